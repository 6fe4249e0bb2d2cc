"""Films of two or more cameras in, displacements U1 U2 U3 in mm with their uncertainty out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from vision import modes, spacemodes
from vision.budget import budget
from vision.camera import Array
from vision.clocks import Track, joined, lags
from vision.displacements import (
    UNLIKELY,
    Displacements,
    check_films,
    covariance_of,
    lost_marks,
    rows_of,
    tracks_of,
    while_moving,
)
from vision.marks import Mark
from vision.modes import Stated
from vision.noise import REST, Codec, NoiseModel, codec_noise, codec_sd, states, static_noise
from vision.plane import homographies
from vision.reference import prepare
from vision.rig import Rig
from vision.tracks import Followed, Progress, follow
from vision.turns import finger_turns, linear_maps, mean_seen, rotations
from vision.variance import misfit
from vision.video import Video
from vision.world import Places, Sight, places_of


@dataclass(frozen=True)
class Recording:
    """What one camera recorded."""

    film: Video
    static: Video
    start_s: float = 0.0  # s, first frame of the film on the clock that all cameras share


@dataclass(frozen=True)
class _Seen:
    """One recording, followed."""

    film: Followed
    still: Followed
    codec: Codec
    track: Track


def measure_in_space(
    recordings: Sequence[Recording],
    rig: Rig,
    marks: Sequence[Mark],
    *,
    dictionary: str = "DICT_4X4_50",
    stated: Stated = Stated(),  # noqa: B008 - frozen
    reference_s: float = 1.8,
    progress: Progress | None = None,
) -> Displacements:
    """Displacements of the marks in all three axes, from two or more cameras.

    recordings: one of each camera of the rig, in its order.   rig: from `vision.stereo.calibrate_rig`.
    marks, dictionary, stated, reference_s, progress: as for `vision.measure`; heights and motion out of the
    plane are measured, so that what is stated of them is not used. The scale is the board's.

    Steps are the frames of the first film; the other cameras' tracks are interpolated to their times. What
    their clocks are apart is estimated from moving marks and taken out, see `vision.clocks.lags`. Tracks and
    homography are those of the first camera. Raises ValueError as `measure` does.
    """
    if len(recordings) != len(rig.cameras):
        raise ValueError(f"{len(recordings)} recordings for {len(rig.cameras)} cameras: wanted one of each")
    frame, points = rows_of(marks)
    for recording in recordings:
        check_films(recording.static, marks)
    seen = [
        _followed(r, rig, c, marks, dictionary=dictionary, reference_s=reference_s, progress=progress)
        for c, r in enumerate(recordings)
    ]
    first, nominal = seen[0].film, np.array([mark.position for mark in marks])
    tracks, when = [s.track for s in seen], seen[0].track.time
    sight = Sight(
        np.empty(0), np.array([_usual(s.film) for s in seen]), nominal, frame, points, first.reference
    )
    lag, lag_sd = lags(rig, sight, tracks, when)
    sight = joined(sight, tracks, when, lag)
    places, rest = places_of(rig, sight), places_of(rig, _at_rest(sight, seen, rig))
    output = [marks[p] for p in points]
    noise = static_noise(rest.place, [mark.name for mark in output], recordings[0].static.path.name)
    value = spacemodes.displacement(places, sight.reference)
    homography = homographies(nominal[frame][:, [0, 2]], first.ideal[:, frame])
    rotation = rotations(linear_maps(first, homography))
    turns = finger_turns(value, rotation[:, points], nominal[points], output)
    frame_mm, remarks = _frame_sd(places.misfit, [marks[p].name for p in frame], stated.frame_mm)
    blur, codec, held = _worse(seen, sight, places, rig, when)
    parts = spacemodes.variances(noise, rest, places, sight, blur, codec)
    moves = states(first.ideal[:, points]) != REST
    noise = replace(noise, codec_sd=while_moving(np.nan_to_num(np.sqrt(parts["codec"])), moves))
    start = _reference_variance(noise, spacemodes.through(places, sight, held), sight)
    fields, names = modes.stacked(
        [
            modes.scale(value, stated.scale),
            modes.placement(value, output, turns, stated.placement_mm),
            modes.node(value, nominal[points], output, turns, stated.node_mm),
            spacemodes.tilt(value, nominal[frame], frame_mm),
            spacemodes.reference(value, output, start),
            spacemodes.clocks(rig, sight, tracks, when, lag, lag_sd, value),
            spacemodes.calibration(rig, sight, value),
        ],
        np.isfinite(value[..., 0]),
    )
    return Displacements(
        first.time,
        tuple(m.name for m in output),
        tuple(m.role for m in output),
        nominal[points],
        value,
        covariance_of(sum(parts.values(), np.zeros(value.shape)), noise, np.isfinite(value[..., 0])),
        fields,
        names,
        noise,
        sight.reference,
        tracks_of(first, marks, rig.cameras[0], rotation),
        homography,
        _lost(seen, marks, nominal[frame][:, [0, 2]]),
        budget(parts, fields, names, np.isfinite(value[..., 0])),
        (*remarks, *_clock_remarks(lag, lag_sd)),
    )


def _followed(
    recording: Recording,
    rig: Rig,
    number: int,
    marks: Sequence[Mark],
    *,
    dictionary: str,
    reference_s: float,
    progress: Progress | None,
) -> _Seen:
    """One recording, followed; the stages that `progress` is told are numbered."""
    camera, (frame, points) = rig.cameras[number], rows_of(marks)
    plane = np.array([mark.position for mark in marks])[frame][:, [0, 2]]
    ready = [
        prepare(film, camera, marks, dictionary=dictionary, reference_s=reference_s)
        for film in (recording.film, recording.static)
    ]
    film, still = (
        follow(video, follower, reference_s=reference_s, stage=f"{stage} {number + 1}", progress=progress)
        for video, follower, stage in zip(
            (recording.film, recording.static), ready, ("film", "static"), strict=True
        )
    )
    codec = codec_noise(recording.film, ready[0], film, plane, frame, points, progress)
    time = film.time - film.time[0] + recording.start_s
    return _Seen(film, still, codec, Track(time, camera.distort(film.ideal)))


def _lost(seen: Sequence[_Seen], marks: Sequence[Mark], plane: Array) -> tuple[str, ...]:
    frame, _ = rows_of(marks)
    return tuple(
        f"camera {c + 1}: {sentence}"
        for c, s in enumerate(seen)
        for sentence in lost_marks(s.film, marks, homographies(plane, s.film.ideal[:, frame]))
    )


def _usual(followed: Followed) -> Array:
    """Usual variance (m,) px2 of a mark's centre in each axis; that of the worst mark for a dot."""
    size = 0.5 * np.trace(followed.covariance, axis1=2, axis2=3)
    usual = np.array([np.median(x[np.isfinite(x)]) if np.isfinite(x).any() else np.nan for x in size.T])
    worst = np.nanmax(usual) if np.isfinite(usual).any() else 1.0
    return np.where(np.isfinite(usual), usual, worst)


def _at_rest(sight: Sight, seen: Sequence[_Seen], rig: Rig) -> Sight:
    """The static films, frame by frame; all of it is reference."""
    count = min(len(s.still.time) for s in seen)
    raw = [camera.distort(s.still.ideal[:count]) for camera, s in zip(rig.cameras, seen, strict=True)]
    return replace(sight, raw=np.array(raw), reference=np.arange(count))


def _worse(
    seen: Sequence[_Seen], sight: Sight, places: Places, rig: Rig, when: Array
) -> tuple[Array, Array, Array]:
    """Variance (c,t,p) px2 that blur and codec add in each camera, and what the codec leaves at rest."""
    points, scale = list(sight.points), spacemodes.px_per_mm(places, rig)
    blur, codec, held = [], [], []
    for c, s in enumerate(seen):
        near, ideal = s.track.nearest(when), s.film.ideal[:, points]
        blur.append((misfit(s.film)[near][:, points] - 1.0) * sight.variance[c, points])
        extra = codec_sd(s.codec, ideal, mean_seen(ideal[s.film.reference]))[near][..., [0, 2]]
        codec.append(0.5 * (extra**2).sum(axis=-1) * scale[c] ** 2)
        ever = (extra > 0).any(axis=(0, 2))  # a mark that never moves keeps its error, so that it cancels
        held.append(0.5 * (s.codec.held[[0, 2]] ** 2).sum() * scale[c] ** 2 * ever)
    return np.array(blur), np.array(codec), np.array(held)


def _reference_variance(noise: NoiseModel, held: Array, sight: Sight) -> Array:
    """Variance (p,3) mm2 of the reference's mean place."""
    mean = noise.sd**2 / len(sight.reference) * (1.0 + noise.rho) / (1.0 - noise.rho)
    return np.asarray(mean + np.nan_to_num(held[sight.reference]).mean(axis=0))


def _frame_sd(misfit: Array, names: Sequence[str], stated: float) -> tuple[float, tuple[str, ...]]:
    """How far frame marks are off their nominal places, mm: as stated, or what the rigid fit shows."""
    power = np.nansum(misfit**2, axis=1)
    free = 3 * int(np.isfinite(misfit[:, 0]).sum()) - 6
    if free < 1 or chi2.sf(power.sum() / stated**2, free) > UNLIKELY:
        return stated, ()
    found = float(np.sqrt(power.sum() / free))
    return found, (
        f"the frame marks are {found:.3f} mm off their stated places, {names[int(np.argmax(power))]!r} most, "
        f"and not {stated:g} mm (frame_sd_mm): {found:.3f} mm is used; measure their places again, or the "
        "board's square, which sets the scale",
    )


def _clock_remarks(lag: Array, sd: Array) -> tuple[str, ...]:
    return tuple(
        f"camera {c + 1} shows the motion {1e3 * lag[c]:+.2f} ms later than its time stamps say (sd "
        f"{1e3 * sd[c]:.2f} ms): taken out"
        for c in np.flatnonzero(lag)
    )
