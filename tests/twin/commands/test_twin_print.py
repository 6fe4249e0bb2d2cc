"""twin print: what stands on the paper, drawn by poppler and measured."""

import subprocess

import cv2
import numpy as np
import pytest

from tests.messages import Lines, saying
from twin import files
from twin.commands.init import film_config
from twin.commands.print import RULER, Item, layout, run_print
from twin.marktables import PointTable
from twin.project.cameratables import BoardTable
from twin.project.config import ProjectTable
from twin.project.folder import Project
from twin.project.toml import dump
from vision import Board, locate
from vision.kinds import CodedMarker, PlainDot
from vision.marks import detect

DPI = 254
PX = DPI / 25.4  # px per mm


@pytest.fixture
def pages_of(tmp_path, require):
    """`pages_of(data)`: the pages (h,w) of a PDF as poppler draws them at DPI."""
    require("pdftoppm")

    def draw(data):
        folder = tmp_path / "drawn"
        folder.mkdir()
        (folder / "print.pdf").write_bytes(data)
        subprocess.run(
            ["pdftoppm", "-r", str(DPI), "-gray", str(folder / "print.pdf"), str(folder / "page")], check=True
        )
        return [cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) for p in sorted(folder.glob("page*"))]

    return draw


def make(folder, **board):
    config = film_config("batch")
    camera = config.cameras[0]
    if board:
        camera = camera.model_copy(update={"board": BoardTable(**board)})
    dot = PointTable(name="dot", node=1019, size_mm=3.0)
    config = config.model_copy(update={"cameras": (camera,), "points": (*config.points, dot)})
    files.write_text(folder / "twin.toml", dump(config))
    return Project.open(folder)


def check_page(picture, project):
    """Every marker at its size, the dot, the board's squares, and both rulers."""
    found, _ = detect(picture, "DICT_4X4_50")
    config = project.config
    wanted = {p.marker: p.size_mm for p in config.points} | {
        m.marker: m.size_mm for m in config.frame.markers
    }
    wanted.pop(None)
    # ids 0, 1 and 20 to 26 are on the board too: a marker seen twice is left out
    alone = {marker for marker in wanted if marker > 26}
    assert alone <= set(found)
    for marker in alone:
        side = np.linalg.norm(np.diff(found[marker], axis=0), axis=1) / PX
        np.testing.assert_allclose(side, wanted[marker], atol=0.1)  # corners to half a pixel of 0.1 mm
    stated = config.cameras[0].board
    board = Board.of(**stated.model_dump() | {"marker_mm": stated.marker_mm or 0.0})
    view = board.find(picture)  # found beside markers with the same ids, from those seen once
    assert len(view) >= 0.5 * (stated.columns - 1) * (stated.rows - 1)  # nine of 27 markers are seen twice
    span = np.linalg.norm(view.pixels[-1] - view.pixels[0]) / PX
    assert span == pytest.approx(np.linalg.norm(view.points[-1] - view.points[0]), abs=0.02)
    check_rulers(picture)


def check_rulers(picture):
    """First and last tick of both rulers, as the outermost dark marks along a line through all ticks."""
    height, width = picture.shape
    low = picture[round(height - (12 + 8 + 0.9) * PX)]  # 0.9 mm above the ruler's line
    right = picture[:, round(width - (12 + 4 + 0.9) * PX)]
    for line in (low[: round(120 * PX)], right[: round(120 * PX)]):
        dark = np.flatnonzero(line < 200)
        ticks = np.split(dark, np.flatnonzero(np.diff(dark) > 3) + 1)
        assert len(ticks) == 101
        places = np.array([tick.mean() for tick in ticks]) / PX
        assert places[-1] - places[0] == pytest.approx(RULER, abs=0.1)  # a pixel is 0.085 mm
        assert np.std(np.diff(places)) < 0.05


def test_board_and_markers_at_true_scale(tmp_path, pages_of):
    project = make(tmp_path)
    say = Lines()
    result = run_print(project, say)
    assert (result["items"], result["pages"]) == (14, 1)
    (picture,) = pages_of((tmp_path / result["run"] / "print.pdf").read_bytes())
    np.testing.assert_allclose(picture.shape, (297 * PX, 210 * PX), atol=1.01)  # poppler rounds up
    check_page(picture, project)
    assert any("both rulers must measure 100.0 mm" in line for line in say)
    assert run_print(project, Lines())["status"] == "skipped"


def test_another_paper_has_the_same_scale(tmp_path, pages_of):
    project = make(tmp_path)
    result = run_print(project, Lines(), paper="letter")
    (picture,) = pages_of((tmp_path / result["run"] / "print.pdf").read_bytes())
    np.testing.assert_allclose(picture.shape, (279.4 * PX, 215.9 * PX), atol=1.01)
    check_page(picture, project)


def test_the_same_sheets_are_the_same_file(tmp_path):
    items = [Item(PlainDot(8.0).artwork("DICT_4X4_50"), ("dot",))]
    one, two = (layout(items, paper="a4", title="t").pdf() for _ in range(2))
    assert one == two
    assert b"/PrintScaling /None" in one


def test_names_in_greek_and_cyrillic_are_printed(tmp_path, require, pages_of):
    require("pdftotext")
    names = ("δάχτυλο α", "палец Ж", "Zürich")
    items = [Item(PlainDot(8.0).artwork("DICT_4X4_50"), (name,)) for name in names]
    data = layout(items, paper="a4", title="проба").pdf()
    (tmp_path / "names.pdf").write_bytes(data)
    command = ["pdftotext", "-enc", "UTF-8", str(tmp_path / "names.pdf"), "-"]
    text = subprocess.run(command, check=True, capture_output=True).stdout.decode("utf-8")
    assert [name for name in (*names, "проба") if name not in text] == []
    # drawn, not only stored: each has ink where its letters are, and no two are alike
    (picture,) = pages_of(data)
    ink = picture < 128
    top, step = round((12 + 2.5 + items[0].art.height + 2.5) * PX), round(3.0 * PX)
    starts = np.cumsum([0.0, *(item.width for item in items)])[:-1] + 12 + 2.5
    cells = [ink[top : top + step, round(x * PX) : round((x + 15) * PX)] for x in starts]
    assert min(cell.sum() for cell in cells) > 200
    assert (cells[0] != cells[1]).mean() > 0.05


def test_letters_that_the_font_lacks_are_said(tmp_path):
    project = make(tmp_path)
    named = project.config.model_copy(update={"project": ProjectTable(name="手指")})
    say = Lines()
    run_print(Project(tmp_path, named), say)
    assert any("手指" in line and "write them by hand" in line for line in say)


@pytest.mark.parametrize("dictionary", ["DICT_4X4_50", "DICT_APRILTAG_36h11"])
def test_markers_measure_what_is_said(dictionary, pages_of):
    ids = [0, 1, 2, 33]
    items = [Item(CodedMarker(i, 5.5 + i % 3).artwork(dictionary), (f"id {i}",)) for i in ids]
    (picture,) = pages_of(layout(items, paper="a4", title="t").pdf())
    found = locate(picture, dictionary=dictionary)
    assert found.ids.tolist() == ids
    assert not found.inverted.any()
    for marker, centre in zip(ids, found.centre, strict=True):
        side = (5.5 + marker % 3) * PX
        low, high = (centre - 0.75 * side).astype(int), (centre + 0.75 * side).astype(int)
        part = picture[low[1] : high[1], low[0] : high[0]].astype(float)
        # The border is black all round: the middle rows and columns of the picture show both its edges.
        ink = (255 - part) / 255
        edge = ink[:, round(len(ink) / 2) - 2 : round(len(ink) / 2) + 2].mean(axis=1)
        outer = np.flatnonzero(edge > 0.5)
        assert (outer[-1] - outer[0] + 1) / PX == pytest.approx(5.5 + marker % 3, abs=0.1)


@pytest.mark.parametrize("kind", ["chessboard", "circles", "acircles"])
def test_other_boards(kind, pages_of):
    board = Board.of(columns=4, rows=7, square_mm=14.0, kind=kind)
    pages = layout([Item(board.artwork(), ("board",))], paper="a4", title="t")
    (picture,) = pages_of(pages.pdf())
    view = board.find(np.asarray(cv2.resize(picture, None, fx=0.3, fy=0.3, interpolation=cv2.INTER_AREA)))
    assert len(view) == 28
    step = np.linalg.norm(np.diff(view.pixels, axis=0), axis=1) / (0.3 * PX)
    nominal = np.linalg.norm(np.diff(view.points, axis=0), axis=1)
    np.testing.assert_allclose(step, nominal, atol=0.06)  # 0.2 px at 3.5 px/mm


def test_a_long_list_goes_on_over_pages(pages_of):
    items = [Item(CodedMarker(i % 50, 20.0).artwork("DICT_4X4_50"), (f"{i}",)) for i in range(50)]
    pictures = list(pages_of(layout(items, paper="a4", title="t").pdf()))
    assert len(pictures) == 2
    seen = [set(detect(picture, "DICT_4X4_50")[0]) for picture in pictures]
    assert seen[0] | seen[1] == set(range(50))
    assert not seen[0] & seen[1]


def test_dots_are_round_and_measure_what_is_said(pages_of):
    (picture,) = pages_of(layout([Item(PlainDot(8.0).artwork("DICT_4X4_50"), ("dot",))], paper="a4", title="t").pdf())
    top = picture[: round(40 * PX), : round(60 * PX)]
    _, _, stats, _ = cv2.connectedComponentsWithStats((top < 128).astype(np.uint8))
    *_, width, height, area = max(stats[1:].tolist(), key=lambda s: s[-1])
    assert width / PX == pytest.approx(8.0, abs=0.15)
    assert height / PX == pytest.approx(8.0, abs=0.15)
    assert area / PX**2 == pytest.approx(np.pi * 16.0, rel=0.01)


def test_what_cannot_be_printed_is_said(tmp_path):
    with pytest.raises(ValueError, match=saying("12", "9", "54", "DICT_4X4_50", "50")):
        run_print(make(tmp_path, columns=12, rows=9, square_mm=25.0, marker_mm=18.0), Lines())
    project = make(tmp_path, columns=9, rows=11, square_mm=25.0, marker_mm=18.0)
    with pytest.raises(
        ValueError, match=r"board charuco  9 x 11 .* mm inside its margins: take another paper"
    ):
        run_print(project, Lines())
    assert run_print(project, Lines(), paper="a3")["pages"] == 1
    with pytest.raises(ValueError, match=saying("--paper", "'a5'", "a4", "a3")):
        run_print(project, Lines(), paper="a5")
    with pytest.raises(ValueError, match=saying("50", "DICT_4X4_50", "0", "49")):
        CodedMarker(50, 6.0).artwork("DICT_4X4_50")
