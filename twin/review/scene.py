"""The simulated finger as rerun entities below `model/`: mesh, rest shape, markers, errors, colour legend."""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from twin import files
from twin.review.states import Array, Fields, Generations, Integers, Single

# Dark blue to yellow, even in lightness and readable without red-green vision (rows of sRGB).
RAMP = np.array(
    [
        (48, 44, 122),
        (44, 86, 150),
        (39, 122, 152),
        (46, 156, 143),
        (94, 187, 116),
        (170, 211, 76),
        (249, 226, 62),
    ]
)
MEASURED = (255, 255, 255)
ERROR = (238, 76, 90)
REST = (160, 165, 175, 45)  # nearly transparent


@dataclass(frozen=True)
class Scene:
    """Geometry and ranges that all states share: the surface that is drawn, its size, the colour scale."""

    nodes: Array  # (m,3) surface nodes at rest, mm
    used: Integers  # (m,) their numbers among all nodes
    triangles: Integers  # (t,3) in surface numbers
    points: Array  # (p,3) markers at rest, mm
    top_mm: float  # displacement of the last colour
    low: Array  # (3,) corner of all that is shown, mm
    high: Array  # (3,)

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.high - self.low))


@dataclass(frozen=True)
class States:
    """The finger at s values of one timeline."""

    u: Single  # (s,n,3) all nodes, mm
    model: Array  # (s,p,3) markers, mm
    measured: Array  # (s,p,3) markers, mm; NaN = not observed


def scene_of(generations: Generations, fields: Fields | None) -> Scene:
    """The scene that fits the last generation and the film: early generations may leave its colours."""
    used, flat = np.unique(generations.triangles, return_inverse=True)
    nodes, last = generations.nodes[used], generations.u[-1][used]
    displacements = last if fields is None else np.concatenate([last, fields.u[:, used].reshape(-1, 3)])
    top = round_up(float(np.linalg.norm(displacements, axis=1).max()))
    places = np.concatenate([nodes, nodes + last])
    triangles = flat.reshape(-1, 3).astype(np.int64)
    return Scene(nodes, used, triangles, generations.points, top, places.min(axis=0), places.max(axis=0))


def colours(
    value: NDArray[np.floating], *, top: float, low: float = 0.0, ramp: Integers = RAMP
) -> NDArray[np.uint8]:
    """Colours (..., 3) of values (...) between `low` and `top`; values beyond take the end colours."""
    place = np.clip((value - low) / (top - low), 0.0, 1.0) * (len(ramp) - 1)
    channels = [np.interp(place, np.arange(len(ramp)), channel) for channel in ramp.T]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def log_states(recording: rr.RecordingStream, scene: Scene, column: rr.TimeColumn, *, states: States) -> int:
    """Log all states on one timeline; returns how many times longer than the errors the arrows are."""
    u = states.u[:, scene.used]
    place = (scene.nodes + u).astype(np.float32)
    mesh = rr.Mesh3D.columns(
        vertex_positions=place.reshape(-1, 3),
        vertex_normals=np.concatenate([normals(state, scene.triangles) for state in place]),
        vertex_colors=colours(np.linalg.norm(u, axis=-1), top=scene.top_mm).reshape(-1, 3),
    )
    recording.send_columns("model/mesh", [column], mesh.partition([len(scene.nodes)] * len(u)))
    # A camera that looks along y sees no U2: the model's own places the dot, and the arrow has none of it.
    seen = np.isfinite(states.measured[..., [0, 2]]).all(axis=-1)
    error = np.where(np.isfinite(states.measured), states.measured - states.model, 0.0)[seen]
    foot = (scene.points + states.model)[seen]
    scale = _arrow_scale(error, size=scene.size)
    dots = rr.Points3D.columns(positions=foot + error)
    arrows = rr.Arrows3D.columns(origins=foot, vectors=scale * error)
    recording.send_columns("model/measured", [column], dots.partition(seen.sum(axis=1)))
    recording.send_columns("model/error", [column], arrows.partition(seen.sum(axis=1)))
    return scale


def log_constants(recording: rr.RecordingStream, scene: Scene) -> None:
    """Log what never changes, visible on every timeline: topology, styles, rest shape, colour legend."""
    radius = 0.007 * scene.size
    constants: dict[str, Any] = {
        "mesh": rr.Mesh3D.from_fields(triangle_indices=scene.triangles),
        "measured": rr.Points3D.from_fields(radii=radius, colors=MEASURED),
        "error": rr.Arrows3D.from_fields(radii=0.45 * radius, colors=ERROR),
        # inside, so that it never flickers through
        "rest": still(scene.nodes, scene.triangles, colour=REST, inside=0.004 * scene.size),
        "legend/bar": _legend_bar(scene),
        "legend/values": _legend_values(scene),
    }
    for name, value in constants.items():
        recording.log(f"model/{name}", value, static=True)


def still(
    nodes: Array, triangles: Integers, *, colour: tuple[int, ...], inside: float = 0.0
) -> rr.Mesh3D:
    """A surface that does not move, by `inside` mm within its nodes (m,3) mm."""
    outward = normals(nodes, triangles)
    return rr.Mesh3D(
        vertex_positions=nodes - inside * outward, vertex_normals=outward, triangle_indices=triangles,
        albedo_factor=colour,
    )  # fmt: skip


def normals(nodes: NDArray[np.floating], triangles: Integers) -> NDArray[np.float32]:
    """Unit vertex normals (m,3): mean of the adjacent triangles' normals, by area."""
    a, b, c = (nodes[triangles[:, corner]].astype(float) for corner in range(3))
    face = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    flat, m = triangles.ravel(), len(nodes)
    total = np.stack([np.bincount(flat, component, minlength=m) for component in face.T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return (total / np.where(length > 0.0, length, 1.0)).astype(np.float32)


def round_up(value: float) -> float:
    """The next of 1, 2, 3, 4, 5, 6, 8, 10 times a power of ten: a colour scale that reads well."""
    if value <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(
        power * next(step for step in (1, 2, 3, 4, 5, 6, 8, 10) if step * power >= value * (1 - 1e-9))
    )


def _arrow_scale(error: Array, *, size: float) -> int:
    """The largest of these factors that leaves nearly all errors (a,3) below an eighth of the scene's size.

    Either true size or clearly more: at twice the size an arrow would seem to miss its marker.
    """
    long = float(np.quantile(np.linalg.norm(error, axis=1), 0.95)) if len(error) else size
    return max((factor for factor in (1, 10, 20, 50, 100, 200) if factor * long <= size / 8), default=1)


# The legend lies below the clamp, in the plane of the finger's near face.


def _legend_place(scene: Scene, fraction: Array, *, drop: float) -> Array:
    """Places (k,3) mm along the legend, `drop` mm below the lowest point of the finger."""
    start = scene.low[0] + 0.02 * scene.size
    x = start + 0.45 * (scene.high[0] - scene.low[0]) * fraction
    level = np.ones_like(x)
    return np.stack([x, scene.high[1] * level, (scene.low[2] - drop) * level], axis=1)


def _legend_bar(scene: Scene) -> rr.Mesh3D:
    fraction = np.linspace(0.0, 1.0, 25)
    below, above = (_legend_place(scene, fraction, drop=drop * scene.size) for drop in (0.0, -0.025))
    k = np.arange(len(fraction) - 1)
    opposite = k + len(fraction)
    corners = [np.stack(three, axis=1) for three in ((k, k + 1, opposite), (k + 1, opposite + 1, opposite))]
    return rr.Mesh3D(
        vertex_positions=np.concatenate([below, above]),
        triangle_indices=np.concatenate(corners),
        vertex_colors=colours(np.tile(fraction, 2), top=1.0),
    )


def _legend_values(scene: Scene) -> rr.Points3D:
    fraction = np.linspace(0.0, 1.0, 5)
    labels = [f"{part * scene.top_mm:g}" for part in fraction]
    labels[-1] += " mm"
    place = _legend_place(scene, fraction, drop=0.008 * scene.size)
    return rr.Points3D(place, radii=rr.Radius.ui_points(0.5), labels=labels, show_labels=True)


@contextmanager
def rerun_file(path: Path, views: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """The recording to log to; the file `path` holds it, with its views, when the block ends."""
    recording = rr.RecordingStream("softtwin", recording_id=uuid.uuid4())  # two files never mix in one viewer
    try:
        # rerun's own writer tells nobody that the disk is full, and may wait for ever
        memory = recording.memory_recording()
        # active: in the bytes the views come after the data, for which a viewer has made its own by then
        recording.send_blueprint(views, make_active=True, make_default=True)
        yield recording
        files.write_bytes(path, memory.drain_as_bytes())
    finally:
        recording.disconnect()
