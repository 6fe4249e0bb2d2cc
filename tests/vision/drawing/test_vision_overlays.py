"""The picture of what was followed: the right frame, paths, ellipses at their size, lost marks in red."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import saying
from vision.drawing.overlays import CENTRE, GONE, PATH, SPREAD, farthest, overlay
from vision.following.tracks import Method, Tracks

FRAMES, TURN = 20, 12  # the farthest frame


def tracks() -> Tracks:
    """One mark that goes to x = 300 and back, one that is lost from frame 8 on, one that is never seen."""
    away = np.interp(np.arange(FRAMES), [0, TURN, FRAMES - 1], [0.0, 200.0, 50.0])
    position = np.tile([[100.0, 100.0], [100.0, 200.0], [100.0, 300.0]], (FRAMES, 1, 1))
    position[:, 0, 0] += away
    method = np.full((FRAMES, 3), Method.REGISTERED, dtype=np.int8)
    method[8:, 1], method[:, 2] = Method.LOST, Method.LOST
    position[method == Method.LOST] = np.nan
    covariance = np.tile(np.diag([0.004**2, 0.002**2]), (FRAMES, 3, 1, 1))
    covariance[method == Method.LOST] = np.nan
    names = ("goes", "falls", "absent")
    return Tracks(
        time=np.arange(FRAMES) / 10.0,
        names=names,
        position=position,
        covariance=covariance,
        rotation=np.zeros((FRAMES, 3)),
        method=method,
    )


def film(frames: int = FRAMES) -> Any:
    def pictures(first: int, stop: int) -> Any:
        shown = range(first, min(stop, frames))
        return ((t, t / 10.0, np.full((400, 640), t, dtype=np.uint8)) for t in shown)

    return SimpleNamespace(path=Path("film.mkv"), frames=pictures)


def rows(picture: NDArray[np.uint8], colour: tuple[int, int, int], *, near: int = 40) -> NDArray[np.intp]:
    """Pixels (n,2) as (x, y) of about that colour."""
    return np.argwhere((np.abs(picture.astype(int) - colour) < near).all(axis=2))[:, ::-1]


def test_the_picture() -> None:
    picture = overlay(film(), tracks())
    assert farthest(tracks()) == TURN
    assert (picture[390, 600] == TURN).all()  # the film's own frame
    path = rows(picture, PATH)
    assert path[:, 0].min() <= 101
    assert path[:, 0].max() >= 270  # under the ellipse after that
    assert (path[:, 1] == 100).all()
    ring = rows(picture, SPREAD)
    # 12 px over the usual sd of 0.0032 px, rounded down to 2000: 8 px by 4 px.
    assert np.ptp(ring[:, 0]) == pytest.approx(16, abs=2)
    assert np.ptp(ring[:, 1]) == pytest.approx(8, abs=2)
    assert np.mean(ring, axis=0) == pytest.approx([300, 100], abs=1)
    assert np.median(rows(picture, CENTRE), axis=0) == pytest.approx([300, 100], abs=1)
    lost = rows(picture, GONE)
    assert np.abs(lost - [100, 200]).sum(axis=1).min() <= 1  # where it was last seen
    assert lost[:, 1].min() > 150
    assert lost[:, 1].max() < 250
    assert (picture[260:340, :300] == TURN).all()  # what was never seen is nowhere


def test_a_film_that_has_changed() -> None:
    with pytest.raises(ValueError, match=saying(r"film\.mkv", "12")):
        overlay(film(5), tracks())
