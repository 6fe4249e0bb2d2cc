"""A project and ranges, C10=0.15:0.25 -> the finger that is varied, and the variables of a design."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from calibrate import Parameter
from fe import Path
from twin.bench.fits import newest_fit
from twin.bench.workbench import elasticity_of, own_of, structure_of
from twin.bodies.finger import FingerTable
from twin.bodies.kinds import BodyTable
from twin.calibrated.exploration import VariedFinger, moves_finger, table_of
from twin.effects.labels import name_of
from twin.effects.library import effect
from twin.effects.material import Elasticity
from twin.effects.protocol import Effect
from twin.experiments.designs import Variable
from twin.gravity import G, density
from twin.laws.law import Constants
from twin.model.objects import RigidObject
from twin.project.folder import Project

RAMP_S, HOLD_S = 2.0, 2.0  # as `twin predict` has them


def asked_ranges(
    project: Project, over: Sequence[str], top: float
) -> tuple[VariedFinger, tuple[Variable, ...], list[str]]:
    """The finger of a project, its varied quantities, and remarks for the user.

    over: texts NAME=LOW:HIGH; top: pressure in MPa. ValueError for a name or range that does not exist.
    """
    ranges = dict(range_of(text) for text in over)
    if not ranges or len(ranges) < len(over):
        raise ValueError("--over: wanted what is varied, each once, such as --over C10=0.15:0.25 --over "
                         "top_wall_mm=1.6:2.4")  # fmt: skip
    structure, table = structure_of(project), _dimensions(project)
    law = elasticity_of(project, structure.nominal).fitted()
    effects, unmoving = _effects(project, law, ranges)
    values, remark = _values(project, effects, law.nominal)
    named = {p.name: p for e in effects for p in e.parameters}
    variables = tuple(_variable(name, *ends, named, table) for name, ends in ranges.items())
    kg_m3 = project.config.model.density_kg_m3
    finger = VariedFinger(
        case=structure.case, effects=effects, values=values, path=_path(project, top), table=table,
        lattice=None if project.builtin is None else project.builtin.lattice,
        refine=project.config.model.mesh, density=None if kg_m3 is None else density(kg_m3),
        self_contact=project.config.model.self_contact,
        thing=None if (text := project.config.model.object) is None else RigidObject.of(text),
    )  # fmt: skip
    leaves = f"Left out, as they do not move the finger: {', '.join(unmoving)}." if unmoving else ""
    return finger, variables, [s for s in (remark, leaves) if s]


def range_of(text: str) -> tuple[str, tuple[float, float]]:
    """The name and ends of NAME=LOW:HIGH. ValueError where it is none."""
    number = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
    match = re.fullmatch(rf"\s*([\w.]+)\s*=\s*({number})\s*:\s*({number})\s*", text, re.I)
    if match is None or not float(match[2]) < float(match[3]):
        raise ValueError(f"--over {text!r}: wanted NAME=LOW:HIGH, the lower first, such as C10=0.15:0.25 "
                         "(MPa) or top_wall_mm=1.6:2.4")  # fmt: skip
    return match[1], (float(match[2]), float(match[3]))


def _variable(
    name: str, low: float, high: float, named: Mapping[str, Parameter], table: BodyTable | None
) -> Variable:
    """The variable of a name and its range: a parameter, else a dimension."""
    if name in named:
        p = named[name]
        if not p.low <= low < high <= p.high:
            limits = f"{p.low:g} to {p.high:g} {p.unit}".rstrip()
            raise ValueError(f"--over {name}={low:g}:{high:g}: wanted {limits}")
        return Variable(name, low, high, p.unit)
    size = None if table is None else dict(table).get(name)
    if not isinstance(size, int | float):
        raise ValueError(_unknown(name, named, table))
    integral = isinstance(size, int)
    if integral and not (low.is_integer() and high.is_integer()):
        raise ValueError(f"--over {name}={low:g}:{high:g}: wanted whole numbers")
    unit = "N/mm" if name.endswith("_N_per_mm") else "mm" if name.endswith("_mm") else ""
    return Variable(name, low, high, unit, integral)


def _unknown(name: str, named: Mapping[str, Parameter], table: BodyTable | None) -> str:
    sizes = [] if table is None else [n for n, v in table if isinstance(v, int | float)]
    deck = "" if table is not None else " (a deck has no dimensions that could be varied)"
    return (f"--over {name}: nothing of the finger has this name{deck}; wanted a parameter "
            f"({', '.join(named)}, or one of another effect, such as clamp.*)"
            f"{', or a dimension: ' if sizes else ''}{', '.join(sizes)}")  # fmt: skip


def _dimensions(project: Project) -> BodyTable | None:
    model = project.config.model
    if model.kind != "finger":
        return model.dimensions
    if project.builtin is not None:
        return table_of(project.builtin.finger)
    return model.finger or FingerTable()


def _effects(
    project: Project, law: Elasticity, ranges: Mapping[str, Any]
) -> tuple[tuple[Effect, ...], list[str]]:
    """The law and the effects that move the finger: those of twin.toml, and whose parameters are varied; and
    labels of those that do not."""
    user_effects, labels = own_of(project), list(project.config.model.effects)
    names = {name_of(label) for label in labels}
    for name in dict.fromkeys(name.partition(".")[0] for name in ranges if "." in name):
        if name not in names:
            labels.append(name)
    every = [effect(label, users=user_effects, law=law.law) for label in labels]
    unmoving = [e for e in every if not moves_finger(e)]
    for e in unmoving:
        if any(p.name in ranges for p in e.parameters):
            raise ValueError(f"--over {e.name}: this effect does not move the finger under a held pressure; "
                             "wanted one that does")  # fmt: skip
    moving = sorted((e for e in every if e not in unmoving), key=lambda e: e.order)
    return (law, *moving), [e.label for e in unmoving]


def _values(
    project: Project, effects: Sequence[Effect], nominal: Constants
) -> tuple[dict[str, float], str]:
    """A value for every parameter: as fitted, else as twin.toml holds it, nominal, or absent."""
    remark, fitted = "", {}
    try:
        fit = newest_fit(project)
        fitted = {p.name: float(x) for p, x in zip(fit.parameters, fit.theta, strict=True)}
    except ValueError as why:
        remark = f"What is not varied is nominal, not fitted: {why}."
    start = nominal.named | project.config.model.fixed | fitted
    for e in effects:
        entry = e.grid[0] if e.grid else {}
        for p in e.parameters:
            middle = (p.low + p.high) / 2 if p.start is None else p.start
            start.setdefault(p.name, p.null if p.null is not None else entry.get(p.name, middle))
    return {p.name: start[p.name] for e in effects for p in e.parameters}, remark


def _path(project: Project, top: float) -> Path:
    """A ramp to a pressure in MPa, which is then held; gravity where the finger has weight."""
    time, acceleration = np.array([0.0, RAMP_S, RAMP_S + HOLD_S]), np.zeros(3)
    model = project.config.model
    if model.density_kg_m3 is not None:
        direction = None if model.gravity is None else np.array(model.gravity, float)
        if direction is None and (project.targets_folder / "targets.csv").is_file():
            gravity = project.targets().gravity
            direction = None if gravity is None else gravity[0]
        if direction is None:
            raise ValueError("model.density_kg_m3: its weight wants the direction of gravity; add "
                             "gravity = [0.0, 0.0, -1.0] under [model] of twin.toml")  # fmt: skip
        acceleration = G * direction / np.linalg.norm(direction)
    return Path(time, np.array([0.0, top, top]), time[[0, 2]], gravity=acceleration)
