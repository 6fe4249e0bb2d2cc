"""`twin camera` on films of a moving board: a real recording of four cameras with their time stamps."""

import shutil

import numpy as np
import pytest

from tests.messages import Lines, says
from twin import files
from twin.commands.camera import run_camera
from twin.commands.init import film_config
from twin.inputs.cameras import board_film, board_times, camera_inputs
from twin.project.cameratables import BoardTable, CameraTable
from twin.project.folder import Project
from twin.project.toml import dump

BOARD = BoardTable(
    columns=4, rows=5, square_mm=54.0, marker_mm=40.5, dictionary="DICT_4X4_1000", inverted=True
)


def make(folder, data, numbers, **changes):
    """A project with some of the four cameras."""
    (folder / "raw").mkdir(exist_ok=True)
    for k in numbers:
        shutil.copy(data / f"cam_{k}.mp4", folder / "raw")
    config = film_config("rig")
    stated = config.cameras[0].model_dump() | {"board": BOARD.model_dump()} | changes
    tables = [CameraTable(**stated | {"name": f"c{k}", "boards": f"raw/cam_{k}.mp4"}) for k in numbers]
    files.write_text(folder / "twin.toml", dump(config.model_copy(update={"cameras": tuple(tables)})))
    return Project.open(folder)


def stamps(folder, data, numbers, *, heading="cam_id,frame_time"):
    rows = [line.split(",")[1:] for line in (data / "timestamps.csv").read_text().splitlines()[1:]]
    kept = [",".join(row) for row in rows if int(row[0]) in numbers]
    files.write_text(folder / "raw/stamps.csv", "\n".join([heading, *kept]) + "\n")


def test_a_camera_from_one_real_film(tmp_path, shared_data):
    project = make(tmp_path, shared_data / "charuco_4cam", [1])
    say = Lines()
    result = run_camera(project, say)
    assert result["rms_px"] < 0.25
    assert "frames of raw/cam_1.mp4" in say[-1]
    assert "frames of cam_1.mp4 that show the board were taken" in result["notes"][0]
    assert run_camera(project, Lines())["status"] == "skipped"


@pytest.mark.slow
def test_a_rig_from_real_films_with_their_stamps(tmp_path, shared_data):
    data = shared_data / "charuco_4cam"
    project = make(tmp_path, data, [0, 1], board_times="raw/stamps.csv")
    with pytest.raises(ValueError, match=r"board_times = 'raw/stamps.csv': no such file"):
        run_camera(project, Lines())
    stamps(tmp_path, data, [0, 1])
    say = Lines()
    result = run_camera(project, say)
    assert "moments of the films of a moving board" in say[-1]
    rig = files.read_json(tmp_path / result["run"] / "rig.json")
    # All four cameras together give 1132.3 mm; the calibration stored with the films (0.4 to 0.5 px) 1149 mm.
    assert np.linalg.norm(rig["shift"][1]) == pytest.approx(1132.3, abs=4.0)
    stamps(tmp_path, data, [0, 1], heading="cam_id,time_s")
    assert project.done("camera", **camera_inputs(project)) is None  # the stamps are an input


def test_stamps_that_do_not_fit_are_refused(tmp_path, shared_data):
    from vision import Video

    data = shared_data / "charuco_4cam"
    project = make(tmp_path, data, [0, 1], board_times="raw/stamps.csv")
    table, film = project.config.cameras[1], Video(tmp_path / "raw/cam_1.mp4")

    def told(text):
        files.write_text(tmp_path / "raw/stamps.csv", text)
        with pytest.raises(ValueError) as caught:
            board_times(project, table, film)
        return str(caught.value)

    stamps(tmp_path, data, [0, 1])
    seconds = board_times(project, table, film)
    assert len(seconds) == 57
    assert np.diff(seconds).min() > 0
    says(told("camera,time_s\nc1,1\nc1,2\n"), "2", "'c1'", "cam_1.mp4", "57")
    assert "do not increase: 2 s is followed by 1 s" in told("camera,time_s\nc1,2\nc1,1\n")
    assert "wanted the names of the cameras, c0, c1" in told("camera,time_s\nx,1\n")
    assert "wanted time_s" in told("camera,when\nc1,1\n")
    alone = table.model_copy(update={"board_times": None})
    assert board_times(project, alone, film)[0] == 0.0


def test_one_film_or_pictures(tmp_path):
    with pytest.raises(ValueError, match=r"names a\.mp4 and 1 more files: wanted one film"):
        board_film([tmp_path / "a.mp4", tmp_path / "b.png"])
    assert board_film([tmp_path / "a.png", tmp_path / "b.JPG"]) is None
    assert board_film([tmp_path / "a.mov"]) == tmp_path / "a.mov"
