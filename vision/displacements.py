"""Film, static film, camera and marks in, displacements in mm with their uncertainty out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
MAX_DEPTH_MM = 0.1


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
    mode_names: tuple[str, ...]  # (k,) scale, placement:<name>:x|z, reference:<name>:1|3
    noise: NoiseModel
    reference: NDArray[np.intp]  # (r,) frames of the reference
    tracks: Tracks
    homography: Array  # (s,3,3) plane (x, z, 1) mm to undistorted px
    lost: tuple[str, ...]  # what was lost and when, one sentence each


def measure(
    film: Video,
    static: Video,
    camera: Camera,
    marks: Sequence[Mark],
    *,
    dictionary: str = "DICT_4X4_50",
    placement_sd_mm: float = 0.3,
    scale_sd: float = 0.001,
    reference_s: float = 1.8,
    progress: Progress | None = None,
) -> Displacements:
    """Displacements of the marks in the film.

    film: the test; at rest for its first reference_s seconds.
    static: at least 120 frames of the finger at rest, better 300.
    camera: from `calibrate_camera`, same setting.   marks: at least 6 "frame" and 4 "fixed" ones.
    placement_sd_mm: mm, how well a finger mark's centre sits on its nominal place.
    scale_sd: relative 1 sd of lengths.
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
    rotation = _rotation(followed, homography)
    place = to_plane(homography, ideal)
    value = with_y(place - _mean(place[followed.reference]))
    output = [marks[p] for p in points]
    turns = _turns(value, rotation[:, points], nominal[points], output)
    reference = _reference_sd(noise, codec, len(followed.reference))
    modes, names = _modes(value, output, turns, reference, placement_sd_mm, scale_sd)
    return Displacements(
        followed.time,
        tuple(m.name for m in output),
        tuple(m.role for m in output),
        nominal[points],
        value,
        _covariance(value, noise, extra),
        modes,
        names,
        noise,
        followed.reference,
        _tracks(followed, marks, camera, rotation),
        homography,
        _lost(followed, marks, homography),
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
    depth = [mark.position[1] for mark in marks]
    if max(depth) - min(depth) > MAX_DEPTH_MM:
        raise ValueError(
            f"marks lie at y from {min(depth)} to {max(depth)} mm, wanted one plane within "
            f"{MAX_DEPTH_MM} mm: one camera measures in one plane only"
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


def _rotation(followed: Followed, homography: Array) -> Array:
    """Rotation (t,p) rad of each mark in the plane, from x towards z, against its mean over the reference."""
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
    angle = np.arctan2(turn[..., 1, 0] - turn[..., 0, 1], turn[..., 0, 0] + turn[..., 1, 1])
    return np.where(followed.method == DOT, np.nan, np.unwrap(angle, axis=0))


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
) -> tuple[Array, tuple[str, ...]]:
    """Shared errors (k,s,p,3) mm, 1 sd each, and their names."""
    seen = np.isfinite(value[..., 0])
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
    return np.array(modes) * seen[..., None], tuple(names)


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
