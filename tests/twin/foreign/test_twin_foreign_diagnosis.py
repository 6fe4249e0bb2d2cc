"""A program that is not ours is told what it lacks."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import twin
from calibrate import Parameter
from tests.messages import Lines, says
from tests.twin.foreign.arcs import BEND, PLACES, STIFF, TIME, TRUE, arcs, course, data_of
from twin.effects.mechanism import Mechanism
from twin.foreign import slowruns
from twin.foreign.courseeffects import candidates, plain_stand_ins
from twin.foreign.foreignmodel import ForeignModel
from twin.foreign.programs import Simulator, Values, Variant
from twin.targets import Array


def rod(**more: object) -> Simulator:
    return twin.simulator(arcs, [STIFF, BEND], **more)  # type: ignore[arg-type]


def late(tau: float) -> Array:
    """The pressure (s,) behind a first-order line, by Euler's method in small steps."""
    t = np.arange(0.0, 40.0, 1e-3)
    p, out = course(t), np.zeros(len(t))
    for k in range(1, len(t)):
        out[k] = out[k - 1] + 1e-3 / tau * (p[k - 1] - out[k - 1])
    return np.interp(TIME, t, out)


def test_nothing_is_missing_where_nothing_is_hidden() -> None:
    found = twin.diagnose(rod(), data_of(arcs(TRUE, course(TIME))))
    assert found.verdict == "none needed"


def test_a_late_pressure_and_a_wrong_scale_are_named() -> None:
    program = rod()
    assert twin.diagnose(program, data_of(arcs(TRUE, late(0.4)))).named == ("pressure_lag",)
    once = len(program.runs)
    assert twin.diagnose(program, data_of(arcs(TRUE, late(0.4)))).named == ("pressure_lag",)
    assert len(program.runs) == once  # a second diagnosis asks nothing anew
    u = arcs(TRUE, course(TIME))
    found = twin.diagnose(program, data_of(u + 0.02 * (u + np.array(list(PLACES.values())))))
    assert found.named[0] == "camera_scale"
    assert found.diagnosis.mechanisms[0] is Mechanism.PICTURE


def test_a_variant_of_its_own_is_named() -> None:
    taper = Variant(Parameter("taper", -0.9, 0.9, "", null=0.0, typical=0.05, plausible=(-0.5, 0.5)), "it thins out")
    found = twin.diagnose(rod(variants=[taper]), data_of(arcs(TRUE | {"taper": 0.1}, course(TIME))))
    assert found.named == ("taper",)
    assert found.diagnosis.mechanisms == (Mechanism.BODY,)
    says(str(found), "It thins out: taper is 0.1")


def test_a_body_that_the_program_cannot_have_is_called_by_no_other_name() -> None:
    """Three points of one plane: a tilted camera does nearly the same."""
    found = twin.diagnose(rod(), data_of(arcs(TRUE | {"taper": 0.1}, course(TIME))))
    assert (found.verdict, found.diagnosis.mechanisms[0]) == ("none of these", Mechanism.BODY)
    says(str(found), "The rest looks like a body that bends more at 25 % of its length")
    # A taper of 0.1 bends the first 3/8 more by 6 %, the last by as much less; one hinge of three says it.
    says(str(found), "Next test: the same run with the walls about 7 % thinner from 0 % to 38 % of its length: give your")
    says(str(found), "variants= of twin.simulator")


def test_no_run_is_wanted_where_an_effect_is_named_or_the_rest_is_of_the_picture() -> None:
    u = arcs(TRUE, course(TIME))
    assert twin.diagnose(rod(), data_of(u)).diagnosis.next_test == ""
    assert twin.diagnose(rod(), data_of(arcs(TRUE, late(0.4)))).diagnosis.next_test == ""


def test_its_derivatives_are_those_of_its_answers() -> None:
    data = data_of(arcs(TRUE, course(TIME)))
    base = ForeignModel.of(rod(), data)
    (lag,) = [e for e in candidates(base.test) if e.name == "pressure_lag"]
    model, values = base.with_effect(lag), {**TRUE, "pressure_lag.tau": 0.3}
    theta = model.theta(values)
    for k, p in enumerate(model.parameters):
        h = 1e-3 * p.step
        ends = [model.predict(theta + s * h * np.eye(3)[k]) for s in (1, -1)]
        wanted = (ends[0] - ends[1]) / (2 * h)
        # differenced over a tenth of a typical step, 1 % of the highest pressure
        np.testing.assert_allclose(model.jacobian(theta)[k], wanted, rtol=0, atol=3e-3 * np.abs(wanted).max())


def test_moduli_that_drift_act_as_another_pressure() -> None:
    base = ForeignModel.of(rod(), data_of(arcs(TRUE, course(TIME))))
    (thermal,) = [e for e in candidates(base.test) if e.name == "thermal"]
    model = base.with_effect(thermal)
    u = model.predict(model.theta({**TRUE, "thermal.rate": 1e-3}))
    wanted = arcs(TRUE, course(TIME) / (1 + 1e-3 * TIME))
    np.testing.assert_allclose(u, wanted - wanted[0], rtol=0, atol=2e-3)  # mm: the log is read between its rows


def test_only_effects_that_need_no_structure_are_tried() -> None:
    test = ForeignModel.of(rod(), data_of(arcs(TRUE, course(TIME)))).test
    names = {e.name for e in candidates(test)}
    assert {"creep", "thermal", "pressure_lag", "pressure_gain", "pressure_offset", "time_shift", "camera_scale"} <= names
    assert not names & {"wall_taper", "mullins", "gravity", "clamp", "marker_slip", "tube", "hoop_reinforcement"}
    assert {e.kind for e in plain_stand_ins(test)} >= {"pressure course", "camera"}


def test_scatter_is_carried_or_refused_and_a_start_must_answer() -> None:
    rng, u = np.random.default_rng(5), arcs(TRUE, course(TIME))

    def noisy(sd: float) -> Simulator:
        return twin.simulator(lambda v, p: arcs(v, p) + sd * rng.standard_normal((len(p), 3, 3)), [STIFF, BEND])

    assert twin.diagnose(noisy(0.02), data_of(u), stand_ins=False).verdict == "none needed"
    with pytest.raises(ValueError, match=r"scatter by 0.\d+ mm, .* noise of the data \(0.05 mm\)"):
        twin.diagnose(noisy(0.5), data_of(u))
    with pytest.raises(ValueError, match=r"failed at curvature = 0.5, bend = 0: .*wanted a start"):
        twin.diagnose(twin.simulator(lambda v, p: 1 / 0, [STIFF, BEND]), data_of(u))
    with pytest.raises(ValueError, match="data: none; wanted the targets"):
        twin.diagnose(rod())


@pytest.mark.parametrize("failing", [lambda values: values["curvature"] > 0.403, lambda values: values["bend"] < 2.5])
def test_a_program_that_fails_beside_the_fit_is_diagnosed_all_the_same(failing: Callable[[Values], bool]) -> None:
    """It answers on one side alone of a parameter: so the derivative is taken there."""

    def predict(values: Values, pressure: Array) -> Array:
        if failing(values):
            raise RuntimeError("no convergence")
        return arcs(values, pressure) if values["curvature"] > 0.1 else np.full((len(pressure), 3, 3), np.nan)

    near = Parameter("curvature", 0.05, 2.0, "1/(mm MPa)", start=0.38, typical=0.05)
    bent = Parameter("bend", -20.0, 20.0, "1/(mm MPa2)", start=2.6, typical=1.0)
    found = twin.diagnose(twin.simulator(predict, [near, bent]), data_of(arcs(TRUE, late(0.4))), stand_ins=False)
    assert found.named == ("pressure_lag",)


def test_a_program_that_answers_at_its_start_alone_is_refused() -> None:
    def predict(values: Values, pressure: Array) -> Array:
        return arcs(values, pressure) if values["curvature"] == 0.5 else np.full((len(pressure), 3, 3), np.nan)

    with pytest.raises(ValueError, match=r"nan at step 0, at curvature = .*wanted bounds of its parameters within"):
        twin.diagnose(twin.simulator(predict, [STIFF, BEND]), data_of(arcs(TRUE, course(TIME))))


def test_a_program_of_30_s_a_run_tells_how_far_it_is_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock, data = [0.0], data_of(arcs(TRUE, course(TIME)))
    monkeypatch.setattr(slowruns, "monotonic", lambda: clock[0])

    def predict(values: Values, pressure: Array) -> Array:
        clock[0] += 30.0
        if clock[0] == 300.0:
            raise KeyboardInterrupt
        return arcs(values, pressure)

    program = twin.simulator(predict, [STIFF, BEND], keep=tmp_path / "runs")
    with pytest.raises(KeyboardInterrupt):
        twin.diagnose(program, data)
    assert len(list((tmp_path / "runs").glob("*.npz"))) == 8  # of ten, the second asked once more for its scatter
    said = Lines()
    again = twin.simulator(predict, [STIFF, BEND], keep=tmp_path / "runs")
    assert twin.diagnose(again, data, say=said).verdict == "none needed"
    assert clock[0] == 30.0 * (len(again.runs) - 8 + 10 + 1)  # nothing twice but the run that was stopped, and scatter
    for lines in (capsys.readouterr().err.splitlines(), said):
        says(lines[0], "takes 30 s a run", "so it takes 15 to 125 min. Each is kept in", "it goes on there")
        says(lines[1], "runs of the simulator")
    twin.diagnose(twin.simulator(predict, [STIFF, BEND]), data)
    says(capsys.readouterr().err, 'keep="runs"')
