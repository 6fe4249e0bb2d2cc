"""What one camera or several tell of the marks' displacements, before it becomes a record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.errors.sharederrors import Named
from vision.errors.staticnoise import NoiseModel


@dataclass(frozen=True, kw_only=True)
class Placed:
    """Displacements of the fixed and finger marks in some of the film's frames."""

    value: Array  # (s,p,3) mm
    noise: NoiseModel  # from the static film, (p,3)
    rest: Array  # (t,p,2|3) mm, places in the static film
    variance: Mapping[str, Array]  # source to (s,p,3) mm2, independent parts
    modes: Sequence[Named]  # errors shared by many values
    turns: Array  # (s,p) rad of the finger at each mark
    rotation: Array  # (t,m) rad of all marks in all frames
    remarks: tuple[str, ...]  # what the user should check or change
    notes: tuple[str, ...]  # what was done without asking anything of the user


def thinned_noise(noise: NoiseModel, frames: int, steps: int) -> NoiseModel:
    """The noise model with the correlation of one step with the next where not every frame is a step."""
    return noise if steps == frames else replace(noise, rho=noise.rho ** (frames / steps))


def while_moving(extra: Array, moves: NDArray[np.bool_]) -> Array:
    """Rms (p,3) of the codec's sd (s,p,3) over the frames in which a point moves, 0 if it never does."""
    chosen = moves[..., None]
    return np.sqrt(np.sum(extra**2 * chosen, axis=0) / np.maximum(chosen.sum(axis=0), 1))
