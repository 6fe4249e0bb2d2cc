"""Decks as published actuators have them, and meshes with named groups: from `twin init --deck` to a fit."""

import os
from collections.abc import Callable
from dataclasses import replace
from itertools import permutations
from pathlib import Path

from benchmarks.kernel.actuatordecks import MIDDLE, TIP, write
from benchmarks.kernel.smalldecks import Z, lattice

import meshio
import numpy as np
import pytest

from fe import Material, solve
from fe.deck.reader import read_deck
from fe.mesh.refine import enriched
from tests.messages import run, saying, says
from twin import virtual
from twin.bench.workbench import structure_of
from twin.commands.init import run_init
from twin.files import read_json
from twin.formats.meshgroups import deck_of
from twin.messages import Silent
from twin.model.discretisation import stiffness_doubt
from twin.model.structure import of_deck
from twin.project.folder import Project
from twin.project.targetfiles import write_targets

NAMED = [a for n, x in (("tip", TIP), ("middle", MIDDLE)) for a in ("--node", f"{n}={','.join(map(str, x))}")]


@pytest.fixture(scope="module")
def deck(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write(tmp_path_factory.mktemp("published"))


def test_a_paper_layer_and_parts_are_read_shown_and_told(
    deck: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("init", tmp_path / "batch", "--deck", deck["bellows"], *NAMED)
    told = " ".join(capsys.readouterr().out.split())
    says(told, "set-1", "(27 elements)", "54")
    assert "read at its largest value, 1" in told
    structure = structure_of(Project.open(tmp_path / "batch"))
    assert not structure.scales  # the paper's stiffness is no rubber's
    (layer,) = structure.case.layers
    assert layer.stiffness == pytest.approx(650.0)  # 0.1 mm x 6500 MPa
    assert structure.case.clamp is not None
    run("look", "--project", tmp_path / "batch")
    png = next((tmp_path / "batch" / "runs").glob("*-look/read.png")).read_bytes()
    assert png.startswith(b"\x89PNG")


def test_two_tied_parts_in_other_units(deck: dict[str, Path]) -> None:
    structure = of_deck(deck["twolayers"], silicone=("upper-1.body",))
    (tie,) = structure.case.ties
    assert tie.reach == pytest.approx(0.1)
    assert structure.case.nodes.max() == pytest.approx(45.0)
    assert structure.case.materials["slab-1.body"].shear == pytest.approx(1.2)
    assert structure.case.clamp is not None  # both meshes are alike there: no node follows one of the clamp's
    assert "27-node elements" in structure.finer


@pytest.mark.slow
def test_a_published_deck_is_calibrated(deck: dict[str, Path], tmp_path: Path) -> None:
    case = read_deck(deck["bellows"]).case
    truth = replace(case, materials=dict.fromkeys(case.materials, Material(0.15, bulk_ratio=1000)))
    bench = virtual.Bench(film_hz=2.0, gauge_sd_MPa=1e-4, sd=0.002)
    course = virtual.path(bench, protocol=((0.0, 0.0), (2.0, 0.0), (4.0, 12.0), (8.0, 12.0)))
    points = np.array([TIP, MIDDLE])
    labels = [int(case.labels[np.linalg.norm(case.nodes - x, axis=1).argmin()]) for x in points]
    response = solve(truth, course)
    write_targets(tmp_path / "targets", virtual.noisy_targets(
        response.at(points), response.per_pressure(points), course, points=virtual.at_nodes(("tip", "middle"), labels, points),
        bench=bench, seed=1,
    ))  # fmt: skip
    run("init", tmp_path / "batch", "--targets", tmp_path / "targets", "--deck", deck["bellows"], *NAMED)
    toml = tmp_path / "batch" / "twin.toml"
    toml.write_text(toml.read_text().replace("population = 30", "population = 8").replace("generations = 20", "generations = 2"))
    run("calibrate", "--project", tmp_path / "batch")
    fit = read_json(next((tmp_path / "batch" / "runs").glob("*-calibrate/fit.json")))
    assert set(fit["parameters"]) == {"C10", "C20", "C30"}  # Yeoh's, as in the deck
    # two points under one ramp: the interval of C10 is 8 % wide on either side
    assert fit["parameters"]["C10"]["value"] == pytest.approx(0.15, rel=0.1)


# -- meshes with groups ------------------------------------------------------------------------------------


def mesh_file(path: Path, kind: str = "msh") -> Path:
    """A hollow block of hexahedra with groups Rubber, Chamber and End."""
    mesh = lattice("C3D8", lines=((0.0, 3.0, 9.0, 15.0, 18.0), (-4.0, -2.0, 2.0, 4.0), Z), void={(1, 1, 1), (2, 1, 1)})
    row = {p: k for k, p in enumerate(mesh.points)}
    places = np.array([mesh.place(p) for p in mesh.points], float)
    cells = np.array([[row[p] for p in points] for _, points, _ in mesh.elements])
    sides = [[int(c) - 1 for c in digits] for digits in ("1234", "5876", "1562", "2673", "3784", "4851")]
    every: dict[frozenset[int], list[list[int]]] = {}
    for cell in cells.tolist():
        for side in sides:
            face = [cell[k] for k in side]
            every.setdefault(frozenset(face), []).append(face)
    skin = [own[0] for own in every.values() if len(own) == 1]
    inside = [f for f in skin if all(3 <= x <= 15 and -2 <= y <= 2 and 2 <= z <= 4 for x, y, z in places[f])]
    end = [f for f in skin if not places[f][:, 0].any()]
    tags = [np.ones(len(cells), int), np.repeat([2, 3], [len(inside), len(end)])]
    blocks = [("hexahedron", cells), ("quad", np.array(inside + end))]
    if kind == "msh":
        names = {"Rubber": np.array([1, 3]), "Chamber": np.array([2, 2]), "End": np.array([3, 2])}
        data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        made = meshio.Mesh(places, blocks, cell_data=data, field_data=names)
        meshio.write(path, made, file_format="gmsh22", binary=False)
    else:
        meshio.write(path, meshio.Mesh(places, blocks, cell_data={"group": tags}))
    return path


@pytest.mark.parametrize(("name", "sets"), [("a.msh", ("", "End")), ("a.vtu", ("2", "3"))])
def test_a_mesh_with_groups_becomes_a_deck(tmp_path: Path, name: str, sets: tuple[str, str]) -> None:
    file = mesh_file(tmp_path / name, Path(name).suffix[1:])
    text = deck_of(file, pressure_set=sets[0], clamp_set=sets[1], constants=(0.2, 0.1))
    (tmp_path / "a.inp").write_text(text)
    case = of_deck(tmp_path / "a.inp").case
    assert case.element.name == "C3D8H"
    assert case.clamp is not None
    assert not case.nodes[case.clamped][:, 0].any()
    assert len(case.surfaces[str(case.pressurised)]) == 2 * 4 + 2  # the sides of two cells, but for their joint


def test_second_order_of_gmsh_is_read_and_what_cannot_be_is_named(tmp_path: Path) -> None:
    file = mesh_file(tmp_path / "a.msh")
    linear = meshio.read(file)
    hexes, quads = (np.asarray(linear.cells_dict[kind]) for kind in ("hexahedron", "quad"))
    edges = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
    sides = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7), range(8))
    number, places = dict[frozenset[int], int](), list(linear.points)

    def middle(corners: list[int]) -> int:
        if frozenset(corners) not in number:
            number[frozenset(corners)] = len(places)
            places.append(linear.points[corners].mean(axis=0))
        return number[frozenset(corners)]

    rich = [[*h, *(middle([h[k] for k in own]) for own in (*edges, *sides))] for h in hexes.tolist()]
    skin = [[*q, *(middle([q[k], q[k - 3]]) for k in range(4)), middle(q)] for q in quads.tolist()]
    blocks = [("hexahedron27", np.array(rich)), ("quad9", np.array(skin))]
    made = meshio.Mesh(np.array(places), blocks, cell_data=linear.cell_data, field_data=linear.field_data)
    meshio.write(tmp_path / "rich.msh", made, file_format="gmsh22", binary=False)
    (tmp_path / "rich.inp").write_text(deck_of(tmp_path / "rich.msh", clamp_set="End", constants=(0.2, 0.1)))
    case = of_deck(tmp_path / "rich.inp").case
    assert case.element.name == "C3D20RH"
    assert len(case.nodes) == len(linear.points) + len({e for h in hexes for a, b in edges for e in [frozenset((h[a], h[b]))]})
    assert len(case.surfaces[str(case.pressurised)]) == 2 * 4 + 2
    wedge = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n15\n" + "".join(f"{n} {n % 3} {n % 5} {n}\n" for n in range(1, 16))
    wedge += "$EndNodes\n$Elements\n1\n1 18 2 1 1 " + " ".join(map(str, range(1, 16))) + "\n$EndElements\n"
    for text, told in (
        (wedge, saying("w.msh", "wedge15", "wanted one type of tetra")),
        ("$MeshFormat\n4.0 0 8\n$EndMeshFormat\n$Entities\n", saying("format 4.0", r"Mesh.MshFileVersion = 4.1")),
    ):
        (tmp_path / "w.msh").write_text(text)
        with pytest.raises(ValueError, match=told):
            deck_of(tmp_path / "w.msh", constants=(0.2, 0.1))
    os.mkfifo(tmp_path / "pipe.msh")
    with pytest.raises(ValueError, match=saying("pipe.msh", "no pipe")):
        deck_of(tmp_path / "pipe.msh", constants=(0.2, 0.1))


def test_a_group_that_is_not_there_is_named_with_those_that_are(tmp_path: Path) -> None:
    file = mesh_file(tmp_path / "a.msh")
    with pytest.raises(ValueError, match=r"no group of faces is called clamp or .*; it has Chamber, End; state --clamp-set"):
        deck_of(file, constants=(0.2, 0.1))
    with pytest.raises(ValueError, match=saying("'Hole'", "--pressure-set")):
        deck_of(file, pressure_set="Hole", constants=(0.2, 0.1))
    (tmp_path / "b.msh").write_text("nothing of a mesh")
    with pytest.raises(ValueError, match=r"b\.msh: not a mesh that can be read"):
        deck_of(tmp_path / "b.msh", constants=(0.2, 0.1))


def test_linear_tetrahedra_say_how_far_off_they_are(tube_deck: Callable[..., Path], tmp_path: Path) -> None:
    case = of_deck(tube_deck(tmp_path, "C3D4", cells=4)).case
    told = stiffness_doubt(case)
    assert "move" in told
    assert 30 < float(told.partition("move ")[2].split()[0]) < 100  # locked: most of the motion is missing
    assert stiffness_doubt(enriched(case)) == ""




def hollow(path: Path, count: int = 4) -> Path:
    """A cube of linear tetrahedra with a hollow cube in its middle, without a group."""
    cut = (1, count - 1)
    places = np.stack(np.meshgrid(*[np.arange(count + 1.0)] * 3, indexing="ij"), -1).reshape(-1, 3) * 5
    number = np.arange((count + 1) ** 3).reshape((count + 1,) * 3)
    cells = [
        [number[i + a, j + b, k + c] for a, b, c in way]
        for i, j, k in np.ndindex(count, count, count)
        if not all(cut[0] <= x < cut[1] for x in (i, j, k))
        for way in PATHS
    ]
    used, rows = np.unique(np.array(cells), return_inverse=True)
    rows = rows.reshape(-1, 4)
    volume = np.linalg.det(places[used][rows[:, 1:]] - places[used][rows[:, :1]])
    rows[volume < 0] = rows[volume < 0][:, [0, 2, 1, 3]]
    meshio.write(path, meshio.Mesh(places[used] - [20.0, 0.0, 0.0], [("tetra", rows)]))
    return path


# a cube as six tetrahedra along its diagonal: one for each order of the axes
PATHS = [
    np.concatenate([[[0, 0, 0]], np.cumsum(np.eye(3, dtype=int)[list(order)], axis=0)]) for order in permutations(range(3))
]


def test_a_mesh_without_groups_has_those_of_its_skin(tmp_path: Path) -> None:
    file = hollow(tmp_path / "a.vtk")
    with pytest.raises(ValueError, match=r"it has chamber, xmin, xmax, ymin, ymax, zmin, zmax; state --clamp-set"):
        deck_of(file, constants=(0.2, 0.1))
    (tmp_path / "a.inp").write_text(deck_of(file, clamp_set="xmin", axes="-x,-y,z", constants=(0.2, 0.1)))
    case = of_deck(tmp_path / "a.inp").case
    assert case.element.name == "C3D10H"
    assert not case.nodes[case.clamped][:, 0].any()  # the end that was at x = 0 of the turned mesh
    assert case.nodes[:, 0].max() == 20
    chamber = case.nodes[np.unique(case.face_nodes(str(case.pressurised)))]
    np.testing.assert_allclose(chamber.min(axis=0), [5.0, -15.0, 5.0])
    np.testing.assert_allclose(chamber.max(axis=0), [15.0, -5.0, 15.0])


def test_a_mesh_in_metres_is_scaled(tmp_path: Path) -> None:
    file = hollow(tmp_path / "a.vtk")
    (tmp_path / "a.inp").write_text(deck_of(file, clamp_set="xmax", unit="cm", constants=(0.2, 0.1)))
    assert np.ptp(of_deck(tmp_path / "a.inp").case.nodes[:, 0]) == pytest.approx(200.0)
    with pytest.raises(ValueError, match="--unit ft: wanted a unit of length of mm, cm, m"):
        deck_of(file, clamp_set="xmax", unit="ft", constants=(0.2, 0.1))


def test_options_of_a_mesh_are_refused_with_a_deck(deck: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"--axes -x,z,y: of a mesh of Gmsh or VTK, .*\*\* units: m, N, s"):
        run_init(tmp_path / "batch", Silent(), deck=deck["bellows"], axes="-x,z,y")


def test_a_second_solid_is_no_chamber(tmp_path: Path) -> None:
    mesh = meshio.read(hollow(tmp_path / "a.vtk"))
    cells = mesh.cells_dict["tetra"]
    both = meshio.Mesh(np.concatenate([mesh.points, mesh.points + [0, 40.0, 0]]),
                       [("tetra", np.concatenate([cells, cells + len(mesh.points)]))])  # fmt: skip
    meshio.write(tmp_path / "b.vtk", both)
    text = deck_of(tmp_path / "b.vtk", clamp_set="xmin", pressure_set="chamber2", constants=(0.2, 0.1))
    says(text, "chamber1", "chamber2")
    assert "chamber3" not in text


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        ("-x,y,z", r"--axes -x,y,z: it mirrors the mesh; wanted a rotation, such as -x,-y,z"),
        ("x,x,z", "--axes x,x,z: wanted x, y and z once each, with their signs"),
        ("x,y", "wanted x, y and z once each"),
        ("up,y,z", "wanted x, y and z once each"),
    ],
)  # fmt: skip
def test_axes_that_are_no_rotation_are_refused(tmp_path: Path, axes: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        deck_of(hollow(tmp_path / "a.vtk"), clamp_set="xmin", axes=axes, constants=(0.2, 0.1))
