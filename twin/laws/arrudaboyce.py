"""Rubber of eight chains that lock at a stretch lambda_m (Arruda & Boyce 1993, doi
10.1016/0022-5096(93)90013-6): the series of five terms that Abaqus and CalculiX have, too."""

from typing import TYPE_CHECKING, Any

import numpy as np

from calibrate import Parameter
from twin.laws.law import MPA, RubberLaw, Shape, Values

if TYPE_CHECKING:
    from fe import Material

SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


def _energy(c: Values, I1: Any, I2: Any, l: Any) -> Any:  # noqa: E741
    k = c["lambda_m"] ** -2
    return c["mu"] * sum(a * k**i * (I1 ** (i + 1) - 3 ** (i + 1)) for i, a in enumerate(SERIES))


def _terms(c: Values) -> dict[str, Any]:
    return {"chains": (c["mu"], c["lambda_m"])}


def _read(m: "Material") -> dict[str, float]:
    mu, lock = m.chains or (0.0, np.inf)
    return {"mu": mu, "lambda_m": lock}


def _at_rest(k: float) -> float:
    """dW/dI1 at rest over mu; k: 1 / lambda_m^2."""
    return sum((i + 1) * a * (3 * k) ** i for i, a in enumerate(SERIES))


def _split(c: Values) -> tuple[float, tuple[float, ...]]:
    k = c["lambda_m"] ** -2
    return c["mu"] * _at_rest(k), (k,)


def _join(scale: float, shape: tuple[float, ...]) -> dict[str, float]:
    return {"mu": scale / _at_rest(shape[0]), "lambda_m": shape[0] ** -0.5}


ARRUDA_BOYCE = RubberLaw(
    name="arruda-boyce",
    title="Arruda-Boyce",
    formula="W = mu sum a_i lambda_m^(2 - 2 i) (I1^i - 3^i), a = 1/2, 1/20, 11/1050, 19/7000, 519/673750",
    stiffness="half of the shear modulus at rest",
    source="10.1016/0022-5096(93)90013-6",
    parameters=(
        Parameter("mu", 0.01, 1.0, MPA, typical=0.04, start=0.5),
        Parameter("lambda_m", 1.1, 10.0, typical=0.2, start=2.0),
    ),
    shapes=(Shape("1/lambda_m^2", 0.01, 0.85, usual=0.25),),
    energy=_energy,
    terms=_terms,
    read=_read,
    split=_split,
    join=_join,
)
