"""What a fresh clone must hold: exact locks without hosts, no path of one machine, data of bounded size."""

import ast
import importlib
import io
import re
import subprocess
import tokenize
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("vision", "fe", "calibrate", "twin")
LOCKS = ("requirements.lock", "requirements-dev.lock", "requirements-docs.lock")
PIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*==[A-Za-z0-9.!+]+( ; [A-Za-z0-9_'\".=!<>() ]+)?")
# The folders where people and build machines keep a checkout; examples in the docs use relative paths.
MACHINE = re.compile(r"(?<![\w.\-/])/(?:home|root|Users|work|mnt)/[\w.-]+")
TEXT = {".py", ".md", ".toml", ".lock", ".cfg", ".txt", ".csv", ".json", ".yml", ".yaml", ".html", ".inp", ""}


def tracked() -> list[Path]:
    """Files of the repository: known to git or about to be, never the ignored ones."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    names = done.stdout.decode().split("\0")
    return [ROOT / name for name in names if name and (ROOT / name).is_file()]


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_holds_exact_pins_and_no_host(name: str) -> None:
    lines = [line.strip() for line in (ROOT / name).read_text(encoding="utf-8").splitlines()]
    lines = [line for line in lines if line and not line.startswith("#") and line != "-r requirements.lock"]
    assert len(lines) >= 5
    assert [line for line in lines if not PIN.fullmatch(line)] == []


def test_the_lock_pins_every_dependency_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    locks = {name: (ROOT / name).read_text(encoding="utf-8").lower() for name in LOCKS}
    extra = project["optional-dependencies"]
    for lock, wanted in zip(LOCKS, (project["dependencies"], [*extra["dev"], *extra["surrogate"]], extra["docs"]), strict=True):
        names = [re.match(r"[A-Za-z0-9._-]+", line).group().lower() for line in wanted]
        text = locks["requirements.lock"] + locks[lock]
        assert [name for name in names if f"\n{name}==" not in text] == []
    assert "\nsetuptools==" in locks["requirements.lock"]  # the project itself is built without a second download


def test_two_locks_pin_one_version() -> None:
    pins = {line for name in LOCKS for line in (ROOT / name).read_text(encoding="utf-8").splitlines() if "==" in line}
    names = [pin.partition("==")[0].lower() for pin in pins]
    assert sorted(name for name in set(names) if names.count(name) > 1) == []


def test_no_file_names_a_path_of_one_machine() -> None:
    files = [path for path in tracked() if path.suffix in TEXT and path.stat().st_size < 2_000_000]
    assert len(files) > 20
    found = []
    for path in files:
        text = path.read_text(encoding="utf-8", errors="replace")
        found += [f"{path.relative_to(ROOT)}: {hit}" for hit in MACHINE.findall(text)]
    assert found == []


def fragments(source: str) -> list[list[str]]:
    """The literals of every text that stands in several, one below the other: what stands between the quotes."""
    found: list[list[str]] = []
    joined: list[tokenize.TokenInfo] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.STRING:
            joined.append(token)
        elif token.type not in (tokenize.NL, tokenize.COMMENT):
            if len({t.start[0] for t in joined}) > 1:
                found.append([re.sub(r"^[rfbuRFBU]*|['\"]", "", t.string) for t in joined])
            joined = []
    return found


def test_no_message_is_torn() -> None:
    """A text that is wrapped by hand keeps at least 12 letters on each line."""
    assert fragments('x = ("one text, "\n     "its "\n     f"rest")') == [["one text, ", "its ", "rest"]]
    packages = [p for p in tracked() if p.suffix == ".py" and p.relative_to(ROOT).parts[0] in PACKAGES]
    assert len(packages) > 100
    torn = {
        str(path.relative_to(ROOT)): short
        for path in packages
        for text in fragments(path.read_text(encoding="utf-8"))
        if (short := [part for part in text if len(part) < 12])
    }
    assert torn == {}


def test_data_files_are_small() -> None:
    sizes = {path.relative_to(ROOT): path.stat().st_size for path in tracked()}
    assert {name: size for name, size in sizes.items() if size > 12e6} == {}
    assert sum(size for name, size in sizes.items() if name.parts[0] == "datasets") <= 30e6


def test_scripts_import_what_is_there() -> None:
    """Benchmarks and examples are run by hand: a name that has moved would be found by whoever types them."""
    for path in (*(ROOT / "benchmarks").rglob("*.py"), *(ROOT / "examples").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES:
                there = importlib.import_module(str(node.module))
                for alias in node.names:
                    if not hasattr(there, alias.name):
                        importlib.import_module(f"{node.module}.{alias.name}")
