"""A model whose solves are jobs of another program, and what that program cannot do for it.

A job holds no derivatives. Those by parameters that change the case are differences of two jobs; those by
parameters that change the pressure or the picture alone take no further job.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calibrate import Parameter
from fe import Case, Solution
from fe.element import Integers
from fe.engines.engine import along
from twin.effects.protocol import Effect, Test, Unsolvable
from twin.gravity import ways
from twin.laws.law import Constants
from twin.model.enginejobs import EngineJobs
from twin.model.firstorder import MarkerPoints
from twin.model.prediction import Model, Solved, Tangents, moved
from twin.targets import Array

JOB_STEP = 0.2  # of a parameter's typical step: 2 % of C10; the six digits of a result leave 0.1 % of it
PLAIN_STEP = 1e-4  # of the same, where both sides come from one job


@dataclass(frozen=True)
class EngineModel(Model):
    """A model that another program solves. jobs: the program, and what it has solved."""

    jobs: EngineJobs = field(default=None, compare=False, repr=False)  # type: ignore[assignment]

    @staticmethod
    def of(model: Model, jobs: EngineJobs) -> "EngineModel":
        """A base model by the jobs of a program. ValueError where the program cannot solve it."""
        engine_model = EngineModel(model.test, model.effects, model.reference, rests=model.rests, jobs=jobs)
        check_engine(engine_model)
        return engine_model

    def with_effect(self, effect: Effect) -> "EngineModel":
        """The model with one more effect. ValueError where the program cannot solve it."""
        model = super().with_effect(effect)
        assert isinstance(model, EngineModel)
        check_engine(model)
        return model

    def solved(self, theta: Array, *, derivatives: bool = False) -> Solved:
        """The solve at theta (d,), with derivatives where they are asked for. Raises Unsolvable where a job
        fails."""
        values = self.named(theta)
        test = self.put(values)
        solution = self._solution(test)
        u = self.seen(moved(test, solution), test, values)
        rows = [self._column(theta, k, test, u) for k in range(len(theta))] if derivatives else []
        return Solved(theta.copy(), u, np.stack(rows) if derivatives else None, solution)

    def drawn(self, theta: Array) -> Solved:
        """The solve at theta (d,) for whoever draws it."""
        return self.solved(theta)

    def tangents(self, theta: Array, effects: Sequence[Effect]) -> Tangents:
        """Nothing: ValueError, as a job holds no derivatives by effects that are absent."""
        raise ValueError(no_derivatives(self.jobs.engine.name))

    def _solution(self, test: Test) -> Solution:
        gravities, number = ways(test.case, test.path)
        highest = float(test.path.at_output().max())
        courses = [self.jobs.course(test.case, highest, g[:3]) for g in gravities]
        return along(test.case, test.path, courses, number)

    def _text(self, test: Test) -> str:
        """The deck of a test's case with the directions of gravity: all that the program sees."""
        gravities, _ = ways(test.case, test.path)
        return f"{self.jobs.engine.deck(test.case, 1e-3, levels=1)}{gravities.tolist()}"

    def _column(self, theta: Array, k: int, test: Test, u: Array) -> Array:
        """The derivative (s, p, 3) of what is seen by parameter k: a difference to the side that has room and
        can be solved."""
        p, why = self.parameters[k], ""
        nudge = PLAIN_STEP * p.step * (1 if theta[k] + PLAIN_STEP * p.step <= p.high else -1)
        changed = self.put(self.named(theta + nudge * np.eye(len(theta))[k]))
        step = p.step * (PLAIN_STEP if self._text(changed) == self._text(test) else JOB_STEP)
        for h in (step, -step) if theta[k] + step <= p.high else (-step, step):
            beside = theta + h * np.eye(len(theta))[k]
            try:
                values = self.named(beside)
                test = self.put(values)
                there = self.seen(moved(test, self._solution(test)), test, values)
            except Unsolvable as error:
                why = str(error)
                continue
            return np.asarray((there - u) / h)
        raise Unsolvable(why)


@dataclass(frozen=True)
class EnginePaths:
    """As `loadpaths.Turned`, with a job for each candidate and direction of gravity.

    followed: points that tell where the markers are; top: the highest pressure in MPa, which every candidate
    must reach; gravities (g, 3) and which of them (s,) acts on each step.
    """

    case: Case
    followed: MarkerPoints
    top: float
    jobs: EngineJobs
    gravities: Array
    of_step: Integers

    def ahead(self, every: Sequence[Constants]) -> None:
        """Do the jobs of several candidates at a time, before `predict` is asked for each."""
        cases = [self._case(constants) for constants in every]
        for k in np.unique(self.of_step):
            self.jobs.ahead(cases, self.top, self.gravities[k], at=self.followed.points)

    def predict(
        self, constants: Constants, pressure: Array, *, steps: Integers | None = None
    ) -> Array | None:
        """Displacements (s, p, 3) mm of the markers at pressures (s,) MPa; None where a job fails:
        `jobs.failed` says why."""
        from scipy.interpolate import CubicSpline

        number, case = self.of_step if steps is None else self.of_step[steps], self._case(constants)
        points = self.followed.points
        out = np.empty((len(pressure), len(points), 3))
        for k in np.unique(number):
            try:
                q, u = self.jobs.course(case, self.top, self.gravities[k], at=points)
            except Unsolvable:
                return None
            out[number == k] = CubicSpline(q, u, axis=0)(pressure[number == k])
        return self.followed.seen(out)

    def _case(self, constants: Constants) -> Case:
        return self.case.with_material(**constants.terms)


# -- what a program cannot do --------------------------------------------------------------------------------


def no_derivatives(name: str) -> str:
    """The message of a stage that asks for derivatives and has none."""
    return (
        f"{name} gives no derivatives by effects that the model has not; set engine = \"embedded\" under "
        "[model] of twin.toml and run twin calibrate again"
    )


def check_engine(model: EngineModel) -> None:
    """ValueError for an effect that the model's program cannot solve, which it names with the way out."""
    engine = model.jobs.engine
    remedy = 'set engine = "embedded" under [model] of twin.toml'
    values = {p.name: _tried(p) for p in model.parameters}
    test = model._whole[0]
    if why := _refused(test, model.jobs):
        raise ValueError(f"{engine.name} cannot solve this finger: {why}; {remedy}")
    for e in model.effects:
        test = e.before(test, {**values, **e.tries(test)[0]})
        if why := _refused(test, model.jobs):
            raise ValueError(
                f"effect {e.label!r}: {engine.name} cannot solve it: {why}; {remedy}, or drop it"
            )


def _tried(p: Parameter) -> float:
    """A value at which a parameter does something."""
    null = p.start if p.null is None else p.null
    middle = (p.low + p.high) / 2 if null is None else null
    return float(np.clip(middle + (p.step / 2 if p.null is not None else 0.0), p.low, p.high))


def _refused(test: Test, jobs: EngineJobs) -> str:
    """The reason for which a program cannot solve a test; "" where it can."""
    if why := jobs.engine.unfit(test.case):
        return why
    if test.perturbations:
        return "it is known to first order alone, from derivatives that no job gives"
    if test.path.stiffness is not None and np.any(test.path.stiffness != 1):
        return "moduli that drift with time; a job is one rise of the pressure"
    if test.path.chambers:
        return "chambers with another share of the pressure in each recording, which a job does not have"
    if np.any(test.path.pulls):
        return "a hung load or another force of the targets, which a job does not have"
    if test.case.contact is not None and test.case.contact.friction:
        return "friction, which depends on what was before; a job is one rise of the pressure"
    for m in test.case.materials.values():
        for what, there in (("creep", m.prony), ("Mullins softening", m.mullins and m.mullins[0])):
            if there:
                return f"{what}, which depends on what was before; a job is one rise of the pressure"
    try:
        jobs.engine.deck(test.case, 1e-3, levels=1)
    except ValueError as error:
        return str(error)
    return ""
