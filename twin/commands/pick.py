"""Natural features that can be followed in place of markers: found, numbered in a picture, and named."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from typer import Option

from twin.bench.workbench import one_side, structure_of
from twin.csvtable import read_sheet
from twin.inputs.cameras import camera_table, dictionary_name, lens_of, result_of
from twin.inputs.recordings import marks_of
from twin.messages import Say
from twin.project.folder import Project
from twin.project.toml import with_point, write
from twin.table import DataTable
from twin.targets import Array
from twin.validation import decoded

if TYPE_CHECKING:  # vision takes a second to import
    from vision.following.features import Feature

SAG_MM = 1.0  # that a feature may lie off the finger's outline, where the user states no sag
COLUMNS = (
    "number", "x_px", "y_px", "seen_x_mm", "seen_z_mm", "size_mm", "sd_px", "x_mm", "y_mm", "z_mm", "away_mm"
)  # fmt: skip
PAPER = 2.0  # a marker's white paper reaches so many of its half sides from its centre
PER_MM = 4.0  # pixels of the outline's mask
CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
SIDE_PX = 30  # of a feature, where the user states no size


@dataclass(frozen=True)
class FoundFeature:
    """A feature in the first picture: where it is seen, and the nearest place on the finger."""

    feature: "Feature"
    seen: Array  # (2,) mm, x and z in the frame marks' plane
    nearest: Array  # (3,) mm

    @property
    def away(self) -> float:
        """Distance of the two in mm."""
        return float(np.hypot(*(self.nearest[[0, 2]] - self.seen)))


@dataclass(frozen=True)
class _Outline:
    """Mask of the unloaded finger in side view."""

    mask: NDArray[np.uint8]
    low: Array  # (2,) mm, x and z of its first pixel

    @classmethod
    def of(cls, faces: Array, more_mm: float) -> "_Outline":
        """From faces (f,m,2) mm of the surface, and so much wider."""
        low = faces.reshape(-1, 2).min(axis=0) - more_mm - PER_MM
        size = np.ceil((np.ptp(faces.reshape(-1, 2), axis=0) + 2 * (more_mm + PER_MM)) * PER_MM).astype(int)
        mask = np.zeros((size[1], size[0]), dtype=np.uint8)
        for face in np.round((faces - low) * PER_MM).astype(np.int32):
            cv2.fillConvexPoly(mask, cv2.convexHull(face), 1)
        reach = 2 * round(more_mm * PER_MM) + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
        return cls(np.asarray(cv2.dilate(mask, disc), np.uint8), low)

    def holds(self, places: Array) -> bool:
        """True if all places (k, 2) mm lie inside: a patch over the edge shows the wall behind."""
        x, z = np.round((places - self.low) * PER_MM).astype(int).T
        height, width = self.mask.shape
        inside = (x >= 0) & (x < width) & (z >= 0) & (z < height)
        return bool(inside.all() and self.mask[z, x].all())


def run_pick(
    project: Project,
    say: Say,
    *,
    names: Annotated[Sequence[str], Option(
        "--name",
        help="write a numbered feature into twin.toml as a point, NAME=NUMBER; once for each")] = (),
    size_mm: Annotated[float | None, Option(help="side of a feature, mm; 30 px without it")] = None,
    sag_mm: Annotated[float, Option(help="how far the finger hangs at rest, mm")] = 1.0,
) -> dict[str, Any]:
    """Numbered features of the film's first picture; or named ones, written into twin.toml by their numbers
    in the newest of these pictures."""
    if names:
        return _named(project, say, names)
    table = camera_table(project)
    if len(project.config.cameras) > 1:
        raise ValueError(
            f"twin.toml has {len(project.config.cameras)} [[cameras]]; wanted one: where a natural feature "
            "lies in the picture of another camera is not known; leave out the other cameras, or glue markers"
        )
    how: dict[str, Any] = {"tables": ("cameras", "frame", "points", "model"),
                           "extra": {"size_mm": size_mm, "sag_mm": sag_mm},
                           "inputs": [project.path(table.film), *project.deck_files()]}  # fmt: skip
    done = project.done("pick", **how)
    if done is not None:
        say(f"Already done: {project.shown(done / 'features.png')}")
        return result_of(project, "pick", done, skipped=True)
    features, side, picture = _features(project, size_mm, sag_mm)
    with project.new_run("pick", **how) as run:
        run.write_text("features.csv", _csv(features, side))
        run.write_bytes("features.png", _sheet(picture, features))
        run.summary.update(features=len(features), size_mm=side)
        run.summary["headline"] = f"{len(features)} features of {side:g} mm"
    picture_path = project.shown(run.path("features.png"))
    say(f"Wrote {picture_path}: {len(features)} features that can be followed, best first. Name those you "
        "want: `twin pick --name tip=1`.")  # fmt: skip
    return result_of(project, "pick", run.folder)


def _features(
    project: Project, size_mm: float | None, sag_mm: float
) -> tuple[list[FoundFeature], float, Any]:
    """Features beside the markers and on the finger, their side in mm, and the picture."""
    from fe.mesh.points import nearest_on_faces
    from vision.film.series import open_film
    from vision.following.features import find_textures, taken
    from vision.following.firstpictures import first_seen
    from vision.marks import px_per_unit, rows_of
    from vision.plane import MIN_VISIBLE, fit_homography, to_plane

    table, marks = camera_table(project), marks_of(project)
    camera = lens_of(project, table)
    film = open_film(project.path(table.film), fps=table.fps, mirrored=table.mirrored)
    picture = next(iter(film.frames()))[2]
    warp = first_seen([picture], camera, marks, dictionary_name(project, table.dictionary))
    frame = [p for p in rows_of(marks)[0] if np.isfinite(warp[p, 0, 0])]
    if len(frame) < MIN_VISIBLE:
        raise ValueError(f"{table.film} shows {len(frame)} frame markers in its first picture, wanted "
                         f"{MIN_VISIBLE} or more; `twin check` draws which")  # fmt: skip
    places = np.array([mark.position for mark in marks])
    homography = fit_homography(places[frame][:, [0, 2]], warp[frame, :2, 2])
    visible = np.isfinite(warp[:, 0, 0])
    scale = float(np.median(2.0 * px_per_unit(warp[frame]) / [marks[p].size_mm for p in frame]))
    side_px = round(SIDE_PX if size_mm is None else size_mm * scale)
    reach = PAPER * px_per_unit(warp[visible]) + 0.75 * side_px  # corner to corner, and 2 px of blur
    busy = taken(picture.shape, camera.distort(warp[visible, :2, 2]), reach)
    structure, plane = structure_of(project), float(places[frame, 1].mean())
    faces, behind = structure.case.nodes[structure.outside], one_side(project) and plane < 0.0
    side, outline = side_px / scale, _Outline.of(faces[..., [0, 2]], sag_mm)

    def on_finger(seen: Array) -> Array:
        position = np.array([seen[0], abs(plane) if behind else plane, seen[1]])
        return nearest_on_faces(structure.case.element, faces, position) * (1.0, -1.0 if behind else 1.0, 1.0)

    features = []
    for feature in find_textures(picture, side_px=side_px, allowed=~busy):
        seen = to_plane(homography[None], camera.undistort(np.array(feature.centre))[None, None])[0, 0]
        if outline.holds(seen + 0.5 * side * CORNERS):
            features.append(FoundFeature(feature, seen, on_finger(seen)))
    if not features:
        raise ValueError(
            f"the first picture of {table.film} shows no feature of {side:.3g} mm on the finger that can be "
            "followed; wanted texture, such as painted spots or pores: state another --size-mm, or --sag-mm "
            "where the finger hangs at rest, or glue markers"
        )
    return features, round(side, 2), picture


def _csv(features: Sequence[FoundFeature], side: float) -> str:
    rows = [
        [k + 1, *np.round(c.feature.centre, 2), *np.round(c.seen, 3), side, f"{c.feature.sd_px:.4f}",
         *np.round(c.nearest, 3), round(c.away, 2)]
        for k, c in enumerate(features)
    ]  # fmt: skip
    return DataTable(COLUMNS, rows).csv(digits=None)


def _sheet(picture: Any, features: Sequence[FoundFeature]) -> bytes:
    """The picture with every feature's number, as PNG."""
    from vision.drawing.overlays import numbered

    drawn = numbered(picture, np.array([c.feature.centre for c in features]).reshape(-1, 2))
    return bytes(cv2.imencode(".png", drawn)[1])


def _named(project: Project, say: Say, names: Sequence[str]) -> dict[str, Any]:
    """Write named features into twin.toml as further points."""
    path = project.newest("pick", "features.csv")
    if path is None:
        raise ValueError("no features are numbered yet: run `twin pick`, and look at its features.png")
    rows = _rows(path)
    text = decoded((project.root / "twin.toml").read_bytes())
    for given in names:
        name, number = _pair(given)
        if number not in rows:
            raise ValueError(f"--name {given}: {path.name} has the numbers 1 to {len(rows)}; "
                             "wanted one of them")  # fmt: skip
        text = with_point(text, {"name": name, **rows[number]})
    write(project.root / "twin.toml", text)  # names what does not fit, as a name that stands twice
    added = [_pair(text)[0] for text in names]
    say(f"Added to the points of twin.toml: {', '.join(added)}. Their position_mm is the place of the "
        "model's surface nearest to where they are seen: correct it where the finger sags.")  # fmt: skip
    return {"stage": "pick", "status": "done", "points": added}


def _rows(path: Path) -> dict[int, dict[str, Any]]:
    """Keys of [[points]] for each number of a features.csv."""
    table = read_sheet(path, wanted=",".join(COLUMNS)).table(COLUMNS)
    value = {name: table.numbers(name, unit="mm").tolist() for name in COLUMNS}
    return {
        int(number): {
            "seen_mm": [value["seen_x_mm"][k], value["seen_z_mm"][k]],
            "size_mm": value["size_mm"][k],
            "position_mm": [value[f"{axis}_mm"][k] for axis in "xyz"],
        }
        for k, number in enumerate(value["number"])
    }


def _pair(text: str) -> tuple[str, int]:
    match = re.fullmatch(r"([A-Za-z0-9_.+-]+)=(\d+)", text)
    if not match:
        raise ValueError(f"--name {text}: wanted a name and a number of features.png, such as tip=7")
    return match[1], int(match[2])
