"""A long film of 1080p through `twin measure`: speed, peak memory, a kill in the middle and the resumed run.

    python benchmarks/tracking/long_film.py [--minutes 1 10] [--whole] [--keep FOLDER]

Drawn for it: 28 markers of 40 px, 18 of them on a finger that bends up and down all the time after a rest of
2 s, noise 2 grey levels, H.264, 30 frames per second with time stamps that jitter. Twenty seconds are drawn
and coded, after that their packets are repeated. `twin measure` is killed as a process when half of the
frames are followed, and started again; frames per second of CPU time are of both processes together, decoding
and all that follows included. `--whole` runs it uninterrupted as well and compares the two targets bit by
bit. `--keep` puts what is drawn there and takes it from there.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.tracking import studio

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from twin import files
from twin.gauge.pressuretable import PressureTable
from twin.marktables import FrameTable, MarkerTable, PointTable
from twin.project.cameratables import CameraTable, MeasureTable
from twin.project.config import CalibrateTable, Config, ProjectTable
from twin.project.toml import dump
from vision import Camera, Mark
from vision.drawing import synthetic
from vision.film.checkpoint import EVERY

Array = NDArray[np.float64]
RATE, JITTER_S = 30, 0.002  # 1/s, s
REST_S, PERIOD_S, LOOP_S = 2.0, 3.0, 18.0  # s
TOP_MPA = 0.03  # that bends it most
TICKS = 90000  # of the clock, 1/s
STATIC = 300  # frames
NOISE = 2.0  # grey levels
BANK = 12  # fields of noise, each laid anew at random
FOCAL, AWAY = 1600.0, 400.0  # px, mm
SIZE_MM = 10.0  # 40 px
FRAME = [(-110.0, 110.0), (0.0, 112.0), (110.0, 110.0), (-110.0, -110.0), (0.0, -112.0), (110.0, -110.0)]
FIXED = [(-60.0, 100.0), (60.0, 100.0), (-112.0, 0.0), (-112.0, 50.0)]


def camera() -> Camera:
    """1080p."""
    matrix = np.array([[FOCAL, 0, 960], [0, FOCAL, 540], [0, 0, 1.0]])
    return Camera(matrix, np.array([-0.1, 0, 0, 0, 0]), (1920, 1080))


def marks() -> list[Mark]:
    """6 frame markers, 4 fixed ones, 18 on the finger in two rows."""
    finger = [(x, z) for z in (40.0, 60.0) for x in np.linspace(-80.0, 96.0, 9)]
    return [*studio.tags(FRAME, FIXED, finger, size=SIZE_MM, y=0.0)]


def bent(curvature: Array) -> tuple[Array, Array]:
    """Places (t,p,3) mm and turns (t,p) rad of the marks for curvatures (t,) 1/mm of the finger."""
    every, k = marks(), np.maximum(curvature, 1e-9)
    place = np.tile([m.position for m in every], (len(k), 1, 1)).astype(float)
    turn = np.zeros(place.shape[:2])
    for p, mark in enumerate(every):
        if mark.role == "finger":
            x, z = mark.position[0] + 90.0, mark.position[2]
            turn[:, p] = -k * x
            place[:, p, 0] = np.sin(k * x) / k - 90.0 - (40.0 - z) * np.sin(k * x)
            place[:, p, 2] = 40.0 - (1.0 - np.cos(k * x)) / k - (40.0 - z) * np.cos(k * x)
    return place, turn


def pictures(folder: Path) -> list[NDArray[np.uint8]]:
    """One bend up and down, noise-free, the first at rest."""
    from vision import Video

    phase = np.arange(int(PERIOD_S * RATE) // 2 + 1) / (PERIOD_S * RATE)
    place, turn = bent(0.003 * np.sin(np.pi * phase) ** 2)
    pose = (cv2.Rodrigues(studio.FACING)[0].ravel(), np.array([0.0, 0.0, AWAY]))
    path = folder / "bend.mkv"
    synthetic.film(path, camera=camera(), pose=pose, marks=marks(), positions=place, rotations=turn,
                   noise_grey=0.0, codec="ffv1")  # fmt: skip
    return [image.copy() for _, _, image in Video(path).frames()]


def exposed(drawn: list[NDArray[np.uint8]], frames: int, *, moving: bool) -> Iterator[NDArray[np.uint8]]:
    """The pictures of a film, each with its own noise."""
    rng = np.random.default_rng(frames)
    height, width = drawn[0].shape
    size = (BANK, height + 64, width + 64)
    bank = np.rint(NOISE * rng.standard_normal(size, dtype=np.float32)).astype(np.int16)
    cycle = [*range(len(drawn)), *range(len(drawn) - 2, 0, -1)]
    for t in range(frames):
        after = t - int(REST_S * RATE)
        picture = drawn[cycle[after % len(cycle)] if moving and after > 0 else 0]
        y, x = rng.integers(0, 64, 2)
        noise = bank[rng.integers(BANK)][y : y + height, x : x + width]
        yield np.clip(picture + noise, 0, 255).astype(np.uint8)


def write(path: Path, shown: Iterator[NDArray[np.uint8]]) -> None:
    """H.264, a key frame every second and stamps that jitter."""
    rng = np.random.default_rng(1)
    options = {"preset": "veryfast", "tune": "grain", "crf": "26", "g": str(RATE), "sc_threshold": "0"}
    options["bf"] = "0"  # with B-frames every opening of the film decodes it once for its stamps
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=RATE, options=options)
        stream.width, stream.height, stream.pix_fmt = 1920, 1080, "yuv420p"
        stream.codec_context.time_base = stream.time_base = Fraction(1, TICKS)
        for t, grey in enumerate(shown):
            chroma = np.full((540, 1920), 128, dtype=np.uint8)
            frame = av.VideoFrame.from_ndarray(np.concatenate([grey, chroma]), format="yuv420p")
            frame.pts = round((t / RATE + rng.uniform(0, 2 * JITTER_S) * (t % RATE > 0)) * TICKS)
            frame.time_base = Fraction(1, TICKS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def lengthen(path: Path, segment: Path, frames: int) -> None:
    """The segment with all that follows its rest repeated, packet by packet, to so many frames."""
    with av.open(str(segment)) as source, av.open(str(path), "w") as container:
        stream = source.streams.video[0]
        target = container.add_stream_from_template(stream)
        packets = [p for p in source.demux(stream) if p.size]
        times = [(p.pts, p.dts) for p in packets]
        rest, later = int(REST_S * RATE), round(LOOP_S / float(stream.time_base or 1))
        for n in range(frames):
            turns, k = divmod(n - rest, len(packets) - rest) if n >= rest else (0, n - rest)
            packet, (pts, dts) = packets[rest + k], times[rest + k]
            packet.stream = target
            packet.pts, packet.dts = (pts or 0) + turns * later, (dts or 0) + turns * later
            packet.time_base = stream.time_base
            container.mux(packet)


def project(root: Path, minutes: float, films: Path) -> None:
    """A project of films that are drawn unless they lie in the folder `films`."""
    raw = root / "raw"
    raw.mkdir(parents=True)
    frames = round(minutes * 60 * RATE)
    segment = round((REST_S + LOOP_S) * RATE)
    for name, count, moving in (("segment.mp4", segment, True), ("static.mp4", STATIC, False)):
        if not (films / name).is_file():
            write(films / f"part-{name}", exposed(pictures(films), count, moving=moving))
            os.replace(films / f"part-{name}", films / name)
    os.link(films / "static.mp4", raw / "static.mp4")
    lengthen(raw / "film.mp4", films / "segment.mp4", frames)
    storage = cv2.FileStorage(str(raw / "lens.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", camera().matrix)
    storage.write("distortion_coefficients", camera().distortion)
    storage.release()
    stamps = np.arange(-1.0, frames / RATE + 1.0, 0.02)
    bends = np.where(stamps > REST_S, np.sin(np.pi * (stamps - REST_S) / PERIOD_S) ** 2, 0.0)
    shown = TOP_MPA * bends + 1e-5 * (np.arange(len(stamps)) % 3)
    log = "".join(f"{t:.2f},{p:.6f}\n" for t, p in zip(stamps, shown, strict=True))
    files.write_text(raw / "pressure.csv", "time_s,pressure_MPa\n" + log)
    files.write_text(root / "twin.toml", dump(config()))


def config() -> Config:
    """Every marker at its place, nothing stated of the finger: this project is measured only."""
    still, own = ([m for m in marks() if (m.role == "finger") is on] for on in (False, True))
    return Config(
        project=ProjectTable(name="long film"),
        cameras=(
            CameraTable(
                name="side", film="raw/film.mp4", static="raw/static.mp4", camera_file="raw/lens.yml"
            ),
        ),
        pressure=PressureTable(),
        measure=MeasureTable(),
        calibrate=CalibrateTable(objective_points=("finger18",)),
        frame=FrameTable(
            markers=tuple(
                MarkerTable(
                    marker=m.kind.code, name=m.name, role=m.role, position_mm=m.position, size_mm=SIZE_MM
                )
                for m in still
            )
        ),
        points=tuple(
            PointTable(name=m.name, node=1 + i, marker=m.kind.code, size_mm=SIZE_MM, position_mm=m.position)
            for i, m in enumerate(own)
        ),
    )


@dataclass(frozen=True)
class Ran:
    """One process of `twin`."""

    wall: float  # s
    cpu: float  # s
    peak: float  # MB
    progress: list[str]  # lines that it printed on the way
    code: int


def twin(root: Path, stage: str, *, until: Path | None = None) -> Ran:
    """Run a stage; kill it as soon as the file `until` is there."""
    command = [sys.executable, "-c", "import sys; from twin.cli import main; sys.exit(main())", stage]
    began, said = time.perf_counter(), root / f"{stage}.txt"
    with open(said, "w") as out:
        process = subprocess.Popen(command, cwd=root, stdout=out, stderr=out)
        ended, status, used = os.wait4(process.pid, os.WNOHANG)
        while not ended:
            time.sleep(0.05)
            if until is not None and until.exists():
                os.kill(process.pid, signal.SIGKILL)
            ended, status, used = os.wait4(process.pid, os.WNOHANG)
        process.returncode = status
    lines = said.read_text().splitlines()
    wall = time.perf_counter() - began
    return Ran(wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, lines, status)


def row(minutes: float, folder: Path, films: Path, *, whole: bool) -> dict[str, Any]:
    """Measure one film: killed half-way, resumed, and with `whole` uninterrupted."""
    root = folder / f"{minutes:g}"
    project(root, minutes, films)
    frames = round(minutes * 60 * RATE)
    if (made := twin(root, "camera")).code:
        raise SystemExit("\n".join(made.progress))
    if whole:
        shutil.copytree(root, folder / f"{minutes:g}-whole")
    half = max(frames // EVERY // 2 - 1, 0)
    kept = root / "runs" / "0002-measure" / f"followed-film-{half:04d}.npz"
    first, again = twin(root, "measure", until=kept), twin(root, "measure")
    if again.code:
        raise SystemExit("\n".join(again.progress))
    told: dict[str, Any] = {
        "minutes": minutes, "frames": frames,
        "film_MB": round((root / "raw" / "film.mp4").stat().st_size / 2**20),
        "killed_peak_MB": round(first.peak),
        "resumed_peak_MB": round(again.peak), "resumed_at": EVERY * (half + 1),
        "frames_per_cpu_s": round(frames / (first.cpu + again.cpu), 1),
        "resumed_s": round(again.wall), "progress": len([x for x in first.progress if " of " in x]),
        "targets_MB": round(sum(p.stat().st_size for p in (root / "targets").iterdir()) / 2**20),
    }  # fmt: skip
    if whole:
        other = folder / f"{minutes:g}-whole"
        one = twin(other, "measure")
        told |= {"wall_s": round(one.wall), "peak_MB": round(one.peak), "bit_equal": same(root, other)}
    return told


def same(one: Path, two: Path) -> bool:
    """Whether two projects hold the same targets and tracks."""
    files_of = [files.read_npz(next(p.glob(name))) for p in (one, two)
                for name in ("targets/targets.npz", "runs/*/tracks.npz")]  # fmt: skip
    arrays = all(
        np.array_equal(a[key], b[key], equal_nan=a[key].dtype.kind == "f")
        for a, b in zip(files_of[:2], files_of[2:], strict=True)
        for key in a.keys() | b.keys()
    )
    tables = [(p / "targets" / "targets.csv").read_bytes() for p in (one, two)]
    return arrays and tables[0] == tables[1]


def main() -> int:
    """Print the table."""
    typed = options(__doc__, {
        "--minutes": {"type": float, "nargs": "+", "default": [1.0, 10.0]},
        "--whole": "uninterrupted as well: compared bit for bit",
        "--keep": (Path, "folder of the films"),
    }, json="one JSON line")  # fmt: skip
    with tempfile.TemporaryDirectory(dir=typed.keep) as name:
        films = typed.keep or Path(name)
        rows = [row(m, Path(name), films, whole=typed.whole) for m in typed.minutes]
    if typed.json:
        print(json.dumps(rows))
        return 0
    print("| " + " | ".join(rows[0]) + " |\n|" + "---|" * len(rows[0]))
    for found in rows:
        print("| " + " | ".join(str(v) for v in found.values()) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
