"""The table of the error budget: how much of each mark's sd comes from where."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.errors.errormodel import SOURCES


@dataclass(frozen=True)
class Budget:
    """Standard deviation of each source at each mark, mm; 0 in y, which one camera does not see."""

    sources: tuple[str, ...]  # (r,)
    sd: Array  # (r,p,3) mm, rms over the steps in which the mark is seen
    peak: Array  # (r,p,3) mm, largest of them

    def total(self) -> Array:
        """All sources together (p,3) mm, rms over the steps."""
        return np.asarray(np.sqrt((self.sd**2).sum(axis=0)))

    def largest(self) -> str:
        """The source with the largest rms over all marks."""
        return self.sources[int(np.argmax((self.sd**2).sum(axis=(1, 2))))]


def budget(
    variance: Mapping[str, Array], modes: Array, names: Sequence[str], seen: NDArray[np.bool_]
) -> Budget:
    """The budget of independent variances and modes.

    variance: source to (s,p,3) mm2, the parts of the independent covariance's diagonal.
    modes: (k,s,p,3) mm, 1 sd each.   names: (k,), the source first: "placement:tip:x".
    seen: (s,p) whether the mark is.

    >>> variance = {"static": np.full((2, 1, 3), 0.01**2)}
    >>> table = budget(variance, np.full((1, 2, 1, 3), 0.03), ["scale"], np.ones((2, 1), dtype=bool))
    >>> table.largest(), table.total().round(4).tolist()
    ('scale', [[0.0316, 0.0316, 0.0316]])
    """
    parts = {source: np.zeros((*seen.shape, 3)) for source in SOURCES}
    for source, part in variance.items():
        parts[source] = np.nan_to_num(part)
    for name, mode in zip(names, modes, strict=True):
        source = name.partition(":")[0]
        parts[source] = parts.get(source, 0.0) + np.nan_to_num(mode) ** 2
    visible = {source: part * seen[..., None] for source, part in parts.items()}
    count = np.maximum(seen.sum(axis=0), 1)[:, None]
    return Budget(
        tuple(visible),
        np.array([np.sqrt(np.maximum(part.sum(axis=0), 0.0) / count) for part in visible.values()]),
        np.array([np.sqrt(np.maximum(part.max(axis=0), 0.0)) for part in visible.values()]),
    )


def with_mode(table: Budget, source: str, mode: Array, seen: NDArray[np.bool_]) -> Budget:
    """The table with one more mode (s,p,3) mm of a source; seen: (s,p)."""
    more = budget({}, mode[None], [source], seen)
    row = more.sources.index(source)
    same = np.array([name == source for name in table.sources])[:, None, None]
    return replace(
        table,
        sd=np.sqrt(table.sd**2 + same * more.sd[row] ** 2),
        peak=np.sqrt(table.peak**2 + same * more.peak[row] ** 2),
    )


def lines(table: Budget, names: Sequence[str]) -> list[str]:
    """The table as text: one row a source, one column a mark, mm, rms over the steps (x and z together)."""
    size = np.sqrt((table.sd**2).sum(axis=2))
    width = max(9, *(len(name) + 1 for name in names))
    head = f"{'mm, rms':14s}" + "".join(f"{name:>{width}s}" for name in names)
    rows = [
        f"{source:14s}" + "".join(f"{v:{width}.4f}" for v in row)
        for source, row in zip(table.sources, size, strict=True)
    ]
    total = f"{'all':14s}" + "".join(f"{v:{width}.4f}" for v in np.sqrt((size**2).sum(axis=0)))
    largest = table.largest()
    return [head, *rows, total, f"largest: {largest}; smaller by {SOURCES.get(largest, 'its own means')}"]


def to_csv(table: Budget, names: Sequence[str]) -> str:
    """The table as CSV: one row a mark and source, rms and largest sd in mm."""
    rows = ["point,source,sd1_mm,sd2_mm,sd3_mm,peak1_mm,peak2_mm,peak3_mm"]
    for p, name in enumerate(names):
        for r, source in enumerate(table.sources):
            cells = [*table.sd[r, p], *table.peak[r, p]]
            rows.append(f"{name},{source}," + ",".join(f"{v:.6g}" for v in cells))
    return "\n".join(rows) + "\n"


def from_csv(text: str) -> tuple[Budget, tuple[str, ...]]:
    """The table and the marks' names that `to_csv` wrote."""
    rows = [line.split(",") for line in text.splitlines()[1:]]
    names, sources = (tuple(dict.fromkeys(row[k] for row in rows)) for k in (0, 1))
    cells = np.array([[float(cell) for cell in row[2:]] for row in rows])
    both = cells.reshape(len(names), len(sources), 2, 3).transpose(2, 1, 0, 3)
    return Budget(sources, both[0], both[1]), names
