"""Forces at places of a structure: a beam's closed form, balance, halves, derivatives, what is refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Path, Support, Variation, finger_case, solve
from fe.mesh.mirror import mirrored
from fe.solver.loadings import spread
from tests.fe.conftest import COARSE, SILICONE, STUB

TIP = np.array([100.0, 5.0, 5.0])
END = np.array([STUB.length, 0.0, 4.0])  # of the finger, on its plane of symmetry
LOAD = np.array([0.0, 0.0, 1e-4])


@pytest.fixture(scope="module")
def beam(cube: Callable[..., Case]) -> Case:
    """A bar of 100 x 10 x 10 mm, held at x = 0."""
    case = cube((10, 2, 2))
    return replace(case, nodes=case.nodes * [100.0, 10.0, 10.0], supports=(Support("x0", (0, 1, 2)),))


@pytest.fixture(scope="module")
def stub() -> Case:
    return finger_case(SILICONE, finger=STUB, lattice=COARSE)


def pulled(case: Case, place: np.ndarray, *pulls: np.ndarray) -> Path:
    """Stretches of 1 s, each under a pull at a place, without pressure."""
    del case
    time = np.arange(2.0 * len(pulls))
    return Path(time, 0 * time, time[::2] + 0.2, places=place[None], pulls=np.repeat(pulls, 2, axis=0)[:, None])


def test_a_beam_under_a_force_at_its_end_bends_by_its_closed_form(beam: Case) -> None:
    found = solve(beam, pulled(beam, TIP, LOAD)).at(TIP[None])[0, 0, 2]
    young, inertia, length = 6 * (SILICONE.C10 + SILICONE.C01), 10.0**4 / 12, 100.0
    # Timoshenko's shear adds 3 EI / (k G A L^2) = 0.9 %; the held end, which cannot thin out, takes more off
    assert found == pytest.approx(LOAD[2] * length**3 / (3 * young * inertia), rel=0.03)


def test_a_force_is_shared_out_with_its_moment(beam: Case, stub: Case) -> None:
    for case, place in ((beam, TIP), (mirrored(stub), np.array(STUB.tip_node))):
        share = spread(case, place)
        assert share.parts.sum() == pytest.approx(1.0)
        np.testing.assert_allclose(share.parts @ (case.nodes[share.rows] - place), 0, atol=1e-9)
    half = spread(stub, END)
    assert half.parts.sum() == pytest.approx(0.5)


def test_half_and_whole_move_alike(stub: Case) -> None:
    place, whole = END, mirrored(stub)
    path = pulled(stub, place, np.array([0.02, 0.0, -0.05]))
    np.testing.assert_allclose(solve(stub, path).at(place[None]), solve(whole, path).at(place[None]), atol=1e-7)


def test_a_pull_that_changes_moves_as_each_does_alone(beam: Case) -> None:
    ways = LOAD, -3 * LOAD, 0 * LOAD
    both = solve(beam, pulled(beam, TIP, *ways)).at(TIP[None])
    alone = [solve(beam, pulled(beam, TIP, w)).at(TIP[None])[0] for w in ways]
    np.testing.assert_allclose(both, alone, atol=1e-9)
    assert np.abs(both[2]).max() < 1e-9


def test_derivatives_agree_with_differences_where_a_force_has_bent_the_beam(beam: Case) -> None:
    path, h = pulled(beam, TIP, 40 * LOAD, -20 * LOAD), 1e-5

    def stiffer(by: float) -> Case:
        return beam.with_material(C10=SILICONE.C10 + by)

    def stronger(by: float) -> Path:
        return replace(path, pulls=(1 + by) * path.pulls)

    sides = [((stiffer(h), path), (stiffer(-h), path)), ((beam, stronger(h)), (beam, stronger(-h)))]
    found = solve(beam, path, variations=[Variation(*pair, h) for pair in sides]).variations_at(TIP[None])
    for row, (plus, minus) in zip(found, sides, strict=True):
        wanted = (solve(*plus).at(TIP[None]) - solve(*minus).at(TIP[None])) / (2 * h)
        # equilibria are left 1e-9 of their size out of balance, over 2 h of 2e-5
        np.testing.assert_allclose(row, wanted, rtol=2e-4, atol=1e-4 * np.abs(wanted).max())


def test_a_creeping_beam_goes_on_moving_after_the_pull_is_put_on(beam: Case) -> None:
    creeping = beam.with_material(prony=((0.2, 2.0),))
    time = np.linspace(0.0, 12.0, 49)
    pulls = np.where(time < 1.0, 0.0, 1.0)[:, None, None] * 20 * LOAD
    path = Path(time, 0 * time, np.array([0.5, 1.2, 11.0]), places=TIP[None], pulls=pulls)
    rest, soon, late = solve(creeping, path).at(TIP[None])[:, 0, 2]
    assert abs(rest) < 1e-9
    # long after, the moduli are 1 - g of those at once: a slender beam moves by so much more
    assert late / soon == pytest.approx(1 / 0.8, rel=0.05)


def test_a_place_far_from_the_model_is_refused(beam: Case) -> None:
    with pytest.raises(ValueError, match=r"force at \[100.0, 5.0, 40.0\] mm: 30 mm from the nearest node"):
        solve(beam, pulled(beam, np.array([100.0, 5.0, 40.0]), LOAD))


def test_a_place_beside_the_plane_of_half_a_model_is_refused(stub: Case) -> None:
    with pytest.raises(ValueError, match="of half a model: wanted a place on its plane of symmetry"):
        spread(stub, np.array(STUB.tip_node))


def test_pulls_of_another_shape_are_refused() -> None:
    time = np.arange(3.0)
    with pytest.raises(ValueError, match=r"pulls of shape \(2, 3\): wanted \(1, 3\)"):
        Path(time, time, time, places=np.zeros((1, 3)), pulls=np.zeros((2, 3)))
