"""Film, static film, camera and marks in, displacements in mm with their uncertainty out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision import depth
from vision.camera import Array, Camera
from vision.marks import Mark, check_names
from vision.noise import (
    MIN_STATIC,
    REST,
    Codec,
    NoiseModel,
    codec_noise,
    codec_sd,
    states,
    static_noise,
    with_y,
)
from vision.plane import homographies, to_plane
from vision.reference import prepare
from vision.tracks import DOT, LOST, Followed, Progress, Tracks, follow
from vision.video import Video

MIN_FRAME, MIN_FIXED = 6, 4
MAX_DEPTH_MM = 0.1  # of the frame marks
MAX_HEIGHT = 0.2  # of the camera's distance, for all other marks


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
    covariance: Array  # (s,p,3,3) mm2, independent part: static noise and, where the patch has moved, codec
    modes: Array  # (k,s,p,3) mm, errors shared by many values, 1 sd each
    mode_names: tuple[str, ...]  # (k,) scale, placement:<name>:x|z, reference:<name>:1|3, those of `depth`
    noise: NoiseModel
    reference: NDArray[np.intp]  # (r,) frames of the reference
    tracks: Tracks
    homography: Array  # (s,3,3) plane (x, z, 1) mm to undistorted px
    lost: tuple[str, ...]  # what was lost and when, one sentence each
    remarks: tuple[str, ...] = ()  # marks off the plane: what was corrected, what seems to have left it


def measure(
    film: Video,
    static: Video,
    camera: Camera,
    marks: Sequence[Mark],
    *,
    dictionary: str = "DICT_4X4_50",
    placement_sd_mm: float = 0.3,
    scale_sd: float = 0.001,
    height_sd_mm: float = 0.3,
    out_of_plane_sd_mm: float = 0.3,
    reference_s: float = 1.8,
    progress: Progress | None = None,
) -> Displacements:
    """Displacements of the marks in the film.

    film: the test; at rest for its first reference_s seconds.
    static: at least 120 frames of the finger at rest, better 300.
    camera: from `calibrate_camera`, same setting.   marks: at least 6 "frame" and 4 "fixed" ones.
    placement_sd_mm: mm, how well a finger mark's centre sits on its nominal place.
    scale_sd: relative 1 sd of lengths.
    height_sd_mm: mm, how well a finger mark's distance from the frame marks' plane is known (its y).
    out_of_plane_sd_mm: mm, 1 sd of a finger mark's motion towards the camera at its largest displacement.
    reference_s: s.   progress: called with (stage, frames done, frames in all).

    Every frame has its own homography from the frame marks, so a shaken tripod does no harm; its noise is
    in the static noise of every point. Raises ValueError for marks that do not suffice or share ids, for a
    static film that is too short or shows no marks, and as `prepare` does.
    """
    frame, points = _check(static, marks)
    follower = prepare(film, camera, marks, dictionary=dictionary, reference_s=reference_s)
    still = _static(static, camera, marks, dictionary, reference_s, progress)
    followed = follow(film, follower, reference_s=reference_s, stage="film", progress=progress)
    nominal = np.array([mark.position for mark in marks])
    plane = nominal[frame][:, [0, 2]]
    homography = homographies(plane, followed.ideal[:, frame])
    rest = to_plane(homographies(plane, still.ideal[:, frame]), still.ideal[:, points])
    noise = static_noise(rest, [marks[p].name for p in points], static.path.name)
    codec = codec_noise(film, follower, followed, plane, frame, points, progress)
    ideal = followed.ideal[:, points]
    extra = codec_sd(codec, ideal, _mean(ideal[followed.reference]))
    noise = replace(noise, codec_sd=_while_moving(extra, states(ideal) != REST))
    linear = _linear(followed, homography)
    rotation = _rotation(linear)
    view, height = depth.viewpoint(camera, homography), depth.heights(marks, frame)
    _check_heights(marks, height, view)
    place = depth.to_own_plane(to_plane(homography, ideal), height[points], view)
    value = with_y(place - _mean(place[followed.reference]))
    output = [marks[p] for p in points]
    turns = _turns(value, rotation[:, points], nominal[points], output)
    reference = _reference_sd(noise, codec, len(followed.reference))
    modes, names = _modes(value, output, turns, reference, placement_sd_mm, scale_sd)
    for more, called in (
        depth.height_modes(value, output, view, sd_mm=height_sd_mm),
        depth.out_of_plane_modes(value, place, output, view, sd_mm=out_of_plane_sd_mm),
        depth.calibration_modes(
            camera,
            followed.ideal,
            homography,
            plane=plane,
            frame=frame,
            points=points,
            height=height[points],
            reference=followed.reference,
        ),
    ):
        modes, names = modes + more, names + called
    size, size_sd = _sizes(linear, still, noise, extra, points, plane, frame)
    return Displacements(
        followed.time,
        tuple(m.name for m in output),
        tuple(m.role for m in output),
        nominal[points],
        value,
        _covariance(value, noise, extra),
        np.array(modes) * np.isfinite(value[..., :1]),
        tuple(names),
        noise,
        followed.reference,
        _tracks(followed, marks, camera, rotation),
        homography,
        _lost(followed, marks, homography),
        (
            *_corrected(output, height[points], view),
            *depth.alarms(followed.time, size, size_sd, output, view, sd_mm=out_of_plane_sd_mm),
        ),
    )


def _check(static: Video, marks: Sequence[Mark]) -> tuple[list[int], list[int]]:
    """Rows of the frame marks and of the output marks; raises ValueError when they do not suffice."""
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
    rows = range(len(marks))
    return [p for p in rows if marks[p].role == "frame"], [p for p in rows if marks[p].role != "frame"]


def _static(
    static: Video,
    camera: Camera,
    marks: Sequence[Mark],
    dictionary: str,
    reference_s: float,
    progress: Progress | None,
) -> Followed:
    follower = prepare(static, camera, marks, dictionary=dictionary, reference_s=reference_s)
    return follow(static, follower, reference_s=reference_s, stage="static", progress=progress)


def _mean(place: Array) -> Array:
    """Mean (p,2) over the frames in which a point is seen; NaN for one never seen."""
    count = np.isfinite(place).sum(axis=0)
    return np.where(count > 0, np.nan_to_num(place).sum(axis=0) / np.maximum(count, 1), np.nan)


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


def _sizes(
    linear: Array,
    still: Followed,
    noise: NoiseModel,
    extra: Array,
    points: list[int],
    plane: Array,
    frame: list[int],
) -> tuple[Array, Array]:
    """Side (s,p) of each output mark against its mean in the reference, and its sd (s,p); NaN for dots."""
    at_rest = _linear(still, homographies(plane, still.ideal[:, frame]))[:, points]
    side = _side(at_rest)
    sd = np.array([np.std(s[np.isfinite(s)]) if np.isfinite(s).any() else np.nan for s in side.T])
    grown = np.sqrt(1.0 + np.nanmax(np.nan_to_num(extra / noise.sd) ** 2, axis=2))
    return _side(linear[:, points]), sd * grown


def _side(linear: Array) -> Array:
    """Root of the area by which linear maps (...,2,2) change a square."""
    return np.sqrt(np.abs(linear[..., 0, 0] * linear[..., 1, 1] - linear[..., 0, 1] * linear[..., 1, 0]))


def _linear(followed: Followed, homography: Array) -> Array:
    """Linear map (t,p,2,2) of each mark in the plane against its mean over the reference; NaN for dots."""
    ends = [
        to_plane(homography, _local_point(followed.warp, x, y))
        for x, y in ((0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5))
    ]
    across, down = ends[0] - ends[1], ends[2] - ends[3]
    linear = np.stack([across, down], axis=-1)
    reference = _mean(linear[followed.reference].reshape(len(followed.reference), -1, 4)).reshape(-1, 2, 2)
    turn = np.full(linear.shape, np.nan)
    known = np.isfinite(reference[:, 0, 0])
    turn[:, known] = linear[:, known] @ np.linalg.inv(reference[known])
    turn[followed.method == DOT] = np.nan
    return turn


def _rotation(turn: Array) -> Array:
    """Rotation (t,p) rad of each mark in the plane, from x towards z, from its linear map (t,p,2,2)."""
    angle = np.arctan2(turn[..., 1, 0] - turn[..., 0, 1], turn[..., 0, 0] + turn[..., 1, 1])
    for of_mark in angle.T:  # a lost frame must not spoil those after it
        seen = np.isfinite(of_mark)
        of_mark[seen] = np.unwrap(of_mark[seen])
    return np.asarray(angle)


def _local_point(warp: Array, x: float, y: float) -> Array:
    mapped = warp @ np.array([x, y, 1.0])
    return np.asarray(mapped[..., :2] / mapped[..., 2:])


def _turns(value: Array, rotation: Array, points: Array, marks: Sequence[Mark]) -> Array:
    """Rotation (s,p) rad of the finger where each mark sits; a dot takes the chord between its neighbours."""
    finger = sorted((p for p, mark in enumerate(marks) if mark.role == "finger"), key=lambda p: points[p, 0])
    turned = np.where(np.isfinite(value[:, :, 0]), rotation, 0.0)
    for i, p in enumerate(finger):
        if marks[p].marker is not None or len(finger) < 2:
            continue
        a, b = finger[max(i - 1, 0)], finger[min(i + 1, len(finger) - 1)]
        chord = (points[b] - points[a])[[0, 2]]
        now = chord + (value[:, b] - value[:, a])[:, [0, 2]]
        turned[:, p] = np.arctan2(chord[0] * now[:, 1] - chord[1] * now[:, 0], now @ chord)
    return np.nan_to_num(turned)


def _while_moving(extra: Array, moves: NDArray[np.bool_]) -> Array:
    """Rms (p,3) of the codec's sd (s,p,3) over the frames in which a point moves, 0 if it never does."""
    chosen = moves[..., None]
    return np.sqrt(np.sum(extra**2 * chosen, axis=0) / np.maximum(chosen.sum(axis=0), 1))


def _covariance(value: Array, noise: NoiseModel, extra: Array) -> Array:
    """Independent covariance (s,p,3,3) mm2: static, plus the codec's where a patch moves or has moved."""
    sd = np.sqrt(noise.sd**2 + extra**2)
    count = len(noise.sd)
    own = noise.correlation.reshape(count, 3, count, 3)[np.arange(count), :, np.arange(count)]
    covariance = sd[..., :, None] * sd[..., None, :] * own
    covariance[np.isnan(value[..., 0])] = np.nan
    return np.asarray(covariance)


def _reference_sd(noise: NoiseModel, codec: Codec, frames: int) -> Array:
    """Sd (p,3) mm of the reference's mean place; 0 in y.

    The mean of n values with lag-1 correlation rho, and the coding error frozen in all of them, which a mark
    that never moves keeps for the whole film, so that it cancels.
    """
    mean = noise.sd**2 / frames * (1.0 + noise.rho) / (1.0 - noise.rho)
    return np.nan_to_num(np.sqrt(mean + np.where(noise.codec_sd > 0, codec.held**2, 0.0)))


def _modes(
    value: Array,
    marks: Sequence[Mark],
    turns: Array,
    reference: Array,
    placement_sd_mm: float,
    scale_sd: float,
) -> depth.Modes:
    """Shared errors (s,p,3) mm, 1 sd each, and their names: scale, placement, reference."""
    modes, names = [np.nan_to_num(value) * scale_sd], ["scale"]
    for p, mark in enumerate(marks):
        if mark.role == "finger":
            cosine, sine = np.cos(turns[:, p]) - 1.0, np.sin(turns[:, p])
            for axis, along_x, along_z in (("x", cosine, sine), ("z", -sine, cosine)):
                mode = np.zeros(value.shape)
                mode[:, p, 0], mode[:, p, 2] = along_x * placement_sd_mm, along_z * placement_sd_mm
                modes.append(mode)
                names.append(f"placement:{mark.name}:{axis}")
    for p, mark in enumerate(marks):
        for component in (0, 2):
            mode = np.zeros(value.shape)
            mode[:, p, component] = reference[p, component]
            modes.append(mode)
            names.append(f"reference:{mark.name}:{component + 1}")
    return modes, names


def _tracks(followed: Followed, marks: Sequence[Mark], camera: Camera, rotation: Array) -> Tracks:
    return Tracks(
        followed.time,
        tuple(mark.name for mark in marks),
        camera.distort(followed.ideal),
        followed.covariance,
        rotation,
        followed.method,
    )


def _lost(followed: Followed, marks: Sequence[Mark], homography: Array) -> tuple[str, ...]:
    total = len(followed.time)
    said = []
    for p, mark in enumerate(marks):
        gone = np.flatnonzero(followed.method[:, p] == LOST)
        if len(gone):
            said.append(
                f"mark {mark.name!r} is lost in {len(gone)} of {total} frames, first at "
                f"{followed.time[gone[0]]:.3f} s, last at {followed.time[gone[-1]]:.3f} s"
            )
    blind = np.flatnonzero(np.isnan(homography[:, 0, 0]))
    if len(blind):
        said.append(
            f"{len(blind)} of {total} frames show fewer than 4 frame marks and give nothing, first at "
            f"{followed.time[blind[0]]:.3f} s"
        )
    return tuple(said)
