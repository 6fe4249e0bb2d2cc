"""Models projected on the film: solved along it, seen by its camera, and drawn over it as still and clip."""

from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from twin import files
from twin.bench.filmedge import FilmEdge
from twin.bench.waterfall import Stair, stairs
from twin.bench.workbench import Workbench
from twin.drawing.painting import Image, still
from twin.inputs.cameras import camera_path, stored_cameras
from twin.inputs.recordings import marks_of
from twin.judging.fitrecord import FitRecord
from twin.messages import Say
from twin.project.folder import Project
from twin.review.filmed import Filmed, Trace
from twin.review.states import Generations
from twin.targets import Array, Targets

if TYPE_CHECKING:  # vision takes a second to import
    from vision import Video
    from vision.perspective import Projection

MOST = 500  # pictures in which the models are drawn
TICK = 1e-6  # s, below every time base
Rows = NDArray[np.intp]


def models_on_film(
    project: Project, targets: Targets, generations: Generations, say: Say
) -> tuple[Filmed | None, str]:
    """The models over the film; or None, and a clause that says why they cannot be drawn over it."""
    models, why = stairs(project), _why_not(project)
    if why or not models or not project.config.cameras:
        return None, why
    return _Sight(project, targets, generations, models, say).filmed(), ""


def _why_not(project: Project) -> str:
    """Reason why the models cannot be drawn over the film; "" if they can, or where there is no film."""
    if not project.config.cameras or not project.path(project.config.cameras[0].film).is_file():
        return ""  # which the recording says itself
    outcome = "the models are not drawn over the film"
    if measured_file(project, "tracks.npz") is None:
        return f"{outcome}: these targets do not come from `twin measure`"
    if len(project.config.films) > 1:
        return f"{outcome}: the targets hold {len(project.config.films)} films"
    try:
        camera_path(project)
    except ValueError as error:
        return f"{outcome}: {error}"
    from vision import Video

    if project.config.cameras[0].mirrored:
        return f"{outcome}, because it is mirrored: store it left for right"
    if Video(project.path(project.config.cameras[0].film)).turns:
        return f"{outcome}, because it is stored on its side: store it upright"
    return ""


def measured_file(project: Project, name: str) -> Path | None:
    """A file of the run that the targets come from, such as tracks.npz; None without any."""
    path = project.root / "runs" / str(project.source().run) / name
    return path if path.is_file() else None


@dataclass(frozen=True)
class _Sight:
    """Film, camera and models of a project."""

    project: Project
    targets: Targets
    generations: Generations
    stairs: tuple[Stair, ...]
    say: Say

    def filmed(self) -> Filmed:
        """All models in the pictures that are shown."""
        moved = [self._moved(stair) for stair in self.stairs]
        before = max((k for k, stair in enumerate(self.stairs) if not stair.effects), default=0)
        return Filmed(
            size=self._projection.camera.size,
            frame=self._frames[self._steps],
            time_s=self.targets.time[self._steps] - self.targets.time[0],
            names=self.generations.point_names,
            measured=self._seen[self._frames[self._steps]],
            models=tuple(self._trace(stair, *both) for stair, both in zip(self.stairs, moved, strict=True)),
            before=before,
            search=self._search(moved[before][0]),
            search_measured=self._seen[self._top],
            expected_mm=self.stairs[-1].foot_mm,
            error_mm=tuple(self._error(predicted) for _, predicted in moved),
        )

    # -- the film -------------------------------------------------------------------------------------------

    @cached_property
    def _tracks(self) -> dict[str, NDArray[Any]]:
        path = measured_file(self.project, "tracks.npz")
        assert path is not None  # `_why_not` has looked
        return files.read_npz(path, "names", "time", "position", "homography", "rotation")

    @cached_property
    def _projection(self) -> "Projection":
        """Projection of the first camera in every frame."""
        from vision.perspective import Projection

        camera = stored_cameras(camera_path(self.project))[0]
        return Projection.of(camera, self._tracks["homography"], marks_of(self.project))

    @cached_property
    def _steps(self) -> Rows:
        """Steps of the targets that are shown: evenly some of many."""
        count = len(self.targets.time)
        return np.unique(np.linspace(0, count - 1, min(MOST, count)).round().astype(int))

    @cached_property
    def _frames(self) -> Rows:
        """The frame (s,) of every step."""
        return np.searchsorted(self._tracks["time"], self.targets.time - self._begin - TICK)

    @property
    def _begin(self) -> float:
        """Offset in s of the clock of the targets from the clock of the film."""
        return float(self.targets.time[0] - self._tracks["time"][0])

    @property
    def _top(self) -> int:
        """The frame of the first arrival at top pressure."""
        return int(self._frames[self.generations.film_frame])

    @cached_property
    def _seen(self) -> Array:
        """Tracked pixels (t,p,2) of every marker of the finger in every frame."""
        names = list(self._tracks["names"])
        return np.asarray(self._tracks["position"][:, [names.index(n) for n in self.generations.point_names]])

    @cached_property
    def _glued(self) -> Array:
        """Offset (p,3) mm at rest of every marker from its node, as the camera sees it."""
        points = self.generations.points
        frames = self._frames[self.targets.reference]
        places = np.array([self._projection.places(self._seen[f], f, y_mm=points[:, 1]) for f in frames])
        visible = np.isfinite(places)
        mean = np.where(visible, places, 0.0).sum(axis=0) / np.maximum(visible.sum(axis=0), 1)
        return np.asarray(np.where(visible.any(axis=0), mean - points, 0.0))

    def _spots(self, u: Array, frames: Rows) -> Array:
        """Positions (s,p,3) mm of the markers for nodes that move by u (s,p,3) mm: the offset of a marker
        from its node turns as the marker is seen to turn."""
        names = list(self._tracks["names"])
        columns = [names.index(n) for n in self.generations.point_names]
        turn = np.nan_to_num(self._tracks["rotation"][frames][:, columns])
        c, s, (x, _, z) = np.cos(turn), np.sin(turn), self._glued.T
        off = np.stack([c * x - s * z, np.zeros_like(turn), s * x + c * z], axis=2)
        return np.asarray(self.generations.points + u + off)

    # -- the models -----------------------------------------------------------------------------------------

    @cached_property
    def _bench(self) -> Workbench:
        return Workbench.of(self.project)

    @cached_property
    def _edge(self) -> FilmEdge:
        return FilmEdge(self._bench)

    def _moved(self, stair: Stair) -> tuple[Array, Array]:
        """Displacements in mm of the edge (s,k,3) at all steps, and those (s,p,3) that a model foretells of
        the markers."""
        model = self._bench.model(stair.effects)
        fit = self.project.root / "runs" / stair.run / "fit.json"
        stored = files.read(FitRecord, fit).parameters if stair.run else {}
        values = {p.name: stored[p.name].value if stored else p.start or 0.0 for p in model.parameters}
        drawn = cache(partial(model.drawn, model.theta(values)))
        moved = self._edge.moved(
            stair.effects, values, lambda: drawn().solution, done=stair.done, say=self.say
        )
        rows = np.flatnonzero(~self.targets.fixed)
        path = fit.with_name("prediction.npz")
        return moved, (files.read_npz(path, "u")["u"] if stair.run else drawn().u)[:, rows]

    def _trace(self, stair: Stair, moved: Array, predicted: Array) -> Trace:
        """The pictures of one model."""
        at_rest, frames = self.generations.nodes[self._edge.nodes], self._frames[self._steps]
        return Trace(
            label=stair.done,
            rms_mm=stair.error_mm,
            edge=self._pictures(at_rest + moved[self._steps], frames),
            markers=self._pictures(self._spots(predicted[self._steps], frames), frames),
        )

    def _search(self, moved: Array) -> Trace:
        """The best of each generation; its displacements count from the rest, the edge's (s,k,3) do not."""
        g, edge = self.generations, self._edge.nodes
        edge = g.nodes[edge] + moved[self.targets.reference].mean(axis=0) + g.u[:, edge]
        frames = np.full(len(edge), self._top)
        markers = self._pictures(self._spots(g.u_points, frames), frames)
        return Trace(
            label="generation",
            rms_mm=float(g.rms_mm[-1]),
            edge=self._pictures(edge, frames),
            markers=markers,
        )

    def _pictures(self, places: Array, frames: Rows) -> Array:
        """Pixels (s,n,2) of places (s,n,3) mm, each in its frame."""
        pairs = zip(places, frames, strict=True)
        return np.array([self._projection.pixels(points, int(f)) for points, f in pairs])

    def _error(self, predicted: Array) -> Array:
        """Distance (s,p) mm of every marker from the model at the displayed steps; NaN = not seen."""
        rows = np.flatnonzero(~self.targets.fixed)
        residual = (self.targets.value[:, rows] - predicted)[self._steps]
        return np.linalg.norm(residual[..., [0, 2]], axis=2)


@dataclass(frozen=True)
class Footage:
    """The film of a project, and the models as its camera would see them."""

    project: Project
    filmed: Filmed

    @property
    def film(self) -> "Video":
        """The film of the first camera."""
        from vision.film.series import open_film

        table = self.project.config.cameras[0]
        return open_film(self.project.path(table.film), fps=table.fps, mirrored=table.mirrored)

    @property
    def worst(self) -> bytes:
        """PNG of the film at the worst moment, with the models beside each other."""
        return still(self._frame(int(self.filmed.frame[self.filmed.worst])), self.filmed)

    @property
    def caption(self) -> str:
        """Caption of the still."""
        return (
            f"At {self.filmed.time_s[self.filmed.worst]:.1f} s of the film, when the model without effects "
            "is farthest off. Red arrows point from the model's marker to the film's, "
            f"magnified {self.filmed.magnified} times. They include errors that many values share, such as a "
            "wrong scale, like the errors above."
        )

    def clip(self, path: Path) -> str:
        """Write the clip; returns what is to be known of its speed, or nothing."""
        from twin.drawing.painting import write_clip

        speed = write_clip(path, self.film, self.filmed)
        return f", {speed:.1f} times as fast as the film" if speed > 1 else ""

    def _frame(self, number: int) -> Image:
        """A frame of the film, (h,w,3)."""
        grey = next(picture for index, _, picture in self.film.frames() if index == number)
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)
