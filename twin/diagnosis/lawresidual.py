"""A model fitted under law errors -> the part of the motion that its effects' laws do not describe."""

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from twin.judging.comparison import BRANCHES, WHILE, branches
from twin.judging.judged import Judged, free_names
from twin.records import Record
from twin.tablemodel import Finite
from twin.targets import Array, Targets

TOLD = 0.005  # of what an effect adds: a law that is right to this is told as right


class LawResidual(Record):
    """The part of the motion of named effects that their laws do not describe.

    >>> first, second = LawResidual(share=0.021, marker="tip", branch="hold").words(["creep"]).split(". ")
    >>> first
    'The creep law describes all but 2.1 % of the motion that creep adds'
    >>> second
    'The rest is largest at marker tip while the pressure is held.'
    """

    share: Finite = Field(description="of what the effects add, rms")
    marker: str = Field(description="where it is largest")
    branch: str

    def words(self, names: Sequence[str]) -> str:
        """Two sentences on the laws of effects of these names; "" where the laws are right."""
        if self.share < TOLD:
            return ""
        joined = " and ".join(names)
        law, them = f"The {joined} law describes", joined
        if len(names) > 1:
            law, them = f"The laws of {joined} describe", "they"
        add = "add" if len(names) > 1 else "adds"
        return (
            f"{law} all but {100 * self.share:.2g} % of the motion that {them} {add}. "
            f"The rest is largest at marker {self.marker} {WHILE.get(self.branch, self.branch)}."
        )


def law_residual(judged: Judged, targets: Targets) -> LawResidual | None:
    """The residual of a judged model that its fitted law errors take up; None where it has none."""
    w = judged.whitener
    rows = np.flatnonzero(w.of_laws)
    if not len(rows):
        return None
    size = w.amplitudes(judged.comparison.residual)[rows]
    field = np.where(w.valid, np.tensordot(size, w.modes[rows], 1), 0.0)
    added = np.where(w.valid, w.pick(_added(judged)), 0.0)
    branch = branches(targets.time, targets.pressure, targets.log_time, targets.log_pressure)
    points = np.unique(w.components[:, 0])
    power = np.array(
        [
            [(field[np.ix_(branch == b, w.components[:, 0] == k)] ** 2).sum() for b in range(len(BRANCHES))]
            for k in points
        ]
    )
    k, b = np.unravel_index(int(power.argmax()), power.shape)
    share = float(np.sqrt((field**2).sum() / max((added**2).sum(), 1e-300)))
    return LawResidual(share=share, marker=targets.names[points[k]], branch=BRANCHES[b])


def _added(judged: Judged) -> Array:
    """Displacements (s, p, 3) mm that the effects of a judged model add, to first order in their
    amplitudes that are free."""
    null = {p.name: p.null for e in judged.model.effects for p in e.amplitudes}
    size = [judged.values[n] - (null[n] or 0.0) if n in null else 0.0 for n in free_names(judged.fit)]
    return np.asarray(np.tensordot(size, judged.jacobian, 1), float)
