"""Exploration of a finger: its bending and the stretch of its walls at varied parameters and dimensions.

Constants and amplitudes of effects are parameters of a model; dimensions ask for a mesh of their own. Every
row is solved on its own and from nothing, so that it is the same whichever process solves it, and when.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np
from pydantic import ValidationError

from fe import Case, Finger, Lattice, Path
from fe.mesh.mirror import mirrored, symmetry_support
from fe.solver.limits import largest_stretch
from fe.solver.newton import Problem
from twin.bodies.finger import FLATNESS, FingerTable
from twin.bodies.kinds import BodyTable
from twin.calibrated.predictions import HIGH, LOW, turned
from twin.effects.protocol import Effect, Order, Test, Unsolvable
from twin.experiments.designs import Variable
from twin.model.keptmodel import KeptModel
from twin.model.objects import RigidObject
from twin.model.prediction import Model
from twin.model.rangedresponse import RangedResponse
from twin.model.structure import BuiltIn, beside, closed, of_body, weighed
from twin.targets import Array

HELD = 1e-6  # typical steps: the range in which a response holds what is not varied
SOLVES = 8  # of a response, for each variable beyond four two more


@dataclass(frozen=True)
class FingerAnswer:
    """Response of a finger to the pressure, relative to rest.

    u1_mm, u3_mm: displacement of the lowest place of its end face; angle_deg: turn of that face about y, down
    is positive; stretch: highest principal stretch at an integration point of its walls; nodes of the mesh.
    """

    u1_mm: float
    u3_mm: float
    angle_deg: float
    stretch: float
    nodes: int


@dataclass(frozen=True)
class VariedFinger:
    """The finger that is varied: its case, the values of all parameters of its effects (the law of its
    silicone first), and the path of its pressure, from rest to where it is looked at.

    table: the dimensions of its body, None of a deck; lattice: where it is stated, else that which the
    dimensions ask for; refine: of every cell; density in tonne/mm3, None without weight; self_contact:
    whether its walls may touch each other; thing: what it meets.
    """

    case: Case
    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    path: Path
    table: BodyTable | None = None
    lattice: Lattice | None = None
    refine: int = 1
    density: float | None = None
    self_contact: bool = False
    thing: RigidObject | None = None

    def meshed(self, dimensions: Mapping[str, float]) -> Case:
        """The case of the finger with other dimensions. ValueError where there is none."""
        assert self.table is not None
        integers = {name for name in dimensions if isinstance(getattr(self.table, name), int)}
        sizes = {name: int(x) if name in integers else x for name, x in dimensions.items()}
        body = type(self.table).model_validate({**self.table.model_dump(), **sizes}).body
        if isinstance(body, BuiltIn) and self.lattice is not None:
            body = BuiltIn(body.finger, self.lattice)
        structure = of_body(body, refine=self.refine)
        structure = closed(structure) if self.self_contact else structure
        structure = structure if self.density is None else weighed(structure, self.density)
        return (structure if self.thing is None else beside(structure, self.thing)).case

    @property
    def dimensions(self) -> frozenset[str]:
        """Names of its dimensions, none of a deck."""
        return frozenset(() if self.table is None else type(self.table).model_fields)

    def remeshes(self, name: str) -> bool:
        """True where a variable of this name changes the mesh, or moves its nodes."""
        shapes = {p.name for e in self.effects if e.order == Order.GEOMETRY for p in e.parameters}
        return name in self.dimensions or name in shapes

    def model(self, case: Case, *, everywhere: bool = False) -> KeptModel:
        """The model of a case; everywhere: it answers at all nodes."""
        test = Test(case, self.path, case.nodes[:1], np.ones(1, bool))
        if symmetry_support(case) is not None and any(e.breaks_symmetry(test) for e in self.effects):
            test = replace(test, case=mirrored(case))
        if everywhere:  # effects may move nodes
            nodes = KeptModel(test, self.effects, np.array([0])).put(self.values).case.nodes
            test = replace(test, points=nodes, moving=np.ones(len(nodes), bool))
        return KeptModel(test, self.effects, np.array([0]))


def moves_finger(effect: Effect) -> bool:
    """True where an effect changes the finger or its load under a held pressure; false for an effect on the
    measurement, or on the course of a film."""
    return effect.order < Order.SLIP and effect.order not in (Order.COURSE, Order.CLOCK)


def table_of(finger: Finger) -> FingerTable:
    """The dimensions of a finger as twin.toml states them. ValueError for a profile that it has no name
    for."""
    profiles = {flatness: name for name, flatness in FLATNESS.items()}
    if finger.flatness not in profiles:
        raise ValueError(f"finger: flatness {finger.flatness:g}: wanted one of {sorted(profiles)}")
    g = finger
    return FingerTable.model_validate({
        "length_mm": g.length, "width_mm": g.width, "height_mm": g.height, "side_wall_mm": g.side,
        "bottom_wall_mm": g.bottom, "top_wall_mm": g.top, "base_cap_mm": g.base_cap, "tip_cap_mm": g.tip_cap,
        "pleats": g.bellows, "pleat_depth_mm": 2 * g.pleat, "side_pleat_depth_mm": g.side_pleat,
        "pleat_profile": profiles[g.flatness], "edge_radius_mm": g.radius,
    })  # fmt: skip


def solved_row(finger: VariedFinger, row: Mapping[str, float]) -> FingerAnswer | str:
    """The answer of the finger with these values, by a whole solve; a sentence where there is none."""
    dimensions = {name: x for name, x in row.items() if name in finger.dimensions}
    try:
        case = finger.meshed(dimensions) if dimensions else finger.case
    except ValidationError as error:
        details = error.errors()[0]
        return ": ".join([*map(str, details["loc"]), str(details["msg"]).removeprefix("Value error, ")])
    except (ValueError, ArithmeticError, IndexError) as error:
        return str(error) or "these dimensions cannot be meshed"
    model = finger.model(case)
    values = {**finger.values, **{k: x for k, x in row.items() if k not in dimensions}}
    try:
        solution = Model.solved(model, model.theta(values)).solution
    except Unsolvable as why:
        return str(why)
    rest, end = solution.fields([0, 1])
    return _shown(Problem.of(model.put(values).case), end - rest)


Task = Callable[[], FingerAnswer | str]


def tasks_of(finger: VariedFinger, rows: Sequence[Mapping[str, float]]) -> list[Task]:
    """The rows' whole solves, as other processes take them."""
    return [partial(solved_row, finger, row) for row in rows]


@dataclass(frozen=True)
class FieldResponse:
    """A response of all nodes, in place of whole solves where no variable changes the mesh."""

    response: RangedResponse
    problem: Problem
    names: tuple[str, ...]

    @staticmethod
    def of(finger: VariedFinger, variables: Sequence[Variable]) -> "FieldResponse":
        """The response of a finger over the ranges of variables. ValueError without an equilibrium there."""
        model = finger.model(finger.case, everywhere=True)
        ranges = {v.name: (v.low, v.high) for v in variables}
        theta = model.theta(finger.values)
        within = {
            p.name: ranges.get(p.name) or _held(float(x), p.low, p.high, p.step)
            for p, x in zip(model.parameters, theta, strict=True)
        }
        solves = SOLVES + 2 * max(len(variables) - 4, 0)
        response = RangedResponse.of(model, theta, within=within, solves=solves)
        problem = Problem.of(model.put(finger.values).case)
        return FieldResponse(response, problem, tuple(p.name for p in model.parameters))

    def row(self, row: Mapping[str, float]) -> FingerAnswer | str:
        """The answer of the finger with these values; a sentence outside the range of the response."""
        values = dict(zip(self.names, self.response.middle, strict=True)) | dict(row)
        try:
            u = self.response.answer(np.array([values[name] for name in self.names])).u[1]
        except ValueError as why:
            return str(why)
        return _shown(self.problem, u)


def _held(x: float, low: float, high: float, step: float) -> tuple[float, float]:
    """A narrow range around a value, inside its bounds."""
    half = HELD * step
    return max(x - half, min(low, x)), min(x + half, max(high, x))


def _shown(problem: Problem, u: Array) -> FingerAnswer:
    """The answer of displacements u (n, 3) mm of all nodes."""
    nodes = problem.case.nodes
    face = np.flatnonzero(nodes[:, 0] > nodes[:, 0].max() - 1e-6)
    rows = [face[nodes[face, 2].argmin()], face[nodes[face, 2].argmax()]]
    angle, _ = turned((LOW, HIGH), u[None, rows], np.zeros((0, 1, 2, 3)), nodes[rows])
    stretch, _ = largest_stretch(problem, u)
    return FingerAnswer(float(u[rows[0], 0]), float(u[rows[0], 2]), float(angle[0]), stretch, len(nodes))


def farthest(pairs: Sequence[tuple[FingerAnswer, FingerAnswer]]) -> FingerAnswer:
    """The largest difference of each quantity between paired answers."""
    every = np.array([[abs(a - b) for a, b in zip(asdict(x).values(), asdict(y).values())] for x, y in pairs])
    u1, u3, angle, stretch, nodes = every.max(axis=0)
    return FingerAnswer(float(u1), float(u3), float(angle), float(stretch), int(nodes))
