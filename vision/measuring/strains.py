"""Strain of a speckled face, from how its subsets stretch, and how well it is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import Array
from vision.errors.staticnoise import NoiseModel
from vision.following.markrotations import linear_maps, mean_seen
from vision.kinds import FacePoint
from vision.marks import Mark, rows_of
from vision.perspective import heights, viewpoint
from vision.placing import planeerrors
from vision.placing.views import Seen

COMPONENTS = ("E_xx", "E_zz", "E_xz")


@dataclass(frozen=True, kw_only=True)
class StrainField:
    """Green-Lagrange strain of a face's points, E = (F'F - 1) / 2, against the reference; NaN where lost."""

    time: Array  # (s,) s
    names: tuple[str, ...]  # (p,)
    points: Array  # (p,3) mm at rest
    value: Array  # (s,p,3) xx, zz, xz
    sd: Array  # (s,p,3) noise at rest, of compression, and of motion towards the camera, which all share


def strain_field(
    seen: Seen,
    marks: Sequence[Mark],
    noise: NoiseModel,
    steps: NDArray[np.intp],
    *,
    moved: Array,
    out_of_plane_mm: float,
) -> StrainField | None:
    """Strain of the face's points in the frames `steps`; None where there is no face.

    noise: of the points of the output.   moved: (s,q,3) mm, their displacements.   out_of_plane_mm: sd of
    motion towards the camera at the largest displacement.

    The sd is the scatter in the static film, that of the reference's mean, and grows as that of the places
    does where compression adds to it. Motion towards the camera adds what `seeming_strain` says.
    """
    output = rows_of(marks)[1]
    rows = [k for k, p in enumerate(output) if isinstance(marks[p].kind, FacePoint)]
    if not rows:
        return None
    face = [output[k] for k in rows]
    plane = seen.film.homography(marks)
    still = green_lagrange(linear_maps(seen.still, seen.still.homography(marks))[:, face])
    value = green_lagrange(linear_maps(seen.film, plane)[steps][:, face])
    frames = np.isfinite(still[..., 0]).sum(axis=0)
    scatter = np.sqrt(np.nansum((still - mean_seen(still)) ** 2, axis=0) / np.maximum(frames - 1, 1)[:, None])
    usual, coded = noise.sd[rows][:, [0, 2]], np.nan_to_num(noise.codec_sd[rows][:, [0, 2]])
    grown = np.sqrt(
        1.0 + np.mean(coded**2 / usual**2, axis=1) + noise.persistence.of_mean(len(seen.film.reference))
    )
    away = viewpoint(seen.camera, plane).distance - heights(marks, rows_of(marks)[0])[face]
    nearer = out_of_plane_mm * planeerrors.bulge(moved[:, rows]) / np.abs(away)
    return StrainField(
        time=seen.film.time[steps],
        names=tuple(marks[p].name for p in face),
        points=np.array([marks[p].position for p in face]),
        value=value,
        sd=np.hypot(scatter * grown[:, None], seeming_strain(value, np.nan_to_num(nearer))),
    )


def seeming_strain(strain: Array, nearer: Array) -> Array:
    """Strain (...,3) that is seen besides where a face comes nearer by a small share (...) of its distance.

    All of it is seen larger by that share e, F' = (1 + e) F, so that dE = e F'F = e (1 + 2 E), to first
    order. Where E is not known, that of a face at rest is taken.
    """
    return np.asarray(nearer[..., None] * (np.array([1.0, 1.0, 0.0]) + 2.0 * np.nan_to_num(strain)))


def green_lagrange(gradient: Array) -> Array:
    """Strain (...,3) xx, zz, xz of deformation gradients (...,2,2) in x and z: no rotation is in it.

    >>> green_lagrange(np.array([[1.1, 0.0], [0.0, 0.95]]))  # stretches of 1.1 and 0.95: (F'F - 1) / 2
    array([ 0.105  , -0.04875,  0.     ])
    >>> turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    >>> green_lagrange(turn @ np.array([[1.1, 0.0], [0.0, 0.95]]))
    array([ 0.105  , -0.04875,  0.     ])
    """
    strain = 0.5 * (np.swapaxes(gradient, -1, -2) @ gradient - np.eye(2))
    return np.stack([strain[..., 0, 0], strain[..., 1, 1], strain[..., 0, 1]], axis=-1)


def to_csv(field: StrainField) -> str:
    """The field as CSV: one row a time and point."""
    rows = ["time_s,point,x_mm,z_mm," + ",".join((*COMPONENTS, *(f"sd_{name}" for name in COMPONENTS)))]
    for time, strain, sds in zip(field.time, field.value, field.sd, strict=True):
        for name, place, values, sd in zip(field.names, field.points, strain, sds, strict=True):
            if np.isfinite(values[0]):
                cells = ",".join(f"{v:.6g}" for v in (place[0], place[2], *values, *sd))
                rows.append(f"{time:.6f},{name},{cells}")
    return "\n".join(rows) + "\n"


def quads(points: Array) -> NDArray[np.int64]:
    """Cells (e,4) between points (p,3) of a grid that is even in x and z, for a surface."""
    x, column = np.unique(np.round(points[:, 0], 6), return_inverse=True)
    z, row = np.unique(np.round(points[:, 2], 6), return_inverse=True)
    number = np.full((len(x), len(z)), -1, dtype=np.int64)
    number[column, row] = np.arange(len(points))
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    cells = corners.reshape(-1, 4)
    return np.asarray(cells[(cells >= 0).all(axis=1)])
