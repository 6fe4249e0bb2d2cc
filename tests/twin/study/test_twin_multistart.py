"""Many starts of least squares become sentences, rows of fit.json and a picture."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibrate import Fit, Parameter, least_squares
from tests.messages import Lines
from twin.project.folder import Run
from twin.study.multistart import several_starts
from twin.targets import Array

BOTH = (Parameter("C10", 0.01, 0.5, "MPa", typical=0.02), Parameter("C01", 0.0, 0.5, "MPa", typical=0.02))


def posed(valley: str) -> Any:
    """A load-path fit of C10 and C01 that has one optimum, two, or a line of them; none for a soft finger."""

    def residual(theta: Array) -> Array | None:
        a, b = theta
        if a + b < 0.06:
            return None
        if valley == "line":
            return np.array([100 * (a + b - 0.4)])
        if valley == "two":
            return np.array([300 * (a - 0.1) * (a - 0.4), 10 * (a - 0.1), 40 * (b - 0.2)])
        return np.array([100 * (a - 0.2), 100 * (b - 0.1)])

    def jacobian(theta: Array) -> Array:
        h = 1e-6
        return np.array([(residual(theta + e) - residual(theta - e)) / (2 * h) for e in h * np.eye(2)]).T  # type: ignore[operator]

    def fit(w: object, starts: Array) -> Fit:
        del w
        return least_squares(residual, jacobian, BOTH, start=starts)

    bench = SimpleNamespace(elasticity=SimpleNamespace(parameters=BOTH), project=SimpleNamespace(config=SimpleNamespace(calibrate=SimpleNamespace(seed=1))))
    return SimpleNamespace(whitener=lambda theta: None, fit=fit, bench=bench)


@pytest.mark.parametrize(("valley", "said"), [
    ("one", r"24 of 24 end at the lowest chi2, at C10 = 0.2 MPa, C01 = 0.1 MPa\. No other optimum was met\."),
    ("two", r"\d+ of 24 end at the lowest chi2, at C10 = 0.1 MPa, C01 = 0.2 MPa\. \d+ end at C10 = 0.39\d? MPa, C01 = 0.2 MPa, where "
            r"chi2 is higher by 8\.\d"),
    ("line", r"24 of 24 end at the lowest chi2, at C10 = .* MPa, and as good at C10 = .* MPa: these data hold no single optimum"),
])  # fmt: skip
def test_optima_are_named_with_their_constants(valley: str, said: str, tmp_path: Path) -> None:
    run = Run(tmp_path, resumed=False)
    found = several_starts(posed(valley), np.array([0.2, 0.1]), 24, run, Lines())
    assert "Starts, on this mesh: " in found.words
    assert re.search(said, found.words), found.words
    rows = found.rows
    assert len(rows) == 24
    assert [row.chi2 for row in rows] == sorted(row.chi2 or 0.0 for row in rows)
    assert rows[0].end == pytest.approx(dict(zip(("C10", "C01"), found.best)))
    assert (tmp_path / "starts.png").read_bytes().startswith(b"\x89PNG")


def test_starts_without_an_equilibrium_are_counted_and_all_of_them_refused(tmp_path: Path) -> None:
    on = posed("one")
    kept = on.fit
    on.fit = lambda w, starts: kept(w, starts if starts[0, 0] > 0.255 else np.array([[0.02, 0.01]]))
    found = several_starts(on, np.array([0.2, 0.1]), 10, Run(tmp_path, resumed=False), Lines())
    assert " From 5 the model has no equilibrium." in found.words
    assert [row.end is None for row in found.rows] == 5 * [False] + 5 * [True]
    assert found.rows[-1].chi2 is None
    on.fit = lambda w, starts: kept(w, np.array([[0.02, 0.01]]))
    with pytest.raises(ValueError, match=r"--starts: from none of them has the model an equilibrium; widen"):
        several_starts(on, np.array([0.2, 0.1]), 10, Run(tmp_path, resumed=False), Lines())
