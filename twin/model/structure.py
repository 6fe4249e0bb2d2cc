"""The structure of a project's model: a body of the program, or the mesh of the user's own Abaqus deck.

Either gives a case with nominal constants, and the finer meshes that its discretisation modes come from.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fe import Case, Clamp, Finger, Lattice, Material
from fe.case import digest
from fe.deck.reader import Deck, read_deck
from fe.deck.soundness import check_body, jacobians
from fe.element import Integers
from fe.kernel.tying import dependence
from fe.mesh.inner import closing
from fe.mesh.mirror import mirrored, symmetry_support
from fe.mesh.refine import enriched, free_faces, refined
from twin.bodies.body import Body
from twin.bodies.finger import BuiltIn
from twin.laws.catalogue import law_of
from twin.laws.law import Constants, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, NOMINAL
from twin.model.objects import RigidObject

SHORT_MM = 20.0  # long: a finger of 200 mm whose lengths are in cm
COMPRESSIBLE = 20.0  # bulk modulus over shear modulus, Poisson's ratio 0.475
STIFFEST = 1e4  # MPa, shear modulus: nylon has 1000, aluminium 26000
LARGEST = 80_000  # nodes of a mesh that is solved for the discretisation error: about 4 GB


@dataclass(frozen=True)
class Mesh:
    """One way to mesh a structure: its fingerprint, and what builds its case."""

    key: str
    build: Callable[[], Case]


@dataclass(frozen=True)
class Structure:
    """A case with nominal constants and what belongs to it.

    key: fingerprint; base and finer: meshes of the discretisation error, the last of which tests the others
    (see `model.discretisation`); none where `unknown` says why. outside (f, m): the faces that are drawn, as
    node rows. scales: whether U depends on pressure / scale and the law's shape alone, as where nothing but
    pressure loads one material. remarks: what a user should know of it. numbers: of a deck's elements.
    nominal: the constants of its silicone until they are fitted. body: the kind of body with its dimensions,
    None of a deck. walls: its own mesh with one dimension of the chamber larger by its tolerance, by name.
    """

    case: Case
    key: str
    finer: Mapping[str, Mesh]
    outside: Integers
    scales: bool = True
    unknown: str = ""
    remarks: tuple[str, ...] = ()
    numbers: Integers | None = None
    nominal: Constants = NOMINAL
    body: Body | None = None
    walls: Mapping[str, Mesh] = field(default_factory=dict)

    @property
    def elements(self) -> Integers:
        """The numbers (e,) of the elements: a deck's own as long as they are not divided, else 1, 2, .."""
        count = len(self.case.connectivity)
        undivided = self.numbers is not None and len(self.numbers) == count
        return self.numbers if self.numbers is not None and undivided else 1 + np.arange(count)

    @property
    def base(self) -> Mesh:
        """The mesh of the model itself."""
        return Mesh(self.key, partial(_itself, self.case))


def _itself(case: Case) -> Case:
    return case


def in_law(structure: Structure, nominal: Constants) -> Structure:
    """The structure whose silicone has these constants until they are fitted."""
    if nominal == structure.nominal:
        return structure
    return replace(structure, case=structure.case.with_material(**nominal.terms), nominal=nominal)


def weighed(structure: Structure, density: float) -> Structure:
    """The structure whose silicone has a density in tonne/mm3."""
    return _changed(structure, f"{density:.9g}", partial(Case.with_material, density=density))


def closed(structure: Structure) -> Structure:
    """The structure whose walls cannot pass through each other."""
    return _changed(structure, "closed", closing)


def whole(structure: Structure) -> Structure:
    """The structure of both halves, where that of a symmetric body is one of them; else as it is."""
    if symmetry_support(structure.case) is None:
        return structure
    both = _changed(structure, "whole", mirrored)
    own = skin(both.case) if structure.body is None else both.case.face_nodes("outside")
    return replace(both, outside=own)


def _changed(structure: Structure, name: str, change: Callable[[Case], Case]) -> Structure:
    """The structure with a change, of this name in its fingerprints, of the cases of all meshes."""

    def changed(mesh: Mesh) -> Mesh:
        return Mesh(f"{mesh.key}-{name}", partial(_built, mesh.build, change))

    finer, walls = ({k: changed(m) for k, m in x.items()} for x in (structure.finer, structure.walls))
    base = changed(structure.base)
    return replace(structure, case=base.build(), key=base.key, finer=finer, walls=walls)


def _built(build: Callable[[], Case], change: Callable[[Case], Case]) -> Case:
    return change(build())


def beside(structure: Structure, rigid: RigidObject) -> Structure:
    """The structure beside a rigid object. ValueError where the object overlaps it at rest, or it is not
    known what may touch."""

    def met(mesh: Mesh) -> Mesh:
        return Mesh(digest(mesh.key, rigid), partial(_beside, mesh.build, rigid))

    finer, walls = ({k: met(m) for k, m in x.items()} for x in (structure.finer, structure.walls))
    base = met(structure.base)
    return replace(structure, case=base.build(), key=base.key, finer=finer, walls=walls, scales=False)


def _beside(build: Callable[[], Case], rigid: RigidObject) -> Case:
    return rigid.beside(build())


# -- a body of the program ---------------------------------------------------------------------------------


def base_case(*, finger: Finger | None = None, lattice: Lattice | None = None) -> Case:
    """The embedded bellows finger with nominal constants, to which every effect is applied."""
    return body_case(BuiltIn(finger or Finger(), lattice or Lattice()), lattice or Lattice())


def body_case(body: Body, lattice: Any) -> Case:
    """A body on a lattice with nominal constants."""
    return body.case(lattice, NOMINAL.material)


def of_finger(finger: Finger, lattice: Lattice) -> Structure:
    """The bellows finger on a lattice. ValueError where its dimensions turn a cell of the mesh over."""
    return of_body(BuiltIn(finger, lattice))


def of_body(
    body: Body, *, refine: int = 1, tolerances: Mapping[str, float] | None = None
) -> Structure:
    """A body on its own lattice, each cell divided `refine` times in each direction. ValueError where its
    dimensions turn a cell of the mesh over. tolerances: sd in mm of dimensions of the chamber, by name."""
    lattice = replace(body.lattice, refine=refine) if refine != 1 else body.lattice
    case = body_case(body, lattice)
    _check_cells(case, body)
    meshes = {
        name: Mesh(body.key(mesh), partial(body_case, body, mesh))
        for name, mesh in body.finer(lattice).items()
    }
    walls = {
        name: Mesh(other.key(lattice), partial(body_case, other, lattice))
        for name, sd in (tolerances or {}).items()
        if sd
        for other in [body.larger(name, sd)]
    }
    return Structure(
        case, body.key(lattice), meshes, case.face_nodes("outside"), scales=not case.layers, body=body,
        walls=walls,
    )  # fmt: skip


def _check_cells(case: Case, body: Body) -> None:
    """ValueError unless the Jacobian is positive at all integration points."""
    size = jacobians(case).min(axis=1)
    if size.min() <= 0.0:
        x, _, z = case.nodes[case.connectivity[size.argmin()]].mean(axis=0)
        raise ValueError(
            f"model.{body.kind}: with these dimensions the mesh folds near x = {x:.3g}, z = {z:.3g} mm; "
            f"wanted cells that are the right way round; {body.remedy}"
        )


# -- a deck ------------------------------------------------------------------------------------------------


def of_deck(
    path: Path, *, mesh: int = 1, silicone: tuple[str, ...] = (), law: RubberLaw | None = None
) -> Structure:
    """The structure of a user's deck, every element divided `mesh` times in each direction (1, 2, 4 ..).

    silicone: element sets whose constants are to be fitted, by default all; the others keep the deck's law.
    law: theirs, by default the deck's own, whose constants then are nominal. Raises ValueError where the deck
    cannot be read or lacks something, and says what is wanted; FileNotFoundError where it is not there.
    """
    deck = sound_deck(path)
    fitted = _fitted(deck.case, silicone, path)
    nominal = _nominal(deck.case.materials[fitted[0]], law)
    case = _clamped(_rubber(_divided(deck.case, mesh), fitted, nominal))
    key = digest(mesh, fitted, *(file.read_bytes() for file in deck.files))
    meshes, unknown = _refinements(case, key)
    forces = case.forces or case.growing
    alone = not case.kept and not forces and not case.layers and all(s.value is None for s in case.supports)
    sentences = (*deck.remarks, *_left_out(deck.case, fitted))
    remarks = (*(f"{path.name}: {r}" for r in sentences), *_remarks(path, case, fitted, meshes, nominal))
    return Structure(case, key, meshes, skin(case), alone, unknown, remarks, deck.elements, nominal)


def sound_deck(path: Path) -> Deck:
    """The deck of a file, with a chamber under pressure and a body that can be solved; else ValueError."""
    deck = read_deck(path)
    if deck.case.pressurised is None:
        raise ValueError(f"{path.name}: no pressure; wanted *DSLOAD with P on the surface of the chamber")
    check_body(deck.case, path.name)
    return deck


def _fitted(case: Case, silicone: tuple[str, ...], path: Path) -> tuple[str, ...]:
    """The element sets of the silicone; ValueError where they are not known."""
    sets = ", ".join(case.materials)
    names = tuple(name.lower() for name in silicone)
    for name in names:
        if name not in case.materials:
            raise ValueError(
                f"model.silicone = {name!r}: {path.name} has no *SOLID SECTION of that name; wanted "
                f"one of {sets}"
            )
    if not names and len(set(case.materials.values())) > 1:
        raise ValueError(
            f"{path.name} has several materials ({sets}); wanted the element sets whose silicone is "
            f'calibrated: write, for example, silicone = ["{next(iter(case.materials))}"] '
            "under [model] in twin.toml"
        )
    return names or tuple(case.materials)


def _divided(case: Case, mesh: int) -> Case:
    if mesh & (mesh - 1):
        raise ValueError(
            f"model.mesh = {mesh}: the elements of a deck are halved again and again; wanted 1, 2, 4 .."
        )
    return case if mesh == 1 else _divided(refined(case), mesh // 2)


def _nominal(material: Material, law: RubberLaw | None) -> Constants:
    """The constants of a silicone until they are fitted: a deck's own where it states the law; of
    Mooney-Rivlin rubber, which neo-Hookean is too, and of a law that no model has, the usual ones."""
    deck_law = law_of(material)
    polynomial = deck_law is None or set(deck_law.names) <= set(MOONEY_RIVLIN.names)
    fitted_law = law or (MOONEY_RIVLIN if polynomial or deck_law is None else deck_law)
    if fitted_law == MOONEY_RIVLIN or deck_law != fitted_law:
        return fitted_law.nominal
    return fitted_law.of(fitted_law.read(material))


def _rubber(case: Case, fitted: tuple[str, ...], nominal: Constants) -> Case:
    """The case with the base law in the fitted sets, as compressible and heavy as in the deck."""
    silicone, base = {k: case.materials[k] for k in fitted}, nominal.material
    changed = {k: replace(base, bulk_ratio=m.bulk_ratio, density=m.density) for k, m in silicone.items()}
    others = tuple(k for k in case.materials if k not in fitted)
    return replace(case, materials={**case.materials, **changed}, kept=others)


def _left_out(case: Case, fitted: tuple[str, ...]) -> list[str]:
    """A sentence on the memory that a deck gives to its silicone."""
    names = [k for k in fitted if case.materials[k].prony or case.materials[k].mullins]
    sentence = f"The memory of {', '.join(names)} is left out: the effects creep and mullins fit it."
    return [sentence] if names else []


def _clamped(case: Case) -> Case:
    """The case with its one fully held node set as the clamp, which an effect may let give way."""
    held = [s for s in case.supports if s.components == (0, 1, 2) and s.value is None]
    if len(held) != 1:
        return case
    tied = dependence(case)
    leading = np.empty(0, np.int64) if tied is None else np.unique(tied.weights.indices // 3)
    if np.isin(case.node_sets[held[0].nodes], leading).any():  # its turn would have to turn who follows it
        return case
    x = case.nodes[case.node_sets[held[0].nodes]]
    centre = (x.min(axis=0) + x.max(axis=0)) / 2
    clamp = Clamp(held[0].nodes, (float(centre[0]), float(centre[2])))
    return replace(case, clamp=clamp, supports=tuple(s for s in case.supports if s is not held[0]))


def _refinements(case: Case, key: str) -> tuple[dict[str, Mesh], str]:
    """Meshes for the discretisation error, the largest last and twice: as a mode, and to test the others."""
    meshes, count = {}, len(case.nodes)
    if case.equations:
        return {}, (
            "the error of the deck's mesh is not known: *EQUATION, *MPC or a rigid joint names nodes, and "
            "says nothing of those between them on a finer mesh; wanted *TIE or *BOUNDARY in its place"
        )
    linear = case.element.simplex and len(case.element.local) == 4
    if linear and 8 * count <= LARGEST:
        meshes["10-node elements"] = Mesh(f"{key}-10", partial(enriched, case))
    if not case.element.simplex and case.element.name != "hex27" and 2 * count <= LARGEST:
        meshes["27-node elements"] = Mesh(f"{key}-27", partial(enriched, case))
    if 8 * count <= LARGEST:
        meshes["halved elements"] = Mesh(f"{key}-halved", partial(refined, case))
    if not meshes:
        return {}, (
            f"the error of the deck's mesh is not known: refined, it would have about {8 * count} nodes, and "
            f"at most {LARGEST} are solved for it; wanted a mesh of at most {LARGEST // 8} nodes"
        )
    return {**meshes, "check": meshes[list(meshes)[-1]]}, ""


def skin(case: Case) -> Integers:
    """The faces (f, m) of a deck's body but for the chamber and the planes of symmetry, as node rows."""
    assert case.pressurised
    chamber = {tuple(row) for row in case.surfaces[case.pressurised].tolist()}
    faces = np.array([row for row in free_faces(case).tolist() if tuple(row) not in chamber], np.int64)
    rows = np.take_along_axis(case.connectivity[faces[:, 0]], case.element.faces[faces[:, 1]], axis=1)
    for s in case.supports:
        if len(s.components) == 1:
            rows = rows[~np.isin(rows, case.node_sets[s.nodes]).all(axis=1)]
    return rows


def _remarks(
    path: Path, case: Case, fitted: tuple[str, ...], meshes: Mapping[str, Mesh], nominal: Constants
) -> tuple[str, ...]:
    """Sentences on what the model takes from a deck, and what it cannot do with it."""
    low, high = (", ".join(f"{x:g}" for x in f(axis=0)) for f in (case.nodes.min, case.nodes.max))
    size = f"{len(case.nodes)} nodes, {len(case.connectivity)} elements {case.element.name}"
    loose = f"{path.name}: no single node set is fully held; a soft clamp is not tested."
    held = () if case.clamp else (loose,)
    return (
        f"{path.name}: {size}, from ({low}) to ({high}) mm. x is read as the finger's length, z as up.",
        f"{path.name}: {_law_told(nominal)} the material of {', '.join(fitted)}."
        + (f" {_staying(case)}" if case.kept else ""),
        f"{path.name}: {_tested(meshes)}",
        *held,
        *(f"{path.name}: {doubt}" for doubt in _doubts(case, fitted)),
    )


def _law_told(nominal: Constants) -> str:
    """The beginning of a sentence on the fitted law, up to the names of its element sets."""
    law = nominal.law
    *most, last = law.names
    fitted = f"{law.title} with fitted {' and '.join([', '.join(most), last] if most else [last])}"
    if nominal == law.nominal:
        return f"{fitted} replaces"
    return f"{fitted}, which begin at the deck's {nominal.told}, is"


def _staying(case: Case) -> str:
    """A sentence on the materials that are not fitted, each with what tells a wrong unit."""
    stay = ", ".join(f"{k} (shear modulus {case.materials[k].shear:.3g} MPa)" for k in case.kept)
    return f"The material of {stay} stays."


def _doubts(case: Case, fitted: tuple[str, ...]) -> list[str]:
    """Sentences on what is odd in a deck's size and materials, without being surely wrong."""
    soft = [k for k in fitted if case.materials[k].bulk_ratio < COMPRESSIBLE]
    stiff = [k for k in case.kept if case.materials[k].shear > STIFFEST]
    return [
        *(
            f"the material of {k} is compressible: its bulk modulus is {case.materials[k].bulk_ratio:.3g} "
            "times its shear modulus, that of silicone more than 1000 times. Is D1 in 1/MPa, and 2 / "
            "bulk modulus?"
            for k in soft
        ),
        *(
            f"the material of {k} is as stiff as metal: its shear modulus is {case.materials[k].shear:.3g} "
            "MPa. Are its constants in MPa?"
            for k in stiff
        ),
    ]


def size_doubt(case: Case) -> str:
    """A sentence on a finger as long as one in cm would be, "" for others."""
    longest = float(np.ptp(case.nodes, axis=0).max())
    if longest >= SHORT_MM:
        return ""
    return f"The finger is {longest:.3g} mm long. Is it in cm? Lengths are in mm."


def _tested(meshes: Mapping[str, Mesh]) -> str:
    """A sentence on how the error of the mesh is found, or why it is not."""
    if meshes:
        return f"the error of the mesh is estimated with {' and '.join(list(meshes)[:-1])}."
    return (
        f"the mesh is too large to estimate its error: at most {LARGEST // 8} nodes are wanted. calibrate "
        "and compare leave this error out, and diagnose cannot test."
    )
