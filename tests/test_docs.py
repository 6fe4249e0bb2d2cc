"""What the docs name exists: pages, files, commands and their options, keys of twin.toml."""

import importlib
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

from benchmarks.docs import figures, reference, sitepages

import numpy as np
import pytest
import typer
from pydantic import BaseModel

from twin.chain import STAGES, TARGETS
from twin.cli import app
from twin.effects.labels import KINDS
from twin.effects.library import all_effects
from twin.judging.whitening import whitener
from twin.project.config import Config
from twin.project.targetfiles import read_targets
from twin.project.toml import parse
from twin.tablemodel import keys_of
from vision.errors.errormodel import SOURCES

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("datasets/*/README.md")]
)
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.py"))
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.S | re.M)
PATH = re.compile(r"\b(?:tests|benchmarks|datasets|docs|twin|fe|vision|calibrate)/[\w./-]*\w")
# What was measured once names the commit and the command as it was then.
MEASURED = re.compile(r"\bat\s+commit\s+[0-9a-f]{8}\s+by\s+(`[^`]+`|```.*?```)((,| and)?\s+`\w+\.py`| beside it,\s+and `[^`]+`)*", re.S)
DOTTED = re.compile(r"(?<![\w./])(?:fe|vision|calibrate|twin)(?:\.(?!toml|py|md)\w+)+(?![\w/])")
COMMAND = re.compile(r"(?<![\w.-])(?<!from )twin ([a-z]+)((?:[ =][\w./:<>=-]+)*)")


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def code(text: str) -> list[str]:
    """Code spans and lines of code blocks that are not output."""
    blocks = [line for kind, body in BLOCK.findall(text) if kind != "text" for line in body.splitlines()]
    return [*(" ".join(span.split()) for span in re.findall(r"`([^`]+)`", BLOCK.sub("", text))), *blocks]


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
    for key, (_, field) in keys_of(model).items():
        inner = re.findall(r"\b(\w+Table)\b", str(field.annotation))
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
        if key not in keys_of(model):
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


def resolves(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        module = ".".join(parts[:k])
        if (ROOT / Path(*parts[:k])).is_dir() or (ROOT / Path(*parts[:k])).with_suffix(".py").is_file():
            found = importlib.import_module(module)
            return len(parts) == k or hasattr(found, parts[k])
    return False


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_dotted_names_exist(page: Path) -> None:
    named = {n for line in code(page.read_text(encoding="utf-8")) for n in DOTTED.findall(line)}
    assert sorted(name for name in named if not resolves(name)) == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_that_code_spans_name_exist(page: Path) -> None:
    text = MEASURED.sub("", page.read_text(encoding="utf-8"))
    named = {path for line in code(text) for path in PATH.findall(line)}
    assert sorted(path for path in named if not list(ROOT.glob(path)) and not path.startswith("datasets/demo-")) == []


def blocks(text: str) -> list[tuple[str, str]]:
    """(kind, body) of every code block; of one that stands below a line "`targets/FILE`:" the kind is FILE, and
    below "`slurm.toml`:" that."""
    below = r"^`(?:targets/)?((?<=/)\S+|slurm\.toml)`:\n\n```\w+\n(.*?)^```$"
    named = {body: file for file, body in re.findall(below, text, re.S | re.M)}
    return [(named.get(body, kind), body) for kind, body in BLOCK.findall(text)]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_pieces_of_twin_toml_have_keys_that_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    pieces = [tomllib.loads(body) for kind, body in blocks(text) if kind == "toml"]
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


def test_the_site_has_every_page_once() -> None:
    """What mkdocs.yml names: the pages of the repository, and those that sitepages.py makes."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    named = re.findall(r"[\w./-]+\.md$", text, re.M)
    notebooks = [f"examples/notebooks/{path.stem}.md" for path in NOTEBOOKS]
    made = ["examples/README.md", *notebooks, *(f"reference/{name}.md" for name in sitepages.PACKAGES)]
    assert sorted(named) == sorted([*map(name_of, PAGES), *made])


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=name_of)
def test_what_a_notebook_names_exists(notebook: Path) -> None:
    text = notebook.read_text(encoding="utf-8")
    said = "\n".join(line[2:] for line in text.splitlines() if line.startswith("# "))
    assert broken_links(notebook, said) == []
    assert unknown_commands(said) == []
    assert unknown_commands(f"```\n{text}```") == []
    assert f"`{name_of(notebook)}`" in (ROOT / "docs" / "python.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("package", ["vision", "fe", "twin"])
def test_contributing_names_the_rooms(package: str) -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    row = next(line for line in text.partition("## Rooms")[2].splitlines() if line.startswith(f"| `{package}`"))
    named = set(re.findall(r"`(\w+)`", row)) - {package}
    rooms = {path.parent.name for path in (ROOT / package).glob("*/__init__.py")}
    modules = {path.stem for path in (ROOT / package).rglob("*.py")}
    assert rooms <= named <= rooms | modules


def test_the_readme_has_each_main_command_on_a_line_of_its_own() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"^make demo.*$", text, re.M) == ["make demo-quick", "make demo"]


def test_made_pages_are_as_the_program_makes_them() -> None:
    made = reference.pages()
    stale = [name for name, text in made.items() if (ROOT / "docs" / name).read_text(encoding="utf-8") != text]
    assert stale == [], "run: python benchmarks/docs/reference.py"
    assert all(f"`{key}`" in made["twin-toml.md"] for table in all_tables() for key in keys_of(table) if key not in tables(table))


def all_tables(model: type[BaseModel] = Config) -> list[type[BaseModel]]:
    return [model, *(deep for one in tables(model).values() for deep in all_tables(one))]


def test_every_effect_has_its_section_and_its_picture_every_family_and_stand_in_its_row() -> None:
    text = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    assert [e.name for e in all_effects() if f"\n### {e.name}\n" not in text] == []
    families = [wide.label for e in all_effects() if (wide := e.wide()) is not None]
    assert [name for name in families if f"`{name}`" not in text] == []
    assert [words for words in KINDS.values() if f"\n| {words} |" not in text] == []
    pictures = {path.stem for path in (ROOT / "docs" / "pictures" / "effects").glob("*.png")}
    assert pictures == {e.name for e in all_effects()}, "run: python benchmarks/docs/pictures.py --only effects"


def test_every_file_that_a_stage_writes_is_explained() -> None:
    text = (ROOT / "docs" / "files.md").read_text(encoding="utf-8").split("<!-- end -->")[1]
    written = {name for stage in STAGES for name in stage.writes if name != TARGETS}
    assert sorted(name for name in written if f"`{name}`" not in text) == []


def test_every_source_of_the_error_budget_is_explained() -> None:
    text = (ROOT / "docs" / "measuring-chain.md").read_text(encoding="utf-8")
    assert [source for source in SOURCES if f"\n| `{source}` |" not in text] == []


def terms() -> set[str]:
    """The words that the glossary explains."""
    rows = re.findall(r"^\| ([^|]+) \|", (ROOT / "docs" / "concepts.md").read_text(encoding="utf-8").partition("## Glossary")[2], re.M)
    return {word.strip() for row in rows for word in row.split(",")}


def words_of_the_report() -> set[str]:
    """What stands over the columns and in the first cells of the report's tables, without units and markup."""
    page = (ROOT / "twin" / "report" / "report.html").read_text(encoding="utf-8")
    heads = [re.sub(r"\{[{%].*?[%}]\}|<[^>]+>", "", head) for head in re.findall(r"<th[^>]*>(.*?)</th>", page)]
    return {head.removesuffix(", RMS mm").removesuffix(", mm").removesuffix(", %").removesuffix(", sd").strip() for head in heads}


# Columns that say what they hold to anybody, and those of `twin study`, which its page explains below them.
PLAIN = {
    "", "effect", "parameter", "value", "unit", "without", "with", "made smaller by", "held-out film", "before / after",
    "source, 1 sd in um", "here", "published", "node", "values", "one reading more", "several readings more",
    "sd of the share", "error wanted", "correlation of C10 and C01", "other initial models: C10, MPa", "C01, MPa",
    "initial RMS", "reduction",
}  # fmt: skip
# Words of the terminal and of the recording, as they stand in the code.
SAID = (
    "adequate", "at its bound", "BIC gain", "evidence", "foretold", "generation", "held out",
    "nominal constants", "not refitted", "not visible", "p-value", "residual", "score", "share", "times its noise",
)  # fmt: skip


def test_the_glossary_holds_the_words_of_report_and_terminal() -> None:
    words = {part for head in words_of_the_report() - PLAIN for part in head.split(", ")}
    assert len(words) > 8
    assert sorted(words - terms()) == []
    code = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "twin").rglob("*.*") if path.suffix in (".py", ".html"))
    assert [word for word in SAID if word not in code] == []  # a word that the program has given up
    explained = (ROOT / "docs" / "concepts.md").read_text(encoding="utf-8").partition("## Glossary")[2]
    rows = re.findall(r"^\| ([^|]+) \|", explained, re.M)
    assert [word for word in SAID if not any(word in row for row in rows)] == []


def test_every_figure_of_the_demo_stands_once_in_its_page() -> None:
    for figure in figures.FIGURES:
        text = (ROOT / figure.page).read_text(encoding="utf-8")
        assert len(figure.pattern.findall(text)) == 1, figure
        assert len(figure.pattern.search(text).groups()) == len(figure.places), figure


def test_a_figure_that_a_run_does_not_have_is_named_and_mended() -> None:
    figure = figures.Figure("README.md", "from # to # mm in # minutes", ("a/b:c", "a/b:d", "minutes:"))
    page = "It falls from 0.169 to\n0.045 mm in 13 minutes."
    assert figures.wrong(page, figure, [0.1686, 0.0449, 600.0]) == []  # rounded; a busy machine takes any time
    (one,) = figures.wrong(page, figure, [0.1886, 0.0449, 35.0])
    assert one == "README.md: 'from # to # mm in # minutes' has 0.169, wanted 0.1886 (a/b:c)"
    assert len(figures.wrong(page, figure, [-0.1686, 0.06, 60.0])) == 2
    assert figures.written(page, figure, [0.1886, 1.5, 35.0]) == "It falls from 0.189 to\n1.500 mm in 13 minutes."
    assert figures.written(page, figure, [0.1686, 0.0449, 60.0]).endswith("mm in 60 minutes.")
    assert figures.wrong("Nothing.", figure, [1.0, 1.0, 1.0]) == [
        "README.md: no 'from # to # mm in # minutes' in it; correct the page, or FIGURES of figures.py",
    ]


def test_a_place_leads_to_a_number_of_a_project(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "0003-add"
    run.mkdir(parents=True)
    (run / "fit.json").write_text(
        '{"parameters": {"creep.g1": {"value": 0.03}}, "rows": [{"z": 1}, {"z": 2}], "said": "C10 = 0.2 MPa, -0.7, 95 %"}'
    )
    for place, wanted in (("parameters.creep.g1.value", 0.03), ("rows.1.z", 2.0), ("said#1", 0.2), ("said#2", -0.7)):
        assert figures.value(tmp_path, f"add/fit.json:{place}") == wanted


def test_every_picture_stands_in_a_page() -> None:
    shown = {(page.parent / link).resolve() for page in PAGES for link in re.findall(r"\]\(([^)\s#]+)", page.read_text(encoding="utf-8"))}
    pictures = [path for path in (ROOT / "docs" / "pictures").rglob("*.*") if path.suffix != ".txt"]
    assert [path.name for path in pictures if path.resolve() not in shown] == []


def test_pictures_are_small() -> None:
    assert sum(path.stat().st_size for path in (ROOT / "docs").rglob("*.*") if path.suffix in (".png", ".svg")) <= 1.6e6


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """The folder with the files of docs/files.md as they stand there."""
    text = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
    folder = tmp_path / "targets"
    folder.mkdir()
    for name, body in blocks(text):
        if name in ("targets.csv", "targets.toml", "pressure.csv"):
            (folder / name).write_text(body, encoding="utf-8")
    script = next(body for kind, body in blocks(text) if kind == "python")
    (tmp_path / "noise.py").write_text(script, encoding="utf-8")
    return folder


def test_the_smallest_example_of_files_is_read(example: Path) -> None:
    for name in ("targets.toml", "pressure.csv"):
        (example / name).unlink()
    targets = read_targets(example, nodes={"tip": 4401, "middle": 5848})
    assert targets.value[2, 0].tolist()[::2] == [-25.69, -57.2]
    assert np.isnan(targets.value[..., 1]).all()
    assert targets.valid.sum() == 8
    assert targets.noise is None
    assert not targets.has_log


def test_the_example_with_a_noise_model_is_read(example: Path) -> None:
    subprocess.run([sys.executable, "noise.py"], cwd=example.parent, check=True, timeout=60)
    targets = read_targets(example)
    assert targets.noise is not None
    assert targets.noise.frames == 400
    assert targets.noise.sd[0].tolist()[::2] == [0.1, 0.1]
    assert targets.mode_names == ("scale",)
    assert targets.modes[0, 2, 0, 2] == pytest.approx(-0.0572)
    assert targets.covariance[2, 1, 0, 0] == pytest.approx(0.01)
    assert targets.pressure_sd.tolist() == [5e-5] * 3
    assert targets.has_log
    assert targets.gravity is not None
    weights = whitener(targets, prediction_modes=np.zeros((0, *targets.value.shape)), gauge=np.zeros(targets.value.shape))
    assert np.isfinite(weights.whiten(np.nan_to_num(targets.value))).all()


def test_the_shortest_twin_toml_is_a_configuration() -> None:
    text = (ROOT / "docs" / "twin-toml.md").read_text(encoding="utf-8")
    piece = next(body for kind, body in blocks(text) if kind == "toml")
    assert parse(piece.encode(), name="the example").points[0].node == 4401


def test_these_checks_see_what_is_wrong() -> None:
    page = ROOT / "README.md"
    assert broken_links(page, "[a](docs/nothing.md) [b](README.md#no-such) [c](CONTRIBUTING.md)") == [
        "docs/nothing.md", "README.md#no-such",
    ]
    assert unknown_commands("of `a b` and `twin\nnonsense` on two lines") == ["twin nonsense"]
    assert unknown_commands("`twin nonsense`, `twin measure --budgett -p x`, `twin measure --budget -p x`") == [
        "twin nonsense", "twin measure --budgett -p x",
    ]
    assert unknown_keys({"model": {"denssity": 1, "mesh": 2}, "modell": 1, "points": [{"nod": 1}]}) == [
        "model.denssity", "modell", "points.nod",
    ]
