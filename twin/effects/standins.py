"""Stand-ins: plain explanations that are no effects of the library, by which a rest is told in words.

What the data ask for and no effect explains may look like a force, a soft spot, another pressure, a drift, a
wrong picture or a slip. A stand-in says how it looks, with size and place; it is never named as the cause.
Plausible ranges are wide on purpose, as nothing is known of what a stand-in stands for (judgement).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.polynomial.polynomial import polyval

from fe.mesh.mirror import symmetry_support
from twin.effects.protocol import Effect, Order, Test, Theta, symmetric
from twin.effects.pulls import pulled
from twin.effects.tags import between
from twin.targets import Array

FORCES = (0.35, 0.6, 0.8, 1.0)  # of the length from the clamp
GROWING = (0.6, 1.0)
SPOTS = (0.1, 0.3, 0.5, 0.7, 0.9)
MARKERS, TIMES = 8, 3  # slips: of so many markers at so many times
WAYS = {"along": (1.0, 0.0, 0.0), "aside": (0.0, 1.0, 0.0), "up": (0.0, 0.0, 1.0)}


class StandIn(Effect):
    """An explanation in plain words. kind: what it is, the same for those that differ in place alone."""

    def __init__(
        self, name: str, amplitudes: Iterable[str], unit: str, *, most: float, step: float, likely: float
    ) -> None:
        """amplitudes: their names; all from -most to most, plausible from -likely to likely."""
        self.name = name
        own = (f"{name}.{a}" for a in amplitudes)
        self.parameters = symmetric(*own, most=most, unit=unit, step=step, likely=likely)

    def of(self, theta: Theta, name: str) -> float:
        """The value of its parameter of that name, 0 where it has none."""
        return float(theta.get(f"{self.name}.{name}", 0.0))

    def numbers(self, theta: Theta) -> list[float]:
        """The values of its parameters."""
        return [float(theta.get(p.name, 0.0)) for p in self.parameters]

    def resembles(self, theta: Theta) -> str:
        """What it looks like at values of its parameters: "0.18 N near the tip, pointing up"."""
        raise NotImplementedError


def stand_ins(test: Test) -> tuple[StandIn, ...]:
    """All stand-ins for a test, about 80 amplitudes in all; forces across the finger only where all of it is
    modelled."""
    span = Span.of(test)
    ways = [way for way in WAYS if way != "aside" or symmetry_support(test.case) is None]
    rows = np.flatnonzero(test.moving)
    some = rows[np.unique(np.linspace(0, len(rows) - 1, MARKERS).round().astype(int))] if len(rows) else rows
    return (
        *(OutsideForce(place, ways) for place in FORCES),
        *(OutsideForce(place, ways, growing=True) for place in GROWING),
        *(SoftSpot(place) for place in SPOTS),
        PressureCurve(span),
        PressureCourse(span),
        MountingDrift(span),
        WrongPicture(),
        *(MarkerJump(test.markers[row], between(test.path.output, TIMES + 2)[1:-1]) for row in some),
    )


@dataclass(frozen=True)
class Span:
    """What a test spans: its first and last time in s, and its top pressure in MPa."""

    begin: float
    end: float
    top: float

    @staticmethod
    def of(test: Test) -> "Span":
        """Of a test's path."""
        t, p = test.path.time, test.path.pressure
        return Span(float(t[0]), float(max(t[-1], t[0] + 1e-9)), float(max(np.abs(p).max(), 1e-9)))

    def across(self, time: Array) -> Array:
        """Times as numbers from -1 to 1."""
        return np.asarray((2 * time - self.begin - self.end) / (self.end - self.begin), float)


# -- what acts on the finger ---------------------------------------------------------------------------------


class OutsideForce(StandIn):
    """A force from outside at a place along the finger, constant or growing with the pressure."""

    order, kind = Order.SUPPORT, "outside force"
    sentence = "something outside pulls or pushes"

    def __init__(self, place: float, ways: list[str], *, growing: bool = False) -> None:
        self.place, self.growing = place, growing
        unit, most, step, likely = ("N/MPa", 60.0, 0.5, 10.0) if growing else ("N", 3.0, 0.02, 0.4)
        name = f"{'growing_' * growing}force_at_{100 * place:.0f}"
        super().__init__(name, ways, unit, most=most, step=step, likely=likely)

    def breaks_symmetry(self, test: Test) -> bool:
        del test
        return any(p.name.endswith(".aside") for p in self.parameters)

    def force(self, theta: Theta) -> Array:
        """The force (3,) in N or N/MPa."""
        return np.array([self.of(theta, way) for way in WAYS])

    def before(self, test: Test, theta: Theta) -> Test:
        force = {self.place: self.force(theta)}
        return pulled(test, *(({}, force) if self.growing else (force, {})), self.name)

    def resembles(self, theta: Theta) -> str:
        force = self.force(theta)
        size = float(np.linalg.norm(force))
        much = f"{1e-2 * size:.2g} N per 10 kPa" if self.growing else f"{size:.2g} N"
        return f"{much} {where(self.place)}, pointing {direction(force)}"


class SoftSpot(StandIn):
    """A band around the finger, a fifth of it long, whose material is softer, in its lower and its upper
    half; stiffer where negative."""

    order, kind, sentence = Order.SUPPORT, "soft spot", "the silicone is softer or stiffer at one place"

    def __init__(self, place: float) -> None:
        self.place = place
        name = f"soft_at_{100 * place:.0f}"
        super().__init__(name, ("lower", "upper"), "", most=0.8, step=0.05, likely=0.3)

    def before(self, test: Test, theta: Theta) -> Test:
        case, low, high = test.case, self.of(theta, "lower"), self.of(theta, "upper")
        if not (low or high):
            return test
        centre = case.nodes[case.connectivity].mean(axis=1)
        x = (centre[:, 0] - case.nodes[:, 0].min()) / np.ptp(case.nodes[:, 0])
        middle = (case.nodes[:, 2].min() + case.nodes[:, 2].max()) / 2
        band = np.abs(x - self.place) < 0.1
        parts = {
            "lower": (band & (centre[:, 2] < middle), low),
            "upper": (band & (centre[:, 2] >= middle), high),
        }
        sets, materials = dict(case.element_sets), dict(case.materials)
        for name in case.materials.keys() - set(case.kept):
            rows = sets[name]
            for half, (flags, softer) in parts.items():
                inside = flags[rows]
                sets[f"{name}_{self.name}_{half}"] = rows[inside]
                materials[f"{name}_{self.name}_{half}"] = case.materials[name].stiffened(1 - softer)
                rows = rows[~inside]
            sets[name] = rows
        return replace(test, case=replace(case, element_sets=sets, materials=materials))

    def resembles(self, theta: Theta) -> str:
        low, high = self.of(theta, "lower"), self.of(theta, "upper")
        if abs(low - high) < 0.25 * max(abs(low), abs(high)):
            return f"silicone {softer((low + high) / 2)} {where(self.place)}"
        half, much = ("lower", low) if abs(low) > abs(high) else ("upper", high)
        return f"silicone {softer(much)} in the {half} half {where(self.place)}"


# -- the pressure --------------------------------------------------------------------------------------------


class OtherPressure(StandIn):
    """Another pressure than the recorded one, by four terms of a polynomial from its `first` on."""

    order, kind, sentence = Order.LINE, "pressure course", "the pressure is not the recorded one"
    by: ClassVar[tuple[str, int]]  # what it is a polynomial of, and the first term

    def __init__(self, span: Span) -> None:
        self.span, (by, first) = span, self.by
        names = (f"c{k}" for k in range(first, first + 4))
        super().__init__(f"pressure_by_{by}", names, "", most=0.5, step=0.01, likely=0.1)


class PressureCurve(OtherPressure):
    """Another pressure, by a polynomial of the recorded one: top (c0 + c1 x + c2 x^2 + ..), x = p / top."""

    by = "pressure", 0

    def wrong(self, x: Array, theta: Theta) -> Array:
        """By how much (k,), as a share of the top pressure, it is higher at shares x (k,) of it."""
        return np.asarray(polyval(x, self.numbers(theta)), float)

    def before(self, test: Test, theta: Theta) -> Test:
        p, top = test.path.pressure, self.span.top
        return replace(test, path=replace(test.path, pressure=p + top * self.wrong(p / top, theta)))

    def resembles(self, theta: Theta) -> str:
        x = np.linspace(0.0, 1.0, 21)
        off = self.wrong(x, theta)
        k = int(np.abs(off).argmax())
        much, at = abs(off[k]) * self.span.top * 1e3, x[k] * self.span.top * 1e3
        return (
            f"a pressure {much:.2g} kPa {'higher' if off[k] > 0 else 'lower'} than recorded at {at:.2g} kPa"
        )


class PressureCourse(OtherPressure):
    """Another pressure, by a polynomial of time: p (1 + c1 P1 + .. + c4 P4), Legendre's, over the film."""

    by = "time", 1

    def wrong(self, time: Array, theta: Theta) -> Array:
        """By which share (k,) it is higher at times (k,) s."""
        return np.asarray(legval(self.span.across(time), [0.0, *self.numbers(theta)]))

    def before(self, test: Test, theta: Theta) -> Test:
        p = test.path.pressure
        return replace(test, path=replace(test.path, pressure=p + p * self.wrong(test.path.time, theta)))

    def resembles(self, theta: Theta) -> str:
        time = np.linspace(self.span.begin, self.span.end, 41)
        off = self.wrong(time, theta)
        low, high = int(off.argmin()), int(off.argmax())
        first, last = sorted((low, high))
        way = "falling" if first == high else "rising"
        span = f"from {time[first]:.3g} s to {time[last]:.3g} s"
        return f"a pressure {way} by {100 * float(np.ptp(off)):.2g} % against the recorded one, {span}"


# -- what is seen --------------------------------------------------------------------------------------------


class MountingDrift(StandIn):
    """All markers of the finger move as one with time, as its mounting creeps: polynomials of degree 3."""

    order, kind, sentence = Order.SLIP, "drift", "the finger as a whole moves with time"

    def __init__(self, span: Span) -> None:
        self.span = span
        names = (f"{way}{k}" for way in ("along", "up") for k in (1, 2, 3))
        super().__init__("drift", names, "mm", most=5.0, step=0.02, likely=0.3)

    def course(self, time: Array, theta: Theta) -> Array:
        """The drift (k, 3) mm at times (k,) s."""
        x = self.span.across(time)
        along, up = (legval(x, [0.0, *c]) for c in np.reshape(self.numbers(theta), (2, 3)))
        return np.stack([along, np.zeros_like(x), up], axis=1)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        moved = self.course(test.path.output, theta)
        return u + moved[:, None] * test.moving[:, None]

    def resembles(self, theta: Theta) -> str:
        time = np.linspace(self.span.begin, self.span.end, 41)
        course = self.course(time, theta)
        course = course - course[0]
        k = int(np.linalg.norm(course, axis=1).argmax())
        size = float(np.linalg.norm(course[k]))
        return f"the whole finger moving by {size:.2g} mm {direction(course[k])} until {time[k]:.3g} s"


class WrongPicture(StandIn):
    """The picture is wrong: by an affine map of x and z, by keystones, and by a lens (r^2)."""

    order, kind, sentence = Order.CAMERA, "camera", "the camera's picture is distorted"
    WORDS: ClassVar[dict[str, str]] = {
        "xx": "stretched along the finger by {:.2g} %", "xz": "sheared along the finger by {:.2g} %",
        "zx": "turned or sheared upwards by {:.2g} %", "zz": "stretched upwards by {:.2g} %",
        "kx": "a keystone along the finger, {:.2g} % over 100 mm",
        "kz": "a keystone upwards, {:.2g} % over 100 mm", "r2": "distorted by the lens, {:.2g} % at 100 mm",
    }  # fmt: skip

    def __init__(self) -> None:
        super().__init__("picture", self.WORDS, "", most=0.3, step=0.01, likely=0.03)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        at = {name: self.of(theta, name) for name in self.WORDS}
        seen = test.points + u - test.points.mean(axis=0)
        x, z = seen[..., 0], seen[..., 2]
        radial = (at["kx"] * x + at["kz"] * z) / 100.0 + at["r2"] * (x**2 + z**2) / 1e4
        wrong_x = at["xx"] * x + at["xz"] * z + radial * x
        wrong_z = at["zx"] * x + at["zz"] * z + radial * z
        return u + np.stack([wrong_x, np.zeros_like(x), wrong_z], axis=-1)

    def resembles(self, theta: Theta) -> str:
        name = max(self.WORDS, key=lambda n: abs(self.of(theta, n)))
        return f"a picture {self.WORDS[name].format(100 * abs(self.of(theta, name)))}"


class MarkerJump(StandIn):
    """One marker jumps in the picture, at any of some times (k,) s."""

    order, kind, sentence = Order.SLIP, "slip", "one marker has slipped or was mistaken"

    def __init__(self, marker: str, times: Array) -> None:
        self.marker, self.times = marker, tuple(float(t) for t in times)
        names = (f"{way}{k}" for k in range(len(self.times)) for way in ("along", "up"))
        super().__init__(_name("slip_of", marker), names, "mm", most=5.0, step=0.05, likely=0.5)

    def _jumps(self, theta: Theta) -> Array:
        """The jumps (k, 3) mm."""
        along, up = np.reshape(self.numbers(theta), (-1, 2)).T
        return np.stack([along, np.zeros_like(up), up], axis=1)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        after = np.asarray(test.path.output[:, None] >= np.array(self.times), float)
        own = np.array([m == self.marker for m in test.markers], float)
        return u + own[:, None] * (after @ self._jumps(theta))[:, None]

    def resembles(self, theta: Theta) -> str:
        sizes = np.linalg.norm(self._jumps(theta), axis=1)
        k = int(sizes.argmax())
        return f"marker {self.marker} slipping by {sizes[k]:.2g} mm at {self.times[k]:.3g} s"


# -- words ---------------------------------------------------------------------------------------------------


def _name(first: str, marker: str) -> str:
    """A name of small letters and digits, of a marker's whatever that has."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in marker.lower())
    return f"{first}_{plain}"


def where(place: float) -> str:
    """A place along the finger, from 0 at the clamp to 1 at the tip, in words."""
    if place >= 0.85:
        return "near the tip"
    return "near the clamp" if place <= 0.15 else f"at {place:.2g} of the length from the clamp"


def softer(much: float) -> str:
    """How much softer a material is, in words."""
    return f"{100 * abs(much):.2g} % {'softer' if much > 0 else 'stiffer'}"


def direction(vector: Array) -> str:
    """Where a vector (3,) points to, in words: its largest part, and another of more than half of that."""
    pairs = (("towards the tip", "towards the clamp"), ("to +y", "to -y"), ("up", "down"))
    order = sorted(range(3), key=lambda i: -abs(vector[i]))
    first, second = (pairs[i][int(vector[i] < 0)] for i in order[:2])
    both = abs(vector[order[1]]) > 0.5 * abs(vector[order[0]])
    return f"{first} and {second}" if both else first
