"""twin print --frame: what is on the sheet, drawn by poppler, is what twin.toml takes from frame.toml."""

import subprocess

import cv2
import numpy as np
import pytest

from tests.messages import Lines, saying
from twin import files
from twin.bodies.finger import FingerTable
from twin.commands.init import film_config
from twin.commands.print import run_print
from twin.marktables import FrameTable
from twin.project.folder import Project
from twin.project.framesheet import UNMEASURED, said_of_sheet
from twin.project.toml import dump
from vision import locate
from vision.plane import fit_homography, to_plane

PX = 10.0  # a mm
FREE = FrameTable(sheet="raw/frame.toml", ruler_mm=(250.0, 160.0))


def make(folder, frame=None, **model):
    config = film_config("batch")
    if frame is not None:
        config = config.model_copy(update={"frame": frame})
    config = config.model_copy(update={"model": config.model.model_copy(update=model)})
    folder.mkdir(exist_ok=True)
    files.write_text(folder / "twin.toml", dump(config))
    return Project.open(folder)


@pytest.fixture
def sheet(tmp_path):
    """Folder of a project whose sheet is printed, and the run of it."""
    result = run_print(make(tmp_path / "p"), Lines(), frame="a4")
    return tmp_path / "p", tmp_path / "p" / result["run"]


def places(project):
    return {m.marker: np.array(m.position_mm) for m in project.config.frame.markers}


def test_the_markers_lie_where_frame_toml_says(sheet, require):
    require("pdftoppm")
    folder, run = sheet
    subprocess.run(
        ["pdftoppm", "-r", str(25.4 * PX), "-gray", "-singlefile", str(run / "frame.pdf"), str(run / "page")],
        check=True,
    )
    picture = cv2.imread(str(run / "page.pgm"), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_allclose(picture.shape, (210 * PX, 297 * PX), atol=1.01)
    found = locate(picture, dictionary="DICT_4X4_50")
    seen = dict(zip(found.ids.tolist(), found.centre, strict=True))
    project = make(folder, FREE)
    stated = places(project)
    assert set(stated) == set(seen)
    roles = [m.role for m in project.config.frame.markers]
    assert roles.count("frame") >= 6
    assert roles.count("fixed") >= 4
    # at true scale and upright: one mm is PX pixels to the right, and z goes up
    one = min(stated)
    for marker, place in stated.items():
        moved = (seen[marker] - seen[one]) / PX * (1.0, -1.0)
        np.testing.assert_allclose((place - stated[one])[[0, 2]], moved, atol=0.01)
    # the lines that say where the finger goes: its clamp and its bottom cross at the origin
    order = sorted(stated)
    to_mm = np.linalg.inv(fit_homography(np.array([stated[k][[0, 2]] for k in order]),
                                         np.array([seen[k] for k in order])))  # fmt: skip
    dark = np.argwhere(picture < 100)[:, ::-1]
    mm = to_plane(np.linalg.inv(to_mm)[None], dark[None].astype(float))[0]
    clamp = mm[(np.abs(mm[:, 0]) < 0.8) & (mm[:, 1] > 31.5) & (mm[:, 1] < 33.5)]  # above the letters
    assert np.median(clamp[:, 0]) == pytest.approx(0.0, abs=0.1)
    bottom = mm[(np.abs(mm[:, 1]) < 0.6) & (mm[:, 0] < -13.0) & (mm[:, 0] > -17.0)]
    assert np.median(bottom[:, 1]) == pytest.approx(0.0, abs=0.1)


def test_rulers_scale_the_places_and_the_budget(sheet):
    folder, _ = sheet
    printed, drawn = make(folder, FREE.model_copy(update={"ruler_mm": (247.5, 160.8)})), make(folder, FREE)
    for marker, place in places(drawn).items():
        np.testing.assert_allclose(places(printed)[marker], place * (0.99, 1.0, 1.005), atol=1e-3)
    sizes = [m.size_mm for m in printed.config.frame.markers]
    np.testing.assert_allclose(sizes, 10.0 * np.sqrt(0.99 * 1.005))
    assert drawn.config.measure.frame_sd_mm == 0.1
    assert drawn.config.measure.scale_sd == 0.001
    # a better printer, whose rulers nobody measured
    text = (folder / "raw" / "frame.toml").read_text().replace("sd_mm = 0.1", "sd_mm = 0.03")
    (folder / "raw" / "frame.toml").write_text(text)
    loose = make(folder, FrameTable(sheet="raw/frame.toml"))
    assert loose.config.measure.frame_sd_mm == 0.03
    assert loose.config.measure.scale_sd == pytest.approx(np.hypot(0.001, UNMEASURED))
    assert "Nobody measured its rulers" in said_of_sheet(loose.config)
    # effects are written without the sheet's markers, and its places stay
    assert loose.set_effects(["creep:1"]).config.frame == loose.config.frame
    assert "\n[[frame.markers]]" not in (folder / "twin.toml").read_text()
    run_print(loose, Lines(), frame="a4")  # the same sheet: what was corrected in it stays
    assert (folder / "raw" / "frame.toml").read_text() == text


def test_a_finger_to_the_left_is_seen_from_the_other_side(sheet):
    folder, _ = sheet
    right, left = (make(folder, FREE.model_copy(update={"finger": side})) for side in ("right", "left"))
    there, here = places(right), places(left)
    top = sorted(there)[:6]  # along the top, from left to right
    np.testing.assert_allclose([here[k][0] for k in top], [there[k][0] for k in top[::-1]], atol=1e-3)
    assert {place[1] for place in there.values()} == {-11.5}  # half the finger's width
    assert {place[1] for place in here.values()} == {11.5}
    behind = make(folder, FREE.model_copy(update={"y_mm": 4.0}))
    assert {place[1] for place in places(behind).values()} == {4.0}


def test_what_cannot_be_is_said(sheet):
    folder, _ = sheet
    with pytest.raises(ValueError, match=saying("ruler_mm", "250", "160", "exchange")):
        make(folder, FREE.model_copy(update={"ruler_mm": (160.0, 250.0)}))
    with pytest.raises(ValueError, match=saying("raw/elsewhere.toml", "does not exist", "--frame a4")):
        make(folder, FREE.model_copy(update={"sheet": "raw/elsewhere.toml"}))
    with pytest.raises(ValueError, match=saying("frame.sheet", "frame.markers", "keep one")):
        FrameTable(sheet="raw/frame.toml", markers=film_config("b").frame.markers)
    with pytest.raises(ValueError, match=saying("ruler_mm", "sheet")):
        FrameTable(ruler_mm=(250.0, 160.0))
    taller = make(folder, FREE, finger=FingerTable(height_mm=30.0))
    with pytest.raises(ValueError, match=saying("raw/frame.toml", "another sheet", "move it away")):
        run_print(taller, Lines(), frame="a4")
    long = make(folder, FREE, finger=FingerTable(length_mm=220.0))
    with pytest.raises(ValueError, match=saying("--frame a4", "220 mm long", "take a larger one")):
        run_print(long, Lines(), frame="a4")
    with pytest.raises(ValueError, match=saying("--frame", "'a5'", "a4")):
        run_print(long, Lines(), frame="a5")
