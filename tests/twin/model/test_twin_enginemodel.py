"""A model that jobs of another program solve: here a program whose answer is a formula, so that nothing waits."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from fe import Case, Finger, Lattice, solve
from fe import Path as Course
from fe.engines.abaqus import Abaqus
from fe.engines.calculix import CalculiX
from fe.engines.engine import EngineResult, over_pressure
from fe.engines.writer import deck
from fe.mesh.convert import converted
from tests.messages import saying
from twin.effects.library import effect
from twin.effects.protocol import Unsolvable
from twin.laws.mooneyrivlin import NOMINAL, mooney_rivlin
from twin.model.enginejobs import FRUITLESS, Done, EngineJobs
from twin.model.enginemodel import EngineModel, EnginePaths
from twin.model.firstorder import MarkerPoints
from twin.model.keptmodel import base_model
from twin.model.structure import base_case, of_deck
from twin.targets import Array, PointKind, TargetPoint, Targets

KIND = "C3D20RH"
SHARE = np.linspace(0, 1, 13)[1:]


@dataclass
class Formula:
    """A program under which a node at x moves by (0, 0, -q (1 + q) x) mm, q = p / (C10 + C01 / 2), as far as q
    reaches; it counts its jobs. gives: another answer than that."""

    case: Case
    name: str = "Formula"
    kind: str = KIND
    reaches: float = np.inf
    gives: Callable[[EngineResult], EngineResult] = field(default=lambda found: found)
    jobs: list[str] = field(default_factory=list)

    def deck(self, case: Case, pressure: float, *, gravity: Array | None = None, levels: int = 0) -> str:
        (m,) = set(case.materials.values())
        text = deck(case, pressure, kind=self.kind, gravity=gravity, levels=levels)
        return f"** {pressure / (m.C10 + m.C01 / 2):.17g}\n{text}"

    def unfit(self, case: Case) -> str:
        return ""

    def run(self, text: str, *, folder: Path | None = None) -> EngineResult:
        self.jobs.append(text)
        assert folder is not None
        (folder / "job.log").write_text("what the program said")
        q = float(text.split()[1]) * SHARE
        q = q[q <= self.reaches]
        own = converted(self.case, self.kind)
        u = np.zeros((len(q), len(own.nodes), 3))
        u[:, :, 2] = -np.outer(q * (1 + q), own.nodes[:, 0])
        whole = len(q) == len(SHARE)
        reason = "converged" if whole else f"stopped at {SHARE[len(q) - 1]:.3g} of the step"
        return self.gives(EngineResult(own.labels[::-1], SHARE[: len(q)], u[:, ::-1], whole, reason, 0.0))

    def solve(
        self, case: Case, pressure: float, *, gravity: Array | None = None, levels: int = 0
    ) -> EngineResult:
        raise NotImplementedError

    def release(self) -> str:
        return "1"


class Kept(dict[str, Array]):
    """A cache in memory."""

    def __call__(self, stage: str, tasks: Mapping[str, Callable[[], Array]], /) -> dict[str, Array]:
        for key, make in tasks.items():
            if key not in self:
                self[key] = make()
        return {key: self[key] for key in tasks}


@pytest.fixture
def program(coarsest_case: Case) -> Formula:
    return Formula(coarsest_case)


@pytest.fixture
def jobs(program: Formula, tmp_path: Path) -> EngineJobs:
    return EngineJobs(program, "1", Kept(), tmp_path / "jobs")


THETA = np.array([0.2, 0.1])


def expected(pressure: Array, theta: Array, x: Array) -> Array:
    """U3 (s, p) mm of the formula."""
    q = pressure / (theta[0] + theta[1] / 2)
    return -np.outer(q * (1 + q), x)


def test_a_prediction_by_a_job_is_what_the_program_gave(
    coarsest_case: Case, make_targets: Callable[..., Targets], jobs: EngineJobs
) -> None:
    targets = make_targets()
    model = EngineModel.of(base_model(targets, coarsest_case), jobs)
    u, x = model.predict(THETA), targets.places(coarsest_case.position)[:2, 0]
    at = model.test.path.at_output()
    # relative to the first two steps; the formula is a parabola, which a cubic spline carries
    own = expected(at, THETA, x)
    np.testing.assert_allclose(u[:, :2, 2], own - own[:2].mean(axis=0), atol=1e-9)
    np.testing.assert_array_equal(u[:, 2], 0.0)  # the fixed marker
    slope = (own[3] - expected(at[3:4] - 1e-7, THETA, x)[0]) / 1e-7
    np.testing.assert_allclose(model.per_pressure(THETA)[3, :2, 2], slope, rtol=1e-5)
    assert model.modes(THETA).shape == (0, *u.shape)


def test_nodes_that_its_elements_lack_move_as_their_shape_functions_say(
    coarsest_case: Case, program: Formula, tmp_path: Path
) -> None:
    text = program.deck(coarsest_case, 0.01)
    folder = tmp_path / "job"
    folder.mkdir()
    pressure, u = over_pressure(program.run(text, folder=folder), coarsest_case, KIND, top=0.01)
    assert pressure[0] == 0.0
    assert u.shape == (13, len(coarsest_case.nodes), 3)
    # linear in x, and so exact also where elements are curved, to rounding
    want = expected(pressure, np.array(NOMINAL.values), coarsest_case.nodes[:, 0])
    np.testing.assert_allclose(u[..., 2], want, atol=1e-9)
    assert len(converted(coarsest_case, KIND).nodes) < len(coarsest_case.nodes)


def test_derivatives_are_differences_of_two_jobs_and_of_one_where_the_case_is_the_same(
    coarsest_case: Case, make_targets: Callable[..., Targets], jobs: EngineJobs, program: Formula
) -> None:
    targets = make_targets()
    model = EngineModel.of(base_model(targets, coarsest_case), jobs)
    for label in ("pressure_gain", "camera_scale"):
        model = model.with_effect(effect(label))
    theta = model.theta({"C10": 0.2, "C01": 0.1, "pressure_gain.gain": 0.0, "camera_scale.scale": 0.0})
    program.jobs.clear()
    found = dict(zip(model.named(theta), model.jacobian(theta), strict=True))
    assert len(program.jobs) == 3  # the model, C10 and C01: gain and scale take none
    at, x, h = model.test.path.at_output(), targets.places(coarsest_case.position)[:2, 0], 1e-6

    def slope(a: Array, b: Array) -> Array:
        both = [u - u[:2].mean(axis=0) for u in (a, b)]
        return (both[0] - both[1]) / h

    own = expected(at, THETA, x)
    for k, name in enumerate(("C10", "C01")):
        want = slope(expected(at, THETA + h * np.eye(2)[k], x), own)
        # forward over 0.004 MPa of 0.25: half of the second derivative, 2 %
        np.testing.assert_allclose(found[name][:, :2, 2], want, atol=0.02 * np.abs(want).max())
        assert np.abs(want).max() > 0.1
    want = slope(expected(at * (1 + h), THETA, x), own)
    scale = np.abs(want).max()
    assert np.abs(np.abs(found["pressure_gain.gain"][:, :2, 2]) - np.abs(want)).max() < 1e-3 * scale
    u = own - own[:2].mean(axis=0)
    assert np.abs(np.abs(found["camera_scale.scale"][:, :2, 2]) - np.abs(u)).max() < 1e-3 * np.abs(u).max()


def test_a_derivative_at_a_bound_is_taken_inwards(
    coarsest_case: Case, make_targets: Callable[..., Targets], jobs: EngineJobs
) -> None:
    model = EngineModel.of(base_model(make_targets(), coarsest_case), jobs)
    theta = np.array([model.parameters[0].high, 0.1])
    at, inside = (model.jacobian(theta - np.array([off, 0.0]))[0] for off in (0.0, 0.01))
    np.testing.assert_allclose(at, inside, atol=0.03 * np.abs(inside).max())  # of 1.5 MPa 0.01, squared


def test_a_job_is_done_once_and_its_folder_is_gone(
    coarsest_case: Case, jobs: EngineJobs, program: Formula, tmp_path: Path
) -> None:
    case = coarsest_case.with_material(C10=0.2, C01=0.1)
    first = jobs.course(case, 0.02, np.zeros(3))
    again = jobs.course(case, 0.02, np.zeros(3))
    fresh = EngineJobs(program, "1", jobs.cache, jobs.folder).course(case, 0.02, np.zeros(3))
    assert len(program.jobs) == 1
    for q, u in (again, fresh):
        np.testing.assert_array_equal(q, first[0])
        np.testing.assert_array_equal(u, first[1])
    assert list((tmp_path / "jobs").iterdir()) == []
    EngineJobs(program, "2", jobs.cache, jobs.folder).course(case, 0.02, np.zeros(3))  # another version
    jobs.course(case.with_material(C10=0.2 + 1e-9), 0.02, np.zeros(3))
    assert len(program.jobs) == 3


def test_a_job_that_fails_is_told_kept_and_tried_again(
    coarsest_case: Case, jobs: EngineJobs, program: Formula
) -> None:
    program.reaches = 0.05  # of p / C
    paths = EnginePaths(coarsest_case, MarkerPoints(coarsest_case.nodes[-3:], ()), 0.02, jobs, np.zeros((1, 3)), np.zeros(2, int))
    at = np.array([0.01, 0.02])
    assert paths.predict(mooney_rivlin(0.2, 0.1), at) is None
    (said,) = jobs.failed
    assert said.startswith("Formula: stopped at")
    assert jobs.reasons() == f"{said.partition(';')[0]} (1 jobs)"
    (folder,) = jobs.folder.iterdir()
    assert str(folder) in said
    assert (folder / "job.log").read_text() == "what the program said"
    assert paths.predict(mooney_rivlin(0.9, 0.1), at) is not None  # stiffer: it is reached
    program.reaches = np.inf
    found = paths.predict(mooney_rivlin(0.2, 0.1), at)
    assert found is not None  # the failure was not stored
    np.testing.assert_allclose(found[:, :, 2], expected(at, THETA, coarsest_case.nodes[-3:, 0]), atol=1e-9)
    assert list(jobs.folder.iterdir()) == []  # of the job that now went well


@pytest.mark.parametrize(
    ("gives", "said"),
    [
        (lambda found: EngineResult.failed("no licence", 0.0), "no licence"),
        (
            lambda r: EngineResult(r.labels[1:], r.share, r.course[:, 1:], True, r.reason, 0.0),
            "the result has no displacement of node",
        ),
    ],
)
def test_a_program_that_gives_nothing_ends_the_run(
    coarsest_case: Case, jobs: EngineJobs, program: Formula,
    gives: Callable[[EngineResult], EngineResult], said: str,
) -> None:  # fmt: skip
    program.gives = gives
    for k in range(FRUITLESS - 1):
        with pytest.raises(Unsolvable, match=said):
            jobs.course(coarsest_case.with_material(C10=0.2 + k), 0.02, np.zeros(3))
    with pytest.raises(ValueError, match=f"{FRUITLESS} jobs in a row wrote no displacements.*{said}"):
        jobs.course(coarsest_case, 0.02, np.zeros(3))


@pytest.mark.parametrize(
    ("label", "engine", "why"),
    [
        ("creep", Abaqus(), "creep, which depends on what was before"),
        ("creep:2", CalculiX(), "creep, which depends on what was before"),
        ("mullins", Abaqus(), "Mullins softening, which depends on what was before"),
        ("clamp", Abaqus(), "a rigid clamp"),
        ("precurvature", CalculiX(), "a precurvature"),
        ("thermal", Abaqus(), "moduli that drift"),
        ("stiffening", CalculiX(), ""),
        ("stiffening", Abaqus(), ""),
        ("pressure_gain", CalculiX(), ""),
        ("wall_taper", CalculiX(), ""),
        ("camera_tilt", Abaqus(), ""),
    ],
)
def test_what_a_program_cannot_solve_is_named_with_the_way_out(
    coarsest_case: Case, make_targets: Callable[..., Targets], tmp_path: Path,
    label: str, engine: Abaqus | CalculiX, why: str,
) -> None:  # fmt: skip
    model = EngineModel.of(base_model(make_targets(), coarsest_case), EngineJobs(engine, "", Kept(), tmp_path))
    if not why:
        assert model.with_effect(effect(label)).effects[-1].name == label
        return
    way = re.escape('set engine = "embedded" under [model] of twin.toml, or drop it')
    with pytest.raises(ValueError, match=f"^effect '{label}': {engine.name} cannot solve it: .*{why}.*{way}$"):
        model.with_effect(effect(label))


def test_a_deck_of_ones_own_keeps_its_elements(tmp_path: Path, require: Callable[[str], None]) -> None:
    """By CalculiX against this kernel, in the deck's elements, which are C3D20RH."""
    require("ccx")
    end, middle = (10 + 100 / 9, 11.5, 0.0), (4 + 50 / 9, 11.5, 0.0)
    finger = Finger(length=end[0], bellows=1, tip_node=end, middle_node=middle)
    case = converted(base_case(finger=finger, lattice=Lattice(per_bellow=2, ring=False, centred=False)), KIND)
    jobs = EngineJobs(CalculiX(), "2.20", Kept(), tmp_path / "jobs")
    pressure, u = jobs.course(case, 0.004, np.zeros(3))
    ours = solve(case, Course(pressure, pressure, pressure)).fields(range(len(pressure)))
    # its tolerance of the residual is 0.5 % of the force, and there are six digits
    np.testing.assert_allclose(u, ours, atol=2e-3 * np.abs(ours).max())
    assert pressure[-1] >= 0.004
    assert list(jobs.folder.iterdir()) == []


def test_elements_that_lock_without_the_hybrid_ones_are_refused(
    make_targets: Callable[..., Targets], tmp_path: Path
) -> None:
    """CalculiX moves this tube of C3D8H, which it takes for C3D8, by 0.009 mm where this kernel has 0.107."""
    case = of_deck(Path(__file__).resolve().parents[2] / "corpora" / "deck" / "tube.inp").case
    at = tuple(float(x) for x in case.nodes[-1])
    points = (TargetPoint("tip", PointKind.PLACE, None, at), *make_targets().points[2:])
    base = base_model(take(make_targets(), points), case)
    with pytest.raises(ValueError, match=saying("CalculiX", "C3D8H", "C3D20R")):
        EngineModel.of(base, EngineJobs(CalculiX(), "", Kept(), tmp_path))
    assert EngineModel.of(base, EngineJobs(Abaqus(), "", Kept(), tmp_path)).jobs.engine.name == "Abaqus"


def take(targets: Targets, points: tuple[TargetPoint, ...]) -> Targets:
    """The targets with so many points, of which nothing is measured."""
    s, p = len(targets.time), len(points)
    return replace(
        targets, points=points, value=np.zeros((s, p, 3)), covariance=np.zeros((s, p, 3, 3)),
        valid=np.zeros((s, p, 3), bool), modes=np.zeros((0, s, p, 3)),
    )  # fmt: skip


def test_a_model_by_jobs_has_no_tangents(
    coarsest_case: Case, make_targets: Callable[..., Targets], jobs: EngineJobs
) -> None:
    model = EngineModel.of(base_model(make_targets(), coarsest_case), jobs)
    with pytest.raises(ValueError, match=r"no derivatives by effects .* engine = \"embedded\""):
        model.tangents(THETA, [effect("pressure_gain")])


def backwards(tasks: Sequence[Callable[[], Done]]) -> Iterator[tuple[int, Done]]:
    """As an executor whose last task ends first."""
    yield from ((k, tasks[k]()) for k in reversed(range(len(tasks))))


def test_jobs_done_together_are_those_done_one_after_the_other(
    coarsest_case: Case, program: Formula, tmp_path: Path
) -> None:
    program.reaches = 0.15
    x = coarsest_case.nodes[:2]
    candidates = [mooney_rivlin(c, 0.0) for c in (0.2, 0.05, 0.3, 0.2, 0.06)]  # two fail at 0.02 MPa, one is twice
    costs, told = [], []
    for together in (None, backwards):
        jobs = EngineJobs(program, "1", Kept(), tmp_path / str(together), together)
        paths = EnginePaths(coarsest_case, MarkerPoints(x, ()), 0.02, jobs, np.zeros((1, 3)), np.zeros(3, np.int64))
        program.jobs.clear()
        paths.ahead(candidates)
        ahead = len(program.jobs)
        found = [paths.predict(c, np.array([0.0, 0.01, 0.02])) for c in candidates]
        assert len(program.jobs) == 4
        assert ahead == (4 if together else 0)
        paths.ahead(candidates)  # what is stored is not done again; what failed is, as it would be alone
        assert len(program.jobs) == (6 if together else 4)
        costs.append([u if u is None else u.tobytes() for u in found])
        told.append([why.split(";")[0] for why in jobs.failed])
    assert costs[0] == costs[1]
    assert told[0] == told[1]
    assert len(set(told[0])) == 2  # in the candidates' order, each stopped elsewhere
    assert [cost is None for cost in costs[0]] == [False, True, False, False, True]


def test_a_worker_with_another_release_is_named(coarsest_case: Case, program: Formula, tmp_path: Path) -> None:
    jobs = EngineJobs(program, "2", Kept(), tmp_path, backwards)
    with pytest.raises(ValueError, match=r"has 1, wanted 2; install the same on every worker"):
        jobs.ahead([coarsest_case], 0.02, np.zeros(3), at=coarsest_case.nodes[:1])
