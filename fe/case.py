"""The frozen description of a structure: nodes, element blocks, named sets, materials, supports and loads."""

import hashlib
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace

import numpy as np

from fe.element import ELEMENTS, Array, Element, Flags, Integers
from fe.material import Material
from fe.obstacles import Obstacle


@dataclass(frozen=True)
class Block:
    """Elements of one type (a name of `fe.element.ELEMENTS`): `connectivity` (e, n) holds row numbers of
    `Case.nodes`."""

    type: str
    connectivity: Integers


@dataclass(frozen=True)
class Support:
    """Prescribed displacement of a node set: `components` out of 0, 1, 2; `value` (k, 3) mm, None means
    zero."""

    nodes: str
    components: tuple[int, ...]
    value: Array | None = None


@dataclass(frozen=True)
class Clamp:
    """A node set held rigidly that may turn about the y axis through `centre` (x, z) mm.

    rotation = compliance (rad/(N mm)) times the moment that the structure exerts on it; 0 is the rigid clamp.
    """

    nodes: str
    centre: tuple[float, float]
    compliance: float = 0.0


@dataclass(frozen=True)
class Layer:
    """An elastic sheet bonded to a surface: stiffness (thickness x modulus, N/mm), one or a tuple for parts
    of equal length along x, and Poisson's ratio. wound: fibres around the x axis, stiff along themselves
    alone; angle: in degrees, of two equal families of them, right and left, off the circumference."""

    surface: str
    stiffness: float | tuple[float, ...]
    poisson: float = 0.3
    wound: bool = False
    angle: float = 0.0

    def per_face(self, case: "Case") -> Array:
        """Stiffness (f,) N/mm of each face, by the part that contains the face's middle."""
        x, parts = case.nodes[case.face_nodes(self.surface), 0], np.atleast_1d(self.stiffness)
        share = (x.mean(axis=1) - x.min()) / max(float(np.ptp(x)), 1e-12)
        return parts[np.clip((len(parts) * share).astype(int), 0, len(parts) - 1)]


@dataclass(frozen=True)
class Spring:
    """Elastic support of an obstacle that moves along `way` (3,): force over displacement, N/mm, without
    force at rest. In a half model the stiffness is half of the spring's."""

    stiffness: float
    way: tuple[float, float, float]


@dataclass(frozen=True)
class Tie:
    """A surface (`slave`) whose nodes follow the faces of another (`master`) where they lie within `reach` mm
    of them."""

    slave: str
    master: str
    reach: float


@dataclass(frozen=True)
class Equation:
    """A linear constraint between nodal displacements: the sum of factor x displacement over terms (label,
    component, factor) is zero. The first term depends on the others."""

    terms: tuple[tuple[int, int, float], ...]


@dataclass(frozen=True)
class Contact:
    """A rigid obstacle that a surface cannot pass: stiffness in MPa per mm of depth, on the area at rest;
    friction: Coulomb's coefficient (see `fe.kernel.contact`; below 0 in a neighbour of a derivative at 0
    only). With a `spring` the obstacle gives way, without it is fixed."""

    surface: str
    obstacle: Obstacle
    stiffness: float
    friction: float = 0.0
    spring: Spring | None = None


@dataclass(frozen=True)
class SelfContact:
    """Two surfaces that cannot pass through each other, or one that cannot pass through itself, without
    friction; stiffness in 1/mm: times the smallest shear modulus it is the pressure per mm of depth (see
    `fe.kernel.selfcontact`), so that displacements stay a function of pressure over the moduli."""

    first: str
    second: str
    stiffness: float = 20.0


@dataclass(frozen=True)
class Case:
    """A structure to be solved, in mm, N, MPa.

    nodes (n, 3) mm; labels (n,): Abaqus node numbers; materials: one per element set, which together cover
    every element once; kept: materials that `with_material` leaves unchanged; pressurised: the surface that
    carries the follower pressure, shares: share of the pressure on some of its parts; forces: dead forces
    (3,) N, spread evenly over a node set, growing: forces in N/MPa, times the pressure. precurvature (1/mm):
    curvature of the stress-free structure towards -z, or its course along x (see `assembly.Geometry`). layer:
    a sheet bonded to it, layers: sheets of its own, as in a deck. self_contact: surfaces that may touch each
    other. ties, equations: dependent displacements (see `kernel.tying`). In a half model forces and moments
    are those of the half.

    >>> from fe import finger_case
    >>> case = finger_case(Material(C10=0.1))
    >>> case.nodes.shape, case.element.name, sorted(case.surfaces)
    ((5295, 3), 'hex27', ['chamber', 'outside'])
    >>> case.with_material(C10=0.2).materials["body"].C10
    0.2
    """

    nodes: Array
    _: KW_ONLY
    labels: Integers
    blocks: tuple[Block, ...]
    node_sets: Mapping[str, Integers]
    element_sets: Mapping[str, Integers]
    surfaces: Mapping[str, Integers]  # (f, 2): element, face
    materials: Mapping[str, Material]
    supports: tuple[Support, ...] = ()
    clamp: Clamp | None = None
    pressurised: str | None = None
    forces: Mapping[str, Array] = field(default_factory=dict)
    kept: tuple[str, ...] = ()
    precurvature: float | tuple[float, ...] = 0.0
    layer: Layer | None = None
    layers: tuple[Layer, ...] = ()
    contact: Contact | None = None
    self_contact: tuple[SelfContact, ...] = ()
    growing: Mapping[str, Array] = field(default_factory=dict)
    shares: Mapping[str, float] = field(default_factory=dict)
    ties: tuple[Tie, ...] = ()
    equations: tuple[Equation, ...] = ()

    @property
    def connectivity(self) -> Integers:
        """Node rows (e, n) of all elements, block by block."""
        return np.concatenate([b.connectivity for b in self.blocks])

    @property
    def element(self) -> Element:
        """Element type of the case; ValueError for several types, or an unknown one."""
        types = sorted({b.type for b in self.blocks})
        unknown = [t for t in types if t not in ELEMENTS]
        if unknown:
            raise ValueError(f"element type {unknown[0]}: wanted one of {', '.join(ELEMENTS)}")
        if len(types) != 1:
            raise ValueError(
                f"elements of the types {', '.join(types)} in one model: wanted one type; mesh it with one"
            )
        return ELEMENTS[types[0]]

    @property
    def sheets(self) -> tuple[Layer, ...]:
        """All bonded sheets with a stiffness."""
        layers = (*self.layers, self.layer) if self.layer else self.layers
        return tuple(sheet for sheet in layers if np.any(sheet.stiffness))

    @property
    def clamped(self) -> Integers:
        """The rows (k,) of the nodes that the clamp holds."""
        return self.node_sets[self.clamp.nodes] if self.clamp else np.empty(0, np.int64)

    @property
    def supported(self) -> Flags:
        """Flags (n, 3) of the displacement components that supports prescribe, nodes of the clamp excepted.
        """
        out = np.zeros((len(self.nodes), 3), bool)
        for s in self.supports:
            out[np.ix_(self.node_sets[s.nodes], np.array(s.components))] = True
        out[self.clamped] = False
        return out

    @property
    def prescribed(self) -> Array:
        """Displacements (n, 3) mm that supports prescribe, 0 elsewhere."""
        out = np.zeros_like(self.nodes)
        for s in self.supports:
            if s.value is not None:
                rows, components = self.node_sets[s.nodes], list(s.components)
                out[np.ix_(rows, np.array(components))] = s.value[:, components]
        return out

    def position(self, label: int) -> Array:
        """Undeformed position (3,) mm of the node with this label; ValueError names the nearest labels if
        unknown."""
        row = np.flatnonzero(self.labels == label)
        if not len(row):
            near = np.sort(self.labels[np.argsort(np.abs(self.labels - label))[:3]])
            raise ValueError(
                f"node {label}: not in the model, wanted one of its {len(self.labels)} node labels "
                f"(nearest: {', '.join(map(str, near))}); correct the node of that point"
            )
        return self.nodes[row[0]]

    @property
    def pressure_shares(self) -> Array | None:
        """Share (f,) of the pressure on each face of the pressurised surface; None if every face carries all.
        """
        if not self.shares or not self.pressurised:
            return None
        faces = [tuple(row) for row in self.surfaces[self.pressurised].tolist()]
        shares = {tuple(r): s for name, s in self.shares.items() for r in self.surfaces[name].tolist()}
        return np.array([shares.get(face, 1.0) for face in faces])

    def face_nodes(self, surface: str) -> Integers:
        """Node rows (f, m) of a surface's faces, ordered so that their normal points out of the material."""
        return self.nodes_of_faces(self.surfaces[surface])

    def nodes_of_faces(self, faces: Integers) -> Integers:
        """Node rows (f, m) of faces (f, 2) = (element, face), in their order."""
        element, face = faces.T
        return np.take_along_axis(self.connectivity[element], self.element.faces[face], axis=1)

    def per_element(self, name: str) -> Array:
        """The constant `name` of each element's material, shape (e,)."""
        out = np.full(sum(len(b.connectivity) for b in self.blocks), np.nan)
        for key, material in self.materials.items():
            out[self.element_sets[key]] = getattr(material, name)
        return out

    def with_material(self, **constants: object) -> "Case":
        """The case with these constants changed in every material except those in `kept`."""
        changed = {k: replace(m, **constants) for k, m in self.materials.items() if k not in self.kept}  # type: ignore[arg-type]
        return replace(self, materials={**self.materials, **changed})


def digest(*arrays: object) -> str:
    """Hash of arrays and plain values (16 hexadecimal digits): the key of a cache.

    >>> digest(np.arange(3)) == digest(np.arange(3))
    True
    >>> digest(np.arange(3)) == digest(np.arange(4))
    False
    """
    h = hashlib.sha256()
    for a in arrays:
        h.update(np.ascontiguousarray(a).tobytes() if isinstance(a, np.ndarray) else repr(a).encode())
    return h.hexdigest()[:16]


@dataclass(frozen=True)
class CaseKey:
    """A case as the key of a cache: equal to all cases with its `digest`."""

    case: Case = field(compare=False)
    digest: str
