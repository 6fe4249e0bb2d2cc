"""Several chambers in a prediction: what is asked of each, and what no film has shown."""

from collections.abc import Mapping, Sequence

import numpy as np

from twin.calibrated.predictions import SAME
from twin.targets import Targets


def shares_of_words(targets: Targets, texts: Sequence[str]) -> dict[str, float]:
    """Share of the pressure in each chamber, from texts SURFACE=SHARE; empty without any. ValueError where
    the films have other chambers."""
    if not texts:
        return {}
    filmed, shares = targets.shares, dict[str, float]()
    for text in texts:
        name, _, value = text.partition("=")
        try:
            shares[name.strip()] = float(value)
        except ValueError:
            raise ValueError(f"--shares {text!r}: wanted SURFACE=SHARE, such as LEFT=1.0") from None
    if not filmed:
        raise ValueError(
            f"--shares {', '.join(texts)}: the films have no pressure_shares, as their structure has one "
            "chamber, or several with one pressure; leave it out"
        )
    if (
        shares.keys() != filmed.keys()
        or not any(shares.values())
        or not np.isfinite([*shares.values()]).all()
    ):
        raise ValueError(
            f"--shares {', '.join(texts)}: wanted one for each of {', '.join(filmed)}, not all 0, such as "
            + " ".join(f"--shares {name}=1.0" for name in filmed)
        )
    return shares


def filling_notes(t: Targets, shares: Mapping[str, float], pressure_MPa: float) -> list[str]:
    """Sentences on chambers filled in another way, or higher, than in the films, up to pressure_MPa."""
    if not t.shares:
        return []
    carried = {name: shares.get(name, float(filmed_shares[0])) for name, filmed_shares in t.shares.items()}
    filling = ", ".join(f"{name} {share:g}" for name, share in carried.items())
    out = [] if shares else [f"The chambers carry the pressure as in the first film: {filling}."]
    tops = np.array([np.abs(t.pressure[t.block == b]).max() for b in np.unique(t.block)])
    for name, filmed_shares in t.shares.items():
        tested, top = float((np.abs(filmed_shares) * tops).max()), abs(carried[name]) * pressure_MPa
        if top > SAME * tested:
            out.append(
                f"{name} is filled to {1e3 * top:.4g} kPa, in the films to {1e3 * tested:.4g} kPa at "
                "most: nobody has seen the silicone's law there, and the intervals do not know it."
            )
    filmed = zip(*t.shares.values(), strict=True)
    if not any(np.allclose(row, list(carried.values())) for row in filmed):
        out.append(f"No film has filled the chambers so: {filling}.")
    return out
