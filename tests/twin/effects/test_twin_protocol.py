"""What an effect may declare: names that do not exist are refused where its class is defined."""

import os
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import twin
from tests.messages import saying
from twin.effects.library import all_effects
from twin.effects.protocol import Effect, Family, Order
from twin.effects.requirements import MEANING, Requirement, lacking
from twin.targets import Targets


def test_an_unknown_requirement_is_an_error_at_definition() -> None:
    with pytest.raises(ValueError, match=saying("'ageing'", "'films'", "'history'", "'unloading'")):

        class Ageing(Effect):
            name, requires = "ageing", ("films",)  # type: ignore[assignment]


def test_an_order_without_a_name_is_an_error_at_definition() -> None:
    with pytest.raises(ValueError, match=saying("'ageing'", "order = 12", r"Order\.LAW", r"Order\.GEOMETRY")):

        class Ageing(Effect):
            name, order = "ageing", 12  # type: ignore[assignment]


def test_a_name_that_no_label_can_hold_is_an_error_at_definition() -> None:
    with pytest.raises(ValueError, match="effect 'Old:2': wanted a name of small letters"):

        class Ageing(Effect):
            name = "Old:2"


def test_a_requirement_may_be_written_as_its_word() -> None:
    class Ageing(Effect):
        name, requires = "ageing", ("history",)  # type: ignore[assignment]

    assert Ageing.requires == (Requirement.HISTORY,)


def test_every_requirement_has_a_meaning(make_targets: Callable[..., Targets]) -> None:
    assert set(MEANING) == set(Requirement)
    t = make_targets(gravity=np.array([[0.0, 0.0, -1.0]]))
    poor = make_targets(log_time=t.time, log_pressure=t.pressure)
    rising = make_targets(log_pressure=np.maximum.accumulate(t.log_pressure))
    assert "16 frames a second" in lacking((Requirement.FAST,), t)  # a film that has it: test_twin_inertia
    slow = [r for r in Requirement if r is not Requirement.FAST]
    for requirement, without in zip(slow, (poor, rising, poor), strict=True):
        assert lacking((requirement,), t) == ""
        assert lacking((requirement,), without).startswith("not testable: needs ")
        others = [r for r in slow if r is not requirement]
        assert lacking(others, t) == lacking((), without) == ""


def test_a_family_has_the_laws_that_it_says() -> None:
    for e in all_effects():
        laws = e.laws()
        wider = [f"{e.name}:{k}" for k in range(2, len(laws) + 1)]
        wider = ["marker_standoff:one"] if e.name == "marker_standoff" else wider  # of one marker, not of all
        assert [law.label for law in laws] == [e.name, *wider]
        for narrow, wide in pairwise(laws):
            assert {p.name for p in narrow.parameters} < {p.name for p in wide.parameters}
        if isinstance(e, Family):
            most = len(laws)
            why = f"effect '{e.name}' has no law with {most + 1} terms, wanted 1 to {most}"
            with pytest.raises(ValueError, match=why):
                type(e)(most + 1)


def test_orders_come_as_they_act() -> None:
    assert [o.name for o in sorted(Order)] == [o.name for o in Order]


def test_the_names_that_twin_exports_are_there_and_cost_nothing_until_used() -> None:
    assert {name: getattr(twin, name).__name__ for name in twin.__all__} == {name: name for name in twin.__all__}
    assert set(twin.__all__) <= set(dir(twin))
    with pytest.raises(AttributeError, match=saying("'twin'", "'effect'")):
        twin.effect  # noqa: B018
    code = "import sys, twin; print(sorted({'numpy', 'fe', 'calibrate'} & set(sys.modules)))"
    environment = {**os.environ, "PYTHONPATH": str(Path(twin.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
