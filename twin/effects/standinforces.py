"""Stand-ins for what acts on the finger: forces, friction, a twist, a soft spot, a fold."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from fe import Case, Path
from fe.mesh.mirror import middle_plane
from twin.effects.forces import pulled, sections
from twin.effects.mechanism import Mechanism
from twin.effects.phrases import direction, softer, where
from twin.effects.protocol import Order, Perturbation, Test, Theta
from twin.effects.standin import Span, StandIn
from twin.effects.standinpressure import NARROW, stop
from twin.targets import Array

FADED = 1.0  # s, in which the force of friction that fades falls to 1 / e at rest (judgement)
HALF = 0.5  # of the top pressure is where a fold or a late force begins


class OutsideForce(StandIn):
    """A force from outside at a place along the finger, constant or growing with the pressure, by some of the
    WAYS. One aside is a stand-in of its own, so that the others stay on half of a symmetric mesh."""

    WAYS: ClassVar[dict[str, tuple[float, float, float]]] = {
        "along": (1.0, 0.0, 0.0), "aside": (0.0, 1.0, 0.0), "up": (0.0, 0.0, 1.0)
    }  # fmt: skip

    order, kind = Order.SUPPORT, "outside force"
    sentence = "something outside pulls or pushes"

    def __init__(self, place: float, ways: Sequence[str], *, growing: bool = False) -> None:
        self.place, self.growing = place, growing
        unit, most, step, likely = ("N/MPa", 60.0, 0.5, 10.0) if growing else ("N", 3.0, 0.02, 0.4)
        aside = "_aside" * (tuple(ways) == ("aside",))
        name = f"{'growing_' * growing}force{aside}_at_{100 * place:.0f}"
        super().__init__(name, ways, unit, most=most, step=step, likely=likely)

    def breaks_symmetry(self, test: Test) -> bool:
        del test
        return any(p.name.endswith(".aside") for p in self.parameters)

    def force(self, theta: Theta) -> Array:
        """The force (3,) in N or N/MPa."""
        return np.array([self.of(theta, axis) for axis in self.WAYS])

    def before(self, test: Test, theta: Theta) -> Test:
        force = {self.place: self.force(theta)}
        return pulled(test, *(({}, force) if self.growing else (force, {})), self.name)

    def resembles(self, theta: Theta) -> str:
        force = self.force(theta)
        size = float(np.linalg.norm(force))
        much = f"{1e-2 * size:.2g} N per 10 kPa" if self.growing else f"{size:.2g} N"
        return f"{much} {where(self.place)}, pointing {direction(force)}"


class Twist(StandIn):
    """A moment about x on the end of the finger, constant or growing with the pressure: forces up and down on
    its two sides."""

    order, kind, sentence = Order.SUPPORT, "twist", "something twists the finger"

    def __init__(self, *, growing: bool = False) -> None:
        self.growing = growing
        unit, most, step, likely = ("N mm/MPa", 2e3, 5.0, 100.0) if growing else ("N mm", 100.0, 0.2, 5.0)
        name = "growing_twist" if growing else "twist"
        super().__init__(name, ("moment",), unit, most=most, step=step, likely=likely)

    def breaks_symmetry(self, test: Test) -> bool:
        del test
        return True

    def before(self, test: Test, theta: Theta) -> Test:
        case, end = test.case, sections(test.case)[-1]
        y = case.nodes[end, 1] - middle_plane(case)
        moment = self.of(theta, "moment")
        if not moment:
            return test
        # half of a finger has one side
        sides = {sign: inside for sign in (1, -1) if (inside := sign * y > 0).any()}
        arm = 2 * float(np.mean([abs(y[inside].mean()) for inside in sides.values()]))
        forces = {f"{self.name}_{sign}": np.array([0.0, 0.0, sign * moment / arm]) for sign in sides}
        rows = {f"{self.name}_{sign}": end[inside] for sign, inside in sides.items()}
        case = replace(case, node_sets={**case.node_sets, **rows})
        if self.growing:
            return replace(test, case=replace(case, growing={**case.growing, **forces}))
        return replace(test, case=replace(case, forces={**case.forces, **forces}))

    def resembles(self, theta: Theta) -> str:
        moment = self.of(theta, "moment")
        much = f"{1e-2 * abs(moment):.2g} N mm per 10 kPa" if self.growing else f"{abs(moment):.2g} N mm"
        return f"a moment of {much} that twists the tip, its side at +y {'up' if moment > 0 else 'down'}"


class SoftSpot(StandIn):
    """A band around the finger, a fifth of its length, whose material is softer, in its lower and its upper
    half; stiffer where negative."""

    order, kind, sentence = Order.SUPPORT, "soft spot", "the silicone is softer or stiffer at one place"
    mechanism = Mechanism.BODY
    HALVES = ("lower", "upper")

    def __init__(self, place: float) -> None:
        self.place = place
        name = f"soft_at_{100 * place:.0f}"
        super().__init__(name, self.HALVES, "", most=0.8, step=0.05, likely=0.3)

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
            for half, (flags, much) in parts.items():
                inside = flags[rows]
                sets[f"{name}_{self.name}_{half}"] = rows[inside]
                materials[f"{name}_{self.name}_{half}"] = case.materials[name].stiffened(1 - much)
                rows = rows[~inside]
            sets[name] = rows
        return replace(test, case=replace(case, element_sets=sets, materials=materials))

    def resembles(self, theta: Theta) -> str:
        low, high = self.of(theta, "lower"), self.of(theta, "upper")
        if abs(low - high) < 0.25 * max(abs(low), abs(high)):
            return f"silicone {softer((low + high) / 2)} {where(self.place)}"
        half, much = ("lower", low) if abs(low) > abs(high) else ("upper", high)
        return f"silicone {softer(much)} in the {half} half {where(self.place)}"


# -- what comes and goes with the pressure -------------------------------------------------------------------


class Coming(StandIn):
    """Something that is there by a course of its own, to first order: `changed` at full, `course` of it at
    every output."""

    order = Order.COURSE
    span: Span

    @abstractmethod
    def changed(self, test: Test, theta: Theta) -> Case:
        """The test's case with it at full."""

    @abstractmethod
    def course(self, share: Array, time: Array) -> Array:
        """Strength (t,) along pressures (t,) over the top one at times (t,) s: 1 is all of it."""

    def before(self, test: Test, theta: Theta) -> Test:
        plus = self.changed(test, theta)
        away = plus if plus is test.case else self.changed(test, {k: -v for k, v in theta.items()})
        perturbation = Perturbation(plus, away, self.at_output(test.path))
        return replace(test, perturbations=(*test.perturbations, perturbation))

    def at_output(self, path: Path) -> Array:
        """The `course` (s,) at the outputs of a path."""
        return np.interp(path.output, path.time, self.course(path.pressure / self.span.top, path.time))


class ComingForce(Coming):
    """A force on the finger at a place, by a course of its own."""

    def __init__(self, name: str, place: float, span: Span) -> None:
        self.place, self.span = place, span
        name = f"{name}_at_{100 * place:.0f}"
        super().__init__(name, ("along", "up"), "N", most=2.0, step=0.02, likely=0.2)

    def force(self, theta: Theta) -> Array:
        """The force (3,) in N at full."""
        return np.array([self.of(theta, "along"), 0.0, self.of(theta, "up")])

    def changed(self, test: Test, theta: Theta) -> Case:
        return pulled(test, {self.place: self.force(theta)}, {}, self.name).case


class LateForce(ComingForce):
    """A force that comes above half of the top pressure: something that is touched then, or pulled taut."""

    kind, sentence = OutsideForce.kind, "the finger touches something, or pulls it taut"

    def __init__(self, place: float, span: Span) -> None:
        super().__init__("late_force", place, span)

    def course(self, share: Array, time: Array) -> Array:
        del time
        return late(share)

    def resembles(self, theta: Theta) -> str:
        force = self.force(theta)
        much = f"{float(np.linalg.norm(force)):.2g} N {where(self.place)}, pointing {direction(force)}"
        return f"{much}, growing {_rises(self.span)}"


class Friction(ComingForce):
    """Friction on the finger at a place: a force that reverses when the pressure turns back; one that fades
    as rubber creeps in its grip is gone soon after the finger rests."""

    kind, sentence = "friction", "the finger rubs on something"

    def __init__(self, place: float, span: Span, *, fading: bool = False) -> None:
        self.fading = fading
        super().__init__(f"{'fading_' * fading}friction", place, span)

    def course(self, share: Array, time: Array) -> Array:
        return stop(share, NARROW, np.exp(-np.diff(time) / FADED) if self.fading else None)

    def resembles(self, theta: Theta) -> str:
        force = self.force(theta)
        much = f"a friction of {float(np.linalg.norm(force)):.2g} N {where(self.place)}"
        rest = ", fading at rest" * self.fading
        return f"{much}, pointing {direction(force)} while the pressure rises, and back while it falls{rest}"


class Fold(Coming):
    """A band around the finger that gives way above half of the top pressure, in its lower and its upper
    half: as much softer at the top as stated."""

    kind, sentence = "fold", "a wall folds or buckles under high pressure"
    mechanism = Mechanism.BODY

    def __init__(self, place: float, span: Span) -> None:
        self.spot, self.span = SoftSpot(place), span
        name = f"fold_at_{100 * place:.0f}"
        super().__init__(name, SoftSpot.HALVES, "", most=0.8, step=0.05, likely=0.3)

    def changed(self, test: Test, theta: Theta) -> Case:
        return self.spot.before(test, self._soft(theta)).case

    def _soft(self, theta: Theta) -> dict[str, float]:
        return {f"{self.spot.name}.{half}": self.of(theta, half) for half in SoftSpot.HALVES}

    def course(self, share: Array, time: Array) -> Array:
        del time
        return late(share)

    def resembles(self, theta: Theta) -> str:
        return f"a fold: {self.spot.resembles(self._soft(theta))}, growing {_rises(self.span)}"


def late(share: Array) -> Array:
    """The part (t,) that is there at pressures (t,) over the top one of what begins at HALF of that.

    >>> late(np.array([0.2, 0.5, 0.75, 1.0]))
    array([0. , 0. , 0.5, 1. ])
    """
    return np.maximum(share - HALF, 0.0) / (1 - HALF)


def _rises(span: Span) -> str:
    """Where that grows, in words."""
    return f"from {1e3 * HALF * span.top:.2g} kPa to {1e3 * span.top:.2g} kPa"
