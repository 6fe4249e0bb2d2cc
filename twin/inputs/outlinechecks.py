"""The film's edges beside the outline of the calibrated model, at some moments of the load path: how far the
two are apart, and which tag does not move as the body beside it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fe import Solution
from fe.mesh.mirror import symmetry_support
from twin import files
from twin.bench.workbench import Workbench
from twin.inputs.cameras import camera_path, camera_table, stored_cameras
from twin.inputs.outlines import PARTS, SeenOutline, drawn, outline_tells, seen_outline, surface
from twin.model.prediction import moved
from twin.model.structure import Structure
from twin.numerals import with_sd
from twin.project.folder import Project
from twin.records import Maybe, Record
from twin.tablemodel import Finite
from twin.targets import Array, Targets

if TYPE_CHECKING:  # vision takes a second to import
    from vision.placing.movedoutlines import MovedOutline
    from vision.placing.outlines import Outline
    from vision.placing.restplaces import BodyPose

SMALL = 0.02  # of the pressure's range: a change below it is noise
TAKEN_MM = 0.005  # to which the motion of the outline is that which the model foretells of the markers
TICK = 1e-6  # s, below every time base
NEAR = 3.0  # sds of an edge that is drawn as right
FLAT = [0, 2]  # x and z
WAYS = ("along the finger", "across the finger")


class OutlineMoment(Record):
    time_s: Finite
    pressure_MPa: Finite
    places: int
    rms_mm: Maybe
    sd_mm: Maybe


class OutlineRecord(Record):
    """The film's edges beside the calibrated model's outline."""

    file: ClassVar[str] = "outline.json"
    moments: tuple[OutlineMoment, ...] = Field(description="each by itself")
    rms_mm: Maybe = Field(description="of the edges' motion since the rest beyond the model's")
    sd_mm: Maybe = Field(description="the median of what is stated of that")
    tags: tuple[str, ...] = Field(default=(), description="that do not move as the body beside them")
    said: tuple[str, ...] = Field(default=(), description="in words")


@dataclass(frozen=True)
class OutlineCheck:
    """The film's edges beside the model's outline at some moments, and tags that do not move as the body."""

    time: Array  # (m,) s
    pressure: Array  # (m,) MPa
    outlines: "tuple[MovedOutline, ...]"
    apart: dict[str, str]  # sentence for each tag that is apart from the body beside it
    markers: int
    picture: Array  # (h, w) of the moment of the highest pressure
    wrong: tuple[str, ...] = ()  # dimensions, by the outline at rest

    @property
    def said(self) -> tuple[str, ...]:
        """Sentences on how far outline and model are apart, and on tags."""
        off, sd = self._rms(np.concatenate([o.off for o in self.outlines])), self._sd(self.outlines)
        seen = sum(int(np.isfinite(o.off).sum()) for o in self.outlines)
        outline = (
            f"The outline of the finger lies {off:.3f} mm rms beside the model's: {seen} places of its edge "
            f"at {len(self.outlines)} moments, each known to {sd:.3f} mm."
        )
        if self.wrong:
            return (outline, *self.wrong, "Until then no tag is judged by the outline.")
        if len(self.apart) > self.markers / 2:
            names = ", ".join(self.apart)
            return (
                outline,
                f"Outline and markers disagree: {names} do not move as the edges beside them. Look at "
                "outline.png: is it the edge of the finger that was found?",
            )
        return (outline, *self.apart.values())

    @property
    def record(self) -> OutlineRecord:
        """The record of outline.json."""
        rows = [
            OutlineMoment(time_s=float(t), pressure_MPa=float(p), places=int(np.isfinite(o.off).sum()),
                          rms_mm=self._rms(o.off), sd_mm=self._sd([o]))
            for t, p, o in zip(self.time, self.pressure, self.outlines, strict=True)
        ]  # fmt: skip
        every = np.concatenate([o.off for o in self.outlines])
        return OutlineRecord(moments=tuple(rows), rms_mm=self._rms(every), sd_mm=self._sd(self.outlines),
                             tags=tuple(self.apart), said=self.said)  # fmt: skip

    @property
    def csv(self) -> str:
        """The edges: time and pressure, where on the body at rest, how far outside the model's outline."""
        lines = ["time_s,pressure_MPa,x_mm,z_mm,off_mm,sd_mm"]
        for t, p, o in zip(self.time, self.pressure, self.outlines, strict=True):
            there = np.isfinite(o.off)
            lines += [f"{t:.6g},{p:.6g},{x:.3f},{z:.3f},{off:.4f},{sd:.4f}" for (x, _, z), off, sd
                      in zip(o.body[there], o.off[there], o.sd[there], strict=True)]  # fmt: skip
        return "\n".join(lines) + "\n"

    def drawn(self) -> bytes:
        """The film at the highest pressure with its edges, as PNG: green where they lie within 3 sds of the
        model's, else red."""
        top = self.outlines[int(self.pressure.argmax())]
        there = np.isfinite(top.off)
        return drawn(self.picture, top.pixel[there], (np.abs(top.off) < NEAR * top.sd)[there])

    @staticmethod
    def _rms(off: Array) -> float:
        return float(np.sqrt(np.nanmean(off**2))) if np.isfinite(off).any() else np.nan

    @staticmethod
    def _sd(outlines: "Sequence[MovedOutline]") -> float:
        return float(np.median(np.concatenate([o.sd[np.isfinite(o.off)] for o in outlines])))


def moments_of(targets: Targets, count: int) -> NDArray[np.intp]:
    """So many steps, spread evenly over the path that the pressure has gone."""
    used = np.flatnonzero(targets.used.any(axis=(1, 2)))
    size = SMALL * max(float(np.ptp(targets.pressure[used])), 1e-12)
    way = np.abs(np.diff(np.round(targets.pressure[used] / size), prepend=0.0)).cumsum()
    goals = np.linspace(0.0, way[-1], count + 1)[1:]
    return used[np.unique(np.searchsorted(way, goals))]


def checked_by_outline(bench: Workbench, theta: Array, predicted: Array, *, count: int) -> OutlineCheck:
    """The film's edges at so many moments beside the outline of a model at its fit theta (d,), whose
    prediction is (s, p, 3) mm. ValueError where film or edges are not there."""
    from vision.film.series import open_film

    project, targets = bench.project, bench.targets
    time, table = _frame_times(project), camera_table(project)
    film = open_film(project.path(table.film), fps=table.fps, mirrored=table.mirrored)
    outline = seen_outline(project, table, film, stored_cameras(camera_path(project))[0])
    steps = moments_of(targets, count)
    frames = np.searchsorted(time, targets.time[steps] - targets.time[0] + time[0] - TICK)
    pictures = {k: np.asarray(grey, float) for k, _, grey in film.chosen(np.unique(frames).tolist())}
    moved = _MovedModel.of(bench, theta, predicted)
    found = moved.beside(outline.found, [pictures[k] for k in frames], steps)
    markers = [_Marker(targets, predicted, moved.seen, p, _placed(project, outline)) for p in moved.rows]
    told = {m.name: said for m in markers if (said := m.sentence(found, steps))}
    top = pictures[frames[int(targets.pressure[steps].argmax())]]
    return OutlineCheck(
        targets.time[steps], targets.pressure[steps], found, told, len(markers), top, outline.wrong
    )


def _frame_times(project: Project) -> Array:
    """Times (t,) s of the film's frames. ValueError where the targets are not of one film of one camera."""
    path = project.root / "runs" / str(project.source().run) / "tracks.npz"
    if len(project.config.cameras) != 1 or len(project.config.films) > 1 or not path.is_file():
        raise ValueError("it takes one film of one camera that `twin measure` has measured")
    return np.asarray(files.read_npz(path, "time")["time"])


def _placed(project: Project, outline: SeenOutline) -> "BodyPose":
    """Where the axes of the targets, which are the finger's, stand in those that the outline is seen in."""
    from vision.placing.restplaces import BodyPose

    return outline.found.pose if outline_tells(project) else BodyPose()


@dataclass(frozen=True)
class _MovedModel:
    """The calibrated model along the film: its nodes, and where it foretells markers."""

    structure: Structure
    solution: Solution
    rest: Array  # (n, 3) mm, its nodes at rest
    rows: NDArray[np.intp]  # (p,) of the markers that move
    seen: Array  # (m, 3) mm, places of all markers at rest
    own: Array  # (s, m, 3) mm, motion of the markers on the mesh itself
    foretold: Array  # (s, m, 3) mm, as it is predicted

    @staticmethod
    def of(bench: Workbench, theta: Array, predicted: Array) -> "_MovedModel":
        """That at a fit theta (d,)."""
        model, structure = bench.model(), bench.structure
        test, solution = model.put(model.named(theta)), model.drawn(theta).solution
        sag = solution.fields(list(bench.targets.reference)).mean(axis=0)[: len(structure.case.nodes)]
        seen = test.points
        if test.rest is not None:
            seen = np.where(np.isfinite(test.rest.places), test.rest.places, seen)
        own = model.relative(moved(test, solution))
        rows = np.flatnonzero(test.moving)
        return _MovedModel(structure, solution, structure.case.nodes + sag, rows, seen, own, predicted)

    def beside(
        self, outline: "Outline", pictures: Sequence[Array], steps: NDArray[np.intp]
    ) -> "tuple[MovedOutline, ...]":
        """The film's edges in pictures (h, w) of some steps."""
        from vision.placing.movedoutlines import RestEdges
        from vision.placing.silhouettes import BodySurface

        held = self.rest[self.structure.case.clamped]
        edges = RestEdges.of(outline.fit, BodySurface(self._faces(self.rest), held))
        pairs = zip(pictures, steps, strict=True)
        return tuple(edges.moved(picture, self._faces(self._nodes(int(step)))) for picture, step in pairs)

    def _faces(self, nodes: Array) -> Array:
        """The outer faces (f, c, 3) mm with nodes at (n, 3) mm, of a half both sides."""
        case = self.structure.case
        x = surface(replace(case, nodes=nodes), self.structure.outside, PARTS)
        return x if symmetry_support(case) is None else np.concatenate([x, x * [1.0, -1.0, 1.0]])

    def _nodes(self, step: int) -> Array:
        """The nodes (n, 3) mm at a step, bent and stretched a little more so that markers move as is
        foretold: with the correction of the mesh, which is known of the markers alone."""
        from vision.placing.movedoutlines import Spine

        nodes = self.structure.case.nodes + self.solution.fields([step])[0][: len(self.rest)]
        spots = (self.seen + self.own[step])[self.rows]
        off = (self.foretold - self.own)[step, self.rows][:, FLAT].ravel()
        spine = Spine.of(self.rest, nodes[:, FLAT])
        columns = spine.motions(self.seen[self.rows, 0], spots[:, FLAT])[..., :-2]  # what is clamped stays
        columns = columns.reshape(len(off), -1)
        normal = columns.T @ columns + TAKEN_MM**2 * np.eye(columns.shape[1])
        amplitude = np.linalg.solve(normal, columns.T @ off)
        nodes[:, FLAT] += spine.motions(self.rest[:, 0], nodes[:, FLAT])[..., :-2] @ amplitude
        return nodes


@dataclass(frozen=True)
class _Marker:
    """A marker beside the outline."""

    targets: Targets
    predicted: Array  # (s, m, 3) mm
    seen: Array  # (m, 3) mm, places at rest
    row: int
    pose: "BodyPose"  # of the axes of all these, where the outline is seen

    @property
    def name(self) -> str:
        return self.targets.names[self.row]

    def apart(self, outline: "MovedOutline", step: int) -> tuple[Array, Array]:
        """How far it has moved against the outline beside it (2,) mm, along the finger and across, with
        the sd (2,); NaN where it was not seen."""
        p, t, (c, s) = self.row, self.targets, (np.cos(self.pose.turn), np.sin(self.pose.turn))
        turned = np.array([[c, -s], [s, c]])
        rest = turned @ self.seen[p, FLAT] + [self.pose.x_mm, self.pose.z_mm]
        motion, spread, own = outline.beside(rest, rest + turned @ self.predicted[step, p, FLAT])
        own = own @ turned
        modes = t.modes[:, step, p][:, FLAT] @ own.T
        covariance = own @ t.covariance[step, p][np.ix_(FLAT, FLAT)] @ own.T + modes.T @ modes + spread
        off = own @ (t.value[step, p] - self.predicted[step, p])[FLAT] - motion
        return off, np.sqrt(np.diag(covariance))

    def sentence(self, outlines: "Sequence[MovedOutline]", steps: NDArray[np.intp]) -> str:
        """A sentence where it does not move as the outline beside it, else ""."""
        from vision.placing.movedoutlines import apart_at

        every = [self.apart(o, int(step)) for o, step in zip(outlines, steps, strict=True)]
        off, sd = (np.array(x) for x in zip(*every, strict=True))
        beyond = apart_at(off, sd)
        if not len(beyond):
            return ""
        size = np.abs(off / sd)
        worst = beyond[np.nanargmax(size[beyond].max(axis=1))]
        way = int(size[worst].argmax())
        much = with_sd(abs(float(off[worst, way])), float(sd[worst, way]))
        return (
            f"Marker {self.name} has moved by {much} mm {WAYS[way]} against the outline beside it at "
            f"{1e3 * self.targets.pressure[steps[worst]]:.3g} kPa: it slips or is loose. Glue it again and "
            "film anew, or remove its point from twin.toml."
        )
