"""Films that were not made yet -> the displacements that a model predicts for them, all by one solve.

Without a memory displacements are a function of pressure and gravity. So the pressures of all planned films,
as the chamber and the material feel them (creep by its equivalent pressure, a drift of the moduli by the
pressure over it), are strung together: one curve of equilibria in each direction of gravity serves them all.
Softening and friction remember more than that; their films are solved one by one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe import Case, Path, Solution, Variation, solve
from fe.path import equivalent
from twin import effort
from twin.effects.protocol import Test, Unsolvable
from twin.gravity import G
from twin.model.prediction import STEP, Model
from twin.targets import Array

GAP = 60.0  # s between the film that there is and the next
LOG = 400  # entries that are kept of the log before
LEVELS = 8  # of pressure on a curve: good to a thousandth of the motion
DENSITY = 1.07e-9  # tonne/mm3, silicone's, where no one has weighed the finger


@dataclass(frozen=True, kw_only=True)
class Film:
    """A film to be made: its corners (time in s, share of the top pressure), frames in 1/s, and the direction
    of gravity (3,) in world axes; no corners: the course of the film that there is, `top` times as high."""

    name: str
    corners: tuple[tuple[float, float], ...] = ()
    hz: float = 0.0
    top: float = 1.0
    gravity: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Shown:
    """The prediction of a model for a film: u (s, p, 3) mm relative to the reference, its derivatives (d, s,
    p, 3), and dU/dp (s, p, 3) mm per MPa. interval: of two frames, s."""

    u: Array
    jacobian: Array
    slope: Array
    interval: float


def heavy(model: Model, down: Array) -> Model:
    """The model as a finger of silicone that nobody has weighed, in a gravity (3,) as a unit vector."""
    path = replace(model.test.path, gravity=G * down)
    test = replace(model.test, case=model.test.case.with_material(density=DENSITY), path=path)
    return replace(model, test=test, parent=None)


def in_film(model: Model, film: Film, points: Array) -> Model:
    """The model in a film that follows the one it describes, with more points (k, 3) mm on the finger.

    Without the mesh's correction, which is known at the film's own points only, and alike for all members.
    """
    model = model.at_one_rest()
    path, test = model.test.path, model.test
    time, pressure, output = _course(path, film)
    before = np.linspace(path.time[0], path.time[-1], min(len(path.time), LOG))
    begin = path.time[-1] + GAP - time[0]
    near = np.clip(np.searchsorted(path.time, before), 0, len(path.time) - 1)
    was = path.outside_of(near)
    now, size = was[0].copy(), path.places.size
    if film.gravity is not None:
        now[: 3 + size] = np.append(G * np.asarray(film.gravity), np.zeros(size))
    outside = np.concatenate([was, np.tile(now, (len(time), 1))])
    course = Path(
        np.append(before, begin + time),
        np.append(path.pressure_at(before), pressure),
        np.append(path.output[model.reference], begin + output),
        **path.under(outside),
    )
    moving = np.append(test.moving, np.ones(len(points), bool))
    names = (*test.markers, *(f"new{k}" for k in range(1, len(points) + 1)))
    places = np.concatenate([test.points, points])
    filmed = replace(test, path=course, points=places, moving=moving, names=names)
    return replace(model, test=filmed, reference=np.arange(len(model.reference)), parent=None, mesh=None)


def _course(path: Path, film: Film) -> tuple[Array, Array, Array]:
    """Log times (t,) s and pressures (t,) MPa of a film, and its frame times (s,) s."""
    top = film.top * float(path.pressure.max())
    if not film.corners:
        outputs = path.output[: np.searchsorted(path.output, _first_turn(path))]
        return outputs, film.top * path.pressure_at(outputs), outputs
    corner, share = np.array(film.corners).T
    frames = np.arange(corner[0], corner[-1], 1.0 / film.hz)
    time = np.union1d(corner, frames)
    return time, top * np.interp(time, corner, share), frames


def _first_turn(path: Path) -> float:
    """The time in s at which gravity first changes; infinite where it never does."""
    return float(path.time[path.turns[0] + 1]) if len(path.turns) else np.inf


def remembers(case: Case) -> bool:
    """True if more than the creep of a case depends on its history."""
    rubs = case.contact is not None and case.contact.friction != 0
    return rubs or any(m.mullins is not None and m.mullins[0] for m in case.materials.values())


def responses(model: Model, theta: Array, films: Sequence[Film], points: Array) -> list[Shown]:
    """Predictions of a model at theta (d,) for films, in the order of its points and of more `points` (k, 3)
    mm.

    Raises Unsolvable where the highest pressure has no equilibrium.
    """
    models = [in_film(model, film, points) for film in films]
    if remembers(model.put(model.named(theta)).case):
        return [_alone(m, theta) for m in models]
    values = model.named(theta)
    tests = [m.put(values) for m in models]
    turned = [_neighbours(models, values, k) for k in range(len(theta))]
    variations = [Variation(_strung(a), _strung(b), h) for a, b, h in turned]
    case, path = _strung(tests)
    with effort.counted(effort.PLANNED):
        solution = solve(case, path, variations=variations, count=LEVELS)
    if not solution.converged:
        raise Unsolvable(f"the finite-element model {solution.reason}")
    u, slope, du = _at_points(solution, tests[0], len(theta))
    out, done = [], 0
    for e, m in enumerate(models):
        rows = slice(done, done + len(tests[e].path.output))
        done, new = rows.stop, slice(len(m.reference), None)
        jacobian = np.zeros((len(theta), len(m.test.path.output), *u.shape[1:]))
        for k, (a, b, h) in enumerate(turned):
            name, step = m.parameters[k].name, h * du[k, rows]
            up = m.seen(u[rows] + step, a[e], {**values, name: values[name] + h})
            down = m.seen(u[rows] - step, b[e], {**values, name: values[name] - h})
            jacobian[k] = (up - down) / (2 * h)
        seen = m.seen(u[rows], tests[e], values)
        out.append(Shown(seen[new], jacobian[:, new], slope[rows][new], _interval(m)))
    return out


def _at_points(solution: Solution, test: Test, count: int) -> tuple[Array, Array, Array]:
    """Displacements (s, p, 3) mm of a test's points, dU/dp (s, p, 3) mm per MPa, and derivatives
    (count, s, p, 3)."""
    places = test.points[test.moving]
    u = np.zeros((len(solution.path.output), len(test.moving), 3))
    slope, du = np.zeros_like(u), np.zeros((count, *u.shape))
    u[:, test.moving], slope[:, test.moving] = solution.at(places), solution.per_pressure(places)
    if count:
        du[:, :, test.moving] = solution.variations_at(places)
    return u, slope, du


def _neighbours(
    models: Sequence[Model], values: dict[str, float], k: int
) -> tuple[list[Test], list[Test], float]:
    """The tests of all films one step up and one step down of parameter number k, and the step."""
    p = models[0].parameters[k]
    h = STEP * p.step
    up, down = ({**values, p.name: values[p.name] + sign * h} for sign in (1, -1))
    return [m.put(up) for m in models], [m.put(down) for m in models], h


def _alone(model: Model, theta: Array) -> Shown:
    """The prediction of a model for a film, solved along its history."""
    new = slice(len(model.reference), None)
    u, jacobian = model.predict(theta)[new], model.jacobian(theta)[:, new]
    return Shown(u, jacobian, model.per_pressure(theta)[new], _interval(model))


def _interval(model: Model) -> float:
    return float(np.median(np.diff(model.test.path.output[len(model.reference) :])))


def _strung(tests: Sequence[Test]) -> tuple[Case, Path]:
    """The case without its memory, and the pressures felt at the frames of all films, as one path."""
    prony = np.array(next((m.prony for m in tests[0].case.materials.values() if m.prony), ())).reshape(-1, 2)
    pressure = np.concatenate([_felt(test.path, prony) for test in tests])
    outside = np.concatenate([test.path.outside_at(test.path.output) for test in tests])
    time = np.arange(len(pressure), dtype=float)
    course = Path(time, pressure, time, **tests[0].path.under(outside))
    return tests[0].case.with_material(prony=()), course


def _felt(path: Path, prony: Array) -> Array:
    """The pressure (s,) MPa at the frames that brings an elastic body without drift to an equal shape."""
    plain = path.pressure / path.stiffness_at(path.time)
    felt = equivalent(path.time, plain, prony, settled=path.settled) if prony[:, 0].any() else plain
    return np.interp(path.output, path.time, felt)
