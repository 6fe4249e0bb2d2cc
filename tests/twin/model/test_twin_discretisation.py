"""The correction of a prediction for its mesh, where the truth is the finest of the meshes.

Truths on still finer meshes, over random constants and pressures: docs/records/meshes.md.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material
from tests.twin.model import meshtruths
from twin import virtual
from twin.effects.library import effect
from twin.judging.fitting import ModelErrors
from twin.laws.mooneyrivlin import NAMES, NOMINAL
from twin.model import discretisation, prediction
from twin.model.arraycache import rounded_up
from twin.model.discretisation import Discretisation, SolvedAt, _tested, discretisation_error
from twin.model.keptmodel import base_model
from twin.model.prediction import HISTORY, Model, moved, remembered, respond
from twin.model.structure import BuiltIn, of_finger
from twin.targets import Array, Targets

THETA = np.array([0.26, 0.07])  # MPa, C10 and C01: other shares than the nominal ones
FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 27.0), (6.0, 27.0), (8.0, 0.0))  # s, kPa
COARSE = Lattice(per_bellow=2, ring=False, centred=False)
BENCH = virtual.Bench(film_hz=2.0)


@dataclass(frozen=True)
class Draw:
    """A model with the error of its mesh, and what the finest of its meshes does at THETA."""

    model: Model
    targets: Targets
    mesh: Discretisation

    def error(self, mesh: Discretisation | None) -> float:
        """The root mean square in mm by which the truth differs from what the model predicts on a mesh."""
        error = (self.targets.value - self.model.on_mesh(mesh).predict(THETA))[:, self.model.test.moving]
        return float(np.sqrt(np.nanmean(error**2)))


@pytest.fixture(autouse=True, scope="module")
def no_table() -> Iterator[None]:
    """The finer meshes are solved: this finger has no table here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(discretisation, "table_of", lambda _: None)
        yield


@pytest.fixture(scope="module")
def draw(short: Finger, short_case: Case) -> Draw:
    points, nodes = meshtruths.markers(short, short_case)
    course = virtual.path(BENCH, protocol=FILM)
    lattice = BuiltIn().finer(COARSE)["check"]
    truth = virtual.truth_case(short, lattice, material=Material(*THETA), element=None)
    u, slope = virtual.displaced(truth, course, points)
    names = tuple(f"p{k}" for k in range(len(points)))
    film = virtual.noisy_targets(u, slope, course, points=virtual.at_nodes(names, nodes, points), bench=BENCH, seed=1)
    targets = meshtruths.exact(film, u)
    model = base_model(targets, short_case)
    structure = of_finger(short, COARSE)
    at = SolvedAt.beside(NOMINAL, float(course.pressure.max()))
    return Draw(model, targets, discretisation_error(model.test, structure=structure, solved_at=at))


@pytest.mark.slow
def test_the_change_to_the_finest_mesh_is_corrected(draw: Draw) -> None:
    found = meshtruths.judged(draw.model.on_mesh(draw.mesh), draw.targets, theta=THETA)
    assert found.before_mm == draw.error(None) > 0.05  # there is something to correct
    assert found.corrected_mm == draw.error(draw.mesh)
    assert found.corrected_mm < 0.02 * found.before_mm  # at constants of another share, from another pressure
    assert max(abs(x) for x in (*found.modes, found.parameters)) < 0.2
    assert found.left_sd < 0.02  # of the noise


@pytest.mark.parametrize("mutant", [lambda x: 0.9 * x, np.negative], ids=["less", "of the other sign"])
def test_a_wrong_change_does_not_correct_it(draw: Draw, mutant: Callable[[Array], Array]) -> None:
    assert draw.error(replace(draw.mesh, changes=mutant(draw.mesh.changes))) > 0.05 * draw.error(None)


def test_derivatives_and_modes_come_with_the_correction(draw: Draw) -> None:
    model = draw.model.on_mesh(draw.mesh)
    h = 1e-4  # MPa
    found, plain = model.jacobian(THETA), draw.model.jacobian(THETA)
    for k in range(2):
        step = h * np.eye(2)[k]
        differenced = (model.predict(THETA + step) - model.predict(THETA - step)) / (2 * h)
        np.testing.assert_allclose(found[k], differenced, rtol=0, atol=1e-3 * np.abs(differenced).max())
        assert np.abs(plain[k] - differenced).max() > 0.01 * np.abs(differenced).max()
    q = model.modes(THETA)
    points = int(model.test.moving.sum())
    assert q.shape == (1 + 5 + 3 * 3 * points, *draw.targets.value.shape)
    assert len(draw.mesh.mode_names) == len(q)
    sizes = np.sqrt((q[:, :, model.test.moving] ** 2).mean(axis=(1, 2, 3)))
    # a stiffness that is off by half of what the meshes differ by, as the derivatives tell it
    off = 0.5 * np.linalg.norm(draw.mesh._shown.softness)
    softer = -np.tensordot(THETA, model.on_mesh(None).jacobian(THETA), 1)
    np.testing.assert_allclose(q[0], off * softer, rtol=0, atol=0.02 * np.abs(q[0]).max())
    # the constants take it up exactly: else history would seem to tell it from them
    own = np.tensordot(THETA, found, 1)
    np.testing.assert_allclose(q[0], -off * own, rtol=0, atol=1e-9 * np.abs(own).max())
    assert sizes[0] > sizes[1:].max() > 0
    np.testing.assert_allclose(q[:, draw.targets.reference].mean(axis=1), 0.0, atol=1e-12)
    assert not draw.model.modes(THETA).size
    np.testing.assert_array_equal(model.on_mesh(None).predict(THETA), draw.model.predict(THETA))


def test_what_bends_further_than_its_pressure_is_corrected_as_far(draw: Draw) -> None:
    # as creep does, which the finer meshes do not know: its rubber is softer, and bends as at more pressure
    softer = draw.model.put(draw.model.named(THETA / 1.1))
    u = moved(softer, draw.model.solution(THETA / 1.1))
    own = draw.model.put(draw.model.named(THETA))
    expected = draw.mesh.corrected(u, softer) - u
    np.testing.assert_allclose(draw.mesh.corrected(u, own) - u, expected, rtol=0, atol=1e-6)
    assert np.abs(expected).max() > 0.1


def test_intervals_cover_where_the_truth_is_on_another_mesh(draw: Draw, short: Finger) -> None:
    # one of the other topology, and one whose cells lie elsewhere; docs/records/meshes.md has more draws
    model = draw.model.on_mesh(draw.mesh)
    points, nodes = meshtruths.markers(short, draw.model.test.case)
    course, pulls = virtual.path(BENCH, protocol=FILM), []
    errors = ModelErrors.of(model, THETA, draw.targets)
    for lattice in (Lattice(per_bellow=2, centred=False), Lattice(per_bellow=3, ring=False, centred=False)):
        hidden = virtual.truth_case(short, lattice, material=Material(*THETA), element=None)
        u, slope = virtual.displaced(hidden, course, points)
        draws = [meshtruths.drawn(points, nodes, u, slope, course, BENCH, seed) for seed in range(10)]
        found = [meshtruths.linear(model, THETA, errors, targets) for targets in draws]
        pulls += [meshtruths.pull(name, e, THETA, NAMES) for name in (*NAMES, "sum", "share") for e in found]
    assert np.mean(np.abs(pulls) <= 1.96) >= 0.9
    # neither false precision nor far too wide
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 1.5


def analytic(top: float, *, factor: float = 1.0, bent: float = 0.02) -> Discretisation:
    """Meshes of two points on a formula, solved up to a pressure in MPa: by parts of `factor` softer, and by
    parts of `bent` mm of other shapes, the last of a shape of its own."""
    grid = np.linspace(0.0, top, 40)
    x = (grid / 0.03)[:, None, None]
    place = np.array([[0.2, 0.0, -1.0], [0.5, 0.0, -3.0]])
    base = 10 * place * x * (1 + 0.2 * x)
    softer = 10 * place * x * (1 + 0.4 * x)
    other = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) * x**2
    last = other + np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]) * x
    parts = np.array([factor * 0.03 * softer, factor * 0.01 * softer + bent * other, bent * last])
    return Discretisation(
        ("a", "b", "check"), NOMINAL.scale, grid, np.zeros((1, 3)), base[None], parts[:, None], tested=0.02
    )


def test_the_gate_is_of_the_meshes_alone() -> None:
    found = analytic(0.024)
    # a fit that is softer or stiffer asks for other solves, and still the same pressures are compared
    for top in (0.031, 0.05):
        assert analytic(top).remainder_mm == pytest.approx(found.remainder_mm, rel=0.05)
        assert analytic(top).apart == pytest.approx(found.apart, rel=0.02)
    assert found.apart == pytest.approx(np.hypot(0.03, 0.01), rel=0.05)
    assert analytic(0.024, factor=3.0).remainder_mm == pytest.approx(found.remainder_mm, rel=0.05)
    assert analytic(0.024, bent=0.06).remainder_mm == pytest.approx(3 * found.remainder_mm, rel=0.05)
    assert (_tested(0.02, 0.024), _tested(0.02, 0.05)) == (rounded_up(0.02),) * 2
    assert (_tested(0.02, 0.09), _tested(0.02, 0.011)) == (0.09, 0.011)  # quite another silicone


def test_meshes_that_lead_nowhere_are_refused(short: Finger, draw: Draw) -> None:
    bent = draw.mesh.base[0]

    def far(stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
        assert stage == "error of the mesh"
        return {key: (1 + 0.3 * k) * bent for k, key in enumerate(tasks)}

    at = SolvedAt(NOMINAL, float(draw.mesh.grid[-1]))
    found = discretisation_error(draw.model.test, structure=of_finger(short, COARSE), solved_at=at, cache=far)
    assert found.unknown.startswith("finer meshes differ in stiffness by ")
    assert found.unknown.endswith("refine the mesh")
    assert found.remainder_mm == found.apart == 0.0
    plain = draw.model.on_mesh(found)
    np.testing.assert_array_equal(plain.predict(THETA), draw.model.predict(THETA))
    assert not plain.modes(THETA).size


@pytest.mark.parametrize(("ends", "known"), [(0.95, True), (0.7, False)])
def test_a_finer_mesh_that_ends_early_gives_less_room_or_no_error(
    short: Finger, make_targets: Callable[..., Targets], short_case: Case, ends: float, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    structure, at = of_finger(short, COARSE), SolvedAt.beside(NOMINAL, 0.02)
    test = base_model(make_targets(), short_case).test

    def responses(*_: object) -> dict[tuple[str, int], Array]:
        share = np.linspace(0.0, 1.0, discretisation.SAMPLES)
        u = np.multiply.outer(share, np.ones((int(test.moving.sum()), 3)))
        longer = {name: u * (1 + 0.01 * k) for k, name in enumerate(("base", *structure.finer))}
        longer["check"] = np.where((share > ends)[:, None, None], np.nan, longer["check"])
        return {(name, 0): field for name, field in longer.items()}

    monkeypatch.setattr(discretisation, "_responses", responses)
    mesh = discretisation_error(test, structure=structure, solved_at=at)
    assert bool(mesh.unknown) != known
    if known:
        assert 0.02 <= mesh.grid[-1] < ends * at.top
        assert np.isfinite(mesh.changes).all()
    else:
        assert "a finer mesh carries at most 15.9 kPa, the test goes to 20 kPa" in mesh.unknown


def test_what_creep_adds_is_uncertain_for_every_marker_on_its_own(draw: Draw) -> None:
    model = draw.model.on_mesh(draw.mesh)
    plain, creeping = model.modes(THETA), model.with_effect(effect("creep"))
    theta = np.array([*THETA, 0.1, 2.0])
    more = creeping.modes(theta)[len(plain) :]
    bare = creeping.on_mesh(None)
    added = bare.predict(theta) - draw.model.on_mesh(None).predict(THETA)
    moving = int((np.abs(added) > 0).any(axis=0).sum())
    assert len(more) == moving
    assert all((np.abs(mode) > 0).any(axis=0).sum() == 1 for mode in more)
    # without creep by the curve of its own solve, whose levels are others: 2e-6 mm
    np.testing.assert_allclose(more.sum(axis=0), HISTORY * added, rtol=0, atol=1.5e-7)


def test_the_finger_without_its_memory_is_not_solved_anew(
    draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    creeping = draw.model.on_mesh(draw.mesh).with_effect(effect("creep"))
    theta = np.array([*THETA, 0.1, 2.0])
    test, solution = creeping.put(creeping.named(theta)), creeping.solution(theta)
    own = replace(test, case=test.case.with_material(prony=()))
    alone = moved(test, solution) - respond(own, (), start=None)[0]
    monkeypatch.setattr(prediction, "respond", None)
    found = remembered(test, solution)
    assert found is not None
    assert np.abs(found).max() > 0.01
    np.testing.assert_allclose(found, alone, rtol=0, atol=1e-5)


def test_the_gauge_s_slope_has_the_mesh_s_change(draw: Draw) -> None:
    model = draw.model.on_mesh(draw.mesh)
    path, h = model.test.path, 1e-5
    ends = []
    for shift in (h, -h):
        there = replace(model.test, path=replace(path, pressure=path.pressure + shift))
        u = moved(there, model.solution(THETA))
        solved = Model(there, model.effects, model.reference).on_mesh(draw.mesh)
        ends.append(draw.mesh.corrected(moved(there, solved.solution(THETA)), there))
        assert np.abs(ends[-1] - u).max() > 1e-4
    slope = (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(model.per_pressure(THETA), slope, rtol=0, atol=5e-3 * np.abs(slope).max())


def test_an_error_of_the_mesh_larger_than_the_body_is_no_estimate(short: Finger, draw: Draw) -> None:
    bent, way = draw.mesh.base[0], np.zeros_like(draw.mesh.base[0])
    way[1, :, 1] = 1.0  # across, at one low pressure: no softer silicone moves it so

    def far(stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
        return {key: bent + 60.0 * (k == 0) * way for k, key in enumerate(tasks)}  # the finest alone

    at = SolvedAt(NOMINAL, float(draw.mesh.grid[-1]))
    found = discretisation_error(draw.model.test, structure=of_finger(short, COARSE), solved_at=at, cache=far)
    assert "mm long, which is no estimate" in found.unknown
