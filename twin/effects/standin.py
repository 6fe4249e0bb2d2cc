"""A stand-in: an explanation in plain words, by which a rest is told that no effect of the library explains.

It says how the rest looks, with size and place; it is never named as the cause. Plausible ranges are wide on
purpose, as nothing is known of what a stand-in stands for (judgement).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from twin.effects.protocol import Effect, Test, Theta, symmetric
from twin.targets import Array


class StandIn(Effect):
    """An explanation in plain words. kind: what it is, the same for those that differ in place alone."""

    def __init__(
        self, name: str, amplitudes: Iterable[str], unit: str, *, most: float, step: float, likely: float
    ) -> None:
        """amplitudes: their names; all from -most to most, plausible from -likely to likely."""
        self.name = name
        names = (f"{name}.{a}" for a in amplitudes)
        self.parameters = symmetric(*names, most=most, unit=unit, step=step, likely=likely)

    def of(self, theta: Theta, name: str) -> float:
        """The value of its parameter of that name, 0 where it has none."""
        return float(theta.get(f"{self.name}.{name}", 0.0))

    def numbers(self, theta: Theta) -> list[float]:
        """The values of its parameters."""
        return [float(theta.get(p.name, 0.0)) for p in self.parameters]

    def resembles(self, theta: Theta) -> str:
        """The stand-in in words at values of its parameters: "0.18 N near the tip, pointing up"."""
        raise NotImplementedError


@dataclass(frozen=True)
class Span:
    """The extent of a test: its first and last time in s, and its top pressure in MPa."""

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
