"""Films of every codec and of pictures: written, read back, and their traps."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.messages import saying
from vision import Video
from vision.film.series import open_film

Image = NDArray[np.uint8]
STAMPS = [0, 40, 80, 130, 160, 200, 260, 280, 320, 360, 400, 440]  # ms, not even


def picture(level: int) -> Image:
    """A 96 x 64 picture with a bright block that moves by 4 px a level, brighter at the top left."""
    grey = np.full((64, 96), 60, dtype=np.uint8)
    grey[:16, :16] = 200
    grey[30:46, 8 + 4 * level : 24 + 4 * level] = 160
    return grey


def write(
    path: Path,
    codec: str,
    stamps_ms: Sequence[int] = STAMPS,
    *,
    pixels: str = "yuv420p",
    turn: float = 0,
    **options: str,
) -> Path:
    """A film of `picture`s with the given time stamps."""
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = 96, 64, pixels
        stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
        if turn:
            stream.set_display_rotation(turn)
        for level, stamp in enumerate(stamps_ms):
            frame = av.VideoFrame.from_ndarray(picture(level), format="gray").reformat(format=pixels)
            frame.pts, frame.time_base = stamp, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def block(grey: Image) -> float:
    """Where the moving block is, px."""
    row = grey[34:42].astype(float).mean(axis=0) - 60.0
    row[row < 30] = 0.0
    return float((row * np.arange(len(row))).sum() / row.sum())


CODECS = [
    ("libx264", "mp4", "yuv420p", {"bf": "3"}),
    ("libx264", "mkv", "yuv422p", {"bf": "0"}),
    ("libx265", "mp4", "yuv420p", {"x265-params": "log-level=none"}),
    ("libvpx-vp9", "webm", "yuv420p", {}),
    ("libsvtav1", "mkv", "yuv420p", {}),
    ("libsvtav1", "mp4", "yuv420p10le", {}),
    ("ffv1", "mkv", "gray", {}),
    ("ffv1", "mkv", "gray10le", {}),
    ("mjpeg", "mkv", "yuvj420p", {"q:v": "3"}),
    ("prores_ks", "mov", "yuv422p10le", {}),
    ("mpeg4", "mp4", "yuv420p", {"bf": "2"}),
]


@pytest.mark.parametrize(("codec", "container", "pixels", "options"), CODECS)
def test_each_codec_is_read_with_its_time_stamps(
    codec: str, container: str, pixels: str, options: dict[str, str], tmp_path: Path
) -> None:
    film = Video(write(tmp_path / f"clip.{container}", codec, pixels=pixels, **options))
    np.testing.assert_allclose(film.time - film.time[0], np.array(STAMPS) / 1000.0, atol=1e-9)
    shown = list(film.frames())
    assert [index for index, *_ in shown] == list(range(len(STAMPS)))
    np.testing.assert_allclose([time for _, time, _ in shown], film.time, atol=0)
    # Every frame has its own stamp: the block is where the frame of that stamp has it.
    where = [block(grey) for *_, grey in shown]
    np.testing.assert_allclose(where, 15.5 + 4.0 * np.arange(len(STAMPS)), atol=0.6)
    assert all(grey.shape == (64, 96) and grey.dtype == np.uint8 for *_, grey in shown)
    if codec == "ffv1" and pixels == "gray":
        np.testing.assert_array_equal(shown[5][2], picture(5))
    assert 180 < shown[0][2][4:12, 4:12].mean() < 242  # full or limited range, but no wrap of 10 bits


@pytest.mark.parametrize("turn", [90, 180, 270])
def test_a_film_on_its_side_is_turned_as_opencv_turns_it(turn: int, tmp_path: Path) -> None:
    path = write(tmp_path / "phone.mp4", "libx264", turn=turn)
    film = Video(path)
    capture = cv2.VideoCapture(str(path))
    seen, colours = capture.read()
    capture.release()
    assert seen
    *_, grey = next(film.frames())
    assert grey.shape == (film.height, film.width) == colours.shape[:2]
    bright = np.array(
        [corner.mean() for corner in (grey[:8, :8], grey[:8, -8:], grey[-8:, -8:], grey[-8:, :8])]
    )
    other = [
        corner.mean() for corner in (colours[:8, :8], colours[:8, -8:], colours[-8:, -8:], colours[-8:, :8])
    ]
    assert int(np.argmax(bright)) == int(np.argmax(other)) == -turn // 90 % 4
    assert [("upside down" in sentence) for sentence in film.issues] == ([True] if turn == 180 else [])


def test_a_film_that_is_coded_interlaced_is_told(tmp_path: Path) -> None:
    film = Video(write(tmp_path / "fields.mkv", "libx264", **{"x264-params": "tff=1"}))
    assert [("fields.mkv is marked as interlaced" in sentence) for sentence in film.issues] == [True]


def test_a_start_offset_is_kept(tmp_path: Path) -> None:
    film = Video(write(tmp_path / "late.mkv", "ffv1", [s + 1500 for s in STAMPS], pixels="gray"))
    np.testing.assert_allclose(film.time, 1.5 + np.array(STAMPS) / 1000.0, atol=1e-9)
    assert film.issues == ()


def test_a_film_that_was_cut_off_ends_where_it_was_cut(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.mkv", "mjpeg", list(range(0, 4000, 40))[:19], pixels="yuvj420p")
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    film = Video(cut)
    shown = list(film.frames())
    assert 8 < len(shown) < 19
    np.testing.assert_allclose(
        [block(grey) for *_, grey in shown], 15.5 + 4.0 * np.arange(len(shown)), atol=0.6
    )


def test_a_frame_that_cannot_be_decoded_shifts_no_other(tmp_path: Path) -> None:
    path = write(tmp_path / "broken.mkv", "mjpeg", pixels="yuvj420p")
    with av.open(str(path)) as container:
        packets = [bytes(p) for p in container.demux(video=0) if p.size]
    data = bytearray(path.read_bytes())
    at = data.find(packets[4])
    data[at : at + len(packets[4])] = bytes(len(packets[4]))
    path.write_bytes(bytes(data))
    film = Video(path)
    shown = list(film.frames())
    assert len(film.time) == len(STAMPS)
    for index, time, grey in shown:
        assert time == pytest.approx(STAMPS[index] / 1000.0, abs=1e-9)
        assert block(grey) == pytest.approx(15.5 + 4.0 * index, abs=0.6)
    assert 4 not in [index for index, *_ in shown]


def pictures(folder: Path, suffix: str, names: Sequence[int]) -> Path:
    folder.mkdir()
    for level, name in enumerate(names):
        assert cv2.imwrite(str(folder / f"frame{name}{suffix}"), picture(level))
    return folder


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif"])
def test_pictures_are_a_film_in_the_order_of_their_numbers(suffix: str, tmp_path: Path) -> None:
    film = open_film(
        pictures(tmp_path / "run1", suffix, [8, 9, 10, 11, 100]), fps=20.0
    )  # by name 10 is before 8
    np.testing.assert_allclose(film.time, np.arange(5) / 20.0)
    where = [block(grey) for *_, grey in film.frames()]
    np.testing.assert_allclose(where, 15.5 + 4.0 * np.arange(5), atol=0.3)
    assert (film.width, film.height) == (96, 64)
    assert film.coding().codec == ("mjpeg" if suffix == ".jpg" else "png")


def test_pictures_with_a_file_of_times(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "run2", ".png", [1, 2, 3, 4])
    (folder / "times.csv").write_text(
        "file,time_s\nframe2.png,0.1\nframe1.png,0.0\nframe4.png,0.5\nframe3.png,0.2\n"
    )
    film = open_film(folder)
    np.testing.assert_allclose(film.time, [0.0, 0.1, 0.2, 0.5])
    assert any("missing in 1 places" in sentence for sentence in film.issues)
    (folder / "times.csv").write_text("time_s\n0\n1\n2\n3\n")
    np.testing.assert_allclose(open_film(folder).time, [0, 1, 2, 3])


def test_a_pattern_of_names_takes_its_pictures_alone(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "raw", ".png", [1, 2, 3, 4, 5])
    for k in (1, 2):
        (folder / f"frame{k}.png").rename(folder / f"still-{k}.png")
    film = open_film(folder / "frame*.png", fps=10.0)
    where = [block(grey) for *_, grey in film.frames()]
    np.testing.assert_allclose(where, 15.5 + 4.0 * np.arange(2, 5), atol=0.3)
    (folder / "times.csv").write_text(
        "file,time_s\n" + "".join(f"{p.name},{k}\n" for k, p in enumerate(sorted(folder.glob("*.png"))))
    )
    np.testing.assert_allclose(open_film(folder / "still-?.png").time, [3, 4])
    with pytest.raises(ValueError, match=r"pattern .*none-\*\.png holds no picture"):
        open_film(folder / "none-*.png", fps=10.0)


def test_pictures_that_are_no_film(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "run3", ".png", [1, 2])
    with pytest.raises(
        ValueError, match=r"run3 has no times.csv \(columns file, time_s\) and no frame rate is given"
    ):
        open_film(folder)
    (folder / "times.csv").write_text("file,time_s\nframe1.png,0\n")
    with pytest.raises(ValueError, match=r"'frame2.png' is missing or is no time in s"):
        open_film(folder)
    (folder / "times.csv").write_text("time_s\n0\n1\n2\n")
    with pytest.raises(ValueError, match="has 3 times for 2 pictures"):
        open_film(folder)
    (folder / "times.csv").unlink()
    (folder / "frame2.png").write_bytes(b"no picture")
    with pytest.raises(ValueError, match=r"frame2.png cannot be read"):
        list(open_film(folder, fps=10.0).frames())
    assert cv2.imwrite(str(folder / "frame2.png"), np.zeros((10, 20), dtype=np.uint8))
    with pytest.raises(ValueError, match=saying("frame2.png", "20", "10 px", "frame1.png", "96", "64")):
        list(open_film(folder, fps=10.0).frames())
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="holds no picture"):
        open_film(tmp_path / "empty", fps=10.0)
