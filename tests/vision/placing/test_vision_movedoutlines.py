"""The film's edges beside the outline of a moved model, and tags beside them, in drawn pictures."""

from benchmarks.films.outlines import SLIPS, STATED, WALL_MM, Moment, draw, model_faces, moment

import numpy as np
import pytest

from twin.inputs.outlines import ModelOutline
from twin.model.structure import body_case
from vision.placing.movedoutlines import LEAST_MM, RestEdges, Spine, apart_at
from vision.placing.outlines import fit_outline
from vision.placing.restplaces import BodyPose
from vision.placing.silhouettes import BodySurface

SLIP_MM = 0.8


@pytest.fixture(scope="module")
def film() -> tuple[Moment, Moment]:
    """Two moments of a drawn film; a tag has slipped before the second."""
    rng = np.random.default_rng(4)
    light = rng.normal(0, 1.0, 2)
    d = draw(rng, distance=500.0, light=light)
    case = body_case(STATED.body, STATED.body.lattice)
    model = ModelOutline.of(STATED, dict.fromkeys(STATED.body.inner, WALL_MM))
    solid = BodySurface(model_faces(case), case.nodes[case.clamped])
    edges = RestEdges.of(fit_outline(d.rest, model, BodyPose()).fit, solid)
    first, second = (moment(d, edges, case, rng, light=light, slip=slip) for slip in (0.0, SLIP_MM))
    return first, second


def test_edges_within_their_sds(film: tuple[Moment, Moment]) -> None:
    for m in film:
        seen = np.isfinite(m.outline.off)
        assert seen.sum() > 60  # of both edges
        assert {True, False} == set(m.outline.body[seen][:, 2] > STATED.height_mm / 2)
        assert np.sqrt(np.mean(m.pull[seen] ** 2)) < 2.0
        assert np.median(m.outline.sd[seen]) < 0.15
        assert np.abs(m.outline.off[seen]).max() > 0.1  # the model is off, which the edges show


def test_a_tag_that_slipped_is_told_from_the_body(film: tuple[Moment, Moment]) -> None:
    first, second = (m.tags.swapaxes(0, 1) for m in film)
    for (off, sd), slip in ((first, 0.0), (second, SLIP_MM)):
        off[SLIPS, 0] -= slip  # along the finger
        assert (np.abs(off) < np.maximum(3.0 * sd, LEAST_MM)).all()
    assert second[1][SLIPS, 0] < 0.25 * SLIP_MM


def test_a_tag_is_apart_at_several_moments() -> None:
    sd = np.full((4, 2), 0.05)
    off = np.zeros((4, 2))
    off[2, 0] = 0.5
    assert not len(apart_at(off, sd))  # a single moment may be an edge that was found wrongly
    off[3, 0] = 0.5
    assert list(apart_at(off, sd)) == [2, 3]
    assert not len(apart_at(off, 4.0 * sd))
    assert not len(apart_at(0.3 * off, 0.1 * sd))  # glue gives way by less than 0.2 mm
    assert not len(apart_at(np.full((4, 2), np.nan), sd))


def test_motions_of_a_spine() -> None:
    """Of a straight body: more curvature lifts its tip, a longer one moves along; what is clamped stays."""
    rest = np.stack(np.meshgrid([0.0, 20.0, 40.0, 60.0], [-5.0, 5.0], [0.0, 10.0], indexing="ij"), axis=-1)
    rest = np.concatenate([rest.reshape(1, -1, 3), np.linspace([0.0, 0, 5], [60.0, 0, 5], 16)[None]], axis=1)
    spine = Spine.of(rest, rest[..., [0, 2]])
    x = np.array([0.0, 30.0, 60.0])
    bend, *_, longer, _, _, _, _ = np.moveaxis(spine.motions(x, np.column_stack([x, 0 * x + 5.0])), 2, 0)
    np.testing.assert_allclose(bend[:, 1], 3.0 * (x / 60.0) ** 2, atol=0.02)
    np.testing.assert_allclose(bend[:, 0], 0.0, atol=1e-6)
    np.testing.assert_allclose(spine.direction(x), np.tile([1.0, 0.0], (3, 1)), atol=1e-9)
    assert longer[0] == pytest.approx([0.0, 0.0], abs=0.02)
