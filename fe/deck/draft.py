"""What a deck said so far, by labels and names, and the case by rows that comes of it."""

from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from fe.case import Block, Case, Support
from fe.deck.kinds import one_type
from fe.deck.units import Units
from fe.element import ELEMENTS, Array, Integers
from fe.laws import Material
from fe.mesh.convert import without_unused_nodes

Faces = list[tuple[int, int]]


@dataclass
class MeshDraft:
    """Nodes, elements (type, nodes), sets and sections of a deck or of one of its parts, by labels and names
    in small letters; inherited: the names that came with an instance, and with which."""

    nodes: dict[int, Array] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, Faces] = field(default_factory=dict)
    sections: dict[str, str] = field(default_factory=dict)
    inherited: dict[tuple[str, str], str] = field(default_factory=dict)


@dataclass
class Draft:
    """What was read so far: sets hold labels, supports (set, component, mm), forces N on each node.

    here: what mesh keywords fill, `mesh` or a part; numbered: what was added to the labels of an instance;
    elastic: modulus and Poisson's ratio of *ELASTIC; instantaneous: whether a law's constants are;
    amplitudes: the largest value of each, and whether it is absolute; remarks: sentences on what was read as
    something else.
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
    forces: dict[tuple[str, int], float] = field(default_factory=dict)
    loads: dict[str, float] = field(default_factory=dict)
    pressures: list[float] = field(default_factory=list)
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    densities: dict[str, float] = field(default_factory=dict)
    elastic: dict[str, tuple[float, float]] = field(default_factory=dict)
    instantaneous: dict[str, bool] = field(default_factory=dict)
    amplitudes: dict[str, tuple[float, bool]] = field(default_factory=dict)
    material: str = ""
    remarks: dict[str, None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.here = self.mesh

    def remark(self, sentence: str) -> None:
        """Keep a sentence for the user, once."""
        self.remarks[sentence] = None

    def case(self) -> Case:
        """The case: labels become rows. ValueError for what is used but not defined, or not complete."""
        mesh = self.mesh
        if not mesh.elements:
            raise ValueError(f"{self.file}: no elements; wanted *NODE and *ELEMENT")
        if not mesh.nodes:
            raise ValueError(f"{self.file}: no nodes; wanted *NODE and *ELEMENT")
        labels = np.array(sorted(mesh.nodes), np.int64)
        numbers = np.array(sorted(mesh.elements), np.int64)

        def rows(known: Integers, wanted: list[int] | Integers, what: str) -> Integers:
            found = np.asarray(wanted, np.int64)
            at = np.minimum(np.searchsorted(known, found), len(known) - 1)
            missing = found[known[at] != found]
            if len(missing):
                raise ValueError(
                    f"{self.file}: {what} {missing[0]} is used but not defined; define it or leave it out"
                )
            return at

        kind = one_type({kind for kind, _ in mesh.elements.values()}, self.file, self.remark)
        nodes_of = np.array([mesh.elements[n][1] for n in numbers])
        connectivity = rows(labels, nodes_of.ravel(), "node").reshape(nodes_of.shape)
        node_sets = {name: rows(labels, sorted(set(s)), "node") for name, s in mesh.node_sets.items()}
        element_sets = {
            name: rows(numbers, sorted(set(s)), "element") for name, s in mesh.element_sets.items()
        }
        surfaces = {}
        for name, faces in mesh.surfaces.items():
            e, f = np.array(list(dict.fromkeys(faces)), np.int64).reshape(-1, 2).T
            absent = np.flatnonzero(f >= len(ELEMENTS[kind].faces))
            if len(absent):
                raise ValueError(
                    f"{self.file}: surface {name!r} has face {f[absent[0]] + 1} of element {e[absent[0]]}, "
                    f"but {kind} has the faces 1 to {len(ELEMENTS[kind].faces)}"
                )
            surfaces[name] = np.stack([rows(numbers, list(e), "element"), f], axis=1)
        pressurised = None
        if self.loads:
            pressurised = "+".join(self.loads)
            surfaces[pressurised] = np.concatenate([surfaces[name] for name in self.loads])
            _check_apart(self, surfaces[pressurised], numbers)
        forces = _forces(self, node_sets, labels)
        case = Case(
            nodes=np.array([mesh.nodes[n] for n in labels]),
            labels=labels,
            blocks=(Block(kind, connectivity),),
            node_sets=node_sets,
            element_sets=element_sets,
            surfaces=surfaces,
            materials=_materials(self, element_sets, len(numbers)),
            supports=_supports(self, node_sets),
            pressurised=pressurised,
            forces=forces,
        )
        return without_unused_nodes(case)


def _check_apart(draft: Draft, faces: Integers, numbers: Integers) -> None:
    """ValueError where a face lies in two surfaces that carry the pressure: it would act twice."""
    own, count = np.unique(faces, axis=0, return_counts=True)
    for e, f in own[count > 1][:1].tolist():
        raise ValueError(
            f"{draft.file}: face {f + 1} of element {numbers[e]} lies in two loaded surfaces, "
            f"{' and '.join(draft.loads)}; wanted it in one, as the pressure would act twice"
        )


def _materials(draft: Draft, sets: dict[str, Integers], count: int) -> dict[str, Material]:
    covered, out = np.zeros(count, int), {}
    for name, material in draft.mesh.sections.items():
        if material not in draft.materials:
            raise ValueError(
                f"{draft.file}: material {material!r} has no *HYPERELASTIC or *ELASTIC; give it constants"
            )
        if name not in sets:
            raise ValueError(
                f"{draft.file}: *SOLID SECTION for the element set {name!r}, which is not defined"
            )
        covered[sets[name]] += 1
        out[name] = draft.materials[material]
    if (covered != 1).any():
        number = sorted(draft.mesh.elements)[int(np.flatnonzero(covered != 1)[0])]
        raise ValueError(
            f"{draft.file}: element {number} has {covered[covered != 1][0]} *SOLID SECTIONs; wanted one"
        )
    return out


def _supports(draft: Draft, sets: dict[str, Integers]) -> tuple[Support, ...]:
    """One support for each set: its components, and its value where any is moved. Later lines count."""
    out = []
    for name in dict.fromkeys(where for where, _, _ in draft.supports):
        values = {d: v for where, d, v in draft.supports if where == name}
        moved = np.zeros((len(sets[name]), 3))
        for d, v in values.items():
            moved[:, d] = v
        out.append(Support(name, tuple(sorted(values)), moved if any(values.values()) else None))
    return tuple(out)


def _forces(draft: Draft, sets: dict[str, Integers], labels: Integers) -> dict[str, Array]:
    """*CLOAD acts on every node of a set; a case spreads one force over it."""
    out: dict[str, Array] = {}
    for (where, d), value in draft.forces.items():
        name = where
        if where.isdigit():
            name = f"node_{where}"
            sets.setdefault(name, np.flatnonzero(labels == int(where)))
        if name not in sets:
            raise ValueError(f"{draft.file}: *CLOAD on the node set {name!r}, which is not defined")
        out.setdefault(name, np.zeros(3))[d] += value * len(sets[name])
    return out
