"""Mistakes of strangers, planted in a small drawn project: each is refused with the sentence it gets, by check
and by measure alone; unusual right inputs pass. All of them are tried by tests that are marked slow."""

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.few import few
from tests.strangers import mistakes, others, planted, planting, studio
from twin.commands.camera import run_camera
from twin.commands.check import run_check
from twin.commands.measure import run_measure
from twin.inputs.recordings import corrections_of
from twin.project.folder import Project

CHECKED = ("positions in cm", "log on another clock", "a finger id that never appears", "film starts in motion",
           "static film in motion", "dark film", "finger's markers lost", "boards not in the pictures")  # fmt: skip


@pytest.mark.parametrize("name", few(CHECKED, CHECKED[:1]))
def test_check_refuses_a_mistake_with_its_sentence(name: str, studio_project: Path, tmp_path: Path) -> None:
    plant, sentence = mistakes.MISTAKES[name]
    told = planted.told(name, plant, base=studio_project, folder=tmp_path, stages=("check",))
    assert told.refused
    assert re.search(sentence, told.sentence), told.sentence


ALONE = ("log on another clock", "finger's markers lost", "two frame ids exchanged", "film starts in motion")


@pytest.mark.parametrize("name", few(ALONE, ALONE[:1]))
def test_measure_alone_refuses_it_and_writes_no_targets(name: str, studio_project: Path, tmp_path: Path) -> None:
    plant, sentence = mistakes.MISTAKES[name]
    told = planted.told(name, plant, base=studio_project, folder=tmp_path, stages=("camera", "measure"))
    assert told.by == "measure"  # which asserts that there are no targets
    assert re.search(sentence if name != "finger's markers lost" else "nothing is measured", told.sentence), told.sentence


@pytest.mark.slow
def test_a_frame_marker_that_alone_is_off_is_left_out_of_the_frame(studio_project: Path, tmp_path: Path) -> None:
    name = "a frame marker 2 mm off"
    told = planted.told(name, mistakes.RIGHT[name], base=studio_project, folder=tmp_path)
    assert not told.refused, told.sentence
    assert any("'frame1' lies 2.0" in s and "kept as a fixed marker" in s for s in told.remarks)
    assert not any("frame_sd_mm" in s for s in told.remarks)  # the others keep what is stated


def test_check_draws_every_mark_and_doubts_nothing_of_what_is_right(studio_project: Path, tmp_path: Path) -> None:
    root, said = shutil.copytree(studio_project, tmp_path / "right"), planted.Lines()
    run_check(Project.open(root), said)
    assert not doubted(said)
    assert any(line.startswith("Wrote check.png: the first frame of raw/film.mkv") and "15 of 15 found" in line for line in said)
    picture = cv2.imread(str(root / "check.png"))
    assert picture.shape == (400, 640, 3)
    colour = picture.astype(int)
    rings = (colour[..., 1] > 200) & (colour[..., 0] < 140) & (colour[..., 2] < 90)
    for mark in studio.marks_of():
        x, y = planting.pixels(mark.name)
        assert rings[max(y - 40, 0) : y + 40, max(x - 40, 0) : x + 40].sum() > 60, mark.name


RECORDED = ("columns exchanged", "time in min", "a static film of one picture", "a film in slow motion",
            "a gap in the log", "the board as a plain chessboard", "boards out of focus")  # fmt: skip


@pytest.mark.parametrize("name", few(RECORDED, RECORDED[:1]))
def test_check_refuses_a_mistake_of_recording(name: str, studio_project: Path, tmp_path: Path) -> None:
    plant, sentence = planted.everything().mistakes[name]
    told = planted.told(name, plant, base=studio_project, folder=tmp_path, stages=("check",))
    assert re.search(sentence, told.sentence), told.sentence


DOUBTED = ("a clock that is off by 1 s", "a gauge that does not read zero", "a tip glued 4 mm short")


@pytest.mark.parametrize("name", few(DOUBTED, DOUBTED[:1]))
@pytest.mark.parametrize("stages", few([("check",), ("camera", "measure")], [("check",)]))
def test_a_doubt_is_told_by_check_and_by_measure(
    name: str, stages: tuple[str, ...], studio_project: Path, tmp_path: Path
) -> None:
    plant, sentence = planted.everything().doubtful[name]
    told = planted.told(name, plant, base=studio_project, folder=tmp_path, stages=stages)
    assert planted.is_told(told, sentence), (told.sentence, told.remarks)


def doubted(remarks: Sequence[str]) -> list[str]:
    return [s for s in remarks if "?" in s or "seen at" in s or "look" in s]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two cycles", "a small sag"])
def test_check_doubts_nothing_of_what_is_right(name: str, studio_project: Path, tmp_path: Path) -> None:
    told = planted.told(name, planted.everything().right[name], base=studio_project, folder=tmp_path, stages=("check",))
    assert not told.refused, told.sentence
    assert not doubted(told.remarks)


PARTS = 4  # of all that is planted, for workers side by side


def test_enough_is_planted() -> None:
    planted_things = planted.everything()
    wrong, doubtful = planted_things.mistakes | others.MISTAKES, planted_things.doubtful | others.DOUBTFUL
    assert len(wrong) + len(doubtful) >= 180
    assert len(planted_things.right | others.RIGHT) >= 45


FILES = ("an unknown law", "a deck in m", "skin elements", "a deck", "no sd", "a lost point as -1")


@pytest.mark.parametrize("name", FILES)
def test_what_files_of_others_say_is_told(name: str) -> None:
    (told,) = planted.others_told({name: others.everything()[name]})
    judged_file(told)


def judged_file(told: planted.Told) -> None:
    """A mistake is refused by its cause, a doubt told by it, and what is right passes."""
    if told.name in others.RIGHT:
        assert not told.refused, (told.name, told.sentence)
    elif told.name in others.DOUBTFUL:
        assert planted.is_told(told, others.DOUBTFUL[told.name][1]), (told.name, told.sentence, told.remarks)
    else:
        assert told.refused, told.name
        assert re.search(others.MISTAKES[told.name][1], told.sentence), (told.name, told.sentence)


@pytest.mark.slow
def test_all_files_of_others() -> None:
    for told in planted.others_told(others.everything()):
        judged_file(told)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_every_mistake_is_refused(part: int, studio_project: Path, tmp_path: Path) -> None:
    for name, (plant, sentence) in [*planted.everything().mistakes.items()][part::PARTS]:
        told = planted.told(name, plant, base=studio_project, folder=tmp_path)
        assert told.refused, name
        assert re.search(sentence, told.sentence), (name, told.sentence)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_every_doubt_is_told(part: int, studio_project: Path, tmp_path: Path) -> None:
    for name, (plant, sentence) in [*planted.everything().doubtful.items()][part::PARTS]:
        told = planted.told(name, plant, base=studio_project, folder=tmp_path)
        assert planted.is_told(told, sentence), (name, told.sentence, told.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_every_right_input_passes(part: int, studio_project: Path, tmp_path: Path) -> None:
    for name, plant in [*planted.everything().right.items()][part::PARTS]:
        told = planted.told(name, plant, base=studio_project, folder=tmp_path)
        assert not told.refused, (name, told.sentence)


HEAD = "marker,does,from_s,to_s,with,x_px,y_px,sd_px\n"


def mended(studio_project: Path, root: Path, lines: str) -> Project:
    """The right project with a tip that is hidden for 0.8 s, and corrections."""
    shutil.copytree(studio_project, root)
    mistakes.RIGHT["the tip hidden for a while"](root)
    (root / "raw" / "corrections.csv").write_text(HEAD + lines)
    text = (root / "twin.toml").read_text()
    (root / "twin.toml").write_text(re.sub(r"# corrections = \.\.\..*", 'corrections = "raw/corrections.csv"', text))
    return Project.open(root)


def test_places_clicked_by_hand_become_targets_with_the_sd_of_a_click(studio_project: Path, tmp_path: Path) -> None:
    rng, frames, sd = np.random.default_rng(2), np.arange(25, 33), 0.7
    place = studio.motion(studio.marks_of(), np.arange(studio.FRAMES) / 10.0)[:, -1]
    lens, (rvec, tvec) = studio.camera()
    seen = cv2.projectPoints(place[frames], rvec, tvec, lens.matrix, lens.distortion)[0].reshape(-1, 2)
    clicks = seen + sd * rng.standard_normal(seen.shape)
    lines = "".join(f"tip,place,{f / 10},,,{x:.2f},{y:.2f},{sd}\n" for f, (x, y) in zip(frames, clicks, strict=True))
    project = mended(studio_project, tmp_path / "mended", lines)
    said = planted.Lines()
    run_camera(project, said)
    run_measure(project, said)
    targets = project.targets()
    tip = targets.names.index("tip")
    assert targets.valid[frames, tip][:, [0, 2]].all()
    error = (targets.value[:, tip] - (place - place[0]))[:, [0, 2]]
    sds = np.sqrt(np.diagonal(targets.covariance[:, tip], axis1=1, axis2=2))[:, [0, 2]]
    np.testing.assert_allclose(sds[frames], sd / 3.2, rtol=0.03)  # 1350 px / 420 mm
    assert 0.6 < np.sqrt(np.mean((error[frames] / sds[frames]) ** 2)) < 1.4  # 16 values: sd 0.18
    assert np.abs(error[33:]).max() < 0.02
    budget = (project.path("runs/0002-measure") / "budget.csv").read_text()
    assert "by_hand" in budget


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("tpi,lost,1,2,,,,", r"line 2, column marker: 'tpi': wanted one of frame0"),
        ("tip,gone,1,2,,,,", r"column does: 'gone': wanted one of lost, swap, place"),
        ("tip,swap,1,2,nobody,,,", r"column with: 'nobody'"),
        ("tip,lost,1,,,,,", r"line 2: to_s is missing; wanted it in s for 'lost'"),
        ("tip,lost,2,1,,,,", r"wanted 2 s or later"),
        ("tip,place,1,,,,200,", r"x_px is missing; wanted it in px"),
        ("tip,place,one,,,1,1,", r"'one': wanted a finite number in s"),
    ],
)
def test_a_line_of_corrections_that_is_not_right_is_named(line: str, sentence: str, studio_project: Path, tmp_path: Path) -> None:
    root = tmp_path / "wrong"
    (root / "raw").mkdir(parents=True)
    (root / "raw" / "corrections.csv").write_text(HEAD + line + "\n")
    text = (studio_project / "twin.toml").read_text()
    (root / "twin.toml").write_text(re.sub(r"# corrections = \.\.\..*", 'corrections = "raw/corrections.csv"', text))
    project = Project.open(root)
    with pytest.raises(ValueError, match=sentence):
        corrections_of(project, project.config.cameras[0])


def test_check_tells_when_a_film_starts_that_nobody_noted(studio_project: Path, tmp_path: Path) -> None:
    root, said = Path(shutil.copytree(studio_project, tmp_path / "noted")), planted.Lines()
    lines = (root / "twin.toml").read_text().splitlines()
    unstated = [line for line in lines if not line.startswith(("film_start_s", "join"))]
    (root / "twin.toml").write_text("\n".join(unstated))
    project = Project.open(root)
    assert len(unstated) == len(lines) - 2
    assert project.config.pressure.join == "onset"
    run_check(project, said)
    told = next(line for line in said if "the finger moves as pressure.csv tells" in line)
    start = float(re.search(r"starts at ([0-9.]+) s", told)[1])
    assert abs(start - studio.FILM_START) < 0.15, told


@pytest.mark.slow
def test_a_frame_rate_for_a_video_file_is_told(studio_project: Path, tmp_path: Path) -> None:
    told = planted.told("fps", planting.camera_with(fps=20.0), base=studio_project, folder=tmp_path, stages=("check",))
    assert any("cameras.fps = 20 is for pictures: film.mkv is a video file" in s for s in told.remarks)


@pytest.mark.slow
def test_check_sends_back_to_measure_where_the_targets_are_gone(studio_project: Path, tmp_path: Path) -> None:
    root, said = Path(shutil.copytree(studio_project, tmp_path / "gone")), planted.Lines()
    run_camera(Project.open(root), said)
    run_measure(Project.open(root), said)
    assert run_check(Project.open(root), said)["next"] == "calibrate"
    shutil.rmtree(root / "targets")
    assert run_check(Project.open(root), said)["next"] == "measure"
