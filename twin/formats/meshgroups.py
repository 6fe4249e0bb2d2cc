"""A mesh of Gmsh or VTK with named groups, as the Abaqus deck that a project has.

A group of cells is a material, one of faces a surface. Without groups of faces the skin gives them: a closed
skin that the material lies around is a chamber, and a flat part on a side of the box around the mesh is that
side. A mesh says neither loads nor laws: the groups that are under pressure and held are named, or found by
their names, and every material is nominal silicone. Tetrahedra of four nodes become those of ten.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fe.deck.units import LENGTHS
from fe.element import ELEMENTS, Array, Integers
from fe.mesh.refine import unshared

MESHES = (".msh", ".vtk", ".vtu")
SOLIDS = {"tetra": "C3D10H", "tetra10": "C3D10H", "hexahedron": "C3D8H", "hexahedron20": "C3D20RH"}
SOLIDS["hexahedron27"] = "C3D20RH"  # Gmsh's own second order: its first 20 nodes are those
AXES = "xyz"
FLAT = 1e-6  # of the mesh's extent
SIDES = ("min", "max")
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))  # of a tetrahedron, as Abaqus lists their middles
FACES = ("triangle", "triangle6", "quad", "quad8", "quad9")  # in the same order as those of Abaqus
PRESSURE = ("chamber", "pressure", "cavity", "inside", "inner")
CLAMP = ("clamp", "root", "fixed", "base")
SYMMETRY = {"xsymm": "XSYMM", "ysymm": "YSYMM", "zsymm": "ZSYMM", "symmetry": "YSYMM"}
DECK = """\
*HEADING
 {name}: groups {groups}
*NODE
{nodes}
{elements}
{sets}
*NSET, NSET={clamp}
{held}
{symmetry}
*SURFACE, NAME={pressure}, TYPE=ELEMENT
{loaded}
{materials}
*BOUNDARY
{clamp}, 1, 3
{planes}
*STEP, NLGEOM=YES
*STATIC
*DSLOAD
{pressure}, P, 0.01
*END STEP
"""


@dataclass(frozen=True)
class Groups:
    """A mesh: nodes (n, 3) mm; elements (e, m) of one type, an Abaqus name; the elements (k,) of each group
    of cells, and the nodes (k, c) of the corners of the faces of each group of faces."""

    nodes: Array
    kind: str
    elements: Integers
    cells: Mapping[str, Integers]
    faces: Mapping[str, Integers]


def deck_of(
    path: Path, *, constants: tuple[float, float], pressure_set: str = "", clamp_set: str = "",
    axes: str = "", unit: str = "",
) -> str:
    """The deck of a mesh: its groups of cells as element sets of silicone with constants C10 and C01 in MPa.

    pressure_set, clamp_set: the groups of faces that are loaded and held, by default those whose names say
    so. axes: which axes of the mesh are x, y and z of the deck, such as "-x,z,y"; unit: of its lengths, by
    default mm. ValueError where a group is not there, or none says so; the message lists the groups; for axes
    that mirror the mesh, and an unknown unit.
    """
    if unit and unit.lower() not in LENGTHS:
        raise ValueError(f"--unit {unit}: wanted a unit of length of {', '.join(LENGTHS)}")
    mesh = _groups(path, _turn(axes) * LENGTHS[unit.lower() or "mm"])
    loaded = _chosen(path, mesh, pressure_set, PRESSURE, "--pressure-set")
    held = _chosen(path, mesh, clamp_set, CLAMP, "--clamp-set")
    planes = {name: SYMMETRY[name.lower()] for name in mesh.faces if name.lower() in SYMMETRY}
    sets = "\n".join(_listed(f"*ELSET, ELSET={name}", rows + 1) for name, rows in mesh.cells.items())
    solid = "*HYPERELASTIC, MOONEY-RIVLIN\n{:g}, {:g}, 0.".format(*constants)
    materials = "\n".join(
        f"*SOLID SECTION, ELSET={n}, MATERIAL={n}\n*MATERIAL, NAME={n}\n{solid}" for n in mesh.cells
    )
    places = enumerate(mesh.nodes.tolist(), start=1)
    rows = "\n".join(", ".join([str(n), *(f"{v:.10g}" for v in x)]) for n, x in places)
    text = DECK.format(
        name=path.name, groups=", ".join([*mesh.cells, *mesh.faces]), nodes=rows, elements=_elements(mesh),
        sets=sets, clamp=held, held=_numbers(np.unique(_on(mesh, held)) + 1), pressure=loaded,
        symmetry="\n".join(_listed(f"*NSET, NSET={n}", np.unique(_on(mesh, n)) + 1) for n in planes),
        loaded=_surface(path, mesh, loaded), materials=materials,
        planes="\n".join(f"{name}, {what}" for name, what in planes.items()),
    )  # fmt: skip
    return "".join(f"{line}\n" for line in text.splitlines() if line.strip())


def _chosen(path: Path, mesh: Groups, group: str, usual: tuple[str, ...], option: str) -> str:
    """The name of a group of faces: as stated, or the one whose name says so."""
    names = {name.lower(): name for name in mesh.faces}
    candidates = (group.lower(), f"group_{group}") if group else usual  # a number would be a node's label
    matches = [names[n] for n in candidates if n in names]
    if not matches:
        listed = ", ".join(mesh.faces) or "none"
        called = f"{group!r}" if group else " or ".join(usual)
        what = f"no group of faces is called {called}"
        raise ValueError(f"{path.name}: {what}; it has {listed}; state {option} with one of them")
    return matches[0]


def _turn(axes: str) -> Array:
    """The rotation (3, 3) that three axes with their signs ask for. ValueError for other words."""
    if not axes:
        return np.eye(3)
    words = [word.strip().lower() for word in axes.split(",")]
    if sorted(word.lstrip("+-") for word in words) != list(AXES) or any(len(word) > 2 for word in words):
        raise ValueError(f"--axes {axes}: wanted x, y and z once each, with their signs, such as -x,z,y")
    turn = np.array([np.eye(3)[AXES.index(word[-1])] * (-1 if word[0] == "-" else 1) for word in words])
    if np.linalg.det(turn) < 0:
        raise ValueError(f"--axes {axes}: it mirrors the mesh; wanted a rotation, such as {words[0]},"
                         f"{_other(words[1])},{words[2]}")  # fmt: skip
    return turn


def _other(word: str) -> str:
    """An axis with the other sign."""
    return word[-1] if word[0] == "-" else f"-{word[-1]}"


def _groups(path: Path, turn: Array) -> Groups:
    """The groups of a mesh file, turned and scaled by a matrix (3, 3). ValueError for what cannot be read, or
    has no solid cells of one type."""
    import meshio

    wanted = f"wanted one type of {', '.join(SOLIDS)}; mesh it with one, and save all elements"
    if not path.is_file():
        raise ValueError(f"{path.name}: wanted a mesh file, no pipe, device or folder")
    read = {".msh": meshio.gmsh.read, ".vtk": meshio.vtk.read, ".vtu": meshio.vtu.read}[path.suffix.lower()]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mesh = read(path)
    except KeyError as error:  # the name of a type without a reader, such as 'wedge15'
        raise ValueError(f"{path.name}: cells {error}, which cannot be read; {wanted}") from None
    except (Exception, SystemExit) as error:
        with path.open("rb") as file:
            head = file.read(64).split()
        if head[:2] == [b"$MeshFormat", b"4.0"] or head[1:2] == [b"4"]:
            raise ValueError(
                f"{path.name}: a mesh of Gmsh's format 4.0 that cannot be read: wanted 4.1 or 2.2; save it "
                "with Mesh.MshFileVersion = 4.1"
            ) from None
        raise ValueError(f"{path.name}: not a mesh that can be read ({str(error)[:200]})") from None
    kinds = {block.type for block in mesh.cells if block.dim == 3}
    if len(kinds) != 1 or not kinds <= SOLIDS.keys():
        raise ValueError(f"{path.name}: solid cells {', '.join(sorted(kinds)) or 'none'}; {wanted}")
    (kind,) = kinds
    elements, solid = _named(mesh, (kind,))
    elements = elements[:, :20]
    corners, faces = _named(mesh, FACES)
    cells = {name: rows for name, rows in solid.items() if len(rows)}
    grouped = np.zeros(len(elements), int)
    for rows in cells.values():
        grouped[rows] += 1
    if (grouped > 1).any():
        raise ValueError(f"{path.name}: a cell is in two groups of cells; wanted one material for each cell")
    if (grouped == 0).any():
        cells["silicone"] = np.flatnonzero(grouped == 0)
    corner_count = len(ELEMENTS[SOLIDS[kind]].corners)
    surfaces = {name: corners[rows][:, :corner_count] for name, rows in faces.items() if len(rows)}
    nodes = np.asarray(mesh.points, float)[:, :3] @ turn.T
    if kind == "tetra":
        nodes, elements = _with_middles(nodes, elements)
    surfaces = surfaces or groups_of_skin(nodes, SOLIDS[kind], elements)
    return Groups(nodes, SOLIDS[kind], elements, cells, surfaces)


def _with_middles(nodes: Array, elements: Integers) -> tuple[Array, Integers]:
    """Tetrahedra (e, 4) with a node in the middle of every edge, (e, 10): linear ones are too stiff for
    rubber."""
    pairs = np.sort(elements[:, EDGES].reshape(-1, 2), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    middles = len(nodes) + np.asarray(number).reshape(len(elements), -1)
    return np.concatenate([nodes, nodes[edges].mean(axis=1)]), np.concatenate([elements, middles], axis=1)


def _named(mesh: object, types: tuple[str, ...]) -> tuple[Integers, dict[str, Integers]]:
    """The cells (e, m) of these types, and the rows (k,) of each of their groups."""
    blocks = [k for k, block in enumerate(mesh.cells) if block.type in types]  # type: ignore[attr-defined]
    if not blocks:
        return np.empty((0, 4), np.int64), {}
    cells = [np.asarray(mesh.cells[k].data, np.int64) for k in blocks]  # type: ignore[attr-defined]
    names = {int(v[0]): n for n, v in mesh.field_data.items()}  # type: ignore[attr-defined]
    data = mesh.cell_data  # type: ignore[attr-defined]
    key = next((k for k in ("gmsh:physical", "group", "material", "CellEntityIds") if k in data), None)
    groups: dict[str, Integers] = {}
    if key is not None:
        tags = np.concatenate([np.asarray(data[key][k]).ravel().astype(int) for k in blocks])
        every = [t for t in np.unique(tags).tolist() if t]
        groups = {names.get(t, f"group_{t}"): np.flatnonzero(tags == t) for t in every}
    return np.concatenate(cells), groups


def _elements(mesh: Groups) -> str:
    lines = [f"*ELEMENT, TYPE={mesh.kind}"]
    for number, row in enumerate((mesh.elements + 1).tolist(), start=1):
        words = [str(number), *map(str, row)]
        cut = 11 if len(words) > 12 else len(words)
        lines += [", ".join(words[:cut]) + "," * (cut < len(words)), ", ".join(words[cut:])]
    return "\n".join(lines)


def _on(mesh: Groups, name: str) -> Integers:
    """The nodes on a group of faces, middle nodes of the solids' faces among them."""
    return mesh.elements[_faces(mesh, name)[:, :1], ELEMENTS[mesh.kind].faces[_faces(mesh, name)[:, 1]]]


def _faces(mesh: Groups, name: str) -> Integers:
    """The faces (f, 2) = (element, face) of solids on a group of faces."""
    element = ELEMENTS[mesh.kind]
    corners = np.sort(mesh.elements[:, element.faces[:, list(element.corners)]], axis=2)
    group_faces = {tuple(row) for row in np.sort(mesh.faces[name], axis=1).tolist()}
    flat = corners.reshape(-1, corners.shape[2]).tolist()
    solid_faces = [k for k, row in enumerate(flat) if tuple(row) in group_faces]
    return np.stack(np.divmod(np.array(solid_faces, np.int64), len(element.faces)), axis=1)


def _surface(path: Path, mesh: Groups, name: str) -> str:
    faces = _faces(mesh, name)
    if not len(faces):
        raise ValueError(f"{path.name}: the faces of {name} belong to no solid cell; wanted its own skin")
    return "\n".join(f"{e + 1}, S{f + 1}" for e, f in faces.tolist())


def _listed(head: str, numbers: Integers) -> str:
    return f"{head}\n{_numbers(numbers)}"


def _numbers(numbers: Integers) -> str:
    return "\n".join(
        ", ".join(map(str, numbers[k : k + 12].tolist())) for k in range(0, len(numbers), 12)
    )


# -- groups of the skin --------------------------------------------------------------------------------------


def groups_of_skin(nodes: Array, kind: str, elements: Integers) -> dict[str, Integers]:
    """Groups (k, c) of faces, each by the nodes of its corners. `chamber`: all closed skins inside; each
    alone is `chamber1`, .. where there are several. `xmin` to `zmax`: the flat ends of the outer skin.

    nodes (n, 3) mm; elements (e, m) of one type, kind, an Abaqus name.
    """
    skin = _skin(kind, elements)
    part = _parts(skin, len(nodes))
    filled = np.bincount(part, weights=_under(nodes - nodes.mean(axis=0), skin))
    filled *= np.sign(filled[np.abs(filled).argmax()])  # the largest is an outer one
    cavities = [skin[part == k] for k in np.flatnonzero(filled < 0)]
    out = {"chamber": np.concatenate(cavities)} if cavities else {}
    if len(cavities) > 1:
        out |= {f"chamber{k}": cavity for k, cavity in enumerate(cavities, start=1)}
    low, high = nodes[skin].min(axis=(0, 1)), nodes[skin].max(axis=(0, 1))
    faces = skin[filled[part] > 0]
    for axis in range(3):
        for side, side_mm in zip(SIDES, (low[axis], high[axis]), strict=True):
            flat = (np.abs(nodes[faces, axis] - side_mm) < FLAT * (high - low).max()).all(axis=1)
            if flat.any():
                out["xyz"[axis] + side] = faces[flat]
    return out


def _skin(kind: str, elements: Integers) -> Integers:
    """The corners (f, c) of the faces that belong to one element alone."""
    element = ELEMENTS[kind]
    owner, number = unshared(element, elements).T
    return np.take_along_axis(elements[owner], element.faces[number][:, list(element.corners)], axis=1)


def _parts(faces: Integers, nodes: int) -> Integers:
    """The number (f,) of the part of the skin that each face belongs to, parts sharing no node."""
    a, b = np.repeat(faces[:, 0], faces.shape[1]), faces.ravel()
    joined = coo_matrix((np.ones(len(a)), (a, b)), shape=(nodes, nodes))
    _, label = connected_components(joined, directed=False)
    return np.asarray(np.unique(label[faces[:, 0]], return_inverse=True)[1], np.int64)


def _under(nodes: Array, faces: Integers) -> Array:
    """The signed volume (f,) mm3 of the cones of faces from the origin: of a closed skin together what it
    encloses, with one sign where the material lies inside, the other where it lies around."""
    apex, middle, last = (nodes[faces[:, k]] for k in (slice(0, 1), slice(1, -1), slice(2, None)))
    return np.asarray(np.einsum("fti,fti->f", apex, np.cross(middle, last)) / 6, float)
