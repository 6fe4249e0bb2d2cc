"""The bellows finger: its dimensions in the table [model.finger], whether they fit together, and its mesh.

The mesh itself is made in `fe.mesh.finger`, as users of the finite elements alone have it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from twin.bodies.body import GAP, Arrow, Place, Sketch
from twin.tablemodel import NotNegative, Positive, TableModel

if TYPE_CHECKING:  # the finite elements are loaded by whoever needs them
    from fe import Case, Finger, Lattice, Material

FLATNESS = {"round": 0.0, "flat": 1.2}  # of `fe.Finger`, by the profile of the pleats
STEEPEST = 3.0  # slope of a pleat's wall, 72 degrees: beyond it the cells of the mesh are too oblique
ROOM = 0.5  # of the radius: what the chamber has beside its rounded edges, at least
PHASES = 60  # of half a pleat, at which the height of the chamber is looked at
# Dimensions of the chamber alone, as twin.toml and as `fe.Finger` name them.
INNER = {
    "side_wall_mm": "side", "bottom_wall_mm": "bottom", "top_wall_mm": "top", "base_cap_mm": "base_cap",
    "tip_cap_mm": "tip_cap", "edge_radius_mm": "radius",
}  # fmt: skip
PITCH = 1.5  # walls of the top that a bellow is long, at least


class FingerTable(TableModel):
    """Your own finger's dimensions; take away the # to state them. `twin look` draws them."""

    length_mm: Positive = Field(default=110.0, description="length from the clamp to the tip, mm")
    width_mm: Positive = Field(default=23.0, description="width across, mm")
    height_mm: Positive = Field(default=20.0, description="height from the flat bottom to the crests, mm")
    side_wall_mm: Positive = Field(default=2.0, description="thickness of each side wall, mm")
    bottom_wall_mm: Positive = Field(default=2.5, description="thickness of the bottom, mm")
    top_wall_mm: Positive = Field(default=2.0, description="thickness of the pleated top wall, mm")
    base_cap_mm: Positive = Field(default=4.0, description="length of solid silicone at the clamp, mm")
    tip_cap_mm: Positive = Field(default=6.0, description="length of solid silicone at the tip, mm")
    pleats: int = Field(default=9, ge=1, le=1000, description="number of pleats (bellows)")
    pleat_depth_mm: NotNegative = Field(
        default=7.6, description="depth of the top's pleats, crest to valley, mm; 0: none"
    )
    side_pleat_depth_mm: NotNegative = Field(
        default=2.8, description="depth of the pleats of each side wall, mm"
    )
    pleat_profile: Literal["round", "flat"] = Field(
        default="round", description="round: a cosine; flat: wider crests and valleys"
    )
    edge_radius_mm: Positive = Field(default=1.0, description="radius of all inner edges of the chamber, mm")

    @property
    def finger(self) -> "Finger":
        """The finger as `fe` has it, its tip and middle node in their places."""
        from fe import Finger
        from fe.mesh.finger import marked

        return marked(
            Finger(
                length=self.length_mm, width=self.width_mm, height=self.height_mm, side=self.side_wall_mm,
                bottom=self.bottom_wall_mm, top=self.top_wall_mm, base_cap=self.base_cap_mm,
                tip_cap=self.tip_cap_mm, bellows=self.pleats, pleat=self.pleat_depth_mm / 2,
                side_pleat=self.side_pleat_depth_mm, flatness=FLATNESS[self.pleat_profile],
                radius=self.edge_radius_mm,
            )
        )  # fmt: skip

    @property
    def body(self) -> "BuiltIn":
        """The finger on the lattice that its dimensions ask for."""
        return BuiltIn.of(self.finger)

    @property
    def pitch_mm(self) -> float:
        """Length of one pleat."""
        return (self.length_mm - self.base_cap_mm - self.tip_cap_mm) / self.pleats

    @property
    def waves(self) -> tuple[str, float, float] | None:
        """The key of what repeats along the top, and where that begins and ends, mm; None without pleats."""
        return ("pleats", self.base_cap_mm, self.length_mm - self.tip_cap_mm) if self.pleat_depth_mm else None

    @property
    def clearance_mm(self) -> float:
        """Height of the chamber where the pleats are lowest, in mm. A steep wall is thicker upwards."""
        t, lowest = self, math.inf
        k, depth = FLATNESS[t.pleat_profile], t.pleat_depth_mm / 2
        for phase in (math.pi * n / PHASES for n in range(PHASES + 1)):
            bent = math.tanh(k * math.cos(phase)) if k else math.cos(phase)
            wave = bent / math.tanh(k) if k else bent
            steep = k * (1 - bent**2) / math.tanh(k) if k else 1.0
            slope = 2 * math.pi * depth / t.pitch_mm * steep * math.sin(phase)
            wall = t.top_wall_mm * (1 + math.hypot(1.0, slope)) / 2
            lowest = min(lowest, t.height_mm - wall - depth * (1 + wave))
        return lowest - t.bottom_wall_mm

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for check in (_check_length, _check_width, _check_height, _check_pleats):
            check(self)
        return self


def _check_length(t: FingerTable) -> None:
    chamber, least = t.length_mm - t.base_cap_mm - t.tip_cap_mm, (4 + 2 * ROOM) * t.edge_radius_mm
    if chamber < least:
        raise ValueError(
            f"model.finger.length_mm = {t.length_mm:g}: the caps of {t.base_cap_mm:g} and {t.tip_cap_mm:g} "
            f"mm leave {chamber:.3g} mm for the chamber; wanted {least:.3g} mm or more for edges of radius "
            f"{t.edge_radius_mm:g} mm; make the finger longer, or the caps shorter"
        )
    if t.pitch_mm < PITCH * t.top_wall_mm:
        raise ValueError(
            f"model.finger.pleats = {t.pleats}: each is {t.pitch_mm:.3g} mm long; wanted "
            f"{PITCH * t.top_wall_mm:.3g} mm or more for a top wall of {t.top_wall_mm:g} mm; state fewer "
            "pleats, or a thinner top wall"
        )


def _check_width(t: FingerTable) -> None:
    half, least = t.width_mm / 2 - t.side_wall_mm - t.side_pleat_depth_mm, (1 + ROOM) * t.edge_radius_mm
    if half < least:
        raise ValueError(
            f"model.finger.width_mm = {t.width_mm:g}: side walls of {t.side_wall_mm:g} mm with pleats of "
            f"{t.side_pleat_depth_mm:g} mm leave {half:.3g} mm for half of the chamber's width; wanted "
            f"{least:.3g} mm or more for edges of radius {t.edge_radius_mm:g} mm; make the finger wider, or "
            "walls, pleats or radius smaller"
        )


def _check_height(t: FingerTable) -> None:
    clearance, least = t.clearance_mm, (2 + ROOM) * t.edge_radius_mm
    if clearance < least:
        raise ValueError(
            f"model.finger.height_mm = {t.height_mm:g}: the bottom of {t.bottom_wall_mm:g} mm, the top wall "
            f"of {t.top_wall_mm:g} mm and pleats of {t.pleat_depth_mm:g} mm leave {clearance:.3g} mm for the "
            f"chamber in the valleys; wanted {least:.3g} mm or more for edges of radius {t.edge_radius_mm:g} "
            "mm; make the finger higher, or walls, pleats or radius smaller"
        )


def _check_pleats(t: FingerTable) -> None:
    k = FLATNESS[t.pleat_profile]
    steepest = math.pi * t.pleat_depth_mm / t.pitch_mm * (k / math.tanh(k) if k else 1.0)
    if steepest > STEEPEST:
        deepest = STEEPEST / steepest * t.pleat_depth_mm
        raise ValueError(
            f"model.finger.pleat_depth_mm = {t.pleat_depth_mm:g}: on pleats {t.pitch_mm:.3g} mm long with a "
            f"{t.pleat_profile} profile their walls are too steep to mesh; wanted {deepest:.3g} mm or less; "
            "state shallower or fewer pleats"
        )


# -- its mesh and its drawing ------------------------------------------------------------------------------


def _study() -> "tuple[Finger, Lattice]":
    from fe import Finger, Lattice

    return Finger(), Lattice()


@dataclass(frozen=True)
class BuiltIn:
    """The bellows finger as a `Body`: its dimensions in mm, and the lattice that divides it into elements. By
    default the reference study's."""

    finger: "Finger" = field(default_factory=lambda: _study()[0])
    lattice: "Lattice" = field(default_factory=lambda: _study()[1])
    kind: ClassVar[str] = "finger"
    inner: ClassVar[tuple[str, ...]] = tuple(INNER)
    bends_down: ClassVar[bool] = True
    remedy: ClassVar[str] = "make the pleats shallower or fewer, or the walls thinner"

    @staticmethod
    def of(finger: "Finger") -> "BuiltIn":
        """A finger on the lattice that its dimensions ask for."""
        from fe.mesh.finger import lattice_of

        return BuiltIn(finger, lattice_of(finger))

    def size(self, dimension: str) -> float:
        """One of the dimensions in `inner`, mm."""
        return float(getattr(self.finger, INNER[dimension]))

    def larger(self, dimension: str, mm: float) -> "BuiltIn":
        """The finger with one of its dimensions larger by mm, on the same lattice."""
        name = INNER[dimension]
        return replace(self, finger=replace(self.finger, **{name: getattr(self.finger, name) + mm}))

    def case(self, lattice: "Lattice", material: "Material") -> "Case":
        """Half of the finger on a lattice."""
        from fe import finger_case

        return finger_case(material, finger=self.finger, lattice=lattice)

    def key(self, lattice: "Lattice") -> str:
        """A fingerprint of dimensions and lattice."""
        from fe.case import digest

        return digest(self.finger, lattice)

    def finer(self, lattice: "Lattice") -> "Mapping[str, Lattice]":
        """The refined lattices; the last is finer in every direction and of the other topology."""
        bellow = max(lattice.per_bellow + 1, round(4 / 3 * lattice.per_bellow))
        section = replace(lattice, fillet=2 * lattice.fillet, across=2 * lattice.across, up=2 * lattice.up)
        check = replace(section, fillet=lattice.fillet, ring=not lattice.ring)
        return {
            "bellows": replace(lattice, per_bellow=bellow),
            "walls": replace(lattice, wall=2 * lattice.wall),
            "section": section,
            "bellows and walls": replace(lattice, per_bellow=bellow, wall=2 * lattice.wall),
            "check": replace(check, per_bellow=bellow, wall=2 * lattice.wall),
        }

    @property
    def places(self) -> dict[str, Place]:
        """Places along the flat lower edge of the side face (the tip last), and above it on the crests of the
        side face."""
        g, y = self.finger, self.finger.width / 2
        edge = np.linspace(0.3, 0.9, 6) * g.length
        crests = g.base_cap + g.pitch * (np.unique(np.linspace(0, g.bellows - 1, 3).round()) + 0.5)
        places = {f"p{k + 1}": (float(x), y, 0.0) for k, x in enumerate(edge)} | {"tip": (g.length, y, 0.0)}
        places |= {f"off{k + 1}": (float(x), y, 12.0) for k, x in enumerate(crests)}
        return places | {"off4": (float(crests[len(crests) // 2]), y, 16.0)}

    @property
    def sketch(self) -> Sketch:
        """Its dimensions; the cut across goes through a crest and a valley."""
        g, w, gap = self.finger, self.finger.width / 2, GAP * self.finger.length
        valley = g.base_cap + g.pitch * max(1, g.bellows // 2)  # of a single pleat the end
        start, end = g.base_cap, g.length - g.tip_cap
        crest, lowest = valley - g.pitch / 2, g.height - 2 * g.pleat
        wide = 1.6 * GAP * g.width
        return Sketch(
            side=(
                Arrow(f"cap {g.base_cap:g}", (0.0, g.height), (start, g.height), gap),
                Arrow(f"{g.bellows} pleats of {g.pitch:.3g}", (start, g.height), (end, g.height), gap),
                Arrow(f"tip cap {g.tip_cap:g}", (end, g.height), (g.length, g.height), gap),
            ),
            along=(
                Arrow(f"height {g.height:g}", (0.0, 0.0), (0.0, g.height), gap),
                Arrow(f"bottom {g.bottom:g}", (crest, 0.0), (crest, g.bottom)),
                Arrow(f"top {g.top:g}", (crest, g.height - g.top), (crest, g.height)),
                Arrow(f"pleat depth {2 * g.pleat:g}", (g.length, lowest), (g.length, g.height), -gap),
            )[: 4 if g.pleat else 3],
            across=(
                Arrow(f"width {g.width:g}", (-w, 0.0), (w, 0.0), -wide),
                Arrow(f"side {g.side:g}", (-w, g.height / 2), (g.side - w, g.height / 2)),
                Arrow(f"side pleats {g.side_pleat:g}", (w - g.side_pleat, lowest), (w, lowest), wide),
            )[: 3 if g.side_pleat else 2],
            left=crest, right=valley, names="crest | valley",
            note=f"inner edges have a radius of {g.radius:g}",
        )  # fmt: skip
