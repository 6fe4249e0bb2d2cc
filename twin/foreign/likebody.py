"""Effects inside a structure that a simulator does not show, by what they do to our model of a like body."""

from collections.abc import Sequence

import numpy as np

from twin.effects.library import all_effects
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Effect, Test, Theta
from twin.foreign.courseeffects import UnevenBody
from twin.judging.judged import Judged
from twin.targets import Array, Targets


class LikeBodyEffect(Effect):
    """An effect by its shape: displacements (k, s, p, 3) mm per unit of each of its k sizes, to first order,
    at the steps and points of the data in our own model of a like body."""

    def __init__(self, effect: Effect, shape: Array) -> None:
        self.effect, self.shape = effect, shape
        self.name, self.order, self.mechanism = effect.name, effect.order, effect.mechanism
        self.generic = UnevenBody.kind if effect.mechanism is Mechanism.BODY else ""
        self.requires, self.parameters = effect.requires, effect.amplitudes
        self.sentence = f"{effect.sentence}, as in a like body"

    def after(self, u: Array, test: Test, theta: Theta) -> Array:
        size = np.array([theta[p.name] for p in self.parameters])
        return u + np.tensordot(size, self.shape, axes=1)

    def told(self, values: Theta) -> str:
        return f"{self.effect.told(values)}: its shape is that in our own model of a like body"


def like_body_effects(like: Judged, data: Targets, known: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects of the library that a simulator has not among those that are known, by the fit of our own
    model of a like body to the same data. Left out are those with a place or a time of their own, on which
    their shape depends. ValueError where the fit is not of these data."""
    model = like.model
    if model.test.path.output.shape != data.time.shape or len(model.test.points) != len(data.points):
        raise ValueError(
            f"like: a fit to {len(model.test.path.output)} steps of {len(model.test.points)} points; wanted "
            f"one to these data, of {len(data.time)} steps and {len(data.points)} points: twin.calibrate("
            "twin.pneunet(...), data)"
        )
    has = {e.name for e in known}
    inside = [
        e
        for e in all_effects()
        if e.name not in has and len(e.amplitudes) == len(e.parameters) and not e.lacks(model.test.case)
    ]
    shapes = model.tangents(like.fit.theta, inside)
    return tuple(LikeBodyEffect(e, shapes[e.label][0]) for e in inside if shapes[e.label][0].any())
