"""Points of a speckled face in targets: no node, their own place in the model, through files and the model."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import Case, solve
from fe import Path as Load
from tests.messages import saying
from twin.model.keptmodel import base_test
from twin.project.targetfiles import read_targets, write_targets
from twin.targets import PointKind, TargetPoint, Targets, as_position


@pytest.fixture
def targets(make_targets: Callable[..., Targets], short_case: Case) -> Targets:
    """The tip, a point between two nodes of the lower edge, a fixed marker."""
    t = make_targets()
    a, b = short_case.position(4401), short_case.position(5848)
    between = TargetPoint("face001", PointKind.PLACE, None, as_position(0.3 * a + 0.7 * b))
    return replace(t, points=(t.points[0], between, t.points[2]))


def test_a_point_that_is_no_node_is_predicted_where_it_is(targets: Targets, short_case: Case) -> None:
    test = base_test(targets, short_case)
    assert test.points[1] == pytest.approx(np.array(targets.points[1].position))
    assert test.points[0] == pytest.approx(short_case.position(4401))
    u = solve(short_case, Load(np.array([0.0, 1.0]), np.array([0.0, 0.005]), np.array([1.0]))).at(
        test.points[:2]
    )
    assert u[0, 1, 2] < -0.01  # mm: it bends, and less than the tip
    assert u[0, 0, 2] < u[0, 1, 2]


def test_its_place_survives_the_files(targets: Targets, tmp_path: Path) -> None:
    write_targets(tmp_path / "targets", targets)
    again = read_targets(tmp_path / "targets", nodes={"tip": 4401})
    assert again.points == targets.points


def test_the_files_of_older_versions_have_a_place_as_node_minus_two(targets: Targets, tmp_path: Path) -> None:
    write_targets(tmp_path / "targets", targets)
    file = tmp_path / "targets" / "targets.toml"
    now = file.read_text()
    file.write_text(now.replace('role = "place"', 'role = "finger"\nnode = -2'))
    assert file.read_text() != now
    assert read_targets(tmp_path / "targets").points == targets.points


def test_a_place_states_its_position() -> None:
    with pytest.raises(ValueError, match=saying("'a'", "position_mm", "x")):
        TargetPoint("a", PointKind.PLACE)
    for kind, node in ((PointKind.FIXED, 3), (PointKind.NODE, None)):
        with pytest.raises(ValueError, match=f"'a' is '{kind.value}' with node {node}; wanted a node label for"):
            TargetPoint("a", kind, node, (0.0, 0.0, 0.0))
