"""A model fitted under law errors -> how far its effects' laws are off, and where."""

import numpy as np
from pydantic import Field

from twin.judging.comparison import BRANCHES, WHILE, branches
from twin.judging.judged import Judged
from twin.records import Record
from twin.tablemodel import Finite
from twin.targets import Array, Targets

TOLD = 0.005  # of what an effect adds: a law that is right to this is told as right


class LawLeft(Record):
    """What the laws of the named effects leave."""

    share: Finite = Field(description="of what the effects add, rms")
    marker: str = Field(description="where it is largest")
    branch: str

    @property
    def words(self) -> str:
        """A sentence; nothing where the laws are right."""
        if self.share < TOLD:
            return ""
        where = WHILE.get(self.branch, self.branch)
        return (
            "No law that was tried is exact: what they leave is "
            f"{100 * self.share:.2g} % of what it adds, most at {self.marker}, {where}."
        )


def left_by_laws(judged: Judged, targets: Targets) -> LawLeft | None:
    """What the laws of a judged model leave, as its law errors show it; None where they were not asked
    for."""
    w = judged.whitener
    own = np.flatnonzero(w.of_laws)
    if not len(own):
        return None
    size = w.amplitudes(judged.comparison.residual)[own]
    field = np.where(w.valid, np.tensordot(size, w.modes[own], 1), 0.0)
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
    return LawLeft(share=share, marker=targets.names[points[k]], branch=BRANCHES[b])


def _added(judged: Judged) -> Array:
    """What the effects of a judged model add (s, p, 3) mm, to first order in their amplitudes."""
    rows = judged.model.jacobian(judged.theta)
    null = {p.name: p.null for e in judged.model.effects for p in e.amplitudes}
    names = [p.name for p in judged.model.parameters]
    size = np.array([judged.values[n] - (null[n] or 0.0) if n in null else 0.0 for n in names])
    return np.asarray(np.tensordot(size, rows, 1), float)
