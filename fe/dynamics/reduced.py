"""A reduced model of motions in time: an equilibrium that moves along its load path, and a few vibrations."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from scipy.sparse import csr_matrix

from fe.case import Case
from fe.dynamics.loading import HeldLoad, LoadedState, at_rest_under
from fe.dynamics.mass import mass_matrix
from fe.dynamics.timesteps import Instant, resumed
from fe.dynamics.vibration import modes
from fe.element import Array
from fe.kernel.assembly import State
from fe.path import Path
from fe.solver.newton import Residual, imbalance

NUDGE = 1e-3  # of the largest pressure, by which the load is differenced
PRECISION = 1e-6  # of the integration
LONGEST = 0.02  # s, of its steps: a course may step between two of them
WINDOW, STEPS = 1.0, 40  # periods that a whole check lasts, and steps of it
RADIUS = 0.95  # of its steps
BENT = 1 / 16  # of what every other level errs, that all of them do: a cubic's error is of fourth order


@dataclass(frozen=True)
class ReducedMotion:
    """A motion of a reduced model at times (s,) s: the pressure (s,) MPa whose equilibrium it swings about,
    and displacements u (s, n, 3) mm. swing (s,) mm: how far it is off the equilibrium, the largest within a
    period. error (s,) mm: as `ReducedModel.certified` states it, of the point that errs most, or (s, p, 3) of
    some points; NaN until then.
    dense: the state at any time, along the path.
    """

    time: Array
    along: Array
    u: Array
    swing: Array
    error: Array
    dense: Any
    path: Path


@dataclass(frozen=True)
class ReducedModel:
    """Equilibria at pressures (k,) MPa, with their vibrations, under gravity (3,) mm/s2.

    u (k, n, 3) mm, pressure modes p (k, e, m), slope (k, n, 3) mm/MPa, and the derivative of the load (k, n,
    3) N/MPa. shape (k, m, n, 3): vibrations of unit modal mass; square (k, m) 1/s2: of their angular
    frequencies.
    """

    case: Case
    pressure: Array
    u: Array
    p: Array
    slope: Array
    load: Array
    shape: Array
    square: Array
    gravity: Array = field(default_factory=lambda: np.zeros(3))

    @staticmethod
    def of(
        case: Case, pressures: Sequence[float], *, count: int = 4, gravity: Array | None = None
    ) -> "ReducedModel":
        """The model of a case from its equilibria at pressures (k,) MPa, rising, under gravity (3,) mm/s2,
        by default without weight. ValueError where there is none, and for a material that creeps."""
        if any(m.prony for m in case.materials.values()):
            raise ValueError("a reduced model of a material that creeps: wanted one without Prony series")
        M, nudge = mass_matrix(case), NUDGE * float(np.abs(pressures).max())
        pull = np.zeros(3) if gravity is None else gravity
        rows: list[tuple[Array, ...]] = []
        for loaded in at_rest_under(case, HeldLoad(gravity=pull), list(map(float, pressures))):
            if not loaded.converged:
                raise ValueError(f"no equilibrium at {1e3 * loaded.held.pressure:.4g} kPa: {loaded.reason}")
            found = modes(loaded, count=2 * count)
            mine = np.flatnonzero(~found.sideways)[:count]
            flat = found.shape[mine].reshape(len(mine), -1)
            shape = found.shape[mine] / np.sqrt(np.einsum("mi,im->m", flat, M @ flat.T))[:, None, None]
            square = (2 * np.pi * found.frequency[mine]) ** 2
            if rows:
                shape, square = _aligned(rows[-1][4], shape, square, M)
            load = _load(loaded, nudge)
            slope = loaded.step(0.0).solve([Residual(-load, np.zeros_like(loaded.state.p), 0.0)])[0].u
            rows.append((loaded.state.u, loaded.state.p, slope, load, shape, square))
        least = min(len(row[5]) for row in rows)
        u, p, slope, load = (np.array([row[k] for row in rows]) for k in range(4))
        shape, square = (np.array([row[k][:least] for row in rows]) for k in (4, 5))
        return ReducedModel(case, np.asarray(pressures, float), u, p, slope, load, shape, square, pull)

    @cached_property
    def place(self) -> "scipy.interpolate.CubicHermiteSpline":
        """The equilibrium (3 n,) mm over the pressure in MPa."""
        k = len(self.pressure)
        u, slope = self.u.reshape(k, -1), self.slope.reshape(k, -1)
        return scipy.interpolate.CubicHermiteSpline(self.pressure, u, slope)

    @cached_property
    def _shapes(self) -> "scipy.interpolate.CubicSpline":
        return scipy.interpolate.CubicSpline(self.pressure, self.shape.reshape(*self.shape.shape[:2], -1))

    @cached_property
    def _terms(self) -> "scipy.interpolate.CubicSpline":
        """Over the pressure: mass of the motion along the path, with its bend, its stiffness; and with each
        vibration: mass, bend, stiffness, square of the angular frequency."""
        M, rows = mass_matrix(self.case), []
        ways = self.slope.reshape(len(self.pressure), -1)
        bends = scipy.interpolate.CubicSpline(self.pressure, ways)(self.pressure, 1)
        for k, (way, bend) in enumerate(zip(ways, bends, strict=True)):
            f, phi = self.load[k].ravel(), self.shape[k].reshape(len(self.shape[k]), -1)
            heavy, bent = M @ way, M @ bend
            first = [way @ heavy, way @ bent, way @ f]
            rows.append(np.concatenate([first, phi @ heavy, phi @ bent, phi @ f, self.square[k]]))
        return scipy.interpolate.CubicSpline(self.pressure, np.array(rows))

    def follow(self, path: Path, *, loss: float = 0.0, drag: float = 0.0) -> ReducedMotion:
        """The motion along a path, from rest at its first pressure.

        u = U(s) + Phi(s) q, where U are the equilibria: what the pressure p pushes beyond the equilibrium at
        s is its derivative there times p - s. Galerkin's equations on U' and Phi, terms of second order in q
        and in s' q left out. loss: loss factor at the slowest vibration, in proportion to frequency. drag:
        what the square of the speed along the path takes of the pressure, s2/MPa; of that of the vibrations
        the part along it, by their masses. Beyond the first and the last pressure of the model it is
        extrapolated.
        """
        start = np.zeros(2 * self.square.shape[1] + 2)
        start[0] = float(np.interp(path.output[0], path.time, path.pressure))
        dense = self._integrated(path, start, loss, drag)
        y = dense(path.output)
        u = self._displaced(y)
        held = self.place(np.interp(path.output, path.time, path.pressure)).reshape(u.shape)
        off = np.linalg.norm(u - held, axis=2).max(axis=1)
        near = np.abs(path.output[:, None] - path.output[None]) <= self._period / 2
        swing = np.where(near, off[None], 0.0).max(axis=1)
        return ReducedMotion(path.output, y[0], u, swing, np.full(len(u), np.nan), dense, path)

    @cached_property
    def _period(self) -> float:
        """The period in s of the slowest vibration, of the mean of its squares."""
        return 2 * np.pi / float(np.sqrt(self.square[:, 0].mean()))

    def _integrated(self, path: Path, start: Array, loss: float, drag: float = 0.0) -> Any:
        """The states (2 + 2 m, s) at any times (s,) s of a path's output, from that at the first."""
        count, terms = self.square.shape[1], self._terms
        slowest = 2 * np.pi / self._period
        viscous = loss / slowest

        def change(t: float, y: Array) -> Array:
            q, v = y[1 : count + 1], y[count + 1 :]
            row = terms(y[0])
            a, c, g = row[:3]
            b, d, h, w2 = row[3:].reshape(4, count)
            speed = v[0] + b @ v[1:] / a
            off = np.interp(t, path.time, path.pressure) - y[0] - viscous * v[0] - drag * abs(speed) * speed
            left, fast = q + viscous * v[1:], v[0] ** 2
            force = h * off - w2 * left - d * fast
            # by Schur's complement, as the vibrations have unit masses
            along = (g * off - h @ left - c * fast - b @ force) / (a - b @ b)
            return np.concatenate([v, [along], force - b * along])

        first, last = float(path.output[0]), float(path.output[-1])
        # what a vibration takes of a push along the path, over all of it, and as fast as the slowest one
        size = np.append(1.0, np.abs(terms(self.pressure)[:, 3 : count + 3]).max(axis=0))
        small = PRECISION * float(np.ptp(self.pressure)) * np.append(size, slowest * size)
        found = scipy.integrate.solve_ivp(
            change, (first, last), start, method="LSODA", dense_output=True, rtol=PRECISION, atol=small,
            max_step=LONGEST,
        )  # fmt: skip
        if not found.success or found.sol is None:
            raise ValueError(f"a reduced model beyond {found.t[-1]:.4g} s: {found.message}")
        return found.sol

    def _displaced(self, y: Array) -> Array:
        """Displacements (s, n, 3) of states (2 + 2 m, s)."""
        s, q = y[0], y[1 : self.square.shape[1] + 1].T
        u = self.place(s) + np.einsum("sm,smn->sn", q, self._shapes(s))
        return u.reshape(len(s), *self.case.nodes.shape)

    def certified(
        self, motion: ReducedMotion, moments: Sequence[float], *, at: csr_matrix | None = None
    ) -> ReducedMotion:
        """The motion with its error, by whole time steps for a period from its state at some moments in s.

        at: of what points (p, n), as `fe.mesh.points.interpolation` gives them; by default of all nodes, of
        which thin walls err most.

        Whole steps begin where the reduced motion is, and neither loses anything for a period. How far they
        lead away from it, over its swing, is the error of a vibration, the largest of all moments. To it the
        error of the equilibria between those that were solved is added, by leaving out every other one.
        ValueError where a step does not converge.
        """
        share = np.max([self._apart(motion, t, WINDOW * self._period, at) for t in moments], axis=0)
        error = np.hypot(np.multiply.outer(motion.swing, share), self._between(motion.along, at))
        return replace(motion, error=error)

    def _apart(self, motion: ReducedMotion, t: float, lasts: float, at: csr_matrix | None) -> Array:
        """The largest distance () or (p, 3) in mm of whole steps from a motion within a time in s, over its
        swing."""
        path = replace(motion.path, output=np.linspace(t, t + lasts, 21), gravity=self.gravity)
        whole = resumed(self.case, path, self._instant(motion, t), longest=lasts / STEPS, radius=RADIUS)
        if not whole.converged:
            raise ValueError(f"whole steps from {t:.4g} s: {whole.reason}")
        mine = self._integrated(path, motion.dense(t), 0.0)(path.output)
        off = _sizes(whole.u - self._displaced(mine), at).max(axis=0)
        return np.asarray(off / max(float(np.interp(t, motion.time, motion.swing)), 1e-12))

    def _instant(self, motion: ReducedMotion, t: float) -> Instant:
        """The state of a motion at a time, with the pressure modes of its equilibrium."""
        h = 1e-4 * 2 * np.pi / float(np.sqrt(self.square.max()))
        before, now, after = self._displaced(motion.dense(np.array([t - h, t, t + h])))
        p = np.asarray(scipy.interpolate.CubicSpline(self.pressure, self.p)(motion.dense(t)[0]), float)
        return Instant(t, State(now, p), (after - before) / (2 * h), (after - 2 * now + before) / h**2, None)

    def _between(self, along: Array, at: csr_matrix | None) -> Array:
        """The error (s,) or (s, p, 3) mm of the equilibria at pressures (s,) MPa, between those that were
        solved."""
        k = self.pressure[::2]
        u, slope = (x[::2].reshape(len(k), -1) for x in (self.u, self.slope))
        coarse = scipy.interpolate.CubicHermiteSpline(k, u, slope)
        off = coarse(self.pressure[1::2]).reshape(-1, *self.case.nodes.shape) - self.u[1::2]
        errors = BENT * _sizes(off, at)
        flat = [np.interp(along, self.pressure[1::2], column) for column in errors.reshape(len(errors), -1).T]
        return np.moveaxis(np.array(flat), 0, -1).reshape(len(along), *errors.shape[1:])


def _sizes(field: Array, at: csr_matrix | None) -> Array:
    """The largest length (s,) of a field (s, n, 3) over all nodes, or its sizes (s, p, 3) at points."""
    if at is None:
        return np.asarray(np.linalg.norm(field, axis=2).max(axis=1))
    return np.array([np.abs(at @ one) for one in field])


def _load(loaded: LoadedState, nudge: float) -> Array:
    """The derivative (n, 3) N/MPa of the load by the pressure at a state."""
    high, low = (imbalance(loaded.problem, loaded.state, loaded.held.pressure + sign * nudge, None).force
                 for sign in (1, -1))  # fmt: skip
    free = np.zeros(high.size)
    free[loaded.problem.kernel.free] = 1.0
    return np.asarray((low - high) / (2 * nudge) * free.reshape(high.shape))


def _aligned(before: Array, shape: Array, square: Array, M: Any) -> tuple[Array, Array]:
    """Shapes (m, n, 3) and squares (m,) in the order and with the signs of those at the state before."""
    a, b = before.reshape(len(before), -1), shape.reshape(len(shape), -1)
    both = a @ (M @ b.T)
    rows, columns = scipy.optimize.linear_sum_assignment(-np.abs(both))
    sign = np.sign(both[rows, columns])
    return shape[columns] * sign[:, None, None], square[columns]
