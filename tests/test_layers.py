"""The layers of CONTRIBUTING.md, read from the import statements (nothing is imported here)."""

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LEAVES = ("vision", "fe", "calibrate")
PACKAGES = (*LEAVES, "twin")
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}


def imports(source: str, *, package: str) -> set[str]:
    """Dotted names that a module may import, wherever in it the statement stands.

    `from a import b` gives both a and a.b: b may be a module. Relative names are made absolute.
    """
    return named(ast.walk(ast.parse(source)), package=package)


def named(nodes: Iterable[ast.AST], *, package: str) -> set[str]:
    """Dotted names in those of the nodes that import."""
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {module, *(f"{module}.{alias.name}" for alias in node.names)}
    return found


@cache
def imports_of(name: str) -> set[str]:
    package = name if FILES[name].name == "__init__.py" else name.rpartition(".")[0]
    return named(ast.walk(parsed(name)), package=package)


def reached_from(name: str) -> set[str]:
    """Own modules that the import of `name` may load: transitively, with every package's __init__."""
    seen: set[str] = set()
    todo = [name]
    while todo:
        module = todo.pop()
        if module in seen or module not in FILES:
            continue
        seen.add(module)
        todo += [module.rpartition(".")[0], *imports_of(module)]
    return seen


@pytest.mark.parametrize("leaf", LEAVES)
def test_a_leaf_imports_no_other_package_of_ours(leaf: str) -> None:
    own = set(PACKAGES) - {leaf}
    modules = [name for name in FILES if name.split(".")[0] == leaf]
    assert modules, f"{leaf} has no modules: this test would see nothing"
    breaches = {(name, used) for name in modules for used in imports_of(name) if used.split(".")[0] in own}
    assert not breaches


@pytest.mark.parametrize("banned", ["felupe", "pickle", "dill", "cloudpickle", "shelve", "joblib"])
def test_no_package_imports(banned: str) -> None:
    assert not [name for name in FILES if any(used.split(".")[0] == banned for used in imports_of(name))]


PARTS = ("fft", "integrate", "interpolate", "ndimage", "optimize", "signal", "spatial", "special", "stats")


@pytest.mark.parametrize("slow", [*(f"scipy.{part}" for part in PARTS), "pandas", "matplotlib.pyplot", "pyvista"])
def test_what_takes_long_to_import_is_imported_where_it_is_called(slow: str) -> None:
    assert not [name for name in FILES if slow in named(parsed(name).body, package=name.rpartition(".")[0])]


def test_no_package_imports_tests_or_benchmarks() -> None:
    banned = {"tests", "benchmarks", "datasets"}
    assert not [name for name in FILES if any(used.split(".")[0] in banned for used in imports_of(name))]


BENCHES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for folder in ("benchmarks", "tests/strangers")
    for path in sorted((ROOT / folder).rglob("*.py"))
}


def test_benchmarks_and_what_they_plant_have_no_circle_and_shadow_no_package() -> None:
    used = {name: imports(path.read_text(encoding="utf-8"), package=name.rpartition(".")[0]) for name, path in BENCHES.items()}
    assert list(TopologicalSorter({name: found & set(BENCHES) for name, found in used.items()}).static_order())
    assert not {path.stem for path in BENCHES.values()} & set(PACKAGES)
    assert not [n for n, path in BENCHES.items() if "__main__" in path.read_text(encoding="utf-8") and n.startswith("benchmarks") and '__file__}/../..' not in path.read_text(encoding="utf-8")]


def test_no_module_is_a_drawer_for_anything() -> None:
    banned = {"utils", "util", "common", "core", "helpers", "misc"}
    assert not [name for name in FILES if banned & {part.lstrip("_") for part in name.split(".")}]


def test_datasets_hold_no_python() -> None:
    assert not list((ROOT / "datasets").rglob("*.py"))


JUDGES = (
    "twin.diagnosis.procedure", "twin.bench.workbench", "twin.bench.effectchange", "twin.study.generations",
    *(f"twin.commands.{name}" for name in ("calibrate", "compare", "diagnose", "add", "drop", "explain", "profile", "posterior", "pareto")),
)  # fmt: skip


@pytest.mark.parametrize("judge", JUDGES)
def test_who_judges_cannot_see_the_virtual_laboratory(judge: str) -> None:
    reached = reached_from(judge)
    assert {"twin", judge} <= reached
    laboratory = {name for name in FILES if room_of(name) == "twin.virtual"}
    assert len(laboratory) > 3  # else the lines below prove nothing
    assert not reached & laboratory
    assert not [name for name in reached if imports_of(name) & laboratory]


def test_the_reader_of_imports_sees_every_form() -> None:
    source = "import a.b\ndef f():\n    from .c import d\n    from .. import e\nfrom g import h as i\n"
    assert imports(source, package="p.q") >= {"a.b", "p.q.c", "p.q.c.d", "p.e", "g", "g.h"}


def test_every_package_says_that_it_is_typed() -> None:
    assert all((ROOT / package / "py.typed").is_file() for package in PACKAGES)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_exports_at_most_twelve_names(package: str) -> None:
    tree = ast.parse(FILES[package].read_text(encoding="utf-8"))
    assigned = {ast.unparse(n.targets[0]): n.value for n in tree.body if isinstance(n, ast.Assign)}
    assert "__all__" in assigned, f"{package}/__init__.py states its __all__"
    most = 21 if package == "twin" else 12  # data, actuators, programs, fits; what an effect of one's own needs
    assert len(ast.literal_eval(assigned["__all__"])) <= most


# -- rooms: the sub-packages, and every module that lies beside them -----------------------------------------


def room_of(module: str) -> str:
    """The room a module lies in: its sub-package, or itself where it lies in the package's own folder."""
    return ".".join(module.split(".")[:2])


def rooms(package: str, imported: dict[str, set[str]]) -> dict[str, set[str]]:
    """For each room of a package the rooms that its modules import (the API in `__init__` is none)."""
    found: dict[str, set[str]] = {}
    for module, names in imported.items():
        if module.split(".")[0] != package or module == package:
            continue
        used = {room_of(name) for name in names if name in FILES and name.count(".") >= 1}
        own = found.setdefault(room_of(module), set())
        own |= {room for room in used if room.split(".")[0] == package} - {room_of(module)}
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_the_rooms_of_a_package_have_an_order(package: str) -> None:
    imported = {name: imports_of(name) for name in FILES}
    graph = rooms(package, imported)
    assert len(graph) > 2, f"{package}: this test would see nothing"
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"rooms import each other in a circle: {' <- '.join(error.args[1])}")


def test_a_circle_of_rooms_is_seen() -> None:
    imported = {"fe.mesh.finger": {"fe.kernel.assembly"}, "fe.kernel.assembly": {"fe.mesh.finger"}}
    with pytest.raises(CycleError):
        TopologicalSorter(rooms("fe", imported)).prepare()


GROUND_FLOOR = {"table", "targets", "gravity", "sanity", "fitmemory", "tablemodel", "marktables", "validation", "records", "files", "csvtable", "messages", "numerals", "effort"}
ENGINE = GROUND_FLOOR | {
    "laws", "effects", "bodies", "model", "contract", "executors", "judging", "gauge", "coupons", "review",
    "virtual", "experiments", "ringing", "formats", "drawing", "diagnosis", "calibrated", "foreign", "assets",
}  # fmt: skip


def over_the_wall(imported: dict[str, set[str]]) -> set[tuple[str, str]]:
    """Imports from an engine room, or the ground floor, into a room that knows the folder of a project."""
    return {
        (module, used)
        for module, names in imported.items()
        for used in names
        if room_of(module).removeprefix("twin.") in ENGINE and used.startswith("twin.") and used in FILES
        if room_of(used).removeprefix("twin.") not in ENGINE
    }


def test_the_engine_knows_no_folder() -> None:
    """A twin is an object, and a project's folder one way to make it."""
    rooms_now = {room_of(name).removeprefix("twin.") for name in FILES if name.startswith("twin.")}
    assert rooms_now >= ENGINE, "a room has gone or was renamed: this test would see less than it says"
    assert over_the_wall({name: imports_of(name) for name in FILES if name.startswith("twin.")}) == set()
    breach = {"twin.judging.fitrecord": {"twin.records", "twin.project.folder"}}  # the mutant
    assert over_the_wall(breach) == {("twin.judging.fitrecord", "twin.project.folder")}


def test_every_room_says_what_it_is_for() -> None:
    silent = [
        name
        for name, path in FILES.items()
        if path.name == "__init__.py" and len((ast.get_docstring(parsed(name)) or "").split()) < 8
    ]
    assert silent == []


def unnamed(docstring: str, modules: set[str]) -> set[str]:
    """The modules that a docstring does not name in backticks."""
    return modules - set(re.findall(r"`([a-z0-9_]+)`", docstring))


def test_every_room_names_its_modules() -> None:
    """The docstring of a room is where a newcomer learns in which order to read its modules."""
    assert unnamed("Read `a` first, then b.", {"a", "b"}) == {"b"}
    silent = {}
    for name, path in FILES.items():
        if path.name == "__init__.py":
            own = {beside.stem for beside in path.parent.glob("*.py")} - {"__init__"}
            left = unnamed(ast.get_docstring(parsed(name)) or "", own)
            silent |= {name: left} if left else {}
    assert silent == {}


# -- names ---------------------------------------------------------------------------------------------------


@cache
def parsed(name: str) -> ast.Module:
    return ast.parse(FILES[name].read_text(encoding="utf-8"))


def defined(name: str, kinds: tuple[type[ast.stmt], ...]) -> set[str]:
    """Public names of one kind that a module defines at its top level."""
    body = (node for node in parsed(name).body if isinstance(node, kinds))
    return {node.name for node in body if not node.name.startswith("_")}  # type: ignore[attr-defined]


MODULES = [name for name, path in FILES.items() if path.name != "__init__.py"]


def test_no_two_public_classes_share_a_name() -> None:
    where = defaultdict(list)
    for module in MODULES:
        for name in defined(module, (ast.ClassDef,)):
            where[name].append(module)
    assert {name: modules for name, modules in where.items() if len(modules) > 1} == {}


def test_no_module_has_the_name_of_what_it_defines() -> None:
    """Names are unique within a room, which a folder gives; a module `compare` with a function `compare` would
    still leave it open which of the two an import means."""
    kinds = (ast.FunctionDef, ast.ClassDef)
    modules = [name for name in MODULES if name.rpartition(".")[2] in defined(name, kinds)]
    assert modules == []


def test_array_is_defined_once_in_a_package() -> None:
    """Leaves share numpy arrays and nothing else, so each package has the alias once."""
    defining = Counter(
        module.split(".")[0]
        for module in MODULES
        for node in parsed(module).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "Array"
    )
    assert defining == dict.fromkeys(PACKAGES, 1)
