"""A table [[material_tests]] of twin.toml -> the loading branch of a test, and the curve that a fit takes."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fe.homogeneous import SLOPES, principal_stretches
from twin.coupons.course import (
    STILL,
    beginning,
    find_drop,
    find_holds,
    is_reversed,
    preload_doubt,
    stiffness_fault,
    strain_fault,
    true_stress_doubt,
)
from twin.coupons.exports import ExportColumn, Quantity, SoughtColumn, read_export
from twin.coupons.testtable import MaterialTestTable
from twin.targets import Array, MaterialCurve

Rows = NDArray[np.int64]
POINTS = 20  # of a curve at most: its values stand for more, whose errors are not independent
TURN = 0.05  # of the range of the strain, by which it goes back where a branch ends
FEWEST = 4
UNLOADED = 0.05  # of the largest load, which a specimen at rest has at most
AWAY, NOWHERE = 0.25, 0.005  # of the largest change, from which a first value is no strain at rest


@dataclass(frozen=True, eq=False)
class PullTest:
    """A recorded test of the silicone: nominal strain and stress (k,) MPa on its loading branch, below 0 in
    compression; time (k,) s since the pull began, None without a clock; number of rows of the file; remarks
    for the user."""

    table: MaterialTestTable
    strain: Array
    stress: Array
    time: Array | None
    rows: int
    remarks: tuple[str, ...]

    @staticmethod
    def of(table: MaterialTestTable, root: Path) -> "PullTest":
        """The test of a table, whose file lies in the folder `root`. ValueError where that file is not right,
        or cannot be what the table says."""
        where = f"material_tests.{table.name}: {table.file}"
        pull, push, time, remarks = _columns(root / table.file, table)
        if fault := true_stress_doubt({pull.heading: table.true_strain, push.heading: table.true_stress}):
            raise ValueError(f"{where}: {fault} (true_strain, true_stress of [[material_tests]])")
        pull, remark = _from_rest(table, pull, push, where)
        strain, stress = _nominal(table, pull, push)
        if fault := strain_fault(strain):
            raise ValueError(f"{where}: {fault}; correct the unit (strain_unit) or length_mm")
        branches = loading_branches(np.abs(strain))
        if len(branches) < table.cycle:
            has = f"it has {len(branches)} loading branches"
            falls = "; its strain only falls, as in unloading: wanted a test that begins at rest"
            raise ValueError(
                f"{where}: cycle = {table.cycle}, but {has}{'' if branches else falls}; correct cycle"
            )
        used, remarks = branches[table.cycle - 1], [*remarks, *remark]
        unloading = len(strain) - len(used)
        if len(branches) == 1 and unloading > 0.05 * len(strain) and not find_holds(strain, stress):
            remarks.append(f"{unloading} of {len(strain)} rows, those of unloading, are left out")
        used, cut = _sound(table, used, strain, stress)
        timed = time is not None and table.cycle == 1 and not cut[0]
        times = _begun(np.abs(strain[used]), time[used]) if timed else None  # type: ignore[index]
        test = PullTest(table, strain[used], stress[used], times, len(strain), ())
        if fault := stiffness_fault(test.strain, test.stress, table.specimen):
            raise ValueError(f"{where}: {fault}; correct the unit (stress_unit) or area_mm2")
        return replace(test, remarks=tuple(_remarks(test, len(branches), [*remarks, *filter(None, cut)])))

    @property
    def stretches(self) -> Array:
        """The largest principal stretch (k,) at each row."""
        return principal_stretches(self.strain, self.table.specimen).max(axis=1)

    @property
    def sentence(self) -> str:
        """One sentence on the rows, the strain and the stiffness of the test."""
        shear = beginning(self.strain, self.stress)[0] / SLOPES[self.table.specimen]
        k = int(np.abs(self.strain).argmax())
        return (
            f"Material test {self.table.name} ({self.table.kind}): {len(self.strain)} of {self.rows} rows of "
            f"{self.table.file}, to {100 * self.strain[k]:.3g} % and {self.stress[k]:.3g} MPa nominal "
            f"stress. Its beginning has a shear modulus of {shear:.3g} MPa."
        )

    def sd(self, stress: Array) -> Array:
        """The sd of each stress alone, MPa."""
        return np.hypot(self.table.sd_MPa, self.table.sd_percent / 100 * stress)

    def curve(self, up_to: float = np.inf) -> MaterialCurve:
        """The curve up to a largest stretch: POINTS values at most, each the mean of its share of the
        strains. ValueError where too few are left."""
        limit = self.table.stretch_up_to or up_to
        keep = (self.stretches <= limit) & (self.strain != 0)
        x, y = np.abs(self.strain[keep]), self.stress[keep]
        if len(x) < FEWEST or np.ptp(x) == 0:
            raise ValueError(
                f"material_tests.{self.table.name}: {len(x)} values up to a stretch of {limit:.3g}; wanted "
                f"{FEWEST} or more: raise stretch_up_to, or export the curve with more points"
            )
        bins = np.clip(((x - x.min()) / np.ptp(x) * POINTS).astype(int), 0, POINTS - 1)
        members = list(np.argsort(x)[:, None])
        if len(x) > POINTS:
            members = [np.flatnonzero(bins == k) for k in np.unique(bins)]

        def mean(values: Array) -> Array:
            return np.array([values[rows].mean() for rows in members])

        strain, stress = mean(self.strain[keep]), mean(y)
        modes, names = self._shared(strain, stress)
        time = None if self.time is None else mean(self.time[keep])
        return MaterialCurve(
            name=self.table.name, kind=self.table.specimen, strain=strain, stress=stress, sd=self.sd(stress),
            modes=modes, mode_names=names, time=None if time is None or np.isnan(time).any() else time,
            up_to=float(self.stretches[keep].max()), recorded=self.rows, left_out=int((~keep).sum()),
        )  # fmt: skip

    def _shared(self, strain: Array, stress: Array) -> tuple[Array, tuple[str, ...]]:
        """The errors (k, n) MPa that all values share, with their names."""
        rows, names = [self.table.scale_percent / 100 * stress], ["scale"]
        if self.table.zero_percent:
            slope = np.gradient(np.append(0.0, stress), np.append(0.0, strain))[1:]
            rows.append(self.table.zero_percent / 100 * slope)
            names.append("zero of the strain")
        return np.array(rows), tuple(names)


def pull_tests(tables: Sequence[MaterialTestTable], root: Path) -> tuple[PullTest, ...]:
    """The tests of the silicone in these tables, whose files lie in the folder `root`. ValueError where a
    file is not right."""
    return tuple(PullTest.of(table, root) for table in tables)


def _columns(
    path: Path, table: MaterialTestTable
) -> tuple[ExportColumn, ExportColumn, Array | None, list[str]]:
    """The columns of strain and stress, times (k,) s, all in the order in which they were recorded, and
    remarks."""
    clock = SoughtColumn(("time",), "time", table.time)
    pulled: tuple[Quantity, ...] = ("displacement",) if table.length_mm is not None else ("strain", "stretch")
    pushed: tuple[Quantity, ...] = ("force",) if table.area_mm2 is not None else ("stress",)
    sought = [
        _sought(table, pulled, table.strain_unit, "strain_unit"),
        _sought(table, pushed, table.stress_unit, "stress_unit"),
    ]
    more = [clock] if table.time is not None else []
    export = read_export(path, [*sought, *more], also=[] if more else [clock], number=table.export_number)
    (pull, push, time), remarks = export.columns, list[str]()
    assert pull is not None
    assert push is not None
    if len(export.headers) > 1:
        lines = ", ".join(map(str, export.headers))
        remarks.append(
            f"the file has {len(export.headers)} specimens, whose headers are the lines {lines}: number "
            f"{table.export_number} is used (export_number)"
        )
    times = None if time is None else time.values
    if is_reversed(push.values, times):
        remarks.append(
            "its rows stand newest first, from the largest load to none: they are turned round; if the "
            "specimen was unloaded instead, this is no curve of loading"
        )
        pull, push = (replace(column, values=column.values[::-1]) for column in (pull, push))
        times = None if times is None else times[::-1]
    return pull, push, times, remarks


def _from_rest(
    table: MaterialTestTable, pull: ExportColumn, push: ExportColumn, where: str
) -> tuple[ExportColumn, list[str]]:
    """The column of the strain from its value at rest on, and a remark: a crosshead's position is none."""
    first, most = float(pull.values[0]), float(np.abs(pull.values - pull.values[0]).max())
    rest = 1.0 if pull.quantity == "stretch" else 0.0
    unloaded = abs(float(push.values[0])) <= UNLOADED * float(np.abs(push.values).max())
    if pull.quantity == "displacement":
        place = re.search(r"posi?tion|crosshead|traverse|absolut|stellung", pull.heading.lower()) is not None
        if abs(first) > (NOWHERE if place else AWAY) * most:
            if not place and not unloaded:
                raise ValueError(
                    f"{where}: {pull.heading} begins at {first:.4g} mm, where the load is not 0; wanted a "
                    "displacement that is 0 at rest: subtract the position at rest"
                )
            return replace(pull, values=pull.values - first), [
                f"{pull.heading} begins at {first:.4g} mm: a position, of which the change from there on is "
                "used, over length_mm"
            ]
    elif unloaded and abs(first - rest) > AWAY * most and most > 0:
        raise ValueError(
            f"{where}: {pull.heading} begins at a {pull.quantity} of {first:.4g}, where the load is 0; "
            f"wanted {rest:g} at rest: is it a {'strain' if rest else 'stretch'}?"
        )
    return pull, []


def _sound(
    table: MaterialTestTable, used: Rows, strain: Array, stress: Array
) -> tuple[Rows, tuple[str, str]]:
    """The rows of a loading branch up to a tear or slip, one for each hold; and a remark on each."""
    torn = held = ""
    if drop := find_drop(np.abs(strain[used]), np.abs(stress[used])):
        at, share, ends = drop
        what = "the specimen tore" if ends else "it slipped in the grips, or tore in part"
        torn = (
            f"the stress falls by {share:.0%} at a strain of {100 * strain[used[at]]:.3g} % while the "
            f"strain goes on: {what}; the {at + 1} rows up to there are used"
        )
        used = used[: at + 1]
    end = int(used[-1])
    near = np.abs(strain - strain[end]) <= STILL * np.ptp(strain)
    while not torn and end + 1 < len(strain) and near[end + 1]:
        end += 1  # a hold at the top lies behind the branch
    longer = np.append(used, np.arange(used[-1] + 1, end + 1))
    holds = find_holds(strain[longer], stress[longer])
    if holds:
        falls = max(1 - abs(stress[longer[b]] / stress[longer[a]]) for a, b in holds)
        relaxed = table.holds == "relaxed"
        ramp = [] if relaxed else list(range(holds[0][0]))
        which = "end of each hold, relaxed," if relaxed else "beginning of each hold, instant,"
        held = (
            f"the strain is held {len(holds)} times, in which the stress falls by up to {falls:.0%} "
            f"(relaxation): the {which} is used; holds = \"{'instant' if relaxed else 'relaxed'}\" "
            "takes the other"
        )
        used = longer[[*ramp, *(b if relaxed else a for a, b in holds)]]
    return used, (held, torn)


def _sought(
    table: MaterialTestTable, quantities: tuple[Quantity, ...], unit: str | None, unit_key: str
) -> SoughtColumn:
    """The column for any of some quantities, by the heading that the table names, if any."""
    headings: dict[Quantity, str | None] = {
        "strain": table.strain, "stretch": table.stretch, "displacement": table.displacement,
        "stress": table.stress, "force": table.force,
    }  # fmt: skip
    named = tuple(q for q in quantities if headings[q] is not None) or quantities
    return SoughtColumn(named, named[0], headings[named[0]], unit, unit_key)


def _nominal(table: MaterialTestTable, pull: ExportColumn, push: ExportColumn) -> tuple[Array, Array]:
    """Nominal strain (k,) and nominal stress (k,) MPa."""
    strain, stress = pull.values, push.values
    if pull.quantity == "displacement":
        strain = strain / table.length_mm  # type: ignore[operator]
    if pull.quantity == "stretch":
        strain = strain - 1.0
    if table.true_strain:
        strain = np.expm1(np.clip(strain, -5.0, 5.0))
    if push.quantity == "force":
        stress = stress / table.area_mm2  # type: ignore[operator]
    if table.kind == "compression":
        strain, stress = -np.abs(strain), -np.abs(stress)
    if strain.min() <= -1.0:
        raise ValueError(f"material_tests.{table.name}: a strain of {strain.min():.3g}; wanted more than -1: "
                         "nothing is pressed flat; correct the unit (strain_unit) or length_mm")  # fmt: skip
    return strain, stress / (1 + strain) if table.true_stress else stress


def loading_branches(strain: Array) -> list[Rows]:
    """The rows of each branch on which strains (k,) rise, from a lowest value to the next highest."""
    back, branches = TURN * float(np.ptp(strain)), []
    low = high = 0
    for k in range(1, len(strain)):
        if strain[k] > strain[high]:
            high = k
        elif strain[k] < strain[high] - back:
            if strain[high] - strain[low] > back:
                branches.append(np.arange(low, high + 1))
            low = high = k
        if strain[k] < strain[low] and high <= low:
            low = high = k
    if strain[high] - strain[low] > back:
        branches.append(np.arange(low, high + 1))
    return branches


def _begun(strain: Array, time: Array) -> Array:
    """Times (k,) s since the strain was 0, to which a straight line through the first half leads back; NaN
    from where they do not rise."""
    falls = np.flatnonzero(np.diff(time) < 0)
    rising = int(falls[0]) + 1 if falls.size else len(time)
    time = np.where(np.arange(len(time)) < rising, time - time[0], np.nan)
    half = max(rising // 2, 2)
    rate = np.polynomial.Polynomial.fit(time[:half], strain[:half], 1).convert(domain=(-1, 1)).coef
    rest = -rate[0] / rate[1] if len(rate) > 1 and rate[1] > 0 else 0.0
    return np.asarray(np.maximum(time - min(rest, 0.0), 1e-9), float)


def _remarks(test: PullTest, branches: int, said: Sequence[str]) -> Sequence[str]:
    """Remarks on a test for the user, a sentence each."""
    name = f"Material test {test.table.name}"
    out = [f"{name}: {sentence}." for sentence in said]
    if branches > 1:
        out.append(
            f"{name}: of {branches} loading branches number {test.table.cycle} is used. A silicone that was "
            "stretched before is softer (Mullins): take the one before which it was stretched as far as "
            "the finger was."
        )
    if doubt := preload_doubt(test.strain, test.stress, test.sd(test.stress)):
        out.append(f"{name}: {doubt}.")
    return out
