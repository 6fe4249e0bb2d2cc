"""What is odd in a deck without being surely wrong is told: its size, a compressible silicone, stiff parts."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from twin.model.structure import base_case, of_deck, size_doubt

CORPUS = Path(__file__).resolve().parents[2] / "corpora" / "deck"
LAW = "0.18D0, 0.06, 0.005"


def remarks(folder: Path, *changes: tuple[str, str], silicone: tuple[str, ...] = ()) -> str:
    text = (CORPUS / "tube.inp").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "tube.inp").write_text(text)
    (folder / "mesh.inc").write_bytes((CORPUS / "mesh.inc").read_bytes())
    return " ".join(of_deck(folder / "tube.inp", silicone=silicone).remarks)


def test_a_deck_that_is_right_raises_no_doubt(tmp_path: Path) -> None:
    assert "?" not in remarks(tmp_path)
    assert size_doubt(base_case()) == ""


def test_a_compressible_silicone_is_told(tmp_path: Path) -> None:
    told = remarks(tmp_path, (LAW, "0.18, 0.06, 0.49"))  # Poisson's ratio in place of D1
    assert "its bulk modulus is 8.5 times its shear modulus" in told
    assert "?" not in remarks(tmp_path, (LAW, "0.18, 0.06, 0.05"))


@pytest.mark.parametrize(("law", "told"), [("800, 0, 0.001", ""), ("180000, 60000, 1e-9", "as stiff as metal: .* 4.8e\\+05 MPa")])
def test_a_part_that_stays_is_named_with_its_stiffness(tmp_path: Path, law: str, told: str) -> None:
    section = '*Solid section, elset="All of it", material=Ecoflex'
    two = (
        f"*Elset, elset=Soft, generate\n501, 531\n*Elset, elset=Stiff\n532,\n*Solid section, elset=Stiff, material=Nylon\n,\n"
        f"{section.replace(chr(34) + 'All of it' + chr(34), 'Soft')}"
    )
    nylon = f"*Material, name=NYLON\n*hyperelastic, mooney-rivlin\n{law}\n*Boundary"
    said = remarks(tmp_path, (section, two), ("*Boundary", nylon), silicone=("Soft",))
    assert re.search(r"The material of stiff \(shear modulus [\d.e+]+ MPa\) stays", said), said
    assert re.search(told, said) if told else "metal" not in said


def test_a_finger_of_some_centimetres_in_length_is_told() -> None:
    case = base_case()
    assert "The finger is 11 mm long. Is it in cm?" in size_doubt(replace(case, nodes=0.1 * case.nodes))
