"""A symmetric solver and an unsymmetric addition on few degrees of freedom -> what the addition changes."""

from collections.abc import Callable

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from fe.element import Array, Integers

LEFT = 1e-10  # of the addition's forces: derivatives are to be exact to 1e-6
KRYLOV = 60


def coupled(dofs: Integers, C: Array, u: Array, answer: Callable[[Array], Array]) -> Array:
    """The forces f (n,) N of an addition to a tangent, f = C (u + answer(f)), by GMRES (Saad & Schultz 1986,
    doi 10.1137/0907058).

    dofs (g, k), C (g, k, k) N/mm: the addition face by face; u (n,) mm: the change without it; answer: the
    change (n,) mm that residual forces (n,) N bring about. The nearest f found is taken where it does not
    come to rest.
    """
    rows, inverse = np.unique(dofs, return_inverse=True)
    inverse = inverse.reshape(dofs.shape)

    def added(change: Array) -> Array:
        part = C @ change[dofs][..., None]
        return np.asarray(np.bincount(inverse.ravel(), part.ravel(), len(rows)), float)

    def spread(f: Array) -> Array:
        out = np.zeros(len(u))
        out[rows] = f
        return out

    own = LinearOperator((len(rows),) * 2, matvec=lambda f: f - added(answer(spread(f))), dtype=float)
    return spread(gmres(own, added(u), rtol=LEFT, restart=KRYLOV, maxiter=1)[0])
