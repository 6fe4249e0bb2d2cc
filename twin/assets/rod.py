"""A finger as a rod of sections, in one plane: turns and lengths that a pressure gives them, and stiffness.

A section is a straight link; before each is a joint. Under a pressure p without load, joint k turns by
bend_k(p) and link k is length_k(p) long. A moment M at a joint turns it by M / bend_stiffness_k(p) more, a
force F along a link lengthens it by F / pull_stiffness_k.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
import scipy

from twin.targets import Array

VERSION = 1  # of rod.json
SWEEPS, NEAR_MM = 200, 1e-9  # of the links under a force, and how exact they are


@dataclass(frozen=True, kw_only=True)
class Rod:
    """Joints and links of a finger; x along it from the clamp, z up, bends towards -z are positive.

    pressure (k,) MPa from 0 on; rest (n + 1, 3) mm: joints at rest and the tip; bend (k, n) rad, relative to
    rest; length (k, n) mm; bend_stiffness (k, n) N mm/rad; pull_stiffness (n,) N/mm; mass (n,) tonne.
    """

    pressure: Array
    rest: Array
    bend: Array
    length: Array
    bend_stiffness: Array
    pull_stiffness: Array
    mass: Array

    @property
    def turns(self) -> Array:
        """Turns (n,) rad of the links at rest from x towards -z."""
        return turns(self.rest)

    def at(self, pressure: float) -> tuple[Array, Array]:
        """Bends (n,) rad and lengths (n,) mm at a pressure in MPa, by a cubic spline.

        >>> rod = straight(bend=0.1, length=20.0, sections=2, top=0.03)
        >>> [x.round(3).tolist() for x in rod.at(0.015)]
        [[0.05, 0.05], [10.0, 10.0]]
        """
        return self._between(self.bend, pressure), self._between(self.length, pressure)

    def stiffness_at(self, pressure: float) -> Array:
        """Stiffness (n,) N mm/rad of the joints at a pressure in MPa, by a cubic spline."""
        return self._between(self.bend_stiffness, pressure)

    def _between(self, table: Array, pressure: float) -> Array:
        return np.asarray(scipy.interpolate.CubicSpline(self.pressure, table)(pressure))

    def joints(self, bend: Array, length: Array) -> Array:
        """Places (n + 1, 3) mm of the joints and the tip where joints turn and links are long by so much."""
        turn = self.turns + np.cumsum(bend)
        steps = length[:, None] * np.stack([np.cos(turn), 0 * turn, -np.sin(turn)], axis=1)
        return self.rest[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])

    def tip(self, pressure: float, force: float = 0.0) -> Array:
        """Displacement (3,) mm of the tip at a pressure in MPa under a force in N up, along z.

        The links are in equilibrium: fixed-point sweeps, each half way.
        """
        bend, length = free, drawn = self.at(pressure)
        stiffness = self.stiffness_at(pressure)
        at = self.joints(bend, length)
        for _ in range(SWEEPS if force else 1):
            turn = self.turns + np.cumsum(bend)
            bend = (bend + free - force * (at[-1, 0] - at[:-1, 0]) / stiffness) / 2
            length = (length + drawn - force * np.sin(turn) / self.pull_stiffness) / 2
            before, at = at, self.joints(bend, length)
            if np.abs(at - before).max() < NEAR_MM:
                break
        return np.asarray(at[-1] - self.rest[-1])

    @property
    def settling(self) -> float:
        """A time in s over which a motion dies away: 2 / frequency of the first bending, which damps it
        critically where all damping is so many seconds times the stiffness. No film tells it."""
        stiffness = self.stiffness_at(self.middle)
        compliance = float(((self.rest[-1, 0] - self.rest[:-1, 0]) ** 2 / stiffness).sum())
        return 2 * float(np.sqrt(compliance * self.mass.sum() / 4))

    @property
    def middle(self) -> float:
        """Half of the highest pressure in MPa: there a simulator with one stiffness has that of the rod."""
        return float(self.pressure[-1]) / 2

    def json(self) -> str:
        """The text of rod.json."""
        arrays = {name: value.tolist() for name, value in asdict(self).items()}
        units = {"pressure": "MPa", "rest": "mm", "bend": "rad", "length": "mm", "mass": "tonne",
                 "settling": "s",
                 "bend_stiffness": "N mm/rad", "pull_stiffness": "N/mm"}  # fmt: skip
        head = {"version": VERSION, "units": units, "settling": self.settling}
        return json.dumps({**head, **arrays}, indent=1) + "\n"

    @staticmethod
    def of(data: Mapping[str, object]) -> "Rod":
        """The rod of a rod.json that was read."""
        return Rod(**{name: np.array(data[name], float) for name in Rod.__dataclass_fields__})


def turns(joints: Array) -> Array:
    """Turns (..., n) rad from x towards -z of the links between joints (..., n + 1, 3) mm.

    >>> turns(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, -1.0]])).round(3) + 0.0
    array([0.   , 1.571])
    """
    step = np.diff(joints, axis=-2)
    return np.unwrap(np.arctan2(-step[..., 2], step[..., 0]), axis=-1)


def lengths(joints: Array) -> Array:
    """Lengths (..., n) mm in the plane of the links between joints (..., n + 1, 3) mm."""
    return np.asarray(np.hypot(*np.moveaxis(np.diff(joints, axis=-2)[..., [0, 2]], -1, 0)))


def straight(*, bend: float, length: float, sections: int, top: float) -> Rod:
    """An even rod whose joints turn by `bend` rad at the pressure `top` MPa, in proportion: for tests."""
    n, share = sections, np.linspace(0, 1, 5)
    rest = np.zeros((n + 1, 3))
    rest[:, 0] = np.linspace(0, length, n + 1)
    return Rod(
        pressure=top * share, rest=rest, bend=bend * share[:, None] * np.ones(n),
        length=np.full((5, n), length / n), bend_stiffness=np.full((5, n), 200.0),
        pull_stiffness=np.full(n, 10.0), mass=np.full(n, 1e-5 / n),
    )  # fmt: skip
