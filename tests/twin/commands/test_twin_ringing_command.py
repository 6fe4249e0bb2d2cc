"""`twin ringing`: files of motion capture, a project's film beside its model, exposure, and what it refuses."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrate import Fit
from tests.messages import Lines
from tests.twin.test_twin_notebook import C10, batch, coarsest
from twin import files
from twin.bench.workbench import Workbench
from twin.calibrated.naturalvibrations import UP, WantedVibrations, vibrations
from twin.commands.ringing import in_targets, run_ringing
from twin.judging.fitrecord import FitRecord
from twin.model.structure import BuiltIn
from twin.project.folder import Project
from twin.results import rows_of
from twin.targets import Array, Targets

__all__ = ["batch", "coarsest"]
HZ, RATIO, RATE = 8.3, 0.06, 100.0


def step(t: Array, at: float, hz: float = HZ) -> Array:
    """A step of 1 at a time that overshoots and rings."""
    late = np.maximum(t - at, 0.0)
    w = 2 * np.pi * hz
    return np.where(t < at, 0.0, 1 - np.exp(-RATIO * w / np.sqrt(1 - RATIO**2) * late) * np.cos(w * late))


def written(path: Path, *, turn: bool = True) -> Path:
    """A file of seven markers of an arm: four on a base that rocks, three at the tip, which step by 8 mm and creep."""
    rng, t = np.random.default_rng(1), np.arange(200) / RATE
    base = np.array([[0.0, 0, 0], [0, 40, 0], [0, 0, 40], [0, 40, 40]])
    tip = np.array([[100.0, 10, 0], [100, 30, 0], [100, 20, 20]])
    moved = np.zeros((len(t), 7, 3))
    moved[:, 4:, 2] = 8 * (step(t, 0.3) - 0.3 * np.exp(-np.maximum(t - 0.3, 0) / 0.15) * (t > 0.3))[:, None]
    x = np.concatenate([base, tip]) + moved
    angle = 0.01 * np.sin(2 * np.pi * 7.0 * t) * turn  # beside the vibration: what does not take it off finds it
    c, s = np.cos(angle), np.sin(angle)
    rocked = np.stack([c[:, None] * x[..., 0] - s[:, None] * x[..., 2], x[..., 1],
                       s[:, None] * x[..., 0] + c[:, None] * x[..., 2]], axis=2)  # fmt: skip
    rocked += 0.01 * rng.standard_normal(rocked.shape)
    header = ",".join(f"m{k}_{axis}_mm" for k in range(1, 8) for axis in "xyz")
    np.savetxt(path, rocked.reshape(len(t), -1), delimiter=",", header=header, comments="")
    return path


def test_a_file_is_read_its_base_taken_off_and_the_exposure_told(tmp_path: Path) -> None:
    say = Lines()
    path = written(tmp_path / "arm_200mbar.csv")
    found = run_ringing(None, say, [path], fps=RATE, exposure_ms=10.0, readout_ms=5.0, px_per_mm=4.0)
    (row,) = found["ringings"]
    assert row["frequency_Hz"] == pytest.approx(HZ, abs=4 * row["frequency_sd_Hz"])
    assert row["frequency_sd_Hz"] < 0.05
    assert row["damping_ratio"] == pytest.approx(RATIO, abs=0.01)
    assert row["pressure_MPa"] == pytest.approx(0.02)
    x = np.pi * HZ * 0.01
    assert row["shrink"] == pytest.approx(1 - np.sin(x) / x, rel=0.02)
    assert row["smear_mm"] == pytest.approx(2 * row["first_mm"] * np.sin(x), rel=0.02)
    assert row["skew_mm"] == pytest.approx(2 * row["first_mm"] * np.sin(x / 2), rel=0.02)
    assert f"{4 * row['smear_mm']:.2g} px" in str(say)
    assert row["model_Hz"] is None
    named = run_ringing(None, Lines(), [path], fps=RATE, base="m1,m2,m3,m4")["ringings"][0]
    assert named["frequency_Hz"] == row["frequency_Hz"]
    assert named["shrink"] is None
    assert list(tmp_path.iterdir()) == [path]


def ringing_targets(bench: Workbench, *, u2: bool = True) -> Targets:
    """Targets at 100 frames a second: at rest, filled to 4 kPa with a ringing, swinging with the pressure, held."""
    t = np.arange(1200) / RATE
    p = np.interp(t, [0, 1, 1.05, 6, 12], [0, 0, 0.004, 0.004, 0.004])
    driven = (t > 6) & (t < 9)
    swing = np.where(driven, np.sin(2 * np.pi * 3.0 * (t - 6)) * np.exp(-0.3 * (t - 6)), 0.0)
    p = p + 0.001 * swing
    moved = -5 * step(t, 1.05) - 3 * swing
    way = np.array([[0.1, 0.0, 1.0], [0.02, 0.0, 0.4]])
    value = moved[:, None, None] * way + 0.01 * np.random.default_rng(2).standard_normal((len(t), 2, 3))
    valid = np.ones(value.shape, bool)
    if not u2:
        value[..., 1], valid[..., 1] = np.nan, False
    old = bench.targets
    return replace(
        old, time=t, pressure=p, log_time=t, log_pressure=p, value=value, valid=valid, block=np.zeros(len(t), int),
        covariance=np.broadcast_to(1e-4 * np.eye(3), (*value.shape, 3)), held_out=np.zeros(len(t), bool),
        modes=np.zeros((0, *value.shape)), mode_names=(), noise=None, reference=np.arange(3),
        pressure_sd=np.zeros(len(t)),
    )  # fmt: skip


@pytest.fixture(scope="module")
def project(batch: Path, coarsest: BuiltIn) -> Project:
    return Project.open(batch, builtin=coarsest)


@pytest.mark.parametrize("u2", [True, False])
def test_a_swing_with_the_pressure_is_not_a_ringing(project: Project, u2: bool) -> None:
    found, remarks = in_targets(ringing_targets(Workbench.of(project), u2=u2), ["first"])
    assert [f.where for f in found] == ["first"]
    assert found[0].ringing.frequency == pytest.approx(HZ, abs=0.02)
    assert found[0].pressure == pytest.approx(0.004)
    assert "1 swings are left out" in remarks[0]


def test_a_film_is_set_beside_the_calibrated_model(
    project: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Workbench.of(project)
    fit = Fit(bench.model().parameters, theta=np.array([C10]), covariance=np.array([[0.01**2]]), chi2=4.0,
              degrees_of_freedom=5, seed=1, evaluations=1, converged=True, reason="made", at_bound=())  # fmt: skip
    record = FitRecord.of(fit, adequate=True)
    monkeypatch.setattr("twin.bench.fits.fit_file", lambda _: tmp_path / "fit.json")
    files.write_json(tmp_path / "fit.json", files.plain(record))
    (here,) = vibrations(bench, record, WantedVibrations((0.004,), 2, kg_m3=1070.0))
    targets = ringing_targets(bench)
    monkeypatch.setattr(Project, "targets", lambda _: targets)
    say = Lines()
    found = run_ringing(project, say, density=1070.0)
    (row,) = found["ringings"]
    up = here.moves.index(UP)
    assert here.sd is not None
    assert row["model_Hz"] == pytest.approx(here.found.frequency[up], rel=1e-6)
    assert row["model_high_Hz"] - row["model_low_Hz"] == pytest.approx(2 * 1.96 * here.sd[up], rel=1e-6)
    assert row["model_moves"] == UP
    folder = project.root / "runs" / found["run"]
    assert rows_of("ringing", folder, found) == (row,)
    assert len((folder / "ringing.csv").read_text(encoding="utf-8").splitlines()) > 2
    assert "0 of 1 lie in its intervals" in str(say)
    bare = run_ringing(project, Lines())  # nothing states the density
    assert bare["ringings"][0]["model_Hz"] is None
    assert "No model beside it: density of the silicone" in bare["note"]


def test_what_cannot_be_read_is_refused(project: Project, tmp_path: Path) -> None:
    path = written(tmp_path / "arm.csv")
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"fps": 0.0}, "as in --fps 100"),
        ({"base": "m9"}, "--base m9: not in .*, which has m1, m2"),
        ({"base": "m1,m2,m3,m4,m5,m6,m7"}, "wanted some that move"),
        ({"exposure_ms": -1.0}, "--exposure-ms -1: wanted"),
    ]
    for how, words in wrong:
        with pytest.raises(ValueError, match=words):
            run_ringing(None, Lines(), [path], **{"fps": RATE} | how)
    with pytest.raises(ValueError, match=r"--fps 100\.0: is for files"):
        run_ringing(project, Lines(), fps=RATE)
    with pytest.raises(ValueError, match="no such file"):
        run_ringing(None, Lines(), [tmp_path / "none.csv"], fps=RATE)


def test_the_project_without_targets_that_ring_says_so(project: Project) -> None:
    found = run_ringing(project, Lines())
    assert found["ringings"] == []
    assert "too short" in found["note"]


