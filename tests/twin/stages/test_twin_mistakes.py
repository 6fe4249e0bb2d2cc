"""Mistakes of strangers, planted in a small drawn project: each is refused with the sentence it gets, by check
and by measure alone; unusual right inputs pass. All of them are tried by the test that is marked slow."""

import re
from pathlib import Path
from types import ModuleType

import cv2
import pytest

from twin.project.folder import Project
from twin.stages.checking import run_check

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def mistakes() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        import strangers_mistakes
    return strangers_mistakes


@pytest.fixture(scope="module")
def base(mistakes: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(mistakes.make(tmp_path_factory.mktemp("strangers") / "base"))


CHECKED = ("positions in cm", "a finger id that never appears", "film starts in motion", "static film in motion",
           "dark film", "finger's markers lost", "log on another clock", "boards not in the pictures")  # fmt: skip


@pytest.mark.parametrize("name", CHECKED)
def test_check_refuses_a_mistake_with_its_sentence(name: str, mistakes: ModuleType, base: Path, tmp_path: Path) -> None:
    plant, sentence = mistakes.MISTAKES[name]
    told = mistakes.told(name, plant, base=base, folder=tmp_path, stages=("check",))
    assert told.refused
    assert re.search(sentence, told.sentence), told.sentence


ALONE = ("two frame ids exchanged", "film starts in motion", "finger's markers lost", "log on another clock")


@pytest.mark.parametrize("name", ALONE)
def test_measure_alone_refuses_it_and_writes_no_targets(name: str, mistakes: ModuleType, base: Path, tmp_path: Path) -> None:
    plant, sentence = mistakes.MISTAKES[name]
    told = mistakes.told(name, plant, base=base, folder=tmp_path, stages=("camera", "measure"))
    assert told.by == "measure"  # which asserts that there are no targets
    assert re.search(sentence if name != "finger's markers lost" else "nothing is measured", told.sentence), told.sentence


def test_a_frame_marker_that_alone_is_off_is_left_out_of_the_frame(mistakes: ModuleType, base: Path, tmp_path: Path) -> None:
    name = "a frame marker 2 mm off"
    told = mistakes.told(name, mistakes.RIGHT[name], base=base, folder=tmp_path)
    assert not told.refused, told.sentence
    assert any("'frame1' lies 2.0" in s and "kept as a fixed marker" in s for s in told.remarks)
    assert not any("frame_sd_mm" in s for s in told.remarks)  # the others keep what is stated


def test_check_draws_every_mark(mistakes: ModuleType, base: Path, tmp_path: Path) -> None:
    said = mistakes.Lines()
    run_check(Project.open(base), said)
    assert any(line.startswith("Wrote check.png: the first frame of raw/film.mkv") and "15 of 15 found" in line for line in said)
    picture = cv2.imread(str(base / "check.png"))
    assert picture.shape == (400, 640, 3)
    colour = picture.astype(int)
    rings = (colour[..., 1] > 200) & (colour[..., 0] < 140) & (colour[..., 2] < 90)
    for mark in mistakes.marks_of():
        x, y = mistakes.pixels(mark.name)
        assert rings[max(y - 40, 0) : y + 40, max(x - 40, 0) : x + 40].sum() > 60, mark.name


@pytest.mark.slow
def test_every_mistake_is_refused_and_every_right_input_passes(mistakes: ModuleType, base: Path, tmp_path: Path) -> None:
    assert len(mistakes.MISTAKES) >= 25
    assert len(mistakes.RIGHT) >= 10
    for name, (plant, sentence) in mistakes.MISTAKES.items():
        told = mistakes.told(name, plant, base=base, folder=tmp_path)
        assert told.refused, name
        assert re.search(sentence, told.sentence), (name, told.sentence)
    for name, plant in mistakes.RIGHT.items():
        told = mistakes.told(name, plant, base=base, folder=tmp_path)
        assert not told.refused, (name, told.sentence)
