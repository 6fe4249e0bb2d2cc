"""One homography a mark and frame: marks are followed through a film, lost and found again."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.film.checkpoint import Keeper, Progress, Row, every_frame
from vision.film.picturefaults import sample, stale
from vision.film.video import Video
from vision.following import blurred, fallback, influence, registration
from vision.following.dots import eccentricity
from vision.following.fallback import ECC_SD
from vision.following.identity import DotMemory, follow_dots
from vision.following.identity import start as memory_of
from vision.following.reference import SURE, Follower, reference_frames
from vision.following.tracks import FIRM, Followed, Method
from vision.marks import codes_of, corner_warp, detect, dot_warp, linear_at_centre, px_per_unit
from vision.plane import homographies, to_plane

POOLED = 4.0  # a dot's contour in one frame counts for one part in so many of its variance
MOVES_PX = 0.3  # px per frame: below it the last place is the better guess


@dataclass(frozen=True)
class FrameState:
    """State after a frame, from which the next one is followed."""

    last: Array  # (p,3,3) warps where marks were last seen
    before: Array  # (p,3,3) and a frame before that
    memory: DotMemory
    picture: Image  # some of its pixels


def follow(
    film: Video,
    follower: Follower,
    *,
    reference_s: float,
    stage: str,
    progress: Progress | None = None,
    keeper: Keeper | None = None,
) -> Followed:
    """Every mark in every frame of the film; a frame that cannot be decoded shows none.

    keeper: where a killed run left what it had followed, and where this one does.
    """
    count = len(follower.marks)
    rows = every_frame(
        film,
        lambda image, state: _next(image, follower, state),
        FrameState(follower.seed.copy(), follower.seed.copy(), _memory(follower), np.zeros((0, 0), np.uint8)),
        nothing=_Sighting.none(count, there=False),
        stage=stage,
        progress=progress,
        keeper=keeper,
    )
    film_rows = _Sighting(*(np.array(column) for column in zip(*rows, strict=True)))
    warp, method, spread = film_rows.warp, film_rows.method, film_rows.spread
    absent = [*np.flatnonzero(~film_rows.there), *range(len(rows), len(film.time))]
    more = influence.extra_variance(film_rows.leaning, np.isin(method, FIRM))
    given_up = np.isinf(more)
    warp[given_up], method[given_up], more[given_up] = np.nan, Method.LOST, 0.0
    ideal = centres(warp, follower.centre)
    old = stale(film_rows.same, ideal)
    warp[old], ideal[old], spread[old], method[old] = np.nan, np.nan, np.nan, Method.LOST
    _straighten(follower, ideal)
    covariance = _covariance(warp, film_rows.match, method, spread, follower)
    names = [mark.name for mark in follower.marks]
    return Followed(
        time=film.time[: len(warp)],
        warp=warp,
        ideal=ideal,
        covariance=covariance + more[..., None, None] * np.eye(2),
        method=method,
        growth=np.where(method == Method.ADJUSTED, film_rows.match, 1.0),
        reference=reference_frames(film, reference_s),
        said=(*_absent(film, absent), *_unknown(names, film_rows.unknown, film.time)),
        noted=_stale(film, np.flatnonzero(old)),
    )


def _absent(film: Video, absent: Sequence[int]) -> tuple[str, ...]:
    if not absent:
        return ()
    return (
        f"{len(absent)} of {len(film.time)} frames of {film.path.name} cannot be decoded, first at "
        f"{film.time[absent[0]]:.3f} s, last at {film.time[absent[-1]]:.3f} s: nothing is measured there. "
        "Copy the film from the camera again.",
    )


def _stale(film: Video, old: NDArray[np.intp]) -> tuple[str, ...]:
    if not len(old):
        return ()
    return (
        f"{len(old)} of {len(film.time)} frames of {film.path.name} repeat the picture before them while "
        f"markers move, first at {film.time[old[0]]:.3f} s, last at {film.time[old[-1]]:.3f} s. They are "
        "left out: the camera did not keep up.",
    )


def _unknown(names: list[str], unknown: NDArray[np.bool_], time: Array) -> tuple[str, ...]:
    """A sentence for each mark that has lost its name (t,p)."""
    return tuple(
        f"Dot {names[p]!r} came too near to another dot at {time[np.argmax(unknown[:, p])]:.3f} s. "
        "After that the two cannot be told apart, and it stays lost: place dots farther apart, or use "
        "coded markers."
        for p in np.flatnonzero(unknown.any(axis=0))
    )


def centres(warp: Array, centre: Array) -> Array:
    """Ideal pixels (...,p,2) of the marks' centres (p,2) local under warps (...,p,3,3)."""
    mapped = warp[..., :2] @ centre[:, :, None] + warp[..., 2:]
    return np.asarray(mapped[..., :2, 0] / mapped[..., 2:, 0])


class _Sighting(NamedTuple):
    """Marks (p) in one picture, or (t,p) in a film; each way of following writes into the arrays."""

    warp: Array  # (p,3,3) local to ideal px; NaN for a lost mark
    match: Array  # (p,) correlation; for a dot the variance of its contour, for an adjusted mark its growth
    method: NDArray[np.int8]  # (p,) of `Method`
    spread: Array  # (p,2,2) px2, covariance of corners and adjusted marks, or of a dot for unit variance
    leaning: Array  # (p,2) of `influence.lean`
    unknown: NDArray[np.bool_]  # (p,) dots that have lost their name
    same: NDArray[np.bool_]  # () the picture is the one before it
    there: NDArray[np.bool_]  # () the frame can be decoded

    @classmethod
    def none(cls, count: int, *, there: bool = True) -> "_Sighting":
        """Sighting of no mark at all."""
        return cls(
            np.full((count, 3, 3), np.nan),
            np.zeros(count),
            np.full(count, Method.LOST, dtype=np.int8),
            np.full((count, 2, 2), np.nan),
            np.full((count, 2), np.nan),
            np.zeros(count, dtype=bool),
            np.array(False),
            np.array(there),
        )


def _next(image: Image, follower: Follower, state: FrameState) -> tuple[Row, FrameState]:
    """Sighting of all marks in one picture, and the state after it."""
    sighting = _coded(image, follower, state)
    memory = _dots(image, follower, state.memory, sighting)
    sighting.unknown[memory.rows] = memory.open
    # A lost mark is looked for where it was last seen.
    seen = np.isfinite(sighting.warp)
    before, last = np.where(seen, state.last, state.before), np.where(seen, sighting.warp, state.last)
    picture = sample(image)
    same = np.array(np.array_equal(picture, state.picture))
    return sighting._replace(same=same), FrameState(last, before, memory, picture)


def _predict(last: Array, before: Array) -> Array:
    """Warps (p,3,3) after one more step like the last one; marks at rest stay (their step is noise)."""
    step = last[:, :2, 2] - before[:, :2, 2]
    moving = np.hypot(step[:, 0], step[:, 1]) > MOVES_PX
    guess = last.copy()
    guess[moving] = _advance(last[moving], before[moving])
    return guess


def _advance(last: Array, before: Array) -> Array:
    """Warps (p,3,3) after the last turn about the mark's centre and the last shift once more."""
    turn = last[:, :2, :2] @ np.linalg.inv(before[:, :2, :2])
    guess = last.copy()
    guess[:, :2, :2] = turn @ last[:, :2, :2]
    guess[:, :2, 2] = 2.0 * last[:, :2, 2] - before[:, :2, 2]
    return guess


def _coded(image: Image, follower: Follower, state: FrameState) -> _Sighting:
    """The coded marks in one picture: from where they were, from their codes, or by a fallback."""
    guess, sighting = _predict(state.last, state.before), _Sighting.none(len(follower.marks))
    rows = np.flatnonzero(np.isfinite(guess[follower.coded, 0, 0]))
    _lay(image, follower, rows, guess, Method.REGISTERED, sighting)
    failed = [i for i in rows.tolist() if sighting.method[follower.coded[i]] == Method.LOST]
    if not failed:
        return sighting
    quads = _quads(image, follower, failed)
    for i, corners in quads.items():
        guess[follower.coded[i]] = corner_warp(corners)
    _lay(image, follower, np.array(list(quads), dtype=np.intp), guess, Method.FOUND_AGAIN, sighting)
    for i in failed:
        p = int(follower.coded[i])
        if sighting.method[p] == Method.LOST:
            place = fallback.place(image, follower, i, guess[p], quads.get(i), state.last[p])
            sighting.warp[p], sighting.match[p], sighting.method[p], sighting.spread[p] = place
    return sighting


def _quads(image: Image, follower: Follower, failed: Sequence[int]) -> dict[int, Array]:
    """Corners (4,2) ideal px of some coded marks, by their row among these, where their codes are read."""
    quads, codes = detect(image, follower.dictionary)[0], codes_of(follower.marks)
    return {
        i: follower.camera.undistort(quads[code])
        for i in failed
        if (code := codes.get(int(follower.coded[i]))) is not None and code in quads
    }


def _lay(
    image: Image, follower: Follower, rows: NDArray[np.intp], guess: Array, by: Method, sighting: _Sighting
) -> None:
    """Register some coded marks from their guesses; those that correlate well enough are written."""
    marks = follower.coded[rows]
    if not len(rows):
        return
    laid, correlation, sums, grey = registration.register_quarters(
        image,
        registration.lens_of(follower.camera),
        follower.templates,
        guess[marks],
        px_per_unit(guess[marks]),
        rows,
    )
    good = correlation > follower.least[rows]
    firm = marks[good]
    sighting.warp[firm], sighting.match[firm], sighting.method[firm] = laid[good], correlation[good], by
    sighting.leaning[firm] = influence.lean(
        follower.quarters, rows[good], sums[good], linear_at_centre(laid[good])
    )
    _adjust(image, follower, rows, laid, correlation, grey, sighting)


def _adjust(
    image: Image, follower: Follower, rows: NDArray[np.intp], laid: Array, match: Array, grey: Array,
    sighting: _Sighting,
) -> None:  # fmt: skip
    """Write those coded marks whose blur and light explain what registration leaves of them."""
    much = (match > SURE) & (1.0 - match**2 > blurred.EXCESS * follower.usual[rows])
    rows = rows[much]
    each = blurred.adjust(
        image, registration.lens_of(follower.camera), follower.templates, follower.spectra, rows,
        start=laid[much], usual=follower.usual[rows], match=match[much], grey=grey[much],
    )  # fmt: skip
    for row, fit in zip(rows, each, strict=True):
        if fit is not None and np.sqrt(1.0 - fit.left) > follower.least[row]:
            p = follower.coded[row]
            sighting.warp[p], sighting.match[p], sighting.method[p] = fit.warp, fit.growth, Method.ADJUSTED
            sighting.spread[p], sighting.leaning[p] = fit.covariance, fit.leaning


def _memory(follower: Follower) -> DotMemory:
    dots = np.setdiff1d(np.arange(len(follower.marks)), follower.coded)
    return memory_of(
        follower.seed[:, :2, 2],
        rows=dots,
        body=np.array([mark.role == "finger" for mark in follower.marks]),
        axes=np.array([follower.dots[p].axes if p in follower.dots else (1.0, 1.0) for p in dots]).reshape(
            -1, 2
        ),
        dark=np.array([p in follower.dots and follower.dots[p].dark for p in dots], dtype=bool),
    )


def _dots(image: Image, follower: Follower, memory: DotMemory, sighting: _Sighting) -> DotMemory:
    """Write the dots beside the coded marks; their new memory."""
    if not len(memory.rows):
        return memory
    memory, dots = follow_dots(image, follower.camera, memory, sighting.warp[:, :2, 2])
    for p, dot in zip(memory.rows, dots, strict=True):
        if dot is not None:
            sighting.warp[p] = dot_warp(dot.centre, follower.dots[p].radius)
            sighting.match[p], sighting.method[p], sighting.spread[p] = dot.variance, Method.DOT, dot.spread
    return memory


def _straighten(follower: Follower, ideal: Array) -> None:
    """Take from the dots (t,p,2) px what the centres of their ellipses are off their own, in place."""
    frame = [p for p, mark in enumerate(follower.marks) if mark.role == "frame"]
    dots = np.setdiff1d(np.arange(len(follower.marks)), follower.coded)
    nominal = np.array([mark.position for mark in follower.marks])[frame][:, [0, 2]]
    homography = homographies(nominal, ideal[:, frame])
    radius = np.array([0.5 * follower.marks[p].size_mm for p in dots])
    finite = np.isfinite(homography[:, 0, 0])
    place = to_plane(homography[finite], ideal[finite][:, dots])
    ideal[np.ix_(finite, dots)] -= eccentricity(homography[finite][:, None], place, radius)


def _covariance(
    warp: Array, match: Array, method: NDArray[np.int8], spread: Array, follower: Follower
) -> Array:
    """Covariance (t,p,2,2) px2 of the centres from the residual of each fit; NaN for lost marks.

    The contour of one dot in one frame tells little of its own variance: it is drawn to the dot's mean.
    """
    covariance = np.full((*warp.shape[:2], 2, 2), np.nan)
    covariance[:, follower.coded] = registration.centre_covariance(
        follower.templates, linear_at_centre(warp[:, follower.coded]), match[:, follower.coded]
    )
    covariance[method == Method.ECC] *= ECC_SD**2
    stored = np.isin(method, (Method.CORNERS, Method.ADJUSTED))
    covariance[stored] = spread[stored]
    dots = np.setdiff1d(np.arange(len(follower.marks)), follower.coded)
    seen, contour = np.isfinite(warp[:, dots, 0, 0]), match[:, dots]
    usual = np.sum(contour * seen, axis=0) / np.maximum(seen.sum(axis=0), 1)
    covariance[:, dots] = spread[:, dots] * (usual + (contour - usual) / POOLED)[..., None, None]
    return covariance
