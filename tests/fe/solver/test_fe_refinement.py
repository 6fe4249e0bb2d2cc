"""Changes of an equilibrium by a tangent factorised nearby, corrected: those of its own tangent."""


import numpy as np
import pytest

from fe import Case, Path, Solution, Variation, solve
from fe.element import Array
from fe.kernel.assembly import State
from fe.solver.historyvariables import Evaluated, Past
from fe.solver.newton import Problem, Reached, Residual, equilibrium, imbalance, moved, tangent_at
from fe.solver.refinement import Corrected

LOAD = 0.006
CREEP = ((0.1, 1.0),)
MULLINS = (0.4, 0.003, 0.2)


def place(case: Case) -> Reached:
    """An equilibrium of a material with memory, after it was loaded further."""
    problem = Problem.of(case)
    found = equilibrium(problem, problem.start(), load=LOAD)
    assert found.state is not None
    u, kernel, c = found.state.u, problem.kernel, problem.constants
    stress, energy = (f(u, c, problem.geometry) for f in (kernel.isochoric, kernel.energies))
    response = type(kernel.changes(u, c, problem.geometry, [u], energy=True)[0])(stress, energy)
    memory = Past.first(Evaluated(problem, u, response)).memory(problem, 0.5)
    after = equilibrium(problem, found.state, load=0.9 * LOAD, memory=memory)
    assert after.state is not None
    return Reached(problem, after.state, 0.9 * LOAD, memory)


@pytest.fixture(scope="module")
def softened(short: Case) -> Reached:
    return place(short.with_material(prony=CREEP, mullins=MULLINS))


def changes(at: Reached, count: int) -> list[State]:
    """Smooth changes that leave what is held."""
    kernel, rng, out = at.problem.kernel, np.random.default_rng(0), []
    for _ in range(count):
        du = 0.1 * np.sin(0.1 * at.problem.case.nodes @ rng.normal(size=(3, 3)))
        du.flat[kernel.supported] = 0.0
        du[kernel.clamped] = 0.0
        out.append(State(du, 1e-3 * rng.normal(size=at.state.p.shape)))
    return out


def test_residuals_go_along_changes_as_differences_do(softened: Reached) -> None:
    at, h, free = softened, 1e-3, softened.problem.kernel.free
    along = changes(at, 3)
    for change, found in zip(along, at.along(along), strict=True):
        a, b = (imbalance(at.problem, moved(at.state, change, s * h), at.load, at.memory) for s in (1, -1))
        wanted = a.minus(b, 1 / (2 * h))
        assert found.gap is not None
        assert wanted.gap is not None
        np.testing.assert_allclose(found.gap, wanted.gap, rtol=0, atol=1e-7 * np.abs(wanted.gap).max())
        own, force = (x.force.ravel()[free] for x in (found, wanted))
        np.testing.assert_allclose(own, force, rtol=0, atol=1e-6 * np.abs(force).max())


@pytest.mark.parametrize(("away", "kept"), [(3e-3, True), (2.0, False)])
def test_a_tangent_of_nearby_gives_the_changes_of_the_own_one(
    softened: Reached, away: float, kept: bool
) -> None:
    """One that is too far is replaced."""
    at, rng = softened, np.random.default_rng(1)
    residuals = [
        Residual(1e-3 * rng.normal(size=at.state.u.shape), np.zeros_like(at.state.p), 0.0) for _ in range(2)
    ]
    wanted = at.factorised().solve(residuals)
    (there,) = changes(at, 1)
    step = tangent_at(at.problem, moved(at.state, there, away), load=at.load, memory=at.memory)
    plain, tangent = step.solve(residuals), Corrected(step, at)
    found = tangent.solve(residuals)
    assert (tangent.step is step) == kept
    for x, y, z in zip(found, wanted, plain, strict=True):
        size = np.abs(y.u).max()
        assert np.abs(z.u - y.u).max() > 1e-5 * size  # without corrections
        np.testing.assert_allclose(x.u, y.u, rtol=0, atol=3e-7 * size)


Asked = tuple[Solution, Array, Array]


@pytest.mark.parametrize("laws", [{}, {"prony": CREEP}], ids=["none", "creep"])
def test_a_solve_beside_another_has_the_same_answers_by_fewer_factorisations(
    short: Case, laws: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0])
    path = Path(time, np.array([0.0, 0.05, 0.02, 0.02]), np.linspace(0.5, 3.0, 6))
    points = np.stack([short.position(4401), short.position(5848)])

    def asked(C10: float, start: Solution | None = None) -> Asked:
        def of(value: float) -> tuple[Case, Path]:
            return short.with_material(C10=value, **laws), path

        found = solve(*of(C10), start=start, variations=[Variation(of(C10 + 1e-6), of(C10 - 1e-6), 1e-6)])
        assert found.converged
        return found, found.at(points), found.variations_at(points)

    first, *_ = asked(0.214)
    near, u, du = asked(0.225, first.ahead(np.array([0.011])))
    monkeypatch.setattr("fe.solver.newton.QUICK", 0.0)
    _, wanted, slope = asked(0.225)
    np.testing.assert_allclose(u, wanted, rtol=0, atol=1e-6)
    np.testing.assert_allclose(du, slope, rtol=0, atol=2e-6 * np.abs(slope).max())
    before, *_ = asked(0.225, first.ahead(np.array([0.011])))
    assert near.iterations <= 0.75 * before.iterations


def test_a_tangent_whose_factors_are_gone_does_not_serve(softened: Reached) -> None:
    problem, load = softened.problem, softened.load
    first = equilibrium(problem, softened.state, load=load)
    assert first.state is not None
    old = tangent_at(problem, first.state, load=load)
    none = Residual(np.zeros_like(first.state.u), np.zeros_like(first.state.p), 0.0)
    assert old.solve([none])
    (turned,) = changes(softened, 1)
    tangent_at(problem, moved(first.state, turned, 5.0), load=load)  # as a step that failed leaves it
    with pytest.raises(RuntimeError, match="factorised since"):
        old.solve([none])
    near = first.state
    again, fresh = (equilibrium(problem, near, load=1.02 * load, last=last) for last in (old, None))
    assert again.state is not None
    assert fresh.state is not None
    np.testing.assert_array_equal(again.state.u, fresh.state.u)
