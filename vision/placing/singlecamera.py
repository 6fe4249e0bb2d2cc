"""Displacements in the plane of the frame marks, from what one camera saw; y is not observed: NaN."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera
from vision.errors import codingdrift, sharederrors
from vision.errors.codingdrift import coding_drift, shares
from vision.errors.codingvariance import Codec, codec_sd
from vision.errors.errormodel import FrameMisfit, Observed, Placed, measured_alone, with_errors
from vision.errors.independenterrors import Rest, at_rest, by_hand, independent, misfit
from vision.errors.sharederrors import Named, Stated
from vision.errors.staticnoise import REST, NoiseModel, states, static_noise, while_moving, with_y
from vision.following.markrotations import finger_turns, linear_maps, mean_seen, rotations, sides
from vision.following.tracks import COARSE, Followed, thinned
from vision.marks import Mark, frame_places, rows_of
from vision.perspective import Viewpoint, heights, to_own_plane, unlike, viewpoint
from vision.placing import planeerrors
from vision.placing.views import Seen
from vision.plane import MIN_VISIBLE, Plane, misplaced, plane_of, to_plane

MAX_DEPTH_MM = 0.1  # of the frame marks
MAX_HEIGHT = 0.2  # of the camera's distance, for all other marks


@dataclass(frozen=True, kw_only=True)
class _Scene:
    """Marks in the picture of the camera; rows of arrays are steps."""

    camera: Camera
    marks: Sequence[Mark]
    frame: list[int]
    points: list[int]
    film: Followed  # its steps
    still: Followed
    plane: Plane
    quiet: Plane  # of the static film
    view: Viewpoint
    height: Array  # (m,) mm off the frame marks' plane

    @property
    def output(self) -> list[Mark]:
        return [self.marks[p] for p in self.points]

    @cached_property
    def place(self) -> Array:
        """(s,p,2) mm, as if all lay in the frame marks' plane."""
        return to_plane(self.plane.homography, self.film.ideal[:, self.points])

    @cached_property
    def own_place(self) -> Array:
        """(s,p,2) mm, each mark in its own plane."""
        return to_own_plane(self.place, self.height[self.points], self.view)

    @cached_property
    def value(self) -> Array:
        """(s,p,3) mm."""
        return with_y(self.own_place - self.at_rest)

    @property
    def at_rest(self) -> Array:
        """(p,2) mm, mean over the reference."""
        return mean_seen(self.own_place[self.film.reference])


def in_plane(seen: Seen, marks: Sequence[Mark], stated: Stated, steps: NDArray[np.intp]) -> Placed:
    """Displacements in the frames `steps`, in the plane of the frame marks.

    Every frame has its own homography from the frame marks, so a shaken tripod does no harm; its noise is
    in the covariance of every place.
    """
    scene = _scene(seen, marks, steps)
    return with_errors(_observed(seen, scene, stated, steps), stated)


def _observed(seen: Seen, scene: _Scene, stated: Stated, steps: NDArray[np.intp]) -> Observed:
    place = to_plane(scene.quiet.homography, seen.still.ideal[:, scene.points])
    noise = static_noise(place, [mark.name for mark in scene.output], seen.static, _quiet_keys(seen))
    ideal = seen.film.ideal[:, scene.points]
    state, coding_sd = states(ideal), codec_sd(seen.codec, ideal, mean_seen(ideal[seen.film.reference]))
    noise = replace(noise, codec_sd=while_moving(coding_sd, state != REST))
    rest = at_rest(noise, scene.quiet, place)
    drift, flicker, unmodelled = _coding_drift(seen, scene, place, rest, steps)
    reference_sd, reference_shared = _reference_sd(noise, seen.codec, len(scene.film.reference))
    linear = linear_maps(seen.film, seen.film.homography(scene.marks))
    rotation = rotations(linear)
    turns = finger_turns(scene.value, rotation[steps][:, scene.points], scene.output)
    slope = sharederrors.slopes(scene.value, scene.output, turns)
    measured = measured_alone(slope, scene.output)
    return Observed(
        marks=scene.output,
        value=scene.value,
        rest=place,
        noise=noise,
        turns=turns,
        slope=slope,
        place=scene.at_rest,
        rotation=rotation,
        state=state[steps],
        variance=_variance(scene, rest, misfit(seen.film)[steps]),
        coding_sd=coding_sd[steps],
        flicker=flicker * with_y(shares(rest)),
        shaken_shared=seen.codec.shared,
        coding_drift=drift,
        reference_sd=reference_sd,
        reference_shared=reference_shared,
        frame=_frame_misfit(scene, rest, measured),
        modes=[*_modes(scene, stated, measured), _redrawn(seen, scene)],
        remarks=(
            *planeerrors.extrapolated(scene.camera, seen.film.ideal, [mark.name for mark in scene.marks]),
            *_grown(scene, linear[steps], coding_sd[steps] / noise.sd, stated),
        ),
        notes=(*unmodelled, *_corrected(scene)),
    )


def _scene(seen: Seen, marks: Sequence[Mark], steps: NDArray[np.intp]) -> _Scene:
    (frame, points), nominal = rows_of(marks), frame_places(marks)
    film = thinned(seen.film, steps)
    quiet = plane_of(nominal, seen.still.ideal[:, frame])
    plane = plane_of(nominal, film.ideal[:, frame])
    view, height = viewpoint(seen.camera, plane.homography), heights(marks, frame)
    _check_heights(marks, height, view)
    return _Scene(
        camera=seen.camera,
        marks=marks,
        frame=frame,
        points=points,
        film=film,
        still=seen.still,
        plane=plane,
        quiet=quiet,
        view=view,
        height=height,
    )


def _variance(scene: _Scene, rest: Rest, worse: Array) -> dict[str, Array]:
    """Variance (s,p,3) mm2 by source, without coding.   worse: (s,m) from `misfit`."""
    parts = independent(rest, scene.plane, scene.place, worse, scene.frame, scene.points)
    return by_hand(parts, scene.film, scene.plane, scene.points)


def _redrawn(seen: Seen, scene: _Scene) -> Named:
    """Errors of registration and lossy coding in a picture that lies elsewhere than at rest."""
    film, coded = scene.film, float(np.sqrt(np.mean(seen.codec.rest[[0, 2]] ** 2)))
    return sharederrors.redrawn(scene.value, film.ideal[:, scene.points], film.reference, scene.output, coded)


def _coding_drift(
    seen: Seen, scene: _Scene, place: Array, rest: Rest, steps: NDArray[np.intp]
) -> tuple[Named, float, tuple[str, ...]]:
    """Errors that stay in marks at rest until coding draws them anew, mm2 that are new in every frame, and a
    sentence where key frames are too many.

    place: (t,p,2) mm in the static film.
    """
    keys = codingdrift.stretches(seen.keys, len(seen.film.time))
    if not codingdrift.rare(keys):
        return {}, 0.0, ()
    film = plane_of(scene.plane.nominal, seen.film.ideal[:, scene.frame])
    frozen = float(np.mean(seen.codec.rest[[0, 2]] ** 2))
    error = coding_drift(film, scene.quiet, place, rest, frozen, keys, _quiet_keys(seen))
    if len(keys) > codingdrift.MOST:
        return (
            {},
            error.flicker,
            (
                f"The film has {len(keys)} key frames, at which the picture of markers at rest changes a "
                f"little. Of more than {codingdrift.MOST} this is not modelled.",
            ),
        )
    still = np.asarray(~(np.nan_to_num(rest.noise.codec_sd) > 0).any(axis=1))
    reference = scene.film.reference
    drift = codingdrift.key_modes(error, steps, reference, scene.output, still, scene.plane, scene.place)
    return drift, error.flicker, ()


def _quiet_keys(seen: Seen) -> list[slice]:
    """Stretches of the static film between key frames; one where its noise holds the steps at them."""
    parts, count = codingdrift.stretches(seen.still_keys, len(seen.still.time)), len(seen.still.time)
    return parts if codingdrift.rare(parts) else [slice(0, count)]


def _modes(scene: _Scene, stated: Stated, slope: Array) -> list[Named]:
    """Errors of what one camera does not see: heights, motion towards it, its own calibration; with what they
    make of places that are measured, of these slopes (s,p,2,2)."""
    value, output, film, view = scene.value, scene.output, scene.film, scene.view
    return [
        planeerrors.height_modes(value, scene.at_rest, slope, output, view, sd_mm=stated.height_mm),
        planeerrors.out_of_plane_modes(value, scene.own_place, output, view, sd_mm=stated.out_of_plane_mm),
        planeerrors.calibration_modes(
            scene.camera,
            film.ideal,
            scene.plane.homography,
            plane=scene.plane.nominal,
            frame=scene.frame,
            points=scene.points,
            height=scene.height[scene.points],
            reference=film.reference,
            slope=slope,
        ),
    ]


def _frame_misfit(scene: _Scene, rest: Rest, slope: Array) -> FrameMisfit:
    reference, plane = scene.film.reference, scene.plane
    residual, rests = mean_seen(plane.residual[reference]), plane.homography[reference]
    seen = np.isfinite(residual[:, 0])
    if seen.sum() >= MIN_VISIBLE:
        hidden = unlike(scene.camera, rests[np.isfinite(rests[:, 0, 0])], plane.nominal[seen])
        residual[seen] += hidden.mean(axis=0)
    return FrameMisfit(
        residual=residual,
        names=[scene.marks[p].name for p in scene.frame],
        fitted=6,
        modes=lambda sd: sharederrors.frame(misplaced(scene.plane, scene.place), reference, slope, sd),
        noise=rest.frame_variance / len(reference),
    )


def _reference_sd(noise: NoiseModel, codec: Codec, frames: int) -> tuple[Array, Array]:
    """Sd of the reference's mean places, mm: (p,3) each mark's own, (3,) what all marks share; 0 in y.

    The mean of n values of noise that lasts, and the coding error frozen in all of them, which a mark
    that never moves keeps for the whole film, so that it cancels.
    """
    grown = noise.persistence.of_mean(frames)
    variance = np.maximum(noise.sd**2 - noise.common_sd**2, 0.0) * grown
    variance = np.sqrt(variance + np.where(noise.codec_sd > 0, codec.rest**2, 0.0))
    return np.nan_to_num(variance), noise.common_sd * np.sqrt(grown)


def _check_heights(marks: Sequence[Mark], height: Array, view: Viewpoint) -> None:
    worst = int(np.argmax(np.abs(height)))
    if abs(height[worst]) > MAX_HEIGHT * abs(view.distance):
        raise ValueError(
            f"marker {marks[worst].name!r} lies {height[worst]:.1f} mm off the frame markers' plane and the "
            f"camera stands {abs(view.distance):.0f} mm away, wanted at most {MAX_HEIGHT:g} of that: "
            "check its y in mm"
        )


def _corrected(scene: _Scene) -> tuple[str, ...]:
    """One sentence where finger marks off the plane were corrected for their height."""
    off = [
        p
        for p, mark in enumerate(scene.marks)
        if mark.role == "finger" and abs(scene.height[p]) > MAX_DEPTH_MM
    ]
    if not off:
        return ()
    worst = max(off, key=lambda p: abs(scene.height[p]))
    return (
        f"{len(off)} finger markers lie off the plane of the frame markers, {scene.marks[worst].name!r} by "
        f"{scene.height[worst]:.1f} mm. This is corrected for a camera "
        f"{abs(scene.view.distance):.0f} mm away.",
    )


def _grown(scene: _Scene, linear: Array, extra: Array, stated: Stated) -> tuple[str, ...]:
    """Marks whose apparent size says that they leave the plane.   extra: (s,p,3), the codec's sd over that
    at rest, by which the size's sd grows."""
    # Only registration tells size well enough for an alarm.
    coarse = np.isin(scene.film.method, COARSE)
    size = sides(np.where(coarse[..., None, None], np.nan, linear)[:, scene.points])
    side = sides(linear_maps(scene.still, scene.quiet.homography)[:, scene.points])
    usual = np.array([np.std(s[np.isfinite(s)]) if np.isfinite(s).any() else np.nan for s in side.T])
    sd = np.asarray(usual * np.sqrt(1.0 + np.nanmax(np.nan_to_num(extra) ** 2, axis=2)))
    marks, view = scene.output, scene.view
    return planeerrors.alarms(scene.film.time, size, sd, marks, view, sd_mm=stated.out_of_plane_mm)
