"""Neo-Hookean rubber: one constant (Treloar 1943, doi 10.1039/TF9433900036)."""

from typing import Any

from calibrate import Parameter
from twin.laws.law import MPA, RubberLaw, Values, reader, terms_of


def _energy(c: Values, I1: Any, I2: Any, l: Any) -> Any:  # noqa: E741
    return c["C10"] * (I1 - 3)


def _split(c: Values) -> tuple[float, tuple[float, ...]]:
    return c["C10"], ()


def _join(scale: float, shape: tuple[float, ...]) -> dict[str, float]:
    del shape
    return {"C10": scale}


NEO_HOOKE = RubberLaw(
    name="neo-hooke",
    title="neo-Hookean",
    formula="W = C10 (I1 - 3)",
    stiffness="C10",
    source="10.1039/TF9433900036",
    parameters=(Parameter("C10", 0.01, 0.5, MPA, typical=0.02, start=0.3),),
    shapes=(),
    energy=_energy,
    terms=terms_of,
    read=reader("C10"),
    split=_split,
    join=_join,
)
