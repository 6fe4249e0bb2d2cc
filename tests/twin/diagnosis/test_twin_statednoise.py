"""A verdict that rests on a noise that was stated, or estimated, says so."""

from dataclasses import replace

import numpy as np

from tests.twin.diagnosis.toy import Toy, smooth_field, targets, toy_effect
from twin.diagnosis.procedure import diagnose
from twin.judging.stillnoise import stated_noise


def test_the_verdict_says_which_noise_it_rests_on() -> None:
    base, field = smooth_field(1), smooth_field(10)
    t = targets(1.3 * base[0] + 0.2 * field[0], seed=0)
    model, effects = Toy({"base": base, "alpha": field}), (toy_effect("alpha"),)

    def said(noise: object) -> str:
        found = diagnose(model, effects, replace(t, noise=noise), seed=0, start=np.array([1.0]), beside=(), plan=False)  # type: ignore[arg-type]
        return f"{found.verdict}: {found.sentence}"

    stated = stated_noise(t.value, 0.01)
    assert said(t.noise).startswith("alpha: Probably alpha is missing.")
    assert "noise is taken" not in said(t.noise)
    assert said(stated).startswith("alpha: Probably alpha is missing.")
    assert said(stated).endswith(f" {stated.basis}")
    assert said(None).startswith("cannot test: no noise model")
