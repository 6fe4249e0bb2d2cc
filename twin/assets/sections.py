"""A calibrated model -> the rod that moves as its line of points does, with the stiffness of its body.

The joints lie on the body along the line of the tip's marker; what the pressure does to them is what
`predict` says, mesh errors mended. The stiffness is that of the model: what a small couple on the end face
turns each joint under every pressure, and what a force along the finger stretches each link without one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fe import Case, Path, solve
from fe.deck.soundness import jacobians
from fe.mesh.points import nearest
from twin.assets.rod import Rod, lengths, turns
from twin.calibrated.predictions import Prediction, WantedCourse, predicted
from twin.calibrated.problem import CalibrationProblem
from twin.effects.protocol import Test
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.targets import Array, PointKind

SECTIONS = 12
LEVELS = 16  # pressures of the rod above 0
SMALL = 1e-4  # turn and strain by which the stiffness is found, about
DENSITY = 1.07e-9  # tonne/mm3 of a silicone, where none is stated
SHARE = 0.1  # of the length by which the force that tests a rod lifts its tip


@dataclass(frozen=True)
class RodBeside:
    """A rod, and what the model says at pressures (k,) MPa of the tip, the point `name`: displacements
    (k, 3) mm with sd (k, 3) mm. force: in N up at the tip; lifted (3,) mm: what it adds at the pressure
    `loaded` MPa. dense: whether the density is the project's own. neo_hooke: the largest share of its
    displacement by which the tip would be off if the silicone were neo-Hooke; NaN where that is too weak."""

    rod: Rod
    name: str
    pressure: Array
    tip: Array
    sd: Array
    loaded: float
    force: float
    lifted: Array
    dense: bool
    neo_hooke: float = np.nan


def followed(
    problem: CalibrationProblem, record: FitRecord, checked: Array, say: Say, *, ramp_s: float, hold_s: float
) -> RodBeside:
    """The rod of a calibrated problem, and its model's answers at pressures (k,) MPa to be checked."""
    name, places = line_of(problem)
    top = max(float(problem.targets.log_pressure.max()), float(checked.max()))
    levels = top * np.linspace(0, 1, LEVELS + 1)[1:]
    courses = [WantedCourse.held(float(p), ramp_s=ramp_s, hold_s=hold_s) for p in (*levels, *checked)]
    answers = predicted(problem, record, courses, places, say)
    rest = np.array(list(places.values()))
    u = np.array([answer.u[0] for answer in answers])  # (k, n + 1, 3)
    joints = rest + np.concatenate([np.zeros((1, *rest.shape)), u[:LEVELS]])
    turn = turns(joints) - turns(rest)
    model = problem.model()
    test = model.put(model.named(record.fit.theta))
    pressure = np.append(0.0, levels)
    stiffness = _stiffness(test, rest, pressure, ramp_s)
    mass, dense = _mass(test, rest)
    rod = Rod(
        pressure=pressure, rest=rest, bend=np.diff(turn, axis=1, prepend=0.0),
        length=lengths(joints), bend_stiffness=stiffness[0], pull_stiffness=stiffness[1], mass=mass,
    )  # fmt: skip
    loaded = float(checked[len(checked) // 2])
    force, lifted = _lifted(test, rod, loaded, ramp_s=ramp_s, hold_s=hold_s)
    return RodBeside(
        rod, name, checked, u[LEVELS:, -1], _sds(answers[LEVELS:]), loaded, force, lifted, dense,
        _neo_hooke(test, rest[-1:], checked, ramp_s),
    )  # fmt: skip


def line_of(problem: CalibrationProblem) -> tuple[str, dict[str, Array]]:
    """The name of the point that is furthest out, and places (3,) mm of the joints and of itself by name."""
    targets = problem.targets
    free = [k for k, point in enumerate(targets.points) if point.kind is not PointKind.FIXED]
    every = targets.places(problem.case.position)
    last = max(free, key=lambda k: float(every[k][0]))
    tip, start = every[last], float(problem.case.nodes[:, 0].min())
    stations = [np.array([x, *tip[1:]]) for x in np.linspace(start, tip[0], SECTIONS + 1)[:-1]]
    places = {f"joint {k}": np.asarray(nearest(problem.case, x), float) for k, x in enumerate(stations)}
    return targets.points[last].name, {**places, "joint tip": np.asarray(tip, float)}


def _sds(answers: Sequence[Prediction]) -> Array:
    """Sds (k, 3) mm of the tip; NaN where the fit has none."""
    return np.array([np.full(3, np.nan) if a.why else a.sd[0, -1] for a in answers])


# -- stiffness -----------------------------------------------------------------------------------------------


Forces = Mapping[str, tuple[Any, Array]]  # rows (m,) of nodes, and the force (3,) N on them, by name


def _solved(test: Test, points: Array, forces: Forces, time: Array, pressure: Array) -> Array:
    """Places (t, p, 3) mm of material points (p, 3) along a course (t,) s, (t,) MPa, under forces as well."""
    case = test.case
    loaded = replace(
        case,
        node_sets={**case.node_sets, **{name: rows for name, (rows, _) in forces.items()}},
        forces={**case.forces, **{name: force for name, (_, force) in forces.items()}},
    )
    solution = solve(loaded, Path(time, pressure, output=time))
    if not solution.converged:
        raise ValueError(f"the finger's stiffness cannot be found: {solution.reason}")
    return np.asarray(points + solution.at(points))


def _faces(case: Case) -> tuple[Any, Any]:
    """Rows of the nodes of the end face above and below its middle."""
    x = case.nodes
    face = np.flatnonzero(x[:, 0] > x[:, 0].max() - 1e-6)
    middle = (x[face, 2].min() + x[face, 2].max()) / 2
    return face[x[face, 2] > middle], face[x[face, 2] <= middle]


def _stiffness(test: Test, rest: Array, pressure: Array, ramp_s: float) -> tuple[Array, Array]:
    """Stiffness (k, n) N mm/rad of the joints at pressures (k,) MPa that rise in a ramp, and (n,) N/mm of the
    links without pressure, of the whole structure."""
    nodes, n = test.case.nodes, len(rest)
    upper, lower = _faces(test.case)
    height = float(nodes[upper, 2].mean() - nodes[lower, 2].mean())
    modulus = 3 * max(m.shear for m in test.case.materials.values())
    pull = np.array([SMALL * modulus * height * float(np.ptp(nodes[:, 0])), 0.0, 0.0])
    couple = {"asset_upper": (upper, pull), "asset_lower": (lower, -pull)}
    along = {"asset_face": (np.concatenate([upper, lower]), 2 * pull)}
    time, points = ramp_s * pressure / pressure[-1], np.concatenate([rest, nodes[upper], nodes[lower]])
    idle, turned = (_solved(test, points, way, time, pressure) for way in ({}, couple))
    (*_, drawn) = _solved(test, points, along, time[:2], np.zeros(2))
    ends = turned[:, n:, 2]
    moment = pull[0] * (ends[:, : len(upper)].mean(axis=1) - ends[:, len(upper) :].mean(axis=1)) / test.share
    bend = np.diff(turns(turned[:, :n]) - turns(idle[:, :n]), axis=1, prepend=0.0)
    compliance = _smoothed(bend / moment[:, None])
    if compliance.min() <= 0:
        raise ValueError(
            "the line of the points does not bend as the finger does: a couple on the end face turns a part "
            "of it the other way; wanted points along the finger, away from its pleats"
        )
    return 1 / compliance, 2 * pull[0] / test.share / (lengths(drawn[:n]) - lengths(idle[0, :n]))


def _smoothed(compliance: Array) -> Array:
    """Compliances (k, n) of joints, of each a quarter given to both neighbours: what pleats do to their
    faces is no stiffness of the finger. The sum stays."""
    padded = np.pad(compliance, ((0, 0), (1, 1)), mode="edge")
    return np.asarray((padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]) / 4)


def _lifted(test: Test, rod: Rod, pressure: float, *, ramp_s: float, hold_s: float) -> tuple[float, Array]:
    """A force in N up at the end face that lifts the tip of a rod by about SHARE of its length, and what it
    adds (3,) mm at a pressure in MPa to the structure's tip."""
    beyond = rod.rest[-1, 0] - rod.rest[:-1, 0]
    force = SHARE * beyond[0] / float((beyond**2 / rod.stiffness_at(pressure)).sum())
    time, course = np.cumsum([0.0, ramp_s, hold_s]), np.array([0.0, pressure, pressure])
    up = {"asset_face": (np.concatenate(_faces(test.case)), np.array([0.0, 0.0, force * test.share]))}
    free, held = (_solved(test, rod.rest[-1:], way, time, course)[-1, 0] for way in ({}, up))
    return force, held - free


def _neo_hooke(test: Test, tip: Array, pressure: Array, ramp_s: float) -> float:
    """What silicone of the one constant that every simulator of solids has would do at pressures (k,) MPa:
    the largest share by which the tip (1, 3) mm is off where all moduli at rest stay."""
    case, levels = test.case, np.append(0.0, np.sort(pressure))
    plain = {
        name: replace(m, C10=m.shear / 2, C01=0.0, C20=0.0, C30=0.0, gent=None, ogden=(), chains=None)
        for name, m in case.materials.items()
    }
    cases = (case, replace(case, materials=plain))
    time = ramp_s * levels / levels[-1]
    try:
        own, other = (_solved(replace(test, case=c), tip, {}, time, levels)[1:, 0] - tip for c in cases)
    except ValueError:
        return float("nan")
    return float((np.linalg.norm(other - own, axis=1) / np.linalg.norm(own, axis=1)).max())


# -- mass ----------------------------------------------------------------------------------------------------


def _mass(test: Test, rest: Array) -> tuple[Array, bool]:
    """Masses (n,) in tonne of the whole structure between joints, and whether its density is stated."""
    case, kind = test.case, test.case.element
    volume = jacobians(case) * kind.weights / test.share  # (e, q) mm3
    density = case.per_element("density")
    stated = bool((density > 0).any())
    x = np.einsum("ea,qa->eq", case.nodes[case.connectivity][..., 0], kind.at_points[0])
    link = np.clip(np.searchsorted(rest[:, 0], x, side="right") - 1, 0, len(rest) - 2)
    mass = volume * (density[:, None] if stated else DENSITY)
    per_link = np.bincount(link.ravel(), weights=mass.ravel(), minlength=len(rest) - 1)
    return np.asarray(per_link, float), stated
