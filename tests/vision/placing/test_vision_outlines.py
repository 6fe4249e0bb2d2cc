"""Where the finger stands and how large it is, by its outline in drawn pictures."""

import re
from dataclasses import replace

from benchmarks.films.outlines import STATED, WALL_MM, Draw, draw

import numpy as np
import pytest

from tests.messages import saying
from twin.inputs.outlines import ModelOutline, SeenOutline
from vision.placing.outlines import Outline, fit_outline
from vision.placing.restpictures import RestSight
from vision.placing.restplaces import BodyPose
from vision.placing.waves import count_of


@pytest.fixture(scope="module")
def model() -> ModelOutline:
    return ModelOutline.of(STATED, dict.fromkeys(STATED.body.inner, WALL_MM))


@pytest.fixture(scope="module")
def drawn() -> Draw:
    return draw(np.random.default_rng(5), distance=500.0, longer=1.8)


@pytest.fixture(scope="module")
def found(drawn: Draw, model: ModelOutline) -> Outline:
    return fit_outline(drawn.rest, model, BodyPose())


def known_sizes() -> dict[str, float]:
    return {name: x for name, x in STATED.model_dump().items() if isinstance(x, float)}


def off(found: Outline, drawn: Draw) -> np.ndarray:
    a, b = found.pose, drawn.pose
    return np.array([a.x_mm - b.x_mm, a.z_mm - b.z_mm, a.turn - b.turn])


def test_pose_and_dimensions_within_their_sds(found: Outline, drawn: Draw) -> None:
    sd = np.sqrt(np.diag(found.covariance))
    assert (np.abs(off(found, drawn)) < 3.5 * sd).all()
    assert (sd < [0.3, 0.3, 0.002]).all()
    shown = {s.name: s for s in found.sizes if s.shown}
    assert {"length_mm", "height_mm", "pleat_depth_mm"} <= {*shown}
    assert not {"width_mm", "side_wall_mm", "bottom_wall_mm"} & {*shown}  # which no camera sees from the side
    for name in ("length_mm", "height_mm", "pleat_depth_mm"):
        assert abs(shown[name].off - drawn.sizes[name]) < 3.5 * shown[name].sd
        assert shown[name].sd < 0.3


def test_a_wrong_length_is_named(found: Outline, drawn: Draw) -> None:
    seen = SeenOutline(found, drawn.rest.picture, STATED.model_dump())
    assert any(line.startswith("model.length_mm = 70, the film shows 7") for line in seen.wrong)
    assert not any("pleat_depth" in line for line in seen.wrong) or abs(drawn.sizes["pleat_depth_mm"]) > 0.1
    assert seen.drawn().startswith(b"\x89PNG")


@pytest.mark.parametrize("stated", [3, 4, 6])
def test_pleats_are_counted_and_their_pitch_told(found: Outline, drawn: Draw, stated: int) -> None:
    table = STATED.model_copy(update={"pleats": stated})
    solid = ModelOutline.of(table, dict.fromkeys(STATED.body.inner, WALL_MM))({})
    sight = RestSight(drawn.rest)
    counted = count_of(sight, solid.waves, sight.outline(solid, drawn.pose), drawn.pose, 1.0)
    assert counted == STATED.pleats
    seen = SeenOutline(replace(found, counted=counted), drawn.rest.picture, known_sizes(), table)
    miscounted = [line for line in seen.wrong if line.startswith("model.pleats")]
    assert miscounted == [f"model.pleats = {stated}, the film shows 4: correct twin.toml."] * (stated != 4)
    true = STATED.model_copy(update={n: getattr(STATED, n) + mm for n, mm in drawn.sizes.items()}).pitch_mm
    (told,) = (line for line in seen.wrong if "have a pitch of 15 mm by twin.toml" in line)  # 1.8 mm longer
    value, sd = (float(x) for x in re.search(r"the film shows ([\d.]+) \+- ([\d.]+) mm", told).groups())  # type: ignore[union-attr]
    assert abs(value - true) < 3.5 * sd < 0.3


def test_the_cap_of_the_tip_is_told(found: Outline, drawn: Draw) -> None:
    (tip,) = (size for size in found.sizes if size.name == "tip_cap_mm")
    assert tip.shown
    assert abs(tip.off - drawn.sizes["tip_cap_mm"]) < 3.5 * tip.sd < 1.0


def test_what_is_known_of_the_pose_counts(drawn: Draw, model: ModelOutline) -> None:
    true, prior = drawn.pose, np.array([0.01, 0.01, 1e-4])
    known = fit_outline(drawn.rest, model, true, prior=prior)
    assert (np.sqrt(np.diag(known.covariance)) < 1.01 * prior).all()
    assert (np.abs(off(known, drawn)) < 3.5 * prior).all()


def test_an_outline_that_is_hidden_is_refused(drawn: Draw, model: ModelOutline) -> None:
    picture = drawn.rest.picture.copy()
    picture[:, 180:] = 120.0  # all but the tip
    with pytest.raises(ValueError, match=saying("outline of the finger shows", "wanted")):
        fit_outline(replace(drawn.rest, picture=picture), model, BodyPose())
    empty = np.random.default_rng(1).normal(120.0, 1.0, picture.shape)
    with pytest.raises(ValueError, match=saying("outline of the finger shows", "wanted")):
        fit_outline(replace(drawn.rest, picture=empty), model, BodyPose())


def test_a_strip_of_tape_along_the_edge_moves_nothing(found: Outline, drawn: Draw, model: ModelOutline) -> None:
    picture = drawn.rest.picture.copy()
    at = found.pixel[:, 0]
    taped = slice(*np.quantile(at, [0.3, 0.5]).astype(int).tolist())
    picture[:, taped] = np.roll(picture[:, taped], 4, axis=0)
    again = fit_outline(replace(drawn.rest, picture=picture), model, BodyPose())
    moved = np.subtract([again.pose.x_mm, again.pose.z_mm, again.pose.turn],
                        [found.pose.x_mm, found.pose.z_mm, found.pose.turn])  # fmt: skip
    assert (np.abs(moved) < np.sqrt(np.diag(found.covariance))).all()
