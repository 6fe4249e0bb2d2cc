"""What an unsymmetric addition on few degrees of freedom changes in the solution of a symmetric system."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import LinearOperator, gmres

from fe.element import Array, Integers

LEFT = 1e-10  # of the addition's forces: derivatives are to be exact to 1e-6
KRYLOV = 60


def addition(parts: Sequence[tuple[Integers, Array]], size: int) -> csr_matrix:
    """The matrix (size, size) of small ones (g, k, k) at degrees of freedom (g, k)."""
    out = csr_matrix((size, size))
    for dofs, C in parts:
        r, c = np.broadcast_arrays(dofs[:, :, None], dofs[:, None])
        out = out + csr_matrix((C.ravel(), (r.ravel(), c.ravel())), shape=(size, size))
    return out


def coupled(C: csr_matrix, u: Array, answer: Callable[[Array], Array]) -> Array:
    """The forces f (n,) N of an addition to a tangent, f = C (u + answer(f)), by GMRES (Saad & Schultz 1986,
    doi 10.1137/0907058).

    C (n, n) N/mm: the addition; u (n,) mm: the change without it; answer: the change (n,) mm that residual
    forces (n,) N bring about. The nearest f found is taken where it does not come to rest.
    """
    rows = np.flatnonzero(np.diff(C.indptr))
    own = C[rows]

    def spread(f: Array) -> Array:
        out = np.zeros(len(u))
        out[rows] = f
        return out

    left = LinearOperator((len(rows),) * 2, matvec=lambda f: f - own @ answer(spread(f)), dtype=float)
    return spread(gmres(left, own @ u, rtol=LEFT, restart=KRYLOV, maxiter=1)[0])
