"""A finger's true motion -> the folder of a drawn test: film, static film, board pictures, pressure log,
twin.toml.

`make_demo.py` and `make_quick.py` say what is filmed. Film, log, tags and their errors are drawn with one
seed, so that a second run writes the same data.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.tracking import studio

import cv2
import numpy as np

from fe import Case
from fe import Path as Course
from twin import virtual
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

TWIST_DEG = 1.2  # how crooked tags are glued, 1 sd
BOARD_JPEG = 93


@dataclass(frozen=True, kw_only=True)
class Look:
    """A camera that looks along -y, z up, a little askew, through a long lens: the side face bulges by 0.2 mm
    towards it, which from 1 m looks like 10 um of motion."""

    size: tuple[int, int]
    middle: tuple[float, float]  # px, of the lens
    px_per_mm: float
    looks_at: tuple[float, float, float]  # mm
    distance: float = 3000.0  # mm
    tilt_deg: tuple[float, float, float] = (0.3, -0.3, 0.6)
    distortion: tuple[float, ...] = (-0.9, 0.0, 0.0015, -0.001, 0.0)
    blur_px: float = 0.8
    noise_grey: float = 0.7

    def camera(self) -> tuple[Camera, tuple[Array, Array]]:
        """The camera and its pose (rvec, tvec)."""
        focal = self.distance * self.px_per_mm
        matrix = np.array([[focal, 0, self.middle[0]], [0, focal, self.middle[1]], [0, 0, 1]])
        lens = Camera(matrix, np.array(self.distortion), self.size)
        return lens, studio.before(self.looks_at, self.distance, self.tilt_deg)


@dataclass(frozen=True, kw_only=True)
class Rig:
    """What is glued and held where: x, z mm of the tags on the wall and of the block that holds the finger,
    all in one plane."""

    frame: studio.Spots
    fixed: studio.Spots
    clamp: studio.Spots
    y: float  # mm, of that plane
    tag_mm: float = 5.5  # side of the black square
    half_tag: float = 2.5  # mm, reach of the glue

    def marks_of(self, finger: Mapping[str, Array]) -> tuple[Mark, ...]:
        """All tags as twin.toml states them: finger, frame, fixed; places in world mm."""
        own = [
            Mark(n, CodedMarker(k, self.tag_mm), tuple(p), "finger")
            for k, (n, p) in enumerate(finger.items())
        ]
        return (*own, *studio.rig(self.frame, self.fixed, size=self.tag_mm, y=self.y))


@dataclass(frozen=True, kw_only=True)
class Boards:
    """The board, how far from the picture's middle its middle is held (x, y mm), and in how many pictures."""

    board: CharucoBoard
    reach: tuple[float, float]
    count: int = 14


@dataclass(frozen=True, kw_only=True)
class Clock:
    """The log's clock: when the static film starts, the film starts and the log ends, in s."""

    static_start: float
    film_start: float
    log_end: float


@dataclass(frozen=True)
class Drawn:
    """What chance has put into the film: all that a measurement cannot know."""

    offset: Array  # (m, 2) mm, each finger tag's centre from its node in x and z
    twist: Array  # (p,) rad, how crooked each tag was glued
    scale_error: float  # the fixed tags are really so much further apart than twin.toml says


@dataclass(frozen=True)
class Motion:
    """The truth along the film: displacement and turn of each marked place, and the outline of the finger."""

    u: Array  # (t, m, 3) mm
    slope: Array  # (t, m, 3) mm per MPa
    turn: Array  # (t, m) rad, from x towards z
    outline: Array  # (t, k, 3) mm, with the clamp


Displaced = Callable[[Array], tuple[Array, Array]]  # points (p, 3) mm -> U (t, p, 3) mm, dU/dp in mm per MPa


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A test that is drawn: who looks, at what, on which bench, and the seed of all its noise."""

    seed: int
    bench: virtual.Bench
    course: Course  # the true pressure, with the frames as output times
    places: Mapping[str, Array]  # undeformed (3,) mm of the finger's tags
    look: Look
    rig: Rig
    boards: Boards
    clock: Clock

    @property
    def marks(self) -> tuple[Mark, ...]:
        """All tags as twin.toml states them: finger, frame, fixed; places in world mm."""
        return self.rig.marks_of(self.places)

    def drawn(self, rng: np.random.Generator) -> Drawn:
        """The errors of placement and scale, with the sds that the bench and twin.toml state."""
        offset = self.bench.placement_sd_mm * rng.standard_normal((len(self.places), 2))
        twist = np.deg2rad(TWIST_DEG) * rng.standard_normal(len(self.marks))
        return Drawn(offset, twist, self.bench.scale_sd * float(rng.standard_normal()))

    def motion(self, truth: Case, displaced: Displaced) -> Motion:
        """The motion of a truth; a tag turns as the edge under it does."""
        marked, face = np.array(list(self.places.values())), studio.side_face(truth)
        reach = np.array([self.rig.half_tag, 0.0, 0.0])
        ends = marked - reach, np.minimum(marked + reach, (truth.nodes[:, 0].max(), np.inf, np.inf))
        points = np.concatenate([marked, *ends, face])
        u, slope = displaced(points)
        m = len(marked)
        chord = (points + u)[:, 2 * m : 3 * m] - (points + u)[:, m : 2 * m]
        clamp = np.array([(x, self.rig.y, z) for x, z in self.rig.clamp])
        outline = np.concatenate([face + u[:, 3 * m :], np.tile(clamp, (len(u), 1, 1))], axis=1)
        return Motion(u[:, :m], slope[:, :m], np.arctan2(chord[..., 2], chord[..., 0]), outline)

    def placed(self, chance: Drawn, moved: Motion) -> tuple[Array, Array]:
        """Where every tag really is in each frame (t, p, 3) mm, and its turn (t, p) rad."""
        place = np.tile([mark.position for mark in self.marks], (len(moved.u), 1, 1)).astype(np.float64)
        place[..., (0, 2)] *= 1.0 + chance.scale_error
        turn = np.tile(chance.twist, (len(moved.u), 1))
        m, (x, z) = len(self.places), chance.offset.T
        c, s = np.cos(moved.turn), np.sin(moved.turn)
        place[:, :m] = np.array(list(self.places.values())) + moved.u
        place[:, :m, 0] += c * x - s * z
        place[:, :m, 2] += s * x + c * z
        turn[:, :m] += moved.turn
        return place, turn

    # -- files -----------------------------------------------------------------------------------------------

    def write(self, folder: Path, config: Config, moved: Motion) -> Drawn:
        """Writes the data set into a folder; says what chance has put into it."""
        rng = np.random.default_rng(self.seed)
        chance, raw = self.drawn(rng), folder / "raw"
        raw.mkdir(parents=True, exist_ok=True)
        (folder / "twin.toml").write_text(dump(config), encoding="utf-8")
        self.write_log(raw / "pressure.csv", rng)
        self.write_boards(raw / "boards", rng)
        self.write_films(raw, chance, moved)
        return chance

    def write_boards(self, folder: Path, rng: np.random.Generator) -> None:
        """The board's pictures, as JPEG files."""
        folder.mkdir(parents=True, exist_ok=True)
        lens, _ = self.look.camera()
        poses = studio.board_poses(self.boards.board, self.look.distance, self.boards.reach, rng)
        for k, pose in enumerate(poses[: self.boards.count]):
            grey = synthetic.board_image(
                lens, self.boards.board, pose, blur_px=self.look.blur_px, noise_grey=self.look.noise_grey,
                seed=self.seed + 100 + k,
            )  # fmt: skip
            cv2.imwrite(str(folder / f"board{k + 1:02d}.jpg"), grey, [cv2.IMWRITE_JPEG_QUALITY, BOARD_JPEG])

    def write_log(self, path: Path, rng: np.random.Generator) -> None:
        """The pressure log over both films: nothing while the finger rests, the protocol, white gauge
        noise."""
        time = np.arange(0.0, self.clock.log_end, 1 / self.bench.log_hz)
        since = time - self.clock.film_start
        true = np.interp(since, self.course.time, self.course.pressure, left=0.0, right=0.0)
        read = true + self.bench.gauge_sd_MPa * rng.standard_normal(len(time))
        studio.write_log(path, time, read)

    def write_films(self, raw: Path, chance: Drawn, moved: Motion) -> None:
        """The film of the test and the static film of the finger at rest."""
        lens, pose = self.look.camera()
        place, turn = self.placed(chance, moved)
        still = np.zeros(self.bench.static_frames, np.int64)
        films = ("film.mp4", np.arange(len(place)), self.seed), ("static.mp4", still, self.seed + 1)
        for name, frames, seed in films:
            synthetic.film(
                raw / name, camera=lens, pose=pose, marks=self.marks, positions=place[frames],
                rotations=turn[frames], outline=moved.outline[frames], fps=self.bench.film_hz,
                blur_px=self.look.blur_px, noise_grey=self.look.noise_grey, seed=seed,
            )  # fmt: skip

    def config(
        self, name: str, model: ModelTable, points: Sequence[PointTable], *, reference_s: float | None = None
    ) -> Config:
        """The twin.toml that a user who made this test would write."""
        side = CameraTable(
            name="side", film="raw/film.mp4", static="raw/static.mp4", boards="raw/boards/*.jpg",
            film_start_s=self.clock.film_start, static_start_s=self.clock.static_start,
            board=studio.board_table(self.boards.board),
        )  # fmt: skip
        rest = {} if reference_s is None else {"reference_s": reference_s}
        measure = MeasureTable(
            placement_sd_mm=self.bench.placement_sd_mm, scale_sd=self.bench.scale_sd, **rest
        )
        return Config(
            project=ProjectTable(name=name), model=model, cameras=(side,), pressure=PressureTable(),
            measure=measure, frame=FrameTable(markers=studio.still_tables(self.marks)), points=tuple(points),
            calibrate=CalibrateTable(), diagnose=DiagnoseTable(),
        )  # fmt: skip


def course_lines(corners: virtual.Corners, bench: virtual.Bench) -> list[str]:
    """Lines of TOML on the true pressure, and how far the log is off."""
    every = ", ".join(f"[{t}, {round(p * 1e-3, 6)}]" for t, p in corners)
    return [
        f"corners = [{every}]  # of the true pressure: time, s, and MPa, without the ripple",
        f"ripple_MPa = {bench.ripple_MPa}",
        f"gauge_sd_MPa = {bench.gauge_sd_MPa}",
    ]


def drawn_lines(recording: Recording, chance: Drawn) -> list[str]:
    """Lines of TOML on what chance has put into a film."""
    return [
        f"scale_error = {chance.scale_error:.6f}  # the fixed tags are really further apart by this share",
        f"placement_sd_mm = {recording.bench.placement_sd_mm}",
        "",
        "[offset_mm]  # of each finger tag's centre from its node, x and z",
        *(f"{n} = [{x:.4f}, {z:.4f}]" for n, (x, z) in zip(recording.places, chance.offset, strict=True)),
    ]


def small_enough(folder: Path, limit_MB: float) -> bool:
    """Prints what each part of a data set weighs; says whether all of it is within the limit."""
    weight: dict[str, float] = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = f"boards/{path.suffix}" if path.parent.name == "boards" else path.name
        weight[name] = weight.get(name, 0.0) + path.stat().st_size / 1e6
    total = sum(weight.values())
    print("\n".join(f"  {name:14s} {size:6.2f} MB" for name, size in weight.items()))
    print(f"  {'in all':14s} {total:6.2f} MB (limit {limit_MB:g})")
    return total <= limit_MB
