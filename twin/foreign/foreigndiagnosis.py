"""Data and a simulator -> the physical effect that the simulator lacks."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twin.diagnosis import procedure
from twin.diagnosis.deciding import Diagnosis
from twin.effects.protocol import Effect, Unsolvable
from twin.foreign.courseeffects import candidates, plain_stand_ins
from twin.foreign.foreignmodel import WIDER, ForeignModel
from twin.foreign.likebody import like_body_effects
from twin.foreign.programs import Simulator, nominal
from twin.foreign.slowruns import watched
from twin.foreign.wantedruns import wanted_run
from twin.judging.fitting import fit_unweighted
from twin.judging.judged import Judged
from twin.messages import Say, Silent
from twin.targets import Array, Targets


def diagnosed(
    simulator: Simulator, data: Targets, *, effects: Sequence[Effect], seed: int, stand_ins: bool,
    say: Say | None, like: Judged | None = None,
) -> Diagnosis:
    """The diagnosis of a simulator, fitted to data from the start of each parameter, or the middle of its
    bounds; its next test is the run that is wanted of it.

    effects: candidates, by default all that it can have, and with a fit of a body `like` it those inside the
    structure by their shape there. say: None tells on stderr how far a slow simulator
    is, and nothing else. ValueError where it fails at its start or everywhere beside it, or scatters by more
    than the noise.
    """
    simulator = watched(simulator, say)
    model, start = ForeignModel.of(simulator, data), nominal(simulator.parameters)
    try:
        scatter = simulator.scatter(start | simulator.absent, model.stated, len(data.points))
    except Unsolvable as error:
        raise ValueError(f"{error}; wanted a start at which it answers: Parameter(..., start=...)") from None
    if scatter:
        data, model = rougher(data, scatter), ForeignModel.of(simulator, data, wider=WIDER)
    begin, told = model.theta(start), ""
    every = tuple(effects) or candidates(model.test, simulator.variants)
    if like is not None:
        every += like_body_effects(like, data, every)
    generic = plain_stand_ins(model.test) if stand_ins else ()
    try:
        if simulator.finer is not None:
            begin = fit_unweighted(model, data, start=begin, seed=seed).theta
            data = with_discretisation(data, model, begin, simulator.finer)
            most = float(np.linalg.norm(data.modes[-1], axis=2).max())
            told = (
                f"A finer run moves the points by up to {most:.2g} mm: an error that all values share has "
                "that for its sd."
            )
        found = procedure.diagnose(
            model, every, data, seed=seed, start=begin, beside=generic, plan=False,
            progress=(Silent() if say is None else say).progress,
        )  # fmt: skip
    except Unsolvable as error:
        wanted = "wanted bounds of its parameters within which it answers"
        raise ValueError(f"{error}, and so it does beside that; {wanted}") from None
    said = " ".join(filter(None, [found.sentence, told]))
    return replace(found, next_test=wanted_run(found), sentence=said)


def with_discretisation(
    data: Targets, model: ForeignModel, theta: Array, finer: Callable[..., Any]
) -> Targets:
    """Data with an error that all values share: what a finer run of the program of a model changes at theta
    (d,), 1 sd of it."""
    other = replace(model.simulator, predict=finer, finer=None, keep=None, runs={})
    change = replace(model, simulator=other).predict(theta) - model.predict(theta)
    names = (*data.mode_names, "discretisation:finer")
    return replace(data, modes=np.concatenate([data.modes, change[None]]), mode_names=names)


def rougher(data: Targets, scatter: float) -> Targets:
    """Data whose noise holds the scatter of a simulator in mm too, each value by itself. ValueError where
    that is larger than the noise."""
    noise = data.noise
    if noise is None:
        return data
    least = float(np.nanmin(noise.sd))
    if scatter > least:
        raise ValueError(
            f"the simulator's answers scatter by {scatter:.3g} mm, more than the noise of the data "
            f"({least:.3g} mm); wanted less: a finer tolerance, the mean of several runs, or more runs"
        )
    return replace(
        data, covariance=data.covariance + scatter**2 * np.eye(3),
        noise=replace(noise, sd=np.sqrt(noise.sd**2 + scatter**2)),
    )  # fmt: skip
