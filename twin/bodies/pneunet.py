"""The PneuNet: rectangular chambers in a row over a channel, with gaps between them, on a flat bottom.

The bottom may have a sheet of paper or fabric, which keeps it from stretching (Mosadegh et al. 2014, doi
10.1002/adfm.201303288).
"""

import math
from typing import TYPE_CHECKING, ClassVar, Self

from pydantic import Field, model_validator

from twin.bodies.body import GAP, Arrow, Cells, CellTable, Place, Sketch, edge_places, marks
from twin.tablemodel import NotNegative, Positive
from twin.targets import Array

if TYPE_CHECKING:  # the finite elements are loaded by whoever needs them
    from fe import Case, Material
    from fe.element import Flags

CELL = 5.0  # thinnest walls that a cell of a wall is long, at most
EDGE = 0.25  # of a chamber's inner length, at most, that the fine cell beside its edges takes
CAP = 4.0  # mm of a cap that a cell is long, about
ON = 1e-6  # mm


class PneunetTable(CellTable):
    """Dimensions of a PneuNet: chambers in a row over a channel that joins them, with gaps between them.

    >>> PneunetTable().pitch_mm, PneunetTable().length_mm  # mm
    (13.0, 88.0)
    """

    kind: ClassVar[str] = "pneunet"
    bends_down: ClassVar[bool] = True
    remedy: ClassVar[str] = "make the walls thicker, or the chambers larger"
    inner: ClassVar[tuple[str, ...]] = (
        "side_wall_mm", "top_wall_mm", "bottom_wall_mm", "channel_width_mm", "channel_height_mm",
        "channel_roof_mm",
    )  # fmt: skip

    chambers: int = Field(default=6, ge=1, le=100, description="number of chambers")
    chamber_length_mm: Positive = Field(default=8.0, description="inner length of a chamber along x, mm")
    chamber_wall_mm: Positive = Field(default=1.5, description="thickness of the walls to the gaps, mm")
    gap_mm: Positive = Field(default=2.0, description="gap between neighbouring chambers, mm")
    width_mm: Positive = Field(default=20.0, description="width across, mm")
    height_mm: Positive = Field(default=20.0, description="height from the flat bottom, mm")
    side_wall_mm: Positive = Field(default=2.0, description="thickness of each side wall, mm")
    top_wall_mm: Positive = Field(default=2.0, description="thickness of the chambers' top, mm")
    bottom_wall_mm: Positive = Field(default=2.5, description="thickness of the bottom, mm")
    channel_width_mm: Positive = Field(default=4.0, description="width of the channel, mm")
    channel_height_mm: Positive = Field(default=2.0, description="height of the channel over the bottom, mm")
    channel_roof_mm: Positive = Field(default=2.0, description="silicone between the channel and a gap, mm")
    base_cap_mm: Positive = Field(default=10.0, description="length of solid silicone at the clamp, mm")
    tip_cap_mm: Positive = Field(default=5.0, description="length of solid silicone at the tip, mm")
    sheet_N_per_mm: NotNegative = Field(
        default=0.0, description="paper or fabric in the bottom: thickness times modulus, N/mm; 0: none"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        rules = (
            ("chamber_length_mm", self.chamber_length_mm, self.chamber_wall_mm, "chamber_wall_mm"),
            ("width_mm", self.width_mm - 2 * self.side_wall_mm, self.side_wall_mm, "side_wall_mm"),
            ("height_mm", self._ceiling - self._floor, self.top_wall_mm, "top_wall_mm"),
        )
        for key, inner, wall, wall_key in rules:
            if inner < wall:
                raise ValueError(
                    f"model.pneunet.{key} = {getattr(self, key):g}: the chamber is {inner:.3g} mm there, and "
                    f"its wall {wall_key} = {wall:g} mm is thicker; wanted {wall:g} mm of chamber or more"
                    f"{' above the gaps' if key == 'height_mm' else ''}; make {key} larger, or walls thinner"
                )
        room = self.width_mm - 2 * self.side_wall_mm
        if self.channel_width_mm >= room:
            raise ValueError(
                f"model.pneunet.channel_width_mm = {self.channel_width_mm:g}: wanted less than the chambers' "
                f"width of {room:.3g} mm; make the channel narrower, or width_mm larger"
            )
        return self

    @property
    def body(self) -> Self:
        """The PneuNet itself."""
        return self

    @property
    def length_mm(self) -> float:
        """Length from the clamp to the tip."""
        return self.base_cap_mm + self.chambers * self.pitch_mm - self._between + self.tip_cap_mm

    @property
    def pitch_mm(self) -> float:
        """Length from one chamber to the next."""
        return self.chamber_length_mm + self._between

    @property
    def waves(self) -> tuple[str, float, float]:
        """The key of what repeats along the top, and where that begins and ends, mm."""
        return "chambers", self.base_cap_mm, self.length_mm - self.tip_cap_mm

    @property
    def _between(self) -> float:
        return 2 * self.chamber_wall_mm + self.gap_mm

    @property
    def _floor(self) -> float:
        """Height of the gaps' floor, mm."""
        return self.bottom_wall_mm + self.channel_height_mm + self.channel_roof_mm

    @property
    def _ceiling(self) -> float:
        """Height of the chambers' ceiling, mm."""
        return self.height_mm - self.top_wall_mm

    @property
    def _starts(self) -> list[float]:
        """x of each chamber's end towards the clamp, mm."""
        return [self.base_cap_mm + k * self.pitch_mm for k in range(self.chambers)]

    # -- its mesh --------------------------------------------------------------------------------------------

    @property
    def lattice(self) -> Cells:
        """Cells of the walls at most CELL times as long as the thinnest is thick."""
        longest = CELL * min(self.chamber_wall_mm, self.side_wall_mm, self.top_wall_mm)
        half = self.width_mm / 2 - self.side_wall_mm - self.channel_width_mm / 2
        return Cells(
            along=math.ceil(self.chamber_length_mm / (1.5 * longest)),
            across=math.ceil(half / longest),
            up=math.ceil((self._ceiling - self._floor) / longest),
            caps=max(1, round(self.base_cap_mm / CAP)),
        )

    def case(self, lattice: Cells, material: "Material") -> "Case":
        """Half of the PneuNet on a lattice; surface `bottom`, too."""
        from dataclasses import replace

        from fe.case import Layer
        from fe.mesh.extruding import box_grid, extruded, facing, hollow_case

        x, y, z = self._stations(lattice), self._across(lattice), self._up(lattice)
        cells = extruded(box_grid(y, z), x).reshape(-1, 27, 3)
        x_at, y_at, z_at = cells.mean(axis=1).T
        void, gap = self._inside(x_at, y_at, z_at)
        case = hollow_case(
            cells[~gap], ~void[~gap], material=material, marks=marks(self.length_mm, self.width_mm / 2, 0.0)
        )
        surfaces = {**case.surfaces, "bottom": facing(case, "outside", 2, 0.0)}
        layers = (Layer("bottom", self.sheet_N_per_mm),) if self.sheet_N_per_mm else ()
        return replace(case, surfaces=surfaces, layers=layers)

    def _inside(self, x: Array, y: Array, z: Array) -> "tuple[Flags, Flags]":
        """Flags (c,) of places in mm: inside the chambers or the channel, and inside a gap."""
        start, end = self._starts[0], self._starts[-1] + self.chamber_length_mm
        along = (x - start) % self.pitch_mm
        inner, middle = along < self.chamber_length_mm, (x > start) & (x < end)
        room = (y < self.width_mm / 2 - self.side_wall_mm) & (z > self.bottom_wall_mm) & (z < self._ceiling)
        roof = self.bottom_wall_mm + self.channel_height_mm
        channel = (y < self.channel_width_mm / 2) & (z > self.bottom_wall_mm) & (z < roof)
        off = along - self.chamber_length_mm - self.chamber_wall_mm
        gap = middle & (off > 0) & (off < self.gap_mm) & (z > self._floor)
        return middle & (channel | (inner & room)), gap

    def _stations(self, lattice: Cells) -> Array:
        """Cell boundaries along x: caps, walls, chambers with a fine cell beside their ends, gaps."""
        from fe.mesh.extruding import between

        along, _, _, wall, caps = lattice.counts
        fine, n = min(self.chamber_wall_mm, EDGE * self.chamber_length_mm), lattice.refine
        stops, counts = [0.0], []
        for k, start in enumerate(self._starts):
            end = start + self.chamber_length_mm
            stops += [start, start + fine, end - fine, end]
            counts += [wall if k else caps, n, along, n]
            if k < self.chambers - 1:
                stops += [end + self.chamber_wall_mm, end + self.chamber_wall_mm + self.gap_mm]
                counts += [wall, along]
        return between([*stops, self.length_mm], [*counts, caps])

    def _across(self, lattice: Cells) -> Array:
        """Cell boundaries from the middle plane to the side."""
        from fe.mesh.extruding import between

        _, across, _, wall, _ = lattice.counts
        half, channel = self.width_mm / 2 - self.side_wall_mm, self.channel_width_mm / 2
        fine = min(self.side_wall_mm, (half - channel) / 2)
        stops = [0.0, channel, half - fine, half, self.width_mm / 2]
        return between(stops, [lattice.refine, across, lattice.refine, wall])

    def _up(self, lattice: Cells) -> Array:
        """Cell boundaries from the bottom to the top."""
        from fe.mesh.extruding import between

        _, _, up, wall, _ = lattice.counts
        fine, n = min(self.top_wall_mm, (self._ceiling - self._floor) / 3), lattice.refine
        roof = self.bottom_wall_mm + self.channel_height_mm
        stops = [0.0, self.bottom_wall_mm, roof, self._floor, self._ceiling - fine, self._ceiling]
        return between([*stops, self.height_mm], [wall, n, n, up, n, wall])

    # -- places and drawing ----------------------------------------------------------------------------------

    @property
    def places(self) -> dict[str, Place]:
        """Places along the lower edge of the side, and above it on the sides of chambers."""
        y, last = self.width_mm / 2, self.chambers - 1
        middles = [start + self.chamber_length_mm / 2 for start in self._starts]
        chosen = [middles[k] for k in sorted({0, last // 2, last})]
        off = {f"off{k + 1}": (x, y, 0.6 * self.height_mm) for k, x in enumerate(chosen)}
        return edge_places(self.length_mm, y, 0.0) | off

    @property
    def sketch(self) -> Sketch:
        """Its dimensions; the cut across goes through a chamber and a gap, or the end cap of a single one."""
        gap, wide, w, h = GAP * self.length_mm, 1.6 * GAP * self.width_mm, self.width_mm / 2, self.height_mm
        start, b = self._starts[(self.chambers - 1) // 2], self.bottom_wall_mm
        end, last = start + self.chamber_length_mm, self._starts[-1] + self.chamber_length_mm
        wall, middle = self.chamber_wall_mm, start + self.chamber_length_mm / 2
        several, top = self.chambers > 1, end + wall
        gaps, low = f"wall {wall:g}, gap {self.gap_mm:g}", self._floor
        ground = low - self.channel_roof_mm
        beyond = top + self.gap_mm / 2 if several else last + self.tip_cap_mm / 2
        row = f"{self.chambers} chambers of {self.chamber_length_mm:g}"
        channel = f"channel {self.channel_width_mm:g} x {self.channel_height_mm:g}"
        return Sketch(
            side=(
                Arrow(f"cap {self.base_cap_mm:g}", (0.0, h), (self.base_cap_mm, h), gap),
                Arrow(row, (self.base_cap_mm, h), (last, h), gap),
                Arrow(f"tip cap {self.tip_cap_mm:g}", (last, h), (self.length_mm, h), gap),
            ),
            along=(
                Arrow(f"height {h:g}", (0.0, 0.0), (0.0, h), gap),
                Arrow(f"bottom {b:g}", (middle, 0.0), (middle, b)),
                Arrow(f"top {self.top_wall_mm:g}", (middle, self._ceiling), (middle, h)),
                Arrow(f"chamber {self.chamber_length_mm:g}", (start, h), (end, h), gap),
                *(
                    Arrow(gaps, (top, h), (top + self.gap_mm, h), 2.2 * gap),
                    Arrow(f"roof {low - ground:g}", (beyond, ground), (beyond, low)),
                )[: 2 * several],
            ),
            across=(
                Arrow(f"width {self.width_mm:g}", (-w, 0.0), (w, 0.0), -wide),
                Arrow(f"side {self.side_wall_mm:g}", (-w, h / 2), (self.side_wall_mm - w, h / 2)),
                Arrow(channel, (0.0, b), (self.channel_width_mm / 2, b)),
            ),
            left=middle, right=beyond, names="chamber | gap" if several else "chamber | cap",
            note=f"a sheet of {self.sheet_N_per_mm:g} N/mm lies in the bottom" if self.sheet_N_per_mm else "",
        )  # fmt: skip
