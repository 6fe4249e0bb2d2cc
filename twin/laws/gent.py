"""Gent's rubber, which cannot be strained beyond I1 - 3 = Jm (Gent 1996, doi 10.5254/1.3538357)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from calibrate import Parameter
from twin.laws.law import MPA, RubberLaw, Shape, Values

if TYPE_CHECKING:
    from fe import Material


def _energy(c: Values, I1: Any, I2: Any, l: Any) -> Any:  # noqa: E741
    return -c["mu"] * c["Jm"] / 2 * np.log(1 - (I1 - 3) / c["Jm"])


def _terms(c: Values) -> dict[str, Any]:
    return {"gent": (c["mu"], c["Jm"])}


def _read(m: "Material") -> dict[str, float]:
    mu, limit = m.gent or (0.0, np.inf)
    return {"mu": mu, "Jm": limit}


def _split(c: Values) -> tuple[float, tuple[float, ...]]:
    return c["mu"] / 2, (1 / c["Jm"],)


def _join(scale: float, shape: tuple[float, ...]) -> dict[str, float]:
    return {"mu": 2 * scale, "Jm": 1 / shape[0]}


GENT = RubberLaw(
    name="gent",
    title="Gent",
    formula="W = -mu Jm / 2 ln(1 - (I1 - 3) / Jm)",
    stiffness="mu / 2",
    source="10.5254/1.3538357",
    parameters=(
        Parameter("mu", 0.02, 1.0, MPA, typical=0.04, start=0.6),
        Parameter("Jm", 1.0, 100.0, typical=1.0, start=8.0),
    ),
    shapes=(Shape("1/Jm", 0.01, 1.0, usual=0.125),),
    energy=_energy,
    terms=_terms,
    read=_read,
    split=_split,
    join=_join,
)
