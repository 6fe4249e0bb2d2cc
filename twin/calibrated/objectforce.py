"""A course of pressure -> the force with which the finger presses on a rigid object, and its error.

The object stands there from the beginning of the course, which begins with a finger at rest: what the film
made creep or soften is not in it. What the film leaves open of the constants and of the mesh's stiffness is
carried over as in `predicting`; what finer meshes change beside a stiffness is not.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fe.path import Path
from twin.calibrated.predictionerrors import Uncertain, amounts_told
from twin.calibrated.predictions import NORMAL, SAME, WantedCourse, why_none
from twin.calibrated.problem import CalibrationProblem
from twin.gravity import G
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.model.objects import RigidObject
from twin.model.prediction import Model
from twin.targets import Array

RISE = 12  # even parts of a rise to a held pressure, at which the force is told
TABLE = "contact"  # the effect that has an obstacle of its own


@dataclass(frozen=True)
class Touched:
    """The force (s, 3) N of the finger on an object at times (s,) s and pressures (s,) MPa.

    factors (q, s, 3) N: its independent errors of 1 sd each. shape (s, n, 3) mm: displacements of all nodes
    of the case. yielded: by how many mm the object has given way along its spring at the end. beyond (s,):
    whether the pressure is above the tested one. why: why there is no interval, "" where there is one.
    """

    time: Array
    pressure: Array
    force: Array
    factors: Array
    shape: Array
    yielded: float
    beyond: NDArray[np.bool_]
    why: str

    @property
    def size(self) -> Array:
        """The size (s,) N of the force."""
        return np.asarray(np.linalg.norm(self.force, axis=1))

    @property
    def half(self) -> Array:
        """Half of the 95 % interval (s, 4) N: of the force's size, and of its parts along x, y, z."""
        direction = self.force / np.maximum(self.size, 1e-300)[:, None]
        size = np.linalg.norm((self.factors * direction).sum(axis=2), axis=0)
        return NORMAL * np.column_stack([size, np.linalg.norm(self.factors, axis=0)])


def rising(course: WantedCourse) -> WantedCourse:
    """The course of a held pressure with RISE output times on its ramp; other courses unchanged."""
    if len(course.output) > 1:
        return course
    return replace(course, output=np.append(np.linspace(0.0, course.time[1], RISE + 1), course.output))


def touched(
    problem: CalibrationProblem, record: FitRecord, course: WantedCourse, thing: RigidObject, say: Say
) -> Touched:
    """The force along a course. ValueError for an object that a model cannot have; Unsolvable where there is
    no equilibrium."""
    theta, film = record.fit.theta, problem.on_mesh(problem.model(), record.fit.theta, say)
    model = beside(film, course, thing)
    solved = model.solved(theta, derivatives=True)
    slopes = -solved.solution.contact_variations
    uncertain = Uncertain.of(film, theta, record, problem.targets, beyond=False)
    amounts, axes = amounts_told(problem.targets, film, theta, uncertain)
    moduli = film.law.moduli if film.law else ()
    softer = -sum((theta[k] * slopes[k] for k, p in enumerate(model.parameters) if p.name in moduli),
                  np.zeros(slopes.shape[1:]))  # fmt: skip
    columns = np.zeros((len(amounts), *slopes.shape[1:]))
    free = [p.name not in record.at_bound for p in model.parameters]
    columns[: sum(free)] = slopes[free]
    force = -solved.solution.contact_force
    if film.mesh is not None and not film.mesh.unknown:
        columns[sum(free)] = film.mesh.stiffness * softer  # the first of the mesh's modes
        force = force + film.mesh.softer * softer
    if record.adequate:  # else it would be what the model lacks
        force = force + np.tensordot(amounts, columns, 1)
    pressure = np.interp(course.output, course.time, course.pressure)
    push = float(abs(force[-1] @ thing.way) / np.linalg.norm(thing.way))
    rows, node_count = list(range(len(course.output))), len(problem.case.nodes)  # the half comes first
    return Touched(
        time=course.output,
        pressure=pressure,
        force=force,
        factors=np.tensordot(axes.T, columns, 1),
        shape=solved.solution.fields(rows)[:, :node_count],
        yielded=0.0 if thing.spring is None else push / thing.spring,
        beyond=pressure > SAME * float(problem.targets.log_pressure.max()),
        why=why_none(record),
    )


def beside(film: Model, course: WantedCourse, thing: RigidObject) -> Model:
    """The model of a film along a course beside an object, relative to the first time of the course.
    ValueError where the model has an obstacle already."""
    if any(e.name == TABLE for e in film.effects):
        raise ValueError(
            f"object {thing.text!r}: the model has the effect {TABLE}, a table under the finger, and meets "
            f"one obstacle alone; wanted a model without it: run `twin drop {TABLE}`"
        )
    test = film.test
    under = test.path.under(test.path.outside_of(np.array([0]))[0])
    if course.shares:
        under["shares"] = np.array([course.shares[name] for name in test.path.chambers])
    if course.gravity is not None:
        under["gravity"] = G * course.gravity
    path = Path(course.time, course.pressure, course.output, **under)
    test_beside = replace(test, case=thing.beside(test.case), path=path)
    return replace(film, test=test_beside, reference=np.array([0]), rests=None, parent=None)
