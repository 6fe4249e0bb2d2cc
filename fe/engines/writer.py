"""The Abaqus input deck of a case under pressure; CalculiX reads it too, without the H of its elements."""

from collections.abc import Iterable, Sequence
from itertools import chain

import numpy as np

from fe.case import Case, Layer, SelfContact, Support
from fe.deck.hyperelastic import written_law
from fe.element import Array, Integers
from fe.engines.obstacle import MOST_BRICKS, touched
from fe.material import Material
from fe.mesh.convert import converted

INCREMENTS = 1000  # at most, of the automatic ones
FIRST_INCREMENT, LARGEST_INCREMENT = 0.05, 0.1  # of the step
LEAST_INCREMENT = 1e-3  # of a step whose course is wanted: below that it is given up
CREEP_TOLERANCE = 1e-3  # of the strain, by which creep may differ over an increment


def deck(
    case: Case,
    pressure: float,
    *,
    kind: str = "C3D20RH",
    gravity: Array | None = None,
    times: tuple[float, float] | None = None,
    levels: int = 0,
) -> str:
    """The text of a deck (mm, N, MPa): the structure under a follower pressure in MPa and its weight in a
    gravity (3,) mm/s2, large displacements, in one static step.

    times: seconds in which the loads grow and for which they are then held, two steps of *VISCO, in which a
    Prony series relaxes the instantaneous constants (Abaqus's TIME=PRONY; CalculiX knows none).

    levels: at how many pressures at least displacements are written, at most equally far apart; what does not
    grow with the pressure (weight, forces, moved supports) is put on in a step before. 0: all grows together.

    kind: the Abaqus element that takes the place of hex27, on the mesh's own nodes and labels (see
    `convert.converted`); a case that has Abaqus elements already keeps them. Names of sets are written in
    capitals. A rigid obstacle is written as held bricks and a contact pair (`obstacle.touched`), surfaces
    that may touch as contact pairs, a layer as membranes on the solids' own nodes. ValueError for what it
    cannot hold: an elastic clamp, a precurvature, an obstacle on a spring, a surface that may touch itself, a
    term of Gent, and in a static step a Prony series.
    """
    _check(case, static=times is None)
    if levels and case.forces and case.growing:
        raise ValueError(
            "forces that last and forces that grow with the pressure: in a deck of two steps the second "
            "would replace the first; wanted one of them"
        )
    changed = converted(case, kind) if case.element.name == "hex27" else case
    supports = list(changed.supports)
    if changed.clamp:
        supports.append(Support(changed.clamp.nodes, (0, 1, 2)))
    lines = ["*HEADING", "softtwin; units mm, N, MPa, s", "*NODE, NSET=ALL_NODES"]
    places = zip(changed.labels, changed.nodes, strict=True)
    lines += [f"{n}, {x:.10g}, {y:.10g}, {z:.10g}" for n, (x, y, z) in places]
    lines += [f"*ELEMENT, TYPE={changed.element.name}, ELSET=ALL_ELEMENTS"]
    lines += chain.from_iterable(
        _wrapped((e, *changed.labels[row])) for e, row in enumerate(changed.connectivity, start=1)
    )
    for name, rows in changed.node_sets.items():
        lines += [f"*NSET, NSET={in_deck(name)}", *_wrapped(changed.labels[rows], last=False)]
    for name, rows in changed.element_sets.items():
        lines += [f"*ELSET, ELSET={in_deck(name)}", *_wrapped(rows + 1, last=False)]
    for name, faces in changed.surfaces.items():
        lines += [f"*SURFACE, NAME={in_deck(name)}, TYPE=ELEMENT"]
        lines += [f"{e + 1}, S{f + 1}" for e, f in faces]
    for name, material in changed.materials.items():
        lines += _material(name, material)
        lines += [f"*SOLID SECTION, ELSET={in_deck(name)}, MATERIAL={in_deck(name)}"]
    next_element = len(changed.connectivity) + MOST_BRICKS + 1  # after the solids and the obstacle's bricks
    for k, layer in enumerate(changed.sheets):
        lines += _sheet(changed, layer, f"SHEET_{k}_" if k else "SHEET", next_element)
        next_element += len(changed.surfaces[layer.surface])
    if changed.contact and changed.contact.stiffness:
        lines += touched(changed, changed.contact)
    lines += chain.from_iterable(_touching(changed, n, c) for n, c in enumerate(changed.self_contact))
    lines += _joints(changed)
    lines += ["*BOUNDARY", *(line for s in supports if s.value is None for line in _held(s))]
    lasting, growing = _lasting(changed, supports, gravity), _growing(changed, pressure)
    if levels and lasting:
        lines += [*_step(None), *lasting, *END]
        lasting = []
    lines += [*_step(times and times[0], levels), *lasting, *growing, *END]
    if times and times[1]:
        lines += [*_step(times[1]), *END]
    return "\n".join([*lines, ""])


def in_deck(name: str) -> str:
    """A name as written in a deck: in capitals, without the point after an instance.

    >>> in_deck("finger-1.root")
    'FINGER-1_ROOT'
    """
    return name.upper().replace(".", "_")


def _joints(case: Case) -> list[str]:
    """Ties and equations."""
    lines = list[str]()
    for k, tie in enumerate(case.ties, start=1):
        lines += [f"*TIE, NAME=TIE_{k}, POSITION TOLERANCE={tie.reach:.10g}"]
        lines += [f"{in_deck(tie.slave)}, {in_deck(tie.master)}"]
    for equation in case.equations:
        words = [f"{label}, {d + 1}, {factor:.10g}" for label, d, factor in equation.terms]
        lines += ["*EQUATION", str(len(words))]
        lines += [", ".join(words[i : i + 4]) for i in range(0, len(words), 4)]
    return lines


END = ("*NODE FILE", "U", "*END STEP")


def steps_of(text: str) -> int:
    """Number of steps of a deck.

    >>> steps_of("*STEP, NLGEOM=YES")
    1
    """
    return sum(line.upper().startswith("*STEP") for line in text.splitlines())


def _lasting(case: Case, supports: Sequence[Support], gravity: Array | None) -> list[str]:
    """Lines of the loads that do not depend on the pressure."""
    lines = list[str]()
    for s in supports:
        if s.value is not None:
            lines += ["*BOUNDARY", *_moved(case, s, s.value)]
    for name, force in case.forces.items():
        lines += _forces(case, name, np.asarray(force))
    if gravity is not None and np.any(gravity):
        size = float(np.linalg.norm(gravity))
        direction = ", ".join(f"{x:.10g}" for x in np.asarray(gravity) / size)
        lines += ["*DLOAD", f"ALL_ELEMENTS, GRAV, {size:.10g}, {direction}"]
    return lines


def _growing(case: Case, pressure: float) -> list[str]:
    """The pressure in MPa, and the forces that grow with it."""
    lines = list[str]()
    for name, force in case.growing.items():
        lines += _forces(case, name, pressure * np.asarray(force))
    if case.pressurised:
        shares = case.shares or {case.pressurised: 1.0}
        named = np.concatenate([case.surfaces[name] for name in shares])
        if len(np.unique(named, axis=0)) != len(case.surfaces[case.pressurised]):
            raise ValueError(
                f"shares of the pressure name other faces than the surface {case.pressurised!r} has: a deck "
                "wants a share for each of its faces; name them all"
            )
        lines += ["*DSLOAD", *(f"{in_deck(n)}, P, {share * pressure:.10g}" for n, share in shares.items())]
    return lines


def _forces(case: Case, name: str, force: Array) -> list[str]:
    labels = case.labels[case.node_sets[name]]
    share = {d + 1: f / len(labels) for d, f in enumerate(force) if f}
    return ["*CLOAD", *(f"{n}, {d}, {f:.10g}" for n in labels for d, f in share.items())]


def _step(time: float | None, levels: int = 0) -> list[str]:
    """Head of a step of `time` seconds in which loads grow in proportion, or of a static step (None);
    `levels`: least number of increments."""
    procedure, length = ("*STATIC", 1.0) if time is None else (f"*VISCO, CETOL={CREEP_TOLERANCE:g}", time)
    largest = length * min(LARGEST_INCREMENT, 1 / levels if levels else 1.0)
    initial = min(FIRST_INCREMENT * length, largest)
    ramp = "" if time is None else "AMPLITUDE=RAMP, "
    least = LEAST_INCREMENT if levels else 1e-6  # a search asks for what has no equilibrium, too
    increments = f"{initial:.6g}, {length:.6g}, {least * length:.6g}, {largest:.6g}"
    return [f"*STEP, NLGEOM=YES, {ramp}INC={INCREMENTS}", procedure, increments]


def _check(case: Case, *, static: bool) -> None:
    if case.clamp and case.clamp.compliance:
        raise ValueError(
            f"clamp of compliance {case.clamp.compliance:g} rad/(N mm): a deck holds a rigid clamp "
            "only; set it to 0"
        )
    for c in case.self_contact:
        if c.first == c.second:
            raise ValueError(
                f"surface {c.first!r} that may touch itself: a deck holds pairs of two surfaces; name the two"
            )
    if np.any(case.precurvature):
        raise ValueError("a precurvature: a deck holds a structure without stress at rest; set it to 0")
    if any(sheet.wound for sheet in case.sheets):
        raise ValueError(
            "a layer of wound fibres: a deck holds sheets alone, stiff in all directions; leave it out"
        )
    for name, m in case.materials.items():
        refused = {"a Prony series": static and m.prony, "a term of Gent": m.gent}
        for what in (what for what, there in refused.items() if there):
            raise ValueError(f"material {name!r} has {what}: a deck of one static step holds none; drop it")


def _material(name: str, m: Material) -> list[str]:
    lines = [f"*MATERIAL, NAME={in_deck(name)}", *written_law(name, m)]
    if m.prony:
        lines[1] += ", MODULI=INSTANTANEOUS"
        lines += ["*VISCOELASTIC, TIME=PRONY", *(f"{g:.10g}, 0., {tau:.10g}" for g, tau in m.prony)]
    if m.mullins and m.mullins[0]:
        softening, scale, beta = m.mullins
        lines += ["*MULLINS EFFECT", f"{1 / softening:.10g}, {scale:.10g}, {beta:.10g}"]
    return [*lines, "*DENSITY", f"{m.density:.10g},"] if m.density else lines


MEMBRANES = {8: "M3D8", 6: "M3D6", 4: "M3D4", 3: "M3D3"}  # by the nodes of a face
SHEET = 0.01  # mm, a thickness for what only has thickness x modulus: in CalculiX 0.1 does 0.1 % less


def _sheet(case: Case, layer: Layer, prefix: str, begin: int) -> list[str]:
    """The layer as membranes, numbered from `first`."""
    faces, each = case.labels[case.face_nodes(layer.surface)], layer.per_face(case)
    lines = list[str]()
    for k, stiffness in enumerate(np.unique(each[each != 0])):
        name, rows = f"{prefix}{k or ''}", np.flatnonzero(each == stiffness)
        lines += [
            f"*ELEMENT, TYPE={MEMBRANES[faces.shape[1]]}, ELSET={name}",
            *chain.from_iterable(_wrapped((begin + int(row), *faces[row])) for row in rows),
            *(f"*MATERIAL, NAME={name}", "*ELASTIC", f"{stiffness / SHEET:.10g}, {layer.poisson:.10g}"),
            *(f"*MEMBRANE SECTION, ELSET={name}, MATERIAL={name}", f"{SHEET},"),
        ]
    return lines


def _touching(case: Case, number: int, contact: SelfContact) -> list[str]:
    """Lines of the contact pair of two surfaces that may touch each other."""
    stiffness = contact.stiffness * case.per_element("shear").min()
    return [
        f"*SURFACE INTERACTION, NAME=WALLS{number}",
        *("*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{stiffness:.10g},"),
        f"*CONTACT PAIR, INTERACTION=WALLS{number}, TYPE=SURFACE TO SURFACE",
        f"{contact.first.upper()}, {contact.second.upper()}",
    ]


def _held(s: Support) -> list[str]:
    return [f"{in_deck(s.nodes)}, {d + 1}, {d + 1}" for d in s.components]


def _moved(case: Case, s: Support, value: np.ndarray) -> list[str]:
    return [
        f"{label}, {d + 1}, {d + 1}, {row[d]:.10g}"
        for label, row in zip(case.labels[case.node_sets[s.nodes]], value, strict=True)
        for d in s.components
    ]


def _wrapped(numbers: Sequence[int] | Integers, *, last: bool = True) -> Iterable[str]:
    """Lines of at most 16 numbers; all but the last end in a comma where one record goes on (`last`)."""
    parts = [numbers[k : k + 16] for k in range(0, len(numbers), 16)]
    for k, part in enumerate(parts):
        text = ", ".join(str(int(n)) for n in part)
        yield text + ("," if last and k < len(parts) - 1 else "")
