"""The widest family of an effect's physics: amplitudes alone, on a fixed basis."""

from collections.abc import Sequence

import numpy as np

from twin.effects.amounts import listed
from twin.effects.protocol import Effect, Theta
from twin.targets import Array

TOLD = ("name", "order", "sentence", "requires", "generic")
SAID = 3  # amplitudes of a family that are told where nothing better is known of it


class Wide(Effect):
    """The widest family of an effect's physics, `creep:wide`; null is 0.

    of: the effect, `class CreepSpectrum(Wide, of=Creep)`: what the family does not state of itself is as
    there.
    """

    def __init_subclass__(cls, of: type[Effect] | None = None) -> None:
        for key in TOLD if of else ():
            if key not in vars(cls):
                setattr(cls, key, getattr(of, key))
        super().__init_subclass__()

    @property
    def label(self) -> str:
        return f"{self.name}:wide"

    def told(self, values: Theta) -> str:
        """The sentence, and the amplitudes that are most felt."""
        own = sorted(self.amplitudes, key=lambda p: -abs(values[p.name]) / (p.typical or 1.0))[:SAID]
        said = [f"{p.name.partition('.')[2]} = {values[p.name]:.2g} {p.unit}".rstrip() for p in own]
        return f"{self.sentence}: {listed(said)}"

    def start(self, theta: Theta) -> Theta:
        none = {p.name: 0.0 for p in self.parameters}
        return {**none, **self.rest(theta), **self.amounts(theta)}

    def rest(self, theta: Theta) -> dict[str, float]:
        """Values of what are not parameters of the effect's physics."""
        return {k: v for k, v in theta.items() if k.partition(".")[0] != self.name}

    def amounts(self, theta: Theta) -> dict[str, float]:
        """What the values of any law of the same physics amount to in amplitudes; those that the law has,
        too, as they are."""
        return {p.name: theta[p.name] for p in self.parameters if p.name in theta}

    def bounded(self, values: Sequence[float] | Array) -> dict[str, float]:
        """Values (k,) of its parameters by name, within their bounds."""
        pairs = zip(self.parameters, values, strict=True)
        return {p.name: float(np.clip(x, p.low, p.high)) for p, x in pairs}


def neighbours(place: float, places: Sequence[float] | Array) -> Array:
    """The shares (k,) by which the two of `places` (k,) next to a place carry what is there."""
    return np.array([np.interp(place, places, unit) for unit in np.eye(len(places))])


def in_logs(terms: Sequence[tuple[float, float]], places: Sequence[float]) -> Array:
    """Amplitudes (k,) at fixed places (k,) > 0 of terms (amplitude, place) anywhere: each is shared by its
    two neighbours, evenly in the logarithm."""
    return sum((x * neighbours(np.log(at), np.log(places)) for x, at in terms), np.zeros(len(places)))
