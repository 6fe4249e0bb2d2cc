"""Classes of effects that mimic each other in these data, found before any verdict.

Two effects whose signatures are parallel, the fitted parameters projected out, cannot be told apart
however small the noise is. The ceiling of an effect is the largest share of its signature that another
effect mimics.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from twin.diagnosis.evidence import apart, ceiling, orthonormal
from twin.diagnosis.signatures import Signatures
from twin.judging.judged import Judged
from twin.records import Record
from twin.tablemodel import Finite
from twin.targets import Array

ALIKE = 0.95  # of a signature that another effect mimics, from which on the two are of one class


class Mimics(Record):
    """The effects that mimic an effect."""

    effect: str
    members: dict[str, Finite] = Field(description="those that mimic at least 95 % of its signature")
    ceiling: Finite = Field(description="the largest share that any other mimics")


def classes_of(signatures: Signatures) -> tuple[Mimics, ...]:
    """The mimics of each effect of the library; effects that cannot be seen are left out."""
    seen = {label: [r for r in rows if not r.note] for label, rows in signatures.items()}
    seen = {label: rows for label, rows in seen.items() if rows}
    bases = {label: [orthonormal(r.columns) for r in rows] for label, rows in seen.items()}
    labels = [label for label, rows in seen.items() if not rows[0].effect.kind]
    return tuple(_mimics(label, seen, bases) for label in labels)


def _mimics(
    label: str, seen: Signatures, bases: Mapping[str, Sequence[Array]]
) -> Mimics:
    columns = np.concatenate([r.columns for r in seen[label]], axis=1)
    size = (columns**2).sum(axis=0)
    columns, size = columns[:, size > 0], size[size > 0]
    shares: dict[str, float] = {}
    for mimic, rows in bases.items():
        if mimic != label:
            mimicked = [((b.T @ columns) ** 2).sum(axis=0) / size for b in rows if b.shape[1]]
            name = seen[mimic][0].effect.kind or mimic
            shares[name] = max(shares.get(name, 0.0), min(1.0, float(np.max(mimicked, initial=0.0))))
    members = {k: v for k, v in sorted(shares.items(), key=lambda kv: -kv[1]) if v >= ALIKE}
    return Mimics(effect=label, members=members, ceiling=max(shares.values(), default=0.0))


def shares_of(
    change: Array, judged: Judged, signatures: Signatures
) -> tuple[float, dict[str, float]]:
    """The chi2 of a change of the prediction (s, p, 3) mm apart from the fitted parameters, and the share
    of that which each signature mimics to first order."""
    seen = apart(judged.whitener.whiten(change), orthonormal(judged.fitted))
    shares = {
        label: max((ceiling(seen, r.columns) for r in rows if not r.note), default=0.0)
        for label, rows in signatures.items()
    }
    return float(seen @ seen), shares
