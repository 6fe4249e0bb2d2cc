"""Mistakes of strangers, planted in a small drawn project, and what `twin check` and `twin measure` say.

    python tests/strangers/mistakes.py [--only NAME] [--json]

Each mistake changes one thing of a project that is right: twin.toml, a film, the log or the board pictures.
`MISTAKES` must be refused with a sentence that names the thing; `RIGHT` are unusual and right, and must pass.
`strangers_recordings` has more of both, and `DOUBTFUL` ones, which must pass with a sentence on the doubt.
The exit code is 1 where one of them goes the other way.
"""

import argparse
import json
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))

import cv2
import numpy as np

from tests.strangers.studio import (
    FILM_START,
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
    make,
    marks_of,
    motion,
)
from twin.commands.camera import run_camera
from twin.commands.check import run_check
from twin.commands.measure import run_measure
from twin.project import files
from twin.project.config import Config, FrameTable, MarkerTable, PointTable
from twin.project.folder import Project
from twin.project.toml import dump
from twin.targets import Array
from vision import Mark, Video
from vision.film.video import Writer


class Lines(list[str]):
    """A say that keeps its lines."""

    def __call__(self, text: str, /) -> None:
        self.append(text)

    def progress(self, stage: str, done: int, total: int, /) -> None:
        pass


@dataclass(frozen=True)
class Told:
    """What the program said of one project."""

    name: str
    refused: bool
    by: str  # "check", "camera", "measure", or "nothing"
    sentence: str  # the error, or all remarks
    remarks: tuple[str, ...] = ()


# -- how a mistake is planted --------------------------------------------------------------------------------

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


# -- the two lists -------------------------------------------------------------------------------------------

# What is planted, and what the sentence has to say.
MISTAKES: Mapping[str, tuple[Plant, str]] = {
    "positions in cm": (every(place=lambda at: [v / 10 for v in at]), r"positions in cm instead of mm"),
    "positions of the rig in cm": (
        every(finger=False, place=lambda at: [v / 10 for v in at]),
        r"positions in cm instead of mm",
    ),
    "positions of the rig in inches": (
        every(finger=False, place=lambda at: [v / 25.4 for v in at]),
        r"positions in inches",
    ),
    "positions of the finger in cm": (
        every(rig=False, place=lambda at: [v / 10 for v in at]),
        r"not on the finger|lies .* mm from its stated place",
    ),
    "all sizes twice": (every(size=2.0), r"size_mm says 18 mm, which is 2\.\d+ times as much"),
    "all sizes in cm": (every(size=0.1), r"sizes in cm instead of mm"),
    "sizes with the white border": (every(size=8 / 6), r"1\.3\d times as much.*without its white border"),
    "one size twice": (
        toml(marker("frame2", size_mm=18.0)),
        r"'frame2' has size_mm = 18, but looks (8\.[89]|9)",
    ),
    "two frame ids exchanged": (
        exchanged("frame0", "frame3"),
        r"'frame0' \(id 3\) and 'frame3' \(id 0\) have each other's places",
    ),
    "a frame and a fixed id exchanged": (
        exchanged("frame1", "fixed9"),
        r"'frame1' \(id 9\) and 'fixed9' \(id 1\) have each other's places",
    ),
    "a frame marker 18 mm off": (
        toml(marker("frame1", position_mm=(48.0, Y, 30.0))),
        r"'frame1' lies 1[78].\d mm from its stated place.*see it at x = 30.\d, z = (29|30).\d mm",
    ),
    "a sign of a frame marker": (
        toml(marker("frame4", position_mm=(24.0, Y, -58.0))),
        r"'frame4' lies 4[5-9].\d mm from its stated place",
    ),
    "a finger's id exchanged with a frame marker's": (
        exchanged("frame2", "tip"),
        r"'frame2' \(id 23\) and 'tip' \(id 2\) have each other's places",
    ),
    "z mirrored": (
        every(place=lambda at: (at[0], at[1], -at[2])),
        r"positions are mirrored.*their z runs down",
    ),
    "x of the rig mirrored": (
        every(finger=False, place=lambda at: (-at[0], at[1], at[2])),
        r"positions are mirrored",
    ),
    "y of the wrong sign": (every(place=lambda at: (at[0], -at[1], at[2])), r"positions are mirrored"),
    "tip and middle exchanged": (
        exchanged("tip", "middle"),
        r"'middle' \(id 23\) and 'tip' \(id 22\) lie in the opposite order",
    ),
    "neighbours on the finger exchanged": (
        exchanged("p2", "middle"),
        r"'p2' \(id 22\) and 'middle' \(id 21\) lie in the opposite order",
    ),
    "finger counted from the tip": (
        every(rig=False, place=lambda at: (110.0 - at[0], at[1], at[2])),
        r"reverse of the stated order",
    ),
    "origin of the rig 60 mm off": (
        every(finger=False, place=lambda at: (at[0] + 60, at[1], at[2])),
        r"mm from its stated place at rest",
    ),
    "a finger id that never appears": (
        toml(marker("tip", marker=33)),
        r"'tip' \(id 33\).*of no stated marker, are the ids 23",
    ),
    "another dictionary": (camera_with(dictionary="DICT_6X6_50"), r"DICT_4X4_50 finds"),
    "film starts in motion": (filmed(early), r"film.mkv: the finger is not at rest between 0.00 and 1.80 s"),
    "static film in motion": (
        filmed(swinging, name="static.mkv", frames=STILL),
        r"static.mkv: the finger is not at rest",
    ),
    "static film too short": (cut_static, r"static.mkv has 60 frames, wanted at least 120"),
    "dark film": (painted(lambda _, grey: grey / 12), r"the picture is dark"),
    "blurred film": (painted(blur(5.0)), r"the picture is blurred"),
    "frame markers covered": (
        painted(hidden("frame0", "frame1", "frame2", "frame3")),
        r"shows 3 of 7 frame markers",
    ),
    "finger's markers lost": (
        painted(hidden("root", "p2", "middle", "tip", since=20), "film.mkv"),
        r"of the .* frames looked at show a marker of the finger",
    ),
    "film of another size": (
        small_film,
        r"film.mkv has 320 x 200 px, the camera was calibrated with 640 x 400",
    ),
    "film of a finger at rest": (
        filmed(lambda marks, time: motion(marks, 0 * time)),
        r"the finger does not move",
    ),
    "film that is none": (
        lambda root: files.write_text(root / "raw" / "film.mkv", "no film"),
        r"cannot be read as a video",
    ),
    "boards not in the pictures": (no_boards, r"0 of 9 board images show"),
    "kPa for MPa": (log(factor=1e3), r"wanted 0\.0001 to 1 MPa"),
    "psi for MPa": (log(factor=145.04), r"wanted 0\.0001 to 1 MPa"),
    "MPa under kPa": (log(head="time_s,pressure_kPa"), r"wanted 0.0001 to 1 MPa"),
    "decimal commas": (bad_log(commas()), r"decimal commas"),
    "log shorter than the film": (
        log(time=np.arange(0.0, 17.0, 0.02)),
        r"the film 14.000 to 18.500 s of the same clock",
    ),
    "log on another clock": (camera_with(film_start_s=FILM_START - 5.0), r"correct film_start_s"),
    "log of a shifted test": (log(shift=4.0), r"correct film_start_s"),
    "log of another day": (bad_log(flat_log()), r"explains \d+ % of the motion, wanted 30 %"),
    "time in ms": (log(time=np.arange(0.0, LOG_END * 1e3, 20.0)), r"20 s apart, so its time is likely in ms"),
    "absolute pressure": (log(head="time_s,p [bar(a)]"), r"absolute pressure"),
    "pressure without a unit": (log(head="time_s,pressure"), r"has no unit"),
}

# Unusual and right.
RIGHT: Mapping[str, Plant] = {
    "nothing planted": lambda root: None,
    "a marker of the same id elsewhere": painted(twice),  # the one in its stated place is followed
    "sizes 10 % off": every(size=1.1),
    "a frame marker 2 mm off": toml(marker("frame1", position_mm=(32.0, Y, 30.0))),
    "frame positions by a ruler": toml(nudged(0.5)),
    "camera on the -y side": from_behind,
    "a sag of 25 mm at rest": sagging(25.0),
    "a drift of 0.1 mm in the reference": filmed(creeping(-0.1)),
    "clock 1.5 s off": camera_with(film_start_s=FILM_START + 1.5),
    "a finger that moves by half a millimetre": filmed(
        lambda marks, time: motion(marks, 0 * time) + 0.05 * (motion(marks, time) - motion(marks, 0 * time))
    ),
    "a frame marker covered": painted(hidden("frame5")),
    "a soft focus": painted(blur(1.5)),
    "little light": painted(lambda _, grey: 16 + grey / 4),
    "pressure in kPa": log(factor=1e3, head="t [s],p [kPa]"),
    "pressure in psi": log(factor=145.04, head="time_s,Pressure (psi)"),
    "the tip hidden for a while": painted(
        lambda i, grey: hidden("tip")(i, grey) if 25 <= i < 33 else grey, "film.mkv"
    ),
}


STAGES = {"check": run_check, "camera": run_camera, "measure": run_measure}


def told(name: str, plant: Plant, *, base: Path, folder: Path, stages: Sequence[str] = tuple(STAGES)) -> Told:
    """What the stages say of a copy of the right project with a mistake in it, up to the first that refuses.

    Raises AssertionError where targets are written all the same.
    """
    root, said = folder / "".join(c if c.isalnum() else "-" for c in name), Lines()
    shutil.copytree(base, root)
    try:
        plant(root)
        for by in stages:
            sentence = _refusal(STAGES[by], root, said)
            if sentence and (root / "targets").exists():
                raise AssertionError(f"{name}: refused, but targets are written")
            if sentence:
                return Told(name, True, by, sentence, tuple(said))
    finally:
        shutil.rmtree(root)
    return Told(name, False, "nothing", "", tuple(said))


def _refusal(stage: Callable[..., object], root: Path, say: Lines) -> str:
    """What a stage refuses a project with, "" where it does not."""
    try:
        stage(Project.open(root), say)
    except ValueError as error:
        return str(error)
    return ""


@dataclass(frozen=True)
class Planted:
    """All that is planted: what must be refused, what must be told, and what must pass."""

    mistakes: Mapping[str, tuple[Plant, str]]
    doubtful: Mapping[str, tuple[Plant, str]]
    right: Mapping[str, Plant]

    @property
    def plants(self) -> dict[str, Plant]:
        named = {name: plant for name, (plant, _) in {**self.mistakes, **self.doubtful}.items()}
        return {**named, **self.right}


def planted() -> Planted:
    """All that is planted here and in `strangers_recordings`."""
    from tests.strangers import recordings as more  # which is made of what stands here

    return Planted({**MISTAKES, **more.MISTAKES}, more.DOUBTFUL, {**RIGHT, **more.RIGHT})


def is_told(one: Told, sentence: str) -> bool:
    """Whether a doubtful project passed with a remark of this pattern."""
    return not one.refused and any(re.search(sentence, remark) for remark in one.remarks)


def figures(only: str = "", *, tell: bool = False) -> dict[str, Any]:
    """Mistakes that were accepted and right inputs that were refused, of those whose names hold a text, each
    with its sentence; tell: print each as it comes."""
    with tempfile.TemporaryDirectory() as place:
        base, every_one, all_of = make(Path(place) / "base"), list[Told](), planted()
        for name, plant in all_of.plants.items():
            if only not in name:
                continue
            every_one.append(told(name, plant, base=base, folder=Path(place)))
            if tell:
                one = every_one[-1]
                print(f"{name} [{one.by}]: {one.sentence or 'passes ' + ' '.join(one.remarks)}", flush=True)
    wrong = [t for t in every_one if t.name in all_of.mistakes]
    right = [t for t in every_one if t.name in all_of.right]
    doubtful = [t for t in every_one if t.name in all_of.doubtful]
    untold = [t.name for t in doubtful if not is_told(t, all_of.doubtful[t.name][1])]
    return {
        "planted": len(wrong), "accepted_wrong": sum(not t.refused for t in wrong),
        "doubtful": len(doubtful), "untold": untold,
        "right": len(right), "refused_right": sum(t.refused for t in right),
        "sentences": {t.name: t.sentence for t in wrong},
        "refused": {t.name: t.sentence for t in right if t.refused},
    }  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", metavar="NAME", help="names that hold this text")
    parser.add_argument("--json", action="store_true", help="one line of JSON")
    options = parser.parse_args()
    found = figures(options.only, tell=not options.json)
    if options.json:
        print(json.dumps(found))
    else:
        print(
            f"{found['planted']} mistakes, {found['accepted_wrong']} accepted; {found['doubtful']} doubtful, "
            f"{len(found['untold'])} not told; {found['right']} unusual, {found['refused_right']} refused"
        )
    return 1 if found["accepted_wrong"] or found["untold"] or found["refused_right"] else 0


if __name__ == "__main__":
    sys.exit(main())
