"""Effects of what pulls the finger from outside: its supply line, a cable, a thread."""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
import scipy

from calibrate import Parameter
from fe import Case
from fe.element import Integers
from fe.mesh.mirror import middle_plane
from twin.effects.families import Wide, neighbours
from twin.effects.phrases import at_place, felt, listed, pull
from twin.effects.protocol import Effect, Family, Order, Test, Theta
from twin.targets import Array

STATIONS = 13  # sections along the finger that carry a force between them
DEGREE = 2  # of the splines that share it out: smooth in its place, and of the right moment
SLICE = 0.25  # of the distance between two stations is how thick a section is
# A supply line of silicone, 4 mm thick and hanging over 300 mm, weighs and pulls 0.05 to 0.3 N (judgement).
PULL = (-0.3, 0.3)
PER_MPA = (-5.0, 5.0)  # N/MPa: as much, at 0.06 MPa


class Tube(Family):
    """A force pulls the finger at one place: `up` and `along` it, N, there from the start and as large in
    every shape. With two terms it also grows with the pressure, by N/MPa, as that of a line that it stiffens.

    place: 0 at the clamp, 1 at the tip. The force is spread over a section of the finger, and by quadratic
    splines over the sections next to it, which keeps force and moment (Schoenberg 1967); at 1 it is the end
    face's. What is there at rest shows as far as the finger turns and stiffens: displacements are relative.
    """

    name, order = "tube", Order.SUPPORT
    sentence = "the supply line, or something else outside, pulls the finger at one place"
    generic = "outside force"
    added: ClassVar[Theta] = {"tube.up_per_MPa": 0.0, "tube.along_per_MPa": 0.0}

    def law(self, terms: int) -> tuple[Parameter, ...]:
        return (
            Parameter("tube.up", -2.0, 2.0, "N", null=0.0, typical=0.02, plausible=PULL),
            Parameter("tube.along", -2.0, 2.0, "N", null=0.0, typical=0.02, plausible=PULL),
            Parameter("tube.place", 0.05, 1.0, "", typical=0.1),
            Parameter("tube.up_per_MPa", -30.0, 30.0, "N/MPa", null=0.0, typical=0.5, plausible=PER_MPA),
            Parameter("tube.along_per_MPa", -30.0, 30.0, "N/MPa", null=0.0, typical=0.5, plausible=PER_MPA),
        )[: 3 if terms == 1 else 5]

    def tried(self, terms: int) -> tuple[Theta, ...]:
        return tuple({"tube.place": x} for x in (1.0, 0.8, 0.6, 0.4, 0.2))

    def before(self, test: Test, theta: Theta) -> Test:
        dead, growing = (
            np.array([theta.get(f"tube.along{per}", 0.0), 0.0, theta.get(f"tube.up{per}", 0.0)])
            for per in ("", "_per_MPa")
        )
        return pulled(test, {theta["tube.place"]: dead}, {theta["tube.place"]: growing}, self.name)

    def told(self, values: Theta) -> str:
        parts = {"": 1.0, "_per_MPa": 0.01}  # N, and N per 10 kPa
        dead, growing = (
            (size * values.get(f"tube.along{per}", 0.0), size * values.get(f"tube.up{per}", 0.0))
            for per, size in parts.items()
        )
        more = f", and with {pull(*growing, 'N')} more per 10 kPa" if any(growing) else ""
        return (
            f"the supply line, or something else outside, pulls the finger with {pull(*dead, 'N')}{more}, "
            f"{at_place(values['tube.place'])}"
        )

    def wide(self) -> Effect:
        return Tubes()


class Tubes(Wide, of=Tube):
    """Forces at three places along the finger, each constant and growing with the pressure."""

    PLACES: ClassVar[tuple[float, ...]] = (0.4, 0.7, 1.0)
    parameters = tuple(
        Parameter(f"tube.{way}{per}{k}", -most, most, unit, null=0.0, typical=step, plausible=likely)
        for per, most, unit, step, likely in (
            ("", 2.0, "N", 0.02, PULL),
            ("_per_MPa", 30.0, "N/MPa", 0.5, PER_MPA),
        )
        for k in range(1, 4)
        for way in ("along", "up")
    )

    def before(self, test: Test, theta: Theta) -> Test:
        dead, growing = (
            {
                place: np.array([theta[f"tube.along{per}{k}"], 0.0, theta[f"tube.up{per}{k}"]])
                for k, place in enumerate(self.PLACES, start=1)
            }
            for per in ("", "_per_MPa")
        )
        return pulled(test, dead, growing, self.name)

    def told(self, values: Theta) -> str:
        forces = [(values[f"tube.along{k}"], values[f"tube.up{k}"]) for k in (1, 2, 3)]
        strong = felt([float(np.linalg.norm(force)) for force in forces])
        pulls = [f"{pull(*forces[k], 'N')} {at_place(self.PLACES[k])}" for k in strong]
        how = f"with {listed(pulls)}" if pulls else "as the pressure rises"
        return f"the supply line, or something else outside, pulls the finger {how}"

    def amounts(self, theta: Theta) -> dict[str, float]:
        near = neighbours(theta.get("tube.place", 1.0), self.PLACES)
        return {
            f"tube.{axis}{per}{k}": float(x) * theta.get(f"tube.{axis}{per}", 0.0)
            for per in ("", "_per_MPa")
            for k, x in enumerate(near, start=1)
            for axis in ("along", "up")
        }


def pulled(test: Test, dead: Mapping[float, Array], growing: Mapping[float, Array], name: str) -> Test:
    """The test with forces (3,) N, and forces that grow with the pressure, (3,) N/MPa, at places along it.

    Forces are those on the whole structure; name: of the node sets that carry them.
    """
    case = test.case
    forces: dict[str, Array] = {}
    loads: dict[str, Array] = {}
    sets: dict[str, Integers] = {}
    rows = sections(case)
    for by_set, by_place in ((forces, dead), (loads, growing)):
        total = np.zeros((STATIONS, 3))
        for place, force in by_place.items():
            total += shares(place)[:, None] * force
        for k in np.flatnonzero(total.any(axis=1)):
            sets[f"{name}_{k}"], by_set[f"{name}_{k}"] = rows[k], test.share * total[k]
    if not sets:
        return test
    return replace(
        test,
        case=replace(
            case,
            node_sets={**case.node_sets, **sets},
            forces={**case.forces, **forces},
            growing={**case.growing, **loads},
        ),
    )


def sections(case: Case) -> list[Integers]:
    """Rows of nodes in sections across x at STATIONS places from end to end, off the middle plane, so that a
    half has half of them."""
    x, off = case.nodes[:, 0], np.abs(case.nodes[:, 1] - middle_plane(case))
    aside = np.flatnonzero(off > 1e-6 * np.ptp(case.nodes, axis=0).max())
    places = x.min() + _stations() * np.ptp(x)
    half = SLICE / 2 * np.ptp(x) / (STATIONS - 1)
    out = []
    for place in places:
        gap = np.abs(x[aside] - place)
        out.append(aside[gap <= max(half, gap.min() + 1e-6 * np.ptp(x))])
    return out


def _knots() -> Array:
    inner = np.linspace(0.0, 1.0, STATIONS - DEGREE + 1)
    return np.concatenate([np.zeros(DEGREE), inner, np.ones(DEGREE)])


def _stations() -> Array:
    """Places (STATIONS,) of the sections: with them the splines keep a force's moment."""
    t = _knots()
    return np.array([t[k + 1 : k + 1 + DEGREE].mean() for k in range(STATIONS)])


def shares(place: float) -> Array:
    """Shares (STATIONS,) of a force at a place from 0 to 1 that the sections carry, by quadratic B-splines,
    which keep force and moment (Schoenberg 1967); just beyond 0 and 1 the splines are continued.

    >>> round(float(shares(0.37).sum()), 12)
    1.0
    """
    return np.asarray(scipy.interpolate.BSpline(_knots(), np.eye(STATIONS), DEGREE)(place), float)
