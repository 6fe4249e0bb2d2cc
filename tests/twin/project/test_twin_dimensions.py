"""[model.finger]: the built-in finger's dimensions, and one sentence for each that does not fit the others."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from fe import Finger
from twin.bodies.finger import FingerTable
from twin.commands.init import film_config, run_init
from twin.project.config import Config
from twin.project.toml import dump, parse


def read(lines: str) -> Config:
    text = f'[model.finger]\n{lines}\n[[points]]\nname = "tip"\nposition_mm = [80.0, 9.0, 0.0]\n[calibrate]\nobjective_points = ["tip"]\n'
    return parse(text.encode(), name="twin.toml")


def test_the_defaults_are_the_built_in_finger() -> None:
    own, known = FingerTable().finger, Finger()
    assert own.middle_node == pytest.approx(known.middle_node, abs=1e-12)
    assert {**vars(own), "middle_node": 0} == {**vars(known), "middle_node": 0}


def test_the_tip_and_the_middle_lie_on_the_finger_of_other_dimensions() -> None:
    table = read("length_mm = 80.0\nwidth_mm = 18.0\npleats = 6\npleat_depth_mm = 5.0").model.finger
    assert table is not None
    finger = table.finger
    assert (finger.bellows, finger.pleat) == (6, 2.5)
    assert finger.tip_node == (80.0, 9.0, 0.0)
    assert finger.base_cap < finger.middle_node[0] < 80.0 - finger.tip_cap
    assert finger.middle_node[1:] == (9.0, 0.0)


def test_rig_and_objective_follow_the_body(tmp_path: Path) -> None:
    run_init(tmp_path / "own", lambda text: None, body="finger:length_mm=92,width_mm=25")  # type: ignore[arg-type]
    config = parse((tmp_path / "own" / "twin.toml").read_bytes(), name="twin.toml")
    rig = np.array([marker.position_mm for marker in config.frame.markers])
    assert (rig[:, 0].min(), rig[:, 0].max()) == (-20.0, 102.0)  # 10 mm beyond the tip
    assert set(rig[:, 1]) == {13.0}  # before the marked side
    assert rig[:, 2].min() == -75.0
    own = "".join(f'[[points]]\nname = "p{k}"\nposition_mm = [{x}, 9.0, 0.0]\n' for k, x in enumerate((80, 12, 39, 60)))
    assert parse(own.encode(), name="twin.toml").objective_points == ("p0", "p2")  # the outermost, the middle one
    nodes = "".join(f'[[points]]\nname = "p{k}"\nnode = {k + 1}\n' for k in range(4))
    assert parse(nodes.encode(), name="twin.toml").objective_points == ("p3", "p1")


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        ("length_mm = -80.0", r"model.finger.length_mm = -80.0: it should be greater than 0 \(length from .*, mm\)"),
        ("length_mm = 12.0", r"length_mm = 12: the caps of 4 and 6 mm leave 2 mm for the chamber; wanted 5 mm or more"),
        ("width_mm = 10.0", r"width_mm = 10: side walls of 2 mm with pleats of 2.8 mm leave 0.2 mm .* wanted 1.5 mm"),
        ("side_wall_mm = 7.5", "width_mm = 23: side walls of 7.5 mm with pleats of 2.8 mm leave 1.2 mm"),
        ("height_mm = 12.0", r"height_mm = 12: .* leave -0.115 mm for the chamber in the valleys; wanted 2.5 mm"),
        ("edge_radius_mm = 3.5", "height_mm = 20: .* edges of radius 3.5 mm"),
        ("pleats = 40", r"pleats = 40: each is 2.5 mm long; wanted 3 mm or more for a top wall of 2 mm; state fewer"),
        ("pleats = 0", "pleats = 0: it should be greater than or equal to 1"),
        ("pleats = 14\nheight_mm = 30.0", r"pleat_depth_mm = 7.6: on pleats 7.14 mm long .* wanted 6.82 mm or less"),
        ('pleat_profile = "square"', "pleat_profile = 'square': it should be 'round' or 'flat'"),
        ("lenght_mm = 80.0", "model.finger.lenght_mm is not a known key; did you mean 'length_mm'"),
        ('top_wall_mm = "2"', "model.finger.top_wall_mm = '2': it should be a valid number"),
    ],
)
def test_a_mistake_gives_one_sentence(lines: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence) as caught:
        read(lines)
    assert str(caught.value).startswith("twin.toml: model.finger.")
    assert "\n" not in str(caught.value)


def test_what_a_sentence_offers_is_accepted() -> None:
    for lines in ("pleats = 14\nheight_mm = 30.0\npleat_depth_mm = 6.82", "width_mm = 12.6", "length_mm = 28.0\npleats = 1"):
        assert read(lines).model.finger is not None


def test_a_flat_profile_has_steeper_walls() -> None:
    deep = "pleats = 9\npleat_depth_mm = 8.5\nheight_mm = 24.0\n"
    assert read(deep).model.finger is not None
    with pytest.raises(ValueError, match="with a flat profile their walls are too steep"):
        read(deep + 'pleat_profile = "flat"')


def test_the_template_has_the_table_in_comments() -> None:
    lines = dump(film_config("batch")).splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("# [model.finger]"))
    block = list(islice(lines, start, start + 1 + len(FingerTable.model_fields)))
    assert all(f"# {key} = " in line for key, line in zip(FingerTable.model_fields, block[1:], strict=True))
    taken = [line.removeprefix("# ") if line in block else line for line in lines]
    assert parse("\n".join(taken).encode(), name="twin.toml").model.finger == FingerTable()
    stated = read("length_mm = 90.0")
    assert parse(dump(stated).encode(), name="twin.toml") == stated
