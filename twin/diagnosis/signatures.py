"""A judged model and absent effects -> their signatures in its residual: whitened columns per prior sd.

Effects of the library and generic stand-ins (an outside force, a soft spot ..) have signatures alike. What
the fitted parameters can imitate is projected out of every column.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate import Parameter
from twin.diagnosis.evidence import Gram, apart, orthonormal
from twin.effects.protocol import Effect, Theta
from twin.judging.judged import Judged
from twin.targets import Array

INVISIBLE = 0.02  # of its own size is what a signature keeps apart from the fitted parameters
SMALLEST = 1e-5  # mm: a signature below this, at its prior sd, is nothing
UNSEEN = "cannot be seen apart from the fitted parameters with these data"
NOTHING = "moves no marker in this test"
AT_ONCE = 100  # entries whose signatures are whitened together
WIDE = 5.0  # typical steps: the prior sd of a parameter without a plausible range


@dataclass(frozen=True, eq=False, kw_only=True)
class Signature:
    """One effect at one entry of its grid.

    parameters (k,): its amplitudes, those with a null. columns (n, k): whitened, apart from what is fitted,
    per prior sd; low, high (k,): bounds in prior sds from null. moved (f, k): what each does to the free
    fitted parameters. note: why it cannot be seen; "" where it can.
    """

    effect: Effect
    entry: Theta
    parameters: tuple[Parameter, ...]
    columns: Array
    low: Array
    high: Array
    moved: Array
    note: str = ""

    @property
    def one_sided(self) -> NDArray[np.bool_]:
        """Flags (k,) of the amplitudes that cannot be below null."""
        return self.low > -1e-9

    @cached_property
    def S(self) -> Array:
        """The information (k, k) on the amplitudes."""
        return self.columns.T @ self.columns

    def gram(self, z: Array) -> Gram:
        """Its products with a residual z (n,)."""
        return Gram(self.S, self.columns.T @ z, float(z @ z))

    def values(self, amplitudes: Array) -> dict[str, float]:
        """Parameter values for amplitudes (k,) in prior sds, with the entry's."""
        sizes = {
            p.name: float(np.clip(null(p) + a * prior_sd(p), p.low, p.high))
            for p, a in zip(self.parameters, amplitudes, strict=True)
        }
        return {**self.entry, **sizes}


Signatures = Mapping[str, Sequence[Signature]]  # by an effect's label, one for each entry of its grid


def null(parameter: Parameter) -> float:
    """The value at which a parameter does nothing; 0 where it has none."""
    return 0.0 if parameter.null is None else parameter.null


def prior_sd(parameter: Parameter) -> float:
    """The sd of a parameter's prior in its unit.

    Of an amplitude half of its plausible range's larger side, so that the range holds about 95 %; without a
    range WIDE typical steps. Of any other parameter the sd of a uniform distribution over its range.

    >>> prior_sd(Parameter("gravity.density", 0.0, 5e-9, null=0.0, plausible=(0.9e-9, 1.3e-9)))
    6.5e-10
    """
    ends = parameter.plausible
    if parameter.null is None:
        low, high = ends or (parameter.low, parameter.high)
        return (high - low) / np.sqrt(12)
    if ends is None:
        return WIDE * parameter.step
    return max(abs(ends[0] - parameter.null), abs(ends[1] - parameter.null)) / 2


def signatures_of(
    judged: Judged, effects: Sequence[Effect], *, tangents: Mapping[str, Sequence[Array]] | None = None
) -> Signatures:
    """The signatures of every effect by its label, one for each entry of its grid, beside a judged fit.

    tangents: what each adds to first order, as `Model.tangents` gives it, made elsewhere; by default there.
    """
    if tangents is None:
        tangents = judged.model.tangents(judged.theta, effects)
    basis = orthonormal(judged.fitted)
    plain = judged.whitener.pick(judged.jacobian)
    imitated = orthonormal(np.nan_to_num(plain).reshape(len(plain), int(np.prod(plain.shape[1:]))).T)
    tried = [
        (effect, entry, fields * np.array([prior_sd(p) for p in effect.amplitudes])[:, None, None, None])
        for effect in effects
        for entry, fields in zip(effect.tries(judged.model.test), tangents[effect.label], strict=True)
    ]
    signatures: dict[str, list[Signature]] = {effect.label: [] for effect in effects}
    for begin in range(0, len(tried), AT_ONCE):
        batch = tried[begin : begin + AT_ONCE]
        whitened = judged.whitener.whiten(np.concatenate([scaled for *_, scaled in batch]))
        ends = np.cumsum([len(scaled) for *_, scaled in batch])[:-1]
        for (effect, entry, scaled), rows in zip(batch, np.split(whitened, ends), strict=True):
            row = _signature(effect, entry, scaled, rows.T, judged, basis, imitated)
            signatures[effect.label].append(row)
    return signatures


def _signature(
    effect: Effect,
    entry: Theta,
    scaled: Array,
    columns: Array,
    judged: Judged,
    basis: Array,
    imitated: Array,
) -> Signature:
    amplitudes = effect.amplitudes
    sd = np.array([prior_sd(p) for p in amplitudes])
    seen = np.nan_to_num(judged.whitener.pick(scaled)).reshape(len(amplitudes), -1).T
    size, remainder = np.abs(seen).max(initial=0.0), apart(seen, imitated)
    note = ""
    if size < SMALLEST:
        note = NOTHING
    elif np.linalg.norm(remainder) < INVISIBLE * np.linalg.norm(seen):
        note = UNSEEN
    offset = np.array([null(p) for p in amplitudes])
    return Signature(
        effect=effect,
        entry=entry,
        parameters=amplitudes,
        columns=apart(columns, basis),
        moved=np.asarray(-np.linalg.lstsq(judged.fitted, columns, rcond=1e-12)[0], float),
        low=(np.array([p.low for p in amplitudes]) - offset) / sd,
        high=(np.array([p.high for p in amplitudes]) - offset) / sd,
        note=note,
    )
