"""A project -> its targets, model and whitener: what every stage after `measure` starts from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibrate import Fit
from fe import Case, Path
from fe.element import Integers
from fe.mesh.points import nearest
from fe.solver.limits import largest_stretch
from fe.solver.newton import Problem
from twin.bench.caches import FolderCache, SolvedList
from twin.bench.engines import jobs_of
from twin.bench.fits import newest
from twin.bench.knownvalues import TAILS, known_values
from twin.bench.positions import on_surface, one_side, places_of
from twin.bodies.body import Body
from twin.bodies.finger import BuiltIn
from twin.coupons.pulltest import PullTest, pull_tests
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.effects.ownfiles import own_effects
from twin.effects.protocol import Effect
from twin.gravity import density, ways
from twin.judging.jointfit import agreement
from twin.judging.judged import Judged, judge, judge_fit
from twin.judging.lawlevels import with_laws
from twin.judging.record import FitRecord, MaterialTestsRow
from twin.laws.catalogue import named_law
from twin.laws.law import Constants, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.laws.stability import STRETCH
from twin.messages import Say
from twin.model.basemodel import base_model, base_test
from twin.model.discretisation import Discretisation, SolvedAt, discretisation_error, meshes_key
from twin.model.enginejobs import EngineJobs
from twin.model.enginemodel import EngineModel
from twin.model.objects import RigidObject
from twin.model.prediction import Model
from twin.model.structure import Structure, beside, closed, in_law, of_body, of_deck, weighed
from twin.project.folder import Project
from twin.project.trust import check_trusted, programs
from twin.sanity import motion_fault, place_fault, rise_fault
from twin.targets import Array, PointKind, Targets, as_position

OFF_MODEL_MM = 0.5
# the scale of finer meshes over that of the model they serve, at most and either way, where it does more than
# to scale the pressure
SAME = 1.05
BEYOND = 1.2  # times the largest stretch in the finger: how far curves of the silicone are used


@dataclass(frozen=True)
class Workbench:
    """What a stage works with."""

    project: Project
    targets: Targets
    structure: Structure
    elasticity: Elasticity
    remarks: tuple[str, ...] = ()  # what was done to the targets, one sentence each
    tests: tuple[PullTest, ...] = ()  # of the silicone itself; the targets have their curves
    finger_stretch: float | None = None  # the largest in the finger, up to BEYOND of which they are used

    @property
    def case(self) -> Case:
        """The structure with nominal constants."""
        return self.structure.case

    @cached_property
    def jobs(self) -> EngineJobs | None:
        """The jobs of the program that solves the model, None where it is the embedded engine. ValueError
        where it is not installed."""
        return jobs_of(self.project)

    @property
    def scales(self) -> bool:
        """Whether U depends on pressure / scale and the law's shape alone."""
        return self.structure.scales and not self.gravities[0].any()

    @property
    def gravities(self) -> tuple[Array, Integers]:
        """The different gravities and hung forces (g, 3 + 3 h) of the targets' steps, and which of them (s,)
        acts on each."""
        return ways(self.case, self.path)

    @property
    def path(self) -> Path:
        """What loads the structure in the targets."""
        return base_test(self.targets, self.case).path

    @staticmethod
    def of(project: Project) -> "Workbench":
        """The workbench of a project. ValueError for unknown nodes or fixed parameters of no use."""
        structure = structure_of(project)
        elasticity = elasticity_of(project, structure.nominal)
        targets = on_surface(project.targets(), places_of(project, structure))
        for point in targets.points:
            if point.kind is PointKind.UNKNOWN:
                raise ValueError(
                    f"point {point.name!r} has no place on the finger; wanted position_mm = [x, y, z] in mm "
                    "or the label of a node: add it under [[points]] in twin.toml"
                )
            if point.node is not None:
                structure.case.position(point.node)  # names what is wrong with an unknown node
        targets, remarks = _on_model(targets, structure.case)
        check_plausible(project, targets, structure.case)
        if structure.case.pressurised and (fault := rise_fault(targets)):
            raise ValueError(f"targets: {fault}")
        known = known_values(project, elasticity.law, own_of)
        targets = replace(targets, known=known, tails=TAILS[project.config.calibrate.loss])
        tests = pull_tests(project.config.material_tests, project.root)
        bench = Workbench(project, targets, structure, elasticity, remarks, tests)
        former = newest(project, FitRecord, ("calibrate",)) if bench.tests else None
        fitted = former.material_tests if former else None
        return bench.stretched(STRETCH / BEYOND if fitted is None else fitted.finger_stretch)

    def stretched(self, finger: float | None) -> "Workbench":
        """The same with the curves of the silicone's tests up to BEYOND of the largest stretch in the finger;
        None: all of them."""
        curves = tuple(test.curve(np.inf if finger is None else BEYOND * finger) for test in self.tests)
        return replace(self, targets=replace(self.targets, curves=curves), finger_stretch=finger)

    def reaching(self, model: Model, theta: Array) -> "Workbench":
        """The same with the curves as far as a model stretches the finger at theta (d,)."""
        if not self.tests or self.jobs is not None:
            return self
        solution = model.solution(theta)
        problem = Problem.of(solution.case)
        return self.stretched(max(largest_stretch(problem, curve.u[-1])[0] for curve in solution.curves))

    @property
    def of_film(self) -> "Workbench":
        """The same without tests of the silicone: for what asks the film alone."""
        return replace(self, targets=replace(self.targets, curves=()), tests=())

    def agreement(self, judged: Judged) -> MaterialTestsRow | None:
        """How a judged model agrees with the tests of the silicone; None where there are none."""
        return agreement(judged, self.targets, finger_stretch=self.finger_stretch)

    def model(self, labels: Sequence[str] | None = None) -> Model:
        """The base model with the effects of these labels, by default those of twin.toml."""
        model: Model = base_model(self.targets, self.case, elasticity=self.elasticity)
        if self.jobs is not None:
            model = EngineModel.of(model, self.jobs)
        for label in self.project.config.model.effects if labels is None else labels:
            added = effect(label, own=own_of(self.project), law=self.law)
            if lacking := added.lacks(self.case):
                raise ValueError(
                    f"effect {label!r}: the model ({self.project.config.model.kind}) has {lacking}; wanted "
                    "an effect that it can have: remove this one from twin.toml [model] effects"
                )
            model = model.with_effect(added)
        return model

    @property
    def law(self) -> RubberLaw:
        """The law of the silicone."""
        return self.elasticity.law

    def cache(self, say: Say) -> FolderCache:
        """The project's cache of arrays."""
        return FolderCache(self.project.root / "cache", say)

    def on_mesh(self, model: Model, theta: Array, say: Say) -> Model:
        """The model with the error of its mesh where its parameters are near theta (d,)."""
        return model.on_mesh(self.mesh(theta, model, say))

    def mesh(self, theta: Array, model: Model, say: Say) -> Discretisation | None:
        """The error of a model's mesh without its effects; None without a noise model: no test needs it.

        The finer meshes are solved at theoretical constants, once for a project, and serve again for others
        nearby.
        """
        if self.jobs is not None:
            why = f"finer meshes are solved by the embedded engine alone, and not by {self.jobs.engine.name}"
            return _warned(Discretisation.none(why), say)
        if self.targets.noise is None:
            return None
        if self.structure.unknown:
            return _warned(Discretisation.none(self.structure.unknown), say)
        test, own = model.base.test, self.elasticity.constants(model.named(theta))
        key = f"{self.law.name}-{meshes_key(test, self.structure)}"
        solved = SolvedList(self.project.root / "cache" / f"{key}-solved.json", self.law)
        at = self._solved_at(own, solved)
        found = discretisation_error(test, structure=self.structure, solved_at=at, cache=self.cache(say))
        solved.add(at)  # not before: constants without an equilibrium must not serve
        return _warned(found, say)

    def judged(self, model: Model, start: Array, say: Say, *, seed: int = 0) -> Judged:
        """The model fitted from a start (d,) near it, and judged: calibrate, add, drop and diagnose alike."""
        found = judge(self.on_mesh(model, start, say), self.targets, starts=start, seed=seed)
        return with_laws(found, self.targets)

    def judged_fit(self, model: Model, fit: Fit, say: Say) -> Judged:
        """The model judged as it was fitted."""
        found = judge_fit(self.on_mesh(model, fit.theta, say), self.targets, fit)
        return with_laws(found, self.targets, refit=False)

    def _solved_at(self, own: Constants, solved: SolvedList) -> SolvedAt:
        """Where finer meshes were solved that serve for these constants, or are to be solved.

        Where U depends on pressure / scale and the law's shape alone, nominal constants serve for all.
        """
        top, nominal = float(self.targets.log_pressure.max()), self.elasticity.nominal
        if self.scales:
            wanted = top * nominal.scale / own.scale
            # for constants twice as stiff as nominal ones, too, so that the mesh is tested at one pressure
            wanted = max(wanted, top) if top < 2 * wanted else wanted
            return solved.serving(nominal, wanted) or SolvedAt.beside(nominal, wanted)
        return solved.serving(own, top, low=1 / SAME, high=SAME) or SolvedAt.beside(own, top)


def _warned(mesh: Discretisation, say: Say) -> Discretisation:
    """The error of a mesh; where it is not known, the user hears so."""
    if mesh.unknown:
        say(
            f"The error of the mesh is not known: {mesh.unknown}. Constants and intervals hold for "
            "this mesh alone."
        )
    return mesh


def check_plausible(project: Project, targets: Targets, case: Case) -> None:
    """Raise ValueError where the targets cannot be displacements of the project's finger."""
    down = project.config.model.kind in ("finger", "pneunet")  # others may lie or bend in any way
    fault = place_fault(targets, case, mirrored=one_side(project))
    fault = fault or motion_fault(targets, case, bends_down=down)
    if fault:
        raise ValueError(f"targets: {fault}")


def elasticity_of(project: Project, nominal: Constants) -> Elasticity:
    """The law of a project's silicone: what of it is fitted, between which bounds, and what is held. nominal:
    the constants until they are fitted. ValueError for constants that the law does not have."""
    config, law = project.config, nominal.law
    for key, stated in (("model.fixed", config.model.fixed), ("calibrate.bounds", config.calibrate.bounds)):
        if unknown := sorted(set(stated) - set(law.names)):
            raise ValueError(
                f"{key}.{unknown[0]}: only {' and '.join(law.names)} can be held, by law = {law.name!r}; "
                "remove it from twin.toml (the density of a weighed finger is model.density_kg_m3)"
            )
    bounds = {**law.around(nominal), **config.calibrate.bounds}
    return Elasticity(law, bounds=bounds, fixed=config.model.fixed, nominal=nominal)


def law_of_project(project: Project) -> RubberLaw:
    """The law of a project's silicone: the one that twin.toml states, else a deck's own."""
    table = project.config.model
    if table.law is None and table.deck is not None:
        return structure_of(project).nominal.law
    return stated_law(project) or MOONEY_RIVLIN


def stated_law(project: Project) -> RubberLaw | None:
    """The law that twin.toml states; None where it states none."""
    name = project.config.model.law
    return None if name is None else named_law(name)


def own_of(project: Project) -> tuple[Effect, ...]:
    """The effects of the project's own files. ValueError where one of them is not right, or not trusted."""
    check_trusted(project.root, programs(project.root, project.config.model.effect_files))
    return own_effects(project.root, project.config.model.effect_files)


def structure_of(project: Project) -> Structure:
    """What the model of a project is made of, as heavy as it was weighed, beside its object. ValueError where
    its deck or its object is not there or not right."""
    table, found = project.config.model, _unweighed(project)
    found = closed(found) if table.self_contact else found
    if table.density_kg_m3 is not None:
        found = weighed(found, density(table.density_kg_m3))
    return found if table.object is None else beside(found, RigidObject.of(table.object))


def body_of(project: Project) -> Body | None:
    """The body of a project with its dimensions, None where it is a deck."""
    model = project.config.model
    if model.deck is not None:
        return None
    if model.kind == "finger":
        return project.builtin or (BuiltIn() if model.finger is None else model.finger.body)
    assert model.dimensions is not None
    return model.dimensions.body


def _unweighed(project: Project) -> Structure:
    table = project.config.model
    if table.deck is None:
        body = body_of(project)
        assert body is not None
        return in_law(of_body(body, refine=table.mesh), (stated_law(project) or MOONEY_RIVLIN).nominal)
    path = project.path(table.deck)
    if not path.is_file():
        raise ValueError(
            f"model.deck = {table.deck!r}: no such file in {project.root}; copy it there or correct twin.toml"
        )
    return of_deck(path, mesh=table.mesh, silicone=table.silicone, law=stated_law(project))


def _on_model(targets: Targets, case: Case) -> tuple[Targets, tuple[str, ...]]:
    """Targets whose material points lie on the model, and what was moved for that."""
    points, off = list(targets.points), {}
    for p in np.flatnonzero(targets.of_kind(PointKind.PLACE)):
        own = np.array(points[p].position)
        moved_to = nearest(case, own)
        off[points[p].name] = float(np.linalg.norm(moved_to - own))
        points[p] = replace(points[p], position=as_position(moved_to))
    worst = max(off, key=lambda name: off[name], default="")
    if off.get(worst, 0.0) > OFF_MODEL_MM:
        raise ValueError(
            f"point {worst!r} lies {off[worst]:.2f} mm off the model, wanted at most {OFF_MODEL_MM} mm: "
            "correct the region or y_mm in [dic], or the model's geometry, and measure anew"
        )
    moved = sum(distance > 0.0 for distance in off.values())
    if not moved:
        return targets, ()
    return replace(targets, points=tuple(points)), (
        f"{moved} of {len(off)} points without a node lie up to {off[worst]:.2f} mm off the model ({worst}). "
        "The nearest point of the model stands for each.",
    )
