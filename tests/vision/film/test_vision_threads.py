"""The same film gives the same numbers, bit for bit, however many CPUs there are."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vision import Video, View, measure
from vision.film import video
from vision.film.video import Writer

Lab = Any
BEND = np.concatenate([np.zeros(12), np.linspace(0, 0.012, 9)[1:]])
MEASURE = """
import hashlib, json, os, sys
os.sched_setaffinity(0, set(json.loads(sys.argv[1])))
from vision import Camera, Mark, Video, View, measure
from vision.kinds import CodedMarker
told = json.loads(sys.argv[2])
marks = [Mark(name, CodedMarker(*kind), *rest) for name, kind, *rest in told["marks"]]
view = View(Video(told["film"]), Video(told["still"]), Camera.from_dict(told["camera"]))
found = measure([view], marks, reference=1.15)
arrays = (found.value, found.covariance, found.modes, found.noise.sd, found.noise.codec_sd)
assert (found.noise.codec_sd[:, 0] > 0).any()
print(hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest())
"""

CPUS = sorted(os.sched_getaffinity(0))
two_cpus = pytest.mark.skipif(len(CPUS) < 2, reason="this process may use one CPU only")


@contextmanager
def one_cpu() -> Iterator[None]:
    """This thread on one CPU, which is then all that FFmpeg and x264 count."""
    os.sched_setaffinity(0, CPUS[:1])
    try:
        yield
    finally:
        os.sched_setaffinity(0, CPUS)


def textured() -> NDArray[np.uint8]:
    """Smooth noise, 640 x 400 px: enough for x264 to cut it into slices."""
    noise = np.random.default_rng(0).integers(0, 256, (50, 80), dtype=np.uint8)
    return np.kron(noise, np.ones((8, 8), dtype=np.uint8))


def coded(path: Path, threads: int | None = None) -> Path:
    """A film of moving texture that Writer codes, with its own number of threads or another."""
    with Writer(path, (640, 400), fps=10.0, codec="libx264", crf=18) as writer:
        if threads is not None:
            writer.stream.codec_context.thread_count = threads
        for k in range(8):
            writer.add(np.roll(textured(), 3 * k, axis=1))
    return path


def shown(path: Path) -> str:
    """What the film shows, as one number."""
    return hashlib.sha256(b"".join(grey.tobytes() for *_, grey in Video(path).frames())).hexdigest()


def test_the_number_of_threads_would_change_what_is_coded(tmp_path: Path) -> None:
    by_threads = [shown(coded(tmp_path / f"{n}.mkv", n)) for n in (1, 2, 16)]
    assert len(set(by_threads)) == 3
    assert shown(coded(tmp_path / "own.mkv")) == by_threads[1]


@two_cpus
def test_a_film_is_coded_alike_on_one_cpu_and_on_two(tmp_path: Path) -> None:
    with one_cpu():
        alone = shown(coded(tmp_path / "one.mkv"))
        automatic = shown(coded(tmp_path / "one-automatic.mkv", 0))
    assert shown(coded(tmp_path / "two.mkv")) == alone
    # The test can fail: x264's own choice differs between the two.
    assert shown(coded(tmp_path / "two-automatic.mkv", 0)) != automatic


@two_cpus
def test_a_damaged_film_is_read_alike_on_one_cpu_and_on_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    damaged = bytearray(coded(tmp_path / "film.mkv").read_bytes())
    rng = np.random.default_rng(1)
    for place in rng.integers(len(damaged) // 4, len(damaged), 20):
        damaged[place] ^= int(rng.integers(1, 256))
    (tmp_path / "damaged.mkv").write_bytes(damaged)
    with one_cpu():
        alone = shown(tmp_path / "damaged.mkv")
    assert shown(tmp_path / "damaged.mkv") == alone
    monkeypatch.setattr(video, "DECODING_THREADS", 0)  # FFmpeg's own choice conceals it otherwise
    assert shown(tmp_path / "damaged.mkv") != alone


@two_cpus
@pytest.mark.slow
def test_a_measurement_is_the_same_on_one_cpu_and_on_two(
    lab: Lab, coded_still: Video, tmp_path: Path
) -> None:
    film = lab.film(tmp_path / "film.mkv", BEND, codec="libx264", seed=3)
    told = {
        "film": str(film.path),
        "still": str(coded_still.path),
        "camera": lab.camera.to_dict(),
        "marks": [astuple(mark) for mark in lab.marks],
    }
    alone = subprocess.run(
        [sys.executable, "-c", MEASURE, json.dumps(CPUS[:1]), json.dumps(told)],
        check=True,
        capture_output=True,
        text=True,
        timeout=300,
    ).stdout.strip()
    found = measure([View(film, coded_still, lab.camera)], lab.marks, reference=1.15)
    arrays = (found.value, found.covariance, found.modes, found.noise.sd, found.noise.codec_sd)
    assert hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest() == alone
