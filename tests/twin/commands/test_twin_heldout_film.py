"""The chain on three films of which one is held out: calibrate, diagnose and the report."""

import numpy as np
import pytest

from fe import Case, Lattice, Material
from tests.twin.commands.test_twin_chain import NAMES, Silent, X, project_at, read
from twin import virtual
from twin.commands.add import run_add
from twin.commands.calibrate import run_calibrate
from twin.commands.confirm import run_confirm
from twin.commands.diagnose import run_diagnose
from twin.commands.review import run_review
from twin.inputs.films import FilmTargets, joined
from twin.model.structure import BuiltIn
from twin.project.folder import Project
from twin.project.record import SourceRecord
from twin.project.targetfiles import write_targets

FILMS = {
    "slow": ((0.0, 0.0), (2.0, 0.0), (5.0, 30.0), (12.0, 30.0), (14.0, 0.0), (17.0, 0.0)),
    "steps": ((0.0, 0.0), (2.0, 0.0), (2.6, 15.0), (7.0, 15.0), (7.6, 27.0), (12.0, 27.0)),
}
pytestmark = pytest.mark.slow  # a minute of one core; test_twin_several.py has the small version
BENCH = virtual.Bench(film_hz=4.0, gauge_sd_MPa=3e-4, sd=0.005)


@pytest.fixture(scope="module")
def found(
    tmp_path_factory: pytest.TempPathFactory, short_case: Case, short_builtin: BuiltIn
) -> tuple[Project, Silent]:
    """The project of a creeping finger after calibrate, diagnose and review."""
    folder = tmp_path_factory.mktemp("films") / "batch"
    project = project_at(folder, short_case, short_builtin)
    (folder / "targets").rename(folder / "targets-0001")
    edge = np.stack([X, np.full_like(X, 11.5), np.zeros_like(X)], axis=1)
    rows = np.linalg.norm(short_case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    places = short_case.nodes[rows]
    material = Material(0.214, 0.083, prony=((0.075, 1.2), (0.055, 3.5), (0.02, 15.0)))
    truth = virtual.truth_case(
        short_builtin.finger, Lattice(per_bellow=2, centred=False), material=material, element=None
    )
    films = []
    for k, (name, corners) in enumerate(FILMS.items()):
        course = virtual.path(BENCH, protocol=corners)
        u, slope = virtual.displaced(truth, course, places)
        points = virtual.at_nodes(NAMES, short_case.labels[rows], places)
        drawn = virtual.noisy_targets(u, slope, course, points=points, bench=BENCH, seed=1 + k)
        films.append(FilmTargets(name=name, log=f"{name}.csv", targets=drawn, held_out=name == "steps"))
    targets, told = joined(films)
    write_targets(folder / "targets", targets, source=SourceRecord(films=tuple(told)))
    say = Silent()
    run_calibrate(project, say)
    run_diagnose(project, say)
    run_review(project, say)
    return project, say


def test_a_held_out_film_is_foretold_better_with_the_named_effect(found: tuple[Project, Silent]) -> None:
    project, say = found
    diagnosis = read(project, "diagnose", "diagnosis.json")
    (row,) = diagnosis["held_out"]  # type: ignore[misc]
    assert diagnosis["named"] == ["creep"]
    assert row["film"] == "steps"
    # creep is planted in the film that was not fitted, too: its error falls, 1.73 times with this seed
    assert row["ratio"] > 1.4
    assert row["ratio"] == pytest.approx(row["before"]["rms_mm"] / row["after"]["rms_mm"])
    assert any(line.startswith("Held out, steps: ") for line in say.lines)
    (fitted,) = read(project, "calibrate", "comparison.json")["held_out"]  # type: ignore[misc]
    assert fitted["film"] == "steps"
    assert fitted["rms_mm"] == pytest.approx(row["before"]["rms_mm"], rel=1e-3)


def test_a_held_out_film_of_markers_that_sit_elsewhere_refutes_the_model(found: tuple[Project, Silent]) -> None:
    project, say = found
    row = read(project, "diagnose", "diagnosis.json")["held_out"][0]  # type: ignore[index]
    # the markers of each film are placed anew, and the model takes them for the same
    assert max(row["p_before"], row["p_after"]) < 1e-6
    assert row["outcome"] == "refuted"
    run_add(project, say, names=["creep"])
    added = Project.open(project.root, builtin=project.builtin)
    for name in ("steps", "1"):
        run_confirm(added, say, name)
        told = read(added, "confirm", "confirmation.json")["film"]
        assert told["outcome"] == "refuted"  # type: ignore[index]
    assert any("so it is refuted" in line for line in say.lines)
    with pytest.raises(ValueError, match=r"film 'slow' is not held out, or not measured; wanted one of 1, steps: hold one out"):
        run_confirm(added, say, "slow")


def test_the_report_shows_the_held_out_film(found: tuple[Project, Silent]) -> None:
    path = found[0].newest("review", "report.html")
    assert path is not None
    text = path.read_text(encoding="utf-8")
    assert "Films that no fit has seen" in text
    assert "<td>steps</td>" in text
