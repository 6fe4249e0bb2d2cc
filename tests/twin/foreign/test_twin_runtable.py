"""A table of runs stands for the program that made them, with an error that is right."""

import numpy as np
import pytest

import twin
from calibrate import Parameter
from tests.twin.foreign.arcs import PLACES, TIME, TRUE, arcs, course, data_of
from twin.effects.protocol import Unsolvable
from twin.foreign.runtable import design, of_runs

NEAR = (Parameter("curvature", 0.3, 0.5, "1/(mm MPa)", start=0.38, typical=0.02), Parameter("bend", 0.0, 6.0, "1/(mm MPa2)", start=2.0, typical=1.0))


def answers(runs: list[dict[str, float]]) -> np.ndarray:
    return np.array([arcs(run, course(TIME)) for run in runs])


def test_its_error_is_no_less_than_that_between_the_runs() -> None:
    """A run that is left out at the rim is missed by more than what lies between all of them."""
    stated = []
    for count in (10, 30):
        runs = design(NEAR, count, seed=1)
        table = of_runs(NEAR, runs, answers(runs))
        asked = design(NEAR, 41, seed=2)[1:]
        off = [table.at(run, course(TIME), course(TIME), len(PLACES)) - arcs(run, course(TIME)) for run in asked]
        assert np.sqrt(np.mean(np.square(off))) < table.error_mm, count
        stated.append(table.error_mm)
    assert stated[1] < 0.2 * stated[0]


def test_what_its_program_lacks_is_named() -> None:
    runs = design(NEAR, 40, seed=1)
    table, places = of_runs(NEAR, runs, answers(runs)), np.array(list(PLACES.values()))
    assert table.error_mm < 0.04  # mm: the noise is 0.05
    u = arcs(TRUE, course(TIME))
    assert twin.diagnose(table, data_of(u + 0.02 * (u + places))).named[0] == "camera_scale"


def test_runs_that_tell_nothing_are_refused() -> None:
    runs = design(NEAR, 8)
    with pytest.raises(ValueError, match="3 runs of 2 parameters; wanted 5 or more"):
        of_runs(NEAR, runs[:3], answers(runs[:3]))
    with pytest.raises(ValueError, match=r"answers of shape \(7, .*wanted finite displacements \(8, s, p, 3\)"):
        of_runs(NEAR, runs, answers(runs[:7]))
    with pytest.raises(ValueError, match="runs without bend"):
        of_runs(NEAR, [{"curvature": run["curvature"]} for run in runs], answers(runs))
    same = [{**run, "bend": 1.0} for run in runs]
    with pytest.raises(ValueError, match="do not tell the parameters apart"):
        of_runs(NEAR, same, answers(same))
    with pytest.raises(Unsolvable, match="bend = 20: outside of all runs"):
        of_runs(NEAR, runs, answers(runs)).at({"curvature": 0.4, "bend": 20.0}, course(TIME), course(TIME), 3)
