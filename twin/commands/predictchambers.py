"""Several chambers in a prediction: what is asked of each, and what no film has shown."""

from collections.abc import Mapping, Sequence

import numpy as np

from twin.calibrated.predictions import SAME
from twin.targets import Targets


def shares_of_words(targets: Targets, stated: Sequence[str]) -> dict[str, float]:
    """What of the pressure each chamber carries, of words SURFACE=SHARE; nothing where none is given.
    ValueError where they are not those of the films."""
    if not stated:
        return {}
    known, found = targets.shares, dict[str, float]()
    for text in stated:
        name, _, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise ValueError(f"--shares {text!r}: wanted SURFACE=SHARE, such as LEFT=1.0") from None
    if not known:
        raise ValueError(
            f"--shares {', '.join(stated)}: the films have no pressure_shares, as their structure has one "
            "chamber, or several with one pressure; leave it out"
        )
    if found.keys() != known.keys() or not any(found.values()) or not np.isfinite([*found.values()]).all():
        raise ValueError(
            f"--shares {', '.join(stated)}: wanted one for each of {', '.join(known)}, not all 0, such as "
            + " ".join(f"--shares {name}=1.0" for name in known)
        )
    return found


def filling_notes(t: Targets, shares: Mapping[str, float], asked_for: float) -> list[str]:
    """How chambers are filled, where the films do not say it: up to a pressure in MPa."""
    if not t.shares:
        return []
    carried = {name: shares.get(name, float(own[0])) for name, own in t.shares.items()}
    told = ", ".join(f"{name} {share:g}" for name, share in carried.items())
    out = [] if shares else [f"The chambers carry the pressure as in the first film: {told}."]
    tops = np.array([np.abs(t.pressure[t.block == b]).max() for b in np.unique(t.block)])
    for name, own in t.shares.items():
        tested, wanted = float((np.abs(own) * tops).max()), abs(carried[name]) * asked_for
        if wanted > SAME * tested:
            out.append(
                f"{name} is filled to {1e3 * wanted:.4g} kPa, in the films to {1e3 * tested:.4g} kPa at "
                "most: nobody has seen the silicone's law there, and the intervals do not know it."
            )
    filmed = zip(*t.shares.values(), strict=True)
    if not any(np.allclose(row, list(carried.values())) for row in filmed):
        out.append(f"No film has filled the chambers so: {told}.")
    return out
