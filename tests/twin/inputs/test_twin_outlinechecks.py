"""The outline of the moved finger beside the calibrated model: its moments, its sentences, and tags."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from fe import Case
from twin.inputs.outlinechecks import OutlineCheck, _Marker, _MovedModel, moments_of
from twin.targets import Array, Targets
from vision.placing.restplaces import BodyPose

STEPS, SHOWN = 8, np.array([1, 3, 6])


@pytest.fixture
def targets(make_targets: Callable[..., Targets]) -> Targets:
    """Of two markers under a pressure that rises and falls."""
    return make_targets(pressure=0.06 * np.array([0.0, 0.5, 1.0, 1.0, 0.75, 0.5, 0.25, 0.0]))


def test_moments_are_spread_over_the_path_of_the_pressure(targets: Targets) -> None:
    steps = moments_of(targets, 4)
    np.testing.assert_allclose(targets.pressure[steps], [0.03, 0.06, 0.03, 0.0], atol=2e-3)
    assert list(steps) == sorted(set(steps))


class Beside:
    """An outline beside which the body moves by so much (2,) mm beyond the model, known to 0.02 mm."""

    off = np.array([0.1, -0.1, np.nan])
    sd = np.array([0.05, 0.05, 0.05])
    body = np.zeros((3, 3))
    pixel = np.zeros((3, 2))

    def __init__(self, motion: Array) -> None:
        self.motion = motion

    def beside(self, rest: Array, place: Array) -> tuple[Array, Array, Array]:
        return self.motion, 4e-4 * np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])  # it hangs down


def told(targets: Targets, slip: Array, *, along: float = 0.0) -> str:
    """What is said of the first marker, which has moved by slips (s, 3) mm more than is foretold, and the body
    beside it by `along` mm along the finger."""
    foretold, seen = targets.value - slip[:, None], np.zeros((len(targets.points), 3))
    marker = _Marker(targets, foretold, seen, 0, BodyPose())
    return marker.sentence(cast(Any, [Beside(np.array([along, 0.0]))] * len(SHOWN)), SHOWN)


def test_a_slipping_tag_is_named_by_place_and_pressure(targets: Targets) -> None:
    slip = np.zeros((STEPS, 3))
    assert told(targets, slip) == ""
    slip[3:, 2] = -0.8
    sentence = told(targets, slip)
    assert sentence.startswith(f"Marker {targets.names[0]} has moved by 0.80")
    assert "mm along the finger against the outline beside it at 60 kPa" in sentence
    slip[6:] = 0.0
    assert told(targets, slip) == ""  # a single moment


def test_a_tag_that_moves_as_the_body_is_not_named(targets: Targets) -> None:
    slip = np.zeros((STEPS, 3))
    slip[:, 2] = -0.8  # along the finger, which hangs down
    assert told(targets, slip, along=0.8) == ""
    assert "by 0.80" in told(targets, 0 * slip, along=0.8)


def check(**changes: Any) -> OutlineCheck:
    values = {"time": np.array([1.0, 2.0]), "pressure": np.array([0.0, 0.06]), "apart": {}, "markers": 4,
              "outlines": cast(Any, (Beside(np.zeros(2)), Beside(np.zeros(2)))), "picture": np.zeros((20, 20))} | changes  # fmt: skip
    return OutlineCheck(**values)


def test_what_is_said_of_the_outline() -> None:
    assert check().said == (
        "The outline of the finger lies 0.100 mm rms beside the model's: 4 places of its edge at 2 moments, each "
        "known to 0.050 mm.",
    )
    assert check(apart={"p1": "Marker p1 slips."}).said[1:] == ("Marker p1 slips.",)
    doubted = check(apart=dict.fromkeys(["p1", "p2", "p3"], "slips")).said
    assert "Outline and markers disagree: p1, p2, p3" in doubted[1]
    wrong = check(apart={"p1": "Marker p1 slips."}, wrong=("model.length_mm = 70, the film shows 72",)).said
    assert wrong[1:] == ("model.length_mm = 70, the film shows 72", "Until then no tag is judged by the outline.")


def test_records_of_the_outline() -> None:
    record = check().record
    assert [row.places for row in record.moments] == [2, 2]
    assert record.rms_mm == pytest.approx(0.1)
    assert check().csv.splitlines()[1] == "1,0,0.000,0.000,0.1000,0.0500"
    assert check().drawn().startswith(b"\x89PNG")


def test_the_model_moves_as_is_foretold_of_its_markers(short_case: Case) -> None:
    """What the mesh's correction adds at markers bends the whole outline; the clamp stays."""
    nodes = short_case.nodes
    length = float(nodes[:, 0].max())
    seen = np.array([[x, 10.0, 0.0] for x in np.linspace(0.2, 1.0, 6) * length])

    def bend(x: Array) -> Array:
        u = np.zeros_like(x)
        u[:, 2] = -0.3 * (x[:, 0] / length) ** 2
        return u

    structure = SimpleNamespace(case=short_case, outside=None)
    solution = SimpleNamespace(fields=lambda steps: np.zeros((1, *nodes.shape)))
    own, foretold = np.zeros((1, 6, 3)), bend(seen)[None]
    model = _MovedModel(cast(Any, structure), cast(Any, solution), nodes, np.arange(6), seen, own, foretold)
    moved = model._nodes(0)
    np.testing.assert_allclose((moved - nodes)[:, 2], bend(nodes)[:, 2], atol=0.02)
    assert np.abs((moved - nodes)[short_case.clamped]).max() < 0.01
