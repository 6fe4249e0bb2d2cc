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
from vision.errors import sharederrors
from vision.errors.codingvariance import codec_sd
from vision.errors.independenterrors import misfit
from vision.errors.sharederrors import Named, Stated
from vision.errors.staticnoise import REST, NoiseModel, states, static_noise
from vision.following.markrotations import finger_turns, linear_maps, mean_seen, rotations
from vision.following.tracks import Followed
from vision.marks import Mark, rows_of
from vision.placing import spaceerrors
from vision.placing.clocks import Track, joined, lags
from vision.placing.placed import Placed, while_moving
from vision.placing.triangulation import Places, Sight, places_of
from vision.placing.views import Seen


@dataclass(frozen=True, kw_only=True)
class _Scene:
    """Where the cameras see the marks, in steps of the first film."""

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
    """Displacements in the frames `steps` of the first film."""
    scene = _scene(seen, rig, marks, steps)
    output, value = [marks[p] for p in scene.sight.points], scene.value
    noise = static_noise(scene.rest.place, [mark.name for mark in output], seen[0].static)
    rotation = rotations(linear_maps(seen[0].film, seen[0].film.homography(marks)))
    points = np.array([mark.position for mark in output])
    turns = finger_turns(value, rotation[steps][:, list(scene.sight.points)], points, output)
    blur, codec, held = _worse(scene)
    parts = spaceerrors.variances(noise, scene.rest, scene.places, scene.sight, blur, codec)
    state, extra = states(seen[0].film.ideal[:, list(scene.sight.points)])[steps], np.sqrt(parts["codec"])
    noise = replace(noise, codec_sd=while_moving(np.nan_to_num(extra), state != REST))
    holds, loose, left = sharederrors.codec(extra, state, output)
    parts["codec"] = loose**2
    start = _reference_variance(noise, spaceerrors.through(scene.places, scene.sight, held), scene.sight)
    frame_mm, said = sharederrors.frame_sd(
        scene.places.misfit,
        [marks[p].name for p in scene.sight.frame],
        stated.frame_mm,
        fitted=6,
        advice=", or the board's square, which sets the scale",
    )
    shared = [*_modes(scene, value, turns, stated, frame_mm, start), holds]
    return Placed(
        value=value,
        noise=noise,
        rest=scene.rest.place,
        variance=parts,
        modes=shared,
        turns=turns,
        rotation=rotation,
        remarks=said,
        notes=(*left, *_clock_notes(scene.lag, scene.lag_sd)),
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


def _modes(
    scene: _Scene, value: Array, turns: Array, stated: Stated, frame_mm: float, start: Array
) -> list[Named]:
    """Errors shared by many values.   start: (p,3) mm2, variance of the reference."""
    output = [scene.marks[p] for p in scene.sight.points]
    nominal, sight = scene.sight.nominal, scene.sight
    return [
        sharederrors.scale(value, stated.scale),
        sharederrors.placement(value, output, turns, stated.placement_mm),
        sharederrors.node(value, nominal[list(sight.points)], output, turns, stated.node_mm),
        spaceerrors.tilt(value, nominal[list(sight.frame)], frame_mm),
        spaceerrors.reference_in_space(value, output, start),
        spaceerrors.clock_modes(scene.rig, sight, scene.tracks, scene.when, scene.lag, scene.lag_sd, value),
        spaceerrors.calibration(scene.rig, sight, value),
    ]


def _usual(followed: Followed) -> Array:
    """Usual variance (m,) px2 of a mark's centre in each axis; that of the worst mark for a dot."""
    size = 0.5 * np.trace(followed.covariance, axis1=2, axis2=3)
    usual = np.array([np.median(x[np.isfinite(x)]) if np.isfinite(x).any() else np.nan for x in size.T])
    worst = np.nanmax(usual) if np.isfinite(usual).any() else 1.0
    return np.where(np.isfinite(usual), usual, worst)


def _at_rest(sight: Sight, seen: Sequence[Seen]) -> Sight:
    """The static films, frame by frame; all of it is reference."""
    count = min(len(s.still.time) for s in seen)
    raw = [s.camera.distort(s.still.ideal[:count]) for s in seen]
    return replace(sight, raw=np.array(raw), reference=np.arange(count))


def _worse(scene: _Scene) -> tuple[Array, Array, Array]:
    """Variance (c,t,p) px2 that blur and codec add in each camera, and what the codec leaves at rest."""
    points, sight = list(scene.sight.points), scene.sight
    scale = spaceerrors.px_per_mm(scene.places, scene.rig)
    blur, codec, held = [], [], []
    for c, s in enumerate(scene.seen):
        near, ideal = scene.tracks[c].nearest(scene.when), s.film.ideal[:, points]
        blur.append((misfit(s.film)[near][:, points] - 1.0) * sight.variance[c, points])
        extra = codec_sd(s.codec, ideal, mean_seen(ideal[s.film.reference]))[near][..., [0, 2]]
        codec.append(0.5 * (extra**2).sum(axis=-1) * scale[c] ** 2)
        ever = (extra > 0).any(axis=(0, 2))  # a mark that never moves keeps its error, so that it cancels
        held.append(0.5 * (s.codec.rest[[0, 2]] ** 2).sum() * scale[c] ** 2 * ever)
    return np.array(blur), np.array(codec), np.array(held)


def _reference_variance(noise: NoiseModel, held: Array, sight: Sight) -> Array:
    """Variance (p,3) mm2 of the reference's mean place."""
    mean = noise.sd**2 * noise.persistence.of_mean(len(sight.reference))
    return np.asarray(mean + np.nan_to_num(held[sight.reference]).mean(axis=0))


def _clock_notes(lag: Array, sd: Array) -> tuple[str, ...]:
    return tuple(
        f"Camera {c + 1} shows the motion {1e3 * lag[c]:+.2f} ms later than its time stamps say "
        f"(sd {1e3 * sd[c]:.2f} ms). This is corrected."
        for c in np.flatnonzero(lag)
    )
