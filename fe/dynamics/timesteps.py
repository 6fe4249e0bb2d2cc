"""The transient motion of a structure along a path, by the generalised-alpha method.

M a + F(u) = load, where F has everything that statics have: large rotations, pressure modes, follower
pressure, layers, contact, creep. One step is one equilibrium with the forces of inertia of that step.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fe.case import Case
from fe.dynamics.loading import HeldLoad, at_rest
from fe.dynamics.mass import element_masses
from fe.element import Array
from fe.kernel.assembly import Response, State
from fe.kernel.inertia import InertiaForces
from fe.path import Path
from fe.solver.historyvariables import Evaluated, Past
from fe.solver.loadings import Loadings
from fe.solver.newton import Equilibrium, Problem, equilibrium

GROWTH = 1.5  # by which a step may be longer than the last one
WANTED = 0.5  # of the tolerance, that the next step is made for
LEAST = 1e-6  # s: a step that must be shorter has no end
FIRST = 1 / 64  # of the longest step: short, as the first one takes the acceleration before it for none
PRECISION = 1e-10  # of the structure's size: an acceleration is a small difference of displacements


@dataclass(frozen=True)
class Scheme:
    """Numbers of the generalised-alpha method with a spectral radius at infinite frequency (Chung & Hulbert
    1993, doi 10.1115/1.2900803): of second order, stable at any step for a linear structure.

    >>> s = Scheme.of(1.0)
    >>> s.inertia, s.force, s.beta, s.gamma
    (0.5, 0.5, 0.25, 0.5)
    """

    inertia: float  # alpha_m
    force: float  # alpha_f
    beta: float
    gamma: float

    @staticmethod
    def of(radius: float) -> "Scheme":
        """The scheme of a radius from 0, which takes out high frequencies in one step, to 1, without damping
        of its own."""
        if not 0 <= radius <= 1:
            raise ValueError(f"radius {radius:g} of the time steps: wanted 0 to 1")
        m, f = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
        return Scheme(m, f, (1 - m + f) ** 2 / 4, 0.5 - m + f)

    def damping(self, x: float) -> float:
        """The damping ratio that the scheme itself adds to a vibration, at x = omega dt.

        >>> abs(Scheme.of(1.0).damping(0.3)) < 1e-12, 0 < Scheme.of(0.8).damping(0.3) < 2e-3
        (True, True)
        """
        m, f, b, g = self.inertia, self.force, self.beta, self.gamma
        # (u, dt v, dt^2 a) of the next time from those of the last, for u'' + omega^2 u = 0
        new = np.array([[1.0, 0.0, -b], [0.0, 1.0, -g], [x**2 * (1 - f), 0.0, 1 - m]])
        old = np.array([[1.0, 1.0, 0.5 - b], [0.0, 1.0, 1 - g], [-(x**2) * f, 0.0, -m]])
        roots = np.linalg.eigvals(np.linalg.solve(new, old))
        root = roots[np.argmax(np.abs(np.imag(roots)))]
        return float(-np.log(abs(root)) / np.hypot(np.angle(root), np.log(abs(root))))


@dataclass(frozen=True)
class Instant:
    """A time in s, the state with its pressure modes, velocity (n, 3) mm/s, acceleration (n, 3) mm/s2, and
    the history of the material where it has one."""

    time: float
    state: State
    velocity: Array
    acceleration: Array
    past: Past | None


@dataclass(frozen=True, kw_only=True)
class Transient:
    """The motion of a case along a path.

    time (s,) s of the path's output; u (s, n, 3) mm and velocity (s, n, 3) mm/s there; steps (k,) s that were
    taken; error (k,) mm: of each, estimated; reason: "converged", or why it ends early.
    """

    case: Case
    time: Array
    u: Array
    velocity: Array
    steps: Array
    error: Array
    reason: str

    @property
    def converged(self) -> bool:
        """True if it was followed to the end of the path."""
        return self.reason == "converged"


def transient(
    case: Case,
    path: Path,
    *,
    held: HeldLoad | None = None,
    tolerance: float = 0.01,
    longest: float = 0.05,
    radius: float = 0.8,
) -> Transient:
    """The motion of a case along a path, from rest under a held load, by default the path's first one.

    tolerance: largest error of one step in mm, of any node: a step whose estimate is larger is halved, and
    later ones grow while theirs are small. longest: step in s, at most. radius: of `Scheme`, whose own
    damping at a frequency is `Scheme.damping`. The error of a step is (beta - 1/6) dt^2 times the change of
    the acceleration (Zienkiewicz & Xie 1991, doi 10.1002/eqe.4290200907); with a radius of 1 that swings for
    ever, and is taken for an error.

    ValueError for a case without density, and for what needs a history that time steps do not keep: a path
    that turns, friction, softening.
    """
    problem, scheme = _problem(case, path), Scheme.of(radius)
    held = held or HeldLoad(float(path.pressure[0]), *_outside(path))
    start = at_rest(case, held)
    if not start.converged:
        return _transient(case, path, [], [], [], start.reason)
    past = _crept(problem, start.state.u) if len(problem.constants.prony) else None
    none = np.zeros_like(case.nodes)
    march = _March(problem, path, scheme, inertia_of(case), tolerance, longest)
    return march.followed(Instant(float(path.time[0]), start.state, none, none, past))


def resumed(case: Case, path: Path, start: Instant, *, longest: float, radius: float = 0.8) -> Transient:
    """The motion of a case along a path from an instant on, in steps of a length in s; none is halved for its
    error."""
    march = _March(_problem(case, path), path, Scheme.of(radius), inertia_of(case), np.inf, longest)
    return march.followed(start)


def _outside(path: Path) -> tuple[Array, Array, Array]:
    """Gravity, places and pulls of a path that does not turn."""
    return np.atleast_2d(path.gravity)[0], path.places, path.pulls


def _problem(case: Case, path: Path) -> Problem:
    """The problem of a case under what a path holds all the time."""
    if np.ndim(path.gravity) > 1 or np.ndim(path.pulls) > 2:
        raise ValueError("time steps of a path that is turned, or whose pulls change: wanted one recording")
    problem = Loadings.of(Problem.of(case), path, (), ()).problems[0]
    if problem.has_friction or len(problem.constants.softening):
        raise ValueError("time steps with friction or softening: wanted a law and an obstacle without")
    return problem


def inertia_of(case: Case) -> InertiaForces:
    """The forces of inertia of a case, of no step yet."""
    dofs = (case.connectivity[:, :, None] * 3 + np.arange(3)).reshape(len(case.connectivity), -1)
    nodal = element_masses(case)
    blocks = np.einsum("eab,ij->eaibj", nodal, np.eye(3)).reshape(*dofs.shape, dofs.shape[1])
    return InertiaForces(dofs, blocks, case.nodes, scale=0.0, ahead=np.zeros_like(case.nodes))


def _crept(problem: Problem, u: Array) -> Past:
    """The history of a state that was held until nothing creeps any longer."""
    past = Past.first(_seen(problem, u))
    return replace(past, terms=0 * past.terms)


def _seen(problem: Problem, u: Array) -> Evaluated:
    kernel, c = problem.kernel, problem.constants
    return Evaluated(problem, u, Response(kernel.isochoric(u, c, problem.geometry), None))


@dataclass(frozen=True)
class _March:
    """A problem followed in time."""

    problem: Problem
    path: Path
    scheme: Scheme
    inertia: InertiaForces
    tolerance: float
    longest: float

    def followed(self, start: Instant) -> Transient:
        """The motion from an instant to the end of the path."""
        seen, steps, errors, reason = [start], [], [], "converged"
        ends = self._ends()
        now, dt, last = start, FIRST * self.longest, None
        while now.time < ends[-1] - 1e-12:
            dt = min(dt, self._room(now.time, ends))
            after, found, error = self._tried(now, dt, last)
            if after is None or error > self.tolerance:
                dt, last = dt / 2, None
                if dt < LEAST:
                    why = found.reason if after is None else f"it errs by {error:.2g} mm however short it is"
                    reason = f"no step from {now.time:.6g} s on: {why}"
                    break
                continue
            steps.append(dt)
            errors.append(error)
            now, last = after, found
            seen.append(now)
            grown = np.sqrt(WANTED * self.tolerance / max(error, 1e-300))  # the error is of third order in dt
            dt = min(self.longest, dt * float(np.clip(grown ** (2 / 3), 0.5, GROWTH)))
        return _transient(self.problem.case, self.path, seen, steps, errors, reason)

    def _ends(self) -> Array:
        """Times in s that a step ends at: those where the pressure has a corner, and the last one."""
        t, p = self.path.time, self.path.pressure
        slope = np.diff(p) / np.diff(t)
        corner = np.abs(np.diff(slope)) > 1e-6 * max(float(np.abs(slope).max()), 1e-300)
        last = min(float(self.path.output[-1]), float(t[-1]))
        inside = t[1:-1][corner]
        return np.append(inside[inside < last], last)

    def _room(self, time: float, ends: Array) -> float:
        """The time in s to the next corner."""
        return float(ends[ends > time + 1e-12].min() - time)

    def _tried(
        self, now: Instant, dt: float, last: Equilibrium | None
    ) -> tuple[Instant | None, Equilibrium, float]:
        """The next instant, the equilibrium of its step, and the error of the step in mm."""
        m, f, b, g = self.scheme.inertia, self.scheme.force, self.scheme.beta, self.scheme.gamma
        u, v, a = now.state.u, now.velocity, now.acceleration
        scale = (1 - m) / ((1 - f) * b * dt**2)
        ahead = m * a - (1 - m) * (u / ((1 - f) * b * dt**2) + v / (b * dt) + (1 / (2 * b) - 1) * a)
        problem = replace(self.problem, inertia=self.inertia.of_step(scale, ahead))
        part = (1 - f) * dt
        memory = now.past.memory(problem, part) if now.past is not None else None
        load = float(np.interp(now.time + part, self.path.time, self.path.pressure))
        # the fast vibrations of thin walls, taken ahead by more than their period, turn elements inside out
        for guess in (replace(now.state, u=u + (1 - f) * (dt * v + dt**2 / 2 * a)), now.state):
            found = equilibrium(
                problem, guess, load=load, memory=memory, last=last.step if last else None,
                exact=False, tolerance=PRECISION,
            )  # fmt: skip
            if found.state is not None:
                break
        if found.state is None:
            return None, found, np.inf
        moved = (found.state.u - u) / (1 - f)
        next_a = (moved - dt * v) / (b * dt**2) - (1 / (2 * b) - 1) * a
        error = abs(b - 1 / 6) * dt**2 * float(np.linalg.norm(next_a - a, axis=1).max())
        state = replace(found.state, u=u + moved)
        past = now.past
        if past is not None:
            past = past.after(_seen(self.problem, state.u), dt, None, None)
        after = Instant(now.time + dt, state, v + dt * ((1 - g) * a + g * next_a), next_a, past)
        return after, found, error


def _transient(
    case: Case, path: Path, seen: list[Instant], steps: list[float], errors: list[float], reason: str
) -> Transient:
    """The motion at the output times that were reached, by cubic Hermite polynomials between steps."""
    t = np.array([one.time for one in seen])
    reached = path.output[path.output <= (t[-1] + 1e-9 if len(t) else -np.inf)]
    rows = [*_between(t, seen, reached)]
    u, v = (np.array([row[k] for row in rows]).reshape(-1, *case.nodes.shape) for k in (0, 1))
    return Transient(case=case, time=reached, u=u, velocity=v, steps=np.array(steps), error=np.array(errors),
                  reason=reason)  # fmt: skip


def _between(t: Array, seen: list[Instant], output: Array) -> Iterator[tuple[Array, Array]]:
    """Displacement and velocity (n, 3) at each output time."""
    for time in output:
        k = int(np.clip(np.searchsorted(t, time, side="right") - 1, 0, max(len(t) - 2, 0)))
        a, b = seen[k], seen[min(k + 1, len(seen) - 1)]
        h = b.time - a.time
        if not h:
            yield a.state.u, a.velocity
            continue
        x = (time - a.time) / h
        h00, h10, h01, h11 = 2 * x**3 - 3 * x**2 + 1, x**3 - 2 * x**2 + x, 3 * x**2 - 2 * x**3, x**3 - x**2
        d00, d10, d11 = 6 * x**2 - 6 * x, 3 * x**2 - 4 * x + 1, 3 * x**2 - 2 * x
        u = h00 * a.state.u + h01 * b.state.u + h * (h10 * a.velocity + h11 * b.velocity)
        slope = d00 * (a.state.u - b.state.u) / h + d10 * a.velocity + d11 * b.velocity
        yield u, slope
