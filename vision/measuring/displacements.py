"""Displacements in mm with their uncertainty, from what one camera or several recorded."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.calibration.rig import Rig
from vision.camera import Array
from vision.doubts.framemarks import frame_fit, without_odd
from vision.doubts.slips import find_slips
from vision.errors.errorbudget import Budget, budget
from vision.errors.errormodel import Placed
from vision.errors.sharederrors import Stated, stacked
from vision.errors.staticnoise import NoiseModel, hidden_in_static, thinned_noise
from vision.film.checkpoint import Keeper, Progress
from vision.following.markrotations import mean_seen
from vision.following.tracks import Method, Tracks
from vision.marks import Mark, check_names, rows_of
from vision.measuring.face import Face, with_face
from vision.measuring.keptsteps import Room, placed_steps
from vision.measuring.strains import StrainField, strain_field
from vision.placing.multicamera import in_space
from vision.placing.planeerrors import principal
from vision.placing.restplaces import at_rest, located
from vision.placing.singlecamera import MAX_DEPTH_MM, in_plane
from vision.placing.views import How, Seen, View, check_static, look
from vision.plane import MIN_VISIBLE

MIN_FRAME, MIN_FIXED = 6, 4
LEAST_SEEN = 0.1  # share of the steps in which a mark of the finger must be seen
STEPS = 2000  # a film of a minute; every step takes the memory of all modes
FALLBACKS = {Method.ECC: "smoothed correlation (ECC)", Method.CORNERS: "its corners"}


@dataclass(frozen=True, kw_only=True)
class Displacements:
    """Displacements of the finger's and the fixed marks, relative to the mean of the reference.

    y (component 1) is not observed by one camera: NaN in value and covariance, 0 in the modes. A lost mark
    is NaN in value and covariance and 0 in the modes.
    """

    time: Array  # (s,) s of the film
    names: tuple[str, ...]  # (p,)
    roles: tuple[str, ...]  # (p,) "fixed" or "finger"
    points: Array  # (p,3) mm, places at rest
    measured: tuple[bool, ...]  # (p,) whether these are what the film shows, and not what is stated
    value: Array  # (s,p,3) mm
    covariance: Array  # (s,p,3,3) mm2, independent part: static noise, homography, blur, codec
    modes: Array  # (k,s,p,3) mm, errors shared by many values, 1 sd each
    mode_names: tuple[str, ...]  # (k,) as in `sharederrors`: scale, placement:<name>:x|z, frame:<k>, ...
    noise: NoiseModel
    reference: NDArray[np.intp]  # (r,) steps of the reference
    tracks: Tracks  # of the first camera, in all t frames
    homography: Array  # (t,3,3) plane (x, z, 1) mm to undistorted px of the first camera
    lost: tuple[str, ...]  # what was lost and when, in sentences for the user
    budget: Budget  # what each mark's sd is made of
    remarks: tuple[str, ...]  # what the user should check or change
    notes: tuple[str, ...] = ()  # what was done without asking anything of the user: for a log
    strain: StrainField | None = None  # of a speckled face
    most_steps: int = STEPS  # of evenly spaced ones; those of the reference stand beside them
    coding: tuple[str, ...] = ()  # how films were coded, in sentences: of the budget's codec row


# Ten arguments, all but two with a default: the one door of the package, and what it may be told.
def measure(
    views: Sequence[View],
    marks: Sequence[Mark],
    *,
    reference: float = 1.8,
    rig: Rig | None = None,
    face: Face | None = None,
    dictionary: str = "DICT_4X4_50",
    stated: Stated = Stated(),  # noqa: B008 - frozen
    steps: int | Room = STEPS,
    progress: Progress | None = None,
    keeper: Keeper | None = None,
) -> Displacements:
    """Displacements of the marks: in the frame marks' plane from one camera, in all axes from several.

    views: what each camera recorded.   marks: at least 6 "frame", 4 "fixed" and 1 "finger" ones.
    reference: s, rest at the start of the first film that displacements are relative to.
    rig: how several cameras, those of the views, stand to each other, from `stereo.calibrate_rig`.
    face: where one camera sees speckles, as `vision.measuring.face.Face`; its points follow the marks.
    dictionary: of the markers, a name or a file.   stated: how well the rig is known.
    steps: number of evenly spaced frames that are given out, besides all of the reference, or what tells it
    from the errors; tracking always uses every frame.
    progress: called with (stage, frames done, frames in all).
    keeper: keeps what was followed, so that a killed measurement goes on where it was, bit for bit.

    Raises ValueError for marks that do not suffice or share ids, for a static film that is too short or shows
    no marks, for cameras that are not the rig's, and as `prepare` and `with_face` do.
    """
    _check(views, marks, rig, face)
    how = How(dictionary, reference, progress, keeper, stated.frame_mm, stated.placement_mm)
    marks = located(views[0].film, views[0].camera, marks, dictionary)
    seen = [look(v, marks, how, camera=f"-{c + 1}" if rig else "") for c, v in enumerate(views)]
    rest = mean_seen(seen[0].film.ideal[seen[0].film.reference])
    every, remark = without_odd(frame_fit(marks, rest, sd_mm=stated.frame_mm, camera=seen[0].camera), marks)
    seen[0] = replace(seen[0], remarks=(*seen[0].remarks, *remark))
    # a clamp marker is off on the body, and by the frame in which it is seen, each by as much
    every, covariance = at_rest(seen[0], every, float(np.sqrt(2.0)) * stated.frame_mm)
    if covariance is not None:
        stated = replace(stated, pose=tuple(map(tuple, principal(covariance).tolist())))
    if face is not None:
        seen[0], every = with_face(seen[0], views[0], every, face, how)
    result = displacements_of(seen, every, rig=rig, stated=stated, steps=steps)
    _check_measured(result, views[0])
    return result


def displacements_of(
    seen: Sequence[Seen],
    marks: Sequence[Mark],
    *,
    rig: Rig | None = None,
    stated: Stated = Stated(),  # noqa: B008 - frozen
    steps: int | Room = STEPS,
) -> Displacements:
    """Displacements from what was followed in the films, as `measure` gives them."""

    def place(frames: NDArray[np.intp]) -> Placed:
        if rig is None:
            return in_plane(seen[0], marks, stated, frames)
        return in_space(seen, rig, marks, stated, frames)

    most, chosen, placed = placed_steps(seen[0].film, steps, place)
    return replace(_record(placed, seen, marks, chosen, stated), most_steps=most)


def _record(
    placed: Placed, seen: Sequence[Seen], marks: Sequence[Mark], steps: NDArray[np.intp], stated: Stated
) -> Displacements:
    film, output = seen[0].film, [marks[p] for p in rows_of(marks)[1]]
    names, time = [m.name for m in output], film.time[steps]
    there = np.isfinite(placed.value[..., 0])
    fields, mode_names = stacked(placed.modes, there)
    sd = np.hypot(placed.noise.sd, placed.noise.codec_sd)
    return Displacements(
        time=time,
        names=tuple(names),
        roles=tuple(m.role for m in output),
        points=np.array([m.position for m in output]),
        measured=tuple(m.measured for m in output),
        value=placed.value,
        covariance=_covariance(placed, there),
        modes=fields,
        mode_names=mode_names,
        noise=thinned_noise(placed.noise, len(film.time), len(steps)),
        reference=np.searchsorted(steps, film.reference),
        tracks=_tracks(seen[0], marks, placed.rotation),
        homography=seen[0].film.homography(marks),
        lost=_lost(seen, marks),
        budget=budget(placed.variance, fields, mode_names, there),
        remarks=(
            *hidden_in_static(placed.rest, names, seen[0].static),
            *_by_camera([s.remarks for s in seen]),
            *placed.remarks,
            *find_slips(time, placed.value, placed.turns, sd, output),
        ),
        notes=(*_fewer(len(steps), len(film.time)), *_noted(seen, marks), *placed.notes),
        coding=_by_camera([s.coded for s in seen]),
        strain=strain_field(
            seen[0], marks, placed.noise, steps, moved=placed.value, out_of_plane_mm=stated.out_of_plane_mm
        ),
    )


def _check(views: Sequence[View], marks: Sequence[Mark], rig: Rig | None, face: Face | None) -> None:
    """Raises ValueError when views, rig, marks or static films do not suffice."""
    cameras = len(rig.cameras) if rig is not None else 1
    if len(views) != cameras:
        raise ValueError(
            f"{len(views)} views for {cameras} cameras: wanted one view of each camera of the rig, in its "
            "order; several cameras need a rig, one camera has none"
        )
    for c, (view, camera) in enumerate(zip(views, rig.cameras if rig is not None else (), strict=False)):
        if not np.array_equal(view.camera.parameters, camera.parameters):
            raise ValueError(
                f"view {c + 1} has another camera than the rig has there: wanted rig.cameras[{c}]"
            )
    if face is not None and rig is not None:
        raise ValueError("a speckled face is measured by one camera: leave out the face or the other cameras")
    if rig is not None and any(mark.measured for mark in marks):
        raise ValueError(
            f"the place of marker {next(m.name for m in marks if m.measured)!r} is not stated, and only one "
            "camera alone measures it: state its position_mm, or leave out the other cameras"
        )
    _check_marks(marks)
    for view in views:
        check_static(view.static)


def _check_measured(result: Displacements, view: View) -> None:
    """Raises ValueError where no mark of the finger is seen in a tenth of the steps after the reference."""
    after = np.setdiff1d(np.arange(len(result.time)), result.reference)
    finger = [p for p, role in enumerate(result.roles) if role == "finger"]
    seen = np.isfinite(result.value[after][:, finger, 0])
    if len(after) and seen.mean(axis=0).max() < LEAST_SEEN:
        raise ValueError(
            f"{view.film.path.name}: nothing is measured: after the reference, which ends at "
            f"{result.time[result.reference[-1]]:.2f} s, every marker of the finger is lost in more than "
            f"{100 * (1 - LEAST_SEEN):.0f} % of the frames, or fewer than {MIN_VISIBLE} frame markers are "
            "seen; wanted markers that stay in the picture, uncovered and sharp: look at the film"
        )


def _check_marks(marks: Sequence[Mark]) -> None:
    check_names(marks)
    for role, least in (("frame", MIN_FRAME), ("fixed", MIN_FIXED), ("finger", 1)):
        count = sum(mark.role in (role, *(["clamp"] if role == "fixed" else [])) for mark in marks)
        if count < least:
            raise ValueError(
                f"{count} markers have the role {role!r}, wanted at least {least}: add some in the "
                "finger's plane"
            )
    y = [mark.position[1] for mark in marks if mark.role == "frame"]
    if max(y) - min(y) > MAX_DEPTH_MM:
        raise ValueError(
            f"frame markers lie at y from {min(y)} to {max(y)} mm, wanted one plane within "
            f"{MAX_DEPTH_MM} mm: they define the plane; other markers may lie in front of it or behind"
        )


def _covariance(placed: Placed, there: NDArray[np.bool_]) -> Array:
    """Independent covariance (s,p,3,3) mm2, correlated between the axes as at rest."""
    variance: Array = sum(placed.variance.values(), np.zeros(placed.value.shape))
    sd, count = np.sqrt(variance), len(placed.noise.sd)
    correlation = placed.noise.correlation.reshape(count, 3, count, 3)[np.arange(count), :, np.arange(count)]
    covariance = sd[..., :, None] * sd[..., None, :] * correlation
    covariance[~there] = np.nan
    return np.asarray(covariance)


def _tracks(seen: Seen, marks: Sequence[Mark], rotation: Array) -> Tracks:
    film, names = seen.film, tuple(mark.name for mark in marks)
    return Tracks(
        time=film.time, names=names, position=seen.camera.distort(film.ideal),
        covariance=film.covariance, rotation=rotation, method=film.method,
    )  # fmt: skip


def _fewer(steps: int, frames: int) -> tuple[str, ...]:
    """A sentence where not every frame became a step."""
    if steps == frames:
        return ()
    return (
        f"All {frames} frames were tracked; {steps} of them are kept as targets: the reference, and the "
        "others evenly spaced.",
    )


def _lost(seen: Sequence[Seen], marks: Sequence[Mark]) -> tuple[str, ...]:
    """Sentences about what each camera lost, with the camera's number where there are several."""
    each = [(*_lost_marks(s, marks), *_blind(s, marks), *s.film.said) for s in seen]
    return _by_camera(each)


def _noted(seen: Sequence[Seen], marks: Sequence[Mark]) -> tuple[str, ...]:
    """Sentences about what each camera placed less certainly or left out, as in `_lost`."""
    return _by_camera([(*_fallen_back(s, marks), *s.film.noted) for s in seen])


def _by_camera(each: Sequence[Sequence[str]]) -> tuple[str, ...]:
    return tuple(
        f"Camera {c + 1}: {sentence}" if len(each) > 1 else sentence
        for c, sentences in enumerate(each)
        for sentence in sentences
    )


def _lost_marks(seen: Seen, marks: Sequence[Mark]) -> list[str]:
    film, sentences = seen.film, []
    for p, mark in enumerate(marks):
        gone = film.time[film.method[:, p] == Method.LOST]
        if len(gone):
            sentences.append(
                f"Marker {mark.name!r} is lost in {len(gone)} of {len(film.time)} frames, from {gone[0]:.3f} "
                f"to {gone[-1]:.3f} s: there it has no displacement."
            )
    return sentences


def _fallen_back(seen: Seen, marks: Sequence[Mark]) -> list[str]:
    film, sentences = seen.film, []
    for p, mark in enumerate(marks):
        for method, means in FALLBACKS.items():
            used = film.time[film.method[:, p] == method]
            if len(used):
                sentences.append(
                    f"Marker {mark.name!r} does not match its reference picture in {len(used)} of "
                    f"{len(film.time)} frames, first at {used[0]:.3f} s. It is placed by {means} there, with "
                    "a larger sd."
                )
        soft = film.time[film.method[:, p] == Method.ADJUSTED]
        if len(soft):
            sentences.append(
                f"Marker {mark.name!r} is more blurred than at rest, or lit along a slope, in {len(soft)} of "
                f"{len(film.time)} frames, first at {soft[0]:.3f} s. Both are fitted beside its place there."
            )
    return sentences


def _blind(seen: Seen, marks: Sequence[Mark]) -> tuple[str, ...]:
    blind = seen.film.time[np.isnan(seen.film.homography(marks)[:, 0, 0])]
    if not len(blind):
        return ()
    return (
        f"{len(blind)} of {len(seen.film.time)} frames show too few frame markers, first at "
        f"{blind[0]:.3f} s: nothing is measured there. Keep {MIN_VISIBLE} uncovered "
        "of which no three lie on one line.",
    )
