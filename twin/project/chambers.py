"""Which of several chambers carry the pressure of a recording: the table, and all recordings together."""

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

Shares = dict[str, Annotated[float, Field(ge=-10, le=10, allow_inf_nan=False)]]


def shares_by_surface(stated: Mapping[str, Mapping[str, float]]) -> dict[str, NDArray[np.float64]]:
    """The shares (b,) of the logged pressure that each surface carries in the recordings, from those of each
    recording by its name. ValueError where recordings name other surfaces, or one presses on none."""
    surfaces = tuple(next(iter(stated.values()), ()))
    for name, shares in stated.items():
        if shares.keys() != set(surfaces):
            first = next(iter(stated))
            raise ValueError(
                f"{name}: pressure_shares names {', '.join(shares) or 'no surface'}, that of {first} "
                f"{', '.join(surfaces) or 'none'}; wanted the same surfaces in each, with 0.0 for one that "
                "has no pressure"
            )
        if shares and not any(shares.values()):
            raise ValueError(
                f"{name}: pressure_shares is 0.0 throughout, so the logged pressure acts on nothing; wanted "
                "1.0 for the surface that it acts on"
            )
    return {surface: np.array([shares[surface] for shares in stated.values()]) for surface in surfaces}
