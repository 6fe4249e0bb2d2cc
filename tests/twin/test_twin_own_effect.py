"""docs/own-effect.md: its file keeps the contract, and finds a force that was planted in another mesh."""

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import Case, Lattice, Material
from tests.few import few
from tests.messages import Lines as Silent
from tests.messages import run
from twin import Effect, check_effect, open_project, virtual
from twin.bench import workbench
from twin.bench.fits import newest_fit, stale
from twin.commands.check import run_check
from twin.effects.ownfiles import own_effects
from twin.marktables import PointTable
from twin.model.structure import BuiltIn
from twin.project.config import CalibrateTable, Config, DiagnoseTable, ModelTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.project.toml import dump

PAGE = Path(__file__).resolve().parents[2] / "docs" / "own-effect.md"
FILM = ((0.0, 0.0), (2.0, 0.0), (6.0, 30.0), (8.0, 30.0))  # s, kPa
BENCH = virtual.Bench(film_hz=2.0, gauge_sd_MPa=1e-4, sd=0.002)
NAMES, X = ("p1", "p2", "middle", "p4", "tip"), np.array([9.556, 15.111, 4 + 50 / 3, 31.778, 10 + 100 / 3])
UP, ALONG = 0.4, 0.2  # N


def blocks() -> list[str]:
    """The Python on the page: the file, its check, a notebook."""
    return re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)


def example() -> str:
    """The file on the page."""
    return blocks()[0]


@pytest.fixture(scope="module")
def batch(short_case: Case, short_builtin: BuiltIn, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A project of the short finger, filmed while a cable pulled its tip, and calibrated without that."""
    folder = tmp_path_factory.mktemp("own") / "batch"
    edge = np.stack([X, np.full_like(X, 11.5), np.zeros_like(X)], axis=1)
    rows = np.linalg.norm(short_case.nodes[:, None] - edge, axis=2).argmin(axis=0)
    points, course = short_case.nodes[rows], virtual.path(BENCH, protocol=FILM)
    finer = Lattice(per_bellow=2, ring=False, centred=False, caps=2)
    truth = virtual.truth_case(short_builtin.finger, finer, material=Material(0.214, 0.083), element=None)
    truth = replace(truth, forces={"tip_face": np.array([ALONG, 0.0, UP]) / 2})  # of the half that is solved
    u, slope = virtual.displaced(truth, course, points)
    at = virtual.at_nodes(NAMES, short_case.labels[rows], points)
    targets = virtual.noisy_targets(u, slope, course, points=at, bench=BENCH, seed=1)
    config = Config(
        points=tuple(PointTable(name=n, node=int(k)) for n, k in zip(NAMES, short_case.labels[rows], strict=True)),
        model=ModelTable(effect_files=("effects/cable.py",), fixed={"C01": 0.083}),  # of a test of the material
        calibrate=CalibrateTable(population=6, generations=2),
    )
    (folder / "effects").mkdir(parents=True)
    (folder / "effects" / "cable.py").write_text(example(), encoding="utf-8")
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    run("trust", "--project", folder)
    write_targets(folder / "targets", replace(targets, noise=None))  # else finer meshes are solved, too
    with pytest.MonkeyPatch.context() as patch:  # the command line knows the study's finger only
        patch.setattr(workbench, "BuiltIn", lambda: short_builtin)
        run("check", "--project", folder)
        run("calibrate", "--project", folder)
        yield folder


def test_the_file_of_the_page_keeps_the_contract(tmp_path: Path) -> None:
    (tmp_path / "cable.py").write_text(example(), encoding="utf-8")
    (cable,) = own_effects(tmp_path, ["cable.py"])
    assert isinstance(cable, Effect)
    assert check_effect(cable) == ()


def test_twin_add_finds_the_planted_force(batch: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("add", "cable", "--project", batch)
    bench = open_project(batch)
    assert [e.label for e in bench.model().effects] == ["elasticity", "cable"]
    (fit,) = batch.glob("runs/*-add/fit.json")
    found = json.loads(fit.read_text())["parameters"]
    # the truth's mesh is another, and its force acts on the whole end face: half a 95 % interval
    assert found["cable.up"]["value"] == pytest.approx(UP, abs=0.06)
    assert found["cable.along"]["value"] == pytest.approx(ALONG, abs=0.1)
    before = json.loads(next(batch.glob("runs/*-calibrate/fit.json")).read_text())
    assert newest_fit(bench.project).chi2 < 0.5 * before["chi2"]
    assert json.loads(fit.with_name("comparison.json").read_text())["adequate"] is True
    notebook = blocks()[2].replace("my-batch", str(batch))
    capsys.readouterr()
    exec(notebook, {})
    assert capsys.readouterr().out.startswith("The model ")


@pytest.mark.parametrize("label", few(["marker_slip:p2@5s", "creep:wide"], ["marker_slip:p2@5s"]))
def test_what_a_diagnosis_names_is_added_and_dropped_under_that_name(batch: Path, label: str) -> None:
    others = Project.open(batch).config.model.effects
    run("add", label, "--project", batch)
    assert Project.open(batch).config.model.effects == (*others, label)
    run("drop", label, "--project", batch)
    assert Project.open(batch).config.model.effects == others


def test_a_fit_with_the_effect_is_stale_when_its_file_changes(batch: Path) -> None:
    project, file = Project.open(batch), batch / "effects" / "cable.py"
    with_cable, without = ({"effects": [*labels]} for labels in (("cable",), ()))
    runs = {}
    for name, how in (("with", with_cable), ("without", without)):
        with project.new_run("calibrate", extra=how) as one:
            runs[name] = one.folder
    (batch / "effects" / "fan.py").write_text("", encoding="utf-8")
    assert [stale(project, folder) for folder in runs.values()] == [[], []]
    file.write_text(example() + "\n# changed\n", encoding="utf-8")
    assert stale(project, runs["with"]) == ["effects/cable.py has changed since"]
    assert stale(project, runs["without"]) == []
    file.unlink()
    assert stale(project, runs["with"]) == ["effects/cable.py is gone"]
    assert stale(project, runs["without"]) == []
    for folder in runs.values():
        shutil.rmtree(folder)
    file.write_text(example(), encoding="utf-8")


def test_check_names_the_line_of_a_broken_file_and_a_broken_promise(batch: Path) -> None:
    file, project = batch / "effects" / "cable.py", Project.open(batch).set_effects([])
    for old, new, sentence in (
        ("null=0.0", "nul=0.0", r"effects/cable\.py, line 14: TypeError: .*unexpected keyword argument 'nul'"),
        ('"cable.up", -1.0, 1.0, "N", null=0.0', '"cable.up", -1.0, 1.0, "N"', r"effect 'cable': its first parameter has no null"),
        ('"cable", Order', '"cord", Order', r"effect 'cord': parameter 'cable\.up': wanted a name of the form cord"),
    ):
        file.write_text(example().replace(old, new), encoding="utf-8")
        run("trust", "--project", batch)
        with pytest.raises(ValueError, match=sentence):
            run_check(project, Silent())
    file.write_text(example(), encoding="utf-8")
    named = replace(project, config=project.config.model_copy(update={"diagnose": DiagnoseTable(candidates=("fan",))}))
    with pytest.raises(ValueError, match=r"effect 'fan' is not in the library, wanted one of creep, .* cable"):
        run_check(named, Silent())
