"""The content of a deck while it is read (`Draft`), by labels and names, and the case that it describes."""

from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from fe.case import Block, Case, Equation, Support
from fe.deck.elementtypes import RICHER, divides, one_type
from fe.deck.joints import Rigid, TieDraft, merged, of_sheets, resolved, tied, with_one_node
from fe.deck.keywords import Keyword
from fe.deck.meshdraft import MeshDraft, SheetSection, in_tetrahedra, rows
from fe.deck.sheets import layers
from fe.deck.units import Units
from fe.element import ELEMENTS, Array, Integers
from fe.material import Material
from fe.mesh.convert import without_unused_nodes
from fe.mesh.refine import enriched

Acting = tuple[int, float]  # step in which a load was stated last, its value
MOST_NODES = 10_000  # of a mesh whose elements become 27-node ones


@dataclass
class Draft:
    """Content of a deck so far: sets hold labels, supports (set, component, mm), loads their step and value.

    turning: held rotations. loaded: surfaces under pressure; shares: theirs over the largest. here: the mesh
    being filled, `mesh` or a part. numbered: offset of the labels of each instance. elastic: modulus and
    Poisson's ratio of *ELASTIC. instantaneous: true for laws with instantaneous constants. amplitudes: peak
    of each amplitude, true for an absolute one, and its times and values over the peak. forces: N on each
    node, by set or label and component. faces: MPa, by face; weights: mm/s2, by direction. named, courses: of
    each face, its loads, and first step and table. pressed: by step, the last keyword and the pressures of
    all faces. renewed: last step with OP=NEW, by keyword. remarks: sentences about replacements.
    """

    file: str
    _: KW_ONLY
    units: Units = field(default_factory=Units)
    mesh: MeshDraft = field(default_factory=MeshDraft)
    parts: dict[str, MeshDraft] = field(default_factory=dict)
    here: MeshDraft = field(default_factory=MeshDraft)
    instance: tuple[str, list[list[float]]] | None = None
    numbered: dict[str, int] = field(default_factory=dict)
    materials: dict[str, Material] = field(default_factory=dict)
    supports: list[tuple[str, int, float]] = field(default_factory=list)
    forces: dict[tuple[str, int], Acting] = field(default_factory=dict)
    turning: list[tuple[str, int, float]] = field(default_factory=list)
    ties: list[TieDraft] = field(default_factory=list)
    rigid: list[Rigid] = field(default_factory=list)
    coupled: Rigid | None = None
    equations: list[Equation] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)
    faces: dict[tuple[int, int], Acting] = field(default_factory=dict)
    weights: dict[tuple[float, ...], Acting] = field(default_factory=dict)
    named: dict[tuple[int, int], tuple[str, ...]] = field(default_factory=dict)
    shares: dict[str, float] = field(default_factory=dict)
    pressures: list[float] = field(default_factory=list)
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    densities: dict[str, float] = field(default_factory=dict)
    elastic: dict[str, tuple[float, float]] = field(default_factory=dict)
    instantaneous: dict[str, bool] = field(default_factory=dict)
    amplitudes: dict[str, tuple[float, bool, tuple[float, ...]]] = field(default_factory=dict)
    courses: dict[tuple[int, int], tuple[int, tuple[float, ...]]] = field(default_factory=dict)
    steps: int = 0
    pressed: dict[int, tuple[Keyword, dict[tuple[int, int], Acting]]] = field(default_factory=dict)
    renewed: dict[str, int] = field(default_factory=dict)
    material: str = ""
    remarks: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.here = self.mesh

    def remark(self, sentence: str) -> None:
        """Keep a sentence for the user, once."""
        self.remarks[sentence] = None

    def case(self) -> tuple[Case, Integers]:
        """The case, in the deck's own units, and the numbers (e,) of its elements: labels become rows.
        ValueError for what is used but not defined, or not complete."""
        if not self.mesh.elements:
            skins = ", ".join(sorted({kind for kind, _ in self.mesh.skins.values()}))
            told = f"no solid elements, only {skins} of a plane or a line" if skins else "no elements"
            raise ValueError(f"{self.file}: {told}; wanted *NODE and *ELEMENT")
        if not self.mesh.nodes:
            raise ValueError(f"{self.file}: no nodes; wanted *NODE and *ELEMENT")
        places, bonded = dict(self.mesh.nodes), self._joined()
        solid = [tie for tie in self.ties if not of_sheets(self.mesh, tie)]
        kind, richer = one_type({kind for kind, _ in self.mesh.elements.values()}, self.remark)
        mesh, numbers = self.mesh, np.array(sorted(self.mesh.elements), np.int64)
        if divides({kind for kind, _ in mesh.elements.values()}):
            mesh, parents = in_tetrahedra(mesh, self.file, self.remark)
            tetrahedra = np.array(sorted(mesh.elements), np.int64)
            case, numbers = self._rows(mesh, kind, tetrahedra), parents
        else:
            case = self._rows(mesh, kind, numbers)
        case = tied(without_unused_nodes(case), solid)
        case = layers(case, self.mesh, places, bonded, self._sheet_law, self.remark)
        self._check_equations(case)
        return (self._richer(case) if richer else case), numbers

    def _richer(self, case: Case) -> Case:
        """The case with 27-node elements, as long as they are not too many."""
        kinds = ", ".join(sorted({kind for kind, _ in self.mesh.elements.values()} & set(RICHER)))
        if len(case.nodes) > MOST_NODES:
            self.remark(
                f"Elements {kinds} are read as C3D8H, which is stiffer in bending: the mesh has more than "
                f"{MOST_NODES} nodes, and 27-node elements on it would be too many."
            )
            return case
        self.remark(f"Elements {kinds} are read as 27-node elements on the same mesh.")
        return enriched(case)

    def _check_equations(self, case: Case) -> None:
        """ValueError where an equation names a node that no element has."""
        named = np.array([n for e in case.equations for n, _, _ in e.terms], np.int64)
        absent = named[~np.isin(named, case.labels)]
        if len(absent):
            raise ValueError(
                f"{self.file}: *EQUATION, *MPC or a rigid joint names node {absent[0]}, which belongs to no "
                "solid element; wanted nodes of the body"
            )

    def _joined(self) -> set[int]:
        """Join nodes by ties, equations and rigid joints; the sheets that are tied."""
        labels = np.array(sorted(self.mesh.nodes), np.int64)
        for elements in (self.mesh.elements, self.mesh.sheets):
            rows(self.file, labels, [n for _, row in elements.values() for n in row], "node")
        same = merged(self.mesh, [tie for tie in self.ties if not of_sheets(self.mesh, tie)])
        self._check_loads()
        joints, held = self.rigid, dict[int, dict[int, float]]()
        for where, d, value in (*self.supports, *self.turning):
            for joint in joints:
                if joint.reference in self.mesh.node_sets[where]:
                    held.setdefault(joint.reference, {})[d] = value
        supports, equations, stands = resolved(joints, held)
        for k, (nodes, d, value) in enumerate(supports):
            self.mesh.node_sets[f"joint_{k}"] = nodes
            self.supports.append((f"joint_{k}", d, value))
        with_one_node(self.mesh, same)
        moved = same | stands
        self.forces = {
            (str(moved.get(int(where), int(where))) if where.isdigit() else where, d): value
            for (where, d), value in self.forces.items()
        }
        for label, node in stands.items():
            for members in self.mesh.node_sets.values():
                if members == [label]:
                    members[:] = [node]
        every = (*self.equations, *equations)
        self.equations = [Equation(tuple((same.get(n, n), d, f) for n, d, f in e.terms)) for e in every]
        return set().union(*(of_sheets(self.mesh, tie) for tie in self.ties))

    def _check_loads(self) -> None:
        """ValueError where a pressure acts on a sheet."""
        for name in self.loaded:
            if any(e in self.mesh.sheets for e, _ in self.mesh.surfaces[name]):
                raise ValueError(
                    f"{self.file}: the loaded surface {name!r} is that of a sheet, and a layer carries no "
                    "pressure; wanted the faces of solids under it"
                )

    def _sheet_law(self, section: SheetSection) -> tuple[float, float]:
        """The modulus and Poisson's ratio of a sheet; of rubber those at small strain."""
        if section.material in self.elastic:
            return self.elastic[section.material]
        if section.material not in self.materials:
            raise ValueError(
                f"{section.place}: material {section.material!r} has no *ELASTIC; give it constants"
            )
        law = self.materials[section.material]
        ratio = (3 * law.bulk_ratio - 2) / (2 * (3 * law.bulk_ratio + 1))
        self.remark(f"The sheet of {section.material} is linearly elastic, as it is at small strain.")
        return 2 * law.shear * (1 + ratio), ratio

    def _rows(self, mesh: MeshDraft, kind: str, numbers: Integers) -> Case:
        """The case of a mesh of one type of element."""
        labels = np.array(sorted(mesh.nodes), np.int64)
        nodes_of = np.array([mesh.elements[n][1] for n in numbers.tolist()])
        connectivity = rows(self.file, labels, nodes_of.ravel(), "node").reshape(nodes_of.shape)
        node_sets = {n: rows(self.file, labels, sorted(set(s)), "node") for n, s in mesh.node_sets.items()}
        element_sets = {
            name: rows(self.file, numbers, sorted(set(s) - mesh.sheets.keys() - mesh.skins.keys()), "element")
            for name, s in mesh.element_sets.items()
        }
        surfaces = {}
        for name, faces in mesh.surfaces.items():
            if any(e in mesh.sheets for e, _ in faces):
                continue
            e, f = np.array(list(dict.fromkeys(faces)), np.int64).reshape(-1, 2).T
            absent = np.flatnonzero((f < 0) | (f >= len(ELEMENTS[kind].faces)))
            if len(absent):
                number, side = e[absent[0]], f[absent[0]]
                called = f"S{side + 1}" if side >= 0 else "SPOS or SNEG"
                raise ValueError(
                    f"{self.file}: surface {name!r} has face {called} of element {number}, but "
                    f"{kind} has the faces S1 to S{len(ELEMENTS[kind].faces)}"
                )
            surfaces[name] = np.stack([rows(self.file, numbers, list(e), "element"), f], axis=1)
        pressurised = None
        if self.loaded:
            pressurised = "+".join(self.loaded)
            surfaces[pressurised] = np.concatenate([surfaces[name] for name in self.loaded])
        forces = _forces(self, node_sets, labels)
        return Case(
            nodes=np.array([mesh.nodes[n] for n in labels.tolist()]),
            labels=labels,
            blocks=(Block(kind, connectivity),),
            node_sets=node_sets,
            element_sets=element_sets,
            surfaces=surfaces,
            materials=_materials(self, element_sets, numbers),
            supports=_supports(self, node_sets),
            pressurised=pressurised,
            forces=forces,
            equations=tuple(self.equations),
            shares=self.shares,
        )


def _materials(draft: Draft, sets: dict[str, Integers], numbers: Integers) -> dict[str, Material]:
    covered, out = np.zeros(len(numbers), int), {}
    for name, material in draft.mesh.sections.items():
        if material not in draft.materials:
            raise ValueError(
                f"{draft.file}: material {material!r} has no *HYPERELASTIC or *ELASTIC; give it constants"
            )
        if name not in sets:
            raise ValueError(
                f"{draft.file}: *SOLID SECTION for the element set {name!r}, which is not defined"
            )
        if draft.mesh.skins.keys() & draft.mesh.element_sets[name]:
            raise ValueError(
                f"{draft.file}: *SOLID SECTION for {name!r}, with elements of a plane or line: wanted solids"
            )
        covered[sets[name]] += 1
        out[name] = draft.materials[material]
    if (covered != 1).any():
        number = numbers[np.flatnonzero(covered != 1)[0]]
        raise ValueError(
            f"{draft.file}: element {number} has {covered[covered != 1][0]} *SOLID SECTIONs; wanted one"
        )
    return out


def _supports(draft: Draft, sets: dict[str, Integers]) -> tuple[Support, ...]:
    """One support for each set: its components, and its value where any is moved. Later lines count."""
    out = []
    for name in dict.fromkeys(where for where, _, _ in draft.supports if len(sets[where])):
        values = {d: v for where, d, v in draft.supports if where == name}
        moved = np.zeros((len(sets[name]), 3))
        for d, v in values.items():
            moved[:, d] = v
        out.append(Support(name, tuple(sorted(values)), moved if any(values.values()) else None))
    return tuple(out)


def _forces(draft: Draft, sets: dict[str, Integers], labels: Integers) -> dict[str, Array]:
    """*CLOAD acts on every node of a set; a case spreads one force over it."""
    out: dict[str, Array] = {}
    for (where, d), (_, value) in draft.forces.items():
        name = where
        if where.isdigit():
            name = f"node_{where}"
            sets.setdefault(name, np.flatnonzero(labels == int(where)))
        if name not in sets:
            raise ValueError(f"{draft.file}: *CLOAD on the node set {name!r}, which is not defined")
        out.setdefault(name, np.zeros(3))[d] += value * len(sets[name])
    return out
