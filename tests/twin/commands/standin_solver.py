"""A solver that answers at once: displacements linear in the pressure and in every number of case and path."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any
from zlib import crc32

import numpy as np

from fe import Case, Path, Variation
from twin.targets import Array

SOME = 100  # numbers of an array that count
LITTLE = 1e-3  # of the pressure's own part is what another number does


@cache
def weights(key: str, size: int) -> Array:
    """Numbers (size,) that belong to a key, of sum of squares 1."""
    found = np.random.default_rng(crc32(key.encode())).standard_normal(size)
    return np.asarray(found / np.linalg.norm(found))


def numbers(thing: Any, key: str) -> Iterator[tuple[str, Array]]:
    """Every array of real numbers in a record, with a key of its own; 0 adds nothing."""
    if is_dataclass(thing):
        for part in fields(thing):
            yield from numbers(getattr(thing, part.name), f"{key}.{part.name}")
    elif isinstance(thing, Mapping):
        for name, part in thing.items():
            yield from numbers(part, f"{key}.{name}")
    elif isinstance(thing, tuple):
        for k, part in enumerate(thing):
            yield from numbers(part, f"{key}.{k}")
    elif isinstance(thing, float) or (isinstance(thing, np.ndarray) and thing.dtype.kind == "f" and thing.size):
        every = np.ravel(thing)
        yield key, every[:: len(every) // SOME + 1]


def response(case: Case, path: Path, points: Array) -> Array:
    """Displacements (s, p, 3) mm at undeformed points (p, 3) mm."""
    p = np.interp(path.output, path.time, path.pressure) / 0.02
    x = points[:, 0] / 50
    own = sum(m.shear for m in case.materials.values()) / len(case.materials)
    shape = 0.6 / own * np.stack([-0.3 * x**2, 0 * x, -2 * x**2], axis=1)
    for key, values in (*numbers(case, "case"), *numbers((path.pressure, path.stiffness), "path")):
        size = float(weights(key, len(values)) @ np.clip(values, -1e3, 1e3))
        shape = shape + LITTLE * size * np.outer(np.sin(3 * x + weights(key, 5)[0]), [0.3, 0.1, 1.0])
    return np.asarray(p[:, None, None] * shape)


@dataclass(frozen=True)
class Answer:
    """What `solve` gives, as far as `twin` asks for it."""

    case: Case
    path: Path
    variations: Sequence[Variation]
    converged: bool = True
    reason: str = "converged"
    crossed: str = ""
    history: None = None

    def at(self, points: Array) -> Array:
        return response(self.case, self.path, points)

    def variations_at(self, points: Array) -> Array:
        rows = [
            (response(*v.plus, points) - response(*v.minus, points)) / (2 * v.step) for v in self.variations
        ]
        return np.reshape(rows, (len(rows), len(self.path.output), len(points), 3))

    def per_pressure(self, points: Array) -> Array:
        return 50 * np.ones((len(self.path.output), 1, 1)) * response(self.case, self.path, points)[-1:]

    def fields(self, steps: Sequence[int]) -> Array:
        return self.at(self.case.nodes)[list(steps)]

    def ahead(self, change: Array) -> "Answer":
        return self


def solve(
    case: Case, path: Path, *, start: object = None, variations: Sequence[Variation] = (), count: int = 1
) -> Answer:
    """The answer, at once."""
    return Answer(case, path, variations)
