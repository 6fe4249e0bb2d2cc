"""Recordings of one pressure each, in a folder: places, base, markers off the surface, names."""

from pathlib import Path

import numpy as np
import pytest

from tests.messages import Lines
from twin.bodies.kinds import BODIES
from twin.commands.init import run_init
from twin.formats.catalogue import read_recorded
from twin.formats.conversion import NO_COURSE, targets_of
from twin.formats.importtable import ImportTable
from twin.formats.takes import pressure_in, takes_targets
from twin.inputs.elsewhere import import_targets
from twin.marktables import PointTable
from twin.model.structure import body_case
from twin.project.folder import Project
from twin.project.toml import dump, parse
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


# -- several recordings of [[import]] --------------------------------------------------------------------------


def recordings(folder: Path, *, unit: str = "_m", exchanged: bool = False) -> Path:
    """Two recordings with a log each, in metres, on a base that shifts by (0.4, 0, 0.2) mm and turns by
    2 mrad while the tip falls by 10 or 20 mm; first 5 rows are off by 0.5 mm."""
    folder.mkdir()
    rest = np.array([[44.0, 11.5, 0.0], *BASE])
    for name, fall in (("run - 1", 10.0), ("run - 2", 20.0)):
        share = np.clip((np.arange(80.0) - 20) / 40, 0, 1)
        place = np.array([rest - [[0.1 * fall * s, 0, fall * s], *[[0.0] * 3] * 3] for s in share])
        place = np.array([p @ turn(2e-3 * s).T + [0.4 * s, 0, 0.2 * s] for p, s in zip(place, share, strict=True)])
        place[:5] += 0.5
        place += np.random.default_rng(1).normal(0, 0.01, place.shape)
        names = [1, 0, 2, 3] if exchanged and fall == 20 else range(4)
        header = ",".join(f"{('tip - 1', 'b 1', 'b 2', 'b 3')[k]}_{axis}{unit}" for k in names for axis in "xyz")
        rows = np.column_stack([0.1 * np.arange(80.0), 1e-3 * place.reshape(80, -1)])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=f"time_s,{header}", comments="")
        log = np.column_stack([0.1 * np.arange(-5.0, 90.0), np.interp(np.arange(-5, 90), np.arange(80), fall * share)])
        np.savetxt(folder / f"{name} log.csv", log, delimiter=",", header="time_s,pressure_kPa", comments="")
    return folder


def project_of(folder: Path, source: Path, say: Lines, *stated: str, **words: object) -> Project:
    run_init(folder, say, targets=source, form="csv", nodes=["tip - 1=44,11.5,0"], sd_mm=0.01,
             finger=("length_mm=44", "pleats=3"), **words)  # type: ignore[arg-type]
    text = (folder / "twin.toml").read_text().replace("# base = ...", 'base = ["b 1", "b 2", "b 3"]')
    text = text.replace("base = []", 'base = ["b 1", "b 2", "b 3"]').replace("first_step = 0", "first_step = 5")
    for old, new in zip(stated[::2], stated[1::2], strict=True):
        assert old in text
        text = text.replace(old, new)
    (folder / "twin.toml").write_text(text)
    return Project.open(folder)


def test_recordings_with_a_log_each_become_blocks_without_the_motion_of_their_base(tmp_path: Path) -> None:
    say = Lines()
    project = project_of(tmp_path / "p", recordings(tmp_path / "runs"), say, hold_out=["run - 2"])
    assert [(t.name, t.file, t.log, t.held_out) for t in project.config.imports] == [
        (f"run_{k}", f"raw/runs/run - {k}.csv", f"raw/runs/run - {k} log.csv", k == 2) for k in (1, 2)]  # fmt: skip
    t, rows = import_targets(project, say)
    assert [row.name for row in rows] == ["run_1", "run_2"]
    assert t.held_out.tolist() == [False] * 75 + [True] * 75
    assert t.has_log
    ends = t.value[[74, 149], 0]
    np.testing.assert_allclose(ends, [[-1, 0, -10], [-2, 0, -20]], atol=0.06)  # with the base off by 0.4 mm
    np.testing.assert_allclose(t.pressure[[74, 149]], [0.01, 0.02], atol=1e-6)
    assert t.noise is not None
    np.testing.assert_allclose(t.noise.sd[0], [0.015, 0.024, 0.030], atol=0.003)  # with the base's own
    assert any("run_1: The base (b_1, b_2, b_3) moves by up to" in line for line in say.lines)
    assert not any("filter" in line for line in say.lines)


def test_of_a_recording_what_is_silent_is_told(tmp_path: Path) -> None:
    source, say = recordings(tmp_path / "runs"), Lines()
    project = project_of(tmp_path / "p", source, say, 'base = ["b 1", "b 2", "b 3"]', "base = []",
                         "first_step = 5", "first_step = 0")  # fmt: skip
    import_targets(project, say)
    assert any("In the first 5 rows b_1, b_2, b_3, which stay, jump by up to" in line for line in say.lines)
    assert any('base = ["b_1", "b_2", "b_3"] under [import] takes its motion off' in line for line in say.lines)
    swapped = project_of(tmp_path / "q", recordings(tmp_path / "swapped", exchanged=True), say)
    with pytest.raises(ValueError, match="run_2: marker tip_1 lies at rest where b_1 lies in run_1"):
        import_targets(swapped, say)
    with pytest.raises(ValueError, match="none of which is in"):
        import_targets(project_of(tmp_path / "r", source, say, '["b 1", "b 2", "b 3"]', '["b 1", "b 2"]'), say)
    with pytest.raises(ValueError, match=r"import.name = 'run_1' stands twice in \[\[import\]\]"):
        project_of(tmp_path / "s", source, say, 'name = "run_2"', 'name = "run_1"')


def test_a_step_known_by_its_top_has_an_sd_of_its_pressure(tmp_path: Path) -> None:
    say = Lines()
    source = recordings(tmp_path / "runs", unit="")
    for log in source.glob("*log.csv"):
        log.unlink()
    with pytest.raises(ValueError, match=r"run_1: .* wanted unit"):
        import_targets(project_of(tmp_path / "o", source, say, "top_kPa = ...", "top_kPa = 1.0"), say)
    project = project_of(tmp_path / "p", source, say, "# top_kPa = ...", "top_kPa = 10.0", unit="m")
    t, _ = import_targets(project, say)
    assert (len(t.time), t.has_log) == (4, False)
    np.testing.assert_allclose(t.pressure_error, [0, 2e-4, 0, 2e-4])
    np.testing.assert_allclose(t.value[[1, 3], 0], [[-1, 0, -10], [-2, 0, -20]], atol=0.6)  # the hold begins at 0.9
    settling = [k for k, name in enumerate(t.mode_names) if name.startswith("settling")]
    assert np.abs(t.modes[settling][:, 1::2]).max() > 0.1
    assert any("known, 10 kPa with an sd of 0.2 kPa" in line for line in say.lines)
    assert parse(dump(project.config).encode(), name="twin.toml") == project.config


def test_a_body_that_a_weight_moves_has_no_pressure(tmp_path: Path) -> None:
    found = read_recorded(recordings(tmp_path / "runs") / "run - 1.csv", "csv")
    table = ImportTable(file="a.csv", format="csv", sd_mm=0.01, first_step=5, top_kPa=0.0, base=("b 1", "b 2", "b 3"))
    t, told = targets_of(found, table, [PointTable(name="tip_1", position_mm=(44.0, 11.5, 0.0))])
    assert t.pressure.tolist() == t.pressure_error.tolist() == [0.0, 0.0]
    np.testing.assert_allclose(t.value[1, 0], [-1, 0, -10], atol=0.4)
    assert NO_COURSE not in told
    assert not any("pressure" in line for line in told)


def test_what_a_hand_holds_may_stand_off_as_far_as_each_point_moves(tmp_path: Path) -> None:
    found = read_recorded(recordings(tmp_path / "runs") / "run - 1.csv", "csv")
    table = ImportTable(file="a.csv", format="csv", sd_mm=0.01, first_step=5, top_kPa=0.0, base=("b 1", "b 2", "b 3"))
    points = [PointTable(name="tip_1", position_mm=(44.0, 11.5, 0.0)), PointTable(name="b_3", position_mm=(0.0, 0.0, 0.0))]
    table = table.model_copy(update={"base": ()})
    with pytest.raises(ValueError, match=r"hold_sd_mm = 1.5 without released = true"):
        targets_of(found, table.model_copy(update={"hold_sd_mm": 1.5}), points)
    t, _ = targets_of(found, table.model_copy(update={"hold_sd_mm": 1.5, "released": True}), points)
    held = [k for k, name in enumerate(t.mode_names) if name.startswith("hold:")]
    share = np.linalg.norm(t.value[1], axis=1) / np.linalg.norm(t.value[1], axis=1).max()
    sizes = t.modes[held][:, 1].reshape(2, 3, 6)
    np.testing.assert_allclose(sizes.max(axis=2), 1.5 * np.repeat(share, 3).reshape(2, 3), atol=1e-12)
    assert ((sizes != 0).sum(axis=2) == 1).all()  # each of its own point and direction
    assert not t.modes[held][:, 0].any()  # at rest nothing is measured
