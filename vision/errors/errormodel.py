"""The error model: all independent variances and shared errors of displacements, of one camera or several.

One more source of error is a function in this room, a line in `with_errors` and a line in SOURCES. Errors
that depend on the cameras come in `Observed`, from `placing.singlecamera` or `placing.multicamera`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.errors import sharederrors
from vision.errors.sharederrors import CREEP_SHARED, Named, Stated
from vision.errors.staticnoise import NoiseModel
from vision.marks import Mark

# Source of an error, and what makes it smaller.
SOURCES = {
    "static": "more light, larger or sharper markers, more pixels per mm",
    "jitter": "camera and frame markers on one stiff support, steady light",
    "homography": "more frame markers, and none of them hidden",
    "blur": "shorter exposure, sharper focus, no glare or shadow",
    "codec": "a lossless or high-rate recording",
    "by_hand": "fewer places clicked by hand, or clicked more exactly (sd_px)",
    "reference": "a longer rest before the test",
    "frame": "frame markers measured or printed more exactly (frame_sd_mm)",
    "scale": "a more exact length between the frame markers (scale_sd)",
    "calibration": "more board pictures, in more tilts, all over the picture",
    "out_of_plane": "a longer lens from farther away, or a second camera",
    "height": "the markers' distances from the plane measured",
    "placement": "markers placed with a jig, or their places measured (placement_sd_mm)",
    "node": "points measured where they are on the finger (node_sd_mm)",
    "pose": "markers on the clamp, or the finger's place in the frame measured ([pose])",
    "sync": "one clock, or a flash in the film",
    "readout": "a camera with a global shutter, or a mode that reads faster (readout_ms)",
    "camera_clock": "one trigger for all cameras",
}


@dataclass(frozen=True, kw_only=True)
class FrameMisfit:
    """Frame marks against their nominal places, after the fit of a homography or of a rigid motion."""

    residual: Array  # (f,2) or (f,3) mm; NaN for marks never seen
    names: Sequence[str]  # (f,)
    fitted: int  # numbers of the fit: 8 of a homography, 6 of a rigid motion
    modes: Callable[[float], Named]  # shared errors of all places, from the sd in mm of one frame mark
    noise: float = 0.0  # mm2, of one component's mean
    advice: str = ""  # what else may be wrong


@dataclass(frozen=True, kw_only=True)
class Observed:
    """Displacements of the p fixed and finger marks in s steps, with the errors that cameras alone tell."""

    marks: Sequence[Mark]  # (p,)
    value: Array  # (s,p,3) mm
    rest: Array  # (t,p,2|3) mm, places in the static film
    noise: NoiseModel  # from the static film, (p,3)
    turns: Array  # (s,p) rad of the finger at each mark
    slope: Array  # (s,p,2,2) of the displacement by the material point
    place: Array  # (p,2) mm, mean over the reference
    rotation: Array  # (t,m) rad of all marks in all frames
    state: NDArray[np.int8]  # (s,p) of each patch, from `staticnoise.states`
    variance: Mapping[str, Array]  # source to (s,p,3) mm2, independent parts without coding
    coding_sd: Array  # (s,p,3) mm, of the coding error while a patch moves or has moved
    flicker: Array  # (p,3) mm2, of coding, new in every frame of a mark at rest
    reference_sd: Array  # (p,3) mm, of each mark's mean place in the reference
    frame: FrameMisfit
    modes: Sequence[Named]  # errors of cameras, clocks and heights
    reference_shared: Array | None = None  # (3,) mm, of the reference, alike in all marks
    shaken_shared: float = CREEP_SHARED  # share of a shaken patch's coding variance that stays
    coding_drift: Named = field(default_factory=dict)  # coding errors of resting marks between key frames
    remarks: tuple[str, ...] = ()  # what the user should check or change
    notes: tuple[str, ...] = ()  # what was done without asking anything of the user


@dataclass(frozen=True, kw_only=True)
class Placed:
    """Displacements of the fixed and finger marks in some of the film's frames, with all their errors."""

    value: Array  # (s,p,3) mm
    noise: NoiseModel  # from the static film, (p,3)
    rest: Array  # (t,p,2|3) mm, places in the static film
    variance: Mapping[str, Array]  # source to (s,p,3) mm2, independent parts
    modes: Sequence[Named]  # errors shared by many values
    turns: Array  # (s,p) rad of the finger at each mark
    rotation: Array  # (t,m) rad of all marks in all frames
    remarks: tuple[str, ...]  # what the user should check or change
    notes: tuple[str, ...]  # what was done without asking anything of the user


def with_errors(observed: Observed, stated: Stated) -> Placed:
    """Displacements with every independent variance and every shared error, for any number of cameras."""
    value, marks, turns, frame = observed.value, observed.marks, observed.turns, observed.frame
    slope, place = measured_alone(observed.slope, marks), observed.place
    frame_mm, doubted = sharederrors.frame_sd(
        frame.residual, frame.names, stated.frame_mm,
        fitted=frame.fitted, noise=frame.noise, advice=frame.advice,
    )  # fmt: skip
    holds, coding_sd, unshared = sharederrors.codec(
        observed.coding_sd, observed.state, marks, observed.shaken_shared
    )
    coding_sd = np.where(coding_sd > 0.0, coding_sd, np.sqrt(observed.flicker))
    return Placed(
        value=value,
        noise=observed.noise,
        rest=observed.rest,
        variance={**observed.variance, "codec": coding_sd**2},
        modes=[
            sharederrors.scale(value, stated.scale, sharederrors.of_places(slope, place)),
            sharederrors.placement(value, marks, turns, stated.placement_mm),
            sharederrors.node(value, marks, observed.slope, stated.node_mm, stated.place_mm),
            sharederrors.pose(value, place, slope, stated.pose),
            frame.modes(frame_mm),
            sharederrors.reference_mode(value, marks, observed.reference_sd, observed.reference_shared),
            *observed.modes,
            holds,
            observed.coding_drift,
        ],
        turns=turns,
        rotation=observed.rotation,
        remarks=(*doubted, *observed.remarks),
        notes=(*unshared, *observed.notes),
    )


def measured_alone(slope: Array, marks: Sequence[Mark]) -> Array:
    """Slopes (s,p,2,2) of the marks whose places the film shows, 0 for those whose places are stated."""
    return np.asarray(slope * np.array([mark.measured for mark in marks])[:, None, None], float)
