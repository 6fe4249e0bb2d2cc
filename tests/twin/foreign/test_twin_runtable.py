"""A table of runs stands for the program that made them, with an error that is right."""

import csv
from pathlib import Path

import numpy as np
import pytest

import twin
from calibrate import Parameter
from tests.messages import Lines
from tests.twin.foreign.arcs import PLACES, TIME, TRUE, arcs, course, data_of
from twin.commands.exploredesign import export_design
from twin.effects.protocol import Unsolvable
from twin.foreign.programs import Variant
from twin.foreign.runtable import design, of_runs, read_runs, table_of

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


def made_elsewhere(runs: Path, answers: Path) -> None:
    """A program of its own that reads a design, and writes what it finds, without y and with x and z alone."""
    with runs.open(encoding="utf-8", newline="") as stream, answers.open("w", encoding="utf-8", newline="") as out:
        table = csv.writer(out)
        table.writerow(["run", *(f"{name}_{axis}_mm" for name in PLACES for axis in "xz")])
        for row in csv.DictReader(stream):
            values = {name: float(text) for name, text in row.items() if name != "run"}
            u = arcs(values, course(TIME))[:, :, ::2].reshape(len(TIME), -1)
            table.writerows([row["run"], *map(repr, line)] for line in u.tolist())


def test_a_design_that_is_run_elsewhere_is_read_back(tmp_path: Path) -> None:
    runs, answers, say = tmp_path / "design.csv", tmp_path / "answers.csv", Lines()
    over = ["curvature=0.3:0.5", "bend=0:6", "taper=-0.15:0.15"]
    export_design(over, runs, say, runs=120, seed=1)
    made_elsewhere(runs, answers)
    taper = Variant(Parameter("taper", -0.15, 0.15, "", null=0.0, typical=0.05, plausible=(-0.1, 0.1)))
    data = data_of(arcs(TRUE | {"taper": 0.1}, course(TIME)))
    program = read_runs(runs, answers, NEAR, data, variants=[taper])
    assert program.error_mm < 0.05  # the noise
    asked = TRUE | {"taper": 0.1}
    off = program.at(asked, course(TIME), course(TIME), len(PLACES)) - arcs(asked, course(TIME))
    assert np.sqrt(np.mean(off**2)) < program.error_mm
    assert twin.diagnose(program, data).named == ("taper",)
    with pytest.raises(ValueError, match=r"design.csv: it is there already"):
        export_design(over, runs, say, runs=120, seed=1)
    with pytest.raises(ValueError, match="--runs 6: wanted 7 or more for 3 parameters"):
        export_design(over, tmp_path / "few.csv", say, runs=6, seed=1)
    short = tmp_path / "short.csv"
    short.write_text("\n".join(answers.read_text(encoding="utf-8").splitlines()[:-1]), encoding="utf-8")
    with pytest.raises(ValueError, match=r"short.csv: run 120 has 79 rows; wanted 80"):
        read_runs(runs, short, NEAR, data, variants=[taper])
    with pytest.raises(ValueError, match=r"design.csv.* hinge"):
        read_runs(runs, answers, (*NEAR, Parameter("hinge", 0.0, 1.0)), data)


def test_a_table_of_a_design_has_its_runs_in_order() -> None:
    runs = design(NEAR, 8)
    assert [row["run"] for row in table_of(runs).records] == list(range(1, 9))
    assert [{n: row[n] for n in runs[0]} for row in table_of(runs).records] == runs
