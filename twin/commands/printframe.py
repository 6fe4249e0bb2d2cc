"""The printed sheet that is the rig's frame of reference, as `twin print --frame` writes it."""

from typing import Any

from twin import files
from twin.commands.print import FOOT, LABEL, MARGIN, PAPERS, SIDE, draw_art, draw_ruler
from twin.drawing.canvas import Paper
from twin.drawing.framepaper import FramePaper, frame_paper
from twin.inputs.cameras import dictionary_files, dictionary_name
from twin.messages import Say
from twin.project.cameratables import CameraTable
from twin.project.folder import Project
from twin.project.framesheet import SheetMarker, SheetTable, read_sheet

SIDE_MM, PRINTED_MM = 10.0, 0.1  # side of a marker, and sd of its centre, printed
TICK = 6.0  # mm, length of the lines that say where the finger goes


def print_frame(project: Project, table: CameraTable, say: Say, *, paper: str) -> dict[str, Any]:
    """frame.pdf in a run, and raw/frame.toml, which another sheet never replaces."""
    how: dict[str, Any] = {
        "tables": ("project", "cameras", "model", "points"),
        "inputs": dictionary_files(project, table.dictionary), "extra": {"frame": paper},
    }  # fmt: skip
    sheet, laid = _sheet(project, table, paper)
    place = project.root / "raw" / "frame.toml"
    if place.is_file() and read_sheet(place).model_copy(update={"sd_mm": PRINTED_MM}) != sheet:
        raise ValueError(
            f"{project.shown(place)} is of another sheet: a rig that has that one needs it; else move it "
            "away, and print again"
        )
    if not place.is_file():
        place.parent.mkdir(exist_ok=True)
        files.write_text(place, sheet.text())
    with project.new_run("print", **how) as run:
        run.write_bytes("frame.pdf", _page(project, table, sheet, laid, paper).pdf())
        run.summary.update(markers=len(sheet.markers), paper=paper)
        run.summary["headline"] = f"{len(sheet.markers)} markers round a window on {paper.upper()}"
    say(f"Wrote {project.shown(run.path('frame.pdf'))} ({run.summary['headline']}) and raw/frame.toml.")
    say("Print it at 100 %, cut out the window, and glue it flat on the rig, in the plane of the finger's "
        "side face. Measure both rulers.")  # fmt: skip
    say("This goes into twin.toml in place of all [[frame.markers]]; `twin setup` writes it:")
    say('  [frame]\n  sheet = "raw/frame.toml"\n  ruler_mm = [across, upright]')
    return {"stage": "print", "status": "done", "run": project.shown(run.folder)} | run.summary


def _sheet(project: Project, table: CameraTable, paper: str) -> tuple[SheetTable, FramePaper]:
    """The sheet of a paper that lies on its long side, and where all is on it; ValueError where the finger or
    the dictionary is too large or too small."""
    from vision.dictionaries import dictionary_of

    body = project.config.model.dimensions
    length, height = (float(getattr(body, key, d)) for key, d in (("length_mm", 110.0), ("height_mm", 25.0)))
    left, top, right, bottom = free = _free(paper)
    try:
        laid = frame_paper(free, side=_art(project, table, 0).width, length=length, height=height)
    except ValueError as small:
        raise ValueError(f"--frame {paper}: {small}: take a larger one, or glue loose markers on") from None
    words = dictionary_of(dictionary_name(project, table.dictionary)).bytesList
    taken, count = {point.marker for point in project.config.points}, len(laid.places)
    codes = [k for k in range(len(words)) if k not in taken][-count:]
    if len(codes) < count:
        raise ValueError(f"--frame {paper}: wanted {count} markers, {table.dictionary} has {len(codes)} left")
    markers = tuple(
        SheetMarker(marker=code, role="fixed" if fixed else "frame", place_mm=(x, z))
        for code, fixed, (x, z) in zip(codes, laid.fixed, laid.up.round(3).tolist(), strict=True)
    )
    rulers = 10.0 * ((right - left) // 10), 10.0 * ((bottom - top) // 10)
    return SheetTable(size_mm=SIDE_MM, sd_mm=PRINTED_MM, ruler_mm=rulers, clamp_mm=round(laid.clamp, 3),
                      markers=markers), laid  # fmt: skip


def _free(paper: str) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of what the markers may fill, mm."""
    height, width = PAPERS[paper]
    return MARGIN, MARGIN, width - MARGIN - SIDE, height - MARGIN - FOOT


def _art(project: Project, table: CameraTable, code: int) -> Any:
    from vision.kinds import CodedMarker

    return CodedMarker(code, SIDE_MM).artwork(dictionary_name(project, table.dictionary))


def _page(project: Project, table: CameraTable, sheet: SheetTable, laid: FramePaper, paper: str) -> Paper:
    height, width = PAPERS[paper]
    page = Paper(width, height)
    page.new_page()
    for mark, (x, y) in zip(sheet.markers, laid.places, strict=True):
        art = _art(project, table, mark.marker)
        draw_art(page, art, x - art.width / 2, y - art.height / 2)
    _draw_window(page, laid)
    assert sheet.ruler_mm is not None  # what is printed has rulers
    (across, upright), foot = sheet.ruler_mm, height - MARGIN
    draw_ruler(page, MARGIN, foot - 10.0, across, upright=False)
    draw_ruler(page, width - MARGIN - 4.0, MARGIN, upright, upright=True)
    page.text(MARGIN, foot - 4.0, f"{project.config.project.name}: print at 100 %, cut out the window, glue "
              "flat in the plane of the finger's side face.", size=LABEL)  # fmt: skip
    page.text(MARGIN, foot, f"Rulers {across:.1f} mm across and {upright:.1f} mm upright: measure both, "
              "write them into twin.toml as ruler_mm.", size=LABEL)  # fmt: skip
    return page


def _draw_window(page: Paper, laid: FramePaper) -> None:
    """The window to cut out, and where the finger goes: its bottom, and its clamp on either side."""
    left, top, right, bottom = laid.window
    for x, out in ((left, -1), (right, 1)):
        page.line(x, top, x, bottom)
        page.line(x, laid.level, x + out * TICK, laid.level)
        page.text(x - (TICK if out < 0 else -0.5), laid.level - 0.8, "z = 0", size=1.8)
    for y, out in ((top, -1), (bottom, 1)):
        page.line(left, y, right, y)
        for x in (laid.middle - laid.clamp, laid.middle + laid.clamp):
            page.line(x, y, x, y + out * TICK)
    for side, points_to in ((-1, "right"), (1, "left")):
        x = laid.middle + side * laid.clamp + 1.0
        page.text(x, top - 1.2, f"x = 0, finger to the {points_to}", size=1.8)
