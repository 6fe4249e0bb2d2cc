"""How a mistake is planted in the small drawn project of `studio`: twin.toml, a film, the log, the boards."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from tests.strangers.studio import (
    FRAMES,
    LOG_END,
    MIDDLE,
    RAMP_S,
    RATE,
    SIZE,
    STILL,
    Y,
    camera,
    config_of,
    draw,
    film_time,
    log_text,
    marks_of,
    motion,
)
from twin import files
from twin.gauge.pressuretable import PressureTable
from twin.marktables import FrameTable, MarkerTable, PointTable
from twin.project.config import Config
from twin.project.toml import dump
from twin.targets import Array
from vision import Mark, Video
from vision.film.video import Writer

Plant = Callable[[Path], None]


def toml(change: Callable[[Config], Config]) -> Plant:
    """Another twin.toml."""
    return lambda root: files.write_text(root / "twin.toml", dump(change(config_of())))


def every(
    *,
    rig: bool = True,
    finger: bool = True,
    place: Callable[[tuple[float, float, float]], Sequence[float]] | None = None,
    size: float = 1.0,
) -> Plant:
    """Positions of all marks as `place` has them, and all sizes times a factor."""

    def changed(table: MarkerTable | PointTable) -> MarkerTable | PointTable:
        own = tuple(place(table.position_mm)) if place else table.position_mm
        return table.model_copy(update={"position_mm": own, "size_mm": table.size_mm * size})

    def change(c: Config) -> Config:
        markers = tuple(changed(m) for m in c.frame.markers) if rig else c.frame.markers
        points = tuple(changed(p) for p in c.points) if finger else c.points
        return c.model_copy(update={"frame": FrameTable(markers=markers), "points": points})

    return toml(change)


def marker(name: str, **update: object) -> Callable[[Config], Config]:
    """Other values for one mark."""

    def change(c: Config) -> Config:
        rows = [m.model_copy(update=update) if m.name == name else m for m in c.frame.markers]
        points = [p.model_copy(update=update) if p.name == name else p for p in c.points]
        return c.model_copy(update={"frame": FrameTable(markers=tuple(rows)), "points": tuple(points)})

    return change


def exchanged(a: str, b: str) -> Plant:
    """The ids of two marks exchanged."""
    ids = {m.name: m.kind.code for m in marks_of()}
    return toml(lambda c: marker(a, marker=ids[b])(marker(b, marker=ids[a])(c)))


def camera_with(**update: object) -> Plant:
    return toml(lambda c: c.model_copy(update={"cameras": (c.cameras[0].model_copy(update=update),)}))


def log(**how: object) -> Plant:
    return lambda root: files.write_text(root / "raw" / "pressure.csv", log_text(**how))


def regulated(top_kPa: float, **how: object) -> Plant:
    """A regulator's pressure stated, and a log of other numbers."""

    def plant(root: Path) -> None:
        log(**how)(root)
        toml(lambda c: c.model_copy(update={"pressure": PressureTable(top_kPa=top_kPa)}))(root)

    return plant


def filmed(
    place: Callable[[list[Mark], Array], Array],
    *,
    name: str = "film.mkv",
    frames: int = FRAMES,
    **how: object,
) -> Plant:
    """A film of other places."""
    return lambda root: draw(root / "raw" / name, place(marks_of(), np.arange(frames) / RATE), **how)


def painted(paint: Callable[[int, Array], Array], *names: str) -> Plant:
    """Films with every picture changed."""

    def plant(root: Path) -> None:
        for name in names or ("film.mkv", "static.mkv"):
            old = root / "raw" / name
            with Writer(root / "raw" / f"new-{name}", SIZE, fps=RATE, codec="ffv1", crf=0) as writer:
                for index, _, grey in Video(old).frames():
                    changed = paint(index, grey.astype(np.float64))
                    writer.add(np.clip(np.rint(changed), 0, 255).astype(np.uint8))
            (root / "raw" / f"new-{name}").replace(old)

    return plant


def pixels(mark: str) -> tuple[int, int]:
    """Where a mark is at rest."""
    lens, (rvec, tvec) = camera()
    place = next(m.position for m in marks_of() if m.name == mark)
    seen = cv2.projectPoints(np.array([place]), rvec, tvec, lens.matrix, lens.distortion)[0].ravel()
    return round(float(seen[0])), round(float(seen[1]))


def hidden(*names: str, since: int = 0) -> Callable[[int, Array], Array]:
    """Grey over some marks, wide enough for their motion."""
    spots = [pixels(name) for name in names]

    def paint(index: int, grey: Array) -> Array:
        for x, y in spots if index >= since else ():
            grey[max(y - 30, 0) : y + 100, max(x - 30, 0) : x + 40] = 120.0
        return grey

    return paint


def twice(index: int, grey: Array) -> Array:
    """The tip's marker once more."""
    x, y = pixels("tip")
    grey[300:350, 300:350] = grey[y - 25 : y + 25, x - 25 : x + 25]
    return grey


def printed_twice(root: Path) -> None:
    """A second print of the tip's marker, loose in the picture for the whole test."""
    x, y = pixels("tip")
    first = next(iter(Video(root / "raw" / "film.mkv").frames()))[2].astype(np.float64)

    def paint(index: int, grey: Array) -> Array:
        grey[300:350, 300:350] = first[y - 25 : y + 25, x - 25 : x + 25]
        return grey

    painted(paint, "film.mkv")(root)


def ids(off: int) -> Plant:
    """All ids of twin.toml off by one number."""

    def change(c: Config) -> Config:
        rows = [m.model_copy(update={"marker": m.marker + off}) for m in c.frame.markers]
        points = [p.model_copy(update={"marker": p.marker + off}) for p in c.points]
        return c.model_copy(update={"frame": FrameTable(markers=tuple(rows)), "points": tuple(points)})

    return toml(change)


def interlaced(root: Path) -> None:
    """A film whose odd rows are half a frame later than its even ones."""
    draw(root / "raw" / "fields.mkv", motion(marks_of(), np.arange(2 * FRAMES) / (2 * RATE)))
    pictures = [grey for _, _, grey in Video(root / "raw" / "fields.mkv").frames()]
    with Writer(root / "raw" / "film.mkv", SIZE, fps=RATE, codec="ffv1", crf=0) as writer:
        for first, second in zip(pictures[::2], pictures[1::2], strict=True):
            first[1::2] = second[1::2]
            writer.add(first)


def on_its_side(root: Path) -> None:
    """Both films turned by a quarter, the boards not."""
    for name in ("film.mkv", "static.mkv"):
        with Writer(root / "raw" / "side.mkv", SIZE[::-1], fps=RATE, codec="ffv1", crf=0) as writer:
            for _, _, grey in Video(root / "raw" / name).frames():
                writer.add(np.ascontiguousarray(np.rot90(grey)))
        (root / "raw" / "side.mkv").replace(root / "raw" / name)


def early(marks: list[Mark], time: Array) -> Array:
    return motion(marks, time + 1.2)  # the film begins 0.8 s before the pressure rises


def swinging(marks: list[Mark], time: Array) -> Array:
    """A static film in which the finger recovers by 3 mm."""
    return motion(marks, RAMP_S[0] + 0.18 * np.exp(-time / 4.0))


def creeping(mm: float) -> Callable[[list[Mark], Array], Array]:
    """The film, or rest, with a drift of the tip by so much in 1.8 s."""

    def place(marks: list[Mark], time: Array) -> Array:
        out = motion(marks, time)
        out[:, -1, 2] += mm * np.clip(time, 0, 1.8) / 1.8
        return out

    return place


def bad_log(text: str) -> Plant:
    return lambda root: files.write_text(root / "raw" / "pressure.csv", text)


def flat_log() -> str:
    """A log in which nothing happens."""
    noise = np.random.default_rng(6).standard_normal(int(LOG_END * 50))
    return "time_s,pressure_MPa\n" + "".join(
        f"{k / 50:.2f},{0.02 + 1e-5 * v:.9g}\n" for k, v in enumerate(noise)
    )


def commas() -> str:
    rows = log_text().splitlines()
    return (
        "\n".join([rows[0], *(",".join(v.replace(".", ",") for v in row.split(",")) for row in rows[1:])])
        + "\n"
    )


def sagging(mm: float) -> Plant:
    """Both films with a tip that hangs by so much at rest."""

    def place(marks: list[Mark], time: Array) -> Array:
        out = motion(marks, time)
        for p, mark in enumerate(marks):
            if mark.role == "finger":
                out[:, p, 2] -= mm * (mark.position[0] / 110.0) ** 2
        return out

    def plant(root: Path) -> None:
        filmed(place)(root)
        filmed(lambda marks, time: place(marks, 0 * time), name="static.mkv", frames=STILL)(root)

    return plant


def from_behind(root: Path) -> None:
    """A camera on the -y side, which sees markers there, and positions that say so."""
    # Marks are drawn facing +y. Seen from behind a half turn about z, the scene is that of the other side.
    turn, about = np.array([-1.0, -1.0, 1.0]), np.array([2 * MIDDLE[0], 0.0, 0.0])
    glued = [replace(m, position=(m.position[0], -Y, m.position[2])) for m in marks_of()]
    for name, time in (("film.mkv", film_time()), ("static.mkv", np.zeros(STILL))):
        draw(root / "raw" / name, motion(glued, time) * turn + about)
    every(place=lambda at: (at[0], -Y, at[2]))(root)


def nudged(sd: float) -> Callable[[Config], Config]:
    """Frame positions as someone with a ruler writes them down."""
    rng = np.random.default_rng(4)

    def change(c: Config) -> Config:
        rows = [
            m.model_copy(
                update={
                    "position_mm": tuple(
                        np.round(
                            np.array(m.position_mm) + sd * rng.standard_normal(3) * (1, 0, 1), 2
                        ).tolist()
                    )
                }
            )
            for m in c.frame.markers
        ]
        return c.model_copy(update={"frame": FrameTable(markers=tuple(rows))})

    return change


def lens_of(model: str) -> Plant:
    """A lens file of ROS in place of the boards."""

    def plant(root: Path) -> None:
        camera_with(boards=None, board=None, camera_file="raw/lens.yaml")(root)
        (w, h), k = SIZE, "[700.0, 0.0, 320.0, 0.0, 700.0, 200.0, 0.0, 0.0, 1.0]"
        text = f"image_width: {w}\nimage_height: {h}\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: {k}\n"
        text += f"distortion_model: {model}\ndistortion_coefficients:\n  rows: 1\n  cols: 4\n  data: [0.0, 0.0, 0.0, 0.0]\n"
        files.write_text(root / "raw" / "lens.yaml", text)

    return plant


def raw_stream(root: Path) -> None:
    """A film as its coder made it, without a container."""
    camera_with(film="raw/film.h264")(root)
    with Writer(root / "raw" / "film.h264", SIZE, fps=RATE, codec="libx264") as writer:
        for _, _, grey in Video(root / "raw" / "film.mkv").frames():
            writer.add(grey)


def littered(root: Path) -> None:
    """What systems leave beside the boards."""
    camera_with(boards="raw/boards/*")(root)
    for name in (".DS_Store", "Thumbs.db", "._b01.png"):
        (root / "raw" / "boards" / name).write_bytes(b"x")


def no_boards(root: Path) -> None:
    for path in (root / "raw" / "boards").glob("*.png"):
        cv2.imwrite(str(path), np.random.default_rng(0).integers(90, 140, SIZE[::-1], dtype=np.uint8))


def cut_static(root: Path) -> None:
    filmed(lambda marks, time: motion(marks, 0 * time), name="static.mkv", frames=60)(root)


def small_film(root: Path) -> None:
    """A film of half the size."""
    with Writer(root / "raw" / "half.mkv", (320, 200), fps=RATE, codec="ffv1", crf=0) as writer:
        for _, _, grey in Video(root / "raw" / "film.mkv").frames():
            writer.add(np.asarray(cv2.resize(grey, (320, 200), interpolation=cv2.INTER_AREA), np.uint8))
    (root / "raw" / "half.mkv").replace(root / "raw" / "film.mkv")


def blur(sd: float) -> Callable[[int, Array], Array]:
    return lambda index, grey: np.asarray(cv2.GaussianBlur(grey, (0, 0), sd))
