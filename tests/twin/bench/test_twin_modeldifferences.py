"""Two projects whose fingers are modelled otherwise are not compared without a word."""

import shutil
from pathlib import Path

import pytest

from twin.bench.modeldifferences import other_models
from twin.project.folder import Project, dataset

CORPUS = Path(__file__).resolve().parents[2] / "corpora" / "deck"


def project(root: Path, old: str = "", new: str = "") -> Project:
    shutil.copytree(dataset("study"), root)
    toml = root / "twin.toml"
    assert old in toml.read_text()
    toml.write_text(toml.read_text().replace(old, new, 1))
    return Project.open(root)


def with_deck(root: Path, text: str) -> Project:
    made = project(root, "mesh = 1", 'mesh = 1\ndeck = "tube.inp"')
    (root / "tube.inp").write_text(text)
    shutil.copy(CORPUS / "mesh.inc", root)
    return made


def test_models_that_are_alike_need_no_word(tmp_path: Path) -> None:
    stated = "[model.finger]\nlength_mm = 110.0\n\n[measure]"
    assert other_models(project(tmp_path / "a"), project(tmp_path / "b", "[measure]", stated)) == ()
    deck = (CORPUS / "tube.inp").read_text()
    assert other_models(with_deck(tmp_path / "c", deck), with_deck(tmp_path / "d", deck)) == ()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[measure]", "[model.finger]\nlength_mm = 90.0\n\n[measure]", "length_mm 110 and 90"),
        ("mesh = 1", "mesh = 1\ndensity_kg_m3 = 1070.0\ngravity = [0.0, 0.0, -1.0]", "density_kg_m3 none and 1070"),
    ],
)
def test_other_dimensions_and_weights_are_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    (sentence,) = other_models(project(tmp_path / "a"), project(tmp_path / "b", old, new))
    assert sentence.startswith(f"a and b are not modelled alike: {told}. If the fingers are alike")


def test_another_deck_is_told(tmp_path: Path) -> None:
    deck = (CORPUS / "tube.inp").read_text()
    a, b = with_deck(tmp_path / "a", deck), with_deck(tmp_path / "b", deck.replace("0.08", "0.07"))
    assert "the mesh tube.inp and tube.inp" in other_models(a, b)[0]
