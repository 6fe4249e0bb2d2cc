"""What lies in a folder of recordings: which film is the test, which tags move, the board, and the log."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from twin.gauge.logcolumns import LogFormat
from twin.gauge.onset import whole_film
from twin.gauge.pressurelog import Log, read_log
from twin.gauge.synchrony import Motion
from twin.project.cameratables import BoardTable
from twin.targets import Array

if TYPE_CHECKING:  # vision takes a second to import
    from vision.camera import Image
    from vision.following.dots import Dot

FILMS = (".mp4", ".mkv", ".avi", ".mov", ".m4v", ".webm", ".mpg", ".mpeg")
LOGS = (".csv", ".txt", ".tsv", ".dat")
OWN = ("runs", "targets", "cache", "effects")  # folders that commands write
LOOKED_AT, LEAST_BOARDS, IN_BOARDS = 40, 4, 8  # frames of a film; pictures of a board, and how many are tried
OFTEN = 0.5  # share of the frames in which a tag is read
MOVES_PX, TIMES = 1.0, 8.0  # a tag moves that goes so far, and so many times as far as those that stand still
LEAST_IDS, WITHIN = 8, 0.15  # markers that tell a board's columns, and how well in squares
NOISE_PX = 0.2  # of a tag's middle by its corners
MOST_DOTS = 40  # more are a pattern, and no markers
SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


@dataclass(frozen=True)
class Tags:
    """Where the tags of a film are in frames over its whole length; plain dots, which have no id, are tags
    -1, -2, ... from left to right."""

    path: Path
    codes: tuple[int, ...]  # those that are read often
    time: Array  # (k,) s from the first frame
    quads: Array  # (k,n,4,2) px, corners; NaN where not read
    frames: int  # of the film
    board: bool = False  # whether it shows the board

    @property
    def centre(self) -> Array:
        """Middles (k,n,2) px."""
        return np.asarray(self.quads.mean(axis=2))

    @cached_property
    def reach(self) -> Array:
        """The farthest way (n,) px of each tag from where it is first seen."""
        away = np.linalg.norm(self.centre - first(self.centre), axis=2)
        return np.asarray(np.nanmax(away, axis=0))

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """Mask (n,) of the tags that move, beside those that stand still."""
        if not self.codes:
            return np.zeros(0, bool)
        return np.asarray(self.reach > max(MOVES_PX, TIMES * float(np.quantile(self.reach, 0.25))))

    @cached_property
    def near(self) -> NDArray[np.bool_]:
        """Mask (n,) of the tags that move a little and lie on the line of those that move: near the clamp."""
        sides = np.linalg.norm(first(self.quads[:, :, 1]) - first(self.quads[:, :, 0]), axis=1)
        places = first(self.centre)
        if self.moves.sum() < 2:
            return np.zeros(len(self.codes), bool)
        middle = places[self.moves].mean(axis=0)
        across = np.linalg.svd(places[self.moves] - middle)[2][1]
        little = self.reach > TIMES * float(np.quantile(self.reach, 0.25))
        return np.asarray(little & ~self.moves & (np.abs((places - middle) @ across) < sides))

    @property
    def still(self) -> set[int]:
        """Ids of the tags that stand still; dots have none."""
        return {code for code, moves in zip(self.codes, self.moves, strict=True) if not moves and code >= 0}

    def motion(self) -> Motion:
        """Way of the moving tags from their first places, in px."""
        squares = ((self.centre - first(self.centre))[:, self.moves] ** 2).sum(axis=2)
        return Motion(self.time, np.sqrt(squares.mean(axis=1)), NOISE_PX)


def first(values: Array) -> Array:
    """The first finite row of each column of (k,n,...)."""
    seen = np.isfinite(values.reshape(*values.shape[:2], -1)).all(axis=2)
    return np.asarray(values[seen.argmax(axis=0), np.arange(values.shape[1])])


@dataclass(frozen=True)
class Recordings:
    """The recordings of a folder, and what nobody but the user can say."""

    film: Tags | None = None
    static: Tags | None = None
    boards: str | None = None  # pattern of pictures, or a film
    rig: tuple[Path, ...] = ()  # pictures, or a film, of the board among the tags that stand still
    board: BoardTable | None = None
    log: Log | None = None
    dictionary: str = "DICT_4X4_50"
    start_s: float | None = None  # of the film on the log's clock
    tables: tuple[Path, ...] = ()  # files that may be a log
    missing: tuple[str, ...] = ()  # sentences on recordings that are not there
    of_log: tuple[str, ...] = ()  # on the log, where it is unclear
    of_clock: tuple[str, ...] = ()  # on when the film starts, where that is unclear

    @property
    def open(self) -> tuple[str, ...]:
        """Sentences on what is missing or unclear."""
        return (*self.missing, *self.of_log, *self.of_clock)


def recordings(
    root: Path, *, dictionary: str, board: BoardTable, form: LogFormat | None = None
) -> Recordings:
    """What lies in a folder.   dictionary, board: what twin.toml or the template states; tried first.   form:
    how its log is to be read."""
    videos, pictures, tables = _files(root)
    if not videos:
        none = f"No film: wanted one of {', '.join(FILMS)} in {root}."
        return Recordings(dictionary=dictionary, missing=(none,))
    dictionary = _dictionary(videos, dictionary)
    with_board = list(_boards(pictures, videos, board, dictionary))
    looks = [_tags(path, dictionary) for path in videos if path not in [group for group, _ in with_board]]
    tests = [t for t in looks if t.moves.any() and (~t.moves).sum() >= 4]
    film = max(tests, key=lambda t: float(t.reach.max()), default=None)
    still = [t for t in looks if t is not film and t.codes and not t.moves.any()]
    static = max(still, key=lambda t: t.frames, default=None)
    log, unclear = _log(tables, form)
    fixed = film.still if film else set()
    rigs = [g for g, table in with_board if _shows(g, fixed - _ids_of_board(table, dictionary), dictionary)]
    alone = [pair for pair in with_board if pair[0] not in rigs] or with_board
    boards, of_board = (pattern_of(root, alone[0][0]), alone[0][1]) if alone else (None, None)
    rig = rigs[0] if rigs else ()
    found = Recordings(
        film, static, boards, (rig,) if isinstance(rig, Path) else tuple(rig), of_board, log, dictionary,
        tables=tuple(tables), of_log=unclear,
    )  # fmt: skip
    return with_clock(replace(found, missing=tuple(_missing(found, videos))))


def _files(root: Path) -> tuple[list[Path], list[list[Path]], list[Path]]:
    """Films, folders of pictures, and tables below a folder, in the order of their names."""
    from vision.film.series import SUFFIXES

    every = [p for p in sorted(root.rglob("*")) if p.is_file() and not _skipped(p.relative_to(root))]
    pictures: dict[tuple[Path, str], list[Path]] = {}
    for path in every:
        if path.suffix.lower() in SUFFIXES:
            pictures.setdefault((path.parent, path.suffix), []).append(path)
    films = [p for p in every if p.suffix.lower() in FILMS]
    tables = [p for p in every if p.suffix.lower() in LOGS and p.name != "times.csv"]
    return films, [group for group in pictures.values() if len(group) >= LEAST_BOARDS], tables


def _skipped(path: Path) -> bool:
    return path.parts[0] in OWN or any(part.startswith(".") for part in path.parts)


def pattern_of(root: Path, boards: Path | Sequence[Path]) -> str:
    """The pictures of a folder, or a film, as twin.toml names them."""
    paths = [boards] if isinstance(boards, Path) else boards
    path = paths[0] if is_film(paths) else paths[0].parent / f"*{paths[0].suffix}"
    return path.relative_to(root).as_posix()


def is_film(paths: Sequence[Path]) -> bool:
    """Whether what was recorded is a film, and not pictures."""
    return paths[0].suffix.lower() in FILMS


def _even(count: int, most: int) -> list[int]:
    return sorted({*np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()})


def _tags(path: Path, dictionary: str) -> Tags:
    """The tags and dots in frames all over a film."""
    from vision import Video
    from vision.dictionaries import dictionary_of
    from vision.marks import detect_wanted

    film, any_id = Video(path), range(len(dictionary_of(dictionary).bytesList))
    seen: list[dict[int, Array]] = []
    time: list[float] = []
    dots: dict[int, Dot] = {}
    for _, at, picture in film.chosen(_even(len(film.time), LOOKED_AT)):
        tags = detect_wanted(picture, dictionary, any_id)[0]
        now = _followed(picture, dots) if seen else _dots(picture, list(tags.values()))
        dots |= now
        seen.append(tags | {code: dot.centre + dot.radius * SQUARE for code, dot in now.items()})
        time.append(at - film.time[0])
    every = sorted({code for quads in seen for code in quads})
    codes = tuple(c for c in every if sum(c in quads for quads in seen) >= OFTEN * len(seen))
    none = np.full((4, 2), np.nan)
    quads = np.array([[frame.get(code, none) for code in codes] for frame in seen])
    return Tags(path, codes, np.array(time), quads.reshape(len(seen), len(codes), 4, 2), len(film.time))


def _dots(picture: "Image", tags: Sequence[Array]) -> "dict[int, Dot]":
    """The plain dots of a film's first picture, outside the corners (4,2) px of its tags."""
    from vision.following.dots import unknown_dots

    found = sorted(unknown_dots(picture), key=lambda dot: float(dot.centre[0]))
    quads = [np.asarray(quad, np.float32) for quad in tags]
    free = [
        dot for dot in found
        if not any(cv2.pointPolygonTest(q, dot.centre.tolist(), True) > -dot.radius for q in quads)
    ]  # fmt: skip
    return {} if len(free) > MOST_DOTS else {-1 - k: dot for k, dot in enumerate(free)}


def _followed(picture: "Image", dots: "dict[int, Dot]") -> "dict[int, Dot]":
    """The dots of the picture before, each nearest to where it was, within half the way to the next one."""
    from vision.camera import Camera
    from vision.following.dots import find_dots

    flat = Camera(np.eye(3), np.zeros(5), (picture.shape[1], picture.shape[0]))
    found = {}
    for code, dot in dots.items():
        others = [np.hypot(*(dot.centre - other.centre)) for key, other in dots.items() if key != code]
        reach = min([0.5 * float(away) for away in others] + [8.0 * dot.radius])
        near = find_dots(picture, flat, dot.centre, dot.axes, search=reach, dark=dot.dark)
        if near:
            found[code] = min(near, key=lambda one: float(np.hypot(*(one.centre - dot.centre))))
    return found


def _dictionary(videos: Sequence[Path], stated: str) -> str:
    """The dictionary of the tags: the one that is stated where it finds four in a film, else the one that
    finds most."""
    from vision import Video
    from vision.dictionaries import other_dictionary
    from vision.marks import detect

    pictures = [next(iter(Video(path).chosen([0])))[2] for path in videos]
    if max(len(detect(picture, stated)[0]) for picture in pictures) >= 4:
        return stated
    other = other_dictionary(pictures, stated)
    return stated if other is None else other[0]


# -- the board -----------------------------------------------------------------------------------------------


def _boards(
    pictures: Sequence[list[Path]], videos: Sequence[Path], stated: BoardTable, dictionary: str
) -> Iterator[tuple[list[Path] | Path, BoardTable]]:
    """Folders of pictures of a board, and films of it, each with that board: the one that is stated, or one
    whose markers tell its columns and rows."""
    from vision import Board
    from vision.boards.board import MIN_CORNERS

    groups: list[list[Path] | Path] = [*pictures, *videos]
    for group in groups:
        looked = _looked_at(group)
        for table in (stated, _read_board(looked, stated, dictionary)):
            if table is None:
                continue
            own = Board.of(**table.model_dump() | {"marker_mm": table.marker_mm or 0.0})
            views = [own.find(own.black_on_white(picture)) for picture in looked]
            if sum(len(view) >= MIN_CORNERS for view in views) >= OFTEN * len(looked):
                yield group, table
                break


def _looked_at(group: list[Path] | Path) -> "list[Image]":
    """Some pictures of a folder, or frames of a film."""
    from vision import Video
    from vision.film.series import bits_of_pictures, read_picture

    if isinstance(group, Path):
        film = Video(group)
        return [picture for _, _, picture in film.chosen(_even(len(film.time), IN_BOARDS))]
    bits = bits_of_pictures(group)
    return [read_picture(group[k], bits) for k in _even(len(group), IN_BOARDS)]


def _ids_of_board(table: BoardTable, dictionary: str) -> set[int]:
    """Ids that the board's own markers have in the dictionary of the tags."""
    own = table.kind == "charuco" and table.dictionary == dictionary
    return set(range(table.columns * table.rows // 2)) if own else set()


def _shows(group: list[Path] | Path, codes: set[int], dictionary: str) -> bool:
    """True where most of some pictures, or of a film's frames, show four or more of the tags."""
    from vision.marks import detect_wanted

    views = [detect_wanted(picture, dictionary, codes)[0] for picture in _looked_at(group)]
    return sum(len(codes & set(view)) >= 4 for view in views) >= OFTEN * len(views)


def _read_board(looked: "Sequence[Image]", stated: BoardTable, dictionary: str) -> BoardTable | None:
    """A charuco board with the columns and rows that its markers' ids tell; None where they tell none.

    Its k-th marker is the k-th white square, row by row. The side of a square is as stated: ids tell none.
    """
    from vision.marks import detect
    from vision.plane import fit_homography, to_plane

    for name in dict.fromkeys((stated.dictionary, dictionary)):
        best = max((detect(picture, name)[0] for picture in looked), key=len)
        if len(best) < LEAST_IDS:
            continue
        codes = np.array(sorted(best))
        seen = np.array([best[c].mean(axis=0) for c in codes])
        fits = {}
        for columns in range(3, 31):
            there = codes < len(_white(columns))
            _, agree = cv2.findHomography(seen[there], _white(columns)[codes[there]], cv2.RANSAC, WITHIN)
            fits[columns] = codes[there][np.ravel(agree) > 0] if agree is not None else codes[:0]
        columns = max(fits, key=lambda c: len(fits[c]))
        own = fits[columns]  # the others are tags beside the board
        if len(own) < LEAST_IDS:
            continue
        to_px = fit_homography(_white(columns)[own], np.array([best[c].mean(axis=0) for c in own]))
        corners = to_plane(to_px[None], np.array([best[c] for c in own]).reshape(1, -1, 2))[0]
        side = float(np.median(np.linalg.norm(np.diff(corners.reshape(-1, 4, 2), axis=1), axis=2)))
        return BoardTable(
            columns=columns, rows=int(_white(columns)[own.max()][1]) + 1, square_mm=stated.square_mm,
            dictionary=name, marker_mm=round(round(side, 2) * stated.square_mm, 3),
        )  # fmt: skip
    return None


def _white(columns: int) -> Array:
    """Middles (n,2) of the white squares of a board, row by row, in squares from its first one."""
    rows, across = np.mgrid[0:60, 0:columns]
    white = (rows + across) % 2 == 1
    return np.column_stack([across[white], rows[white]]).astype(float)


# -- the log and the clock -----------------------------------------------------------------------------------


def _log(tables: Sequence[Path], form: LogFormat | None) -> tuple[Log | None, tuple[str, ...]]:
    """The one table that is a pressure log, and sentences where there is none or are several."""
    logs, refused = [], []
    for path in tables:
        try:
            logs.append(read_log(path, time_shift_s=0.0, form=form))
        except ValueError as error:
            refused.append(str(error))
    if len(logs) == 1:
        return logs[0], ()
    if not logs:
        return None, tuple(f"No pressure log that can be read: {sentence}." for sentence in refused) or (
            f"No pressure log: wanted a table ({', '.join(LOGS)}) with time and pressure.",
        )
    names = ", ".join(log.path.name for log in logs)
    longest = max(logs, key=lambda log: float(np.ptp(log.pressure)))
    return longest, (f"{names} are logs: {longest.path.name}, with the largest range, is taken.",)


def with_clock(found: Recordings) -> Recordings:
    """With the start of the film on the log's clock, by its motion."""
    if found.film is None or found.log is None:
        return found
    try:
        return replace(found, start_s=whole_film(found.film.motion(), found.log), of_clock=())
    except ValueError as error:
        unclear = f"When the film starts on the clock of the log: {error}."
        return replace(found, start_s=None, of_clock=(unclear,))


def _missing(found: Recordings, videos: Sequence[Path]) -> Iterator[str]:
    names = ", ".join(path.name for path in videos)
    if found.film is None:
        yield (f"No test among {names}: wanted a film in which tags of the finger move beside four or more "
               "that stand still.")  # fmt: skip
    if found.static is None:
        yield f"No static film among {names}: wanted 300 frames or more of the finger at rest."
    if found.boards is None:
        yield ("No pictures of a board: wanted 10 or more in a folder, or a film, of the board of "
               "[cameras.board].")  # fmt: skip
