"""Least squares on the load paths from many starts -> where they end: whether there is one optimum."""

from dataclasses import dataclass

import numpy as np

from calibrate import Fit
from calibrate.starts import SAME, Ended, latin, optima, waterfall
from twin.judging.fitrecord import StartRow
from twin.messages import Say
from twin.numerals import short
from twin.project.folder import Run
from twin.study.loadpathfit import OnPaths
from twin.targets import Array

LEAST, MOST = 2, 1000  # starts
PICTURE = "starts.png"


@dataclass(frozen=True)
class Starts:
    """The descents from several starts, the best end first."""

    ends: tuple[Ended, ...]

    @property
    def rows(self) -> tuple[StartRow, ...]:
        """Rows of fit.json, one per start."""
        return tuple(
            StartRow(
                start=self._named(end.start),
                end=None if end.fit is None else self._named(end.fit.theta),
                chi2=end.chi2,
                converged=end.fit is not None and end.fit.converged,
            )
            for end in self.ends
        )  # fmt: skip

    def _named(self, theta: Array) -> dict[str, float]:
        assert self.ends[0].fit is not None
        return {p.name: float(x) for p, x in zip(self.ends[0].fit.parameters, theta, strict=True)}

    @property
    def best(self) -> Array:
        """The constants (d,) of the best end."""
        assert self.ends[0].fit is not None
        return self.ends[0].fit.theta

    @property
    def words(self) -> str:
        """Sentences on the number of ends at the best optimum and on other optima."""
        distinct, count = optima(self.ends), len(self.ends)
        top = [optimum for optimum in distinct if optimum.fit.chi2 <= distinct[0].fit.chi2 + SAME]
        others, lost = distinct[len(top) :], sum(end.fit is None for end in self.ends)
        hits = sum(optimum.count for optimum in top)
        text = f"Starts, on this mesh: {hits} of {count} end at the lowest chi2, at {_constants(top[0].fit)}"
        if len(top) > 1:
            text += f", and as good at {_constants(top[-1].fit)}: these data hold no single optimum"
        text += "."
        for optimum in others:
            text += (
                f" {optimum.count} {'ends' if optimum.count == 1 else 'end'} at {_constants(optimum.fit)}, "
                f"where chi2 is higher by {short(optimum.fit.chi2 - distinct[0].fit.chi2)}."
            )
        if not others and len(top) == 1 and hits == count:
            text += " No other optimum was met."
        return text + (f" From {lost} the model has no equilibrium." if lost else "")


def several_starts(on: OnPaths, near: Array, count: int, run: Run, say: Say) -> Starts:
    """Least squares from a Latin hypercube of `count` starts within the bounds, drawn into the run.

    constants (d,) at which the gauge's errors are taken. ValueError where none of them ends.
    """
    w, elasticity = on.whitener(near), on.bench.elasticity
    parameters, seed = elasticity.parameters, on.bench.project.config.calibrate.seed
    say.progress("starts", 0, count)
    done = 0

    def fit(start: Array) -> Fit:
        nonlocal done
        end = on.fit(w, start[None])
        done += 1
        say.progress("starts", done, count)
        return end

    ends = waterfall(fit, latin(parameters, count, seed=seed))
    if ends[0].fit is None:
        raise ValueError("--starts: from none of them has the model an equilibrium; widen [calibrate] bounds")
    from twin.drawing.fitplots import draw_starts

    run.write_bytes(PICTURE, draw_starts(np.array([end.chi2 for end in ends]), same=SAME))
    return Starts(ends)


def _constants(fit: Fit) -> str:
    return ", ".join(f"{p.name} = {short(float(x))} {p.unit}" for p, x in zip(fit.parameters, fit.theta))
