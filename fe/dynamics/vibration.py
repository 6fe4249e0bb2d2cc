"""Natural frequencies, shapes and damping of a structure about a loaded state."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh

from fe.case import Case
from fe.dynamics.loading import LoadedState
from fe.dynamics.mass import Attached, mass_matrix
from fe.element import Array, Flags
from fe.mesh.mirror import AXIS, symmetry_support
from fe.mesh.points import interpolation
from fe.solver.newton import Residual, Step

PRECISION = 1e-9  # of an eigenvalue
SETTLED = 1e-5  # of a frequency, by which its modulus may still change it
PASSES = 8


@dataclass(frozen=True)
class Modes:
    """Natural vibrations of a case about a state, m of them, by frequency.

    frequency (m,) Hz; damping (m,): damping ratios, half the loss factors; shape (m, n, 3): displacement over
    its largest one; mass (m,): modal masses in tonne of the whole structure; participation (m, 3): share of
    the structure's mass that a shaking base sets in motion along x, y, z; sideways (m,): antisymmetric about
    the plane of a half model. A motion without restoring force has the frequency 0.
    """

    case: Case
    _: KW_ONLY
    frequency: Array
    damping: Array
    shape: Array
    mass: Array
    participation: Array
    sideways: Flags

    @property
    def stable(self) -> bool:
        """True if every motion has a restoring force."""
        return bool((self.frequency > 0).all())

    def at(self, points: Array) -> Array:
        """Shapes (m, p, 3) at undeformed points (p, 3) mm."""
        operator = interpolation(self.case, points)
        return np.stack([operator @ shape for shape in self.shape])


def modes(
    loaded: LoadedState,
    *,
    count: int = 6,
    attached: Sequence[Attached] = (),
    loss: float | Mapping[str, float] = 0.0,
) -> Modes:
    """The `count` lowest natural vibrations about a state.

    attached: masses at points. loss: loss factor of every material, or of some by name, beside that of their
    Prony series.

    K phi = omega^2 M phi with the tangent K of the state, of which pressure modes are condensed (they have no
    mass, so that this is exact), the follower pressure's part included, by Lanczos about 0 (Lehoucq, Sorensen
    & Yang 1998, doi 10.1137/1.9780898719628). K has the storage modulus at the lowest frequency of each
    symmetry; at those of higher modes it acts on their own shapes (Rayleigh's quotient). The loss factor is
    the strain energy lost over the whole (Johnson & Kienholz 1982, doi 10.2514/3.51190). A half model gives
    motions of both symmetries. ValueError for a state that is none, and for a case without density.
    """
    if not loaded.converged:
        raise ValueError(f"no vibrations about a state that is none: {loaded.reason}; ask for a lower load")
    case = loaded.problem.case
    half = symmetry_support(case) is not None
    parts = [_of_symmetry(loaded, count, attached, loss, None)] if not half else [
        _of_symmetry(loaded, count, attached, loss, sideways) for sideways in (False, True)
    ]  # fmt: skip
    every = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    order = np.argsort(every[0], kind="stable")[:count]
    frequency, damping, shape, mass, participation, sideways = (column[order] for column in every)
    return Modes(case, frequency=frequency, damping=damping, shape=shape, mass=mass,
                 participation=participation, sideways=sideways)  # fmt: skip


def _of_symmetry(
    loaded: LoadedState, count: int, attached: Sequence[Attached], loss: float | Mapping[str, float],
    sideways: bool | None,
) -> tuple[Array, ...]:  # fmt: skip
    """Columns of `Modes` of one symmetry about the plane of a half model; None for a whole one."""
    case = loaded.problem.case
    components = [0, 1, 2] if sideways is None else [AXIS] if sideways else [0, 2]
    M = mass_matrix(case, attached, components=components)
    square, shapes, omega = _lowest(loaded, M, count, bool(sideways))
    factors = case.materials.keys() if isinstance(loss, float | int) else loss
    own = {k: loss if isinstance(loss, float | int) else loss[k] for k in factors}
    rows = [_one(loaded, w2, shape, omega, own) for w2, shape in zip(square, shapes, strict=True)]
    frequency, damping = np.array(rows).T
    ways = np.tile(np.eye(3)[components], len(case.nodes))  # (c, 3 n): all nodes along one axis
    pushed, taking = M @ ways.T, np.zeros((len(shapes), 3))
    taking[:, components] = (shapes.reshape(len(shapes), -1) @ pushed) ** 2 / (ways * pushed.T).sum(axis=1)
    top = np.linalg.norm(shapes, axis=2).max(axis=1)
    mass = (1 if sideways is None else 2) / top**2
    flags = np.full(len(shapes), bool(sideways))
    return frequency, damping, shapes / top[:, None, None], mass, taking, flags


def _lowest(
    loaded: LoadedState, M: sp.csr_matrix, count: int, sideways: bool
) -> tuple[Array, Array, float]:
    """Squares (m,) 1/s2 of the lowest angular frequencies, shapes (m, n, 3) of unit modal mass, and the
    angular frequency 1/s whose storage modulus they have: the lowest one's own."""
    omega = np.inf
    for _ in range(PASSES):
        step = loaded.step(min(omega, 1e12), sideways=sideways)
        square, shapes = _eigen(step, M, count)
        lowest, old = np.sqrt(max(square[0], 0.0)), omega
        omega = float(lowest)
        if not len(loaded.problem.constants.prony) or abs(old - omega) < SETTLED * omega or not omega:
            break
    return square, shapes, min(old, 1e12)


def _eigen(step: Step, M: sp.csr_matrix, count: int) -> tuple[Array, Array]:
    """Eigenvalues (m,) nearest to 0, from below, and shapes (m, n, 3) of unit modal mass."""
    size, none = M.shape[0], np.zeros_like(step.system.gap)

    def answer(force: Array) -> Array:
        nodal = np.asarray(force).reshape(-1, 3)
        moment = step.problem.clamp_gap(step.state.rotation, nodal)
        return -step.solve([Residual(nodal, none, moment)])[0].u.ravel()

    start = answer(M @ np.random.default_rng(0).standard_normal(size))
    # of the first matrix only the shape counts, as its inverse is given
    square, shapes = eigsh(M, k=count, M=M, sigma=0.0, which="LM", v0=start, tol=PRECISION,
                           OPinv=LinearOperator((size, size), matvec=answer, dtype=float))  # fmt: skip
    order = np.argsort(square)
    return square[order], shapes.T[order].reshape(count, -1, 3)


def _one(
    loaded: LoadedState, square: float, shape: Array, omega: float, loss: Mapping[str, float]
) -> tuple[float, float]:
    """Frequency in Hz and damping ratio of a mode (n, 3) of unit modal mass, from the square of the angular
    frequency 1/s2 with the storage modulus at `omega`."""
    if square <= 0:
        return 0.0, 0.0
    here, creeps = float(np.sqrt(square)), len(loaded.problem.constants.prony) > 0
    for _ in range(PASSES if creeps else 0):
        more = loaded.stiffness(shape, loaded.storage(here) - loaded.storage(omega))
        old, here = here, float(np.sqrt(max(square + more, 0.0)))
        if abs(old - here) < SETTLED * here:
            break
    share = loaded.lost(here) if creeps else np.zeros(len(loaded.problem.constants.shear))
    for name, factor in loss.items():
        rows = loaded.problem.case.element_sets[name]
        share[rows] += factor * loaded.storage(here)[rows]
    factor = loaded.stiffness(shape, share) / here**2 if share.any() else 0.0
    return here / (2 * np.pi), factor / 2
