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
from fe.kernel.inertia import InertiaForces
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
    """A case prepared for solving: kernel (shared by cases with equal mesh and supports), constants, dead
    forces (n, 3) N, forces growing with the pressure (n, 3) N/MPa or None, prescribed displacements (k,) mm
    at the supported degrees of freedom, obstacle (`plane`) and self-contact (`walls`); in a time step the
    forces of inertia."""

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
    inertia: InertiaForces | None = None

    @staticmethod
    def of(case: Case, kernel: Kernel | None = None) -> "Problem":
        """The problem of a case without weight; on a given kernel of its mesh, or on a new one."""
        dead, growing = _nodal(case, case.forces), _nodal(case, case.growing) if case.growing else None
        kernel = kernel or Kernel(case)
        base, curved = kernel.geometry, case.precurvature
        same = np.array_equal(case.nodes, base.nodes) and curved == base.precurvature
        geometry = base if same else Geometry(case.nodes, kernel.connectivity, kernel.element, curved)
        layers = tuple(LayerFaces(case, sheet) for sheet in case.sheets)
        plane = ObstacleFaces(case) if case.contact and case.contact.stiffness else None
        walls = SelfFaces(case) if case.self_contact else None
        prescribed = case.prescribed.ravel()[kernel.supported]
        return Problem(
            kernel=kernel, constants=ElementConstants.of(case), case=case, dead=dead, prescribed=prescribed,
            geometry=geometry, layers=layers, plane=plane, walls=walls, growing=growing,
        )  # fmt: skip

    @property
    def faces(self) -> tuple[LayerFaces | ObstacleFaces | SelfFaces | InertiaForces, ...]:
        """Layers, obstacle, self-contact and inertia: all forces besides the solid's and the pressure."""
        return tuple(f for f in (*self.layers, self.plane, self.walls, self.inertia) if f is not None)

    @property
    def proportional(self) -> bool:
        """True if pressure is the only load, so that u is a function of pressure over the moduli."""
        clamp = self.case.clamp
        held = bool(clamp and clamp.compliance) or bool(self.layers) or self.plane is not None
        return not self.dead.any() and not held

    def has_memory(self, path: Path) -> bool:
        """True if the response may not be a function of pressure over the moduli: a material has a memory, or
        moduli drift."""
        c = self.constants
        drifts = path.stiffness is not None and not self.proportional
        return bool(len(c.prony) or len(c.softening)) or drifts

    def loaded(self, pressure: float) -> Array:
        """Outside forces (n, 3) N at a pressure in MPa."""
        return self.dead if self.growing is None else self.dead + pressure * self.growing

    def placed_as(self, problem: "Problem") -> bool:
        """True if two problems differ in material constants and outside forces alone."""
        bare = all(not q.layers and q.plane is None and q.walls is None for q in (self, problem))
        return (
            bare
            and self.kernel is problem.kernel
            and self.geometry is problem.geometry is self.kernel.geometry
            and self.case.clamp == problem.case.clamp
            and np.array_equal(self.prescribed, problem.prescribed)
        )

    def stiffened(self, factor: float) -> "Problem":
        """The problem with all moduli multiplied."""
        if factor == 1:
            return self
        walls = self.walls.times(factor) if self.walls else None
        return replace(self, constants=self.constants.times(factor), walls=walls)

    def softer(self, factor: float) -> "Problem":
        """The problem with the contact stiffness of obstacle and self-contact multiplied by `factor`."""
        plane, walls = self.plane, self.walls
        plane, walls = plane and plane.softer(factor), walls and walls.times(factor)
        return replace(self, plane=plane, walls=walls)

    def walls_touch(self, u: Array) -> bool:
        """True if its walls touch each other at displacements u (n, 3) mm."""
        return self.walls is not None and self.walls.touches(self.case.nodes + u)

    def filtered(self, state: State, change: State) -> State:
        """The change of a state, shortened so that walls penetrate each other by at most `SelfFaces.give`."""
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

    def in_contact(self, u: Array) -> bool:
        """True if it touches its obstacle or itself at displacements u (n, 3) mm."""
        on = self.plane is not None and self.plane.touches(self.case.nodes + u)
        return on or self.walls_touch(u)

    @property
    def has_friction(self) -> bool:
        """True if its obstacle has friction, so that a state depends on the states before."""
        return self.plane is not None and self.plane.friction != 0

    def sliding(self, where: Flags | None) -> "Problem":
        """The problem with prescribed flags (f, q) of sliding points; unchanged for None."""
        if self.plane is None or not self.has_friction or where is None:
            return self
        return replace(self, plane=self.plane.sliding(where))

    def after(self, u: Array) -> "Problem":
        """The problem with slip updated to the equilibrium at displacements u (n, 3) mm."""
        if self.plane is None or not self.has_friction:
            return self
        return replace(self, plane=self.plane.after(self.case.nodes + u))

    def touch(self, u: Array) -> Array:
        """Force (3,) N of the obstacle at displacements u (n, 3) mm; zero without one."""
        return np.zeros(3) if self.plane is None else self.plane.resultant(self.case.nodes + u)

    @property
    def only_solids(self) -> bool:
        """True if its symmetric tangent consists of solid elements, pressure and self-contact alone."""
        clamp = self.case.clamp
        held = bool(self.layers) or self.plane is not None or bool(clamp and clamp.compliance)
        return self.kernel.symmetric and not held and self.inertia is None

    @property
    def has_weight(self) -> bool:
        """True if any material has a density."""
        return any(m.density for m in self.case.materials.values())

    def under(self, gravity: Array) -> "Problem":
        """The problem with its weight in a gravity (3,) mm/s2, as consistent nodal forces of the mass at
        rest."""
        if not self.has_weight:
            return self
        mass = self.kernel.masses(self.case.per_element("density"), self.geometry)
        return replace(self, dead=self.dead + mass[:, None] * gravity)

    def with_shares(self, shares: Mapping[str, float]) -> "Problem":
        """The problem with these shares of the pressure by surface, the others as before."""
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
        slope = np.stack([c * dz - s * dx, none, -s * dz - c * dx], axis=1)
        return moved, slope, np.stack([-s * dz - c * dx, none, s * dx - c * dz], axis=1)

    def clamp_gap(self, rotation: float, force: Array) -> float:
        """Rotation in rad of an elastic clamp under nodal forces (n, 3) N."""
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
    """Residual of the equilibrium equations at a state: nodal forces (n, 3) N; volume gaps (e, m) mm3, or
    None where they are condensed into the forces; moment, the residual of the clamp's equation in rad."""

    force: Array
    gap: Array | None
    moment: float

    def plus(self, residual: "Residual") -> "Residual":
        """The sum of two residuals that are not condensed."""
        assert self.gap is not None
        assert residual.gap is not None
        return Residual(self.force + residual.force, self.gap + residual.gap, self.moment + residual.moment)

    def minus(self, residual: "Residual", factor: float) -> "Residual":
        """`factor` times the difference of two residuals."""
        gap = None if self.gap is None or residual.gap is None else factor * (self.gap - residual.gap)
        return Residual(factor * (self.force - residual.force), gap, factor * (self.moment - residual.moment))


class Step:
    """Factorised tangent at one state; solves for any right-hand side, clamp rotation included, until another
    tangent on its kernel is factorised."""

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
        """True while the factors are its own: another factorisation on the kernel replaces them."""
        return self._matrix.count == self._count

    @cached_property
    def slides(self) -> Flags | None:
        """Flags (f, q) of points that slide on the obstacle in this tangent; None without an obstacle."""
        plane, x = self.problem.plane, self.problem.case.nodes + self.state.u
        return None if plane is None else plane.slides(x)

    @cached_property
    def _back(self) -> Array:
        """Response of the free displacements to a rotation of the clamp, mm per rad, with opposite sign."""
        return self._matrix.solve(self._side)

    def solve(self, residuals: Sequence[Residual]) -> list[State]:
        """Changes of state that cancel the residuals. RuntimeError if another tangent on the kernel was
        factorised since."""
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
        """Work of a residual, without its volume gaps, along a change of state, N mm."""
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
        """Change of state from the solution (f,) for the unknowns with the clamp held."""
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
    """An equilibrium under a load in MPa whose tangent is not factorised."""

    problem: Problem
    state: State
    load: float
    memory: Memory | None

    def factorised(self) -> Step:
        """The factorised tangent at this equilibrium."""
        return tangent_at(self.problem, self.state, load=self.load, memory=self.memory)

    @cached_property
    def _points(self) -> PointTangents:
        return self.problem.kernel.at_points(self.state, self.problem.constants, self.memory)

    def along(self, changes: Sequence[State]) -> list[Residual]:
        """Directional derivatives of the residual along changes of the state with the clamp held."""
        bulk, walls = self.problem.constants.bulk, self._walls
        changed = self.problem.kernel.along(self.state.u, bulk, self.load, self._points, changes)
        if walls is not None:
            wall_forces = [(walls @ change.u.ravel()).reshape(-1, 3) for change in changes]
            changed = [(force + more, gap) for (force, gap), more in zip(changed, wall_forces, strict=True)]
        return [Residual(force, gap, 0.0) for force, gap in changed]

    @cached_property
    def _walls(self) -> csr_matrix | None:
        """Tangent (3 n, 3 n) N/mm of self-contact, None without contact."""
        if not self.problem.walls_touch(self.state.u):
            return None
        assert self.problem.walls is not None
        parts = self.problem.walls.tangent(self.problem.case.nodes + self.state.u)
        return addition([parts], self.problem.kernel.dofs)


@dataclass(frozen=True)
class Equilibrium:
    """Equilibrium state with the tangent factorised next to it, or the reason of a failure.

    The tangent's state differs from the equilibrium by less than TOLERANCE of the structure's size, or, where
    there is a `place`, by so little that a few corrections turn one tangent into the other.
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
    """Equilibrium at follower pressure `load` MPa, from `start`, in at most LIMIT factorisations.

    last: a factorised tangent of a neighbouring state, reused while it is the newest and converges. exact:
    the result's tangent is the equilibrium's own, as derivatives need it; otherwise a nearby one. quick: a
    nearby tangent with a `place`, from which a few corrections lead to derivatives (`fe.solver.refinement`),
    is accepted, too. Never raises for lack of convergence: `reason` then says what stopped it.
    """
    kernel, state, before = problem.kernel, _consistent(problem, start), np.inf
    extent = float(np.ptp(problem.case.nodes, axis=0).max())
    small = (tolerance * extent, 10 * tolerance * problem.shear)  # mm, MPa
    kinked = problem.has_friction or (memory is not None and memory.softening is not None)
    smooth = not problem.has_friction  # so far: whether the tangent may be expected to serve again
    fine = np.inf if not exact else QUICK if quick and problem.only_solids else 0.0
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
        if length > small[0] and (kinked or problem.walls_touch(state.u) or problem.walls_touch(ahead)):
            full, change = change, _shortened(last, state, change, load, memory)
            stalls += float(np.abs(change.u).max()) < STALLED * length
            if problem.walls is not None and stalls > 1:
                return Equilibrium(None, None, iteration + 1, f"walls that touch hold it back: {TOO_FAR}")
            smooth = change is full and length < SETTLING * NEARBY * extent
        state = _consistent(problem, moved(state, change))
        if length < small[0] and np.abs(change.p).max() < small[1]:
            return Equilibrium(state, last, iteration + 1, "converged")
        before = min(before, size) if np.isfinite(size) else before
    return Equilibrium(None, None, LIMIT, f"no equilibrium after {LIMIT} iterations")


def _shortened(step: Step, state: State, change: State, load: float, memory: Memory | None) -> State:
    """The correction, shortened by a line search until the forces along it nearly vanish.

    The tangent jumps where softening or sliding sets in, and full corrections may oscillate across that kink.
    Volume gaps are left out: over a long step they are far from linear, but the next correction closes them.
    """

    def work(factor: float) -> float:
        done = step.work(imbalance(step.problem, moved(state, change, factor), load, memory), change)
        return done if np.isfinite(done) else np.inf  # an element turned inside out

    low, high, initial = 0.0, 1.0, work(0.0)
    a, b = initial, work(1.0)
    if b <= OVERSHOT * abs(initial):
        return change
    for _ in range(SEARCHES):
        factor = low + (high - low) * min(max(-a / (b - a), 0.1), 0.9)
        here = work(factor)
        if abs(here) <= OVERSHOT * abs(initial):
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
    """As `equilibrium`; where contact is too stiff to converge from `start`, its stiffness grows in steps."""
    result = equilibrium(problem, start, load=load, memory=memory, last=last, exact=exact, quick=quick)
    if (problem.plane is None and problem.walls is None) or result.state is not None:
        return result
    state, count, stiffness, step = start, result.iterations, SOFTEST / 8, 8.0
    while stiffness < 1 and step > 1.1:
        factor = min(1.0, stiffness * step)
        precision = TOLERANCE if factor == 1 or problem.walls is None else LOOSE
        result = equilibrium(problem.softer(factor), state, load=load, memory=memory, tolerance=precision)
        count += result.iterations
        if result.state is None:
            step **= 0.5
        else:
            state, stiffness = result.state, factor
    return replace(result, iterations=count)


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
    """State after corrections with the tangent of a nearby state (chord method), and their rate of
    convergence; the best state, and None, where they converge too slowly.

    small: largest corrections in mm and MPa that may remain before an exact tangent adds one of its own; at a
    rate below `fine` none is added, and EXACT of them may remain. newton: the correction in mm by which this
    tangent has led to the state, or inf: the next ones shrink by a few times less.
    """
    older = before = np.inf
    while True:
        (change,) = step.solve([imbalance(problem, state, load, memory)])
        length = float(np.abs(change.u).max())
        if not (length < SHRINK * older and length < 2 * before):
            return state, None
        # what is left of this correction: linear convergence, the slower of one and of two steps
        rate = max(length / before, np.sqrt(length / older))
        if np.isinf(before):
            rate = SHRINK if np.isinf(newton) else min(SHRINK, length / (SHRINK * newton))
        share = EXACT if rate < fine else 1.0
        state, older, before = _consistent(problem, moved(state, change)), before, length
        if rate * length < share * small[0] and rate * np.abs(change.p).max() < share * small[1]:
            return state, rate


def moved(state: State, change: State, factor: float = 1.0) -> State:
    """The state plus `factor` times a change of state."""
    return State(
        state.u + factor * change.u, state.p + factor * change.p, state.rotation + factor * change.rotation
    )


def _consistent(problem: Problem, state: State) -> State:
    """The state with held nodes placed exactly by supports and the clamp's rotation."""
    u = state.u.copy()
    u.flat[problem.kernel.supported] = problem.prescribed
    u[problem.kernel.clamped] = problem.clamp_motion(state.rotation)[0]
    return replace(state, u=problem.kernel.followed(u))


def imbalance(problem: Problem, state: State, load: float, memory: Memory | None) -> Residual:
    """Residual at a state, not condensed.

    The problem's own positions are used, those of held nodes included, so that a problem with other nodes or
    prescribed displacements on this kernel is differenced right.
    """
    state = _consistent(problem, state)
    force, gap = problem.kernel.residual(state, problem.constants, load, memory, problem.geometry)
    force -= problem.loaded(load)
    for faces in problem.faces:
        force -= faces.force(problem.case.nodes + state.u)
    return Residual(force, gap, state.rotation + problem.clamp_gap(state.rotation, force))
