"""Effects that need no structure of ours: of the pressure, the clocks and the picture, and creep by what it
does to the pressure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibrate import Parameter
from twin.effects.library import all_effects
from twin.effects.loads import first_order_lag
from twin.effects.mechanism import Mechanism
from twin.effects.phrases import number, percent, way
from twin.effects.protocol import Effect, Order, Test, Theta
from twin.effects.requirements import Requirement
from twin.effects.standin import StandIn
from twin.effects.standins import stand_ins
from twin.foreign.programs import Variant
from twin.targets import Array

TIMES = (0.5, 2.0, 8.0, 30.0)  # s, at which creep is tried


class NeedsStructure(Exception):
    """An effect asks for the structure, which a foreign model does not show."""


@dataclass(frozen=True, init=False)
class NoStructure:
    """The place of a structure in a test of a foreign model: whoever asks for anything of it, or wants it
    changed, is told so."""

    def __init__(self, **changes: Any) -> None:
        for name in changes:
            raise NeedsStructure(name)

    def __getattr__(self, name: str) -> Any:
        raise NeedsStructure(name)


class CourseCreep(Effect):
    """All moduli relax by a share g with the time tau: the motion is then that of the pressure

    p + g / (1 - g) q,  q the response of a first-order line of tau / (1 - g) to p,

    exact for a linear structure (Boltzmann's superposition; Ferry 1980, ISBN 0-471-04894-1), where one law of
    the silicone scales it.
    """

    name, order, requires = "creep", Order.LINE, (Requirement.HISTORY,)
    mechanism = Mechanism.HISTORY
    sentence = "the silicone creeps: it goes on giving way under a held pressure"
    parameters = (
        Parameter("creep.g1", 0.0, 0.6, "", null=0.0, typical=0.02, plausible=(0.0, 0.3)),
        Parameter("creep.tau1", 0.05, 600.0, "s", typical=1.0),
    )
    grid = tuple({"creep.tau1": tau} for tau in TIMES)

    def before(self, test: Test, theta: Theta) -> Test:
        g, tau, path = theta["creep.g1"], theta["creep.tau1"], test.path
        late = first_order_lag(path.time, path.pressure, tau / (1 - g))
        return replace(test, path=replace(path, pressure=path.pressure + g / (1 - g) * late))

    def told(self, values: Theta) -> str:
        share, time = percent(values["creep.g1"]), number(values["creep.tau1"])
        return f"the silicone creeps: {share} of its stiffness relaxes with {time} s"


class VariantEffect(Effect):
    """What a simulator has by a parameter of its own, as an effect."""

    order = Order.MATERIAL

    def __init__(self, variant: Variant) -> None:
        own = variant.parameter
        self.name, self.key, self.mechanism = own.name, own.name, variant.mechanism
        self.generic = UnevenBody.kind if variant.mechanism is Mechanism.BODY else ""
        self.sentence = variant.sentence or f"the simulator's {own.name} is not {own.null:g}"
        self.parameters = (replace(own, name=f"{own.name}.size"),)

    def told(self, values: Theta) -> str:
        (p,) = self.parameters
        return f"{self.sentence}: {self.name} is {number(values[p.name])} {p.unit}".rstrip()


class UnevenBody(StandIn):
    """A slender body that bends more, or less, in one part of its length than in the model: what lies beyond
    HINGES of its length turns about them by a share of the whole bend, which the farthest point tells (the
    turn of an arc is twice that of its chord). Clamped at x = 0; between points the body is taken as
    straight.
    """

    order, kind = Order.SLIP, "soft spot"
    sentence = "the body is not as stiff along its length as in the model"
    mechanism = Mechanism.BODY
    HINGES = (0.25, 0.5, 0.75)

    def __init__(self) -> None:
        names = (f"at_{100 * x:.0f}" for x in self.HINGES)
        super().__init__("uneven_body", names, "", most=1.0, step=0.01, likely=0.1)

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        at = test.points[:, ::2] + u[:, :, ::2]
        far, rows = int(test.points[:, 0].argmax()), np.argsort(test.points[:, 0])
        length = test.points[far, 0]
        bend = 2 * (np.arctan2(at[:, far, 1], at[:, far, 0]) - np.arctan2(test.points[far, 2], length))
        x, moved = np.append(0.0, test.points[rows, 0]), np.concatenate([0 * u[:, :1], u[:, rows]], axis=1)
        out = at.copy()
        for share, much in zip(self.HINGES, self.numbers(theta), strict=True):
            hinge = np.array([[np.interp(share * length, x, m[:, i]) for i in (0, 2)] for m in moved])
            hinge[:, 0] += share * length
            turn, arm = (much * bend)[:, None], out - hinge[:, None]
            c, s = np.cos(turn), np.sin(turn)
            turned = np.stack([c * arm[..., 0] - s * arm[..., 1], s * arm[..., 0] + c * arm[..., 1]], axis=-1)
            out = np.where((test.points[:, 0] > share * length)[:, None], hinge[:, None] + turned, out)
        seen = u.copy()
        seen[:, :, ::2] = out - test.points[:, ::2]
        return seen

    def resembles(self, theta: Theta) -> str:
        k = int(np.abs(self.numbers(theta)).argmax())
        much = self.numbers(theta)[k]
        return (
            f"a body that bends {way(much, 'more', 'less')} at {percent(self.HINGES[k])} of its length, by "
            f"{percent(much)} of its whole bend"
        )

    def variant(self, theta: Theta) -> str:
        """The change of a simulator that would do as much: the part of the length about the hinge that turns
        most, and by how much it is softer, what it turns more over its share of an even bend.

        >>> e = UnevenBody()
        >>> e.variant({p.name: x for p, x in zip(e.parameters, (0.0375, 0.0, -0.01))})
        'with the walls about 10 % thinner from 0 % to 38 % of its length'
        """
        k = int(np.abs(self.numbers(theta)).argmax())
        between = (np.array(self.HINGES[1:]) + self.HINGES[:-1]) / 2
        start, end = np.array([0.0, *between, 1.0])[k : k + 2]
        softer = self.numbers(theta)[k] / (end - start)
        where = f"from {percent(start)} to {percent(end)} of its length"
        return f"with the walls about {percent(softer)} {way(softer, 'thinner', 'thicker')} {where}"


def candidates(test: Test, variants: Sequence[Variant] = ()) -> tuple[Effect, ...]:
    """The effects that a foreign model can have: its variants, creep, and those of the library that ask for
    nothing of the structure."""
    own = tuple(map(VariantEffect, variants))
    known = (CourseCreep(), *(e for e in all_effects() if _is_free(e, test) and e.name != CourseCreep.name))
    return (*own, *(e for e in known if e.name not in [v.name for v in own]))


def plain_stand_ins(test: Test) -> tuple[Effect, ...]:
    """The stand-ins that ask for nothing of the structure, and one for the body."""
    return (UnevenBody(), *(e for e in stand_ins(test) if _is_free(e, test)))


def _is_free(effect: Effect, test: Test) -> bool:
    """True if an effect changes the pressure's course and the picture alone, without the structure."""
    try:
        effect.breaks_symmetry(test)
        values = {p.name: p.low if p.null is None else p.null + p.step for p in effect.parameters}
        values |= effect.tries(test)[0]
        changed = effect.before(test, values)
        effect.after(np.zeros((len(test.path.output), len(test.points), 3)), changed, values)
        return changed.case is test.case and not changed.slips and not changed.perturbations
    except NeedsStructure:
        return False
