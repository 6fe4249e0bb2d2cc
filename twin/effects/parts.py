"""The widest family of an effect of one amplitude that no other course suggests itself for: thirds of the
finger, each with an amplitude of its own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fe import Case
from twin.effects.protocol import Effect, Test, Theta
from twin.effects.widest import TOLD, Wide

COUNT = 3


class Parts(Wide):
    """An effect that may be more in one part of the finger than in another: parts of equal length along it,
    from the clamp. It must change materials or the layer alone."""

    def __init__(self, one: Effect) -> None:
        self.one, (self.only,) = one, one.amplitudes
        for key in TOLD:
            setattr(self, key, getattr(one, key))
        self.sentence = f"{one.sentence}, in some parts of the finger more than in others"
        self.parameters = tuple(replace(self.only, name=f"{self.only.name}{k}") for k in range(1, COUNT + 1))

    def before(self, test: Test, theta: Theta) -> Test:
        sides = [self.one.before(test, {self.only.name: theta[p.name]}) for p in self.parameters]
        return replace(test, case=in_parts([side.case for side in sides]))

    def breaks_symmetry(self, test: Test) -> bool:
        return self.one.breaks_symmetry(test)

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
        if any(other.materials[name] != materials[name] for other in cases):
            del materials[name]
            for k, other in enumerate(cases):
                sets[f"{name}_part{k + 1}"] = sets[name][part[sets[name]] == k]
                materials[f"{name}_part{k + 1}"] = other.materials[name]
    if layer is not None:
        each = tuple(float(np.mean(c.layer.stiffness)) for c in cases if c.layer)
        layer = replace(layer, stiffness=each)
    return replace(case, element_sets=sets, materials=materials, layer=layer)
