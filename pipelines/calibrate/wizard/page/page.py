"""The page: the picture on the left, one step and what it does to the uncertainty on the right.

The card that says how sure a landing will be, where it comes from, and what each answer did.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from nicegui import ui
from nicegui.events import GenericEventArguments, MouseEventArguments
from numpy.typing import NDArray

from metrology import UncertaintySource
from pipelines.calibrate.wizard.answers import STEPS
from pipelines.calibrate.wizard.drawing import (
    STYLE,
    Places,
    grid_lines,
    handles,
    marks,
    millimetres,
    note,
    phrase,
    residual_arrows,
    shaded_map,
)
from pipelines.calibrate.wizard.page.steps import PANELS
from pipelines.calibrate.wizard.session import Session
from pipelines.web.guard import HOLD, RELEASE, SCRIPT, Jobs

__all__ = ["WizardPage"]

LINES_SHOWN, CHANGES_SHOWN = 5, 5

"""Lines of the budget and changes shown: as many as a card holds without scrolling."""

WORDS = {UncertaintySource.BALL_PLANE_GUESS: "ball plane only guessed"}


def outlook_card(session: Session) -> None:
    """Draw the card."""
    found = session.outlook
    with ui.column().classes("wz-card w-full gap-2").props("data-test=outlook aria-live=polite"):
        ui.html("<h2>Landing uncertainty to expect</h2>", sanitize=False)
        std = found.std
        if std is None or found.distance is None:
            ui.label("not yet known").classes("wz-big").props("data-test=std")
            note(phrase(found.problem or "a wall grid is needed"))
        else:
            ui.label(f"± {millimetres(std)}").classes("wz-big").props("data-test=std")
            where = "at a supposed landing" if found.supposed else "at the landing"
            note(f"{where}, {found.distance:.3f} m from rest (one standard deviation)")
            _budget(session)
        for warning in found.warnings:
            note(phrase(warning), "wz-warn")
        _changes(session)


def _budget(session: Session) -> None:
    lines = session.outlook.budget[:LINES_SHOWN]
    largest = max(line.std for line in lines)
    for line in lines:
        with ui.row().classes("w-full items-center no-wrap gap-2 wz-small"):
            ui.label(WORDS.get(line.source, line.source)).style("width: 13rem; flex: none")
            with ui.element("div").style("flex: 1"):
                ui.element("div").classes("wz-bar").style(
                    f"width: {max(1.0, 100.0 * line.std / largest):.0f}%"
                )
            ui.label(millimetres(line.std)).style("width: 4.5rem; text-align: right; flex: none")


def _changes(session: Session) -> None:
    told = [change for change in session.changes if change.after is not None]
    if not told:
        return
    ui.separator()
    with ui.column().classes("gap-0 w-full wz-small").props("data-test=changes"):
        for change in reversed(told[-CHANGES_SHOWN:]):
            before = millimetres(change.before)
            ui.label(f"{change.label}: {before} → {millimetres(change.after)}")


FloatArray = NDArray[np.float64]

PICTURE_URL, FIRST_URL = "/scene.png", "/first.png"

"""The still scene, and the first frame, in which the ball usually rests."""

LOUPE_ZOOM, LOUPE_PX = 7, 168

"""Factor and px on the screen: 24 px of the picture, as much as a crossing needs around it."""

GRAB_SHARE = 0.03

"""How near to a handle it is grabbed, of the picture's width."""

ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, -1), "ArrowDown": (0, 1)}

POLL_S = 0.25

"""s between looks at the session: a window that follows within a quarter second seems live."""


class WizardPage:
    """One window's view of the session; all that matters lives in the session.

    Parameters
    ----------
    session : Session
    jobs : Jobs
    close : callable
        Ends the program.
    """

    def __init__(self, session: Session, jobs: Jobs, close: Any) -> None:
        self.session = session
        self.jobs = jobs
        self.close = close
        self.places = Places(session, jobs)
        self.saving_problem = ""
        self._revision = -1
        self._drawn: tuple[object, ...] = ()
        self._following: list[Callable[[], None]] = []
        self._dragged: str | None = None
        self._steps: list[ui.button] = []

    def build(self) -> None:
        """Lay the page out."""
        session = self.session
        info = session.answers.scene.info
        ui.add_css(STYLE)
        ui.add_head_html(SCRIPT)
        ui.page_title(f"Calibration: {info.path.name}")
        with ui.column().classes("w-full gap-3").style("max-width: 1500px; margin: 0 auto"):
            with ui.row().classes("w-full items-baseline gap-3"):
                ui.html(f"<h1>Calibration of {_safe(info.path.name)}</h1>", sanitize=False)
                ui.label(f"{info.width} × {info.height} px, {info.frames} frames").classes(
                    "wz-small"
                )
            self._navigation()
            with ui.row().classes("w-full items-start gap-4"):
                with ui.column().classes("gap-2").style("flex: 3 1 520px; min-width: 0"):
                    self._picture()
                with ui.column().classes("gap-3").style("flex: 2 1 380px; min-width: 340px"):
                    self.panel()
                    with ui.row().classes("w-full justify-between"):
                        self._back = ui.button("Back", on_click=lambda: self.go(session.step - 1))
                        self._back.props("outline no-caps color=teal-9 data-test=back")
                        self._next = ui.button("Next", on_click=lambda: self.go(session.step + 1))
                        self._next.props("unelevated no-caps color=teal-9 data-test=next")
                    self.outlook()
        ui.timer(POLL_S, self._poll)
        self.show()

    def _navigation(self) -> None:
        """The row of steps; never drawn anew, so that no click on it is lost."""
        with (
            ui.element("nav")
            .props('aria-label="Steps"')
            .classes("row items-center gap-1 wz-card w-full")
        ):
            for index, name in enumerate(STEPS):
                button = ui.button(
                    f"{index + 1}  {phrase(name)[:-1]}",
                    on_click=lambda _, index=index: self.go(index),
                )
                button.props(f'flat dense color=inherit data-test="step-{index + 1}"')
                self._steps.append(button.classes("wz-step"))

    def _mark(self) -> None:
        """Show in the row of steps which is the present one."""
        for index, button in enumerate(self._steps):
            button.props(f"aria-current={'step' if index == self.session.step else 'false'}")
            done = index < self.session.step
            button.classes(add="wz-done" if done else "", remove="" if done else "wz-done")
        self._back.set_enabled(self.session.step > 0)
        self._next.set_visibility(self.session.step < len(STEPS) - 1)

    @ui.refreshable_method
    def panel(self) -> None:
        """The present step."""
        self._following.clear()
        self._drawn = self._known
        with ui.column().classes("wz-card w-full gap-3").props("data-test=panel"):
            number = self.session.step
            ui.html(f"<h2>{number + 1}. {phrase(STEPS[number])[:-1]}</h2>", sanitize=False)
            self.status()
            PANELS[number](self)

    def follows(self, follow: Callable[[], None]) -> None:
        """Have a part of the present step follow what is set, without being drawn anew.

        Parameters
        ----------
        follow : callable
            Shows what is set; called now and whenever something has changed.
        """
        self._following.append(follow)
        follow()

    @property
    def _known(self) -> tuple[object, ...]:
        """What the present step says depends on this."""
        session = self.session
        return session.step, len(session.changes), session.grid_problem, session.ball_problem

    @ui.refreshable_method
    def status(self) -> None:
        """What is being worked out, or why it failed."""
        if self.jobs.busy:
            with ui.row().classes("items-center gap-2").props("role=status"):
                ui.spinner(size="sm")
                ui.label(f"{phrase(self.jobs.busy)[:-1]} …").props("data-test=busy")
        if self.jobs.problem:
            note(phrase(self.jobs.problem), "wz-bad", alert=True)

    @ui.refreshable_method
    def outlook(self) -> None:
        """The expected uncertainty."""
        outlook_card(self.session)

    def go(self, step: int) -> None:
        """Show another step."""
        self.session.step = min(max(step, 0), len(STEPS) - 1)
        self.places.leave()
        self.jobs.problem = self.saving_problem = ""
        self.show()

    def finish(self) -> None:
        """Say goodbye and end the program."""
        ui.run_javascript(
            'document.body.innerHTML = \'<p style="font: 18px system-ui; margin: 4rem">'
            "The calibration is closed. You can close this window.</p>'"
        )
        ui.timer(0.3, self.close, once=True)

    def show(self) -> None:
        """Draw all anew."""
        self._revision = self.jobs.revision
        self._mark()
        self.redraw_panel()
        self.outlook.refresh()
        self.draw()

    def redraw_panel(self) -> None:
        """Draw the present step anew; what has the focus keeps it."""
        self.panel.refresh()
        ui.run_javascript(RELEASE)

    def draw(self) -> None:
        """Draw what lies over the picture, and the loupe; show in the step what is set."""
        for follow in self._following:
            follow()
        answers, found = self.session.answers, self.session.outlook
        step = self.session.step
        parts = []
        if step == 5 and found.calibration is not None and answers.grid is not None:
            if self.session.layer == "uncertainty":
                parts.append(shaded_map(found.calibration)[0])
            elif self.session.layer == "residuals":
                parts.append(residual_arrows(found.calibration, answers.grid)[0])
        if answers.grid is not None and (
            step in (2, 4) or (step == 5 and self.session.layer == "grid")
        ):
            parts.append(grid_lines(answers.grid))
        if step in (3, 4) or (step == 5 and self.session.layer == "uncertainty"):
            parts.append(marks(answers, None))
        if step == 2 and self.places.by_hand:
            active = self.places.active
            number = int(active[-1]) if active and active.startswith("corner") else None
            parts.append(handles(self.places.corners, number, answers.scene.size))
        if step == 5:
            parts.append(self.places.ruler())
        self._image.content = "".join(parts)
        self._image.set_source(self._shown)
        self._loupe.style(f"background-image: url({self._shown})")
        self._magnify()

    @property
    def _shown(self) -> str:
        return FIRST_URL if self.session.step == 3 else PICTURE_URL

    def _picture(self) -> None:
        scene = self.session.answers.scene
        self._image = ui.interactive_image(
            PICTURE_URL,
            on_mouse=self._mouse,
            events=["mousedown", "mousemove", "mouseup"],
            sanitize=False,
        )
        self._image.classes("wz-picture").props(
            'tabindex=0 role=application data-test=picture aria-label="The scene. Choose a place '
            'in the step beside it; arrow keys move it by 1 px, with Shift by 10, with Alt by 0.1."'
        )
        self._image.on("keydown", self._key, args=["key", "shiftKey", "altKey"])
        with ui.row().classes("items-start gap-3 no-wrap"):
            self._loupe = ui.element("div").classes("wz-loupe").props("aria-hidden=true")
            wide, high = (LOUPE_ZOOM * length for length in scene.size)
            self._loupe.style(f"background-size: {wide}px {high}px")
            with ui.column().classes("gap-1"):
                self._where = ui.label().classes("wz-small").props("data-test=where")
                ui.label(
                    "Choose a place with its button, then click in the picture. By keyboard: Tab "
                    "to the picture, arrow keys move the place (Shift: 10 px, Alt: 0.1 px)."
                ).classes("wz-small")

    def _mouse(self, event: MouseEventArguments) -> None:
        px = np.array([event.image_x, event.image_y]) - 0.5
        if event.type == "mousedown":
            self._dragged = self.places.grabbed(px, GRAB_SHARE) or self.places.active
            if self._dragged is not None:
                self.places.active = self._dragged
                self.places.put(self._dragged, px, final=False)
        elif event.type == "mousemove":
            if self._dragged is None or not event.buttons:
                self._magnify(px)
                return
            self.places.put(self._dragged, px, final=False)
        elif self._dragged is not None:
            name, self._dragged = self._dragged, None
            self.places.put(name, px, final=True)
        self.draw()

    def _key(self, event: GenericEventArguments) -> None:
        step = ARROWS.get(event.args.get("key", ""))
        at = None if self.places.active is None else self.places.where(self.places.active)
        if step is None or self.places.active is None:
            return
        size = 10.0 if event.args.get("shiftKey") else 0.1 if event.args.get("altKey") else 1.0
        if at is None:
            at = (np.array(self.session.answers.scene.size) - 1.0) / 2.0
        self.places.put(self.places.active, at + size * np.array(step), final=True)
        self.draw()

    def _magnify(self, px: FloatArray | None = None) -> None:
        active = self.places.active
        if px is None and active is not None:
            px = self.places.where(active)
        if px is None:
            return
        x, y = (px + 0.5) * LOUPE_ZOOM - LOUPE_PX / 2
        self._loupe.style(f"background-position: {-x:.1f}px {-y:.1f}px")
        named = "" if active is None else f"{self.places.label(active)}: "
        reading = ""
        grid = self.session.answers.grid
        if grid is not None:
            wall = grid.to_wall(px)
            if np.isfinite(wall).all():
                reading = f"; wall {wall[0]:+.3f}, {wall[1]:+.3f} m"
        self._where.text = f"{named}{px[0]:.1f}, {px[1]:.1f} px{reading}"

    async def _poll(self) -> None:
        """Show what has been worked out.

        The step is drawn anew only while nobody types or presses anything in it, and the browser
        holds clicks back until it is.
        """
        if self.jobs.revision != self._revision:
            self._revision = self.jobs.revision
            self.status.refresh()
            self.outlook.refresh()
            self.draw()
        if self._drawn == self._known:
            return
        try:
            if await ui.run_javascript(HOLD, timeout=5.0):
                self.redraw_panel()
        except TimeoutError:
            return  # the window is gone, or being reloaded


def _safe(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")
