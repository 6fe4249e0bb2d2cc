"""What a hung weight tells: the stiffness from the gauge, from data of another mesh; and what the model asks."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibrate import Fit, least_squares
from fe import Case, Lattice
from tests.twin.conftest import SHORT
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.model.keptmodel import base_model
from twin.model.structure import base_case
from twin.targets import Array, Load, Targets

BLOCKS = np.array([0, 0, 0, 0, 0, 1, 1, 1])
DOWN = np.tile([0.0, 0.0, -1.0], (2, 1))
END = (SHORT.length, 0.0, 8.0)  # on the end face, in the plane of symmetry
GAIN, SD = 0.06, 0.01  # what is planted; mm


def with_weight(make_targets: Callable[..., Targets], grams: float | None) -> Targets:
    loads = () if grams is None else (Load(1, END, weight_g=grams),)
    return make_targets(block=BLOCKS, gravity=DOWN, loads=loads)


def of_truth(t: Targets, gain: float) -> Array:
    """What the targets' points show of a finger on another mesh, whose gauge reads too little by `gain`."""
    finer = base_case(finger=SHORT, lattice=Lattice(per_bellow=3, wall=1, centred=True))
    elasticity = Elasticity(fixed={"C01": 0.083})
    model = base_model(t, finer, elasticity=elasticity).with_effect(effect("pressure_gain"))
    return model.predict(model.theta({"C10": 0.214, "pressure_gain.gain": gain}))


@pytest.fixture
def at_places(make_targets: Callable[..., Targets], short_case: Case) -> Callable[[float | None], Targets]:
    """Targets whose points are told by place, so that another mesh has them too, under a weight in block 1."""

    def make(grams: float | None) -> Targets:
        t = with_weight(make_targets, grams)
        points = tuple(
            replace(p, kind=type(p.kind).PLACE, node=None, position=tuple(short_case.position(p.node)))
            if p.node is not None else p for p in t.points
        )  # fmt: skip
        return replace(t, points=points)

    return make


def fitted(t: Targets, case: Case, gain: float) -> Fit:
    """The fit of C10 and the gauge's gain to what the truth shows."""
    model = base_model(t, case, elasticity=Elasticity(fixed={"C01": 0.083}))
    model, measured = model.with_effect(effect("pressure_gain")), of_truth(t, gain)
    return least_squares(
        lambda x: ((measured - model.predict(x)) / SD).ravel(),
        lambda x: -(model.jacobian(x) / SD).reshape(len(x), -1).T,
        model.parameters,
        start=np.array([0.25, 0.0]),
    )


@pytest.mark.slow
def test_twenty_grams_tell_the_gauge_from_the_silicone(
    at_places: Callable[[float | None], Targets], short_case: Case
) -> None:
    hung = at_places(20.0)
    right, low = (fitted(hung, short_case, gain) for gain in (0.0, GAIN))
    # such coarse meshes differ by a tenth under pressure, which both gains take up
    assert (1 + low.theta[1]) / (1 + right.theta[1]) == pytest.approx(1 + GAIN, abs=0.01)
    assert low.theta[0] == pytest.approx(right.theta[0], rel=0.01)
    model = base_model(at_places(None), short_case, elasticity=Elasticity(fixed={"C01": 0.083}))
    J = model.with_effect(effect("pressure_gain")).jacobian(low.theta).reshape(2, -1) / SD
    # pressure alone tells them apart only as far as C01, held fixed, bends the response
    alone = np.sqrt(np.diag(np.linalg.inv(J @ J.T)))
    assert (alone > 3 * np.sqrt(np.diag(low.covariance))).all()


def test_a_weight_beside_the_middle_asks_for_the_whole_finger(
    make_targets: Callable[..., Targets], short_case: Case
) -> None:
    in_the_middle = base_model(with_weight(make_targets, 20.0), short_case)
    assert in_the_middle.extent.startswith("Half model")
    t = make_targets(block=BLOCKS, gravity=DOWN, loads=(Load(1, "tip", weight_g=20.0),))
    assert base_model(t, short_case).extent == "Whole model: a hung load breaks the symmetry."


def test_a_weight_without_gravity_is_refused(make_targets: Callable[..., Targets], short_case: Case) -> None:
    t = make_targets(block=BLOCKS, loads=(Load(1, "tip", weight_g=20.0),))
    with pytest.raises(ValueError, match=r"block 1 has a weight of 20 g, which pulls along gravity"):
        base_model(t, short_case)


def test_a_weight_acts_in_its_own_block_alone(make_targets: Callable[..., Targets], short_case: Case) -> None:
    theta = np.array([0.214, 0.083])
    plain, hung = (base_model(with_weight(make_targets, g), short_case).predict(theta) for g in (None, 20.0))
    np.testing.assert_allclose(hung[BLOCKS == 0], plain[BLOCKS == 0], atol=1e-6)
    assert (hung[BLOCKS == 1, 0, 2] < plain[BLOCKS == 1, 0, 2] - 0.1).all()  # the tip hangs lower
