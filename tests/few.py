"""Of many cases of one test, few run always."""

from collections.abc import Container, Iterable
from typing import Any

import pytest


def few(cases: Iterable[Any], always: Container[Any]) -> list[Any]:
    """The cases for `pytest.mark.parametrize`: those that are not in `always` are slow."""
    return [case if case in always else pytest.param(case, marks=pytest.mark.slow) for case in cases]
