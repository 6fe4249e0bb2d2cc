"""A noise model without a static film: as it is stated, or from values at rest and under a held pressure."""

from pathlib import Path

import numpy as np
import pytest

from tests.messages import saying
from twin.judging.stillnoise import holds, stated_noise, still_noise
from twin.project.targetfiles import read_targets
from twin.targets import Array

PRESSURE = np.interp(np.arange(400), [0, 150, 180, 330, 360, 400], [0.0, 0.0, 0.03, 0.03, 0.0, 0.0])


def drawn(*, sd: float, rho: float, shared: float = 0.0, seed: int = 0) -> Array:
    """Values (400, 3, 3) mm: a motion that creeps, and noise of an sd, correlated from step to step by rho, of
    which components share a part; U2 is not seen."""
    rng = np.random.default_rng(seed)
    e = np.sqrt(1 - shared) * rng.standard_normal((400, 3, 3)) + np.sqrt(shared) * rng.standard_normal((400, 1, 1))
    y = e.copy()
    for k in range(1, len(y)):
        y[k] = rho * y[k - 1] + np.sqrt(1 - rho**2) * e[k]
    creep = np.cumsum(PRESSURE)[:, None, None] / 100
    out = -100 * PRESSURE[:, None, None] - creep + sd * y
    out[:, :, 1] = np.nan
    return np.asarray(out)


@pytest.mark.parametrize(("rho", "shared"), [(0.0, 0.0), (0.6, 0.0), (0.0, 0.5)])
def test_scatter_at_rest_and_in_holds_is_the_noise(rho: float, shared: float) -> None:
    found = [still_noise(drawn(sd=0.02, rho=rho, shared=shared, seed=k), PRESSURE, "holds") for k in range(5)]
    seen = [0, 2]
    # 5 x 6 components of some 330 values: 2 % of an sd where they are independent, thrice that with rho
    assert np.mean([n.sd[:, seen] for n in found]) == pytest.approx(0.02, rel=0.06)
    assert np.mean([n.rho[:, seen] for n in found]) == pytest.approx(rho, abs=0.06)
    rows = np.ix_([0, 2, 3, 5, 6, 8], [0, 2, 3, 5, 6, 8])
    off = np.mean([n.correlation[rows][~np.eye(6, dtype=bool)].mean() for n in found])
    assert off == pytest.approx(shared, abs=0.06)
    assert all(np.isnan(n.sd[:, 1]).all() for n in found)
    assert 300 < found[0].frames < 340
    assert found[0].basis == "The noise was estimated from 342 steps at rest or under a held pressure, not from a static film."


def test_holds_are_where_the_pressure_stays() -> None:
    assert [(a, b) for a, b in holds(PRESSURE) if b - a > 20] == [(0, 150), (180, 330), (360, 399)]
    assert holds(np.linspace(0.0, 0.03, 50)) == []
    assert holds(np.zeros(40)) == [(0, 39)]


def test_what_says_too_little_of_the_noise_is_refused() -> None:
    value = drawn(sd=0.02, rho=0.0)
    with pytest.raises(ValueError, match="1 rests or holds leave 16 free values of each component, wanted 30"):
        still_noise(value, PRESSURE, ((0, 19),))
    with pytest.raises(ValueError, match=saying(r"still_steps = \[0, 400\]", "0", "399")):
        still_noise(value, PRESSURE, ((0, 400),))
    with pytest.raises(ValueError, match="0 rests or holds leave 0 free values"):
        still_noise(value[:50], np.linspace(0.0, 0.03, 50), "holds")
    with pytest.raises(ValueError, match="does not scatter at all; state sd_mm"):
        still_noise(np.where(np.isnan(value), np.nan, 1.0), PRESSURE, ((0, 99),))
    value[:, 1, 2] = np.nan
    value[390:, 1, 2] = 0.1  # seen, but in no rest that is named
    with pytest.raises(ValueError, match="every point is seen"):
        still_noise(value, PRESSURE, ((0, 99),))


def test_a_stated_sd_is_that_of_every_value() -> None:
    found = stated_noise(drawn(sd=0.02, rho=0.0), 0.03)
    np.testing.assert_array_equal(found.sd, [[0.03, np.nan, 0.03]] * 3)
    np.testing.assert_array_equal(found.rho[:, 0], 0.0)
    assert "an sd of 0.03 mm, each value by itself:" in found.basis


def folder(path: Path, noise: str) -> Path:
    """Targets by hand: one point in 400 steps with an sd of 0.01 mm, and what [noise] says."""
    path.mkdir()
    value = drawn(sd=0.02, rho=0.0)[:, 0]
    head = "block,step,time_s,pressure_MPa,point,u1_mm,u2_mm,u3_mm,sd1_mm,sd2_mm,sd3_mm,valid"
    rows = [f"0,{k},{0.1 * k!r},{float(PRESSURE[k])!r},tip,{u[0]!r},,{u[2]!r},0.01,,0.01,1" for k, u in enumerate(value.tolist())]
    (path / "targets.csv").write_text("\n".join([head, *rows]) + "\n")
    (path / "targets.toml").write_text(f"[reference]\nblock = 0\nsteps = [0, 1, 2]\n{noise}")
    return path


def test_targets_by_hand_state_their_noise_in_a_line(tmp_path: Path) -> None:
    assert read_targets(folder(tmp_path / "none", "")).noise is None
    told = read_targets(folder(tmp_path / "told", "[noise]\nsd_mm = 0.02\n"))
    assert told.noise is not None
    np.testing.assert_array_equal(told.noise.sd, [[0.02, np.nan, 0.02]])
    np.testing.assert_allclose(told.covariance[:, 0, 0, 0], 0.02**2)  # no value is known better than its noise
    wrong = read_targets(folder(tmp_path / "wrong", "[noise]\nsd_mm = 0.03\nrho = 0.2\n"))
    assert wrong.noise is not None
    sd = wrong.noise.sd[0, 0]
    assert sd == pytest.approx(0.02, rel=0.2)
    np.testing.assert_allclose(wrong.covariance[:, 0, 0, 0], sd**2)
    assert f"correlated by 0.2 from step to step. From step to step the film scatters by {sd:.3g} mm" in wrong.noise.basis
    still = read_targets(folder(tmp_path / "still", '[noise]\nstill_steps = "holds"\n'))
    assert still.noise is not None
    assert still.noise.sd[0, 0] == pytest.approx(0.02, rel=0.15)
    assert still.noise.basis.startswith("The noise was estimated from 342 steps")
    rows = read_targets(folder(tmp_path / "rows", "[noise]\nstill_steps = [[0, 140], [190, 320]]\n"))
    assert rows.noise is not None
    assert rows.noise.frames == 141 + 131 - 2 * 4


@pytest.mark.parametrize(
    ("noise", "sentence"),
    [
        ("[noise]\n", "noise.frames is missing; add it, or state sd_mm .such as 0.02. or still_steps"),
        ('[noise]\nsd_mm = 0.02\nstill_steps = "holds"\n', "wanted one of points"),
        ("[noise]\nstill_steps = [[0, 5]]\n", r"targets.toml: \[noise\] still_steps: 1 rests or holds leave"),
        ("[noise]\nsd_mm = 0.0\n", "sd_mm"),
    ],
)
def test_a_noise_that_is_stated_wrongly_is_one_sentence(tmp_path: Path, noise: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        read_targets(folder(tmp_path / "wrong", noise))


def test_blocks_state_their_noise_each(tmp_path: Path) -> None:
    path = folder(tmp_path / "blocks", "")
    head, *rows = (path / "targets.csv").read_text().splitlines()
    moved = [f"1,{r.split(',', 3)[1]},{float(r.split(',')[2]) + 100!r},{r.split(',', 3)[3]}" for r in rows]
    (path / "targets.csv").write_text("\n".join([head, *rows, *moved]) + "\n")
    blocks = [f"[[blocks]]\nblock = {b}\nreference_steps = [0]\n[blocks.noise]\n{how}\n" for b, how in enumerate(("sd_mm = 0.03", 'still_steps = "holds"'))]
    (path / "targets.toml").write_text("[reference]\neach_block = true\n" + "".join(blocks))
    found = read_targets(path)
    first, second = (n.sd[0, 0] for n in found.noises)
    assert first == 0.03
    assert second == pytest.approx(0.02, rel=0.15)
    np.testing.assert_allclose(np.sqrt(found.covariance[:, 0, 0, 0]), np.repeat([first, second], 400))
