"""The pneumatic arm of arXiv 2201.12560 as a deck: a cylinder with four chambers in its quadrants.

    python benchmarks/kernel/arm.py FILE [--rib MM]

Published: length, radius, outer wall, square bore and its wall, end cap. Not published, and assumed: ribs of
2.3 mm between the chambers, a cap at the clamp like that at the tip, a bore that is open at both ends, square
corners. The half y >= 0 is meshed; the upper chamber carries the pressure. The sides of the bore's wall are
the surface `strain_limiting_layer`, on which the effect of this name lies: near the axis, as hoses through
the bore would, it keeps the arm from lengthening and little from bending.
"""

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np

from fe import Case, Material
from fe.element import Array, Flags, Integers
from fe.engines.writer import deck
from fe.mesh.extruding import between, extruded, grid_quads, hollow_case

SILICONE = Material(C10=0.03, C01=0.014, density=1.07e-9)  # E 0.264 MPa as published, 1070 kg/m3
FRAME_MPA = 100.0  # C10 of a frame: any that is far stiffer than silicone serves
MARKS = {4401: (100.0, 0.0, -22.2), 5848: (50.0, 0.0, -22.2)}


@dataclass(frozen=True)
class Arm:
    """Dimensions in mm; cells: along the chambers, along a chamber's side (half of it), across it."""

    length: float = 100.0
    radius: float = 22.2
    wall: float = 2.03
    bore: float = 10.11 / np.sqrt(2)  # half of its side
    inner: float = 2.27  # wall between bore and chambers
    rib: float = 2.3
    cap: float = 6.93
    framed: bool = False  # a stiff frame holds the cap at the tip
    cells: tuple[int, int, int] = (8, 2, 1)

    def case(self, material: Material = SILICONE) -> Case:
        """The half y >= 0, clamped at x = 0; surfaces chamber (the upper one), other (the lateral one and
        the lower one) and outside."""
        along, side, across = self.cells
        x = between([0.0, self.cap, self.length - self.cap, self.length], [1, along, 1])
        quads, void = self._section(side, across)
        middle = (x[1:] + x[:-1]) / 2
        hollow = ((middle > self.cap) & (middle < self.length - self.cap))[:, None] & void
        case = hollow_case(
            extruded(quads, x).reshape(-1, 27, 3), ~hollow.ravel(), material=material, marks=MARKS,
            placed=lambda p: np.column_stack([p[:, 0], self._placed(p[:, 1:])]),
        )  # fmt: skip
        case = _only_above(case)
        case = replace(case, surfaces={**case.surfaces, "strain_limiting_layer": self._sides_of_bore(case)})
        return self._in_frame(case, material) if self.framed else case

    def _sides_of_bore(self, case: Case) -> Integers:
        """The faces (f, 2) of the bore's wall to the sides of the axis, between the ribs."""
        faces = case.surfaces["outside"]
        x = case.nodes[case.nodes_of_faces(faces)]
        aside = (np.abs(x[..., 1] - self.bore) < 0.1 * self.bore).all(axis=1)
        between_ribs = np.abs(x[..., 2]).max(axis=1) < self._edge * self.bore + 0.1
        return np.asarray(faces[aside & between_ribs & (np.ptp(x[..., 0], axis=1) > 0)])

    def _in_frame(self, case: Case, material: Material) -> Case:
        """The case whose cap at the tip is as stiff as plastic is beside silicone."""
        x = case.nodes[case.connectivity][..., 0].mean(axis=1)
        cap = x > self.length - self.cap
        sets = {"body": np.flatnonzero(~cap), "frame": np.flatnonzero(cap)}
        stiff = replace(material, C10=FRAME_MPA, C01=0.0)
        return replace(case, element_sets=sets, materials={"body": material, "frame": stiff}, kept=("frame",))

    @property
    def _edge(self) -> float:
        """Share of half a chamber's side at which the rib begins."""
        return 1 - self.rib / np.sqrt(2) / (self.bore + self.inner)

    def _section(self, side: int, across: int) -> tuple[Array, Flags]:
        """Reference quadrilaterals (c, 4, 2) of half a section, rings of squares, and which are chambers."""
        half = np.append(np.linspace(0.0, self._edge, side + 1), 1.0)
        whole = np.concatenate([-half[:0:-1], half])  # along a side, from corner to corner
        one = np.ones(len(whole))
        line = np.concatenate([
            np.stack([half, one[: len(half)]], axis=1),
            np.stack([one, -whole], axis=1)[1:],
            np.stack([half[::-1], -one[: len(half)]], axis=1)[1:],
        ])  # fmt: skip
        levels = np.array([1.0, 2.0, *(2 + np.arange(1, across + 1) / across), 4.0])
        quads = grid_quads(line[:, None] * levels[:, None])
        middle = np.abs((line[1:] + line[:-1]) / 2).min(axis=1)
        return quads, ((middle < self._edge)[:, None] & [False, *[True] * across, False]).ravel()

    def _placed(self, p: Array) -> Array:
        """Places (n, 2) mm of reference points: level 1 is the bore, 2 its wall, 3 the outer wall, 4 the
        skin."""
        level = np.abs(p).max(axis=1)
        line = p / level[:, None]
        rings = [self.bore * line, (self.bore + self.inner) * line]
        rings += [self._ring(line, r) for r in (self.radius - self.wall, self.radius)]
        weights = np.maximum(1 - np.abs(level - np.arange(1, 5)[:, None]), 0.0)
        return np.einsum("kn,knd->nd", weights, np.array(rings))

    def _ring(self, line: Array, radius: float) -> Array:
        """Places (n, 2) mm on a circle: ribs keep their thickness, chambers are divided by their angle."""
        y, z = line.T
        small = np.minimum(np.abs(y), np.abs(z))  # 0 in a chamber's middle, 1 in a rib's
        off = np.arcsin(self.rib / 2 / radius)
        away = np.interp(small, [0.0, self._edge, 1.0], [np.pi / 4, off, 0.0])  # from the rib's middle
        flat = np.abs(z) < np.abs(y)
        angle = np.sign(z) * np.where(flat, np.pi / 4 - away, np.pi / 4 + away)
        out = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        out[y < 1e-12, 0] = 0.0
        return out


def _only_above(case: Case) -> Case:
    """The case whose chamber is the upper one; the others are `other`, the bore belongs to `outside`."""
    faces = case.surfaces["chamber"]
    places = case.nodes[case.face_nodes("chamber")].mean(axis=1)
    above = places[:, 2] > np.abs(places[:, 1])
    surfaces = {**case.surfaces, "chamber": faces[above], "other": faces[~above]}
    return replace(case, surfaces=surfaces)


def main() -> None:
    """Write the deck."""
    file = {"nargs": 1, "help": "the deck to write"}
    typed = options(__doc__, {"file": file, "--rib": (2.3, "thickness of the ribs, mm")})
    Path(typed.file[0]).write_text(deck(Arm(rib=typed.rib).case(), 0.01))


if __name__ == "__main__":
    main()
