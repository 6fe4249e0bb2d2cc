"""Effects of the shape: the chamber is not where the drawing has it, or the finger is not straight at rest.

Only inner surfaces move, so that markers stay where they are. At one value the map is a displacement of the
chamber's surface, spread through the walls (`fe.mesh.inner`); it works on any mesh with a named chamber.
"""

from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.polynomial.legendre import legval

from calibrate import Parameter
from fe import Case
from fe.mesh.inner import Inside, inside, least_volume_ratio
from twin.effects.families import Wide, neighbours
from twin.effects.phrases import at_ends, felt, listed, number, way
from twin.effects.protocol import Effect, Order, Test, Theta, Unsolvable, symmetric
from twin.targets import Array

CORE = 0.5  # mm: a core held at one end sinks or floats by so much (judgement)
LEAST = 0.05  # of an element's volume must be left anywhere: beyond, the walls are all but closed


class InnerShape(Effect):
    """A displacement of the chamber's surface."""

    order = Order.GEOMETRY

    def motion(self, inner: Inside, theta: Theta) -> Array:
        """The displacement (k, 3) mm of the nodes of the inner surface, 0 at null."""
        raise NotImplementedError

    def lacks(self, case: Case) -> str:
        return "" if case.pressurised else "no chamber, whose walls could be off"

    def before(self, test: Test, theta: Theta) -> Test:
        """Raises Unsolvable where the walls do not leave room for it."""
        if self.lacks(test.case):
            return test
        inner = inside(test.case)
        moved = self.motion(inner, theta)
        if not moved.any():
            return test
        nodes = test.case.nodes + inner.spread(moved)
        ratio = least_volume_ratio(test.case, nodes)
        if ratio < LEAST:
            values = ", ".join(f"{p.name} = {theta[p.name]:.3g} {p.unit}".rstrip() for p in self.parameters)
            raise Unsolvable(
                f"{values}: an element of the wall keeps {ratio:.2g} of its volume, wanted {LEAST:g}; the "
                "walls are too thin for it, or the mesh too coarse"
            )
        return replace(test, case=replace(test.case, nodes=nodes))


def _along(inner: Inside) -> Array:
    """Places (k,) along the chamber: 0 at its base, 1 at its tip."""
    x = inner.position[:, 0]
    return np.asarray((x - x.min()) / np.ptp(x), float)


def _across(inner: Inside) -> Array:
    """The normals' part (k, 3) across the finger's axis: walls get thicker by it, end caps do not."""
    return inner.normal * [0.0, 1.0, 1.0]


class WallThickness(InnerShape):
    """All walls of the chamber are thicker by `mm`: the core was smaller. No effect of the library, as one
    film cannot tell it from stiffer silicone; two castings differ by it."""

    name = "wall_thickness"
    sentence = "the walls are thicker or thinner everywhere (another core)"
    # a core is printed or cut to 0.1 or 0.2 mm, and shrinks (judgement)
    parameters = symmetric("wall_thickness.mm", most=1.0, unit="mm", step=0.05, likely=0.3)

    def motion(self, inner: Inside, theta: Theta) -> Array:
        return theta["wall_thickness.mm"] * _across(inner)

    def told(self, values: Theta) -> str:
        mm = values["wall_thickness.mm"]
        return f"all walls are {number(mm)} mm {way(mm, 'thicker', 'thinner')}"


class WallTaper(InnerShape):
    """Walls get thicker from base to tip by `mm` in all, thinner before the middle, thicker behind it."""

    name = "wall_taper"
    sentence = "the walls get thicker or thinner along the finger (the core was thinner at one end)"
    parameters = symmetric("wall_taper.mm", most=1.2, unit="mm", step=0.1, likely=0.6)

    def motion(self, inner: Inside, theta: Theta) -> Array:
        return theta["wall_taper.mm"] * (_along(inner) - 0.5)[:, None] * _across(inner)

    def told(self, values: Theta) -> str:
        mm = values["wall_taper.mm"]
        return (
            f"the walls get {number(mm)} mm {way(mm, 'thicker', 'thinner')} from base to tip (the core was "
            "thinner at one end)"
        )

    def wide(self) -> Effect:
        return WallCourse()


class LegendreCourse(InnerShape, Wide):
    """A polynomial along the chamber: amplitudes c0, c1 .. in mm of Legendre's polynomials, from -1 at its
    base to 1 at its tip."""

    def along(self, inner: Inside, theta: Theta) -> Array:
        """Its values (k,) mm at the nodes of the inner surface."""
        c = [theta[p.name] for p in self.parameters]
        return np.asarray(legval(2 * _along(inner) - 1, c), float)

    def ends(self, values: Theta) -> tuple[float, float]:
        """Its values in mm at the base of the chamber and at its tip."""
        base, tip = legval([-1.0, 1.0], [values[p.name] for p in self.parameters])
        return float(base), float(tip)


class WallCourse(LegendreCourse, of=WallTaper):
    """Walls thicker by a polynomial of degree 5 along the finger: any smooth course, and a step as far as
    five terms carry it."""

    parameters = symmetric(
        *(f"wall_taper.c{k}" for k in range(6)), most=0.8, unit="mm", step=0.05, likely=0.3
    )

    def motion(self, inner: Inside, theta: Theta) -> Array:
        return self.along(inner, theta)[:, None] * _across(inner)

    def told(self, values: Theta) -> str:
        off = at_ends(*self.ends(values), "mm", "thicker", "thinner")
        return f"the walls of the chamber are not as drawn: {off}"

    def amounts(self, theta: Theta) -> dict[str, float]:
        return {"wall_taper.c1": 0.5 * theta.get("wall_taper.mm", 0.0)}


class EccentricCore(InnerShape):
    """The chamber as a whole lies higher by `mm`: the bottom is thicker, the top thinner."""

    name = "eccentric_core"
    sentence = "the core sat too high or too low: top and bottom walls are not as drawn"
    parameters = symmetric("eccentric_core.mm", most=1.0, unit="mm", step=0.1, likely=CORE)

    def motion(self, inner: Inside, theta: Theta) -> Array:
        return np.tile([0.0, 0.0, theta["eccentric_core.mm"]], (len(inner.rows), 1))

    def told(self, values: Theta) -> str:
        mm = values["eccentric_core.mm"]
        return f"the core lies {number(mm)} mm too {way(mm, 'high (towards +z)', 'low (towards -z)')}"

    def wide(self) -> Effect:
        return CoreCourse()


class CoreCourse(LegendreCourse, of=EccentricCore):
    """The core sat higher by a polynomial of degree 3 along the finger: off, tilted or bent."""

    parameters = symmetric(
        *(f"eccentric_core.c{k}" for k in range(4)), most=1.0, unit="mm", step=0.1, likely=CORE
    )

    def motion(self, inner: Inside, theta: Theta) -> Array:
        return self.along(inner, theta)[:, None] * [0.0, 0.0, 1.0]

    def told(self, values: Theta) -> str:
        return f"the core lies {at_ends(*self.ends(values), 'mm', 'too high', 'too low')}"

    def amounts(self, theta: Theta) -> dict[str, float]:
        return {"eccentric_core.c0": theta.get("eccentric_core.mm", 0.0)}


class SidewaysCore(InnerShape):
    """The chamber as a whole lies off the middle plane by `mm` towards +y: the finger bends sideways and
    twists."""

    name = "eccentric_core_y"
    sentence = "the core sat off the middle plane: one side wall is thicker than the other"
    parameters = symmetric("eccentric_core_y.mm", most=0.8, unit="mm", step=0.1, likely=CORE)

    def told(self, values: Theta) -> str:
        mm = values["eccentric_core_y.mm"]
        return f"the core lies {number(mm)} mm off the middle plane, towards {way(mm, '+y', '-y')}"

    def breaks_symmetry(self, test: Test) -> bool:
        del test
        return True

    def motion(self, inner: Inside, theta: Theta) -> Array:
        return np.tile([0.0, theta["eccentric_core_y.mm"], 0.0], (len(inner.rows), 1))

    def wide(self) -> Effect:
        return SidewaysCourse()


class SidewaysCourse(LegendreCourse, of=SidewaysCore):
    """The core sat off the middle plane by a polynomial of degree 2 along the finger: off, tilted or bent."""

    parameters = symmetric(
        *(f"eccentric_core_y.c{k}" for k in range(3)), most=0.8, unit="mm", step=0.1, likely=CORE
    )

    def breaks_symmetry(self, test: Test) -> bool:
        del test
        return True

    def motion(self, inner: Inside, theta: Theta) -> Array:
        return self.along(inner, theta)[:, None] * [0.0, 1.0, 0.0]

    def amounts(self, theta: Theta) -> dict[str, float]:
        return {"eccentric_core_y.c0": theta.get("eccentric_core_y.mm", 0.0)}


class Ballooning(InnerShape):
    """A band around the chamber is thinner by `depth`: a Gaussian of sd `width` along x, about `place`."""

    name = "ballooning"
    sentence = "the wall is thin at one place along the finger and balloons there"
    parameters = (
        Parameter("ballooning.depth", 0.0, 0.9, "mm", null=0.0, typical=0.1, plausible=(0.0, 0.5)),
        Parameter("ballooning.place", 0.0, 1.0, "", typical=0.1),
        Parameter("ballooning.width", 3.0, 30.0, "mm", typical=2.0),
    )
    grid = tuple({"ballooning.place": place, "ballooning.width": 8.0} for place in (0.1, 0.3, 0.5, 0.7, 0.9))

    def motion(self, inner: Inside, theta: Theta) -> Array:
        off = (_along(inner) - theta["ballooning.place"]) * np.ptp(inner.position[:, 0])
        bell = np.exp(-0.5 * (off / theta["ballooning.width"]) ** 2)
        return -theta["ballooning.depth"] * bell[:, None] * _across(inner)

    def told(self, values: Theta) -> str:
        depth, place, width = (values[f"ballooning.{k}"] for k in ("depth", "place", "width"))
        return (
            f"the wall is {number(depth)} mm thinner at {number(place)} of the chamber's length, over about "
            f"{number(2 * width)} mm, and balloons there"
        )

    def wide(self) -> Effect:
        return ThinBands()


class ThinBands(InnerShape, Wide, of=Ballooning):
    """Five bands around the chamber, each thinner by its own depth: Gaussians at PLACES, of sd WIDTH."""

    PLACES: ClassVar[tuple[float, ...]] = (0.1, 0.3, 0.5, 0.7, 0.9)
    WIDTH: ClassVar[float] = 0.1  # of the chamber's length; 10 mm of the built-in finger's
    parameters = tuple(
        Parameter(f"ballooning.d{k}", 0.0, 0.9, "mm", null=0.0, typical=0.1, plausible=(0.0, 0.5))
        for k in range(1, len(PLACES) + 1)
    )

    def motion(self, inner: Inside, theta: Theta) -> Array:
        off = (_along(inner)[:, None] - self.PLACES) / self.WIDTH
        depth = np.exp(-0.5 * off**2) @ [theta[p.name] for p in self.parameters]
        return -depth[:, None] * _across(inner)

    def told(self, values: Theta) -> str:
        depths = [values[p.name] for p in self.parameters]
        bands = [f"{number(depths[k])} mm at {number(self.PLACES[k])}" for k in felt(depths)]
        return f"the wall is thinner along the chamber, by {listed(bands)} of its length, and balloons there"

    def amounts(self, theta: Theta) -> dict[str, float]:
        """The depth shared by the two nearest bands, times the band's width over 10 mm: as much material."""
        depth, place = (theta.get(f"ballooning.{k}", 0.0) for k in ("depth", "place"))
        depth *= theta.get("ballooning.width", 10.0) / 10.0
        return self.bounded(depth * neighbours(place, self.PLACES))


class Precurvature(Effect):
    """The finger is free of stress where it is curved: straight, as it is meshed, it would be held by force.

    At rest it lies as much lower as that; displacements are relative to the rest.
    """

    name, order = "precurvature", Order.GEOMETRY
    sentence = "the finger is curved without any load (it shrank or cured more on one side)"
    # 1e-3 1/mm lifts the tip of 110 mm by 6 mm: more is seen by eye (judgement)
    parameters = symmetric("precurvature.per_mm", most=3e-3, unit="1/mm", step=1e-4, likely=1e-3)

    def before(self, test: Test, theta: Theta) -> Test:
        return replace(test, case=replace(test.case, precurvature=theta["precurvature.per_mm"]))

    def told(self, values: Theta) -> str:
        curvature = values["precurvature.per_mm"]
        return f"the finger is curved without any load, {_curved(curvature)}"

    def wide(self) -> Effect:
        return CurvedCourse()


class CurvedCourse(Wide, of=Precurvature):
    """The curvature at rest is a polynomial of degree 3 along the finger: c0, c1 .. of Legendre's
    polynomials, from -1 at the clamp to 1 at the tip."""

    parameters = symmetric(
        *(f"precurvature.c{k}" for k in range(4)), most=3e-3, unit="1/mm", step=1e-4, likely=1e-3
    )

    def before(self, test: Test, theta: Theta) -> Test:
        course = tuple(theta[p.name] for p in self.parameters)
        return replace(test, case=replace(test.case, precurvature=course))

    def told(self, values: Theta) -> str:
        base, tip = legval([-1.0, 1.0], [values[p.name] for p in self.parameters])
        ends = f"{_curved(base)} at the clamp and {_curved(tip)} at the tip"
        return f"the finger is curved without any load, {ends}"

    def amounts(self, theta: Theta) -> dict[str, float]:
        return {"precurvature.c0": theta.get("precurvature.per_mm", 0.0)}


def _curved(per_mm: float) -> str:
    """A curvature in 1/mm by its direction and its radius."""
    if not per_mm:
        return "not at all"
    return f"{way(per_mm, 'down', 'up')} with a radius of {number(1 / per_mm)} mm"
