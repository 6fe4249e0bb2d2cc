"""Right inputs as strangers have them: boards, films of boards, dots, photographs. None may be refused.

Each function below builds one right input, puts it through the chain, and says whether it was accepted and
how wrong the answer is against the truth, in stated sds or px. Accepted is what gives an answer within the
limit; a refusal is counted with its sentence. Recordings come from $SOFTTWIN_DATA; where they are absent the
input is left out.
"""

import csv
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks import SHARED
from benchmarks.tracking import photos, printeddots

import cv2
import numpy as np

from vision import Camera, Video, calibrate_camera, locate
from vision.boards.board import Board, Print, flipped
from vision.boards.charuco import CharucoBoard
from vision.boards.circles import CIRCLE, AsymmetricCircleBoard, CircleBoard, CodedCircleBoard
from vision.calibration.boardfilms import camera_of_film, rig_of_films
from vision.calibration.stereo import calibrate_rig
from vision.camera import Array, Image
from vision.dictionaries import dictionary_of
from vision.drawing import synthetic
from vision.film.video import Writer

SDS = 4.5  # largest error of fx fy cx cy, in stated sds, of a drawn camera
TRUTH = Camera(
    np.array([[900.0, 0, 322.0], [0, 902.0, 238.0], [0, 0, 1.0]]),
    np.array([-0.15, 0.06, 0, 0, 0]),
    (640, 480),
)
CHARUCO = CharucoBoard(columns=8, rows=6, square_mm=11.0, marker_mm=8.0, dictionary="DICT_5X5_100")
CODED = CodedCircleBoard(columns=14, rows=10, square_mm=8.0, coding=((4, 3), (9, 3), (4, 6)))
REAL = photos.BOARD
# Where the second of two drawn cameras is: rotation, and shift in mm.
SECOND = cv2.Rodrigues(np.array([0.0, 0.25, 0.0]))[0], np.array([-30.0, 1.0, 4.0])


@dataclass(frozen=True)
class Outcome:
    """What became of a right input."""

    accepted: bool
    error: float
    unit: str  # of the error
    said: str = ""


# -- drawing ---------------------------------------------------------------------------------
@dataclass(frozen=True)
class LargerDots:
    """The coded board with larger dots in place of rings, to be drawn."""

    columns: int = CODED.columns
    rows: int = CODED.rows
    square_mm: float = CODED.square_mm
    inverted: bool = False

    def print_of(self, texels: float) -> Print:
        plain = CircleBoard.print_of(CODED, texels)
        square, paper = round(plain.origin), plain.paper.copy()
        offset = np.arange(square) + 0.5 - 0.5 * square
        disc = np.clip(np.hypot(offset[:, None], offset) - 1.4 * CIRCLE * square + 0.5, 0.0, 1.0)
        for column, row in CODED.coding:
            left, top = (round((k + 0.5) * square) for k in (column, row))
            paper[top : top + square, left : left + square] = disc
        return plain._replace(paper=paper)


def pose(i: int, middle: Array, away: float) -> tuple[Array, Array]:
    """The i-th pose of a board: tilted by some 25 degrees, turned, its middle near that of the picture."""
    tilts = [(25, 0), (-25, 5), (0, 28), (5, -28), (20, 20), (-20, 18), (18, -22), (-24, -20)]
    tilt = np.deg2rad([*tilts[i % 8], 0.0]) * (1.0 if i < 8 else 0.7)
    turn = cv2.Rodrigues(tilt)[0] @ cv2.Rodrigues(np.array([0.0, 0.0, np.deg2rad(24.0 * i)]))[0]
    shift = np.array([4.0 * np.sin(i), 3.0 * np.cos(2 * i), away]) - turn @ middle
    return np.ravel(cv2.Rodrigues(turn)[0]), shift


def pictures(board: Any, count: int, middle: Array, away: float) -> list[Image]:
    """Pictures of a board in several poses."""
    return [synthetic.board_image(TRUTH, board, pose(i, middle, away), seed=i) for i in range(count)]


def stored(images: list[Image], folder: Path) -> list[Path]:
    """The pictures as files b00.png, b01.png, ..."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"b{i:02d}.png" for i in range(len(images))]
    for path, image in zip(paths, images, strict=True):
        cv2.imwrite(str(path), image)
    return paths


def charucos(count: int = 12) -> list[Image]:
    return pictures(CHARUCO, count, np.array([44.0, 33.0, 0.0]), 165.0)


def judged(camera: Camera, truth: Array = TRUTH.parameters[:4]) -> Outcome:
    """A drawn camera against the truth, in stated sds."""
    error = float(np.abs((camera.parameters[:4] - truth) / camera.stdevs[:4]).max())
    return Outcome(error < SDS, error, "sd", "; ".join(camera.remarks))


# -- circle boards ---------------------------------------------------------------------------
def cut_circles(folder: Path) -> Outcome:
    """A plain board of circles whose edge the picture cuts."""
    board = CircleBoard(columns=14, rows=10, square_mm=8.0)
    images = pictures(board, 8, np.array([52.0, 36.0, 0.0]), 105.0)
    return judged(calibrate_camera(stored(images, folder), board))


def cut_shifted_circles(folder: Path) -> Outcome:
    """The same with every other row shifted."""
    board = AsymmetricCircleBoard(columns=7, rows=14, square_mm=6.0)
    images = pictures(board, 8, np.array([42.0, 40.0, 0.0]), 105.0)
    return judged(calibrate_camera(stored(images, folder), board))


def ring_coded(folder: Path) -> Outcome:
    """A part of a board on which rings mark origin and axes."""
    images = pictures(CODED, 8, np.array([52.0, 36.0, 0.0]), 125.0)
    return judged(calibrate_camera(stored(images, folder), CODED))


def size_coded(folder: Path) -> Outcome:
    """The same with larger dots for rings."""
    images = pictures(LargerDots(), 8, np.array([52.0, 36.0, 0.0]), 125.0)
    return judged(calibrate_camera(stored(images, folder), CODED))


def two_views(board: Board, folder: Path, *, count: int, away: float, moved: int = -1) -> list[list[Path]]:
    """Pictures of two cameras; one board is moved by 2 mm between its two pictures."""
    middle = board.points.mean(axis=0)
    both: tuple[list[Image], list[Image]] = ([], [])
    for i in range(count):
        rvec, tvec = pose(i, middle, away)
        both[0].append(synthetic.board_image(TRUTH, board, (rvec, tvec), seed=2 * i))
        tvec = tvec + ((2.0, 1.0, 0.0) if i == moved else (0.0, 0.0, 0.0))
        turn = SECOND[0] @ cv2.Rodrigues(rvec)[0]
        other = np.ravel(cv2.Rodrigues(turn)[0]), SECOND[0] @ tvec + SECOND[1]
        both[1].append(synthetic.board_image(TRUTH, board, other, seed=2 * i + 1))
    return [stored(images, folder / str(c)) for c, images in enumerate(both)]


def joined(paths: list[list[Path]], board: Board) -> Outcome:
    """The rig of two drawn cameras: error of the base in stated sds."""
    rig = calibrate_rig(paths, board, [calibrate_camera(own, board) for own in paths])
    sd = np.sqrt(np.diag(rig.covariance))[-3:]
    error = float(np.abs((rig.shift[1] - SECOND[1]) / sd).max())
    return Outcome(error < SDS, error, "sd", "; ".join(rig.remarks))


def coded_stereo(folder: Path) -> Outcome:
    """Two cameras that each see another part of a ring-coded board."""
    return joined(two_views(CODED, folder, count=8, away=150.0), CODED)


# -- several cameras, films ------------------------------------------------------------------
def moved_between(folder: Path) -> Outcome:
    """Two cameras; one of ten boards was moved between the two pictures of it: left out, and told."""
    told = joined(two_views(CHARUCO, folder, count=10, away=190.0, moved=4), CHARUCO)
    named = "moved between the cameras' pictures called b04.png" in told.said
    return replace(told, accepted=told.accepted and named)


def board_film(folder: Path) -> Outcome:
    """A film in which a board is moved by hand, a fifth of its frames blurred."""
    path = folder / "boards.mkv"
    with Writer(path, TRUTH.size, fps=8.0, codec="ffv1", crf=0) as writer:
        for i, image in enumerate(charucos(24)):
            writer.add(image if i % 5 else np.asarray(cv2.blur(image, (9, 1)), dtype=np.uint8))
    return judged(camera_of_film(Video(path), CHARUCO))


def real_board_film(folder: Path) -> Outcome | None:
    """A real film of a white-on-black board that is moved by hand."""
    if not (SHARED / "charuco_4cam").is_dir():
        return None
    camera = camera_of_film(Video(SHARED / "charuco_4cam/cam_1.mp4"), REAL)
    return Outcome(camera.rms_px < 0.3, camera.rms_px, "px rms", camera.notes[0])


def real_rig_films(folder: Path) -> Outcome | None:
    """Two real cameras that run freely, with their time stamps; base against that of all four cameras."""
    data = SHARED / "charuco_4cam"
    if not data.is_dir():
        return None
    with (data / "timestamps.csv").open() as file:
        rows = [(int(r["cam_id"]), float(r["frame_time"])) for r in csv.DictReader(file)]
    films = [Video(data / f"cam_{k}.mp4") for k in (0, 1)]
    times = [np.array([t for c, t in rows if c == k]) for k in (0, 1)]
    rig = rig_of_films(films, times, REAL, [camera_of_film(film, REAL) for film in films])
    # All four cameras together put the first two 1132.3 mm apart.
    sd = float(np.sqrt(np.diag(rig.covariance)[-3:].sum()))
    error = abs(float(np.linalg.norm(rig.shift[1])) - 1132.3) / sd
    return Outcome(error < SDS, error, "sd", rig.remarks[0])


# -- views that do not fit, mirrors ----------------------------------------------------------
def one_bent(folder: Path) -> Outcome:
    """One of 12 boards was bent: left out, and named."""
    images = charucos()
    y, x = np.mgrid[:480, :640].astype(np.float32)
    bent = (x + 1.5 * np.sin(y / 50), y + 1.5 * np.sin(x / 40))
    changed = cv2.remap(images[4], *bent, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    images[4] = np.asarray(changed, dtype=np.uint8)
    told = judged(calibrate_camera(stored(images, folder), CHARUCO))
    return replace(told, accepted=told.accepted and "b04.png was left out" in told.said)


def one_smeared(folder: Path) -> Outcome:
    """One of 12 pictures was taken in motion: its corners fit, or it is left out."""
    images = charucos()
    images[2] = np.asarray(cv2.blur(images[2], (7, 1)), dtype=np.uint8)
    return judged(calibrate_camera(stored(images, folder), CHARUCO))


def in_a_mirror(folder: Path) -> Outcome:
    """A camera that looks into a mirror."""
    paths = stored([flipped(image) for image in charucos(8)], folder)
    return judged(calibrate_camera(paths, CHARUCO, mirrored=True))


def mirrored_print(folder: Path) -> Outcome:
    """A board that is printed mirrored, as on film that is seen from behind."""
    paths = stored([flipped(image) for image in charucos(8)], folder)
    truth = TRUTH.parameters[:4] * (1, 1, -1, 1) + (0, 0, 639.0, 0)
    return judged(calibrate_camera(paths, replace(CHARUCO, mirrored=True)), truth)


# -- marks -----------------------------------------------------------------------------------
def sheet_of(dictionary: str, ids: list[int], cell_px: int, gap: int) -> tuple[Image, Array]:
    """A picture of a row of markers, blurred by 0.85 px and noisy, and their centres (n,2) px."""
    words, fine = dictionary_of(dictionary), 4
    cells = words.markerSize + 2
    side, step = cell_px * cells * fine, (cell_px * cells + gap) * fine
    paper, centre = np.full((side + 2 * gap * fine, step * len(ids) + gap * fine), 255.0), []
    for k, marker in enumerate(ids):
        left, top = gap * fine + k * step + k, gap * fine + 2 * k
        bits = words.generateImageMarker(marker, cells)
        paper[top : top + side, left : left + side] = np.kron(bits, np.ones((cell_px * fine, cell_px * fine)))
        centre.append([(left + 0.5 * side) / fine - 0.5, (top + 0.5 * side) / fine - 0.5])
    soft = cv2.GaussianBlur(40.0 + 0.7 * paper, (0, 0), 0.85 * fine)
    height, width = (n // fine for n in paper.shape)
    grey = soft[: height * fine, : width * fine].reshape(height, fine, width, fine).mean(axis=(1, 3))
    noisy = np.rint(grey + np.random.default_rng(0).normal(0.0, 1.0, grey.shape))
    return np.asarray(np.clip(noisy, 0, 255), dtype=np.uint8), np.array(centre)


def located(dictionary: str, ids: list[int], cell_px: int, *, limit: float = 0.02) -> Outcome:
    """Centres of drawn markers: the largest error, px."""
    picture, centre = sheet_of(dictionary, ids, cell_px, max(2 * cell_px, 20))
    found = locate(picture, dictionary=dictionary)
    single = [k for k, i in enumerate(ids) if ids.count(i) == 1]
    order = sorted(single, key=lambda k: ids[k])
    if found.ids.tolist() != [ids[k] for k in order]:
        return Outcome(False, np.nan, "px", f"found {found.ids.tolist()} of {ids}")
    error = float(np.abs(found.centre - centre[order]).max())
    return Outcome(error < limit, error, "px")


def eighth_of_the_picture(folder: Path) -> Outcome:
    """Markers of 160 px, an eighth of a picture 1280 px wide."""
    return located("DICT_4X4_50", [3, 7, 12], 27)


def third_of_the_picture(folder: Path) -> Outcome:
    """Markers of 400 px, a third of the picture."""
    return located("DICT_4X4_50", [3, 7], 67)


def apriltags(folder: Path) -> Outcome:
    """AprilTags: centres in this package's pixels, not half a pixel off as their own library counts."""
    return located("DICT_APRILTAG_36h11", [5, 100, 586], 5)


def one_id_twice(folder: Path) -> Outcome:
    """Two markers of one id among others: the others are located."""
    return located("DICT_4X4_50", [3, 9, 3, 7], 8)


def photograph(folder: Path) -> Outcome | None:
    """A photograph of 35 markers on paper that is not flat: error over stated sd is near 1."""
    if not (SHARED / "opencv_boards").is_dir():
        return None
    value, degrees, rms, _ = photos.photograph(SHARED / "opencv_boards")
    pull = float(np.sqrt(value / degrees))
    return Outcome(0.8 < pull < 1.25, pull, "pull", f"{rms:.3f} px from the plane")


def dots(radius: float) -> Callable[[Path], Outcome]:
    def look(folder: Path) -> Outcome:
        seen, shifts = printeddots.trial(radius, 6, int(radius))
        return Outcome(seen == 6, float(np.sqrt(np.mean(np.square(shifts)))), "px", f"{seen} of 6")

    look.__doc__ = f"Printed dots of {2 * radius:g} px with a rough rim."
    return look


INPUTS: tuple[Callable[[Path], Outcome | None], ...] = (
    dots(2.5), dots(9.0), dots(30.0), dots(60.0), cut_circles, cut_shifted_circles, ring_coded, size_coded,
    coded_stereo, moved_between, board_film, real_board_film, real_rig_films, one_bent, one_smeared,
    in_a_mirror, mirrored_print, eighth_of_the_picture, third_of_the_picture, apriltags, one_id_twice,
    photograph,
)  # fmt: skip


def tried(put_in: Callable[[Path], Outcome | None]) -> Outcome | None:
    """What becomes of an input; a refusal is an outcome with its sentence."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return put_in(Path(folder))
        except ValueError as error:
            return Outcome(False, np.nan, "", str(error))


def figures(quick: bool) -> dict[str, Any]:
    """`refused_right` of `right_inputs`, `dots_found` and `photo_pulls` {board: pull}."""
    outcomes = []
    print("| right input | accepted | error | said |\n|---|---|---|---|")
    for put_in in INPUTS:
        outcome = tried(put_in)
        if outcome is None:
            continue
        outcomes.append(outcome)
        what, said = (put_in.__doc__ or "").splitlines()[0], outcome.said.splitlines()
        word = "yes" if outcome.accepted else "NO"
        told = f"{outcome.error:.3g} {outcome.unit} | {said[0][:160] if said else ''}"
        print(f"| {what} | {word} | {told} |", flush=True)
    return {
        "right_inputs": len(outcomes),
        "refused_right": sum(not outcome.accepted for outcome in outcomes),
        "dots_found": printeddots.figures(quick)["dots_found"],
        "photo_pulls": photos.figures(quick)["photo_pulls"],
    }
