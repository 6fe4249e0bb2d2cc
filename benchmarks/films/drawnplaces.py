"""Places of markers in drawn films, the frame typed, printed or measured in photographs, side by side.

    python benchmarks/films/drawnplaces.py [--quick] [--json]

Each film shows a finger that bends to arcs, up to 0.5 mm and 0.5 degrees off the frame, with tags up to 1 mm
off their nodes and 0 to 0.4 mm thick. Film, static film and photographs of rig and board are drawn, and
measured by the code of `twin measure` and `twin setup`; curvature and its change along the finger are fitted.

typed: markers of the frame and nodes of the tags as twin.toml states them, with the defaults of `[measure]`.
sheet: a printed frame, the tags' places from the film. bundle: a frame of loose markers, measured in eight
photographs; the tags' places from the film. The finger's pose is the default of `[pose]`. Five films are made
before each rig.

place_pull: error of the tags' places over what is stated of them. coverage: of the 95 % intervals of both
numbers. pull: rms of their errors over sds. power: sd of the change with typed places over that of this way.
"""

import os
import sys

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.commandline import whole
from benchmarks.films.places import FRAME, NODES, RIG, Y, bent, estimated, in_frame, pulls

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.inputs.foundrecordings import Tags
from twin.inputs.looseframe import measured, moved
from twin.project.cameratables import BoardTable
from vision import Board, Camera, Displacements, Mark, Video, View
from vision.drawing import synthetic
from vision.kinds import CodedMarker
from vision.measuring.displacements import displacements_of
from vision.perspective import viewpoint
from vision.placing.restplaces import BodyPose, at_rest
from vision.placing.views import How, look
from vision.plane import plane_of, to_plane

Array = NDArray[np.float64]
FIXED = np.array([(5, 33), (85, 33), (-32, -20), (122, -20)], float)
REST, FPS, STATIC, FAR = 15, 10.0, 120, 420.0  # frames, 1/s, frames, mm
SIDE = {"frame": 9.0, "fixed": 9.0, "finger": 6.5}  # mm, of the markers
MIDDLE = np.array([45.0, Y, -22.0])  # mm, where the camera looks
BEND = np.concatenate([np.zeros(REST), np.linspace(0.001, 0.013, 11)])  # 1/mm
BOARD = BoardTable(columns=8, rows=6, square_mm=12.0, marker_mm=9.0)
FACING = np.array([[-1.0, 0, 0], [0, 0, -1.0], [0, -1.0, 0]])  # along -y, z up
FILM = Camera(np.array([[1500.0, 0, 323.0], [0, 1501.0, 237.0], [0, 0, 1]]), np.zeros(5), (640, 480))
PHOTO = Camera(np.array([[1400.0, 0, 322.0], [0, 1400.0, 238.0], [0, 0, 1]]), np.zeros(5), (640, 480))
POSE = tuple(map(tuple, np.diag([0.3, 0.3, np.deg2rad(0.3)]).tolist()))  # the default of [pose]


def marks_of(rig: Array, tags: Array, *, are_measured: bool) -> list[Mark]:
    """Six frame marks and four fixed ones at places (10,2) mm, and the finger's at (n,2) mm."""
    roles = ["frame"] * len(FRAME) + ["fixed"] * len(FIXED) + ["finger"] * len(tags)
    return [
        Mark(f"{role}{k}", CodedMarker(30 + k, SIDE[role]), (float(x), Y, float(z)), role,
             measured=are_measured and role == "finger")
        for k, (role, (x, z)) in enumerate(zip(roles, np.concatenate([rig, tags]), strict=True))
    ]  # fmt: skip


def film(folder: Path, rig: Array, rng: np.random.Generator) -> tuple[View, Array]:
    """The film and the static film of a rig (10,2) mm, and the tags' true places (n,2) mm at rest."""
    tags, off = NODES + rng.uniform(-1, 1, NODES.shape), rng.uniform(-0.5, 0.5, 3)
    stands = BodyPose(off[0], off[1], np.deg2rad(off[2]))
    glued = rng.normal(0, RIG.place_mm, tags.shape)
    body = in_frame(bent(tags + glued, 1.0, 0.0, bend=BEND) - glued, stands)
    place = np.insert(np.concatenate([np.tile(rig, (len(BEND), 1, 1)), body], axis=1), 1, Y, axis=2)
    place[:, len(rig) :, 1] += rng.uniform(0.0, 0.4, len(tags))
    turns = np.tile(np.deg2rad(rng.normal(0, 1, place.shape[1])), (len(BEND), 1))
    turns[:, len(rig) :] += stands.turn - BEND[:, None] * (tags + glued)[:, 0]
    tilt = cv2.Rodrigues(np.deg2rad(rng.normal(0, 3, 3)))[0] @ FACING
    pose = cv2.Rodrigues(tilt)[0].ravel(), np.array([0, 0, FAR]) - tilt @ MIDDLE
    seed = int(rng.integers(1 << 30))
    for name, frames in (("film.mkv", np.arange(len(BEND))), ("static.mkv", np.zeros(STATIC, int))):
        synthetic.film(
            folder / name, camera=FILM, pose=pose, marks=marks_of(rig, tags, are_measured=False),
            positions=place[frames], rotations=turns[frames], fps=FPS, seed=seed + len(frames),
            codec="rawvideo",
        )  # fmt: skip
    return View(Video(folder / "film.mkv"), Video(folder / "static.mkv"), FILM), body[0]


def photographed(
    folder: Path, rig: Array, seen: Displacements, rng: np.random.Generator
) -> tuple[Array, float]:
    """Places (10,2) mm that eight photographs of rig and board tell, and their sd: up to a shift and a turn,
    which are those of the truth, as nothing else says where x = 0 is."""
    true, wrong = Board.of(**BOARD.model_dump()), 1 + rng.normal(0, RIG.scale)
    stated = BOARD.model_copy(update={"square_mm": 12.0 * wrong, "marker_mm": 9.0 * wrong})
    marks, paths = marks_of(rig, NODES[:0], are_measured=False), []
    middle = np.array([true.columns, true.rows, 0.0]) * true.square_mm / 2
    for k in range(8):
        lean = np.deg2rad(rng.uniform(20, 40)) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0.0])
        turn = cv2.Rodrigues(lean)[0] @ cv2.Rodrigues(np.array([0, 0, rng.uniform(-0.4, 0.4)]))[0]
        at = np.array([*rng.uniform(-12, 12, 2), rng.uniform(540, 600)])
        world, seed = turn @ FACING, int(rng.integers(1 << 30))
        grey = synthetic.board_image(
            PHOTO, true, (cv2.Rodrigues(turn)[0].ravel(), at - turn @ middle), marks=marks, seed=seed,
            marks_pose=(cv2.Rodrigues(world)[0].ravel(), at - world @ MIDDLE),
        )  # fmt: skip
        paths.append(folder / f"rig{k}.png")
        cv2.imwrite(str(paths[-1]), grey)
    quads = np.repeat(seen.tracks.position[:, :, None], 4, axis=2)
    tags = Tags(folder / "film.mkv", tuple(30 + np.arange(quads.shape[1])), seen.time, quads, len(quads))
    found = measured(paths, stated, tags, "DICT_4X4_50")
    rows = [code - 30 for code in found.codes]
    flat = found.place[:, :2] * [-1.0, 1.0]  # x runs to the left of the picture
    return moved(flat, flat, rig[rows])[np.argsort(rows)], found.sd


def judged(seen: Displacements, rig: Array, frame_mm: float, true: Array) -> tuple[Array, Array, Array]:
    """Pulls of the tags' places, and both numbers with their covariance."""
    finger = [p for p, role in enumerate(seen.roles) if role == "finger"]
    place, moves = seen.points[finger][:, [0, 2]], np.arange(REST, len(BEND))
    fields = seen.modes[:, moves][:, :, finger][..., [0, 2]].reshape(len(seen.modes), -1)
    own = seen.covariance[moves][:, finger][..., [0, 2], [0, 2]].ravel()
    value = seen.value[moves][:, finger][..., [0, 2]].ravel()
    x, spread = estimated(value, np.diag(own) + fields.T @ fields, place, bend=BEND)
    if not seen.measured[finger[0]]:
        return ((place - true) / np.hypot(RIG.placement_mm, RIG.node_mm)).ravel(), x, spread
    ideal = seen.tracks.position[:REST]
    plane = plane_of(rig[: len(FRAME)], ideal[:, : len(FRAME)])
    on_plane = to_plane(plane.homography, ideal[:, len(FRAME) + len(FIXED) :])
    view = viewpoint(FILM, plane.homography)
    return pulls(place - true, place, plane, on_plane, view, frame_mm=frame_mm), x, spread


Found = dict[str, tuple[Array, Array, Array]]  # of each way, as `judged` tells it


def of_rig(folder: Path, films: int, rng: np.random.Generator) -> Iterator[Found]:
    """What the three ways make of each film before one rig, which is measured once."""
    rig = np.concatenate([FRAME, FIXED]) + rng.normal(0, 1.0, (len(FRAME) + len(FIXED), 2))

    def off() -> tuple[Array, float]:
        return (rig + rng.normal(0, RIG.frame_mm, rig.shape)) * (1 + rng.normal(0, RIG.scale)), RIG.frame_mm

    frames = {"typed": off(), "sheet": off()}
    for _ in range(films):
        view, true = film(folder, rig, rng)
        marks = marks_of(frames["typed"][0], NODES, are_measured=False)
        followed = look(view, marks, How("DICT_4X4_50", (REST - 1) / FPS))
        if "bundle" not in frames:
            first = displacements_of([followed], marks, stated=RIG)
            frames["bundle"] = photographed(folder, rig, first, rng)
        found = {}
        for way, (places, sd) in frames.items():
            free = way != "typed"
            marks, _ = at_rest(followed, marks_of(places, NODES, are_measured=free), sd)
            stated = replace(RIG, frame_mm=sd, pose=POSE if free else ())
            found[way] = judged(displacements_of([followed], marks, stated=stated), places, sd, true)
        yield found


def run(rigs: int, films: int, seed: int) -> dict[str, float]:
    """The figures of all three ways, of so many films before each rig; as it goes, those so far."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(rigs):
        with TemporaryDirectory() as folder:
            for one in of_rig(Path(folder), films, rng):
                found.append(one)
                print(figures_of(found), flush=True)
    return figures_of(found)


def figures_of(found: Sequence[Found]) -> dict[str, float]:
    """The figures of films."""
    figures: dict[str, float] = {"films": len(found)}
    for way in found[0]:
        place, x, spread = (np.array(part) for part in zip(*(one[way] for one in found), strict=True))
        sd = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
        figures |= {
            f"{way}_place_pull": float(np.sqrt(np.mean(place**2))),
            f"{way}_pull": float(np.sqrt(np.mean((x / sd) ** 2))),
            f"{way}_coverage": float(np.mean(np.abs(x / sd) < 1.96)),
            f"{way}_power": float(np.median([one["typed"][2][1, 1] ** 0.5 for one in found] / sd[:, 1])),
        }
    return {name: round(value, 3) for name, value in figures.items()}


if __name__ == "__main__":
    quick = "2 films before one rig instead of 5 before each of 8"
    sys.exit(whole(__doc__ or "", lambda short: run(*((1, 2) if short else (8, 5)), seed=5), quick=quick))
