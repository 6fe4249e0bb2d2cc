"""Displacements U1 U2 U3 from what two or more cameras saw.

Steps are frames of the first film; the other cameras' tracks are interpolated to their times. What their
clocks are apart is estimated from moving marks and taken out, see `placing.clocks.lags`. Heights and motion
out of the plane are measured, so that what is stated of them is not used. The scale is the board's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.calibration.rig import Rig
from vision.camera import Array
from vision.errors.codingvariance import codec_sd
from vision.errors.errormodel import FrameMisfit, Observed, Placed, with_errors
from vision.errors.independenterrors import misfit
from vision.errors.sharederrors import Stated, slopes
from vision.errors.staticnoise import REST, NoiseModel, states, static_noise, while_moving
from vision.following.markrotations import finger_turns, linear_maps, mean_seen, rotations
from vision.following.tracks import Followed
from vision.marks import Mark, rows_of
from vision.placing import spaceerrors
from vision.placing.clocks import Track, joined, lags
from vision.placing.triangulation import Places, Sight, places_of
from vision.placing.views import Seen


@dataclass(frozen=True, kw_only=True)
class _Scene:
    """Marks in the pictures of all cameras, in steps of the first film."""

    rig: Rig
    marks: Sequence[Mark]
    seen: Sequence[Seen]
    tracks: Sequence[Track]
    when: Array  # (s,) s on the clock that all cameras share
    lag: Array  # (c,) s, and its sd
    lag_sd: Array
    sight: Sight
    places: Places
    rest: Places  # of the static films

    @property
    def value(self) -> Array:
        """(s,p,3) mm."""
        return spaceerrors.displacement(self.places, self.sight.reference)


def in_space(
    seen: Sequence[Seen], rig: Rig, marks: Sequence[Mark], stated: Stated, steps: NDArray[np.intp]
) -> Placed:
    """Displacements in the frames `steps` of the first film, in all three axes."""
    return with_errors(_observed(_scene(seen, rig, marks, steps), steps), stated)


def _observed(scene: _Scene, steps: NDArray[np.intp]) -> Observed:
    points, film, value = list(scene.sight.points), scene.seen[0].film, scene.value
    output = [scene.marks[p] for p in points]
    noise = static_noise(scene.rest.place, [mark.name for mark in output], scene.seen[0].static)
    rotation = rotations(linear_maps(film, film.homography(scene.marks)))
    turns = finger_turns(value, rotation[steps][:, points], output)
    blur, coding, frozen = _worse(scene)
    coding_sd = np.sqrt(spaceerrors.through(scene.places, scene.sight, coding))
    state = states(film.ideal[:, points])[steps]
    noise = replace(noise, codec_sd=while_moving(np.nan_to_num(coding_sd), state != REST))
    return Observed(
        marks=output,
        value=value,
        rest=scene.rest.place,
        noise=noise,
        turns=turns,
        slope=slopes(value, output, turns),
        place=np.array([mark.position for mark in output])[:, [0, 2]],
        rotation=rotation,
        state=state,
        variance=spaceerrors.variances(noise, scene.rest, scene.places, scene.sight, blur),
        coding_sd=coding_sd,
        flicker=np.zeros(noise.sd.shape),
        reference_sd=_reference_sd(
            noise, spaceerrors.through(scene.places, scene.sight, frozen), scene.sight
        ),
        frame=_frame_misfit(scene),
        modes=[
            spaceerrors.clock_modes(
                scene.rig, scene.sight, scene.tracks, scene.when, scene.lag, scene.lag_sd, value
            ),
            spaceerrors.calibration(scene.rig, scene.sight, value),
        ],
        notes=_clock_notes(scene.lag, scene.lag_sd),
    )


def _frame_misfit(scene: _Scene) -> FrameMisfit:
    frame = list(scene.sight.frame)
    return FrameMisfit(
        residual=scene.places.misfit,
        names=[scene.marks[p].name for p in frame],
        fitted=6,
        modes=lambda sd: spaceerrors.tilt(scene.value, scene.sight.nominal[frame], sd),
        advice=", or the board's square, which sets the scale",
    )


def _scene(seen: Sequence[Seen], rig: Rig, marks: Sequence[Mark], steps: NDArray[np.intp]) -> _Scene:
    (frame, points), nominal = rows_of(marks), np.array([mark.position for mark in marks])
    tracks = [Track(s.film.time - s.film.time[0] + s.start, s.camera.distort(s.film.ideal)) for s in seen]
    when, reference = tracks[0].time[steps], np.searchsorted(steps, seen[0].film.reference)
    sight = Sight(
        raw=np.empty(0),
        variance=np.array([_usual(s.film) for s in seen]),
        nominal=nominal,
        frame=frame,
        points=points,
        reference=reference,
    )
    lag, lag_sd = lags(rig, sight, tracks, when)
    sight = joined(sight, tracks, when, lag)
    return _Scene(
        rig=rig,
        marks=marks,
        seen=seen,
        tracks=tracks,
        when=when,
        lag=lag,
        lag_sd=lag_sd,
        sight=sight,
        places=places_of(rig, sight),
        rest=places_of(rig, _at_rest(sight, seen)),
    )


def _usual(followed: Followed) -> Array:
    """Usual variance (m,) px2 of a mark's centre in each axis; the largest of all marks for a dot."""
    size = 0.5 * np.trace(followed.covariance, axis1=2, axis2=3)
    usual = np.array([np.median(x[np.isfinite(x)]) if np.isfinite(x).any() else np.nan for x in size.T])
    worst = np.nanmax(usual) if np.isfinite(usual).any() else 1.0
    return np.where(np.isfinite(usual), usual, worst)


def _at_rest(sight: Sight, seen: Sequence[Seen]) -> Sight:
    """The static films, frame by frame; every frame is reference."""
    count = min(len(s.still.time) for s in seen)
    raw = [s.camera.distort(s.still.ideal[:count]) for s in seen]
    return replace(sight, raw=np.array(raw), reference=np.arange(count))


def _worse(scene: _Scene) -> tuple[Array, Array, Array]:
    """Variance (c,t,p) px2 that blur and codec add in each camera, and what the codec leaves at rest."""
    points, sight = list(scene.sight.points), scene.sight
    scale = spaceerrors.px_per_mm(scene.places, scene.rig)
    blur, coding, frozen = [], [], []
    for c, s in enumerate(scene.seen):
        near, ideal = scene.tracks[c].nearest(scene.when), s.film.ideal[:, points]
        blur.append((misfit(s.film)[near][:, points] - 1.0) * sight.variance[c, points])
        extra = codec_sd(s.codec, ideal, mean_seen(ideal[s.film.reference]))[near][..., [0, 2]]
        coding.append(0.5 * (extra**2).sum(axis=-1) * scale[c] ** 2)
        ever = (extra > 0).any(axis=(0, 2))  # a mark that never moves keeps its error, so that it cancels
        frozen.append(0.5 * (s.codec.rest[[0, 2]] ** 2).sum() * scale[c] ** 2 * ever)
    return np.array(blur), np.array(coding), np.array(frozen)


def _reference_sd(noise: NoiseModel, frozen: Array, sight: Sight) -> Array:
    """Sd (p,3) mm of each mark's mean place in the reference.   frozen: (s,p,3) mm2, coding error at rest."""
    mean = noise.sd**2 * noise.persistence.of_mean(len(sight.reference))
    return np.asarray(np.sqrt(mean + np.nan_to_num(frozen[sight.reference]).mean(axis=0)))


def _clock_notes(lag: Array, sd: Array) -> tuple[str, ...]:
    return tuple(
        f"Camera {c + 1} shows the motion {1e3 * lag[c]:+.2f} ms later than its time stamps say "
        f"(sd {1e3 * sd[c]:.2f} ms). This is corrected."
        for c in np.flatnonzero(lag)
    )
