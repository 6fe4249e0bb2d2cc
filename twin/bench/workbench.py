"""The calibration problem of a project: targets, model and whitener, for every stage after `measure`."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TypeVar

from fe import Case
from twin.bench.engines import jobs_of
from twin.bench.fits import held_fit, newest
from twin.bench.priors import TAILS, known_values
from twin.bodies.body import Body
from twin.bodies.finger import BuiltIn
from twin.calibrated.caches import Store
from twin.calibrated.positions import PlacedPoint, fault_of, on_both_sides, on_structure, placed, seen_at_rest
from twin.calibrated.problem import BEYOND, CalibrationProblem, Carried
from twin.coupons.pulltest import pull_tests
from twin.effects.material import Elasticity
from twin.effects.opendimensions import QUARTER, OpenDimensions
from twin.effects.ownfiles import own_effects
from twin.effects.protocol import Effect, Unsolvable
from twin.gravity import density
from twin.judging.fitrecord import FitRecord
from twin.laws.catalogue import named_law
from twin.laws.law import STRETCH, Constants, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.model.enginejobs import EngineJobs
from twin.model.objects import RigidObject
from twin.model.structure import Structure, beside, body_case, closed, in_law, of_body, of_deck, weighed
from twin.project.folder import Project
from twin.project.trust import check_trusted, programs
from twin.ringing.quasistatic import without_ringing
from twin.targets import Targets

Given = TypeVar("Given")
WALL_SD_MM = 0.1  # of the dimensions that a table of wall_sd_mm does not name
TRIES = 6  # fits of a model that carries less than the test


@dataclass(frozen=True)
class Workbench(CalibrationProblem):
    """The calibration problem of a project."""

    project: Project = field(kw_only=True)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the effects in twin.toml."""
        return self.project.config.model.effects

    @property
    def own_effects(self) -> tuple[Effect, ...]:
        """The effects of the project's own files."""
        return own_of(self.project)

    @cached_property
    def jobs(self) -> EngineJobs | None:
        """The jobs of the program that solves the model, None where it is the embedded engine. ValueError
        where it is not installed."""
        return jobs_of(self.project)

    @staticmethod
    def of(project: Project, *, whole: bool = False) -> "Workbench":
        """The workbench of a project, with targets as far as its fitted model carries them; whole: with all.
        ValueError for unknown nodes or fixed parameters of no use."""
        structure = structure_of(project)
        elasticity = elasticity_of(project, structure.nominal)
        stated = seen_at_rest(project.targets(), structure, mirrored=one_side(project))
        targets, remarks = on_structure(
            stated, places_of(project, structure), structure.case, name="targets",
            wanted="position_mm = [x, y, z] in mm or the label of a node: add it under "
            "[[points]] in twin.toml", bends_down=bends_down(project), mirrored=one_side(project),
        )  # fmt: skip
        if (hz := project.config.calibrate.ringing_Hz) is not None:
            targets = without_ringing(targets, hz)
        priors = known_values(project, elasticity.law, own_of)
        targets = replace(targets, known=priors, tails=TAILS[project.config.calibrate.loss])
        tests = pull_tests(project.config.material_tests, project.root)
        store = Store(project.root / "cache")
        bench = Workbench(targets, structure, elasticity, remarks, tests, store=store, project=project)
        former = newest(project, FitRecord, ("calibrate",)) if bench.tests else None
        fitted = former.material_tests if former else None
        bench = bench.stretched(STRETCH / BEYOND if fitted is None else fitted.finger_stretch)
        return bench if whole else bench.carrying(carried(project))


def carried(project: Project) -> Carried | None:
    """Up to which pressures the model of a project carries its targets, by its newest fit that holds; None
    where it carries all, or there is no fit."""
    fit = held_fit(project, project.config.model.effects)
    most = fit.carried_MPa if fit else None
    return None if most is None else Carried(*most)


def as_far_as_it_carries(bench: Workbench, fitted: Callable[[Workbench], Given]) -> Given:
    """What a fit on a workbench gives; where a solve of it does not come to the highest pressure, on the
    targets up to where it came. ValueError where it comes nowhere."""
    why = ""
    for failed in range(1, TRIES + 1):
        try:
            return fitted(bench)
        except Unsolvable as error:
            t, why = bench.targets, str(error)
            used = float(t.pressure[t.used.any(axis=(1, 2))].max())
            most = bench.carried or Carried(used, float(t.pressure.max()))
            bench = bench.carrying(most.below(error.reached, failed=failed))
            if not bench.targets.used.any():
                break
    raise ValueError(f"{why}; wanted constants, effects or a mesh that carry more of the test")


def check_plausible(project: Project, targets: Targets, case: Case) -> None:
    """Raise ValueError where the targets cannot be displacements of the project's finger."""
    if fault := fault_of(targets, case, bends_down=bends_down(project), mirrored=one_side(project)):
        raise ValueError(f"targets: {fault}")


def bends_down(project: Project) -> bool:
    """True where the project's body bends to -z whatever is wrong."""
    body = body_of(project)
    return body is not None and body.bends_down


def elasticity_of(project: Project, nominal: Constants) -> Elasticity:
    """The law of a project's silicone, the bounds of its free constants and its fixed values.

    nominal: the constants until they are fitted. ValueError for constants that the law does not have.
    """
    config, law = project.config, nominal.law
    of_fit = config.calibrate.bounds
    for key, constants in (("model.fixed", config.model.fixed), ("calibrate.bounds", of_fit)):
        if unknown := sorted(set(constants) - set(law.names)):
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
    own = own_effects(project.root, project.config.model.effect_files)
    return (*own, open_dimensions(project)) if project.config.model.open else own


def open_dimensions(project: Project) -> OpenDimensions:
    """The effect of the dimensions that twin.toml leaves open. ValueError where one of its meshes folds."""
    body, table = body_of(project), project.config.model
    assert body is not None  # the configuration refuses those of a deck
    sds = tuple((name, sd) for name, (_, sd) in table.open.items())
    return _opened(body, table.mesh, sds)  # type: ignore[arg-type]  # every body is frozen


@lru_cache(maxsize=8)  # every stage asks for it several times
def _opened(body: Body, refine: int, sds: tuple[tuple[str, float], ...]) -> OpenDimensions:
    lattice = replace(body.lattice, refine=refine) if refine != 1 else body.lattice

    def larger(name: str, mm: float) -> Case:
        return body_case(body.larger(name, mm), lattice)

    pairs = {name: (larger(name, -QUARTER * sd), larger(name, QUARTER * sd)) for name, sd in sds}
    return OpenDimensions.of(body_case(body, lattice), pairs, dict(sds))


def structure_of(project: Project) -> Structure:
    """The structure of a project's model, with its stated density and rigid object. ValueError where its deck
    or object is missing or wrong."""
    table = project.config.model
    structure = on_both_sides(_unweighed(project), project.config.points, mirrored=one_side(project))
    structure = closed(structure) if table.self_contact else structure
    if table.density_kg_m3 is not None:
        structure = weighed(structure, density(table.density_kg_m3))
    return structure if table.object is None else beside(structure, RigidObject.of(table.object))


def body_of(project: Project) -> Body | None:
    """The body of a project with its dimensions, None where it is a deck."""
    model = project.config.model
    if model.deck is not None:
        return None
    if model.kind == "finger" and project.builtin is not None:
        builtin = project.builtin
        for name, (mean, _) in model.open.items():
            builtin = builtin.larger(name, mean - builtin.size(name))
        return builtin
    if model.kind == "finger" and model.finger is None and not model.open:
        return BuiltIn()
    assert model.dimensions is not None
    return model.dimensions.body


def tolerances_of(project: Project, body: Body) -> dict[str, float]:
    """The sd in mm of each dimension of a body that no camera sees. ValueError for one that it does not
    have."""
    stated = project.config.model.wall_sd_mm
    if not isinstance(stated, dict):
        return dict.fromkeys(body.inner, stated) | dict.fromkeys(project.config.model.open, 0.0)
    if unknown := sorted(set(stated) - set(body.inner)):
        raise ValueError(
            f"model.wall_sd_mm: {unknown[0]} is no inner dimension of a {body.kind}; wanted some of "
            f"{', '.join(body.inner) or 'none'}"
        )
    given = {name: stated.get(name, WALL_SD_MM) for name in body.inner}
    return given | dict.fromkeys(project.config.model.open, 0.0)  # they are parameters


def _unweighed(project: Project) -> Structure:
    table = project.config.model
    if table.deck is None:
        body = body_of(project)
        assert body is not None
        structure = of_body(body, refine=table.mesh, tolerances=tolerances_of(project, body))
        return in_law(structure, (stated_law(project) or MOONEY_RIVLIN).nominal)
    path = project.path(table.deck)
    if not path.is_file():
        raise ValueError(
            f"model.deck = {table.deck!r}: no such file in {project.root}; copy it there or correct twin.toml"
        )
    return of_deck(path, mesh=table.mesh, silicone=table.silicone, law=stated_law(project))


def places_of(project: Project, structure: Structure) -> dict[str, PlacedPoint]:
    """The places of the points that twin.toml states without a node, by name. ValueError where one is further
    than ON_FINGER_MM from the finger."""
    return placed(project.config.points, structure, mirrored=one_side(project))


def one_side(project: Project) -> bool:
    """True where a point at y < 0 of half a finger stands for its mirror image: a single camera sees only x
    and z, which are equal on both sides."""
    return len(project.config.cameras) == 1
