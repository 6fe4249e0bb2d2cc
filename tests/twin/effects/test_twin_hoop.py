"""Fibres around a body: by hand on a tube, and where they lie on any body and deck."""

from dataclasses import replace

from benchmarks.kernel.arm import Arm

import numpy as np
import pytest

from fe import Case, Material, Path, solve
from fe.kernel.layer import LayerFaces
from fe.mesh.mirror import mirrored
from fe.mesh.skin import outer_skin
from twin.bodies.kinds import BODIES
from twin.effects.library import effect
from twin.effects.protocol import Test

SILICONE = Material(0.1)
A, B, LENGTH = 5.5, 8.0, 80.0  # mm: radii of chamber and tube, and its length


def tube() -> Case:
    body = BODIES["tube"].model_validate({"length_mm": LENGTH, "offset_mm": 0.0}).body
    return body.case(body.lattice, SILICONE)


def wound(case: Case, **values: float) -> Case:
    theta = {f"hoop_reinforcement.{name}": x for name, x in values.items()}
    label = "hoop_reinforcement:2" if "angle" in values else "hoop_reinforcement"
    path = Path(np.array([0.0, 1.0]), np.zeros(2), np.ones(1))
    return effect(label).before(Test(case, path, np.zeros((1, 3)), np.array([True])), theta).case


@pytest.mark.parametrize("stiffness", [0.0, 0.5, 3.0])
def test_a_tube_with_fibres_widens_and_lengthens_as_by_hand(stiffness: float) -> None:
    """Lame's closed tube of incompressible material, on whose outside fibres press with q = k e / b."""
    p, young, ring = 1e-4, 6 * 0.1, B**2 - A**2
    widens = 1.5 * p * A**2 / ring / (young + stiffness / B * (1.5 * A**2 + 0.5 * B**2) / ring)
    lengthens = stiffness * widens / B * B**2 / ring / young
    case = wound(tube(), stiffness=stiffness)
    path = Path(np.arange(2.0), np.array([0.0, p]), np.ones(1))
    points = np.array([[LENGTH / 2, B, B], [LENGTH / 3, B, B], [2 * LENGTH / 3, B, B]])
    u = solve(case, path).at(points)[0]
    assert u[0, 1] / B == pytest.approx(widens, rel=0.02)
    assert (u[2, 0] - u[1, 0]) / (LENGTH / 3) == pytest.approx(lengthens, abs=0.03 * widens)


def test_fibres_at_an_angle_resist_along_the_tube_as_the_square_of_the_sine_squared() -> None:
    case, strain = tube(), 1e-4
    longer = case.nodes * [1 + strain, 1.0, 1.0]
    ends = case.nodes[:, 0] > LENGTH / 2

    def force(angle: float) -> float:
        sheet = wound(case, stiffness=2.0, angle=angle)
        return -float(LayerFaces(sheet, sheet.sheets[0]).force(longer)[ends, 0].sum())

    circumference = np.pi * B  # of half a tube
    for angle in (0.0, 30.0, 45.0):
        wanted = 2.0 * strain * circumference * np.sin(np.radians(angle)) ** 4
        assert force(angle) == pytest.approx(wanted, rel=0.01, abs=1e-9)


@pytest.mark.parametrize("whole", [False, True])
def test_the_outer_skin_is_neither_bore_nor_chamber_nor_end(whole: bool) -> None:
    arm = Arm(cells=(2, 1, 1)).case()
    case = mirrored(arm) if whole else arm
    faces = outer_skin(case)
    nodes = replace(case, surfaces={"skin": faces}).face_nodes("skin")
    radius = np.hypot(*np.moveaxis(case.nodes[nodes][..., 1:], -1, 0))
    np.testing.assert_allclose(radius, 22.2, rtol=1e-9)
    assert len(faces) == (2 if whole else 1) * 4 * 8


def test_a_tube_s_skin_is_what_its_fibres_lie_on_and_a_deck_may_name_its_own(short_case: Case) -> None:
    case = tube()
    found = {tuple(row) for row in outer_skin(case).tolist()}
    assert found == {tuple(row) for row in case.surfaces["around"].tolist()}
    named = replace(case, surfaces={**case.surfaces, "hoop_reinforcement": case.surfaces["outside"][:3]})
    assert len(wound(named, stiffness=1.0).surfaces["hoop_reinforcement"]) == 3
    finger = {tuple(row) for row in short_case.surfaces["outside"].tolist()}
    skin = {tuple(row) for row in outer_skin(short_case).tolist()}
    assert skin < finger
    assert len(skin) > 0.2 * len(finger)
    assert effect("hoop_reinforcement").lacks(short_case) == ""


def test_the_arm_has_a_sheet_beside_its_axis_and_a_frame_of_its_own_material() -> None:
    arm = Arm(cells=(2, 1, 1), framed=True)
    case = arm.case(SILICONE)
    sheet = case.surfaces["strain_limiting_layer"]
    x = case.nodes[case.nodes_of_faces(sheet)]
    assert np.ptp(x[..., 0]) == arm.length  # all along
    np.testing.assert_allclose(x[..., 1], arm.bore, rtol=1e-9)
    assert np.abs(x[..., 2]).max() < arm.bore  # between the ribs, near the height of the axis
    softer = case.with_material(C10=0.01)
    assert softer.materials["body"].C10 == 0.01
    assert softer.materials["frame"] == case.materials["frame"]
    middle = case.nodes[case.connectivity[case.element_sets["frame"]]][..., 0].mean(axis=1)
    assert middle.min() > arm.length - arm.cap
