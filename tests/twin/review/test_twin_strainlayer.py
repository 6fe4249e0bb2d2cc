"""The strain of a speckled face: from what was measured to coloured points over the film, read back."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista as pv
import rerun as rr
from rerun.chunk import RrdReader

from twin.commands.measure import STRAIN_SHOWN, _write_strain
from twin.project.folder import Run
from twin.review.arrangement import VIEWS, arranged
from twin.review.filmlayer import SIGNED, VIEW, log_strains, strain_view
from twin.review.scene import RAMP, rerun_file, scene_of
from twin.review.states import Generations, Strains
from vision.measuring.strains import COMPONENTS, StrainField, to_csv

TIMES, SIZE = np.array([3.0, 3.1, 3.2]), (640, 400)
GRID = np.array([[x, 12.0, z] for x in (10.0, 20.0) for z in (0.0, 10.0)])
PIXEL = np.array([[100.0, 200.0], [100.0, 160.0], [140.0, 200.0], [140.0, 160.0]])
TOP = 0.02


def field(times: np.ndarray = TIMES) -> StrainField:
    """E_xx grows to 0.02 from point to point and is negative in the first; the third point is lost at last."""
    value = np.zeros((len(times), 4, 3))
    value[..., 0] = np.linspace(0.0, 1.0, len(times))[:, None] * [-TOP, 0.0, TOP / 2, TOP]
    value[-1, 2] = np.nan
    sd = np.full((len(times), 4, 3), 1e-4) * np.arange(1, 5)[:, None]
    return StrainField(time=times, names=("face001", "face002", "face003", "face004"), points=GRID, value=value, sd=sd)


def written(folder: Path, times: np.ndarray = TIMES) -> Strains:
    """What the stage measure leaves for the review. The tracks have two frames before, and a marker first."""
    own = field(times)
    frames = np.concatenate([[2.0, 2.5], times])
    place = np.tile(np.concatenate([[[5.0, 5.0]], PIXEL]), (len(frames), 1, 1)) + np.arange(len(frames))[:, None, None]
    moved = SimpleNamespace(
        strain=own, names=("tip", *own.names), value=np.zeros((len(times), 5, 3)),
        tracks=SimpleNamespace(time=frames, names=("tip", *own.names), position=place),
    )  # fmt: skip
    _write_strain(Run(folder, resumed=False), moved, SIZE)  # type: ignore[arg-type]
    return Strains.load(folder / "strain.npz")


def test_what_was_measured_is_kept_for_the_review(tmp_path: Path) -> None:
    found, own = written(tmp_path), field()
    assert (found.components, found.names, tuple(found.size)) == (COMPONENTS, own.names, SIZE)
    np.testing.assert_allclose(found.time_s, [0.0, 0.1, 0.2], atol=1e-12)  # as targets are shown
    np.testing.assert_array_equal(found.value, own.value)
    np.testing.assert_array_equal(found.sd, own.sd)
    np.testing.assert_array_equal(found.pixel, [PIXEL + 2, PIXEL + 3, PIXEL + 4])  # of its own frames and points
    assert (tmp_path / "strain.csv").read_text() == to_csv(own)
    grid = pv.read(tmp_path / "strain-0001.vtu")
    np.testing.assert_allclose(grid["sd_E_xx"], own.sd[1, :, 0])
    many = written(tmp_path, np.linspace(3.0, 13.0, 1000))
    assert len(many.time_s) == STRAIN_SHOWN
    assert many.time_s[-1] == pytest.approx(10.0)


def logged(path: Path, entity: str, column: str) -> dict[float, list[object]]:
    """What a file logs for `entity`: {time in s: content of a column}."""
    found: dict[float, list[object]] = {}
    for chunk in RrdReader(str(path)).stream().filter(content=entity):
        table = chunk.to_record_batch()
        if {"film_time", column} <= set(table.schema.names):
            times = [t * 1e-9 for t in table.column("film_time").cast("int64").to_pylist()]
            found.update(zip(times, table.column(column).to_pylist(), strict=True))
    return found


def rgb(packed: list[int]) -> list[tuple[int, int, int]]:
    return [(value >> 24, value >> 16 & 255, value >> 8 & 255) for value in packed]


def test_points_have_the_place_and_the_colour_of_their_strain(tmp_path: Path) -> None:
    strains, path = written(tmp_path), tmp_path / "strain.rrd"
    with rerun_file(path, rr.blueprint.Blueprint(strain_view(strains))) as recording:
        log_strains(recording, strains, scale=np.array([0.5, 0.5]))
    places = logged(path, "/film/strain/E_xx", "Points2D:positions")
    shades = logged(path, "/film/strain/E_xx", "Points2D:colors")
    assert sorted(places) == pytest.approx([0.0, 0.1, 0.2])
    assert [len(places[t]) for t in sorted(places)] == [4, 4, 3]  # a lost point is not drawn
    last = max(places)
    np.testing.assert_allclose(places[last], 0.5 * (PIXEL[[0, 1, 3]] + 4 + 0.5))
    assert rgb(shades[last]) == [tuple(SIGNED[k]) for k in (0, 3, 6)]  # type: ignore[arg-type]
    sds = logged(path, "/film/strain/sd_E_xx", "Points2D:colors")
    assert rgb(sds[last])[-1] == tuple(RAMP[-1])  # type: ignore[arg-type]
    labels = [
        text for chunk in RrdReader(str(path)).stream().filter(content="/film/legend/strain/E_xx")
        for row in chunk.to_record_batch().column("Points2D:labels").to_pylist() for text in row
    ]  # fmt: skip
    assert labels == ["-0.02", "-0.01", "0", "0.01", "0.02"]


def test_the_strain_has_a_view_where_there_is_one(tmp_path: Path) -> None:
    nodes = np.eye(3)
    generations = Generations(
        generation=np.array([1]), names=("C10",), best=np.ones((1, 1)), rms_mm=np.ones(1), nodes=nodes,
        triangles=np.array([[0, 1, 2]]), u=np.zeros((1, 3, 3), np.float32), point_names=("tip",), points=nodes[:1],
        u_points=np.zeros((1, 1, 3)), u_measured=np.zeros((1, 3)), film_time_s=0.0, film_frame=0,
    )  # fmt: skip
    scene = scene_of(generations, None)
    for strains, more in ((written(tmp_path), [VIEW]), (None, [])):
        tabs = arranged(scene, has_film=True, filmed=None, pictures=(), strains=strains).root_container
        assert [view.name for view in tabs.contents] == [*VIEWS, *more]  # type: ignore[union-attr]
