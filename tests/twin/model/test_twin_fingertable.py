"""The tables that come with the package: of the meshes and laws of today, and of no other finger."""

from dataclasses import replace

from benchmarks.kernel.fingertable import structure as shipped

import numpy as np
import pytest

from fe import Path, solve
from fe.mesh.points import nearest
from tests.twin.conftest import COARSE, SHORT
from twin.effects.protocol import Test
from twin.laws.mooneyrivlin import NOMINAL, mooney_rivlin
from twin.model.arraycache import ArrayCache
from twin.model.discretisation import SolvedAt, discretisation_error
from twin.model.fingertable import FieldSums, KnownFinger, table_of
from twin.model.structure import BuiltIn, Structure, of_finger
from twin.targets import Array

STALE = 2e-3  # mm of 58: a changed mesh or law moves the tip by more, a sum of fields by a hundredth of it
TOP = 0.03  # MPa


@pytest.fixture(scope="module", params=["default", "quick", "short"])
def structure(request: pytest.FixtureRequest) -> Structure:
    return of_finger(SHORT, COARSE) if request.param == "short" else shipped(request.param)


@pytest.fixture(scope="module")
def table(structure: Structure) -> KnownFinger:
    found = table_of(structure)
    assert found is not None, "python benchmarks/kernel/fingertable.py makes it"
    return found


@pytest.fixture(scope="module")
def points(structure: Structure) -> Array:
    """The tip, the middle, and a place beside every node."""
    tip = structure.case.position(4401)
    return np.array([tip, structure.case.position(5848), [0.43 * tip[0], tip[1], 0.0]])


def test_it_is_what_the_finger_does_today(structure: Structure, table: KnownFinger, points: Array) -> None:
    """Where this fails a mesh or a law has changed: python benchmarks/kernel/fingertable.py, and of the short
    finger python -m tests.twin.shortfinger."""
    C = mooney_rivlin(0.214, 0.083)
    found = solve(structure.case.with_material(**C.named), _at(TOP))
    known = table.load_paths(structure.case, points).predict(C, np.array([TOP]))
    assert known is not None
    np.testing.assert_allclose(known[0], found.at(points)[0], rtol=0, atol=STALE)
    assert known[0, 0, 2] < -0.1 * points[0, 0]


@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n == "base" else pytest.mark.slow) for n in (
    "base", *BuiltIn().finer(BuiltIn().lattice))])  # fmt: skip
def test_its_finer_meshes_are_those_of_today(
    structure: Structure, table: KnownFinger, points: Array, name: str
) -> None:
    mesh = {"base": structure.base, **structure.finer}[name]
    found = solve(mesh.build().with_material(**NOMINAL.named), _at(TOP))
    points = np.array([nearest(found.case, x) for x in points])
    known = table.response(mesh, constants=NOMINAL, pressure=np.array([TOP]), points=points)
    np.testing.assert_allclose(known[0], found.at(points)[0], rtol=0, atol=STALE)


def test_the_error_of_the_mesh_asks_for_no_solve(structure: Structure, points: Array) -> None:
    pressure = np.linspace(0.0, TOP, 5)
    moving = np.ones(len(points), bool)
    test = Test(structure.case, Path(pressure, pressure, pressure), points, moving)

    def refused(stage: str, tasks: object, /) -> dict[str, Array]:
        raise AssertionError(f"{stage} was solved")

    cache: ArrayCache = refused
    found = discretisation_error(
        test, structure=structure, solved_at=SolvedAt.beside(NOMINAL, TOP), cache=cache
    )
    assert len(found.names) == len(structure.finer)
    assert 0.01 < np.abs(found.changes[-1, 0, -1, 0]).max() < 1.0  # mm at the tip, to the finest mesh
    weight = replace(test.path, gravity=np.array([0.0, 0.0, -9810.0]))
    heavy = replace(test, case=structure.case.with_material(density=1.1e-9), path=weight)
    with pytest.raises(AssertionError, match="was solved"):  # weight is not in the table
        discretisation_error(heavy, structure=structure, solved_at=SolvedAt.beside(NOMINAL, TOP), cache=cache)


def test_another_finger_has_none() -> None:
    own = BuiltIn()
    other = of_finger(replace(own.finger, bottom=own.finger.bottom + 0.1), own.lattice)
    assert table_of(other) is None


def test_fields_are_as_few_as_leave_what_is_allowed() -> None:
    rng = np.random.default_rng(1)
    u = rng.standard_normal((20, 3)) @ rng.standard_normal((3, 30)) + 1e-6 * rng.standard_normal((20, 30))
    found = FieldSums.of(np.arange(10), u.reshape(20, 10, 3), 1e-4)
    assert len(found.basis) == 3
    whole = np.tensordot(found.weights, found.basis, 1)
    assert np.abs(whole.reshape(20, -1) - u).max() < 1e-4


def _at(pressure: float) -> Path:
    p = np.array([0.0, pressure])
    return Path(p, p, p[1:])
