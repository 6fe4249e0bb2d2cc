"""Gates for marks that cannot be what is stated of them: each planted mistake with its sentence, and right
marks near each limit, which pass. The camera is OpenCV's own projection; nothing is drawn."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import says
from vision import Mark
from vision.doubts.framemarks import frame_fit, without_odd
from vision.doubts.plausibility import check_marks
from vision.kinds import CodedMarker
from vision.marks import corner_warp

Array = NDArray[np.float64]
Lab = Any  # the fixture's class, see conftest.py
RIGHT, DOWN = np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])  # of a mark's print, seen from +y
SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def seen(lab: Lab, marks: Sequence[Mark], *, behind: bool = False, places: Array | None = None) -> Array:
    """Warps (p,3,3) of marks that are really at their positions, or at places (p,3) mm; behind: of the scene
    turned by half a turn about z, so that the camera looks from -y."""
    where = np.array([m.position for m in marks]) if places is None else places
    right, turn = (-RIGHT, np.array([-1.0, -1.0, 1.0])) if behind else (RIGHT, np.ones(3))
    about = np.array([90.0, 0.0, 0.0]) if behind else np.zeros(3)
    warps = []
    for mark, place in zip(marks, where, strict=True):
        corners = np.array([place + 0.5 * mark.size_mm * (a * right + b * DOWN) for a, b in SQUARE])
        warps.append(corner_warp(lab.camera.undistort(lab.pixels(corners * turn + about))))
    return np.array(warps)


def stated(marks: Sequence[Mark], change: Callable[[Mark], Mark]) -> list[Mark]:
    return [change(m) for m in marks]


def moved(x: float = 1.0, y: float = 1.0, z: float = 1.0) -> Callable[[Mark], Mark]:
    return lambda m: replace(m, position=(m.position[0] * x, m.position[1] * y, m.position[2] * z))


def sized(factor: float, name: str = "") -> Callable[[Mark], Mark]:
    return lambda m: replace(m, kind=CodedMarker(m.kind.code, m.size_mm * factor)) if name in m.name else m  # type: ignore[attr-defined]


def ids(a: str, b: str, marks: Sequence[Mark]) -> list[Mark]:
    kind = {m.name: m.kind for m in marks}
    return [replace(m, kind=kind[{a: b, b: a}.get(m.name, m.name)]) for m in marks]


def as_found(warp: Array, real: Sequence[Mark], marks: Sequence[Mark]) -> Array:
    """The warps (p,3,3) that marks of these ids are found at."""
    row = {m.kind.code: p for p, m in enumerate(real)}  # type: ignore[attr-defined]
    return warp[[row[m.kind.code] for m in marks]]  # type: ignore[attr-defined]


def shifted(name: str, x: float, z: float) -> Callable[[Mark], Mark]:
    return lambda m: replace(m, position=(m.position[0] + x, m.position[1], m.position[2] + z)) if m.name == name else m


WRONG = [
    (lambda marks: stated(marks, moved(0.1, 0.1, 0.1)), r"0\.9 mm wide \(median\), size_mm says 9 mm.*positions in cm instead of mm"),
    (lambda marks: stated(marks, moved(1e-3, 1e-3, 1e-3)), r"positions in m instead of mm"),
    (lambda marks: stated(marks, moved(1 / 25.4, 1 / 25.4, 1 / 25.4)), r"positions in inches"),
    (lambda marks: stated(marks, sized(2.0)), r"which is 2 times as much; either all sizes or all positions"),
    (lambda marks: stated(marks, sized(0.1)), r"sizes in cm instead of mm"),
    (lambda marks: stated(marks, sized(1.18)), r"1\.18 times as much"),
    (lambda marks: stated(marks, sized(2.0, "finger11")), r"'finger11' has size_mm = 18, but looks 9 mm wide"),
    (lambda marks: ids("frame0", "frame4", marks), r"'frame0' \(id 4\) and 'frame4' \(id 0\) have each other's places.*exchange their marker ids"),
    (lambda marks: ids("frame1", "fixed7", marks), r"'frame1' \(id 7\) and 'fixed7' \(id 1\) have each other's places"),
    (lambda marks: ids("frame2", "finger12", marks), r"'frame2' \(id 12\) and 'finger12' \(id 2\) have each other's places"),
    (lambda marks: stated(marks, shifted("frame1", 18.0, 0.0)), r"'frame1' lies 18\.0 mm from its stated place, wanted at most 3 mm.*see it at x = 45\.0, z = 34\.0"),
    (lambda marks: stated(marks, shifted("frame1", 0.0, 3.3)), r"'frame1' lies 3\.3 mm"),
    (lambda marks: stated(stated(marks, shifted("frame1", 18.0, 0.0)), shifted("frame3", 0.0, 14.0)), r"neither one marker nor an exchange of two explains it"),
    (lambda marks: stated(marks, moved(z=-1.0)), r"mirrored.*looks from the -y side.*their z runs down"),
    (lambda marks: stated(marks, moved(x=-1.0)), r"mirrored.*their z runs up"),
    (lambda marks: stated(marks, moved(y=-1.0)), r"mirrored.*y = -12 mm says that they face the -y side"),
    (lambda marks: stated(marks, lambda m: moved(y=-1.0)(m) if m.role == "finger" else m), r"'finger10' is stated at y = -12 mm and the frame markers at y = 12 mm"),
    (lambda marks: ids("finger10", "finger11", marks), r"'finger10' \(id 11\) and 'finger11' \(id 10\) lie in the opposite order"),
    (lambda marks: ids("finger10", "finger12", marks), r"reverse of the stated order"),
    (lambda marks: stated(marks, lambda m: moved(0.1)(m) if m.role == "finger" else m), r"finger marker 'finger10' lies 27\.0 mm from its stated place at rest"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "sentence"), WRONG)
def test_a_planted_mistake_gets_its_sentence(lab: Lab, change: Any, sentence: str) -> None:
    marks = change(lab.marks)
    warp = as_found(seen(lab, lab.marks), lab.marks, marks)
    with pytest.raises(ValueError, match=sentence):
        check_marks(marks, warp, camera=lab.camera)


NEAR = [
    lambda marks: list(marks),
    lambda marks: stated(marks, sized(1.12)),
    lambda marks: stated(marks, sized(0.9)),
    lambda marks: stated(marks, sized(1.12, "finger11")),
    lambda marks: stated(marks, shifted("frame1", 0.0, 2.7)),
    lambda marks: stated(marks, shifted("fixed7", 18.0, 0.0)),  # its displacement is 0 wherever it is
    lambda marks: stated(marks, moved(1.004, 1.0, 1.004)),
]


@pytest.mark.parametrize("change", NEAR)
def test_right_marks_near_a_limit_pass(lab: Lab, change: Any) -> None:
    check_marks(change(lab.marks), seen(lab, lab.marks), camera=lab.camera)


def test_places_by_a_ruler_pass(lab: Lab) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        marks = [
            replace(m, position=tuple(np.array(m.position) + rng.normal(0, 0.5, 3) * (1, 0, 1))) if m.role == "frame" else m
            for m in lab.marks
        ]
        check_marks(marks, seen(lab, lab.marks), camera=lab.camera, frame_sd_mm=0.5)


def test_a_sagging_finger_passes_and_a_hidden_mark_is_no_matter(lab: Lab) -> None:
    places = lab.motion([0.009])[0][0]  # the last mark hangs 32 mm
    warp = seen(lab, lab.marks, places=places)
    check_marks(lab.marks, warp, camera=lab.camera)
    warp[[0, 7, 11]] = np.nan
    check_marks(lab.marks, warp, camera=lab.camera)
    check_marks(lab.marks, warp, camera=None)


def test_a_camera_on_the_other_side_passes_where_y_says_so(lab: Lab) -> None:
    glued = stated(lab.marks, moved(y=-1.0))
    warp = seen(lab, glued, behind=True)
    check_marks(glued, warp, camera=lab.camera)
    with pytest.raises(ValueError, match=r"mirrored.*from the -y side, but their y = 12 mm"):
        check_marks(lab.marks, warp, camera=lab.camera)


def test_one_frame_mark_off_by_less_than_the_limit_is_kept_as_a_fixed_one(lab: Lab) -> None:
    warp = seen(lab, lab.marks)
    marks = stated(lab.marks, shifted("frame4", 2.0, 0.0))
    fit = frame_fit(marks, warp[:, :2, 2], sd_mm=0.1, camera=lab.camera)
    assert fit is not None
    kept, said = without_odd(fit, marks)
    assert [m.role for m in kept].count("frame") == 5
    assert kept[4].role == "fixed"
    says(said[0], "'frame4'", "2.00 mm")
    assert "x = 45.00, z = -64.00 mm" in said[0]
    assert without_odd(frame_fit(lab.marks, warp[:, :2, 2], sd_mm=0.1, camera=lab.camera), lab.marks) == (list(lab.marks), ())


def test_places_that_all_scatter_keep_every_frame_mark(lab: Lab) -> None:
    rng, warp = np.random.default_rng(1), seen(lab, lab.marks)
    dropped = 0
    for _ in range(40):  # three times the stated sd: the sd is enlarged instead
        off = [m if m.role != "frame" else replace(m, position=tuple(np.array(m.position) + rng.normal(0, 0.3, 3) * (1, 0, 1))) for m in lab.marks]
        dropped += bool(without_odd(frame_fit(off, warp[:, :2, 2], sd_mm=0.1, camera=lab.camera), off)[1])
    assert dropped <= 4  # six marks leave four degrees of freedom: by chance one of them explains all
