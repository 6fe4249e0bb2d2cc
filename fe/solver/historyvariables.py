"""History variables at one time of a path: Prony stresses, largest energies, slip on an obstacle."""

from dataclasses import dataclass, replace

import numpy as np

from fe.element import Array, Flags
from fe.kernel import compiled
from fe.kernel.assembly import Memory, Response, Softening
from fe.kernel.contact import ObstacleFaces
from fe.material import relaxation
from fe.solver.newton import Problem

# The largest energy so far is kept this much smaller. A held state, or one that comes back to its largest
# load, then lies clearly on the virgin side of the kink at W = W_max and not on either by rounding.
SHY = 1e-6


@dataclass(frozen=True)
class Evaluated:
    """A problem at displacements u (n, 3) mm, with its constitutive response."""

    problem: Problem
    u: Array
    response: Response


@dataclass(frozen=True)
class Past:
    """History variables: the law's stress (e, q, 3, 3) MPa at the last time, Prony stresses (m, e, q, 3, 3),
    the largest energy so far (e, q) N mm/mm3 where softening needs it, and the obstacle with the slip so far.
    """

    now: Array
    terms: Array
    peak: Array | None
    plane: ObstacleFaces | None

    @staticmethod
    def first(seen: Evaluated) -> "Past":
        """History variables after instantaneous loading from rest."""
        response, problem = seen.response, seen.problem.after(seen.u)
        terms = problem.constants.prony[..., 0][..., None, None, None] * response.stress
        peak = None if response.energy is None else (1 - SHY) * response.energy
        return Past(response.stress, terms, peak, problem.plane)

    def on(self, problem: Problem) -> Problem:
        """The problem with the slip so far."""
        return replace(problem, plane=self.plane) if problem.has_friction else problem

    def below(self, response: Response) -> Flags | None:
        """Flags (e, q) of points whose energy is below the largest so far; None without softening."""
        if self.peak is None or response.energy is None:
            return None
        return np.asarray(response.energy < self.peak)

    def memory(self, problem: Problem, dt: float, below: Flags | None = None) -> Memory:
        """Input of the next time step, dt s long; below (e, q): prescribed branch of softening, by default
        chosen by energy."""
        c, prony = problem.constants, problem.constants.prony
        g, (decay, ramp) = prony[..., 0], relaxation(prony, dt)
        viscous = (g * ramp).sum(0)
        history_stress = np.empty_like(self.now)
        flat = (len(self.now), self.now[0].size)
        compiled.history_stress(
            self.terms.reshape(len(g), *flat), self.now.reshape(flat), decay, viscous,
            history_stress.reshape(flat),
        )
        softening = None
        if self.peak is not None and len(c.softening):
            table = c.softening * np.stack([1 - g.sum(0), *np.ones((2, len(viscous)))], axis=1)
            softening = Softening(table, self.peak, below)
        return Memory(1 - g.sum(0) + viscous, history_stress, softening)

    def after(self, seen: Evaluated, dt: float, below: Flags | None, slides: Flags | None) -> "Past":
        """History variables after one more time step; a neighbour takes the base's branches of softening and
        slip."""
        response, prony = seen.response, seen.problem.constants.prony
        decay, ramp = relaxation(prony, dt)
        terms, flat = np.empty_like(self.terms), (len(self.now), self.now[0].size)
        compiled.relaxed(
            self.terms.reshape(len(prony), *flat), self.now.reshape(flat), response.stress.reshape(flat),
            decay, prony[..., 0] * ramp, terms.reshape(len(prony), *flat),
        )  # fmt: skip
        peak = self.peak
        if peak is not None and response.energy is not None and below is not None:
            peak = np.where(below, peak, (1 - SHY) * response.energy)
        return Past(response.stress, terms, peak, self.on(seen.problem).sliding(slides).after(seen.u).plane)
