"""Markers whose material point is known by where the film at rest shows them, on a finger that sags."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fe import Case
from tests.messages import saying
from twin.calibrated.positions import beneath, seen_at_rest
from twin.model.keptmodel import base_model
from twin.model.structure import BuiltIn, of_body
from twin.targets import PointKind, TargetPoint, Targets

DENSITY = 8 * 1.07e-9  # tonne/mm3: the short finger sags by as large a share as the long one does
THETA = np.array([0.214, 0.083])  # MPa
DOWN = np.array([[0.0, 0.0, -1.0]])


def at(targets: Targets, *, rest: bool, where: tuple[float, float, float]) -> Targets:
    point = TargetPoint("tip", PointKind.PLACE, None, where, where if rest else None)
    return replace(targets, points=(point, *targets.points[1:]))


@pytest.mark.parametrize("theta", [THETA, 0.7 * THETA])
def test_the_material_point_is_where_the_model_that_sags_shows_the_marker(
    coarsest_case: Case, make_targets: Callable[..., Targets], theta: np.ndarray
) -> None:
    case = coarsest_case.with_material(density=DENSITY)
    t = make_targets(gravity=DOWN)
    label = coarsest_case.labels[np.argmax(coarsest_case.nodes @ [1.0, 0.5, 0.3])]
    x = coarsest_case.position(int(label)) - [6.0, 1.0, 1.0]
    stated = base_model(at(t, rest=False, where=tuple(x.tolist())), case)
    sag = stated.solution(theta).at(x[None])[t.reference].mean(axis=0)[0]
    assert np.abs(sag).max() > 0.3  # mm
    seen = (float(x[0] + sag[0]), float(x[1]), float(x[2] + sag[2]))
    model = base_model(at(t, rest=True, where=seen), case)
    np.testing.assert_allclose(model.predict(theta), stated.predict(theta), rtol=0, atol=2e-4)
    naive = base_model(at(t, rest=False, where=seen), case)
    assert np.abs(naive.predict(theta) - stated.predict(theta)).max() > 0.01
    step = 1e-3 * theta[0]
    ways = [theta + side * np.array([step, 0.0]) for side in (1, -1)]
    difference = (model.predict(ways[0]) - model.predict(ways[1])) / (2 * step)
    slope = model.jacobian(theta)[0]
    np.testing.assert_allclose(slope, difference, rtol=0, atol=0.03 * np.abs(difference).max())
    ignored = stated.jacobian(theta)[0]
    assert np.abs(ignored - difference).max() > 2 * np.abs(slope - difference).max()


def test_places_lie_on_the_side_face_beneath_the_marker(make_targets: Callable[..., Targets]) -> None:
    structure = of_body(BuiltIn())
    place = beneath(structure, np.array([52.3, 11.5, 9.0]))  # in a pleat of the side wall, or near one
    np.testing.assert_allclose(place[[0, 2]], [52.3, 9.0], atol=0.01)
    assert 5.0 < place[1] <= 11.5
    there = at(make_targets(), rest=True, where=(52.3, -11.5, 9.0))
    found = seen_at_rest(there, structure, mirrored=True).points[0]
    np.testing.assert_allclose(found.position, place, atol=1e-6)
    beside = at(make_targets(), rest=True, where=(52.3, 11.5, -7.0))
    with pytest.raises(ValueError, match=saying("points.tip", "z = -7.0", "beside the finger", "density", "pose")):
        seen_at_rest(beside, structure, mirrored=True)
