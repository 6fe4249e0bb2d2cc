"""The page of `twin setup`: it shows a desk, and turns clicks into steps."""

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
from nicegui import run, ui

from twin.messages import Lines, Say
from twin.setup import desk as desks
from twin.setup import panels
from twin.setup.desk import Check, Desk
from twin.setup.draft import SetupDraft, with_start
from twin.setup.recordedpictures import as_url, clock_chart, first_picture

QUIET_S = 0.8  # without a change, after which the check runs
STEP_S, SAME_S = 0.02, 0.015  # of the slider; within which it stands where the desk has it
LONG_MS = 8000  # that a message stays


class Page:
    """The page: a desk, and what shows it."""

    def __init__(self, draft: SetupDraft, say: Say, check: Check) -> None:
        self.say, self.check = say, check
        self.picture = first_picture(draft.found)
        self.desk = desks.desk_of(draft, width=1280 if self.picture is None else self.picture.shape[1])
        self.lines: list[str] = []  # what the check said last
        self.wrong = ""
        self.is_checking = False
        self.changes = 0
        self.checks = asyncio.Lock()
        self.fields: dict[str, Any] = {}  # of the numbers of a desk
        self.buttons: dict[str, tuple[Any, Callable[[SetupDraft], bool]]] = {}  # shown while they are wanted
        self.overlay: Any = None
        self.chart: Any = None

    # -- events ----------------------------------------------------------------------------------------------

    def to(self, desk: Desk) -> None:
        """Show another desk, and check it soon."""
        before, self.desk = self.desk, desk
        self.draw(before)
        if desk.fault:
            self.notify(desk.fault, kind="negative")
        for shown in (self.state, self.tag, self.wanted):
            shown.refresh()
        if desk.draft.stated.model.kind != before.draft.stated.model.kind:
            self.body.refresh()
        if desk.has_outline != before.has_outline:
            self.place.refresh()
        self.draw_clock()
        self.changes += 1
        self.check_soon()

    def step(self, change: Callable[[SetupDraft], SetupDraft]) -> None:
        """Do a step of the draft."""
        self.to(desks.changed(self.desk, change))

    async def long_step(self, change: Callable[[SetupDraft], SetupDraft], *, said: str = "") -> None:
        """Do a step that takes seconds, again where something else was changed meanwhile.   said: what is
        shown until it is done."""
        with self.root:
            waiting = ui.notification(said, spinner=True, timeout=None) if said else None
        try:
            await self._long_step(change)
        finally:
            if waiting is not None:
                waiting.dismiss()

    async def _long_step(self, change: Callable[[SetupDraft], SetupDraft]) -> None:
        while True:
            before = self.desk
            desk = await run.io_bound(desks.changed, before, change)
            if desk is None:  # the server ends
                return
            if before is self.desk:
                self.to(desk)
                return

    def mouse(self, event: Any) -> None:
        """Take, drag and let go what is in the picture."""
        pixel = np.array([event.image_x, event.image_y])
        if event.type == "mousedown":
            desk = desks.pressed(self.desk, pixel)
        elif self.desk.drag is None:
            return
        elif event.type == "mousemove" and event.buttons:
            desk = desks.moved(self.desk, pixel)
        else:
            self.to(desks.released(self.desk))
            return
        before, self.desk = self.desk, desk
        self.draw(before)
        self.tag.refresh()

    def shift(self, start_s: float) -> None:
        """Shift the film, unless it is there already."""
        if self.desk.draft.start is None or abs(start_s - self.desk.draft.start) > SAME_S:
            self.step(lambda draft: with_start(draft, start_s))

    def write(self) -> None:
        """Write twin.toml."""
        told = Lines()
        self.to(desks.written(self.desk, told))
        if not self.desk.fault:
            said = ["Wrote twin.toml.", *told.lines]
            for line in said:
                self.say(line)
            self.notify(" ".join(said), kind="positive")

    def notify(self, text: str, *, kind: Any) -> None:
        """Show a message for a while."""
        ui.notify(text, type=kind, multi_line=True, timeout=LONG_MS, close_button="OK")

    def check_soon(self) -> None:
        """Run the check when nothing has changed for a moment."""
        now = self.changes
        with self.root:
            ui.timer(QUIET_S, lambda: self.check_now(now), once=True)

    async def check_now(self, now: int) -> None:
        """Run the check in a thread, unless something has changed since."""
        async with self.checks:
            if now != self.changes:
                return
            self.is_checking = True
            self.checked.refresh()
            if self.desk.camera is None:
                camera = await run.io_bound(desks.lens_of_board, self.desk.proposal)
                self.desk = desks.with_camera(self.desk, camera)
            said = await run.io_bound(desks.checked_lines, self.desk.proposal, self.check)
            self.is_checking = False
            if said is not None and now == self.changes:
                self.lines, self.wrong = said
                self.draw(self.desk)
            self.checked.refresh()

    # -- what is shown ---------------------------------------------------------------------------------------

    def build(self) -> None:
        """The page."""
        ui.colors(primary="#0072b2")
        with ui.header().classes("items-center bg-white text-black border-b py-2"):
            ui.label("twin setup").classes("text-lg font-bold")
            ui.label(self.desk.draft.root.name).classes("text-gray-600").tooltip(str(self.desk.draft.root))
            ui.space()
            self.state()
            ui.button("Write twin.toml", on_click=self.write, icon="save").props("no-caps")
        self.root = ui.row(wrap=False).classes("w-full items-start p-1 gap-4")
        with self.root:
            with ui.column().classes("w-7/12 gap-2"):
                self.build_picture()
                self.build_clock()
                self.recordings()
            with ui.column().classes("w-5/12 gap-3"):
                self.wanted()
                self.checked()
                self.measures()
                self.body()
        self.check_soon()

    def build_picture(self) -> None:
        """The film's first picture with tags and outline."""
        panels.title("The film's first picture", "Click a tag to change its role. Drag the outline of the "
                     "model by its face or its handles until it lies on the finger.")  # fmt: skip
        if self.picture is None:
            ui.label("No film with tags that move is found here.").classes("text-red-700")
        else:
            self.overlay = ui.interactive_image(
                as_url(self.picture), content=self.desk.svg, sanitize=False, on_mouse=self.mouse,
                events=["mousedown", "mousemove", "mouseup", "mouseleave"],
            ).classes("w-full border cursor-pointer").props("draggable=false")  # fmt: skip
        self.tag()
        self.place()

    def draw(self, before: Desk) -> None:
        """Draw tags and outline as the desk has them, and change the numbers that are others than before: in
        the other fields somebody may be typing. Show the buttons that are wanted."""
        if self.overlay is not None:
            self.overlay.set_content(self.desk.svg)
        former = desks.numbers_of(before)
        for key, value in desks.numbers_of(self.desk).items():
            if key in self.fields and value != former.get(key):
                self.fields[key].set_value(value)
        for button, is_wanted in self.buttons.values():
            button.set_visibility(is_wanted(self.desk.draft))

    def build_clock(self) -> None:
        """Log and motion over each other, with a slider for the film's start."""
        found = self.desk.draft.found
        panels.title("Clocks", "The motion must follow the pressure: shift the film until its rises, holds "
                     "and rests lie on those of the log.")  # fmt: skip
        if found.log is None or found.film is None:
            ui.label("Wanted a film and a pressure log.").classes("text-red-700")
            return
        low, high = sorted((float(found.log.time[0]), float(found.log.time[-1] - found.film.time[-1])))
        self.chart = ui.echart(clock_chart(self.desk.draft)).classes("w-full h-56")
        with ui.row(wrap=False).classes("w-full items-center gap-4"):
            self.slider = ui.slider(
                min=low, max=high, step=STEP_S, value=self.desk.draft.start or low,
                on_change=lambda event: self.shift(event.value),
            )  # fmt: skip
            self.said_start = ui.label().classes("text-sm w-96")
            ui.button("as found", on_click=lambda: self.step(lambda draft: with_start(draft, None))).props(
                "outline dense no-caps"
            ).classes("w-32")
        self.draw_clock()

    def draw_clock(self) -> None:
        """Draw log and motion as the desk has them."""
        draft = self.desk.draft
        if self.chart is None or draft.found.log is None:
            return
        self.chart.options.update(clock_chart(draft))
        if draft.start is None:
            self.said_start.set_text("When the film starts is open: shift it.")
            return
        self.slider.set_value(draft.start)
        share = desks.explained_at(draft, draft.start)
        how = "" if share is None else f" The pressure explains {100 * share:.0f} % of the motion."
        self.said_start.set_text(f"The film starts at {draft.start:.2f} s of the log.{how}")

    @ui.refreshable_method
    def state(self) -> None:
        """Whether it is written."""
        panels.state_panel(self)

    @ui.refreshable_method
    def tag(self) -> None:
        """The selected tag."""
        panels.tag_panel(self)

    @ui.refreshable_method
    def place(self) -> None:
        """Where the outline stands."""
        panels.place_panel(self)

    @ui.refreshable_method
    def wanted(self) -> None:
        """What nobody has decided."""
        panels.wanted_panel(self)

    @ui.refreshable_method
    def checked(self) -> None:
        """What `twin check` says."""
        panels.check_panel(self)

    @ui.refreshable_method
    def recordings(self) -> None:
        """What is found."""
        panels.recordings_panel(self)

    @ui.refreshable_method
    def measures(self) -> None:
        """What is measured with a ruler."""
        panels.measures_panel(self)

    @ui.refreshable_method
    def body(self) -> None:
        """The body's dimensions."""
        panels.body_panel(self)
