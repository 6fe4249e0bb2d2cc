"""Whatever a verdict, a ranking or the docs name, `add`, `explain`, `drop` and `candidates` take, and the project
opens after it. The solver answers at once; the names do not depend on what it says."""

import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import Case
from tests.few import few
from tests.messages import run, saying
from tests.twin.commands import standin_solver
from tests.twin.conftest import plain_targets
from twin.bench import workbench
from twin.bench.effectchange import change_effects
from twin.bench.workbench import Workbench
from twin.commands import diagnose
from twin.effects.labels import AND, KINDS, groups, name_of
from twin.effects.library import all_effects
from twin.effects.protocol import Effect
from twin.judging import judged
from twin.judging.intervals import fit_record
from twin.marktables import PointTable
from twin.model import prediction
from twin.model.keptmodel import base_test
from twin.model.structure import BuiltIn
from twin.project.config import Config
from twin.project.folder import Project, kind_of
from twin.project.targetfiles import write_targets
from twin.project.toml import dump, with_key
from twin.targets import TargetPoint, at_node

ROOT = Path(__file__).resolve().parents[3]
NAMES, X = ("p1", "middle", "p3", "tip"), np.array([9.556, 4 + 50 / 3, 31.778, 10 + 100 / 3])


def labels_of(e: Effect) -> list[str]:
    """Every label under which an effect may be named."""
    wide = e.wide()
    return [*(law.label for law in e.laws()), *([wide.label] if wide is not None else [])]


def named_in_docs() -> set[str]:
    """What the docs say that one may type."""
    text = "".join(p.read_text(encoding="utf-8") for p in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))])
    typed = re.findall(r"twin (?:add|explain|drop) ([a-z][\w:@.]*)", text)
    listed = re.findall(r"candidates = \[(.*?)\]", text) + re.findall(r"effects = \[(.*?)\]", text)
    typed += [name for names in listed for name in re.findall(r'"([^"]+)"', names)]
    known = {e.name for e in all_effects()}
    return {name for name in typed if name_of(name) in known}


LIBRARY = {label for e in all_effects() for label in labels_of(e)}
FOUND = {"marker_slip:p1@2.5s", "marker_slip:tip@-0.5s"}  # as a diagnosis holds a marker and a time
VERDICTS = {
    "creep or pressure_lag", "tube or an outside force", "creep + tube", "pressure_gain + stiffening",
    "creep + camera_scale or tube + stiffening",
}  # fmt: skip
ALL = sorted(LIBRARY | FOUND | VERDICTS | named_in_docs())
ALWAYS = ("creep:wide", "tube:wide", "marker_slip", "marker_slip:p1@2.5s", "pressure_gain + stiffening", "tube or an outside force")


@pytest.fixture(scope="module")
def calibrated(
    short_case: Case, short_builtin: BuiltIn, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Path]:
    """A project of the short finger that was calibrated, with nothing missing."""
    folder = tmp_path_factory.mktemp("names") / "batch"
    edge = np.stack([X, np.full_like(X, 11.5), np.zeros_like(X)], axis=1)
    rows = np.linalg.norm(short_case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    nodes = [int(k) for k in short_case.labels[rows]]
    points: tuple[TargetPoint, ...] = tuple(map(at_node, NAMES, nodes))
    empty = {"value": np.zeros((8, 4, 3)), "valid": np.ones((8, 4, 3), bool), "modes": np.zeros((0, 8, 4, 3))}
    t = plain_targets(points=points, covariance=np.tile(1e-4 * np.eye(3), (8, 4, 1, 1)), **empty)
    test = base_test(t, short_case)
    u = standin_solver.response(short_case.with_material(C10=0.22, C01=0.09), test.path, test.points)
    noise = 0.01 * np.random.default_rng(1).standard_normal(u.shape)
    t = replace(t, value=u - u[t.reference].mean(axis=0) + noise)
    folder.mkdir()
    config = Config(points=tuple(PointTable(name=n, node=k) for n, k in zip(NAMES, nodes, strict=True)))
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", t)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prediction, "solve", standin_solver.solve)
        patch.setattr(judged, "TURNS", 1)  # nothing is asked of the fits
        patch.setattr(workbench, "BuiltIn", lambda: short_builtin)  # the command line knows the study's finger only
        fitted(folder)
        yield folder


def fitted(folder: Path) -> None:
    """Leave the run of a calibration."""
    project = Project.open(folder)
    bench = Workbench.of(project)
    found = bench.judged(bench.model(), np.array([0.2, 0.1]), lambda text: None)  # type: ignore[arg-type]
    with project.new_run("calibrate", seed=1) as made:
        made.write_json("fit.json", fit_record(found.fit, found.comparison, effects=()))


@pytest.fixture
def batch(calibrated: Path, tmp_path: Path) -> Path:
    return shutil.copytree(calibrated, tmp_path / "batch")


def present(folder: Path) -> tuple[str, ...]:
    """The names of the effects of a project, which opens."""
    return tuple(name_of(label) for label in Project.open(folder).config.model.effects)


@pytest.mark.parametrize("text", few(ALL, ALWAYS))
def test_what_is_named_can_be_explained_added_and_dropped(batch: Path, text: str) -> None:
    names = tuple(name_of(label) for label in groups(text)[0])
    run("explain", text, "--project", batch)
    assert present(batch) == ()
    run("add", text, "--project", batch)
    assert present(batch) == names
    label = AND.join(Project.open(batch).config.model.effects)  # as fit.json and the report name it
    run("explain", label, "--project", batch)
    run("add", label, "--project", batch)  # once more: it is replaced by itself
    assert present(batch) == names
    run("drop", text, "--project", batch)
    assert present(batch) == ()


@pytest.mark.parametrize("text", few(ALL, ALWAYS))
def test_what_is_named_is_a_candidate(batch: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    def taken(model: object, effects: list[Effect], *rest: object, **how: object) -> None:
        seen.extend(e.label for e in effects)
        raise ValueError("seen")

    monkeypatch.setattr(diagnose, "diagnose", taken)
    path = batch / "twin.toml"
    path.write_text(with_key(path.read_text(), "diagnose", "candidates", [text]))
    run("check", "--project", batch)
    with pytest.raises(ValueError, match="seen"):
        run("diagnose", "--project", batch)
    stand_ins = set(KINDS.values())
    assert seen == [label for group in groups(text) for label in group if label not in stand_ins]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        *((words, "is no effect that a model can have; wanted .*an effect of your own") for words in KINDS.values()),
        ("outside force", "it is no effect.*wanted tube, which it may be, or"),
        ("creep + a soft spot", "'a soft spot' tells how the rest looks"),
        ("creep:two", "no such law of creep, wanted one of creep, creep:2, creep:wide$"),
        ("marker_slip:p9@2s", "no marker 'p9'; wanted one of p1, middle, p3, tip"),
        ("Creep", "not in the library"), ("", "not in the library"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("command", ["add", "explain"])
def test_what_no_model_can_have_is_refused_and_nothing_is_written(
    batch: Path, command: str, text: str, why: str
) -> None:
    before = (batch / "twin.toml").read_bytes()
    with pytest.raises(ValueError, match=why):
        run(command, text, "--project", batch)
    assert (batch / "twin.toml").read_bytes() == before
    assert present(batch) == ()


def test_what_twin_toml_could_not_hold_is_refused_before_it_is_fitted(
    batch: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Workbench.of(Project.open(batch))
    monkeypatch.setattr(Workbench, "judged", lambda *given, **more: pytest.fail("it was fitted"))
    with pytest.raises(ValueError, match=saying(r"twin\.toml", "model.effects")):
        change_effects(bench, "add", ("creep", "creep:wide"), {}, lambda text: None)  # type: ignore[arg-type]
    assert [kind_of(path) for path in Project.open(batch).runs()] == ["calibrate"]


def test_effects_that_twin_toml_could_not_hold_are_not_written(batch: Path) -> None:
    before = (batch / "twin.toml").read_bytes()
    for wrong in (["Creep 2"], ["creep", "creep:wide"]):
        with pytest.raises(ValueError, match=r"twin\.toml: model"):
            Project.open(batch).set_effects(wrong)
    assert (batch / "twin.toml").read_bytes() == before
