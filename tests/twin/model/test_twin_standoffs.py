"""Markers that stand off the surface: seen where a rigid stalk on the turned surface holds them."""

from dataclasses import replace

import numpy as np
import pytest

from twin.bodies.kinds import BODIES
from twin.calibrated.positions import on_both_sides, placed
from twin.marktables import PointTable
from twin.model.firstorder import MarkerPoints, swung
from twin.model.keptmodel import base_model
from twin.model.structure import Structure, body_case
from twin.targets import Array, PointKind, TargetPoint, Targets, as_position

BODY = BODIES["tube"].model_validate({"length_mm": 40.0, "section": "rectangular"}).body
CASE = body_case(BODY, BODY.lattice)
STRUCTURE = Structure(CASE, "tube", {}, CASE.face_nodes("outside"))
FOOT, AXIS, HIGH = np.array([30.0, 8.0, 8.0]), np.array([0.0, 1.0, 0.0]), 6.0  # on the tube's side
PRESSURE = np.array([0.0, 0.01, 0.02])
CONSTANTS = {"C10": 0.1, "C01": 0.03}
pytestmark = pytest.mark.usefixtures("solved_once")


def targets(off: Array | None) -> Targets:
    n = len(PRESSURE)
    point = TargetPoint("ball", PointKind.PLACE, None, as_position(FOOT), off=None if off is None else as_position(off))
    return Targets(
        time=np.arange(float(n)), pressure=PRESSURE, block=np.zeros(n, int), points=(point,), value=np.zeros((n, 1, 3)),
        covariance=np.tile(np.eye(3), (n, 1, 1, 1)), valid=np.ones((n, 1, 3), bool), held_out=np.zeros(n, bool),
        modes=np.zeros((0, n, 1, 3)), mode_names=(), noise=None, log_time=np.arange(float(n)), log_pressure=PRESSURE,
        reference=np.array([0]), gravity=None, pressure_sd=np.zeros(n),
    )  # fmt: skip


def at(place: Array) -> Array:
    """Displacements (s, 3) mm of a material point."""
    t = targets(None)
    model = base_model(replace(t, points=(replace(t.points[0], position=as_position(place)),)), CASE)
    return np.asarray(model.predict(model.theta(CONSTANTS))[:, 0], float)


def test_a_marker_off_the_surface_is_where_a_stalk_on_it_would_hold_it() -> None:
    model = base_model(targets(HIGH * AXIS), CASE)
    u = model.predict(model.theta(CONSTANTS))[:, 0]
    foot, h = at(FOOT), -0.5
    along, up = ((at(FOOT + h * way) - foot) / h + way for way in np.eye(3)[[0, 2]])
    normal = np.cross(up, along)  # z times x is y, outwards
    stalk = HIGH * (normal / np.linalg.norm(normal, axis=1)[:, None] - AXIS)
    assert np.abs(stalk).max() > 0.2  # mm: it is seen
    np.testing.assert_allclose(u, foot + stalk, atol=1e-6)
    strained = HIGH * (at(FOOT) - at(FOOT - 0.1 * AXIS)) / 0.1
    assert np.abs(strained - stalk).max() > 0.05  # the wall beneath becomes thinner, a stalk not shorter


def test_markers_on_both_sides_of_a_symmetric_body_are_mirror_images() -> None:
    stated = [PointTable(name=n, position_mm=(30.0, y, 8.0), standoff_mm=6.0) for n, y in (("a", 14.0), ("b", -14.0))]
    assert on_both_sides(STRUCTURE, stated[:1], mirrored=False) is STRUCTURE
    assert on_both_sides(STRUCTURE, stated, mirrored=True) is STRUCTURE  # a single camera: seen as its image
    both = on_both_sides(STRUCTURE, stated, mirrored=False)
    places = placed(stated, both, mirrored=False)
    np.testing.assert_allclose(places["b"].nearest, [30.0, -8.0, 8.0], atol=1e-3)
    assert both.outside.max() < len(both.case.nodes) == both.base.build().nodes.shape[0] > len(CASE.nodes)
    points = [TargetPoint(n, PointKind.PLACE, None, as_position(p.nearest), off=as_position(p.off)) for n, p in places.items()]
    seen = []
    for point in points:
        model = base_model(replace(targets(HIGH * AXIS), points=(point,)), both.case)
        seen.append(model.predict(model.theta(CONSTANTS))[:, 0])
    np.testing.assert_allclose(seen[1], seen[0] * (1.0, -1.0, 1.0), atol=1e-6)
    half = base_model(targets(HIGH * AXIS), CASE)
    np.testing.assert_allclose(seen[0], half.predict(half.theta(CONSTANTS))[:, 0], atol=1e-6)


def test_its_derivatives_are_those_of_predictions() -> None:
    model = base_model(targets(HIGH * AXIS), CASE)
    theta, h = model.theta(CONSTANTS), 1e-4
    for k, row in enumerate(model.jacobian(theta)):
        ends = [model.predict(theta + side * h * np.eye(len(theta))[k]) for side in (1, -1)]
        wanted = (ends[0] - ends[1]) / (2 * h)
        np.testing.assert_allclose(row, wanted, rtol=0, atol=2e-3 * np.abs(wanted).max())


def test_load_paths_tell_the_same_of_it() -> None:
    t = targets(HIGH * AXIS)
    followed = MarkerPoints.of(t, CASE, np.array([0]))
    model = base_model(t, CASE)
    theta = model.theta(CONSTANTS)
    u = np.stack([at(x) for x in followed.points], axis=1)
    np.testing.assert_allclose(followed.seen(u), model.predict(theta), atol=1e-6)


def test_a_patch_that_turns_and_stretches_turns_its_stalk_alone() -> None:
    x, c, s = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    moved = x @ np.diag([1.3, 0.9, 1.0]) @ turn.T + [3.0, -1.0, 2.0]
    np.testing.assert_allclose(swung(np.array([0.0, 0, 1]), x, moved - x), turn[:, 2] - [0, 0, 1], atol=1e-12)


def test_a_stated_standoff_is_held_against_the_place() -> None:
    def place(z: float, standoff: float | None) -> Array | None:
        point = PointTable(name="ball", position_mm=(30.0, 0.0, z), standoff_mm=standoff)
        return placed([point], STRUCTURE, mirrored=False)["ball"].off

    np.testing.assert_allclose(place(-5.5, 6.0), [0.0, 0.0, -6.0], atol=1e-5)  # of the search for the foot
    assert place(-1.0, None) is None
    with pytest.raises(ValueError, match=r"not on the finger.*of a ball or a tag on a stalk state standoff_mm = 5\.5, too"):
        place(-5.5, None)
    with pytest.raises(ValueError, match=r"points\.ball\.standoff_mm = 12: its position_mm .* lies 5\.5 mm off the surface"):
        place(-5.5, 12.0)
    with pytest.raises(ValueError, match=r"lies 0\.5 mm off the surface; wanted the place of the marker itself"):
        place(-0.5, 2.0)
    with pytest.raises(ValueError, match=r"standoff_mm = 6 and a node; wanted the place of the marker itself"):
        PointTable(name="ball", node=4401, position_mm=(30.0, 0.0, -6.0), standoff_mm=6.0)
