"""Mooney-Rivlin rubber, the law of a project that names none: constants C10 and C01, which stand here once.

The scale is C10 + C01, the form the share C01 / (C10 + C01) (Rivlin 1948, doi 10.1098/rsta.1948.0024).
"""

import math
from typing import Any

from calibrate import Parameter
from twin.laws.law import MPA, Bounds, Constants, RubberLaw, Shape, Values, ratio, reader, terms_of

NAMES = ("C10", "C01")
LEAST_SHARE = -0.6  # that is stable up to a stretch of 1.63; Ogden's exponent 4 with C20 has -0.5
WIDEST_SHARE = -2.0  # with terms beside C10 and C01, which make it stable: Ogden's exponent 10


def _energy(c: Values, I1: Any, I2: Any, l: Any) -> Any:  # noqa: E741
    return c["C10"] * (I1 - 3) + c["C01"] * (I2 - 3)


def _split(c: Values) -> tuple[float, tuple[float, ...]]:
    total = c["C10"] + c["C01"]
    return total, (ratio(c["C01"], total),)


def _join(scale: float, shape: tuple[float, ...]) -> dict[str, float]:
    (share,) = shape
    return {"C10": (1 - share) * scale, "C01": share * scale}


def _widened(bounds: Bounds, fixed: Values) -> Bounds:
    """Bounds of least squares: where C01 may be 0 it may be negative, and C10 larger by as much as the least
    C01 takes. `Model.allowed` says up to where that is stable."""
    low, high = bounds.get("C01", (math.inf, 0.0))
    if low > 0.0:
        return bounds
    softest = MOONEY_RIVLIN.at(bounds["C10"][1] if "C10" in bounds else fixed["C10"], (WIDEST_SHARE,))
    wider = {"C01": (min(low, softest["C01"]), high)}
    if "C10" in bounds:
        wider["C10"] = bounds["C10"][0], softest["C10"]
    return {**bounds, **wider}


def mooney_rivlin(C10: float, C01: float) -> Constants:
    """The constants C10 and C01 in MPa.

    >>> mooney_rivlin(0.2, 0.1).material.shear  # shear modulus at rest in MPa, 2 (C10 + C01)
    0.6000000000000001
    """
    return MOONEY_RIVLIN.of({"C10": C10, "C01": C01})


MOONEY_RIVLIN = RubberLaw(
    name="mooney-rivlin",
    title="Mooney-Rivlin",
    formula="W = C10 (I1 - 3) + C01 (I2 - 3)",
    stiffness="C10 + C01",
    source="10.1098/rsta.1948.0024",
    parameters=(
        Parameter("C10", 0.01, 0.5, MPA, typical=0.02, start=0.2),
        Parameter("C01", 0.0, 0.5, MPA, typical=0.02, start=0.1),
    ),
    shapes=(Shape("share", 0.0, 1.0, usual=0.3, below=LEAST_SHARE, more=3),),
    energy=_energy,
    terms=terms_of,
    read=reader(*NAMES),
    split=_split,
    join=_join,
    widened=_widened,
)
NOMINAL = MOONEY_RIVLIN.nominal
