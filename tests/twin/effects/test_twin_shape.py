"""Effects of shape and structure: what moves and what stays, derivatives, other meshes, CalculiX."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from fe import Case, Path, Variation, solve
from fe.deck.reader import read_deck
from fe.element import ELEMENTS, Array
from fe.engines.calculix import CalculiX
from fe.engines.engine import Embedded
from fe.engines.writer import deck
from fe.kernel.assembly import Geometry
from fe.mesh.convert import converted
from fe.mesh.inner import inside
from fe.mesh.mirror import mirrored
from twin.contract.specimen import small_test
from twin.effects.protocol import Effect, Test, Unsolvable
from twin.effects.shape import Ballooning, EccentricCore, Precurvature, SidewaysCore, WallTaper
from twin.effects.supports import StrainLimitingLayer, flat_bottom

RAMP = Path(np.array([0.0, 1.0]), np.array([0.0, 0.02]), np.array([1.0]))
SHAPES: dict[Effect, dict[str, float]] = {
    WallTaper(): {"wall_taper.mm": 0.4},
    EccentricCore(): {"eccentric_core.mm": -0.3},
    SidewaysCore(): {"eccentric_core_y.mm": 0.3},
    Ballooning(): {"ballooning.depth": 0.4, "ballooning.place": 0.6, "ballooning.width": 8.0},
}
ALL = {
    **SHAPES,
    Precurvature(): {"precurvature.per_mm": 1e-3},
    StrainLimitingLayer(): {"strain_limiting_layer.stiffness": 0.3},
}


def ramped(case: Case) -> Test:
    return Test(case, RAMP, case.position(4401)[None], np.array([True]))


def named(e: Effect) -> str:
    return e.name


@pytest.mark.parametrize("e", SHAPES, ids=named)
def test_only_inner_surfaces_and_what_lies_between_move(e: Effect, short_case: Case) -> None:
    case = mirrored(short_case) if isinstance(e, SidewaysCore) else short_case
    changed = e.before(ramped(case), SHAPES[e]).case
    outside = np.unique(case.face_nodes("outside"))
    np.testing.assert_array_equal(changed.nodes[outside], case.nodes[outside])
    moved = np.linalg.norm(changed.nodes - case.nodes, axis=1)
    inner = inside(case).rows
    assert 0.05 < moved.max() == moved[inner].max() <= 0.4
    for s in case.supports:  # the symmetry plane stays one
        rows, own = case.node_sets[s.nodes], list(s.components)
        np.testing.assert_array_equal(changed.nodes[rows][:, own], case.nodes[rows][:, own])
    assert e.before(ramped(case), {**SHAPES[e], e.parameters[0].name: 0.0}).case.nodes is case.nodes


def bottom_wall(case: Case) -> tuple[Array, Array]:
    """Place along the chamber (0 to 1) and thickness in mm of the flat bottom wall, in its middle."""
    x = case.nodes[inside(case).rows]
    flat = x[(x[:, 2] < x[:, 2].min() + 0.45) & (np.abs(x[:, 1]) < 1e-9)]
    return (flat[:, 0] - x[:, 0].min()) / np.ptp(x[:, 0]), flat[:, 2]


def test_walls_are_as_thick_as_the_effects_say(short_case: Case) -> None:
    place, before = bottom_wall(short_case)
    keep = (place > 0.1) & (place < 0.9)  # beside the rounded ends
    for e, expected in (
        (WallTaper(), 0.4 * (place - 0.5)),
        (EccentricCore(), -0.3 + 0 * place),
        (Ballooning(), -0.4 * np.exp(-0.5 * ((place - 0.6) * 100 / 3 / 8.0) ** 2)),
    ):
        changed = e.before(ramped(short_case), ALL[next(k for k in ALL if k.name == e.name)]).case
        rows = inside(short_case).rows
        x = short_case.nodes[rows]
        flat = (x[:, 2] < x[:, 2].min() + 0.45) & (np.abs(x[:, 1]) < 1e-9)
        after = changed.nodes[rows][flat, 2]
        np.testing.assert_allclose((after - before)[keep], expected[keep], atol=1e-6)


@pytest.mark.parametrize("kind", [k for k in ELEMENTS if k != "hex27"])
def test_any_mesh_with_a_chamber_can_have_them(
    tube_deck: Callable[..., File], tmp_path: File, kind: str
) -> None:
    case = read_deck(tube_deck(tmp_path, kind, cells=6)).case
    test = Test(case, RAMP, case.position(70001)[None], np.array([True]))
    solid = Geometry(case.nodes, case.connectivity, case.element).weight.sum()
    for e, share in ((WallTaper(), 0.002), (EccentricCore(), 0.002), (Ballooning(), 0.0)):
        half = {k: 0.5 * v if k.endswith((".mm", ".depth")) else v for k, v in ALL[next(k for k in ALL if k.name == e.name)].items()}
        changed = e.before(test, half).case
        weight = Geometry(changed.nodes, changed.connectivity, changed.element).weight
        assert weight.min() > 0
        # a taper about the middle and a shift keep the volume; a thin band takes some away
        change = weight.sum() / solid - 1
        assert abs(change) < share if share else change < -0.005
    assert len(flat_bottom(case)) == (6 - 1 + 1) * 3 * (2 if kind.startswith(("C3D10", "C3D4")) else 1)


def test_a_sheet_lies_on_the_surface_of_its_name(short_case: Case) -> None:
    roof = short_case.surfaces["chamber"][::3]
    own, sheet = replace(short_case, surfaces={**short_case.surfaces, "strain_limiting_layer": roof}), StrainLimitingLayer()
    for case, faces in ((own, roof), (short_case, flat_bottom(short_case))):
        changed = sheet.before(ramped(case), {"strain_limiting_layer.stiffness": 1.0}).case
        assert changed.layer is not None
        np.testing.assert_array_equal(changed.surfaces[changed.layer.surface], faces)
        assert sheet.lacks(case) == ""


def test_walls_that_would_close_are_refused_with_a_sentence(short_case: Case) -> None:
    with pytest.raises(Unsolvable, match=r"eccentric_core.mm = 2.6 mm: an element of the wall keeps .* of its volume"):
        EccentricCore().before(ramped(short_case), {"eccentric_core.mm": 2.6})
    for e, values in SHAPES.items():  # within their bounds there is room in the built-in finger
        for p in e.parameters[:1]:
            for end in (p.low, p.high):
                e.before(ramped(short_case), {**values, p.name: end})
    solid = ramped(replace(short_case, pressurised=None))  # nothing to change: a workbench refuses the effect
    assert WallTaper().before(solid, {"wall_taper.mm": 0.1}) is solid
    assert WallTaper().lacks(solid.case) == "no chamber, whose walls could be off"
    with pytest.raises(ValueError, match="no pressurised surface: wanted a chamber"):
        inside(solid.case)


@pytest.mark.parametrize("e", ALL, ids=named)
@pytest.mark.parametrize("null", [True, False])
def test_derivatives_are_those_of_whole_solves(e: Effect, null: bool) -> None:
    small = small_test().case
    test, p = ramped(mirrored(small) if isinstance(e, SidewaysCore) else small), e.parameters[0]
    at = 0.0 if null else ALL[e][p.name]

    def case(value: float) -> Case:
        return e.before(test, {**ALL[e], p.name: value}).case

    def u(value: float) -> Array:
        found = solve(case(value), RAMP)
        assert found.converged
        return found.at(test.points)

    h = 1e-6 * p.step
    sides = [(case(at + s * h), RAMP) for s in (1, -1)]
    ours = solve(case(at), RAMP, variations=[Variation(sides[0], sides[1], h)]).variations_at(test.points)[0]
    h = 0.03 * p.step  # two steps take the fourth order in
    one, two = ((u(at + k * h) - u(at - k * h)) / (2 * k * h) for k in (1, 2))
    theirs = (4 * one - two) / 3
    assert np.abs(theirs).max() * p.step > 1e-4  # mm: it is felt
    np.testing.assert_allclose(ours, theirs, atol=1e-6 * np.abs(theirs).max())


def test_a_sideways_core_bends_sideways_and_its_image_the_other_way(short_case: Case) -> None:
    test = ramped(mirrored(short_case))
    ahead, behind = (
        solve(SidewaysCore().before(test, {"eccentric_core_y.mm": v}).case, RAMP) for v in (0.3, -0.3)
    )
    point, image = test.points, test.points * [1, -1, 1]
    np.testing.assert_allclose(ahead.at(point), behind.at(image) * [1, -1, 1], atol=1e-8)
    assert np.abs(ahead.at(point)[0, 0, 1] + ahead.at(image)[0, 0, 1]) > 0.01  # mm, both go one way


def test_calculix_feels_a_core_off_its_place_as_the_kernel_does(
    require: Callable[[str], None],
) -> None:
    require("ccx")
    base = converted(small_test().case.with_material(C10=0.214, C01=0.083), "C3D20RH")
    test = Test(base, RAMP, base.position(4401)[None], np.array([True]))
    changed = EccentricCore().before(test, {"eccentric_core.mm": -0.4}).case
    tight = "*CONTROLS, PARAMETERS=FIELD\n1e-6,1e-6\n*STATIC"  # by default ccx stops at half a per cent
    theirs = [CalculiX().run(deck(c, 0.02).replace("*STATIC", tight, 1)) for c in (base, changed)]
    ours = [Embedded().solve(c, 0.02) for c in (base, changed)]
    assert [r.reason for r in (*theirs, *ours)] == ["converged"] * 4
    effects = [b.u[np.argsort(b.labels)] - a.u[np.argsort(a.labels)] for a, b in (theirs, ours)]
    assert np.abs(effects[0] - effects[1]).max() < 0.02 * np.abs(effects[0]).max()
    assert np.abs(effects[0]).max() > 0.01  # mm
