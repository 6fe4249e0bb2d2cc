"""Uncertain parameters and modes of a prediction, and their posterior by the film.

Parameters, the error of the mesh, and the laws' errors as far as the data have asked for them are uncertain
together. The film tells their best values and what it leaves open (a linear model with normal priors;
Rasmussen & Williams 2006, section 2.1): where it holds a displacement, constants and mesh err against each
other.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.diagnosis.signatures import prior_sd
from twin.effects.library import effect
from twin.judging.fitrecord import FitRecord
from twin.judging.lawerrors import law_errors
from twin.judging.likelihood import priors_of, without_gross
from twin.judging.materialcurves import curve_jacobian, curve_residual
from twin.judging.whitening import whitener
from twin.model.prediction import Model
from twin.targets import Array, Targets

LEAST_LAW = 0.03  # of what an effect adds is what its law may err by where nobody has looked, 1 sd
LAW = "stiffening"  # what a silicone may do beyond the pressures of the film


@dataclass(frozen=True)
class Uncertain:
    """Changes of a prediction: columns (k, s, p, 3) mm per unit, and the precision (k,) that each has without
    the film: of a fitted parameter that of its bounds, which counts where the film does not show it, 1 of a
    mode. stated: what the priors of twin.toml say of them, as a residual (m,) and its derivatives (m, k)."""

    columns: Array
    prior: Array
    stated: tuple[Array, Array] = (np.zeros(0), np.zeros((0, 0)))
    free: NDArray[np.bool_] | None = None  # (d,) of the model's parameters, those whose columns come first

    @staticmethod
    def of(
        model: Model,
        theta: Array,
        record: FitRecord,
        targets: Targets,
        *,
        beyond: bool,
    ) -> "Uncertain":
        """Columns of a model at theta (d,) for targets with the steps to be predicted: the free parameters
        first, in their order. beyond: whether some of that lies above the tested pressure."""
        free = np.array([p.name not in record.at_bound for p in model.parameters])
        width = np.array([p.high - p.low for p in model.parameters])[free]
        columns, prior = [model.jacobian(theta)[free]], [12 / width**2]  # an even spread over them
        modes = [model.modes(theta)]
        share = max(record.law_error, LEAST_LAW)
        modes += [share * prior_term.modes for prior_term in law_errors(model, theta, targets)]
        for mode_block in modes:
            columns.append(mode_block)
            prior.append(np.ones(len(mode_block)))
        if beyond and LAW not in [e.name for e in model.effects]:
            law = effect(LAW, users=()) if model.law is None else effect(LAW, law=model.law)
            columns.append(model.tangents(theta, [law])[LAW][0])
            prior.append(np.array([1 / prior_sd(p) ** 2 for p in law.amplitudes]))
        priors, count = priors_of(model.parameters, targets), sum(map(len, columns))
        rows = np.zeros((len(priors), count))
        for row, prior_term in zip(rows, priors, strict=True):
            row[: sum(free)] = prior_term.slope(theta)[free]
        prior_residual = np.array([prior_term.value(theta) for prior_term in priors]), rows
        return Uncertain(np.concatenate(columns), np.concatenate(prior), prior_residual, free)


def told_by_film(
    targets: Targets, model: Model, theta: Array, uncertain: Uncertain
) -> tuple[Array, Array]:
    """Change (s, p, 3) mm of a prediction by the film's residual, and the errors (k, s, p, 3) mm that remain.

    The change comes from mesh and laws above all. The errors are independent, 1 sd each.
    """
    amounts, axes = amounts_told(targets, model, theta, uncertain)
    columns = uncertain.columns
    return np.asarray(np.tensordot(amounts, columns, 1)), np.asarray(np.tensordot(axes.T, columns, 1))


def amounts_told(
    targets: Targets, model: Model, theta: Array, uncertain: Uncertain
) -> tuple[Array, Array]:
    """The amounts (k,) of the uncertain's columns that the film's residual asks for, and what it leaves open:
    independent errors of 1 sd, each a column of amounts (k, k)."""
    columns, prior = uncertain.columns, uncertain.prior
    s, p = targets.valid.shape[:2]
    nothing = np.zeros((0, *targets.value.shape))
    gauge = model.per_pressure(theta)[:s, :p] * targets.pressure_error[:, None, None]
    w = whitener(targets, prediction_modes=nothing, gauge=gauge, points=~targets.fixed)
    residual = targets.value - model.predict(theta)[:s, :p]
    if (trimmed := without_gross(targets, residual, w)) is not targets:
        w = whitener(trimmed, prediction_modes=nothing, gauge=gauge, points=~targets.fixed)
    seen, z = w.whiten(columns[:, :s, :p]).T, w.whiten(residual)
    if len(uncertain.stated[0]):
        prior_residual, rows = uncertain.stated
        seen, z = np.vstack([seen, rows]), np.append(z, -prior_residual)
    if targets.curves:  # of the silicone, which know no more than the parameters
        slopes = -curve_jacobian(model, targets, theta)[:, uncertain.free]
        beside = np.zeros((len(slopes), len(columns) - slopes.shape[1]))
        seen = np.concatenate([seen, np.hstack([slopes, beside])])
        z = np.concatenate([z, curve_residual(model, targets, theta)])
    scale = 1 / np.sqrt((seen**2).sum(axis=0) + prior)
    information = (seen * scale).T @ (seen * scale) + np.diag(prior * scale**2)
    power, turn = np.linalg.eigh(information)
    axes = scale[:, None] * turn / np.sqrt(power)
    return axes @ (axes.T @ (seen.T @ z)), axes
