"""The equilibrium of a case under one load, by Newton's method with exact tangents."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from fe.case import Case
from fe.element import Array, Flags
from fe.kernel.assembly import ElementConstants, Geometry, Kernel, Linearised, Memory, State
from fe.kernel.compiled import PointTangents
from fe.kernel.contact import ObstacleFaces
from fe.kernel.layer import LayerFaces
from fe.kernel.selfcontact import SelfFaces
from fe.kernel.systems import addition, coupled
from fe.path import Path

# Last correction: of u against the structure's size, of p against a tenth of the shear modulus. The tangent
# that serves derivatives is that far from the equilibrium: 1e-7 leaves them 1e-6 wrong, 1e-5 left 2e-3.
TOLERANCE = 1e-7
# A factorised tangent serves again, at an eighth of the cost of a new one, for states within NEARBY of the
# structure's size, as long as every correction is at most SHRINK of the last but one: a wrong p first pushes
# u away, and the next correction brings it back.
NEARBY = 0.02
SHRINK = 0.2
# Where a tangent jumps: how far the forces along a correction may turn round before it is shortened, in how
# many tries; and how small a correction shows that the jumps are behind, of NEARBY.
OVERSHOT = 0.3
SEARCHES = 6
SETTLING = 0.1
STALLED = 0.1  # of a correction, twice: walls that touch let no more of it pass
LIMIT = 25  # factorisations for one equilibrium
SOFTEST = 1 / 512  # of a plane's stiffness: with that it is met first where it cannot be met at once
LOOSE = 1e-4  # as TOLERANCE, on the way there
TOO_FAR = "the load is beyond a limit point, or too large for one step"
QUICK = 0.02  # shrink corrections of this tangent by at most, where it serves for derivatives, too
EXACT = 0.01  # of TOLERANCE is what such corrections may leave, as Newton's last one does


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One case made ready: kernel (shared by cases with the same mesh and supports), constants, dead forces
    (n, 3) N, forces that grow with the pressure, growing (n, 3) N/MPa, or None, prescribed displacements (k,)
    mm at the supported degrees of freedom, walls that may touch each other."""

    kernel: Kernel
    constants: ElementConstants
    case: Case
    dead: Array
    prescribed: Array
    geometry: Geometry
    layers: tuple[LayerFaces, ...]
    plane: ObstacleFaces | None
    walls: SelfFaces | None = None
    growing: Array | None = None

    @staticmethod
    def of(case: Case, kernel: Kernel | None = None) -> "Problem":
        """The problem of a case without weight, on an existing kernel of the same mesh where given."""
        dead, growing = _nodal(case, case.forces), _nodal(case, case.growing) if case.growing else None
        kernel = kernel or Kernel(case)
        own, curved = kernel.geometry, case.precurvature
        same = np.array_equal(case.nodes, own.nodes) and curved == own.precurvature
        geometry = own if same else Geometry(case.nodes, kernel.connectivity, kernel.element, curved)
        layers = tuple(LayerFaces(case, sheet) for sheet in case.sheets)
        plane = ObstacleFaces(case) if case.contact and case.contact.stiffness else None
        walls = SelfFaces(case) if case.self_contact else None
        prescribed = case.prescribed.ravel()[kernel.supported]
        return Problem(
            kernel=kernel, constants=ElementConstants.of(case), case=case, dead=dead, prescribed=prescribed,
            geometry=geometry, layers=layers, plane=plane, walls=walls, growing=growing,
        )  # fmt: skip

    @property
    def faces(self) -> tuple[LayerFaces | ObstacleFaces | SelfFaces, ...]:
        """What acts on its surfaces besides the pressure."""
        return tuple(f for f in (*self.layers, self.plane, self.walls) if f is not None)

    @property
    def proportional(self) -> bool:
        """Whether pressure alone loads it, so that u is a function of pressure over the moduli."""
        clamp = self.case.clamp
        held = bool(clamp and clamp.compliance) or bool(self.layers) or self.plane is not None
        return not self.dead.any() and not held

    def remembers(self, path: Path) -> bool:
        """Whether the material may answer by other than a function of pressure over the moduli."""
        c = self.constants
        drifts = path.stiffness is not None and not self.proportional
        return bool(len(c.prony) or len(c.softening)) or drifts

    def loaded(self, pressure: float) -> Array:
        """The outside forces (n, 3) N under a pressure in MPa."""
        return self.dead if self.growing is None else self.dead + pressure * self.growing

    def placed_as(self, other: "Problem") -> bool:
        """Whether two problems differ at most in constants of materials and outside forces."""
        bare = all(not q.layers and q.plane is None and q.walls is None for q in (self, other))
        return (
            bare
            and self.kernel is other.kernel
            and self.geometry is other.geometry is self.kernel.geometry
            and self.case.clamp == other.case.clamp
            and np.array_equal(self.prescribed, other.prescribed)
        )

    def stiffened(self, factor: float) -> "Problem":
        """The problem with all moduli multiplied."""
        if factor == 1:
            return self
        walls = self.walls.times(factor) if self.walls else None
        return replace(self, constants=self.constants.times(factor), walls=walls)

    def softer(self, factor: float) -> "Problem":
        """The problem with `factor` of the stiffness of its plane and of walls that touch each other."""
        plane, walls = self.plane, self.walls
        plane, walls = plane and plane.softer(factor), walls and walls.times(factor)
        return replace(self, plane=plane, walls=walls)

    def closed(self, u: Array) -> bool:
        """Whether its walls touch each other at displacements u (n, 3) mm."""
        return self.walls is not None and self.walls.touches(self.case.nodes + u)

    def filtered(self, state: State, change: State) -> State:
        """A change of a state, or so much of it as drives walls no deeper into each other than they give
        way."""
        if self.walls is None:
            return change
        x, du = self.case.nodes + state.u, change.u
        limit, low, high = max(self.walls.give, self.walls.deepest(x)), 0.0, 1.0
        if self.walls.deepest(x + du) <= limit:
            return change
        for _ in range(SEARCHES):
            middle = (low + high) / 2
            low, high = (middle, high) if self.walls.deepest(x + middle * du) <= limit else (low, middle)
        return moved(moved(change, change, -1.0), change, max(low, high / 2))

    def met(self, u: Array) -> bool:
        """Whether it touches its plane or itself at displacements u (n, 3) mm."""
        on = self.plane is not None and self.plane.touches(self.case.nodes + u)
        return on or self.closed(u)

    @property
    def rubs(self) -> bool:
        """Whether a plane has friction, so that a state depends on those before."""
        return self.plane is not None and self.plane.friction != 0

    def sliding(self, where: Flags | None) -> "Problem":
        """The same problem, sliding there (f, q) and nowhere else; None: where it does."""
        if self.plane is None or not self.rubs or where is None:
            return self
        return replace(self, plane=self.plane.sliding(where))

    def after(self, u: Array) -> "Problem":
        """The problem as it goes on from the equilibrium at displacements u (n, 3) mm: the same but for
        slip."""
        if self.plane is None or not self.rubs:
            return self
        return replace(self, plane=self.plane.after(self.case.nodes + u))

    def touch(self, u: Array) -> Array:
        """The force in N and its moment about the origin in N mm (6,) of the obstacle at displacements u
        (n, 3) mm; nothing without one."""
        return np.zeros(6) if self.plane is None else self.plane.resultant(self.case.nodes + u)

    @property
    def bare(self) -> bool:
        """Whether its tangent is that of solid elements, pressure and self-contact alone, and symmetric."""
        clamp = self.case.clamp
        held = bool(self.layers) or self.plane is not None or bool(clamp and clamp.compliance)
        return self.kernel.symmetric and not held

    @property
    def heavy(self) -> bool:
        """Whether any material has a density."""
        return any(m.density for m in self.case.materials.values())

    def under(self, gravity: Array) -> "Problem":
        """The problem with its weight in a gravity (3,) mm/s2, as consistent nodal forces of the mass at
        rest."""
        if not self.heavy:
            return self
        mass = self.kernel.masses(self.case.per_element("density"), self.geometry)
        return replace(self, dead=self.dead + mass[:, None] * gravity)

    def with_shares(self, shares: Mapping[str, float]) -> "Problem":
        """The problem with surfaces that carry so much of the pressure, the others as before."""
        if not shares:
            return self
        case = replace(self.case, shares={**self.case.shares, **shares})
        return replace(self, case=case, kernel=self.kernel.with_shares(case.pressure_shares))

    @property
    def shear(self) -> float:
        """The smallest shear modulus of the materials, MPa."""
        return float(self.constants.shear.min())

    def start(self) -> State:
        """The undeformed state with the prescribed displacements put in."""
        u = np.zeros_like(self.case.nodes)
        u.flat[self.kernel.supported] = self.prescribed
        return State(self.kernel.followed(u), np.zeros((len(self.case.connectivity), self.kernel.modes)))

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

    def clamp_gap(self, rotation: float, force: Array) -> float:
        """The rotation in rad by which an elastic clamp gives way to nodal forces (n, 3) N."""
        if self.case.clamp is None or not self.case.clamp.compliance:
            return 0.0
        _, turn, _ = self.clamp_motion(rotation)
        return float(self.case.clamp.compliance * (turn * force[self.kernel.clamped]).sum())


def _nodal(case: Case, forces: Mapping[str, Array]) -> Array:
    """Forces (3,) on node sets as forces (n, 3) on nodes."""
    out = np.zeros_like(case.nodes)
    for name, force in forces.items():
        rows = case.node_sets[name]
        out[rows] += np.asarray(force, float) / len(rows)
    return out


@dataclass(frozen=True)
class Residual:
    """What is out of balance at a state: nodal forces (n, 3) N; volume gaps (e, m) mm3, or None where they
    are condensed into the forces already; the moment, residual of the clamp's equation in rad."""

    force: Array
    gap: Array | None
    moment: float

    def plus(self, other: "Residual") -> "Residual":
        """The sum of two residuals that are not condensed."""
        assert self.gap is not None
        assert other.gap is not None
        return Residual(self.force + other.force, self.gap + other.gap, self.moment + other.moment)

    def minus(self, other: "Residual", factor: float) -> "Residual":
        """`factor` times the difference of two residuals."""
        gap = None if self.gap is None or other.gap is None else factor * (self.gap - other.gap)
        return Residual(factor * (self.force - other.force), gap, factor * (self.moment - other.moment))


class Step:
    """A factorised tangent at one state: solves for any right-hand side, clamp rotation included, until
    another tangent on its kernel is factorised."""

    def __init__(self, problem: Problem, state: State, system: Linearised) -> None:
        self.problem, self.state = problem, state
        kernel, clamp = problem.kernel, problem.case.clamp
        self._matrix = system.wider.matrix if system.wider else kernel.matrix
        self._matrix.factorise(system.data)
        self._count = self._matrix.count
        self.system = replace(system, data=np.empty(0))  # the matrix has it, and not longer than it needs
        below = self._matrix.negative
        # as many as there are shared pressures belong to the mixed form
        self.negative = max(0, (below or 0) - kernel.shared)
        self._compliance = clamp.compliance if clamp else 0.0
        parts = problem.plane.coupling(problem.case.nodes + state.u) if problem.plane else []
        parts += [] if system.border is None else [system.border]
        self._addition = addition(parts, kernel.dofs) if parts else None
        _, self._turn, bend = problem.clamp_motion(state.rotation)
        self._side = system.turning
        self._stiffness = float(
            (system.lever[kernel.clamped] * self._turn).sum() + (bend * system.force[kernel.clamped]).sum()
        )

    @property
    def newest(self) -> bool:
        """Whether the factors are still its own: a step that failed leaves those of other states."""
        return self._matrix.count == self._count

    @cached_property
    def slides(self) -> Flags | None:
        """Where (f, q) the surface slides on a plane, as this tangent has it, or None without a plane."""
        plane, x = self.problem.plane, self.problem.case.nodes + self.state.u
        return None if plane is None else plane.slides(x)

    @cached_property
    def _back(self) -> Array:
        """The free displacements' answer to a turn of the clamp, mm per rad, but for its sign."""
        return self._matrix.solve(self._side)

    def solve(self, residuals: Sequence[Residual]) -> list[State]:
        """For each change of the residuals the change of state that cancels it. RuntimeError where another
        tangent on the kernel was factorised since."""
        if not self.newest:
            raise RuntimeError("a tangent on this kernel was factorised since; take the newest one")
        changes = self._symmetric(residuals)
        return changes if self._addition is None else [self._with(self._addition, c) for c in changes]

    def _with(self, C: csr_matrix, change: State) -> State:
        """The change of state with an addition C (3 n, 3 n) to the tangent."""
        none = np.zeros_like(self.system.gap)

        def answer(force: Array) -> State:
            nodal = force.reshape(-1, 3)
            moment = self.problem.clamp_gap(self.state.rotation, nodal)
            return self._symmetric([Residual(nodal, none, moment)])[0]

        return moved(change, answer(coupled(C, change.u.ravel(), lambda f: answer(f).u.ravel())))

    def _symmetric(self, residuals: Sequence[Residual]) -> list[State]:
        kernel = self.problem.kernel
        condensed = [self._condensed(r) for r in residuals]
        gaps = [self.system.gap if r.gap is None else r.gap for r in residuals]
        sides = [kernel.unknowns(force, gap) for (force, _), gap in zip(condensed, gaps, strict=True)]
        x = self._matrix.solve(np.stack(sides, axis=1))  # together: the factors are read once
        return [
            self._spread(x[:, k], moment, gap)
            for k, (gap, (_, moment)) in enumerate(zip(gaps, condensed, strict=True))
        ]

    def work(self, r: Residual, change: State) -> float:
        """What residuals, but for their gaps, do along a change of state, N mm."""
        free = self.problem.kernel.free
        turned = r.moment * change.rotation / self._compliance if self._compliance else 0.0
        return float(r.force.ravel()[free] @ change.u.ravel()[free]) + turned

    def _condensed(self, r: Residual) -> tuple[Array, float]:
        """Force (n, 3) N and moment with the volume gaps eliminated."""
        if r.gap is None:
            return r.force, r.moment
        kernel, system = self.problem.kernel, self.system
        extra = system.coupling @ (system.compliance @ r.gap[..., None])
        extra = kernel.gather(extra.reshape(*kernel.connectivity.shape, 3))
        return r.force + extra, r.moment + self.problem.clamp_gap(self.state.rotation, extra)

    def _spread(self, x: Array, moment: float, gap: Array) -> State:
        """The change of state from the solution (f,) for the unknowns with the clamp held."""
        kernel, system, turn = self.problem.kernel, self.system, -moment
        if self._compliance:
            pivot = 1 + self._compliance * (self._stiffness - float(self._side @ self._back))
            turn = (-moment + self._compliance * float(self._side @ x)) / pivot
        du = np.zeros((kernel.dofs // 3, 3))
        x = -x if turn == 0 else -x - self._back * turn
        du.reshape(-1)[kernel.free] = x[: len(kernel.free)]
        du[kernel.clamped] = self._turn * turn
        if kernel.shared:
            return State(du, kernel.pressures(x), float(turn))
        strain = np.swapaxes(system.coupling, 1, 2) @ du[kernel.connectivity].reshape(len(gap), -1, 1)
        return State(du, (system.compliance @ (gap[..., None] + strain))[..., 0], float(turn))


@dataclass(frozen=True)
class Reached:
    """An equilibrium under a load in MPa, of which no tangent is factorised."""

    problem: Problem
    state: State
    load: float
    memory: Memory | None

    def factorised(self) -> Step:
        """Its own tangent."""
        return tangent_at(self.problem, self.state, load=self.load, memory=self.memory)

    @cached_property
    def _points(self) -> PointTangents:
        return self.problem.kernel.at_points(self.state, self.problem.constants, self.memory)

    def along(self, changes: Sequence[State]) -> list[Residual]:
        """How the residuals go along changes of the state that leave the clamp where it is."""
        bulk, walls = self.problem.constants.bulk, self._walls
        found = self.problem.kernel.along(self.state.u, bulk, self.load, self._points, changes)
        if walls is not None:
            own = [(walls @ change.u.ravel()).reshape(-1, 3) for change in changes]
            found = [(force + more, gap) for (force, gap), more in zip(found, own, strict=True)]
        return [Residual(force, gap, 0.0) for force, gap in found]

    @cached_property
    def _walls(self) -> csr_matrix | None:
        """The tangent (3 n, 3 n) N/mm of walls that touch each other, or None where none do."""
        if not self.problem.closed(self.state.u):
            return None
        assert self.problem.walls is not None
        parts = self.problem.walls.tangent(self.problem.case.nodes + self.state.u)
        return addition([parts], self.problem.kernel.dofs)


@dataclass(frozen=True)
class Equilibrium:
    """The equilibrium state and the tangent factorised next to it, or the reason why there is none.

    The tangent's state and the equilibrium differ by less than TOLERANCE of the structure's size, or, where
    there is a `place`, by so little that a few corrections lead from the one tangent to the other.
    """

    state: State | None
    step: Step | None
    iterations: int
    reason: str
    place: Reached | None = None


def _residuals(
    problem: Problem, state: State, load: float, memory: Memory | None
) -> tuple[Linearised, float]:
    _, turn, _ = problem.clamp_motion(state.rotation)
    system = problem.kernel.linearise(state, problem.constants, load, memory, turn)
    system = replace(system, force=system.force - problem.loaded(load))
    x = problem.case.nodes + state.u
    if problem.walls is not None and problem.walls.touches(x):
        system = problem.kernel.widened(system, problem.walls.meeting(x))
    for faces in problem.faces:
        system = problem.kernel.with_turned_faces(system, *faces.tangent(x), turn)
        system = replace(system, force=system.force - faces.force(x))
    return system, state.rotation + problem.clamp_gap(state.rotation, system.force)


def tangent_at(problem: Problem, state: State, *, load: float, memory: Memory | None = None) -> Step:
    """The factorised tangent at a state under follower pressure `load` MPa."""
    return Step(problem, state, _residuals(problem, state, load, memory)[0])


def equilibrium(
    problem: Problem,
    start: State,
    *,
    load: float,
    memory: Memory | None = None,
    last: Step | None = None,
    exact: bool = True,
    quick: bool = False,
    tolerance: float = TOLERANCE,
) -> Equilibrium:
    """The equilibrium at follower pressure `load` MPa, from `start`, in at most LIMIT factorisations.

    last: a factorised tangent of a neighbouring state; while it is the newest it serves as far as it can.
    exact: the result's tangent is that of the equilibrium, as derivatives need it; otherwise it may be a
    nearby one's. quick: it may be that with a `place`, too, from which a few corrections lead to derivatives
    (`fe.solver.refinement`). Never raises for lack of convergence: `reason` then says what stopped it.
    """
    kernel, state, before = problem.kernel, _consistent(problem, start), np.inf
    extent = float(np.ptp(problem.case.nodes, axis=0).max())
    small = (tolerance * extent, 10 * tolerance * problem.shear)  # mm, MPa
    kinked = problem.rubs or (memory is not None and memory.softening is not None)
    smooth = not problem.rubs  # so far: whether the tangent may be expected to serve again
    fine = np.inf if not exact else QUICK if quick and problem.bare else 0.0
    length, stalls = np.inf, 0  # of the correction by `last` itself; corrections of which little was left
    for iteration in range(LIMIT):
        near = last if last is not None and last.newest and smooth else None
        if near is not None and np.abs(state.u - near.state.u).max() < NEARBY * extent:
            newton = length if exact else np.inf
            state, rate = _chord(problem, state, near, load, memory, small, fine, newton)
            if rate is not None and rate < fine:
                place = Reached(problem, state, load, memory) if exact else None
                return Equilibrium(state, near, iteration, "converged", place)
        system, moment = _residuals(problem, state, load, memory)
        free = system.force.ravel()[kernel.free]
        if not np.isfinite(system.data).all():
            return Equilibrium(None, None, iteration, "an element turned inside out")
        size = float(np.abs(free).max(initial=0.0))
        if iteration > 2 and size > 1e3 * before:
            return Equilibrium(None, None, iteration, f"the forces grew out of balance: {TOO_FAR}")
        last = Step(problem, state, system)
        (change,) = last.solve([Residual(system.force, None, moment)])
        length, change = float(np.abs(change.u).max()), problem.filtered(state, change)
        if not np.isfinite(length) or (iteration > 0 and np.abs(change.u).max() > 0.5 * extent):
            return Equilibrium(None, None, iteration + 1, f"a correction of half the structure: {TOO_FAR}")
        ahead = moved(state, change).u
        if length > small[0] and (kinked or problem.closed(state.u) or problem.closed(ahead)):
            whole, change = change, _shortened(last, state, change, load, memory)
            stalls += float(np.abs(change.u).max()) < STALLED * length
            if problem.walls is not None and stalls > 1:
                return Equilibrium(None, None, iteration + 1, f"walls that touch hold it back: {TOO_FAR}")
            smooth = change is whole and length < SETTLING * NEARBY * extent
        state = _consistent(problem, moved(state, change))
        if length < small[0] and np.abs(change.p).max() < small[1]:
            return Equilibrium(state, last, iteration + 1, "converged")
        before = min(before, size) if np.isfinite(size) else before
    return Equilibrium(None, None, LIMIT, f"no equilibrium after {LIMIT} iterations")


def _shortened(step: Step, state: State, change: State, load: float, memory: Memory | None) -> State:
    """The correction, or so much of it as brings the forces to rest along it.

    The tangent jumps where softening or sliding sets in, and full corrections may go to and fro across that
    kink. Gaps are left out: along a long way they are far from linear, but the next correction closes them.
    """

    def work(factor: float) -> float:
        done = step.work(imbalance(step.problem, moved(state, change, factor), load, memory), change)
        return done if np.isfinite(done) else np.inf  # an element turned inside out

    low, high, first = 0.0, 1.0, work(0.0)
    a, b = first, work(1.0)
    if b <= OVERSHOT * abs(first):
        return change
    for _ in range(SEARCHES):
        factor = low + (high - low) * min(max(-a / (b - a), 0.1), 0.9)
        here = work(factor)
        if abs(here) <= OVERSHOT * abs(first):
            break
        low, a, high, b = (factor, here, high, b) if here < 0 else (low, a, factor, here)
    return moved(moved(change, change, -1.0), change, factor)


def eased(
    problem: Problem,
    start: State,
    *,
    load: float,
    memory: Memory | None = None,
    last: Step | None = None,
    exact: bool = True,
    quick: bool = False,
) -> Equilibrium:
    """As `equilibrium`; where a plane is too stiff to be met from `start`, it is met softer first."""
    found = equilibrium(problem, start, load=load, memory=memory, last=last, exact=exact, quick=quick)
    if (problem.plane is None and problem.walls is None) or found.state is not None:
        return found
    state, count, met, step = start, found.iterations, SOFTEST / 8, 8.0
    while met < 1 and step > 1.1:
        factor = min(1.0, met * step)
        way = TOLERANCE if factor == 1 or problem.walls is None else LOOSE
        found = equilibrium(problem.softer(factor), state, load=load, memory=memory, tolerance=way)
        count += found.iterations
        if found.state is None:
            step **= 0.5
        else:
            state, met = found.state, factor
    return replace(found, iterations=count)


def _chord(
    problem: Problem,
    state: State,
    step: Step,
    load: float,
    memory: Memory | None,
    small: tuple[float, float],
    fine: float,
    newton: float,
) -> tuple[State, float | None]:
    """The state after corrections with a tangent of nearby (the chord method), and the rate at which they
    shrink where it is an equilibrium; the best state, and None, where they do not shrink fast enough.

    small: what corrections may leave, in mm and MPa, before an exact tangent brings one of its own; with a
    rate below `fine` it brings none, and they leave EXACT of it. newton: the correction in mm by which this
    tangent has led to the state, or inf: the next ones shrink by a few times less.
    """
    older = before = np.inf
    while True:
        (change,) = step.solve([imbalance(problem, state, load, memory)])
        length = float(np.abs(change.u).max())
        if not (length < SHRINK * older and length < 2 * before):
            return state, None
        # what is left of this correction: linear convergence, the slower of one and of two steps
        left = max(length / before, np.sqrt(length / older))
        if np.isinf(before):
            left = SHRINK if np.isinf(newton) else min(SHRINK, length / (SHRINK * newton))
        share = EXACT if left < fine else 1.0
        state, older, before = _consistent(problem, moved(state, change)), before, length
        if left * length < share * small[0] and left * np.abs(change.p).max() < share * small[1]:
            return state, left


def moved(state: State, change: State, factor: float = 1.0) -> State:
    """The state plus `factor` times a change of state."""
    return State(
        state.u + factor * change.u, state.p + factor * change.p, state.rotation + factor * change.rotation
    )


def _consistent(problem: Problem, state: State) -> State:
    """The state with held nodes exactly where supports and the clamp's rotation put them."""
    u = state.u.copy()
    u.flat[problem.kernel.supported] = problem.prescribed
    u[problem.kernel.clamped] = problem.clamp_motion(state.rotation)[0]
    return replace(state, u=problem.kernel.followed(u))


def imbalance(problem: Problem, state: State, load: float, memory: Memory | None) -> Residual:
    """All residuals at a state, not condensed.

    The problem's own positions are used, those of held nodes included, so that a problem with other nodes or
    prescribed displacements on the same kernel is differenced right.
    """
    state = _consistent(problem, state)
    force, gap = problem.kernel.residual(state, problem.constants, load, memory, problem.geometry)
    force -= problem.loaded(load)
    for faces in problem.faces:
        force -= faces.force(problem.case.nodes + state.u)
    return Residual(force, gap, state.rotation + problem.clamp_gap(state.rotation, force))
