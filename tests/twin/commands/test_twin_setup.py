"""twin setup: a folder with film, board pictures and log becomes a twin.toml that can be measured."""

import shutil

from benchmarks.tracking.own_film import BOARD, FILM_START, TAG_MM, write_recordings

import numpy as np
import pytest

from tests.messages import Lines, says
from twin import files
from twin.bodies.finger import FingerTable
from twin.commands.init import film_config
from twin.commands.print import run_print
from twin.commands.setup import run_setup
from twin.marktables import FrameTable
from twin.project.folder import Project
from twin.project.framesheet import with_sheet
from twin.project.toml import dump


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with recordings before the printed sheet and nothing else, and the true places by id."""
    root = tmp_path_factory.mktemp("setup") / "own"
    root.mkdir()
    config = film_config("own")
    files.write_text(root / "twin.toml", dump(config))
    run_print(Project.open(root), Lines(), frame="a4")
    sheet = with_sheet(config.model_copy(update={"frame": FrameTable(sheet="raw/frame.toml", finger="left")}), root)
    true = write_recordings(root / "raw", sheet.frame.markers, still=40)
    (root / "twin.toml").unlink()
    shutil.rmtree(root / "runs")
    return root, true


@pytest.fixture
def folder(recorded, tmp_path):
    """A copy of it, by links to the films."""
    root = tmp_path / "own"
    shutil.copytree(recorded[0], root, copy_function=lambda a, b: shutil.os.link(a, b))
    return root


def listing(root):
    return {p.relative_to(root): p.stat().st_mtime_ns for p in root.rglob("*")}


def test_nothing_is_typed(folder, recorded):
    before = listing(folder)
    told = Lines()
    run_setup(folder, told)
    assert listing(folder) == before  # without --yes nothing is written
    says(told[-1], "--yes")
    result = run_setup(folder, told, yes=True)
    written = listing(folder)
    assert {k for k in written if written[k] != before.get(k)} <= {*map(type(folder), ["twin.toml", "."])}
    project = Project.open(folder)
    camera, pressure = project.config.cameras[0], project.config.pressure
    assert (camera.film, camera.static, camera.boards) == ("raw/film.mkv", "raw/static.mkv", "raw/board/*.png")
    assert (camera.board.columns, camera.board.rows) == (BOARD.columns, BOARD.rows)  # read off its ids
    share = camera.board.marker_mm / camera.board.square_mm
    assert share == pytest.approx(BOARD.marker_mm / BOARD.square_mm, abs=0.03)
    assert (pressure.file, pressure.join) == ("raw/log.csv", "onset")
    assert camera.film_start_s == pytest.approx(FILM_START, abs=0.11)
    assert project.config.frame.finger == "left"
    points = {point.marker: point for point in project.config.points}
    assert set(points) == set(recorded[1])  # role by motion; of the sheet none is taken for the finger
    assert (points[3].name, points[1].name) == ("tip", "middle")
    for code, point in points.items():
        assert point.size_mm == pytest.approx(TAG_MM, rel=0.05)
        if point.position_mm is not None:
            np.testing.assert_allclose(point.position_mm, recorded[1][code], atol=0.3)
    wanted = " ".join(result["wanted"])
    says(wanted, "ruler_mm", "model.finger")
    assert not [line for line in result["wanted"] if "No " in line]


def test_what_the_user_stated_stays_and_the_former_file_too(folder):
    config = film_config("mine")
    finger = FingerTable(length_mm=112.0)
    config = config.model_copy(update={"model": config.model.model_copy(update={"finger": finger})})
    files.write_text(folder / "twin.toml", dump(config))
    first = (folder / "twin.toml").read_text()
    told = Lines()
    result = run_setup(folder, told, yes=True)
    assert (folder / "twin-0001.toml").read_text() == first
    assert any("twin-0001.toml" in line for line in told)
    assert Project.open(folder).config.model.finger == finger
    assert "model.finger" not in " ".join(result["wanted"])
    # once the rulers are stated and a point is corrected, a second setup keeps both
    text = (folder / "twin.toml").read_text().replace("# ruler_mm = ...", "ruler_mm = [249.5, 160.4]")
    files.write_text(folder / "twin.toml", text.replace('name = "p3"', 'name = "knuckle"'))
    assert run_setup(folder, Lines(), yes=True)["wanted"] == []
    config = Project.open(folder).config
    assert config.frame.ruler_mm == (249.5, 160.4)
    assert "knuckle" in [point.name for point in config.points]
    assert (folder / "twin-0002.toml").is_file()


def test_what_is_missing_is_said(folder):
    for name in ("static.mkv", "log.csv", "frame.toml"):
        (folder / "raw" / name).unlink()
    shutil.rmtree(folder / "raw" / "board")
    wanted = "\n".join(run_setup(folder, Lines())["wanted"])
    says(wanted, "No static film", "film.mkv", "No pictures of a board", "No pressure log", "stand still",
         "printed sheet", "34, 35")  # fmt: skip
    with pytest.raises(ValueError, match="no such folder"):
        run_setup(folder / "elsewhere", Lines())
