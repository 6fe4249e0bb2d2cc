"""Recordings of one pressure each, in a folder: places, base, markers off the surface, names."""

from pathlib import Path

import numpy as np
import pytest

from tests.messages import Lines
from twin.bodies.kinds import BODIES
from twin.commands.init import run_init
from twin.formats.takes import pressure_in, takes_targets
from twin.marktables import PointTable
from twin.model.structure import body_case
from twin.project.folder import Project
from twin.targets import Array, Targets

BODY = BODIES["tube"].model_validate({"length_mm": 40.0, "offset_mm": 1.0}).body
CASE = body_case(BODY, BODY.lattice)
BALLS = {"a": [40.0, 0.0, -5.0], "b": [40.0, 13.0, 8.0], "c": [40.0, -13.0, 8.0]}  # 5 mm off the tube
BASE = [[-3.0, 0.0, 30.0], [-3.0, 20.0, 5.0], [-3.0, -20.0, 5.0]]
NAMES = ("a", "b", "c", "base 1", "base-2", "base_3")


def turn(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def written(folder: Path, *, exchanged: bool = False) -> Path:
    """Three recordings: the cap turns by 1 rad/MPa times the pressure, the base by a hundredth of it."""
    folder.mkdir()
    rest = np.array([*BALLS.values(), *BASE])
    for name, kPa in (("a run_100mbar.csv", 10.0), ("a run_20 kPa.csv", 20.0), ("a run-300mbar.csv", 30.0)):
        angle, rows = 1e-2 * kPa, []
        cap = (rest[:3] - [0, 0, 8.0]) @ turn(angle).T + [0, 0, 8.0] - [0.02 * kPa, 0.0, 0.3 * kPa]
        end = np.concatenate([cap, rest[3:]]) @ turn(angle / 100).T + [0.1, 0.0, 0.2]
        for share in (0.0, 0.4, *[1.0] * 4):  # in the room, x is down and the place another
            place = rest + share * (end - rest)
            rows.append((place @ np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]]) + [500.0, 20.0, 7.0]).ravel())
        order = [1, 0, 2, 3, 4, 5] if exchanged and kPa == 30 else range(6)
        header = ",".join(f"{NAMES[k]}_{axis}_mm" for k in order for axis in "xyz")
        np.savetxt(folder / name, np.array(rows), delimiter=",", header=header, comments="")
    return folder


def found(folder: Path, *held_out: str, off: float = 0.0) -> tuple[Targets, dict[str, PointTable], list[str]]:
    places = {name: np.array(x) for name, x in BALLS.items()}
    places["b"] = places["b"] + [off, 0.0, 0.0]
    return takes_targets(folder, places, case=CASE, outside=CASE.face_nodes("outside"), sd_mm=0.02, axes="z,y,-x",
                         held_out=held_out)  # fmt: skip


def test_markers_stand_off_the_cap_and_the_base_is_taken_off(tmp_path: Path) -> None:
    t, points, remarks = found(written(tmp_path / "takes"), "300mbar")
    np.testing.assert_allclose(t.pressure[1::2], [0.01, 0.02, 0.03])
    assert t.held_out.tolist() == [False] * 4 + [True] * 2
    assert t.names == ("a", "b")  # half a tube: c would stand where b stands
    assert [(p.position_mm, p.standoff_mm) for p in points.values()] == [
        ((40.0, 0.0, -5.0), pytest.approx(5.0)), ((40.0, 13.0, 8.0), pytest.approx(5.0))]  # fmt: skip
    for k, kPa in enumerate((10.0, 20.0, 30.0)):
        for p, name in enumerate("ab"):
            foot = np.array(BALLS[name])
            wanted = (foot - [0, 0, 8.0]) @ turn(1e-2 * kPa).T + [0, 0, 8.0] - [0.02 * kPa, 0.0, 0.3 * kPa] - foot
            np.testing.assert_allclose(t.value[2 * k + 1, p], wanted, atol=1e-5)
    told = " ".join(remarks)
    assert "base_1, base-2, base_3 move by at most" in told.replace("base_2", "base-2")
    assert "Markers off the surface, which turn with it rigidly: a 5.0, b 5.0, c 5.0 mm." in told


def test_markers_lie_to_each_other_as_they_are_recorded_not_as_they_are_stated(tmp_path: Path) -> None:
    folder = written(tmp_path / "takes")
    right, rough = found(folder), found(folder, off=3.0)
    assert any("differ from the recorded ones at rest by up to 2 mm (b)" in line for line in rough[2])
    shift = np.array([1.0, 0.0, 0.0])  # of the mean of three, all of which the recordings have 3 mm apart
    for name in "ab":
        before, after = (np.array(side[1][name].position_mm) for side in (right, rough))
        np.testing.assert_allclose(after, before + shift, atol=1e-6)


def test_what_cannot_be_is_refused_with_its_cause(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"marker b lies at rest where a lies in a run_100mbar\.csv: their names are"):
        found(written(tmp_path / "exchanged", exchanged=True))
    with pytest.raises(ValueError, match=r"--node b: to the other markers it lies 6\.7 mm elsewhere than in the rec"):
        found(written(tmp_path / "far"), off=10.0)
    with pytest.raises(ValueError, match="--hold-out 999mbar: in no file's name"):
        found(written(tmp_path / "held"), "999mbar")
    with pytest.raises(ValueError, match=r"run\.csv states no pressure"):
        pressure_in("run.csv")
    with pytest.raises(ValueError, match="several pressures"):
        pressure_in("10kPa to 20kPa.csv")


def test_init_makes_a_project_of_a_folder_of_recordings(tmp_path: Path) -> None:
    say = Lines()
    nodes = [f"{name}={','.join(map(str, x))}" for name, x in BALLS.items()]
    run_init(tmp_path / "p", say, targets=written(tmp_path / "takes"), body="tube:length_mm=40,offset_mm=1",
             nodes=nodes, axes="z,y,-x", sd_mm=0.02, pressure_from="name", hold_out=("300mbar",))  # fmt: skip
    project = Project.open(tmp_path / "p")
    assert project.targets().held_out.sum() == 2
    assert project.targets().noise is not None
    assert len(list((tmp_path / "p" / "raw" / "recordings").iterdir())) == 3
    assert any("off the surface" in line for line in say.lines)
    assert [point.standoff_mm for point in project.config.points] == [5.0, 5.0]
