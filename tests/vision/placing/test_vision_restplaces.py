"""Places of the finger's marks that nobody states, and where the body stands in the frame, from drawn films."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import saying
from vision import Displacements, Mark, Video, View, measure
from vision.drawing import synthetic
from vision.errors import sharederrors
from vision.errors.sharederrors import Stated
from vision.following.markrotations import finger_turns
from vision.kinds import CodedMarker, MarkKind, PlainDot
from vision.placing.restplaces import BodyPose, pose_of

Array = NDArray[np.float64]
Lab = Any  # the fixture's class, see conftest.py
STANDS = BodyPose(x_mm=0.5, z_mm=-0.4, turn=np.deg2rad(0.5))
GLUED = np.array([(30.7, 0.4), (59.2, -0.8), (90.9, 0.6)])  # mm, of the body
BEND = np.concatenate([np.zeros(14), np.linspace(0, 0.01, 6)])
NOWHERE = (np.nan, 12.0, np.nan)


def bent(place: Array, curvature: Array) -> tuple[Array, Array]:
    """Places (t,p,2) mm of material points (p,2) of a beam on the x axis bent to arcs, and turns (t,p)."""
    k = np.where(curvature == 0.0, 1e-9, curvature)[:, None]
    (x, z), turn = place.T, -k * place[:, 0]
    return np.stack([np.sin(k * x) / k - z * np.sin(turn), -(1 - np.cos(k * x)) / k + z * np.cos(turn)], 2), turn


def in_frame(place: Array) -> Array:
    """Places (..., 2) mm of the body in the axes of the frame."""
    c, s = np.cos(STANDS.turn), np.sin(STANDS.turn)
    return np.asarray(place @ np.array([[c, s], [-s, c]]) + [STANDS.x_mm, STANDS.z_mm])


@pytest.fixture(scope="module")
def filmed(lab: Lab, tmp_path_factory: pytest.TempPathFactory) -> Video:
    """A film of a body that stands elsewhere, with tags elsewhere than on its nodes."""
    path = tmp_path_factory.mktemp("places") / "bend.mkv"
    place, turn = lab.motion(np.zeros(len(BEND)))
    fingers = lab.rows("finger")
    moved, turned = bent(GLUED, BEND)
    place[:, fingers, ::2], turn[:, fingers] = in_frame(moved), turned + STANDS.turn
    synthetic.film(path, camera=lab.camera, pose=lab.pose, marks=lab.marks, positions=place,
                   rotations=turn, codec="rawvideo", seed=3)  # fmt: skip
    return Video(path)


def unplaced(lab: Lab) -> list[Mark]:
    return [replace(m, position=NOWHERE, measured=True) if m.role == "finger" else m for m in lab.marks]


def of_finger(found: Displacements) -> list[int]:
    return [p for p, role in enumerate(found.roles) if role == "finger"]


def check(found: Displacements, marks: list[Mark]) -> None:
    """Places and displacements are the body's own, to 0.01 px or so."""
    rows = of_finger(found)
    np.testing.assert_allclose(found.points[rows][:, [0, 2]], GLUED, atol=0.006)
    true = bent(GLUED, BEND)[0]
    np.testing.assert_allclose(found.value[:, rows][..., [0, 2]], true - true[0], atol=0.008)


def test_places_and_a_stated_pose(lab: Lab, filmed: Video, still: Video) -> None:
    marks = STANDS.in_body(unplaced(lab))
    found = measure([View(filmed, still, lab.camera)], marks, reference=1.2)
    check(found, marks)
    assert not any(name.startswith("placement:") for name in found.mode_names)
    largest = np.abs(found.modes[found.mode_names.index("node:finger12:x")]).max()
    assert largest < 0.03  # of 0.02 mm, turned by a rad


def test_markers_of_the_clamp_tell_where_the_body_stands(lab: Lab, filmed: Video, still: Video) -> None:
    marks = unplaced(lab)
    for name in ("fixed8", "fixed6"):  # one of them at the far end, so that 0.01 mm tells the turn
        p = next(k for k, m in enumerate(marks) if m.name == name)
        place = np.array(STANDS.in_body([marks[p]])[0].position)
        marks[p] = replace(marks[p], role="clamp", position=tuple(place.tolist()))
    found = measure([View(filmed, still, lab.camera)], marks, reference=1.2)
    check(found, marks)
    assert set(found.roles) == {"fixed", "finger"}
    poses = [k for k, name in enumerate(found.mode_names) if name.startswith("pose:")]
    assert len(poses) == 3
    tip, top = of_finger(found)[-1], float(np.nanmax(np.abs(found.value)))
    size = np.sqrt((found.modes[poses][:, -1, tip] ** 2).sum())
    assert 0.05 < size < 0.5  # 0.1 mm of a clamp marker, through 0.9 rad and a turn of 0.1 / 120 of 40 mm
    assert top > 30.0


def test_a_clamp_with_one_marker_is_refused(lab: Lab, filmed: Video, still: Video) -> None:
    marks = [replace(m, role="clamp") if m.name == "fixed8" else m for m in unplaced(lab)]
    wanted = saying('1 markers with role "clamp"', "wanted two or more", "pose")
    with pytest.raises(ValueError, match=wanted):
        measure([View(filmed, still, lab.camera)], marks, reference=1.2)
    with pytest.raises(ValueError, match="mm apart or more"):
        pose_of(np.zeros((2, 2)), np.zeros((2, 2)), 0.1)


@pytest.mark.parametrize("kind", [CodedMarker(1, 5.0), PlainDot(3.0)], ids=["tags", "dots"])
def test_errors_of_places_and_pose_are_what_they_do(kind: MarkKind) -> None:
    """Each mode is the difference of what is measured and what the true field says at the measured place."""
    k, marks = 1e-2, np.array([(x, 2.0) for x in np.arange(5.0, 100.0, 5.0)])
    curvature, turn, error = np.array([0.0, k]), 4e-3, np.array([0.3, -0.2])

    def u(x: Array) -> Array:
        place = bent(x, curvature)[0]
        return place - place[0]

    tags = [Mark(f"m{p}", kind, (x, 0.0, z), "finger", measured=True) for p, (x, z) in enumerate(marks)]
    value = np.zeros((2, len(marks), 3))
    value[..., ::2] = u(marks)
    turns = finger_turns(value, bent(marks, curvature)[1], tags)
    slope = sharederrors.slopes(value, tags, turns)
    small = np.array([[1.0, turn], [-turn, 1.0]])
    seen = marks @ small + error
    true = (u(marks) @ small) - u(seen)
    (field,) = sharederrors.pose(value, marks, slope, [(*error, turn)]).values()
    np.testing.assert_allclose(field[..., ::2], true, atol=0.01 * np.abs(true).max())
    (grown,) = sharederrors.scale(value, 1e-3, sharederrors.of_places(slope, marks)).values()
    true = 1.001 * u(marks) - u(1.001 * marks)
    np.testing.assert_allclose(grown[..., ::2], true, atol=0.01 * np.abs(value).max() * 1e-3)


def test_stated_places_keep_their_errors(lab: Lab, filmed: Video, still: Video) -> None:
    places = iter(GLUED.tolist())
    marks = [m if m.role != "finger" else replace(m, position=((at := next(places))[0], 12.0, at[1]))
             for m in lab.marks]  # fmt: skip
    found = measure([View(filmed, still, lab.camera)], STANDS.in_body(marks), reference=1.2,
                    stated=Stated(placement_mm=0.3))  # fmt: skip
    assert "placement:finger12:x" in found.mode_names
    assert not any(name.startswith("pose") for name in found.mode_names)
