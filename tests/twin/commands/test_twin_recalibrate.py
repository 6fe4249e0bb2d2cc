"""One command from the targets to the report, and batches beside each other; the stages are stood in for."""

import csv
import os
import shutil
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from calibrate import Fit, Parameter
from tests.askedonce import asked_once
from tests.messages import saying, says
from twin import chain, cli, files
from twin.batches.former import camera_kept
from twin.batches.series import batches_in, earlier_facts
from twin.batches.values import SHARE, SUM, changes_of, values_of
from twin.bench import workbench
from twin.bench.modeldifferences import same_films
from twin.commands import recalibrateall
from twin.commands.batches import run_batches
from twin.commands.calibrate import _former_values
from twin.commands.comparetwo import run_side_by_side
from twin.commands.initlike import run_init_like
from twin.commands.recalibrate import run_recalibrate
from twin.commands.recalibrateall import recalibrate_all
from twin.commands.trust import run_trust
from twin.executors.local import using
from twin.judging.fitrecord import FitRecord
from twin.marktables import PointTable
from twin.project import toml
from twin.project.cameratables import RecordingTable
from twin.project.config import Config, ProjectTable
from twin.project.folder import Project, dataset
from twin.project.targetfiles import write_targets
from twin.project.toml import dump, with_key
from twin.report.page import render
from twin.validation import decoded


@pytest.fixture(scope="module", autouse=True)
def made_once():
    """All batches have the same finger, most the same twin.toml: its mesh is made, its text is edited once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workbench, "of_body", asked_once(workbench.of_body))
        patch.setattr(toml, "with_key", asked_once(toml.with_key))
        yield


def record(c10=0.21, c01=0.08, g1=None, *, sd=0.002, note="", effects=()):
    """A fit.json; C10 and C01 trade off with a correlation of -0.9, as they do."""
    values = [c10, c01] + ([g1] if g1 is not None else [])
    names = ["C10", "C01", "creep.g1"][: len(values)]
    covariance = sd**2 * np.array([[1, -0.9, 0], [-0.9, 1, 0], [0, 0, 1.0]])[: len(values), : len(values)]
    parameters = tuple(Parameter(n, 0.0, 1.0, "" if "." in n else "MPa") for n in names)
    fit = Fit(parameters, np.array(values), covariance, 90.0, 100, 1, 5, True, "converged", ())
    rows = {n: {"low": None if note else 0.0, "high": None if note else 1.0, "note": note} for n in names}
    return FitRecord.of(fit, adequate=not note, intervals=rows, effects=tuple(effects))


real = chain.function_at


class Stages:
    """Stand for the stages after `measure`: they leave what the next one reads, and record that they ran."""

    def __init__(self):
        self.ran, self.named, self.stop, self.fits = [], ["creep"], None, {}

    def function_at(self, place):
        name = place.rpartition("run_")[2]
        if name not in {stage.name for stage in chain.STAGES}:
            return real(place)
        return lambda project, say, **options: self.run(name, project, say)

    def run(self, name, project, say):
        fit = self.fits.get(project.root.name, {"c10": 0.21})
        left = {
            "calibrate": {"fit.json": record(**fit, note="the model does not fit yet")},
            "diagnose": {"diagnosis.json": {"verdict": " + ".join(self.named) or "adequate", "named": self.named}},
            "add": {"fit.json": record(**fit, g1=0.03, effects=self.named), "comparison.json": {"rms_mm": 0.04, "noise_sd_mm": 0.04}},
            "review": {"report.html": {}},
        }
        with project.new_run(name) as run:
            for file, data in left.get(name, {}).items():
                run.write_json(file, data)
            if name == "review":
                stream = rr.RecordingStream("softtwin")
                stream.save(run.path("review.rrd"))
                stream.log("diagnosis", rr.TextDocument(project.root.name), static=True)
                stream.disconnect()
            if self.stop == name:
                self.stop = None
                raise KeyboardInterrupt  # as a kill does, it leaves the run under way
        if name == "calibrate" and project.config.model.effects:
            with project.new_run("add") as run:
                run.write(record(**fit, g1=0.03, effects=project.config.model.effects))
        self.ran.append(name)
        if name == "add":
            project.set_effects(self.named)
        return {"stage": name}

    def since(self):
        done, self.ran = self.ran, []
        return done


@pytest.fixture
def stages(monkeypatch):
    standin = Stages()
    monkeypatch.setattr(chain, "function_at", standin.function_at)
    return standin


def moving(targets):
    """Targets whose tip and middle bend with the pressure."""
    value = targets.value.copy()
    value[:, :2, 2] = targets.pressure[:, None] / 0.02 * np.array([-40.0, -13.0])
    return replace(targets, value=value)


@pytest.fixture
def batch(tmp_path, make_targets, make_noise):
    """`batch(name)`: a project with targets that have a noise model."""

    def make(name="batch-07", **config):
        folder = tmp_path / name
        folder.mkdir()
        points = (PointTable(name="tip", node=4401), PointTable(name="middle", node=5848))
        (folder / "twin.toml").write_text(dump(Config(project=ProjectTable(name=name), points=points, **config)))
        noise = make_noise(3, sd=0.01, rho=0.1, common=0.0, frames=400)
        write_targets(folder / "targets", moving(make_targets(noise=noise)))
        return Project.open(folder)

    return make


def again(project, say):
    return run_recalibrate(Project.open(project.root), say)


ALL = ["calibrate", "compare", "diagnose", "add", "review"]


def test_everything_runs_once_and_then_nothing(batch, stages, say):
    project = batch()
    result = run_recalibrate(project, say)
    assert stages.since() == ALL
    assert (result["verdict"], result["effects"]) == ("creep", ["creep"])
    assert result["report.html"].endswith("0005-review/report.html")
    assert set(again(project, say)["stages"].values()) == {"none", "fresh"}
    assert stages.since() == []


def test_new_targets_make_all_stale_and_the_effects_are_fitted_again(batch, stages, say):
    project = batch()
    run_recalibrate(project, say)
    stages.since()
    table = project.targets_folder / "targets.csv"
    table.write_text(table.read_text().replace("0.02,", "0.0201,"))
    stages.named = []
    result = again(project, say)
    assert stages.since() == ["calibrate", "compare", "diagnose", "review"]
    assert (result["verdict"], result["effects"]) == ("adequate", ["creep"])  # nothing else is missing
    assert set(again(project, say)["stages"].values()) == {"none", "fresh"}


def test_effects_that_are_written_into_twin_toml_are_fitted(batch, stages, say):
    project = batch()
    stages.named = []
    run_recalibrate(project, say)
    Project.open(project.root).set_effects(["creep"])
    stages.since()
    assert again(project, say)["effects"] == ["creep"]
    assert stages.since() == ["calibrate", "compare", "diagnose", "review"]


def test_only_what_depends_on_a_change_runs_again(batch, stages, say):
    project = batch()
    run_recalibrate(project, say)
    stages.since()
    text = decoded((project.root / "twin.toml").read_bytes())
    (project.root / "twin.toml").write_text(with_key(text, "diagnose", "seed", 7))
    again(project, say)
    assert stages.since() == ["diagnose", "add", "review"]  # the review does not read [diagnose], but its result


def test_what_the_user_has_dropped_stays_dropped(batch, stages, say):
    project = batch()
    run_recalibrate(project, say)
    project = Project.open(project.root)
    with project.new_run("drop") as run:
        run.write(record())
    project.set_effects([])
    stages.since()
    result = again(project, say)
    assert (stages.since(), result["effects"]) == (["review"], [])


def test_a_moved_folder_is_fresh_and_no_bit_changes(batch, stages, say, tmp_path):
    project = batch("Charge 09 ü")
    run_recalibrate(project, say)
    place = str(project.root).encode()
    assert not [p for p in project.root.rglob("*") if p.is_file() and place in p.read_bytes()]
    moved = tmp_path / "autre dossier é" / "Charge 09 ü"
    moved.parent.mkdir()
    shutil.move(project.root, moved)
    before = {p: p.read_bytes() for p in moved.rglob("*") if p.is_file()}
    stages.since()
    with Project.open(moved).lock("recalibrate"):
        result = run_recalibrate(Project.open(moved), say)
    assert stages.since() == []
    assert result["report.html"].startswith(str(moved))
    assert {p: p.read_bytes() for p in moved.rglob("*") if p.is_file() and not p.name.startswith(".lock")} == before


@pytest.mark.parametrize("where", ALL)
def test_stopped_in_any_stage_it_goes_on_there(batch, stages, say, where):
    project = batch()
    stages.stop = where
    with pytest.raises(KeyboardInterrupt):
        run_recalibrate(project, say)
    before = stages.since()
    assert before == ALL[: ALL.index(where)]
    again(project, say)
    assert stages.since() == ALL[ALL.index(where) :]
    assert len(project.runs()) == len(ALL)  # the run under way was resumed, not begun again


def test_targets_without_a_noise_model_are_calibrated_and_not_diagnosed(batch, stages, say, make_targets):
    project = batch()
    shutil.rmtree(project.targets_folder)
    write_targets(project.targets_folder, moving(make_targets()))
    result = run_recalibrate(project, say)
    assert stages.since() == ["calibrate", "compare", "review"]
    assert result["verdict"] == "not diagnosed: no noise model"


# -- a batch like another ------------------------------------------------------------------------------------


def test_a_batch_like_another_remembers_it_and_says_what_changed(batch, stages, say, tmp_path):
    former = batch()
    path = former.root / "twin.toml"
    path.write_text(path.read_text().replace("[calibrate]", "[calibrate]  # our rig"))
    stages.fits = {"batch-07": {"c10": 0.21}, "batch-08": {"c10": 0.25}}
    run_recalibrate(Project.open(former.root), say)
    run_init_like(tmp_path / "batch-08", say, like=former.root)
    project = Project.open(tmp_path / "batch-08")
    assert (project.config.project.name, project.config.project.like) == ("batch-08", "../batch-07")
    assert project.config.model.effects == ("creep",)  # the silicone is the same
    assert any("The model keeps its effects, creep" in line for line in say.lines)
    assert "# our rig" in (project.root / "twin.toml").read_text()
    assert not project.targets_folder.exists()
    shutil.copytree(former.targets_folder, project.targets_folder)
    result = run_recalibrate(project, say)
    found = {row["name"]: row for row in result["changes"]}
    assert found[SUM]["difference"] == pytest.approx(0.04)
    assert found[SUM]["known"]
    # sd of a sum of two with correlation -0.9, of two batches
    half = 1.96 * 0.002 * np.sqrt(2 * (2 - 1.8))
    assert (found[SUM]["low"], found[SUM]["high"]) == pytest.approx((0.04 - half, 0.04 + half), rel=1e-4)
    assert not found["creep.g1"]["known"]
    assert any("C10 + C01 is larger by 0.0400 MPa, 14 %," in line for line in say.lines)
    assert any("creep.g1 has not changed measurably" in line for line in say.lines)


def test_an_effect_of_one_film_is_not_kept(batch, say, tmp_path):
    former = batch().set_effects(["creep", "marker_slip:tip@19s"])
    run_init_like(tmp_path / "batch-08", say, like=former.root)
    assert Project.open(tmp_path / "batch-08").config.model.effects == ("creep",)
    assert "keeps its effects, creep:" in say.lines[-2]
    assert "Left out: marker_slip:tip@19s, of its film alone." in say.lines[-2]


def test_a_folder_that_is_there_is_never_overwritten(batch, say):
    project = batch()
    with pytest.raises(ValueError, match="is there already and is never overwritten"):
        run_init_like(project.root, say, like=project.root)


def test_a_former_batch_that_is_gone_is_said(batch, stages, say):
    project = batch(calibrate={"seed": 1})
    text = decoded((project.root / "twin.toml").read_bytes())
    (project.root / "twin.toml").write_text(with_key(text, "project", "like", "../batch-06"))
    assert "cannot be checked: project.like = '../batch-06': no project in " in camera_kept(Project.open(project.root))
    run_recalibrate(Project.open(project.root), say)  # what can be done without it is done
    assert any(line.startswith("Not compared with ../batch-06: ") for line in say.lines)


@pytest.fixture
def filmed(tmp_path, say):
    """The demo as batch-07, measured as far as the test of the camera asks, and batch-08 like it with its film."""
    from vision.camera import Camera
    from vision.film.series import open_film
    from vision.following.markercentres import locate

    source, root = dataset("demo"), tmp_path / "batch-07"
    (root / "raw" / "boards").mkdir(parents=True)
    shutil.copy(source / "twin.toml", root)
    (root / "raw" / "boards" / "one.jpg").write_bytes(b"a picture of the board")
    former = Project.open(root)
    film = open_film(source / "raw" / "film.mp4")
    lens = Camera(np.array([[3000.0, 0, 640], [0, 3000.0, 360], [0, 0, 1]]), np.zeros(5), (film.width, film.height))
    found = locate(next(iter(film.frames()))[2], dictionary=former.config.cameras[0].dictionary, camera=lens)
    centre = dict(zip(found.ids.tolist(), found.centre))
    rig = [m for m in former.config.frame.markers if m.marker in centre]

    def measured(shift_px):
        position = np.array([[centre[m.marker] + (shift_px if m.role == "fixed" else 0.0) for m in rig]])
        with former.new_run("camera", tables=(), inputs=[]) as run:
            run.write_json("camera.json", lens.to_dict())
        with former.new_run("measure", tables=(), inputs=[]) as run:
            run.write_npz("tracks.npz", {"names": np.array([m.name for m in rig]), "position": position})
        run_init_like(tmp_path / "batch-08", say, like=root)
        os.link(source / "raw" / "film.mp4", tmp_path / "batch-08" / "raw" / "film.mp4")
        return Project.open(tmp_path / "batch-08")

    return measured


def test_a_camera_that_still_fits_is_kept(filmed, say):
    project = filmed(0.05)
    assert any("test by the fixed markers whether it still fits, once raw/film.mp4 is there" in s for s in say.lines)
    assert any("film_start_s = 35" in s and "they belong to one film" in s for s in say.lines)
    says(camera_kept(project), "batch-07", "0.07 px")


def test_a_camera_that_does_not_fit_is_refused(filmed):
    project = filmed(1.0)
    with pytest.raises(ValueError, match=saying("batch-07", r"1\.4.")):
        camera_kept(project)


def test_new_board_pictures_are_no_camera_of_another_batch(filmed):
    project = filmed(1.0)
    (project.root / "raw" / "boards" / "one.jpg").write_bytes(b"a new picture of the board")
    assert camera_kept(project) == ""


# -- many batches --------------------------------------------------------------------------------------------


def test_a_batch_that_fails_stops_no_other(batch, stages, say, tmp_path):
    for name in ("batch-10", "batch-9"):
        batch(name)
    (tmp_path / "batch-11").mkdir()
    (tmp_path / "batch-11" / "twin.toml").write_text("points = 3")
    result = recalibrate_all(tmp_path, say)
    assert [row["batch"] for row in result["batches"]] == ["batch-9", "batch-10", "batch-11"]
    assert [row["status"] for row in result["batches"]] == ["done", "done", "failed"]
    assert result["failed"] == ["batch-11"]
    assert say.lines[-1] == "1 of 3 batches failed: batch-11."
    stages.since()
    again = recalibrate_all(tmp_path, say)
    assert (stages.since(), again["failed"]) == ([], ["batch-11"])


def test_the_exit_code_says_that_a_batch_failed(batch, stages, tmp_path, monkeypatch, capsys):
    batch()
    for wanted in (0, 2):
        monkeypatch.setattr(sys, "argv", ["twin", "recalibrate", "-p", str(tmp_path)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == wanted, capsys.readouterr().err
        (tmp_path / "broken").mkdir(exist_ok=True)
        (tmp_path / "broken" / "twin.toml").write_text("points = 3")


def test_a_second_command_on_the_folder_is_refused(batch, stages, say, tmp_path, monkeypatch):
    batch()
    inner = []

    def add(root):
        cli._run(chain.stage_of("add"), json=False, project=root, names=[])

    def second(project, say, **options):
        for work in (lambda: recalibrate_all(tmp_path, say), lambda: add(project.root)):
            with pytest.raises(ValueError, match=r"`twin recalibrate` \(process \d+ on .*\) is writing") as error:
                work()
            inner.append(error)
        return stages.run("calibrate", project, say)

    usual = stages.function_at
    monkeypatch.setattr(chain, "function_at", lambda p: second if p.endswith("run_calibrate") else usual(p))
    assert recalibrate_all(tmp_path, say)["failed"] == []
    assert len(inner) == 2


def test_the_report_shows_the_constants_beside_earlier_batches(batch, stages, say, tmp_path):
    stages.fits = {"b-1": {"c10": 0.21}, "b-2": {"c10": 0.211}, "b-10": {"c10": 0.25}}
    for name in stages.fits:
        run_recalibrate(batch(name), say)
    other = batch("b-0")  # of other points: another rig
    (other.root / "twin.toml").write_text((other.root / "twin.toml").read_text().replace('"tip"', '"end"'))
    batch("b-3")  # not calibrated yet
    project = Project.open(tmp_path / "b-10")
    fit = record(0.25, g1=0.03, effects=["creep"])
    found = earlier_facts(project, fit)
    assert found["batches"] == ["b-1", "b-2", "b-10"]
    rows = {row["name"]: row for row in found["rows"]}
    assert [cell.split()[0] for cell in rows[SUM]["cells"]] == ["0.29", "0.291", "0.33"]
    assert rows[SUM]["changed"]
    assert not rows["creep.g1"]["changed"]
    assert found["beside"] == "b-2"
    page = render(title="b-10", facts={"earlier": found})
    assert "The constants beside earlier batches" in page
    says(page, "C10", "C01", "0.0390 MPa")
    assert earlier_facts(Project.open(tmp_path / "b-1"), fit) is None
    # the one that twin.toml names counts, wherever it lies
    (tmp_path / "far").mkdir()
    shutil.move(tmp_path / "b-1", tmp_path / "far")
    text = decoded((project.root / "twin.toml").read_bytes())
    (project.root / "twin.toml").write_text(with_key(text, "project", "like", "../far/b-1"))
    run_trust(project.root, say)
    found = earlier_facts(Project.open(project.root), fit)
    assert (found["batches"], found["beside"]) == (["b-1", "b-2", "b-10"], "b-1")


SERIES = [0.210, 0.2103, 0.2096, 0.2101, 0.2098, 0.2104]


def series(batch, stages, say, tmp_path, last):
    for k, c10 in enumerate([*SERIES, last], 1):
        batch(f"b-{k}")
        stages.fits[f"b-{k}"] = {"c10": c10, "sd": 0.0005}
    recalibrate_all(tmp_path, say)
    return run_batches(tmp_path, say)


def test_a_batch_that_differs_is_named_with_its_quantity(batch, stages, say, tmp_path):
    result = series(batch, stages, say, tmp_path, last=0.235)
    assert result["newest"] == "b-7"
    assert SUM in result["differs"]
    assert "creep.g1" not in result["differs"]
    page = (tmp_path / "batches.html").read_text()
    assert "b-7, the newest by name, differs from the former batches in C10 + C01" in page
    assert page.count("data:image/svg+xml;base64,") == 1
    rows = list(csv.DictReader((tmp_path / "batches.csv").read_text().splitlines()))
    assert len(rows) == 7 * 3
    assert float(rows[0]["low"]) < float(rows[0]["value"]) < float(rows[0]["high"])


def test_no_cell_of_the_table_of_batches_is_a_formula(batch, stages, say, tmp_path):
    stages.fits["=cmd|calc"] = {"c10": 0.21}
    done, broken = batch("=cmd|calc"), batch("@sum")
    run_recalibrate(done, say)
    with Project.open(done.root).new_run("diagnose") as run:
        run.write_json("diagnosis.json", {"verdict": "\t+1", "sentence": "", "named": []})
    (broken.root / "twin.toml").write_text("=")
    run_batches(tmp_path, say)
    rows = list(csv.DictReader((tmp_path / "batches.csv").read_text().splitlines()))
    assert {row["batch"] for row in rows} == {"'=cmd|calc", "'@sum"}
    assert {row["verdict"] for row in rows if "cmd" in row["batch"]} == {"'\t+1"}
    assert all(float(row["value"]) > 0 for row in rows if "cmd" in row["batch"])  # a number is a number


def test_a_batch_like_the_others_is_not_called_different(batch, stages, say, tmp_path):
    result = series(batch, stages, say, tmp_path, last=0.2102)
    assert result["differs"] == []
    assert len(result["tests"]) == 3
    assert any("b-7, the newest by name, is like the former batches" in line for line in say.lines)


def test_too_few_batches_are_listed_and_not_tested(batch, stages, say, tmp_path):
    for name in ("b-1", "b-2"):
        batch(name)
    recalibrate_all(tmp_path, say)
    batch("b-0")  # no fit yet
    result = run_batches(tmp_path, say)
    assert (result["tests"], result["batches"]) == ([], ["b-0", "b-1", "b-2"])
    assert any("C10 + C01 is not tested: 1 former batches have it" in line for line in say.lines)
    assert any(line.startswith("b-0: no fit in this project") for line in say.lines)
    assert f"`twin compare {tmp_path}/b-1 {tmp_path}/b-2` lays the two side by side." in say.lines


def test_equal_films_of_two_batches_are_told(batch):
    films = {"b-1": "the same", "b-2": "another", "b-3": "the same"}
    projects = [batch(name, **{"import": (RecordingTable(name="film", file="raw/film.csv", format="csv"),)}) for name in films]
    for project, text in zip(projects, films.values(), strict=True):
        project.path("raw").mkdir()
        for file in ("film.csv", "log.csv"):  # one log of two films is right
            project.path(f"raw/{file}").write_text(text if file == "film.csv" else "a log")
        with project.new_run("measure", inputs=[project.path("raw/film.csv"), project.path("raw/log.csv")]) as run:
            files.write_json(project.targets_folder / "source.json", {"run": run.name})
    (told,) = same_films(projects)
    assert told.startswith("b-1 and b-3 are measured from the same film, of equal bytes (raw/film.csv)")
    assert not [*same_films(projects[:2])]


@pytest.mark.parametrize(
    ("broken", "how"),
    [("twin.toml", "sparse"), ("twin.toml", "folder"), ("runs/0004-add/fit.json", "folder"),
     ("runs/0004-add/fit.json", "bytes"), ("runs/0001-calibrate/run.json", "fifo"), ("runs/0004-add/run.json", "link"),
     ("runs/0004-add/run.json", "folder")],
)  # fmt: skip
def test_a_broken_neighbour_is_a_row_and_stops_nobody(batch, stages, say, tmp_path, broken, how):
    for name in ("a0", "a1"):
        run_recalibrate(batch(name), say)
    path = tmp_path / "a0" / broken
    path.unlink()
    if how == "folder":
        path.mkdir()
    elif how == "fifo":
        os.mkfifo(path)
    elif how == "link":
        path.symlink_to("/proc/self/mem")
    else:
        path.write_bytes(b"\xff\x00")
    if how == "sparse":
        os.truncate(path, 3 * 2**30)
    before = len(say.lines)
    earlier_facts(Project.open(tmp_path / "a1"), record())
    assert run_batches(tmp_path, say)["newest"] == "a1"
    assert any(line.startswith("a1: C10") for line in say.lines[before:])
    told = [line for line in say.lines[before:] if line.startswith("a0: ")]
    assert len(told) == 1
    assert "a0" in told[0][4:] or "no fit" in told[0]  # its file, or that without it there is no fit
    like = tmp_path / "a1" / "twin.toml"
    like.write_text(with_key(like.read_text(), "project", "like", "../a0"))
    assert run_recalibrate(Project.open(tmp_path / "a1"), say)["like"] in ("a0", "../a0")
    assert _former_values(Project.open(tmp_path / "a1"), ("lost",), ()) == {}
    assert list(recalibrateall._groups([tmp_path / "a0", tmp_path / "a1"], Project.open))[-1][-1].name == "a1"


def test_a_folder_without_batches_is_refused(say, tmp_path):
    assert batches_in(tmp_path) == []
    with pytest.raises(ValueError, match=r"no project below it; wanted a folder whose subfolders have a twin\.toml"):
        run_batches(tmp_path, say)


# -- two side by side ----------------------------------------------------------------------------------------


def test_two_batches_and_two_models_lie_side_by_side(batch, stages, say, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stages.fits = {"b-1": {"c10": 0.21}, "b-2": {"c10": 0.25}}
    for name in stages.fits:
        run_recalibrate(batch(name), say)
    result = run_side_by_side([tmp_path / "b-1", tmp_path / "b-2"], say)
    page = (tmp_path / result["page"]).read_text()
    assert "b-2 beside b-1: C10 + C01" in page
    entities = {chunk.entity_path for chunk in RrdReader(str(tmp_path / "compare-b-1-b-2.rrd")).stream()}
    assert {"/b-1/diagnosis", "/b-2/diagnosis"} <= entities
    assert any(line == "Both in one recording: rerun compare-b-1-b-2.rrd" for line in say.lines)
    models = [tmp_path / "b-1" / "runs" / run for run in ("0001-calibrate", "0004-add")]
    result = run_side_by_side(models, say)
    assert result["page"] == "compare-b-1-0001-calibrate-b-1-0004-add.html"
    assert result["recording"] is None  # these stand-ins have no generations
    assert "does not fit yet" in result["changes"][0]["note"]
    assert any("b-1 has no effect, b-1 creep" in line for line in say.lines)
    with pytest.raises(ValueError, match=r"neither a project nor a run with a fit\.json"):
        run_side_by_side([tmp_path, tmp_path], say)
    with pytest.raises(ValueError, match="folders to compare: 1; wanted two"):
        run_side_by_side([tmp_path], say)


def test_sum_and_share_are_known_better_than_their_parts():
    found = {v.name: v for v in values_of(record(0.2, 0.1, sd=0.01))}
    assert found[SUM].sd == pytest.approx(0.01 * np.sqrt(2 * 0.1))
    # d share = (-b, a) / (a + b)^2
    g = np.array([-0.1, 0.2]) / 0.09
    assert found[SHARE].sd == pytest.approx(0.01 * np.sqrt(g @ np.array([[1, -0.9], [-0.9, 1]]) @ g))


def test_without_an_interval_no_change_is_claimed():
    before, after = values_of(record(0.2)), values_of(record(0.3, note="no interval: the model does not fit yet"))
    change = changes_of(before, after)[0]
    assert not change.known
    assert change.words.endswith("Whether that is a change is not known: the model does not fit yet.")


# -- kill -9 -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_killed_at_random_moments_it_ends_with_the_same_bits():
    from tests.strangers.kills import recalibrations

    found = recalibrations(quick=True)
    assert found["kills"] > 0, "no kill came in time: nothing was shown"
    assert found["kills_same"] == found["kills"]


def made_like(project, like):
    file = project.root / "twin.toml"
    file.write_text(with_key(file.read_text(), "project", "like", like))


class Backwards:
    """As a cluster whose last task ends first."""

    workers = 2

    def ended(self, tasks):
        yield from ((k, tasks[k]()) for k in reversed(range(len(tasks))))


def test_on_a_cluster_all_but_the_reports_are_made_at_a_time(batch, stages, say, tmp_path):
    for name in ("batch-1", "batch-2"):
        batch(name)
    made_like(batch("batch-3"), "../batch-2")
    (tmp_path / "batch-4").mkdir()
    (tmp_path / "batch-4" / "twin.toml").write_text("[project]\nnaem = 1\n")
    order = []
    real, stages.run = stages.run, lambda name, project, say: (
        order.append((project.root.name, name)), real(name, project, say))[1]  # fmt: skip
    with using(Backwards()):
        result = recalibrate_all(tmp_path, say)
    alone = ALL[:-1]
    made = [(name, stage) for name in ("batch-2", "batch-1", "batch-3") for stage in alone]
    assert order == [*made, *((f"batch-{k}", "review") for k in (1, 2, 3))]  # what is made like another waits for it
    assert result["failed"] == ["batch-4"]
    assert any(line.startswith("batch-2: twin calibrate") for line in say.lines)
    order.clear()
    assert recalibrate_all(tmp_path, say)["failed"] == ["batch-4"]
    assert order == []


def test_a_worker_that_does_not_see_the_folder_leaves_the_batch(batch, stages, say, tmp_path, monkeypatch):
    project = batch("batch-1")
    monkeypatch.setattr(recalibrateall, "_elsewhere", partial(elsewhere, recalibrateall._elsewhere))
    with using(Backwards()):
        assert recalibrate_all(tmp_path, say)["failed"] == []
    assert any("not on a disk that worker" in line for line in say.lines)
    assert stages.since() == ALL
    assert project.newest("review", "report.html")


def elsewhere(real, batch, opened):
    """As on a computer that has other folders."""
    return real(Path("/nowhere") / batch.name, opened)


def test_batches_made_like_each_other_in_a_circle_are_worked_on_all_the_same(batch, stages, say, tmp_path):
    for name, like in (("batch-1", "../batch-2"), ("batch-2", "../batch-1")):
        made_like(batch(name), like)
    with using(Backwards()):
        recalibrate_all(tmp_path, say)
    assert stages.since().count("review") == 2
