"""What the docs name exists: pages, files, commands and their options, keys of twin.toml."""

import re
import tomllib
from functools import cache
from pathlib import Path

import pytest
import typer
from pydantic import BaseModel

from twin.cli import app
from twin.project.config import Config

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("datasets/*/README.md")]
)
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.S | re.M)
PATH = re.compile(r"\b(?:tests|benchmarks|datasets|docs|twin|fe|vision|calibrate)/[\w./-]*\w")
COMMAND = re.compile(r"(?<![\w.-])twin ([a-z]+)((?:[ =][\w./:<>=-]+)*)")


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def code(text: str) -> list[str]:
    """Code spans and lines of code blocks that are not output."""
    blocks = [line for kind, body in BLOCK.findall(text) if kind != "text" for line in body.splitlines()]
    return [*re.findall(r"`([^`\n]+)`", BLOCK.sub("", text)), *blocks]


def headings(page: Path) -> set[str]:
    """Anchors as Git hosts make them: small letters, words joined by hyphens."""
    lines = re.findall(r"^#+ (.+)$", BLOCK.sub("", page.read_text(encoding="utf-8")), re.M)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


def broken_links(page: Path, text: str) -> list[str]:
    found = []
    for link in re.findall(r"\]\(([^)\s]+)\)", BLOCK.sub("", text)):
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        if re.match(r"https?://", link):
            continue
        if not target.exists() or (anchor and anchor not in headings(target)):
            found.append(link)
    return found


@cache
def commands() -> dict[str, set[str]]:
    """The options of every subcommand of `twin`."""
    group = typer.main.get_command(app)
    own = {option for p in group.params for option in p.opts}
    return {
        name: own | {"--help"} | {option for p in command.params for option in p.opts}
        for name, command in group.commands.items()  # type: ignore[attr-defined]
    }


def unknown_commands(text: str) -> list[str]:
    found = []
    for line in code(text):
        for name, rest in COMMAND.findall(line):
            options = re.findall(r"(?<=[ ])--?[a-z][a-z-]*", rest)
            known = commands().get(name, set())
            if name not in commands() or not set(options) <= known:
                found.append(f"twin {name}{rest}")
    return found


def tables(model: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """The tables below a table of twin.toml, by their key."""
    found = {}
    for key, field in model.model_fields.items():
        inner = [t for t in re.findall(r"\b(\w+Table)\b", str(field.annotation))]
        if inner:
            found[key] = next(t for t in _table_models() if t.__name__ == inner[0])
    return found


def _table_models(model: type[BaseModel] = BaseModel) -> list[type[BaseModel]]:
    below = model.__subclasses__()
    return below + [deep for one in below for deep in _table_models(one)]


def unknown_keys(given: dict[str, object], model: type[BaseModel] = Config, *, at: str = "") -> list[str]:
    """Keys of a piece of twin.toml that the config model does not have."""
    found = []
    for key, value in given.items():
        if key not in model.model_fields:
            found.append(f"{at}{key}")
        for row in value if isinstance(value, list) else [value]:
            if isinstance(row, dict) and key in tables(model):
                found += unknown_keys(row, tables(model)[key], at=f"{at}{key}.")
    return found


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    assert broken_links(page, page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_their_options_exist(page: Path) -> None:
    assert unknown_commands(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_that_code_spans_name_exist(page: Path) -> None:
    named = {path for line in code(page.read_text(encoding="utf-8")) for path in PATH.findall(line)}
    assert sorted(path for path in named if not list(ROOT.glob(path)) and not path.startswith("datasets/demo-")) == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_pieces_of_twin_toml_have_keys_that_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    pieces = [tomllib.loads(body) for kind, body in BLOCK.findall(text) if kind == "toml"]
    assert [key for piece in pieces for key in unknown_keys(piece)] == []
    for key, table in re.findall(r"`(\w+)(?: = [^`]*)?`\s+under\s+`\[+([\w.]+)\]+`", text):
        assert unknown_keys(_nested(f"{table}.{key}".split("."))) == []


def _nested(path: list[str]) -> dict[str, object]:
    return {path[0]: _nested(path[1:]) if len(path) > 1 else 0}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_targets_of_make_exist(page: Path) -> None:
    known = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    named = {n for line in code(page.read_text(encoding="utf-8")) for n in re.findall(r"^make ([a-z-]+)$", line)}
    assert named - known == set()


def test_every_page_of_docs_is_reached_from_the_readme() -> None:
    seen: set[Path] = set()
    todo = [ROOT / "README.md"]
    while todo:
        page = todo.pop()
        if page in seen or page.suffix != ".md":
            continue
        seen.add(page)
        links = re.findall(r"\]\(([^)\s#]+)", page.read_text(encoding="utf-8"))
        todo += [(page.parent / link).resolve() for link in links if not link.startswith("http")]
    assert [name_of(page) for page in PAGES if page not in seen] == []


def test_the_readme_has_the_main_command_on_a_line_of_its_own() -> None:
    assert re.search(r"^make demo$", (ROOT / "README.md").read_text(encoding="utf-8"), re.M)


def test_these_checks_see_what_is_wrong() -> None:
    page = ROOT / "README.md"
    assert broken_links(page, "[a](docs/nothing.md) [b](README.md#no-such) [c](CONTRIBUTING.md)") == [
        "docs/nothing.md", "README.md#no-such",
    ]
    assert unknown_commands("`twin nonsense`, `twin measure --budgett -p x`, `twin measure --budget -p x`") == [
        "twin nonsense", "twin measure --budgett -p x",
    ]
    assert unknown_keys({"model": {"denssity": 1, "mesh": 2}, "modell": 1, "points": [{"nod": 1}]}) == [
        "model.denssity", "modell", "points.nod",
    ]
