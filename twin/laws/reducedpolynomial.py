"""Rubber whose energy is a polynomial in I1 - 3: neo-Hookean, of one constant (Treloar 1943, doi
10.1039/TF9433900036), and Yeoh's cubic, which stiffens with strain (Yeoh 1993, doi 10.5254/1.3538343)."""

from typing import Any

from calibrate import Parameter
from twin.laws.law import MPA, RubberLaw, Shape, Values, ratio, reader, terms_of

NAMES = ("C10", "C20", "C30")


def _energy(c: Values, I1: Any, I2: Any, l: Any) -> Any:  # noqa: E741
    return sum(c[name] * (I1 - 3) ** k for k, name in enumerate(NAMES, 1) if name in c)


def _split(c: Values) -> tuple[float, tuple[float, ...]]:
    return c["C10"], tuple(ratio(c[name], c["C10"]) for name in NAMES[1:] if name in c)


def _join(scale: float, shape: tuple[float, ...]) -> dict[str, float]:
    return dict(zip(NAMES, (scale, *(share * scale for share in shape))))


def _law(name: str, title: str, formula: str, source: str, *, rows: tuple[Parameter, ...],
         shapes: tuple[Shape, ...]) -> RubberLaw:  # fmt: skip
    return RubberLaw(
        name=name, title=title, formula=formula, stiffness="C10", source=source, parameters=rows,
        shapes=shapes, energy=_energy, terms=terms_of, read=reader(*(p.name for p in rows)), split=_split,
        join=_join,
    )  # fmt: skip


NEO_HOOKE = _law(
    "neo-hooke", "neo-Hookean", "W = C10 (I1 - 3)", "10.1039/TF9433900036",
    rows=(Parameter("C10", 0.01, 0.5, MPA, typical=0.02, start=0.3),), shapes=(),
)  # fmt: skip
YEOH = _law(
    "yeoh", "Yeoh", "W = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3", "10.5254/1.3538343",
    rows=(
        Parameter("C10", 0.01, 0.5, MPA, typical=0.02, start=0.3),
        Parameter("C20", -0.05, 0.15, MPA, typical=0.005, start=0.03),
        Parameter("C30", -0.02, 0.05, MPA, typical=0.002, start=0.0),
    ),
    shapes=(
        Shape("C20/C10", -0.1, 0.5, usual=0.1, count=4),
        Shape("C30/C10", -0.03, 0.15, usual=0.0, count=3),
    ),
)  # fmt: skip
