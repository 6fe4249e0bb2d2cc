"""Every field of a case, and of what it holds, is differentiated as whole solves are, or refused by name."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

import fe.path
from fe import Block, Case, Clamp, Material, Path, Support, Variation, solve
from fe.case import Contact, Equation, Layer, SelfContact, Spring, Tie
from fe.element import Array
from fe.obstacles import Flat
from fe.solver.newton import equilibrium
from tests.fe.conftest import SILICONE

Test = tuple[Case, Path]
Map = Callable[[Test, float], Test]
Cube = Callable[..., Case]
UP = (0.0, 0.0, 1.0)
LITTLE = 1e-6  # MPa, N/mm or MPa/mm: so little more on one side can be differenced though it comes at once
STIFFER = replace(SILICONE, C10=SILICONE.C10 + LITTLE)
TIME = np.array([0.0, 1.0, 2.0])
LOAD = np.array([0.0, 0.02, 0.01])  # MPa
RECORDS = (Case, Path, Support, Clamp, Layer, Contact, Material)


@pytest.fixture(autouse=True)
def tight(monkeypatch: pytest.MonkeyPatch) -> None:
    """The derivatives' tangent is TOLERANCE away from the equilibrium; both are to be compared to 1e-5. Few
    times on a path: both sides have the same."""
    monkeypatch.setitem(equilibrium.__kwdefaults__, "tolerance", 1e-10)
    monkeypatch.setattr(fe.path, "RAMP", 2)
    monkeypatch.setattr(fe.path, "SOFT_RAMP", 2)


def bar(cube: Cube) -> Case:
    """A bar of 4 x 1 x 1 mm in an elastic clamp, of two materials, its end lifted, near a plane below it."""
    case = cube((2, 1, 1), pressurised="z1", shift=0.03)
    lift = np.zeros((len(case.node_sets["x1"]), 3))
    lift[:, 1] = 0.02
    return replace(
        case,
        nodes=case.nodes * [4.0, 1.0, 1.0],
        node_sets=case.node_sets | {"corner": case.node_sets["x1"][:2]},
        element_sets={"body": np.array([0]), "rest": np.array([1]), "none": np.empty(0, np.int64)},
        materials={"body": SILICONE, "rest": STIFFER, "none": SILICONE},
        clamp=Clamp("x0", (0.0, 0.5), 1e-2),
        supports=(Support("x1", (1,), lift),),
        forces={"x1": np.array([0.01, 0.0, -0.002])},
        layer=Layer("y1", 0.05),
        contact=Contact("z0", Flat(UP, -0.004), 0.5),
    )


def path() -> Path:
    hung = np.array([[4.0, 0.5, 0.5]])
    down = np.array([0.0, 0.0, -9810.0])
    return Path(
        TIME, LOAD, TIME[2:], gravity=down, places=hung, pulls=np.array([[0.0, 0.0, -1e-3]]), chambers=("z1",),
        shares=np.ones(1),
    )  # fmt: skip


def of(part: str, **change: Callable[[float], object]) -> Map:
    """A record within the case with one field as a function of the parameter."""

    def put(test: Test, x: float) -> Test:
        case, path = test
        record = getattr(case, part)
        return replace(case, **{part: replace(record, **{k: f(x) for k, f in change.items()})}), path

    return put


def case(**change: Callable[[Case, float], object]) -> Map:
    """The case with one field as a function of it and the parameter."""
    return lambda test, x: (replace(test[0], **{k: f(test[0], x) for k, f in change.items()}), test[1])


def along(**change: Callable[[Path, float], object]) -> Map:
    """The path with one field as a function of it and the parameter."""
    return lambda test, x: (test[0], replace(test[1], **{k: f(test[1], x) for k, f in change.items()}))


def material(**change: Callable[[float], object]) -> Map:
    """The material of the first element with one constant as a function of the parameter."""

    def put(test: Test, x: float) -> Test:
        case, path = test
        body = replace(case.materials["body"], **{k: f(x) for k, f in change.items()})
        return replace(case, materials=case.materials | {"body": body}), path

    return put


def support(part: str, value: Callable[[Support, float], object]) -> Map:
    """The bar's support with one field as a function of it and the parameter."""
    return case(supports=lambda c, x: (replace(c.supports[0], **{part: value(c.supports[0], x)}),))


def sided(x: float, plus: object, minus: object) -> object:
    """One thing on either side: what differs little may be differenced though it is not smooth."""
    return plus if x > 0 else minus


def lifted(s: Support, x: float) -> Array:
    assert s.value is not None
    return s.value + x * np.linspace(0.5, 1.0, s.value.size).reshape(s.value.shape)


def kinked(pressure: Array, x: float) -> Array:
    return pressure * (1 + x * np.arange(len(pressure)))


def turning(p: Path, x: float) -> Array:
    return np.array([[0.0, 0.0, -9810.0]] * 2 + [[9810.0 * x, 0.0, -9810.0]])


@dataclass(frozen=True)
class Line:
    """A field as a function of a parameter about 0; what refuses it, if anything; how far whole solves go to
    either side; whether anything is felt."""

    name: str
    change: Map
    refused: str = ""
    h: float = 1e-4
    felt: bool = True


# Every field of each record, several times where its parts differ.
FIELDS = [
    Line("Case.nodes", case(nodes=lambda c, x: c.nodes * [1 + x, 1.0, 1 + 2 * x])),
    Line("Case.nodes", case(nodes=lambda c, x: np.vstack([c.nodes, c.nodes[:1]])), refused="`nodes`, their number"),
    Line("Case.labels", case(labels=lambda c, x: c.labels + int(np.sign(x))), h=1.0, felt=False),
    Line("Case.blocks", case(blocks=lambda c, x: (Block("hex27", c.connectivity[::-1]),)), refused="`blocks`"),
    Line("Case.node_sets", case(node_sets=lambda c, x: c.node_sets | {"spare": np.array([int(x > 0)])}), h=1.0, felt=False),
    Line("Case.node_sets", case(node_sets=lambda c, x: c.node_sets | {"x1": c.node_sets["corner"]}), refused="`supports`"),
    Line("Case.node_sets", case(node_sets=lambda c, x: c.node_sets | {"x0": c.node_sets["x0"][1:]}), refused="`clamp`"),
    Line("Case.element_sets", case(element_sets=lambda c, x: c.element_sets | {
        "body": np.array(sided(x, [], [0]), int), "rest": np.array(sided(x, [0, 1], [1]), int),
    }), h=1.0),
    Line("Case.surfaces", case(surfaces=lambda c, x: c.surfaces | {"z1": c.surfaces["z0"]}), refused="`pressurised`"),
    Line("Case.surfaces", case(surfaces=lambda c, x: c.surfaces | {"z0": c.surfaces["y0"]}), refused="`contact`"),
    Line("Case.materials", case(materials=lambda c, x: c.materials | {"rest": replace(STIFFER, C01=0.083 + 0.1 * x)})),
    Line("Case.supports", case(supports=lambda c, x: ()), refused="`supports`"),
    Line("Case.supports", case(supports=lambda c, x: (*c.supports, Support("corner", (0,)))), refused="`supports`"),
    Line("Support.nodes", support("nodes", lambda s, x: "corner"), refused="`supports`"),
    Line("Support.components", support("components", lambda s, x: (1, 2)), refused="`supports`"),
    Line("Support.value", support("value", lifted)),
    Line("Case.clamp", case(clamp=lambda c, x: None), refused="`supports`|`clamp`"),
    Line("Clamp.nodes", of("clamp", nodes=lambda x: "corner"), refused="`supports`|`clamp`"),
    Line("Clamp.centre", of("clamp", centre=lambda x: (10 * x, 0.5 + 20 * x))),
    Line("Clamp.compliance", of("clamp", compliance=lambda x: 1e-2 + 10 * x)),
    Line("Case.pressurised", case(pressurised=lambda c, x: "y0"), refused="`pressurised`"),
    Line("Case.pressurised", case(pressurised=lambda c, x: None), refused="`pressurised`"),
    Line("Case.forces", case(forces=lambda c, x: {"x1": c.forces["x1"] + [0.0, 0.0, x]})),
    Line("Case.growing", case(growing=lambda c, x: {"x1": np.array([0.2, 0.0, 20 * x])})),
    Line("Case.kept", case(kept=lambda c, x: sided(x, ("rest",), ())), h=1.0, felt=False),
    Line("Case.precurvature", case(precurvature=lambda c, x: x)),
    Line("Case.precurvature", case(precurvature=lambda c, x: (x, 0.0, -x))),
    Line("Case.layer", case(layer=lambda c, x: sided(x, Layer("y1", LITTLE), None)), h=1.0),
    Line("Case.layers", case(layers=lambda c, x: sided(x, (Layer("y1", LITTLE),), ())), h=1.0),
    Line("Case.self_contact", case(self_contact=lambda c, x: sided(x, (SelfContact("y0", "y1"),), ())), h=1.0, felt=False),
    Line("Case.shares", case(shares=lambda c, x: {"z0": 0.5 + x}), refused="`shares`"),
    Line("Case.ties", case(ties=lambda c, x: sided(x, (Tie("y0", "y1", 0.1),), ())), refused="`ties`"),
    Line("Case.equations", case(equations=lambda c, x: (Equation(((1, 0, 1.0), (2, 0, -1.0))),)), refused="`ties`"),
    Line("Layer.surface", of("layer", surface=lambda x: "y1", stiffness=lambda x: 0.05 + x)),
    Line("Layer.stiffness", of("layer", stiffness=lambda x: 0.05 + x)),
    Line("Layer.wound", of("layer", wound=lambda x: x > 0, stiffness=lambda x: LITTLE), h=1.0),
    Line("Layer.angle", of("layer", wound=lambda x: True, stiffness=lambda x: 0.05, angle=lambda x: 30.0 + 1000 * x)),
    Line("Layer.poisson", of("layer", poisson=lambda x: 0.3 + 10 * x)),
    Line("Case.contact", case(contact=lambda c, x: sided(x, replace(c.contact, stiffness=LITTLE / 100), None)), h=1.0),
    Line("Contact.surface", of("contact", surface=lambda x: "y0"), refused="`contact`"),
    Line("Contact.obstacle", of("contact", obstacle=lambda x: Flat((x, 0.0, 1.0), -0.004 + 0.1 * x))),
    Line("Contact.spring", of("contact", spring=lambda x: Spring(1.0 + x, (0.0, 0.0, 1.0)))),
    Line("Contact.stiffness", of("contact", stiffness=lambda x: 0.5 + 10 * x)),
    Line("Contact.friction", of("contact", friction=lambda x: 0.1 + x)),
    Line("Material.chains", material(chains=lambda x: (0.1 + x, 2.0 + x))),
    Line("Material.C10", material(C10=lambda x: 0.214 + x)),
    Line("Material.C01", material(C01=lambda x: 0.083 + x)),
    Line("Material.C20", material(C20=lambda x: 10 * x)),
    Line("Material.C30", material(C30=lambda x: 1000 * x)),
    Line("Material.bulk_ratio", material(bulk_ratio=lambda x: 1000.0 * (1 + 10 * x))),
    Line("Material.prony", material(prony=lambda x: ((x, 1.5),))),
    Line("Material.gent", material(gent=lambda x: (x, 5.0))),
    Line("Material.ogden", material(ogden=lambda x: ((x, 3.0),))),
    Line("Material.mullins", material(mullins=lambda x: (x, 0.001, 0.1))),
    Line("Material.density", material(density=lambda x: 1e-9 + 1e-6 * x)),
    Line("Path.time", along(time=lambda p, x: p.time + x), refused="`time`"),
    Line("Path.pressure", along(pressure=lambda p, x: kinked(p.pressure, x))),
    Line("Path.output", along(output=lambda p, x: p.output - abs(x)), refused="`output`"),
    Line("Path.stiffness", along(stiffness=lambda p, x: 1 + x * p.time)),
    Line("Path.gravity", along(gravity=lambda p, x: p.gravity * (1 + x) + [100 * x, 0.0, 0.0])),
    Line("Path.gravity", along(gravity=turning), refused="`gravity`"),
    Line("Path.places", along(places=lambda p, x: p.places + x), refused="`places`"),
    Line("Path.pulls", along(pulls=lambda p, x: p.pulls * (1 + x) + [0.1 * x, 0.0, 0.0])),
    Line("Path.shares", along(shares=lambda p, x: p.shares + x)),
    Line("Path.chambers", along(chambers=lambda p, x: ("z0",)), refused="`chambers`"),
    Line("Path.settled", along(settled=lambda p, x: True), refused="`settled`"),
]  # fmt: skip


SMOOTH, REFUSED = ([line for line in FIELDS if bool(line.refused) == no] for no in (False, True))
# along a creeping path a few are enough: it carries the two sides from time to time as it does the base
ALONG = ("Support.value", "Case.nodes", "Case.forces", "Case.growing", "Clamp.compliance", "Material.prony", "Path.stiffness")
CREEPING = [line for line in SMOOTH if line.name in ALONG]


def test_there_is_a_line_for_every_field() -> None:
    wanted = {f"{record.__name__}.{f.name}" for record in RECORDS for f in fields(record)}
    assert {line.name for line in FIELDS} == wanted


def check(line: Line, test: Test) -> None:
    """The derivative at 0, of sides that are near, against a difference of whole solves."""

    def moved(x: float) -> Array:
        at = line.change(test, x)
        found = solve(*at, count=4)
        assert found.reason == "converged"
        return found.at(at[0].nodes[::4])  # of the nodes, wherever they are

    base, near = line.change(test, 0.0), line.h if line.h == 1.0 else 1e-6
    variation = Variation(line.change(test, near), line.change(test, -near), near)
    found = solve(*base, variations=[variation], count=4)
    assert found.reason == "converged"
    theirs = (moved(line.h) - moved(-line.h)) / (2 * line.h)
    size = np.abs(theirs).max()
    assert (size > 0) == line.felt
    np.testing.assert_allclose(found.variations_at(base[0].nodes[::4])[0], theirs, rtol=0, atol=1e-5 * size)


@pytest.mark.parametrize("line", SMOOTH, ids=lambda line: line.name)
def test_a_field_is_differentiated_as_whole_solves_are(cube: Cube, line: Line) -> None:
    check(line, (bar(cube).with_material(density=1e-9), path()))


@pytest.mark.parametrize("line", CREEPING, ids=lambda line: line.name)
def test_a_field_is_differentiated_along_a_path_of_creep(cube: Cube, line: Line) -> None:
    check(line, (bar(cube).with_material(prony=((0.2, 1.5),)), path()))


@pytest.mark.parametrize("line", REFUSED, ids=lambda line: line.name)
def test_what_has_no_derivative_is_refused_by_name(cube: Cube, line: Line) -> None:
    base = bar(cube), path()
    sides = (line.change(base, x) for x in (1e-6, -1e-6))
    with pytest.raises(ValueError, match=f"^a variation changes ({line.refused})"):
        solve(*base, variations=[Variation(*sides, 1e-6)])


def test_a_growing_force_is_the_dead_one_at_its_pressure(cube: Cube) -> None:
    case, force = cube((1, 1, 1), pressurised="z1", supports=(Support("x0", (0, 1, 2)),)), np.array([0.0, 0.0, 0.3])
    at = Path(TIME, LOAD, TIME[1:])
    grown = solve(replace(case, growing={"x1": force}), at, count=4).at(case.nodes)
    for k, pressure in enumerate(LOAD[1:]):
        dead = solve(replace(case, forces={"x1": pressure * force}), replace(at, output=at.output[[k]]), count=4)
        # levels of pressure carry the curve by cubics, and one equilibrium is none
        np.testing.assert_allclose(grown[k], dead.at(case.nodes)[0], rtol=0, atol=1e-5 * np.abs(grown).max())


def test_a_prescribed_displacement_alone_is_felt(cube: Cube) -> None:
    """Pressure alone loads it, and all but the displacement is equal."""
    supports = Support("x0", (0, 1, 2)), Support("x1", (2,), np.full((9, 3), 0.1))
    case = cube((1, 1, 1), pressurised="z1", supports=supports)
    check(Line("Support.value", of_last_support), (case, replace(path(), gravity=np.zeros(3))))


def of_last_support(test: Test, x: float) -> Test:
    case, path = test
    *others, last = case.supports
    assert last.value is not None
    return replace(case, supports=(*others, replace(last, value=last.value + x))), path


def test_a_start_with_another_prescribed_displacement_changes_nothing(cube: Cube) -> None:
    """The neighbour's held nodes are where its own support put them."""
    cases = [bar(cube), of_last_support((bar(cube), path()), 0.01)[0]]
    cold = solve(cases[1], path(), count=4).at(cases[1].nodes)
    warm = solve(cases[1], path(), count=4, start=solve(cases[0], path(), count=4)).at(cases[1].nodes)
    np.testing.assert_allclose(warm, cold, rtol=0, atol=1e-9)
