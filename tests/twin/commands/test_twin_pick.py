"""Natural features without markers: numbered in a picture, named, and measured like markers."""

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from tests.messages import Lines, saying
from tests.strangers import studio
from twin.commands.camera import run_camera
from twin.commands.check import run_check
from twin.commands.measure import run_measure
from twin.commands.pick import COLUMNS, run_pick
from twin.commands.print import run_print
from twin.csvtable import read_sheet
from twin.project.config import Config
from twin.project.folder import Project
from twin.project.toml import dump, parse
from vision.drawing import synthetic

FINGER = (0.0, 0.0, 110.0, 20.5)  # mm, x and z of the speckled part of the side face


def sink(time: np.ndarray) -> np.ndarray:
    """The skin's shift (t,2) mm, the same for all of it."""
    return np.outer(studio.ramp(time), (-2.0, -12.0))


def textured(shift: np.ndarray) -> Any:
    """A skin with a natural texture, shifted by (t,2) mm: grey levels at places (n,2) mm in frame t."""
    rng = np.random.default_rng(8)
    skin = 90.0 + 30.0 * gaussian_filter(rng.standard_normal((80, 300)), 1.6) / 0.177
    last: dict[tuple[float, ...], np.ndarray] = {}  # the skin at rest is drawn once, not in 120 frames

    def grey(t: int, places: np.ndarray) -> np.ndarray:
        if (key := tuple(shift[t].tolist())) not in last:
            last.clear()
            last[key] = drawn(places - shift[t])
        return last[key]

    def drawn(places: np.ndarray) -> np.ndarray:
        x, z = places.T
        low_x, low_z, high_x, high_z = FINGER
        inside = (x > low_x) & (x < high_x) & (z > low_z) & (z < high_z)
        out: np.ndarray = np.full(len(x), np.nan)
        out[inside] = map_coordinates(skin, [z[inside] / 0.4 + 5, x[inside] / 0.4 + 5], order=1, mode="nearest")
        return out

    return grey


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """The right project, but one tag and a textured skin on the finger."""
    root = tmp_path_factory.mktemp("skin") / "skin"
    studio.draw_boards(root / "raw" / "boards")
    (root / "raw" / "pressure.csv").write_text(studio.log_text())
    marks = [m for m in studio.marks_of() if m.role != "finger" or m.name == "root"]
    lens, pose = studio.camera()
    for name, time in (("film.mkv", studio.film_time()), ("static.mkv", np.zeros(120))):
        place = np.tile([m.position for m in marks], (len(time), 1, 1)).astype(float)
        shift = sink(time)
        place[:, -1, ::2] += shift
        synthetic.film(
            root / "raw" / name, camera=lens, pose=pose, marks=marks, positions=place, codec="rawvideo",
            rotations=np.zeros(place.shape[:2]), fps=studio.RATE, seed=len(time),
            face=(studio.Y, textured(shift)),
        )  # fmt: skip
    config = studio.config_of()
    first = config.points[0].model_copy(update={"position_mm": (20.0, studio.Y, 0.0)})
    config = config.model_copy(
        update={"points": (first,), "calibrate": config.calibrate.model_copy(update={"objective_points": ("root",)})}
    )
    (root / "twin.toml").write_text(dump(config))
    return Project.open(root)


def test_features_are_numbered_named_and_measured(project: Project) -> None:
    say = Lines()
    picked = run_pick(project, say, size_mm=6.0)
    assert picked["features"] >= 5
    assert run_pick(project, say, size_mm=6.0)["status"] == "skipped"
    folder = project.path(picked["run"])
    picture = cv2.imread(str(folder / "features.png"))
    assert picture.shape == (400, 640, 3)
    table = read_sheet(folder / "features.csv", wanted="number").table(COLUMNS)
    x, z = (table.numbers(f"seen_{axis}_mm", unit="mm") for axis in "xz")
    # all of a square of 6 mm lies on the finger, but for 1 mm
    assert ((x > 2.0) & (x < 108.0) & (z > 2.0) & (z < 18.0)).all()
    middle, tip = int(np.argmin(np.abs(x - 54))), int(np.argmax(x))
    run_pick(project, say, names=[f"middle={middle + 1}", f"tip={tip + 1}"])
    assert "correct it where the finger sags" in say[-1]
    own = Project.open(project.root)
    assert [p.name for p in own.config.points] == ["root", "middle", "tip"]
    assert own.config.points[2].seen_mm == (pytest.approx(x[tip]), pytest.approx(z[tip]))
    run_check(own, say)
    run_camera(own, say)
    run_measure(own, say)
    targets = own.targets()
    truth = sink(studio.film_time())
    for name in ("middle", "tip"):
        row = targets.names.index(name)
        error = targets.value[:, row][:, [0, 2]] - truth
        assert targets.valid[:, row][:, [0, 2]].all()
        # 30 px of smooth texture, noise of 1 grey level: a bound of some 0.01 px, which is 3 um
        assert np.abs(error).max() < 0.03, name
    with pytest.raises(ValueError, match=saying("--name", "tip=9999", "features.csv", "1")):
        run_pick(own, say, names=["tip=9999"])
    with pytest.raises(ValueError, match=r"name = 'tip' stands twice"):
        run_pick(own, say, names=["tip=1"])
    with pytest.raises(ValueError, match=r"--name tip: wanted a name and a number"):
        run_pick(own, say, names=["tip"])


def test_a_feature_has_no_marker_and_is_not_printed(project: Project, tmp_path: Path) -> None:
    config = studio.config_of()
    feature = {"marker": None, "seen_mm": (109.0, -0.5)}
    points = (*config.points[:-1], config.points[-1].model_copy(update=feature))
    (tmp_path / "twin.toml").write_text(dump(config.model_copy(update={"points": points})))
    printed = run_print(Project.open(tmp_path), Lines(), paper="a3")
    assert printed["items"] == 1 + len(studio.marks_of()) - 1  # the board, and all marks but the feature
    text = (tmp_path / "twin.toml").read_text()
    with pytest.raises(ValueError, match=saying("points.tip", "marker = 23", "seen_mm")):
        parse(text.replace("seen_mm = [109", "marker = 23\nseen_mm = [109").encode(), name="twin.toml")


def test_a_picture_without_texture_says_what_to_do(project: Project, tmp_path: Path) -> None:
    root = tmp_path / "plain"
    shutil.copytree(project.root / "raw" / "boards", root / "raw" / "boards")
    marks, (lens, pose) = studio.marks_of(), studio.camera()

    def plain(t: int, places: np.ndarray) -> np.ndarray:
        inside = (places > (-20.0, -20.0)).all(axis=1) & (places < (130.0, 22.0)).all(axis=1)
        return np.where(inside, 90.0, np.nan)

    synthetic.film(
        root / "raw" / "film.mkv", camera=lens, pose=pose, marks=marks, positions=studio.motion(marks, np.zeros(2)),
        rotations=np.zeros((2, len(marks))), codec="rawvideo", face=(studio.Y, plain),
    )  # fmt: skip
    (root / "twin.toml").write_text(dump(studio.config_of()))
    with pytest.raises(ValueError, match=r"no feature of 9\.\d+ mm on the finger that can be followed; wanted texture"):
        run_pick(Project.open(root), Lines())


def test_features_are_for_one_camera(project: Project) -> None:
    first = project.config.cameras[0]
    two = {"cameras": (first, first.model_copy(update={"name": "top", "film": "raw/top.mkv"}))}
    both = Project(project.root, project.config.model_copy(update=two))
    with pytest.raises(ValueError, match=saying("twin.toml", "2", r"\[\[cameras\]\]")):
        run_pick(both, Lines())
    seen = project.config.points[0].model_copy(update={"marker": None, "seen_mm": (20.0, 5.0)})
    with pytest.raises(ValueError, match=saying("seen_mm", "2", r"\[\[cameras\]\]")):
        Config.model_validate(project.config.model_copy(update={**two, "points": (seen,)}).model_dump())
