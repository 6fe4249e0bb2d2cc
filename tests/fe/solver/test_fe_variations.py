"""Derivatives through `Variation` against central differences of whole solves."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import fe.path
from fe import Case, Lattice, Material, Path, Support, Variation, finger_case, solve
from fe.element import Array
from fe.solver.newton import equilibrium
from tests.fe.conftest import SHORT

Test = tuple[Case, Path]
Map = Callable[[float], Test]
FORCE = np.array([0.0, 0.0, -0.03])  # N: without it the clamp carries no moment
TIME, TOP = np.array([0.0, 1.0]), 0.02


def ramp(gain: float = 0.0) -> Path:
    return Path(time=TIME, pressure=np.array([0.0, TOP]) * (1 + gain), output=np.array([1.0]))


@pytest.fixture(autouse=True)
def tight(monkeypatch: pytest.MonkeyPatch) -> None:
    """The derivatives' tangent is TOLERANCE away from the equilibrium; both are to be compared to 1e-5. Few
    times on a path: both sides have the same."""
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-8)
    monkeypatch.setattr(fe.path, "RAMP", 3)


def marked(case: Case) -> Array:
    """Positions (3, 3) mm of the tip, the middle and a clamp node under the top wall, moved by `top`."""
    clamp = case.nodes[case.node_sets["clamp"]]
    under = clamp[np.argmin(np.abs(clamp[:, 2] - clamp[:, 2].max() + 2.0))]
    return np.stack([case.position(4401), case.position(5848), under])


def difference(test: Map, at: float, h: float) -> Array:
    """dU/dparameter (s, 3, 3) at the marked nodes, to h^2, from two solves."""

    def u(value: float) -> Array:
        case, path = test(value)
        solution = solve(case, path, count=4)
        assert solution.converged
        return solution.at(marked(case))

    return (u(at + h) - u(at - h)) / (2 * h)


def exact(base: Test, tests: list[Map], at: list[float], steps: list[float]) -> Array:
    """The derivatives (v, s, 3, 3) that one solve with variations gives."""
    variations = [Variation(f(x + h), f(x - h), h) for f, x, h in zip(tests, at, steps)]
    solution = solve(*base, variations=variations, count=4)
    assert solution.converged
    return solution.variations_at(marked(base[0]))


def loaded(stub: Case) -> Case:
    return replace(stub, forces={"tip_face": FORCE}, clamp=replace(stub.clamp, compliance=1e-3))


def test_derivatives_without_history(short: Case) -> None:
    case = loaded(short)
    lattice = Lattice(per_bellow=2, ring=False, centred=False)

    def material(name: str) -> Map:
        return lambda x: (case.with_material(**{name: x}), ramp())

    def clamp(x: float) -> Test:
        return replace(case, clamp=replace(case.clamp, compliance=x)), ramp()

    def top(x: float) -> Test:
        changed = finger_case(case.materials["body"], finger=replace(SHORT, top=x), lattice=lattice)
        return replace(case, nodes=changed.nodes), ramp()

    tests = [material("C10"), material("C01"), material("C20"), clamp, top, lambda x: (case, ramp(x))]
    at = [0.214, 0.083, 0.0, 1e-3, 2.0, 0.0]
    typical = np.array([0.02, 0.02, 0.02, 1e-3, 0.1, 0.05])
    ours = exact((case, ramp()), tests, at, list(1e-6 * typical))
    for n, name in enumerate(("C10", "C01", "C20", "compliance", "top", "gain")):
        theirs = difference(tests[n], at[n], 0.005 * typical[n])
        size = np.abs(theirs).max()
        assert size * typical[n] > 1e-3, name  # mm: the parameter is felt
        np.testing.assert_allclose(ours[n], theirs, atol=1e-5 * size, err_msg=name)


def test_derivative_to_the_clamps_compliance_at_its_null(stub: Case) -> None:
    case = replace(stub, forces={"tip_face": FORCE})

    def clamp(x: float) -> Test:
        return replace(case, clamp=replace(case.clamp, compliance=x)), ramp()

    ours = exact(clamp(0.0), [clamp], [0.0], [1e-9])[0]
    theirs = difference(clamp, 0.0, 5e-6)
    np.testing.assert_allclose(ours, theirs, atol=1e-5 * np.abs(theirs).max())


def test_derivatives_under_a_pressure_on_an_open_face(cube: Callable[..., Case]) -> None:
    # its follower tangent is not symmetric: without that part the derivative is a few per cent off
    case = cube((3, 1, 1), supports=(Support("x0", (0, 1, 2)),), pressurised="z1")
    path = Path(TIME, np.array([0.0, 0.1]), TIME[1:])

    def u(C10: float) -> Array:
        solution = solve(case.with_material(C10=C10), path)
        assert solution.converged
        return solution.fields([0])[0]

    h = 2e-7
    plus, minus = ((case.with_material(C10=0.214 + s * h), path) for s in (1, -1))
    found = solve(case, path, variations=[Variation(plus, minus, h)])
    wide, narrow = ((u(0.214 + h) - u(0.214 - h)) / (2 * h) for h in (2e-3, 1e-3))
    theirs = (4 * narrow - wide) / 3
    assert found.iterations < 15
    assert np.abs(found.fields([0])).max() > 0.05
    ours = found.variations_at(case.nodes)[0, 0]
    np.testing.assert_allclose(ours, theirs, atol=1e-6 * np.abs(theirs).max())
    ahead, behind = (
        solve(case, Path(TIME, np.array([0.0, 0.1 + s * 1e-5]), TIME[1:])).fields([0])[0] for s in (1, -1)
    )
    theirs = (ahead - behind) / 2e-5
    np.testing.assert_allclose(found.per_pressure(case.nodes)[0], theirs, atol=1e-6 * np.abs(theirs).max())


LOG = np.linspace(0, 4, 161)
CYCLE = np.interp(LOG, [0, 1, 3, 3.5, 4], [0, TOP, TOP, 0.5 * TOP, 0.5 * TOP])
KNOTS = np.array([1.0, 3.0, 3.5, 4.0])  # corners of the path: history states are solved there


def cycle(gain: float = 0.0) -> Path:
    return Path(time=LOG, pressure=CYCLE * (1 + gain), output=KNOTS)


def test_derivatives_with_history(stub: Case) -> None:
    def creep(share: float, tau: float, **constants: float) -> Case:
        return stub.with_material(prony=((share, tau),), **constants)

    tests: list[Map] = [
        lambda x: (creep(x, 1.5), cycle()),
        lambda x: (creep(0.2, x), cycle()),
        lambda x: (creep(0.2, 1.5, C10=x), cycle()),
        lambda x: (creep(0.2, 1.5), cycle(x)),
    ]
    at, typical = [0.2, 1.5, 0.214, 0.0], np.array([0.1, 1.0, 0.02, 0.05])
    ours = exact(tests[0](0.2), tests, at, list(1e-6 * typical))
    for n, name in enumerate(("g", "tau", "C10", "gain")):
        theirs = difference(tests[n], at[n], 0.005 * typical[n])
        size = np.abs(theirs).max()
        assert size * typical[n] > 1e-3, name
        np.testing.assert_allclose(ours[n], theirs, atol=1e-5 * size, err_msg=name)


def test_derivatives_of_a_history_that_begins_under_load(stub: Case) -> None:
    hanging = replace(stub, forces={"tip_face": FORCE}).with_material(prony=((0.2, 1.5),))
    pressure = 0.005 + 0.5 * CYCLE

    def test(gain: float, **constants: float) -> Test:
        return hanging.with_material(**constants), Path(LOG, pressure * (1 + gain), np.array([0.0, *KNOTS]))

    tests: list[Map] = [lambda x: test(0.0, C10=x), test]
    ours = exact(test(0.0), tests, [0.214, 0.0], [2e-8, 5e-8])
    for n, (at, h) in enumerate(((0.214, 3e-5), (0.0, 1e-4))):
        theirs = difference(tests[n], at, h)
        size = np.abs(theirs).max()
        assert np.abs(theirs[0]).max() > 0.05 * size  # the first state is moved, too
        np.testing.assert_allclose(ours[n], theirs, atol=1e-5 * size)


def test_derivatives_to_creep_at_its_null(stub: Case) -> None:
    def creep(share: float, tau: float) -> Test:
        return stub.with_material(prony=((share, tau),)), cycle()

    tests: list[Map] = [lambda x: creep(x, 1.5), lambda x: creep(0.0, x)]
    ours = exact(creep(0.0, 1.5), tests, [0.0, 1.5], [1e-7, 1e-6])
    theirs = difference(tests[0], 0.0, 5e-4)
    size = np.abs(theirs).max()
    np.testing.assert_allclose(ours[0], theirs, atol=1e-5 * size)
    np.testing.assert_allclose(ours[1], 0, atol=1e-9)  # tau is not felt without a share


def test_no_creep_and_a_share_of_zero_are_the_same(stub: Case) -> None:
    point = stub.position(4401)[None]
    without, null = (solve(c, cycle(), count=4).at(point) for c in (stub, stub.with_material(prony=((0.0, 1.5),))))
    np.testing.assert_allclose(null, without, atol=1e-6)  # mm, DESIGN: null values equal the base
    some = solve(stub.with_material(prony=((0.2, 1.5),)), cycle(), count=4).at(point)
    assert np.abs(some - without).max() > 0.05
    assert (np.diff(some[:, 0, 2])[0] < -0.01).all()  # it creeps during the hold


def test_creep_with_two_equal_terms_is_creep_with_their_sum(stub: Case) -> None:
    point = stub.position(4401)[None]
    one, two = (
        solve(stub.with_material(prony=p), cycle(), count=4).at(point)
        for p in (((0.2, 1.5),), ((0.05, 1.5), (0.15, 1.5)))
    )
    np.testing.assert_allclose(two, one, atol=1e-7)


def test_materials_of_a_case_are_one_each() -> None:
    assert Material(0.2, 0.1).bulk == pytest.approx(1000 * 2 * 0.3)
