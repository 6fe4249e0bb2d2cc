"""Every parameter of every material effect: its derivative, full field and along a history, against differences
of whole solves."""

import numpy as np
import pytest

from fe import Block, Case, Material, Path, Support, solve
from fe.element import Array
from fe.solver.newton import equilibrium
from tests.few import few
from twin.effects.material import Compressibility, Creep, Mullins, Stiffening, Thermal
from twin.effects.protocol import Effect, Test
from twin.model.prediction import Model, respond

# A rise, a hold, a fall, a rise beyond the first and a fall, in s and MPa; outputs where the history is solved.
LOG = np.linspace(0.0, 6.0, 61)
PRESSURE = np.interp(LOG, [0, 1, 2, 3, 4.5, 6], [0, 0.2, 0.2, 0.05, 0.25, 0.1])
SOLVED = np.array([1.0, 2.0, 3.0, 4.5, 6.0])
ROUNDING = 1e-10  # mm, of a whole solve
HOLD = 1  # the number of the output at the end of the hold

CREEP = {"creep.g1": 0.1, "creep.tau1": 1.5}
SOFT = {"mullins.softening": 0.3, "mullins.m": 1e-3}
LAW = {"stiffening.C20": 0.05, "stiffening.C30": 0.02, "compressibility.excess": 0.05, "thermal.rate": -0.01}
CASES = {
    "softening at null": ((Mullins(),), {**SOFT, "mullins.softening": 0.0}),
    "softening, creep": ((Mullins(2), Creep()), {**SOFT, "mullins.beta": 0.2, **CREEP}),
    "softening, drift": ((Mullins(), Thermal()), {**SOFT, "mullins.m": 5e-3, "thermal.rate": -0.01}),
    "law": ((Stiffening(2), Compressibility(), Thermal()), LAW),
    "law at null": ((Stiffening(2), Compressibility(), Thermal()), dict.fromkeys(LAW, 0.0)),
}  # fmt: skip


def box(force: float) -> Case:
    """An eighth of a hollow cube: seven cells around a missing one, which the symmetry planes close, its nodes
    moved at random within the planes, under a dead force N on its top."""
    k, j, i = np.meshgrid(*[np.arange(5)] * 3, indexing="ij")
    nodes = np.stack([i, j, k], axis=-1).reshape(-1, 3) / 2
    local = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]
    places = [(x, y, z) for z in (0, 2) for y in (0, 2) for x in (0, 2) if (x, y, z) != (0, 0, 0)]
    used, cells = np.unique([(local + at) @ [1, 5, 25] for at in places], return_inverse=True)
    nodes = nodes[used]
    sets = {"xyz"[d]: np.flatnonzero(nodes[:, d] == 0) for d in range(3)}
    sets["top"] = np.flatnonzero(nodes[:, 2] == 2)
    shift = np.random.default_rng(1).uniform(-0.04, 0.04, nodes.shape) * (nodes > 0)
    around = [[places.index(at), 2 * d] for d, at in enumerate(((2, 0, 0), (0, 2, 0), (0, 0, 2)))]
    return Case(
        nodes=nodes + shift,
        labels=np.arange(1, len(nodes) + 1),
        blocks=(Block("hex27", cells.reshape(len(places), 27)),),
        node_sets=sets,
        element_sets={"body": np.arange(len(places))},
        surfaces={"inside": np.array(around)},
        materials={"body": Material(0.214, 0.083)},
        supports=tuple(Support("xyz"[d], (d,)) for d in range(3)),
        pressurised="inside",
        forces={"top": np.array([0.0, 0.0, force])} if force else {},
    )


@pytest.fixture(autouse=True)
def tight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole solves to 1e-11 of the structure's size: their differences are to be right to 1e-6."""
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-11)


def model_of(effects: tuple[Effect, ...], force: float = -0.05) -> Model:
    case = box(force)
    test = Test(case, Path(LOG, PRESSURE, SOLVED), case.nodes, np.ones(len(case.nodes), bool))
    return Model(test, effects, np.array([0]))


def field(model: Model, values: dict[str, float]) -> Array:
    """Displacements (s, n, 3) mm by a whole solve."""
    test = model.put(values)
    solution = solve(test.case, test.path)
    assert solution.converged, solution.reason
    return solution.fields(range(len(SOLVED)))


def exact(model: Model, values: dict[str, float]) -> Array:
    """The derivatives (d, s, n, 3) that one solve gives."""
    changes = [model._direction(values, p)[0] for p in model.parameters]
    return respond(model.put(values), changes, start=None)[1]


@pytest.mark.parametrize("name", few(CASES, CASES.keys() - {"softening, drift"}))
def test_derivatives_of_material_effects(name: str) -> None:
    effects, values = CASES[name]
    model = model_of(effects)
    for p, ours in zip(model.parameters, exact(model, values), strict=True):
        h = 0.01 * p.step

        def difference(x: float, name: str = p.name) -> Array:
            a, b = (field(model, {**values, name: values[name] + sign * x}) for sign in (1, -1))
            return (a - b) / (2 * x)

        theirs = (4 * difference(h / 2) - difference(h)) / 3  # of fourth order in h
        size = np.abs(theirs).max()
        assert (size * p.step > 1e-4) == (p.name != "mullins.m" or values["mullins.softening"] > 0)  # mm: felt
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6 * size + ROUNDING / h, err_msg=p.name)


def test_where_an_effect_begins_from_a_softened_hold_the_derivative_is_one_sided() -> None:
    # held at its largest load the finger is at the kink: what loads it on is virgin, what unloads it is softened
    model = model_of((Mullins(), Creep()), force=0.0)
    values = {**SOFT, **CREEP, "creep.g1": 0.0}
    ours, base = exact(model, values)[2], field(model, values)
    h = 1e-4
    once, twice = (field(model, {**values, "creep.g1": k * h}) for k in (1, 2))
    forward = (4 * once - twice - 3 * base) / (2 * h)
    backward = (base - field(model, {**values, "creep.g1": -h})) / h
    size = np.abs(forward).max()
    np.testing.assert_allclose(ours, forward, rtol=0, atol=1e-6 * size)
    assert np.abs(backward[HOLD] - forward[HOLD]).max() > 0.1 * size
