"""Natural vibrations against beam theory, CalculiX, closed forms of damping, and the other half of a model."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from benchmarks.kernel.beams import Beam
from benchmarks.kernel.vibrations import theirs

import numpy as np
import pytest

from fe import Case, Clamp
from fe.case import Contact
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.mass import Attached, mass_matrix
from fe.dynamics.vibration import _eigen, modes
from fe.mesh.convert import converted
from fe.mesh.mirror import mirrored
from fe.obstacles import Flat
from fe.solver.newton import State, imbalance

CELLS = (8, 1, 1)
DENSITY, G = 1.07e-9, 9810.0  # tonne/mm3, mm/s2
DOWN = np.array([0.0, 0.0, -G])


def dense(case: Case) -> Case:
    return case.with_material(density=DENSITY)


def test_the_mass_of_a_brick_is_its_density_times_its_volume(cube: Callable[..., Case]) -> None:
    for kind in ("hex27", "C3D20R", "C3D10"):
        case = dense(cube((2, 1, 1)))
        case = case if kind == "hex27" else converted(case, kind)
        M, along = mass_matrix(case), np.zeros(3 * len(case.nodes))
        along[2::3] = 1.0
        assert along @ M @ along == pytest.approx(DENSITY, rel=1e-12)
        turn = np.cross([1.0, 0.0, 0.0], case.nodes).ravel()  # the integral of y^2 + z^2
        assert turn @ M @ turn == pytest.approx(DENSITY * 2 / 3, rel=1e-12)
        used = np.unique(case.connectivity)
        block = M[::3, ::3].toarray()[np.ix_(used, used)]
        assert np.linalg.eigvalsh(block).min() > 1e-6 * DENSITY  # every motion has a mass


@pytest.mark.parametrize("tip", [0.0, 2e-5])
def test_a_slender_beam_vibrates_as_beam_theory_says(tip: float) -> None:
    """In both directions, without and with a mass of two thirds of its own at the tip."""
    beam = Beam(tip=tip)
    attached = [Attached(beam.end, tip)] if tip else []
    found = modes(at_rest(beam.case(CELLS), HeldLoad()), count=4, attached=attached)
    assert found.sideways.tolist() == [False, True, False, True]
    theory = [beam.timoshenko(n, sideways=s) for n in (0, 1) for s in (False, True)]
    np.testing.assert_allclose(found.frequency, theory, rtol=0.01)  # the mesh: 0.6 % at most
    tip_only = found.at(beam.end[None])[:, 0]
    assert (np.abs(tip_only).argmax(axis=1) == [2, 1, 2, 1]).all()
    if not tip:
        assert found.frequency[0] == pytest.approx(beam.euler(), rel=0.01)
        # of a cantilever the first takes 61.3 %, the second 18.8 % of the mass
        np.testing.assert_allclose(found.participation[[0, 2], 2], [0.613, 0.188], atol=0.003)
        assert found.mass[0] == pytest.approx(DENSITY * 200 * 14 * 10 / 4, rel=0.01)


def test_a_weight_on_a_thread_slows_the_motion_along_it_alone() -> None:
    beam = Beam(tip=2e-5)
    hung = [Attached(beam.end, beam.tip, way=np.array([0.0, 0.0, 2.0]))]
    found = modes(at_rest(beam.case(CELLS), HeldLoad()), count=2, attached=hung)
    up, aside = found.frequency[~found.sideways][0], found.frequency[found.sideways][0]
    assert up == pytest.approx(beam.timoshenko(), rel=0.005)
    assert aside == pytest.approx(Beam().timoshenko(sideways=True), rel=0.005)


def test_a_body_on_a_soft_clamp_turns_as_a_rigid_one() -> None:
    """omega^2 = 1 / (compliance I) about the clamp's axis, of which the held face has a good part."""
    size, compliance = np.array([4.0, 4.0, 10.0]), 1.0
    case = replace(Beam(4.0, 4.0, 10.0, young=600.0).case((1, 1, 2)), clamp=Clamp("clamp", (0.0, 5.0), compliance))
    found = modes(at_rest(case, HeldLoad()), count=1)
    inertia = DENSITY * size.prod() / 2 * (4.0**2 / 3 + 10.0**2 / 12)  # of the half
    assert found.frequency[0] == pytest.approx(1 / np.sqrt(compliance * inertia) / (2 * np.pi), rel=1e-3)


def test_an_attached_mass_moves_in_its_symmetry_alone() -> None:
    beam = Beam()
    case, one = beam.case(CELLS), Attached(beam.end, 2e-5)
    for components in ([0, 2], [1]):
        M = mass_matrix(case, [one], components=components) - mass_matrix(case)
        ways = np.tile(np.eye(3), len(case.nodes))
        np.testing.assert_allclose(
            np.diag(ways @ M @ ways.T), [1e-5 * (d in components) for d in range(3)], atol=1e-18
        )
        assert abs(M[1::3, 1::3]).max() > 0 if 1 in components else not M[1::3].nnz


def test_half_a_finger_has_the_vibrations_of_the_whole(stub: Case) -> None:
    half = replace(dense(stub), clamp=stub.clamp and replace(stub.clamp, compliance=1e-3))
    held = HeldLoad(0.03, gravity=DOWN)
    one, both = (modes(at_rest(case, held), count=3) for case in (half, mirrored(half)))
    # sideways the clamp of the half is rigid, as that of the whole turns about y alone
    np.testing.assert_allclose(one.frequency, both.frequency, rtol=1e-6)
    np.testing.assert_allclose(one.mass, both.mass, rtol=1e-6)
    np.testing.assert_allclose(one.participation, both.participation, atol=1e-6)
    stiff = modes(at_rest(dense(stub), held), count=3)
    assert stiff.frequency[0] > 1.01 * one.frequency[0]


def test_a_vibration_feels_the_forces_of_the_pressurised_state(stub: Case) -> None:
    """omega^2 of a shape against differences of the residual, the pressure following along."""
    loaded = at_rest(dense(stub), HeldLoad(0.03, gravity=DOWN))
    found = modes(loaded, count=2)
    shape, problem = found.shape[~found.sideways][0], loaded.problem
    step, h = loaded.step(0.0), 1e-4
    strain = np.swapaxes(step.system.coupling, 1, 2) @ shape[stub.connectivity].reshape(len(stub.connectivity), -1, 1)
    pressure = (step.system.compliance @ strain)[..., 0]
    sides = [
        imbalance(problem, State(loaded.state.u + s * shape, loaded.state.p + s * pressure), 0.03, None).force
        for s in (h, -h)
    ]
    work = float(((sides[0] - sides[1]) / (2 * h) * shape).sum())
    omega = 2 * np.pi * found.frequency[~found.sideways][0]
    M = mass_matrix(problem.case)
    assert work / (shape.ravel() @ M @ shape.ravel()) == pytest.approx(omega**2, rel=1e-5)
    assert abs(modes(at_rest(dense(stub), HeldLoad()), count=1).frequency[0] / found.frequency[0] - 1) > 0.01


def test_a_loaded_finger_vibrates_as_in_calculix(stub: Case, require: Callable[[str], None], tmp_path: Path) -> None:
    require("ccx")
    case = converted(dense(stub), "C3D20RH")
    pulled = replace(case, forces={"tip_face": np.array([0.3, 0.0, -0.3])}, pressurised=None)
    found = modes(at_rest(pulled, HeldLoad()), count=8)
    other = theirs(pulled, 0.0, count=3, folder=tmp_path)
    np.testing.assert_allclose(found.frequency[~found.sideways][:3], other, rtol=0.005)
    straight = modes(at_rest(case, HeldLoad()), count=1).frequency[0]
    assert abs(straight / other[0] - 1) > 0.01  # else the load would show nothing


# -- damping -------------------------------------------------------------------------------------------------


def test_a_prony_series_damps_and_stiffens_by_its_complex_modulus() -> None:
    """In a beam at rest every strain is isochoric: omega^2 = omega_0^2 (G' / G_0), damping G'' / (2 G')."""
    beam, g, tau = Beam(), 0.2, 0.05
    case = beam.case(CELLS)
    elastic = modes(at_rest(case, HeldLoad()), count=3)
    found = modes(at_rest(case.with_material(prony=((g, tau),)), HeldLoad()), count=3)
    x = 2 * np.pi * found.frequency * tau
    storage, lost = 1 - g / (1 + x**2), g * x / (1 + x**2)
    np.testing.assert_allclose(found.frequency, elastic.frequency * np.sqrt(storage), rtol=1e-4)
    np.testing.assert_allclose(found.damping, lost / storage / 2, rtol=2e-3)
    slow = modes(at_rest(case.with_material(prony=((g, 1e4),)), HeldLoad()), count=1)
    assert slow.frequency[0] == pytest.approx(elastic.frequency[0], rel=1e-6)


def test_the_modulus_of_a_higher_mode_is_that_at_its_own_frequency() -> None:
    """Rayleigh's quotient about a bent state against the tangent at that frequency."""
    case = Beam().case(CELLS).with_material(prony=((0.3, 0.03),))
    loaded = at_rest(case, HeldLoad(gravity=0.1 * DOWN))
    found = modes(loaded, count=3)
    frequency = found.frequency[~found.sideways][1]
    instant = case.with_material(prony=())
    assert frequency < modes(at_rest(instant, HeldLoad(gravity=0.1 * DOWN)), count=3).frequency[2]
    square, _ = _eigen(loaded.step(2 * np.pi * frequency), mass_matrix(case), 2)
    assert np.sqrt(square[1]) / (2 * np.pi) == pytest.approx(frequency, rel=1e-3)


def test_a_loss_factor_of_the_material_is_twice_the_damping_at_rest(stub: Case) -> None:
    case = dense(stub)
    rest = modes(at_rest(case, HeldLoad()), count=2, loss=0.1)
    np.testing.assert_allclose(rest.damping, 0.05, rtol=2e-3)  # the rest is compression
    named = modes(at_rest(case, HeldLoad()), count=2, loss={"body": 0.1})
    np.testing.assert_array_equal(named.damping, rest.damping)
    # under pressure part of the stiffness is that of the stress, which loses nothing: the share of the rest
    # is also that by which a modulus which rises with frequency alone raises omega^2
    g, held = 0.01, HeldLoad(0.03)
    slow, fast = (
        modes(at_rest(case.with_material(prony=((g, tau),)), held), count=1, loss=0.1) for tau in (1e-7, 1e3)
    )
    share = ((fast.frequency[0] / slow.frequency[0]) ** 2 - 1) * (1 - g) / g
    assert slow.damping[0] == pytest.approx(0.05 * share, rel=0.01)
    assert share < 0.9
    relaxed = case.with_material(C10=(1 - g) * case.materials["body"].C10, C01=(1 - g) * case.materials["body"].C01)
    assert slow.frequency[0] == pytest.approx(modes(at_rest(relaxed, held), count=1).frequency[0], rel=1e-5)


# -- what is refused -----------------------------------------------------------------------------------------


def test_vibrations_want_a_density_and_a_state(stub: Case) -> None:
    with pytest.raises(ValueError, match="density of 'body' 0 tonne/mm3"):
        modes(at_rest(stub, HeldLoad()))
    far = at_rest(dense(stub), HeldLoad(5.0))
    assert not far.converged
    with pytest.raises(ValueError, match="ask for a lower load"):
        modes(far)
    rough = replace(dense(stub), contact=Contact("outside", Flat((0.0, 0.0, 1.0), -1.0), 1.0, friction=0.3))
    with pytest.raises(ValueError, match="friction"):
        at_rest(rough, HeldLoad())
