"""The best of every generation by full finite elements, as review and report show it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from fe import Case, Path, solve
from fe.element import triangles
from twin import effort
from twin.calibrated.problem import SOLVED
from twin.gravity import under
from twin.messages import Say
from twin.model.enginejobs import EngineJobs
from twin.review.states import Generations
from twin.study.generations import Generation
from twin.study.loadpathfit import OnPaths
from twin.targets import Array


def full_solves(on: OnPaths, generations: Sequence[Generation], say: Say) -> Generations:
    """Displacements of the best individual of every generation at the first arrival at top pressure; with
    weight, relative to the rest.
    """
    bench, step = on.bench, int(on.objective.steps[0])
    t, nodes = bench.targets, bench.case.nodes
    points = t.places(bench.case.position)[on.rows]
    u = _fields(on, generations, say)
    near = np.argmin(np.linalg.norm(nodes[None] - points[:, None], axis=2), axis=1)
    return Generations(
        generation=np.arange(1, len(generations) + 1),
        names=tuple(p.name for p in bench.elasticity.parameters),
        best=np.array([g.best for g in generations]),
        rms_mm=np.array([g.rms_mm for g in generations]),
        nodes=nodes,
        triangles=triangles(bench.structure.outside),
        u=u.astype(np.float32),
        point_names=tuple(t.names[r] for r in on.rows),
        points=points,
        u_points=u[:, near],
        u_measured=t.value[step, on.rows],
        film_time_s=float(t.time[step] - t.time[0]),
        film_frame=step,
    )


def _fields(on: OnPaths, generations: Sequence[Generation], say: Say) -> Array:
    """Displacements (g, n, 3) mm of the best of every generation, each solved once. ValueError where one has
    no equilibrium."""
    if on.bench.jobs is not None:
        return _by_jobs(on, on.bench.jobs, generations, say)
    case, path = _to_the_top(on)
    fields: dict[bytes, Array] = {}
    start = None
    for k, g in enumerate(generations):
        say.progress("best of each generation by full FE", k, len(generations))
        if g.best.tobytes() not in fields:
            constants = on.constants(g.best)
            with effort.counted(effort.kind_of(history=False, derivatives=False)):
                start = solve(case.with_material(**constants.terms), path, start=start, count=4)
            if not start.converged and start.reached > 0.0:  # it is drawn as far as it comes
                most = np.minimum(path.pressure, SOLVED * start.reached)
                short = replace(path, pressure=most)
                start = solve(case.with_material(**constants.terms), short, count=4)
            if not start.converged:
                raise ValueError(f"the best of generation {g.number} ({constants.told}) {start.reason}")
            *rest, top = start.fields(range(len(path.output)))[:, : len(on.bench.case.nodes)]
            fields[g.best.tobytes()] = top - rest[0] if rest else top
    return np.array([fields[g.best.tobytes()] for g in generations])


def _by_jobs(
    on: OnPaths, jobs: EngineJobs, generations: Sequence[Generation], say: Say
) -> Array:
    """Displacements (g, n, 3) mm as in `_fields`, by one further job per distinct best candidate that returns
    the whole shape.
    """
    bench, o, fields = on.bench, on.objective, dict[bytes, Array]()
    gravities, of_step = bench.gravities
    case, highest = under(bench.case, bench.path), float(bench.targets.pressure.max())
    for k, g in enumerate(generations):
        say.progress("best of each generation, whole shape", k, len(generations))
        if g.best.tobytes() not in fields:
            candidate = case.with_material(**on.constants(g.best).terms)
            shapes = []
            for step, pressure in zip(o.steps[:2], (o.pressure[0], 0.0), strict=False):
                q, u = jobs.course(candidate, highest, gravities[of_step[step]][:3])
                nodal = u[:, : len(bench.case.nodes)]
                shapes.append(scipy.interpolate.CubicSpline(q, nodal, axis=0)(pressure))
            fields[g.best.tobytes()] = shapes[0] - shapes[-1] if len(shapes) > 1 else shapes[0]
    return np.array([fields[g.best.tobytes()] for g in generations])


def _to_the_top(on: OnPaths) -> tuple[Case, Path]:
    """The case, and its load from rest to the first arrival at top pressure; where it has weight, the rest is
    an output, too."""
    bench, objective = on.bench, on.objective
    gravities, of_step = bench.gravities
    load = np.array([0.0, objective.pressure[0]])
    if not gravities.any():
        return bench.case, Path(load, load, load[1:])
    top, rest = gravities[of_step[objective.steps[:2]]]
    path = Path(np.array([0.0, 1.0]), load, np.array([0.0, 1.0]), **bench.path.under(np.stack([rest, top])))
    return under(bench.case, path), path
