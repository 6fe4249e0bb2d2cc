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
from vision.film.scheduling import as_before
from vision.film.series import open_film, read_picture

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
        with as_before():
            stream.codec_context.open()
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


def pictures(folder: Path, suffix: str, names: Sequence[object]) -> Path:
    folder.mkdir()
    for level, name in enumerate(names):
        assert cv2.imwrite(str(folder / f"frame{name}{suffix}"), picture(level))
    return folder


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif"])
def test_pictures_are_a_film_in_the_order_of_their_numbers(suffix: str, tmp_path: Path) -> None:
    film = open_film(
        pictures(tmp_path / "run1", suffix, [8, 9, 10, 11, 100]), fps=20.0
    )  # by name 10 is before 8, and 88 are missing before 100
    np.testing.assert_allclose(film.time, np.array([0, 1, 2, 3, 92]) / 20.0)
    assert any("missing in 1 places" in sentence for sentence in film.issues)
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


@pytest.mark.parametrize(
    ("names", "fps", "times"),
    [
        (["0.35", "0.4", "0.4501", "0.5", "0.55"], 20.0, [0, 0.05, 0.1001, 0.15, 0.2]),  # s
        (["1732650014.0031", "1732650014.1000012", "1732650014.2035", "1732650014.3"], 10.0, [0, 0.0969012, 0.2004, 0.2969]),
        (["173265001", "173265052", "173265099", "173265151"], 20.0, [0, 0.051, 0.098, 0.15]),  # ms
        (["1000017", "1051000", "1098000"], 20.0, [0, 0.050983, 0.097983]),  # us
        (["1000000017", "1051000000", "1098000000"], 20.0, [0, 0.050999983, 0.097999983]),  # ns
        (["0.8", "1.9", "3.10"], 0.9, [0, 1.1, 2.3]),  # s, with digits that seem to count
        (["000", "020", "040", "080"], 20.0, [0, 1, 2, 4]),  # every 20th, one missing
        (["000", "002", "005", "007"], 20.0, [0, 0.1, 0.25, 0.35]),  # some missing
        (["1.0001", "1.0002", "1.0003"], 20.0, [0, 0.05, 0.1]),  # counted behind a point
        (["0001-3", "0002-17", "0003-20", "0005-20"], 20.0, [0, 0.05, 0.1, 0.2]),  # the one that differs in all
        (["101502_0008", "101502_0009", "101503_0010"], 20.0, [0, 0.05, 0.1]),  # the clock's second beside it
    ],
)  # fmt: skip
def test_numbers_in_names_are_order_and_times(
    names: list[str], fps: float, times: list[float], tmp_path: Path
) -> None:
    film = open_film(pictures(tmp_path / "run", ".png", names), fps=fps)
    np.testing.assert_allclose(film.time, times, atol=1e-9)
    assert any("Several numbers change in the names" in issue for issue in film.issues) == ("_" in names[0] or "-" in names[0])
    where = [block(grey) for *_, grey in film.frames()]
    np.testing.assert_allclose(where, 15.5 + 4.0 * np.arange(len(names)), atol=0.3)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (["1", "2", "02"], "have the same number"),
        (["1.9", "1.10", "1.90"], "have the same number"),
        (["1.8", "1.9", "1.10"], "may have decimal numbers, or count behind the point"),
        (["1", "2", "-3"], "names of two forms"),
        (["0_0001", "0_0002", "1_0001", "1_0002"], r"several numbers change in the names, as from frame0_0001\.png to frame0_0002"),
        (["0001_0.05", "0002_0.10"], "it is unknown which counts the pictures"),
        (["000", "050", "100"], "go up by 50, which may be time stamps in ms or count pictures at fps = 20"),
        (["1000", "1130", "1255"], "neither count pictures nor are time stamps at fps = 20"),
        (["1.13", "2.2", "3.4"], "neither count pictures nor are time stamps at fps = 20"),
    ],
)
def test_numbers_that_say_no_order_or_no_time_are_refused(
    names: list[str], sentence: str, tmp_path: Path
) -> None:
    folder = pictures(tmp_path / "run", ".png", names)
    with pytest.raises(ValueError, match=sentence):
        open_film(folder, fps=20.0)
    rows = "".join(f"frame{name}.png,{0.1 * k}\n" for k, name in enumerate(names))
    (folder / "times.csv").write_text("file,time_s\n" + rows)
    where = [block(grey) for *_, grey in open_film(folder).frames()]
    np.testing.assert_allclose(where, 15.5 + 4.0 * np.arange(len(names)), atol=0.3)


def test_what_systems_leave_beside_pictures_is_passed_over(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "run", ".png", [1, 2])
    for name in (".DS_Store", "Thumbs.db", "._frame1.png"):
        (folder / name).write_bytes(b"x")
    assert len(open_film(folder, fps=10.0).time) == 2
    (folder / "frame1.png").rename(folder / "frame3.jpg")
    with pytest.raises(ValueError, match="names of two forms"):
        open_film(folder, fps=10.0)


@pytest.mark.parametrize(("bits", "left"), [(8, 0), (10, 0), (12, 0), (14, 0), (16, 0), (12, 4)])
def test_pictures_of_more_bits_keep_their_grey_levels(bits: int, left: int, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for level in range(3):  # the first one is dark: all have one scale
        grey = (picture(level).astype(np.uint16) << (bits - 8)) // (4 if level == 0 else 1)
        assert cv2.imwrite(str(folder / f"f{level}.png"), grey << left)
    film = open_film(folder, fps=10.0)
    shown = [grey for *_, grey in film.frames()]
    np.testing.assert_array_equal(shown[2], picture(2))
    assert shown[0].max() == 50
    assert any(f"{bits} bits" in sentence for sentence in film.issues) == (8 < bits + left < 16)
    assert read_picture(folder / "f2.png", 8).max() == (200 if bits == 8 else 255)  # brighter than any looked at


def test_stacks_and_other_numbers_are_no_pictures_of_a_film(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "run", ".png", [])
    assert cv2.imwritemulti(str(folder / "film.tif"), [picture(0), picture(1)])
    with pytest.raises(ValueError, match=r"film.tif is a stack of 2 pictures"):
        open_film(folder, fps=10.0)
    with pytest.raises(ValueError, match="is a TIFF: wanted a video file"):
        open_film(folder / "film.tif", fps=10.0)
    assert cv2.imwrite(str(folder / "film.tif"), picture(0).astype(np.float32))
    with pytest.raises(ValueError, match="holds float32"):
        open_film(folder, fps=10.0)


@pytest.mark.parametrize("cover", [True, False])
def test_the_largest_film_is_read_of_several_videos(cover: bool, tmp_path: Path) -> None:
    path = tmp_path / "film.mov"
    with av.open(str(path), "w") as container:
        first: Any = container.add_stream("mjpeg", rate=25)
        first.width, first.height, first.pix_fmt = (400, 400, "yuvj420p") if cover else (48, 32, "yuvj420p")
        main: Any = container.add_stream("libx264", rate=25)
        main.width, main.height, main.pix_fmt = 96, 64, "yuv420p"
        for level in range(8):
            grey = picture(level)
            if level == 0 or not cover:
                small = cv2.resize(grey, (first.width, first.height))
                container.mux(first.encode(av.VideoFrame.from_ndarray(small, format="gray")))
            container.mux(main.encode(av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuv420p")))
        for stream in (first, main):
            container.mux(stream.encode(None))
    film = Video(path)
    where = [block(grey) for *_, grey in film.frames()]
    np.testing.assert_allclose(where, 15.5 + 4.0 * np.arange(8), atol=0.6)
    assert len(film.coding().size) == 8
    told = [sentence for sentence in film.issues if "videos" in sentence]
    assert told == ([] if cover else ["film.mov holds 2 videos: the largest is read, of 96 x 64 px."])


def test_a_raw_stream_has_no_times(tmp_path: Path) -> None:
    path = write(tmp_path / "film.h264", "libx264", bf="0")
    with pytest.raises(ValueError, match=r"holds no time stamps.*ffmpeg -framerate 30 -i film.h264 -c copy film.mp4"):
        Video(path)


def test_a_film_that_begins_within_a_group_of_pictures_begins_with_its_first_picture(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.mkv", "libx264", range(0, 480, 40), bf="0", g="6")
    path = tmp_path / "cut.ts"
    with av.open(str(whole)) as source, av.open(str(path), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in list(source.demux(video=0))[3:]:
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    film = Video(path)
    shown = list(film.frames())
    assert [index for index, *_ in shown] == list(range(len(film.time)))
    np.testing.assert_allclose([block(grey) for *_, grey in shown], 15.5 + 4.0 * np.arange(6, 12), atol=0.6)
    np.testing.assert_allclose(film.time - film.time[0], 0.04 * np.arange(6), atol=1e-4)
    assert any("first 3 frames" in s and "0.120 s later" in s for s in film.issues)
    assert film.coding().key.tolist() == [True, *5 * [False]]
