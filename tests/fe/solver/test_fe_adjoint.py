"""Derivatives towards a memory that the base has not, against those of a followed history at its null."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import fe.path
from fe import Case, Path, Variation, solve
from fe.element import Array
from tests.fe.solver.test_fe_variations import FORCE, LOG, TOP, cycle, marked

Law = Callable[[Case, float], Case]
# A second rise beyond the first peak, where softening ends
SECOND = np.interp(LOG, [0, 0.8, 1.6, 2.2, 3.0, 4.0], [0, 0.6 * TOP, 0.6 * TOP, 0.1 * TOP, TOP, 0.3 * TOP])
OUTPUT = np.linspace(0.4, 4.0, 10)


@pytest.fixture(autouse=True)
def dense(monkeypatch: pytest.MonkeyPatch) -> None:
    """A followed history is of second order in its steps; adjoints take every log time."""
    monkeypatch.setattr(fe.path, "RAMP", 8)


def creep(case: Case, share: float) -> Case:
    return case.with_material(prony=((share, 1.5),))


def creep_in_front(case: Case, share: float) -> Case:
    """Creep of the elements nearer to the clamp alone."""
    rows = np.arange(len(case.connectivity))
    front = case.nodes[case.connectivity, 0].mean(axis=1) < 10.0
    silicone = replace(next(iter(case.materials.values())), prony=())
    materials = {"front": replace(silicone, prony=((share, 1.5),)), "rest": silicone}
    return replace(case, element_sets={"front": rows[front], "rest": rows[~front]}, materials=materials)


def softening(case: Case, amount: float) -> Case:
    return case.with_material(mullins=(amount, 0.002, 0.1))


def both(case: Case, path: Path, law: Law, *, h: float) -> tuple[Array, Array]:
    """Derivatives (s, 3, 3) of a base without memory, and of one that follows its own, which is null."""
    pair = Variation((law(case, h), path), (law(case, -h), path), h)
    without, followed = (solve(c, path, variations=[pair]) for c in (case, law(case, 0.0)))
    assert without.history is None
    assert followed.history is not None
    return without.variations_at(marked(case))[0], followed.variations_at(marked(case))[0]


def like(ours: Array, theirs: Array, *, tolerance: float) -> bool:
    """Whether they agree at every time, to a share of the largest of each point."""
    size = np.abs(theirs).max(axis=(0, 2), keepdims=True)
    return bool(size.max() > 0.1 and (np.abs(ours - theirs) <= tolerance * size + 1e-9).all())


@pytest.mark.parametrize("law", [creep, creep_in_front], ids=["all", "in front"])
def test_towards_creep(stub: Case, law: Law) -> None:
    path = replace(cycle(), output=OUTPUT)
    base = law(stub, 0.0)
    bare = replace(base, materials={k: replace(m, prony=()) for k, m in base.materials.items()})
    # what the steps of the followed history leave: a quarter of it with twice as many
    assert like(*both(bare, path, law, h=1e-7), tolerance=2e-3)


def test_towards_softening(stub: Case) -> None:
    path = Path(LOG, SECOND, OUTPUT)
    assert like(*both(stub, path, softening, h=1e-6), tolerance=1e-5)  # the same times; levels interpolated


def test_towards_creep_while_gravity_turns(stub: Case) -> None:
    heavy = stub.with_material(density=3e-9)
    gravity = np.where(LOG[:, None] < 2.0, [0.0, 0.0, -9810.0], [-9810.0, 0.0, 0.0])
    turned = replace(cycle(), output=OUTPUT, gravity=gravity)
    assert like(*both(heavy, turned, creep, h=1e-7), tolerance=1e-3)


def test_a_settled_weight_creeps_no_more(stub: Case) -> None:
    heavy = stub.with_material(density=3e-9)
    still = Path(LOG, np.zeros(len(LOG)), OUTPUT, gravity=np.array([0.0, 0.0, -9810.0]), settled=True)
    g = 0.2
    creeping = solve(creep(heavy, g), still).at(marked(stub))
    # its long-term modulus alone; the bulk modulus is that of an instant, which at 1000 mu does not show
    m = next(iter(heavy.materials.values()))
    soft = heavy.with_material(C10=(1 - g) * m.C10, C01=(1 - g) * m.C01)
    static = solve(soft, still).at(marked(stub))
    assert np.ptp(creeping, axis=0).max() < 1e-9
    np.testing.assert_allclose(creeping, static, atol=2e-3 * np.abs(static).max())
    hung_at_once = solve(creep(heavy, g), replace(still, settled=False)).at(marked(stub))
    assert np.ptp(hung_at_once, axis=0).max() > 0.05 * np.abs(static).max()


def test_towards_creep_of_a_settled_weight(stub: Case) -> None:
    heavy = stub.with_material(density=3e-9)
    settled = replace(cycle(), output=OUTPUT, gravity=np.array([0.0, 0.0, -9810.0]), settled=True)
    ours, theirs = both(heavy, settled, creep, h=1e-7)
    assert like(ours, theirs, tolerance=1e-3)
    at_once = both(heavy, replace(settled, settled=False), creep, h=1e-7)[1]
    assert not like(ours, at_once, tolerance=1e-2)


@pytest.mark.slow
def test_towards_creep_while_moduli_drift_and_while_the_clamp_gives_way(stub: Case) -> None:
    drifting = replace(cycle(), output=OUTPUT, stiffness=1 + 0.05 * LOG)
    assert like(*both(stub, drifting, creep, h=1e-7), tolerance=1e-3)
    hanging = replace(stub, forces={"tip_face": FORCE}, clamp=replace(stub.clamp, compliance=1e-3))
    assert like(*both(hanging, replace(cycle(), output=OUTPUT), creep, h=1e-7), tolerance=1e-3)


def test_a_secant_over_a_wide_step_is_that_of_whole_solves(stub: Case) -> None:
    path, h = replace(cycle(), output=OUTPUT), 0.05
    pair = Variation((creep(stub, 2 * h), path), (creep(stub, 0.0), path), h)
    ours = solve(stub, path, variations=[pair]).variations_at(marked(stub))[0]
    ends = [solve(c, path).at(marked(stub)) for c in (creep(stub, 2 * h), stub)]
    theirs = (ends[0] - ends[1]) / (2 * h)
    assert like(ours, theirs, tolerance=0.02)  # a tangent would be a tenth off


def test_many_laws_at_once_are_each_alone_and_cost_no_factorisation(stub: Case) -> None:
    path = replace(cycle(), output=OUTPUT)

    def pair(law: Law, h: float) -> Variation:
        return Variation((law(stub, h), path), (law(stub, -h), path), h)

    laws: list[Law] = [lambda c, g, tau=tau: c.with_material(prony=((g, tau),)) for tau in (0.3, 1.0, 3.0)]
    pairs = [*(pair(law, 1e-6) for law in laws), pair(softening, 1e-6)]
    plain, together = solve(stub, path), solve(stub, path, variations=pairs)
    assert together.iterations == plain.iterations
    np.testing.assert_array_equal(together.at(marked(stub)), plain.at(marked(stub)))
    alone = np.concatenate([solve(stub, path, variations=[p]).variations_at(marked(stub)) for p in pairs])
    size = np.abs(alone).max(axis=(1, 2, 3), keepdims=True)
    assert (np.abs(together.variations_at(marked(stub)) - alone) < 1e-9 * size).all()  # rounding
