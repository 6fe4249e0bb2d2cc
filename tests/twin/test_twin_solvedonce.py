"""The answers that tests of `twin` share are those of the same problem, and of no other."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import fe.path
from fe import Case, Path, Solution, Variation, solve
from tests.twin import solvedonce
from tests.twin.solvedonce import SolvedOnce
from twin.model import prediction

TIME = np.array([0.0, 1.0, 2.0])
PATH = Path(TIME, np.array([0.0, 0.01, 0.01]), TIME)


def test_only_the_same_problem_has_the_same_answer(coarsest_case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def standin(case: Case, path: Path, *, start: Solution | None = None, **how: Any) -> Solution:
        asked.append((case, path))
        return Solution(
            case=case, path=path, curves=(), number=np.zeros(0, np.int64), pressure=np.array([float(len(asked))]),
            slopes=np.zeros(0), history=None, iterations=1, reason="converged",
        )  # fmt: skip

    once, case = SolvedOnce(standin), coarsest_case
    stiffer = case.with_material(C10=np.nextafter(case.materials["body"].C10, 1.0))
    changes = [Variation((stiffer, PATH), (case, PATH), h) for h in (0.1, 0.2)]
    first = once(case, PATH)
    others = [
        once(stiffer, PATH), once(case, replace(PATH, pressure=PATH.pressure * 1.0000001)), once(case, PATH, count=6),
        once(case, PATH, variations=changes[:1]), once(case, PATH, variations=changes[1:]),
        once(case, PATH, start=first), once(case, PATH, start=replace(first, iterations=2)),
    ]  # fmt: skip
    assert len(asked) == 1 + len(others)
    assert once(case.with_material(), replace(PATH)) is first
    assert once(case, PATH, start=first) is others[-2]
    assert len(asked) == 1 + len(others)
    monkeypatch.setattr(fe.path, "SOFT_RAMP", 4)
    assert once(case, PATH) is not first
    monkeypatch.setattr(solvedonce, "SIZE", 1)
    assert once(stiffer, PATH) is not others[0]
    assert len(asked) == 3 + len(others)


@pytest.mark.usefixtures("solved_once")
def test_what_is_shared_is_what_a_solve_of_its_own_gives(coarsest_case: Case) -> None:
    where = coarsest_case.position(4401)[None]
    shared, own = prediction.solve(coarsest_case, PATH), solve(coarsest_case, PATH)
    assert shared is prediction.solve(coarsest_case, PATH)
    assert shared is not own
    np.testing.assert_array_equal(shared.at(where), own.at(where))
