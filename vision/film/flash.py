"""A flash or a lamp in the film: when it goes on, to a fraction of a frame."""

import numpy as np

from vision.film.video import Array, Video

MIN_RISE = 10.0  # grey levels between dark and lit
PARTLY = (0.05, 0.95)  # share of the light in the frame in which it goes on, if that frame was being exposed


def flash_onset(film: Video, region: tuple[int, int, int, int]) -> tuple[float, float]:
    """Time of a lamp's onset on the film's clock, and its sd, s.

    region: (x, y, width, height) px of the lamp.

    A frame's time stamp is taken as the middle of its exposure and the exposure as one frame interval long.
    A frame that shows a share f of the light was lit for that share: onset = t + (1/2 - f) dt. How short the
    exposure truly was is not known: between two frames, dark and fully lit, the onset is anywhere,
    sd = dt / sqrt(12); within a frame the rms error is |1/2 - f| dt / sqrt(3), and the noise of f.
    Raises ValueError for a region outside the picture or without a rise of 10 grey levels.
    """
    x, y, width, height = region
    if min(x, y) < 0 or min(width, height) < 1 or x + width > film.width or y + height > film.height:
        raise ValueError(
            f"flash region {list(region)} leaves the picture of {film.width} x {film.height} px: give "
            "[x, y, width, height] in px"
        )
    light = np.full(len(film.time), np.nan)
    for index, _, grey in film.frames():
        light[index] = grey[y : y + height, x : x + width].mean()
    return _onset(film.time[np.isfinite(light)], light[np.isfinite(light)], film.path.name)


def _onset(time: Array, light: Array, name: str) -> tuple[float, float]:
    """Onset and its sd from the mean light (t,) at times (t,) s."""
    low, high = np.percentile(light, 1.0), light.max()
    above = np.flatnonzero(light > 0.5 * (low + high))
    if high - low < MIN_RISE or not len(above) or above[0] == 0:
        raise ValueError(
            f"film {name} shows no lamp going on in the flash region: light there is {low:.0f} to {high:.0f} "
            f"grey levels, wanted dark frames at the start and a rise of {MIN_RISE:g}; check the region"
        )
    lit_frame = int(above[0])
    # The frame before may hold a little of the light already.
    dark = light[: max(lit_frame - 1, 1)]
    base, noise = float(np.median(dark)), float(np.std(dark)) if len(dark) > 2 else 1.0
    after = light[lit_frame + 1 : lit_frame + 3]
    lit = float(after.max()) if len(after) else float(high)
    shares = np.clip((light[[lit_frame - 1, lit_frame]] - base) / max(lit - base, 1e-9), 0.0, 1.0)
    frame, share = (lit_frame - 1, shares[0]) if shares[0] > PARTLY[0] else (lit_frame, shares[1])
    step = float(time[frame] - time[frame - 1]) if frame else float(time[1] - time[0])
    onset = float(time[frame]) + (0.5 - float(share)) * step
    spread = abs(1.0 - 2.0 * share) if PARTLY[0] < share < PARTLY[1] else 1.0
    return onset, float(step * np.hypot(spread / np.sqrt(12.0), noise / max(lit - base, 1e-9)))
