"""Makes a batch of a small finger as a rig elsewhere would: films, board pictures, log, and its twin.toml.

    python benchmarks/batches/make_batch.py FOLDER [--other] [--moved | --zoomed]

The finger has two or three pleats and the picture 704 x 480 px, so that a whole `twin recalibrate` takes a
minute or two. The truth is solved on a mesh whose cells lie elsewhere than the model's. --other: another
finger (other dimensions; silicone that is softer, stiffens, and creeps with another time). --moved: the
camera stands elsewhere with the same lens. --zoomed: its lens was changed after the board was photographed.
"""

import argparse
import os
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.tracking import studio

import cv2
import numpy as np

from fe import Case, Finger, Lattice, Material
from twin import virtual
from twin.bodies.finger import FingerTable
from twin.gauge.pressuretable import PressureTable
from twin.marktables import FrameTable, PointTable
from twin.project.cameratables import CameraTable, MeasureTable
from twin.project.config import CalibrateTable, Config, DiagnoseTable, ModelTable, ProjectTable
from twin.project.toml import dump
from twin.targets import Array
from vision import Camera, Mark
from vision.boards.charuco import CharucoBoard
from vision.drawing import synthetic
from vision.kinds import CodedMarker

PROTOCOL: virtual.Corners = (
    (0.0, 0.0), (2.0, 0.0), (4.0, 30.0), (9.0, 30.0), (9.4, 0.0), (14.0, 0.0)
)  # fmt: skip
BENCH = virtual.Bench(film_hz=6.0, log_hz=25.0, gauge_sd_MPa=1.5e-4, static_frames=300, placement_sd_mm=0.1)
STATIC_START, FILM_START, LOG_END = 0.5, 52.0, 70.0  # s on the clock of the log
SIZE, DISTANCE, PX_PER_MM, LOOKS_AT = (704, 480), 3000.0, 6.3, (21.0, 11.5, 0.0)
BOARD = CharucoBoard(columns=8, rows=6, square_mm=8.0, marker_mm=6.0)
LENS = -2.0  # k1: 0.3 px in the corners
BLUR_PX, NOISE_GREY, TAG_MM, HALF_TAG = 0.8, 4.0, 6.0, 2.5
# x, z mm on the rig, in a plane Y mm from its middle, clear of the finger's way
FRAME = ((-26, 26), (10, 27), (46, 27), (68, 26), (-26, -24), (20, -27), (68, -24))
FIXED = ((-26, 2), (68, 2), (28, 27), (46, -27), (-5, -27))
Y = 11.5


@dataclass(frozen=True)
class SmallBatch:
    """A finger's dimensions, its true law, and how the camera stands."""

    table: FingerTable
    material: Material
    seed: int = 7
    tilt_deg: tuple[float, float, float] = (0.3, -0.3, 0.6)  # of the camera
    k1: float = LENS  # distortion of the lens while it films; the board is photographed with LENS
    droop_mm: float | None = None  # of the tip at top pressure, bent as a beam; None: the truth is solved
    static_frames: int = BENCH.static_frames

    @property
    def finger(self) -> Finger:
        return self.table.finger

    @property
    def truth(self) -> Case:
        """What is filmed: cells that are not the model's."""
        cells = Lattice(per_bellow=5, wall=1, centred=False)
        return virtual.truth_case(self.finger, cells, material=self.material, element=None)

    @property
    def stations(self) -> dict[str, Array]:
        """Undeformed places (3,) mm of the markers, on the flat lower edge of the side face."""
        ends = {"p1": 0.3, "middle": 0.63, "tip": 1.0}
        x = {name: round(share * self.finger.length, 2) for name, share in ends.items()}
        return {name: np.array([at, self.finger.width / 2, 0.0]) for name, at in x.items()}


CREEPING = Material(0.214, 0.083, prony=((0.075, 1.2), (0.055, 3.5)))
STIFFENING = Material(0.16, 0.05, C20=0.02, prony=((0.06, 2.0),))
FIRST = SmallBatch(FingerTable(length_mm=38.0, pleats=3), CREEPING)
OTHER = SmallBatch(
    FingerTable(length_mm=36.0, pleats=2, width_mm=21.0, height_mm=19.0, top_wall_mm=1.8, bottom_wall_mm=2.2,
                pleat_depth_mm=7.0, side_pleat_depth_mm=2.4),
    STIFFENING, seed=11,
)  # fmt: skip


def moved(batch: SmallBatch) -> SmallBatch:
    """The same test filmed from elsewhere, with the same lens."""
    return replace(batch, tilt_deg=(-0.2, 0.1, -0.8))


def zoomed(batch: SmallBatch) -> SmallBatch:
    """The same test filmed with another lens than the board."""
    return replace(batch, k1=12 * LENS)


# -- what is filmed ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Motion:
    """Along the film: places of all marks (t, p, 3) mm, their turns (t, p) rad, the finger's outline."""

    place: Array
    turn: Array
    outline: Array = field(repr=False)


def marks_of(batch: SmallBatch) -> tuple[Mark, ...]:
    """All tags as twin.toml states them."""
    own = [
        Mark(n, CodedMarker(k, TAG_MM), tuple(map(float, at)), "finger")
        for k, (n, at) in enumerate(batch.stations.items())
    ]
    return (*own, *studio.rig(FRAME, FIXED, size=TAG_MM, y=Y))


def motion(batch: SmallBatch, rng: np.random.Generator) -> Motion:
    """The truth's motion, with tags that are glued a little beside their places."""
    marks, tags = marks_of(batch), np.array(list(batch.stations.values()))
    reach, end = np.array([HALF_TAG, 0.0, 0.0]), (batch.finger.length, np.inf, np.inf)
    face = studio.side_face(batch.truth)
    points = np.concatenate([tags, tags - reach, np.minimum(tags + reach, end), face])
    m, moved = len(tags), points + displacements(batch, points)
    chord = moved[:, 2 * m : 3 * m] - moved[:, m : 2 * m]
    angle = np.arctan2(chord[..., 2], chord[..., 0])
    x, z = BENCH.placement_sd_mm * rng.standard_normal((2, m))
    place = np.tile([mark.position for mark in marks], (len(moved), 1, 1)).astype(float)
    place[:, :m] = moved[:, :m]
    place[:, :m, 0] += np.cos(angle) * x - np.sin(angle) * z
    place[:, :m, 2] += np.sin(angle) * x + np.cos(angle) * z
    turn = np.tile(np.deg2rad(rng.standard_normal(len(marks))), (len(moved), 1))
    turn[:, :m] += angle
    return Motion(place, turn, moved[:, 3 * m :])


def displacements(batch: SmallBatch, points: Array) -> Array:
    """Where the points (p, 3) mm go, (t, p, 3) mm: by the finite elements of the truth, or as a beam of
    constant curvature, which takes no time to solve."""
    course = virtual.path(BENCH, protocol=PROTOCOL)
    if batch.droop_mm is None:
        return virtual.displaced(batch.truth, course, points)[0]
    pressure = np.interp(course.output, course.time, course.pressure)[:, None]
    x, z = points[:, 0], points[:, 2]
    turn = 2.0 * batch.droop_mm / batch.finger.length**2 * pressure / pressure.max() * x
    along = x * np.sinc(turn / np.pi) + z * np.sin(turn)
    up = z * np.cos(turn) - 0.5 * x * turn * np.sinc(0.5 * turn / np.pi) ** 2
    return np.stack([along - x, 0.0 * turn, up - z], axis=-1)


def camera(batch: SmallBatch) -> tuple[Camera, tuple[Array, Array]]:
    """The camera and its pose (rvec, tvec): it looks along -y, z up, a little askew."""
    return lens(batch.k1), studio.before(LOOKS_AT, DISTANCE, batch.tilt_deg)


def lens(k1: float) -> Camera:
    """A long lens with this distortion."""
    focal = DISTANCE * PX_PER_MM
    matrix = np.array([[focal, 0, SIZE[0] / 2 + 3], [0, focal, SIZE[1] / 2 - 4], [0, 0, 1.0]])
    return Camera(matrix, np.array([k1, 0.0, 0.0, 0.0, 0.0]), SIZE)


# -- files ---------------------------------------------------------------------------------------------------


def write_films(raw: Path, batch: SmallBatch) -> None:
    """film.mp4 of the test and static.mp4 of the finger at rest."""
    (eye, pose), marks = camera(batch), marks_of(batch)
    filmed = motion(batch, np.random.default_rng([batch.seed, 1]))
    still = np.zeros(batch.static_frames, np.int64)
    for name, frames, seed in (("film", np.arange(len(filmed.place)), 1), ("static", still, 2)):
        synthetic.film(
            raw / f"{name}.mp4", camera=eye, pose=pose, marks=marks, positions=filmed.place[frames],
            rotations=filmed.turn[frames], outline=filmed.outline[frames], fps=BENCH.film_hz, blur_px=BLUR_PX,
            noise_grey=NOISE_GREY, seed=100 * batch.seed + seed,
        )  # fmt: skip


def write_log(path: Path, batch: SmallBatch) -> None:
    """The pressure log over both films, with the noise of the gauge."""
    rng, time = np.random.default_rng([batch.seed, 2]), np.arange(0.0, LOG_END, 1 / BENCH.log_hz)
    course = virtual.path(BENCH, protocol=PROTOCOL)
    true = np.interp(time - FILM_START, course.time, course.pressure, left=0.0, right=0.0)
    read = true + BENCH.gauge_sd_MPa * rng.standard_normal(len(time))
    studio.write_log(path, time, read)


def write_boards(folder: Path) -> None:
    """Pictures of the board, tilted to every side, all over the picture."""
    folder.mkdir(parents=True, exist_ok=True)
    eye = lens(LENS)
    for k, pose in enumerate(studio.board_poses(BOARD, DISTANCE, (20.0, 10.0), np.random.default_rng(3))):
        grey = synthetic.board_image(eye, BOARD, pose, blur_px=BLUR_PX, noise_grey=NOISE_GREY, seed=500 + k)
        cv2.imwrite(str(folder / f"board{k + 1:02d}.png"), grey)


def config(name: str, batch: SmallBatch) -> Config:
    """The twin.toml that a user who made this test would write: positions in mm, no node."""
    side = CameraTable(
        name="side", film="raw/film.mp4", static="raw/static.mp4", boards="raw/boards/*.png",
        film_start_s=FILM_START, static_start_s=STATIC_START,
        board=studio.board_table(BOARD),
    )  # fmt: skip
    return Config(
        project=ProjectTable(name=name), model=ModelTable(finger=batch.table, wall_sd_mm=0.0),
        cameras=(side,), pressure=PressureTable(), points=points_of(batch),
        frame=FrameTable(markers=studio.still_tables(marks_of(batch))),
        measure=MeasureTable(placement_sd_mm=BENCH.placement_sd_mm, scale_sd=BENCH.scale_sd),
        calibrate=CalibrateTable(population=8, generations=4),
        diagnose=DiagnoseTable(candidates=("creep", "camera_scale")),
    )  # fmt: skip


def points_of(batch: SmallBatch) -> tuple[PointTable, ...]:
    """The table [[points]] of twin.toml."""
    return tuple(
        PointTable(name=m.name, position_mm=m.position, marker=m.kind.code, size_mm=m.size_mm)
        for m in marks_of(batch) if m.role == "finger"
    )  # fmt: skip


def write_raw(raw: Path, batch: SmallBatch) -> None:
    """Films and log, as a user drops them into raw/."""
    raw.mkdir(parents=True, exist_ok=True)
    write_films(raw, batch)
    write_log(raw / "pressure.csv", batch)


def write(folder: Path, batch: SmallBatch) -> None:
    """Write films, boards, log and twin.toml of a batch."""
    write_raw(folder / "raw", batch)
    write_boards(folder / "raw" / "boards")
    (folder / "twin.toml").write_text(dump(config(folder.resolve().name, batch)), encoding="utf-8")


def main() -> int:
    """Write a whole project folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--other", action="store_true", help="the other finger")
    stands = parser.add_mutually_exclusive_group()
    stands.add_argument("--moved", action="store_true", help="the camera stands elsewhere")
    stands.add_argument("--zoomed", action="store_true", help="its lens was changed")
    told = parser.parse_args()
    batch = OTHER if told.other else FIRST
    batch = moved(batch) if told.moved else zoomed(batch) if told.zoomed else batch
    write(told.folder, batch)
    return 0


if __name__ == "__main__":
    sys.exit(main())
