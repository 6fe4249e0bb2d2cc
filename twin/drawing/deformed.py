"""Turns displacement fields into pictures of the deformed finger (off screen) and files for ParaView.

VTK ends the process with a segmentation fault where no OpenGL library is installed, which nothing can catch:
so a process of its own tries first, and where it fails the caller gets one line and goes on.
"""

import functools
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from twin import files
from twin.review.scene import RAMP, normals, round_up
from twin.targets import Array

# Read by VTK when it opens its first window: EGL needs neither a screen nor an X server.
WINDOW = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
PROBE = """
from vtkmodules import vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

window = vtkRenderWindow()
window.SetOffScreenRendering(True)
window.AddRenderer(vtkRenderer())
window.Render()
"""  # VTK alone: to import pyvista takes a second
MISSING = (
    "no picture of the deformed finger: VTK finds no EGL library to draw off screen "
    "(Debian, Ubuntu: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri)"
)
INK = "#1d2733"


# Our 27-node hexahedron is a tensor product: node i + 3 j + 9 k at xi, eta, zeta = (i, j, k) / 2.
# VTK's triquadratic hexahedron wants corners, edges, faces, centre. Entry m: our node at place m.
VTK_HEX27 = np.array(
    [
        *(0, 2, 8, 6, 18, 20, 26, 24),  # corners, counter-clockwise at zeta = 0, then at zeta = 1
        *(1, 5, 7, 3, 19, 23, 25, 21),  # edges at zeta = 0, then at zeta = 1
        *(9, 11, 17, 15),  # edges along zeta
        *(12, 14, 10, 16, 4, 22),  # faces xi = 0, 1; eta = 0, 1; zeta = 0, 1
        13,  # centre
    ]
)
# VTK's kind of cell (names of pyvista.CellType) by nodes: surface cells, then solids in Abaqus's order, which
# is VTK's, and hex27.
VTK_KINDS = {
    3: "TRIANGLE",
    4: "QUAD",
    8: "HEXAHEDRON",
    10: "QUADRATIC_TETRA",
    20: "QUADRATIC_HEXAHEDRON",
    27: "TRIQUADRATIC_HEXAHEDRON",
}


@functools.cache
def can_draw() -> bool:
    """True where VTK can draw off screen: tried once, in a process of its own."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", PROBE], env={**os.environ, **WINDOW}, capture_output=True, timeout=60
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def deformed_picture(
    path: Path,
    *,
    nodes: Array,
    triangles: NDArray[np.int64],
    u: NDArray[np.floating],
    points: Array | None = None,
    size: tuple[int, int] = (1600, 1000),
) -> str | None:
    """Write a PNG of the deformed surface coloured by displacement; None, or one line saying why not.

    nodes (n,3) mm; triangles (t,3); u (n,3) mm; points (p,3) mm measured places of markers, drawn as dots,
    NaN = not seen; size (width, height) px. Seen as by the camera: from +y, z up, so x runs to the left.
    """
    if not can_draw():
        return MISSING
    os.environ.update(WINDOW)
    import pyvista as pv  # half a second, and only after the line above

    faces = np.column_stack([np.full(len(triangles), 3), triangles])
    # The shape at rest lies a little inside, so that it never shows through the clamp, which does not move.
    rest = pv.PolyData(nodes - 0.004 * np.ptp(nodes, axis=0).max() * normals(nodes, triangles), faces)
    moved = pv.PolyData(np.asarray(nodes + u, dtype=float), faces)
    moved["displacement"] = np.linalg.norm(u, axis=1)
    plotter = pv.Plotter(off_screen=True, window_size=list(size))
    plotter.set_background("white")  # type: ignore[arg-type]
    plotter.add_mesh(rest, color="#9aa3ad", opacity=0.18, smooth_shading=True)
    top = round_up(float(moved["displacement"].max()))
    look = {"cmap": _ramp(), "clim": (0.0, top), "ambient": 0.3, "smooth_shading": True}
    plotter.add_mesh(moved, scalars="displacement", **look, **_bar(size))
    if points is not None and np.isfinite(points).all(axis=1).any():
        dots = points[np.isfinite(points).all(axis=1)]
        plotter.add_mesh(pv.PolyData(dots), color=INK, point_size=13, render_points_as_spheres=True)
    _look(plotter, np.concatenate([nodes, nodes + u]), size=size)
    try:
        with files.whole(path) as draft:
            plotter.screenshot(draft)
    finally:
        plotter.close()
    return None


def write_vtu_series(
    folder: Path,
    name: str,
    *,
    nodes: Array,
    cells: NDArray[np.int64],
    times: Sequence[float],
    fields: Mapping[str, NDArray[np.floating]],
) -> Path:
    """Write one .vtu per time and `name`.pvd that lists them; returns the path of the latter for ParaView.

    nodes (n,3) mm undeformed; cells (e,27) hexahedra (tensor order, see VTK_HEX27), (e,20), (e,8) or (e,10)
    hexahedra and tetrahedra as Abaqus orders them, (e,4) or (e,3) surface cells; times (k,) s; fields {name:
    (k,n,...)} at the nodes. "Warp by vector" with U shows the shape.
    ValueError for other cells and for fields of another length.
    """
    grid = grid_of(nodes, cells)
    for key, field in fields.items():
        if field.shape[:2] != (len(times), len(nodes)):
            shape = (len(times), len(nodes))
            raise ValueError(f"field {key!r} has shape {field.shape}; wanted {shape} (times, nodes) first")
    names = [f"{name}-{step:04d}.vtu" for step in range(len(times))]
    for step, file in enumerate(names):
        for key, field in fields.items():
            grid.point_data[key] = np.asarray(field[step])
        files.write_bytes(folder / file, _vtu(grid))
    return _write_pvd(folder / f"{name}.pvd", times=times, names=names)


def grid_of(nodes: Array, cells: NDArray[np.int64]) -> Any:
    """The mesh as pyvista's unstructured grid; nodes (n,3) mm, cells (e,m) as in `write_vtu_series`."""
    import pyvista as pv

    width = cells.shape[1]
    if width not in VTK_KINDS:
        raise ValueError(
            f"cells have {width} nodes; wanted 27, 20, 8 (hexahedra), 10 (tetrahedra), 4 or 3 (surface)"
        )
    order = VTK_HEX27 if width == 27 else np.arange(width)
    kind = pv.CellType[VTK_KINDS[width]]
    return pv.UnstructuredGrid({kind: cells[:, order]}, nodes)


def _vtu(grid: Any) -> bytes:
    """The .vtu file of a grid: VTK's own way to the disk ends the whole program where that is full."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.WriteToOutputStringOn()
    writer.SetDataModeToBinary()
    writer.Write()
    return str(writer.GetOutputString()).encode("utf-8")


def _write_pvd(path: Path, *, times: Sequence[float], names: Sequence[str]) -> Path:
    rows = [
        f'    <DataSet timestep="{time:.9g}" file={quoteattr(file)}/>' for time, file in zip(times, names)
    ]
    head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    files.write_text(path, "\n".join([*head, *rows, "  </Collection>", "</VTKFile>", ""]))
    return path


def _ramp() -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("finger", RAMP / 255.0)


def _bar(size: tuple[int, int]) -> dict[str, Any]:
    """The colour bar, bottom right, below the clamp."""
    place = {"position_x": 0.56, "position_y": 0.04, "width": 0.4, "height": 0.12}
    letters = {"title_font_size": size[1] // 30, "label_font_size": size[1] // 34, "color": INK}
    return {
        "scalar_bar_args": {"title": "displacement, mm\n", "n_labels": 5, "fmt": "%.3g", **place, **letters}
    }


def _look(plotter: Any, places: Array, *, size: tuple[int, int]) -> None:
    """Parallel view from +y, a little from above, that shows all places (m,3)."""
    low, high = places.min(axis=0), places.max(axis=0)
    centre, extent = 0.5 * (low + high), high - low
    plotter.enable_parallel_projection()
    far = 4.0 * float(np.linalg.norm(extent))
    plotter.camera.focal_point = centre
    plotter.camera.position = centre + far * np.array([0.0, 1.0, 0.2])
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.parallel_scale = 0.56 * max(extent[2] + 0.2 * extent[1], extent[0] * size[1] / size[0])
    plotter.reset_camera_clipping_range()
