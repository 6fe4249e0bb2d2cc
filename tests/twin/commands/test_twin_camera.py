"""twin camera on real pictures, on a file of another program, and what twin.toml may say of it."""

import shutil

import numpy as np
import pytest

from tests.messages import Lines
from twin import files
from twin.commands.camera import run_camera
from twin.commands.init import film_config
from twin.inputs.cameras import board_of
from twin.project.cameratables import BoardTable, CameraTable
from twin.project.folder import Project
from twin.project.toml import dump
from vision import Camera
from vision.film.video import Writer

CHESS = BoardTable(kind="chessboard", columns=9, rows=6, square_mm=25.0)


def make(folder, **changes):
    config = film_config("batch")
    stated = config.cameras[0].model_dump() | changes
    config = config.model_copy(update={"cameras": (CameraTable(**stated),)})
    files.write_text(folder / "twin.toml", dump(config))
    return Project.open(folder)


@pytest.mark.parametrize(("side", "limit"), [("left", 0.20), ("right", 0.21)])
def test_real_chessboard_pictures_of_a_project(tmp_path, shared_data, side, limit):
    (tmp_path / "raw").mkdir()
    for picture in (shared_data / "opencv_boards").glob(f"{side}*.jpg"):
        shutil.copy(picture, tmp_path / "raw" / picture.name)
    project = make(tmp_path, boards="raw/*.jpg", board=CHESS.model_dump())
    say = Lines()
    result = run_camera(project, say)
    assert result["rms_px"] <= limit
    assert (result["images"], result["given"]) == (13, 13)
    assert set(result["model"].split()) >= {"k1", "k2", "p1", "p2"}
    assert not any("lens model" in line for line in say)  # it asks nothing: it is in the run's log
    log = files.read_jsonl(tmp_path / result["run"] / "log.jsonl")
    assert any("The lens model is" in record.get("note", "") for record in log)
    assert "13 of 13 board images" in say[-1]
    camera = Camera.from_dict(files.read_json(tmp_path / result["run"] / "camera.json"))
    np.testing.assert_allclose(camera.stdevs, list(result["sd"].values()))
    assert 0.3 < camera.stdevs[0] < 2.0
    assert len(camera.covered) > 4


def test_a_camera_of_another_program(tmp_path):
    (tmp_path / "raw").mkdir()
    with Writer(tmp_path / "raw/film.mp4", (64, 48), fps=10.0, codec="libx264", crf=18) as writer:
        writer.add(np.zeros((48, 64), dtype=np.uint8))
    text = "%YAML:1.0\n---\nK: [80., 0., 32., 0., 80., 24., 0., 0., 1.]\nD: [-0.1, 0.02, 0., 0.]\n"
    files.write_text(tmp_path / "raw/lens.yml", text)
    project = make(tmp_path, boards=None, board=None, camera_file="raw/lens.yml")
    say = Lines()
    result = run_camera(project, say)
    assert "lens.yml does not say how well the camera is known" in say[0]
    camera = Camera.from_dict(files.read_json(tmp_path / result["run"] / "camera.json"))
    assert camera.distortion.tolist() == [-0.1, 0.02, 0.0, 0.0, 0.0]
    assert run_camera(project, Lines())["status"] == "skipped"
    files.write_text(tmp_path / "raw/lens.yml", text.replace("-0.1", "-0.2"))
    assert run_camera(project, Lines())["status"] == "done"
    (tmp_path / "raw/lens.yml").unlink()
    with pytest.raises(ValueError, match=r"cameras.camera_file = 'raw/lens.yml': no such file"):
        run_camera(project, Lines())


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"boards": None},
            "cameras 'side' has no calibration: give boards and .cameras.board., or camera_file",
        ),
        ({"board": None}, "cameras 'side' has no calibration"),
        ({"camera_file": "raw/lens.yml"}, "has boards and camera_file: keep one of them"),
        ({"dictionary": "APRILTAG"}, "wanted one of OpenCV's names, such as DICT_4X4_50"),
        ({"dictionary": "/tmp/own.yml"}, "wanted a path relative to the project folder"),
        ({"board": {"columns": 9, "rows": 6, "square_mm": 15.0}}, "marker_mm is missing"),
        (
            {"board": CHESS.model_dump() | {"kind": "dots"}},
            "'charuco', 'chessboard', 'circles', 'acircles' or 'codedcircles'",
        ),
    ],
)
def test_what_twin_toml_may_not_say(changes, sentence):
    stated = film_config("batch").cameras[0].model_dump()
    with pytest.raises(ValueError, match=sentence):
        CameraTable(**stated | changes)


def test_own_dictionary_and_board_kind_survive_the_file(tmp_path):
    project = make(tmp_path, dictionary="raw/own.yml", board=CHESS.model_dump())
    table = project.config.cameras[0]
    assert table.dictionary == "raw/own.yml"
    assert table.board == CHESS


def test_a_camera_in_a_mirror_sees_everything_left_for_right(tmp_path):
    """Pictures of the board, film and static film alike."""
    from twin.inputs.recordings import views_of

    picture = np.tile(np.arange(0, 128, 2, dtype=np.uint8), (48, 1))
    for name in ("film", "static"):
        (tmp_path / "raw").mkdir(exist_ok=True)
        with Writer(tmp_path / f"raw/{name}.mkv", (64, 48), fps=10.0, codec="ffv1", crf=0) as writer:
            writer.add(picture)
    files.write_text(
        tmp_path / "raw/lens.yml", "K: [80., 0., 32., 0., 80., 24., 0., 0., 1.]\nD: [-0.1, 0.02, 0., 0.]\n"
    )
    plain = {"boards": None, "board": None, "camera_file": "raw/lens.yml"}
    own = Camera(np.diag([80.0, 80.0, 1.0]), np.zeros(5), (64, 48))
    files.write_json(tmp_path / "camera.json", own.to_dict())
    for mirrored in (False, True):
        project = make(tmp_path, film="raw/film.mkv", static="raw/static.mkv", mirrored=mirrored, **plain)
        ((view,), _) = views_of(project, tmp_path / "camera.json")
        shown = picture[:, ::-1] if mirrored else picture
        for film in (view.film, view.static):
            np.testing.assert_array_equal(next(iter(film.frames()))[2], shown)


def test_a_mirrored_board_is_calibrated_as_stated(tmp_path, shared_data):
    import cv2

    (tmp_path / "raw").mkdir()
    for picture in sorted((shared_data / "opencv_boards").glob("left*.jpg")):
        cv2.imwrite(str(tmp_path / "raw" / f"{picture.stem}.png"), cv2.imread(str(picture))[:, ::-1])
    cameras = []
    for mirrored in (False, True):
        project = make(tmp_path, boards="raw/*.png", board=CHESS.model_dump(), mirrored=mirrored)
        result = run_camera(project, Lines())  # the key is a part of what the camera is made from
        assert result["status"] == "done"
        cameras.append(Camera.from_dict(files.read_json(tmp_path / result["run"] / "camera.json")))
    # The two are each other's mirror images: 639 px is the last column.
    assert cameras[1].matrix[0, 2] == pytest.approx(639.0 - cameras[0].matrix[0, 2], abs=0.2)
    assert cameras[1].matrix[0, 0] == pytest.approx(cameras[0].matrix[0, 0], abs=0.2)
    assert cameras[0].matrix[0, 2] < 310.0


def test_coding_dots_belong_to_their_kind_of_board(tmp_path):
    coded = {"kind": "codedcircles", "columns": 14, "rows": 10, "square_mm": 8.0}
    dots = ((2, 2), (10, 2), (2, 7))
    project = make(tmp_path, board=coded | {"coding": dots})  # written to twin.toml and read again
    table = project.config.cameras[0]
    assert table.board.coding == dots
    assert board_of(project, table).coding == dots
    for wrong in ({"kind": "codedcircles"}, {"kind": "circles", "coding": dots}):
        with pytest.raises(
            ValueError, match="wanted column and row of the three coding dots with codedcircles"
        ):
            BoardTable(**coded | wrong)
