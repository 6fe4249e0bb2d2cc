"""A film that is followed in two goes is followed as in one, bit for bit; frames that are not there are said."""

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from vision import Video
from vision.film import checkpoint
from vision.film.picturefaults import stale
from vision.following.reference import prepare
from vision.following.tracking import follow
from vision.following.tracks import Followed, Method
from vision.kinds import PlainDot

Lab = Any
BEND = np.concatenate([np.zeros(12), np.linspace(0, 0.012, 16)[1:], np.full(8, 0.012)])


class Killed(Exception):
    pass


@pytest.fixture(scope="module")
def film(lab: Lab, tmp_path_factory: pytest.TempPathFactory) -> Video:
    marks = [replace(m, kind=PlainDot(3.5)) if m.name == "finger11" else m for m in lab.marks]
    return lab.film(tmp_path_factory.mktemp("kept") / "film.mkv", BEND, marks=marks, seed=3)


def followed(film: Video, lab: Lab, keeper: Any, progress: Any = None) -> Followed:
    marks = [replace(m, kind=PlainDot(3.5)) if m.name == "finger11" else m for m in lab.marks]
    follower = prepare(film, lab.camera, marks, dictionary="DICT_4X4_50", reference_s=1.15)
    return follow(film, follower, reference_s=1.15, stage="film", progress=progress, keeper=keeper)


@pytest.mark.parametrize("frames", [11, 24])
def test_a_killed_run_goes_on_bit_for_bit(
    film: Video, lab: Lab, kept: Any, frames: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkpoint, "EVERY", 5)
    whole = followed(film, lab, None)

    def kill(stage: str, done: int, total: int) -> None:
        if done == frames:
            raise Killed

    with pytest.raises(Killed):
        followed(film, lab, kept, kill)
    assert len(kept) == frames // 5
    seen: list[int] = []
    again = followed(film, lab, kept, lambda stage, done, total: seen.append(done))
    assert seen[0] == 5 * (frames // 5) + 1  # nothing that was kept is followed again
    for field in fields(Followed):
        one, two = getattr(whole, field.name), getattr(again, field.name)
        np.testing.assert_array_equal(one, two, err_msg=field.name)
    assert np.isfinite(again.ideal).all()


def test_repeated_pictures_are_left_out_where_marks_move(
    film: Video, lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, every = followed(film, lab, None), Video.frames

    def stuttering(self: Video) -> Iterator[tuple[int, float, Any]]:
        shown = [image for *_, image in every(self)]
        for index, stamp, _ in every(self):
            yield index, stamp, shown[{5: 4, 6: 4, 18: 17, 22: 20, 21: 20}.get(index, index)]

    monkeypatch.setattr(Video, "frames", stuttering)
    found = followed(film, lab, None)
    lost = np.flatnonzero((found.method == Method.LOST).all(axis=1))
    assert lost.tolist() == [18, 21, 22]  # 5 and 6 show a finger at rest, and are right
    assert np.isnan(found.ideal[lost]).all()
    assert np.isnan(found.covariance[lost]).all()
    kept = [t for t in range(19, len(BEND)) if t not in lost]
    np.testing.assert_allclose(found.ideal[kept], whole.ideal[kept], atol=0.02)  # px, another reference
    assert any(
        "3 of 35 frames of film.mkv repeat the picture before them while markers move" in sentence
        and "first at 1.800 s, last at 2.200 s" in sentence
        for sentence in found.noted
    )
    assert not any("repeat" in sentence for sentence in (*whole.said, *whole.noted))


def test_a_picture_repeated_round_a_frame_that_is_not_there_is_stale() -> None:
    ideal = np.arange(8.0)[:, None, None] * np.ones((8, 2, 2))  # px: all marks move
    ideal[[0, 3]] = np.nan  # no mark is seen in the first, the fourth cannot be decoded
    same = np.array([False, True, False, False, True, False, False, False])
    ideal[4] = ideal[2]
    assert np.flatnonzero(stale(same, ideal)).tolist() == [4]


def test_frames_that_are_not_there_are_lost_and_said(
    film: Video, lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = followed(film, lab, None)
    gone = [16, 20, 21, len(BEND) - 1]  # 10 % of the frames
    every = Video.frames

    def some(self: Video) -> Iterator[tuple[int, float, Any]]:
        return (shown for shown in every(self) if shown[0] not in gone)

    monkeypatch.setattr(Video, "frames", some)
    holed = followed(film, lab, None)
    assert (holed.method[[16, 20, 21]] == Method.LOST).all()
    assert np.isnan(holed.ideal[[16, 20, 21]]).all()
    there = [t for t in range(len(BEND) - 1) if t not in gone]
    np.testing.assert_allclose(
        holed.ideal[there], whole.ideal[there], atol=0.004
    )  # px: other starts, same ends
    assert any(
        "4 of 35 frames of film.mkv cannot be decoded, first at 1.600 s, last at 3.400 s" in sentence
        for sentence in holed.said
    )
