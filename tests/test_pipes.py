"""A FIFO or a device in the place of a file is refused at once by the readers of vision and fe; those of twin are
tried beside their formats, and calibrate reads no file."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fe.deck.reader import read_deck
from vision import Video
from vision.calibration.camerafile import read_camera
from vision.dictionaries import dictionary_of
from vision.film.series import open_film, read_picture

READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "film": ("film.mp4", lambda folder: Video(folder / "film.mp4")),
    "picture": ("f1.png", lambda folder: read_picture(folder / "f1.png")),
    "picture of a film": ("f1.png", lambda folder: list(open_film(folder, fps=10.0).frames())),
    "times of pictures": ("times.csv", lambda folder: list(open_film(folder, fps=10.0).frames())),
    "lens": ("lens.yml", lambda folder: read_camera(folder / "lens.yml", name="side", size=(640, 480))),
    "lens in TOML": ("lens.toml", lambda folder: read_camera(folder / "lens.toml", name="side", size=(640, 480))),
    "dictionary": ("words.yml", lambda folder: dictionary_of(str(folder / "words.yml"))),
    "deck": ("deck.inp", lambda folder: read_deck(folder / "deck.inp")),
    "what a deck includes": ("mesh.inc", lambda folder: read_deck(folder / "tube.inp")),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["FIFO", "device"])
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused(reader: str, kind: str, tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "f0.png"), np.zeros((10, 20), np.uint8))
    (tmp_path / "tube.inp").write_bytes((Path(__file__).parent / "corpora" / "deck" / "tube.inp").read_bytes())
    name, read = READERS[reader]
    if kind == "FIFO":
        os.mkfifo(tmp_path / name)
    else:
        (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(ValueError, match=r"no file|no such file|does not exist|not in the folder") as error:
        read(tmp_path)
    assert name in str(error.value)
