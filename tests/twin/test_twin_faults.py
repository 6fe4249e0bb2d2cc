"""Faults of the surroundings: interrupts at any moment, a full disk, no terminal, another language, two at once.

Every command runs in a process of its own, as a user starts it.
"""

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.few import few
from tests.strangers import kills
from twin import files
from twin.files import lock
from twin.project.folder import Project, dataset

# Python's own answer to an interrupt, which is a traceback, ends where the command's begins.
ENTER = """if True:
    import signal, sys
    from twin.main import start
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    print("up", file=sys.stderr, flush=True)
    start()
"""
ROOT = Path(__file__).resolve().parents[2]


def started(*arguments: object, **how: object) -> subprocess.Popen[str]:
    """`twin ...` as a process; the word `up` on stderr says that it has begun."""
    given = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": ROOT, "errors": "replace"}
    return subprocess.Popen([sys.executable, "-c", ENTER, *map(str, arguments)], **{**given, **how})  # type: ignore[call-overload,no-any-return]


def ended(*arguments: object, **how: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `twin ...`."""
    process = started(*arguments, **how)
    out, error = process.communicate(timeout=120)
    return process.returncode, out, error.removeprefix("up\n") if error else ""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    folder = tmp_path / "study"
    (folder / "targets").mkdir(parents=True)
    for name in ("twin.toml", "targets/targets.csv"):
        (folder / name).write_bytes((dataset("study") / name).read_bytes())
    return folder


COMMANDS = (("--help",), ("list", "-p", "."), ("look", "-p", "."))


def interrupted(command: tuple[str, ...], folder: Path, moment: float) -> None:
    """Start a command there and interrupt it so many seconds after it began: no traceback, nothing locked."""
    process = started(*command, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert process.stderr is not None
    assert process.stderr.readline() == "up\n"
    time.sleep(moment)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert "Traceback" not in error, moment
    # the last milliseconds, without Python's handlers, are the system's: -2, in a shell 130 as well
    assert process.returncode in (0, 130, -signal.SIGINT), moment
    assert not (folder / ".lock.json").exists()


@pytest.mark.parametrize("command", few(COMMANDS, COMMANDS[-1:]))
def test_an_interrupt_at_any_moment_leaves_no_traceback(study: Path, command: tuple[str, ...]) -> None:
    for moment in (0.0, *np.random.default_rng(3).uniform(0.0, 1.5, 2)):
        interrupted(command, study, moment)
    assert ended("look", "-p", study)[0] == 0


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_interrupts_at_many_moments(study: Path, command: tuple[str, ...]) -> None:
    for moment in np.random.default_rng(4).uniform(0.0, 1.5, 20):
        interrupted(command, study, moment)


def test_an_interrupt_that_falls_into_a_callback_is_not_lost() -> None:
    code = """if True:
        import signal, sys, time, types
        from twin import main

        class Callback:
            def __del__(self):
                signal.raise_signal(signal.SIGINT)

        def run():
            Callback()
            time.sleep(20.0)

        sys.modules["twin.cli"] = types.SimpleNamespace(main=run)
        main.start()
    """
    begin = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, cwd=ROOT)
    assert (done.returncode, done.stderr) == (130, "interrupted: run the same command again\n")
    assert time.monotonic() - begin < 15.0  # it did not wait for the work to end


def test_an_interrupt_just_after_the_lock_is_named_leaves_no_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(path: Path, data: object) -> None:
        path.write_text(str(data), encoding="utf-8")
        raise KeyboardInterrupt

    monkeypatch.setattr(files, "write_json", interrupted)
    with pytest.raises(KeyboardInterrupt), lock(tmp_path / ".lock", "look"):
        pass
    assert not (tmp_path / ".lock.json").exists()


def test_an_interrupt_waits_until_a_library_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "loaded.py").write_text(
        "import signal, time\nsignal.raise_signal(signal.SIGINT)\ntime.sleep(0.1)\nprint('loaded', flush=True)\n",
        encoding="utf-8",
    )
    code = """if True:
        import sys, time, types
        from twin import main

        def run():
            import loaded
            time.sleep(20.0)

        sys.modules["twin.cli"] = types.SimpleNamespace(main=run)
        main.start()
    """
    paths = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}
    begin = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=paths)
    assert (done.returncode, done.stdout) == (130, "loaded\n")
    assert time.monotonic() - begin < 15.0


def test_an_import_that_never_ends_is_interrupted_after_some_patience(tmp_path: Path) -> None:
    (tmp_path / "endless.py").write_text(
        "import signal, time\nsignal.raise_signal(signal.SIGINT)\nfor _ in range(400):\n    time.sleep(0.1)\n",
        encoding="utf-8",
    )
    code = """if True:
        import sys, types
        from twin import main

        def run():
            import endless

        sys.modules["twin.cli"] = types.SimpleNamespace(main=run)
        main.PATIENCE_S = 0.5
        main.start()
    """
    paths = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}
    begin = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=paths)
    assert (done.returncode, "Traceback" in done.stderr) == (130, False)
    assert time.monotonic() - begin < 15.0


def test_a_command_that_is_asked_to_end_gives_its_lock_back(study: Path) -> None:
    process = started("calibrate", "-p", study)
    while not (study / ".lock.json").exists():
        assert process.poll() is None
        time.sleep(0.01)
    process.terminate()
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in error
    assert "Traceback" not in error
    assert not (study / ".lock.json").exists()


def test_two_commands_at_once_do_not_meet(study: Path, tmp_path: Path) -> None:
    with lock(study / ".lock", "calibrate"):
        code, _, error = ended("look", "-p", study)
    assert (code, "`twin calibrate`" in error) == (2, True)
    both = [started("init", tmp_path / "new") for _ in range(2)]
    codes = sorted((p.communicate(timeout=60), p.returncode)[1] for p in both)
    assert codes in ([0, 2], [0, 0])  # the second may find an empty folder's place taken, or begin after the first
    assert codes == [0, 2]
    Project.open(tmp_path / "new")
    assert [p.name for p in tmp_path.iterdir() if "partial" in p.name] == []


PLAIN = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.slow
def test_names_that_the_language_does_not_have(study: Path) -> None:
    text = (study / "twin.toml").read_text(encoding="utf-8")
    (study / "twin.toml").write_text(text.replace('name = "study"', 'name = "Prüfling-字"'), encoding="utf-8")
    folder = study.rename(study.with_name("Prüfling-字"))
    for command in ("check", "list", "look"):
        code, _, error = ended(command, "-p", folder, env={**os.environ, **PLAIN})
        assert (code, error) == (0, ""), command


def test_a_byte_order_mark_in_twin_toml_is_no_fault(study: Path) -> None:
    (study / "twin.toml").write_bytes(b"\xef\xbb\xbf" + (study / "twin.toml").read_bytes())
    assert ended("check", "-p", study)[0] == 0
    assert Project.open(study).set_effects(["creep"]).config.model.effects == ("creep",)


def test_no_terminal_and_no_output(study: Path) -> None:
    for shell in ('"$@" >&-', '"$@" >&- 2>&-', '"$@" 2>&- </dev/null', '"$@" <&-'):
        command = ["sh", "-c", shell, "sh", sys.executable, "-c", "from twin.main import start; start()", "list"]
        done = subprocess.run([*command, "-p", str(study)], cwd=ROOT, capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr) == (0, ""), shell


@pytest.mark.parametrize(("command", "made"), [("check", None), ("look", "quality.csv")])
def test_a_reader_that_has_enough_is_no_error_and_stops_no_work(study: Path, command: str, made: str | None) -> None:
    process = started(command, "-p", study)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr as error:
        assert error.read() == "up\n"
    assert process.wait(timeout=120) == 0
    assert made is None or Project.open(study).newest(command, made) is not None


def test_a_number_of_threads_that_is_none_is_named(study: Path) -> None:
    for threads in ("abc", "0", "-1", "2,2"):
        code, _, error = ended("check", "-p", study, env={**os.environ, "OMP_NUM_THREADS": threads})
        assert (code, error) == (2, f"error: OMP_NUM_THREADS = '{threads}': wanted a number of threads, 1 or more; unset it\n")


def test_a_folder_whose_name_no_file_can_hold_is_refused(study: Path, tmp_path: Path) -> None:
    for more in ((), ("--like", study)):
        code, _, error = ended("init", os.fsdecode(bytes(tmp_path) + b"/bad\xff"), *more)
        assert code == 2
        assert error.endswith("bad\\udcff: its name is no UTF-8 text; wanted a folder of another name\n")
        assert [path.name for path in tmp_path.iterdir()] == ["study"]


def test_a_name_that_is_too_long_is_said_of_the_folder(tmp_path: Path) -> None:
    code, _, error = ended("init", tmp_path / ("y" * 250))
    assert (code, error) == (2, f"error: {tmp_path / ('y' * 250)}: File name too long\n")


def test_the_next_command_can_be_typed_as_it_stands(tmp_path: Path) -> None:
    for name in ("a b  'c'", "-dash", "$(date)"):
        code, out, _ = ended("init", "--", name, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
        assert code == 0
        command = out.partition("Next: `")[2].partition("` says")[0]
        assert subprocess.run(["sh", "-c", f"cd {command.partition('--project ')[2]} && ls"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout == "raw\ntwin.toml\n"


def test_a_full_output_is_said(study: Path) -> None:
    with open("/dev/full", "w") as full:
        code, _, error = ended("check", "-p", study, stdout=full)
    assert code == 2
    assert "No space left on device" in error
    assert "Traceback" not in error


def small_files(limit: int) -> Callable[[], None]:
    """What a process does first so that no file of it may be larger, in bytes."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))


@pytest.mark.parametrize("limit", few([100, 2000], [100]))
def test_files_that_cannot_grow_are_named_and_nothing_half_is_left(study: Path, limit: int) -> None:
    code, _, error = ended("look", "-p", study, preexec_fn=small_files(limit))
    assert code == 2
    assert "File too large" in error
    assert str(study) in error  # which file it was
    assert [p for p in study.rglob(".*") if p.is_file() and p.name != ".lock"] == []
    assert ended("look", "-p", study)[0] == 0


@pytest.mark.slow
def test_a_full_disk_in_any_stage_changes_no_bit() -> None:
    found = kills.disk(True)
    assert found["disk_faults"] == found["disk_same"] > 12
    assert found["disk_internal"] == found["disk_left"] == found["disk_half"] == 0


@pytest.mark.slow
def test_interrupts_and_kills_in_any_stage_change_no_bit(tmp_path: Path) -> None:
    found = kills.interrupts(True, count=5, tally=tmp_path)
    assert found["interrupts_same"] == found["interrupts"] == 5
    assert found["interrupts_traceback"] == 0
    assert kills.kills(True, count=4, tally=tmp_path)["kills_same"] == 4


@pytest.mark.slow
def test_of_two_recalibrations_at_once_one_waits_for_the_other(tmp_path: Path) -> None:
    folder = tmp_path / "short"
    kills.KINDS["model"].make(folder)
    both = [kills._child(folder, "model", ("recalibrate",)) for _ in range(2)]
    said = {child.returncode: error for child, error in [(c, c.communicate(timeout=1800)[1]) for c in both]}
    assert set(said) == {0, 2}
    assert f"{folder / '.lock'}: `twin recalibrate` (process " in said[2]
    assert "is writing to this project; wait for it to end" in said[2]
    alone = tmp_path / "alone"
    kills.KINDS["model"].make(alone)
    kills._finished(alone, "model")
    assert kills.digests(folder) == kills.digests(alone)
