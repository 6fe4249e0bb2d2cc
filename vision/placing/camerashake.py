"""The picture of the frame marks, frame by frame: whether lens and camera stay as they were at rest.

A camera may shake: the plane of the frame marks takes that up. Where a stabiliser or the focus moves the
lens, the calibration no longer holds, and the plane hides it.
"""

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array

# Of each, a third to a tenth of what tests/strangers/recordings.py plants; the films of the demos stay below
SHIFT, TURN, SCALE = 0.5, 5e-4, 1e-3  # px, rad, of the picture's size


def unsteady(ideal: Array, reference: NDArray[np.intp], time: Array, *, film: str) -> tuple[str, ...]:
    """One sentence where the picture of the frame marks does not stay at its rest; none where it does.

    ideal: (t,f,2) px of the frame marks, NaN where one is not seen.   reference: (r,) frames of the rest.
    time: (t,) s.

    Shift, turn and scale of each frame come from least squares over the marks that it shows (a similarity);
    single frames are judged by the median of five.
    """
    visible = np.isfinite(ideal[reference, :, 0]).any(axis=0)
    if visible.sum() < 2:
        return ()
    rest = np.nanmedian(ideal[reference][:, visible], axis=0)
    motions = np.nan_to_num([_calm(x) for x in _similar(ideal[:, visible], rest)])
    frame = int(np.argmax(np.abs(motions[0])))
    shift, turned, scaled = map(float, np.abs(motions).max(axis=1))
    if shift < SHIFT and turned < TURN and scaled < SCALE:
        return ()
    return (
        f"The frame markers move in the picture of {film}: by up to {shift:.2g} px at {time[frame]:.2f} s, "
        f"turned by up to {np.degrees(turned):.2g} degrees, scaled by up to {100 * scaled:.2g} %. "
        f"{_cause(scaled)} Their plane takes up most of it; the calibration does not hold where the lens "
        "has moved, and the stated errors do not cover that. Film with the stabiliser off, focus and zoom "
        "locked, and the camera on a firm stand.",
    )


def _cause(scaled: float) -> str:
    if scaled >= SCALE:
        return "A change of scale comes from focus, zoom or a camera that moves nearer or farther."
    return "That comes from a stabiliser, or from a camera that shakes or was touched."


def _similar(ideal: Array, rest: Array) -> tuple[Array, Array, Array]:
    """Shift (t,) px, turn (t,) rad and scale (t,) of each frame against the rest (f,2) px."""
    seen = np.isfinite(ideal[..., 0])
    w = np.where(seen.sum(axis=1) > 1, seen.T, np.nan).T / np.maximum(seen.sum(axis=1), 1)[:, None]
    now, then = np.nan_to_num(ideal) @ [1, 1j], rest @ [1, 1j]
    centre, before = (w * now).sum(axis=1), (w * then).sum(axis=1)
    a, b = then - before[:, None], now - centre[:, None]
    with np.errstate(invalid="ignore"):  # of frames that show fewer than two
        turned = (w * a.conj() * b).sum(axis=1) / (w * np.abs(a) ** 2).sum(axis=1)
    return np.abs(centre - before), np.angle(turned), np.abs(turned) - 1


def _calm(values: Array) -> Array:
    """The running median of five (t,): a mark that is read wrongly once is no motion of the picture."""
    padded = np.pad(values, 2, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1), float)
