"""A project whose model is the user's own Abaqus deck, from `twin init --deck` to the deformed output."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fe import Material, solve
from fe import Path as Course
from fe.deck.reader import read_deck
from fe.element import triangles
from fe.kernel.assembly import Geometry
from fe.mesh.refine import enriched
from tests.messages import run, saying
from twin import virtual
from twin.bench.workbench import structure_of
from twin.drawing.deformed import deformed_picture, write_vtu_series
from twin.model import structure
from twin.model.structure import of_deck, skin
from twin.project.folder import Project
from twin.project.targetfiles import read_targets, write_targets

Tube = Callable[..., Path]
FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 60.0), (8.0, 60.0), (8.4, 0.0), (12.0, 0.0))  # kPa
NODES = {"tip": 70001, "middle": 70002}
SILICONE = Material(0.20, 0.06, bulk_ratio=833)


@pytest.fixture(scope="module")
def batch(tube_deck: Tube, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project after init, calibrate, compare and review. The truth has richer elements than the deck."""
    root = tmp_path_factory.mktemp("deck")
    deck = tube_deck(root, "C3D20RH", cells=5)
    case = read_deck(deck).case
    truth = replace(enriched(case), materials=dict.fromkeys(case.materials, SILICONE))
    bench = virtual.Bench(film_hz=2.0, gauge_sd_MPa=1e-4, sd=0.002)
    course = virtual.path(bench, protocol=FILM)
    points = np.array([case.position(n) for n in NODES.values()])
    response = solve(truth, course)
    write_targets(root / "targets", virtual.noisy_targets(
        response.at(points), response.per_pressure(points), course, points=virtual.at_nodes(NODES, NODES.values(), points),
        bench=bench, seed=1,
    ))  # fmt: skip
    named = [a for name, label in NODES.items() for a in ("--node", f"{name}={label}")]
    run("init", root / "batch", "--targets", root / "targets", "--deck", deck, *named)
    toml = root / "batch" / "twin.toml"
    toml.write_text(toml.read_text().replace("population = 30", "population = 8").replace("generations = 20", "generations = 2"))
    for stage in ("check", "calibrate", "compare", "review"):
        run(stage, "--project", root / "batch")
    return root / "batch"


def read(batch: Path, kind: str, name: str) -> dict[str, object]:
    found = Project.open(batch).newest(kind, name)
    assert found is not None
    return dict(json.loads(found.read_text()))


def test_init_copies_the_deck_with_what_it_includes(batch: Path) -> None:
    assert {p.name for p in (batch / "raw").iterdir()} == {"tube.inp", "mesh.inc"}
    config = Project.open(batch).config
    assert config.model.deck == "raw/tube.inp"
    assert {p.name: p.node for p in config.points} == NODES


def test_init_judges_the_deck(tube_deck: Tube, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, label = next(iter(NODES.items()))
    run("init", tmp_path / "judged", "--deck", tube_deck(tmp_path, "C3D20RH", cells=5), "--node", f"{name}={label}")
    told = capsys.readouterr().out
    assert "with fitted C10 and C01" in told  # what the model makes of its material
    assert told.index("Wrote") < told.index("with fitted C10") < told.index("Next:")


def test_calibration_finds_the_silicone_of_another_mesh(batch: Path) -> None:
    fit = read(batch, "calibrate", "fit.json")
    values = {k: v["value"] for k, v in fit["parameters"].items()}  # type: ignore[attr-defined]
    # the truth's elements are other than the deck's: the constants take that up
    assert values["C10"] + values["C01"] == pytest.approx(0.26, rel=0.2)
    compared = read(batch, "compare", "comparison.json")
    moved = np.nanmax(np.abs(read_targets(batch / "targets").value))
    assert compared["raw_rms_mm"] < 0.1 * moved  # type: ignore[operator]


def test_a_deck_too_coarse_to_be_corrected_says_so(batch: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # five cells along a bending tube: with ten it is a half softer
    assert not read(batch, "compare", "comparison.json")["adequate"]
    run("diagnose", "--project", batch)
    told = capsys.readouterr()
    assert "The error of the mesh is not known: finer meshes differ in stiffness by" in told.out + told.err
    assert str(read(batch, "diagnose", "diagnosis.json")["verdict"]).startswith("cannot test: mesh: finer meshes differ")


def test_what_the_deck_was_made_from_is_kept(batch: Path) -> None:
    made_from = read(batch, "calibrate", "run.json")["inputs"]
    assert {"raw/tube.inp", "raw/mesh.inc"} <= set(made_from)  # type: ignore[call-overload]


def test_the_deformed_deck_is_written_in_its_own_elements(batch: Path) -> None:
    import pyvista as pv

    found = Project.open(batch).newest("review", "deformed.pvd")
    assert found is not None
    mesh = pv.read(sorted(found.parent.glob("deformed-*.vtu"))[-1])
    case = read_deck(batch / "raw" / "tube.inp").case
    assert set(mesh.celltypes) == {25}  # quadratic hexahedra
    np.testing.assert_allclose(mesh.points, case.nodes, atol=1e-5)
    assert np.abs(np.asarray(mesh["U"])).max() > 0.5  # mm


@pytest.mark.parametrize(("kind", "cell"), [("C3D10H", 24), ("C3D20RH", 25), ("C3D8H", 12)])
def test_a_deformed_deck_opens_in_paraview(tube_deck: Tube, tmp_path: Path, kind: str, cell: int) -> None:
    import pyvista as pv

    case, output = of_deck(tube_deck(tmp_path, kind, cells=4)).case, np.array([0.5, 1.0])
    u = solve(case, Course(np.array([0.0, 1.0]), np.array([0.0, 0.02]), output)).fields([0, 1])
    cells = case.connectivity
    pvd = write_vtu_series(tmp_path, "deformed", nodes=case.nodes, cells=cells, times=output, fields={"U": u})
    reader = pv.get_reader(pvd)
    reader.set_active_time_value(1.0)
    mesh = reader.read()[0]
    assert set(mesh.celltypes) == {cell}
    assert np.abs(u[1]).max() > 0.5  # mm
    moved = mesh.warp_by_vector("U")
    np.testing.assert_allclose(moved.points, case.nodes + u[1], atol=1e-5)
    parts = moved.triangulate().compute_cell_sizes()["Volume"]
    assert parts.min() > 0  # no cell is inside out
    solid = Geometry(case.nodes + u[1], case.connectivity, case.element).weight
    # VTK cuts curved cells by planes; wrong orders of nodes miss by far more
    assert parts.sum() == pytest.approx(solid.sum(), rel=0.02)


@pytest.mark.parametrize("kind", ["C3D10H", "C3D20RH", "C3D8H"])
def test_the_picture_of_a_deck_is_drawn(
    tube_deck: Tube, tmp_path: Path, kind: str, require: Callable[[str], None]
) -> None:
    require("egl")
    import pyvista as pv

    found = of_deck(tube_deck(tmp_path, kind, cells=4))
    path, nodes = tmp_path / "deformed.png", found.case.nodes
    u = np.zeros_like(nodes)
    u[:, 2] = -0.02 * nodes[:, 0] ** 2
    note = deformed_picture(path, nodes=nodes, triangles=triangles(found.outside), u=u, size=(300, 200))
    assert note is None
    pixels = np.asarray(pv.read(path).point_data.active_scalars)[:, :3].astype(float)
    assert ((pixels.max(axis=1) - pixels.min(axis=1)) > 60).sum() > 500  # coloured by displacement


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("C3D20RH", ["27-node elements", "halved elements", "check"]),
        ("C3D10H", ["halved elements", "check"]),
        ("C3D8H", ["27-node elements", "halved elements", "check"]),
    ],
)
def test_meshes_of_the_discretisation_error(tube_deck: Tube, tmp_path: Path, kind: str, names: list[str]) -> None:
    found = of_deck(tube_deck(tmp_path, kind, cells=4))
    assert list(found.finer) == names
    sizes = [len(m.build().nodes) for m in (found.base, *found.finer.values())]
    assert sizes == sorted(sizes)
    assert found.finer["check"] == found.finer["halved elements"]
    assert found.scales
    assert found.case.clamp
    assert found.case.clamp.nodes == "root"
    # the skin without the chamber and the symmetry plane
    x = found.case.nodes[found.outside]
    assert x[..., 1].max(axis=1).min() > 0
    assert ((x[..., 0] < 1e-9).all(axis=1) | (x[..., 0].max(axis=1) > 0)).all()


def test_a_mesh_too_large_to_refine_is_said_to_be_untested(
    tube_deck: Tube, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deck = tube_deck(tmp_path, "C3D10H", cells=4)
    monkeypatch.setattr(structure, "LARGEST", 1000)
    found = of_deck(deck)
    assert not found.finer
    assert "the error of the deck's mesh is not known" in found.unknown
    assert any("diagnose cannot test" in r for r in found.remarks)


def two_materials(deck: Path) -> Path:
    mesh, text = deck.parent / "mesh.inc", deck.read_text()
    mesh.write_text(mesh.read_text() + "*Elset, elset=Paper, generate\n501, 503, 1\n*Elset, elset=Rest, generate\n504, 999, 1\n")
    count = mesh.read_text().partition('elset="All of it", generate\n501, ')[2].partition(",")[0]
    mesh.write_text(mesh.read_text().replace("504, 999, 1", f"504, {count}, 1"))
    section = '*Solid section, elset="All of it", material=Ecoflex\n,\n'
    both = "*Solid section, elset=Rest, material=Ecoflex\n,\n*Solid section, elset=Paper, material=Stiff\n,\n"
    stiff = "*Material, name=Stiff\n*Hyperelastic, neo hooke\n5., 0.0004\n*Boundary"
    deck.write_text(text.replace(section, both).replace("*Boundary", stiff))
    return deck


def test_of_two_materials_one_is_the_silicone(tube_deck: Tube, tmp_path: Path) -> None:
    deck = two_materials(tube_deck(tmp_path, "C3D8H", cells=4))
    with pytest.raises(ValueError, match=r"several materials \(rest, paper\); wanted the element sets whose silicone"):
        of_deck(deck)
    with pytest.raises(ValueError, match=saying("model.silicone = 'glue'", "tube.inp", r"\*SOLID", "SECTION")):
        of_deck(deck, silicone=("glue",))
    found = of_deck(deck, silicone=("Rest",))
    changed = found.case.with_material(C10=0.3, C01=0.1).materials
    assert (changed["rest"].C10, changed["paper"].C10) == (0.3, 5.0)
    assert not found.scales  # U is no function of pressure / C alone


def test_what_is_wrong_with_the_deck_of_a_project_is_one_sentence(
    batch: Path, tube_deck: Tube, tmp_path: Path
) -> None:
    project = Project.open(batch)
    model = project.config.model
    lost = Project(batch, project.config.model_copy(update={"model": model.model_copy(update={"deck": "raw/no.inp"})}))
    with pytest.raises(ValueError, match=r"model.deck = 'raw/no.inp': no such file in"):
        structure_of(lost)
    odd = Project(batch, project.config.model_copy(update={"model": model.model_copy(update={"mesh": 3})}))
    with pytest.raises(ValueError, match=saying("model.mesh = 3", "1", "2", "4")):
        structure_of(odd)
    deck = tube_deck(tmp_path, "C3D8H", cells=4)
    with pytest.raises(ValueError, match="--deck without --node"):
        run("init", tmp_path / "new", "--deck", deck)
    with pytest.raises(ValueError, match="node 4401: not in the model"):
        run("init", tmp_path / "new", "--deck", deck, "--node", "tip=4401")
    case = read_deck(deck).case
    within = next(int(n) for n in case.labels if n not in case.labels[np.unique(skin(case))])
    with pytest.raises(ValueError, match=rf"points.tip.node = {within}: it lies at .* inside the finger, in its chamber or"):
        run("init", tmp_path / "new", "--deck", deck, "--node", f"tip={within}")
    with pytest.raises(ValueError, match=r"points.tip.position_mm = \[900, 0, 0\]: not on the finger; the nearest place on"):
        run("init", tmp_path / "new", "--deck", deck, "--node", "tip=900,0,0")
    assert not (tmp_path / "new").exists()
    deck.write_text(deck.read_text().replace("*Dsload\nTube-1.Chamber, P, 0.08\n", ""))
    with pytest.raises(ValueError, match=saying("tube.inp", r"\*DSLOAD")):
        of_deck(deck)
