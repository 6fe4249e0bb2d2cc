"""Models as the camera of the film would see them, in pixels, and their errors."""

from dataclasses import dataclass

import numpy as np

from twin.review.states import Array, Integers

MAGNIFIED = (1, 2, 5, 10, 20, 50, 100)  # how much longer than the errors arrows may be
LONGEST = 0.09  # of the picture's width, for nearly all arrows


@dataclass(frozen=True, kw_only=True)
class Trace:
    """One model in s pictures: the edge of its side face, and where it puts the markers."""

    label: str
    rms_mm: float  # of measured minus model, over the whole film
    edge: Array  # (s,k,2) px
    markers: Array  # (s,p,2) px; NaN where the marker's place at rest is not known


@dataclass(frozen=True, kw_only=True)
class Filmed:
    """All models over the film. Pixel (0, 0) is the centre of the top-left one."""

    size: tuple[int, int]  # px, width and height
    frame: Integers  # (s,) frames of the film that are shown
    time_s: Array  # (s,) film time
    names: tuple[str, ...]  # (p,) markers
    measured: Array  # (s,p,2) px; NaN = not seen
    models: tuple[Trace, ...]  # nominal constants, calibrated, and each effect that was added
    before: int  # which of them has no effect yet
    search: Trace  # the best of each generation at top pressure
    search_measured: Array  # (p,2) px, at top pressure
    expected_mm: float  # of the error, by noise and shared errors
    error_mm: tuple[Array, ...]  # (s,p) mm, each model's distance from every marker

    @property
    def numbers(self) -> tuple[int, ...]:
        """Indices of the models along the film: the one before effects were added, and the present one where
        it differs.
        """
        return tuple(dict.fromkeys((self.before, len(self.models) - 1)))

    @property
    def shown(self) -> tuple[Trace, ...]:
        """These models."""
        return tuple(self.models[k] for k in self.numbers)

    @property
    def worst(self) -> int:
        """The picture at which the model without effects misses its markers most."""
        error = self.error_mm[self.before]
        seen = np.isfinite(error)
        total = (np.where(seen, error, 0.0) ** 2).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
        return int(total.argmax())

    @property
    def magnified(self) -> int:
        """Magnification of the error arrows along the film, equal for all models."""
        return magnified(self.measured - self.models[self.before].markers, self.size)

    @property
    def search_magnified(self) -> int:
        """Magnification of the error arrows for the best of the generations."""
        return magnified(self.search_measured - self.search.markers[-1:], self.size)


def magnified(error: Array, size: tuple[int, int]) -> int:
    """The largest of some round factors that leaves nearly all errors (...,2) px short in a picture."""
    length = np.linalg.norm(error, axis=-1)
    length = length[np.isfinite(length)]
    far = float(np.quantile(length, 0.95)) if len(length) else np.inf
    return max((m for m in MAGNIFIED if m * far <= LONGEST * size[0]), default=1)


def rms(error_mm: Array) -> Array:
    """Root mean square (s,) mm of the markers' distances (s,p); NaN where none is seen."""
    seen = np.isfinite(error_mm)
    total, count = (np.where(seen, error_mm, 0.0) ** 2).sum(axis=1), seen.sum(axis=1)
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)
