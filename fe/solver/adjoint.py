"""Derivatives towards creep and softening from a base without memory, for any number of laws at once.

Without memory the base is a function U(q) of pressure, and so are its tangent K and its stress S. A small
memory changes the stress by dS(t), which follows from the base's own history. The response of an observed
displacement is l . f, where f are the nodal forces of dS and l, the response to a unit force there, is the
adjoint field K(q) l = -e. Adjoint fields are computed at the levels of the curve only, and interpolated
between them as the curve's derivatives are. Creep is linear in the history of the stress: with S interpolated
between levels, too, every time constant costs a recursion over numbers, not over fields.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.sparse import csr_matrix

from fe.element import Array, Integers
from fe.kernel.assembly import Response, Softening, State
from fe.material import relaxation
from fe.path import Path, in_time, knots
from fe.solver.curve import Curve
from fe.solver.historyvariables import SHY
from fe.solver.loadings import Loadings
from fe.solver.memory import Course, series
from fe.solver.newton import Problem, Residual, tangent_at
from fe.solver.sensitivity import Differenced


@dataclass(frozen=True)
class NullTangents:
    """Parameters, by number, whose neighbouring problems differ from a base without memory by a memory alone.

    pressure (t,) MPa: the curve's pressure at the log times.
    """

    loadings: Loadings
    curves: tuple[Curve, ...]
    pressure: Array
    varied: Mapping[int, Differenced]

    def at(self, operator: csr_matrix) -> dict[int, Array]:
        """Derivatives (s, p, 3) mm per unit at the output times, by number, of points that `operator` (p, n)
        takes from the nodes."""
        fields = [
            _adjoints(q, curve, operator)
            for q, curve in zip(self.loadings.problems, self.curves, strict=True)
        ]
        creeping = {n: v for n, v in self.varied.items() if _creeps(v)}
        softening = {n: v for n, v in self.varied.items() if _softens(v)}
        shape = (len(self.loadings.path.output), operator.shape[0], 3)
        out = {n: np.zeros((shape[0], 3 * shape[1])) for n in self.varied}
        for n, rows in self._creep(creeping, fields).items():
            out[n] += rows + self._secant_correction(creeping[n], operator).reshape(rows.shape)
        for n, rows in self._softening(softening, fields).items():
            out[n] += rows
        return {n: rows.reshape(shape) for n, rows in out.items()}

    def _shares(self, time: Array) -> Array:
        """Interpolation weights (k, l) of the levels of all curves, in turn, at times (k,) s."""
        q = np.interp(time, self.loadings.path.time, self.pressure)
        number, parts = self.loadings.at(time), []
        for k, curve in enumerate(self.curves):
            x = curve.pressure
            parts.append(scipy.interpolate.CubicSpline(x, np.eye(len(x)))(q) * (number == k)[:, None])
        return np.concatenate(parts, axis=1)

    # -- creep ----------------------------------------------------------------------------------------------

    def _creep(self, varied: Mapping[int, Differenced], fields: Sequence[Array]) -> dict[int, Array]:
        """Derivatives (s, 3 p) by number due to Prony relaxation of the levels' stresses."""
        if not varied:
            return {}
        path, base = self.loadings.path, self.loadings.problems[0]
        sides = [q.constants.prony for v in varied.values() for q in (v.plus, v.minus)]
        # elements that no side tells apart make one group
        rows = np.concatenate([np.moveaxis(s, 2, 1).reshape(-1, s.shape[1]) for s in sides])
        _, group_row, group = np.unique(rows, axis=1, return_index=True, return_inverse=True)
        answers = _answers(base, self.curves, fields, group.reshape(-1), len(group_row))  # (l, 3 p, g, l)
        before, now = self._shares(path.time), self._shares(path.output)
        out = {}
        for k, (n, v) in enumerate(varied.items()):
            plus, minus = (
                np.stack([_remaining(side[:, e], path, before) for e in group_row])
                for side in sides[2 * k : 2 * k + 2]
            )
            change = (plus - minus) / (2 * v.step)  # (g, s, l)
            out[n] = np.einsum("sl,lpgm,gsm->sp", now, answers, change, optimize=True)
        return out

    def _secant_correction(self, v: Differenced, operator: csr_matrix) -> Array:
        """Correction (s, p, 3) of the tangent at null to a secant over a wide step: the secant between the
        states at the creep-equivalent pressures of both sides, less its own tangent."""
        path, number = self.loadings.path, self.loadings.at(self.loadings.path.output)
        plus, minus = (
            np.interp(path.output, path.time, Course.of(q, path, path.time).pressure)
            for q in (v.plus, v.minus)
        )
        here = np.interp(path.output, path.time, self.pressure)
        remaining = [
            _remaining(series(q), path, self.pressure[:, None])[:, 0] for q in (v.plus, v.minus)
        ]
        slope = (remaining[1] - remaining[0]) / (2 * v.step)
        out = np.empty((len(here), operator.shape[0], 3))
        for k, curve in enumerate(self.curves):
            rows = number == k
            there = curve.values(operator, plus[rows]) - curve.values(operator, minus[rows])
            along = curve.values(operator, here[rows], 1)
            out[rows] = there / (2 * v.step) - slope[rows, None, None] * along
        return out

    # -- softening ------------------------------------------------------------------------------------------

    def _softening(self, varied: Mapping[int, Differenced], fields: Sequence[Array]) -> dict[int, Array]:
        """Derivatives (s, 3 p) by number due to softening below the largest energy so far, at the times of a
        history."""
        if not varied:
            return {}
        path = self.loadings.path
        time = knots(path, softening=True)
        forces = self._softened(time, list(varied.values()))
        shares, responses = self._shares(time), np.zeros((len(varied), len(time), len(fields[0][0])))
        begin = 0
        for adjoints in fields:
            part = shares[:, begin : begin + len(adjoints)]
            begin += len(adjoints)
            answer = forces.reshape(-1, forces.shape[-1]) @ adjoints.reshape(-1, adjoints.shape[-1]).T
            answer = answer.reshape(*forces.shape[:2], *adjoints.shape[:2])
            responses += np.einsum("kl,vklp->vkp", part, answer)
        weights = in_time(path, time, softening=True)
        return {n: weights @ rows for n, rows in zip(varied, responses, strict=True)}

    def _softened(self, time: Array, varied: Sequence[Differenced]) -> Array:
        """Nodal forces (v, k, 3 n) N per unit at times (k,) s."""
        loadings, number = self.loadings, self.loadings.at(time)
        q = np.interp(time, loadings.path.time, self.pressure)
        out = np.zeros((len(varied), len(time), loadings.problems[0].kernel.dofs))
        peak: Array | None = None
        for k, (c, load) in enumerate(zip(number, q, strict=True)):
            problem, u = loadings.problems[c], self.curves[c].state(load).u
            energy = problem.kernel.energies(u, problem.constants, problem.geometry)
            peak = (1 - SHY) * energy if peak is None else peak
            below = energy < peak
            if below.any():
                stress = problem.kernel.isochoric(u, problem.constants, problem.geometry)
                for n, v in enumerate(varied):
                    drop = [_drop(x, Response(stress, energy), peak) for x in (v.plus, v.minus)]
                    change = (drop[1] - drop[0]) / (2 * v.step)
                    out[n, k] = problem.kernel.internal(u, change[..., None, None] * stress).ravel()
            peak = np.where(below, peak, (1 - SHY) * energy)
        return out


def _creeps(v: Differenced) -> bool:
    return any(q.constants.prony[..., 0].any() for q in (v.plus, v.minus))


def _softens(v: Differenced) -> bool:
    return any(q.constants.softening[:, 0].any() for q in (v.plus, v.minus))


def _drop(problem: Problem, response: Response, peak: Array) -> Array:
    """Reduction (e, q) of the stress scale by softening; it acts on the long-term part."""
    c = problem.constants
    if not len(c.softening) or response.energy is None:
        return np.zeros_like(peak)
    return (1 - c.prony[..., 0].sum(0))[:, None] * Softening(c.softening, peak, None).drop(response.energy)


def _adjoints(problem: Problem, curve: Curve, operator: csr_matrix) -> Array:
    """Adjoint fields (l, 3 p, 3 n) mm per N at every level, one for each component of each point."""
    count, out = operator.shape[0], []
    rows, dense = problem.kernel.dofs // 3, operator.toarray()
    for k, load in enumerate(curve.pressure):
        state = State(curve.u[k], curve.p[k], float(curve.rotation[k]))
        step, units = tangent_at(problem, state, load=float(load)), []
        for a in range(count):
            for d in range(3):
                force = np.zeros((rows, 3))
                force[:, d] = dense[a]
                moment = problem.clamp_gap(state.rotation, force)
                units.append(Residual(force, np.zeros_like(state.p), moment))
        out.append([change.u.ravel() for change in step.solve(units)])
    return np.array(out)


def _answers(
    problem: Problem, curves: Sequence[Curve], fields: Sequence[Array], group: Integers, count: int
) -> Array:
    """Displacements (l, 3 p, g, m) mm at every level l due to the stress of every level m in each of `count`
    groups (e,) of elements."""
    kernel, states = problem.kernel, [u for curve in curves for u in curve.u]
    adjoints = [f for field in fields for f in field]
    out = np.empty((len(states), len(adjoints[0]), count, len(states)))
    for m, there in enumerate(states):
        stress = kernel.isochoric(there, problem.constants, problem.geometry)
        for g in range(count):
            part = stress if count == 1 else stress * (group == g)[:, None, None, None]
            for n, here in enumerate(states):
                out[n, :, g, m] = adjoints[n] @ kernel.internal(here, part).ravel()
    return out


def _remaining(prony: Array, path: Path, shares: Array) -> Array:
    """Coefficients (s, l) of the levels' stresses at the output times after relaxation by a Prony series (m,
    2), from their shares (t, l) at the log times: linear viscoelasticity, exact for shares linear in time."""
    time, output = path.time, path.output
    stress = (1 - prony[:, 0].sum()) * shares
    for g, tau in prony[prony[:, 0] != 0]:
        decay, ramp = relaxation(np.array([[g, tau]]), np.diff(time))
        put_on = g * ramp[:, None] * np.diff(shares, axis=0)
        fading = (0.0 if path.settled else g) * shares[0]  # else the first is put on at once
        stress[0] += fading
        for n, more in enumerate(put_on):
            fading = decay[n] * fading + more
            stress[n + 1] += fading
    k = np.clip(np.searchsorted(time, output, side="right") - 1, 0, len(time) - 2)
    x = np.clip((output - time[k]) / (time[k + 1] - time[k]), 0.0, 1.0)[:, None]
    return np.asarray((1 - x) * stress[k] + x * stress[k + 1])
