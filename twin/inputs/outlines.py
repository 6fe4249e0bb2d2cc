"""The outline of a project's model against what the film shows of the finger at rest: where it stands, and
whether its dimensions are right."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fe import Case
from fe.element import Integers
from fe.mesh.mirror import symmetry_support
from twin.bench.workbench import body_of, structure_of, tolerances_of
from twin.bodies.body import Body
from twin.bodies.finger import FingerTable
from twin.bodies.kinds import BodyTable
from twin.bodies.pneunet import PneunetTable
from twin.inputs.cameras import dictionary_name
from twin.inputs.recordings import marks_of, stated_of, stated_pose
from twin.inputs.restsags import RestSag, rest_sag
from twin.marktables import PoseTable
from twin.model.structure import body_case
from twin.numerals import with_sd
from twin.project.cameratables import CameraTable
from twin.project.folder import Project
from twin.targets import Array

if TYPE_CHECKING:  # vision takes a second to import
    from vision import Camera, Video
    from vision.placing.outlines import Outline, Size
    from vision.placing.silhouettes import BodySurface, Changed, Waves

PARTS = 4  # of a face's side, whose chords stand for its curve
CHANGE_MM = 0.1  # of a dimension, for its slope
ENDS = "tip_cap_mm"  # of the dimensions of the chamber the one that the outline tells: there the pleats end
LOW = 0.25  # of the height: lower than every valley
SAG, CHANGE_SAG = "sag", 0.1  # of the weight, as a share of what the constants say; for its slope
TYPED_MM = 1.0  # error of a dimension that twin.toml states and the outline shows
LEAST_SD = 1e-4  # mm and rad: of a pose that is stated as exact
OFF, LEAST_MM = 3.0, 0.1  # sds from which a dimension is another than stated; what a casting is off anyway


@dataclass(frozen=True)
class SeenOutline:
    """What the outline of the finger at rest tells."""

    found: "Outline"
    picture: Array  # (h, w) the film at rest
    stated: Mapping[str, float]  # dimensions in mm of twin.toml
    table: BodyTable | None = None  # these, with what is counted

    @property
    def wrong(self) -> tuple[str, ...]:
        """A sentence for each dimension that is not as stated."""
        return self._repeated[0] + tuple(
            f"model.{name} = {self.stated[name]:g}, the film shows {_told(self.stated[name], size)}: measure "
            "it again, or correct twin.toml."
            for name, size in self._shown.items()
            if _is_off(size)
        )

    @property
    def _repeated(self) -> "tuple[tuple[str, ...], tuple[str, ...]]":
        """Sentences on pleats or chambers that are not as stated, their number and their pitch, and clauses
        on what is."""
        table = self.table
        if not isinstance(table, FingerTable | PneunetTable) or not (table.waves and self.found.counted):
            return (), ()
        key, stated, counted = table.waves[0], getattr(table, table.waves[0]), self.found.counted
        table = table.model_copy(update={key: counted})
        larger = {n: table.model_copy(update={n: x + CHANGE_MM}).pitch_mm for n, x in self.stated.items()}
        slopes = {n: (pitch - table.pitch_mm) / CHANGE_MM for n, pitch in larger.items()}
        pitch = self.found.combined(slopes)
        told = f"model.{key} = {stated}, the film shows {counted}: correct twin.toml."
        wrong = () if counted == stated else (told,)
        shows = _told(table.pitch_mm, pitch)
        if _is_off(pitch):
            stands = f"{counted} {key} have a pitch of {table.pitch_mm:.4g} mm by twin.toml"
            told = f"{stands}, the film shows {shows}: measure them again, or correct twin.toml."
            return (*wrong, told), ()
        return wrong, (*(() if wrong else (f"{key} = {stated}",)), f"pitch {table.pitch_mm:.4g} ({shows})")

    @property
    def told(self) -> tuple[str, ...]:
        """Sentences on where the finger stands and on the dimensions that are as stated."""
        pose, (x, z, turn) = self.found.pose, np.sqrt(np.diag(self.found.covariance))
        place = (
            f"The outline of the finger at rest shows {len(self.found.pixel)} of {self.found.looked} "
            f"places. By it the finger stands at x = {with_sd(pose.x_mm, x)} mm, z = {with_sd(pose.z_mm, z)} "
            f"mm, turned by {with_sd(math.degrees(pose.turn), math.degrees(turn))} degrees."
        )
        right = [
            f"{name} = {self.stated[name]:g} ({_told(self.stated[name], size)})"
            for name, size in self._shown.items()
            if not _is_off(size)
        ] + list(self._repeated[1])
        return (place, *([f"It shows these dimensions as stated: {', '.join(right)}."] if right else []))

    @property
    def errors(self) -> tuple[tuple[float, float, float], ...]:
        """Errors of the pose, 1 sd each: x in mm, z in mm, turn in rad."""
        from vision.placing.planeerrors import principal

        return tuple((float(x), float(z), float(turn)) for x, z, turn in principal(self.found.covariance))

    @property
    def summary(self) -> dict[str, Any]:
        """Its numbers for run.json."""
        pose, sd = self.found.pose, np.sqrt(np.diag(self.found.covariance))
        return {
            "places": len(self.found.pixel), "looked": self.found.looked,
            "pose": {"x_mm": pose.x_mm, "z_mm": pose.z_mm, "turn_deg": math.degrees(pose.turn)},
            "pose_sd": {"x_mm": sd[0], "z_mm": sd[1], "turn_deg": math.degrees(sd[2])},
            "sizes_mm": {n: [self.stated[n] + s.off, s.sd] for n, s in self._shown.items()},
        }  # fmt: skip

    def drawn(self) -> bytes:
        """The film at rest with the edge of the finger where it was found, as PNG: green where it lies within
        GOOD_MM of the fitted model's, else red."""
        from vision.placing.outlines import GOOD_MM

        return drawn(self.picture, self.found.pixel, np.abs(self.found.residual) < GOOD_MM)

    @property
    def _shown(self) -> "dict[str, Size]":
        return {size.name: size for size in self.found.sizes if size.shown and size.name in self.stated}


def drawn(picture: Array, pixel: Array, right: NDArray[np.bool_]) -> bytes:
    """A picture (h, w) with places (k, 2) px of an edge, green where they are right, else red, as PNG."""
    import cv2

    grey = np.clip(picture, 0, 255).astype(np.uint8)
    large = cv2.resize(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), None, fx=2, fy=2)
    for (x, y), good in zip(2.0 * pixel + 0.5, right, strict=True):
        colour = (80, 230, 80) if good else (60, 60, 255)
        cv2.circle(large, (round(x * 16), round(y * 16)), 24, colour, -1, cv2.LINE_AA, 4)
    return bytes(cv2.imencode(".png", large)[1])


def _is_off(size: "Size") -> bool:
    return abs(size.off) > max(OFF * size.sd, LEAST_MM)


def _told(stated: float, size: "Size") -> str:
    return f"{with_sd(stated + size.off, size.sd)} mm"


def outline_tells(project: Project) -> bool:
    """Whether the outline is to tell where the finger stands."""
    return project.config.pose is not None and project.config.pose.source == "outline"


def seen_outline(project: Project, table: CameraTable, film: "Video", camera: "Camera") -> SeenOutline:
    """The finger at rest in a film, by its outline. ValueError where too little of it is seen, or where it
    sags and nobody states which way."""
    from vision.placing.outlines import fit_outline
    from vision.placing.restpictures import picture_at_rest
    from vision.placing.restplaces import BodyPose

    pose, sought = project.config.pose or PoseTable(), outline_tells(project)
    marks = marks_of(project, BodyPose() if sought else None)
    rest = picture_at_rest(
        film, camera, marks, dictionary=dictionary_name(project, table.dictionary),
        reference_s=project.config.measure.reference_s, stated=stated_of(project), edge_mm=pose.edge_sd_mm,
    )  # fmt: skip
    clamped = any(mark.role == "clamp" for mark in marks)
    sd = np.maximum([pose.sd_mm, pose.sd_mm, math.radians(pose.turn_sd_deg)], LEAST_SD)
    model = ModelOutline.of_project(project)
    found = fit_outline(
        rest, model, stated_pose(project) if sought else BodyPose(), prior=None if sought or clamped else sd
    )
    stated = {} if model.table is None else {name: float(getattr(model.table, name)) for name in model.known}
    return SeenOutline(found, rest.picture, stated, model.table)


@dataclass(frozen=True)
class ModelOutline:
    """The surface of a model at rest, with other dimensions than stated."""

    base: Case  # as stated
    outside: Integers  # its outer faces
    table: BodyTable | None = None  # its dimensions; a deck has none
    known: Mapping[str, float] = field(default_factory=dict)  # sd in mm of each of them
    sag: RestSag | None = None  # by its weight

    @staticmethod
    def of_project(project: Project) -> "ModelOutline":
        """That of a project's model."""
        structure, body = structure_of(project), body_of(project)
        sag = rest_sag(project, structure)
        if body is None or project.config.model.dimensions is None:
            return ModelOutline(structure.case, structure.outside, sag=sag)
        return ModelOutline.of(project.config.model.dimensions, tolerances_of(project, body), sag)

    @staticmethod
    def of(table: BodyTable, tolerances: Mapping[str, float], sag: RestSag | None = None) -> "ModelOutline":
        """That of a body with these dimensions.   tolerances: sd in mm of those of its chamber."""
        case = body_case(table.body, _fine(table.body))
        sizes = {name: x for name, x in table.model_dump().items() if isinstance(x, float) and x > 0.0}
        known = {name: tolerances.get(name, TYPED_MM) for name in sizes}
        if known.get(ENDS):
            known[ENDS] = TYPED_MM
        return ModelOutline(case, case.face_nodes("outside"), table, known, sag)

    def __call__(self, off: Mapping[str, float]) -> "BodySurface":
        """The surface with dimensions that are off by so many mm."""
        from vision.placing.silhouettes import BodySurface

        faces, held = self._faces(off), self.base.nodes[self.base.clamped]
        return BodySurface(faces, held, partial(self._changed, off, faces), self._waves)

    @property
    def _waves(self) -> "Waves | None":
        """What repeats along the upper side."""
        from vision.placing.silhouettes import Waves

        table = self.table
        if not isinstance(table, FingerTable | PneunetTable) or table.waves is None:
            return None
        key, start, end = table.waves

        def other(count: int) -> ModelOutline:
            return ModelOutline.of(table.model_copy(update={key: count}), self.known, self.sag)

        high = table.height_mm
        return Waves(getattr(table, key), start, end, LOW * high, high, other)

    def _changed(self, off: Mapping[str, float], faces: Array) -> "tuple[Changed, ...]":
        """The surface with each of its dimensions changed."""
        from vision.placing.silhouettes import Changed

        changed = []
        for name, sd in self.known.items():
            for mm in (CHANGE_MM, -CHANGE_MM) if sd > 0.0 else ():
                other = self._faces({**off, name: off.get(name, 0.0) + mm})
                if other.shape == faces.shape:  # else the lattice has other cells
                    changed.append(Changed(name, other, mm, sd))
                    break
        if self.sag is not None:
            other = self._faces({**off, SAG: off.get(SAG, 0.0) + CHANGE_SAG})
            changed.append(Changed(SAG, other, CHANGE_SAG, self.sag.sd))
        return tuple(changed)

    def _faces(self, off: Mapping[str, float]) -> Array:
        case, outside = self.base, self.outside
        changed = {name: mm for name, mm in off.items() if name != SAG}
        if self.table is not None and changed:
            sizes = {name: getattr(self.table, name) + mm for name, mm in changed.items()}
            case = body_case(self.table.model_copy(update=sizes).body, _fine(self.table.body))
            outside = case.face_nodes("outside")
        x = surface(case, outside, PARTS)
        if self.sag is not None:
            x = x + (1.0 + off.get(SAG, 0.0)) * self.sag(x)
        return x if symmetry_support(case) is None else np.concatenate([x, x * [1.0, -1.0, 1.0]])


def _fine(body: Body) -> Any:
    """The lattice that is finer along the body: its outline is the body's own to 0.01 mm."""
    return next(iter(body.finer(body.lattice).values()))


def surface(case: Case, outside: Integers, parts: int) -> Array:
    """Corners (f, 3 or 4, 3) mm of a case's outer faces, each side cut into parts on its curve."""
    n, simplex = np.arange(parts), case.element.simplex
    i, j = (x.ravel() for x in np.meshgrid(n, n, indexing="ij"))
    corners = np.stack([(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)], axis=0).transpose(2, 0, 1) / parts
    if simplex:
        lower = corners[i + j < parts][:, [0, 1, 3]]
        corners = np.concatenate([lower, corners[i + j < parts - 1][:, [1, 2, 3]]])
    else:
        corners = 2.0 * corners - 1.0
    shape = case.element.on_face(corners.reshape(-1, 2))[0].reshape(*corners.shape[:2], -1)
    return np.asarray(np.einsum("qcm,fmx->fqcx", shape, case.nodes[outside]).reshape(-1, corners.shape[1], 3))
