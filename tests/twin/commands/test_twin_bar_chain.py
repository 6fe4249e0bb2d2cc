"""A bar of the program that bends by its weight and hung weights: from `init` over `calibrate` to `compare`.

The truth is the same 27-node element on a finer mesh. From 20-node hybrid elements (C3D20H), which are stiffer,
C10 came out 0.7 % higher, 8 of its sd.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import Case
from fe.mesh.finger import NAMED_NODES
from fe.mesh.points import nearest
from tests.messages import Lines
from tests.twin.conftest import plain_targets
from twin.bodies.bar import BarTable
from twin.calibrated.predictions import WantedCourse, after
from twin.commands.calibrate import run_calibrate
from twin.commands.compare import run_compare
from twin.commands.init import run_init
from twin.commands.predict import run_predict
from twin.commands.predictweights import loads_of_words, weight_notes
from twin.effects.material import Elasticity
from twin.laws.catalogue import LAWS
from twin.model.keptmodel import base_model
from twin.model.structure import body_case
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.targets import Load, Noise, PointKind, TargetPoint, Targets

BAR = BarTable(length_mm=60.0, width_mm=12.0, height_mm=12.0).body
DENSITY = 1.07e-9  # tonne/mm3
SD = 0.01  # mm
TRUTH = 0.12  # MPa, C10
NAMES = ("tip", "middle")


def measured_shape() -> Targets:
    """The test that `measured` fills: 5 and then 10 g hang from the bar's end."""
    time, own = np.arange(12.0), body_case(BAR, BAR.lattice)
    places = np.array([nearest(truth(), own.position(NAMED_NODES[n])) for n in NAMES])
    points = (*(TargetPoint(n, PointKind.PLACE, None, tuple(map(float, x))) for n, x in zip(NAMES, places, strict=True)),
              TargetPoint("fixed", PointKind.FIXED, None, (0.0, 0.0, 30.0)))  # fmt: skip
    shape = (len(time), len(points), 3)
    end = (60.0, 0.0, 6.0)
    return plain_targets(
        time=time, pressure=np.zeros(12), log_time=time, log_pressure=np.zeros(12), value=np.zeros(shape),
        block=np.repeat([0, 1, 2], 4), held_out=np.zeros(12, bool), points=points, valid=np.ones(shape, bool),
        covariance=np.tile(SD**2 * np.eye(3), (12, 3, 1, 1)), modes=np.zeros((0, *shape)),
        reference=np.arange(4), pressure_sd=np.zeros(12), gravity=np.tile([0.0, 0.0, -1.0], (3, 1)),
        loads=(Load(1, end, weight_g=5.0), Load(2, end, weight_g=10.0)),
    )  # fmt: skip


def truth() -> Case:
    """The bar on a finer mesh."""
    return body_case(BAR, BAR.finer(BAR.lattice)["check"]).with_material(density=DENSITY)


def measured() -> Targets:
    """How places of a bar, on a finer mesh, move."""
    t = measured_shape()
    model = base_model(t, truth(), elasticity=Elasticity(LAWS["neo-hooke"]))
    value = model.predict(model.theta({"C10": TRUTH}))
    noise = np.random.default_rng(2).normal(0.0, SD, t.value.shape)
    told = Noise(sd=np.full((3, 3), SD), rho=np.zeros((3, 3)), correlation=np.eye(9), frames=300,
                 codec_sd=np.zeros((3, 3)), gauge_sd_MPa=0.0, gauge_frames=300)  # fmt: skip
    return replace(t, value=value + noise, noise=told)


def test_a_weight_is_asked_for_by_its_place_and_grams() -> None:
    t = measured_shape()
    assert loads_of_words(t, ()) is None
    assert loads_of_words(t, ("tip=7", "60,0,6=2.5")) == (Load(0, "tip", weight_g=7.0), Load(0, (60.0, 0.0, 6.0), weight_g=2.5))
    for text in ("tip", "fixed=7", "60,0=7", "tip=-1", "tip=0", "=7"):
        with pytest.raises(ValueError, match=r"wanted a point \(tip, middle\) or x,y,z in mm, and the grams"):
            loads_of_words(t, (text,))
    with pytest.raises(ValueError, match="no direction of gravity"):
        loads_of_words(replace(t, gravity=None), ("tip=7",))
    with pytest.raises(ValueError, match="relative to its own rest"):
        loads_of_words(replace(t, reference=np.array([0, 4, 8])), ("tip=7",))


def test_a_weight_is_foretold_from_the_rest_in_which_a_hand_holds_the_bar_unloaded() -> None:
    shape = measured_shape()
    t = replace(shape, reference=np.array([0, 4, 8]), released=(0, 1, 2))
    assert loads_of_words(t, ("60,0,6=10",)) == (Load(0, (60.0, 0.0, 6.0), weight_g=10.0),)
    course = WantedCourse.held(0.0, ramp_s=1.0, hold_s=1.0, loads=(Load(0, (60.0, 0.0, 6.0), weight_g=10.0),))
    wanted, theta = after(t, [course], {}), [TRUTH]
    assert wanted.released == (0, 1, 2, 3)
    assert after(shape, [course], {}).released == ()
    u = base_model(wanted, truth(), elasticity=Elasticity(LAWS["neo-hooke"])).predict(np.array(theta))
    np.testing.assert_allclose(u[12], 0.0, atol=1e-9)
    np.testing.assert_allclose(u[-1], u[11], atol=1e-4)  # as the block of 10 g
    assert u[-1, 0, 2] < 1.2 * base_model(shape, truth(), elasticity=Elasticity(LAWS["neo-hooke"])).predict(
        np.array(theta))[11, 0, 2]  # its own weight acts, too  # fmt: skip


@pytest.mark.parametrize(("grams", "told"), [(10.0, []), (12.0, ["12 g hang on it, and more than the 10 g in the test"])])
def test_a_weight_beyond_those_of_the_test_is_told(grams: float, told: list[str]) -> None:
    course = WantedCourse.held(0.0, ramp_s=1.0, hold_s=1.0, loads=(Load(0, "tip", weight_g=grams),))
    notes = weight_notes(measured_shape(), course)
    assert [note.partition(":")[0] for note in notes] == told


@pytest.mark.slow
def test_a_bar_is_calibrated_by_the_weights_that_hang_from_it(tmp_path: Path, say: Lines) -> None:
    write_targets(tmp_path / "t", measured())
    run_init(tmp_path / "p", say, targets=tmp_path / "t", body="bar:length_mm=60,width_mm=12,height_mm=12",
             density_kg_m3=DENSITY * 1e12)  # fmt: skip
    toml = tmp_path / "p" / "twin.toml"
    text = toml.read_text().replace("population = 30", "population = 12").replace("generations = 20", "generations = 3")
    toml.write_text(text.replace("[model]\n", '[model]\nlaw = "neo-hooke"\n'))
    project = Project.open(tmp_path / "p")
    found = run_calibrate(project, say)
    row = found["fit"]["parameters"]["C10"]
    assert row["sd"] < 0.05 * TRUTH
    assert abs(row["value"] - TRUTH) < 3 * row["sd"]
    compared = run_compare(project, say)
    assert compared["p_value"] > 1e-3
    assert compared["raw_rms_mm"] < 1.5 * SD
    seen = run_predict(project, say, weight=("60,0,6=10",))["points"]
    hung = measured().value[8:12].mean(axis=0)
    for k, name in enumerate(NAMES):  # as the block of 10 g was measured: four steps with SD, and the fit's own error
        row = next(r for r in seen if r["point"] == name)
        np.testing.assert_allclose(row["u_mm"], hung[k], atol=4 * SD)
        assert row["pressure_MPa"] == 0.0
    assert not any("nobody has seen" in line for line in say.lines)
