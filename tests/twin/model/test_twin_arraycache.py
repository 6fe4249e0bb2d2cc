"""Keys of stored arrays: they change with everything that the arrays depend on, and with nothing else."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fe import Case
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NOMINAL, mooney_rivlin
from twin.model import discretisation, loadpaths
from twin.model.arraycache import SOURCES, no_cache, rounded_up, sources_digest
from twin.model.discretisation import SolvedAt, discretisation_error, meshes_key
from twin.model.keptmodel import base_test
from twin.model.loadpaths import load_paths, reach
from twin.model.structure import BuiltIn, Structure, of_finger, weighed
from twin.targets import Array, Targets

DOWN = np.array([[0.0, 0.0, -1.0]])


class Asked:
    """A cache that makes nothing: it keeps the keys that are asked for."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.keys: set[str] = set()
        self.shape = shape

    def __call__(self, stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
        self.keys |= set(tasks)
        return dict.fromkeys(tasks, np.zeros(self.shape))


def test_no_cache_makes_every_array() -> None:
    made = no_cache("stage", {"a": partial(np.zeros, 2), "b": partial(np.ones, 2)})
    np.testing.assert_array_equal(made["b"], [1.0, 1.0])
    assert set(made) == {"a", "b"}


def test_the_digest_of_the_code_changes_with_any_source(tmp_path: Path) -> None:
    for source in SOURCES:
        file = tmp_path / source if source.endswith(".py") else tmp_path / source / "room" / "a.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("x = 1\n")
    seen = [sources_digest(tmp_path)]
    (tmp_path / "fe" / "notes.txt").write_text("no source")
    assert sources_digest(tmp_path) == seen[0]
    for file in sorted(tmp_path.rglob("*.py")):
        file.write_text("x = 2\n")
        seen.append(sources_digest(tmp_path))
    os.rename(tmp_path / "fe" / "room" / "a.py", tmp_path / "fe" / "room" / "b.py")
    seen.append(sources_digest(tmp_path))
    assert len(set(seen)) == len(SOURCES) + 2


@pytest.mark.parametrize("nominal", [0.01, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06, 0.1])
def test_logs_of_one_nominal_pressure_ask_for_the_same(nominal: float) -> None:
    rng = np.random.default_rng(1)
    highest = nominal * (1 + 0.003 * rng.uniform(-1, 1, 50))
    found = {rounded_up(p) for p in highest}
    assert len(found) == 1
    assert nominal < found.pop() < 1.15 * nominal


def finger(builtin: BuiltIn) -> Structure:
    return of_finger(builtin.finger, builtin.lattice)


def mesh_keys(structure: Structure, targets: Targets, at: SolvedAt) -> set[str]:
    """The keys of the finer meshes' responses."""
    asked = Asked((discretisation.SAMPLES, 2, 3))
    discretisation_error(base_test(targets, structure.case), structure=structure, solved_at=at, cache=asked)
    return asked.keys


def test_finer_meshes_are_solved_anew_where_anything_changes(
    short_builtin: BuiltIn, make_targets: Callable[..., Targets], monkeypatch: pytest.MonkeyPatch
) -> None:
    untabled = replace(short_builtin, finger=replace(short_builtin.finger, top=2.05))
    at, structure, t = SolvedAt(NOMINAL, 0.024), finger(untabled), make_targets()
    base = mesh_keys(structure, t, at)
    assert mesh_keys(finger(untabled), make_targets(value=t.value + 1.0), at) == base  # measured anew
    assert len(base) == 1 + len(structure.finer)
    down = replace(make_targets(), gravity=DOWN)
    heavy = weighed(structure, 1.07e-9)
    forced = replace(structure, case=replace(structure.case, forces={"tip_face": np.array([0.0, 0.0, 0.1])}))
    finer_base = replace(untabled, lattice=replace(untabled.lattice, caps=2))
    longer = replace(untabled, finger=replace(untabled.finger, top=2.1))
    tip, middle, *others = t.points
    swapped = (replace(tip, node=middle.node), replace(middle, node=tip.node), *others)
    changed: dict[str, set[str]] = {
        "constants": mesh_keys(structure, t, SolvedAt(mooney_rivlin(0.21, 0.1), 0.024)),
        "pressure": mesh_keys(structure, t, SolvedAt(NOMINAL, 0.03)),
        "mesh": mesh_keys(finger(finer_base), t, at),
        "dimension": mesh_keys(finger(longer), t, at),
        "force": mesh_keys(forced, t, at),
        "weight": mesh_keys(heavy, down, at),
        "density": mesh_keys(weighed(structure, 1.1e-9), down, at),
        "gravity": mesh_keys(heavy, replace(down, gravity=-DOWN), at),
        "point": mesh_keys(structure, replace(t, points=swapped), at),
    }  # fmt: skip
    monkeypatch.setattr(discretisation, "code_digest", lambda: "another version")
    changed["code"] = mesh_keys(structure, t, at)
    assert [name for name, keys in changed.items() if keys & base] == []
    assert len(set.union(*changed.values())) == len(changed["mesh"]) * (len(changed))


def test_the_list_of_solved_constants_belongs_to_one_structure_under_one_load(
    short_builtin: BuiltIn, make_targets: Callable[..., Targets]
) -> None:
    structure = finger(short_builtin)
    test, heavy = base_test(make_targets(), structure.case), weighed(structure, 1.07e-9)
    down = base_test(make_targets(gravity=DOWN), heavy.case)
    keys = [meshes_key(test, structure), meshes_key(down, heavy), meshes_key(base_test(make_targets(gravity=-DOWN), heavy.case), heavy)]
    assert meshes_key(base_test(make_targets(), structure.case), finger(short_builtin)) == keys[0]
    assert len(set(keys)) == 3


def path_keys(case: Case, points: Array, **named: Any) -> set[str]:
    asked = Asked((61, len(points), 3))
    load_paths(case, points, **{"cache": asked, "key": "structure", **named})
    return asked.keys


def test_load_paths_are_solved_anew_where_anything_changes(
    short_case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = short_case.position(4401)[None]
    base = path_keys(short_case, points)
    assert path_keys(short_case, points.copy()) == base
    assert len(base) == MOONEY_RIVLIN.shapes[0].count
    assert all(key.isalnum() for key in base)  # fit for file names
    found = [
        path_keys(short_case, points + 1.0),
        path_keys(short_case, points, key="another"),
        path_keys(short_case, points, top=0.2),
        path_keys(short_case, points, scale=0.2),
        path_keys(short_case, points, outside={"gravity": 9810.0 * DOWN[0]}),
    ]
    for name, value in (("LEVELS", 6), ("code_digest", lambda: "another version")):
        with monkeypatch.context() as patch:
            patch.setattr(loadpaths, name, value)
            found.append(path_keys(short_case, points))
    assert len(set.union(base, *found)) == MOONEY_RIVLIN.shapes[0].count * (1 + len(found))


def test_how_far_a_deck_goes_is_solved_anew_for_another_pressure(short_case: Case) -> None:
    asked = [Asked((1,)) for _ in range(4)]
    for one, (wanted, key) in zip(asked, [(0.3, "a"), (0.3, "a"), (0.4, "a"), (0.3, "b")], strict=True):
        reach(short_case, MOONEY_RIVLIN, wanted, cache=one, key=key)
    assert asked[0].keys == asked[1].keys
    assert len(set.union(*(one.keys for one in asked))) == 3
