"""The tube: round or rectangular, with one chamber that may lie off its axis, so that it bends.

A section is an O-grid: a core, a ring around it up to the chamber's surface, and the wall. In the end caps
all of it is silicone; between them core and ring are the chamber.
"""

import math
from typing import TYPE_CHECKING, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from twin.bodies.body import GAP, Arrow, Cells, CellTable, Place, Sketch, edge_places, marks
from twin.tablemodel import Finite, NotNegative, Positive
from twin.targets import Array

if TYPE_CHECKING:  # the finite elements are loaded by whoever needs them
    from fe import Case, Material

CORE, ROUND = 0.5, 0.3  # of the chamber: the core's size, and how much of a circle its outline has
SLENDER = 20.0  # chamber widths over a wall, at most: a thinner one is a film
CELL = 4.0  # walls of length of a cell along the tube, about
ASPECT = 6.0  # walls that a cell along the outline is long, at most
MOST = 40  # cells along it
THICK = 0.3  # of half the chamber that a wall is thick, at most, where one cell across it does


class TubeTable(CellTable):
    """Dimensions of a tube with a chamber, closed by caps at both ends. A chamber above the axis bends it
    down."""

    kind: ClassVar[str] = "tube"
    bends_down: ClassVar[bool] = False
    remedy: ClassVar[str] = "make the walls thicker, or edge_radius_mm smaller"
    inner: ClassVar[tuple[str, ...]] = (
        "chamber_width_mm", "chamber_height_mm", "offset_mm", "base_cap_mm", "tip_cap_mm",
    )  # fmt: skip

    section: Literal["round", "rectangular"] = Field(
        default="round", description="round: a circle, or an ellipse where width and height differ"
    )
    length_mm: Positive = Field(default=80.0, description="length from the clamp to the tip, mm")
    width_mm: Positive = Field(default=16.0, description="outer width, mm")
    height_mm: Positive = Field(default=16.0, description="outer height, mm")
    chamber_width_mm: Positive = Field(default=11.0, description="width of the chamber, mm")
    chamber_height_mm: Positive = Field(default=11.0, description="height of the chamber, mm")
    offset_mm: Finite = Field(default=1.5, description="how far the chamber lies above the axis, mm; - below")
    edge_radius_mm: NotNegative = Field(
        default=1.5, description="radius of the chamber's edges along a rectangular tube, mm"
    )
    base_cap_mm: Positive = Field(default=5.0, description="length of solid silicone at the clamp, mm")
    tip_cap_mm: Positive = Field(default=5.0, description="length of solid silicone at the tip, mm")
    fibre_N_per_mm: NotNegative = Field(
        default=0.0,
        description="fibres wound around the tube: thickness times modulus of the layer, N/mm; 0: none",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        side, upright = (a - b for a, b in zip(self._half, self._inner, strict=True))
        walls = {
            "chamber_width_mm": (side, "the side walls"),
            "chamber_height_mm": (upright - abs(self.offset_mm), "the wall it is nearest to"),
        }
        for key, (wall, which) in walls.items():
            size = getattr(self, key)
            if wall < size / SLENDER:
                raise ValueError(
                    f"model.tube.{key} = {size:g}: it leaves {wall:.3g} mm for {which}; wanted "
                    f"{size / SLENDER:.3g} mm or more; make the chamber smaller, "
                    f"{key.removeprefix('chamber_')} larger, or offset_mm nearer to 0"
                )
        if (chamber := self._chamber[1] - self._chamber[0]) < max(self._inner):
            raise ValueError(
                f"model.tube.length_mm = {self.length_mm:g}: the caps of {self.base_cap_mm:g} and "
                f"{self.tip_cap_mm:g} mm leave {chamber:.3g} mm for the chamber; wanted "
                f"{max(self._inner):.3g} mm or more, half its width; make the tube longer, or caps shorter"
            )
        if self.section == "rectangular" and self.edge_radius_mm > 0.8 * min(self._inner):
            raise ValueError(
                f"model.tube.edge_radius_mm = {self.edge_radius_mm:g}: wanted "
                f"{0.8 * min(self._inner):.3g} mm or less, 0.4 of the chamber's smaller side; make it less, "
                'or state section = "round"'
            )
        return self

    @property
    def body(self) -> Self:
        """The tube itself."""
        return self

    @property
    def _half(self) -> tuple[float, float]:
        """Half of the outer width and height, mm."""
        return self.width_mm / 2, self.height_mm / 2

    @property
    def _inner(self) -> tuple[float, float]:
        """Half of the chamber's width and height, mm."""
        return self.chamber_width_mm / 2, self.chamber_height_mm / 2

    @property
    def _chamber(self) -> tuple[float, float]:
        """x of the chamber's ends, mm."""
        return self.base_cap_mm, self.length_mm - self.tip_cap_mm

    @property
    def _thin(self) -> float:
        """The thinnest wall, mm."""
        return min(self._half[0] - self._inner[0], self._half[1] - self._inner[1] - abs(self.offset_mm))

    @property
    def _thick(self) -> float:
        """The thickest wall, mm."""
        return max(self._half[0] - self._inner[0], self._half[1] - self._inner[1] + abs(self.offset_mm))

    @property
    def _side_height(self) -> float:
        """Height of the markers' line on the side: the widest place of a round tube, else the lower edge."""
        return self.height_mm / 2 if self.section == "round" else 0.0

    # -- its mesh --------------------------------------------------------------------------------------------

    @property
    def lattice(self) -> Cells:
        """Cells by the thinnest wall: at most ASPECT of it along the outline, about CELL of it along x."""
        start, end = self._chamber
        across, up = (max(2, math.ceil(size / (ASPECT * self._thin))) for size in self._inner)
        along = math.ceil((end - start) / (CELL * (self._half[1] - self._inner[1])))
        wall = 2 if self._thick > THICK * max(self._inner) else 1
        return Cells(along=min(max(along, 4), MOST), across=across, up=up, wall=wall)

    def case(self, lattice: Cells, material: "Material") -> "Case":
        """Half of the tube on a lattice; surface `around`, around it without its ends, too."""
        from dataclasses import replace

        from fe.case import Layer
        from fe.mesh.extruding import between, extruded, facing, hollow_case

        along, across, up, wall, caps = lattice.counts
        quads, inner = _section(across, up, wall, lattice.refine)
        start, end = self._chamber
        fine = min(self._thin, (end - start) / 4)
        stops = [0.0, start, start + fine, end - fine, end, self.length_mm]
        x = between(stops, [caps, lattice.refine, along, lattice.refine, caps])
        middle = (x[1:] + x[:-1]) / 2
        void = ((middle > start) & (middle < end))[:, None] & inner
        case = hollow_case(
            extruded(quads, x).reshape(-1, 27, 3), ~void.ravel(), material=material,
            placed=lambda p: np.column_stack([p[:, 0], self._placed(p[:, 1], p[:, 2], lattice)]),
            marks=marks(self.length_mm, self._half[0], self._side_height),
        )  # fmt: skip
        ends = np.concatenate([facing(case, "outside", 0, x) for x in (0.0, self.length_mm)])
        outside = case.surfaces["outside"]
        around = outside[~(outside[:, None] == ends).all(axis=2).any(axis=1)]
        layers = (Layer("around", self.fibre_N_per_mm, wound=True),) if self.fibre_N_per_mm else ()
        return replace(case, surfaces={**case.surfaces, "around": around}, layers=layers)

    def _placed(self, a: Array, b: Array, lattice: Cells) -> Array:
        """Places (n, 2) mm, y and z, of the O-grid's points a, b: the core where both are up to 1, the
        chamber up to 2, the wall up to 3."""
        m = np.maximum(np.abs(a), np.abs(b))
        inner, outer = self._outlines(a, b, m, lattice)
        centre = np.array([0.0, self.height_mm / 2 + self.offset_mm])
        square = np.column_stack([a, b]) * self._inner
        core = CORE * ((1 - ROUND) * square + ROUND * m[:, None] * (inner - centre))
        reach = np.minimum(1 / np.maximum(m, 1e-12), 1.0)[:, None]  # from a point to the core's outline
        edge = CORE * ((1 - ROUND) * square * reach + ROUND * (inner - centre))
        ring = np.clip(m - 1, 0, 1)[:, None]
        chamber = centre + np.where(m[:, None] <= 1, core, edge * (1 - ring) + ring * (inner - centre))
        depth = np.clip(m - 2, 0, 1)[:, None]
        return np.where(m[:, None] <= 2, chamber, inner * (1 - depth) + outer * depth)

    def _outlines(self, a: Array, b: Array, m: Array, lattice: Cells) -> tuple[Array, Array]:
        """Places (n, 2) mm on the chamber's outline and on the tube's, in the direction of points a, b."""
        upright = np.abs(a) >= np.abs(b)  # on the side, not on bottom or top
        q = np.where(upright, b, a) / np.maximum(m, 1e-12)
        high = self.height_mm / 2
        if self.section == "round":
            angle = np.where(upright, q * np.pi / 4, np.sign(b) * (np.pi / 2 - q * np.pi / 4))
            unit = np.column_stack([np.cos(angle), np.sin(angle)])
            unit[np.abs(a) < 1e-12, 0] = 0.0  # exactly on the plane of symmetry
            return unit * self._inner + [0.0, high + self.offset_mm], unit * self._half + [0.0, high]
        (w, h), r = self._inner, self.edge_radius_mm
        # an arc takes the last cell of each side
        cells = np.where(upright, lattice.up, lattice.across)
        straight = (cells - 1) / cells
        bend = np.clip((np.abs(q) - straight) / (1 - straight), 0, 1)
        near = np.clip(np.abs(q) / straight, 0, 1)
        side, sign = np.where(upright, h, w) - r, np.sign(q)
        along = sign * (near * side + r * np.sin(bend * np.pi / 4))
        outward = np.where(upright, 1.0, np.sign(b))
        out = outward * (np.where(upright, w, h) - r * (1 - np.cos(bend * np.pi / 4)))
        inner = np.where(upright[:, None], np.column_stack([out, along]), np.column_stack([along, out]))
        inner += np.array([0.0, high + self.offset_mm])
        # spokes of the wall are square to its straight parts
        foot = sign * near * side + np.where(upright, high + self.offset_mm, 0.0)
        corner = np.where(upright, high + sign * high, self._half[0])
        reached = foot + bend * (corner - foot)
        face = np.where(upright, self._half[0], high + np.sign(b) * high)
        outer = np.where(upright[:, None], np.column_stack([face, reached]), np.column_stack([reached, face]))
        return inner, outer

    # -- places and drawing ----------------------------------------------------------------------------------

    @property
    def places(self) -> dict[str, Place]:
        """Places along the side of a round tube or the lower edge of a rectangular one, and off that line."""
        (w, h), lift = self._half, 0.5 if self.section == "round" else 0.6
        z = h * (1 + lift) if self.section == "round" else self.height_mm * lift
        y = w * math.sqrt(1 - lift**2) if self.section == "round" else w
        off = {f"off{k + 1}": (x * self.length_mm, y, z) for k, x in enumerate((0.25, 0.5, 0.75, 0.9))}
        return edge_places(self.length_mm, w, self._side_height) | off

    @property
    def sketch(self) -> Sketch:
        """Its dimensions."""
        (w, h), (start, end), gap = self._half, self._chamber, GAP * self.length_mm
        low, high = (h + self.offset_mm + side * self._inner[1] for side in (-1, 1))
        wide, middle = 1.6 * GAP * self.width_mm, self.length_mm / 2
        level, inner = (low + high) / 2, self._inner[0]
        notes = [f"fibres of {self.fibre_N_per_mm:g} N/mm are wound around it"] if self.fibre_N_per_mm else []
        if self.section == "rectangular":
            notes.append(f"the chamber's edges have a radius of {self.edge_radius_mm:g}")
        return Sketch(
            side=(
                Arrow(f"cap {self.base_cap_mm:g}", (0.0, 2 * h), (start, 2 * h), gap),
                Arrow(f"chamber {end - start:.4g}", (start, 2 * h), (end, 2 * h), gap),
                Arrow(f"tip cap {self.tip_cap_mm:g}", (end, 2 * h), (self.length_mm, 2 * h), gap),
            ),
            along=(
                Arrow(f"height {2 * h:g}", (0.0, 0.0), (0.0, 2 * h), gap),
                Arrow(f"bottom {low:.3g}", (middle, 0.0), (middle, low)),
                Arrow(f"chamber {self.chamber_height_mm:g}", (middle, low), (middle, high)),
                Arrow(f"top {2 * h - high:.3g}", (middle, high), (middle, 2 * h)),
            ),
            across=(
                Arrow(f"width {2 * w:g}", (-w, 0.0), (w, 0.0), -wide),
                Arrow(f"chamber {self.chamber_width_mm:g}", (-inner, level), (inner, level)),
            ),
            left=middle, right=middle, note="; ".join(notes),
        )  # fmt: skip


def _section(across: int, up: int, wall: int, ring: int) -> tuple[Array, "NDArray[np.bool_]"]:
    """Quadrilaterals (c, 4, 2) of half an O-grid, and which of them lie inside the wall."""
    from fe.mesh.extruding import box_grid, grid_quads, path

    y, z = np.arange(across + 1) / across, np.arange(-up, up + 1) / up
    core = box_grid(y, z)
    line = np.concatenate([path(y, -1.0), path(1.0, z[1:]), path(y[-2::-1], 1.0)])
    rings = [
        grid_quads(line[:, None] * (start + np.arange(count + 1) / count)[:, None])[:, [0, 3, 2, 1]]
        for start, count in ((1.0, ring), (2.0, wall))
    ]  # counter-clockwise
    quads = np.concatenate([core, *rings])
    return quads, np.arange(len(quads)) < len(core) + len(rings[0])
