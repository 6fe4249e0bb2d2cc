"""What laws share that are polynomials in the invariants: their constants are fields of a material."""

from functools import partial
from typing import Any

from fe import Material
from twin.laws.law import Values


def terms_of(c: Values) -> dict[str, Any]:
    """The fields of a material."""
    return dict(c)


def _read(names: tuple[str, ...], m: Material) -> dict[str, float]:
    return {name: float(getattr(m, name)) for name in names}


def reader(*names: str) -> Any:
    """What reads the constants of these names off a material."""
    return partial(_read, names)
