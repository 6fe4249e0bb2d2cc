"""Solves that tests of a file ask for again are made once: the same problem has the same answer, bit by bit."""

import hashlib
import pickle
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import fe.path
from fe import Case, Path, Solution

SIZE = 40  # solutions that are kept: up to 30 MB each, with derivatives


class SolvedOnce:
    """`fe.solve`, which keeps its newest answers. Problems differ as soon as a bit of them does, or a setting
    of `fe` that a test changes; what cannot be told apart is solved."""

    def __init__(self, solve: Callable[..., Solution]) -> None:
        self.solve = solve
        self.kept: OrderedDict[bytes, Solution] = OrderedDict()

    def __call__(self, case: Case, path: Path, *, start: Solution | None = None, **how: Any) -> Solution:
        begin = None if start is None else [getattr(start, f.name) for f in fields(start) if f.name[0] != "_"]
        try:
            said = pickle.dumps((case, path, begin, sorted(how.items()), fe.path.SOFT_RAMP))
        except (AttributeError, TypeError, pickle.PicklingError):
            return self.solve(case, path, start=start, **how)
        key = hashlib.sha256(said).digest()
        if key not in self.kept:
            self.kept[key] = self.solve(case, path, start=start, **how)
        self.kept.move_to_end(key)
        if len(self.kept) > SIZE:
            self.kept.popitem(last=False)
        return self.kept[key]
