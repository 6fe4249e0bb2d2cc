"""Stability of rubber: the stretch up to which a case's silicone does not shear on by itself, and Drucker's
test."""

import numpy as np

from fe import Case, Material
from twin.laws.law import STRETCH

MODES = {"uniaxial": (1.0, -0.5, -0.5), "planar": (1.0, 0.0, -1.0), "equibiaxial": (1.0, 1.0, -2.0)}
TRIED = 200  # stretches


def steadiness(case: Case) -> float:
    """The least `Material.steadiness` of the materials of a case up to STRETCH, but for those kept."""
    silicones = [m for name, m in case.materials.items() if name not in case.kept]
    return min((m.steadiness(STRETCH) for m in silicones), default=1.0)


def drucker_limit(m: Material, stretch: float) -> tuple[float, str]:
    """The stretch up to which a material passes Drucker's test, at most the given one, and the mode in which
    it fails first, "" where it passes.

    In uniaxial, planar and equibiaxial tension at constant volume every small change of the logarithmic
    strains must do positive work with the change that it makes of the Kirchhoff stresses: their matrix is
    positive definite, as Abaqus has it. Compression along one axis is tension along two.

    >>> drucker_limit(Material(C10=0.3), 1.63)
    (1.63, '')
    >>> limit, mode = drucker_limit(Material(C10=0.3, C20=-0.2), 1.63)
    >>> round(limit, 2), mode
    (1.16, 'equibiaxial')
    """
    limit = stretch, ""
    for name, powers in MODES.items():
        for x in np.geomspace(1.0, stretch, TRIED)[1:]:
            if x >= limit[0]:
                break
            matrix = stiffness(m, x ** np.array(powers))
            if not (np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix).min() > 0.0):
                limit = float(x), name
                break
    return limit


def stiffness(m: Material, l: np.ndarray) -> np.ndarray:  # noqa: E741
    """Derivatives (2, 2) in MPa of the differences of the Kirchhoff stresses to the third one by the first
    two logarithmic strains, at principal stretches l (3,) of constant volume; -inf beyond Gent's limit."""
    square = l**2
    slope, curvature = m.slopes(float(square.sum()))
    if not np.isfinite(slope):
        return np.full((2, 2), -np.inf)
    moduli = 4 * curvature * np.outer(square, square) + np.diag(4 * slope * square + 4 * m.C01 / square)
    moduli += np.diag(sum((2 * mu * l**alpha for mu, alpha in m.ogden), np.zeros(3)))
    away = np.array([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])  # the third strain is less by both
    return np.asarray(away @ moduli @ away.T)
