"""The smallest size of every absent effect that these data would have shown.

What the fitted parameters take up of an effect is no evidence for it. The rest of its signature, S in
whitened values per unit, gives a score of sd 1 and mean size |S|. A size is found with probability POWER
where that mean lies above the threshold of the test by the normal quantile of POWER.
"""

import math
from collections.abc import Sequence

import numpy as np
import scipy
from pydantic import Field

from calibrate import Parameter
from twin.diagnosis.evidence import apart, orthonormal
from twin.diagnosis.signatures import null
from twin.effects.protocol import Effect, Theta
from twin.records import Maybe, Record
from twin.targets import Array

ALPHA = 0.01  # of a false alarm over all effects and all their grids
POWER = 0.9
APART = 0.02  # of its own size must be left of a signature beside the fitted parameters


class Detectable(Record):
    """The size of an effect's first parameter that these data show with probability POWER; None where no size
    would be seen."""

    effect: str
    parameter: str
    unit: str
    size: Maybe = Field(description="found nine times of ten, at the least visible of its tries")
    least: Maybe = Field(description="at the most visible one")
    note: str = Field(description="the size beside the plausible, or why none would be seen")

    @property
    def words(self) -> str:
        """The effect with its smallest size, in a few words."""
        if self.size is None or self.least is None:
            return f"{self.effect} ({self.note})"
        size = f"{self.size:.2g}"
        span = size if f"{self.least:.2g}" == size else f"{self.least:.2g} to {size}"
        return f"{self.parameter} of {span} {self.unit}".rstrip()


def smallest(
    effect: Effect,
    signatures: Array,
    fitted: Array,
    *,
    effects: int,
    entries: Sequence[Theta] = (),
    alpha: float = ALPHA,
    power: float = POWER,
) -> Detectable:
    """The smallest size of one effect that a test beside `effects` - 1 others finds.

    signatures (k, n): whitened change per unit of its first parameter, a row for each grid entry. fitted
    (n, f): whitened derivatives of the fitted parameters. entries (k,): the values of each grid entry; those
    outside their plausible range are left out. One-sided where the null is the lower bound.
    """
    p, seen = effect.parameters[0], _apart(signatures, fitted)
    possible = _plausible(effect, entries) or list(range(len(seen)))
    visible = [float(seen[k]) for k in possible if seen[k] > 0.0]
    if not visible:
        return unseen(effect, "cannot be seen apart from the fitted parameters with these data")
    threshold = quantile(alpha, effects=effects, entries=len(seen), one_sided=p.null == p.low)
    needed = threshold + float(scipy.special.ndtri(power))
    size, least = needed / min(visible), needed / max(visible)
    room = max(p.high - null(p), null(p) - p.low)
    if least > room:
        return unseen(effect, f"no size up to its bound, {_with_unit(room, p)}, would show")
    notes = [_beside_plausible(p, size)] if p.plausible is not None else []
    if len(visible) < len(possible):
        notes.append(f"not visible at {len(possible) - len(visible)} of {len(possible)} tries")
    return Detectable(
        effect=effect.name, parameter=p.name, unit=p.unit, size=size, least=least, note="; ".join(notes)
    )


def unseen(effect: Effect, why: str) -> Detectable:
    """The record of an effect that these data show at no size, with the reason."""
    p = effect.parameters[0]
    return Detectable(effect=effect.name, parameter=p.name, unit=p.unit, size=None, least=None, note=why)


def quantile(alpha: float, *, effects: int, entries: int, one_sided: bool) -> float:
    """The score that an effect must reach: alpha shared among effects (Bonferroni, the worst case of Holm)
    and among the entries of its grid (Sidak).

    >>> round(quantile(0.01, effects=1, entries=1, one_sided=False), 3)
    2.576
    >>> round(quantile(0.01, effects=20, entries=5, one_sided=True), 3)
    3.719
    """
    level = -math.expm1(math.log1p(-alpha / effects) / entries)
    return -float(scipy.special.ndtri(level if one_sided else level / 2))


def in_words(rows: Sequence[Detectable]) -> str:
    """Sentences on the sizes that would have been found, and on effects that show at no size."""
    seen = [row.words for row in rows if row.size is not None]
    blind: dict[str, list[str]] = {}
    for row in rows:
        if row.size is None:
            blind.setdefault(row.note.removeprefix("not testable: "), []).append(row.effect)
    out = [f"These sizes would have been found, nine times of ten: {', '.join(seen)}."] if seen else []
    if blind:
        which = "; ".join(f"{', '.join(names)} ({why})" for why, names in blind.items())
        out.append(f"Not testable here: {which}.")
    return " ".join(out)


def _apart(signatures: Array, fitted: Array) -> Array:
    """Norms (k,) of signatures (k, n) beside the columns of `fitted` (n, f); 0 where too little is left."""
    remainder = apart(signatures.T, orthonormal(fitted))
    size, lengths = np.linalg.norm(remainder, axis=0), np.linalg.norm(signatures, axis=1)
    return np.where(size > APART * lengths, size, 0.0)


def _plausible(effect: Effect, entries: Sequence[Theta]) -> list[int]:
    """The numbers of the grid entries whose values lie in their parameters' plausible ranges."""
    ranges = {p.name: p.plausible for p in effect.parameters if p.plausible is not None}
    return [
        k
        for k, entry in enumerate(entries or ({},))
        if all(ranges[name][0] <= x <= ranges[name][1] for name, x in entry.items() if name in ranges)
    ]


def _with_unit(size: float, parameter: Parameter) -> str:
    return f"{size:.2g} {parameter.unit}".rstrip()


def _beside_plausible(parameter: Parameter, size: float) -> str:
    """A smallest visible size beside the declared plausible range, in words."""
    assert parameter.plausible is not None
    low, high = parameter.plausible
    smaller, larger = sorted(abs(x - null(parameter)) for x in parameter.plausible)
    if size > larger:
        return f"even the largest plausible size, {_with_unit(larger, parameter)}, may be missed"
    if size <= (0.0 if low < null(parameter) < high else smaller):
        return "every plausible size would have been found"
    return f"plausible are sizes up to {_with_unit(larger, parameter)}"
