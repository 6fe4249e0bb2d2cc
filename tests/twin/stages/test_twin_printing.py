"""twin print: what stands on the paper, read back from the PDF by a small reader and by poppler, and measured."""

import re
import subprocess

import cv2
import numpy as np
import pytest

from twin.project import files
from twin.project.config import BoardTable, PointTable
from twin.project.folder import Project
from twin.project.toml import dump
from twin.stages.printing import RULER, layout, run_print
from twin.stages.starting import film_config
from vision import Board, locate
from vision.kinds.coded import CodedMarker
from vision.kinds.plaindot import PlainDot
from vision.marks import detect

DPI = 254
PX = DPI / 25.4  # px per mm
FINE = 4  # fine pixels to a pixel


class Lines(list):
    """A say that keeps its lines."""

    def __call__(self, text):
        self.append(text)


def pages_of(data):
    """Draw the pages of a PDF (h,w) at DPI: numbers and the operators cm re m l c h f S g, no text."""
    offset = int(re.search(rb"startxref\n(\d+)", data)[1])
    table = re.findall(rb"(\d{10}) 00000 n ", data[offset:])
    objects = [data[int(at) :].split(b"endobj", 1)[0] for at in table]
    assert [int(body.split()[0]) for body in objects] == list(range(1, len(objects) + 1))
    boxes = [re.search(rb"MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", body) for body in objects]
    contents = [re.search(rb"/Contents (\d+) 0 R", body) for body in objects]
    for box, content in zip(boxes, contents, strict=True):
        if box:
            body = objects[int(content[1]) - 1]
            length = int(re.search(rb"/Length (\d+)", body)[1])
            stream = body.split(b"stream\n", 1)[1]
            assert stream[length:].startswith(b"\nendstream")
            yield drawn(stream[:length].decode("cp1252"), float(box[1]), float(box[2]))


def drawn(stream, width, height):
    """Rectangles and upright or level lines by whole fine pixels, circles as polygons; then averaged."""
    scale = FINE * DPI / 72.0
    picture = np.full((round(height * scale), round(width * scale)), 255, dtype=np.uint8)
    stack, boxes, rings, unit, colour, pen = [], [], [], 1.0, 0, 0.0
    for word in re.sub(r"BT .*? ET", "", stream).split():
        if re.fullmatch(r"-?[\d.]+", word):
            stack.append(float(word))
            continue
        if word == "cm":
            unit = stack[0] * scale
        elif word == "g":
            colour = 255 * int(stack[0])
        elif word == "w":
            pen = stack[0]
        elif word == "re":
            boxes.append(stack)
        elif word == "m":
            rings.append([np.array(stack)])
        elif word == "l":
            (x, y), (u, v) = rings.pop()[0], stack
            assert x == u or y == v
            boxes.append([min(x, u) - pen / 2, min(y, v) - pen / 2, abs(x - u) + pen, abs(y - v) + pen])
        elif word == "c":
            b, c, d = np.array(stack).reshape(3, 2)
            a = rings[-1][-1]
            rings[-1] += [
                (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t * t * c + t**3 * d
                for t in np.linspace(0, 1, 17)[1:]
            ]
        elif word in "fS":
            for x, y, w, h in boxes:
                rows = [round(picture.shape[0] - z * unit) for z in (y + h, y)]
                columns = [round(z * unit) for z in (x, x + w)]
                picture[slice(*rows), slice(*columns)] = colour if word == "f" else 0
            for ring in rings:
                flat = np.array(ring) * (unit, -unit) + (0, picture.shape[0])
                cv2.fillPoly(picture, [flat.round().astype(np.int32)], colour)
            boxes, rings = [], []
        stack = []
    size = (round(width * DPI / 72.0), round(height * DPI / 72.0))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))


def poppler(path, folder):
    subprocess.run(["pdftoppm", "-r", str(DPI), "-gray", str(path), str(folder / "page")], check=True)
    return [cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) for p in sorted(folder.glob("page*"))]


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


def test_board_and_markers_at_true_scale(tmp_path):
    project = make(tmp_path)
    say = Lines()
    result = run_print(project, say)
    assert (result["items"], result["pages"]) == (14, 1)
    (picture,) = pages_of((tmp_path / result["run"] / "print.pdf").read_bytes())
    assert picture.shape == (round(297 * PX), round(210 * PX))
    check_page(picture, project)
    assert any("both rulers must measure 100.0 mm" in line for line in say)
    assert run_print(project, Lines())["status"] == "skipped"


def test_poppler_sees_the_same(tmp_path, require):
    require("pdftoppm")
    project = make(tmp_path)
    result = run_print(project, Lines(), paper="letter")
    (picture,) = poppler(tmp_path / result["run"] / "print.pdf", tmp_path)
    assert picture.shape == (round(279.4 * PX), round(215.9 * PX))
    check_page(picture, project)


@pytest.mark.parametrize("dictionary", ["DICT_4X4_50", "DICT_APRILTAG_36h11"])
def test_markers_measure_what_is_said(dictionary):
    from twin.review.pdf import pdf_bytes
    from twin.stages.printing import Item

    ids = [0, 1, 2, 33]
    items = [Item(CodedMarker(i, 5.5 + i % 3).artwork(dictionary), (f"id {i}",)) for i in ids]
    (picture,) = pages_of(pdf_bytes(layout(items, paper="a4", title="t")))
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
def test_other_boards(kind):
    from twin.review.pdf import pdf_bytes
    from twin.stages.printing import Item

    board = Board.of(columns=4, rows=7, square_mm=14.0, kind=kind)
    pages = layout([Item(board.artwork(), ("board",))], paper="a4", title="t")
    (picture,) = pages_of(pdf_bytes(pages))
    view = board.find(np.asarray(cv2.resize(picture, None, fx=0.3, fy=0.3, interpolation=cv2.INTER_AREA)))
    assert len(view) == 28
    step = np.linalg.norm(np.diff(view.pixels, axis=0), axis=1) / (0.3 * PX)
    nominal = np.linalg.norm(np.diff(view.points, axis=0), axis=1)
    np.testing.assert_allclose(step, nominal, atol=0.06)  # 0.2 px at 3.5 px/mm


def test_a_long_list_goes_on_over_pages():
    from twin.review.pdf import pdf_bytes
    from twin.stages.printing import Item

    items = [Item(CodedMarker(i % 50, 20.0).artwork("DICT_4X4_50"), (f"{i}",)) for i in range(50)]
    pictures = list(pages_of(pdf_bytes(layout(items, paper="a4", title="t"))))
    assert len(pictures) == 2
    seen = [set(detect(picture, "DICT_4X4_50")[0]) for picture in pictures]
    assert seen[0] | seen[1] == set(range(50))
    assert not seen[0] & seen[1]


def test_dots_are_round_and_measure_what_is_said():
    from twin.review.pdf import pdf_bytes
    from twin.stages.printing import Item

    (picture,) = pages_of(pdf_bytes(layout([Item(PlainDot(8.0).artwork("DICT_4X4_50"), ("dot",))], paper="a4", title="t")))
    top = picture[: round(40 * PX), : round(60 * PX)]
    _, _, stats, _ = cv2.connectedComponentsWithStats((top < 128).astype(np.uint8))
    *_, width, height, area = max(stats[1:].tolist(), key=lambda s: s[-1])
    assert width / PX == pytest.approx(8.0, abs=0.15)
    assert height / PX == pytest.approx(8.0, abs=0.15)
    assert area / PX**2 == pytest.approx(np.pi * 16.0, rel=0.01)


def test_what_cannot_be_printed_is_said(tmp_path):
    with pytest.raises(ValueError, match="12 x 9 squares needs 54 markers, DICT_4X4_50 has 50"):
        run_print(make(tmp_path, columns=12, rows=9, square_mm=25.0, marker_mm=18.0), Lines())
    project = make(tmp_path, columns=9, rows=11, square_mm=25.0, marker_mm=18.0)
    with pytest.raises(
        ValueError, match=r"board charuco  9 x 11 .* mm inside its margins: take another paper"
    ):
        run_print(project, Lines())
    assert run_print(project, Lines(), paper="a3")["pages"] == 1
    with pytest.raises(ValueError, match="--paper 'a5': wanted one of a4, letter, a3"):
        run_print(project, Lines(), paper="a5")
    with pytest.raises(ValueError, match="marker 50 is not in DICT_4X4_50: it has ids 0 to 49"):
        CodedMarker(50, 6.0).artwork("DICT_4X4_50")
