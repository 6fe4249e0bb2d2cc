"""The command line: exit codes, one sentence for an error, JSON on its own, the demo that resumes."""

import inspect
import json
import os
import re
import subprocess
import sys
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, get_args, get_origin

import numpy as np
import pytest
import typer

from tests.messages import says
from twin import chain, cli, console, files
from twin.commands import demo
from twin.executors import clusters
from twin.executors.local import Serial, current, using
from twin.notebook import OpenedProject
from twin.project.config import Config
from twin.project.folder import Project, dataset
from twin.project.toml import with_effects
from twin.signatures import signature_of
from twin.tablemodel import keys_of

NAMES = [command.name for command in chain.COMMANDS]
ROOT = Path(cli.__file__).resolve().parents[1]


@pytest.fixture
def run(monkeypatch, capsys):
    """Run `twin ...` in this process; return exit code, stdout, stderr."""

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["twin", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return ended.value.code, *capsys.readouterr()

    return call


@pytest.fixture
def study(tmp_path):
    folder = tmp_path / "study"
    (folder / "targets").mkdir(parents=True)
    for name in ("twin.toml", "targets/targets.csv"):
        (folder / name).write_bytes((dataset("study") / name).read_bytes())
    return folder


real = chain.function_at


class Standin:
    """Stands for the stages: every one records its call and writes what is told; their own code is not loaded."""

    def __init__(self) -> None:
        self.calls = []
        self.writes = {"diagnose": {"diagnosis.json": {"verdict": "creep", "named": ["creep"]}}, "review": {"report.html": "", "review.rrd": ""}}
        self.instead = {}

    def function_at(self, place):
        name = place.rpartition("run_")[2]
        if name not in {stage.name for stage in chain.STAGES}:
            return real(place)
        return self.instead.get(name) or (lambda project, say, **options: self.run(name, project, say, **options))

    def run(self, name, project, say, /, **options):
        self.calls.append((name, *(v[0] if isinstance(v, list) else v for v in options.values() if v)))
        say.progress(name, 1, 2)
        say(f"{name}: did it")
        with project.new_run(name) as run:
            for file, data in self.writes.get(name, {}).items():
                run.write_json(file, data)
        return {"stage": name, "value": float("nan")}


@pytest.fixture
def stages(monkeypatch):
    standin = Standin()
    monkeypatch.setattr(chain, "function_at", standin.function_at)
    return standin


def test_a_long_part_says_what_time_is_left(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    say = console.Console(as_json=False)
    for now[0], done in ((0.0, 0), (40.0, 2), (80.0, 2), (110.0, 0), (500.0, 1), (700.0, 10)):
        say.progress("meshes", done, 10)
    assert capsys.readouterr().err.splitlines() == [
        "  meshes: 2 of 10, about 3 min left", "  meshes: 2 of 10, about 5 min left",
        "  meshes: 0 of 10", "  meshes: 1 of 10, about 58 min left", "  meshes: 10 of 10",
    ]  # fmt: skip
    for now[0], done in ((800.0, 4), (840.0, 6)):  # four were done by the run that goes on
        say.progress("trials", done, 10)
    assert capsys.readouterr().err.splitlines()[-1] == "  trials: 6 of 10, about 80 s left"


def test_help_lists_every_command_of_this_version(run):
    code, out, _ = run("--help")
    assert code == 0
    assert (run("-h")[1], run("look", "-h")[1]) == (out, run("look", "--help")[1])
    sections = re.findall(r"^(\S[^\n]*):\n((?:  .*\n)+)", out, re.M)[1:]  # behind the options
    assert [title for title, _ in sections] == [group.value for group in chain.Group]
    listed = {title: re.findall(r"^  (\S+)", text, re.M) for title, text in sections}
    assert listed == {g.value: [c.name for c in chain.COMMANDS if c.group is g] for g in chain.Group}
    assert [name for names in listed.values() for name in names] == NAMES
    assert "..." not in out.split("Options:")[1]  # every line of help is whole on 80 columns
    assert max(map(len, out.splitlines())) <= 80
    usual = re.search(r"The usual way:\n((?:    .*\n)+)", out)
    assert usual is not None
    assert len(usual[1].splitlines()) == 5
    assert set(re.findall(r"twin (\w+)", usual[1])) < set(NAMES)


def test_the_readme_has_every_command_in_the_same_order():
    """CI tries each of them in a fresh clone: `python -m twin.chain` prints the names."""
    table = (ROOT / "README.md").read_text(encoding="utf-8").partition("## The commands")[2].partition("\n## ")[0]
    assert re.findall(r"^\| `twin (\w+)[^`]*` \| \S", table, re.M) == NAMES
    printed = subprocess.run([sys.executable, "-m", "twin.chain"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert printed.stdout.split() == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_command_takes_the_options_of_its_function(name, run, monkeypatch):
    command = chain.command_of(name)
    stated = {
        p.name: p
        for p in inspect.signature(real(command.function)).parameters.values()
        if get_origin(p.annotation) is Annotated
    }
    read = {p.name: p for p in signature_of(command).parameters}
    assert {k: (p.kind, p.default, get_args(p.annotation)[0]) for k, p in read.items()} == {
        k: (p.kind, p.default, get_args(p.annotation)[0]) for k, p in stated.items()
    }
    parsed = {p.name: p.default for p in typer.main.get_command(cli.app).commands[name].params}
    assert set(parsed) - {"project", "cluster", "json", "help"} == set(stated)
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = run(name, "--help")
    assert code == 0
    assert " ".join(command.title.split()) in " ".join(out.split())
    assert len(out.splitlines()) <= 25  # a screen
    for p in stated.values():
        assert " ".join(get_args(p.annotation)[1].help.split()) in " ".join(out.split())


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_takes_the_options_of_the_command_line(name):
    command = chain.command_of(name)
    if command.needs not in (chain.Needs.PROJECT, chain.Needs.LOCK):
        return
    method = getattr(OpenedProject, name)
    taken = inspect.signature(method).parameters
    assert list(taken) == ["self", *(p.name for p in signature_of(command).parameters)]
    for p in signature_of(command).parameters:
        assert f"{p.name}: {get_args(p.annotation)[1].help}" in method.__doc__
    assert command.title in method.__doc__


def test_a_stage_gets_the_project_and_says_what_it_did(run, study, stages):
    code, out, _ = run("calibrate", "--project", study)
    assert (code, out) == (0, "calibrate: did it\n")
    assert run("add", "creep", "-p", study)[0] == 0
    assert stages.calls == [("calibrate",), ("add", "creep")]


def test_a_command_that_solves_much_takes_a_cluster(run, study, stages, monkeypatch):
    sentence = "error: --cluster head:1: wanted tcp://HOST:8786, the scheduler's JSON file, or a slurm.toml"
    for command in chain.COMMANDS:
        assert ("--cluster" in run(command.name, "--help")[1]) == command.solves
    code, _, err = run("calibrate", "-p", study, "--cluster", "head:1")
    assert (code, err.startswith(sentence), stages.calls) == (2, True, [])
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "head:1")  # as programs of dask have it
    assert run("calibrate", "-p", study)[::2] == (2, err)
    assert run("check", "-p", study)[0] == 0  # which solves nothing
    used = []

    @contextmanager
    def on_cluster(wanted, say):
        used.append(wanted)
        with using(Serial()):
            yield

    monkeypatch.setattr(clusters, "on_cluster", on_cluster)
    stages.instead["calibrate"] = lambda project, say, **_: {"workers": type(current()).__name__}
    assert json.loads(run("calibrate", "-p", study, "--cluster", "tcp://head:2", "--json")[1]) == {"workers": "Serial"}
    assert used == ["tcp://head:2"]


def test_json_stands_alone_on_stdout(run, study, stages):
    code, out, err = run("calibrate", "-p", study, "--json")
    assert code == 0
    assert json.loads(out) == {"stage": "calibrate", "value": None}
    assert out.count("\n") == 1
    assert "calibrate: did it" in err


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        (ValueError("tip:\nno such node"), 2, "error: tip: no such node"),
        (PermissionError(13, "Permission denied", "runs"), 2, "error: runs: Permission denied"),
        (KeyboardInterrupt(), 130, "interrupted: .*again to resume"),
        (TypeError("bug"), 1, "internal error: TypeError: bug .*--debug"),
        (np.linalg.LinAlgError("Singular matrix"), 1, "internal error: LinAlgError: Singular matrix"),
    ],
    ids=["input", "files", "interrupt", "bug", "singular"],
)
def test_what_goes_wrong_is_one_sentence_and_a_code(run, study, stages, error, code, sentence):
    def fails(project, say, **_):
        raise error

    stages.instead["calibrate"] = fails
    got, out, err = run("calibrate", "-p", study)
    assert (got, out) == (code, "")
    assert re.match(sentence, err)
    assert err.count("\n") == 1
    assert "Traceback" not in err
    with Project.open(study).lock("add"):  # it let go of the project
        pass


def test_debug_shows_the_traceback(monkeypatch, study, stages):
    stages.instead["calibrate"] = lambda project, say, **_: 1 / 0
    monkeypatch.setattr(sys, "argv", ["twin", "--debug", "calibrate", "-p", str(study)])
    with pytest.raises(ZeroDivisionError):
        cli.main()


@pytest.mark.parametrize("arguments", [("bogus",), ("drop",), ("check", "--bogus")])
def test_wrong_usage_exits_2(run, arguments):
    code, _, err = run(*arguments)
    assert code == 2
    assert "Error" in err


def test_outside_a_project_the_way_in_is_named(run, stages, tmp_path):
    code, _, err = run("calibrate", "-p", tmp_path)
    assert code == 2
    assert "`twin demo FOLDER` or `twin init FOLDER`" in err


def test_a_second_writer_is_refused(run, study, stages):
    with Project.open(study).lock("calibrate"):
        code, _, err = run("add", "creep", "-p", study)
    assert code == 2
    assert "is writing to this project" in err
    assert stages.calls == []


def test_check_says_what_comes_next(run, study, stages):
    assert run("check", "-p", study)[1].endswith("Next: `twin calibrate`.\n")
    run("calibrate", "-p", study)
    assert json.loads(run("check", "-p", study, "--json")[1])["next"] == "compare"


def test_check_names_the_effect_of_the_diagnosis(run, study, stages):
    for name in ("calibrate", "compare", "diagnose"):
        run(name, "-p", study)
    assert json.loads(run("check", "-p", study, "--json")[1])["next"] == "add creep"
    stages.writes["diagnose"] = {"diagnosis.json": {"verdict": "creep", "named": ["creep", "clamp"]}}
    run("diagnose", "-p", study)
    assert json.loads(run("check", "-p", study, "--json")[1])["next"] == "add"
    stages.writes["diagnose"] = {"diagnosis.json": {"verdict": "creep", "named": ["creep:`date`; ls"]}}
    run("diagnose", "-p", study)  # of a stranger: what is pasted runs nothing else
    assert run("check", "-p", study)[1].endswith("Next: `twin add 'creep:`date`; ls'`.\n")


def test_check_asks_for_what_is_stale_again(run, study, stages):
    run("calibrate", "-p", study)
    csv = study / "targets" / "targets.csv"
    csv.write_text(csv.read_text().replace("-58.0", "-57.0"))
    assert json.loads(run("check", "-p", study, "--json")[1])["next"] == "calibrate"
    assert "stale: targets/targets.csv" in run("list", "-p", study)[1]


def test_the_version_is_that_of_the_package(run):
    assert run("--version")[:2] == (0, f"softtwin {version('softtwin')}\n")


@pytest.mark.parametrize("stage", chain.STAGES, ids=lambda stage: stage.name)
def test_every_stage_reads_tables_that_there_are(stage):
    assert stage.title.endswith(".")
    assert set(stage.tables) <= set(keys_of(Config))


def test_list_shows_the_runs(run, study, stages):
    run("calibrate", "-p", study)
    code, out, _ = run("list", "-p", study)
    assert code == 0
    assert "0001-calibrate" in out
    (row,) = json.loads(run("list", "-p", study, "--json")[1])["runs"]
    assert (row["run"], row["status"]) == ("0001-calibrate", "done")


def test_init_makes_a_project_of_targets(run, study, tmp_path):
    assert run("init", tmp_path / "new", "--targets", study / "targets")[0] == 0
    project = Project.open(tmp_path / "new")
    assert {p.name: p.node for p in project.config.points} == {"tip": 4401, "middle": 5848}
    assert project.targets().value[1, 0, 2] == -58
    code, _, err = run("init", tmp_path / "new", "--targets", study / "targets")
    assert code == 2
    assert "never overwritten" in err


def test_init_asks_for_nodes_that_it_cannot_know(run, study, tmp_path):
    csv = study / "targets" / "targets.csv"
    csv.write_text(csv.read_text().replace("middle", "knee"))
    code, _, err = run("init", tmp_path / "new", "--targets", study / "targets")
    assert code == 2
    assert "--node knee=4401" in err
    assert not (tmp_path / "new").exists()
    assert run("init", tmp_path / "new", "--targets", study / "targets", "--node", "knee=17")[0] == 0
    assert [p.node for p in Project.open(tmp_path / "new").targets().points] == [4401, 17]


def test_init_for_a_film_says_what_is_missing(run, tmp_path):
    assert run("init", tmp_path / "batch-07")[0] == 0
    code, _, err = run("check", "-p", tmp_path / "batch-07")
    assert code == 2
    for name in ("raw/film.mp4", "raw/static.mp4", "raw/pressure.csv", "raw/boards/*.png"):
        assert name in err


@pytest.fixture
def demo_data(monkeypatch, stages, study):
    """A data set without a film, measured by stand-ins."""
    monkeypatch.setattr(demo, "dataset", lambda name: study)
    return stages


ALL = ["camera", "measure", "calibrate", "compare", "diagnose", "add", "review"]


def test_demo_runs_every_stage_and_says_where_the_results_are(run, demo_data, tmp_path):
    code, out, _ = run("demo", tmp_path / "demo")
    assert code == 0
    assert [call[0] for call in demo_data.calls] == ALL
    for name in ("review.rrd", "report.html"):
        assert str(tmp_path / "demo/runs/0007-review" / name) in out
    assert out.index("[1/7] twin camera") < out.index("[7/7] twin review")


def test_the_quick_demo_has_its_data_and_its_folder(run, stages, study, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(demo, "dataset", lambda name: asked.append(name) or study)
    monkeypatch.chdir(tmp_path)
    assert run("demo", "--quick")[0] == 0
    assert (tmp_path / "softtwin-quick" / "demo.json").is_file()
    assert run("demo")[0] == 0
    assert (tmp_path / "softtwin-demo" / "demo.json").is_file()
    assert asked == ["quick", "demo"]
    code, _, err = run("demo", "softtwin-quick")
    assert code == 2
    says(err, "datasets/quick", "datasets/demo")
    assert "add --quick" in err
    code, _, err = run("demo", "softtwin-demo", "--quick")
    assert code == 2
    assert "leave out --quick" in err


def test_an_interrupted_demo_is_resumed(run, demo_data, tmp_path):
    def interrupted(project, say):
        raise KeyboardInterrupt

    demo_data.instead["diagnose"] = interrupted
    assert run("demo", tmp_path / "demo")[0] == 130
    demo_data.instead.clear()
    demo_data.calls.clear()
    code, out, _ = run("demo", tmp_path / "demo")
    assert code == 0
    assert [call[0] for call in demo_data.calls] == ["camera", "measure", "diagnose", "add", "review"]
    assert re.search("runs/0003-calibrate.* skipped", out)


def test_the_demo_refuses_a_folder_of_something_else(run, demo_data, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    code, _, err = run("demo", tmp_path / "full")
    assert code == 2
    assert "is not a demo project" in err
    assert [p.name for p in (tmp_path / "full").iterdir()] == ["mine.txt"]
    (tmp_path / "empty").mkdir()
    assert run("demo", tmp_path / "empty")[0] == 0
    files.write_json(tmp_path / "empty" / "demo.json", {})
    assert "another version" in run("demo", tmp_path / "empty")[2]


def test_the_command_starts_without_the_heavy_packages():
    code = (
        "import sys; import twin.cli\n"
        "heavy = {'cv2', 'av', 'scipy', 'pymoo', 'rerun', 'pyvista', 'matplotlib', 'pydantic'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_runs_are_listed_without_the_packages_that_compute(study):
    toml = study / "twin.toml"
    toml.write_text(with_effects(toml.read_text(encoding="utf-8"), ["creep"]), encoding="utf-8")
    with Project.open(study).new_run("calibrate"):
        pass
    code = (
        "import atexit, sys; from twin.cli import main\n"
        "heavy = {'cv2', 'av', 'fe', 'numba', 'pymoo', 'scipy', 'ssl', 'vision'}\n"
        "atexit.register(lambda: print(sorted(heavy & set(sys.modules)), file=sys.stderr))\n"
        "main()"
    )
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code, "list", "-p", str(study)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    assert "0001-calibrate" in done.stdout
    assert done.stderr.strip() == "[]"


def test_a_plain_terminal_lists_names_that_it_cannot_show(study):
    with Project.open(study).new_run("calibrate") as done:
        done.summary["headline"] = "M\u00fcller's finger: sd 0.6 \u03bcm in this sentence, which is longer than any terminal is wide"
    env = {**os.environ, "PYTHONPATH": str(ROOT), "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "COLUMNS": "20"}
    code = "from twin.cli import main; main()"
    command = [sys.executable, "-c", code, "list", "-p", str(study)]
    out = subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout.splitlines()
    assert out[0].startswith("0001-calibrate   done")
    assert out[1:] == ["    M\\xfcller's finger: sd 0.6 \\u03bcm in this sentence, which is longer than any terminal is wide"]


def test_what_a_folder_says_does_not_steer_the_terminal(run, study):
    project = Project.open(study)
    with project.new_run("calibrate") as made:
        made.summary["headline"] = "\x1b]0;owned\x07\x1b[31m\x9b2J\u202eright\rleft"
    code, out, _ = run("list", "-p", study)
    assert code == 0
    assert out.splitlines()[-1].strip().startswith(r"\x1b]0;owned\x07\x1b[31m\x9b2J\u202eright\x0dleft")
    told = json.loads(made.path("run.json").read_text(encoding="utf-8"))
    files.write_json(made.path("run.json"), told | {"summary": {"headline": "\x7f\x1b\x9b"}})
    code, out, _ = run("list", "-p", study, "--json")
    assert json.loads(out)["runs"][0]["headline"] == "\x7f\x1b\x9b"
    assert out.strip().isprintable()
    record = json.loads(made.path("run.json").read_text(encoding="utf-8")) | {"kind": ["\x1b[31m"]}
    files.write_json(made.path("run.json"), record)
    code, _, err = run("list", "-p", study)
    assert code == 2
    assert "\x1b" not in err
    (study / "twin.toml").write_text((study / "twin.toml").read_text() + '[a."\\u001b[31m"]\n')
    _, _, err = run("check", "-p", study)
    assert err.startswith("error: ")
    assert "\x1b" not in err


def test_too_little_memory_is_no_error_of_the_program(run, study, stages):
    def greedy(project, say, **options):
        raise MemoryError("Unable to allocate 117. GiB for an array")

    stages.instead["calibrate"] = greedy
    code, _, err = run("calibrate", "-p", study)
    assert code == 2
    assert err == ("error: the memory of this computer does not suffice: Unable to allocate 117. GiB for an array; "
                   "take a coarser mesh, or fewer points\n")
