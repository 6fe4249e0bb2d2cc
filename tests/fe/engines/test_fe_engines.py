"""Three engines behind one protocol: the same case, the same answer; Abaqus by a stand-in that records."""

import ast
import dataclasses
import json
import os
import re
import stat
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path as File

import numpy as np
import pytest

from fe import Case, solve
from fe import Path as Course
from fe.deck.reader import read_deck
from fe.engines import process
from fe.engines.abaqus import EXTRACT, Abaqus
from fe.engines.calculix import CalculiX
from fe.engines.engine import Embedded, Engine
from fe.engines.writer import steps_of
from fe.mesh.convert import converted
from tests.messages import says

PRESSURE = 0.01  # MPa
# Records its command line; "solves" by copying a recorded result where the extraction script would write it.
STAND_IN = """\
#!{python}
import json, pathlib, shutil, sys
log = pathlib.Path({log!r})
seen = json.loads(log.read_text()) if log.exists() else []
seen.append({{"arguments": sys.argv[1:], "files": sorted(p.name for p in pathlib.Path(".").iterdir())}})
log.write_text(json.dumps(seen))
if sys.argv[1] == "python":
    assert pathlib.Path("job.odb").exists()
    shutil.copy({result!r}, sys.argv[5])
else:
    if {fails!r}:
        sys.exit("Abaqus/Analysis exited with errors")
    pathlib.Path("job.odb").write_text("")
"""


@pytest.fixture
def stand_in(tmp_path: File) -> Callable[..., tuple[Abaqus, File]]:
    """`stand_in(csv_text, fails=False)`: an Abaqus whose extraction gives that text, and its log."""

    def make(text: str, *, fails: bool = False) -> tuple[Abaqus, File]:
        program, log, result = (tmp_path / name for name in ("abaqus", "log.json", "result.csv"))
        result.write_text(text)
        code = STAND_IN.format(python=sys.executable, log=str(log), result=str(result), fails=fails)
        program.write_text(code)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        return Abaqus(executable=str(program), folder=tmp_path / "job"), log

    return make


def recorded(case: Case) -> str:
    """What the extraction script writes, from the embedded engine's displacements."""
    found = Embedded().solve(case, PRESSURE)
    rows = [
        f"{share:.9g},{n},{share * u[0]:.9g},{share * u[1]:.9g},{share * u[2]:.9g}"
        for share in (0.5, 1.0)
        for n, u in zip(found.labels, found.u)
    ]
    return "\n".join(["share,label,u1,u2,u3", *rows[::-1], ""])  # in any order


def test_abaqus_is_run_with_the_studys_settings_and_read(
    short: Case, stand_in: Callable[..., tuple[Abaqus, File]]
) -> None:
    case = converted(short, "C3D20RH")
    abaqus, log = stand_in(recorded(case))
    found = abaqus.solve(short, PRESSURE)
    assert found.reason == "converged"
    expected = Embedded().solve(case, PRESSURE)
    np.testing.assert_allclose(found.at(4401), expected.at(4401), atol=1e-7)
    job, extraction = json.loads(log.read_text())
    assert job["arguments"] == [
        "job=job", "input=job.inp", "cpus=4", "domains=4", "memory=60%", "interactive", "ask_delete=OFF",
    ]  # fmt: skip
    assert extraction["arguments"] == ["python", "extract.py", "job.odb", "1", "job.csv"]
    np.testing.assert_allclose(found.share, [0.5, 1.0])
    np.testing.assert_allclose(found.course[0], found.u / 2, atol=1e-7)
    assert {"job.inp", "extract.py"} <= set(job["files"])
    assert abaqus.folder
    assert read_deck(abaqus.folder / "job.inp").case.element.name == "C3D20RH"  # hybrid, as Abaqus wants it


def test_an_abaqus_that_fails_or_stops_early_says_so(
    short: Case, stand_in: Callable[..., tuple[Abaqus, File]]
) -> None:
    abaqus, _ = stand_in("", fails=True)
    found = abaqus.solve(short, PRESSURE)
    assert not found.converged
    assert "exited with errors" in found.reason
    with pytest.raises(ValueError, match=r"no displacement of node 4401.*exited with errors"):
        found.at(4401)
    abaqus, _ = stand_in("share,label,u1,u2,u3\n0.25,4401,1,2,3\n")
    stopped = abaqus.solve(short, PRESSURE)
    assert stopped.reason == "stopped at 0.25 of the step"
    np.testing.assert_array_equal(stopped.course, [[[1, 2, 3]]])  # what was reached
    assert stopped.u.shape == (0, 3)
    abaqus, _ = stand_in("share,label,u1,u2,u3\n")  # the job stopped before its last step
    assert abaqus.solve(short, PRESSURE).reason == "the result file holds no displacements"
    abaqus, _ = stand_in("share,label,u1,u2,u3\n0.5,4401,1,2,3\n1,4401,1,2,3\n1,4402,1,2,3\n")
    assert "other nodes" in abaqus.solve(short, PRESSURE).reason


@pytest.mark.parametrize("engine", [Abaqus(executable="no-such-abaqus"), CalculiX(executable="no-such-ccx")])
def test_an_engine_that_is_absent_says_what_to_install(short: Case, engine: Engine) -> None:
    with pytest.raises(FileNotFoundError, match=r"not found, wanted .*install"):
        engine.solve(short, PRESSURE)


def test_the_extraction_script_is_python_and_uses_what_an_odb_has() -> None:
    tree = ast.parse(EXTRACT)
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    # names of the odb's object model: Abaqus Scripting Reference Guide, "Odb commands"
    model = {"steps", "frames", "fieldOutputs", "values", "nodeLabel", "data", "dataDouble", "precision"}
    assert model <= used
    assert used - model <= {"frameValue", "argv", "write", "close"}


# abqpy decorates all it documents by functions without types, behind which everything would be Any.
DECORATORS = """\
from typing import Any, TypeVar
_T = TypeVar("_T")
def abaqus_function_doc(f: _T) -> _T: ...
def abaqus_class_doc(f: _T) -> _T: ...
def abaqus_method_doc(f: _T) -> _T: ...
def __getattr__(name: str) -> Any: ...
"""


@pytest.fixture(scope="module")
def stubs(tmp_path_factory: pytest.TempPathFactory) -> File:
    """abqpy's types of the odb's objects, unpacked: its modules have names such as `mesh`, so that it is never
    installed. Skips where no package index is there, fails where SOFTTWIN_REQUIRE names abqpy."""
    folder = tmp_path_factory.mktemp("abqpy")
    pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(folder), "abqpy==2026.10"]
    done = subprocess.run(pip, capture_output=True, text=True, timeout=120)
    if done.returncode != 0:
        if "abqpy" in os.environ.get("SOFTTWIN_REQUIRE", "").split():
            pytest.fail(f"abqpy cannot be had, and SOFTTWIN_REQUIRE asks for it: {done.stderr}")
        pytest.skip("abqpy==2026.10 cannot be had from a package index")
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "unpacked")
    (folder / "unpacked" / "abqpy" / "decorators.pyi").write_text(DECORATORS)
    return folder / "unpacked"


@pytest.mark.slow
def test_the_extraction_script_has_the_types_of_an_odb(stubs: File, tmp_path: File) -> None:
    pytest.importorskip("mypy")
    (tmp_path / "extract.py").write_text(EXTRACT)
    (tmp_path / "wrong.py").write_text(EXTRACT.replace("frame.frameValue", "frame.time"))
    check = [sys.executable, "-m", "mypy", "--config-file=", "--follow-imports=silent", "--cache-dir", str(tmp_path / "c")]
    env = {**os.environ, "MYPYPATH": str(stubs)}
    done = subprocess.run([*check, "extract.py", "wrong.py"], cwd=tmp_path, env=env, capture_output=True, text=True)
    (told,) = [line for line in done.stdout.splitlines() if "error:" in line]
    assert told.startswith("wrong.py")
    assert '"OdbFrame" has no attribute "time"' in told


def test_the_embedded_engine_and_calculix_give_one_answer(stub: Case, require: Callable[[str], None]) -> None:
    require("ccx")
    case = converted(stub, "C3D20RH")
    engines: list[Engine] = [Embedded(), CalculiX()]
    ours, theirs = (e.solve(case, PRESSURE) for e in engines)
    assert ours.converged
    assert theirs.converged
    np.testing.assert_allclose(theirs.at(4401), ours.at(4401), rtol=1e-3)


def test_the_embedded_engine_never_raises_for_lack_of_convergence(short: Case) -> None:
    found = Embedded().solve(short, 5.0)
    assert not found.converged
    assert "stopped at" in found.reason


def test_calculix_writes_the_course_of_the_pressure_under_a_weight_put_on_before(
    stub: Case, require: Callable[[str], None]
) -> None:
    """Against this kernel in the same elements, at the pressures that CalculiX chose."""
    require("ccx")
    case, weight = converted(stub.with_material(density=1.07e-9), "C3D20RH"), np.array([0.0, 0.0, -9810.0])
    theirs = CalculiX().solve(case, PRESSURE, gravity=weight, levels=4)
    assert theirs.converged
    assert theirs.share[0] == 0.0  # the weight alone
    assert len(theirs.share) > 4
    ramp = np.array([0.0, 1.0])
    ours = solve(case, Course(ramp, PRESSURE * ramp, theirs.share, gravity=weight)).fields(range(len(theirs.share)))
    rows = [int(np.flatnonzero(case.labels == label)[0]) for label in theirs.labels]
    moves = np.abs(ours).max()
    # six digits in its result file, and its tolerance of the residual, 0.5 % of the force
    np.testing.assert_allclose(theirs.course, ours[:, rows], atol=1e-3 * moves)
    assert np.abs(ours[0]).max() > 0.01 * moves  # the weight is felt


def test_of_a_calculix_that_stopped_the_last_block_does_not_count(tmp_path: File) -> None:
    """It writes its best solution of an increment that did not converge, as if it were one."""
    program = tmp_path / "ccx"
    blocks = [
        f"  100CL  10{k} {time:.5E}           1                     0    {k}           1\n -4  DISP        4    1\n"
        f" -1      4401 {k:.5E} 0.00000E+00 0.00000E+00\n -3\n"
        for k, time in ((1, 0.25), (2, 0.5), (3, 0.625))
    ]
    end = ' *ERROR: too many cutbacks'
    code = f"#!{sys.executable}\nopen('job.frd', 'w').write({''.join(blocks)!r})\nprint({end!r})\nraise SystemExit(201)\n"
    program.write_text(code)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    found = CalculiX(executable=str(program)).run("*STEP\n")
    assert not found.converged
    assert found.reason == "stopped at 0.5 of the step: *ERROR: too many cutbacks"
    np.testing.assert_array_equal(found.share, [0.25, 0.5])
    np.testing.assert_array_equal(found.course[:, 0, 0], [1.0, 2.0])


def frd(*blocks: tuple[str, str]) -> str:
    """A result file of CalculiX with one node: time and displacement of each increment."""
    return "".join(
        f"  100CL  10{k} {time:>11}           1                     0    {k}           1\n -4  DISP        4    1\n"
        f" -1      4401{u:>12} 0.00000E+00 0.00000E+00\n -3\n"
        for k, (time, u) in enumerate(blocks)
    )


HALF, FULL = ("5.00000E-01", "1.00000E-01"), ("1.00000E+00", "2.00000E-01")
WRITE = "open('job.frd', 'w').write({!r})"
MISBEHAVIOUR = {
    "nan": (WRITE.format(frd(HALF, (FULL[0], "NaN"))), "no numbers below"),
    "infinity": (WRITE.format(frd(HALF, (FULL[0], "Infinity"))), "no numbers below"),
    "too far": (WRITE.format(frd(HALF, (FULL[0], "1.0000E+200"))), "no numbers below"),
    "stars": (WRITE.format(frd(HALF, (FULL[0], "*" * 12))), r"no number .*\*{12}"),
    "no E": (WRITE.format(frd(HALF, (FULL[0], "1.00000-100"))), "no number .*1.00000-100"),
    "foreign byte": ("open('job.frd', 'wb').write({!r})".format(frd(HALF, FULL).encode().replace(b"2.00", b"2.\xff0")), "no number"),
    "stars for a time": (WRITE.format(frd(HALF, ("*" * 11, FULL[1]))), r"no number .*\*{11}"),
    "time that goes back": (WRITE.format(frd(FULL, HALF)), "times that do not increase"),
    "written twice": (WRITE.format(frd(HALF, HALF)), "times that do not increase"),
    "pipe": ("import os; os.mkfifo('job.frd')", "job.frd: wanted a file, no pipe or device"),
    "device": ("import os; os.symlink('/dev/urandom', 'job.frd')", "job.frd: wanted a file, no pipe or device"),
    "large": ("open('job.frd', 'w').truncate(2**31 + 1)", "job.frd: wanted a file, .* of at most 2 GB"),
    "hangs": ("import time; time.sleep(600)", "not ended after 2 s, and killed"),
    "child hangs": ("import subprocess, sys; subprocess.run(['sleep', '600'])", "not ended after 2 s, and killed"),
    "prints without end": ("while True: print('y' * 65536)", "printed more than 16 MB"),
    "nothing": ("pass", "ccx stopped before the end"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISBEHAVIOUR)
def test_a_program_that_misbehaves_gives_a_reason(tmp_path: File, name: str) -> None:
    act, told = MISBEHAVIOUR[name]
    program = tmp_path / "ccx"
    end = "import sys; sys.stdout.buffer.write(b'\\xff\\xfe'); print(' Job finished')"
    program.write_text(f"#!{sys.executable}\n{act}\n{end}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    found = CalculiX(executable=str(program), timeout_s=2.0).run("*STEP\n")
    assert not found.converged
    assert re.search(told, found.reason)


def test_bytes_that_are_no_text_spoil_no_job(tmp_path: File, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "ccx"
    printed = "import sys; sys.stdout.buffer.write(b'Version \\xff2.20\\n'); print(' Job finished')"
    act = WRITE.format(frd(HALF, FULL))
    program.write_text(f"#!{sys.executable}\n{printed}\nif '-v' not in sys.argv: {act}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    engine = CalculiX(executable=str(program))
    np.testing.assert_array_equal(engine.run("*STEP\n").course[:, 0, 0], [0.1, 0.2])
    assert engine.release().startswith("CalculiX")
    program.write_text(f"#!{sys.executable}\nimport time; time.sleep(600)\n")
    monkeypatch.setattr(process, "RELEASE_S", 1.0)
    with pytest.raises(TimeoutError, match="not ended after 1 s, and killed; wanted its version"):
        engine.release()


# An Abaqus that solves by CalculiX and keeps its result as text; its Python has an `odbAccess` that reads it, so
# that the extraction script itself is run.
WORKING = """\
#!{python}
import json, os, pathlib, subprocess, sys
sys.path.insert(0, {root!r})
here = pathlib.Path(".")
if sys.argv[1] == "information=release":
    print("Abaqus JobID   0\\nAbaqus 2023\\n")
elif sys.argv[1] == "python":
    os.environ["PYTHONPATH"] = {modules!r}
    sys.exit(subprocess.call([{python!r}, *sys.argv[2:]]))
else:
    options = dict(word.partition("=")[::2] for word in sys.argv[1:])
    wanted = {{"job": "job", "input": "job.inp", "cpus": "2", "domains": "2", "memory": "4gb"}}
    if {{k: v for k, v in options.items() if v}} != {{**wanted, "ask_delete": "OFF"}} or "interactive" not in options:
        sys.exit("Abaqus Error: the options are " + repr(options))
    from fe.engines.calculix import CalculiX
    text = (here / options["input"]).read_text()
    if "TYPE=C3D20RH" not in text or "*DSLOAD" not in text or not text.startswith("*HEADING"):
        sys.exit("Abaqus Error: the deck is not understood")
    found = CalculiX().run(text)
    frames = [[float(s), u.tolist()] for s, u in zip(found.share, found.course)]
    (here / "job.odb").write_text(json.dumps([text.count("*STEP,"), found.labels.tolist(), frames]))
    if not found.converged:
        sys.exit("Abaqus/Analysis exited with errors")
"""
ODB_ACCESS = """\
import json
from types import SimpleNamespace as Object

def openOdb(path, readOnly):
    assert readOnly
    count, labels, frames = json.load(open(path))
    def frame(share, u):
        values = [Object(nodeLabel=n, data=x, precision="SINGLE_PRECISION") for n, x in zip(labels, u)]
        return Object(frameValue=share, fieldOutputs={"U": Object(values=values)})
    steps = {"Step-%d" % k: Object(frames=[]) for k in range(count)}
    steps["Step-%d" % (count - 1)] = Object(frames=[frame(*one) for one in frames])
    return Object(steps=steps, close=lambda: None)
"""


@pytest.fixture
def working(tmp_path: File, require: Callable[[str], None]) -> Abaqus:
    """An Abaqus that solves, with 2 CPUs and 4 GB."""
    require("ccx")
    program, modules, root = tmp_path / "abq", tmp_path / "modules", File(__file__).resolve().parents[3]
    modules.mkdir()
    (modules / "odbAccess.py").write_text(ODB_ACCESS)
    program.write_text(WORKING.format(python=sys.executable, root=str(root), modules=str(modules)))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return Abaqus(executable=str(program), cpus=2, memory="4gb")


def test_abaqus_is_asked_in_words_that_it_knows_and_its_odb_is_read(
    stub: Case, working: Abaqus, tmp_path: File
) -> None:
    assert working.release() == "Abaqus 2023"
    heavy, weight = stub.with_material(density=1.07e-9), np.array([0.0, 0.0, -9810.0])
    text = working.deck(heavy, PRESSURE, gravity=weight, levels=3)
    assert steps_of(text) == 2
    found = working.run(text, folder=tmp_path / "job")
    assert found.reason == "converged"
    same = CalculiX().run(text)
    order = np.argsort(same.labels)
    np.testing.assert_array_equal(found.labels, same.labels[order])
    np.testing.assert_allclose(found.share, same.share, atol=1e-9)
    np.testing.assert_allclose(found.course, same.course[:, order], atol=1e-8)  # nine digits
    log = (tmp_path / "job" / "job.log").read_text()
    says(log, "job=job", "input=job.inp", "cpus=2", "domains=2", "memory=4gb", "ask_delete=OFF")
    wrong = dataclasses.replace(working, memory="5gb").run(text, folder=tmp_path / "wrong")
    assert "Abaqus Error: the options are" in wrong.reason
