"""An equilibrium under a load that has been held for long, and the tangent that a vibration feels there."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fe.case import Case, Support
from fe.element import Array
from fe.kernel.assembly import Memory, State
from fe.material import Material
from fe.mesh.mirror import symmetry_support
from fe.path import Path
from fe.solver.curve import Curve
from fe.solver.loadings import Loadings
from fe.solver.newton import Equilibrium, Problem, Step, equilibrium, tangent_at
from fe.solving import solve

DOWN = (4, 16)  # steps to a pressure below 0, the more where the fewer fail
NONE = np.zeros((0, 3))


@dataclass(frozen=True)
class HeldLoad:
    """A load that is held: pressure in MPa, gravity (3,) mm/s2, dead forces `pulls` (h, 3) N at material
    points `places` (h, 3) mm."""

    pressure: float = 0.0
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    places: Array = field(default_factory=lambda: NONE)
    pulls: Array = field(default_factory=lambda: NONE)

    @property
    def path(self) -> Path:
        """The path of one output time under this load."""
        time, load = np.array([0.0, 1.0]), np.array([0.0, self.pressure])
        return Path(time, load, time[1:], gravity=self.gravity, places=self.places, pulls=self.pulls)


@dataclass(frozen=True)
class LoadedState:
    """A case at rest under a held load: its problem with all loads, its state, and the reason where there is
    none ("converged" else)."""

    problem: Problem
    held: HeldLoad
    state: State
    reason: str

    @property
    def converged(self) -> bool:
        """True if there is an equilibrium."""
        return self.reason == "converged"

    @cached_property
    def stress(self) -> Array:
        """Isochoric second Piola-Kirchhoff stress (e, q, 3, 3) MPa of the instantaneous constants."""
        problem = self.problem
        return problem.kernel.isochoric(self.state.u, problem.constants, problem.geometry)

    def storage(self, omega: float) -> Array:
        """Storage modulus (e,) of every element at an angular frequency in 1/s, over the instantaneous one:
        1 - sum g + sum g (omega tau)^2 / (1 + (omega tau)^2) (Ferry 1980, Viscoelastic Properties of
        Polymers)."""
        g, tau = np.moveaxis(self.problem.constants.prony, -1, 0)
        x = (omega * tau) ** 2
        return np.asarray(1 - g.sum(axis=0) + (g * x / (1 + x)).sum(axis=0))

    def lost(self, omega: float) -> Array:
        """Loss modulus (e,) of every element, over the instantaneous modulus: sum g omega tau / (1 + (omega
        tau)^2)."""
        g, tau = np.moveaxis(self.problem.constants.prony, -1, 0)
        return np.asarray((g * omega * tau / (1 + (omega * tau) ** 2)).sum(axis=0))

    def step(self, omega: float, *, sideways: bool = False) -> Step:
        """The factorised tangent that small vibrations of an angular frequency in 1/s feel.

        Stress and follower pressure are those of the state; what a strain adds to the stress has the storage
        modulus. sideways: of a half model, for motions that are antisymmetric about its plane.
        """
        problem = self._sideways if sideways else self.problem
        return tangent_at(problem, self.state, load=self.held.pressure, memory=self._memory(omega))

    def _memory(self, omega: float) -> Memory | None:
        if not len(self.problem.constants.prony):
            return None
        storage = self.storage(omega)
        rest = (self.storage(0.0) - storage)[:, None, None, None] * self.stress
        return Memory(storage, rest)

    @cached_property
    def _sideways(self) -> Problem:
        """The problem whose plane of symmetry, and clamp, hold what is antisymmetric about it."""
        case, plane = self.problem.case, symmetry_support(self.problem.case)
        assert plane is not None
        supports = tuple(Support(s.nodes, (0, 2)) if s is plane else s for s in case.supports)
        clamp = case.clamp and replace(case.clamp, compliance=0.0)
        return Problem.of(replace(case, supports=supports, clamp=clamp))

    def stiffness(self, shape: Array, share: Array) -> float:
        """Twice the strain energy in N mm of a motion (n, 3) mm, of what strain adds to the isochoric stress,
        every element's part times its share (e,)."""
        kernel, c, change = self.problem.kernel, self.problem.constants, State(shape, 0 * self.state.p)
        pasts = (Memory(share, -share[:, None, None, None] * self.stress), Memory(0 * share, 0 * self.stress))
        with_it, without = (
            kernel.along(self.state.u, c.bulk, 0.0, kernel.at_points(self.state, c, past), [change])[0][0]
            for past in pasts
        )
        return float(((with_it - without) * shape).sum())


def at_rest(case: Case, held: HeldLoad) -> LoadedState:
    """The equilibrium of a case under a held load, all creep at its end, softening left out.

    ValueError where the tangent has no symmetric part alone: friction, or a chamber with an open edge.
    """
    return at_rest_under(case, held, [held.pressure])[0]


def at_rest_under(case: Case, held: HeldLoad, pressures: Sequence[float]) -> list[LoadedState]:
    """The equilibria (k,) of a case as `at_rest` finds them, under pressures (k,) MPa in place of the held
    one, along one load path."""
    relaxed = replace(case, materials={k: _relaxed(m) for k, m in case.materials.items()})
    plain = replace(case, materials={k: replace(m, mullins=None) for k, m in case.materials.items()})
    problem = Loadings.of(Problem.of(plain), held.path, (), ()).problems[0]
    for what, there in (("friction", problem.has_friction), ("an open edge", not problem.kernel.symmetric)):
        if there:
            raise ValueError(
                f"vibrations with {what}: its tangent is not symmetric, wanted an obstacle without friction "
                "and a closed chamber; leave it out"
            )
    loads = [replace(held, pressure=pressure) for pressure in pressures]
    solution = solve(relaxed, replace(held, pressure=max(0.0, *pressures)).path)
    reached = np.inf if solution.converged else solution.reached
    prony = problem.constants.prony
    rest = Memory(1 - prony[..., 0].sum(axis=0), 0 * problem.geometry.weight[..., None, None] * np.eye(3))
    memory = rest if len(prony) else None
    return [
        _loaded(problem, load, solution.curves[0], memory) if max(load.pressure, 0.0) < reached
        else LoadedState(problem, load, problem.start(), solution.reason) for load in loads
    ]  # fmt: skip


def _loaded(problem: Problem, held: HeldLoad, curve: Curve, memory: Memory | None) -> LoadedState:
    """The equilibrium under a held load, near a curve of those from no pressure on."""
    start = curve.state(max(held.pressure, 0.0))
    found = equilibrium(problem, start, load=max(held.pressure, 0.0), memory=memory)
    rest = found.state
    for count in DOWN if held.pressure < 0 and rest is not None else ():
        assert rest is not None
        found = _sucked(problem, rest, np.linspace(0.0, held.pressure, count + 1)[1:], memory)
        if found.state is not None:
            break
    return LoadedState(problem, held, found.state or start, found.reason)


def _sucked(problem: Problem, start: State, loads: Array, memory: Memory | None) -> Equilibrium:
    """The equilibrium at the last of pressures (k,) MPa below 0, one after another: the paths of `solve`
    begin at no pressure, and rise."""
    for load in loads:
        found = equilibrium(problem, start, load=float(load), memory=memory)
        if found.state is None:
            break
        start = found.state
    return found


def _relaxed(material: Material) -> Material:
    """The material after long creep."""
    return material.instant.stiffened(1 - sum(g for g, _ in material.prony))
