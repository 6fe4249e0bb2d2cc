"""What `twin posterior` keeps in a run's folder, writes and says, on samples of closed models."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibrate import Fit, Parameter
from calibrate.posteriors import Chain
from tests.messages import saying
from twin.calibrated.posterior import Sample, WholeSolve
from twin.commands import posterior
from twin.commands.posterior import PosteriorRecord, RunKeeping
from twin.project.folder import Run
from twin.targets import Array

TWO = (Parameter("C10", 0.01, 1.5, "MPa"), Parameter("C01", -1.0, 0.5, "MPa"))
COVARIANCE = np.array([[4e-4, -1e-4], [-1e-4, 1e-4]])
FIT = Fit(TWO, np.array([0.21, 0.08]), COVARIANCE, 700.0, 690, 0, 9, True, "", ())


class Told:
    """A `say` that keeps how far things are."""

    def __init__(self) -> None:
        self.progressed: list[tuple[str, int, int]] = []

    def __call__(self, text: str, /) -> None: ...

    def progress(self, stage: str, done: int, total: int, /) -> None:
        self.progressed.append((stage, done, total))


def chain_of(values: Array) -> Chain:
    """A chain of 16 walkers through independent values (n 16, d)."""
    shape = -1, 16, values.shape[1]
    return Chain(values.reshape(shape), np.zeros(len(values)).reshape(-1, 16), np.full(16, len(values) / 48), np.zeros(624), np.zeros(3))


def sample_of(values: Array, doubt: str = "") -> Sample:
    density: Any = SimpleNamespace(true=lambda x: x)
    return Sample(chain_of(values), density, 25, (0.03, 0.2), doubt)


def normal(seed: int = 0) -> Array:
    return np.random.default_rng(seed).multivariate_normal(FIT.theta, COVARIANCE, size=16000)


def test_what_a_sampler_keeps_is_read_again(tmp_path: Path) -> None:
    say = Told()
    keeping = RunKeeping(Run(tmp_path, resumed=False), say)
    theta, u = np.array([0.1, 1 / 3]), np.arange(6.0).reshape(1, 2, 3)
    one, none = WholeSolve(theta, u, np.stack([u, 2 * u]), 0.7), WholeSolve(2 * theta, u * np.nan, np.stack([u, u]) * np.nan, np.nan)
    assert keeping.solve(theta) is None
    for solve in (one, none):
        keeping.add_solve(solve)
    again = RunKeeping(Run(tmp_path, resumed=True), say)
    for solve in (one, none):
        found = again.solve(solve.theta)
        assert found is not None
        assert found.solved == solve.solved
        for name, x in vars(solve).items():
            np.testing.assert_array_equal(getattr(found, name), x)
    assert again.solve(3 * theta) is None

    chain = chain_of(normal()[:320])
    assert again.chain(0) is None
    again.set_chain(1, chain, 500)
    assert again.chain(0) is None
    kept = again.chain(1)
    assert kept is not None
    for name, x in chain.arrays.items():
        np.testing.assert_array_equal(kept.arrays[name], x)
    assert say.progressed == [("chain 2, steps", 20, 500)]

    again.set_points(0, np.zeros((0, 2)))
    again.set_points(1, np.array([theta, theta / 3]))
    assert len(again.points(0)) == 0  # type: ignore[arg-type]
    np.testing.assert_array_equal(again.points(1), [theta, theta / 3])
    assert again.points(2) is None


def test_a_sample_becomes_means_intervals_and_correlations() -> None:
    profiles: Any = SimpleNamespace(profiles=[SimpleNamespace(name="C10", low_95=0.17, high_95=None)])
    made = posterior._record(sample_of(normal()), FIT, Path("runs/0002-add/fit.json"), profiles)
    assert (made.fit, made.trusted, made.solves) == ("0002-add", True, 25)
    rows = {row.name: row for row in made.rows}
    assert list(rows) == ["C10", "C01", "C10+C01", "share"]
    for name, mean, sd in (("C10", 0.21, 0.02), ("C01", 0.08, 0.01), ("C10+C01", 0.29, np.sqrt(3e-4))):
        row = rows[name]
        assert row.mean == pytest.approx(mean, abs=0.04 * sd)  # of 12,800 values: 4 sds
        assert row.low_95 == pytest.approx(mean - 1.96 * sd, abs=0.1 * sd)
        assert row.high_covariance == pytest.approx(mean + 1.96 * sd)
        assert row.bound == ""
    assert (rows["C10"].low_profile, rows["C10"].high_profile, rows["C01"].low_profile) == (0.17, None, None)
    assert made.correlation[0][1] == pytest.approx(-0.5, abs=0.03)
    lines = posterior._told(made.model_copy(update={"inside": 0.96}))
    assert "mean" in lines[0]
    assert "by profile" in lines[0]
    assert any("Correlations above 0.3: C01 and C10 -0.5" in line for line in lines)
    assert lines[-1] == "96% of the measured values lie within the 95 % band of a measurement."


def test_a_chain_that_may_not_be_trusted_gives_no_interval() -> None:
    made = posterior._record(sample_of(normal(), "R-hat is 1.200, wanted below 1.01"), FIT, Path("0002-add/fit.json"), None)
    assert not made.trusted
    assert {row.mean for row in made.rows} == {row.low_95 for row in made.rows} == {None}
    assert {x for row in made.correlation for x in row} == {None}
    (line,) = posterior._told(made.model_copy(update={"off": None}))  # it was never checked
    assert line.startswith("No interval: R-hat is 1.200, wanted below 1.01.")
    assert "--steps 2000" in line
    off = posterior._record(sample_of(normal(), "the response is off"), FIT, Path("0002-add/fit.json"), None)
    assert posterior._told(off) == [f"No interval: the response is off. {posterior.OTHERWISE}"]
    assert posterior._headline(made) == "No interval: R-hat is 1.200, wanted below 1.01."
    assert PosteriorRecord.model_validate(json.loads(made.model_dump_json())) == made


@pytest.mark.parametrize(("draw", "said"), [
    (lambda rng: 0.01 + np.abs(rng.normal(0, 0.05, 16000)), "C10 leans on its bound of 0.01 MPa"),
    (lambda rng: 1.5 - rng.exponential(0.05, 16000), "C10 leans on its bound of 1.5 MPa"),
    (lambda rng: rng.uniform(0.01, 1.5, 16000), "The data hardly narrow C10"),
    (lambda rng: 0.01 + np.abs(rng.normal(0.2, 0.05, 16000)), ""),
])  # fmt: skip
def test_what_a_bound_does_to_an_interval_is_said(draw: Callable[[np.random.Generator], Array], said: str) -> None:
    x = draw(np.random.default_rng(4))
    sentence = posterior._leaning(x, "C10", FIT)
    assert sentence.startswith(said) if said else sentence == ""


def test_what_cannot_be_asked_for_is_refused_before_anything_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    project: Any = None
    with pytest.raises(ValueError, match=saying("--seed", "-1", "0")):
        posterior.run_posterior(project, Told(), seed=-1)
    with pytest.raises(ValueError, match=saying("--steps", "0", "1")):
        posterior.run_posterior(project, Told(), steps=0)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "corner" else name)
    with pytest.raises(ValueError, match=r"needs corner: not installed; run pip install emcee corner"):
        posterior.run_posterior(project, Told())


def test_pictures_and_tables_are_written(tmp_path: Path) -> None:
    values = normal()
    steps, points = 7, 2
    fields = np.random.default_rng(1).normal(size=(2, steps, points, 3))
    density: Any = SimpleNamespace(
        true=lambda x: x, theta=lambda x: x, response=SimpleNamespace(coefficients=lambda x: x, fields=fields)
    )
    sample = replace(sample_of(values), density=density)
    shown = np.tensordot(FIT.theta, fields, 1)
    valid = np.ones((steps, points, 3), bool)
    valid[:, :, 1] = False
    rng = np.random.default_rng(2)
    targets: Any = SimpleNamespace(
        value=shown + 0.5 * rng.normal(size=shown.shape), valid=valid, time=np.arange(steps) / 2, names=("tip", "rig"),
        fixed=np.array([False, True]),
    )
    components = np.array([[0, 0], [0, 2]])  # of the tip alone
    w: Any = SimpleNamespace(components=components, sd=np.full((steps, 2), 0.3), modes=np.full((1, steps, 2), 0.4))
    band = posterior._Band.of(sample, w)
    np.testing.assert_allclose(band.mean, shown, atol=2e-3)
    known = np.sqrt(np.einsum("isp,ij,jsp->sp", fields[..., 0], COVARIANCE, fields[..., 0]))[:, 0]
    half = (band.ends[1] - band.ends[0])[:, 0, 0] / 2
    np.testing.assert_allclose(half, 1.96 * known, rtol=0.15)  # ends of 2000 values: 4 sds
    outer = (band.outer[1] - band.outer[0])[:, 0, 0] / 2
    np.testing.assert_allclose(outer, 1.96 * np.sqrt(known**2 + 0.25), rtol=0.01)
    assert np.isnan(band.outer[:, :, 1]).all()
    assert band.inside(targets) > 0.8

    posterior._write_sample(Run(tmp_path, resumed=False), sample, FIT, band, targets)
    lines = (tmp_path / "posterior.csv").read_text().splitlines()
    assert lines[0] == "C10,C01,C10+C01,share"
    assert len(lines) == 1 + 2000
    a, b, total, share = map(float, lines[7].split(","))
    assert total == pytest.approx(a + b)
    assert share == pytest.approx(b / (a + b))
    lines = (tmp_path / "band.csv").read_text().splitlines()
    assert lines[0].startswith("time_s,point,component,measured_mm,mean_mm,low_mm,high_mm,low_measured_mm")
    assert len(lines) == 1 + steps * 2  # of the tip, U1 and U3
    row = lines[2].split(",")
    assert row[1:3] == ["tip", "U3"]
    assert float(row[7]) < float(row[5]) < float(row[4]) < float(row[6]) < float(row[8])
    for picture in ("posterior.png", "band.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
