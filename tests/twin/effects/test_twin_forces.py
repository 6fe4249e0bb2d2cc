"""A force at a place along the finger: its size, its moment, and the end face at the tip."""

from dataclasses import replace

import numpy as np
import pytest

from twin.contract.specimen import small_test
from twin.effects.forces import STATIONS, sections, shares
from twin.effects.library import effect
from twin.model.prediction import respond


@pytest.mark.parametrize("place", [0.05, 0.23, 0.5, 0.81, 1.0])
def test_sections_share_a_force_and_keep_its_moment(place: float) -> None:
    share = shares(place)
    assert share.sum() == pytest.approx(1.0, abs=1e-12)
    assert share @ [shares_at(k) for k in range(STATIONS)] == pytest.approx(place, abs=1e-12)
    assert (share > -1e-12).all()


def shares_at(k: int) -> float:
    """The place of a section: where the first moment of the splines puts it."""
    steps = STATIONS - 2  # intervals of splines of degree 2
    return float(np.mean(np.clip([(k - 1) / steps, k / steps], 0, 1)))


def test_sections_lie_where_their_forces_act_and_off_the_middle_plane() -> None:
    case = small_test().case
    x = case.nodes[:, 0]
    for k, rows in enumerate(sections(case)):
        assert (case.nodes[rows, 1] > 0).all()
        wanted = x.min() + shares_at(k) * np.ptp(x)
        # the mesh has nodes every 1 to 3 mm
        assert abs(case.nodes[rows, 0].mean() - wanted) < 1.6
    np.testing.assert_allclose(x[sections(case)[-1]], x.max(), rtol=0, atol=1e-9)


def test_a_pull_at_the_tip_is_that_of_its_end_face() -> None:
    test = small_test()
    tube = effect("tube:2")
    own = {"tube.up": 0.1, "tube.along": 0.05, "tube.place": 1.0}
    values = {**own, "tube.up_per_MPa": 1.0, "tube.along_per_MPa": -1.0}
    bare = replace(test, case=replace(test.case, forces={}))
    pulled = tube.before(bare, values)
    assert sum(pulled.case.forces.values()).tolist() == pytest.approx([0.025, 0.0, 0.05])  # of the half
    u = respond(pulled, (), start=None)[0]
    top = float(np.interp(1.5, test.path.time, test.path.pressure))
    force = 0.5 * np.array([0.05 - top, 0.0, 0.1 + top])
    face = replace(bare, case=replace(bare.case, forces={"tip_face": force}))
    wanted = respond(replace(face, path=replace(test.path, output=np.array([1.5]))), (), start=None)[0][0]
    none = respond(replace(bare, path=replace(test.path, output=np.array([1.5]))), (), start=None)[0][0]
    at = int(np.flatnonzero(test.path.output == 1.5)[0])
    # nodes on the middle plane carry none of it: the end face itself is dented otherwise
    np.testing.assert_allclose(u[at], wanted, rtol=0, atol=0.05 * np.abs(wanted - none).max())
