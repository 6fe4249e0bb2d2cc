"""Lay out the calibration board and all markers of twin.toml at true scale, with rulers and cut marks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from twin.drawing.canvas import Paper, text_width, without_letters
from twin.inputs.cameras import dictionary_files, dictionary_name
from twin.inputs.recordings import mark_kind
from twin.messages import Say
from twin.project.cameratables import CameraTable
from twin.project.folder import Project

if TYPE_CHECKING:
    from vision.artwork import Artwork

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4), "a3": (297.0, 420.0)}  # mm
MARGIN = 12.0  # mm, that no printer reaches
FOOT = 22.0  # mm at the bottom, for the ruler and what is said about it
SIDE = 14.0  # mm at the right, for the upright ruler
RULER = 100.0  # mm
GAP, CUT, LABEL = 7.0, 2.5, 2.6  # mm between items, length of a cut mark, height of a letter


@dataclass(frozen=True)
class Item:
    """One thing to cut out, and the lines written below it."""

    art: "Artwork"
    lines: tuple[str, ...]

    @property
    def width(self) -> float:
        return max(self.art.width, *(text_width(line, LABEL) for line in self.lines)) + GAP

    @property
    def height(self) -> float:
        return self.art.height + 1.35 * LABEL * len(self.lines) + CUT + GAP


def run_print(
    project: Project, say: Say, *, paper: Annotated[str, Option(help="a4, letter or a3")] = "a4",
    frame: Annotated[str, Option(help="instead the sheet for the rig: a4, letter or a3")] = "",
) -> dict[str, Any]:  # fmt: skip
    """print.pdf, unless it is there: the board and every marker of twin.toml; with --frame frame.pdf, a sheet
    of markers round a window for the finger, and raw/frame.toml with their places."""
    for option, name in (("--paper", paper), ("--frame", frame or paper)):
        if name not in PAPERS:
            raise ValueError(f"{option} {name!r}: wanted one of {', '.join(PAPERS)}")
    if not project.config.cameras:
        raise ValueError(
            "twin.toml has no [[cameras]]: there is nothing to print for targets measured elsewhere"
        )
    table = project.config.cameras[0]
    if frame:
        from twin.commands.printframe import print_frame

        return print_frame(project, table, say, paper=frame)
    dictionaries = [file for name in _dictionaries(table) for file in dictionary_files(project, name)]
    how: dict[str, Any] = {
        "tables": ("project", "cameras", "frame", "points"), "inputs": dictionaries,
        "extra": {"paper": paper},
    }  # fmt: skip
    done = project.done("print", **how)
    if done is not None:
        say(f"Already done in {project.shown(done)}, skipped.")
        return {"stage": "print", "status": "skipped", "run": project.shown(done)}
    with project.new_run("print", **how) as run:
        items = _items(project, table)
        title = project.config.project.name
        sheets = layout(items, paper=paper, title=title)
        run.write_bytes("print.pdf", sheets.pdf())
        run.summary.update(items=len(items), pages=sheets.pages, paper=paper)
        pages = "page" if sheets.pages == 1 else "pages"
        run.summary["headline"] = f"{len(items)} items on {sheets.pages} {paper.upper()} {pages}"
        missing = without_letters("".join([title, *(line for item in items for line in item.lines)]))
    if missing:
        say(f"The font has no letters for {missing}: write them by hand.")
    say(f"Print the sheets at 100 %, not fitted to the page; both rulers must measure {RULER:.1f} mm.")
    say("Then measure the board's squares and write the length into twin.toml.")
    say(f"Wrote {project.shown(run.path('print.pdf'))}: {run.summary['headline']}")
    return {"stage": "print", "status": "done", "run": project.shown(run.folder)} | run.summary


def _dictionaries(table: CameraTable) -> list[str]:
    return sorted({table.dictionary, *([table.board.dictionary] if table.board else [])})


def _items(project: Project, table: CameraTable) -> list[Item]:
    """Return the board, if the camera has one, and the markers: the finger's, then those of the frame."""

    items = []
    if table.board is not None:
        items.append(_board(project, table))
    config = project.config
    glued = [(point, "finger") for point in config.points if point.seen_mm is None]
    cut = () if config.frame.sheet else config.frame.markers  # those of a sheet are on it
    for mark, role in (*glued, *((marker, marker.role) for marker in cut)):
        what = "dot" if mark.marker is None else f"id {mark.marker}"
        art = mark_kind(mark).artwork(dictionary_name(project, table.dictionary))
        items.append(Item(art, (f"{mark.name}  {what}", f"{role}  {mark.size_mm:g} mm")))
    return items


def _board(project: Project, table: CameraTable) -> Item:
    from vision import Board

    stated = table.board
    assert stated is not None
    name = dictionary_name(project, stated.dictionary)
    board = Board.of(**stated.model_dump() | {"marker_mm": stated.marker_mm or 0.0, "dictionary": name})
    lines = f"board {stated.kind}  {stated.columns} x {stated.rows}  squares {stated.square_mm:g} mm"
    if stated.kind == "charuco":
        lines += f"  markers {stated.marker_mm:g} mm  {stated.dictionary}"
    return Item(board.artwork(), (lines,))


def layout(items: Sequence[Item], *, paper: str, title: str) -> Paper:
    """Sheets with the items in rows; ValueError for one that does not fit on the paper."""
    width, height = PAPERS[paper]
    right, bottom = width - MARGIN - SIDE, height - MARGIN - FOOT
    sheets = Paper(width, height)
    x, y, row = right, bottom, 0.0  # the first item opens a page
    for item in items:
        _check_fits(item, right - MARGIN, bottom - MARGIN, paper)
        if x + item.width > right:
            x, y, row = MARGIN, y + row, 0.0
        if not sheets.pages or y + item.height > bottom:
            _open_page(sheets, title)
            x, y, row = MARGIN, MARGIN, 0.0
        _place(sheets, item, x + CUT, y + CUT)
        x, row = x + item.width, max(row, item.height)
    return sheets


def _check_fits(item: Item, width: float, height: float, paper: str) -> None:
    if item.width > width or item.height > height:
        raise ValueError(
            f"{item.lines[0]}: needs {item.width:.0f} x {item.height:.0f} mm with its labels, "
            f"{paper.upper()} has {width:.0f} x {height:.0f} mm inside its margins: take another paper, swap "
            "columns and rows, or make the squares smaller"
        )


def _place(page: Paper, item: Item, x: float, y: float) -> None:
    """Draw an item with its top left corner at (x, y), marks where to cut, and its lines below."""
    art = item.art
    draw_art(page, art, x, y)
    for across, sideways in ((x, -1), (x + art.width, 1)):
        for down, upwards in ((y, -1), (y + art.height, 1)):
            page.line(across + 0.5 * sideways, down, across + CUT * sideways, down)
            page.line(across, down + 0.5 * upwards, across, down + CUT * upwards)
    for number, line in enumerate(item.lines):
        page.text(x, y + art.height + CUT + (1 + 1.35 * number) * LABEL, line, size=LABEL)


def draw_art(page: Paper, art: "Artwork", x: float, y: float) -> None:
    """Fill the shapes of an artwork whose top left corner lies at (x, y)."""
    for layer in art.layers:
        page.shapes(
            [(x + a, y + b, w, h) for a, b, w, h in layer.rectangles.tolist()],
            [(x + a, y + b, r) for a, b, r in layer.circles.tolist()],
            black=layer.black,
        )


def _open_page(sheets: Paper, title: str) -> None:
    """Begin a sheet with its rulers and what to do with them."""
    sheets.new_page()
    foot = sheets.height - MARGIN
    draw_ruler(sheets, MARGIN, foot - 8.0, RULER, upright=False)
    draw_ruler(sheets, sheets.width - MARGIN - 4.0, MARGIN, RULER, upright=True)
    sheets.text(MARGIN, foot, f"{title}, page {sheets.pages}: print at 100 %, not fitted to the page. "
                f"Each ruler must measure {RULER:.1f} mm.", size=LABEL)  # fmt: skip


def draw_ruler(page: Paper, x: float, y: float, length: float, *, upright: bool) -> None:
    """Draw a line of that length in mm with a tick at every mm, from (x, y) to the right or down."""

    def line(start: float, end: float, off: float) -> None:
        ends = ((start, -off), (end, 0.0))
        (a, b), (c, d) = ((v, u) for u, v in ends) if upright else ends
        page.line(x + a, y + b, x + c, y + d)

    line(0.0, length, 0.0)
    for tick in range(int(length) + 1):
        line(tick, tick, 4.0 if tick % 10 == 0 else 2.8 if tick % 5 == 0 else 1.8)
