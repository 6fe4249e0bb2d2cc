"""The rod of sections against closed forms, and the stiffness that it takes from the elements."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from fe import Case, Material, Path
from fe.mesh.extruding import box_grid, extruded, hollow_case
from twin.assets import mujocochain, sections, sectiontable
from twin.assets.rod import Rod, lengths, straight, turns
from twin.effects.protocol import Test

LENGTH, SHEAR = 40.0, 0.3


@pytest.fixture
def rod() -> Rod:
    """Bends that are no line of the pressure, and another stiffness at every pressure."""
    even = straight(bend=0.1, length=60.0, sections=6, top=0.03)
    p = even.pressure[:, None] / 0.03
    return replace(even, bend=(0.06 * p + 0.03 * p**2) * np.arange(1, 7) / 4, length=10 * (1 + 0.05 * p) * np.ones(6), bend_stiffness=200 * (1 + p) * np.ones(6))


def test_an_even_rod_bends_into_an_arc_towards_minus_z() -> None:
    rod = straight(bend=0.01, length=60.0, sections=100, top=0.03)
    u = rod.tip(0.03)
    np.testing.assert_allclose(u, [60 * np.sin(1.0) - 60, 0.0, -60 * (1 - np.cos(1.0))], atol=0.4)  # of 100 links
    assert u[2] < 0


def test_a_small_force_lifts_the_tip_as_its_joints_yield_at_that_pressure(rod: Rod) -> None:
    level = replace(rod, bend=0 * rod.bend, length=10 + 0 * rod.length)
    arms = np.arange(60.0, 0.0, -10.0)
    for pressure, stiffness in ((0.0, 200.0), (0.03, 400.0)):
        assert level.tip(pressure, 1e-3)[2] == pytest.approx(1e-3 * (arms**2 / stiffness).sum(), rel=1e-3)


def test_the_links_under_a_force_are_in_equilibrium(rod: Rod) -> None:
    """The least energy: a virtual turn of any joint does no work."""
    force, (bend, length), stiffness = 2e-2, rod.at(0.02), rod.stiffness_at(0.02)

    def energy(x: np.ndarray) -> float:
        more, longer = x
        tip = rod.joints(bend + more, length + longer)[-1]
        return float(stiffness @ more**2 + rod.pull_stiffness @ longer**2) / 2 - force * float(tip[2])

    from scipy.optimize import minimize

    found = minimize(lambda x: energy(x.reshape(2, -1)), np.zeros(12), method="BFGS", options={"gtol": 1e-7})
    more, longer = found.x.reshape(2, -1)
    np.testing.assert_allclose(rod.tip(0.02, force), rod.joints(bend + more, length + longer)[-1] - rod.rest[-1], atol=1e-3)


def test_rod_json_gives_the_rod_again(rod: Rod) -> None:
    data = json.loads(sectiontable.written(rod)["rod.json"])
    again = Rod.of(data)
    assert all(np.array_equal(getattr(again, name), getattr(rod, name)) for name in Rod.__dataclass_fields__)
    assert data["version"] == 1
    assert data["units"]["bend_stiffness"] == "N mm/rad"


def test_the_table_has_a_row_a_pressure_and_section(rod: Rod) -> None:
    lines = sectiontable.written(rod)["sections.csv"].splitlines()
    assert len(lines) == 1 + 5 * 6
    last = dict(zip(lines[0].split(","), map(float, lines[-1].split(",")), strict=True))
    assert last["curvature_per_mm"] == pytest.approx(0.09 * 6 / 4 / 10)
    assert last["stretch"] == pytest.approx(1.05)
    assert last["bend_stiffness_Nmm_per_rad"] == pytest.approx(400.0)


def test_the_springs_of_mujoco_rest_where_the_rod_is(rod: Rod) -> None:
    """Moment of the controls over the spring's stiffness, joint by joint, from the file alone."""
    root = ElementTree.fromstring(mujocochain.written(rod)["finger.xml"])
    springs = {j.get("name"): float(j.get("stiffness", "nan")) for j in root.iter("joint") if j.get("type")}
    moments = [{j.get("joint"): float(j.get("coef", "nan")) for j in fixed} for fixed in root.findall("tendon/fixed")]
    p = rod.pressure[3]
    s = p / float(root.find("custom/numeric").get("data"))  # type: ignore[union-attr, arg-type]
    bend, length = rod.at(float(p))
    for k in range(6):
        turn, longer = (sum(m[f"{what}{k + 1}"] * s ** (j + 1) for j, m in enumerate(moments)) / springs[f"{what}{k + 1}"] for what in ("bend", "stretch"))
        assert turn == pytest.approx(bend[k], rel=1e-6)
        assert 1e3 * longer == pytest.approx(length[k] - 10, rel=1e-6)
    assert springs["bend3"] == pytest.approx(1e-3 * 300.0)  # N m/rad, at half of the highest pressure
    assert len(root.findall(".//body")) == 6
    assert sum(float(g.get("mass", "nan")) for g in root.iter("geom")) == pytest.approx(1e3 * rod.mass.sum())


# -- the stiffness of a body ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bar() -> Test:
    """Half of a solid bar of 40 x 4 x 4 mm, clamped at x = 0."""
    quads = box_grid(np.linspace(0.0, 2.0, 2), np.linspace(0.0, 4.0, 3))
    cells = extruded(quads, np.linspace(0.0, LENGTH, 9)).reshape(-1, 27, 3)
    case = hollow_case(cells, np.ones(len(cells), bool), material=Material(C10=SHEAR / 2), marks={})
    path = Path(np.array([0.0, 1.0]), np.zeros(2), output=np.array([1.0]))
    return Test(case, path, np.zeros((0, 3)), np.zeros(0, bool))


@pytest.fixture(scope="module")
def places() -> np.ndarray:
    return np.stack([np.linspace(0.0, LENGTH, 6), np.zeros(6), np.full(6, 2.0)], axis=1)


def test_a_bar_has_the_stiffness_of_beam_theory_and_the_mass_of_its_volume(bar: Test, places: np.ndarray) -> None:
    """EI / l and EA / l away from the clamp, whose joint turns half as much and shares with its neighbour."""
    link, area, inertia = LENGTH / 5, 16.0, 4.0**4 / 12
    joints, links = sections._stiffness(bar, places, np.array([0.0, 0.01]), 1.0)
    assert bar.share == 0.5
    np.testing.assert_allclose(joints[0, 2:-1], 3 * SHEAR * inertia / link, rtol=0.01)
    np.testing.assert_allclose(links[1:-1], 3 * SHEAR * area / link, rtol=0.03)
    mass, stated = sections._mass(bar, places)
    assert not stated
    np.testing.assert_allclose(mass, sections.DENSITY * area * link, rtol=0.1)  # cells are no multiple of links
    assert mass.sum() == pytest.approx(sections.DENSITY * area * LENGTH)
    heavy = replace(bar, case=bar.case.with_material(density=2e-9))
    assert sections._mass(heavy, places)[1]
    assert sections._mass(heavy, places)[0].sum() == pytest.approx(2e-9 * area * LENGTH)


def test_a_force_lifts_the_bar_and_its_rod_alike(bar: Test, places: np.ndarray) -> None:
    joints, links = sections._stiffness(bar, places, np.array([0.0, 0.01]), 1.0)
    idle = np.broadcast_to(lengths(places), (2, 5))
    rod = Rod(pressure=np.array([0.0, 0.01]), rest=places, bend=np.zeros((2, 5)), length=idle, bend_stiffness=joints, pull_stiffness=links, mass=np.ones(5))
    force, lifted = sections._lifted(bar, rod, 0.0, ramp_s=1.0, hold_s=1.0)
    assert 0.05 * LENGTH < lifted[2] < 0.15 * LENGTH
    assert rod.tip(0.0, force)[2] == pytest.approx(lifted[2], rel=0.06)  # twelve links, and no shear


def test_turns_do_not_jump_where_a_finger_curls_up() -> None:
    angle = np.linspace(0.0, 7.0, 30)
    steps = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    np.testing.assert_allclose(turns(np.cumsum(np.concatenate([np.zeros((1, 3)), steps]), axis=0)), angle, atol=1e-9)


def test_what_a_neo_hooke_solid_would_lose_is_nothing_of_one_and_something_of_another(coarsest_case: Case) -> None:
    tip, pressure = coarsest_case.nodes[[int(coarsest_case.nodes[:, 0].argmax())]], np.array([0.02, 0.01])

    def lost(material: Material) -> float:
        still = Path(np.array([0.0, 1.0]), np.zeros(2), output=np.zeros(1))
        case = replace(coarsest_case, materials=dict.fromkeys(coarsest_case.materials, material))
        return sections._neo_hooke(Test(case, still, tip, np.ones(1, bool)), tip, pressure, 1.0)

    assert lost(Material(C10=0.3)) < 1e-6
    assert 1e-3 < lost(Material(C10=0.2, C01=0.1)) < 0.1
    assert np.isnan(lost(Material(C10=0.01)))  # too soft to carry 20 kPa
