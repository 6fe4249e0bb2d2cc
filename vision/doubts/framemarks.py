"""Frame marks against their stated places: the one that lies elsewhere, or two that are exchanged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from vision.camera import Array, Camera
from vision.errors.sharederrors import UNLIKELY
from vision.marks import Mark, codes_of, rows_of
from vision.perspective import unlike
from vision.plane import homographies, to_plane

LIMIT_MM, LIMIT_SHARE = 3.0, 0.05  # of the rig's size: frame marks farther off are refused
BARE = 3.0  # times that, where no lens is known: a wide lens bends a rig of 200 mm by some mm
LEAST = 6  # frame marks seen, below which none can be told from the others
PLAIN = 5.0  # times smaller must the misfit become for one explanation to count
ALONE = 3.0  # times smaller than with the next best


@dataclass(frozen=True)
class FrameFit:
    """Agreement of the frame marks with their stated places, and an explanation where they disagree."""

    rms_mm: float  # of one component, after the fit of a homography
    limit_mm: float
    worst: str  # name of the mark that misses most
    odd: str = ""  # the one mark without which the others agree, "" if there is none
    away_mm: float = 0.0  # how far it lies from its stated place
    seen_at: tuple[float, float] = (0.0, 0.0)  # mm, where the others see it
    swapped: tuple[str, str] | None = None  # two marks whose exchange makes all agree
    left_mm: float = 0.0  # rms of what that leaves
    chance: float = 1.0  # of what the odd one's absence leaves, at the stated sd

    @property
    def refused(self) -> bool:
        """True if nothing can be measured with these places."""
        return self.rms_mm > self.limit_mm or (bool(self.odd) and self.away_mm > self.limit_mm)


def frame_fit(
    marks: Sequence[Mark], pixels: Array, *, sd_mm: float, camera: Camera | None
) -> FrameFit | None:
    """Agreement of the frame marks, from the ideal px (p,2) of all marks; None where fewer than 6 are seen.

    sd_mm: how well their places are known.   camera: whose lens the pixels are free of; None for raw px.
    Each is left out in turn, and each is exchanged with every other coded mark.
    """
    rows = [p for p in rows_of(marks)[0] if np.isfinite(pixels[p, 0])]
    if len(rows) < LEAST:
        return None
    nominal = np.array([marks[p].position for p in rows])[:, [0, 2]]
    overall, worst = _misfit(nominal, pixels[rows][None], camera)
    limit = min(LIMIT_MM, LIMIT_SHARE * float(np.ptp(nominal, axis=0).max())) * (1.0 if camera else BARE)
    fitted = 6 if camera else 8
    fit = FrameFit(float(overall[0]), limit, marks[rows[int(worst[0])]].name)
    if not _contradicts(fit.rms_mm, 2 * len(rows) - fitted, sd_mm):
        return fit
    without = np.repeat(pixels[rows][None], len(rows), axis=0)
    without[np.arange(len(rows)), np.arange(len(rows))] = np.nan
    pairs, exchanged = _exchanges(marks, rows, pixels)
    remaining, swapped = _misfit(nominal, without, camera)[0], _misfit(nominal, exchanged, camera)[0]
    best, pair = int(np.argmin(remaining)), int(np.argmin(swapped)) if len(pairs) else -1
    if len(pairs) and swapped[pair] < remaining[best] and _explains(swapped, pair, fit.rms_mm):
        a, b = pairs[pair]
        return replace(fit, swapped=(marks[a].name, marks[b].name), left_mm=float(swapped[pair]))
    if not _explains(remaining, best, fit.rms_mm):
        return fit
    free = 2 * len(rows) - 2 - fitted
    seen = to_plane(homographies(nominal, without[best : best + 1]), pixels[rows[best]][None, None])[0, 0]
    return replace(
        fit, odd=marks[rows[best]].name, left_mm=float(remaining[best]),
        seen_at=(float(seen[0]), float(seen[1])), away_mm=float(np.hypot(*(seen - nominal[best]))),
        chance=float(scipy.special.chdtrc(free, remaining[best] ** 2 / sd_mm**2 * free)),
    )  # fmt: skip


def check_frame(fit: FrameFit | None, marks: Sequence[Mark]) -> None:
    """Raises ValueError where the frame marks lie elsewhere than is stated; says which ids to exchange, or
    whose place to correct."""
    if fit is None or not fit.refused:
        return
    off = f"the frame markers are {fit.rms_mm:.1f} mm (rms) off their stated places"
    limit = f"wanted at most {fit.limit_mm:.3g} mm"
    if fit.swapped:
        codes = {marks[p].name: code for p, code in codes_of(marks).items()}
        (a, b), code_a, code_b = fit.swapped, codes[fit.swapped[0]], codes[fit.swapped[1]]
        raise ValueError(
            f"markers {a!r} (id {code_a}) and {b!r} (id {code_b}) have each other's places: {off}, {limit}, "
            f"and {fit.left_mm:.2g} mm with these two exchanged; exchange their marker ids, or "
            "their position_mm"
        )
    if fit.odd:
        nominal = next(m.position for m in marks if m.name == fit.odd)
        x, z = fit.seen_at
        raise ValueError(
            f"frame marker {fit.odd!r} lies {fit.away_mm:.1f} mm from its stated place, {limit}: it is "
            f"stated at x = {nominal[0]:g}, z = {nominal[2]:g} mm, and the others, which agree to "
            f"{fit.left_mm:.2g} mm without it, see it at x = {x:.1f}, z = {z:.1f} mm; correct its "
            "position_mm or its marker id, or remove it"
        )
    raise ValueError(
        f"{off}, {fit.worst!r} most, {limit}; neither one marker nor an exchange of two explains it: "
        "measure position_mm of the frame markers again (x along the finger from the clamp, z up, in mm)"
    )


def without_odd(fit: FrameFit | None, marks: Sequence[Mark]) -> tuple[list[Mark], tuple[str, ...]]:
    """The marks, where one frame mark alone contradicts the others with that one as a fixed mark; and a
    sentence about it."""
    if fit is None or not fit.odd or fit.chance < UNLIKELY:
        return list(marks), ()
    adjusted = [replace(m, role="fixed") if m.name == fit.odd else m for m in marks]
    return adjusted, (
        f"Frame marker {fit.odd!r} lies {fit.away_mm:.2f} mm from its stated place; the others agree without "
        f"it. It does not define the frame, and is kept as a fixed marker: correct its position_mm, "
        f"x = {fit.seen_at[0]:.2f}, z = {fit.seen_at[1]:.2f} mm as the others see it.",
    )


def _misfit(nominal: Array, pixels: Array, camera: Camera | None) -> tuple[Array, Array]:
    """Rms (t,) mm of one component after the fit of a homography to pixels (t,f,2), of a known camera with
    what that hides, inf where there is none, and the row (t,) that misses most."""
    with np.errstate(all="ignore"):  # marks that are exchanged may have no homography at all
        homography = homographies(nominal, pixels)
        off = to_plane(homography, pixels) - nominal
        for t in range(len(off) if camera else 0):
            if np.isfinite(homography[t, 0, 0]):
                assert camera is not None
                seen = np.isfinite(pixels[t, :, 0])
                off[t, seen] += unlike(camera, homography[t], nominal[seen])
        power = np.nansum(off**2, axis=2)
        free = 2 * np.isfinite(pixels[..., 0]).sum(axis=1) - (6 if camera else 8)
        rms = np.sqrt(power.sum(axis=1) / np.maximum(free, 1))
    solvable = np.isfinite(homography[:, 0, 0]) & (free > 0) & np.isfinite(rms)
    return np.where(solvable, rms, np.inf), power.argmax(axis=1)


def _contradicts(rms: float, free: int, sd_mm: float) -> bool:
    return bool(scipy.special.chdtrc(free, rms**2 * free / sd_mm**2) < UNLIKELY)


def _explains(misfit: Array, best: int, overall: float) -> bool:
    """True if the best explanation leaves far less than none, and far less than all others."""
    others = np.delete(misfit, best)
    return bool(
        misfit[best] * PLAIN < overall and misfit[best] * ALONE < (others.min() if len(others) else np.inf)
    )


def _exchanges(
    marks: Sequence[Mark], rows: Sequence[int], pixels: Array
) -> tuple[list[tuple[int, int]], Array]:
    """Pairs of coded marks, one or both of the frame, and the frame marks' pixels (k,f,2) with them
    exchanged."""
    coded = [p for p in codes_of(marks) if np.isfinite(pixels[p, 0])]
    pairs = [(a, b) for a in rows if a in coded for b in coded if b != a and (b not in rows or a < b)]
    changed = np.repeat(pixels[list(rows)][None], len(pairs), axis=0)
    for k, (a, b) in enumerate(pairs):
        changed[k, rows.index(a)] = pixels[b]
        if b in rows:
            changed[k, rows.index(b)] = pixels[a]
    return pairs, changed
