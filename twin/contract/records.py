"""Records of numbers: whether two hold the same, and the numbers in one."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from twin.targets import Array


def alike(a: Any, b: Any) -> bool:
    """Whether two records, mappings, sequences or arrays hold the same to the last bit."""
    if is_dataclass(a):
        return type(a) is type(b) and all(alike(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, Mapping):
        return a.keys() == b.keys() and all(alike(a[k], b[k]) for k in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(a == b)


def numbers(a: Any) -> Iterator[Array]:
    """Every number in a record, as arrays."""
    if is_dataclass(a):
        yield from (x for f in fields(a) for x in numbers(getattr(a, f.name)))
    elif isinstance(a, Mapping):
        yield from (x for value in a.values() for x in numbers(value))
    elif isinstance(a, tuple | list):
        yield from (x for value in a for x in numbers(value))
    elif isinstance(a, float) or (isinstance(a, np.ndarray) and a.dtype.kind == "f"):
        yield np.asarray(a)
