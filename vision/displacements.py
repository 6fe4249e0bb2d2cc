"""Film, static film, camera and marks in, displacements in mm with their uncertainty out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from vision import depth, modes
from vision.budget import Budget, budget
from vision.camera import Array, Camera
from vision.checkpoint import Keeper
from vision.fallback import CORNERS, ECC, LOST
from vision.marks import Mark, check_names
from vision.modes import Stated
from vision.noise import (
    MIN_STATIC,
    REST,
    Codec,
    NoiseModel,
    codec_noise,
    codec_sd,
    hidden_in_static,
    states,
    static_noise,
    with_y,
)
from vision.plane import Plane, misplaced, plane_of, to_plane
from vision.reference import prepare
from vision.slip import slips
from vision.tracks import Followed, Progress, Tracks, follow
from vision.turns import finger_turns, linear_maps, mean_seen, rotations, sides
from vision.variance import at_rest, independent, misfit
from vision.video import Video

MIN_FRAME, MIN_FIXED = 6, 4
MAX_DEPTH_MM = 0.1  # of the frame marks
MAX_HEIGHT = 0.2  # of the camera's distance, for all other marks
FALLBACKS = {ECC: "smoothed correlation (ECC)", CORNERS: "its corners"}
UNLIKELY = 0.001  # chance below which residuals contradict what is stated


@dataclass(frozen=True)
class Displacements:
    """Displacements of the finger's and the fixed marks, relative to the mean of the reference frames.

    y (component 1) is not observed by one camera: NaN in value and covariance, 0 in the modes. A lost mark
    is NaN in value and covariance and 0 in the modes.
    """

    time: Array  # (s,) s of the film
    names: tuple[str, ...]  # (p,)
    roles: tuple[str, ...]  # (p,) "fixed" or "finger"
    points: Array  # (p,3) mm, nominal places at rest
    value: Array  # (s,p,3) mm
    covariance: Array  # (s,p,3,3) mm2, independent part: static noise, homography, blur, codec
    modes: Array  # (k,s,p,3) mm, errors shared by many values, 1 sd each
    mode_names: tuple[str, ...]  # (k,) see vision.modes: scale, placement:<name>:x|z, frame:<k>, ...
    noise: NoiseModel
    reference: NDArray[np.intp]  # (r,) frames of the reference
    tracks: Tracks
    homography: Array  # (s,3,3) plane (x, z, 1) mm to undistorted px
    lost: tuple[str, ...]  # what was lost and when, one sentence each
    budget: Budget  # what each mark's sd is made of
    remarks: tuple[str, ...]  # what was corrected and what contradicts what was stated, one sentence each


def measure(
    film: Video,
    static: Video,
    camera: Camera,
    marks: Sequence[Mark],
    *,
    dictionary: str = "DICT_4X4_50",
    stated: Stated = Stated(),  # noqa: B008 - frozen
    reference_s: float = 1.8,
    progress: Progress | None = None,
    keeper: Keeper | None = None,
) -> Displacements:
    """Displacements of the marks in the film.

    film: the test; at rest for its first reference_s seconds.
    static: at least 120 frames of the finger at rest, better 300.
    camera: from `calibrate_camera`, same setting.   marks: at least 6 "frame" and 4 "fixed" ones.
    stated: how well the rig is known.
    reference_s: s.   progress: called with (stage, frames done, frames in all).
    keeper: keeps what was followed, so that a killed measurement goes on where it was, bit for bit.

    Every frame has its own homography from the frame marks, so a shaken tripod does no harm; its noise is
    in the covariance of every place. Raises ValueError for marks that do not suffice or share ids, for a
    static film that is too short or shows no marks, and as `prepare` does.
    """
    check_films(static, marks)
    follower = prepare(film, camera, marks, dictionary=dictionary, reference_s=reference_s)
    still = _static(static, camera, marks, dictionary, reference_s, progress, keeper)
    followed = follow(film, follower, reference_s=reference_s, stage="film", progress=progress, keeper=keeper)
    frame, points = rows_of(marks)
    codec = codec_noise(film, follower, followed, _xz(marks)[frame], frame, points, progress)
    return displacements(followed, still, camera, marks, codec=codec, stated=stated, static=static.path.name)


def displacements(
    followed: Followed,
    still: Followed,
    camera: Camera,
    marks: Sequence[Mark],
    *,
    codec: Codec,
    stated: Stated,
    static: str,
) -> Displacements:
    """Displacements from what was followed in the film and in the static one, as `measure` gives them.

    static: name of the static film.
    """
    frame, points = rows_of(marks)
    output = [marks[p] for p in points]
    nominal = np.array([mark.position for mark in output])
    quiet = plane_of(_xz(marks)[frame], still.ideal[:, frame])
    rest_place = to_plane(quiet.homography, still.ideal[:, points])
    noise = static_noise(rest_place, [mark.name for mark in output], static)
    ideal, reference = followed.ideal[:, points], followed.reference
    extra = codec_sd(codec, ideal, mean_seen(ideal[reference]))
    noise = replace(noise, codec_sd=while_moving(extra, states(ideal) != REST))
    plane = plane_of(_xz(marks)[frame], followed.ideal[:, frame])
    view, height = depth.viewpoint(camera, plane.homography), depth.heights(marks, frame)
    _check_heights(marks, height, view)
    place = to_plane(plane.homography, ideal)
    own_place = depth.to_own_plane(place, height[points], view)
    value = with_y(own_place - mean_seen(own_place[reference]))
    seen = np.isfinite(value[..., 0])
    linear = linear_maps(followed, plane.homography)
    rotation = rotations(linear)
    turns = finger_turns(value, rotation[:, points], nominal, output)
    rest = at_rest(noise, quiet, rest_place)
    noisy = rest.frame_variance / len(reference)
    frame_mm, remarks = _frame_sd(plane, reference, [marks[p].name for p in frame], stated.frame_mm, noisy)
    fields, names = modes.stacked(
        [
            modes.scale(value, stated.scale),
            modes.placement(value, output, turns, stated.placement_mm),
            modes.node(value, nominal, output, turns, stated.node_mm),
            modes.frame(misplaced(plane, place), reference, frame_mm),
            modes.reference(value, output, _reference_sd(noise, codec, len(reference))),
            modes.named(depth.height_modes(value, output, view, sd_mm=stated.height_mm)),
            modes.named(
                depth.out_of_plane_modes(value, own_place, output, view, sd_mm=stated.out_of_plane_mm)
            ),
            modes.named(
                depth.calibration_modes(
                    camera,
                    followed.ideal,
                    plane.homography,
                    plane=plane.nominal,
                    frame=frame,
                    points=points,
                    height=height[points],
                    reference=reference,
                )
            ),
        ],
        seen,
    )
    # Only registration tells size well enough for an alarm.
    linear = np.where(np.isin(followed.method, list(FALLBACKS))[..., None, None], np.nan, linear)
    size, size_sd = sides(linear[:, points]), _grown(still, quiet, points, noise, extra)
    parts = independent(rest, plane, place, misfit(followed), frame, points, extra)
    return Displacements(
        followed.time,
        tuple(m.name for m in output),
        tuple(m.role for m in output),
        nominal,
        value,
        covariance_of(sum(parts.values(), np.zeros(value.shape)), noise, seen),
        fields,
        names,
        noise,
        reference,
        tracks_of(followed, marks, camera, rotation),
        plane.homography,
        lost_marks(followed, marks, plane.homography),
        budget(parts, fields, names, seen),
        (
            *hidden_in_static(rest_place, [mark.name for mark in output], static),
            *remarks,
            *_corrected(output, height[points], view),
            *slips(followed.time, value, turns, np.hypot(noise.sd, noise.codec_sd), output),
            *depth.extrapolated(camera, followed.ideal, [mark.name for mark in marks]),
            *depth.alarms(followed.time, size, size_sd, output, view, sd_mm=stated.out_of_plane_mm),
        ),
    )


def check_films(static: Video, marks: Sequence[Mark]) -> None:
    """Raises ValueError when the marks or the static film do not suffice."""
    check_names(marks)
    for role, wanted in (("frame", MIN_FRAME), ("fixed", MIN_FIXED), ("finger", 1)):
        count = sum(mark.role == role for mark in marks)
        if count < wanted:
            raise ValueError(
                f"{count} marks have the role {role!r}, wanted at least {wanted}: add some in the "
                "finger's plane"
            )
    y = [mark.position[1] for mark in marks if mark.role == "frame"]
    if max(y) - min(y) > MAX_DEPTH_MM:
        raise ValueError(
            f"frame marks lie at y from {min(y)} to {max(y)} mm, wanted one plane within "
            f"{MAX_DEPTH_MM} mm: they define the plane; other marks may lie in front of it or behind"
        )
    if len(static.time) < MIN_STATIC:
        raise ValueError(
            f"static film {static.path.name} has {len(static.time)} frames, wanted at least {MIN_STATIC}: "
            "film the finger at rest for longer"
        )


def rows_of(marks: Sequence[Mark]) -> tuple[list[int], list[int]]:
    """Rows of the frame marks and of the output marks."""
    frame = [p for p, mark in enumerate(marks) if mark.role == "frame"]
    return frame, [p for p in range(len(marks)) if p not in frame]


def _xz(marks: Sequence[Mark]) -> Array:
    """Nominal places (m,2) mm in the plane."""
    return np.array([mark.position for mark in marks])[:, [0, 2]]


def _static(
    static: Video,
    camera: Camera,
    marks: Sequence[Mark],
    dictionary: str,
    reference_s: float,
    progress: Progress | None,
    keeper: Keeper | None,
) -> Followed:
    follower = prepare(static, camera, marks, dictionary=dictionary, reference_s=reference_s)
    return follow(static, follower, reference_s=reference_s, stage="static", progress=progress, keeper=keeper)


def while_moving(extra: Array, moves: NDArray[np.bool_]) -> Array:
    """Rms (p,3) of the codec's sd (s,p,3) over the frames in which a point moves, 0 if it never does."""
    chosen = moves[..., None]
    return np.sqrt(np.sum(extra**2 * chosen, axis=0) / np.maximum(chosen.sum(axis=0), 1))


def covariance_of(variance: Array, noise: NoiseModel, seen: NDArray[np.bool_]) -> Array:
    """Independent covariance (s,p,3,3) mm2 of variances (s,p,3), correlated between the axes as at rest."""
    sd, count = np.sqrt(variance), len(noise.sd)
    own = noise.correlation.reshape(count, 3, count, 3)[np.arange(count), :, np.arange(count)]
    covariance = sd[..., :, None] * sd[..., None, :] * own
    covariance[~seen] = np.nan
    return np.asarray(covariance)


def _reference_sd(noise: NoiseModel, codec: Codec, frames: int) -> Array:
    """Sd (p,3) mm of the reference's mean place; 0 in y.

    The mean of n values with lag-1 correlation rho, and the coding error frozen in all of them, which a mark
    that never moves keeps for the whole film, so that it cancels.
    """
    mean = noise.sd**2 / frames * (1.0 + noise.rho) / (1.0 - noise.rho)
    return np.nan_to_num(np.sqrt(mean + np.where(noise.codec_sd > 0, codec.held**2, 0.0)))


def _frame_sd(
    plane: Plane, reference: NDArray[np.intp], names: Sequence[str], stated: float, noise: float
) -> tuple[float, tuple[str, ...]]:
    """How far frame marks are off their nominal places, mm: as stated, or what the reference shows if more.

    Their residuals about the homography have 2 f - 8 degrees of freedom.   noise: mm2, of their mean places.
    """
    mean = mean_seen(plane.residual[reference])
    seen = np.isfinite(mean[:, 0])
    free, power = 2 * int(seen.sum()) - 8, np.nan_to_num(mean**2).sum(axis=1)
    if free < 1 or chi2.sf(power.sum() / (stated**2 + noise), free) > UNLIKELY:
        return stated, ()
    found = float(np.sqrt(power.sum() / free - noise))
    return found, (
        f"the frame marks are {found:.3f} mm off their stated places, {names[int(np.argmax(power))]!r} most, "
        f"and not {stated:g} mm (frame_sd_mm): {found:.3f} mm is used; measure their places again",
    )


def _check_heights(marks: Sequence[Mark], height: Array, view: depth.Viewpoint) -> None:
    worst = int(np.argmax(np.abs(height)))
    if abs(height[worst]) > MAX_HEIGHT * abs(view.distance):
        raise ValueError(
            f"mark {marks[worst].name!r} lies {height[worst]:.1f} mm off the frame marks' plane and the "
            f"camera stands {abs(view.distance):.0f} mm away, wanted at most {MAX_HEIGHT:g} of that: "
            "check its y in mm"
        )


def _corrected(marks: Sequence[Mark], height: Array, view: depth.Viewpoint) -> tuple[str, ...]:
    """One sentence where finger marks off the plane were corrected for their height."""
    off = [p for p, m in enumerate(marks) if m.role == "finger" and abs(height[p]) > MAX_DEPTH_MM]
    if not off:
        return ()
    worst = max(off, key=lambda p: abs(height[p]))
    return (
        f"{len(off)} finger marks lie off the frame marks' plane, by {height[worst]:.1f} mm at "
        f"{marks[worst].name!r}: corrected with the camera {view.distance:.0f} mm away",
    )


def _grown(still: Followed, quiet: Plane, points: list[int], noise: NoiseModel, extra: Array) -> Array:
    """Sd (s,p) of each mark's apparent size: as in the static film, more where the codec adds."""
    side = sides(linear_maps(still, quiet.homography)[:, points])
    sd = np.array([np.std(s[np.isfinite(s)]) if np.isfinite(s).any() else np.nan for s in side.T])
    return np.asarray(sd * np.sqrt(1.0 + np.nanmax(np.nan_to_num(extra / noise.sd) ** 2, axis=2)))


def tracks_of(followed: Followed, marks: Sequence[Mark], camera: Camera, rotation: Array) -> Tracks:
    return Tracks(
        followed.time,
        tuple(mark.name for mark in marks),
        camera.distort(followed.ideal),
        followed.covariance,
        rotation,
        followed.method,
    )


def lost_marks(followed: Followed, marks: Sequence[Mark], homography: Array) -> tuple[str, ...]:
    total = len(followed.time)
    said = []
    for p, mark in enumerate(marks):
        gone = np.flatnonzero(followed.method[:, p] == LOST)
        if len(gone):
            said.append(
                f"mark {mark.name!r} is lost in {len(gone)} of {total} frames, first at "
                f"{followed.time[gone[0]]:.3f} s, last at {followed.time[gone[-1]]:.3f} s"
            )
        for code, how in FALLBACKS.items():
            used = np.flatnonzero(followed.method[:, p] == code)
            if len(used):
                said.append(
                    f"mark {mark.name!r} does not register in {len(used)} of {total} frames and is placed by "
                    f"{how} there, with a larger sd, first at {followed.time[used[0]]:.3f} s"
                )
    blind = np.flatnonzero(np.isnan(homography[:, 0, 0]))
    if len(blind):
        said.append(
            f"{len(blind)} of {total} frames show fewer than 4 frame marks and give nothing, first at "
            f"{followed.time[blind[0]]:.3f} s"
        )
    return (*said, *followed.said)
