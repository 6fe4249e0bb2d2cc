"""The states that review and report show, as plain arrays: one per generation, one per film time.

`Generations` is what the genetic algorithm went through; `Fields` is the calibrated model along the film;
`Strains` what a speckled face shows. They are saved as .npz without pickle, so a run folder can be reviewed
long after the run.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from twin import files
from twin.targets import Array

Single = NDArray[np.float32]
Integers = NDArray[np.int64]


class _Stored:
    """Gives a frozen dataclass of arrays and numbers `.save(path)` and `.load(path)`."""

    def save(self, path: Path) -> None:
        """Write all fields to `path` (.npz, compressed, no pickle), atomically."""
        files.write_npz(path, {name: getattr(self, name) for name in _kinds(type(self))})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what `save` wrote. ValueError where a field is missing, or is not what it should be."""
        kinds = _kinds(cls)
        stored = files.read_npz(path, *kinds)
        try:
            return cls(**{name: _plain(stored[name], kind) for name, kind in kinds.items()})
        except ValueError as error:
            raise ValueError(f"{path}: {error}; {files.AGAIN}") from None


@dataclass(frozen=True, kw_only=True)
class Generations(_Stored):
    """The best individual of every generation at the first arrival at top pressure."""

    generation: Integers  # (g,) number of the generation, increasing
    names: tuple[str, ...]  # (d,) parameters
    best: Array  # (g,d) parameters of the best individual
    rms_mm: Array  # (g,) its root mean square error, mm
    nodes: Array  # (n,3) undeformed, mm
    triangles: Integers  # (t,3) surface, node indices, counter-clockwise from outside
    u: Single  # (g,n,3) displacement at top pressure, mm
    point_names: tuple[str, ...]  # (p,) markers
    points: Array  # (p,3) markers at rest, mm
    u_points: Array  # (g,p,3) model at the markers, mm
    u_measured: Array  # (p,3) measured at the same step, mm; NaN = not observed
    film_time_s: float  # first arrival at top pressure, s
    film_frame: int  # the frame shown for it

    def __post_init__(self) -> None:
        g, n, p = len(self.generation), len(self.nodes), len(self.points)
        _check_triangles(self.triangles, n)
        _check(self, {"best": (g, len(self.names)), "rms_mm": (g,), "nodes": (n, 3), "u": (g, n, 3)})
        _check(self, {"points": (len(self.point_names), 3), "u_points": (g, p, 3), "u_measured": (p, 3)})


@dataclass(frozen=True, kw_only=True)
class Fields(_Stored):
    """The calibrated model (with its named effect) at k times of the film."""

    time_s: Array  # (k,) film time, s, increasing
    pressure: Array  # (k,) MPa
    u: Single  # (k,n,3) displacement of the nodes of `Generations`, mm
    u_points: Array  # (k,p,3) model at the markers, mm
    u_measured: Array  # (k,p,3) measured, mm; NaN = not observed

    def __post_init__(self) -> None:
        k, n, p = len(self.time_s), self.u.shape[1], self.u_points.shape[1]
        _check(self, {"pressure": (k,), "u": (k, n, 3), "u_points": (k, p, 3), "u_measured": (k, p, 3)})


@dataclass(frozen=True, kw_only=True)
class Strains(_Stored):
    """The strain of a speckled face at k times of the film, and where the film shows its points."""

    time_s: Array  # (k,) film time, s, increasing
    components: tuple[str, ...]  # (c,) E_xx, E_zz, E_xz
    names: tuple[str, ...]  # (p,) points
    size: tuple[int, int]  # px, width and height of the film
    pixel: Array  # (k,p,2) px; NaN = lost
    value: Array  # (k,p,c) Green-Lagrange strain; NaN = lost
    sd: Array  # (k,p,c)

    def __post_init__(self) -> None:
        k, p, c = len(self.time_s), len(self.names), len(self.components)
        _check(self, {"size": (2,), "pixel": (k, p, 2), "value": (k, p, c), "sd": (k, p, c)})


def _kinds(cls: type) -> dict[str, Any]:
    """Type of each field, by name."""
    return {field.name: field.type for field in fields(cls)}


def _plain(array: NDArray[Any], kind: Any) -> Any:
    """A stored array as the dataclass holds it: tuples of text, Python numbers, arrays. ValueError where it
    is of another kind."""
    text, number = kind == tuple[str, ...], kind in (int, float)
    # an array of no names is stored as numbers
    if (text != (array.dtype.kind == "U") and array.size) or number != (array.ndim == 0):
        raise ValueError(f"an array holds {array.dtype} of shape {array.shape}: wanted {kind}")
    if text:
        return tuple(str(item) for item in array)
    return array.item() if number else array


def _check(data: object, shapes: dict[str, tuple[int, ...]]) -> None:
    for name, shape in shapes.items():
        got = np.shape(getattr(data, name))
        if got != shape:
            raise ValueError(f"{type(data).__name__}.{name} has shape {got}, wanted {shape}")


def _check_triangles(triangles: Integers, nodes: int) -> None:
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.size == 0:
        raise ValueError(f"Generations.triangles has shape {triangles.shape}, wanted (t,3) with t > 0")
    if triangles.min() < 0 or triangles.max() >= nodes:
        raise ValueError(f"Generations.triangles names node {triangles.max()}, but there are {nodes} nodes")
