"""A whitened residual that may hold gross errors -> one of which they take little: errors of Student's t.

K. L. Lange, R. J. A. Little, J. M. G. Taylor 1989 (doi:10.1080/01621459.1989.10478852). Their scale is found
with the fit, 1 at least: the errors are known, and what is more a model leaves. Their iteratively reweighted
least squares end where the gradient of the deviance is 0. The same place is found here by least squares of
its signed root, whose steps are bounded and accepted by the deviance itself.
"""

import math

import numpy as np
from scipy.optimize import brentq

from calibrate.fit import Jacobian, Residual
from calibrate.parameters import Array

NU = 4.0  # degrees of freedom, as Lange et al. propose for unknown errors
SMALL = 1e-4  # of z, below which the root of the deviance is taken as straight


def scale_of(z: Array, nu: float = NU) -> float:
    """The likeliest scale of whitened values (n,), 1 at least; exact zeros stand for no data."""
    square = z[z != 0] ** 2

    def over(scale: float) -> float:
        return float(np.sum((nu + 1) * square / (nu * scale**2 + square))) - len(square)

    if not len(square) or over(1.0) <= 0:
        return 1.0
    return float(brentq(over, 1.0, 2 * math.sqrt(float(square.max())) + 1, xtol=1e-10))


def weights(z: Array, nu: float = NU, *, scale: float = 1.0) -> Array:
    """The weight (n,) of each whitened value (n,): (nu + 1) / (nu + (z / scale)^2), at most 1.25 for 4."""
    return np.asarray((nu + 1) / (nu + (z / scale) ** 2))


def student(residual: Residual, jacobian: Jacobian, nu: float = NU) -> tuple[Residual, Jacobian, Jacobian]:
    """A residual and its derivatives under errors of Student's t with nu degrees of freedom.

    residual, jacobian: as in `least_squares`, of n normal errors. The first of the result is the signed root
    of the deviance (nu + 1) ln(1 + (z / s)^2 / nu) of each value, s the likeliest scale there; the largest
    carries 2 n ln s, too. The second is its derivatives with s as it is: where s is likeliest, its own change
    changes nothing of the sum. The third, rows (n, d), is for `least_squares(information=...)`: their
    products are the expected information of the t distribution, (nu + 1) / (nu + 3) / s^2 of that of normal
    errors.
    """

    def roots(z: Array) -> tuple[Array, Array, float]:
        """The roots (n,), their derivatives (n,) by z, and the scale."""
        s = scale_of(z, nu)
        x = np.abs(z) / s
        size = np.sqrt((nu + 1) * np.log1p(x**2 / nu))
        slope, far = np.full_like(x, math.sqrt((nu + 1) / nu)), x > SMALL
        slope[far] = weights(x[far], nu) * x[far] / size[far]
        most = int(np.argmax(x))
        whole = math.hypot(size[most], math.sqrt(2 * np.count_nonzero(z) * math.log(s)))
        slope[most] *= size[most] / whole if whole else 1.0
        size[most] = whole
        return np.sign(z) * size, slope / s, s

    def root(theta: Array) -> Array | None:
        z = residual(theta)
        return None if z is None or not np.all(np.isfinite(z)) else roots(z)[0]

    def slope(theta: Array) -> Array:
        rows, z = jacobian(theta), residual(theta)
        return np.full_like(rows, np.nan) if z is None else np.asarray(roots(z)[1][:, None] * rows)

    def information(theta: Array) -> Array:
        z = residual(theta)
        s = 1.0 if z is None else roots(z)[2]
        return np.asarray(math.sqrt((nu + 1) / (nu + 3)) / s * jacobian(theta))

    return root, slope, information
