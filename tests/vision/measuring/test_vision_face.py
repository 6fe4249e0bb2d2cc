"""A speckled face on drawn film: an analytic field measured with pulls, shared errors, a region without speckles."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.pulls import band
from vision import Displacements, Video, View, measure
from vision.drawing import synthetic
from vision.errors.sharederrors import Stated
from vision.measuring.face import Face
from vision.measuring.strains import green_lagrange, quads, seeming_strain, to_csv

Array = NDArray[np.float64]
DEPTH, TIMES = 12.0, 24  # mm, frames
LOW, HIGH = (10.0, -42.0), (80.0, -12.0)  # mm, where the speckles are at rest
PERFECT = Stated(
    placement_mm=1e-6, scale=1e-9, frame_mm=1e-6, node_mm=1e-6, height_mm=1e-6, out_of_plane_mm=1e-6
)


def deformation(t: int) -> tuple[Array, Array]:
    """Gradient F (2,2) and shift (2,) mm in frame t: at rest for 1.5 s, then turned, stretched and moved."""
    ramp = max(0.0, (t - 15) / 8.0)
    turn = -0.22 * ramp
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return rotation @ np.diag([1.0 + 0.03 * ramp, 1.0 - 0.015 * ramp]), ramp * np.array([-3.0, -6.0])


def moved(points: Array, t: int) -> Array:
    gradient, shift = deformation(t)
    return np.asarray((points - LOW) @ gradient.T + LOW + shift)


class Speckles:
    """Gaussian blobs on the material, evaluated in closed form: nothing is interpolated."""

    def __init__(self) -> None:
        rng, self.size = np.random.default_rng(4), 0.55  # mm, sd of a blob
        self.blobs = rng.uniform(np.array(LOW) - 2, np.array(HIGH) + 2, (1700, 2))
        self.cell = 4 * self.size
        self.cells: dict[tuple[int, int], Array] = {}
        index = np.floor(self.blobs / self.cell).astype(int)
        low, high = index.min(axis=0), index.max(axis=0)
        # A cell without a blob of its own shows those of its neighbours: else it would have sharp edges.
        for key in np.stack(np.meshgrid(*map(np.arange, low, high + 1)), axis=-1).reshape(-1, 2):
            near = (np.abs(index - key) <= 1).all(axis=1)
            self.cells[int(key[0]), int(key[1])] = self.blobs[near]

    def __call__(self, t: int, place: Array) -> Array:
        gradient, shift = deformation(t)
        material = (place - np.array(LOW) - shift) @ np.linalg.inv(gradient).T + LOW
        grey = np.full(len(place), np.nan)
        # 1 mm more than is measured: at the speckles' very edge the wall behind them shows through the blur.
        inside = np.flatnonzero(
            ((material >= np.array(LOW) - 1) & (material <= np.array(HIGH) + 1)).all(axis=1)
        )
        index = np.floor(material[inside] / self.cell).astype(int)
        keys, which = np.unique(index, axis=0, return_inverse=True)
        for k, key in enumerate(keys):
            rows = inside[which.ravel() == k]
            blobs = self.cells.get((int(key[0]), int(key[1])), np.empty((0, 2)))
            distance = ((material[rows, None] - blobs[None]) ** 2).sum(axis=2) / (2 * self.size**2)
            grey[rows] = 205.0 - 55.0 * 2.8 * np.tanh(np.exp(-np.minimum(distance, 50.0)).sum(axis=1) / 2.8)
        return grey


@pytest.fixture(scope="module")
def films(lab: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Video, Video]:
    folder: Path = tmp_path_factory.mktemp("face")
    speckles, kept = Speckles(), {}

    def drawn(t: int, place: Array) -> Array:
        """The speckles; what is at rest is worked out once."""
        if t > 15:
            return speckles(t, place)
        if not kept:
            kept[0] = speckles(0, place)
        return np.asarray(kept[0])

    for name, count, face in (("film", TIMES, drawn), ("static", 120, lambda _, place: drawn(0, place))):
        place, turn = lab.motion(np.zeros(count))
        synthetic.film(
            folder / f"{name}.mkv", camera=lab.camera, pose=lab.pose, marks=lab.marks, positions=place,
            rotations=turn, codec="rawvideo", seed=count, face=(DEPTH, face),
        )  # fmt: skip
    return Video(folder / "film.mkv"), Video(folder / "static.mkv")


@pytest.fixture(scope="module")
def found(lab: Any, films: tuple[Video, Video]) -> Displacements:
    face = Face(LOW, HIGH, DEPTH, step_mm=10.0, subset_mm=9.0)
    return measure([View(*films, lab.camera)], lab.marks, face=face, stated=PERFECT, reference=1.5)


def rows(found: Displacements) -> list[int]:
    return [p for p, name in enumerate(found.names) if name.startswith("face")]


@pytest.mark.slow
def test_a_known_field_of_the_face_is_measured_with_pulls_of_one(found: Displacements) -> None:
    face = rows(found)
    assert len(face) == 21
    points = found.points[face][:, [0, 2]]
    truth = np.array([moved(points, t) - points for t in range(TIMES)])
    error = found.value[:, face][..., [0, 2]] - truth
    assert np.abs(truth).max() > 15.0
    assert not any("face" in remark for remark in found.remarks)  # it stretches: no alarm of depth
    assert np.isfinite(error).all()
    variance = np.diagonal(found.covariance, axis1=2, axis2=3) + (found.modes**2).sum(axis=0)
    pulls = error / np.sqrt(variance[:, face][..., [0, 2]])
    assert np.sqrt(np.mean(error**2)) < 0.003  # mm, 0.01 px at 3.4 px/mm
    still = slice(0, 16)
    low, high = band(16 * 21 * 2 / 4)  # frames, subsets, axes; subsets share pixels with their neighbours
    assert low < np.sqrt(np.mean(pulls[still] ** 2)) < high
    # a stretched, turned patch is interpolated otherwise than at rest: twice the noise is the most it adds
    assert np.sqrt(np.mean(pulls[16:] ** 2)) < 2.0


def test_errors_of_the_whole_face_are_one_mode(found: Displacements) -> None:
    shared = [name for name in found.mode_names if name.split(":")[1:2] == ["face"]]
    assert sorted(shared) == [
        "height:face",
        "node:face:x",
        "node:face:z",
        "out_of_plane:face",
        "placement:face:x",
        "placement:face:z",
    ]
    assert not any(name.startswith("placement:face0") for name in found.mode_names)


def test_a_region_without_speckles_is_refused(lab: Any, films: tuple[Video, Video]) -> None:
    face = Face((10.0, -42.0), (80.0, 20.0), DEPTH, step_mm=10.0, subset_mm=9.0)
    with pytest.raises(ValueError, match="subsets show no speckles, the first at x"):
        measure([View(*films, lab.camera)], lab.marks, face=face, stated=PERFECT, reference=1.5)
    small = Face(LOW, HIGH, DEPTH, 10.0, 2.0)
    with pytest.raises(ValueError, match=r"a subset of 2 mm is \d+ px wide, wanted 15"):
        measure([View(*films, lab.camera)], lab.marks, face=small, reference=1.5)
    with pytest.raises(ValueError, match="holds 0 subsets of 40 mm"):
        Face(LOW, HIGH, DEPTH, 10.0, 40.0).points()


def test_strain_is_the_material_s_with_its_sd(found: Displacements) -> None:
    field = found.strain
    assert field is not None
    assert field.names == tuple(found.names[p] for p in rows(found))
    truth = np.array([green_lagrange(deformation(t)[0]) for t in range(TIMES)])[:, None]
    assert np.abs(truth).max() > 0.03  # turned by 13 degrees besides, which is no strain
    pulls = (field.value - truth) / field.sd
    low, high = band(16 * 21 * 3 / 8)  # frames, subsets, components; neighbours share pixels, components slopes
    assert low < np.sqrt(np.mean(pulls[:16] ** 2)) < high
    # a stretched, turned patch is interpolated otherwise than at rest
    assert np.sqrt(np.mean(pulls[16:] ** 2)) < 2.0
    assert np.abs(field.value - truth).max() < 0.002
    lines = to_csv(field).splitlines()
    assert lines[0] == "time_s,point,x_mm,z_mm,E_xx,E_zz,E_xz,sd_E_xx,sd_E_zz,sd_E_xz"
    assert len(lines) == 1 + TIMES * len(field.names)
    assert float(lines[-1].split(",")[4]) == pytest.approx(field.value[-1, -1, 0], rel=1e-5)
    cells = quads(field.points)
    assert len(cells) == 6 * 2  # of 7 x 3 points
    edges = field.points[cells][:, 1] - field.points[cells][:, 0]
    np.testing.assert_allclose(edges, [[10.0, 0.0, 0.0]] * len(cells), atol=1e-9)


NEARER_MM = 1.5  # at the end of the ramp


@pytest.mark.slow
def test_a_face_that_comes_nearer_seems_to_stretch_as_the_sd_says(
    lab: Any, films: tuple[Video, Video], tmp_path: Path
) -> None:
    """Drawn by the pinhole: what is dy nearer is seen on the plane of rest, D away, (D - dy) / D as far out."""
    rvec, tvec = lab.pose
    eye = -np.asarray(cv2.Rodrigues(rvec)[0]).T @ tvec
    away, foot, speckles = eye[1] - DEPTH, eye[[0, 2]], Speckles()
    ramp = np.clip((np.arange(TIMES) - 15) / 8.0, 0.0, 1.0)
    share = 1.0 - NEARER_MM * ramp / away
    place, turn = lab.motion(np.zeros(TIMES))
    synthetic.film(
        tmp_path / "nearer.mkv", camera=lab.camera, pose=lab.pose, marks=lab.marks, positions=place, rotations=turn,
        codec="rawvideo", seed=5, face=(DEPTH, lambda t, seen: speckles(0, foot + (seen - foot) * share[t])),
    )  # fmt: skip
    face = Face((20.0, -36.0), (50.0, -18.0), DEPTH, step_mm=10.0, subset_mm=9.0)
    views = [View(Video(tmp_path / "nearer.mkv"), films[1], lab.camera)]
    field = measure(views, lab.marks, face=face, stated=replace(PERFECT, out_of_plane_mm=NEARER_MM), reference=1.5).strain
    assert field is not None
    seeming = 0.5 * (share[-1] ** -2 - 1.0)
    assert seeming > 0.001
    direct = field.value[-1, :, :2]
    assert direct.mean() == pytest.approx(seeming, rel=0.1)  # ten sds of the mean's noise are less
    # it came nearer by one sd: the error is the sd, but for the noise, a tenth of it
    assert np.sqrt(np.mean((direct / field.sd[-1, :, :2]) ** 2)) == pytest.approx(1.0, abs=0.15)
    noise = field.sd[0]  # at rest there is no more
    assert (field.sd[-1, :, :2] > 2.0 * noise[:, :2]).all()
    np.testing.assert_allclose(field.sd[-1, :, 2], noise[:, 2], rtol=0.05)  # it shears nothing
    assert np.abs(field.value[:15] / field.sd[:15]).max() < 5.0


def test_what_a_nearer_face_adds_to_its_strain_is_the_derivative() -> None:
    gradient, small = deformation(TIMES - 1)[0], 1e-6
    strain = green_lagrange(gradient)
    slope = (green_lagrange((1.0 + small) * gradient) - strain) / small
    np.testing.assert_allclose(seeming_strain(strain, np.array(1.0)), slope, atol=3 * small)


def test_markers_alone_have_no_strain(lab: Any, films: tuple[Video, Video]) -> None:
    assert measure([View(*films, lab.camera)], lab.marks, stated=PERFECT, reference=1.5).strain is None
