"""Marks glued elsewhere, or nearer to the camera, than stated are told; a sag and a ruler's errors are not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from vision import Camera, Mark
from vision.doubts.misplacedmarks import doubts
from vision.kinds import CodedMarker
from vision.marks import corner_warp

FRAME = [(-24, 26), (30, 30), (70, 30), (120, 26), (-24, -58), (45, -60), (120, -58)]
FINGER = [("root", 20.0), ("p2", 37.0), ("middle", 54.0), ("tip", 110.0)]
Y, TAG = 11.5, 9.0


def marks(size: float = TAG) -> list[Mark]:
    still = [Mark(f"frame{k}", CodedMarker(k, TAG), (float(x), Y, float(z)), "frame") for k, (x, z) in enumerate(FRAME)]
    return [*still, *(Mark(n, CodedMarker(20 + k, size), (x, Y, 0.0), "finger") for k, (n, x) in enumerate(FINGER))]


def told(off: np.ndarray | None = None, *, stated: list[Mark] | None = None, noise_px: float = 0.05) -> tuple[str, ...]:
    """What is said of marks that are glued `off` (4,3) mm from where they are stated."""
    lens = Camera(np.array([[1350.0, 0, 322], [0, 1351.0, 198], [0, 0, 1]]), np.zeros(5), (640, 400))
    facing = np.array([[-1.0, 0, 0], [0, 0, -1.0], [0, -1.0, 0]])
    turned = np.asarray(cv2.Rodrigues(np.deg2rad([2.0, 1.5, 0.0]))[0]) @ facing
    pose = cv2.Rodrigues(turned)[0].ravel(), np.array([0.0, 0.0, 420.0]) - turned @ np.array([45.0, Y, -15.0])
    rng, warp = np.random.default_rng(0), []
    for k, mark in enumerate(marks()):
        place = np.array(mark.position) + (0.0 if off is None or k < len(FRAME) else off[k - len(FRAME)])
        half = mark.size_mm / 2
        corners = place + half * np.array([[1, 0, 1], [-1, 0, 1], [-1, 0, -1], [1, 0, -1]])
        seen = cv2.projectPoints(corners, *pose, lens.matrix, lens.distortion)[0].reshape(4, 2)
        warp.append(corner_warp(seen + noise_px * rng.standard_normal((4, 2))))
    return doubts(stated or marks(), np.array(warp), camera=lens, placement_sd_mm=0.3)


def sag(mm: float) -> np.ndarray:
    """A tip that hangs by so much: an arc from the clamp."""
    x = np.array([x for _, x in FINGER])
    radius = 110.0**2 / (2 * mm)
    return np.column_stack([radius * np.sin(x / radius) - x, 0 * x, radius * (np.cos(x / radius) - 1)])


@pytest.mark.parametrize("mm", [2.0, 15.0])
def test_a_fixed_mark_stated_elsewhere_is_named(mm: float) -> None:
    x, y, z = marks()[1].position
    rig = [replace(m, role="fixed", position=(x + mm, y, z)) if m.name == "frame1" else m for m in marks()]
    said = told(stated=rig)
    assert len(said) == (mm > 5.0)
    for sentence in said:
        assert sentence.startswith("Fixed marker 'frame1' is seen at x = 30.0, z = 30.0 mm, stated at x = 45, z = 30 mm.")


@pytest.mark.parametrize("off", [None, sag(8.0), sag(25.0), np.random.default_rng(1).normal(0, 0.4, (4, 3))])
def test_right_marks_pass(off: np.ndarray | None) -> None:
    assert told(off) == ()


@pytest.mark.parametrize(("row", "move"), [(3, (-4.0, 0, 0)), (2, (6.0, 0, 0)), (0, (2.5, 0, 0)), (2, (0, 0, 5.0)), (1, (0, 0, -5.0))])
@pytest.mark.parametrize("hangs", [None, sag(10.0)])
def test_a_mark_glued_elsewhere_is_named(row: int, move: tuple[float, float, float], hangs: np.ndarray | None) -> None:
    off = np.zeros((4, 3)) if hangs is None else hangs.copy()
    off[row] += move
    (sentence,) = told(off)
    assert sentence.startswith(f"Finger marker {FINGER[row][0]!r} is seen at x = ")
    assert "correct its position_mm or node" in sentence


@pytest.mark.parametrize(("mm", "words"), [(10.0, "larger than .* about (9|10|11) mm nearer to"), (-10.0, "smaller than .* about (9|10|11) mm farther from")])
def test_marks_at_another_height_than_stated_are_told_by_their_size(mm: float, words: str) -> None:
    import re

    sentence = told(np.tile([0.0, mm, 0.0], (4, 1)))[0]
    assert re.search(words, sentence), sentence
    assert "which is the plane of the frame markers" in sentence
    other = [m if m.role == "frame" else Mark(m.name, CodedMarker(20, 9.2), m.position, m.role) for m in marks()]
    assert not any("look" in s for s in told(np.tile([0.0, mm, 0.0], (4, 1)), stated=other))  # prints of two sizes
