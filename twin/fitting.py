"""A model, targets and the errors of both -> the parameters that fit, and the whitened residual's
derivatives."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrate import Fit, least_squares
from twin.discretisation import Discretisation, with_remainder
from twin.model import Model, Unsolvable
from twin.targets import Array, Targets
from twin.whitening import Whitener, whitener


def whitener_of(model: Model, theta: Array, targets: Targets, mesh: Discretisation | None) -> Whitener:
    """The whitener of the targets with the model's own modes at theta."""
    slope = model.per_pressure(theta) * targets.pressure_sd[:, None, None]
    modes = mesh.modes if mesh is not None else np.zeros((0, *targets.value.shape))
    return whitener(targets, prediction_modes=modes, gauge=slope)


def measured_remainder(model: Model, theta: Array, targets: Targets, mesh: Discretisation) -> Discretisation:
    """The discretisation modes with their remainder, as small smooth modes.

    The remainder (rms in mm) is what the check mesh shows that neither the modes but the finest, nor the
    targets' own
    modes, nor the fitted parameters carry: leaving one out tells what a next refinement would still bring.
    """
    fewer = replace(mesh, modes=mesh.modes[:-1], names=mesh.names[:-1])
    w, jacobian = whitener_of(model, theta, targets, fewer), model.jacobian(theta)
    change = np.linalg.lstsq(w.whiten(jacobian).T, w.whiten(mesh.check), rcond=1e-12)[0]
    size = w.rms(mesh.check - np.tensordot(change, jacobian, 1), gauge=True)
    return with_remainder(mesh, size, model.solution(theta).pressure, model.test.moving, model.reference)


def fit_model(
    model: Model,
    targets: Targets,
    w: Whitener,
    *,
    start: Array | Sequence[Array],
    seed: int = 0,
    evaluations: int = 25,
) -> Fit:
    """The bounded least-squares fit of all of a model's parameters, from one or several starts (m, d)."""

    def residual(theta: Array) -> Array | None:
        try:
            return w.whiten(targets.value - model.predict(theta))
        except Unsolvable:
            return None

    def jacobian(theta: Array) -> Array:
        try:
            return -w.whiten(model.jacobian(theta)).T
        except Unsolvable:
            return np.full((targets.valid.shape[0] * len(w.components), len(theta)), np.nan)

    return least_squares(
        residual, jacobian, model.parameters, start=start, seed=seed, max_evaluations=evaluations
    )
