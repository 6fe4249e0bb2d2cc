"""`twin virtual`: a project of an experiment that never was, with what it hides sealed beside it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from twin.commands import virtual
from twin.commands.virtual import run_virtual
from twin.project.config import Config
from twin.project.targetfiles import read_targets
from twin.project.toml import parse
from twin.virtual.hidden import Kind


def quick(
    case: Any, course: Any, points: np.ndarray, hidden: tuple[tuple[Kind, float], ...] = (), count: int = 0
) -> Any:
    """In place of solves: every point sinks in proportion to the pressure and its place, and by what is
    hidden."""
    shape = np.array([0.0, 0.0, -5.0]) * points[:, :1] / 100
    x = course.at_output()[:, None, None]
    size = sum(s for _, s in hidden)
    return x * 100 * shape * (1 + size * x * 30), np.broadcast_to(100 * shape, (len(x), *shape.shape))


def rows(case: Any, course: Any, points: np.ndarray, kind: Kind) -> np.ndarray:
    u, _ = quick(case, course, points, ())
    return np.array([u, u + 0.01 * u**2, u * course.at_output()[:, None, None] * 30])


@pytest.fixture
def solved_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(virtual, "displaced", quick)
    monkeypatch.setattr(virtual, "tangents", rows)


@pytest.mark.usefixtures("solved_at_once")
def test_a_project_and_its_sealed_truth(tmp_path: Path, say: Any) -> None:
    folder = tmp_path / "made"
    run_virtual(folder, say, protocol="P3", hide=["creep"], sigmas=30.0, seed=3)
    found = read_targets(folder / "targets")
    assert len(found.points) == 5
    assert found.noise is not None
    assert not found.held_out.any()
    truth = json.loads((tmp_path / "made.truth.json").read_text(encoding="utf-8"))
    assert truth["hidden"][0]["name"] == "creep"
    assert truth["non_centrality"]["creep"] == pytest.approx(30.0, rel=0.05)  # linear but for the noise model
    assert not list(folder.rglob("*truth*"))
    text = "".join(p.read_text(encoding="utf-8") for p in folder.rglob("*.toml"))
    assert "hidden" not in text
    assert f"{truth['hidden'][0]['size']:.4g}" not in text


@pytest.mark.usefixtures("solved_at_once")
def test_a_weighed_finger_has_its_density_and_a_recording_held_out(tmp_path: Path, say: Any) -> None:
    folder = tmp_path / "five"
    run_virtual(folder, say, protocol="P5", hide=[], sigmas=None, noise="ar1", seed=4)
    found = read_targets(folder / "targets")
    assert found.gravity is not None
    assert len(found.gravity) == 3
    assert set(found.block[found.held_out].tolist()) == {2}
    assert found.fixed.sum() == 4
    assert config_of(folder).model.density_kg_m3 == pytest.approx(1070.0)


@pytest.mark.usefixtures("solved_at_once")
def test_what_the_truth_meets_stands_in_its_project(
    tmp_path: Path, say: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    met: list[Any] = []
    monkeypatch.setattr(virtual, "displaced", lambda case, *a, **k: met.append(case.contact) or quick(case, *a, **k))
    thing = "cylinder:d=20,x=50,z=-14"
    run_virtual(tmp_path / "held", say, protocol="P2", hide=[], sigmas=None, object=thing)
    assert [contact.obstacle.radius for contact in met] == [10.0]
    assert config_of(tmp_path / "held").model.object == thing


def config_of(folder: Path) -> Config:
    return parse((folder / "twin.toml").read_bytes(), name="twin.toml")


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"protocol": "P9"}, "--protocol P9: wanted one of P1"),
        ({"hide": ["rust"]}, "--hide rust: wanted one of"),
        ({"hide": ["creep=much"]}, "--hide creep=much: wanted NAME=SIZE"),
        ({"element": "C3D4"}, "--element C3D4: wanted one of"),
        ({"object": "sphere:d=4", "hide": ["creep"]}, "--object sphere:d=4 and --hide creep: the truth beside an"),
        ({"object": "cube:d=4", "hide": []}, "object 'cube:d=4': wanted a cylinder, sphere or plane"),
        ({"noise": "pink"}, "--noise pink: wanted one of white"),
    ],
)
def test_what_does_not_exist_is_said(
    changes: dict[str, Any], wanted: str, tmp_path: Path, say: Any
) -> None:
    given: dict[str, Any] = {"protocol": "P1", "hide": [], "sigmas": None} | changes
    with pytest.raises(ValueError, match=wanted):
        run_virtual(tmp_path / "x", say, **given)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("solved_at_once")
def test_nothing_is_overwritten(tmp_path: Path, say: Any) -> None:
    (tmp_path / "y").mkdir()
    with pytest.raises(ValueError, match="never overwritten"):
        run_virtual(tmp_path / "y", say, protocol="P1", hide=[], sigmas=None)
