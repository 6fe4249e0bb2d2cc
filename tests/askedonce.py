"""Answers that tests of a file ask for again and again are kept: the same question has the same answer."""

import copy
import hashlib
import pickle
from collections.abc import Callable
from typing import Any


def asked_once(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which answers a question that it was asked before with a copy of that answer. Questions
    differ as soon as a bit of them does."""
    kept: dict[bytes, Any] = {}

    def answer(*question: Any, **more: Any) -> Any:
        key = hashlib.sha256(pickle.dumps((question, sorted(more.items())))).digest()
        if key not in kept:
            kept[key] = function(*question, **more)
        return copy.deepcopy(kept[key])

    return answer
