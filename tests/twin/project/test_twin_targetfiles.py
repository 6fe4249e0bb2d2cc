"""Targets: bit-equal round trip, targets.csv alone, and one sentence for every broken cell."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying
from twin.csvtable import read_table
from twin.project.folder import Project, dataset
from twin.project.targetfiles import read_targets, write_targets
from twin.targets import COLUMNS, Load, Noise, PointKind, TargetPoint, Targets, as_position, at_node

CSV = """block,step,time_s,pressure_MPa,point,u1_mm,u2_mm,u3_mm,sd1_mm,sd2_mm,sd3_mm,valid
0,0,0.0,0.0,tip,0.0,,0.0,0.1,,0.2,1
0,0,0.0,0.0,4711,,,0.0,,,0.2,1
0,1,1.0,0.01,tip,-1.5,,-20.0,0.1,,0.2,1
0,1,1.0,0.01,4711,,,-7.0,,,0.2,0
"""


def make_points():
    """A point at a node, one between nodes and a fixed marker."""
    a, b, c = (as_position(x) for x in np.random.default_rng(7).random((3, 3)))
    return (
        at_node("tip", 4401, a), TargetPoint("a.1", PointKind.PLACE, None, b), TargetPoint("F0", PointKind.FIXED, None, c),
    )  # fmt: skip


def make(*, seed: int = 0) -> Targets:
    """Two blocks with lost cells, modes, a log of its own and a noise model."""
    rng = np.random.default_rng(seed)
    steps, points = 12, 3
    value = rng.normal(size=(steps, points, 3))
    value[..., 1] = np.nan
    value[4, 2] = np.nan
    root = rng.normal(size=(steps, points, 3, 3))
    covariance = root @ root.swapaxes(2, 3)
    covariance = (covariance + covariance.swapaxes(2, 3)) / 2
    covariance[..., 1, :] = covariance[..., :, 1] = np.nan
    covariance[4, 2] = np.nan
    valid = ~np.isnan(value)
    valid[3, 1, 0] = False  # one component of two left out: only the npz can hold that
    block = np.repeat([0, 1], 6)
    one = np.array([1.0, np.nan, 1.0])  # y is not observed
    noise = Noise(
        sd=rng.random((3, 3)), rho=rng.random((3, 3)) * one, correlation=np.corrcoef(rng.normal(size=(9, 30))), frames=300, codec_sd=rng.random((3, 3)),
        gauge_sd_MPa=1.25e-5, gauge_frames=900,
    )  # fmt: skip
    return Targets(
        time=np.arange(steps) * 0.1, pressure=np.sin(np.arange(steps) * 0.1), block=block, points=make_points(), value=value, covariance=covariance,
        valid=valid, held_out=block == 1, modes=rng.normal(size=(2, steps, points, 3)),
        mode_names=("scale", "placement:tip:x"), noise=noise, log_time=np.arange(600) / 400 - 0.05,
        log_pressure=np.sin(np.arange(600) / 400 - 0.05), reference=np.array([0, 1]),
        gravity=np.array([[0, 0, -1.0], [1.0, 0, 0]]),
        pressure_sd=1e-3 * rng.random(steps),
    )  # fmt: skip


def bits(thing):
    """Return something that is equal only for the same bits, NaN included."""
    if dataclasses.is_dataclass(thing):
        return {f.name: bits(getattr(thing, f.name)) for f in dataclasses.fields(thing)}
    if isinstance(thing, tuple):
        return tuple(bits(part) for part in thing)
    return (thing.dtype.str, thing.shape, thing.tobytes()) if isinstance(thing, np.ndarray) else thing


@pytest.fixture
def folder(tmp_path):
    """A folder with targets.csv alone."""
    (tmp_path / "targets").mkdir()
    (tmp_path / "targets" / "targets.csv").write_text(CSV)
    return tmp_path / "targets"


def broken(folder, old, new):
    text = (folder / "targets.csv").read_text()
    assert old in text
    (folder / "targets.csv").write_text(text.replace(old, new, 1))
    return folder


@pytest.mark.parametrize(
    "changes",
    [{}, {"reference": np.array([0, 6]), "released": (1,)}, {"noise": None, "gravity": None}, {"modes": np.zeros((0, 12, 3, 3)), "mode_names": ()},
     {"points": (at_node("tip", 4401), at_node("a.1", 3), TargetPoint("F0", PointKind.FIXED))},
     {"points": (TargetPoint("tip", PointKind.UNKNOWN), *make_points()[1:])}],
    ids=["all", "released", "no noise", "no modes", "no positions", "no node"],
)  # fmt: skip
def test_round_trip_is_bit_equal(tmp_path, changes):
    targets = dataclasses.replace(make(), **changes)
    write_targets(tmp_path / "targets", targets)
    assert bits(read_targets(tmp_path / "targets")) == bits(targets)
    header = (tmp_path / "targets" / "targets.csv").read_text().splitlines()[0]
    assert tuple(header.split(",")) == tuple(COLUMNS)


def test_without_a_log_pressure_is_linear_between_steps(tmp_path):
    targets = make()
    targets = dataclasses.replace(targets, log_time=targets.time, log_pressure=targets.pressure)
    write_targets(tmp_path / "targets", targets)
    assert not (tmp_path / "targets" / "pressure.csv").exists()
    assert bits(read_targets(tmp_path / "targets")) == bits(targets)
    assert not targets.has_log


def test_targets_are_never_overwritten(tmp_path):
    write_targets(tmp_path / "targets", make())
    before = (tmp_path / "targets" / "targets.csv").read_bytes()
    with pytest.raises(ValueError, match="never overwritten"):
        write_targets(tmp_path / "targets", make(seed=1))
    assert (tmp_path / "targets" / "targets.csv").read_bytes() == before


def test_csv_alone_is_enough(folder):
    targets = read_targets(folder, nodes={"tip": 4401})
    assert targets.names == ("tip", "4711")
    # a name that is a number is its node
    assert targets.points == (at_node("tip", 4401), at_node("4711", 4711))
    assert targets.noise is None
    assert targets.modes.shape == (0, 2, 2, 3)
    assert targets.reference.tolist() == [0]
    assert targets.valid[1].tolist() == [[True, False, True], [False, False, False]]
    np.testing.assert_allclose(np.diag(targets.covariance[1, 0])[[0, 2]], [0.01, 0.04], rtol=1e-12)
    assert targets.covariance[1, 0, 0, 2] == 0  # independent, as the sd columns say
    assert np.isnan(targets.covariance[1, 0, 1]).all()


def test_a_point_without_node_says_so(folder):
    assert read_targets(folder).points == (TargetPoint("tip", PointKind.UNKNOWN), at_node("4711", 4711))


def test_an_edit_of_the_csv_counts(tmp_path):
    write_targets(tmp_path / "targets", make())
    text = (tmp_path / "targets" / "targets.csv").read_text().splitlines()
    text[1] = text[1].removesuffix("1") + "0"
    (tmp_path / "targets" / "targets.csv").write_text("\n".join(text))
    assert not read_targets(tmp_path / "targets").valid[0, 0].any()


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "-1.5",
            "abc",
            r"targets.csv, line 4, column u1_mm: 'abc': wanted a finite number in mm or an empty cell",
        ),
        ("-1.5", "nan", "line 4, column u1_mm: 'nan'"),
        ("-1.5,,-20.0,0.1", "-1.5,,-20.0,", "line 4, column sd1_mm: '': u1_mm is observed"),
        ("-20.0,0.1,,0.2", "-20.0,0.1,,0", "line 4, column sd3_mm: '0': u3_mm is observed"),
        (
            "0,1,1.0,0.01,4711",
            "0,1,1.0,0.02,4711",
            "line 5, column pressure_MPa: '0.02': the step's first row says 0.01",
        ),
        ("0,1,1.0,0.01,4711", "0,1,1.5,0.01,4711", "line 5, column time_s: '1.5'"),
        ("0,1,1.0,0.01,4711", "0,1,1.0,0.01,tip", "line 5, column point: 'tip': .* has this point twice"),
        ("0,1,1.0,0.01,4711", "0,2,2.0,0.01,4711", "block 0, step 1 has no row for point '4711'"),
        ("0,1,1.0,0.01,tip", "0.5,1,1.0,0.01,tip", "line 4, column block: '0.5': wanted a whole number"),
        (",0.2,0\n", ",0.2,no\n", "line 5, column valid: 'no': wanted 1"),
        ("-20.0,0.1,,0.2,1", "-20.0,0.1,,0.2", "line 4: 11 cells; wanted 12"),
        ("u3_mm", "U3_mm", "column u3_mm is missing.*rename 'U3_mm'"),
        ("tip,0.0,,0.0", "tip,0.0,,-3.0", "the first step has U3 = -3 mm at 'tip'; add the unloaded step"),
    ],
)
def test_a_broken_cell_gives_one_sentence(folder, old, new, sentence):
    with pytest.raises(ValueError, match=sentence):
        read_targets(broken(folder, old, new))


def test_time_must_increase(folder):
    text = (folder / "targets.csv").read_text().replace("0,1,1.0", "0,1,0.0")
    (folder / "targets.csv").write_text(text)
    with pytest.raises(ValueError, match=saying("4", "time_s", "'0.0'", "0 s")):
        read_targets(folder)


@pytest.mark.parametrize(
    ("toml", "sentence"),
    [
        ('[[points]]\nname = "top"', "point 'top' is not in targets.csv, which has tip, 4711"),
        ('[[points]]\nname = "tip"\nnode = 4402', "point 'tip' is node 4402, twin.toml says 4401"),
        ('[[points]]\nname = "tip"\nrole = "fixed"', "has role 'fixed', twin.toml gives it node 4401; correct one"),
        ('[[points]]\nname = "tip"\nrole = "fixd"', r"points\[1\].role = 'fixd': it should be 'finger', 'place' or 'fixed'"),
        ('[[points]]\nname = "tip"\nnode = "4401"', r"points\[1\].node = '4401': it should be a valid integer"),
        ('[[points]]\nname = "4711"\nrole = "place"', "'4711' lies at no node and has no position"),
        ('[[points]]\nname = "tip"\nposition_mm = [1, 2]', r"points\[1\].position_mm\[3\] is missing"),
        ("[reference]\nsteps = [7]", "reference block 0, step 7 is not in targets.csv"),
        ("[[blocks]]\nblock = 3", "block 3 is not in targets.csv"),
        ("[[blocks]]\nblock = 0\ngravity = [0, 0, -9.81]", "gravity = .* of block 0 is not a unit vector: wanted length 1"),
        ("[noise]\nframes = 3\ngauge_sd_MPa = 0.0\ngauge_frames = 0", "targets.npz is missing"),
        ("x = = 1", "not valid TOML"),
        ("[noise]\nframes = 3", "noise.gauge_sd_MPa is missing"),
        ('[[blocks]]\nblock = 0\nheld_out = "false"', r"blocks\[1\].held_out = 'false': it should be a valid boolean"),
        ("[[blocks]]\nblock = 0\nheld_outt = true", r"held_outt is not a known key; did you mean 'held_out'\?"),
        ("[[blocks]]\nblock = 0\n[[blocks]]\nblock = 0", "a block stands twice"),
        ("[[blocks]]\nblock = [1]", r"blocks\[1\].block = \[1\]: it should be a valid integer"),
        ("[noises]\nframes = 3", "noises is not a known key; did you mean 'noise'"),
        ("points = 1", "points = 1: it should be a valid array"),
        ("blocks = 3", "blocks = 3: it should be a valid array"),
        ("[reference]\nsteps = 0", "reference.steps = 0: it should be a valid array"),
        ('[[points]]\nname = "tip"\n[[points]]\nname = "tip"', "point 'tip' stands twice"),
        ("x = " + 5000 * "[", "brackets lie in each other too deeply"),
    ],
)
def test_a_broken_toml_gives_one_sentence(folder, toml, sentence):
    (folder / "targets.toml").write_text(toml)
    with pytest.raises(ValueError, match=sentence):
        read_targets(folder, nodes={"tip": 4401})


def test_a_fixed_marker_keeps_its_role(folder):
    (folder / "targets.toml").write_text('[[points]]\nname = "4711"\nrole = "fixed"\n')
    assert read_targets(folder).fixed.tolist() == [False, True]


def test_an_npz_of_other_targets_is_refused(tmp_path):
    write_targets(tmp_path / "targets", make())
    lines = (tmp_path / "targets" / "targets.csv").read_text().splitlines()
    cells = lines[1].split(",")
    cells[10] = str(2 * float(cells[10]))
    (tmp_path / "targets" / "targets.csv").write_text("\n".join([lines[0], ",".join(cells), *lines[2:]]))
    with pytest.raises(ValueError, match="standard deviations are not those"):
        read_targets(tmp_path / "targets")


def test_a_log_must_cover_the_steps(tmp_path):
    write_targets(tmp_path / "targets", make())
    log = (tmp_path / "targets" / "pressure.csv").read_text().splitlines()
    (tmp_path / "targets" / "pressure.csv").write_text("\n".join(log[:200]))
    with pytest.raises(ValueError, match="wanted a log that covers all steps"):
        read_targets(tmp_path / "targets")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"time": np.zeros(12)}, "time must increase"),
        ({"block": np.repeat([1, 0], 6)}, "numbered 0, 1"),
        ({"held_out": np.arange(12) == 3}, "block 0 is held out in part"),
        ({"reference": np.array([12])}, "reference steps"),
        ({"points": tuple(at_node(n, k) for k, n in enumerate("aab"))}, "not all different"),
        ({"points": (at_node("a", 1),)}, r"value has shape \(12, 3, 3\); wanted \(12, 1, 3\)"),
        ({"modes": np.zeros((1, 12, 3, 3))}, "modes has shape"),
        ({"valid": np.ones((12, 3, 3), dtype=bool)}, "step 0, point tip, U2 is valid but has value nan"),
    ],
)
def test_targets_that_do_not_fit_together_are_refused(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        dataclasses.replace(make(), **changes)


def test_the_study_holds_table_1():
    targets = Project.open(dataset("study")).targets()
    assert {p.name: p.node for p in targets.points} == {"tip": 4401, "middle": 5848}
    assert targets.value[targets.pressure == 0.03, :, 2].tolist() == [[-58.0, -19.0]]
    assert targets.valid.sum() == 2  # the unloaded step is zero by definition, not data
    assert targets.noise is None


# -- what hangs on the structure -----------------------------------------------------------------------------

BLOCKS = np.array([0, 0, 0, 0, 0, 1, 1, 1])
DOWN = np.tile([0.0, 0.0, -1.0], (2, 1))


def test_loads_come_back_as_they_were_written(tmp_path: Path, make_targets: Callable[..., Targets]) -> None:
    loads = (Load(1, "tip", weight_g=20.0), Load(1, (10.0, 0.0, 8.0), force=(0.0, 0.0, -0.2)))
    t = make_targets(block=BLOCKS, gravity=DOWN, loads=loads)
    write_targets(tmp_path / "targets", t)
    assert read_targets(tmp_path / "targets").loads == loads


@pytest.mark.parametrize(
    ("load", "said"),
    [
        ('{weight_g = 0.02, at = "tip"}', "0.1 to 5000 grams, such as 20.0"),
        ('{weight_g = 20.0, at = "tips"}', "is at 'tips'; wanted one of the points tip, middle"),
        ('{weight_g = 20.0, at = "fixed"}', "is at 'fixed'; wanted one of the points tip, middle"),
        ("{weight_g = 20.0}", "at is missing"),
        ('{weight_g = 20.0, force_N = [0.0, 0.0, 1.0], at = "tip"}', "one of weight_g in grams and force_N"),
        ('{force_N = [0.0, 0.0, -200.0], at = "tip"}', "a force above 0 and up to 50 N"),
        ('{mass_kg = 0.02, at = "tip"}', "mass_kg"),
        ("{weight_g = 20.0, at = [1.0, 2.0]}", "a point's name, or a position"),
    ],
)
def test_loads_that_cannot_be_meant_are_refused(
    load: str, said: str, tmp_path: Path, make_targets: Callable[..., Targets]
) -> None:
    write_targets(tmp_path / "targets", make_targets(block=BLOCKS, gravity=DOWN))
    told = tmp_path / "targets" / "targets.toml"
    lines = told.read_text().replace("block = 1\n", f"block = 1\nloads = [{load}]\n")
    told.write_text(lines)
    with pytest.raises(ValueError, match=r"targets\.toml") as caught:
        read_targets(tmp_path / "targets")
    assert said in str(caught.value)


# -- arrays and log


def altered(tmp_path, **arrays):
    """The folder of written targets with these arrays of targets.npz in place of the own ones."""
    write_targets(tmp_path / "targets", make())
    path = tmp_path / "targets" / "targets.npz"
    with np.load(path) as file:
        own = dict(file)
    np.savez(path, **(own | {name: change(own[name]) for name, change in arrays.items()}))
    return tmp_path / "targets"


def put(value, *index):
    """A change of an array: this value at that place."""

    def change(array):
        out = array.copy()
        out[index] = value
        return out

    return change


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        ("modes", put(np.nan, 0, 1, 0, 0), "array 'modes' holds nan; wanted finite numbers in mm"),
        ("modes", put(np.inf, 1, 2, 2, 2), "array 'modes' holds inf"),
        ("modes", lambda a: a[:, :5], r"array 'modes' has shape \(2, 5, 3, 3\); wanted \(2, 12, 3, 3\)"),
        ("pressure_sd", put(-1.0, 3), "array 'pressure_sd' holds -1; wanted finite numbers in MPa, 0 to 1"),
        ("pressure_sd", put(1e300, 3), "array 'pressure_sd' holds 1e\\+300; wanted finite numbers in MPa, 0 to 1"),
        ("modes", put(-1e300, 0, 1, 0, 0), "array 'modes' holds -1e\\+300; wanted finite numbers in mm, of 1e\\+06 at most"),
        ("covariance", put(1e300, 0, 0, 0, 0), "covariance of step 0, point 0 holds 1e\\+300; wanted finite numbers in mm2"),
        ("pressure_sd", lambda a: a.astype(str), "array 'pressure_sd' holds <U32; wanted numbers"),
        ("valid", lambda a: a.astype(str), "array 'valid' holds <U5; wanted booleans"),
        ("covariance", put(9.0, 0, 0, 0, 2), "covariance of step 0, point 0 is not symmetric"),
        ("covariance", lambda a: put(9.0, 0, 0, 0, 2)(put(9.0, 0, 0, 2, 0)(a)), "covariance of step 0, point 0 has the eigenvalue -"),
        ("covariance", put(np.nan, 0, 0, 0, 2), "covariance of step 0, point 0 holds nan"),
        ("correlation", put(0.5, 0, 1), "array 'correlation' is not symmetric"),
        ("correlation", put(2.0, 0, 0), "array 'correlation' is not 1 on its diagonal"),
        ("correlation", lambda a: 3 * a - 2 * np.eye(9), "array 'correlation' has the eigenvalue -"),
        ("correlation", lambda a: a[:3], "array 'correlation' has shape"),
    ],
)  # fmt: skip
def test_a_wrong_array_gives_one_sentence(tmp_path, name, change, sentence):
    with pytest.raises(ValueError, match=sentence):
        read_targets(altered(tmp_path, **{name: change}))


@pytest.mark.parametrize(
    ("column", "value", "wanted"),
    [("u1_mm", "-1e300", "mm, of 1e\\+06"), ("sd2_mm", "1e300", "mm, of 1e\\+06"), ("time_s", "1e300", "s, of 1e\\+13")],
)
def test_a_number_beyond_any_test_is_refused_with_its_cell(tmp_path, column, value, wanted):
    write_targets(tmp_path / "targets", make())
    path = tmp_path / "targets" / "targets.csv"
    head, *rows = (line.split(",") for line in path.read_text().splitlines())
    rows[-1][head.index(column)] = value
    path.write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    with pytest.raises(ValueError, match=rf"targets.csv, line {len(rows) + 1}, column {column}: '{value}': wanted a number in {wanted} at most; correct its unit"):
        read_targets(tmp_path / "targets")


def test_a_new_line_in_a_name_is_part_of_it(tmp_path):
    write_targets(tmp_path / "targets", make())
    path, name = tmp_path / "targets" / "targets.csv", make().names[0]
    path.write_text(path.read_text().replace(f",{name},", f',"{name[:1]}\n{name[1:]}",'))
    assert read_table(path, tuple(COLUMNS)).cells["point"][0] == f"{name[:1]}\n{name[1:]}"


def test_an_unknown_array_is_refused(tmp_path):
    folder = altered(tmp_path)
    with np.load(folder / "targets.npz") as file:
        np.savez(folder / "targets.npz", **file, mode=np.zeros(3))
    with pytest.raises(ValueError, match="array 'mode' is not known; wanted covariance, valid"):
        read_targets(folder)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda b, t, p: (b, t, 1000 * p), r"says .* MPa at .* s, targets.csv .* they differ at 11 of 12 steps; wanted the log"),
        (lambda b, t, p: (b, t, np.roll(p, 200)), "wanted the log of the same test"),
        (lambda b, t, p: (b + 1, t, p), r"block 2 is not in targets.csv, which has \[0, 1\]"),
        (lambda b, t, p: (0 * b, t, p), "the sample at 0.6025 s is of block 0, but targets.csv has block 1 there"),
    ],
)
def test_a_log_that_contradicts_the_steps_is_refused(tmp_path, change, sentence):
    write_targets(tmp_path / "targets", make())
    path = tmp_path / "targets" / "pressure.csv"
    b, t, p = np.loadtxt(path, delimiter=",", skiprows=1).T
    rows = "".join(f"{int(bb)},{tt!r},{pp!r}\n" for bb, tt, pp in zip(*(a.tolist() for a in change(b, t, p))))
    path.write_text("block,time_s,pressure_MPa\n" + rows)
    with pytest.raises(ValueError, match=sentence):
        read_targets(tmp_path / "targets")


def test_a_byte_order_mark_is_no_fault(folder):
    text = '\ufeff[[points]]\nname = "4711"\nrole = "fixed"\n'
    (folder / "targets.toml").write_text(text, encoding="utf-8")
    assert read_targets(folder).fixed.tolist() == [False, True]
