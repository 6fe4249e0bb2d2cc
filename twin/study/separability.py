"""A calibrated model and readings that could be added -> how well each would tell C10 from C01.

To first order a reading adds to the information on the constants the square of its derivative in units of
its error (Fisher information; for the choice of experiments doi:10.1137/1.9780898719109). No reading is
simulated, and no error of the model counts: this is what geometry and material allow.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fe import Path
from twin.effects.protocol import Unsolvable
from twin.laws.law import Constants
from twin.model.prediction import Model
from twin.records import Record
from twin.targets import Array

LEVELS = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)  # of the top pressure at which one could read
KNOWN = 0.1  # sd of the share C01 / (C10 + C01) at which it is called known
UNKNOWN = 1 / math.sqrt(12)  # sd of a share of which nothing is known but that it lies between 0 and 1
SINGULAR = 1e-10  # smallest over largest eigenvalue of an information that determines both


class Known(Record):
    """What is known of the share."""

    share_sd: float | None = Field(description="null where it is left open")
    correlation: float
    wanted_sd_mm: float | None = Field(description="error of all readings for a `share_sd` of 0.1")

    @property
    def vague(self) -> float:
        """The sd of the share, infinite where it is left open."""
        return math.inf if self.share_sd is None else self.share_sd

    @property
    def wanted(self) -> str:
        """The error in mm that is wanted, in words."""
        return f"{self.wanted_sd_mm or 0.0:.2g}"


def knowledge(information: Array, constants: Constants, sd_mm: float) -> dict[str, Any]:
    """The fields of `Known` from the information (2, 2) on C10 and C01 in 1/MPa2 that readings with an error
    of sd_mm hold."""
    sizes = np.linalg.eigvalsh(information)
    if sizes[0] <= SINGULAR * sizes[1]:
        return {"share_sd": None, "correlation": -1.0, "wanted_sd_mm": None}
    covariance = np.linalg.inv(information)
    slope = np.array([-constants["C01"], constants["C10"]]) / constants.scale**2
    sd, share_sd = np.sqrt(np.diag(covariance)), math.sqrt(slope @ covariance @ slope)
    return {"share_sd": share_sd, "correlation": float(covariance[0, 1] / (sd[0] * sd[1])),
            "wanted_sd_mm": sd_mm * KNOWN / share_sd}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Spot:
    """A point where one could read: its name, its node and its place (3,) mm."""

    name: str
    node: int
    place: Array


class ReadingRow(Known):
    """One reading that could be added, and what is known with it."""

    point: str
    node: int
    x_mm: float
    direction: str
    pressure_MPa: float
    u_mm: float

    @property
    def words(self) -> str:
        """As one would ask for it."""
        return f"{self.direction} of {self.point} at {1e3 * self.pressure_MPa:.3g} kPa"


@dataclass(frozen=True, kw_only=True)
class Outcomes:
    """What a model shows at spots and pressures: u (s, p, 3) mm, its derivatives (2, s, p, 3) to C10 and C01
    in mm/MPa."""

    spots: tuple[Spot, ...]
    pressure: Array
    u: Array
    jacobian: Array

    def information(self, seen: NDArray[np.bool_], sd_mm: float) -> Array:
        """Information (2, 2) in 1/MPa2 of the readings of a mask (s, p, 3), each with an error of sd_mm."""
        rows = self.jacobian[:, seen] / sd_mm
        return np.asarray(rows @ rows.T)


def outcomes(model: Model, theta: Array, *, spots: Sequence[Spot], top: float) -> Outcomes:
    """What the model at theta (2,) shows at the spots, at shares of a top pressure in MPa as far as there is
    an equilibrium. Raises Unsolvable where there is none at the top pressure itself."""
    levels = np.array(LEVELS)
    while True:
        try:
            return _at_levels(model, theta, tuple(spots), top * levels)
        except Unsolvable:
            if levels[-1] <= 1.0:
                raise
            levels = levels[:-1]


def _at_levels(model: Model, theta: Array, spots: tuple[Spot, ...], pressure: Array) -> Outcomes:
    path, test = model.test.path, model.test
    load, time = np.append(0.0, pressure), np.arange(len(pressure) + 1.0)
    row = path.outside_at(path.output[[int(np.argmax(path.at_output()))]])[0]
    course = Path(time, load, time, **path.under(row))
    places, every = np.array([s.place for s in spots]), np.ones(len(spots), bool)
    names = tuple(s.name for s in spots)
    planned = replace(test, path=course, points=places, moving=every, names=names)
    asked = replace(model, test=planned, reference=np.array([0]), rests=None, parent=None, mesh=None)
    jacobian, u = asked.jacobian(theta), asked.predict(theta)
    return Outcomes(spots=spots, pressure=pressure, u=u[1:], jacobian=jacobian[:, 1:])


def readings(
    shown: Outcomes, *, information: Array, constants: Constants, sd_mm: float
) -> list[ReadingRow]:
    """Every single reading that could be added, best first. information (2, 2): of what is there."""
    found = []
    for index in np.ndindex(shown.u.shape):
        s, p, i = index
        seen = np.zeros(shown.u.shape, bool)
        seen[index] = True
        spot = shown.spots[p]
        found.append(
            ReadingRow(point=spot.name, node=spot.node, x_mm=float(spot.place[0]), direction=f"U{i + 1}",
                    pressure_MPa=float(shown.pressure[s]), u_mm=float(shown.u[index]),
                    **knowledge(information + shown.information(seen, sd_mm), constants, sd_mm))
        )  # fmt: skip
    return sorted(found, key=lambda r: r.vague)
