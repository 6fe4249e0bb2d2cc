"""A camera from board pictures: lens model by evidence, covariance, and checks that say why they refuse."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from vision.boards.board import MIN_CORNERS, Board, BoardView, flipped
from vision.calibration import lens
from vision.calibration.rejectedpictures import MIN_LEFT, Rejected, area, empty_corners, why, without_outliers
from vision.camera import Array, Camera, Image
from vision.film.picturefaults import board_edge_sd, picture_trouble
from vision.film.series import read_picture as read_levels
from vision.plane import fit_homography, to_plane

MIN_IMAGES = 6
MIN_TILT_DEG = 10.0  # below it focal length and distance are one number, and OpenCV's sd does not tell
# Share of the picture inside the hull of all corners. A small board far away may leave 5 % and calibrate well
# there; what lies outside is told where a film shows marks there.
MIN_COVERAGE, GOOD_COVERAGE = 0.02, 0.6
MAX_SCALE_ERROR = 1e-3  # of lengths on boards that were held out
FOLDS = 3


@dataclass(frozen=True)
class _Seen:
    """Views of a board in pictures."""

    views: tuple[BoardView, ...]  # those with enough corners
    rows: tuple[int, ...]  # their pictures
    said: tuple[str, ...] = ()  # how else the board was read, and what to do about it
    noted: tuple[str, ...] = ()  # the same where nothing is to be done


def calibrate_camera(
    images: Sequence[Path], board: Board, *, max_rms_px: float = 0.3, mirrored: bool = False
) -> Camera:
    """The camera that took the pictures of a board.

    images: picture files, all of one size, the board tilted differently in each.
    board: the printed board; its square sets the scale.
    max_rms_px: px, the largest reprojection error that is accepted.   mirrored: pictures taken in a mirror;
    the camera is then that of the pictures left for right.

    Zhang's method, doi 10.1109/34.888718; of six lens models from none to k1 k2 p1 p2 k3 the one with the
    lowest BIC. The camera's `notes` say what was chosen and checked, its `remarks` what to do better.
    Pictures that do not fit the others are left out by the rule of `rejectedpictures`.

    Raises ValueError when pictures are missing or differ in size, or fewer than 6 show the board (it names
    the other dictionary that finds markers). Also when the boards are not tilted against each other or cover
    less than 2 % of the picture. Also when the error is above max_rms_px, or lengths on held-out boards are
    off by more than 0.1 %.
    """
    if not images:
        raise ValueError(
            f"no board images were given: film or photograph the board in at least {MIN_IMAGES} poses"
        )
    pictures = [read_picture(Path(path), board, mirrored=mirrored) for path in images]
    return camera_from(pictures, [Path(path).name for path in images], board, max_rms_px=max_rms_px)


def camera_from(
    pictures: Sequence[Image], names: Sequence[str], board: Board, *, max_rms_px: float = 0.3
) -> Camera:
    """The camera that took the pictures of a board, black on white; as `calibrate_camera`.

    names: what each picture is called in sentences.
    """
    sizes = {picture.shape for picture in pictures}
    if len(sizes) > 1:
        raise ValueError(
            f"board images differ in size ({sorted(sizes)} px): use pictures of one camera setting"
        )
    seen = _look(list(pictures), board)
    size = (int(pictures[0].shape[1]), int(pictures[0].shape[0]))
    fits, rejected = _fitted(seen.views, size)
    views = [seen.views[i] for i in rejected.kept]
    widths = np.array([
        board_edge_sd(pictures[i], v.points, v.pixels) for i, v in zip(seen.rows, seen.views, strict=True)
    ])  # fmt: skip
    called = [names[i] for i in seen.rows]
    covariance, enlarged = lens.covariance(fits[0], views)
    tilt_deg, coverage = _tilt(fits[0]), area(views) / (size[0] * size[1])
    _accept(fits[0], max_rms_px, [called[i] for i in rejected.kept], tilt_deg, coverage, views=views,
            doubt=lambda: board.doubt(pictures))  # fmt: skip
    scale = _held_out_scale(views, size, fits[0].camera.model)
    _accept_scale(*scale)
    return replace(
        fits[0].camera,
        covariance=covariance,
        covered=_hull(views),
        remarks=(*seen.said, *_left_out(rejected, called, widths), *_uncovered(coverage)),
        notes=(*seen.noted, *_not_found(seen, names), _evidence(fits, enlarged), _checks(tilt_deg, scale)),
    )


def _fitted(views: Sequence[BoardView], size: tuple[int, int]) -> tuple[list[lens.LensFit], Rejected]:
    """Fits with every lens model, best first, to the views that fit together, and which these are."""
    fits: list[lens.LensFit] = []

    def rms(chosen: Sequence[BoardView]) -> Array:
        fits[:] = lens.fit_models(chosen, size)
        return fits[0].view_rms()

    rejected = without_outliers(views, rms)
    return fits, rejected


def read_picture(path: Path, board: Board, *, mirrored: bool = False) -> Image:
    """A board picture in grey, black on white, and left for right where it is mirrored. Raises ValueError
    when there is none."""
    grey = board.black_on_white(read_levels(path))
    return flipped(grey) if mirrored else grey


def _look(pictures: list[Image], board: Board) -> _Seen:
    """The board in all pictures; read in the other usual way where it is not found as stated."""
    plain = _seen(pictures, board)
    for reading in board.other_readings() if len(plain.rows) < MIN_IMAGES else ():
        seen = _seen(pictures, reading.board)
        if len(seen.rows) >= MIN_IMAGES:
            text = (reading.text,)
            return replace(seen, said=text) if reading.asks else replace(seen, noted=text)
    if len(plain.rows) < MIN_IMAGES:
        raise ValueError(_too_few(len(plain.rows), pictures, board))
    return plain


def _seen(pictures: list[Image], board: Board) -> _Seen:
    views = [board.find(picture) for picture in pictures]
    rows = tuple(i for i, view in enumerate(views) if len(view) >= MIN_CORNERS)
    return _Seen(tuple(views[i] for i in rows), rows)


def _left_out(rejected: Rejected, called: Sequence[str], widths: Array) -> list[str]:
    """A sentence for each picture that does not fit the others."""
    sentences = [
        f"{called[row]} was left out of {len(called)} board pictures: its corners fit to {rms:.2f} px, "
        f"those of most others to {rejected.usual:.2f} px; {why(widths, row)}."
        for row, rms in zip(rejected.dropped, rejected.rms, strict=True)
    ]
    if rejected.stays is not None:
        sentences.append(
            f"{called[rejected.stays]} fits the other board pictures badly, but it stays: without it fewer "
            f"than {MIN_LEFT} would be left, or a part of the picture without boards. Photograph the board "
            f"in {max(MIN_LEFT + 1 - len(rejected.kept), 1)} more poses; {why(widths, rejected.stays)}."
        )
    return sentences


def _not_found(seen: _Seen, names: Sequence[str]) -> list[str]:
    """A sentence about pictures that do not show the board."""
    left_out = [name for i, name in enumerate(names) if i not in seen.rows]
    if not left_out:
        return []
    more = ", ..." if len(left_out) > 4 else ""
    return [f"The board was not found in {len(left_out)} pictures: {', '.join(left_out[:4])}{more}."]


def _evidence(fits: list[lens.LensFit], enlarged: float) -> str:
    """A sentence on the lens model and its evidence against the next best."""
    best, others = fits[0], fits[1:]
    sentence = (
        f"The lens model is {_called(best)}, the best of {len(fits)}: its reprojection error is "
        f"{best.camera.rms_px:.3f} px. The next best, {_called(others[0])}, has "
        f"{others[0].camera.rms_px:.3f} px and a BIC that is {others[0].bic - best.bic:.1f} higher."
    )
    if enlarged > 1.2:
        sentence += (
            " Errors differ from picture to picture (board not flat, light), which makes the sds "
            f"{enlarged:.1f} times larger."
        )
    return sentence


def _called(fit: lens.LensFit) -> str:
    return " ".join(fit.camera.model) or "without distortion"


def _checks(tilt_deg: float, scale: tuple[float, float]) -> str:
    sentence = f"The boards are tilted by up to {tilt_deg:.0f} degrees against each other."
    if np.isfinite(scale[0]):
        sentence += (
            f" Lengths on boards that took no part in the fit are off by {100 * scale[0]:.3f} +- "
            f"{100 * scale[1]:.3f} %."
        )
    return sentence


def _uncovered(coverage: float) -> tuple[str, ...]:
    if coverage >= GOOD_COVERAGE:
        return ()
    return (
        f"The boards cover {100 * coverage:.0f} % of the picture. Outside that area the lens is uncertain: "
        "photograph the board in the corners too.",
    )


def _tilt(fit: lens.LensFit) -> float:
    """Largest angle in degrees between two of the boards."""
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in fit.turns])
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0).min())))


def _hull(views: Sequence[BoardView]) -> Array:
    """Convex polygon (k,2) px round all corners."""
    hull = cv2.convexHull(np.concatenate([view.pixels for view in views]).astype(np.float32))
    return np.asarray(hull, dtype=np.float64).reshape(-1, 2)


def _held_out_scale(
    views: Sequence[BoardView], size: tuple[int, int], model: tuple[str, ...]
) -> tuple[float, float]:
    """Mean relative error of lengths on boards that took no part, and its sd; NaN if too few show enough.

    As in a film, the outer corners of a board give the homography, the inner ones are measured with it.
    """
    folds = FOLDS if len(views) >= 3 * FOLDS else len(views)
    errors = []
    for fold in range(folds):
        training = [view for i, view in enumerate(views) if i % folds != fold]
        camera = lens.fit_lens(training, size, model).camera
        errors += [_scale_error(view, camera) for i, view in enumerate(views) if i % folds == fold]
    finite = [error for error in errors if np.isfinite(error)]
    if len(finite) < MIN_IMAGES:
        return np.nan, np.nan
    return float(np.mean(finite)), float(np.std(finite, ddof=1) / np.sqrt(len(finite)))


def _scale_error(view: BoardView, camera: Camera) -> float:
    """Relative size of the inner corners' figure, measured with the homography of the outer ones.

    NaN where the view has too few of them.
    """
    place = view.points[:, :2]
    distance = np.linalg.norm(place - place.mean(axis=0), axis=1)
    inner = distance < np.median(distance)
    if inner.sum() < 4 or (~inner).sum() < 6:
        return np.nan
    ideal = camera.undistort(view.pixels)
    homography = fit_homography(place[~inner], ideal[~inner])
    measured = to_plane(homography[None], ideal[None, inner])[0]
    nominal = place[inner] - place[inner].mean(axis=0)
    return float(np.sum(measured * nominal) / np.sum(nominal**2) - 1.0)


def _accept(
    fit: lens.LensFit,
    limit: float,
    called: Sequence[str],
    tilt_deg: float,
    coverage: float,
    *,
    views: Sequence[BoardView],
    doubt: Callable[[], str],
) -> None:
    if not fit.camera.rms_px <= limit:
        rms = fit.view_rms()
        worst = int(np.argmax(rms))
        others = [view for i, view in enumerate(views) if i != worst]
        raise ValueError(
            f"reprojection error of the board corners is {fit.camera.rms_px:.3f} px, wanted at most "
            f"{limit} px; {called[worst]} is worst with {rms[worst]:.3f} px, most fit to "
            f"{np.median(rms):.3f} px{_wanted(others, fit.camera.size)}; check that the board is flat and "
            f"its squares are as stated{doubt()}"
        )
    if tilt_deg < MIN_TILT_DEG:
        raise ValueError(
            f"the boards are tilted by at most {tilt_deg:.1f} degrees against each other, wanted "
            f"{MIN_TILT_DEG}: the focal length stays unknown; add pictures tilted by 20 to 40 degrees"
        )
    if coverage < MIN_COVERAGE:
        raise ValueError(
            f"the boards cover {100 * coverage:.0f} % of the picture, wanted {100 * MIN_COVERAGE:.0f} %: the "
            "lens stays unknown elsewhere; hold the board nearer and into the corners of the picture"
        )


def _wanted(views: Sequence[BoardView], size: tuple[int, int]) -> str:
    """Pictures that are missing, as a part of a sentence."""
    empty = empty_corners(views, size)
    where = f", some in the {', '.join(empty)} corner of the picture" if empty else ""
    more = max(MIN_LEFT - len(views), 3)
    return f": replace the worst pictures, and take {more} sharp ones more, tilted by 20 to 40 degrees{where}"


def _accept_scale(error: float, sd: float) -> None:
    if abs(error) > MAX_SCALE_ERROR and abs(error) > 3.0 * sd:
        raise ValueError(
            f"lengths on held-out boards are off by {100 * error:.2f} +- {100 * sd:.2f} %, wanted at most "
            f"{100 * MAX_SCALE_ERROR} %: the lens model does not hold from picture to picture; fix focus and "
            "zoom, and take sharp pictures of a flat board all over the picture"
        )


def _too_few(usable: int, pictures: list[Image], board: Board) -> str:
    trouble = picture_trouble(pictures[0])
    return (
        f"{usable} of {len(pictures)} board images show at least {MIN_CORNERS} {board.shows} of the "
        f"{board.columns} x {board.rows} {board.kind} board, wanted {MIN_IMAGES}"
        f"{board.advice(pictures, MIN_IMAGES)}" + (f"; in the first {trouble}" if trouble else "")
    )
