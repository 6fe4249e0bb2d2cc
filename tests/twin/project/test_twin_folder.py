"""Runs: numbered, resumed when killed, never overwritten; files whole or not at all; one writer at a time."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import warnings
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from twin import files
from twin.calibrated.caches import SolvedRows
from twin.csvtable import read_table
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.inputs.cameras import CameraRecord
from twin.judging.fitrecord import FitRecord
from twin.project.folder import Project
from twin.project.record import RunRecord, SourceRecord

ROOT = Path(__file__).resolve().parents[3]
TOML = '[[points]]\nname = "tip"\nnode = 4401\n[[points]]\nname = "middle"\nnode = 5848\n'


@pytest.fixture
def project(tmp_path):
    (tmp_path / "twin.toml").write_text(TOML)
    return Project.open(tmp_path)


def kill(project, kind="calibrate", **how):
    """Leave a run as a kill does."""
    try:
        with project.new_run(kind, **how) as run:
            run.append({"generation": 1})
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        return run


def test_a_folder_without_twin_toml_names_the_way_out(tmp_path):
    with pytest.raises(
        ValueError, match=r"does not exist: make a project with `twin demo FOLDER` or `twin init"
    ):
        Project.open(tmp_path)


def test_runs_are_numbered_and_say_how_they_were_made(project):
    (project.root / "a.csv").write_text("1\n")
    for kind in ("camera", "measure", "camera"):
        with project.new_run(kind, seed=3, inputs=[project.root / "a.csv"]) as run:
            run.summary["rms"] = float("nan")
    assert [folder.name for folder in project.runs()] == ["0001-camera", "0002-measure", "0003-camera"]
    info = project.info(run.folder)
    assert (info.status, info.seed, info.kind) == ("done", 3, "camera")
    # sha256 of "1\n" by coreutils
    assert info.inputs == {"a.csv": "4355a46b19d348dc2f57c046f8ef63d4538ebb936000f3c9ee954a27460dd865"}
    assert files.plain(info.summary) == {"rms": None}
    assert {"python", "numpy", "pydantic"} <= info.versions.keys()
    assert Project.open(project.root).config == project.config
    assert "population = 30" in run.path("twin.toml").read_text()  # resolved: defaults written out


def test_a_killed_run_is_resumed(project):
    killed = kill(project)
    assert project.newest("calibrate", "log.jsonl") is None  # not done
    with project.new_run("calibrate") as run:
        assert run.resumed
        assert run.folder == killed.folder
        run.append({"generation": 2})
    assert run.log() == [{"generation": 1}, {"generation": 2}]
    assert len(project.info(run.folder).started) == 2
    assert project.newest("calibrate", "log.jsonl") == run.path("log.jsonl")


@pytest.mark.parametrize("change", ["config", "seed", "extra", "inputs", "kind"])
def test_a_killed_run_of_something_else_is_not(project, change):
    (project.root / "targets").mkdir()
    kill(project)
    how = {"seed": {"seed": 2}, "extra": {"extra": {"effect": "creep"}}}.get(change, {})
    if change == "config":
        project = project.set_effects(["creep"])
    if change == "inputs":
        (project.root / "targets" / "targets.csv").write_text("changed")
    with project.new_run("compare" if change == "kind" else "calibrate", **how) as run:
        assert not run.resumed
    assert run.name.startswith("0002-")


def test_only_the_named_tables_count(project):
    kill(project, tables=("cameras",))
    with project.set_effects(["creep"]).new_run("calibrate", tables=("cameras",)) as run:
        assert run.resumed


def test_a_line_cut_off_by_a_kill_is_dropped(project):
    killed = kill(project)
    with open(killed.path("log.jsonl"), "a") as log:
        log.write('{"generation": 2, "rm')
    assert killed.log() == [{"generation": 1}]
    with project.new_run("calibrate") as run:
        run.append({"generation": 2})
    assert run.log() == [{"generation": 1}, {"generation": 2}]


def test_a_failed_run_keeps_its_sentence_and_is_not_resumed(project):
    with pytest.raises(ValueError, match="too hot"), project.new_run("calibrate") as run:
        raise ValueError("too hot")
    assert project.info(run.folder).status == "failed: too hot"
    with pytest.raises(TypeError), project.new_run("calibrate") as second:
        raise TypeError("bug")
    assert project.info(second.folder).status == "failed: TypeError: bug"
    assert second.name == "0002-calibrate"


def test_newest_takes_done_runs_that_have_the_file(project):
    for number in range(11):
        with project.new_run("calibrate", seed=number) as run:
            if number != 10:
                run.write_json("found.json", {"number": number})
    kill(project, seed=99)
    newest = project.newest("calibrate", "found.json")
    assert newest is not None
    assert files.read_json(newest) == {"number": 9}
    assert project.newest(("add", "calibrate"), "found.json") == newest
    assert project.newest(None, "found.json") == newest
    assert project.newest("add", "found.json") is None


def test_done_finds_the_same_work_only(project):
    with project.new_run("camera", seed=1) as run:
        pass
    assert project.done("camera", seed=1) == run.folder
    assert project.done("camera", seed=2) is None


def test_a_folder_without_run_json_takes_its_number(project):
    (project.root / "runs" / "0007-calibrate").mkdir(parents=True)
    assert project.info(project.runs()[0]).status == "incomplete"
    with project.new_run("calibrate") as run:
        assert run.name == "0008-calibrate"


def test_json_holds_no_nan(tmp_path):
    data = {"a": np.array([1.0, np.nan]), "b": (np.int64(3), np.bool_(True), float("inf")), "c": {1: None}}
    files.write_json(tmp_path / "a.json", data)
    assert "NaN" not in (tmp_path / "a.json").read_text()
    assert files.read_json(tmp_path / "a.json") == {"a": [1.0, None], "b": [3, True, None], "c": {"1": None}}
    np.testing.assert_array_equal(np.array([1.0, None], dtype=float), [1.0, np.nan])  # how it reads back


def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    files.write_json(path, 1)
    with pytest.raises(TypeError):
        files.write_json(path, object())

    def no_space(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", no_space)
    with pytest.raises(OSError, match=r"No space left on device: '.*a\.json'"):
        files.write_json(path, 2)
    assert files.read_json(path) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_no_pickle_is_written_or_read(tmp_path):
    with pytest.raises(ValueError, match="pickle"):
        files.write_npz(tmp_path / "a.npz", {"a": np.array([object()])})
    np.savez(tmp_path / "b.npz", a=np.array([{"x": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match="pickle"):
        files.read_npz(tmp_path / "b.npz")


@pytest.mark.parametrize("read", [files.read_json, files.read_npz])
def test_a_broken_file_gives_one_sentence(tmp_path, read):
    (tmp_path / "x").write_text("{")
    with pytest.raises(ValueError, match="remove it and run its stage again"):
        read(tmp_path / "x")


def test_two_writers_at_once_are_refused(project):
    held = pytest.raises(ValueError, match=rf"`twin calibrate` \(process {os.getpid()} on")
    with project.lock("calibrate"), held, project.lock("add"):
        pass
    with project.lock("add"):  # what is left of the lock is in nobody's way
        pass
    assert [p.name for p in project.root.glob(".lock*") if p.stat().st_size] == []


def test_a_lock_without_its_owner_is_a_lock(project):
    with project.lock("calibrate"):
        (project.root / ".lock.json").unlink()
        with pytest.raises(ValueError, match="another command is writing to this project"), project.lock("add"):
            pass


def test_the_lock_of_a_killed_process_is_taken_over(project):
    code = (
        "import sys, time; from pathlib import Path; from twin.files import lock\n"
        "with lock(Path(sys.argv[1]), 'measure'): print('held', flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", code, str(project.root / ".lock")]
    root = str(Path(files.__file__).parents[2])
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": root}
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "held\n"
        with pytest.raises(ValueError, match=rf"process {child.pid} "), project.lock("add"):
            pass
        child.send_signal(signal.SIGKILL)
        child.wait(timeout=10)
    with project.lock("add"):
        assert json.loads((project.root / ".lock.json").read_text())["command"] == "add"


@pytest.mark.parametrize("text", ["", "{}", "[1]"])
def test_files_that_a_dead_process_left_lock_nothing(project, text):
    (project.root / ".lock").write_text(text)
    (project.root / ".lock.json").write_text(text)
    with project.lock("add"):
        pass


def test_a_killed_process_resumes_in_its_folder(project):
    code = (
        "import sys, time; from twin.project.folder import Project\n"
        "with Project.open(sys.argv[1]).new_run('calibrate', seed=1) as run:\n"
        "    run.append({'generation': 1}); print(run.name, flush=True); time.sleep(60)"
    )
    root = str(Path(files.__file__).parents[2])
    command = [sys.executable, "-c", code, str(project.root)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": root}
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "0001-calibrate\n"
        child.kill()
        child.wait(timeout=10)
    start = time.monotonic()
    with project.new_run("calibrate", seed=1) as run:
        assert run.resumed
        assert run.log() == [{"generation": 1}]
    assert time.monotonic() - start < 10


def test_a_note_goes_to_the_log_and_not_to_the_screen(project, capsys):
    with project.new_run("calibrate") as run:
        run.note("half model: load and shape are symmetric")
    assert run.log() == [{"note": "half model: load and shape are symmetric"}]
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("model", "text", "sentence"),
    [
        (RunRecord, "[]", "all of it = []: it should be an object"),
        (RunRecord, '{"kind": "camera", "status": "done", "digest": 3}', r"digest = 3: it should be a valid string"),
        (RunRecord, '{"kind": "camera", "status": "done", "digest": "", "seeds": 1}', "seeds is not a known key; did you mean 'seed'"),
        (FitRecord, "{}", r"parameters is missing"),
        (FitRecord, "[" * 100_000, "brackets lie in each other too deeply"),
        (CameraRecord, "null", "all of it = None: it should be an object"),
        (DiagnosisRecord, '{"verdict": 1, "named": []}', "verdict = 1: it should be a valid string"),
        (SolvedRows, '[{"values": {"C10": 0.2, "C01": 0.1}, "top_MPa": -0.03}]', "top_MPa = -0.03: it should be greater than 0"),
        (SourceRecord, "9" * 5000, "not valid JSON"),
    ],
)
def test_a_record_that_is_none_gives_one_sentence(tmp_path, model, text, sentence):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=sentence.replace("[", r"\[")) as told:
        files.read(model, path)
    assert str(path) in str(told.value)
    assert "remove it and run its stage again" in str(told.value)


FIT = {
    "parameters": {"C10": {"value": 0.2, "sd": 0.01, "low": 0.1, "high": 0.3}, "C01": {"value": 0.1, "sd": None, "low": 0.0, "high": 0.3}},
    "covariance": [[1e-4, 0.0], [0.0, 4e-4]], "chi2": 3.0, "degrees_of_freedom": 5, "seed": 1, "evaluations": 7,
    "converged": True, "reason": "converged", "at_bound": [],
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"covariance": [[1e-4, 0.0]]}, "covariance has 1 rows; wanted 2 x 2"),
        ({"covariance": [[1e-4, 1e-5], [0.0, 4e-4]]}, "covariance is not symmetric"),
        ({"covariance": [[1e-4, 3e-4], [3e-4, 4e-4]]}, "covariance has an eigenvalue below 0"),
        ({"at_bound": ["C20"]}, "at_bound names 'C20', which is no parameter"),
        ({"chi2": -1.0}, "chi2 = -1.0"),
        ({"parameters": {"C10": {"value": 0.9, "sd": None, "low": 0.1, "high": 0.3}}}, "value 0.9 is outside its bounds 0.1 to 0.3"),
    ],
)
def test_a_fit_that_contradicts_itself_is_refused(tmp_path, change, sentence):
    files.write_json(tmp_path / "fit.json", FIT)
    assert files.plain(files.read(FitRecord, tmp_path / "fit.json")) == FIT
    files.write_json(tmp_path / "fit.json", FIT | change)
    with pytest.raises(ValueError, match=sentence):
        files.read(FitRecord, tmp_path / "fit.json")


def test_arrays_that_would_fill_the_memory_are_refused(tmp_path, monkeypatch):
    files.write_npz(tmp_path / "x.npz", {"a": np.zeros(10_000)})
    monkeypatch.setattr(files, "MOST_BYTES", 50_000)
    with pytest.raises(ValueError, match=r"not a readable npz file \(unpacked it would have"):
        files.read_npz(tmp_path / "x.npz")


def packed(path, **entries):
    """An npz file of these bytes or arrays by name, those of a name with _ at its end a second time."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a name that stands twice
        for name, data in entries.items():
            buffer = io.BytesIO()
            if isinstance(data, np.ndarray):
                np.save(buffer, data)
            file.writestr(f"{name.rstrip('_')}.npy", buffer.getvalue() or data)


def claims(shape):
    """An array of one number that says to have this shape."""
    buffer = io.BytesIO()
    npy.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return buffer.getvalue() + bytes(8)


@pytest.mark.parametrize(
    ("entries", "why"),
    [
        ({"a": claims((10**9,))}, "a.npy has not the size that it says"),
        ({"a": claims((-1,))}, "a.npy has not the size that it says"),
        ({"a": np.zeros(2, np.longdouble)}, "a.npy holds float128: wanted numbers, booleans or text, no pickle"),
        ({"a": np.zeros(2, complex)}, "a.npy holds complex128"),
        ({"a": np.array([b"x"])}, r"a.npy holds \|S1"),
        ({"a": np.zeros(2, "f8,f8")}, "a.npy holds "),
        ({"a": b"xx"}, "EOF|magic"),
        ({"a": b"no array at all"}, "magic"),
        ({"a": np.zeros(2), "a_": b"xx"}, "EOF|magic"),
        ({"a": np.zeros(2), "a_": np.zeros(3)}, "an array stands twice"),
        ({"b": np.zeros(2)}, "it has no array 'a'"),
    ],
)
def test_an_array_that_is_not_what_it_says_is_refused_with_its_file(tmp_path, entries, why):
    packed(tmp_path / "x.npz", **entries)
    with pytest.raises(ValueError, match=rf"x\.npz: not a readable npz file \(.*({why}).*\); remove it and run") as told:
        files.read_npz(tmp_path / "x.npz", "a")
    assert "allow_pickle" not in str(told.value)


def test_arrays_of_any_order_and_size_of_number_are_read(tmp_path):
    some = {"a": np.asfortranarray(np.arange(6.0).reshape(2, 3)), "b": np.arange(3, dtype=">f4"), "c": np.array("x"), "d": np.zeros((0, 3))}
    files.write_npz(tmp_path / "x.npz", some)
    for name, array in files.read_npz(tmp_path / "x.npz").items():
        np.testing.assert_array_equal(array, some[name])


def test_no_other_code_reads_arrays():
    """Each of them would need the limits of `files.read_npz` again; what comes with the package needs none."""
    sources = [path for package in ("twin", "vision", "fe", "calibrate") for path in (ROOT / package).rglob("*.py")]
    assert [path.name for path in sources if re.search(r"np\.load|npy\.read_array|pickle\.load", path.read_text(encoding="utf-8")) and path.name != "fingertable.py"] == ["files.py"]


def test_a_sound_file_is_never_called_damaged(tmp_path, monkeypatch):
    """Too many open files and too little memory say so, and nobody is told to remove the file."""
    files.write_npz(tmp_path / "x.npz", {"a": np.zeros(3)})
    files.write_json(tmp_path / "x.json", {})
    readers = {"x.npz": files.read_npz, "x.json": files.read_json}
    many = OSError(24, "Too many open files", "x")
    for name, reader in readers.items():
        with monkeypatch.context() as changed:
            changed.setattr(files, "_open_at_once", lambda *_: (_ for _ in ()).throw(many))
            with pytest.raises(OSError, match="Too many open files"):
                reader(tmp_path / name)
    monkeypatch.setattr(files, "_array", lambda *_: (_ for _ in ()).throw(MemoryError))
    with pytest.raises(MemoryError, match=r"x\.npz has "):
        files.read_npz(tmp_path / "x.npz")


@pytest.mark.parametrize("name", ["fifo", "device"])
@pytest.mark.parametrize("where", ["targets/targets.npz", "targets/pressure.csv", "runs/0001-camera/run.json", "raw/log.csv", "cache/x.npz"])
def test_a_fifo_or_device_in_the_place_of_a_file_is_refused_at_once(tmp_path, name, where):
    (tmp_path / "twin.toml").write_text(TOML + '[pressure]\nfile = "raw/log.csv"\n')
    place = tmp_path / where
    place.parent.mkdir(parents=True)
    if name == "fifo":
        os.mkfifo(place)
    else:
        place.symlink_to(os.devnull)
    with pytest.raises(ValueError, match=rf"{re.escape(where)} is a (FIFO|link)"):
        Project.open(tmp_path)
    for reader in (files.read_json, files.read_npz, files.read_text, partial(read_table, columns=("time_s",))):
        with pytest.raises(ValueError, match="FIFO"):
            reader(place)
    with pytest.raises(ValueError, match="FIFO"):
        files.digest_of([place], root=tmp_path)


def test_a_file_too_large_to_read_is_named_with_its_size(tmp_path):
    with open(tmp_path / "x.csv", "wb") as sparse:
        sparse.truncate(3 * 2**30)
    with pytest.raises(ValueError, match=r"x\.csv: 3221 MB; wanted at most 200"):
        read_table(tmp_path / "x.csv", ("time_s",))
    with pytest.raises(ValueError, match=r"x\.csv: 3\.0 GB; wanted at most 1 GB"):
        files.read_bytes(tmp_path / "x.csv")
