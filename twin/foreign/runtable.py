"""A design of runs that somebody's program makes anywhere, and the table of its answers as a simulator."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibrate import Parameter
from calibrate.parameters import bounds
from twin.csvtable import read_table
from twin.foreign.programs import Simulator, Values, Variant, in_words, nominal
from twin.table import DataTable
from twin.targets import Array, Targets

if TYPE_CHECKING:
    from scipy.interpolate import RBFInterpolator

LEAST = 2  # runs a parameter, and one more
BEYOND = 0.01  # of what the runs span, up to which they are asked


def design(parameters: Sequence[Parameter], count: int, *, seed: int = 0) -> list[dict[str, float]]:
    """So many runs, values by name: the start of every parameter first, then points that fill the bounds
    evenly (Sobol 1967, doi:10.1016/0041-5553(67)90144-9).

    >>> from calibrate import Parameter
    >>> runs = design([Parameter("E", 0.1, 0.3, "MPa", start=0.2), Parameter("nu", 0.4, 0.5)], 4)
    >>> runs[0]
    {'E': 0.2, 'nu': 0.45}
    >>> all(0.1 <= run["E"] <= 0.3 for run in runs), len(runs)
    (True, 4)
    """
    from scipy.stats import qmc

    low, high = bounds(tuple(parameters))
    points = qmc.Sobol(len(low), seed=seed).random_base2(int(np.ceil(np.log2(max(count, 2)))))[: count - 1]
    points = (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), 1e-12)  # up to the bounds
    names, rows = [p.name for p in parameters], low + points * (high - low)
    return [nominal(parameters), *(dict(zip(names, row, strict=True)) for row in rows.tolist())]


def table_of(runs: Sequence[Values]) -> DataTable:
    """A row a run: its number from 1 on, and its values by name.

    >>> print(table_of([{"E": 0.2, "nu": 0.45}, {"E": 0.3, "nu": 0.4}]).csv(digits=4), end="")
    run,E,nu
    1,0.2,0.45
    2,0.3,0.4
    """
    return DataTable(("run", *runs[0]), [(k, *run.values()) for k, run in enumerate(runs, start=1)])


def read_runs(
    design: str | Path,
    answers: str | Path,
    parameters: Sequence[Parameter],
    data: Targets,
    *,
    variants: Sequence[Variant | Parameter] = (),
) -> Simulator:
    """The simulator of a design that somebody's program has run, for `twin.diagnose(simulator, data)`.

    design: the file of `twin explore --export`, a row a run, with a column for each parameter and variant.
    answers: a file with a row a run and step of the data, in their order: its number in the column run, and
    displacements such as tip_x_mm; a direction that the data do not see may be left out. ValueError names
    what is missing.
    """
    own = tuple(v if isinstance(v, Variant) else Variant(v) for v in variants)
    names = [p.name for p in (*parameters, *(v.parameter for v in own))]
    table = _columns(Path(design), ("run", *names))
    seen = {
        f"{name}_{axis}_mm": (k, i)
        for k, name in enumerate(data.names)
        for i, axis in enumerate("xyz")
        if data.valid[:, k, i].any() and not data.fixed[k]
    }
    told = _columns(Path(answers), ("run", *seen))
    numbers, steps = table["run"], len(data.time)
    u = np.zeros((len(numbers), steps, len(data.points), 3))
    for n, number in enumerate(numbers):
        rows = told["run"] == number
        if rows.sum() != steps:
            raise ValueError(
                f"{answers}: run {number:g} has {rows.sum()} rows; wanted {steps}, one for each step of the "
                "data, in every run of the design"
            )
        for column, (k, i) in seen.items():
            u[n, :, k, i] = told[column][rows]
    runs = [{name: float(table[name][n]) for name in names} for n in range(len(numbers))]
    return of_runs(parameters, runs, u, variants=own)


def _columns(path: Path, wanted: Sequence[str]) -> dict[str, Array]:
    """Columns (rows,) of finite numbers of a CSV file by name. ValueError where one is missing."""
    table = read_table(path, wanted)
    return {name: table.numbers(name, unit="its unit") for name in wanted}


def of_runs(
    parameters: Sequence[Parameter],
    runs: Sequence[Values],
    answers: Array,
    *,
    variants: Sequence[Variant] = (),
) -> Simulator:
    """The simulator of a table of runs: values by name, and displacements (n, s, p, 3) mm of each run.

    Between the runs it answers by cubic radial functions over a polynomial (Wendland 2004, ISBN
    978-0-521-84335-5); its error is the rms by which that run is missed, left out, that is missed most, and
    counts as noise of a diagnosis. ValueError for too few runs, or where they do not tell a parameter.
    """
    every = (*parameters, *(v.parameter for v in variants))
    u, least = np.asarray(answers, float), LEAST * len(every) + 1
    if u.ndim != 4 or len(u) != len(runs) or not np.isfinite(u).all():
        wanted = f"({len(runs)}, s, p, 3)"
        raise ValueError(f"answers of shape {u.shape}; wanted finite displacements {wanted}, mm")
    if len(runs) < least:
        raise ValueError(f"{len(runs)} runs of {len(every)} parameters; wanted {least} or more: see design")
    if lost := [p.name for p in every if any(p.name not in run for run in runs)]:
        raise ValueError(f"runs without {lost[0]}; wanted {', '.join(p.name for p in every)} in each")
    x = np.array([_scaled(every, run) for run in runs])
    if np.linalg.matrix_rank(x - x.mean(axis=0)) < len(every):
        raise ValueError("the runs do not tell the parameters apart; wanted values that vary one by one")
    flat, n = u.reshape(len(u), -1), np.arange(len(u))
    missed = [flat[k] - _between(x[n != k], flat[n != k])(x[k : k + 1])[0] for k in n]
    error = float(np.sqrt(np.mean(np.square(missed), axis=1)).max())
    predict = partial(_answer, every, _between(x, flat), u.shape[1:], (x.min(axis=0), x.max(axis=0)))
    return Simulator(predict, tuple(parameters), tuple(variants), error_mm=error)


def _scaled(every: Sequence[Parameter], run: Values) -> list[float]:
    """The values of a run over their bounds, from 0 to 1."""
    return [(run[p.name] - p.low) / (p.high - p.low) for p in every]


def _between(x: Array, y: Array) -> "RBFInterpolator":
    from scipy.interpolate import RBFInterpolator

    d = x.shape[1]
    quadratic = len(x) > (d + 1) * (d + 2) // 2
    return RBFInterpolator(x, y, kernel="cubic", degree=2 if quadratic else 1)


def _answer(
    every: Sequence[Parameter], between: "RBFInterpolator", shape: tuple[int, ...], box: tuple[Array, Array],
    values: Values,
) -> Array:  # fmt: skip
    """Displacements between the runs. ValueError outside of them."""
    x = np.array([_scaled(every, values)])
    room = BEYOND * (box[1] - box[0])
    if (x < box[0] - room).any() or (x > box[1] + room).any():
        raise ValueError(f"{in_words(values)}: outside of all runs; wanted runs that hold it")
    return np.asarray(between(x)[0].reshape(shape))
