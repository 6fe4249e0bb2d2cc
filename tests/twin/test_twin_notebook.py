"""The Python door: the example of docs/python.md as it stands there, and what every method returns."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import twin
from fe import Case, Finger, Lattice
from twin import notebook
from twin.chain import STAGES
from twin.commands.init import run_init
from twin.effects.material import Elasticity
from twin.executors.local import Serial, using
from twin.formats.catalogue import read_recorded
from twin.formats.conversion import targets_of
from twin.formats.importtable import ImportTable
from twin.marktables import PointTable
from twin.model.keptmodel import base_model
from twin.model.structure import BuiltIn
from twin.notebook import OpenedProject
from twin.project.config import CalibrateTable, Config, ModelTable
from twin.project.folder import Project
from twin.project.targetfiles import write_targets
from twin.project.toml import dump

PAGE = Path(__file__).resolve().parents[2] / "docs" / "python.md"
PRESSURE = (0.0, 2.0, 4.0)  # kPa
C10 = 0.21


@pytest.fixture(scope="module")
def coarsest(short: Finger) -> BuiltIn:
    return BuiltIn(short, Lattice(per_bellow=1, ring=False, centred=False))


@pytest.fixture(scope="module")
def batch(coarsest_case: Case, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A project of the short finger with three steps, imported from a plain CSV that the model itself made."""
    folder = tmp_path_factory.mktemp("notebook") / "my-batch"
    nodes = {"tip": 4401, "middle": 5848}
    csv = folder.parent / "points.csv"
    csv.write_text(rows(np.zeros((3, 2, 3))), encoding="utf-8")
    targets = made(csv, nodes)
    fixed = {"C01": 0.083}
    model = base_model(targets, coarsest_case, elasticity=Elasticity(fixed=fixed))
    csv.write_text(rows(model.predict(model.theta({"C10": C10}))), encoding="utf-8")
    folder.mkdir()
    config = Config(points=tuple(PointTable(name=n, node=k) for n, k in nodes.items()), model=ModelTable(fixed=fixed),
                    calibrate=CalibrateTable(population=4, generations=1, bounds={"C10": (0.15, 0.3), "C01": (0.0, 0.5)}))  # fmt: skip
    (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
    write_targets(folder / "targets", made(csv, nodes))
    with using(Serial()):  # on a finger so small, starting processes costs more than they save
        yield folder


def rows(u: np.ndarray) -> str:
    lines = [f"{k},{p},{','.join(repr(float(v)) for v in u[k][:, [0, 2]].ravel())}" for k, p in enumerate(PRESSURE)]
    return "time_s,p [kPa],tip_x_mm,tip_z_mm,middle_x_mm,middle_z_mm\n" + "\n".join(lines) + "\n"


def made(csv: Path, nodes: dict[str, int]) -> twin.Targets:
    points = [PointTable(name=name, node=node) for name, node in nodes.items()]
    return targets_of(read_recorded(csv, "csv"), ImportTable(file="x.csv", format="csv", sd_mm=0.05), points)[0]


@pytest.fixture(scope="module")
def opened(batch: Path, coarsest: BuiltIn) -> OpenedProject:
    return twin.open_project(batch, builtin=coarsest)


def test_the_examples_of_the_page_run_as_they_stand(batch: Path, coarsest: BuiltIn, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    examples = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert [len(example.splitlines()) <= 12 for example in examples] == [True] * 5
    # a fit without a folder: test_twin_calibration.py; a program of one's own: examples/my_simulator.py; a table of
    # its runs: test_twin_runtable.py
    del examples[:3]
    monkeypatch.chdir(batch.parent)
    monkeypatch.setattr(twin, "open_project", lambda folder: notebook.open_project(folder, builtin=coarsest), raising=False)
    found: dict[str, object] = {}
    exec("".join(examples), found)
    printed = capsys.readouterr().out
    assert "Next: `twin calibrate`." in printed
    assert found["constants"].loc["C10", "value"] == pytest.approx(C10, rel=0.01)  # type: ignore[attr-defined]  # it stops within a part of its sd
    assert found["constants"].loc["C10", "unit"] == "MPa"  # type: ignore[attr-defined]
    assert found["measured"].shape == (6, 12)  # type: ignore[attr-defined]
    assert found["predicted"].shape == (3, 2, 3)  # type: ignore[attr-defined]
    np.testing.assert_allclose(found["predicted"][..., 2], found["batch"].targets.value[..., 2], atol=0.02)  # type: ignore[index,attr-defined]
    shown, error = found["shown"], found["shown"].error  # type: ignore[attr-defined]
    whole = found["batch"].model().predict(np.array([0.2]))  # type: ignore[attr-defined]
    assert np.abs(shown.u - whole).max() < 3 * error.max() < 0.01  # type: ignore[attr-defined]  # mm
    with pytest.raises(ValueError, match="the range of this response"):
        found["response"].at({"C10": 0.4})  # type: ignore[attr-defined]


def test_results_are_tables(opened: OpenedProject) -> None:
    opened.calibrate()
    misfit = opened.compare()
    table = misfit.to_pandas()
    assert isinstance(table, pd.DataFrame)
    assert set(table["by"]) == {"marker", "direction", "pressure", "branch"}
    assert set(table[table["by"] == "marker"]["name"]) == {"tip", "middle"}
    assert misfit.folder is not None
    assert (misfit.folder / "comparison.json").is_file()
    assert misfit.summary["where"] in str(misfit)
    runs = opened.list().to_pandas()
    assert list(runs["run"].str.partition("-")[2])[-2:] == ["calibrate", "compare"]
    assert set(runs["status"]) == {"done"}
    assert opened.check().to_pandas().loc[0, "next"] == "diagnose"


def test_a_notebook_runs_twice_and_shows_tables_in_its_cells(opened: OpenedProject) -> None:
    opened.calibrate()
    first = opened.recalibrate()
    again = opened.recalibrate()
    assert set(again.summary["stages"].values()) == {"fresh", "none"}
    assert again.to_pandas().equals(first.to_pandas())
    assert opened.found("calibrate").to_pandas().equals(first.to_pandas())
    runs = len(opened.project.runs())
    assert opened.found("compare").to_pandas()["by"].nunique() == 4
    assert len(opened.project.runs()) == runs  # nothing was run
    with pytest.raises(ValueError, match=r"no run of explain belongs to this project as it is; run batch\.explain\(\)"):
        opened.found("explain")
    shown = first._repr_html_()
    assert "<td>C10</td>" in shown
    assert "<p>Verdict: " in shown
    assert len(repr(first)) < 300  # a cell without HTML is no page of numbers
    assert "finger.png" in set(opened.look().to_pandas()["file"])


def test_a_stage_that_cannot_work_raises_its_sentence(opened: OpenedProject, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no_such_effect"):
        opened.add("no_such_effect")
    with pytest.raises(ValueError, match=r"twin\.toml does not exist"):
        twin.open_project(tmp_path)


def test_targets_as_a_table_hold_what_the_file_holds(opened: OpenedProject) -> None:
    targets = opened.targets
    table, file = targets.to_pandas(), pd.read_csv(opened.root / "targets" / "targets.csv")
    for name in ("time_s", "pressure_MPa", "u1_mm", "u2_mm", "u3_mm", "sd3_mm"):
        np.testing.assert_allclose(table[name].to_numpy(float), file[name].to_numpy(float), rtol=1e-5)
    assert table["point"].tolist() == file["point"].tolist()
    assert table["valid"].astype(int).tolist() == file["valid"].tolist()
    assert replace(targets, valid=~targets.valid & np.isfinite(targets.value)).to_pandas()["valid"].iloc[0]


def test_every_stage_is_a_method() -> None:
    assert [stage.name for stage in STAGES if not hasattr(OpenedProject, stage.name)] == []
    text = PAGE.read_text(encoding="utf-8")
    assert [stage.name for stage in STAGES if f"`{stage.name}(" not in text] == []


def test_a_project_is_locked_while_a_stage_works(opened: OpenedProject) -> None:
    with Project.open(opened.root).lock("measure"), pytest.raises(ValueError, match="measure"):
        opened.compare()


def test_measure_of_another_programs_file_has_no_budget(tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    u = np.zeros((3, 2, 3))
    u[1:, :, 2] = [[-6.0, -2.0], [-12.0, -4.0]]
    file.write_text(rows(u), encoding="utf-8")
    run_init(tmp_path / "own", lambda text: None, targets=file, nodes=(), sd_mm=0.05)
    found = twin.open_project(tmp_path / "own").measure()
    assert found.rows == ()
    assert found.folder is not None
    assert (tmp_path / "own" / "targets" / "targets.csv").is_file()
