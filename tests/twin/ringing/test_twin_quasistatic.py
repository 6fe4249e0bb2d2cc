"""How far inertia moves a made finger off its equilibrium, in which steps, and what leaves them out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.messages import Lines
from tests.twin.test_twin_notebook import batch, coarsest
from twin.bench.firstvibration import first_vibration
from twin.bench.workbench import Workbench
from twin.commands.check import _check_inertia
from twin.model.structure import BuiltIn
from twin.project.folder import Project
from twin.ringing.quasistatic import fast_times, inertia, not_static, said, spans, without_ringing
from twin.targets import Array, Targets

__all__ = ["batch", "coarsest"]
HZ, SD = 5.0, 0.01
WAY = np.array([[0.1, 0.0, 1.0], [0.02, 0.0, 0.4]])


@pytest.fixture(scope="module")
def project(batch: Path, coarsest: BuiltIn) -> Project:
    return Project.open(batch, builtin=coarsest)


def oscillator(statics: Array, dt: float, hz: float, ratio: float) -> Array:
    """x'' + 2 zeta w x' + w^2 (x - u) = 0 along u (t,), by small steps."""
    w, x, v, out = 2 * np.pi * hz, statics[0], 0.0, []
    for u in statics:
        out.append(x)
        v += dt * (w**2 * (u - x) - 2 * ratio * w * v)
        x += dt * v
    return np.array(out)


def made(old: Targets, *, rise_s: float, every: int = 20, seed: int = 1) -> tuple[Targets, Array]:
    """Targets of a finger that rises by 20 mm at 2 s, as an oscillator of HZ; and its true error of statics (s,)
    mm."""
    fine = np.arange(0.0, 8.0, 5e-4)
    statics = 20 * np.interp(fine, [2, 2 + rise_s], [0, 1])
    moved = oscillator(statics, 5e-4, HZ, 0.03)
    t, error = fine[::every], (moved - statics)[::every]
    value = -moved[::every, None, None] * WAY
    value = value + SD * np.random.default_rng(seed).standard_normal(value.shape)
    s = len(t)
    targets = replace(
        old, time=t, pressure=2e-4 * statics[::every], log_time=t, log_pressure=2e-4 * statics[::every], value=value,
        valid=np.ones(value.shape, bool), block=np.zeros(s, int), held_out=np.zeros(s, bool),
        covariance=np.broadcast_to(SD**2 * np.eye(3), (*value.shape, 3)), modes=np.zeros((0, *value.shape)),
        mode_names=(), noise=None, reference=np.arange(3), pressure_sd=np.zeros(s),
    )  # fmt: skip
    return targets, np.abs(error) * np.linalg.norm(WAY[0])


def test_the_acceleration_tells_how_far_statics_are_off(project: Project) -> None:
    targets, true = made(project.targets(), rise_s=0.1)
    found, noise = inertia(targets, HZ)
    assert np.sqrt(np.mean((found - true) ** 2)) < 0.12 * np.sqrt(np.mean(true**2))
    assert 0.9 * true.max() < found.max() < 1.05 * true.max()
    assert noise[2:-2].max() < 6 * SD  # a parabola knows less of its ends
    flags = not_static(targets, HZ)
    assert not flags[targets.time < 1.9].any()
    assert flags[(targets.time > 2) & (targets.time < 3.5)].all()
    assert true[~flags].max() < 5 * noise[2:-2].max()  # four of them are asked for
    (first, *_) = spans(targets.time, flags)
    assert first[0] == pytest.approx(2.0, abs=0.1)


def test_a_slow_film_is_quasi_static_and_noise_is_no_motion(project: Project) -> None:
    for seed in range(5):
        slow, true = made(project.targets(), rise_s=4.0, seed=seed)
        assert true[slow.time > 2.5].max() < 0.3
        assert not_static(slow, HZ)[slow.time < 1.8].sum() == 0
    still = replace(slow, value=SD * np.random.default_rng(9).standard_normal(slow.value.shape))
    assert not_static(still, HZ).mean() < 0.02
    coarse, _ = made(project.targets(), rise_s=0.1, every=200)  # 10 steps a second do not show 5 Hz
    assert inertia(coarse, HZ)[0].max() == 0


def test_lost_markers_and_fixed_ones_do_not_count(project: Project) -> None:
    targets, _ = made(project.targets(), rise_s=0.1)
    whole = inertia(targets, HZ)[0]
    valid = targets.valid.copy()
    valid[::3, 0] = False
    valid[:, :, 1] = False
    lost = inertia(replace(targets, valid=valid), HZ)[0]
    assert np.isfinite(lost).all()
    assert lost.max() > 0.3 * whole.max()


def test_check_tells_them_and_ringing_Hz_leaves_them_out(
    project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    targets, _ = made(project.targets(), rise_s=0.1)
    case = Workbench.of(project).structure.case
    hz, source = first_vibration(project, case)
    assert (source, hz > 2) == ("usual constants", True)
    say = Lines()
    monkeypatch.setattr("twin.bench.firstvibration.first_vibration", lambda *_: (HZ, "usual constants"))
    _check_inertia(project, targets, case, say)
    assert "not quasi-static (1.9" in say[0] or "not quasi-static (2.0" in say[0]
    assert 'ringing_Hz = 5 under [calibrate] of twin.toml; to follow them, effects = ["inertia"]' in say[0]
    assert said(made(project.targets(), rise_s=0.1, every=200)[0], HZ, "x") == ""
    left = without_ringing(targets, HZ)
    assert (left.valid.any(axis=(1, 2)) == ~not_static(targets, HZ)).all()
    stated = replace(project, config=project.config.model_copy(update={
        "calibrate": project.config.calibrate.model_copy(update={"ringing_Hz": HZ})}))  # fmt: skip
    monkeypatch.setattr(Project, "targets", lambda _: targets)
    assert not Workbench.of(stated).targets.valid[not_static(targets, HZ)].any()
    assert Workbench.of(project).targets.valid.all()
    _check_inertia(stated, targets, case, say)
    assert "steps are left out of all fits" in say[1]
    followed = replace(project, config=project.config.model_copy(update={
        "model": project.config.model.model_copy(update={"effects": ("inertia:2",)})}))  # fmt: skip
    _check_inertia(followed, targets, case, say)
    assert len(say) == 2


def test_a_course_is_fast_where_its_steps_would_move_the_finger_beside_its_equilibrium(project: Project) -> None:
    targets, _ = made(project.targets(), rise_s=1.0)
    top, noise = float(targets.log_pressure.max()), np.random.default_rng(3)

    def fast(rise_s: float, *, sd: float = 0.0, every: float = 0.01) -> Array:
        time = np.unique(np.append(np.arange(0.0, 6.0, every), [2.0, 2.0 + rise_s]))
        course = top * np.interp(time, [2, 2 + rise_s], [0, 1])
        return fast_times(targets, time, course + sd * top * noise.standard_normal(len(time)), HZ)

    step = fast(0.05)
    assert abs(step.min() - 2.0) < 0.2
    assert abs(step.max() - 2.05) < 0.2
    assert len(fast(0.05, every=3.0)) == len(step)  # a polygon of four corners is the same course
    assert len(fast(3.9, sd=2e-3)) == 0  # of a log, noise is no motion
    assert len(fast(0.05, sd=2e-3)) > 0
    assert len(fast_times(targets, np.array([0.0, 6.0]), np.array([0.0, 0.0]), HZ)) == 0
