"""Plots hold what they were given and survive gaps; files for ParaView read back; no EGL is one line."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkCommonDataModel import vtkTriQuadraticHexahedron

from fe import Case
from fe.mesh.elementshapes import quality
from twin.drawing import deformed, meshpictures, plots, studyplots

STEPS, MARKERS = 30, ("5848", "4401", "m<3")
TIME = np.linspace(0.0, 6.0, STEPS)
PRESSURE = 0.03 * np.sin(TIME / 2) ** 2
MEASURED = (
    -1000.0 * PRESSURE[:, None, None] * np.array([0.3, 1.0, 0.6])[:, None] * np.array([0.4, np.nan, 1.0])
)
MEASURED[10:15, 1] = np.nan
BEFORE, AFTER = 1.1 * MEASURED, MEASURED + 0.01
GAPS = np.full((STEPS, 3, 3), np.nan)
PLOTS: dict[str, Callable[[], str]] = {
    "displacements": lambda: plots.displacements(
        TIME, measured=MEASURED, models={"model before": BEFORE, "model after": AFTER}, names=MARKERS
    ),
    "residual_map": lambda: plots.residual_pictures(
        TIME, maps={"before": MEASURED - BEFORE, "after creep": GAPS}, names=MARKERS, unit="mm"
    )[0],
    "best_error": lambda: studyplots.best_error(np.arange(1, 21), rms_mm=58.0 * 0.6 ** np.arange(20)),
    "best_constants": lambda: studyplots.best_constants(
        np.arange(1, 21), best=np.full((20, 2), [0.214, np.nan]), names=("C10", "C01")
    ),
    "one_constant": lambda: studyplots.best_constants(np.arange(1, 3), best=np.ones((2, 1)), names=("C10",)),
    "valley": lambda: studyplots.valley(
        np.random.default_rng(1).uniform(0.01, 0.5, (60, 2)),
        rms_mm=np.where(np.arange(60) % 7 == 0, np.nan, np.arange(60) + 1.0),
        names=("C10", "C01"),
        marks={"best": np.array([0.214, 0.083])},
    ),
    "against_pressure": lambda: studyplots.against_pressure(
        PRESSURE, models={"base model": BEFORE[:, 0, 2], "with creep": AFTER[:, 0, 2]}, read_at=PRESSURE,
        read_mm=MEASURED[:, 0, 2], title="4401 (tip)",
    ),
    "waterfall": lambda: plots.falling(
        [("nominal constants", 5.2), ("calibrated", 0.2123), ("+ creep", 0.0531)],
        expected_mm=0.0502,
    ),
}
WORDS = {
    "displacements": [
        "U1, mm",
        "U3, mm",
        "film time, s",
        "measured",
        "model before",
        "model after",
        "4401",
        "m<3",
    ],
    "residual_map": ["before: U1", "after creep: U3", "measured - model, mm", "5848"],
    "best_error": ["RMS error, mm", "best so far", "generation"],
    "best_constants": ["constants of the best, MPa", "generation", "C10"],
    "one_constant": ["C10"],
    "valley": ["C10, MPa", "C01, MPa", "RMS error, mm", "best", "no solution"],
    "against_pressure": ["4401 (tip)", "U3, mm", "pressure, kPa", "30", "measured", "base model", "with creep"],
    "waterfall": ["nominal constants", "+ creep", "a right model", "5.2 mm", "0.0531 mm", "0.0502 mm", "RMS error, logarithmic"],
}


def words(svg: str) -> list[str]:
    """The texts of an SVG, which must be well-formed XML."""
    return [
        "".join(node.itertext()).strip() for node in ElementTree.fromstring(svg).iter() if "text" in node.tag
    ]


@pytest.mark.parametrize("name", PLOTS)
def test_a_plot_says_what_it_shows_with_units_and_fetches_nothing(name: str) -> None:
    svg = PLOTS[name]()
    assert [word for word in WORDS[name] if word not in words(svg)] == []
    assert svg.startswith("<svg")
    assert svg.endswith("</svg>")
    hosts = set(re.findall(r"https?://([^/\"]+)", svg))
    assert hosts <= {"www.w3.org"}  # names of XML vocabularies
    assert not re.search(r"[ \"]nan\b", svg)


@pytest.mark.parametrize("name", PLOTS)
def test_the_same_data_give_the_same_text(name: str) -> None:
    assert PLOTS[name]() == PLOTS[name]()


def test_plots_of_nothing_but_gaps_are_drawn() -> None:
    plots.displacements(TIME, measured=GAPS, models={}, names=MARKERS)
    plots.residual_pictures(TIME[:1], maps={"before": GAPS[:1]}, names=MARKERS, unit="sd")
    studyplots.valley(np.ones((3, 2)), rms_mm=np.full(3, np.nan), marks={}, names=("C10", "C01"))
    assert "not known" in words(plots.falling([("calibrated", np.nan)], expected_mm=0.05))


def bar_lengths(svg: str, colour: str) -> list[float]:
    """Widths in pt of the closed rectangles that are filled with `colour`."""
    found = []
    for path, style in re.findall(r'<path d="([^"]+)"[^>]*style="([^"]+)"', svg):
        if f"fill: {colour}" in style:
            x = [float(number) for number in re.findall(r"[ML] ([-\d.]+) ", path)]
            found.append(max(x) - min(x))
    return found


def test_bars_are_as_long_as_the_errors() -> None:
    svg = plots.falling([("calibrated", 0.2), ("+ creep", 0.1)], expected_mm=0.05)
    (kept, taken), (after,), (noise,) = (
        bar_lengths(svg, colour) for colour in (plots.BEFORE, plots.AFTER, plots.NOISE)
    )
    # 1e-4: coordinates are written with six decimals
    assert (kept + taken) / after == pytest.approx(2.0, rel=1e-4)
    assert {"0.2 mm", "0.1 mm", "0.05 mm", "a right model"} <= set(words(svg))
    assert after / noise == pytest.approx(2.0, rel=1e-4)
    assert taken == pytest.approx(after, rel=1e-4)  # what the next model takes off
    # an effect that makes it worse takes nothing off
    svg = plots.falling([("calibrated", 0.1), ("- creep", 0.2)], expected_mm=0.05)
    assert len(bar_lengths(svg, plots.BEFORE)) == len(bar_lengths(svg, plots.AFTER)) == 1


def heights(svg: str, names: tuple[str, ...]) -> list[float]:
    """Heights in pt at which these texts stand."""
    return [float(re.findall(rf' y="([-\d.]+)"[^>]*>{name}</text>', svg)[0]) for name in names]


def test_names_of_curves_that_end_together_stand_apart() -> None:
    best = np.linspace(0.0, 1.0, 20)[:, None] * [0.150, 0.149] + [0.0, 0.001]
    svg = studyplots.best_constants(np.arange(1, 21), best=best, names=("C10", "C01"))
    ends = heights(svg, ("C10", "C01"))
    assert abs(ends[0] - ends[1]) > 9.0  # pt, a line of text


def test_no_line_joins_the_steps_of_a_release() -> None:
    svg = PLOTS["against_pressure"]()
    for colour in (plots.BEFORE, plots.AFTER, plots.MEASURED):
        # a dot is a short path, used at every step; a line would be one path with a segment for each step
        paths = re.findall(rf'<path d="([^"]+)"[^>]*style="[^"]*stroke: {colour}', svg)
        assert all(path.count("L") <= 1 for path in paths), colour


def tensor_hexahedron() -> np.ndarray:
    """Nodes (27,3) of one cell in our order: i + 3 j + 9 k at (i, j, k) / 2."""
    return np.array([(i, j, k) for k in range(3) for j in range(3) for i in range(3)]) / 2.0


def test_our_hexahedra_take_the_order_of_vtk() -> None:
    wanted = np.array(vtkTriQuadraticHexahedron().GetParametricCoords()).reshape(27, 3)
    np.testing.assert_array_equal(tensor_hexahedron()[deformed.VTK_HEX27], wanted)


def test_a_series_of_hexahedra_reads_back_with_times_fields_and_volume(tmp_path: Path) -> None:
    nodes = tensor_hexahedron() * [2.0, 3.0, 5.0]
    u = np.stack([scale * nodes for scale in (0.0, 0.1, 0.2)])
    pvd = deformed.write_vtu_series(
        tmp_path,
        "deformed",
        nodes=nodes,
        cells=np.arange(27)[None],
        times=(0.0, 0.4, 1.0),
        fields={"U": u, "pressure_MPa": np.full((3, 27), 0.01)},
    )
    reader = pv.get_reader(pvd)
    assert reader.time_values == [0.0, 0.4, 1.0]
    reader.set_active_time_value(1.0)
    mesh = reader.read()[0]
    assert mesh.celltypes.tolist() == [29]
    np.testing.assert_allclose(mesh.point_data["U"], u[2])
    assert set(mesh.point_data.keys()) == {"U", "pressure_MPa"}
    # VTK splits the cell into tetrahedra: exact for a box, and wrong for every wrong order of nodes.
    warped = mesh.warp_by_vector("U").triangulate().compute_cell_sizes()
    assert np.abs(warped["Volume"]).sum() == pytest.approx(30.0 * 1.2**3, rel=1e-6)
    assert len(list(tmp_path.iterdir())) == 4


@pytest.mark.parametrize(("width", "kind"), [(3, 5), (4, 9)])
def test_a_series_of_surface_cells_reads_back(tmp_path: Path, width: int, kind: int) -> None:
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    fields = {"U": np.zeros((1, 4, 3), dtype=np.float32)}
    pvd = deformed.write_vtu_series(
        tmp_path, "s", nodes=nodes, cells=np.arange(width)[None], times=[2.0], fields=fields
    )
    assert pv.read(pvd)[0].celltypes.tolist() == [kind]


def test_cells_and_fields_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    nodes = np.zeros((20, 3))
    with pytest.raises(ValueError, match="cells have 26 nodes; wanted 27"):
        deformed.write_vtu_series(
            tmp_path, "s", nodes=nodes, cells=np.arange(26)[None], times=[0.0], fields={}
        )
    with pytest.raises(ValueError, match=r"field 'U' has shape \(2, 20, 3\); wanted \(1, 20\)"):
        deformed.write_vtu_series(
            tmp_path,
            "s",
            nodes=nodes,
            cells=np.arange(4)[None],
            times=[0.0],
            fields={"U": np.zeros((2, 20, 3))},
        )
    assert list(tmp_path.iterdir()) == []


# A plate in the side face: z falls with x, so a picture from the right side has its tip low on the left.
PLATE = np.array([[x, 10.0, z] for x in np.linspace(0.0, 100.0, 11) for z in (0.0, 20.0)])
STRIP = np.array([[2 * i + a, 2 * i + b, 2 * i + c] for i in range(10) for a, b, c in ((0, 1, 2), (1, 3, 2))])
FALL = np.stack([np.zeros(22), np.zeros(22), -60.0 * (PLATE[:, 0] / 100.0) ** 2], axis=1)


def test_the_picture_shows_the_finger_from_the_side_of_the_camera(
    tmp_path: Path, require: Callable[[str], None]
) -> None:
    require("egl")
    path = tmp_path / "deformed.png"
    points = np.array([[100.0, 10.0, -60.0], [np.nan, np.nan, np.nan]])
    reason = deformed.deformed_picture(
        path, nodes=PLATE, triangles=STRIP, u=FALL, points=points, size=(400, 250)
    )
    assert reason is None
    pixels = pv.read(path).point_data.active_scalars.reshape(250, 400, -1)[::-1, :, :3].astype(float)
    yellow = (pixels[..., 0] > 150) & (pixels[..., 1] > 150) & (pixels[..., 2] < 110)
    rows, columns = np.nonzero(yellow[:, :200])  # the colour bar is on the right
    assert len(rows) > 20
    assert rows.mean() > 125
    assert columns.mean() < 150
    assert list(tmp_path.iterdir()) == [path]


def test_without_egl_there_is_one_line_and_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A process that dies as VTK does where no OpenGL library is found.
    monkeypatch.setattr(deformed, "PROBE", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    deformed.can_draw.cache_clear()
    try:
        reason = deformed.deformed_picture(tmp_path / "a.png", nodes=PLATE, triangles=STRIP, u=FALL)
    finally:
        deformed.can_draw.cache_clear()
    assert reason is not None
    assert "libegl1" in reason
    assert "\n" not in reason
    assert list(tmp_path.iterdir()) == []


def test_the_shapes_of_a_regular_mesh_are_drawn_though_all_are_alike(short_case: Case) -> None:
    (measure, *_) = quality(short_case)
    for values in (np.ones(len(measure.values)), 1.0 + 2.3e-16 * (np.arange(len(measure.values)) % 4), measure.values):
        alike = replace(measure, values=values)
        drawn = meshpictures.shapes(short_case, outside=short_case.face_nodes("outside"), measures=[alike])
        assert drawn.startswith(b"\x89PNG")
