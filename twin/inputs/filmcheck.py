"""Quick look at films and board pictures: faults that `twin measure` would find later, within seconds."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from twin import files
from twin.gauge.agreement import check_agrees, other_rate
from twin.gauge.onset import whole_film
from twin.gauge.pressurelog import Log
from twin.gauge.synchrony import Motion
from twin.inputs.cameras import dictionary_name, lens_of
from twin.inputs.recordings import corrections_of, marks_of
from twin.messages import Say
from twin.project.cameratables import CameraTable
from twin.project.folder import Project
from twin.targets import Array

if TYPE_CHECKING:  # vision takes a second to import
    from vision import Camera, Mark, Video
    from vision.following.preview import Glimpses

SMALL_PX = 20.0  # a marker below it is followed less well
OFTEN = 0.5  # share of the frames looked at in which a marker of the finger should be seen
OTHER_SIZE, OTHER_NOISE = 1.05, 1.5  # times, of markers and of noise, in the static film and the test
UNSTEADY = 0.01  # share of its grey level by which a film at rest changes a frame; that of the demos: 5e-5
TORN, TORN_FRAMES = 4e-4, 2  # share of the pixels, 100 of a small picture, and frames in which it is so
AT_FIRST = 3  # frames that are at rest if any are
CORNERS_MM, NOISE_MM = 0.1, 0.03  # error of a place by a marker's corners at 3 px/mm, and its scatter


@dataclass(frozen=True)
class _Look:
    """One camera's films, and what is known of the marks in them."""

    project: Project
    table: CameraTable
    marks: "Sequence[Mark]"
    camera: "Camera"
    film: "Video"
    static: "Video"

    @property
    def dictionary(self) -> str:
        return dictionary_name(self.project, self.table.dictionary)

    @property
    def finger(self) -> list[int]:
        return [p for p, mark in enumerate(self.marks) if mark.role == "finger"]


def check_films(project: Project, log: Log, say: Say, *, draws: bool = True) -> None:
    """Say what a few frames of the films show, and draw the first with every mark circled (check.png).

    Raises ValueError at the first thing for which `twin camera` or `twin measure` would refuse them.
    """
    from vision.film.series import open_film

    marks = marks_of(project)
    for table in project.config.cameras:
        film, static = (
            open_film(project.path(f), fps=table.fps, mirrored=table.mirrored)
            for f in (table.film, table.static)
        )
        picture = "check.png" if len(project.config.cameras) == 1 else f"check-{table.name}.png"
        if draws:
            _draw(project, table, marks, film, picture, say)
        corrections_of(project, table)  # names the line that is not right
        look = _Look(project, table, marks, lens_of(project, table), film, static)
        for sentence in (*film.issues, *static.issues, *_findings(look, log), *_outlined(look)):
            say(sentence)


def _outlined(look: _Look) -> tuple[str, ...]:
    """Sentences on the finger's outline at rest; ValueError where it is to tell the pose, and does not."""
    from twin.inputs.outlines import outline_tells, seen_outline

    if len(look.project.config.cameras) > 1:
        return ()
    try:
        outline = seen_outline(look.project, look.table, look.film, look.camera)
    except ValueError as error:
        if outline_tells(look.project):
            raise
        return (f"The outline is not compared with the model: {error}.",)
    return (*outline.told, *outline.wrong)


def _draw(
    project: Project, table: CameraTable, marks: "Sequence[Mark]", film: "Video", name: str, say: Say
) -> None:
    """Draw the first frame, whatever is wrong with it; without the lens, which may be unknown yet."""
    from vision.drawing.overlays import ring_sheet

    picture, detected = ring_sheet(film, marks, dictionary=dictionary_name(project, table.dictionary))
    what = f"the first frame of {table.film} with every marker circled, {detected} of {len(marks)} found"
    try:
        files.write_bytes(project.root / name, bytes(cv2.imencode(".png", picture)[1]))
    except PermissionError:  # a project that may only be read is checked all the same
        say(f"{name} cannot be written into {project.root}: {what}.")
        return
    say(f"Wrote {name}: {what}.")


def _findings(look: _Look, log: Log) -> list[str]:
    """Sentences about the films; ValueError where they are not right."""
    from vision.following.preview import check_glimpses, glimpses
    from vision.placing.views import check_static

    check_static(look.static)
    seen, still = (
        glimpses(film, look.camera, look.marks, dictionary=look.dictionary, reference_s=rest_s)
        for film, rest_s in ((look.film, look.project.config.measure.reference_s), (look.static, None))
    )
    for film, frames in ((look.film, seen), (look.static, still)):
        check_glimpses(film, frames, look.marks, look.dictionary)
    _whole_pictures(look, seen)
    sentences = [*_marks(look, seen), *_rests(look, seen, still, log), *_small(look, seen)]
    sentences += [*_seldom(look, seen), *_apart(look, seen, still), *_lit(look, seen)]
    return [*sentences, *_motion(look, seen, log)]


def _whole_pictures(look: _Look, seen: "Glimpses") -> None:
    """Raise ValueError where moving markers are torn between odd and even rows."""
    from vision.film.video import WHOLE

    torn = seen.combs > TORN + float(np.median(seen.combs[seen.rest]))
    if torn.sum() >= TORN_FRAMES:
        raise ValueError(
            f"{look.table.film} is interlaced: in {int(torn.sum())} of the {len(torn)} frames looked at, odd "
            f"and even rows show two moments, and a marker that moves is torn between them. {WHOLE}"
        )


def _marks(look: _Look, seen: "Glimpses") -> tuple[str, ...]:
    """Sentences on marks that may lie elsewhere; ValueError where they cannot be what is stated."""
    from vision.doubts.framemarks import frame_fit, without_odd
    from vision.doubts.misplacedmarks import doubts
    from vision.doubts.plausibility import check_marks
    from vision.following.firstpictures import unseen

    gone = [look.marks[p] for p in look.finger if np.isnan(seen.warp[p, 0, 0])]
    if gone:
        raise ValueError(unseen(look.film.path.name, gone, look.marks, set(seen.unused)))
    sd, glued = look.project.config.measure.frame_sd_mm, look.project.config.measure.placement_sd_mm
    check_marks(look.marks, seen.warp, camera=look.camera, frame_sd_mm=sd)
    fit = frame_fit(look.marks, seen.warp[:, :2, 2], sd_mm=max(sd, CORNERS_MM), camera=look.camera)
    sentences = doubts(look.marks, seen.warp, camera=look.camera, placement_sd_mm=glued)
    return (*without_odd(fit, look.marks)[1], *sentences)


def _rests(look: _Look, seen: "Glimpses", still: "Glimpses", log: Log) -> tuple[str, ...]:
    """Sentences where the finger drifts at rest; ValueError where it moves, or the film runs too fast to show
    its rest."""
    from vision.errors.restdrift import check_rest

    coded, rest = _coded(look), seen.rest
    names, film = [look.marks[p].name for p in coded], look.film.path.name
    try:
        moved = check_rest(
            _places(look, seen)[rest][:, coded], seen.time[rest], names, film=film, static=False
        )
    except ValueError as moving:
        stamps, first = _join(look) == "stamps", np.arange(len(seen.time)) < AT_FIRST
        course = _course(look, seen, first) if stamps else None
        if course is not None and (rate := other_rate(course, log, look.table.film_start_s)):
            raise ValueError(rate.sentence if rate.sure else f"{moving}. {rate.sentence}") from None
        raise
    static = look.static.path.name
    return (*moved, *check_rest(_places(look, still)[:, coded], still.time, names, film=static, static=True))


def _coded(look: _Look) -> list[int]:
    """Rows of the finger's coded marks: dots are not looked for in single frames."""
    from vision.marks import codes_of

    return [p for p in look.finger if p in codes_of(look.marks)]


def _places(look: _Look, seen: "Glimpses") -> Array:
    """Places (k,p,2) mm of all marks in the frame marks' plane; NaN where not seen."""
    from vision.marks import frame_places, rows_of
    from vision.plane import homographies, to_plane

    frame = rows_of(look.marks)[0]
    return to_plane(homographies(frame_places(look.marks), seen.ideal[:, frame]), seen.ideal)


def _small(look: _Look, seen: "Glimpses") -> list[str]:
    """A sentence where markers are small in the picture."""
    from vision.marks import px_per_unit

    side = 2.0 * px_per_unit(seen.warp)
    if not np.nanmin(side) < SMALL_PX:
        return []
    least = int(np.nanargmin(side))
    return [f"Marker {look.marks[least].name!r} is {side[least]:.0f} px wide in {look.table.film}; wanted 25 "
            "px or more: larger markers, a longer lens, or the camera nearer."]  # fmt: skip


def _apart(look: _Look, seen: "Glimpses", still: "Glimpses") -> list[str]:
    """Sentences where the static film is not made as the test: its noise is then not that of the test."""
    from vision.marks import px_per_unit

    name, film = look.static.path.name, look.film.path.name
    size = float(np.nanmedian(px_per_unit(still.warp) / px_per_unit(seen.warp)))
    change = still.flicker / seen.flicker if seen.flicker > 0.0 else 1.0
    noise = f"{name} tells the noise of {film}, wanted both with the same camera, lens, light and codec"
    sentences = []
    if max(size, 1 / size) > OTHER_SIZE:
        sentences.append(
            f"The markers are {size:.2f} times as large in {name} as in {film}. {noise}: film it again."
        )
    if max(change, 1 / change) > OTHER_NOISE:
        sentences.append(
            f"At rest, pixels of {name} change by {still.flicker:.2g} grey levels from frame to frame, those "
            f"of {film} by {seen.flicker:.2g}. {noise}: film it again."
        )
    return sentences


def _lit(look: _Look, seen: "Glimpses") -> list[str]:
    """A sentence where the light changes from frame to frame."""
    if not seen.light > UNSTEADY:
        return []
    return [
        f"The light flickers: at rest the mean grey level of {look.film.path.name} changes by "
        f"{100 * seen.light:.2g} % from frame to frame. That shifts the edges of markers by micrometres, and "
        "the stated errors hold only a part of it. Film by daylight or lamps that do not flicker, or expose "
        "for 10 ms or a multiple of it (8.3 ms where the mains has 60 Hz)."
    ]


def _seldom(look: _Look, seen: "Glimpses") -> list[str]:
    """Sentences about markers of the finger that are often not seen; ValueError where hardly one is."""
    from vision.measuring.displacements import LEAST_SEEN

    coded = _coded(look)
    after = np.isfinite(seen.ideal[~seen.rest][:, coded, 0])
    if not after.size:
        return []
    if after.mean(axis=0).max(initial=0.0) < LEAST_SEEN:
        raise ValueError(
            f"{look.table.film}: after the reference, {int(after.any(axis=1).sum())} of the {len(after)} "
            "frames looked at show a marker of the finger; wanted markers that stay in the picture, "
            "uncovered and sharp: film again"
        )
    return [
        f"Marker {look.marks[p].name!r} is read in {int(visible.sum())} of the {len(visible)} frames looked "
        f"at after the reference: {_why_not(look, p, several)}"
        for p, visible, several in zip(coded, after.T, seen.twice[~seen.rest][:, coded].T, strict=True)
        if visible.mean() < OFTEN
    ]  # fmt: skip


def _why_not(look: _Look, row: int, several: Array) -> str:
    """Reason why a marker is seldom read, from the frames (k,) in which its code stands in several places."""
    from vision.marks import codes_of

    if not several.mean() > 1.0 - OFTEN:
        return "is it covered, blurred or out of the picture?"
    return (
        f"its id {codes_of(look.marks)[row]} is seen twice in {int(several.sum())} of them. Print every id "
        "once: cover the other one, and film again if it is on the finger."
    )


def _motion(look: _Look, seen: "Glimpses", log: Log) -> tuple[str, ...]:
    """Sentences on how the finger's motion in the frames goes with the log, and when the film starts where
    the motion is to tell; ValueError where it contradicts the log, or fits it at two times."""
    motion = _course(look, seen, seen.rest)
    if motion is None:
        return ()
    if _join(look) == "stamps":
        return check_agrees(motion, log, look.table.film_start_s, stated=True)
    apart = float(np.median(np.diff(motion.time[np.isfinite(motion.mm)])))
    start = whole_film(motion, log)
    return (
        f"By frames {apart:.2g} s apart, the finger moves as {log.path.name} tells where the film starts at "
        f"{start:.1f} s of it.",
        *check_agrees(motion, log, start, stated=False),
    )


def _join(look: _Look) -> str:
    """How film and log are synchronised; "" without a log."""
    pressure = look.project.config.pressure
    return pressure.join if pressure else ""


def _course(look: _Look, seen: "Glimpses", rest: NDArray[np.bool_]) -> Motion | None:
    """Distance of the finger's coded marks from their mean places in the frames `rest` (k,); None without
    such marks, or where film and log have no common clock yet."""
    from vision.following.markrotations import mean_seen

    place = _places(look, seen)[:, _coded(look)]
    if _join(look) not in ("stamps", "onset") or not place.shape[1]:
        return None
    squares = ((place - mean_seen(place[rest])) ** 2).sum(axis=2)
    complete = np.isfinite(squares).all(axis=1)
    mm = np.where(complete, np.sqrt(np.where(np.isfinite(squares), squares, 0.0).mean(axis=1)), np.nan)
    return Motion(seen.time - look.film.time[0], mm, NOISE_MM)
