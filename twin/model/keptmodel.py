"""A model that keeps its last solves: the same answers as a model without a memory, sooner.

What was solved is served when it is asked for again, bit for bit, and so is that there is no equilibrium.
Any other question is solved to the tolerance of Newton's method; a solve nearby serves as a start only. So
what was asked before changes a prediction by less than `SAME`.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from fe import Case, Path, Solution
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect, Order, SeenAtRest, Test, Unsolvable
from twin.effects.requirements import swings
from twin.gravity import of_targets, pulls_of, shares_of
from twin.model.discretisation import Discretisation
from twin.model.firstorder import standoffs
from twin.model.prediction import Model, Solved
from twin.targets import Array, Targets

SAME = 1e-6  # mm, between predictions of one model after other questions; the null of an effect keeps it, too
KEPT = 6  # solves of a model
FAILED = 60  # thetas without an equilibrium: a fit asks for them over and over, and each costs as a solve

Failure = tuple[str, float]  # why, and the pressure in MPa that was reached


@dataclass(frozen=True)
class KeptModel(Model):
    """A model with its last solves, and with an object for each model made from it by adding an effect."""

    _solves: list[Solved] = field(default_factory=list, init=False, compare=False, repr=False)
    _kin: dict[str, "KeptModel"] = field(default_factory=dict, init=False, compare=False, repr=False)
    _failed: dict[bytes, "Failure"] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def kept(self) -> tuple[Solved, ...]:
        """The solves that it has."""
        return tuple(self._solves)

    @property
    def failures(self) -> int:
        """How many parameters it knows to have no equilibrium."""
        return len(self._failed)

    def on_mesh(self, mesh: Discretisation | None) -> Self:
        """The model whose predictions carry the error of its mesh, with the solves that were kept."""
        model = super().on_mesh(mesh)
        model._solves.extend(map(model._seen_again, self._solves))
        return model

    def with_effect(self, effect: Effect) -> "KeptModel":
        """The model with one more effect, with the solves that it has kept."""
        if effect.label not in self._kin:
            model = super().with_effect(effect)
            assert isinstance(model, KeptModel)
            self._kin[effect.label] = model
        return self._kin[effect.label]

    def solved(self, theta: Array, *, derivatives: bool = False) -> Solved:
        """The solve at theta (d,), kept or made now; that with derivatives: who fits or compares asks for
        them next, and alone they cost as much as the solve."""
        earlier = self._earlier(theta)
        if earlier is not None and not (derivatives and earlier.jacobian is None):
            return earlier
        return self._made(theta, derivatives=True)

    def values(self, theta: Array) -> Solved:
        """The solve at theta (d,), kept or made now without derivatives."""
        return self._earlier(theta) or self._made(theta, derivatives=False)

    def _made(self, theta: Array, *, derivatives: bool) -> Solved:
        """A solve made now, unless it is known that there is none."""
        key = np.asarray(theta, float).tobytes()
        if key in self._failed:
            said, reached = self._failed[key]
            raise Unsolvable(said, reached=reached)
        try:
            return self._keep(super().solved(theta, derivatives=derivatives))
        except Unsolvable as why:
            while len(self._failed) >= FAILED:
                del self._failed[next(iter(self._failed))]
            self._failed[key] = str(why), why.reached
            raise

    def _earlier(self, theta: Array) -> Solved | None:
        return next((s for s in self._solves if np.array_equal(s.theta, theta)), None)

    def _keep(self, solve: Solved) -> Solved:
        others = [s for s in self._solves if not np.array_equal(s.theta, solve.theta)]
        self._solves[:] = [*others, solve][-KEPT:]
        return solve

    def _start(self, theta: Array) -> Solution | None:
        """The nearest solution, ahead to first order; for a model's first solve its parent's, which may be of
        half of its mesh."""
        model: Model = self
        near = self._nearest(theta)
        if near is None and isinstance(self.parent, KeptModel):
            model, near = self.parent, self.parent._solves[-1] if self.parent._solves else None
        if near is None:
            return None
        if near.jacobian is None:  # its directions, if any, are not those of the parameters
            return near.solution
        values = self.named(theta)
        here = np.array([values.get(p.name, 0.0) for p in model.parameters])
        perturbs = [e.order == Order.COURSE for e in model.effects for _ in e.parameters]
        change = here - near.theta
        if any(perturbs):  # they move no curve, and have directions beside those of the parameters
            more = len(near.solution.slopes) - len(change)
            change = np.append(np.where(perturbs, 0.0, change), np.zeros(more))
        return near.solution.ahead(change)

    def _nearest(self, theta: Array) -> Solved | None:
        """The kept solve with the smallest change of any parameter, in typical steps."""
        scale = np.array([p.step for p in self.parameters])
        return min(self._solves, key=lambda s: float(np.abs((s.theta - theta) / scale).max()), default=None)


# -- the base model: elasticity alone ------------------------------------------------------------------------

def base_test(targets: Targets, case: Case) -> Test:
    """The test that the targets describe: their points on the case, which has settled under its weight and
    what hangs on it, their log as the path."""
    moving = ~targets.fixed
    points = targets.places(case.position)
    places, pulls = pulls_of(targets, case.position)
    chambers, shares = shares_of(targets, case)
    weight = of_targets(targets)
    path = Path(
        targets.log_time, targets.log_pressure, targets.time, gravity=weight, places=places, pulls=pulls,
        chambers=chambers, shares=shares, settled=bool(weight.any() or pulls.any()),
    )  # fmt: skip
    if swings(targets):  # whose log must be as fine as its frames, with inertia and without
        path = path.with_outputs
    rest = None
    if any(point.rest for point in targets.points):
        first = targets.rests[targets.reference] == targets.rests[targets.reference[0]]
        places = np.array([point.rest or (np.nan,) * 3 for point in targets.points])
        rest = SeenAtRest(places, targets.reference[first])
    slips = standoffs(targets)
    return Test(case, path, np.nan_to_num(points), moving, targets.names, slips=slips, rest=rest)


def base_model(targets: Targets, case: Case, *, elasticity: Elasticity | None = None) -> KeptModel:
    """The base model of the targets on a case, by default of Mooney-Rivlin rubber, all free."""
    rests = targets.rests if targets.rests.any() else None
    law = ((elasticity or Elasticity()).fitted(),)
    return KeptModel(base_test(targets, case), law, targets.reference, rests=rests)
