"""Yeoh's rubber: a cubic in I1 - 3, which stiffens with strain (Yeoh 1993, doi 10.5254/1.3538343)."""

from typing import Any

from calibrate import Parameter
from twin.laws.law import MPA, RubberLaw, Shape, Values, ratio, reader, terms_of


def _energy(c: Values, I1: Any, I2: Any, l: Any) -> Any:  # noqa: E741
    return c["C10"] * (I1 - 3) + c["C20"] * (I1 - 3) ** 2 + c["C30"] * (I1 - 3) ** 3


def _split(c: Values) -> tuple[float, tuple[float, ...]]:
    return c["C10"], (ratio(c["C20"], c["C10"]), ratio(c["C30"], c["C10"]))


def _join(scale: float, shape: tuple[float, ...]) -> dict[str, float]:
    return {"C10": scale, "C20": shape[0] * scale, "C30": shape[1] * scale}


YEOH = RubberLaw(
    name="yeoh",
    title="Yeoh",
    formula="W = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3",
    stiffness="C10",
    source="10.5254/1.3538343",
    parameters=(
        Parameter("C10", 0.01, 0.5, MPA, typical=0.02, start=0.3),
        Parameter("C20", -0.05, 0.15, MPA, typical=0.005, start=0.03),
        Parameter("C30", -0.02, 0.05, MPA, typical=0.002, start=0.0),
    ),
    shapes=(
        Shape("C20/C10", -0.1, 0.5, usual=0.1, count=4),
        Shape("C30/C10", -0.03, 0.15, usual=0.0, count=3),
    ),
    energy=_energy,
    terms=terms_of,
    read=reader("C10", "C20", "C30"),
    split=_split,
    join=_join,
)
