"""Film in: the container's own time stamps, and what is wrong with them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vision import Video


def test_variable_frame_rate_keeps_its_time_stamps(write_clip: Callable[..., Path]) -> None:
    stamps = [0, 33, 70, 101, 140, 171, 210]
    film = Video(write_clip(stamps))
    np.testing.assert_allclose(film.time, np.array(stamps) / 1000.0, atol=1e-9)
    shown = [(index, time, int(grey[24, 32])) for index, time, grey in film.frames()]
    assert shown == [(i, s / 1000.0, 20 + 5 * i) for i, s in enumerate(stamps)]
    assert film.issues == ()
    assert (film.width, film.height) == (64, 48)


def test_a_gap_is_said(write_clip: Callable[..., Path]) -> None:
    film = Video(write_clip([0, 40, 80, 200, 240, 280]))
    assert len(film.issues) == 1
    assert "missing in 1 places" in film.issues[0]
    assert "0.120 s after 0.080 s" in film.issues[0]


def test_duplicate_time_stamps_are_said(write_clip: Callable[..., Path]) -> None:
    film = Video(write_clip([0, 40, 80, 80, 120, 160]))
    assert any("1 frames repeat the time stamp" in issue and "0.080 s" in issue for issue in film.issues)
    assert len(film.time) == 6


def test_frames_are_not_kept_in_memory(write_clip: Callable[..., Path]) -> None:
    frames = Video(write_clip(list(range(0, 4000, 40)))).frames()
    assert next(frames)[0] == 0  # an iterator: nothing else has been decoded yet
    assert next(frames)[0] == 1


def test_not_a_film(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"absent\.mp4 does not exist"):
        Video(tmp_path / "absent.mp4")
    for name, content in (("text.mp4", b"this is no film" * 50), ("empty.mp4", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ValueError, match=f"{name} cannot be read as a video"):
            Video(tmp_path / name)


def test_a_playlist_is_no_film_so_no_other_file_is_read(write_clip: Callable[..., Path]) -> None:
    other = write_clip([0, 40, 80])
    for name, text in (
        ("list.mp4", f"ffconcat version 1.0\nfile {other.name}\n"),
        ("list.m3u8", f"#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:1,\n{other}\n#EXT-X-ENDLIST\n"),
    ):
        (other.parent / name).write_text(text)
        with pytest.raises(ValueError, match=rf"{name} cannot be read as a video .*: give one file that holds the film"):
            Video(other.parent / name)


def test_real_variable_rate_film_with_muddled_stamps(shared_data: Path) -> None:
    film = Video(shared_data / "ingest_video" / "box.mp4")
    assert len(film.time) == 455  # OpenCV says 456
    assert np.all(np.diff(film.time) >= 0)
    assert any("run backwards" in issue for issue in film.issues)
    assert sum(1 for _ in film.frames()) == 455


def test_real_film_with_b_frames(shared_data: Path) -> None:
    film = Video(shared_data / "ingest_video" / "Megamind.avi")
    step = 125.0 / 2997.0
    np.testing.assert_allclose(film.time, step * np.arange(1, 271), atol=1e-9)
    assert any("88 time stamps run backwards" in issue for issue in film.issues)


def test_real_film_whose_header_counts_wrongly(shared_data: Path) -> None:
    film = Video(shared_data / "ingest_video" / "tree.avi")
    assert len(film.time) == 68  # its header says 444
    assert next(film.frames())[2].shape == (film.height, film.width)
