"""Where the finger stands and how large it is, by its outline in drawn pictures: errors over stated sds.

    python benchmarks/films/outlines.py [--quick] [--json] [--show FILE]

Each draw has its own finger: dimensions, pose, frame markers, scale, distance and edges are off by what is
stated of them. The picture is drawn from the surface of a finer mesh, projected by OpenCV, with tags on the
edge, a strip that hides a part, a slope of light and noise. It is measured by the code of `twin measure`.

pose_pull, size_pull: errors over their sds, which should be 1. refused: share of draws in which too little of
the outline is seen. pose_mm, pose_deg, length_mm, height_mm: rms errors.
"""

import os
import sys

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from dataclasses import dataclass
from pathlib import Path

from benchmarks.commandline import options, told

import cv2
import numpy as np
from numpy.typing import NDArray

from fe import Lattice
from twin.bodies.finger import BuiltIn, FingerTable
from twin.inputs.outlines import ModelOutline, surface
from twin.model.structure import body_case
from vision import Camera, Mark
from vision.kinds import CodedMarker
from vision.placing.outlines import RestPicture, fit_outline
from vision.placing.restplaces import BodyPose

Array = NDArray[np.float64]
STATED = FingerTable(
    length_mm=70.0, width_mm=20.0, height_mm=15.0, side_wall_mm=1.9, top_wall_mm=2.7, pleats=4,
    pleat_depth_mm=6.8, side_pleat_depth_mm=2.0,
)  # fmt: skip
FINE = Lattice(per_bellow=18, wall=1, across=1, up=1, centred=False)
Y, SIZE, PX, FINER = STATED.width_mm / 2, (640, 360), 5.0, 6  # mm, px, px per mm, drawn px a px
FRAME = np.array(
    [(-21, 20), (14, 22), (50, 22), (87, 20), (-23, -34), (14, -36), (50, -36), (87, -34)], float
)
TAGS = ((18.0, 0.0), (38.0, 0.0), (70.0, 0.0))  # mm, of the body: middles of tags on its edge
WALL_MM, FRAME_MM, SCALE, HEIGHT_MM, EDGE_MM, WANDER = 0.1, 0.1, 1e-3, 0.3, 0.05, 0.4
OFF = {"length_mm": 1.0, "height_mm": 0.5, "pleat_depth_mm": 0.3, "width_mm": 0.3, "side_pleat_depth_mm": 0.2}
INNER = {"base_cap_mm": WALL_MM, "tip_cap_mm": WALL_MM}


@dataclass(frozen=True)
class Draw:
    """A picture, what is stated of its rig, and the truth."""

    rest: RestPicture
    pose: BodyPose
    sizes: dict[str, float]


def draw(rng: np.random.Generator, *, distance: float, longer: float = 0.0) -> Draw:
    """A picture at rest from `distance` mm of a finger that is longer than stated by so many mm, too."""
    focal = PX * distance
    camera = Camera(np.array([[focal, 0, 323.0], [0, focal, 178.0], [0, 0, 1]]), np.zeros(5), SIZE)
    off = {name: float(rng.normal(0, sd)) for name, sd in (OFF | INNER).items()}
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
    picture = painted(pixels(in_frame(x, pose)), pose, rng)
    for place in TAGS:
        picture = tagged(picture, pixels(in_frame(np.array([place[0], Y, place[1]]), pose)))
    picture += rng.normal(0, 0.7 / np.sqrt(20), picture.shape)
    marks = [Mark(f"f{k}", CodedMarker(k, 5.0), (a, Y, b), "frame") for k, (a, b) in enumerate(FRAME)]
    rest = RestPicture(picture, camera, marks, ideal, FRAME_MM, SCALE, HEIGHT_MM, EDGE_MM)
    return Draw(rest, pose, off)


def in_frame(x: Array, pose: BodyPose) -> Array:
    """Places (..., 3) mm of the body in the frame."""
    c, s = np.cos(pose.turn), np.sin(pose.turn)
    return np.asarray(x @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) + [pose.x_mm, 0.0, pose.z_mm])


def painted(faces: Array, pose: BodyPose, rng: np.random.Generator) -> Array:
    """The picture (h,w) of faces (f,c,2) px, each side's edge off by its own error, before a lit wall."""
    mask = np.zeros((SIZE[1] * FINER, SIZE[0] * FINER), np.uint8)
    for face in np.round(((faces + 0.5) * FINER - 0.5) * 16).astype(np.int32):
        cv2.fillConvexPoly(mask, np.ascontiguousarray(face), 255, cv2.LINE_8, 4)
    inside, outside = (cv2.distanceTransform(m, cv2.DIST_L2, 5) for m in (mask, 255 - mask))
    away = cv2.GaussianBlur(outside - inside, (0, 0), FINER / 2)
    down, right = np.gradient(away)
    c, s = np.cos(pose.turn), np.sin(pose.turn)
    x, z = -right * c - down * s, right * s - down * c  # x to the left of the picture, z up
    side = np.where(np.abs(x) > np.abs(z), x > 0, 2 + (z > 0))
    coarse = rng.normal(0, 1.0, (SIZE[1] // 40 + 2, SIZE[0] // 40 + 2))  # a knot every 8 mm
    wander = cv2.resize(coarse, mask.shape[::-1], interpolation=cv2.INTER_LINEAR) * WANDER * 1.5
    edge = EDGE_MM * (rng.normal(0, 1.0, 4)[side] + wander) * PX * FINER
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
    told(run(16 if typed.quick else 60, seed=7), typed.json)


if __name__ == "__main__":
    main()
