"""Truths on other meshes than the model's: what its correction leaves, and intervals of the constants."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe import Case, Finger, Path
from twin import virtual
from twin.judging.fitting import ModelErrors
from twin.judging.judged import judge
from twin.laws.mooneyrivlin import mooney_rivlin
from twin.model.prediction import Model
from twin.targets import Array, Targets


@dataclass(frozen=True)
class Row:
    """Errors of all markers and axes against the truth in mm, rms, and pulls.

    before_mm: of the plain mesh with the truth's own constants; corrected_mm: with the measured change.
    parameters: error of the fitted C10 + C01 over its sd. modes: amplitudes in sds; left_sd: what all modes
    leave over the noise of one value.
    """

    before_mm: float
    corrected_mm: float
    parameters: float
    modes: tuple[float, ...]
    left_sd: float


def drawn(
    points: Array, nodes: Array, u: Array, slope: Array, course: Path, bench: virtual.Bench, seed: int
) -> Targets:
    """One draw of what would be measured of true displacements u (s, p, 3) mm of markers at nodes (p,)."""
    names = (*(f"p{k}" for k in range(len(points) - 1)), "tip")
    at = virtual.at_nodes(names, nodes, points)
    return virtual.noisy_targets(u, slope, course, points=at, bench=bench, seed=seed)


def exact(film: Targets, u: Array) -> Targets:
    """The targets of a film with the true displacements u (s, p, 3) mm in place of what was measured."""
    value = np.where(film.valid, 0.0, np.nan)
    value[:, : u.shape[1]] += u - u[film.reference].mean(axis=0)
    return replace(film, value=value)


def judged(model: Model, targets: Targets, *, theta: Array) -> Row:
    """The pulls of a model on its mesh in targets without noise, whose truth has the constants theta (2,)."""
    found = judge(model, targets, starts=theta)
    error, w = targets.value - found.predicted, found.whitener
    first, modes, moving = len(targets.mode_names), model.modes(found.theta), ~targets.fixed
    one = np.ones(2)
    return Row(
        before_mm=_rms((targets.value - model.on_mesh(None).predict(theta))[:, moving]),
        corrected_mm=_rms((targets.value - model.predict(theta))[:, moving]),
        parameters=float((found.theta - theta).sum() / np.sqrt(one @ found.fit.covariance @ one)),
        modes=tuple(w.amplitudes(error)[first : first + len(modes)].tolist()),
        left_sd=w.rms(error, gauge=True) / w.noise_sd,
    )


def markers(finger: Finger, case: Case) -> tuple[Array, Array]:
    """Places (p, 3) mm and node labels (p,) of markers on the flat lower edge of the side, the tip last."""
    bellow = (finger.length - finger.base_cap - finger.tip_cap) / finger.bellows
    x = finger.base_cap + bellow * np.linspace(0.5, finger.bellows - 0.5, 6)
    x = np.append(x, finger.length)
    wanted = np.stack([x, np.full_like(x, finger.width / 2), np.zeros_like(x)], axis=1)
    rows = np.linalg.norm(case.nodes[:, None] - wanted, axis=2).argmin(axis=0)
    return case.nodes[rows], case.labels[rows]


def _rms(x: Array) -> float:
    return float(np.sqrt(np.nanmean(np.square(x))))


@dataclass(frozen=True)
class Estimates:
    """Parameters (d,) of one draw with their covariance (d, d)."""

    theta: Array
    covariance: Array


def linear(model: Model, theta: Array, errors: ModelErrors, targets: Targets) -> Estimates:
    """The estimates of a draw by one linear step from theta (d,), with the noise model of its own."""
    w = errors.whitener(targets)
    A = w.whiten(model.jacobian(theta)).T
    covariance = np.asarray(np.linalg.inv(A.T @ A), float)
    z = w.whiten(targets.value - model.predict(theta))
    return Estimates(theta + covariance @ (A.T @ z), covariance)


def pull(name: str, found: Estimates, true: Array, names: Sequence[str]) -> float:
    """The error of a parameter, or of the sum or share of the constants, over its sd."""
    value, sd = _of(name, found, names)
    return (value - _of(name, Estimates(true, np.eye(len(true))), names)[0]) / sd


def _of(name: str, found: Estimates, names: Sequence[str]) -> tuple[float, float]:
    """A parameter, or the sum or share of the constants, with its sd to first order."""
    gradient, constants = np.zeros(len(names)), mooney_rivlin(*found.theta[:2])
    if name == "sum":
        gradient[:2], value = 1.0, constants.scale
    elif name == "share":
        gradient[:2] = np.array([-constants["C01"], constants["C10"]]) / constants.scale**2
        value = constants["C01"] / constants.scale
    else:
        k = list(names).index(name)
        gradient[k], value = 1.0, float(found.theta[k])
    return value, float(np.sqrt(gradient @ found.covariance @ gradient))
