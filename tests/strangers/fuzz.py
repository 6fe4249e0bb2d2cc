"""Damaged files for every reader: each must be taken, or refused by one sentence, within seconds.

`fuzz_cases`: files tried; `fuzz_internal`: those at which a reader ended by an internal error, or by a
sentence that helps nobody; `fuzz_hang`: those that took longer than 10 s.
"""

import json
import os
import shutil
import signal
import tempfile
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from tests.strangers import damage

CORPORA = Path(__file__).resolve().parents[1] / "corpora"
LIMIT_S = 10.0
RAW = ("pydantic.dev", "Traceback", "NoneType", "object is not", "invalid literal for", "reshape")


class Hang(BaseException):
    """A reader took too long."""


@dataclass
class Tally:
    """What the readers did so far."""

    cases: int = 0
    refused: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    internal: list[str] = field(default_factory=list)
    hang: list[str] = field(default_factory=list)

    def figures(self) -> dict[str, int]:
        """The figures of the benchmark."""
        return {"fuzz_cases": self.cases, "fuzz_refused": self.refused,
                "fuzz_internal": len(self.internal), "fuzz_hang": len(self.hang)}  # fmt: skip


@dataclass(frozen=True)
class Reader:
    """A reader and what it is given: files of a folder, of which one is damaged. read(folder, file)."""

    files: tuple[str, ...]  # that are damaged, in a copy of the corpus's folder
    read: Callable[[Path, Path], Any]
    share: int = 1  # of the cases


# -- the readers --------------------------------------------------------------------------------------------


def _project(folder: Path, file: Path) -> None:
    from twin.project.toml import dump, former_keys, parse

    data = file.read_bytes()
    dump(parse(data, name=file.name))
    former_keys(data)


def _targets(folder: Path, file: Path) -> None:
    from twin.project.targetfiles import read_targets

    read_targets(folder, nodes={"tip": 4401})


def _log(folder: Path, file: Path) -> None:
    from twin.gauge.logcolumns import LogFormat
    from twin.gauge.pressurelog import read_log

    read_log(file, time_shift_s=0.0, form=LogFormat(None, None, None))


def _deck(folder: Path, file: Path) -> None:
    from fe.deck.reader import read_deck
    from twin.model.structure import of_deck

    if file.name == "bar.inp":  # no chamber: no finger
        read_deck(file)
    else:
        of_deck(folder / "tube.inp")


def _record(folder: Path, file: Path) -> None:
    """A record as stages use it."""
    from twin import files
    from twin.calibrated.caches import SolvedList
    from twin.diagnosis.diagnosisrecord import DiagnosisRecord
    from twin.diagnosis.explanation import EvidenceRecord
    from twin.inputs.cameras import stored_cameras
    from twin.judging.fitrecord import ComparisonRecord, FitRecord
    from twin.project.record import RunRecord

    if file.name == "log.jsonl":
        files.read_jsonl(file)
        return
    if file.name == "solved.json":
        own = file.rename(folder / "x-solved.json")
        list(SolvedList(own).known)
        return
    if file.name == "camera.json":
        stored_cameras(file)[0].undistort(np.array([[1.0, 2.0]]))
        return
    models = (RunRecord, FitRecord, ComparisonRecord, EvidenceRecord, DiagnosisRecord)
    found = files.read({m.file: m for m in models}[file.name], file)
    if isinstance(found, FitRecord):
        assert found.fit.theta.size == len(found.estimates)


def _runs(folder: Path, file: Path) -> None:
    """A run of a project, as `twin list`, `twin check` and whoever wants the newest fit see it."""
    from twin.bench.fits import every_fresh, newest_fit
    from twin.commands.list import run_list
    from twin.project.folder import Project
    from twin.project.toml import with_effects

    root = folder / "batch"
    run = root / "runs" / "0001-calibrate"
    run.mkdir(parents=True)
    study = (CORPORA / "project" / "study.toml").read_text(encoding="utf-8")
    (root / "twin.toml").write_text(with_effects(study, ["creep:2"]), encoding="utf-8")
    for name in ("run.json", "fit.json", "comparison.json"):
        shutil.copy(folder / name, run / name)
    project = Project.open(root)
    run_list(project, _Silent())
    list(every_fresh(project, ("calibrate",), "run.json"))
    newest_fit(project)


class _Silent:
    def __call__(self, text: str, /) -> None:
        json.dumps(text)

    def progress(self, stage: str, done: int, total: int, /) -> None: ...


def _camera(folder: Path, file: Path) -> None:
    from vision.calibration.camerafile import read_camera

    read_camera(file, name="cam1", size=(1280, 720))


def _dictionary(folder: Path, file: Path) -> None:
    from vision.dictionaries import dictionary_of

    dictionary_of(str(file))


def _format(name: str) -> Callable[[Path, Path], None]:
    def read(folder: Path, file: Path) -> None:
        from twin.formats.catalogue import read_recorded

        read_recorded(folder if name in ("dice", "matchid") else file, name)

    return read


READERS: dict[str, Reader] = {
    "project": Reader(("study.toml", "demo.toml"), _project, 3),
    "targets": Reader(("targets.csv", "targets.toml", "targets.npz", "pressure.csv"), _targets, 4),
    "logs": Reader(("mpa.csv", "bar.csv"), _log, 2),
    "deck": Reader(("tube.inp", "mesh.inc", "bar.inp"), _deck, 4),
    "records": Reader(
        ("run.json", "fit.json", "comparison.json", "diagnosis.json", "evidence.json", "camera.json",
         "log.jsonl", "solved.json"), _record, 3,
    ),
    "records/": Reader(("run.json", "fit.json", "comparison.json"), _runs, 2),
    "cameras": Reader(("ros.yaml", "caliscope.toml", "opencv.yml", "opencv.xml", "opencv.json"), _camera, 2),
    "cameras/": Reader(("dictionary.yml",), _dictionary),
    "formats/deeplabcut": Reader(("film.csv",), _format("deeplabcut")),
    "formats/anipose": Reader(("pose.csv",), _format("anipose")),
    "formats/csv": Reader(("points.csv",), _format("csv")),
    "formats/dice": Reader(("DICe_solution_01.txt",), _format("dice")),
    "formats/matchid": Reader(("film_1.csv",), _format("matchid")),
}  # fmt: skip


# -- damage and judgement -----------------------------------------------------------------------------------


def strategy(file: Path) -> st.SearchStrategy[bytes]:
    """The bytes of a file of the corpus, damaged."""
    data = file.read_bytes()
    if file.suffix == ".npz":
        return (damage.arrays.map(lambda done: damage.damaged_arrays(data, done))
                | damage.bits.map(lambda done: damage.damaged_bytes(data, done)))  # fmt: skip
    text = data.decode("utf-8")
    found = damage.edits.map(lambda done: damage.damaged_text(text, done).encode("utf-8", "surrogatepass"))
    if file.suffix == ".json":
        tree = json.loads(text)
        found |= damage.changes.map(lambda done: json.dumps(damage.damaged_tree(tree, done)).encode())
    elif file.suffix == ".toml" and "noise" not in text:  # nan has no form in a tree of JSON
        tables = tomllib.loads(text)
        found |= damage.changes.map(lambda done: _toml(damage.damaged_tree(tables, done)))
    return found | damage.bits.map(lambda done: damage.damaged_bytes(data, done))


def _toml(tables: Any) -> bytes:
    import tomlkit

    try:
        return tomlkit.dumps(tables).encode("utf-8", "surrogatepass")
    except Exception:  # what TOML cannot hold is no file of anyone
        return b""


def tried(tally: Tally, name: str, file: str, data: bytes) -> None:
    """One damaged file given to its reader, and the end counted."""
    reader = READERS[name]
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as scratch:
        folder = Path(shutil.copytree(CORPORA / name.rstrip("/"), Path(scratch) / "corpus"))
        (folder / file).write_bytes(data)
        tally.cases += 1
        try:
            with _limited(LIMIT_S), warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                reader.read(folder, folder / file)
            tally.kinds["taken"] += 1
        except Hang:
            tally.hang.append(f"{name} {file}: {data[:2000]!r}")
        except (ValueError, OSError) as error:
            tally.refused += 1
            if not str(error).strip() or any(word in str(error) for word in RAW):
                tally.internal.append(f"{name} {file}: unhelpful: {error!s:.300}: {data[:300]!r}")
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            tally.kinds[type(error).__name__] += 1
            tally.internal.append(f"{name} {file}: {_where(error)}: {data[:300]!r}")


def _where(error: BaseException) -> str:
    at = error.__traceback__
    while at is not None and at.tb_next is not None:
        at = at.tb_next
    place = "" if at is None else f" at {Path(at.tb_frame.f_code.co_filename).name}:{at.tb_lineno}"
    return f"{type(error).__name__}{place}: {error!s:.200}"


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    def ring(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def fuzz(cases: int, *, first: int = 0, only: str = "") -> Tally:
    """What so many damaged files of all readers led to; first: the seed."""
    tally = Tally()
    chosen = {name: r for name, r in READERS.items() if name.startswith(only)}
    parts = sum(r.share for r in chosen.values())
    for name, reader in chosen.items():
        for file in reader.files:
            count = max(1, -(-cases * reader.share // (parts * len(reader.files))))
            _many(tally, name, file, count, first)
    return tally


def _many(tally: Tally, name: str, file: str, count: int, first: int) -> None:
    @seed(first)
    @settings(max_examples=count, database=None, deadline=None, phases=[Phase.generate],
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(strategy(CORPORA / name.rstrip("/") / file))
    def each(data: bytes) -> None:
        tried(tally, name, file, data)

    each()
