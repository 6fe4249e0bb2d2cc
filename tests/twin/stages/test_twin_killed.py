"""`twin measure` killed as a process in the middle of the film: the next one goes on there, bit for bit."""

import shutil
import subprocess
import sys
import time
from itertools import islice
from pathlib import Path

import numpy as np

from twin.project import files
from vision import Video
from vision.film.video import Writer

ROOT = Path(__file__).resolve().parents[3]
# Parts of 20 frames, so that a short film has some.
TWIN = "import sys; import vision.film.checkpoint as c; c.EVERY = 20; from twin.cli import main; sys.exit(main())"


def shortened(film: Path, target: Path, frames: int) -> None:
    """The film's first frames, lossless."""
    video = Video(film)
    with Writer(target, (video.width, video.height), fps=20.0, codec="ffv1", crf=0) as writer:
        for _, _, grey in islice(video.frames(), frames):
            writer.add(grey)


def twin(folder: Path, stage: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", TWIN, stage], cwd=folder, stdout=subprocess.DEVNULL)


def test_a_killed_process_goes_on_bit_for_bit(tmp_path: Path) -> None:
    demo, whole = ROOT / "datasets" / "demo", tmp_path / "whole"
    shutil.copytree(demo, whole)
    for name, frames in (("film", 60), ("static", 120)):
        shortened(demo / "raw" / f"{name}.mp4", whole / "raw" / f"{name}.mkv", frames)
        (whole / "raw" / f"{name}.mp4").unlink()
    text = (
        (whole / "twin.toml").read_text().replace("film.mp4", "film.mkv").replace("static.mp4", "static.mkv")
    )
    files.write_text(whole / "twin.toml", text)
    assert twin(whole, "camera").wait(60) == 0
    killed = tmp_path / "killed"
    shutil.copytree(whole, killed)
    assert twin(whole, "measure").wait(120) == 0

    process, kept = twin(killed, "measure"), killed / "runs" / "0002-measure" / "followed-film-0001.npz"
    began = time.monotonic()
    while not kept.exists() and process.poll() is None and time.monotonic() < began + 120:
        time.sleep(0.01)
    process.kill()
    assert process.wait(10) != 0  # it was not done
    assert not (killed / "targets").exists()
    before = kept.stat().st_mtime_ns, sorted(p.name for p in kept.parent.glob("followed-static-*"))
    assert len(before[1]) == 6
    again = twin(killed, "measure")
    while again.poll() is None and time.monotonic() < began + 120:
        if kept.exists():
            assert kept.stat().st_mtime_ns == before[0]  # what was followed is not followed again
        time.sleep(0.01)
    assert again.wait(10) == 0
    for name in ("targets.csv", "pressure.csv"):
        assert (killed / "targets" / name).read_bytes() == (whole / "targets" / name).read_bytes()
    for pattern in ("runs/*/tracks.npz", "targets/targets.npz"):
        one, two = (files.read_npz(next(folder.glob(pattern))) for folder in (whole, killed))
        assert one.keys() == two.keys()
        for key, array in one.items():
            np.testing.assert_array_equal(array, two[key], err_msg=key)
