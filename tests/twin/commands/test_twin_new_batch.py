"""A batch of another finger, filmed elsewhere, goes from `init --like` to the verdict; its folder is moved."""

import hashlib
import shutil
from pathlib import Path

from benchmarks.batches import make_batch
from benchmarks.batches.make_batch import FIRST, OTHER

import numpy as np
import pytest

from fe import Lattice
from twin import files
from twin.batches.former import camera_kept
from twin.batches.values import SUM
from twin.commands.initlike import run_init_like
from twin.commands.recalibrate import run_recalibrate
from twin.commands.recalibrateall import recalibrate_all
from twin.model.structure import BuiltIn
from twin.project.folder import Project
from twin.project.toml import dump
from vision.drawing import synthetic
from vision.film.series import open_film
from vision.following.markercentres import locate

COARSE = Lattice(per_bellow=4, wall=1, up=1, centred=False)  # 1600 nodes where the default has 5400
OLD, NEW = "charge 07 é", "charge 08 ß"  # blanks and letters that not every file system spells alike


def opened(folder):
    """A project whose finger has the dimensions of its twin.toml, on a coarse mesh."""
    table = Project.open(folder).config.model.finger
    return Project.open(folder, builtin=BuiltIn(table.finger, COARSE))


def recalibrated(folder, say):
    project = opened(folder)
    with project.lock("recalibrate"):
        return run_recalibrate(project, say)


def stated(folder, batch):
    """The dimensions and points of another finger, as the user writes them into the twin.toml of its batch."""
    config = Project.open(folder).config
    model = config.model.model_copy(update={"finger": batch.table})
    changed = config.model_copy(update={"model": model, "points": make_batch.points_of(batch)})
    (folder / "twin.toml").write_text(dump(changed), encoding="utf-8")


def digests(folder):
    """The digest of every file below a folder but those of the lock."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.startswith(".lock")
    }  # fmt: skip


@pytest.fixture(scope="module")
def rig(tmp_path_factory, say):
    """A folder with the former batch, recalibrated, and the new one, as `init --like` and the user leave it."""
    folder = tmp_path_factory.mktemp("my batches ü")
    make_batch.write_raw(folder / OLD / "raw", FIRST)
    make_batch.write_boards(folder / OLD / "raw" / "boards")
    (folder / OLD / "twin.toml").write_text(dump(make_batch.config(OLD, FIRST)), encoding="utf-8")
    recalibrated(folder / OLD, say)
    run_init_like(folder / NEW, say, like=folder / OLD)
    make_batch.write_raw(folder / NEW / "raw", OTHER)
    stated(folder / NEW, OTHER)
    return folder


@pytest.fixture(scope="module")
def done(rig, say):
    """What `recalibrate` tells of the new batch, and the lines it said."""
    before = len(say.lines)
    return recalibrated(rig / NEW, say), say.lines[before:]


@pytest.mark.slow
def test_another_finger_goes_from_its_films_to_the_verdict(rig, done):
    result, said = done
    assert result["stages"]["measure"] == result["stages"]["review"] == "done"
    assert any(f"The camera of {OLD} still fits" in line for line in said)
    assert result["verdict"] == "creep"
    names = {row["name"]: row for row in result["changes"]}
    # true: 0.297 MPa in the first, 0.21 MPa in the other, a coarse mesh with either
    assert names[SUM]["known"]
    assert names[SUM]["difference"] == pytest.approx(-0.087, rel=0.25)
    assert "The constants beside earlier batches" in Path(result["report.html"]).read_text(encoding="utf-8")
    for name in ("report.html", "review.rrd"):
        assert Path(result[name]).stat().st_size > 10_000


@pytest.mark.slow
def test_a_second_time_all_is_fresh_and_no_bit_changes(rig, done, say):
    before = digests(rig / NEW)
    again = recalibrated(rig / NEW, say)
    assert not {"done", "failed"} & set(again["stages"].values())
    assert digests(rig / NEW) == before
    assert {k: v for k, v in again.items() if k != "stages"} == {k: v for k, v in done[0].items() if k != "stages"}


@pytest.mark.slow
def test_a_moved_folder_is_fresh_and_names_no_place_of_this_machine(rig, done, say, tmp_path):
    place = str(rig).encode()
    for path in (p for p in rig.rglob("*") if p.is_file()):
        assert place not in path.read_bytes(), path
    moved = Path(shutil.copytree(rig, tmp_path / "elsewhere"))
    before = digests(moved)
    assert not {"done"} & set(recalibrated(moved / NEW, say)["stages"].values())
    alone = Path(shutil.copytree(rig / NEW, tmp_path / "alone" / NEW))  # the former batch stays behind
    result = recalibrated(alone, say)
    assert not {"done"} & set(result["stages"].values())
    assert any(f"Not compared with ../{OLD}" in line for line in say.lines)
    assert digests(moved) == before


@pytest.fixture(scope="module")
def first_frames(tmp_path_factory):
    """`first_frames(batch)`: the film of a batch, of which only the first frame is drawn."""

    def drawn(batch, path):
        eye, pose = make_batch.camera(batch)
        marks = make_batch.marks_of(batch)
        place = np.array([[mark.position for mark in marks]])
        synthetic.film(path, camera=eye, pose=pose, marks=marks, positions=place, rotations=np.zeros((1, len(marks))),
                       blur_px=make_batch.BLUR_PX, noise_grey=make_batch.NOISE_GREY, seed=5)  # fmt: skip

    return drawn


@pytest.mark.parametrize("stands", ["where it was", "elsewhere", "with another lens"])
def test_the_camera_is_kept_unless_its_lens_has_changed(first_frames, say, tmp_path, stands):
    now = {"where it was": OTHER, "elsewhere": make_batch.moved(OTHER), "with another lens": make_batch.zoomed(OTHER)}
    former, new = tmp_path / OLD, tmp_path / NEW
    (former / "raw" / "boards").mkdir(parents=True)
    (former / "raw" / "boards" / "one.png").write_bytes(b"a picture of the board")
    (former / "twin.toml").write_text(dump(make_batch.config(OLD, FIRST)), encoding="utf-8")
    first_frames(FIRST, former / "raw" / "film.mp4")
    eye = make_batch.lens(make_batch.LENS)
    seen = locate(next(iter(open_film(former / "raw" / "film.mp4").frames()))[2], dictionary="DICT_4X4_50", camera=eye)
    names = {m.kind.code: m.name for m in make_batch.marks_of(FIRST)}
    project = Project.open(former)
    with project.new_run("camera", tables=(), inputs=[]) as run:
        run.write_json("camera.json", eye.to_dict())
    with project.new_run("measure", tables=(), inputs=[]) as run:
        run.write_npz("tracks.npz", {"names": np.array([names[i] for i in seen.ids.tolist()]), "position": seen.centre[None]})
    files.write_npz(former / "cache" / "finer.npz", {"array": np.zeros(2)})
    run_init_like(new, say, like=former)
    assert (new / "cache" / "finer.npz").exists()  # what depends on the finger alone is not solved again
    first_frames(now[stands], new / "raw" / "film.mp4")
    if stands == "with another lens":
        with pytest.raises(ValueError, match=rf"the camera of {OLD} does not fit: .* accepted up to 0.3 px"):
            camera_kept(Project.open(new))
    else:
        assert f"The camera of {OLD} still fits" in camera_kept(Project.open(new))


@pytest.mark.slow
def test_the_rest_of_a_folder_goes_on_after_a_batch_that_fails(rig, done, say, tmp_path):
    folder = Path(shutil.copytree(rig, tmp_path / "all"))
    run_init_like(folder / "charge 07b", say, like=folder / OLD)
    make_batch.write_log(folder / "charge 07b" / "raw" / "pressure.csv", OTHER)
    result = recalibrate_all(folder, say, opened=opened)
    assert [row["status"] for row in result["batches"]] == ["done", "failed", "done"]
    assert "raw/film.mp4 (cameras.film)" in result["batches"][1]["error"]
