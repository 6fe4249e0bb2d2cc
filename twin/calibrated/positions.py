"""The points of twin.toml that are stated by a position in mm -> their places on the finger's surface."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe import Case
from fe.mesh.points import nearest, nearest_on_faces
from twin.calibrated.problem import CalibrationProblem
from twin.gravity import is_heavy, unmoved
from twin.marktables import PointTable
from twin.model.structure import Structure, whole
from twin.sanity import ON_PLANE_MM, motion_fault, on_model_side, place_fault, rise_fault
from twin.targets import Array, PointKind, TargetPoint, Targets, as_position

OFF_MODEL_MM = 0.5
SAGS = 0.3  # of its distance from the clamp that a heavy finger's marker may hang below its place
BENEATH, STRAIGHT_MM = 30, 1e-3  # steps to the place beneath a marker, and how exact it is
ON_FINGER_MM = 3.0  # from the surface at most: room for a tag's thickness and for a rough reading
LEAST_OFF = 0.5  # of its standoff: a marker that is stated nearer to the surface tells no direction


@dataclass(frozen=True)
class PlacedPoint:
    """A named point: the position (3,) mm that twin.toml states, and the nearest (3,) mm on the surface.
    standoff: of a marker off the surface, mm; None of one on it."""

    name: str
    stated: Array
    nearest: Array
    standoff: float | None = None

    @property
    def away(self) -> float:
        """The distance between the two in mm."""
        return float(np.linalg.norm(self.nearest - self.stated))

    @property
    def off(self) -> Array | None:
        """The way (3,) mm from the surface to a marker off it; None of one on it."""
        if self.standoff is None:
            return None
        return np.asarray(self.standoff * (self.stated - self.nearest) / self.away, float)

    @property
    def sentence(self) -> str:
        """A sentence on the distance between the stated position and the surface."""
        if self.standoff is not None:
            return (
                f"Point {self.name} stands {self.standoff:.3g} mm off the finger's surface at "
                f"{_shown(self.nearest)} mm, and turns with it."
            )
        if self.away < 0.005:
            return f"Point {self.name} lies on the finger's surface at {_shown(self.nearest)} mm."
        return (
            f"Point {self.name}: the film is measured at its position_mm. The model takes the nearest place "
            f"on its surface, {_shown(self.nearest)} mm, {self.away:.2f} mm away."
        )


def on_both_sides(
    structure: Structure, points: Iterable[PointTable], *, mirrored: bool
) -> Structure:
    """The structure, of both halves where a point lies at y < 0 and only a half is meshed. mirrored: see
    `placed`; then a half has every place."""
    stated = [p.position_mm for p in points if p.position_mm is not None]
    return structure if mirrored or all(y >= -ON_PLANE_MM for _, y, _ in stated) else whole(structure)


def placed(
    points: Iterable[PointTable], structure: Structure, *, mirrored: bool
) -> dict[str, PlacedPoint]:
    """The places of the points without a node, by name. ValueError where one is further than ON_FINGER_MM
    from the surface. mirrored: whether a point at y < 0 of half a body stands for its mirror image."""
    return {
        p.name: _place(p, structure, mirrored=mirrored)
        for p in points
        if p.node is None and p.position_mm is not None
    }


def check_points(points: Iterable[PointTable], structure: Structure, *, mirrored: bool = False) -> None:
    """Raise ValueError where a point is at a node that is not on the surface, or is stated far from it.

    mirrored: see `placed`.
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
        position = on_model_side(np.array(point.position_mm), structure.case, mirrored=mirrored)
        if (away := float(np.linalg.norm(position - x))) > ON_FINGER_MM:
            raise ValueError(
                f"points.{point.name}: node {point.node} lies at {_shown(x)} mm, {away:.1f} mm from its "
                f"position_mm {_shown(np.array(point.position_mm))}; wanted at most {ON_FINGER_MM:g} mm; "
                "correct one of them, or leave one out"
            )


def position_of(point: PointTable, structure: Structure, *, mirrored: bool = False) -> Array:
    """The undeformed position (3,) mm of a point: its node's, or the nearest place on the surface. ValueError
    where there is no such node or place. mirrored: see `placed`."""
    if point.node is not None:
        return np.asarray(structure.case.position(point.node), float)
    return _place(point, structure, mirrored=mirrored).nearest


def _place(point: PointTable, structure: Structure, *, mirrored: bool = False) -> PlacedPoint:
    assert point.position_mm is not None  # the configuration refuses a point with neither
    case = structure.case
    position = on_model_side(np.array(point.position_mm), case, mirrored=mirrored)
    nearest = nearest_on_faces(case.element, case.nodes[structure.outside], position)
    place = PlacedPoint(point.name, position, nearest, point.standoff_mm)
    if place.standoff is not None:
        _check_standoff(place)
    elif place.away > ON_FINGER_MM:
        raise ValueError(
            f"points.{point.name}.position_mm = {_shown(position)}: not on the finger; the nearest place on "
            f"its surface, {_shown(place.nearest)}, is {place.away:.1f} mm away; wanted at most "
            f"{ON_FINGER_MM:g} mm; correct the position (x along the finger from the clamp, y across, z up "
            "from the bottom; `twin look` shows them), or the finger's dimensions; of a ball or a tag on a "
            f"stalk state standoff_mm = {place.away:.1f}, too"
        )
    return place


def _check_standoff(place: PlacedPoint) -> None:
    """Raise ValueError where a marker that stands off the surface is stated elsewhere."""
    assert place.standoff is not None
    if place.away < LEAST_OFF * place.standoff or abs(place.away - place.standoff) > ON_FINGER_MM:
        raise ValueError(
            f"points.{place.name}.standoff_mm = {place.standoff:g}: its position_mm {_shown(place.stated)} "
            f"lies {place.away:.1f} mm off the surface; wanted the place of the marker itself, as far off to "
            f"{ON_FINGER_MM:g} mm; correct one of them"
        )


def side_of(structure: Structure) -> float:
    """The y in mm of the side face of a structure: the outermost of its surface towards +y."""
    return float(structure.case.nodes[np.unique(structure.outside), 1].max())


def seen_at_rest(targets: Targets, structure: Structure, *, mirrored: bool) -> Targets:
    """Targets whose points that the film at rest shows lie on the side face there. ValueError where one is
    further than ON_FINGER_MM from the face, of a finger that has weight so far that no sag explains it."""
    return replace(targets, points=tuple(_seen(p, structure, mirrored) for p in targets.points))


def _seen(point: TargetPoint, structure: Structure, mirrored: bool) -> TargetPoint:
    if point.rest is None:
        return point
    case = structure.case
    rest = on_model_side(np.array(point.rest), case, mirrored=mirrored)
    place = beneath(structure, rest)
    away = float(np.hypot(*(place - rest)[[0, 2]]))
    if away > ON_FINGER_MM + (SAGS * abs(rest[0]) if is_heavy(case) else 0.0):
        raise ValueError(
            f"points.{point.name}: the film at rest shows it at x = {rest[0]:.1f}, z = {rest[2]:.1f} mm, "
            f"{away:.1f} mm beside the finger; wanted at most {ON_FINGER_MM:g} mm: does the finger sag under "
            "its weight (density_kg_m3 and gravity of [model]), or stand elsewhere in the frame ([pose])? "
            "Else state its position_mm"
        )
    return replace(point, position=as_position(place), rest=as_position(rest))


def beneath(structure: Structure, x: Array) -> Array:
    """The place (3,) mm on the surface right beneath x (3,) mm, along y; the nearest one beside the face."""
    case, place = structure.case, np.array(x, float)
    for _ in range(BENEATH):
        near = nearest_on_faces(case.element, case.nodes[structure.outside], place)
        if np.hypot(*(near - x)[[0, 2]]) < STRAIGHT_MM:
            break
        place = np.array([x[0], near[1], x[2]])
    return near


def on_structure(
    targets: Targets, places: Mapping[str, PlacedPoint], case: Case, *, name: str, wanted: str,
    bends_down: bool, mirrored: bool = False,
) -> tuple[Targets, tuple[str, ...]]:  # fmt: skip
    """Targets whose points lie on a structure, at these places where they have one, and remarks.

    name: of the targets in errors; wanted: of a point without a place; mirrored: see `placed`. ValueError
    where a point has no place, or these cannot be displacements of the structure.
    """
    targets = on_surface(targets, places)
    for point in targets.points:
        if point.kind is PointKind.UNKNOWN:
            raise ValueError(f"point {point.name!r} has no place on the finger; wanted {wanted}")
        if point.node is not None:
            case.position(point.node)  # names what is wrong with an unknown node
    targets, remarks = on_model(targets, case)
    fault = fault_of(targets, case, bends_down=bends_down, mirrored=mirrored) or unmoved(targets, case)
    if fault := fault or (rise_fault(targets) if case.pressurised else ""):
        raise ValueError(f"{name}: {fault}")
    return targets, remarks


def fault_of(targets: Targets, case: Case, *, bends_down: bool, mirrored: bool = False) -> str:
    """Fault of targets that cannot be displacements of a structure, "" without one."""
    fault = place_fault(targets, case, mirrored=mirrored)
    return fault or motion_fault(targets, case, bends_down=bends_down)


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
    off = None if place.off is None else as_position(place.off)
    return TargetPoint(point.name, PointKind.PLACE, None, as_position(place.nearest), off=off)


def _shown(x: Array) -> str:
    return "[" + ", ".join(f"{v:.4g}" for v in np.round(x, 3) + 0.0) + "]"


def on_model(targets: Targets, case: Case) -> tuple[Targets, tuple[str, ...]]:
    """Targets whose material points lie on the model, and a sentence on the points moved for that."""
    points, off = list(targets.points), {}
    for p in np.flatnonzero(targets.of_kind(PointKind.PLACE)):
        position = np.array(points[p].position)
        moved_to = nearest(case, position)
        off[points[p].name] = float(np.linalg.norm(moved_to - position))
        points[p] = replace(points[p], position=as_position(moved_to))
    worst = max(off, key=lambda name: off[name], default="")
    if off.get(worst, 0.0) > OFF_MODEL_MM:
        raise ValueError(
            f"point {worst!r} lies {off[worst]:.2f} mm off the model, wanted at most {OFF_MODEL_MM} mm: "
            "correct the region or y_mm in [dic], or the model's geometry, and measure anew"
        )
    moved = sum(distance > 0.0 for distance in off.values())
    if not moved:
        return targets, ()
    return replace(targets, points=tuple(points)), (
        f"{moved} of {len(off)} points without a node lie up to {off[worst]:.2f} mm off the model ({worst}). "
        "The nearest point of the model stands for each.",
    )


def asked(
    problem: CalibrationProblem, at: Sequence[str], *, argument: str = "--at"
) -> dict[str, Array]:
    """The places (3,) mm on the finger that texts name: points of the project, x=60 (on their line along the
    finger), or x,y,z; all points of the project without texts. An error names the argument."""
    names, every = problem.targets.names, problem.targets.places(problem.case.position)
    by_name = {n: x for n, x, p in zip(names, every, problem.targets.points) if p.kind is not PointKind.FIXED}
    return {text: _asked(problem, text, by_name, argument) for text in at} or by_name


def _asked(
    problem: CalibrationProblem, text: str, by_name: dict[str, Array], argument: str
) -> Array:
    if text in by_name:
        return by_name[text]
    numbers = re.sub(r"^x=", "", text).split(",")
    try:
        x = np.array([float(n) for n in numbers])
    except ValueError:
        x = np.zeros(0)
    if len(x) == 1 and text.startswith("x="):
        near = min(by_name.values(), key=lambda place: abs(float(place[0]) - float(x[0])))
        x = np.array([x[0], near[1], near[2]])
    if x.shape != (3,) or not np.isfinite(x).all():
        raise ValueError(
            f"{argument} {text!r}: wanted a point of the project ({', '.join(by_name)}), x=60, or x,y,z in "
            "mm, the clamp at x = 0"
        )
    place = np.asarray(nearest(problem.case, x), float)
    if (off := float(np.linalg.norm(place - x))) > ON_FINGER_MM:
        raise ValueError(
            f"{argument} {text!r} is {off:.1f} mm off the finger's surface; wanted at most {ON_FINGER_MM:g} "
            f"mm: the nearest place is {','.join(f'{v:.4g}' for v in place)}"
        )
    return place
