"""Rerun files, clips and VTU files on a disk without room: one sentence that names the file, and no half file.

rerun, ffmpeg and VTK write by themselves: each runs in a process of its own, where no file may grow.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.few import few

PREPARE = """
import resource, sys
from pathlib import Path
import numpy as np
from twin.console import guarded

folder, limit = Path(sys.argv[1]), int(sys.argv[2])
TIMES, SIZE = np.arange(6) / 10.0, (64, 48)
rng = np.random.default_rng(1)
nodes = rng.uniform(0.0, 40.0, (512, 3))

def film():
    from vision.film.video import Video, Writer
    with Writer(folder / "film.mkv", SIZE, fps=10.0, codec="libx264") as writer:
        for _ in TIMES:
            writer.add(rng.integers(0, 255, (48, 64), dtype=np.uint8))
    return Video(folder / "film.mkv")

def history():
    from twin.review.states import Generations
    u = rng.normal(size=(9, 512, 3))
    return Generations(
        generation=np.arange(1, 10), names=("C10",), best=np.full((9, 1), 0.2), rms_mm=np.ones(9), nodes=nodes,
        triangles=np.arange(510).reshape(-1, 3), u=u.astype(np.float32), point_names=("tip",), points=nodes[:1],
        u_points=u[:, :1], u_measured=u[0, :1], film_time_s=0.2, film_frame=2,
    )

def filmed():
    from twin.review.filmed import Filmed, Trace
    edge = np.tile(rng.uniform(5.0, 40.0, (9, 2)), (6, 1, 1))
    seen = np.full((6, 1, 2), 20.0)
    way = tuple(Trace(label=n, rms_mm=0.1, edge=edge, markers=seen + 1.0) for n in ("before", "after"))
    return Filmed(
        size=SIZE, frame=np.arange(6), time_s=TIMES, names=("tip",), measured=seen, models=way, before=0,
        search=way[0], search_measured=seen[0], expected_mm=0.01, error_mm=(np.ones((6, 1)), np.ones((6, 1))),
    )
"""
WRITE = {
    "review.rrd": """
from twin.review.recording import write_review
source, told = film().path, history()
def work():
    write_review(folder / "review.rrd", film=source, frame_times_s=TIMES, generations=told, fields=None,
                 diagnosis_markdown="creep")
""",
    "clip.mp4": """
from twin.drawing.painting import write_clip
source, shown = film(), filmed()
def work():
    write_clip(folder / "clip.mp4", source, shown)
""",
    "field-0000.vtu": """
from twin.drawing.deformed import write_vtu_series
def work():
    write_vtu_series(folder, "field", nodes=nodes, cells=np.arange(512).reshape(-1, 8), times=[0.0],
                     fields={"U": nodes[None]})
""",
}
RUN = """
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
sys.exit(guarded(work, debug=False))
"""


def written(name: str, folder: Path, limit: int) -> tuple[int, str]:
    """Exit code and stderr of a process that writes the file, and may not write more bytes into any."""
    command = [sys.executable, "-W", "error", "-c", PREPARE + WRITE[name] + RUN, str(folder), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stderr


@pytest.mark.parametrize("name", few(WRITE, ["review.rrd"]))
def test_a_file_that_cannot_grow_is_named_and_the_former_one_is_left(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text("the former one", encoding="utf-8")
    assert written(name, tmp_path, 3000) == (2, f"error: {path}: File too large\n")
    assert path.read_text(encoding="utf-8") == "the former one"
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []
    assert written(name, tmp_path, 0) == (0, "")
    assert path.stat().st_size > 3000
