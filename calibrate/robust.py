"""Robust least squares with errors of Student's t, so that gross errors have little influence.

K. L. Lange, R. J. A. Little, J. M. G. Taylor 1989 (doi:10.1080/01621459.1989.10478852). Their scale is
fitted, with 1 as its lower limit: larger scales stand for lack of fit. Their iteratively reweighted least
squares end where the gradient of the deviance is 0. Least squares of the signed root of the deviance end at
this point, too, with bounded steps that the deviance itself accepts.
"""

import math

import numpy as np
import scipy

from calibrate.fit import Jacobian, Residual
from calibrate.parameters import Array

NU = 4.0  # degrees of freedom, as Lange et al. propose for unknown errors
TURNS, SETTLED = 30, 1e-3  # of amplitudes of shared errors at most, and their change, in sd, at the end
SMALL = 1e-4  # of z, below which the root of the deviance is taken as straight


def scale_of(z: Array, nu: float = NU) -> float:
    """Maximum likelihood scale of whitened values (n,), at least 1; exact zeros stand for no data.

    >>> import numpy as np
    >>> scale_of(np.array([0.5, -0.3, 0.1])), round(scale_of(np.array([4.0, -5.0, 6.0])), 2)
    (1.0, 5.01)
    """
    square = z[z != 0] ** 2

    def over(scale: float) -> float:
        return float(np.sum((nu + 1) * square / (nu * scale**2 + square))) - len(square)

    if not len(square) or over(1.0) <= 0:
        return 1.0
    return float(scipy.optimize.brentq(over, 1.0, 2 * math.sqrt(float(square.max())) + 1, xtol=1e-10))


def weights(z: Array, nu: float = NU, *, scale: float = 1.0) -> Array:
    """Weights (n,) of whitened values (n,): (nu + 1) / (nu + (z / scale)^2).

    >>> import numpy as np
    >>> weights(np.array([0.0, 1.0, 10.0])).round(2)
    array([1.25, 1.  , 0.05])
    """
    return np.asarray((nu + 1) / (nu + (z / scale) ** 2))


def parted(
    z: Array, modes: Array, nu: float = NU, *, start: Array | None = None
) -> tuple[Array, Array, float]:
    """Values (n,) without shared errors, amplitudes (k,) of these, and the scale of the t errors.

    modes (k, n): errors that many values share, with amplitudes that are normal with sd 1; start (k,): first
    amplitudes. Amplitudes by least squares would follow a gross error and carry it into every value of its
    mode.
    """
    a = np.zeros(len(modes)) if start is None else start
    rest = z - modes.T @ a
    for _ in range(TURNS):
        scale = scale_of(rest, nu)
        if not len(modes):
            break
        weighted = modes * (weights(rest, nu, scale=scale) / scale**2)
        solved = np.linalg.solve(np.eye(len(modes)) + weighted @ modes.T, weighted @ z)
        before, a = a, np.asarray(solved, float)
        rest = z - modes.T @ a
        if np.abs(a - before).max() < SETTLED:
            break
    return rest, a, scale_of(rest, nu)


def student(
    residual: Residual, jacobian: Jacobian, nu: float = NU, *, modes: Array | None = None
) -> tuple[Residual, Jacobian, Jacobian]:
    """Residual, Jacobian and information under Student's t errors with nu degrees of freedom.

    modes (k, n): shared errors with normal amplitudes beside them (`parted`).

    residual, jacobian: as in `least_squares`, of n values whose own errors are independent. The first of the
    result, (n + k,), is the signed root of the deviance (nu + 1) ln(1 + (z / s)^2 / nu) of each value, s the
    likeliest scale there, and the amplitudes; the largest value carries 2 n ln s, too. The second is its
    derivatives with s as it is: where s is likeliest, its own change changes nothing of the sum. The third,
    rows (n, d), is for `least_squares(information=...)`: their products are the expected information of the t
    distribution, (nu + 1) / (nu + 3) / s^2 of that of normal errors.
    """
    last: dict[bytes, tuple[Array, Array, float]] = {}  # of the newest values: their derivatives come next

    def split(z: Array) -> tuple[Array, Array, float]:
        if (key := z.tobytes()) not in last:
            near = next((amplitudes for _, amplitudes, _ in last.values()), None)
            last.clear()
            last[key] = parted(z, own(z), nu, start=near)
        return last[key]

    def roots(z: Array, scale: float) -> tuple[Array, Array]:
        """The roots (n,), and their derivatives (n,) by z."""
        x = np.abs(z) / scale
        size = np.sqrt((nu + 1) * np.log1p(x**2 / nu))
        slope, far = np.full_like(x, math.sqrt((nu + 1) / nu)), x > SMALL
        slope[far] = weights(x[far], nu) * x[far] / size[far]
        most = int(np.argmax(x))
        largest = math.hypot(size[most], math.sqrt(2 * np.count_nonzero(z) * math.log(scale)))
        slope[most] *= size[most] / largest if largest else 1.0
        size[most] = largest
        return np.sign(z) * size, slope / scale

    def own(z: Array) -> Array:
        return np.zeros((0, len(z))) if modes is None else modes

    def turned(rows: Array, turn: Array, shared: Array) -> Array:
        """Rows (n + k, d) of values with derivatives (n,) and of amplitudes that follow."""
        weighted = shared * turn**2
        follow = np.linalg.solve(np.eye(len(shared)) + weighted @ shared.T, weighted @ rows)
        return np.vstack([turn[:, None] * (rows - shared.T @ follow), follow])

    def root(theta: Array) -> Array | None:
        z = residual(theta)
        if z is None or not np.all(np.isfinite(z)):
            return None
        rest, amplitudes, scale = split(z)
        return np.append(roots(rest, scale)[0], amplitudes)

    def slope(theta: Array) -> Array:
        rows, z = jacobian(theta), residual(theta)
        if z is None or not np.all(np.isfinite(rows)):
            return np.full((len(rows) + len(own(rows[:, 0])), rows.shape[1]), np.nan)
        rest, _, scale = split(z)
        return turned(rows, roots(rest, scale)[1], own(z))

    def information(theta: Array) -> Array:
        rows, z = jacobian(theta), residual(theta)
        if z is None or not np.all(np.isfinite(rows)):
            return rows
        scale = split(z)[2]
        every = turned(rows, np.full(len(z), math.sqrt((nu + 1) / (nu + 3)) / scale), own(z))
        out = np.zeros_like(rows)  # as many as values, and the same products
        out[: rows.shape[1]] = np.linalg.qr(every).R
        return out

    return root, slope, information
