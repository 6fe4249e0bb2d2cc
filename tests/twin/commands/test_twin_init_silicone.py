"""A finger of another shape takes over what belongs to the silicone of a former one, and says what it leaves."""

from pathlib import Path

import pytest

from tests.messages import Lines
from twin.commands.init import run_init
from twin.effects.library import all_effects, effect
from twin.effects.mechanism import Owner
from twin.project.folder import Project
from twin.project.toml import dump

EFFECTS = ("creep:2", "stiffening", "wall_taper", "thermal", "camera_scale")


@pytest.fixture
def former(tmp_path: Path) -> Path:
    run_init(tmp_path / "a", Lines(), body="tube")
    config = Project.open(tmp_path / "a").config
    model = config.model.model_copy(update={"effects": EFFECTS, "law": "ogden1", "fixed": {"alpha": 3.0}, "density_kg_m3": 1080.0, "gravity": (0.0, 0.0, -1.0)})
    (tmp_path / "a" / "twin.toml").write_text(dump(config.model_copy(update={"model": model})), encoding="utf-8")
    return tmp_path / "a"


def test_the_silicone_goes_over_and_the_shape_and_the_rig_stay(former: Path, tmp_path: Path) -> None:
    say = Lines()
    run_init(tmp_path / "b", say, body="pneunet", like=former)
    made = Project.open(tmp_path / "b").config
    assert made.model.body == "pneunet"
    assert made.model.effects == ("creep:2", "stiffening")
    assert (made.model.law, made.model.fixed, made.model.density_kg_m3) == ("ogden1", {"alpha": 3.0}, 1080.0)
    assert made.model.gravity is None
    assert made.project.like is None  # its constants are not those of a batch on the same rig
    told = "\n".join(say.lines)
    assert "Of the silicone of a it has the law ogden1, creep:2, stiffening, alpha = 3 MPa, fixed and a density of 1080 kg/m3." in told
    assert "Left behind: wall_taper, of the other body's shape." in told
    assert "Left behind: thermal and camera_scale, of the other film and its rig." in told


def test_what_is_stated_of_the_new_finger_stands(former: Path, tmp_path: Path) -> None:
    run_init(tmp_path / "b", Lines(), body="tube:length_mm=60", like=former, density_kg_m3=1200.0)
    made = Project.open(tmp_path / "b").config.model
    assert made.density_kg_m3 == 1200.0
    assert made.tube is not None
    assert made.tube.length_mm == 60.0


def test_without_a_shape_like_is_the_next_batch_on_the_rig(former: Path, tmp_path: Path) -> None:
    run_init(tmp_path / "b", Lines(), like=former)
    assert Project.open(tmp_path / "b").config.model.effects == EFFECTS
    with pytest.raises(ValueError, match=r"leave out --targets.*or state --body"):
        run_init(tmp_path / "c", Lines(), like=former, sd_mm=0.1)


def test_every_effect_says_what_it_belongs_to() -> None:
    owners = {e.name: e.owner for e in all_effects()}
    assert {name for name, owner in owners.items() if owner is Owner.SILICONE} == {"creep", "stiffening", "mullins", "compressibility", "gravity"}
    assert {"wall_taper", "eccentric_core", "hoop_reinforcement", "strain_limiting_layer"} <= {name for name, owner in owners.items() if owner is Owner.BODY}
    assert effect("thermal:wide").owner is Owner.RIG  # a family belongs where its physics does
    assert effect("creep:wide").owner is Owner.SILICONE
