"""The structured mesh of the bellows finger, with rounded inner edges, as a `Case`.

A 2-D section of quadrilaterals (walls and core) is extruded along x; core cells inside the chamber are void.
The lattice lives in a reference box; a map then rounds the chamber's edges and folds the pleats. Refinement
changes the lattice, never the geometry.
"""

from dataclasses import dataclass, replace

import numpy as np

from fe.case import Case
from fe.element import Array, Flags
from fe.material import Material
from fe.mesh.extruding import between, extruded, grid_quads, hollow_case, path
from fe.mesh.mirror import mirrored


@dataclass(frozen=True, kw_only=True)
class Finger:
    """Dimensions of the bellows finger in mm (x along, y across, z up; the flat bottom is z = 0).

    Both marked nodes lie on the flat lower edge of the side face. middle_node is the node of the default mesh
    whose U3 comes nearest to the reference study's -19 mm where the tip moves by -58 mm. `marked` places both
    on a finger of other dimensions.

    >>> Finger(length=92.0, bellows=8).pitch
    10.25
    """

    length: float = 110.0
    width: float = 23.0
    height: float = 20.0
    side: float = 2.0  # wall thicknesses
    bottom: float = 2.5
    top: float = 2.0
    base_cap: float = 4.0
    tip_cap: float = 6.0
    bellows: int = 9
    pleat: float = 3.8  # amplitude A: the top wall's pleats are 2 A deep
    side_pleat: float = 2.8  # depth of the side walls' pleats at the ceiling
    flatness: float = 0.0  # of crests and valleys: 0 is a cosine; the larger, the steeper between them
    radius: float = 1.0  # of all inner edges
    tip_node: tuple[float, float, float] = (110.0, 11.5, 0.0)
    middle_node: tuple[float, float, float] = (187 / 3, 11.5, 0.0)  # a quarter into the sixth bellow

    @property
    def pitch(self) -> float:
        """Length of a bellow in mm."""
        return (self.length - self.base_cap - self.tip_cap) / self.bellows

    def wave(self, phase: Array) -> tuple[Array, Array]:
        """The pleats' profile between 1 (valley, phase 0) and -1 (crest), and its slope over the phase."""
        cosine, sine, k = np.cos(phase), np.sin(phase), self.flatness
        if k == 0.0:
            return cosine, -sine
        bent = np.tanh(k * cosine)
        return bent / np.tanh(k), -sine * k * (1 - bent**2) / np.tanh(k)


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """Division of a finger into cells: cells per bellow, per wall, per fillet, per middle span, per cap;
    section topology.

    ring: walls divided by mitred corners (an O-grid), not by straight lines. centred: a cell's middle, not a
    boundary, at every crest and valley, whose bend one cell then follows. The default is the cheapest of
    docs/records/meshes.md within 2 % of the limit.
    """

    per_bellow: int = 6
    wall: int = 1
    fillet: int = 1
    across: int = 1  # the straight middle part in y
    up: int = 1  # the straight middle part in z
    caps: int = 1
    ring: bool = True
    centred: bool = True
    refine: int = 1  # every cell of the lattice divided so many times in each direction


NAMED_NODES = {"tip": 4401, "middle": 5848}  # the node numbers of the reference study


def _stations(g: Finger, m: Lattice) -> Array:
    """Cell boundaries along x: the caps, the fillets at the chamber's ends, the bellows, the middle node."""
    start, end = g.base_cap, g.length - g.tip_cap
    cell = (end - start) / (g.bellows * m.per_bellow)
    pleats = start + cell * (np.arange(g.bellows * m.per_bellow + 1) + 0.5 * m.centred)
    # no slivers between the fillets and the first pleat cell
    inner = pleats[(pleats > start + 1.25 * g.radius) & (pleats < end - 1.25 * g.radius)]
    fillet = np.linspace(0, g.radius, m.fillet + 1)
    caps = np.linspace(0, start, m.caps + 1)[:-1], np.linspace(end, g.length, m.caps + 1)[1:]
    # the rest of the first and last pleat cell is divided as finely as the fillet beside it
    lead = np.linspace(start + g.radius, inner[0], m.fillet + 1)[1:-1]
    tail = np.linspace(inner[-1], end - g.radius, m.fillet + 1)[1:-1]
    stops = np.concatenate([caps[0], start + fillet, lead, inner, tail, end - fillet[::-1], caps[1]])
    return between(list(stops), [m.refine] * (len(stops) - 1))


def _section_block(g: Finger, m: Lattice) -> tuple[Array, Flags]:
    """Quadrilaterals (c, 4, 2) of the reference half section by straight lines, and which of them are
    core."""
    w, top = g.width / 2, g.height - g.top
    wall, fillet, across, up = (m.refine * n for n in (m.wall, m.fillet, m.across, m.up))
    y = between([0, w - g.side - g.radius, w - g.side, w], [across, fillet, wall])
    stops = [0, g.bottom, g.bottom + g.radius, top - g.radius, top, g.height]
    z = between(stops, [wall, fillet, up, fillet, wall])
    quads = grid_quads(np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1))
    centre = quads.mean(axis=1)
    core = (centre[:, 0] < w - g.side) & (centre[:, 1] > g.bottom) & (centre[:, 1] < top)
    return quads, core


def _section_ring(g: Finger, m: Lattice) -> tuple[Array, Flags]:
    """The reference half section as an O-grid of walls with mitred corners around a lattice core."""
    w, top, r = g.width / 2, g.height - g.top, g.radius
    wall, fillet, across, up = (m.refine * n for n in (m.wall, m.fillet, m.across, m.up))
    y = between([0, w - g.side - r, w - g.side], [across, fillet])
    z = between([g.bottom, g.bottom + r, top - r, top], [fillet, up, fillet])
    core = grid_quads(np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1))
    yo = between([0, w - g.side - r / 2, w], [across, fillet])  # outer ends of the spokes
    zo = between([0, g.bottom + r / 2, top - r / 2, g.height], [fillet, up, fillet])
    inner = np.concatenate([path(y, g.bottom), path(w - g.side, z[1:]), path(y[-2::-1], top)])
    outer = np.concatenate([path(yo, 0.0), path(w, zo[1:]), path(yo[-2::-1], g.height)])
    depth = np.linspace(0, 1, wall + 1)[None, :, None]
    walls = grid_quads(inner[:, None] * (1 - depth) + outer[:, None] * depth)
    walls = walls[:, [0, 3, 2, 1]]  # counter-clockwise
    quads = np.concatenate([core, walls])
    return quads, np.arange(len(quads)) < len(core)


def _round_and_fold(reference: Array, g: Finger) -> Array:
    """Positions (n, 3) mm in the finger of reference points (n, 3): chamber edges rounded, pleats folded."""
    w = g.width / 2
    low = np.array([g.base_cap, -(w - g.side), g.bottom])
    high = np.array([g.length - g.tip_cap, w - g.side, g.height - g.top])
    on = np.clip(reference, low, high)  # nearest chamber point
    core = np.clip(on, low + g.radius, high - g.radius)
    d = (on - core) / g.radius
    d = np.tan(d * np.pi / 4)  # equal angles along the arc
    longest, norm = np.abs(d).max(-1, keepdims=True), np.linalg.norm(d, axis=-1, keepdims=True)
    moved = core + g.radius * d * np.divide(longest, norm, out=np.ones_like(norm), where=norm > 0) - on
    wall = np.array([g.base_cap, g.side, g.bottom]), np.array([g.tip_cap, g.side, g.top])
    depth = np.where(reference < on, (on - reference) / wall[0], (reference - on) / wall[1]).max(
        -1, keepdims=True
    )
    return _fold(reference + moved * (1 - depth), g)


def _fold(p: Array, g: Finger) -> Array:
    """The pleats: bands of one radius beside the walls move rigidly, the middle of the chamber is
    stretched."""
    x, y, z = p.T
    start, end = g.base_cap, g.length - g.tip_cap
    wave, steepness = g.wave(2 * np.pi * (np.clip(x, start, end) - start) / g.pitch)
    slope = g.pleat * 2 * np.pi / g.pitch * steepness
    thickness = g.top * np.sqrt(1 + slope**2)  # vertical, so that it is g.top across the wall
    drop = g.pleat * (1 + wave)
    ceiling = g.height - g.top / 2 - drop - thickness / 2
    flat, top = g.bottom + g.radius, g.height - g.top
    height = np.clip((z - flat) / (top - g.radius - flat), 0, 1)
    folded = z + height * (ceiling - top)
    folded = np.where(z > top, ceiling + (z - top) / g.top * thickness, folded)
    inner = g.width / 2 - g.side - g.radius
    inward = g.side_pleat * (1 + wave) / 2 * np.clip((z - g.bottom) / (top - g.bottom), 0, 1)
    return np.stack([x, y - inward * np.clip(y / inner, 0, 1), folded], axis=-1)


def marked(finger: Finger) -> Finger:
    """The finger with its tip node at its end and its middle node a quarter into a bellow near its middle."""
    y, bellow = finger.width / 2, min(round(5 / 9 * finger.bellows), finger.bellows - 1)
    middle = finger.base_cap + (bellow + 0.25) * finger.pitch
    return replace(finger, tip_node=(finger.length, y, 0.0), middle_node=(middle, y, 0.0))


def finger_case(
    material: Material, *, finger: Finger | None = None, lattice: Lattice | None = None, full: bool = False
) -> Case:
    """Half model (y >= 0) of a finger, clamped at x = 0, with a follower pressure on the chamber.

    material is the one silicone; finger (mm) and lattice default to the bundled geometry and mesh; full: the
    whole finger instead of its half. Node sets: clamp, symmetry, tip_face; surfaces: chamber, outside. The
    labels of `NAMED_NODES` are the tip and middle nodes, on the marked side y = width / 2.

    >>> coarse = Lattice(per_bellow=2)
    >>> case = finger_case(Material(C10=0.1), lattice=coarse)
    >>> len(case.connectivity), len(case.nodes), case.element.name
    (173, 2235, 'hex27')
    >>> case.position(NAMED_NODES["tip"])
    array([110. ,  11.5,   0. ])
    """
    g, m = finger or Finger(), lattice or Lattice()
    quads, core = (_section_ring if m.ring else _section_block)(g, m)
    x = _stations(g, m)
    inside = (x[:-1] > g.base_cap - 1e-9) & (x[1:] < g.length - g.tip_cap + 1e-9)
    half = hollow_case(
        extruded(quads, x).reshape(-1, 27, 3),
        ~(inside[:, None] & core[None, :]).ravel(),
        placed=lambda reference: _round_and_fold(reference, g),
        material=material,
        marks={NAMED_NODES["tip"]: g.tip_node, NAMED_NODES["middle"]: g.middle_node},
    )
    return mirrored(half) if full else half


# The default lattice is the cheapest within 2 % of the limit on the default finger (docs/records/meshes.md).
# Six things make it too coarse on another one: long pleats or thin tops, steep pleat walls, pleats much
# deeper in the middle than at the sides, flat walls that bulge like plates, thick walls, and a chamber so
# short that its ends and corners count. `benchmarks/batches/batches.py` measures what is left.
CELL = 5.6  # top walls that a pleat is long, at most, where the default number of cells does
STEEPER = 4 / 3  # more cells along a pleat with flat crests, or sheared between middle and side
SHEARED = 0.5  # pitches that pleats are deeper in the middle than at the sides, at most, where one cell does
CELLS = 72  # along the chamber at most, where more than the default number of cells a pleat would do
CORRUGATED = 2.5  # top walls that pleats are deep, where they hold the top from bulging
SPAN = 0.85  # half the chamber's width over its height, at most, where one cell in the middle does
SHORT = 4.0  # heights that the chamber is long, at least, where its ends need no cells of their own
THICK = 0.2  # wall over half the width or over the height, at most, where one cell across it does


def lattice_of(finger: Finger) -> Lattice:
    """Lattice of cells for a finger; the default one for the default finger.

    >>> lattice_of(Finger()) == Lattice()
    True
    >>> lattice_of(Finger(side=5.0)).wall  # thick walls
    2
    """
    base = Lattice()
    half, height = finger.width / 2, finger.height
    thick = max(finger.side / half, finger.bottom / height, finger.top / height) > THICK
    short = finger.pitch * finger.bellows < SHORT * height
    sheared = _sheared(finger)
    return replace(
        base,
        per_bellow=_along(finger, base.per_bellow),
        across=_across(finger) + short,
        up=base.up + short,
        fillet=base.fillet + sheared,
        caps=base.caps + short,
        wall=2 if thick or short else base.wall,
    )


def _along(finger: Finger, least: int) -> int:
    """Cells along a pleat."""
    steep = STEEPER if finger.flatness or _sheared(finger) else 1.0
    cells = least * max(finger.pitch / (CELL * finger.top), 1.0) * steep
    return max(least, min(int(np.ceil(cells)), CELLS // finger.bellows))


def _across(finger: Finger) -> int:
    """Cells across the middle of half the chamber."""
    half = finger.width / 2 - finger.side
    high = finger.height - finger.top - finger.bottom
    plates = 1 if 2 * finger.pleat >= CORRUGATED * finger.top else 2
    return max(plates, int(np.ceil(half / (SPAN * high))))


def _sheared(finger: Finger) -> bool:
    """True if the crests fall off so steeply towards the sides that they shear the top wall."""
    return 2 * finger.pleat - finger.side_pleat > SHEARED * finger.pitch
