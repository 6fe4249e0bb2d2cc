"""A whitened residual that may hold gross errors -> one of which they take little: errors of Student's t.

K. L. Lange, R. J. A. Little, J. M. G. Taylor 1989 (doi:10.1080/01621459.1989.10478852). Their iteratively
reweighted least squares end where the gradient of the deviance is 0. The same place is found here by least
squares of its signed root, whose steps are bounded and accepted by the deviance itself.
"""

import math
from collections.abc import Sequence

import numpy as np

from calibrate.fit import Jacobian, Residual, least_squares
from calibrate.parameters import Array, Parameter

NU = 4.0  # degrees of freedom, as Lange et al. propose for unknown errors
NORMAL = 0.6745  # median of |z| of normal errors of sd 1
NARROWER = 20  # times that the scale is made anew on the way from a start
SMALL = 1e-4  # of z, below which the root of the deviance is taken as straight


def weights(z: Array, nu: float = NU) -> Array:
    """The weight (n,) of each whitened value (n,): (nu + 1) / (nu + z^2), 1.25 at most for nu = 4."""
    return np.asarray((nu + 1) / (nu + z**2))


def scale_of(z: Array) -> float:
    """The sd that the middle half of whitened values (n,) shows, 1 at least, whatever gross errors do."""
    return max(float(np.median(np.abs(z))) / NORMAL, 1.0)


def student(
    residual: Residual, jacobian: Jacobian, nu: float = NU, *, scale: float = 1.0
) -> tuple[Residual, Jacobian, Jacobian]:
    """A residual and its derivatives under errors of Student's t with nu degrees of freedom and a scale.

    residual, jacobian: as in `least_squares`, of normal errors. The first two of the result are the signed
    root r of the deviance (nu + 1) ln(1 + z^2 / nu) and its derivatives. The third, rows (n, d), is for
    `least_squares(information=...)`: their products are the expected information of the t distribution,
    (nu + 1) / (nu + 3) of that of normal errors.
    """

    def root(theta: Array) -> Array | None:
        z = residual(theta)
        if z is None:
            return None
        return np.sign(z) * np.sqrt((nu + 1) * np.log1p((z / scale) ** 2 / nu))

    def slope(theta: Array) -> Array:
        rows, z = jacobian(theta) / scale, residual(theta)
        if z is None:
            return np.full_like(rows, np.nan)
        z = z / scale
        r = np.abs(np.sqrt((nu + 1) * np.log1p(z**2 / nu)))
        far = np.abs(z) > SMALL
        turn = np.full_like(z, math.sqrt((nu + 1) / nu))
        turn[far] = weights(z[far], nu) * np.abs(z[far]) / r[far]
        return np.asarray(turn[:, None] * rows)

    def information(theta: Array) -> Array:
        return np.asarray(math.sqrt((nu + 1) / (nu + 3)) / scale * jacobian(theta))

    return root, slope, information


def approached(
    residual: Residual, jacobian: Jacobian, parameters: Sequence[Parameter], theta: Array, nu: float = NU
) -> Array:
    """Parameters (d,) from which a fit under the t with scale 1 finds its way: from theta (d,), which gross
    errors may have led far off, fits under the scale that the middle half of the values shows, which falls on
    the way. Far off, all values are gross errors of scale 1, and show no way."""
    before = math.inf
    for _ in range(NARROWER):
        z = residual(theta)
        if z is None or not (scale := scale_of(z)) < before:
            break
        root, slope, _ = student(residual, jacobian, nu, scale=scale)
        theta, before = least_squares(root, slope, parameters, start=theta).theta, scale
        if scale == 1.0:
            break
    return theta
