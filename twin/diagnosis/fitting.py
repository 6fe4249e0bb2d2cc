"""A model, targets and the errors of both -> the parameters that fit, and the whitened residual's
derivatives."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrate import Fit, least_squares
from twin.diagnosis.whitening import Whitener, whitener
from twin.effects.baselaw import NAMES
from twin.model.discretisation import Discretisation, with_remainder
from twin.model.prediction import Model, Unsolvable
from twin.targets import Array, Targets


def whitener_of(model: Model, theta: Array, targets: Targets, mesh: Discretisation | None) -> Whitener:
    """The whitener of the targets with the model's own modes at theta."""
    slope = model.per_pressure(theta) * targets.pressure_sd[:, None, None]
    modes = mesh.modes if mesh is not None else np.zeros((0, *targets.value.shape))
    return whitener(targets, prediction_modes=modes, gauge=slope)


def measured_remainder(model: Model, theta: Array, targets: Targets, mesh: Discretisation) -> Discretisation:
    """The discretisation modes beside the fitted parameters, and their remainder as small smooth modes.

    What a mode shares with the parameters of the base model is taken out of it and kept as `spread`: a coarse
    mesh is mostly too stiff, which the fitted constants take up. The remainder (rms in mm) is what the check
    mesh shows that neither the modes but the finest, nor the targets' own modes, nor the fitted parameters
    carry: leaving one out tells what a next refinement would still bring.
    """
    jacobian = model.jacobian(theta)
    mesh = _beside(mesh, jacobian)
    fewer = replace(mesh, modes=mesh.modes[:-1], names=mesh.names[:-1])
    w = whitener_of(model, theta, targets, fewer)
    change = np.linalg.lstsq(w.whiten(jacobian).T, w.whiten(mesh.check), rcond=1e-12)[0]
    size = w.rms(mesh.check - np.tensordot(change, jacobian, 1), gauge=True)
    return with_remainder(mesh, size, model.solution(theta).pressure, model.test.moving, model.reference)


def _beside(mesh: Discretisation, jacobian: Array) -> Discretisation:
    """The modes without their projection on the derivatives (d, s, p, 3), which goes into `spread` (q, d)."""
    rows = jacobian.reshape(len(jacobian), -1)
    found = np.linalg.lstsq(rows.T, mesh.modes.reshape(len(mesh.modes), -1).T, rcond=1e-10)[0]
    spread = np.asarray(found.T, float)
    return replace(mesh, modes=mesh.modes - np.tensordot(spread, jacobian, 1), spread=spread)


def with_mesh(fit: Fit, mesh: Discretisation | None) -> Fit:
    """The fit with the mesh's part in the covariance of C10 and C01, which no residual shows."""
    if mesh is None or mesh.spread is None:
        return fit
    covariance = fit.covariance.copy()
    names = [p.name for p in fit.parameters]
    own = [k for k, name in enumerate(names) if name in NAMES and name not in fit.at_bound]
    if len(own) == mesh.spread.shape[1]:
        covariance[np.ix_(own, own)] += mesh.spread.T @ mesh.spread
    return replace(fit, covariance=covariance)


def refitted(
    model: Model, targets: Targets, mesh: Discretisation | None, *, start: Array, seed: int = 0
) -> tuple[Fit, Whitener]:
    """The fit of a model from a start (d,) near it, with the mesh's part in its covariance, and its whitener.

    The errors of gauge and mesh depend on the parameters, so they are those at the start: under the errors of
    the base model the demo's C10 ends at 0.227 instead of 0.234 MPa. mesh: the discretisation error there.
    """
    w = whitener_of(model, start, targets, mesh)
    return with_mesh(fit_model(model, targets, w, start=start, seed=seed), mesh), w


def fit_model(
    model: Model,
    targets: Targets,
    w: Whitener,
    *,
    start: Array | Sequence[Array],
    seed: int = 0,
    evaluations: int = 25,
    tolerance: float = 0.1,
) -> Fit:
    """The bounded least-squares fit of all of a model's parameters, from one or several starts (m, d).

    tolerance: of the parameters, in sds; no interval of 2 sds shows a tenth. Every evaluation is a solve with
    its derivatives, none is taken along those of a neighbour: the fit does not depend on what was solved
    before.
    """

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
        residual, jacobian, model.parameters, start=start, seed=seed, max_evaluations=evaluations,
        tolerance=tolerance, renew=True,
    )  # fmt: skip
