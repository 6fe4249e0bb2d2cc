"""The calibration problem: targets, a structure and the law of its silicone, without a folder.

A project makes one of its files (`twin/bench/workbench.py`), a notebook of a table (`twin.calibrate`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from calibrate import Fit
from fe import Case, Path
from fe.element import Integers
from fe.solver.limits import largest_stretch
from fe.solver.newton import Problem
from twin.calibrated.caches import SolvedList, Store
from twin.coupons.pulltest import PullTest
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect
from twin.gravity import ways
from twin.judging.fitrecord import MaterialTestsRow
from twin.judging.jointfit import agreement
from twin.judging.judged import Judged, judge, judge_base, judge_fit
from twin.judging.lawerrorlevels import with_laws
from twin.judging.lawerrors import erring
from twin.laws.law import Constants, RubberLaw
from twin.messages import Say
from twin.model.discretisation import Discretisation, SolvedAt, discretisation_error, meshes_key
from twin.model.enginejobs import EngineJobs
from twin.model.enginemodel import EngineModel
from twin.model.keptmodel import base_model, base_test
from twin.model.prediction import Model
from twin.model.structure import Structure
from twin.targets import Array, Targets

# the scale of finer meshes over that of the model they serve, at most and either way, where it does more than
# to scale the pressure
SAME = 1.05
SOLVED = 0.95  # of the pressure at which a solve stopped is what others are asked for
BEYOND = 1.2  # times the largest stretch in the finger: how far curves of the silicone are used


@dataclass(frozen=True)
class Carried:
    """Pressures in MPa up to which a model carries the targets of its fit, and those that are held out."""

    fitted: float
    held_out: float

    def below(self, reached: float, *, failed: int = 1) -> "Carried":
        """Pressures that a solve reaches, which came to `reached` MPa; lower ones where it says nothing, and
        the lower the more fits have failed: the next one has other constants, and may carry less."""
        known = 0.0 < reached < max(self.fitted, self.held_out)
        most = SOLVED ** 2 ** (failed - 1) * (reached if known else max(self.fitted, self.held_out))
        return Carried(min(self.fitted, most), min(self.held_out, most))


def reached_stretch(model: Model, theta: Array) -> float:
    """The largest principal stretch in the finger at the end of each path, at theta (d,)."""
    solution = model.solution(theta)
    problem = Problem.of(solution.case)
    return max(largest_stretch(problem, curve.u[-1])[0] for curve in solution.curves)


@dataclass(frozen=True)
class CalibrationProblem:
    """Targets, the structure that shows them, and which constants of its law are free.

    remarks: changes to the targets, one sentence each. tests: of the silicone itself, whose curves the
    targets have, up to BEYOND of finger_stretch, the largest stretch in the finger. carried: up to
    which pressure the model carries them, where it does not carry all. store: finer meshes that
    were solved. effects: labels of the effects in the model, of which `own` are the user's.
    mesh_error: whether finer meshes tell the error of this one.
    """

    targets: Targets
    structure: Structure
    elasticity: Elasticity
    remarks: tuple[str, ...] = ()
    tests: tuple[PullTest, ...] = ()
    finger_stretch: float | None = None
    carried: Carried | None = None
    store: Store = field(default_factory=Store)
    effects: tuple[str, ...] = ()
    own: tuple[Effect, ...] = ()
    mesh_error: bool = True

    @property
    def case(self) -> Case:
        """The structure with nominal constants."""
        return self.structure.case

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the effects in the model."""
        return self.effects

    @property
    def own_effects(self) -> tuple[Effect, ...]:
        """Effects of the user, beside the library."""
        return self.own

    @property
    def jobs(self) -> EngineJobs | None:
        """Jobs of the program that solves the model; None: the embedded engine."""
        return None

    @property
    def law(self) -> RubberLaw:
        """The law of the silicone."""
        return self.elasticity.law

    @property
    def scales(self) -> bool:
        """True where U depends on pressure / scale and the law's shape alone."""
        return self.structure.scales and not self.gravities[0].any()

    @property
    def gravities(self) -> tuple[Array, Integers]:
        """The different gravities and hung forces (g, 3 + 3 h) of the targets' steps, and which of them (s,)
        acts on each."""
        return ways(self.case, self.path)

    @property
    def path(self) -> Path:
        """The path of loads in the targets."""
        return base_test(self.targets, self.case).path

    def carrying(self, most: Carried | None) -> Self:
        """The problem with targets up to the pressures that its model carries; None: as they are."""
        if most is None:
            return self
        targets = self.targets.carried(most.fitted, most.held_out)
        return replace(self, targets=targets, carried=most)

    def stretched(self, finger: float | None) -> Self:
        """The problem with the curves of the silicone's tests up to BEYOND of the largest stretch in the
        finger; None: all of them."""
        curves = tuple(test.curve(np.inf if finger is None else BEYOND * finger) for test in self.tests)
        return replace(self, targets=replace(self.targets, curves=curves), finger_stretch=finger)

    def reaching(self, model: Model, theta: Array) -> Self:
        """The problem with the curves as far as a model stretches the finger at theta (d,)."""
        if not self.tests or self.jobs is not None:
            return self
        return self.stretched(reached_stretch(model, theta))

    @property
    def of_film(self) -> Self:
        """The problem without tests of the silicone."""
        return replace(self, targets=replace(self.targets, curves=()), tests=())

    def agreement(self, judged: Judged) -> MaterialTestsRow | None:
        """The agreement of a judged model with the tests of the silicone; None where there are none."""
        return agreement(judged, self.targets, finger_stretch=self.finger_stretch)

    def model(self, labels: Sequence[str] | None = None) -> Model:
        """The base model with the effects of these labels, by default `labels`. ValueError for an effect that
        the structure cannot have."""
        model: Model = base_model(self.targets, self.case, elasticity=self.elasticity)
        if self.jobs is not None:
            model = EngineModel.of(model, self.jobs)
        for label in self.labels if labels is None else labels:
            added = effect(label, users=self.own_effects, law=self.law)
            if lacking := added.lacks(self.case):
                raise ValueError(
                    f"effect {label!r}: the model has {lacking}; wanted an effect that it can have: leave "
                    "this one out, or remove it from [model] effects of twin.toml"
                )
            model = model.with_effect(added)
        return model

    def on_mesh(self, model: Model, theta: Array, say: Say) -> Model:
        """The model with the error of its mesh where its parameters are near theta (d,)."""
        return model.on_mesh(self.mesh(theta, model, say))

    def mesh(self, theta: Array, model: Model, say: Say) -> Discretisation | None:
        """The error of a model's mesh without its effects; None without a noise model: no test needs it.

        The finer meshes are solved at theoretical constants, once for a store, and serve again for others
        nearby.
        """
        if self.jobs is not None:
            why = f"finer meshes are solved by the embedded engine alone, and not by {self.jobs.engine.name}"
            return _warned(Discretisation.none(why), say)
        if self.targets.noise is None or not self.mesh_error:
            return None
        if self.structure.unknown:
            return _warned(Discretisation.none(self.structure.unknown), say)
        test, constants = model.base.test, self.elasticity.constants(model.named(theta))
        solved = self.store.solved(f"{self.law.name}-{meshes_key(test, self.structure)}", self.law)
        point, cache = self._solved_at(constants, solved), self.store.cache(say)
        mesh = discretisation_error(test, structure=self.structure, solved_at=point, cache=cache)
        solved.add(point)  # not before: constants without an equilibrium must not serve
        return _warned(mesh, say)

    def judged(self, model: Model, start: Array, say: Say, *, seed: int = 0) -> Judged:
        """The model fitted from a start (d,) near it, and judged: calibrate, add, drop and diagnose alike."""
        on_mesh = self.on_mesh(model, start, say)
        if not erring(model):
            return judge_base(on_mesh, self.targets, starts=start, seed=seed)
        return with_laws(judge(on_mesh, self.targets, starts=start, seed=seed), self.targets)

    def judged_fit(self, model: Model, fit: Fit, say: Say) -> Judged:
        """The model judged at a given fit, without a refit."""
        judged = judge_fit(self.on_mesh(model, fit.theta, say), self.targets, fit)
        return with_laws(judged, self.targets, refit=False)

    def _solved_at(self, constants: Constants, solved: SolvedList) -> SolvedAt:
        """Constants and pressure at which finer meshes were solved that serve for these constants, or are to
        be solved.

        Where U depends on pressure / scale and the law's shape alone, nominal constants serve for all.
        """
        top, nominal = float(self.targets.log_pressure.max()), self.elasticity.nominal
        if self.scales:
            pressure = top * nominal.scale / constants.scale
            # for constants twice as stiff as nominal ones, too, so that the mesh is tested at one pressure
            pressure = max(pressure, top) if top < 2 * pressure else pressure
            return solved.serving(nominal, pressure) or SolvedAt.beside(nominal, pressure)
        return solved.serving(constants, top, low=1 / SAME, high=SAME) or SolvedAt.beside(constants, top)


def _warned(mesh: Discretisation, say: Say) -> Discretisation:
    """The error of a mesh, after a warning where it is not known."""
    if mesh.unknown:
        say(
            f"The error of the mesh is not known: {mesh.unknown}. Constants and intervals hold for "
            "this mesh alone."
        )
    return mesh
