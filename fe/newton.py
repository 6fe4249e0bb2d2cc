"""A case, a load and a starting state -> the equilibrium state, by Newton's method with exact tangents."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fe.assembly import Constants, Geometry, Kernel, Linearised, Memory, State
from fe.case import Case
from fe.element import Array

# Last correction: of u against the structure's size, of p against a tenth of the shear modulus. Convergence
# is quadratic in both, and near incompressibility p settles last: with u alone the tangent can be 1 % off.
TOLERANCE = 1e-5
# A factorised tangent serves again, at a quarter of the cost of a new one, for states within NEARBY of the
# structure's size, as long as every correction is at most SHRINK of the one before.
NEARBY = 0.02
SHRINK = 0.2
EXACT = 1e-3  # of TOLERANCE is what such corrections may leave, as Newton's last one does


@dataclass(frozen=True)
class Problem:
    """One case made ready: kernel (shared by cases with the same mesh and supports), constants, dead forces
    (n, 3)."""

    kernel: Kernel
    constants: Constants
    case: Case
    dead: Array
    geometry: Geometry

    @staticmethod
    def of(case: Case, kernel: Kernel | None = None) -> "Problem":
        """The problem of a case, on an existing kernel of the same mesh where given."""
        dead = np.zeros_like(case.nodes)
        for name, force in case.forces.items():
            rows = case.node_sets[name]
            dead[rows] += np.asarray(force, float) / len(rows)
        kernel = kernel or Kernel(case)
        same = np.array_equal(case.nodes, kernel.geometry.nodes)
        geometry = kernel.geometry if same else Geometry(case.nodes, kernel.connectivity)
        return Problem(kernel, Constants.of(case), case, dead, geometry)

    @property
    def shear(self) -> float:
        """The smallest shear modulus 2 (C10 + C01) of the material, MPa."""
        return float(2 * (self.constants.C10 + self.constants.C01).min())

    def start(self) -> State:
        """The undeformed state with the prescribed displacements put in."""
        u = np.zeros_like(self.case.nodes)
        for s in self.case.supports:
            if s.value is not None:
                rows = self.case.node_sets[s.nodes]
                u[np.ix_(rows, np.array(s.components))] = s.value[:, list(s.components)]
        return State(u, np.zeros((len(self.case.connectivity), 4)))

    def clamp_motion(self, rotation: float) -> tuple[Array, Array, Array]:
        """Displacement (k, 3) mm of the clamp nodes at a rotation, and its first two derivatives."""
        if self.case.clamp is None:
            return (np.empty((0, 3)),) * 3
        x = self.case.nodes[self.kernel.clamped]
        dx, dz = x[:, 0] - self.case.clamp.centre[0], x[:, 2] - self.case.clamp.centre[1]
        s, c, none = np.sin(rotation), np.cos(rotation), np.zeros(len(x))
        moved = np.stack([c * dx + s * dz - dx, none, c * dz - s * dx - dz], axis=1)
        first = np.stack([c * dz - s * dx, none, -s * dz - c * dx], axis=1)
        return moved, first, np.stack([-s * dz - c * dx, none, s * dx - c * dz], axis=1)


class Step:
    """A factorised tangent at one state: solves for any right-hand side, clamp rotation included."""

    def __init__(self, problem: Problem, state: State, system: Linearised) -> None:
        self.problem, self.state, self.system = problem, state, system
        kernel, clamp = problem.kernel, problem.case.clamp
        kernel.matrix.factorise(system.data)
        self._compliance = clamp.compliance if clamp else 0.0
        _, self._turn, bend = problem.clamp_motion(state.rotation)
        self._side = system.turning.ravel()[kernel.free]
        self._stiffness = float(
            (system.turning[kernel.clamped] * self._turn).sum() + (bend * system.force[kernel.clamped]).sum()
        )

    @cached_property
    def _back(self) -> Array:
        """The free displacements' answer to a turn of the clamp, mm per rad, but for its sign."""
        return self.problem.kernel.matrix.solve(self._side)

    def moment(self, force: Array) -> float:
        """The generalised force (N mm) of nodal forces (n, 3) on the clamp's rotation."""
        return float((self._turn * force[self.problem.kernel.clamped]).sum())

    def solve(self, force: Array, moment: float, gap: Array | None) -> State:
        """The change of state that cancels a change of the residuals: nodal `force` (n, 3) N (not condensed
        where `gap` (e, 4) mm3 is given), and `moment`, the residual of the clamp's equation in rad."""
        kernel, system = self.problem.kernel, self.system
        if gap is not None:
            extra = (system.coupling @ (system.compliance @ gap[..., None])).reshape(-1, 27, 3)
            force = force + kernel.gather(extra)
            moment = moment + self._compliance * self.moment(kernel.gather(extra))
        x = kernel.matrix.solve(force.ravel()[kernel.free])
        turn = -moment
        if self._compliance:
            pivot = 1 + self._compliance * (self._stiffness - float(self._side @ self._back))
            turn = (-moment + self._compliance * float(self._side @ x)) / pivot
        du = np.zeros((kernel.dofs // 3, 3))
        du.reshape(-1)[kernel.free] = -x if turn == 0 else -x - self._back * turn
        du[kernel.clamped] = self._turn * turn
        gap = system.gap if gap is None else gap
        strain = np.swapaxes(system.coupling, 1, 2) @ du[kernel.connectivity].reshape(-1, 81, 1)
        return State(du, (system.compliance @ (gap[..., None] + strain))[..., 0], float(turn))


@dataclass(frozen=True)
class Equilibrium:
    """The equilibrium state and the tangent factorised next to it, or the reason why there is none.

    The tangent's state and the equilibrium differ by less than TOLERANCE of the structure's size.
    """

    state: State | None
    step: Step | None
    iterations: int
    reason: str


def _residuals(
    problem: Problem, state: State, load: float, memory: Memory | None
) -> tuple[Linearised, float]:
    _, turn, _ = problem.clamp_motion(state.rotation)
    system = problem.kernel.linearise(state, problem.constants, load, memory, turn)
    force = system.force - problem.dead
    system = replace(system, force=force)
    clamp = problem.case.clamp
    compliance = clamp.compliance if clamp else 0.0
    return system, state.rotation + compliance * float((turn * force[problem.kernel.clamped]).sum())


def equilibrium(
    problem: Problem,
    start: State,
    *,
    load: float,
    memory: Memory | None = None,
    last: Step | None = None,
    exact: bool = True,
    limit: int = 25,
    tolerance: float = TOLERANCE,
) -> Equilibrium:
    """The equilibrium at follower pressure `load` MPa, from `start`, in at most `limit` factorisations.

    last: the newest factorised tangent, of a neighbouring state; it serves as far as it can. exact: the
    result's tangent is that of the equilibrium, as derivatives need it; otherwise it may be a nearby one's.
    Never raises for lack of convergence: `reason` then says what stopped it.
    """
    kernel, state, before = problem.kernel, _consistent(problem, start), np.inf
    extent = float(np.ptp(problem.case.nodes, axis=0).max())
    small = (tolerance * extent, 10 * tolerance * problem.shear)  # mm, MPa
    for iteration in range(limit):
        if last is not None and np.abs(state.u - last.state.u).max() < NEARBY * extent:
            share = 1.0 if exact else EXACT  # an exact tangent brings a correction of its own
            state, settled = _chord(problem, state, last, load, memory, (share * small[0], share * small[1]))
            if settled and not exact:
                return Equilibrium(state, last, iteration, "converged")
        system, moment = _residuals(problem, state, load, memory)
        free = system.force.ravel()[kernel.free]
        if not np.isfinite(system.data).all():
            return Equilibrium(None, None, iteration, "an element turned inside out")
        size = float(np.abs(free).max(initial=0.0))
        if iteration > 2 and size > 1e3 * before:
            return Equilibrium(None, None, iteration, "the residual grew: limit point or too large a step")
        last = Step(problem, state, system)
        change = last.solve(system.force, moment, None)
        length = float(np.abs(change.u).max())
        if not np.isfinite(length) or (iteration > 0 and length > 0.5 * extent):
            return Equilibrium(None, None, iteration + 1, "the correction left the size of the structure")
        state = _consistent(problem, moved(state, change))
        if length < small[0] and np.abs(change.p).max() < small[1]:
            return Equilibrium(state, last, iteration + 1, "converged")
        before = min(before, size) if np.isfinite(size) else before
    return Equilibrium(None, None, limit, f"no equilibrium in {limit} iterations")


def _chord(
    problem: Problem, state: State, step: Step, load: float, memory: Memory | None, small: tuple[float, float]
) -> tuple[State, bool]:
    """The state after corrections with a tangent of nearby (the chord method), and whether it is an
    equilibrium; the best state where they do not shrink fast enough."""
    before = np.inf
    while True:
        change = step.solve(*_swapped(imbalance(problem, state, load, memory)))
        length = float(np.abs(change.u).max())
        if not length < SHRINK * before:
            return state, False
        left = SHRINK if np.isinf(before) else length / before  # linear convergence: of this correction
        state, before = _consistent(problem, moved(state, change)), length
        if left * length < small[0] and left * np.abs(change.p).max() < small[1]:
            return state, True


def _swapped(residuals: tuple[Array, Array, float]) -> tuple[Array, float, Array]:
    force, gap, moment = residuals
    return force, moment, gap


def moved(state: State, change: State, factor: float = 1.0) -> State:
    """The state plus `factor` times a change of state."""
    return State(
        state.u + factor * change.u, state.p + factor * change.p, state.rotation + factor * change.rotation
    )


def _consistent(problem: Problem, state: State) -> State:
    """The state with the clamp nodes exactly where its rotation puts them."""
    if problem.case.clamp is None:
        return state
    u = state.u.copy()
    u[problem.kernel.clamped] = problem.clamp_motion(state.rotation)[0]
    return replace(state, u=u)


def imbalance(
    problem: Problem, state: State, load: float, memory: Memory | None
) -> tuple[Array, Array, float]:
    """All residuals at a state, not condensed: forces (n, 3) N, volume gaps (e, 4) mm3, clamp in rad.

    The problem's own positions are used, the clamp's included, so that a problem with other nodes on the same
    kernel is differenced right.
    """
    kernel, clamp = problem.kernel, problem.case.clamp
    state = _consistent(problem, state)
    force, gap = kernel.residual(state, problem.constants, load, memory, problem.geometry)
    force -= problem.dead
    _, turn, _ = problem.clamp_motion(state.rotation)
    moment = float((turn * force[kernel.clamped]).sum())
    return force, gap, state.rotation + (clamp.compliance if clamp else 0.0) * moment
