"""Separability of C10 and C01: the accuracy of their share after further displacement readings.

To first order a reading adds the outer product of its derivative, in units of its error, to the Fisher
information on the constants (design of experiments: doi:10.1137/1.9780898719109). No reading is simulated and
the model is taken as exact, so these are limits set by geometry and material.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fe import Case, Path
from twin.effects.protocol import Unsolvable
from twin.laws.law import Constants
from twin.model.prediction import Model
from twin.records import Record
from twin.targets import Array, Targets

LEVELS = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)  # reading pressures, of the top pressure
ALONG = 8  # candidate nodes along the line on which the markers sit
KNOWN = 0.1  # sd of the share C01 / (C10 + C01) below which the constants count as separated
UNKNOWN = 1 / math.sqrt(12)  # sd of a uniform share between 0 and 1
SINGULAR = 1e-10  # least ratio of the eigenvalues of an information that determines both constants


class Separation(Record):
    """Accuracy of the share C01 / (C10 + C01) under some readings."""

    share_sd: float | None = Field(description="null where it is left open")
    correlation: float
    wanted_sd_mm: float | None = Field(description="error of all readings for a `share_sd` of 0.1")

    @classmethod
    def of(cls, information: Array, constants: Constants, sd_mm: float, **fields: Any) -> Self:
        """Accuracy from the Fisher information (2, 2) in 1/MPa2 of readings with an error sd_mm.

        The information is on C10 and C01. The share is s = C01 / (C10 + C01) with the gradient g =
        (-C01, C10) / (C10 + C01)^2, and var(s) = g' information^-1 g. fields: further ones of a subclass.

        >>> from twin.laws.mooneyrivlin import mooney_rivlin
        >>> print(Separation.of(np.diag([1e4, 1e4]), mooney_rivlin(0.2, 0.1), 1.0))
        share_sd=0.02484... correlation=0.0 wanted_sd_mm=4.02...
        """
        eigenvalues = np.linalg.eigvalsh(information)
        if eigenvalues[0] <= SINGULAR * eigenvalues[1]:
            return cls(share_sd=None, correlation=-1.0, wanted_sd_mm=None, **fields)
        covariance = np.linalg.inv(information)
        gradient = np.array([-constants["C01"], constants["C10"]]) / constants.scale**2
        sd, share_sd = np.sqrt(np.diag(covariance)), math.sqrt(gradient @ covariance @ gradient)
        fields |= {"wanted_sd_mm": sd_mm * KNOWN / share_sd}
        return cls(share_sd=share_sd, correlation=float(covariance[0, 1] / (sd[0] * sd[1])), **fields)

    @property
    def sd(self) -> float:
        """Standard deviation of the share, infinite where it is left open."""
        return math.inf if self.share_sd is None else self.share_sd


class FurtherReading(Separation):
    """A further reading of one displacement, and the separation with it."""

    point: str
    node: int
    x_mm: float
    direction: str
    pressure_MPa: float
    u_mm: float

    @property
    def words(self) -> str:
        """Instruction for the reading, such as "U1 of tip at 30 kPa"."""
        return f"{self.direction} of {self.point} at {1e3 * self.pressure_MPa:.3g} kPa"


class FurtherReadings(Separation):
    """A set of further readings, and the separation with them."""

    words: str
    count: int


@dataclass(frozen=True, kw_only=True)
class Spot:
    """A point that could be read: its name, its node and its position (3,) mm."""

    name: str
    node: int
    place: Array


def spots(case: Case, targets: Targets, rows: Sequence[int]) -> tuple[Spot, ...]:
    """Points of these rows of the targets, and nodes evenly along x on the line through the first of them."""
    places, near = targets.places(case.position)[rows], 1e-6 * float(np.ptp(case.nodes, axis=0).max())
    nodes = [targets.points[r].node or 0 for r in rows]
    out = [Spot(name=targets.names[r], node=n, place=x) for r, n, x in zip(rows, nodes, places, strict=True)]
    line = np.flatnonzero((np.abs(case.nodes[:, 1:] - places[0, 1:]) < near).all(axis=1))
    x = case.nodes[line, 0]
    grid = np.linspace(x.min(), x.max(), ALONG + 1)[1:] if len(line) >= ALONG else ()
    for row in dict.fromkeys(int(line[np.argmin(np.abs(x - v))]) for v in grid):
        place, node = case.nodes[row], int(case.labels[row])
        out += [] if node in nodes else [Spot(name=f"x = {place[0]:.0f} mm", node=node, place=place)]
    return tuple(out)


@dataclass(frozen=True, kw_only=True)
class Sensitivities:
    """Displacements u (s, p, 3) mm of a model at pressures (s,) MPa and spots (p,), and their derivatives
    (2, s, p, 3) by C10 and C01 in mm/MPa."""

    spots: tuple[Spot, ...]
    pressure: Array
    u: Array
    jacobian: Array

    @staticmethod
    def of(
        model: Model, theta: Array, *, spots: Sequence[Spot], top: float, levels: Sequence[float] = LEVELS
    ) -> "Sensitivities":
        """Sensitivities at theta (2,) and levels of the top pressure in MPa, as far as equilibria exist.
        Raises Unsolvable where there is none at the top pressure itself."""
        path, pressure, time = model.test.path, top * np.array(levels), np.arange(len(levels) + 1.0)
        row = path.outside_at(path.output[[int(np.argmax(path.at_output()))]])[0]
        test = replace(
            model.test, path=Path(time, np.append(0.0, pressure), time, **path.under(row)),
            points=np.array([s.place for s in spots]), moving=np.ones(len(spots), bool),
            names=tuple(s.name for s in spots),
        )  # fmt: skip
        probe = replace(model, test=test, reference=np.array([0]), rests=None, parent=None, mesh=None)
        try:
            jacobian, u = probe.jacobian(theta), probe.predict(theta)
        except Unsolvable:
            if levels[-1] <= 1.0:
                raise
            return Sensitivities.of(model, theta, spots=spots, top=top, levels=levels[:-1])
        return Sensitivities(spots=tuple(spots), pressure=pressure, u=u[1:], jacobian=jacobian[:, 1:])

    def information(self, mask: NDArray[np.bool_], sd_mm: float) -> Array:
        """Fisher information (2, 2) in 1/MPa2 of the readings in a mask (s, p, 3), each with an sd in mm."""
        rows = self.jacobian[:, mask] / sd_mm
        return np.asarray(rows @ rows.T)

    def _with(self, information: Array, index: Any, sd_mm: float) -> tuple[Array, int]:
        """Information with the readings of an index added, and their number."""
        mask = np.zeros(self.u.shape, bool)
        mask[index] = True
        return information + self.information(mask, sd_mm), int(mask.sum())

    def readings(self, information: Array, constants: Constants, sd_mm: float) -> list[FurtherReading]:
        """All single readings, the most informative first. information (2, 2): of the present targets."""
        rows = [
            FurtherReading.of(
                self._with(information, (s, p, i), sd_mm)[0], constants, sd_mm, point=self.spots[p].name,
                node=self.spots[p].node, x_mm=float(self.spots[p].place[0]), direction=f"U{i + 1}",
                pressure_MPa=float(self.pressure[s]), u_mm=float(self.u[s, p, i]),
            )
            for s, p, i in np.ndindex(self.u.shape)
        ]  # fmt: skip
        return sorted(rows, key=lambda r: r.sd)

    def plans(
        self, information: Array, constants: Constants, sd_mm: float,
        *, names: Sequence[str], component: int, top: float,
    ) -> list[FurtherReadings]:  # fmt: skip
        """Sets of further readings up to the top pressure in MPa, the least work first.

        information (2, 2): of the present targets, displacement `component` of the points `names`, which are
        the first spots.
        """
        steps = np.flatnonzero(self.pressure <= top * (1 + 1e-9))
        points, everywhere = range(len(names)), range(len(self.spots))
        visible = sorted({0, 2, component})  # a camera that looks along y sees x and z
        unread = [i for i in visible if i != component]
        ramp = f"at {len(steps)} pressures up to {1e3 * top:.3g} kPa"
        here, there = " and ".join(names), f"{len(everywhere)} points"
        plans = []
        designs: tuple[tuple[list[int], str, str, Any], ...] = (
            (unread, here, "at the same pressure", (steps[-1:], points)),
            ([component], here, ramp, (steps[:-1], points)),
            (visible, here, ramp, (steps, points)),
            (visible, there, ramp, (steps, everywhere)),
        )
        for components, where, when, index in designs:
            total, count = self._with(information, np.ix_(*index, np.array(components)), sd_mm)
            words = f"{' and '.join(f'U{i + 1}' for i in components)} of {where} {when}"
            plans.append(FurtherReadings.of(total, constants, sd_mm, words=words, count=count))
        return plans
