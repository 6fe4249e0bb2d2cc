"""How sharp a picture of a board is: the width of its edges along both of the board's axes."""

import cv2
import numpy as np

from vision.boards.board import BoardView
from vision.camera import Image
from vision.plane import fit_homography

CALM_PX = 0.7  # sd of the Gaussian before slopes are taken: noise has slopes too
EDGES = 98.0  # percentile of the slopes inside a board that is an edge


def blur_px(picture: Image, view: BoardView) -> float:
    """Sd in px of the edges of a board in a picture (h,w), of the worse of its two axes.

    A step of c grey levels blurred with an sd of s has the slope c / (s sqrt(2 pi)). Motion blurs along one
    direction, which the worse axis shows.
    """
    low = np.maximum(np.floor(view.pixels.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(view.pixels.max(axis=0)).astype(int) + 1, picture.shape[::-1])
    part = np.asarray(picture[low[1] : high[1], low[0] : high[0]], dtype=np.float32)
    if min(part.shape) < 8:
        return np.inf
    calm = np.asarray(cv2.GaussianBlur(part, (0, 0), CALM_PX), dtype=np.float64)
    down, right = np.gradient(calm)
    dark, light = np.percentile(calm, (2.0, 98.0))
    homography = fit_homography(view.points[:, :2], view.pixels)
    middle = homography @ (*view.points[:, :2].mean(axis=0), 1.0)
    along = homography[:2, :2] / middle[2] - np.outer(middle[:2] / middle[2], homography[2, :2]) / middle[2]
    across = np.linalg.inv(along)  # its rows stand on the board's lines
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    steep = [float(np.percentile(np.abs(x * right + y * down), EDGES)) for x, y in across]
    wide = float(light - dark) / (max(min(steep), 1e-6) * np.sqrt(2.0 * np.pi))
    return float(np.sqrt(max(wide**2 - CALM_PX**2, 0.0)))
