"""Drawn boards and films of two cameras to targets with U2, through `twin camera` and `twin measure`; and the
films of one of them, measured by a process that is killed in the middle: the next one goes on there."""

import shutil
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.messages import Lines
from twin import files
from twin.commands.camera import run_camera
from twin.commands.measure import run_measure
from twin.gauge.pressuretable import PressureTable
from twin.marktables import FrameTable, MarkerTable, PointTable
from twin.project.cameratables import BoardTable, CameraTable, MeasureTable
from twin.project.config import Config, ProjectTable
from twin.project.folder import Project
from twin.project.toml import dump, parse
from vision import Board, Camera, Mark
from vision.camera import Array
from vision.drawing import synthetic
from vision.kinds import CodedMarker

BOARD = BoardTable(columns=7, rows=5, square_mm=22.0, marker_mm=16.0)
SIZE = (640, 400)
MIDDLE = np.array([45.0, 12.0, -15.0])
FRAMES, RATE = 34, 10.0
PLACES = {
    "frame": [(-15, 22), (45, 26), (105, 22), (-15, -50), (45, -54), (105, -50)],
    "fixed": [(15, 24), (75, 24), (-17, -15), (107, -15)],
}
POINTS = {"middle": (50.0, 12.0, 0.0), "tip": (85.0, 12.0, 0.0)}
NODES = {"middle": 2529, "tip": 4149}  # within 2 mm of them


def pose_of(degrees: float) -> tuple[Array, Array]:
    """A camera 400 mm away that looks at the middle, turned about the vertical."""
    facing = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    tilt, _ = cv2.Rodrigues(np.deg2rad([3.0, 2.0, 0.0]))
    about, _ = cv2.Rodrigues(np.array([0.0, 0.0, np.deg2rad(degrees)]))
    rotation = tilt @ facing @ about
    return cv2.Rodrigues(rotation)[0].ravel(), np.array([0.0, 0.0, 400.0]) - rotation @ MIDDLE


CAMERAS = {
    "left": (np.array([[1250.0, 0, 322], [0, 1251.0, 198], [0, 0, 1]]), pose_of(-9.0)),
    "right": (np.array([[1230.0, 0, 318], [0, 1229.0, 203], [0, 0, 1]]), pose_of(13.0)),
}


def camera_of(name: str) -> Camera:
    return Camera(CAMERAS[name][0], np.array([-0.1, 0.0, 0.0, 0.0, 0.0]), SIZE)


def marks() -> list[Mark]:
    flat = [(role, x, z) for role, spots in PLACES.items() for x, z in spots]
    still = [Mark(f"{role}{i}", CodedMarker(i, 9.0), (x, 12.0, z), role) for i, (role, x, z) in enumerate(flat)]
    return still + [Mark(n, CodedMarker(20 + i, 9.0), p, "finger") for i, (n, p) in enumerate(POINTS.items())]


def motion(time: Array) -> tuple[Array, Array]:
    """Places (t,p,3) mm: the finger's marks sink by up to 20 mm and come forward by up to 6 mm."""
    ramp = np.clip((time - 2.0) / 1.2, 0.0, 1.0)
    place = np.tile([m.position for m in marks()], (len(time), 1, 1)).astype(float)
    for p, share in ((-2, 0.4), (-1, 1.0)):
        place[:, p] += np.outer(ramp, share * np.array([-4.0, 6.0, -20.0]))
    return place, np.zeros(place.shape[:2])


def draw_boards(root: Path) -> None:
    """The board in 9 poses before both cameras, all tilted otherwise."""
    rng = np.random.default_rng(3)
    board = Board.of(**BOARD.model_dump())
    first, _ = cv2.Rodrigues(CAMERAS["left"][1][0])
    for k in range(9):
        tilt, _ = cv2.Rodrigues(
            np.r_[rng.choice([-1, 1], 2) * rng.uniform(0.25, 0.55, 2), rng.normal(0, 0.3)]
        )
        corner = tilt @ np.array([-77.0, -55.0, 0.0]) + np.r_[rng.uniform(-25, 25, 2), rng.uniform(380, 440)]
        for name, (_, (rvec, tvec)) in CAMERAS.items():
            to_world = first.T @ np.column_stack([tilt, corner - CAMERAS["left"][1][1]])
            turn, _ = cv2.Rodrigues(rvec)
            pose = turn @ to_world
            picture = synthetic.board_image(
                camera_of(name), board, (cv2.Rodrigues(pose[:, :3])[0].ravel(), pose[:, 3] + tvec), seed=k
            )
            path = root / "raw" / name / f"b{k:02d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), picture)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    root = tmp_path_factory.mktemp("batch")
    draw_boards(root)
    for k, name in enumerate(CAMERAS):
        for film, at in (("film", np.arange(FRAMES) / RATE), ("static", np.zeros(120))):
            place, turn = motion(at)
            synthetic.film(
                root / "raw" / f"{name}-{film}.mkv", camera=camera_of(name), pose=CAMERAS[name][1], marks=marks(),
                positions=place, rotations=turn, codec="rawvideo", seed=7 * k + len(at),
            )  # fmt: skip
    time = np.arange(-1, 6, 0.02)
    pressure = 0.03 * np.clip((time - 2.0) / 1.2, 0.0, 1.0) + 1e-5 * (np.arange(len(time)) % 3)
    log = "".join(f"{t:.2f},{p:.7f}\n" for t, p in zip(time, pressure, strict=True))
    files.write_text(root / "raw" / "pressure.csv", "time_s,pressure_MPa\n" + log)
    config = Config(
        project=ProjectTable(name="pair"),
        cameras=tuple(
            CameraTable(name=n, film=f"raw/{n}-film.mkv", static=f"raw/{n}-static.mkv", boards=f"raw/{n}/*.png",
                        board=BOARD) for n in CAMERAS
        ),
        pressure=PressureTable(), measure=MeasureTable(placement_sd_mm=0.01, node_sd_mm=0.01),
        frame=FrameTable(markers=tuple(
            MarkerTable(marker=m.kind.code, name=m.name, role=m.role, position_mm=m.position, size_mm=9.0)
            for m in marks() if m.role != "finger"
        )),
        points=tuple(
            PointTable(name=n, node=NODES[n], marker=20 + i, size_mm=9.0, position_mm=p)
            for i, (n, p) in enumerate(POINTS.items())
        ),
    )  # fmt: skip
    files.write_text(root / "twin.toml", dump(config))
    return Project.open(root)


def test_two_cameras_give_targets_with_motion_out_of_the_plane(project: Project) -> None:
    say = Lines()
    camera = run_camera(project, say)
    assert any("2 cameras from 9 board poses" in line for line in say)
    assert (project.path(camera["run"]) / "rig.json").is_file()
    assert run_camera(project, Lines())["status"] == "skipped"
    run_measure(project, say)
    targets = project.targets()
    places = motion(targets.time)[0][:, -2:]
    truth = places - places[targets.reference].mean(axis=0)
    rows = [targets.names.index(name) for name in POINTS]
    assert targets.valid[:, rows].all()
    error = targets.value[:, rows] - truth
    assert np.abs(truth[..., 1]).max() == pytest.approx(6.0)
    assert np.abs(error).max() < 0.1  # mm; one camera is off by r dy / Z = 45 x 6 / 400 = 0.7 mm
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3) + (targets.modes**2).sum(axis=0)
    pulls = error / np.sqrt(variance[:, rows])
    assert np.sqrt(np.mean(pulls**2)) < 1.6  # one calibration: its error is one draw for all values
    assert any(name.startswith("calibration:") for name in targets.mode_names)


def test_cameras_that_do_not_share_a_board_are_refused(project: Project) -> None:
    left, right = project.config.cameras
    text = dump(project.config.model_copy(update={"cameras": (left, replace_board(right))}))
    with pytest.raises(ValueError, match=r"one \[cameras.board\] in both"):
        parse(text.encode(), name="twin.toml")
    text = dump(
        project.config.model_copy(update={"cameras": (left, right.model_copy(update={"name": "left"}))})
    )
    with pytest.raises(ValueError, match=r"name = 'left' stands twice"):
        parse(text.encode(), name="twin.toml")


def replace_board(table: CameraTable) -> CameraTable:
    assert table.board is not None
    return table.model_copy(update={"board": table.board.model_copy(update={"square_mm": 23.0})})


def test_pictures_without_a_common_name_are_refused(project: Project, tmp_path: Path) -> None:
    shutil.copytree(project.root / "raw", tmp_path / "raw")
    for path in (tmp_path / "raw" / "right").glob("*.png"):
        path.rename(path.with_name(f"r-{path.name}"))
    shutil.copy(project.root / "twin.toml", tmp_path)
    with pytest.raises(ValueError, match="0 board pictures have the same file name in two cameras"):
        run_camera(Project.open(tmp_path), Lines())


# Parts of 10 frames, so that a short film has some.
TWIN = "import sys; import vision.film.checkpoint as c; c.EVERY = 10; from twin.cli import main; sys.exit(main())"


def twin(folder: Path, stage: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", TWIN, stage], cwd=folder, stdout=subprocess.DEVNULL)


@pytest.mark.slow
def test_a_killed_process_goes_on_bit_for_bit(project: Project, tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    shutil.copytree(project.root / "raw", whole / "raw")
    one = project.config.model_copy(update={"cameras": project.config.cameras[:1]})
    files.write_text(whole / "twin.toml", dump(one))
    assert twin(whole, "camera").wait(60) == 0
    shutil.copytree(whole, killed)
    assert twin(whole, "measure").wait(120) == 0

    process, kept = twin(killed, "measure"), killed / "runs" / "0002-measure" / "followed-film-0001.npz"
    began = time.monotonic()
    while not kept.exists() and process.poll() is None and time.monotonic() < began + 120:
        time.sleep(0.002)
    process.kill()
    assert process.wait(10) != 0  # it was not done
    assert not (killed / "targets").exists()
    before = kept.stat().st_mtime_ns, sorted(p.name for p in kept.parent.glob("followed-static-*"))
    assert len(before[1]) == 12
    again = twin(killed, "measure")
    while again.poll() is None and time.monotonic() < began + 120:
        if kept.exists():
            assert kept.stat().st_mtime_ns == before[0]  # what was followed is not followed again
        time.sleep(0.01)
    assert again.wait(10) == 0
    for name in ("targets.csv", "pressure.csv"):
        assert (killed / "targets" / name).read_bytes() == (whole / "targets" / name).read_bytes()
    for pattern in ("runs/*/tracks.npz", "targets/targets.npz"):
        first, second = (files.read_npz(next(folder.glob(pattern))) for folder in (whole, killed))
        assert first.keys() == second.keys()
        for key, array in first.items():
            np.testing.assert_array_equal(array, second[key], err_msg=key)
