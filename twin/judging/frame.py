"""Targets -> whether the fixed markers, which no model can move, stay within their noise.

They span the frame in which everything else is measured. What moves one of them, or the camera, is no physics
of the finger: it has a test and a sentence of its own.
"""

import numpy as np
from pydantic import Field

from calibrate import excess
from twin.judging.comparison import (
    ADEQUATE,
    BRANCHES,
    WHILE,
    branches,
    lack_of_fit,
    slow_shapes,
    smooth_functions,
)
from twin.judging.whitening import PLAUSIBLE, Whitener, whitener
from twin.records import Maybe, Record
from twin.targets import Array, Targets

IMMATERIAL = 0.3  # of the finger's noise sd: a misfit of the frame below it forbids no verdict
WINDOWS = 8  # even parts of the film in which a marker may sit elsewhere


class FrameTest(Record):
    """The fixed markers against no displacement: chi2 of `count` values, the probability of one as bad, and
    in words which marker moves, when and how much."""

    p_value: Maybe = Field(description="null where there is nothing to test")
    chi2: float
    count: int
    misfit: float = Field(description="rms beyond the noise, in sds of the finger's noise")
    moves: bool = Field(description="significant and not immaterial")
    sentence: str
    place: str = Field(default="", exclude=True)  # which marker moves most, by how much, where to and when


def frame_test(targets: Targets) -> FrameTest:
    """The test of the fixed markers, with all that is stated of their errors, but for a model's."""
    still = np.zeros_like(targets.value)
    w = whitener(targets, prediction_modes=still[None][:0], gauge=still, points=targets.fixed)
    if not w.count:
        return _untested("no fixed marker was measured")
    if targets.noise is None:
        return _untested("there is no noise model")
    z = w.whiten(targets.value)
    slow = smooth_functions(targets, w, np.concatenate([slow_shapes(targets), _windows(targets)]))
    if len(z) <= 2 * slow.shape[1]:
        return _untested(f"{w.count} values of fixed markers are too few")
    p = lack_of_fit(targets, w, z, np.zeros((len(z), 0)), slow)
    misfit = float(np.sqrt(max(excess(z, slow), 0.0) / w.count)) * w.noise_sd / _noise_of_finger(targets, w)
    moves, place = p <= ADEQUATE and misfit >= IMMATERIAL, "" if p > ADEQUATE else _place(targets, w)
    return FrameTest(
        p_value=p,
        chi2=float(z @ z),
        count=w.count,
        misfit=misfit,
        moves=moves,
        sentence=_sentence(w, place, moves=moves),
        place=place,
    )


def _noise_of_finger(targets: Targets, w: Whitener) -> float:
    """Root mean variance in mm of the finger's own markers, of the fixed ones where there are none."""
    variance = np.diagonal(targets.covariance, axis1=2, axis2=3)[targets.used]
    return float(np.sqrt(variance.mean())) if variance.size else w.noise_sd


def _untested(why: str) -> FrameTest:
    words = f"Whether the frame moves cannot be tested: {why}."
    return FrameTest(p_value=None, chi2=0.0, count=0, misfit=0.0, moves=False, sentence=words)


def _windows(targets: Targets) -> Array:
    """Indicators (WINDOWS, s) of the even parts of the film."""
    edges = np.linspace(targets.time[0], targets.time[-1], WINDOWS + 1)
    part = np.clip(np.searchsorted(edges, targets.time, side="right") - 1, 0, WINDOWS - 1)
    return np.asarray(part == np.arange(WINDOWS)[:, None], float)


def _sentence(w: Whitener, place: str, *, moves: bool) -> str:
    """The verdict on the frame with the marker that moves, in words."""
    noise = f"{w.noise_sd:.4f} mm"
    if not place:
        return f"The fixed markers stay in place within their noise of {noise}."
    if not moves:
        return (
            f"The fixed markers move by a little more than their noise of {noise}: {place}. That is too "
            "little to change a verdict."
        )
    return (
        f"The frame moves: {place}; the noise is {noise}. Every displacement is measured against the fixed "
        "markers. Fasten markers and camera and film again, or leave this marker out."
    )


def _place(targets: Targets, w: Whitener) -> str:
    """The marker that moves most beyond its noise, with distance, direction and time, in words."""
    cleaned, windows = w.cleaned(targets.value, bound=PLAUSIBLE), _windows(targets) > 0
    seen = [np.isfinite(cleaned[rows]) for rows in windows]
    count = np.array([flags.sum(axis=0) for flags in seen])  # (WINDOWS, m)
    total = np.array([np.nan_to_num(cleaned[rows]).sum(axis=0) for rows in windows])
    mean = total / np.maximum(count, 1)
    sd = np.sqrt((w.sd**2).mean(axis=0))
    component = int(np.argmax((count * (mean / sd) ** 2).sum(axis=0)))
    part = int(np.argmax(np.abs(mean[:, component])))
    point, axis = w.components[component]
    time = targets.time[windows[part]]
    branch = branches(targets.time, targets.pressure, targets.log_time, targets.log_pressure)
    often = BRANCHES[int(np.bincount(branch[windows[part]]).argmax())]
    return (
        f"marker {targets.names[point]} by {mean[part, component]:+.4f} mm in U{axis + 1} from {time[0]:.1f} "
        f"to {time[-1]:.1f} s, {WHILE[often]}"
    )
