"""Widest families of the effects: amplitudes alone, on a fixed basis, or one for each third of the finger."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fe import Case
from twin.effects.phrases import listed
from twin.effects.protocol import Effect, Test, Theta
from twin.targets import Array

TOLD = ("name", "order", "sentence", "requires", "generic", "mechanism", "belongs")
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
        largest = sorted(self.amplitudes, key=lambda p: -abs(values[p.name]) / (p.typical or 1.0))[:SAID]
        terms = [f"{p.name.partition('.')[2]} = {values[p.name]:.2g} {p.unit}".rstrip() for p in largest]
        return f"{self.sentence}: {listed(terms)}"

    def start(self, theta: Theta) -> Theta:
        none = {p.name: 0.0 for p in self.parameters}
        return {**none, **self.rest(theta), **self.amounts(theta)}

    def rest(self, theta: Theta) -> dict[str, float]:
        """Values of what are not parameters of the effect's physics."""
        return {k: v for k, v in theta.items() if k.partition(".")[0] != self.name}

    def amounts(self, theta: Theta) -> dict[str, float]:
        """The family's amplitudes that come nearest to fitted values of another law of this physics;
        amplitudes that both have keep their values."""
        return {p.name: theta[p.name] for p in self.parameters if p.name in theta}

    def bounded(self, values: Sequence[float] | Array) -> dict[str, float]:
        """Values (k,) of its parameters by name, within their bounds."""
        pairs = zip(self.parameters, values, strict=True)
        return {p.name: float(np.clip(x, p.low, p.high)) for p, x in pairs}


def neighbours(place: float, places: Sequence[float] | Array) -> Array:
    """Weights (k,) of linear interpolation at a place between `places` (k,): two are not 0, their sum is 1.

    >>> neighbours(0.5, (0.4, 0.7, 1.0)).round(3)
    array([0.667, 0.333, 0.   ])
    """
    return np.array([np.interp(place, places, unit) for unit in np.eye(len(places))])


def in_logs(terms: Sequence[tuple[float, float]], places: Sequence[float]) -> Array:
    """Amplitudes (k,) at fixed places (k,) > 0 of terms (amplitude, place) anywhere: each is shared by its
    two neighbours, evenly in the logarithm.

    >>> in_logs([(0.1, 10.0)], (1.0, 100.0))
    array([0.05, 0.05])
    """
    return sum((x * neighbours(np.log(place), np.log(places)) for x, place in terms), np.zeros(len(places)))


# -- thirds of the finger, each with an amplitude of its own -------------------------------------------------

COUNT = 3


class Parts(Wide):
    """An effect that may be more in one part of the finger than in another: parts of equal length along it,
    from the clamp. It must change materials or the layer alone."""

    def __init__(self, effect: Effect) -> None:
        self.effect, (self.only,) = effect, effect.amplitudes
        for key in TOLD:
            setattr(self, key, getattr(effect, key))
        self.sentence = f"{effect.sentence}, in some parts of the finger more than in others"
        self.parameters = tuple(replace(self.only, name=f"{self.only.name}{k}") for k in range(1, COUNT + 1))

    def before(self, test: Test, theta: Theta) -> Test:
        sides = [self.effect.before(test, {self.only.name: theta[p.name]}) for p in self.parameters]
        return replace(test, case=in_parts([side.case for side in sides]))

    def breaks_symmetry(self, test: Test) -> bool:
        return self.effect.breaks_symmetry(test)

    def amounts(self, theta: Theta) -> dict[str, float]:
        return {p.name: theta.get(self.only.name, 0.0) for p in self.parameters}


def in_parts(cases: Sequence[Case]) -> Case:
    """The case that has the materials and the layer of each of some cases of one mesh in a part of its
    length, in their order."""
    case, count = cases[0], len(cases)
    x = case.nodes[case.connectivity].mean(axis=1)[:, 0]
    low, length = case.nodes[:, 0].min(), np.ptp(case.nodes[:, 0])
    part = np.clip((count * (x - low) / length).astype(int), 0, count - 1)
    sets, materials, layer = dict(case.element_sets), dict(case.materials), case.layer
    for name in case.materials.keys() - set(case.kept):
        if any(piece.materials[name] != materials[name] for piece in cases):
            del materials[name]
            for k, piece in enumerate(cases):
                sets[f"{name}_part{k + 1}"] = sets[name][part[sets[name]] == k]
                materials[f"{name}_part{k + 1}"] = piece.materials[name]
    if layer is not None:
        each = tuple(float(np.mean(c.layer.stiffness)) for c in cases if c.layer)
        layer = replace(layer, stiffness=each)
    return replace(case, element_sets=sets, materials=materials, layer=layer)
