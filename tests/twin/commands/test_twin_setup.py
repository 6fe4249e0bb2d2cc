"""twin setup: a folder with film, board pictures and log becomes a twin.toml that can be measured."""

import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial

from benchmarks.tracking import own_film
from benchmarks.tracking.own_film import FILM_START, TAG_MM, write_recordings, write_rig

import numpy as np
import pytest

from tests.askedonce import asked_once
from tests.browser import Browser, answers, own_address
from tests.messages import Lines, says
from twin import files
from twin.bodies.finger import FingerTable
from twin.commands import setup
from twin.commands.init import film_config
from twin.commands.print import run_print
from twin.commands.setup import run_setup
from twin.inputs import foundrecordings
from twin.inputs.looseframe import moved
from twin.marktables import FrameTable, MarkerTable
from twin.project.folder import Project
from twin.project.framesheet import read_sheet, with_sheet
from twin.project.toml import dump
from vision import marks
from vision.boards.charuco import CharucoBoard
from vision.film.series import read_picture
from vision.film.video import Writer
from vision.following import dots
from vision.placing import loosemarkers

# The board of the film, but for markers that are drawn right with 136 texels a square in place of 450.
BOARD = replace(own_film.BOARD, marker_mm=11.25)


@pytest.fixture(scope="module", autouse=True)
def looked_once():
    """The tests' folders hold the same pictures: what is seen in one is looked for once."""
    with pytest.MonkeyPatch.context() as patch:
        for owner, name in ((marks, "_detect"), (CharucoBoard, "look"), (dots, "unknown_dots"), (loosemarkers, "locate"), (foundrecordings, "_read_board")):
            patch.setattr(owner, name, asked_once(getattr(owner, name)))
        yield


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with recordings before the printed sheet and nothing else, and the true places by id."""
    root = tmp_path_factory.mktemp("setup") / "own"
    root.mkdir()
    config = film_config("own")
    files.write_text(root / "twin.toml", dump(config))
    run_print(Project.open(root), Lines(), frame="a4")
    sheet = with_sheet(config.model_copy(update={"frame": FrameTable(sheet="raw/frame.toml", finger="left")}), root)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(own_film, "BOARD", BOARD)
        true = write_recordings(root / "raw", sheet.frame.markers, still=40)
        write_rig(root / "raw" / "rig", sheet.frame.markers)
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


def test_nothing_is_typed(folder, recorded, monkeypatch):
    before = listing(folder)
    told = Lines()
    monkeypatch.setattr(setup, "find_spec", lambda name: None)  # without the library of the page the words remain
    run_setup(folder, told)
    assert listing(folder) == before  # without --yes nothing is written
    says(told[-1], "Nothing is written", "--yes", "pip install nicegui")
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
    for point in points.values():
        assert point.size_mm == pytest.approx(TAG_MM, rel=0.05)
        assert point.is_measured
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
    assert config.frame.pictures is None  # a printed sheet needs none
    assert config.frame.ruler_mm == (249.5, 160.4)
    assert "knuckle" in [point.name for point in config.points]
    assert not (folder / "twin-0002.toml").exists()  # it says the same


def test_loose_markers_are_measured_by_pictures_of_rig_and_board(folder, recorded):
    printed = read_sheet(folder / "raw" / "frame.toml")
    (folder / "raw" / "frame.toml").unlink()
    told = Lines()
    wanted = run_setup(folder, told, yes=True)["wanted"]
    config = Project.open(folder).config
    assert (config.frame.pictures, config.frame.finger) == ("raw/rig/*.png", "left")
    assert config.cameras[0].boards == "raw/board/*.png"
    assert any(line.startswith("axes") for line in wanted)
    assert config.measure.scale_sd == 0.001  # the board's
    apart(config, printed)
    # two named markers are the axes; the former frame is kept
    along = [m.marker for m in printed.markers if abs(m.place_mm[1] - printed.markers[0].place_mm[1]) < 1.0]
    text = (folder / "twin.toml").read_text().replace("# axes = ...", f"axes = [{along[-1]}, {along[0]}]")
    files.write_text(folder / "twin.toml", text)
    run_setup(folder, Lines(), yes=True)
    assert (folder / "raw" / "frame-0001.toml").is_file()
    config = Project.open(folder).config
    places = {m.marker: m.position_mm for m in config.frame.markers}
    assert places[along[-1]][::2] == (0.0, 0.0)
    assert places[along[0]][2] == pytest.approx(0.0, abs=1e-3)
    assert places[along[0]][0] == pytest.approx(245.67, abs=0.15)
    apart(config, printed)


def test_a_film_round_rig_and_board_measures_them_as_pictures_do(folder):
    printed = read_sheet(folder / "raw" / "frame.toml")
    (folder / "raw" / "frame.toml").unlink()
    pictures = [read_picture(path, 8) for path in sorted((folder / "raw" / "rig").glob("*.png"))]
    shutil.rmtree(folder / "raw" / "rig")
    with Writer(folder / "raw" / "rig.mkv", pictures[0].shape[::-1], fps=25.0, codec="ffv1") as film:
        for picture in pictures:
            film.add(picture)
    run_setup(folder, Lines(), yes=True)
    config = Project.open(folder).config
    assert config.frame.pictures == "raw/rig.mkv"
    assert config.cameras[0].film == "raw/film.mkv"
    apart(config, printed)


def apart(config, printed):
    """The places are those of the sheet that was filmed, but for a shift and a turn."""
    true = {m.marker: np.array(m.place_mm) * (-1.0, 1.0) for m in printed.markers}  # the finger points left
    own = np.array([m.position_mm for m in config.frame.markers])[:, [0, 2]]
    want = np.array([true[m.marker] for m in config.frame.markers])
    away = own - moved(want, want, own)
    sd = config.measure.frame_sd_mm
    assert sd < 0.03
    assert 0.5 < np.sqrt((away**2).sum() / (2 * len(own) - 3)) / sd < 1.5  # of 29 values


def test_typed_places_are_checked_by_the_pictures(folder):
    printed = read_sheet(folder / "raw" / "frame.toml")
    (folder / "raw" / "frame.toml").unlink()
    config = film_config("typed")
    typed = tuple(
        MarkerTable(name=f"R{m.marker}", marker=m.marker, role=m.role, size_mm=10.0,
                    position_mm=(round(50.0 - m.place_mm[0], 1), 11.5, round(m.place_mm[1], 1)))
        for m in printed.markers
    )  # fmt: skip
    x, y, z = typed[4].position_mm
    typed = (*typed[:4], typed[4].model_copy(update={"position_mm": (x + 1.0, y, z)}), *typed[5:])
    files.write_text(folder / "twin.toml", dump(config.model_copy(update={"frame": FrameTable(markers=typed)})))
    wanted = run_setup(folder, Lines(), yes=True)["wanted"]
    odd = [line for line in wanted if line.startswith("Marker ")]
    assert len(odd) == 1
    says(odd[0], typed[4].name, f"x = {x + 1.0:.2f}", f"x = {x:.1f}"[:-1], "pictures show")
    places = {m.marker: m.position_mm for m in Project.open(folder).config.frame.markers}
    for mark in printed.markers:
        np.testing.assert_allclose(places[mark.marker][::2], (50.0 - mark.place_mm[0], mark.place_mm[1]), atol=0.15)


def test_what_is_missing_is_said(folder):
    shutil.rmtree(folder / "raw" / "rig")
    for name in ("static.mkv", "log.csv", "frame.toml"):
        (folder / "raw" / name).unlink()
    shutil.rmtree(folder / "raw" / "board")
    wanted = "\n".join(run_setup(folder, told := Lines(), dry_run=True)["wanted"])
    says(told[-1], "Nothing is written", "--yes", "--dry-run")
    says(wanted, "No static film", "film.mkv", "No pictures of a board", "No pressure log", "stand still",
         "printed sheet", "34, 35")  # fmt: skip
    # Neither places of the template's rig nor its points stand for what the film shows.
    with pytest.raises(ValueError, match="nothing tells where the rig is, so twin"):
        run_setup(folder, say := Lines(), yes=True)
    assert not (folder / "twin.toml").exists()
    says("\n".join(say), "Points on the finger: ")
    assert "tip (id 0)" not in "\n".join(say)
    with pytest.raises(ValueError, match="no such folder"):
        run_setup(folder / "elsewhere", Lines())


def test_a_folder_without_film_has_no_page(require, tmp_path):
    require("nicegui")
    with pytest.raises(ValueError, match="there is nothing to show: No film"):
        run_setup(tmp_path, Lines())


# -- the page ------------------------------------------------------------------------------------------------

LONG_S = 600.0  # for the check, beside other tests: 8 s on two idle cores
PICTURE = "[...document.querySelectorAll('img')].find(i => i.naturalWidth === 800 && i.width > 400)"


@pytest.fixture
def served(folder):
    """Address of the page of the folder, and the process that serves it."""
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-c", "from twin.main import start; start()", "setup", str(folder)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment)
    said = ""
    while not (address := re.search(r"http://[0-9.:]+", said)):
        line = child.stdout.readline()
        assert line, said
        said += line
    yield address[0], child
    child.kill()
    child.wait()
    child.stdout.close()


def test_the_page_in_a_browser(require, folder, served, tmp_path):
    require("nicegui")
    require("chromium")
    url, child = served
    port = int(url.rpartition(":")[2])
    if (other := own_address()) not in (None, "127.0.0.1"):
        assert not answers(port, other)
    before = listing(folder)
    with Browser(tmp_path / "profile", width=1500, height=1300) as browser:
        browser.open(url)
        page = browser.until("static.mkv has 40 frames, wanted", "10 frame", "6 fixed", "4 finger", "not written yet", wait_s=LONG_S)
        says(page, "ruler_mm under [frame]", "The film starts at 34", "0 to 30 kPa", "film.mkv, 66 frames")
        x, y, width, _ = browser.value(f"(({{x, y, width, height}}) => [x, y, width, height])({PICTURE}.getBoundingClientRect())")

        def at(px, py):
            return x + px * width / 800, y + py * width / 800

        click = partial(browser.drag, at(764, 172), at(764, 172))  # on a tag of the rig
        browser.until("Tag 40 is", after=click)
        browser.press("ignore")
        clamp = partial(browser.drag, at(640, 118), at(610, 133))  # of the outline: 30 px to the left, 15 down
        browser.until("back to 0", after=clamp)
        browser.reload()  # what was done is kept, though it is not written
        assert "dialog beforeunload ''" in browser.told
        browser.until("back to 0", "5 fixed")
        browser.press("these are right")  # the square of the board
        browser.fill("length of solid silicone at the clamp, mm", "10")  # one after the other, none is lost
        browser.fill("thickness of the pleated top wall, mm", "2.7")
        browser.fill("ruler across, mm", "249.9")
        browser.fill("ruler upright, mm", "160")
        browser.until("Nothing is left to state")
        browser.fill("number of pleats (bellows)", "60")
        browser.until("model.finger.pleats = 60: each is")
        browser.until("5 fixed ones", wait_s=LONG_S)  # the check has run again
        assert listing(folder) == before  # nothing is written until it is asked for
        browser.press("Write twin.toml")
        browser.until("twin.toml is written")
    child.send_signal(signal.SIGINT)
    said, _ = child.communicate(timeout=LONG_S)
    assert child.returncode == 0
    says(said, "Wrote twin.toml", "frame.toml is kept as frame-0001.toml", "twin.toml has all that the page showed")
    assert "Traceback" not in said
    written = {k for k, v in listing(folder).items() if v != before.get(k)}
    assert {str(k) for k in written} == {"raw", "twin.toml", "raw/frame.toml", "raw/frame-0001.toml"}
    project = Project.open(folder)
    assert 40 not in [m.marker for m in project.config.frame.markers]
    own, board = project.config.model.finger, project.config.cameras[0].board
    assert (own.base_cap_mm, own.top_wall_mm, own.pleats, board.square_mm) == (10.0, 2.7, 9, 15.0)
    assert project.config.frame.ruler_mm == (249.9, 160.0)
    pose = project.config.pose
    assert (pose.x_mm, pose.z_mm) == pytest.approx((10.0, -5.0), abs=0.6)  # the finger points to the left
