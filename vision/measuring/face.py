"""A speckled side face beside the marks: its displacement field, as more points of the same measurement.

Subsets are cut on a grid in mm on the face and laid, affinely in the face's plane, on every frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Array, Camera, Image
from vision.film.checkpoint import Row, every_frame
from vision.film.video import Video
from vision.following import registration
from vision.following.markrotations import mean_seen
from vision.following.reference import MAX_REFERENCE
from vision.following.subsetbias import Curvature, curvature_of, straightened
from vision.following.tracks import OF_MARKS, Followed, Method
from vision.kinds import FacePoint
from vision.marks import Mark, linear_at_centre, px_per_unit, rows_of
from vision.perspective import viewpoint
from vision.placing.views import How, Seen, View

MAX_POINTS = 150  # two modes of its own each, of all points in all steps: 2.2 GB at 2000 steps
GROUP = "face"  # all of it is off its place, its nodes, its height alike
# Noise is smaller between pixels than on them, which pulls a match there: 0.003 px of bias at 0.1 px of shift
# without this blur, 0.0005 with it; doi 10.1007/s11340-013-9717-7.
BLUR_PX = 0.8
MIN_CORRELATION = 0.9
MIN_CONTRAST = 4.0  # grey levels, sd within a subset after the blur
NEIGHBOURS = 8
LEAST_PX = 15.0  # side of a subset


@dataclass(frozen=True)
class Face:
    """A flat speckled part of the finger at rest, and how it is cut up.

    >>> Face((0.0, -5.0), (20.0, 5.0), y=11.5, step_mm=10.0, subset_mm=8.0).points().tolist()
    [[4.0, -1.0], [14.0, -1.0]]
    """

    low: tuple[float, float]  # mm, smallest x and z of the speckles
    high: tuple[float, float]  # mm, largest x and z
    y: float  # mm
    step_mm: float  # between the subsets' centres
    subset_mm: float  # side of a subset

    def points(self) -> Array:
        """Centres (p,2) mm, x and z, of the subsets that lie wholly within. Raises ValueError for none."""
        half = 0.5 * self.subset_mm
        axes = [
            np.arange(a + half, b - half + 1e-9, self.step_mm)
            for a, b in zip(self.low, self.high, strict=True)
        ]
        count = len(axes[0]) * len(axes[1])
        if not 0 < count <= MAX_POINTS:
            raise ValueError(
                f"the face from {self.low} to {self.high} mm holds {count} subsets of {self.subset_mm:g} mm "
                f"every {self.step_mm:g} mm, wanted 1 to {MAX_POINTS} (every point has two modes "
                "of its own, and their memory grows with the square): change step_mm, subset_mm or region"
            )
        x, z = np.meshgrid(*axes, indexing="ij")
        return np.stack([x.ravel(), z.ravel()], axis=1)


def with_face(seen: Seen, view: View, marks: Sequence[Mark], face: Face, how: How) -> tuple[Seen, list[Mark]]:
    """The camera's sightings with the face's subsets as more marks, named face001, face002 and so on.

    face: where the speckles are at rest. Placement, node, height and motion out of the plane are one error
    for all of it.

    Raises ValueError for a region without texture, and for subsets below 15 px.
    """
    frame, _ = rows_of(marks)
    height = face.y - float(np.mean([marks[p].position[1] for p in frame]))
    still, film = (
        _joined(followed, _follow(video, seen.camera, followed, homography, face, height, how, stage))
        for video, followed, stage in (
            (view.static, seen.still, "static-face"),
            (view.film, seen.film, "face"),
        )
        for homography in [followed.homography(marks)]
    )
    kind = FacePoint(face.subset_mm)
    spots = [
        Mark(f"face{k + 1:03d}", kind, (float(x), face.y, float(z)), "finger", GROUP)
        for k, (x, z) in enumerate(face.points())
    ]
    return replace(seen, film=film, still=still), [*marks, *spots]


def smooth(image: Image) -> NDArray[np.float32]:
    """The picture for matching: blurred by BLUR_PX."""
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR_PX), dtype=np.float32)


def _joined(marks: Followed, face: Followed) -> Followed:
    pairs = {name: (getattr(marks, name), getattr(face, name)) for name in OF_MARKS}
    both: dict[str, Any] = {name: np.concatenate(pair, axis=1) for name, pair in pairs.items()}
    return replace(marks, **both)


def _follow(
    film: Video, camera: Camera, marks: Followed, homography: Array, face: Face, height: float, how: How,
    stage: str,
) -> Followed:  # fmt: skip
    """The face's subsets in every frame."""
    view = viewpoint(camera, homography[marks.reference])
    half = 0.5 * face.subset_mm / (1.0 - height / view.distance)
    centre = view.foot + (face.points() - view.foot) / (1.0 - height / view.distance)
    start = homography[marks.reference[0]] @ _local(centre, half)
    scale = px_per_unit(start / start[:, 2:, 2:])
    if 2.0 * np.median(scale) < LEAST_PX:
        raise ValueError(
            f"a subset of {face.subset_mm:g} mm is {2 * np.median(scale):.0f} px wide, wanted {LEAST_PX:g} "
            "or more: take larger subsets or a closer camera"
        )
    grid = registration.local_grid(int(np.clip(np.ceil(2.0 * np.median(scale)), 15, 60)), 1.0)
    lens = registration.lens_of(camera)
    patch = _mean_patches(film, lens, homography, centre, start, grid, marks.reference)
    templates = registration.affine_templates(patch, grid)
    start = start / start[:, 2:, 2:]
    near = [np.argsort(np.hypot(*(centre - c).T), kind="stable")[1 : NEIGHBOURS + 1] for c in centre]
    rows = every_frame(
        film,
        partial(find_subsets, lens=lens, templates=templates, rest=start, near=near),
        start,
        nothing=(np.full(start.shape, np.nan), np.full(len(start), np.nan)),
        stage=stage,
        progress=how.progress,
        keeper=how.keeper,
    )
    warp, match = (np.array([row[k] for row in rows]) for k in (0, 1))
    seen, linear = np.isfinite(warp[..., 0, 0]), linear_at_centre(warp)
    ideal, covariance = _straight(
        curvature_of(centre, -half, patch, templates),  # local axes run against those of the plane
        warp[..., :2, 2] / warp[..., 2:, 2],
        linear,
        registration.centre_covariance(templates, linear, match),
        marks.reference,
    )
    return Followed(
        time=marks.time,
        warp=warp,
        ideal=ideal,
        covariance=covariance,
        method=np.where(seen, Method.REGISTERED, Method.LOST).astype(np.int8),
        growth=np.ones(seen.shape),
        reference=marks.reference,
    )


def _straight(
    curvature: Curvature, place: Array, linear: Array, covariance: Array, reference: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Places (t,p,2) px without the shift by the strain's gradient, and their covariance (t,p,2,2) px2."""
    pairs = list(zip(place, linear, covariance, strict=True))
    rest = np.nan_to_num(mean_seen(np.array([curvature.shift(*pairs[t][:2]) for t in reference])))
    both = [straightened(curvature, *pair, rest) for pair in pairs]
    return np.array([p for p, _ in both]), np.array([c for _, c in both])


def _local(centre: Array, half: float) -> Array:
    """From the subset's local square to the plane (x, z, 1) mm, (p,3,3)."""
    local = np.zeros((len(centre), 3, 3))
    local[:, 0, 0], local[:, 1, 1], local[:, 2, 2] = -half, -half, 1.0
    local[:, :2, 2] = centre
    return local


def _mean_patches(
    film: Video, lens: Array, homography: Array, centre: Array, start: Array, grid: Array,
    reference: NDArray[np.intp],
) -> Array:  # fmt: skip
    """Mean patches (p,3,n) of the reference frames, laid by each frame's own homography."""
    local = np.linalg.inv(homography[reference[0]]) @ start
    total, count = np.zeros((len(centre), 3, grid.shape[1])), 0
    for index, _, image in islice(film.frames(), min(len(reference), MAX_REFERENCE)):
        if np.isfinite(homography[index, 0, 0]):
            warp = homography[index] @ local
            total += registration.patches(smooth(image), lens, warp / warp[:, 2:, 2:], grid)
            count += 1
    mean = total / max(count, 1)
    flat = np.flatnonzero(mean[:, 0].std(axis=1) < MIN_CONTRAST)
    if len(flat):
        x, z = centre[flat[0]]
        raise ValueError(
            f"{len(flat)} of {len(centre)} subsets show no speckles, the first at x {x:.1f}, z {z:.1f} mm: "
            "correct the region, or take larger subsets"
        )
    return mean


def find_subsets(
    image: Image,
    last: Array,
    *,
    lens: Array,
    templates: registration.Templates,
    rest: Array,
    near: list[NDArray[np.intp]],
) -> tuple[Row, Array]:
    """Warps (p,3,3) and correlations (p,) in one picture, and where subsets were last seen.

    rest: (p,3,3) warps at the start.   near: the neighbours by which a lost subset is looked for.
    """
    picture, every = smooth(image), np.arange(len(rest))
    warp, match = registration.register(picture, lens, templates, last, px_per_unit(last), every)
    for p in np.flatnonzero(match < MIN_CORRELATION):
        good = [q for q in near[p] if match[q] >= MIN_CORRELATION]
        if good:  # as the neighbour moved since the start
            guess = (warp[good[0]] @ np.linalg.inv(rest[good[0]]) @ rest[p])[None]
            again, correlation = registration.register(
                picture, lens, templates, guess / guess[:, 2:, 2:], px_per_unit(guess), every[p : p + 1]
            )
            warp[p], match[p] = again[0], correlation[0]
    lost = match < MIN_CORRELATION
    last = np.where(lost[:, None, None], last, warp)
    warp[lost], match[lost] = np.nan, np.nan
    return (warp, match), last
