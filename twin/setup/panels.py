"""The panels of the page: each shows a part of its desk, and turns what is typed or chosen into steps."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, get_args

from nicegui import ui

from twin.bodies.kinds import BODIES
from twin.inputs.looseframe import Measured
from twin.setup import desk as desks
from twin.setup.draft import (
    ROLES,
    Role,
    SetupDraft,
    with_axes,
    with_board,
    with_body,
    with_dimension,
    with_log,
    with_pose,
    with_rulers,
)
from twin.setup.outline import snapped
from twin.setup.proposal import is_body_stated
from twin.setup.recordedpictures import as_url, headings_of_log, recorded_pictures, said_of_log
from twin.setup.svglayers import COLOURS, called

if TYPE_CHECKING:
    from twin.setup.page import Page

ABOUT: dict[Role, str] = {
    "frame": "defines the axes, six or more", "fixed": "must show no motion, four or more",
    "clamp": "on the clamp, at a known place", "finger": "is measured", "ignore": "is left out",
}  # fmt: skip
RIGHT = "these are right"
UNSAID = "as its heading says"
UNITS = ("MPa", "kPa", "Pa", "hPa", "bar", "mbar", "psi")


def title(text: str, about: str = "") -> None:
    """A heading, with a sentence below it."""
    with ui.column().classes("gap-0"):
        ui.label(text).classes("font-bold")
        if about:
            ui.label(about).classes("text-sm text-gray-600")


def number(page: "Page", key: str, then: Callable[[Any], Any], *, label: str = "", step: float = 0.1) -> None:
    """A number of the desk, to be typed; `then` has it when its field is left. It goes back where it cannot
    be."""
    field = ui.number(label, value=desks.numbers_of(page.desk)[key], step=step).classes("w-24").props("dense")
    page.fields[key] = field

    def done() -> None:
        if field.value is not None:
            then(field.value)
        field.set_value(desks.numbers_of(page.desk)[key])

    field.on("change", done)


def state_panel(page: "Page") -> None:
    """Whether twin.toml has all of this; the browser asks before a page is left that is not written."""
    done = page.desk.proposal.is_written
    colour = "text-green-700" if done else "text-orange-700 font-bold"
    ui.label("twin.toml is written" if done else "not written yet").classes(colour)
    ui.run_javascript(f"window.onbeforeunload = {'null' if done else '(e) => e.preventDefault()'}")


def tag_panel(page: "Page") -> None:
    """The selected tag with the roles that it can have; without one, what the colours say."""
    code, proposal = page.desk.selected, page.desk.proposal
    with ui.row().classes("items-center gap-2 min-h-8"):
        if code is None:
            counts = {role: list(proposal.roles.values()).count(role) for role in ROLES}
            for role in (role for role in ROLES if counts[role] or role in ("frame", "fixed", "finger")):
                ui.icon("square").style(f"color: {COLOURS[role]}")
                ui.label(f"{counts[role]} {role}: {ABOUT[role]}").classes("text-sm mr-2")
            return
        ui.label(f"{called(code).capitalize()} is").classes("font-bold")
        for role in proposal.choices(code):
            _role_button(page, role, is_own=proposal.roles[code] == role)
        ui.label(ABOUT[proposal.roles[code]]).classes("text-sm text-gray-600")


def _role_button(page: "Page", role: Role, *, is_own: bool) -> None:
    look = "unelevated" if is_own else "outline"
    def take() -> None:
        page.to(desks.with_tag_role(page.desk, role))

    button = ui.button(role, color=COLOURS[role], on_click=take)
    button.props(f"no-caps dense {look}").classes("px-3").tooltip(ABOUT[role])


def place_panel(page: "Page") -> None:
    """Where the outline stands, in numbers."""
    if not page.desk.has_outline:
        ui.label("The outline is shown once the places of four frame markers are known.").classes("text-sm")
        return
    with ui.row().classes("items-center gap-3"):
        ui.label("The clamped end stands at").classes("text-sm")
        for key, text in (("x_mm", "x, mm"), ("z_mm", "z, mm"), ("turn_deg", "turn, degrees")):
            number(page, key, partial(_place, page, key), label=text)
        snap = ui.button("snap to edges", on_click=partial(_snap, page)).props("outline dense no-caps")
        snap.tooltip("To the edges that the film shows at rest: place, turn, dimensions that are others")
        _sometimes(page, "pose", "back to 0", lambda draft: with_pose(draft, None),
                   lambda draft: draft.stated.pose is not None)  # fmt: skip


async def _snap(page: "Page") -> None:
    """Lay the outline on the edges that the film shows."""
    await page.long_step(
        lambda draft: snapped(draft, page.desk.camera), said="The edges of the finger are looked for"
    )


def _place(page: "Page", key: str, value: float) -> None:
    """State where the clamped end stands."""
    page.step(lambda draft: with_pose(draft, draft.pose.model_copy(update={key: float(value)})))


def wanted_panel(page: "Page") -> None:
    """What nobody has decided."""
    wanted = page.desk.proposal.wanted
    with ui.card().classes("w-full gap-1 p-3"):
        title("Still to be stated" if wanted else "Nothing is left to state")
        for line in wanted:
            _remark("edit", line, "text-orange-700", "")


def _remark(icon: str, text: str, colour: str, letters: str) -> None:
    with ui.row(wrap=False).classes("items-start gap-2"):
        ui.icon(icon, size="xs").classes(f"{colour} mt-1")
        ui.label(text).classes(f"text-sm {letters}")


def check_panel(page: "Page") -> None:
    """What `twin check` says of it as it stands on the page."""
    with ui.card().classes("w-full gap-1 p-3"):
        with ui.row().classes("items-center gap-2"):
            title("twin check says")
            if page.is_checking:
                ui.spinner(size="sm")
        if page.wrong:
            _remark("error", page.wrong, "text-red-700", "text-red-700")
        for line in page.lines:
            ui.label(line).classes("text-sm")
        if page.lines and not page.wrong:
            _remark("check", "Nothing is wrong. Once it is written: twin camera, then twin measure.",
                    "text-green-700", "text-green-700")  # fmt: skip


def recordings_panel(page: "Page") -> None:
    """What is found, with a picture of each; column, unit and range of the log, to be confirmed."""
    draft = page.desk.draft
    title("Recordings")
    with ui.row().classes("gap-3 items-start"):
        for text, picture in recorded_pictures(draft):
            with ui.column().classes("gap-0 w-40"):
                ui.image(as_url(picture, wide=320)).classes("w-40 h-24")
                ui.label(text).classes("text-xs")
    if draft.found.tables:
        ui.label(said_of_log(draft.found)).classes("text-sm")
        _log_fields(page, draft)


def _log_fields(page: "Page", draft: SetupDraft) -> None:
    """How the log is read."""
    own = draft.stated.pressure
    column, unit, top_kPa = (None, None, None) if own is None else (own.column, own.unit, own.top_kPa)
    with ui.row().classes("gap-3 items-end"):
        heading = ui.select({"": UNSAID} | {k: k for k in headings_of_log(draft.found)}, value=column or "",
                            label="column of the pressure")  # fmt: skip
        of_unit = ui.select({"": UNSAID} | {k: k for k in UNITS}, value=unit or "", label="its unit")
        top = ui.number("regulator's top, kPa", value=top_kPa)
        for field in (heading, of_unit, top):
            field.classes("w-44").props("dense")
        top.tooltip("What the regulator was set to at most: it tells a wrong unit. It may be left empty.")

        async def read() -> None:
            await page.long_step(lambda draft: with_log(
                draft, column=heading.value or None, unit=of_unit.value or None, top_kPa=top.value or None
            ))  # fmt: skip
            page.recordings.refresh()

        ui.button("read it so", on_click=read).props("outline dense no-caps")


def measures_panel(page: "Page") -> None:
    """What is measured with a ruler: the board's square, and both rulers of the sheet; of loose markers,
    which of them define the axes."""
    draft = page.desk.draft
    with ui.card().classes("w-full gap-1 p-3"):
        title("Measured with a ruler")
        with ui.row().classes("gap-3"):
            if (board := draft.found.board) is not None:
                sides = {"square_mm": "square of the board, mm", "marker_mm": "its marker, mm"}
                _together(page, sides, with_board)
                as_found = partial(with_board, square_mm=board.square_mm, marker_mm=board.marker_mm)
                _sometimes(page, "board", RIGHT, as_found, lambda draft: not draft.board_measured)
            if draft.has_printed_sheet:
                _together(page, {"across": "ruler across, mm", "upright": "ruler upright, mm"}, with_rulers)
        if isinstance(draft.loose, Measured):
            _axes_fields(page, draft, draft.loose)


def _sometimes(
    page: "Page", key: str, text: str, step: Callable[[SetupDraft], SetupDraft],
    wanted: Callable[[SetupDraft], bool],
) -> None:  # fmt: skip
    """A button that does a step, shown as long as it is wanted."""
    button = ui.button(text, on_click=lambda: page.long_step(step)).props("outline dense no-caps")
    page.buttons[key] = button, wanted
    button.set_visibility(wanted(page.desk.draft))


def _together(page: "Page", labels: Mapping[str, str], step: Callable[..., SetupDraft]) -> None:
    """Numbers of one step, which is done when all are typed."""
    numbers = desks.numbers_of(page.desk)
    fields = {key: ui.number(label, value=numbers[key], step=0.1) for key, label in labels.items()}
    page.fields |= fields

    async def done() -> None:
        values = {key: field.value for key, field in fields.items()}
        if None not in values.values():
            await page.long_step(lambda draft: step(draft, **values))

    for field in fields.values():
        field.classes("w-40").props("dense").on("change", done)


def _axes_fields(page: "Page", draft: SetupDraft, loose: Measured) -> None:
    """Which of the loose markers define the axes."""
    axes = draft.stated.frame.axes or (None, None)
    names = ("marker at x = 0, z = 0", "marker that is level with it")
    with ui.row().classes("gap-3"):
        chosen = [ui.select(list(loose.codes), value=own, label=name).classes("w-52").props("dense")
                  for own, name in zip(axes, names, strict=True)]  # fmt: skip

    def done() -> None:
        values = [field.value for field in chosen]
        if None not in values:
            page.step(lambda draft: with_axes(draft, values))

    for field in chosen:
        field.on_value_change(done)


def body_panel(page: "Page") -> None:
    """The kind of the body and its dimensions."""
    draft = page.desk.draft
    own, kind = draft.dimensions, draft.stated.model.kind
    with ui.card().classes("w-full gap-0 p-3"):
        title("Dimensions of the body", "Length and height are handles in the picture, too.")
        if own is None:
            ui.label("A deck has its own.").classes("text-sm")
            return
        with ui.row().classes("gap-3 items-end"):
            ui.select(list(BODIES), value=kind, label="kind of body", on_change=lambda event: page.step(
                lambda draft: with_body(draft, event.value))).classes("w-40").props("dense")  # fmt: skip
            usual = partial(with_body, kind=kind)
            _sometimes(page, "body", RIGHT, usual, lambda draft: not is_body_stated(draft))
        for key, field in type(own).model_fields.items():
            with ui.row(wrap=False).classes("items-center gap-3"):
                _dimension(page, key, getattr(own, key), get_args(field.annotation))
                ui.label(field.description or key).classes("text-sm")


def _dimension(page: "Page", key: str, value: Any, choices: tuple[Any, ...]) -> None:
    """The field of a dimension: a number, or one of some words."""
    if isinstance(value, str):
        ui.select([word for word in choices if isinstance(word, str)], value=value,
                  on_change=lambda event: page.step(lambda draft: with_dimension(draft, key, event.value))
                  ).classes("w-24").props("dense")  # fmt: skip
        return
    kind, step = (int, 1.0) if isinstance(value, int) else (float, 0.1)
    number(page, key, lambda new: page.step(lambda draft: with_dimension(draft, key, kind(new))), step=step)
