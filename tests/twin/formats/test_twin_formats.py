"""Files of other programs as targets: their columns, what counts as not seen, units, axes, times, and refusals."""

import contextlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from tests.messages import Lines, saying
from twin.chain import stage_of
from twin.commands.check import check_project
from twin.commands.init import run_init
from twin.diagnosis.procedure import _refusal
from twin.fitmemory import MOST_BYTES, MOST_STEPS, bytes_of
from twin.formats.catalogue import FORMATS, format_of, read_recorded
from twin.formats.conversion import NO_COURSE, targets_of
from twin.formats.importtable import ImportTable
from twin.formats.recorded import Recorded
from twin.formats.supplied import mm_per_unit, still_wanted, turned
from twin.marktables import PointTable
from twin.project.cameratables import RecordingTable
from twin.project.folder import Project
from twin.project.targetfiles import read_targets, write_targets
from twin.project.toml import with_key
from twin.targets import PointKind, Targets

# Two points over four steps along the file's x and y: the truth that every file below holds.
TIP = np.array([[110.0, 50.0], [109.0, 56.0], [105.0, 70.0], [98.0, 81.0]])
MIDDLE = np.array([[60.0, 50.0], [59.5, 52.0], [58.0, 57.0], [56.0, 61.0]])
XY = np.stack([TIP, MIDDLE], axis=1)  # (s,p,2)
DEPTH = np.array([[7.0, 7.0], [7.1, 7.0], [7.2, 7.1], [7.3, 7.1]])  # (s,p) z


def deeplabcut(folder: Path, *, animals: bool = False) -> Path:
    scorer = "DLC_resnet50_fingerOct12shuffle1_100000"
    levels = [["scorer"] + 6 * [scorer], ["individuals"] + 3 * ["a"] + 3 * ["b"], ["bodyparts"] + 3 * ["tip"] + 3 * ["middle"], ["coords"] + 2 * ["x", "y", "likelihood"]]
    rows = [[k, *t, 0.99, *m, 0.2 if k == 2 else 0.98] for k, (t, m) in enumerate(zip(TIP, MIDDLE))]
    text = "\n".join(",".join(map(str, row)) for row in [*(levels if animals else [levels[0], *levels[2:]]), *rows])
    return written(folder / "film.csv", text)


def anipose(folder: Path, *, cameras: float = 1.0, score: float = 0.95) -> Path:
    head = [f"{n}_{c}" for n in ("tip", "middle") for c in ("x", "y", "z", "error", "ncams", "score")]
    head += [f"M_{i}{j}" for i in range(3) for j in range(3)] + [f"center_{i}" for i in range(3)] + ["fnum"]
    rows = []
    for k in range(4):
        row: list[object] = []
        for p in range(2):
            seen = k != 2 or p == 0
            row += [*XY[k, p], DEPTH[k, p], 0.5, 3.0 if seen else cameras, 0.95 if seen else score]
        rows.append([*row, *np.eye(3).ravel(), 0.0, 0.0, 0.0, k])
    return written(folder / "pose.csv", "\n".join(",".join(map(str, row)) for row in [head, *rows]))


def dice(folder: Path) -> Path:
    for k in range(4):
        stars = "***\n*** Digital Image Correlation Engine (DICe), Copyright 2021\n*** Subset size: 27\n***\n"
        head = "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,GAMMA,BETA,STATUS_FLAG,UNCERTAINTY\n"
        rows = ""
        for p in range(2):
            failed = (k, p) == (2, 1)
            moved = XY[k, p] - XY[0, p] if not failed else (0.0, 0.0)
            rows += f"{p},{XY[0, p, 0]:.4E},{XY[0, p, 1]:.4E},{moved[0]:.4E},{moved[1]:.4E},{-1.0 if failed else 5.0e-3:.4E},1.0E-02,0.0E+00,4.0E+00,1.0E-02\n"
        written(folder / f"DICe_solution_{k:02d}.txt", stars + head + rows)
    return folder


def matchid(folder: Path, *, head: str = "X [mm];Y [mm];U [mm];V [mm]", comma: bool = True) -> Path:
    separator = ";" if ";" in head else ","
    for k in (8, 9, 11, 10):  # by number, not by letters: 8 and 9 are the first
        step, rows = k - 8, ""
        for p in range(2):
            lost = (step, p) == (2, 1)
            moved = ["", ""] if lost else [repr(float(v)) for v in XY[step, p] - XY[0, p]]
            rows += separator.join([*(repr(float(v)) for v in XY[0, p]), *moved]) + "\n"
        written(folder / f"film_{k}.csv", head + "\n" + (rows.replace(".", ",") if comma else rows))
    return folder


def c3d(folder: Path) -> Path:
    import ezc3d

    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [50.0]
    content["parameters"]["POINT"]["LABELS"]["value"] = ("tip", "middle")
    content["parameters"]["POINT"]["UNITS"]["value"] = ("m",)
    points = np.ones((4, 2, 4))
    points[:2] = 1e-3 * np.moveaxis(XY, 0, -1).swapaxes(0, 1)
    points[2] = 1e-3 * DEPTH.T
    residuals = np.zeros((1, 2, 4))
    residuals[0, 1, 2] = -1.0
    content["data"]["points"] = points
    content["data"]["meta_points"] = {"residuals": residuals, "camera_masks": np.zeros((7, 2, 4), dtype=bool)}
    content.write(str(folder / "take.c3d"))
    return folder / "take.c3d"


def csv(folder: Path) -> Path:
    rows = [f"{0.02 * k};{TIP[k, 0]};{TIP[k, 1]};{'' if k == 2 else MIDDLE[k, 0]};{'' if k == 2 else MIDDLE[k, 1]};{10.0 * k}" for k in range(4)]
    head = "time_s;tip_x_mm;tip_y_mm;middle_x_mm;middle_y_mm;p [kPa]"
    return written(folder / "points.csv", (head + "\n" + "\n".join(rows)).replace(".", ","))


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


WRITERS: dict[str, Callable[[Path], Path]] = {
    "deeplabcut": deeplabcut, "anipose": anipose, "dice": dice, "matchid": matchid, "c3d": c3d, "csv": csv
}  # fmt: skip
NAMES = {"dice": ("s0", "s1"), "matchid": ("p1", "p2")}
PIXELS = ("deeplabcut", "dice")
LOG = "time_s,p [kPa]\n" + "".join(f"{0.01 * k:.2f},{5.0 * k}\n" for k in range(9))  # 10 kPa at each 0.02 s


def stated(form: str, **changes: object) -> ImportTable:
    given: dict[str, object] = {
        "file": "raw/file", "format": form, "sd_mm": 0.2, "axes": "x,0,-y", "fps": 50.0,
        "log": None if form == "csv" else "log.csv", "mm_per_px": 0.5 if form in PIXELS else None,
    }  # fmt: skip
    return ImportTable(**{**given, **changes})  # type: ignore[arg-type]


def made(folder: Path, found: Recorded, table: ImportTable, **nodes: int) -> tuple[Targets, list[str]]:
    """Targets of points at these nodes, with the log below a folder."""
    log = None if table.log is None else folder / table.log
    if log is not None and not log.exists():
        written(log, LOG)
    return targets_of(found, table, [PointTable(name=n, node=k) for n, k in nodes.items()], log=log)


def test_every_format_is_tried_here_and_in_twin_toml() -> None:
    assert set(WRITERS) == set(FORMATS) == set(get_args(ImportTable.model_fields["format"].annotation))


@pytest.mark.parametrize("form", WRITERS)
def test_a_file_shows_its_format(tmp_path: Path, form: str) -> None:
    assert format_of(WRITERS[form](tmp_path)) == form


@pytest.mark.parametrize("form", WRITERS)
def test_a_file_becomes_displacements_in_world_axes(tmp_path: Path, form: str) -> None:
    (tmp_path / "in").mkdir()
    found = read_recorded(WRITERS[form](tmp_path / "in"), form)
    tip, middle = NAMES.get(form, ("tip", "middle"))
    targets, _ = made(tmp_path, found, stated(form), **{tip: 4401, middle: 5848})
    scale = 0.5 if form in PIXELS else 1.0
    wanted = np.stack([XY[..., 0] - XY[0, :, 0], np.full((4, 2), np.nan), XY[0, :, 1] - XY[..., 1]], axis=-1) * scale
    wanted[2, 1] = np.nan  # unlikely, failed or lost: not seen
    # c3d holds single precision of m: 1e-7 of 0.1 m
    np.testing.assert_allclose(targets.value, wanted, rtol=0, atol=2e-5)
    np.testing.assert_allclose(targets.time, 0.02 * np.arange(4), rtol=0, atol=1e-12)
    np.testing.assert_allclose(targets.pressure, 0.01 * np.arange(4), rtol=0, atol=1e-12)
    assert targets.valid.sum() == 10  # 3 steps after the reference, 2 points, 2 components, but for the one not seen
    assert not targets.valid[0].any()
    assert targets.covariance[1, 0, 0, 0] == pytest.approx(0.04)
    assert [point.node for point in targets.points] == [4401, 5848]
    assert targets.has_log == (form != "csv")
    assert ("scale" in targets.mode_names) == (form in PIXELS)
    assert found.missing == (0 if form == "csv" else 1)


def test_the_error_of_the_reference_is_shared_by_all_steps(tmp_path: Path) -> None:
    found = read_recorded(csv(tmp_path), "csv")
    targets, _ = made(tmp_path, found, stated("csv", rest_steps=2), tip=1)
    mode = targets.modes[targets.mode_names.index("reference:tip:1")]
    np.testing.assert_allclose(mode[:, 0, 0], 0.2 / np.sqrt(2))
    assert targets.reference.tolist() == [0, 1]
    assert targets.valid[:2, 0, 0].all()  # their mean is 0, they are not
    np.testing.assert_allclose(targets.value[:2, 0, 0], [0.5, -0.5])


def still_table(folder: Path, *, sd: float, seed: int = 0) -> Recorded:
    """Two points of a csv: 100 rows at rest, 100 at 20 kPa where they creep, and a ramp between, with noise."""
    rng, k = np.random.default_rng(seed), np.arange(220)
    pressure = np.interp(k, [0, 100, 120, 220], [0.0, 0.0, 20.0, 20.0])
    z = -0.5 * pressure[:, None] * [1.0, 0.4] * (1 + 0.02 * np.maximum(k - 120, 0)[:, None] / 100)
    u = np.stack([110.0 + 0.1 * z, 50.0 - z], axis=2) + sd * rng.standard_normal((220, 2, 2))
    head = "time_s,tip_x_mm,tip_y_mm,middle_x_mm,middle_y_mm,p [kPa]"
    rows = [f"{0.1 * n!r},{','.join(repr(float(x)) for x in u[n].ravel())},{float(pressure[n])!r}" for n in k.tolist()]
    return read_recorded(written(folder / "still.csv", "\n".join([head, *rows])), "csv")


def test_an_sd_that_is_stated_is_the_noise_model(tmp_path: Path) -> None:
    found = still_table(tmp_path, sd=0.05)
    corrected, said = made(tmp_path, found, stated("csv", sd_mm=0.05, rho=0.5), tip=1, middle=2)
    assert corrected.noise is not None
    assert said == [corrected.noise.basis]
    assert "correlated by 0.5 from step to step. From step to step the film scatters by" in said[0]
    np.testing.assert_allclose(corrected.noise.rho[:, [0, 2]], 0.0, atol=0.1)
    targets, remarks = made(tmp_path, found, stated("csv", sd_mm=0.05), tip=1, middle=2)
    noise = targets.noise
    assert noise is not None
    np.testing.assert_array_equal(noise.sd, [[0.05, np.nan, 0.05]] * 2)
    np.testing.assert_allclose(noise.rho[:, [0, 2]], 0.0)
    np.testing.assert_array_equal(noise.correlation, np.eye(6))
    assert noise.basis == (
        "The noise is taken as stated, an sd of 0.05 mm, each value by itself: the verdict holds if that is right."
    )
    assert remarks == []
    assert _refusal(targets) == ""
    assert _refusal(replace(targets, noise=None)).startswith("no noise model: film the finger at rest")
    write_targets(tmp_path / "targets", targets)
    again = read_targets(tmp_path / "targets").noise
    assert again is not None
    assert (again.basis, again.frames) == (noise.basis, noise.frames)


@pytest.mark.parametrize("still", ["holds", ((0, 99), (121, 219))])
def test_rests_and_holds_tell_the_noise(tmp_path: Path, still: Any) -> None:
    found = still_table(tmp_path, sd=0.05)
    targets, remarks = made(tmp_path, found, stated("csv", sd_mm=None, still_steps=still), tip=1, middle=2)
    noise = targets.noise
    assert noise is not None
    # sd of an sd from 190 values: 5 %; of a correlation: 0.07. Four values each
    np.testing.assert_allclose(noise.sd[:, [0, 2]], 0.05, rtol=0.16)
    assert np.isnan(noise.sd[:, 1]).all()
    assert noise.rho[:, [0, 2]].max() < 0.22
    assert 180 < noise.frames < 200
    assert remarks == [noise.basis]
    assert noise.basis.startswith("The noise was estimated from ")
    np.testing.assert_allclose(targets.covariance[5, 0, 0, 0], noise.sd[0, 0] ** 2)
    assert _refusal(targets) == ""


def test_a_three_dimensional_frame_is_turned_and_its_mirror_refused() -> None:
    u = np.array([[[1.0, 2.0, 3.0]]])
    np.testing.assert_array_equal(turned(u, "y,-x,z")[0, 0], [2, -1, 3])
    np.testing.assert_array_equal(turned(u, "x,0,-y")[0, 0], [1, np.nan, -2])
    for axes, sentence in {"x,y,-z": "mirror image", "x,x,y": "stands twice", "x,y": "wanted the file's axes", "0,0,0": "none does"}.items():
        with pytest.raises(ValueError, match=sentence):
            turned(u, axes)


def test_a_table_of_times_and_pressures_holds_the_course_between_its_rows(tmp_path: Path) -> None:
    time = np.arange(0.0, 10.0, 0.5)
    for top, known in ((np.minimum(time, 5.0), True), (20.0 * (time > 4.0), False)):
        rows = [f"{t},{60 + p},{0.1 * p},{p}" for t, p in zip(time, top, strict=True)]
        text = "\n".join(["time_s,tip_x_mm,tip_z_mm,pressure_kPa", *rows])
        found = read_recorded(written(tmp_path / "rows.csv", text), "csv")
        targets, remarks = made(tmp_path, found, stated("csv", sd_mm=0.02), tip=4401)
        assert targets.has_log == known
        assert (NO_COURSE in remarks) != known  # within a step of 20 kPa it may be anything
        np.testing.assert_allclose(np.interp(time, targets.log_time, targets.log_pressure), 1e-3 * top, atol=1e-9)


def test_a_table_of_an_own_finger_needs_one_command(tmp_path: Path) -> None:
    rows = [f"{t},{80 - 0.1 * t},{-t},{3 * t}" for t in range(8)]
    file = written(tmp_path / "own.csv", "\n".join(["time_s,tip_x_mm,tip_z_mm,pressure_kPa", *rows]))
    shape = ("length_mm=80", "pleats=6")
    given: dict[str, Any] = {"targets": file, "nodes": ["tip=80,11.5,0"]}
    run_init(tmp_path / "batch", Lines(), finger=shape, sd_mm=0.02, **given)
    config = Project.open(tmp_path / "batch").config
    assert config.model.finger is not None
    assert (config.model.finger.length_mm, config.model.finger.pleats) == (80.0, 6)
    assert [table.sd_mm for table in config.imports] == [0.02]
    wrong = {
        "80": "wanted KEY=VALUE", "long_mm=80": "long_mm", "length_mm=far": "length_mm", "pleats=6.5": "pleats",
        "length_mm=70": "walls are too steep to mesh",
    }  # fmt: skip
    for text, told in wrong.items():
        with pytest.raises(ValueError, match=told):
            run_init(tmp_path / "other", Lines(), finger=[text], **given)
    with pytest.raises(ValueError, match=saying(r"points\.tip\.position_mm", r"10\.0 mm")):
        run_init(tmp_path / "other", Lines(), finger=["length_mm=70", "pleats=5"], **given)
    with pytest.raises(ValueError, match="whose place --deck takes"):
        run_init(tmp_path / "other", Lines(), finger=shape, deck=tmp_path / "own.inp", **given)
    with pytest.raises(ValueError, match=r"--sd-mm.*sd_mm = -1"):
        run_init(tmp_path / "other", Lines(), sd_mm=-1.0, **given)
    for text, rows in (("holds", "holds"), ("0-60, 200-260", ((0, 60), (200, 260)))):
        run_init(tmp_path / f"still {text}", Lines(), still=text, finger=shape, **given)
        imports = Project.open(tmp_path / f"still {text}").config.imports
        assert [table.still_steps for table in imports] == [rows]
    with pytest.raises(ValueError, match=saying("--still", "'0", "60'", "0-60")):
        run_init(tmp_path / "other", Lines(), still="0 to 60", **given)


def test_points_without_a_node_are_left_out_or_taken_where_they_lie(tmp_path: Path) -> None:
    found = read_recorded(csv(tmp_path), "csv")
    targets, remarks = made(tmp_path, found, stated("csv"), tip=4401)
    assert targets.names == ("tip",)
    left, course = remarks
    assert left.startswith("Left out")
    assert left.endswith("middle.")
    assert course == NO_COURSE
    targets, remarks = made(tmp_path, found, stated("csv", origin_mm=(-10.0, 11.5, 50.0)), tip=4401)
    assert targets.points[1].kind is PointKind.PLACE
    assert targets.points[1].position == (50.0, 11.5, 0.0)  # 60 - 10, the plane, 50 - 50
    assert remarks == [NO_COURSE]
    targets, _ = made(tmp_path, found, stated("csv", fixed=("middle",)), tip=4401)
    assert targets.fixed.tolist() == [False, True]
    named = [PointTable(name="tip", position_mm=(110.0, 11.5, 0.0))]
    targets, _ = targets_of(found, stated("csv"), named)
    assert (targets.points[0].kind, targets.points[0].position) == (PointKind.PLACE, (110.0, 11.5, 0.0))


def test_a_long_file_is_thinned_and_its_rest_kept() -> None:
    s = 5 * MOST_STEPS
    found = Recorded(names=("tip",), position=np.arange(3.0 * s).reshape(s, 1, 3), unit="mm", frame=np.arange(s), time=np.arange(s) / 100, pressure=np.zeros(s), axes="x,y,z")
    targets, remarks = made(Path(), found, stated("csv", axes=None, sd_mm=0.1, rest_steps=40), tip=1)
    assert MOST_STEPS <= len(targets.time) <= MOST_STEPS + 40
    assert targets.reference.tolist() == list(range(40))
    assert remarks == [f"{len(targets.time)} of {s} steps are kept, evenly spaced."]


@pytest.mark.parametrize(("parts", "hold_mm", "fewer"), [(1, 0.0, False), (3, 0.0, True), (1, 0.1, True)])
def test_of_many_points_as_many_steps_are_kept_as_a_fit_holds(parts: int, hold_mm: float, fewer: bool) -> None:
    s, p = 1000, 80
    names = tuple(f"m{k}" for k in range(p))
    found = Recorded(names=names, position=np.cumsum(np.ones((s, p, 3)), axis=0), unit="mm", frame=np.arange(s), time=np.arange(s) / 100, pressure=np.zeros(s), axes="x,y,z")
    table = stated("csv", axes=None, sd_mm=0.1, rest_steps=40, hold_sd_mm=hold_mm, released=hold_mm > 0.0)
    targets, remarks = targets_of(found, table, [PointTable(name=n, position_mm=(k, 0.0, 0.0)) for k, n in enumerate(names)], parts=parts)
    wanted = parts * bytes_of(targets.value.size, 3 * p, parts * len(targets.modes))
    assert (0.9 * MOST_BYTES if fewer else 0.0) < wanted <= MOST_BYTES
    assert (len(targets.time) < s) == fewer
    assert [f"{len(targets.time)} of {s} steps are kept, evenly spaced: a fit of so many points holds no more in 3 GB." in remarks] == [fewer]


@pytest.mark.parametrize(
    ("head", "comma", "unit"),
    [
        ("coor.X [mm],coor.Y [mm],disp.Horizontal Displacement U [mm],disp.Vertical Displacement V [mm]", False, "mm"),
        ("Coordinates.Image X [Pixel];Coordinates.Image Y [Pixel];disp.Horizontal Displacement U [Pixel];disp.Vertical Displacement V [Pixel]", True, "px"),
        ("x;y;u;v", True, "px"),
    ],
)
def test_exports_of_several_versions_of_matchid(tmp_path: Path, head: str, comma: bool, unit: str) -> None:
    found = read_recorded(matchid(tmp_path, head=head, comma=comma), "matchid")
    assert found.unit == unit
    np.testing.assert_allclose(found.position[3, :, :2], XY[3])
    assert np.isnan(found.position[2, 1]).all()


def test_a_stereo_solution_of_dice_is_in_mm(tmp_path: Path) -> None:
    head = "COORDINATE_X COORDINATE_Y DISPLACEMENT_X DISPLACEMENT_Y MODEL_COORDINATES_X MODEL_COORDINATES_Y MODEL_COORDINATES_Z MODEL_DISPLACEMENT_X MODEL_DISPLACEMENT_Y MODEL_DISPLACEMENT_Z SIGMA\n"
    for k in range(3):
        written(tmp_path / f"DICe_solution_{k}.txt", head + f"100 200 0 0 10 20 30 {k} 0 {-k} 0.01\n")
    found = read_recorded(tmp_path, "dice")
    assert (found.unit, found.axes, found.names) == ("mm", "", ("s0",))
    assert found.position[2, 0].tolist() == [12, 20, 28]


@pytest.mark.parametrize(("cameras", "score"), [(1.0, 0.95), (3.0, 0.3), (float("nan"), float("nan"))])
def test_anipose_needs_two_cameras_and_a_good_score(tmp_path: Path, cameras: float, score: float) -> None:
    found = read_recorded(anipose(tmp_path, cameras=cameras, score=score), "anipose")
    assert np.argwhere(np.isnan(found.position).any(axis=2)).tolist() == [[2, 1]]
    assert found.missing == 1


def test_several_animals_have_names_of_their_own(tmp_path: Path) -> None:
    assert read_recorded(deeplabcut(tmp_path, animals=True), "deeplabcut").names == ("a_tip", "b_middle")


REFUSED = {
    "no sd": ("c3d", {"sd_mm": None}, r"\[import\].* wanted sd_mm .sd of one position"),
    "no scale": ("deeplabcut", {"mm_per_px": None}, "wanted mm_per_px .* in pixels"),
    "scale for mm": ("csv", {"mm_per_px": 0.5}, "mm_per_px = 0.5: the file is in mm; leave it out"),
    "no rate": ("deeplabcut", {"fps": None}, "wanted fps .* counts frames"),
    "no axes": ("c3d", {"axes": None}, "wanted axes .* x,0,-y"),
    "no pressure": ("c3d", {"log": None}, "wanted log .* has no pressure"),
    "noise twice": ("csv", {"still_steps": "holds"}, "import.sd_mm = 0.2 and import.still_steps: both say how large"),
    "short holds": ("csv", {"sd_mm": None, "still_steps": ((0, 3),)}, "leave 3 free values of each component, wanted 30"),
    "late": ("c3d", {"start_s": 0.05}, "log.csv covers 0.000 to 0.080 s, the file 0.050 to 0.110 s.* start_s"),
    "other point": ("csv", {"fixed": ("base",)}, "point 'base' is not in the file, which has tip, middle"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_stated_is_refused(tmp_path: Path, case: str) -> None:
    form, changes, sentence = REFUSED[case]
    found = read_recorded(WRITERS[form](tmp_path), form)
    with pytest.raises(ValueError, match=sentence):
        made(tmp_path, found, stated(form, **changes), **{NAMES.get(form, ("tip",))[0]: 1})


def test_a_log_without_times_has_a_row_for_each_step(tmp_path: Path) -> None:
    found = read_recorded(c3d(tmp_path), "c3d")
    log = written(tmp_path / "log.csv", "p [mbar]\n0\n100\n200\n300\n")
    targets, _ = made(tmp_path, found, stated("c3d"), tip=1)
    np.testing.assert_allclose(targets.pressure, [0, 0.01, 0.02, 0.03])
    assert not targets.has_log
    written(log, "p [mbar]\n0\n100\n")
    with pytest.raises(ValueError, match="2 rows without times for 4 steps"):
        made(tmp_path, found, stated("c3d"), tip=1)


@pytest.mark.parametrize(
    ("form", "text", "sentence"),
    [
        ("deeplabcut", "scorer,a,a\nbodyparts,tip,tip\ncoords,x,y\n0,1,2\n", "no likelihood, take the analysed video"),
        ("deeplabcut", "time_s,x\n0,1\n", "begins with 'time_s,x'; wanted DeepLabCut's rows"),
        ("deeplabcut", "scorer,a,a,a\nbodyparts,tip,tip,tip\ncoords,x,y,likelihood\nimg1.png,1,2,1\n", "wanted a frame's number"),
        ("anipose", "tip_x,tip_y,tip_z\n1,2,3\n", "a file of Anipose's folder pose-3d"),
        ("dice", "SUBSET_ID,COORDINATE_X\n0,1\n", "column COORDINATE_Y is missing"),
        ("dice", "FRAME,COORDINATE_X\n0,1\n", "is a result of tracking"),
        ("matchid", "X [mm];Y [mm];Exx [ ]\n0;1;2\n", "wanted X, Y and the displacements U, V in one unit"),
        ("c3d", "nothing of the kind", "not a C3D file"),
        ("csv", "time_s,tip_x_mm,tip_z_px\n0,1,2\n", "all in one unit: found mm and px"),
        ("sleap", "", "format sleap: wanted one of deeplabcut, "),
    ],
)  # fmt: skip
def test_another_file_is_named(tmp_path: Path, form: str, text: str, sentence: str) -> None:
    path = written(tmp_path / "file.txt", text)
    with pytest.raises(ValueError, match=sentence):
        read_recorded(path, form)


@pytest.fixture
def batch(tmp_path: Path) -> Path:
    """A project of a file of DeepLabCut, as init makes it."""
    (tmp_path / "in").mkdir()
    run_init(tmp_path / "batch", Lines(), targets=deeplabcut(tmp_path / "in"), nodes=["middle=53,11.3,20"])
    written(tmp_path / "batch" / "raw" / "log.csv", LOG.replace("p [kPa]", "p"))
    return tmp_path / "batch"


def state(batch: Path, **keys: object) -> Project:
    """The project once these keys stand under [import]."""
    text = (batch / "twin.toml").read_text()
    for key, value in keys.items():
        text = with_key(text, "import", key, value)
    (batch / "twin.toml").write_text(text)
    return Project.open(batch)


FACTS = {"sd_mm": 0.2, "mm_per_px": 0.5, "fps": 50.0, "log": "raw/log.csv", "log_unit": "kPa"}


def test_init_writes_what_the_file_shows_and_names_what_it_does_not(tmp_path: Path, batch: Path) -> None:
    project = Project.open(batch)
    table = RecordingTable(name="film", file="raw/film.csv", format="deeplabcut", axes="x,0,-y")
    assert project.config.imports == (table,)
    assert [(p.name, p.node, p.position_mm) for p in project.config.points] == [
        ("tip", 4401, None), ("middle", None, (53.0, 11.3, 20.0)),
    ]
    said = Lines()
    result = run_init(tmp_path / "other", said, targets=batch / "raw" / "film.csv")
    assert result["wanted"] == ["sd_mm", "mm_per_px", "fps", "log"]
    assert [line.split(":")[0].strip() for line in said[2:-1]] == result["wanted"]
    assert said[-1].startswith("Next: `twin measure --project ")
    with pytest.raises(ValueError, match=saying("sd_mm", "mm_per_px")):
        check_project(project, Lines())
    with pytest.raises(ValueError, match=r"missing in .*raw/none.csv \(import.log\)"):
        check_project(state(batch, log="raw/none.csv"), Lines())


def test_a_plain_file_wants_its_sd_alone(tmp_path: Path) -> None:
    result = run_init(tmp_path / "batch", Lines(), targets=csv(tmp_path))
    assert result["wanted"] == ["sd_mm"]
    assert not still_wanted(read_recorded(csv(tmp_path), "csv"), stated("csv"))


def test_measure_makes_the_targets_and_a_wrong_axis_is_corrected(batch: Path) -> None:
    project, measure = state(batch, **FACTS, axes="x,0,y"), stage_of("measure").run
    with pytest.raises(ValueError, match="bends"):  # to +z: the axis is the wrong way round
        measure(project, Lines())
    project, said = state(batch, axes="x,0,-y"), Lines()
    result = measure(project, said)
    assert (result["status"], result["points"], result["steps"]) == ("done", 2, 4)
    assert any("1 of 8 positions have a likelihood below 0.6" in line for line in said)
    targets = Project.open(batch).targets()
    np.testing.assert_allclose(targets.value[3, 0, [0, 2]], [-6.0, -15.5])
    assert "scale" in targets.mode_names
    assert targets.pressure[-1] == pytest.approx(0.03)
    assert measure(project, Lines())["status"] == "skipped"
    check_project(project, Lines())


def test_facts_that_change_make_other_targets_and_keep_the_former(batch: Path) -> None:
    measure = stage_of("measure").run
    measure(state(batch, **FACTS), Lines())
    project = state(batch, mm_per_px=0.25)
    with pytest.raises(ValueError, match=r"never overwritten; .* --replace"):
        measure(project, Lines())
    assert measure(project, Lines(), renew=True)["status"] == "done"  # as `recalibrate` does
    assert measure(project, Lines(), renew=True)["status"] == "skipped"
    np.testing.assert_allclose(project.targets().value[3, 0, 2], -15.5 / 2)
    assert (batch / "targets-0001" / "targets.csv").is_file()
    assert measure(project, Lines(), replace=True)["status"] == "done"  # nothing has changed: again
    assert (batch / "targets-0002" / "targets.csv").is_file()
    with pytest.raises(ValueError, match="--budget"):
        measure(project, Lines(), budget=True)


def test_init_refuses_what_it_cannot_read(tmp_path: Path) -> None:
    for given, sentence in (
        ({"targets": csv(tmp_path), "nodes": ["knee=17"]}, "--node knee: not in the file, which has tip, middle"),
        ({"targets": written(tmp_path / "a.txt", "1 2 3")}, "a.txt: .*targets.csv, or --format"),
        ({"form": "csv"}, "--format without --targets"),
        ({"targets": tmp_path / "none.csv"}, "none.csv"),
    ):
        with pytest.raises((ValueError, OSError), match=sentence):
            run_init(tmp_path / "new", Lines(), **given)  # type: ignore[arg-type]
        assert not (tmp_path / "new").exists()
    alone = written(tmp_path / "knee.csv", csv(tmp_path).read_text().replace("tip", "knee").replace("middle", "q"))
    with pytest.raises(ValueError, match=saying("--node", "NAME=LABEL", "NAME=X,Y,Z")):
        run_init(tmp_path / "new", Lines(), targets=alone)


def test_a_real_file_of_motion_capture(shared_data: Path) -> None:
    found = read_recorded(shared_data / "real_beam" / "beam_load52_V2_a.c3d", "c3d")
    assert found.names == ("Tip_1", "Tip_2", "Tip_3", "Base_1", "Base_2", "Base_3")
    assert (found.unit, found.missing, found.position.shape) == ("m", 0, (600, 6, 3))
    fixed = ("Base - 1", "Base - 2", "Base - 3")
    log = np.zeros(600)
    found = Recorded(**{**vars(found), "pressure": log})
    table = stated("c3d", sd_mm=0.01, axes="x,y,z", fixed=fixed, log=None)
    targets, _ = made(shared_data, found, table, Tip_1=1)
    moved = np.linalg.norm(targets.value[-1], axis=1)
    assert 16.0 < moved[0] < 17.6  # as measured from the file by others: its record says 16 to 17.5 mm
    assert moved[1:].max() < 0.8


def test_targets_of_a_film_make_another_project_at_the_places_they_state(tmp_path: Path) -> None:
    """Markers that lie at no node are points of the finger, too."""
    found = read_recorded(csv(tmp_path), "csv")
    targets, _ = made(tmp_path, found, stated("csv"), tip=4401)
    places = tuple(replace(p, kind=PointKind.PLACE, node=None, position=(110.0, 11.5, 0.0)) for p in targets.points)
    write_targets(tmp_path / "measured", replace(targets, points=places))
    run_init(tmp_path / "again", Lines(), targets=tmp_path / "measured")
    (point,) = Project.open(tmp_path / "again").config.points
    assert (point.name, point.node, point.position_mm) == ("tip", None, (110.0, 11.5, 0.0))


def test_a_log_beside_a_pressure_of_the_file_is_taken_where_both_agree(tmp_path: Path) -> None:
    found = read_recorded(csv(tmp_path), "csv")
    targets, _ = made(tmp_path, found, stated("csv", log="log.csv"), tip=4401)
    assert targets.has_log
    np.testing.assert_allclose(targets.pressure, 0.01 * np.arange(4))
    written(tmp_path / "log.csv", LOG.replace("p [kPa]", "p [mbar]"))
    with pytest.raises(ValueError, match=r"the file has a pressure of its own, which differs from the log's by up to 0\.0"):
        made(tmp_path, found, stated("csv", log="log.csv"), tip=4401)


def test_a_step_at_ten_rows_a_second_is_a_log_of_steps(tmp_path: Path) -> None:
    time = np.arange(0.0, 10.0, 0.1)
    pressure = 20.0 * (time > 4.0)
    rows = [f"{t:.1f},{60 - 0.1 * p},{-p * (1 + 0.01 * t)},{p}" for t, p in zip(time, pressure, strict=True)]
    text = "\n".join(["time_s,tip_x_mm,tip_z_mm,pressure_kPa", *rows])
    targets, remarks = made(tmp_path, read_recorded(written(tmp_path / "step.csv", text), "csv"), stated("csv"), tip=4401)
    assert targets.has_log
    assert remarks == []


@pytest.mark.parametrize("form", ["dice", "matchid"])
def test_numbers_of_files_become_times(tmp_path: Path, form: str) -> None:
    WRITERS[form](tmp_path)
    files = sorted(tmp_path.glob("*.*"))
    numbers = (0, 20, 40, 100)
    for file, number in list(zip(files, numbers if form == "dice" else numbers[-2:] + numbers[:2]))[::-1]:
        stem = "DICe_solution_" if form == "dice" else "picture_"
        file.rename(tmp_path / f"{stem}{number:03d}{file.suffix}")
    found = read_recorded(tmp_path, form)
    long = "time_s,p [kPa]\n" + "".join(f"{k},{3.0 * k}\n" for k in range(9))
    written(tmp_path.parent / f"{form}-log.csv", long)
    tip, _ = NAMES[form]
    targets, _ = targets_of(
        found, stated(form, fps=20.0, log="log.csv"), [PointTable(name=tip, node=4401)], log=tmp_path.parent / f"{form}-log.csv"
    )
    np.testing.assert_allclose(targets.time, np.array(numbers) / 20.0)
    np.testing.assert_allclose(targets.value[:, 0, 0], TIP[:, 0] * (0.5 if form in PIXELS else 1.0) - TIP[0, 0] * (0.5 if form in PIXELS else 1.0), atol=1e-4)


TIME = np.arange(0.0, 12.0, 0.1)
PRESSURE = np.interp(TIME, [0, 3, 6, 8, 11, 12], [0, 0, 30, 30, 0, 0])


def swung(seed: int = 0) -> np.ndarray:
    """Places (s,2,3) of two points under PRESSURE, with a noise of 0.02 mm."""
    rest = np.array([[110.0, 0.0, 50.0], [60.0, 0.0, 50.0]])
    u = PRESSURE[:, None, None] * np.array([[-0.4, 0.0, -1.6], [-0.1, 0.0, -0.5]])
    return rest + u + 0.02 * np.random.default_rng(seed).standard_normal((len(TIME), 2, 3)) * [1, 0, 1]


def table_of(place: np.ndarray, *, lost: dict[tuple[int, int], str] | None = None, pressure: bool = True) -> str:
    head = ["time_s", *(f"{n}_{a}_mm" for n in ("tip", "middle") for a in "xz"), *(["p [kPa]"] if pressure else [])]
    rows = []
    for k, t in enumerate(TIME):
        cells = [f"{v:.4f}" for v in place[k][:, [0, 2]].ravel()]
        for p in range(2):
            if lost and (k, p) in lost:
                cells[2 * p : 2 * p + 2] = 2 * [lost[k, p]]
        rows.append(",".join([f"{t:.1f}", *cells, *([f"{PRESSURE[k]:.4f}"] if pressure else [])]))
    return "\n".join([",".join(head), *rows])


@pytest.mark.parametrize("word", ["0", "0.0000", "-1", "-9999", "9999.0", "1e20", "", "-", "NaN", "n/a"])
def test_a_lost_point_is_no_place_however_it_is_written(tmp_path: Path, word: str) -> None:
    lost = {(k, 0): word for k in range(80, 90)}
    found = read_recorded(written(tmp_path / "a.csv", table_of(swung(), lost=lost)), "csv")
    targets, remarks = made(tmp_path, found, stated("csv", axes="x,y,z", sd_mm=0.02), tip=4401, middle=5848)
    assert np.flatnonzero(np.isnan(targets.value[:, 0, 0])).tolist() == list(range(80, 90))
    assert np.isfinite(targets.value[:, 1, 0]).all()
    assert np.nanmax(np.abs(targets.value)) < 60.0
    assert any("10 positions count as not seen" in s for s in remarks) == (word not in ("", "-", "NaN", "n/a"))


def test_zeros_of_displacements_at_rest_are_places(tmp_path: Path) -> None:
    place = swung() - swung()[0]
    place[:25] = 0.0
    place[112:] = 0.0
    found = read_recorded(written(tmp_path / "a.csv", table_of(place)), "csv")
    assert np.isfinite(found.position[..., [0, 2]]).all()
    assert found.remarks == ()


def test_a_place_that_is_held_where_the_point_was_lost_is_asked_about(tmp_path: Path) -> None:
    place = swung()
    place[40:55, 0] = place[40, 0]
    found = read_recorded(written(tmp_path / "a.csv", table_of(place)), "csv")
    assert "tip has exactly one place in rows 40 to 54" in found.remarks[0]
    place = swung()
    place[40:55, 0] = place[0, 0]
    found = read_recorded(written(tmp_path / "a.csv", table_of(place)), "csv")
    assert "tip is exactly at its first place in rows 40 to 54" in found.remarks[0]


def test_points_that_exchange_their_places_are_named(tmp_path: Path) -> None:
    place = swung()
    place[50:60] = place[50:60, ::-1]
    found = read_recorded(written(tmp_path / "a.csv", table_of(place)), "csv")
    with pytest.raises(ValueError, match=r"points tip and middle exchange places at 5, 6 s"):
        made(tmp_path, found, stated("csv", axes="x,y,z"), tip=4401, middle=5848)
    place = swung()
    place[50:60, 0] += 8.0
    found = read_recorded(written(tmp_path / "a.csv", table_of(place)), "csv")
    _, remarks = made(tmp_path, found, stated("csv", axes="x,y,z"), tip=4401, middle=5848)
    assert any("tip jumps by" in s for s in remarks)


@pytest.mark.parametrize(("rate", "start", "wanted"), [
    (1.0, 0.0, None), (1.25, 0.0, "seems to run 0.80 times"), (0.75, 2.0, "times|start_s"), (1.0, 1.5, "start_s"), (1.0, 5.0, "start_s"),
])  # fmt: skip
def test_imported_motion_is_compared_with_the_log_as_a_film_is(tmp_path: Path, rate: float, start: float, wanted: str | None) -> None:
    import re

    found = read_recorded(written(tmp_path / "a.csv", table_of(swung(), pressure=False)), "csv")
    assert found.time is not None
    found = replace(found, time=found.time / rate)
    log = np.arange(-8.0, 24.0, 0.05)
    text = "time_s,p [kPa]\n" + "".join(f"{t:.2f},{p:.4f}\n" for t, p in zip(log, np.interp(log, TIME, PRESSURE), strict=True))
    written(tmp_path / "log.csv", text)
    try:
        _, remarks = made(tmp_path, found, stated("csv", axes="x,y,z", sd_mm=0.02, log="log.csv", start_s=start, fps=None), tip=4401, middle=5848)
    except ValueError as error:
        remarks = [str(error)]
    if wanted is None:
        assert remarks == []
    else:
        assert any(re.search(wanted, sentence) for sentence in remarks)


@pytest.mark.parametrize(("step", "rate", "told"), [(10, 1.0, False), (2, 1.25, True)])
def test_rows_a_second_apart_cannot_tell_a_rate_from_a_lag(tmp_path: Path, step: int, rate: float, told: bool) -> None:
    found = read_recorded(written(tmp_path / "a.csv", table_of(swung(), pressure=False)), "csv")
    late = np.concatenate([np.repeat(found.position[:1], 10, axis=0), found.position[:-10]])  # by a second
    found = replace(found, time=TIME[::step] / rate, position=late[::step], frame=found.frame[::step])
    log = "".join(f"{t:.2f},{p:.4f}\n" for t in np.arange(-8.0, 24.0, 0.05) for p in [np.interp(t, TIME, PRESSURE)])
    written(tmp_path / "log.csv", "time_s,p [kPa]\n" + log)
    _, remarks = made(tmp_path, found, stated("csv", axes="x,y,z", sd_mm=0.02, log="log.csv", fps=None), tip=4401, middle=5848)
    assert any("seems to run 0.80 times" in sentence for sentence in remarks) == told
    assert told or remarks == []


def test_a_height_that_became_the_width_is_told_with_the_axes_to_write(tmp_path: Path) -> None:
    text = table_of(swung()).replace("_z_mm", "_y_mm")
    found = read_recorded(written(tmp_path / "a.csv", text), "csv")
    _, remarks = made(tmp_path, found, stated("csv", axes=None, sd_mm=0.02), tip=4401, middle=5848)
    assert any('write axes = "x,-z,y" under [import]' in sentence for sentence in remarks)
    said = Lines()
    run_init(tmp_path / "batch", said, targets=tmp_path / "a.csv")
    assert any('write axes = "x,-z,y" under [import]' in sentence for sentence in said)
    targets, remarks = made(tmp_path, found, stated("csv", axes="x,-z,y", sd_mm=0.02), tip=4401, middle=5848)
    assert remarks == []
    assert np.nanmin(targets.value[..., 2]) < -40.0


def test_readings_of_static_points_need_no_frame_rate(tmp_path: Path) -> None:
    rows = [f"{110 - 0.1 * p},{50 - p},{p}" for p in (0, 0, 10, 10, 20, 20)]
    found = read_recorded(written(tmp_path / "a.csv", "\n".join(["tip_x_mm,tip_z_mm,p [kPa]", *rows])), "csv")
    assert "fps" not in still_wanted(found, stated("csv", fps=None))
    targets, _ = made(tmp_path, found, stated("csv", axes="x,y,z", fps=None), tip=4401)
    np.testing.assert_allclose(targets.time, np.arange(6))


def test_a_c3d_of_lost_markers_damage_and_units(tmp_path: Path) -> None:
    import ezc3d

    path = c3d(tmp_path)
    content = ezc3d.c3d(str(path))
    points = content["data"]["points"].copy()
    points[:, 0, 1] = [0.0, 0.0, 0.0, 1.0]
    content["data"]["points"] = points
    content["data"]["meta_points"]["residuals"][:] = 0.0
    content.write(str(path))
    assert np.isnan(read_recorded(path, "c3d").position[1, 0]).all()
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(6):  # whatever is changed: read, or refused in a sentence
        data = bytearray(whole)
        for at in rng.integers(0, 1500, 8):
            data[at] = rng.integers(256)
        path.write_bytes(data)
        with contextlib.suppress(ValueError):
            read_recorded(path, "c3d")
    path.write_bytes(whole.replace(b"\x01m", b"\x01*", 1))
    for unit in ("**", "kg", "2 mm", ""):
        with pytest.raises(ValueError, match="wanted px or a unit of length"):
            mm_per_unit(replace(read_recorded(csv(tmp_path), "csv"), unit=unit), stated("csv"))


def test_pipes_and_files_of_other_kinds_are_refused(tmp_path: Path) -> None:
    import os

    for name in ("a.csv", "b.c3d"):
        os.mkfifo(tmp_path / name)
        for call in (format_of, lambda path: read_recorded(path, "deeplabcut")):
            if name == "a.csv":
                with pytest.raises(ValueError, match="is a pipe or a device; wanted a file"):
                    call(tmp_path / name)
    matchid(tmp_path / "m") if (tmp_path / "m").mkdir() is None else None
    (tmp_path / "m" / "._film_8.csv").write_bytes(b"x")
    assert len(read_recorded(tmp_path / "m", "matchid").frame) == 4
    os.mkfifo(tmp_path / "m" / "film_12.csv")
    with pytest.raises(ValueError, match="is a pipe or a device; wanted a file"):
        read_recorded(tmp_path / "m", "matchid")
