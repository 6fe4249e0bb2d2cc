"""Where the finger stands and how large it is, by its outline in drawn pictures: errors over stated sds.

    python benchmarks/films/outlines.py [--quick] [--json] [--show FILE]

Each draw has its own finger: dimensions, pose, frame markers, scale, distance and edges are off by what is
stated of them. The picture is drawn from the surface of a finer mesh, projected by OpenCV, with tags on the
edge, a strip that hides a part, a slope of light and noise. It is measured by the code of `twin measure`.

pose_pull, size_pull: errors over their sds, which should be 1. refused: share of draws in which too little of
the outline is seen. pose_mm, pose_deg, length_mm, height_mm: rms errors.

Then the finger bends, by a formula and no model, at three moments of each draw, before a model on a coarse
mesh that bends a little otherwise. data_pull: errors of the edges' motion from rest to moment over their sds;
data_sd_mm: the median of these. tag_pull: of tags beside the outline. slips_told: share of tags which slip by
0.8 mm that are named; tags_wronged: share of draws in which another is.
"""

import os
import sys

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.commandline import options, told

import cv2
import numpy as np
from numpy.typing import NDArray

from fe import Case, Lattice
from twin.bodies.finger import BuiltIn, FingerTable
from twin.inputs.outlines import ModelOutline, surface
from twin.model.structure import body_case
from vision import Camera, Mark
from vision.kinds import CodedMarker
from vision.marks import frame_places
from vision.placing.movedoutlines import MovedOutline, RestEdges, apart_at
from vision.placing.outlines import fit_outline
from vision.placing.restpictures import RestPicture
from vision.placing.restplaces import BodyPose
from vision.placing.silhouettes import BodySurface
from vision.plane import plane_of, to_plane

Array = NDArray[np.float64]
Edges = Callable[[Array, Array], Array]  # how far edges are off, in sds, by their normals
STATED = FingerTable(
    length_mm=70.0, width_mm=20.0, height_mm=15.0, side_wall_mm=1.9, top_wall_mm=2.7, pleats=4,
    pleat_depth_mm=6.8, side_pleat_depth_mm=2.0,
)  # fmt: skip
FINE = Lattice(per_bellow=18, wall=1, across=1, up=1, centred=False)
Y, SIZE, PX, FINER = STATED.width_mm / 2, (640, 360), 5.0, 6  # mm, px, px per mm, drawn px a px
FRAME = np.array(
    [(-21, 20), (14, 22), (50, 22), (87, 20), (-23, -34), (14, -36), (50, -36), (87, -34)], float
)
SLIPS = 1  # of the tags
TAGS = ((18.0, 0.0), (38.0, 0.0), (70.0, 0.0))  # mm, of the body: middles of tags on its edge
WALL_MM, FRAME_MM, SCALE, HEIGHT_MM, EDGE_MM, WANDER = 0.1, 0.1, 1e-3, 0.3, 0.05, 0.4
OFF = {"length_mm": 1.0, "height_mm": 0.5, "pleat_depth_mm": 0.3, "width_mm": 0.3, "side_pleat_depth_mm": 0.2}
SLIP_MM = 0.8  # of a tag along the finger, in half of the draws, from the second of so many moments on
MOMENTS, CORRECTED = 3, 0.25  # share of the errors of dimensions that are left where they are corrected
INNER = {"base_cap_mm": WALL_MM, "tip_cap_mm": 0.3}


@dataclass(frozen=True)
class Draw:
    """A picture, what is stated of its rig, and the truth."""

    rest: RestPicture
    pose: BodyPose
    sizes: dict[str, float]
    pixels: Callable[[Array], Array]  # (..., 2) px of places (..., 3) mm in the frame
    surface: Array  # (f, c, 3) mm, in the axes of the body


def draw(
    rng: np.random.Generator, *, distance: float, longer: float = 0.0, light: Array | None = None,
    sag: Callable[[Array], Array] | None = None,
) -> Draw:  # fmt: skip
    """A picture at rest from `distance` mm of a finger that is longer than stated by so many mm, too.

    light: (2,) of a film that goes on: its edges are off by that, and not by sides; its shape wanders, and
    its dimensions are corrected by what the outline at rest has shown.   sag: displacements that are added.
    """
    focal = PX * distance
    camera = Camera(np.array([[focal, 0, 323.0], [0, focal, 178.0], [0, 0, 1]]), np.zeros(5), SIZE)
    left = 1.0 if light is None else CORRECTED
    off = {name: float(rng.normal(0, left * sd)) for name, sd in (OFF | INNER).items()}
    off["length_mm"] += longer
    true = STATED.model_copy(update={name: getattr(STATED, name) + mm for name, mm in off.items()})
    pose = BodyPose(rng.uniform(-2, 2), rng.uniform(-2, 2), np.deg2rad(rng.uniform(-2, 2)))
    facing = np.array([[-1.0, 0, 0], [0, 0, -1.0], [0, -1.0, 0]])
    turn = cv2.Rodrigues(np.deg2rad(rng.normal(0, 1, 3)))[0] @ facing
    shift = np.array([0.0, 0, distance]) - turn @ np.array([32.0, Y, -8.0])

    def pixels(points: Array) -> Array:
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        seen = cv2.projectPoints(flat, cv2.Rodrigues(turn)[0], shift, camera.matrix, camera.distortion)[0]
        return np.asarray(seen, float).reshape(*points.shape[:-1], 2)

    frame = (FRAME + rng.normal(0, FRAME_MM, FRAME.shape)) * (1 + rng.normal(0, SCALE))
    x = surface(case := body_case(BuiltIn(true.finger, FINE), FINE), case.face_nodes("outside"), 4)
    x = np.concatenate([x, x * [1.0, -1.0, 1.0]])
    x[..., 1] += rng.normal(0, HEIGHT_MM)
    ideal = pixels(np.insert(frame, 1, Y, axis=1)) + rng.normal(0, 0.003, frame.shape)
    if light is not None:
        x = wandering(x, rng)
    x = x if sag is None else x + sag(x)
    picture = painted(pixels(in_frame(x, pose)), pose, rng, sides(rng) if light is None else lit(light))
    for place in TAGS:
        picture = tagged(picture, pixels(in_frame(np.array([place[0], Y, place[1]]), pose)))
    picture += rng.normal(0, 0.7 / np.sqrt(20), picture.shape)
    marks = [Mark(f"f{k}", CodedMarker(k, 5.0), (a, Y, b), "frame") for k, (a, b) in enumerate(FRAME)]
    rest = RestPicture(picture, camera, marks, ideal, FRAME_MM, SCALE, HEIGHT_MM, EDGE_MM)
    return Draw(rest, pose, off, pixels, x)


def wandering(x: Array, rng: np.random.Generator) -> Array:
    """Places (..., 3) mm of a casting whose top and bottom wander, with knots every 8 mm."""
    knots = np.arange(-8.0, 96.0, 8.0)
    low, high = (np.interp(x[..., 0], knots, rng.normal(0, WANDER * EDGE_MM, len(knots))) for _ in range(2))
    out = x.copy()
    out[..., 2] += np.where(x[..., 2] > STATED.height_mm / 2, high, low)
    return out


@dataclass(frozen=True)
class Bend:
    """A motion of the finger: its middle has the curvature (1 + uneven t) turn / length, t from -1 to 1."""

    turn: float  # rad at the tip
    uneven: float
    stretch: float

    def __call__(self, x: Array) -> Array:
        """Places (..., 3) mm that were at x (..., 3) mm at rest."""
        s = np.linspace(0.0, 1.3 * STATED.length_mm, 2000)
        t = 2 * s / STATED.length_mm - 1
        angle = self.turn / STATED.length_mm * np.cumsum(1 + self.uneven * t) * s[1]
        ends = [np.cumsum(f(angle)) * s[1] * (1 + self.stretch) for f in (np.cos, np.sin)]
        a, cx, cz = (np.interp(x[..., 0].clip(0), s, v) for v in (angle, *ends))
        up, back = x[..., 2] - STATED.height_mm / 2, np.minimum(x[..., 0], 0.0)
        z = cz + up * np.cos(a) + STATED.height_mm / 2
        return np.stack([back + cx - up * np.sin(a), x[..., 1], z], axis=-1)


@dataclass(frozen=True)
class Moment:
    """A moment of a film: what its outline shows, and its tags."""

    outline: MovedOutline
    pull: Array  # (k,) of its edges, over their sd
    tags: Array  # (t, 2, 2): motion beyond the outline's along and across, mm, and its sd


def moment(
    d: Draw, edges: RestEdges, case: Case, rng: np.random.Generator, *, light: Array, slip: float
) -> Moment:
    """A drawn moment in which the model on a mesh is off by a little; a tag has slipped along the finger."""
    turn, uneven, stretch = rng.uniform(-1.2, -0.3), rng.uniform(-0.3, 0.3), rng.uniform(0.0, 0.05)
    true = Bend(turn, uneven, stretch)
    model = Bend(turn * rng.normal(1, 0.01), uneven + rng.normal(0, 0.02), stretch + rng.normal(0, 2e-3))
    tags = np.array([[x, Y, z] for x, z in TAGS])
    sits = tags.copy()
    sits[SLIPS, 0] += slip
    now = true(sits)
    picture = painted(d.pixels(in_frame(true(d.surface), d.pose)), d.pose, rng, lit(light))
    rested, moved = (d.pixels(in_frame(x, d.pose)) for x in (tags, now))
    for middle in moved:
        picture = tagged(picture, middle)
    picture += rng.normal(0, 0.7, picture.shape)
    found = edges.moved(picture, model_faces(replace(case, nodes=model(case.nodes))))
    line, body = found.line, found.body
    apart = (in_frame(true(body), d.pose) - in_frame(model(body), d.pose))[:, [0, 2]]
    pull = (found.off - (apart * line.normal).sum(axis=1)) / found.sd
    rested, moved = (placed(d.rest, px + rng.normal(0, 0.02, px.shape)) for px in (rested, moved))
    at = edges.fit.stands
    on_body = in_body(np.insert(rested, 1, Y, axis=1), at)
    foretold = in_frame(model(on_body), at)[:, [0, 2]]
    rows = []
    for rest, place, here in zip(rested, foretold, moved, strict=True):
        motion, spread, own = found.beside(rest, place)
        rows.append([own @ (here - place) - motion, np.sqrt(np.diag(spread) + 0.01**2)])
    return Moment(found, pull, np.array(rows))


def placed(rest: RestPicture, pixel: Array) -> Array:
    """Places (n, 2) mm in the plane of the frame marks of px (n, 2)."""
    plane = plane_of(frame_places(rest.marks), rest.ideal[None])
    return to_plane(plane.homography, rest.camera.undistort(pixel)[None])[0]


def in_body(x: Array, pose: BodyPose) -> Array:
    """Places (..., 3) mm of the frame in the axes of the body."""
    return in_frame(x - [pose.x_mm, 0.0, pose.z_mm], BodyPose(0.0, 0.0, -pose.turn))


def model_faces(case: Case) -> Array:
    """The outer faces of a half and its mirror image."""
    x = surface(case, case.face_nodes("outside"), 4)
    return np.concatenate([x, x * [1.0, -1.0, 1.0]])


def run_moved(draws: int, seed: int) -> dict[str, float]:
    """The figures of outlines that have moved; in half of the draws a tag has slipped."""
    rng = np.random.default_rng(seed)
    make = ModelOutline.of(STATED, {**dict.fromkeys(STATED.body.inner, WALL_MM)})
    case = body_case(STATED.body, STATED.body.lattice)
    solid = BodySurface(model_faces(case), case.nodes[case.clamped])
    pulls, sds, tags, told, wrong = [], [], [], [], 0
    for k in range(draws):
        light, slip = rng.normal(0, 1.0, 2), SLIP_MM * (k % 4 > 1)
        d = draw(rng, distance=(3000.0, 500.0)[k % 2], light=light)
        edges = RestEdges.of(fit_outline(d.rest, make, BodyPose()).fit, solid)
        film = [moment(d, edges, case, rng, light=light, slip=slip * (j > 0)) for j in range(MOMENTS)]
        pulls += [float(np.nanmean(m.pull**2)) for m in film]
        sds += [float(np.nanmedian(m.outline.sd)) for m in film]
        off, sd = (np.array([m.tags[:, i] for m in film]) for i in (0, 1))
        named = [t for t in range(len(TAGS)) if len(apart_at(off[:, t], sd[:, t]))]
        right = [t for t in range(len(TAGS)) if not (slip and t == SLIPS)]
        tags.append((off / sd)[:, right].ravel())
        told += [SLIPS in named] if slip else []
        wrong += any(t in right for t in named)
    return {
        "films": draws,
        "data_pull": round(float(np.sqrt(np.mean(pulls))), 3),
        "data_sd_mm": round(float(np.median(sds)), 3),
        "tag_pull": round(float(np.sqrt(np.mean(np.square(np.concatenate(tags))))), 3),
        "slips_told": round(float(np.mean(told)), 3),
        "tags_wronged": round(wrong / draws, 3),
    }


def in_frame(x: Array, pose: BodyPose) -> Array:
    """Places (..., 3) mm of the body in the frame."""
    c, s = np.cos(pose.turn), np.sin(pose.turn)
    return np.asarray(x @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) + [pose.x_mm, 0.0, pose.z_mm])


def sides(rng: np.random.Generator) -> Edges:
    """Each side's edge off by its own error, and wandering along it."""
    off, coarse = rng.normal(0, 1.0, 4), rng.normal(0, 1.0, (SIZE[1] // 40 + 2, SIZE[0] // 40 + 2))
    wide, high = (FINER * n for n in SIZE)
    wander = cv2.resize(coarse, (wide, high), interpolation=cv2.INTER_LINEAR) * WANDER * 1.5  # knots: 8 mm
    return lambda x, z: off[np.where(np.abs(x) > np.abs(z), x > 0, 2 + (z > 0))] + wander


def lit(light: Array) -> Edges:
    """Edges off as light (2,) falls on them."""
    return lambda x, z: np.asarray((light[0] * x + light[1] * z) / np.maximum(np.hypot(x, z), 1e-3))


def painted(faces: Array, pose: BodyPose, rng: np.random.Generator, edges: Edges) -> Array:
    """The picture (h,w) of faces (f,c,2) px, their edges off, before a lit wall."""
    mask = np.zeros((SIZE[1] * FINER, SIZE[0] * FINER), np.uint8)
    for face in np.round(((faces + 0.5) * FINER - 0.5) * 16).astype(np.int32):
        cv2.fillConvexPoly(mask, np.ascontiguousarray(face), 255, cv2.LINE_8, 4)
    inside, outside = (cv2.distanceTransform(m, cv2.DIST_L2, 5) for m in (mask, 255 - mask))
    away = cv2.GaussianBlur(outside - inside, (0, 0), FINER / 2)
    down, right = np.gradient(away)
    c, s = np.cos(pose.turn), np.sin(pose.turn)
    x, z = -right * c - down * s, right * s - down * c  # x to the left of the picture, z up
    edge = EDGE_MM * edges(x, z) * PX * FINER
    cover = np.where(outside - inside < edge - 1.0, 1.0, 0.0).astype(np.float32)
    block = cv2.GaussianBlur(cover, (0, 0), 0.8 * FINER)
    cover = block.reshape(SIZE[1], FINER, SIZE[0], FINER).mean(axis=(1, 3)).astype(float)
    wall = 120.0 + rng.uniform(-15, 15) * np.linspace(-1, 1, SIZE[0]) + rng.uniform(-8, 8) * np.linspace(
        -1, 1, SIZE[1]
    )[:, None]  # fmt: skip
    return np.asarray(wall + cover * (60.0 - wall))


def tagged(picture: Array, middle: Array) -> Array:
    """The picture with a tag of 6 mm at px (2,)."""
    x, y = np.round(middle).astype(int)
    out = picture.copy()
    out[y - 15 : y + 16, x - 15 : x + 16] = 190.0
    out[y - 12 : y + 13, x - 12 : x + 13] = 30.0
    return out


def run(draws: int, seed: int) -> dict[str, float]:
    """The figures, from so many draws."""
    rng = np.random.default_rng(seed)
    make = ModelOutline.of(STATED, {**dict.fromkeys(STATED.body.inner, WALL_MM)})
    poses, sizes, errors, refused, lengths = [], [], [], 0, []
    for k in range(draws):
        d = draw(rng, distance=(3000.0, 500.0)[k % 2])
        try:
            found = fit_outline(d.rest, make, BodyPose())
        except ValueError as error:
            print(error, file=sys.stderr)
            refused += 1
            continue
        off = np.array([found.pose.x_mm - d.pose.x_mm, found.pose.z_mm - d.pose.z_mm,
                        found.pose.turn - d.pose.turn])  # fmt: skip
        poses.append(off @ np.linalg.solve(found.covariance, off) / 3)
        errors.append(off)
        shown = {s.name: s for s in found.sizes if s.shown}
        sizes += [(s.off - d.sizes.get(name, 0.0)) / s.sd for name, s in shown.items()]
        lengths.append([shown[name].off - d.sizes[name] for name in ("length_mm", "height_mm")])
    x, z, turn = np.sqrt(np.mean(np.square(errors), axis=0))
    length, height = np.sqrt(np.mean(np.square(lengths), axis=0))
    return {
        "draws": draws,
        "pose_pull": round(float(np.sqrt(np.mean(poses))), 3),
        "size_pull": round(float(np.sqrt(np.mean(np.square(sizes)))), 3),
        "refused": round(refused / draws, 3),
        "pose_mm": round(float(np.hypot(x, z)), 3),
        "pose_deg": round(float(np.rad2deg(turn)), 3),
        "length_mm": round(float(length), 3),
        "height_mm": round(float(height), 3),
    }


def main() -> None:
    show = (Path, "write the first picture there")
    typed = options(__doc__ or "", {"--show": show}, quick="16 draws instead of 60", json="one JSON line")
    if typed.show:
        picture = draw(np.random.default_rng(7), distance=3000.0).rest.picture
        cv2.imwrite(str(typed.show), np.clip(picture, 0, 255).astype(np.uint8))
    count = 16 if typed.quick else 60
    told(run(count, seed=7) | run_moved(count, seed=8), typed.json)


if __name__ == "__main__":
    main()
