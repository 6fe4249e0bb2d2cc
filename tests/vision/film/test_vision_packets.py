"""How a film was coded, from its packets; a part of a film without what stands before it; decoding ahead."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.frame import VideoFrame

from vision import Video
from vision.film.decoding import ahead
from vision.film.packets import Coding, is_simple, longest_between
from vision.film.video import Writer

ROOT = Path(__file__).parents[3]
FRAMES, SIZE = 70, (128, 96)


def pictures() -> Iterator[np.ndarray]:
    """A bright block that wanders over noise."""
    rng = np.random.default_rng(3)
    for k in range(FRAMES):
        grey = np.full(SIZE[::-1], 90.0)
        grey[30:60, 10 + k : 40 + k] = 190.0
        yield np.clip(np.rint(grey + 1.5 * rng.standard_normal(grey.shape)), 0, 255).astype(np.uint8)


def written(path: Path, codec: str, *, shown: int = FRAMES, **options: str) -> Video:
    with Writer(path, SIZE, fps=30.0, codec=codec, options=options, shown=shown) as writer:
        for grey in pictures():
            writer.add(grey)
    return Video(path)


@pytest.mark.parametrize("container", ["mkv", "mp4"])
@pytest.mark.parametrize(("between", "every"), [(0, 30), (2, 35), (3, 250)])
def test_b_frames_key_frames_and_bytes_are_those_of_the_coder(
    between: int, every: int, container: str, tmp_path: Path
) -> None:
    plain = "b-adapt=0:scenecut=0:b-pyramid=none"
    film = written(
        tmp_path / f"film.{container}", "libx264", bf=str(between), g=str(every), **{"x264-params": plain}
    )
    coding = film.coding()
    assert (coding.codec, coding.between) == ("h264", between)
    assert np.flatnonzero(coding.key).tolist() == list(range(0, FRAMES, every))
    assert coding.every == every
    assert coding.fps == pytest.approx(30.0, rel=0.03)  # mkv holds whole milliseconds
    assert 0.5 < coding.size.sum() / (tmp_path / f"film.{container}").stat().st_size < 1.0
    assert coding.size[0] > 3 * np.median(coding.size)
    assert coding.live == (every in (30, 35))
    assert ("no B-frames" in coding.described()) == (between == 0)


@pytest.mark.parametrize(("codec", "between"), [("libx264", 0), ("libx264", 3), ("libx265", 3)])
def test_frames_that_are_not_shown_are_looked_at_and_not_coded(codec: str, between: int, tmp_path: Path) -> None:
    more = {"bf": str(between)} if codec == "libx264" else {"x265-params": f"bframes={between}:log-level=error"}
    whole, part = (written(tmp_path / f"{n}.mp4", codec, shown=n, **more) for n in (FRAMES, 40))
    assert 40 <= len(part.time) <= 40 + between
    np.testing.assert_array_equal(part.coding().size[:40], whole.coding().size[:40])
    for (_, _, a), (_, _, b) in zip(part.frames(0, 40), whole.frames(0, 40), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_encoder_that_codes_again_has_the_same_frames(tmp_path: Path) -> None:
    for codec, name in (("libx264", "h264"), ("libx265", "hevc")):
        like = Coding(name, np.ones(60, np.intp), np.arange(60) % 20 == 0, 2, 30.0)
        encoder, options = like.options(25.0)
        assert encoder == codec
        again = written(tmp_path / f"{name}.mkv", encoder, **options).coding()
        assert again.codec == name
        assert again.between == 2
        assert again.every == 20


def test_what_codes_in_haste_is_coded_again_in_haste(tmp_path: Path) -> None:
    """Webcams code in H.264's Baseline profile, old cameras as MPEG-4: at the same bytes they err more in what moves."""
    hasty = written(tmp_path / "hasty.mkv", "libx264", preset="ultrafast", g="15").coding()
    assert hasty.simple
    encoder, options = hasty.options(23.0)
    assert options["preset"] == "ultrafast"
    assert written(tmp_path / "again.mkv", encoder, **options).coding().simple
    usual = written(tmp_path / "usual.mkv", "libx264", bf="0", g="15").coding()
    assert not usual.simple
    assert usual.options(23.0)[1]["preset"] == "fast"
    assert written(tmp_path / "old.mkv", "mpeg4").coding().simple
    assert not is_simple("mjpeg", "Baseline")  # of JPEG


WRITES = """
import sys
import numpy as np
from pathlib import Path
from vision.film.packets import Coding
from vision.film.video import Writer
none = np.zeros(0, int)
encoder, options = Coding(sys.argv[2], none, none, 0, 25.0, grain=True).options(20.0)
noise = np.random.default_rng(5).normal(90.0, 12.0, (480, 760))
with Writer(Path(sys.argv[1]), (704, 480), fps=25.0, codec=encoder, options=options) as writer:
    for k in range(12):
        writer.add(noise[:, 3 * k : 3 * k + 704].clip(0, 255).astype(np.uint8))
"""


@pytest.mark.slow
@pytest.mark.parametrize("codec", ["h264", "hevc"])
def test_pictures_are_coded_alike_whatever_was_in_memory_before(codec: str, tmp_path: Path) -> None:
    found = set()
    for filled in ("1", "2"):  # glibc fills new memory with such bytes; another libc ignores it
        path = tmp_path / f"{filled}.mkv"
        environment = {**os.environ, "MALLOC_PERTURB_": filled}
        subprocess.run([sys.executable, "-c", WRITES, str(path), codec], check=True, env=environment, cwd=ROOT)
        with av.open(str(path)) as film:
            found.add(b"".join(bytes(packet) for packet in film.demux(video=0)))
    assert len(found) == 1


def test_order_of_packets_tells_b_frames() -> None:
    assert longest_between([0, 1, 2, 3]) == 0
    assert longest_between([0, 4, 2, 1, 3, 8, 6, 5, 7]) == 3
    assert longest_between([0, 2, 1, 4, 3]) == 1


@pytest.mark.parametrize(
    ("codec", "container"),
    [("libx264", "mkv"), ("libx264", "mp4"), ("libx265", "mkv"), ("libx265", "mp4"), ("ffv1", "mkv")],
)
def test_a_part_of_a_film_is_the_same_pictures(codec: str, container: str, tmp_path: Path) -> None:
    options = {"libx264": {"g": "20", "bf": "3"}, "libx265": {"x265-params": "keyint=20:log-level=none"}}
    film = written(tmp_path / f"film.{container}", codec, **options.get(codec, {}))
    whole = {index: grey for index, _, grey in film.frames()}
    assert list(whole) == list(range(FRAMES))
    for first, stop in ((0, 5), (19, 22), (43, 60), (66, 999)):
        part = {index: grey for index, _, grey in film.frames(first, stop)}
        assert list(part) == list(range(first, min(stop, FRAMES)))
        assert all(np.array_equal(grey, whole[index]) for index, grey in part.items())
    wanted = [0, 1, 19, 20, 45, FRAMES - 1]
    some = {index: grey for index, _, grey in film.chosen(wanted)}
    assert list(some) == wanted
    assert all(np.array_equal(grey, whole[index]) for index, grey in some.items())


def test_chosen_frames_pass_over_key_frames_that_none_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    film, decoded = written(tmp_path / "film.mkv", "libx264", g="10", bf="0"), []
    honest = Video._decoded

    def counted(self: Video, after: float | None = None) -> Iterator[VideoFrame]:
        for frame in honest(self, after):
            decoded.append(frame)
            yield frame

    monkeypatch.setattr(Video, "_decoded", counted)
    assert [index for index, *_ in film.chosen([2, FRAMES - 1])] == [2, FRAMES - 1]
    assert len(decoded) < 40  # of FRAMES: MOST_B and a group of ten before each
    film._in_order = True  # no stamps to look for: one pass, not one for each group
    decoded.clear()
    assert [index for index, *_ in film.chosen([2, FRAMES - 1])] == [2, FRAMES - 1]
    assert len(decoded) == FRAMES


def test_decoding_ahead_keeps_order_errors_and_ends() -> None:
    assert list(ahead(iter(range(50)))) == list(range(50))
    assert list(ahead(iter([]))) == []

    def broken() -> Iterator[int]:
        yield from range(6)
        raise ValueError("the film ends")

    items = ahead(broken())
    assert [next(items) for _ in range(6)] == list(range(6))
    with pytest.raises(ValueError, match="the film ends"):
        next(items)
    for k in ahead(iter(range(10**9))):
        if k == 3:
            break  # the thread ends with it: else this test would not
