"""Recordings of each camera, and what was followed in them: the film, the film at rest, the codec's error."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera, Image
from vision.doubts.misplacedmarks import doubts
from vision.doubts.plausibility import check_marks
from vision.errors.codingvariance import Codec, codec_terms
from vision.errors.reencoding import coded_again, described
from vision.errors.restdrift import check_rest
from vision.errors.staticnoise import MIN_STATIC
from vision.film.checkpoint import Keeper, Progress
from vision.film.video import Video
from vision.following.corrections import Correction, corrected
from vision.following.reference import Follower, check_fingers_seen, prepare
from vision.following.tracking import follow
from vision.following.tracks import Followed
from vision.marks import Mark, frame_places, rows_of
from vision.plane import homographies, to_plane


@dataclass(frozen=True)
class View:
    """Recordings of one camera."""

    film: Video  # the test; the finger is at rest at its start
    static: Video  # at least 120 frames of the finger at rest, better 300
    camera: Camera  # of the same setting
    start: float = 0.0  # s, first frame of the film on the clock that all cameras share
    corrections: tuple[Correction, ...] = ()  # what a person mends of the film's tracks


@dataclass(frozen=True)
class How:
    """Settings for following films."""

    dictionary: str
    reference_s: float
    progress: Progress | None = None
    keeper: Keeper | None = None
    frame_sd_mm: float = 0.1  # how well the frame marks' places are known
    placement_sd_mm: float = 0.3  # how well the finger's marks are placed


@dataclass(frozen=True, kw_only=True)
class Seen:
    """Tracks and coding error of one camera."""

    camera: Camera
    film: Followed
    still: Followed  # the static film
    codec: Codec
    static: str = "static film"  # its name
    start: float = 0.0  # s, as of the view
    keys: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))  # key frames of the film
    still_keys: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))  # of the static film
    remarks: tuple[str, ...] = ()  # what the user should check or change
    coded: tuple[str, ...] = ()  # how the film was coded, and coded again: a sentence


def check_static(film: Video) -> None:
    """Raises ValueError where a static film is too short to tell the noise, or one picture throughout."""
    if len(film.time) < MIN_STATIC:
        raise ValueError(
            f"static film {film.path.name} has {len(film.time)} frames, wanted at least {MIN_STATIC}: film "
            "the finger at rest for longer"
        )
    picture: Image | None = None
    for _, _, image in film.frames():
        if picture is not None and not np.array_equal(image, picture):
            return
        picture = image
    raise ValueError(
        f"static film {film.path.name} shows one picture in all {len(film.time)} frames: it has no noise to "
        "tell; wanted a film of the finger at rest as the camera wrote it, not a picture made into a film, "
        "nor one whose noise was coded away, which a higher bit rate keeps"
    )


def look(view: View, marks: Sequence[Mark], how: How, *, camera: str = "") -> Seen:
    """Tracks of one camera: the marks in the film and in the static film, and the error of coding.

    camera: what its stages have behind their names, "-2" for the second camera.

    The first pictures are checked against what is stated of the marks, both films are followed, corrections
    by hand are made to the film's tracks, and the film is coded again to tell the error of its coding.
    Raises ValueError, before anything is followed, where the first picture contradicts what is stated of the
    marks; and where the finger moves in the static film or in the film's reference.
    """
    ready, still_ready = _prepared(view, marks, how)
    still = _followed(view.static, still_ready, how, f"static{camera}")
    film = _followed(view.film, ready, how, f"film{camera}")
    film = corrected(film, [mark.name for mark in marks], view.corrections, view.camera)
    remarks = _rest(still, marks, view.static, static=True) + _rest(film, marks, view.film, static=False)
    remarks += doubts(marks, ready.seed, camera=view.camera, placement_sd_mm=how.placement_sd_mm)
    frame, points = rows_of(marks)
    remarks += unsteady(film.ideal[:, frame], film.reference, film.time, film=view.film.path.name)
    again = coded_again(view.film, ready, film, frame_places(marks), frame, points, how.progress)
    return Seen(
        camera=view.camera,
        film=film,
        still=still,
        codec=codec_terms(again),
        static=view.static.path.name,
        start=view.start,
        keys=view.film.keys(),
        still_keys=view.static.keys(),
        remarks=remarks,
        coded=described(view.film, again),
    )


def _prepared(view: View, marks: Sequence[Mark], how: How) -> tuple[Follower, Follower]:
    """Reference patches of the film and of the static film; ValueError where the film's first picture shows
    that the marks are not as stated."""
    ready, still_ready = (
        prepare(film, view.camera, marks, dictionary=how.dictionary, reference_s=how.reference_s)
        for film in (view.film, view.static)
    )
    check_fingers_seen(view.film, ready)
    check_marks(marks, ready.seed, camera=view.camera, frame_sd_mm=how.frame_sd_mm)
    return ready, still_ready


def _followed(film: Video, follower: Follower, how: How, stage: str) -> Followed:
    """Every mark in every frame of a film; what is kept of a killed run has the stage's name."""
    return follow(
        film, follower, reference_s=how.reference_s, stage=stage, progress=how.progress, keeper=how.keeper
    )


def _rest(followed: Followed, marks: Sequence[Mark], film: Video, *, static: bool) -> tuple[str, ...]:
    """Sentences of `check_rest` on the finger's marks in the static film, or in the reference of the film."""
    frames = np.arange(len(followed.time)) if static else followed.reference
    finger, ideal = [p for p, m in enumerate(marks) if m.role == "finger"], followed.ideal[frames]
    place = to_plane(homographies(frame_places(marks), ideal[:, rows_of(marks)[0]]), ideal[:, finger])
    names = [marks[p].name for p in finger]
    return check_rest(place, followed.time[frames], names, film=film.path.name, static=static)


def steps_of(film: Followed, most: int) -> NDArray[np.intp]:
    """Frames that become steps: all, or in a longer film `most` even ones and those of the reference."""
    return np.union1d(film.reference, even_steps(len(film.time), most))


def even_steps(count: int, most: int) -> NDArray[np.intp]:
    """Frames of `count`: all, or `most` even ones.

    >>> even_steps(10, 4)
    array([0, 3, 6, 9])
    """
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.intp)


# Of each, a third to a tenth of what tests/strangers/recordings.py plants; the films of the demos stay below
SHIFT, TURN, SCALE = 0.5, 5e-4, 1e-3  # px, rad, of the picture's size


def unsteady(ideal: Array, reference: NDArray[np.intp], time: Array, *, film: str) -> tuple[str, ...]:
    """One sentence where the picture of the frame marks does not stay at its rest; none where it does.

    A camera that shakes is no harm: the plane of the frame marks takes that up. Where a stabiliser or the
    focus moves the lens, the calibration no longer holds, and the plane hides it.

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
