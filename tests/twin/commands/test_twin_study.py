"""The study stage on the study's own data set, for the short finger: seven figures, the table, the headline, what separates."""

import base64
import html
import json
import re
import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrate import Fit, Parameter
from fe import Case, solve
from fe import Path as Course
from tests.messages import Lines, says
from twin.commands.add import run_add
from twin.commands.check import run_check
from twin.commands.compare import run_compare
from twin.commands.diagnose import run_diagnose
from twin.commands.review import run_review
from twin.commands.study import run_study
from twin.laws.law import Constants
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, mooney_rivlin
from twin.model.structure import BuiltIn
from twin.numerals import short
from twin.project.folder import Project, dataset
from twin.study.identifiability import difference
from twin.study.reference import Reference

FIGURES = ("5a", "5b", "5c", "6a", "6b", "6c", "6d")
NODES = {"tip": (10 + 100 / 3, 11.5, 0.0), "middle": (4 + 50 / 3, 11.5, 0.0)}
TABLES = 2e-3  # of a displacement: the load paths are interpolated between five shares and along 61 pressures
SVG = "{http://www.w3.org/2000/svg}"


def study_at(folder: Path, *replaced: tuple[str, str]) -> Path:
    """The study's data set for the short finger, which moves a tenth of the whole one, with a short search."""
    source = dataset("study")
    (folder / "targets").mkdir(parents=True)
    text = (source / "twin.toml").read_text(encoding="utf-8")
    for old, new in (("generations = 20", "generations = 3"), *replaced):
        assert old in text
        text = text.replace(old, new)
    (folder / "twin.toml").write_text(text, encoding="utf-8")
    rows = (source / "targets" / "targets.csv").read_text(encoding="utf-8")
    rows = rows.replace("-58.0", "-5.8").replace("-19.0", "-2.2")
    (folder / "targets" / "targets.csv").write_text(rows, encoding="utf-8")
    return folder


@dataclass(frozen=True)
class Done:
    """A project after `twin study`: its lines, its record, its figures by name, and the report."""

    project: Project
    lines: list[str]
    record: dict[str, Any]
    figures: dict[str, str]
    report: str


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, short_builtin: BuiltIn) -> Done:
    say = Lines()
    project = Project.open(study_at(tmp_path_factory.mktemp("study") / "mine"), builtin=short_builtin)
    result = run_study(project, say)
    folder = project.root / "runs" / result["run"]
    record = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    figures = {name: (folder / f"figure-{name}.svg").read_text(encoding="utf-8").strip() for name in FIGURES}
    return Done(project, say.lines, record, figures, newest_report(project))


def newest_report(project: Project) -> str:
    path = project.newest("review", "report.html")
    assert path is not None
    return path.read_text(encoding="utf-8")


def drawn(figure: str, gid: str) -> np.ndarray:
    """The points (n, 2) of a curve or bar of an SVG by its id, y upwards."""
    group = next(g for g in ElementTree.fromstring(figure).iter() if g.get("id") == gid)
    path = group if group.tag == f"{SVG}path" else next(group.iter(f"{SVG}path"))
    numbers = re.findall(r"[ML] ([-\d.]+) ([-\d.]+)", path.get("d", "").replace("\n", " "))
    return np.array(numbers, float) * (1, -1)


def scale_of(figure: str, curves: dict[str, np.ndarray]) -> None:
    """Assert that one scale maps the values (n,) of every curve to where it is drawn: simplified lines lack points,
    so each drawn point is compared with the curve at its place along x."""
    ends = {gid: drawn(figure, gid) for gid in curves}
    own = np.concatenate([[v[0], v[-1]] for v in curves.values()])
    seen = np.concatenate([[p[0, 1], p[-1, 1]] for p in ends.values()])
    slope, offset = np.polyfit(own, seen, 1)
    assert slope > 0
    for gid, values in curves.items():
        x, y = ends[gid].T
        at = np.interp((x - x[0]) / (x[-1] - x[0]), np.linspace(0, 1, len(values)), values)
        np.testing.assert_allclose(y, slope * at + offset, atol=0.3)  # points of 1/72 inch; lines are simplified


# -- the figures -----------------------------------------------------------------------------------------------


def test_one_command_makes_the_seven_figures_in_files_and_in_the_report(done: Done) -> None:
    assert done.record["figures"] == [f"figure-{name}.svg" for name in FIGURES]
    images = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", done.report)
    drawings = [base64.b64decode(text).decode().strip() for text in images]
    for name in FIGURES:
        assert ElementTree.fromstring(done.figures[name]).tag == f"{SVG}svg"
        assert done.figures[name] in drawings
        assert f"Figure {name}." in done.report
    words = {name: set(re.findall(r">([^<]+)</text>", text)) for name, text in done.figures.items()}
    assert words["5a"] >= {"generation", "RMS error, mm", "initial model", "best so far"}
    assert words["5b"] >= {"generation", "C10", "C01", "C10 + C01", "constants of the best, MPa"}
    assert words["5c"] >= {"C10, MPa", "C01, MPa", "RMS error, mm", "ridge: least error", "published", "least squares"}
    for name, point in (("6a", "tip (node 4401)"), ("6b", "middle (node 5848)")):
        assert words[name] >= {point, "pressure, kPa", "U3, mm", "initial model", "updated model", "experiment, 95 %"}
    assert words["6c"] >= {"U3, mm", "experiment", "initial model", "updated model", "-5.8", "-2.2"}
    assert words["6d"] >= {"absolute error of U3, mm", "initial model", "updated model", "error of a reading, 1 sd"}


def direct(case: Case, constants: Constants, pressure: np.ndarray) -> np.ndarray:
    """U3 (k, 2) mm of tip and middle, straight from the finite elements."""
    rows = [int(np.linalg.norm(case.nodes - place, axis=1).argmin()) for place in NODES.values()]
    solution = solve(case.with_material(**constants.named), Course(pressure, pressure, pressure))
    assert solution.converged
    return solution.at(case.nodes[rows])[:, :, 2]


@pytest.mark.parametrize("side", ["initial", "final"])
def test_curves_are_those_of_the_finite_elements(done: Done, short_case: Case, side: str) -> None:
    curves, model = done.record["curves"], done.record[side]
    pressure = np.array(curves["pressure_MPa"])
    some = np.array([0, 20, 40, len(pressure) - 1])
    assert pressure[-1] == done.record["pressure_MPa"] == 0.03
    u = direct(short_case, mooney_rivlin(model["C10"], model["C01"]), pressure[some])
    for k, point in enumerate(curves["points"]):
        np.testing.assert_allclose(np.array(point[f"{side}_mm"])[some], u[:, k], rtol=TABLES, atol=1e-6)
    np.testing.assert_allclose(model["u_mm"], u[-1], rtol=TABLES)
    error = u[-1] - done.record["measured_mm"]
    assert model["rms_mm"] == pytest.approx(np.sqrt((error**2).mean()), abs=TABLES * 5.8)


def test_figures_hold_the_numbers_of_the_record(done: Done) -> None:
    record = done.record
    for name, point in zip(("6a", "6b"), record["curves"]["points"]):
        scale_of(done.figures[name], {"initial": np.array(point["initial_mm"]), "final": np.array(point["final_mm"])})
        assert (point["measured_at_MPa"], point["measured_sd_mm"]) == ([0.03], [1.0])
    measured = np.array(record["measured_mm"])
    u = {title: np.array(record[side]["u_mm"]) for title, side in (("initial model", "initial"), ("updated model", "final"))}
    for figure, rows in (("6c", u), ("6d", {title: np.abs(x - measured) for title, x in u.items()})):
        bars = [(drawn(done.figures[figure], f"{title}: {label}"), value)
                for title, x in rows.items() for label, value in zip(("tip (node 4401)", "middle (node 5848)"), x)]  # fmt: skip
        ratios = [float(np.ptp(bar[:, 1])) / abs(value) for bar, value in bars]
        np.testing.assert_allclose(ratios, ratios[0], rtol=1e-3)  # one scale for all bars of a figure


def test_search_figures_hold_the_search(done: Done) -> None:
    folder = done.project.newest("calibrate", "candidates.npz")
    assert folder is not None
    found, best = np.load(folder), np.load(folder.with_name("generations.npz"))
    dots = next(g for g in ElementTree.fromstring(done.figures["5c"]).iter() if g.get("id") == "candidates")
    assert len(list(dots.iter(f"{SVG}use"))) == np.isfinite(found["rms_mm"]).sum()
    assert len(drawn(done.figures["5a"], "best")) == len(best["generation"]) == 3
    scale_of(done.figures["5b"], {"C10": best["best"][:, 0], "C01": best["best"][:, 1], "C10 + C01": best["best"].sum(axis=1)})
    total = done.record["final"]
    assert [total["C10"], total["C01"]] == pytest.approx(best["best"][-1])


# -- the table and the words ---------------------------------------------------------------------------------------


def cells(report: str) -> dict[str, list[str]]:
    """The cells after the first of every row of the report's tables, by that first."""
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row, re.S) for row in re.findall(r"<tr>(.*?)</tr>", report, re.S)]
    return {html.unescape(row[0]): row[1:] for row in rows if row}


def test_the_table_is_that_of_the_record(done: Done) -> None:
    record, row = done.record, cells(done.report)
    initial, final = record["initial"], record["final"]
    reduction = 100 * (1 - final["rms_mm"] / initial["rms_mm"])
    assert record["reduction_percent"] == pytest.approx(reduction)
    assert row["initial RMS, mm"] == [short(initial["rms_mm"]), "not stated"]
    assert row["final RMS, mm"] == [short(final["rms_mm"]), "not stated"]
    assert row["reduction, %"] == [short(reduction), "72.4"]
    assert row["C10, MPa"] == [short(final["C10"]), "0.214"]
    assert row["C01, MPa"] == [short(final["C01"]), "0.083"]
    assert row["C10 + C01, MPa"] == [short(final["C10"] + final["C01"]), "0.297"]
    assert (initial["C10"], initial["C01"], initial["stated"]) == (0.2, 0.1, False)
    for start in record["starts"]:
        assert [short(start[k]) for k in ("C01", "rms_mm", "reduction_percent")] == row[short(start["C10"])]


def test_the_published_reduction_is_that_of_the_initial_sums_it_names(done: Done, short_case: Case) -> None:
    record = done.record
    assert record["published_reduction_from_total_MPa"]
    for total in record["published_reduction_from_total_MPa"]:
        c = MOONEY_RIVLIN.at(total, (record["initial"]["share"],))
        u = direct(short_case, c, np.array([0.0, 0.03]))[-1]
        rms = np.sqrt(((u - record["measured_mm"]) ** 2).mean())
        assert 100 * (1 - record["final"]["rms_mm"] / rms) == pytest.approx(72.4, abs=2.0)  # near a minimum: steep


def test_the_headline_says_what_was_found_and_nothing_refuses(done: Done) -> None:
    ridge, headline = done.record["ridge"], done.record["headline"]
    low, high = ridge["agreeing_share"]
    total = [t for s, t in zip(ridge["share"], ridge["total_MPa"]) if low <= s <= high]
    assert f"C10 + C01 = {min(total):.3g} to {max(total):.3g} MPa" in headline
    assert f"<h1>{headline}</h1>" in done.report
    assert headline in done.lines
    for text in (done.report.split("</style>")[1], " ".join(done.lines), json.dumps(done.record)):
        assert not re.search(r"\bnan\b|\binf\b|no calibrated model|cannot be tested", text, re.I)


def test_diagnose_and_check_do_not_contradict_it(done: Done) -> None:
    say = Lines()
    run_diagnose(done.project, say)
    words = " ".join(say.lines)
    assert "cannot test: no noise model" in words
    assert "`twin study`" in words
    run_review(done.project, say)
    assert f"<h1>{done.record['headline']}</h1>" in newest_report(done.project)
    run_check(done.project, say)


def test_a_report_without_the_study_leads_with_the_constants(done: Done, tmp_path: Path) -> None:
    folder, say = shutil.copytree(done.project.root, tmp_path / "plain"), Lines()
    for run in (folder / "runs").glob("*-*"):
        if not run.name.endswith("-calibrate"):
            shutil.rmtree(run)
    project = Project.open(folder, builtin=done.project.builtin)
    run_check(project, say)
    assert any("`twin study` makes the figures" in line for line in say.lines)
    run_review(project, say, clip=True)
    assert "No clip: this project has no film to lay the model on." in say.lines
    assert project.newest("review", "clip.mp4") is None
    assert "<h1>C10 + C01 = " in newest_report(project)


# -- the ridge ---------------------------------------------------------------------------------------------------


def test_the_ridge_is_lowest_across_and_flat_along(done: Done, short_case: Case) -> None:
    ridge, measured = done.record["ridge"], np.array(done.record["measured_mm"])
    k = len(ridge["share"]) // 2
    share, total = ridge["share"][k], ridge["total_MPa"][k]

    def rms(t: float) -> float:
        u = direct(short_case, MOONEY_RIVLIN.at(t, (share,)), np.array([0.0, 0.03]))[-1]
        return float(np.sqrt(((u - measured) ** 2).mean()))

    assert rms(total) == pytest.approx(ridge["rms_mm"][k], abs=TABLES * 5.8)
    assert rms(total) < min(rms(0.95 * total), rms(1.05 * total))
    assert max(ridge["rms_mm"]) < 1.0  # what a reading is known to
    assert ridge["agreeing_share"] == [ridge["share"][0], ridge["share"][-1]]


def a_fit(c10: float, c01: float, *bound: str) -> Fit:
    own = tuple(Parameter(n, 0.0, 0.5, "MPa", start=0.2, typical=0.02) for n in ("C10", "C01"))
    return Fit(
        parameters=own, theta=np.array([c10, c01]), covariance=np.eye(2), chi2=1.0, degrees_of_freedom=1, seed=1,
        evaluations=1, converged=True, reason="converged", at_bound=bound,
    )  # fmt: skip


def test_why_the_two_searches_differ_is_said() -> None:
    genetic, flat = {"C10": 0.1, "C01": 0.2}, lambda v: 0.14 + 0.01 * v["C01"]
    said, same = difference(genetic, a_fit(0.3, 0.0, "C01"), flat, sd_mm=1.0)
    assert same
    assert "one flat ridge" in said
    assert "down to the bound of C01" in said
    assert "bound" not in difference(genetic, a_fit(0.2, 0.1), flat, sd_mm=1.0)[0]
    said, same = difference(genetic, a_fit(0.3, 0.0, "C01"), flat, sd_mm=1e-4)
    assert not same
    assert "least squares fits all values" in said
    assert difference(genetic, a_fit(0.101, 0.199), flat, sd_mm=1.0) == ("", False)


# -- what it refuses -----------------------------------------------------------------------------------------------


def test_what_has_no_such_figures_is_refused_in_one_sentence(tmp_path: Path, short_builtin: BuiltIn) -> None:
    one = study_at(tmp_path / "one", ('objective_points = ["tip", "middle"]', 'objective_points = ["tip"]'))
    with pytest.raises(ValueError, match=r"objective_points = \['tip'\]: figures 6a and 6b are of two points"):
        run_study(Project.open(one, builtin=short_builtin), Lines())
    held = study_at(tmp_path / "held", ("fixed = {}", "fixed = {C10 = 0.2}"))
    with pytest.raises(ValueError, match=r"model\.fixed holds C10: .* both must be free"):
        run_study(Project.open(held, builtin=short_builtin), Lines())


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("initial = {C10 = 0.2}", "wanted both C10 and C01"),
        ("initial = {C10 = 0.0, C01 = 0.0}", "both 0; wanted a sum above 0 MPa"),
        ("initial = {C10 = -0.1, C01 = 0.1}", "initial"),
    ],
)
def test_a_wrong_study_table_is_named(tmp_path: Path, line: str, sentence: str) -> None:
    folder = study_at(tmp_path / "wrong", ("\ninitial = {}", f"\n{line}"))
    with pytest.raises(ValueError, match=sentence):
        Project.open(folder)


def test_initial_constants_of_twin_toml_are_used(done: Done) -> None:
    study = done.project.config.study
    assert study is not None
    stated = study.model_copy(update={"initial": {"C10": 0.25, "C01": 0.05}})
    config = done.project.config.model_copy(update={"study": stated})
    found = Reference.of(replace(done.project, config=config), Lines()).study()
    assert (found.initial.C10, found.initial.C01) == (0.25, 0.05)
    assert "as stated" in found.sentences[0]
    assert found.reduction_percent == pytest.approx(100 * (1 - found.final.rms_mm / found.initial.rms_mm))


def test_calibrate_and_compare_say_what_the_data_cannot(done: Done) -> None:
    told, say = " ".join(done.lines), Lines()
    assert "C10 and C01" in told
    assert "cannot be separated" in told
    assert "contradict each other" in told
    says(told, "0.03 MPa", "0.01 MPa")
    run_compare(done.project, say)
    assert "no more data than fitted parameters" in " ".join(say)
    with pytest.raises(ValueError, match="effect 'wobble' is not in the library"):
        run_add(done.project, say, names=["wobble"])
