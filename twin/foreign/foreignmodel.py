"""A simulator as the diagnosis asks every model: displacements, derivatives, tangents of absent effects."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from fe import Path
from twin.effects.mechanism import Mechanism
from twin.effects.protocol import Effect, Order, Test, Theta, Unsolvable
from twin.foreign.courseeffects import NoStructure, VariantEffect
from twin.foreign.programs import Simulator
from twin.model.prediction import STEP, Model, Solved, Tangents
from twin.targets import Array, Targets

NUDGE = 0.1  # of a parameter's typical step, for differencing the simulator: 1 % of a modulus
PRESSED = 0.01  # of the highest pressure, for the same
WIDER = 10.0  # times that where the simulator's answers scatter
Asked = tuple[Theta, Test]  # a question: values by name, and the test with its pressures


class Given(Effect):
    """The parameters of a simulator, to which all effects add."""

    name, order, sentence = "simulator", Order.LAW, "the simulator's own parameters"
    mechanism = Mechanism.LAW

    def __init__(self, simulator: Simulator) -> None:
        self.parameters = simulator.parameters


@dataclass(frozen=True)
class ForeignModel(Model):
    """A model that somebody's program answers for. simulator: that program; stated (s,): the pressures of the
    data, MPa; wider: how much further its derivatives are differenced, as its answers scatter.

    The pressure at a step says where the finger is: what an effect does to the pressure moves it along dU/dp
    to first order, and by a run of its own where it is fitted.
    """

    simulator: Simulator = field(default=None, compare=False, repr=False)  # type: ignore[assignment]
    stated: Array = field(default_factory=lambda: np.zeros(0), compare=False, repr=False)
    wider: float = field(default=1.0, compare=False, repr=False)

    @staticmethod
    def of(simulator: Simulator, targets: Targets, *, wider: float = 1.0) -> "ForeignModel":
        """The base model of a simulator for data. ValueError where a point has no place."""
        points = np.array([p.position if p.position is not None else (np.nan,) * 3 for p in targets.points])
        moving = ~targets.fixed
        if (lost := moving & np.isnan(points).any(axis=1)).any():
            raise ValueError(
                f"point {targets.names[int(lost.argmax())]!r} has no place; wanted (x, y, z) in mm under "
                "points= of twin.read_table"
            )
        path = Path(targets.log_time, targets.log_pressure, targets.time)
        test = Test(NoStructure(), path, np.nan_to_num(points), moving, targets.names)  # type: ignore[arg-type]
        rests = targets.rests if targets.rests.any() else None
        return ForeignModel(
            test, (Given(simulator),), targets.reference, rests=rests, simulator=simulator,
            stated=path.at_output(), wider=wider,
        )  # fmt: skip

    @property
    def extent(self) -> str:
        """A sentence on what is solved."""
        return "The model is a program of its own: nothing is known of its mesh."

    def over(self, model: Model) -> "ForeignModel":
        """This model: it has no mesh that another could share."""
        del model
        return self

    def allowed(self, theta: Theta) -> bool:
        """True: bounds alone say where a fit may go."""
        del theta
        return True

    def put(self, theta: Theta) -> Test:
        """The test with every effect's `before` applied."""
        return self._put(theta)

    def _put(self, theta: Theta) -> Test:
        test = self.test
        for e in self.effects:
            test = e.before(test, theta)
        return test

    def solved(self, theta: Array, *, derivatives: bool = False) -> Solved:
        """The answer at theta (d,), with derivatives where they are asked for. Raises Unsolvable where the
        simulator fails."""
        values = self.named(theta)
        test = self.put(values)
        u = self._answer(values, test)
        rows = [self._column(values, k, u, test) for k in range(len(theta))] if derivatives else []
        jacobian = np.reshape(rows, (len(theta), *u.shape)) if derivatives else None
        return Solved(theta.copy(), self.seen(u, test, values), jacobian, _nothing())

    def drawn(self, theta: Array) -> Solved:
        """The answer at theta (d,): there is nothing else to draw."""
        return self.solved(theta)

    def per_pressure(self, theta: Array) -> Array:
        """dU/dp (s, p, 3) mm per MPa of the pressure at the step itself."""
        values = self.named(theta)
        return self._per_pressure(values, self.put(values))

    def tangents(self, theta: Array, effects: Sequence[Effect]) -> Tangents:
        """As `Model.tangents`: along dU/dp, and by a run for what the simulator itself can have."""
        values, out = self.named(theta), Tangents()
        test = self.put(values)
        u, slope = self._answer(values, test), self._per_pressure(values, test)
        before = self.seen(u, test, values)
        for e in effects:
            model = self.with_effect(e)
            assert isinstance(model, ForeignModel)
            nulls = {p.name: p.null for p in e.amplitudes if p.null is not None}
            out[e.label] = []
            for entry in e.tries(self.test):
                rows = []
                for p in e.amplitudes:
                    there = {**values, **nulls, **entry, p.name: nulls[p.name] + p.step}
                    changed = model.put(there)
                    moved = u + slope * (_pressure(changed) - _pressure(test))[:, None, None]
                    if isinstance(e, VariantEffect):
                        moved = model._answer(there, changed)
                    rows.append((model.seen(moved, changed, there) - before) / p.step)
                out[e.label].append(np.array(rows))
        return out

    def _answer(self, values: Theta, test: Test) -> Array:
        """Displacements (s, p, 3) mm of the simulator, 0 of fixed markers."""
        own = {p.name: values[p.name] for p in self.simulator.parameters}
        own |= self.simulator.absent
        own |= {e.key: values[e.parameters[0].name] for e in self.effects if isinstance(e, VariantEffect)}
        u = self.simulator.at(own, _pressure(test), self.stated, len(self.test.points))
        return np.where(self.test.moving[:, None], u, 0.0)

    def _two(self, sides: Sequence[Asked], middle: Asked) -> list[tuple[Asked, Array]]:
        """Two questions with their answers (s, p, 3) mm: both sides, or that side at which the simulator does
        not fail, and the middle. Raises Unsolvable where it fails at both."""
        found: list[tuple[Asked, Array]] = []
        for side in sides:
            try:
                found.append((side, self._answer(*side)))
            except Unsolvable as error:
                why = error
        if not found:
            raise why
        return found if len(found) > 1 else [*found, (middle, self._answer(*middle))]

    def _per_pressure(self, values: Theta, test: Test) -> Array:
        little = self.wider * PRESSED * float(np.abs(test.path.pressure).max())
        sides = [(values, _pressed(test, more)) for more in (little, -little)]
        ((_, a), one), ((_, b), other) = self._two(sides, (values, test))
        return np.asarray((one - other) / (a.path.pressure[0] - b.path.pressure[0]))

    def _column(self, values: dict[str, float], k: int, u: Array, test: Test) -> Array:
        """The derivative (s, p, 3) of what is seen by parameter k."""
        p = self.parameters[k]
        owner = next(e for e in self.effects if p in e.parameters)
        if isinstance(owner, (Given, VariantEffect)):
            h = self.wider * NUDGE * p.step
            sides = [
                {**values, p.name: float(np.clip(values[p.name] + way * h, p.low, p.high))} for way in (1, -1)
            ]
            ends = self._two([(side, test) for side in sides], (values, test))
        else:
            sides = [{**values, p.name: values[p.name] + way * STEP * p.step} for way in (1, -1)]
            slope = self._per_pressure(values, test)
            asked = [(side, self.put(side)) for side in sides]
            ends = [(q, u + slope * (_pressure(q[1]) - _pressure(test))[:, None, None]) for q in asked]
        ((a, there), one), ((b, beside), other) = ends
        change = self.seen(one, there, a) - self.seen(other, beside, b)
        return np.asarray(change / (a[p.name] - b[p.name]))


def _pressure(test: Test) -> Array:
    """The pressure (s,) MPa at the steps of a test that moves a structure of undrifted moduli as far."""
    p = test.path.at_output()
    return p if test.path.stiffness is None else p / test.path.stiffness_at(test.path.output)


def _pressed(test: Test, more: float) -> Test:
    return replace(test, path=replace(test.path, pressure=test.path.pressure + more))


def _nothing() -> Any:
    """The place of a solution: without a history."""
    return SimpleNamespace(history=None)
