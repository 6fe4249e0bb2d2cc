"""Which error the report calls that of the model before."""

from types import SimpleNamespace

import pytest

from twin.report.story import Story


@pytest.mark.parametrize(
    ("effects", "named", "wanted"),
    [
        ((), ("creep",), (0.4, 0.2)),  # diagnosed, and nothing added yet
        (("creep",), ("creep",), (0.4, 0.2)),  # added after the diagnosis, which saw the model without it
        (("creep",), (), (0.5, 0.3)),  # kept of a former batch: the diagnosis saw the model with it
    ],
)
def test_the_error_before_is_that_of_the_model_without_effects(
    effects: tuple[str, ...], named: tuple[str, ...], wanted: tuple[float, float]
) -> None:
    story = SimpleNamespace(
        fit=SimpleNamespace(effects=effects),
        start=SimpleNamespace(raw_rms_mm=0.5, rms_mm=0.3),
        diagnosis=SimpleNamespace(named=named, raw_rms_before_mm=0.4, rms_before_mm=0.2),
    )
    assert Story.unmended.fget(story) == wanted  # type: ignore[attr-defined]
