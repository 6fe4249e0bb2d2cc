"""A model, targets and the errors of both -> the parameters that fit, and the whitened residual's
derivatives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibrate import Fit, least_squares
from calibrate.fit import Jacobian, Residual
from twin.judging.lawerrors import LawError, law_errors
from twin.judging.likelihood import posed, whitening
from twin.judging.materialcurves import beside_film
from twin.judging.whitening import LAW, MESH_MODE, Whitener, whitener
from twin.model.discretisation import WALL
from twin.model.prediction import Model, Unsolvable
from twin.targets import Array, Targets

MESH = 0.1  # of the noise, up to which an error of the mesh that nothing carries is left out


@dataclass(frozen=True, kw_only=True)
class ModelErrors:
    """The errors of a model at its parameters: gauge (s, p, 3) mm, what 1 sd of the gauge's noise does to
    each step; modes (q, s, p, 3) mm of its mesh and walls, 1 sd each, with their names (q,); laws, what its
    effects' laws may be off, by the share `law`."""

    gauge: Array
    modes: Array
    names: tuple[str, ...] = ()
    laws: tuple[LawError, ...] = ()
    law: float = 0.0

    @staticmethod
    def of(model: Model, theta: Array, targets: Targets, *, law: float = 0.0) -> "ModelErrors":
        """The errors of a model at theta (d,); law: by which share of what they add its laws err, 1 sd."""
        laws = law_errors(model, theta, targets) if law else ()
        gauge = model.per_pressure(theta) * targets.pressure_error[:, None, None]
        modes = np.concatenate([model.modes(theta), _of_mesh(model, theta, targets, gauge)])
        names = [MESH_MODE] * len(modes)
        if model.mesh is not None:
            names[model.mesh.wall_modes] = [f"{WALL}{name}" for name in model.mesh.wall_names]
        return ModelErrors(
            gauge=gauge,
            modes=modes,
            names=tuple(names),
            laws=laws,
            law=law,
        )

    def whitener(self, targets: Targets) -> Whitener:
        """The whitener of what a model can move, the finger's points, with these errors."""
        w = whitener(
            targets, prediction_modes=self.modes, gauge=self.gauge, points=~targets.fixed, names=self.names
        )
        for error in self.laws:
            w = w.beside(self.law * error.modes, (f"{LAW}{error.effect}",) * len(error.modes))
        return w


def noise_of(targets: Targets, gauge: Array) -> float:
    """Root mean variance in mm of one value of the finger: its own and that of the gauge (s, p, 3) mm."""
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3) + gauge**2
    return float(np.sqrt(variance[targets.valid & ~targets.fixed[:, None]].mean()))


def unresolved(model: Model, noise: float) -> float:
    """The root mean square in mm of the mesh's error that neither correction nor modes carry; 0 where it is
    below MESH of the noise in mm."""
    remainder = model.mesh.remainder_mm if model.mesh is not None else 0.0
    return remainder if remainder > MESH * noise else 0.0


def _of_mesh(model: Model, theta: Array, targets: Targets, gauge: Array) -> Array:
    """Modes (q, s, p, 3) mm of that error, 1 sd each: of the motion, each direction on its own."""
    error = unresolved(model, noise_of(targets, gauge))
    if not error:
        return np.zeros((0, *gauge.shape))
    u = model.predict(theta)
    rms = np.sqrt((u[targets.valid & ~targets.fixed[:, None]] ** 2).mean())
    return error / rms * np.array([u * axis for axis in np.eye(3) if (u * axis).any()])


def whitener_of(model: Model, theta: Array, targets: Targets) -> Whitener:
    """The whitener of what a model can move, the finger's points, with the model's own errors at theta."""
    return ModelErrors.of(model, theta, targets).whitener(targets)


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
    residual, jacobian, information = whitened(model, targets, w)
    return least_squares(
        residual, jacobian, model.parameters, start=start, seed=seed, max_evaluations=evaluations,
        tolerance=tolerance, information=information,
    )  # fmt: skip


def fit_unweighted(
    model: Model, targets: Targets, *, start: Array | Sequence[Array], seed: int = 0, evaluations: int = 25
) -> Fit:
    """The bounded least-squares fit in which every value that fits use counts alike, from starts (m, d): its
    root mean square of measured - predicted is the smallest."""
    noise = noise_of(targets, np.zeros_like(targets.value))

    def scaled(field: Array) -> Array:
        return field[..., targets.used] / noise

    residual, jacobian = _mapped(model, targets, scaled, int(targets.used.sum()))
    return least_squares(
        residual, jacobian, model.parameters, start=start, seed=seed, max_evaluations=evaluations,
        tolerance=0.1,
    )  # fmt: skip


def whitened(
    model: Model, targets: Targets, w: Whitener
) -> tuple[Residual, Jacobian, Jacobian | None]:
    """The whitened residual (n,) of a model at theta (d,), None where a fit may not go, its derivatives (n,
    d), and the rows of its information where these are others: of the film as `posed` by the targets, and
    below it of the tests of the silicone itself."""
    values = targets.valid.shape[0] * len(w.components)
    mapped = _mapped(model, targets, whitening(targets, w), values)
    film = posed(*mapped, model.parameters, targets, w)
    return beside_film(*film, model=model, targets=targets) if targets.curves else film


def _mapped(
    model: Model, targets: Targets, mapped: Callable[[Array], Array], count: int
) -> tuple[Residual, Jacobian]:
    """The residual (n,) of a model at theta (d,), None where a fit may not go, and its derivatives (n, d),
    NaN there, by the linear map of fields (..., s, p, 3) mm to `count` values (..., n)."""

    def residual(theta: Array) -> Array | None:
        if not model.allowed(model.named(theta)):
            return None
        try:
            return mapped(targets.value - model.predict(theta))
        except Unsolvable:
            return None

    def jacobian(theta: Array) -> Array:
        try:
            return -mapped(model.jacobian(theta)).T
        except Unsolvable:
            return np.full((count, len(theta)), np.nan)

    return residual, jacobian
