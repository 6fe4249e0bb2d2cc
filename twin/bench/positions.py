"""The points of twin.toml that are stated by a position in mm -> their places on the finger's surface."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fe.mesh.points import nearest_on_faces
from twin.marktables import PointTable
from twin.model.structure import Structure
from twin.project.folder import Project
from twin.sanity import on_model_side
from twin.targets import Array, PointKind, TargetPoint, Targets, as_position

ON_FINGER_MM = 3.0  # from the surface at most: room for a tag's thickness and for a rough reading


@dataclass(frozen=True)
class PlacedPoint:
    """A named point: the position (3,) mm that twin.toml states, and the nearest (3,) mm on the surface."""

    name: str
    stated: Array
    nearest: Array

    @property
    def away(self) -> float:
        """The distance between the two in mm."""
        return float(np.linalg.norm(self.nearest - self.stated))

    @property
    def sentence(self) -> str:
        """How far the surface is from what was stated."""
        if self.away < 0.005:
            return f"Point {self.name} lies on the finger's surface at {_shown(self.nearest)} mm."
        return (
            f"Point {self.name}: the film is measured at its position_mm. The model takes the nearest place "
            f"on its surface, {_shown(self.nearest)} mm, {self.away:.2f} mm away."
        )


def places_of(project: Project, structure: Structure) -> dict[str, PlacedPoint]:
    """The places of the points that twin.toml states without a node, by name. ValueError where one is further
    than ON_FINGER_MM from the finger."""
    return placed(project.config.points, structure, mirrored=one_side(project))


def placed(
    points: Iterable[PointTable], structure: Structure, *, mirrored: bool
) -> dict[str, PlacedPoint]:
    """The same for these points.   mirrored: see `one_side`."""
    return {p.name: _place(p, structure, mirrored=mirrored) for p in points if p.node is None}


def check_points(points: Iterable[PointTable], structure: Structure, *, mirrored: bool = False) -> None:
    """Raise ValueError where a point is at a node that is not on the surface, or is stated far from it.

    mirrored: see `one_side`.
    """
    surface = set(structure.case.labels[np.unique(structure.outside)].tolist())
    for point in points:
        if point.node is None:
            continue
        x = structure.case.position(point.node)  # names what is wrong with an unknown node
        if point.node not in surface:
            raise ValueError(
                f"points.{point.name}.node = {point.node}: it lies at {_shown(x)} mm, inside the finger, in "
                "its chamber or on its plane of symmetry; wanted a node of the outer surface; `twin look "
                "--at x,y,z` names the nearest one"
            )
        if point.position_mm is None:
            continue
        stated = on_model_side(np.array(point.position_mm), structure.case, mirrored=mirrored)
        if (away := float(np.linalg.norm(stated - x))) > ON_FINGER_MM:
            raise ValueError(
                f"points.{point.name}: node {point.node} lies at {_shown(x)} mm, {away:.1f} mm from its "
                f"position_mm {_shown(np.array(point.position_mm))}; wanted at most {ON_FINGER_MM:g} mm; "
                "correct one of them, or leave one out"
            )


def position_of(point: PointTable, structure: Structure, *, mirrored: bool = False) -> Array:
    """The undeformed position (3,) mm of a point: its node's, or the nearest place on the surface. ValueError
    where there is no such node or place.   mirrored: see `one_side`."""
    if point.node is not None:
        return np.asarray(structure.case.position(point.node), float)
    return _place(point, structure, mirrored=mirrored).nearest


def one_side(project: Project) -> bool:
    """Whether a point on the side y < 0 of half a finger stands for its mirror image on the other side: one
    camera sees only x and z, which are the same in both."""
    return len(project.config.cameras) == 1


def _place(point: PointTable, structure: Structure, *, mirrored: bool = False) -> PlacedPoint:
    assert point.position_mm is not None  # the configuration refuses a point with neither
    case = structure.case
    stated = on_model_side(np.array(point.position_mm), case, mirrored=mirrored)
    nearest = nearest_on_faces(case.element, case.nodes[structure.outside], stated)
    place = PlacedPoint(point.name, stated, nearest)
    if place.away > ON_FINGER_MM:
        raise ValueError(
            f"points.{point.name}.position_mm = {_shown(stated)}: not on the finger; the nearest place on "
            f"its surface, {_shown(place.nearest)}, is {place.away:.1f} mm away; wanted at most "
            f"{ON_FINGER_MM:g} mm; correct the position (x along the finger from the clamp, y across, z up "
            "from the bottom; `twin look` shows them), or the finger's dimensions"
        )
    return place


def on_surface(targets: Targets, places: Mapping[str, PlacedPoint]) -> Targets:
    """Targets whose points of these names lie at these places. ValueError where targets.toml has them
    elsewhere: at a node, or on the rig."""
    points = tuple(_moved(p, places[p.name]) if p.name in places else p for p in targets.points)
    return replace(targets, points=points)


def _moved(point: TargetPoint, place: PlacedPoint) -> TargetPoint:
    if point.kind not in (PointKind.PLACE, PointKind.UNKNOWN):
        what = f"node {point.node}" if point.kind is PointKind.NODE else "a marker on the rig"
        raise ValueError(
            f"points.{point.name}.position_mm = {_shown(place.stated)} in twin.toml, but the targets have "
            f"{point.name!r} as {what}; wanted one of them: correct targets/targets.toml or twin.toml"
        )
    return TargetPoint(point.name, PointKind.PLACE, None, as_position(place.nearest))


def _shown(x: Array) -> str:
    return "[" + ", ".join(f"{v:.4g}" for v in np.round(x, 3) + 0.0) + "]"
