"""Places of markers and of the finger from the film at rest, against stated ones: virtual observations.

    python benchmarks/films/places.py [--quick] [--json]

Each draw has a frame of six markers that are off by frame_sd_mm, a scale that is off, a finger that stands
elsewhere in the frame, tags up to 1 mm off their nodes and 0 to 0.4 mm thick, material points place_mm
beside them, noise in every pixel. The finger is a beam that bends to arcs; tags turn with it. No picture is
drawn: marks are projected exactly, and placed by the same code as a film's. Two numbers are fitted, the
curvature and its change from clamp to tip (an effect).

place_pull: error of the measured places over what is stated of them. pose_pull: the same of the pose that
two markers of the clamp tell. coverage: of the 95 % intervals of both numbers. power_ratio: sd of the effect
with stated places (placement_sd_mm 0.3, node_sd_mm 0.1) over that with measured ones, the pose from the
clamp. standoff_wrong: share of draws in which an absent effect has more than 3 sds. The tags do not tilt out
of the plane: thickness acts through perspective alone.
"""

import os
import sys

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from dataclasses import dataclass

from benchmarks.commandline import whole

import cv2
import numpy as np
from numpy.typing import NDArray

from vision import Camera, Mark
from vision.errors import sharederrors
from vision.errors.errormodel import measured_alone
from vision.errors.sharederrors import Named, Stated
from vision.errors.staticnoise import with_y
from vision.kinds import CodedMarker
from vision.perspective import Viewpoint, to_own_plane, viewpoint
from vision.placing.planeerrors import height_modes, principal
from vision.placing.restplaces import BodyPose, pose_of
from vision.plane import Plane, misplaced, place_noise, plane_of, to_plane

Array = NDArray[np.float64]
Y, DISTANCE, PX, NOISE_PX, REST = 12.0, 500.0, 4.0, 0.01, 20  # mm, mm, px per mm, px, frames
FRAME = np.array([(-30, 30), (45, 34), (120, 30), (-30, -75), (45, -79), (120, -75)], float)
CLAMP = np.array([(-20.0, -6.0), (-20.0, 26.0)])  # mm, in the axes of the finger
NODES = np.array([(x, 2.0) for x in np.linspace(12.0, 100.0, 9)])
BEND = np.concatenate([np.zeros(1), np.linspace(0.001, 0.013, 11)])  # 1/mm
RIG = Stated(placement_mm=0.3, node_mm=0.1)


def bent(place: Array, curvature: float, change: float, bend: Array = BEND) -> Array:
    """Places (t,p,2) mm of material points (p,2) of the beam, its curvature changed from clamp to tip.

    bend: (t,) 1/mm."""
    s = np.linspace(0.0, 120.0, 1201)
    shape = curvature * (s + change * (s**2 / 200.0 - s / 2.0))  # integral of 1 + change (s / 100 - 1 / 2)
    turn = -bend[:, None] * shape
    cosine, sine = np.cos(turn), np.sin(turn)
    step = s[1] - s[0]
    middles = [np.cumsum((f[:, 1:] + f[:, :-1]) / 2, axis=1) for f in (cosine, sine)]
    lines = [step * np.pad(m, ((0, 0), (1, 0))) for m in middles]
    out = np.zeros((len(bend), len(place), 2))
    for p, (x, z) in enumerate(place):
        a, b = (np.array([np.interp(x, s, row) for row in line]) for line in lines)
        c, d = (np.array([np.interp(x, s, row) for row in f]) for f in (cosine, sine))
        out[:, p] = np.stack([a - z * d, b + z * c], axis=1)
    return out


@dataclass(frozen=True)
class Draw:
    """What one camera shows: values (t,p,2) mm and places (p,2) mm at rest in the axes of the frame, turns
    (t,p) rad of the tags, the plane, and the truth."""

    value: Array
    place: Array
    turns: Array
    true: Array
    marks: list[Mark]
    plane: Plane
    view: Viewpoint
    seen: Array
    pose: tuple[BodyPose, BodyPose, Array]  # true, found, covariance


def draw(rng: np.random.Generator, *, spread: float) -> Draw:
    """One observation; spread: of the tags about their nodes, mm."""
    focal = PX * DISTANCE
    matrix = np.array([[focal, 0, 400.0], [0, focal, 300.0], [0, 0, 1]])
    camera = Camera(matrix, np.zeros(5), (800, 600))
    x, z = rng.normal(0, 0.3, 2)
    true = BodyPose(float(x), float(z), float(np.deg2rad(rng.normal(0, 0.3))))
    tags = NODES + rng.uniform(-spread, spread, NODES.shape)
    frame = (FRAME + rng.normal(0, RIG.frame_mm, FRAME.shape)) * (1 + rng.normal(0, RIG.scale))
    clamp = in_frame(CLAMP + rng.normal(0, RIG.frame_mm, CLAMP.shape), true)
    glued = rng.normal(0, RIG.place_mm, tags.shape)
    body = in_frame(bent(tags + glued, 1.0, 0.0) - glued, true)
    still = [np.broadcast_to(x, (len(BEND), *x.shape)) for x in (frame, clamp)]
    every = np.concatenate([*still, body], axis=1)
    world = np.insert(every, 1, Y, axis=2)
    world[:, len(FRAME) + 2 :, 1] += rng.uniform(0.0, 0.4, len(tags))
    facing = np.array([[-1.0, 0, 0], [0, 0, -1.0], [0, -1.0, 0]])
    turn = cv2.Rodrigues(np.deg2rad(rng.normal(0, 3, 3)))[0] @ facing
    shift = np.array([0.0, 0, DISTANCE]) - turn @ np.array([45.0, Y, -20.0])
    flat = np.ascontiguousarray(world.reshape(-1, 3))
    pixels = cv2.projectPoints(flat, cv2.Rodrigues(turn)[0], shift, camera.matrix, camera.distortion)[0]
    ideal = np.asarray(pixels, float).reshape(*world.shape[:2], 2)
    sd = np.where(np.arange(len(BEND)) == 0, NOISE_PX / np.sqrt(REST), NOISE_PX)
    ideal = ideal + sd[:, None, None] * rng.normal(size=ideal.shape)
    plane = plane_of(FRAME, ideal[:, : len(FRAME)])
    view = viewpoint(camera, plane.homography)
    seen = to_plane(plane.homography, ideal[:, len(FRAME) :])
    found, covariance = pose_of(CLAMP, seen[0, :2], np.sqrt(2.0) * RIG.frame_mm)
    own = to_own_plane(seen[:, 2:], np.zeros(len(tags)), view)
    marks = [Mark(f"p{k}", CodedMarker(k, 5.0), (float(x), Y, float(z)), "finger", measured=True)
             for k, (x, z) in enumerate(own[0])]  # fmt: skip
    noise = NOISE_PX / (PX * 5.0)  # rad, of a side of 5 mm
    turns = -BEND[:, None] * tags[:, 0] + rng.normal(0, noise, own.shape[:2])
    pose = true, found, covariance
    return Draw(own - own[0], own[0], turns, tags, marks, plane, view, seen[:, 2:], pose)


def in_frame(x: Array, pose: BodyPose) -> Array:
    """Places (...,2) mm of the body in the axes of the frame."""
    c, s = np.cos(pose.turn), np.sin(pose.turn)
    return np.asarray(x @ np.array([[c, s], [-s, c]]) + [pose.x_mm, pose.z_mm])


def in_body(x: Array, pose: BodyPose, *, moved: bool) -> Array:
    """Places (moved) or displacements (...,2) mm of the frame in the axes of the finger."""
    c, s = np.cos(pose.turn), np.sin(pose.turn)
    return (x - moved * np.array([pose.x_mm, pose.z_mm])) @ np.array([[c, -s], [s, c]])


def fitted(d: Draw, pose: BodyPose, errors: Array, *, stated: bool) -> tuple[Array, Array]:
    """Curvature less 1 and change of it, and their covariance, by generalised least squares."""
    value, place = in_body(d.value, pose, moved=False), in_body(d.place, pose, moved=True)
    marks = [Mark(m.name, m.kind, (float(x), Y, float(z)), "finger", measured=not stated)
             for m, (x, z) in zip(d.marks, NODES if stated else place, strict=True)]  # fmt: skip
    points = NODES if stated else place
    full = with_y(value)
    full[..., 1] = 0.0
    slope = sharederrors.slopes(full, marks, d.turns)
    measured = measured_alone(slope, marks)
    at_rest = np.array([0])
    modes: list[Named] = [
        sharederrors.scale(full, RIG.scale, sharederrors.of_places(measured, place)),
        sharederrors.placement(full, marks, d.turns, RIG.placement_mm),
        sharederrors.node(full, marks, slope, RIG.node_mm, RIG.place_mm),
        sharederrors.pose(full, place, measured, [tuple(row) for row in errors]),
        sharederrors.frame(misplaced(d.plane, d.seen), at_rest, measured, RIG.frame_mm),
        height_modes(full, place, measured, marks, d.view, sd_mm=RIG.height_mm),
    ]
    fields = np.array([f for named in modes for f in named.values()])[:, 1:, :, ::2]
    columns = fields.reshape(len(fields), -1)
    of_frame = np.trace(place_noise(d.plane, d.seen)[1:], axis1=2, axis2=3) / 2
    noise = NOISE_PX**2 * (1 / PX**2 + of_frame)
    covariance = np.diag(np.repeat(noise.ravel(), 2)) + columns.T @ columns

    return estimated(value[1:].ravel(), covariance, points)


def estimated(value: Array, covariance: Array, points: Array, bend: Array = BEND) -> tuple[Array, Array]:
    """Curvature less 1, its change, and their covariance, from the displacements at all bends but 0."""

    def moved(c: float, e: float) -> Array:
        u = bent(points, c, e, bend)
        return np.asarray((u - u[0])[bend > 0].ravel())

    base = moved(1.0, 0.0)
    J = np.stack([(moved(1.001, 0.0) - base) / 1e-3, (moved(1.0, 1e-3) - base) / 1e-3], axis=1)
    weighted = np.linalg.solve(covariance, J)
    spread = np.asarray(np.linalg.inv(J.T @ weighted), float)
    return spread @ weighted.T @ (value - base), spread


def pulls(
    error: Array, place: Array, plane: Plane, seen: Array, view: Viewpoint, *, frame_mm: float
) -> Array:
    """Errors (p,2) mm of places (p,2) mm in the frame over their sd, of frame, scale, height and noise."""
    shift = frame_mm * misplaced(plane, seen)[:, 0]
    variance = (shift**2).sum(axis=0) + (RIG.scale * place) ** 2 + (NOISE_PX / PX) ** 2 / REST
    variance += (RIG.height_mm / view.distance * (place - view.foot)) ** 2
    return np.asarray((error / np.sqrt(variance)).ravel())


def run(draws: int, seed: int) -> dict[str, float]:
    """The figures, from so many draws."""
    rng = np.random.default_rng(seed)
    places, poses, inside, ratios, wrong = [], [], [], [], []
    for _ in range(draws):
        d = draw(rng, spread=1.0)
        true, found, covariance = d.pose
        off = np.array([found.x_mm - true.x_mm, found.z_mm - true.z_mm, found.turn - true.turn])
        off_place = d.place - in_frame(d.true, true)
        places.append(pulls(off_place, d.place, d.plane, d.seen, d.view, frame_mm=RIG.frame_mm))
        poses.append(off @ np.linalg.solve(covariance, off) / 3)
        usual = BodyPose(), np.diag([0.3, 0.3, np.deg2rad(0.3)])
        for pose, errors in (usual, (found, principal(covariance))):
            x, spread = fitted(d, pose, errors, stated=False)
            z = x / np.sqrt(np.diag(spread))
            inside.append(np.abs(z) < 1.96)
            wrong.append(abs(z[1]) > 3.0)
        _, typed = fitted(d, BodyPose(), np.zeros((0, 3)), stated=True)
        ratios.append(np.sqrt(typed[1, 1] / spread[1, 1]))
    return {
        "draws": draws,
        "place_pull": round(float(np.sqrt(np.mean(np.square(places)))), 3),
        "pose_pull": round(float(np.sqrt(np.mean(poses))), 3),
        "coverage": round(float(np.mean(inside)), 3),
        "power_ratio": round(float(np.median(ratios)), 2),
        "standoff_wrong": round(float(np.mean(wrong)), 4),
    }


if __name__ == "__main__":
    quick = "400 draws instead of 1000"
    sys.exit(whole(__doc__ or "", lambda short: run(400 if short else 1000, seed=7), quick=quick))
