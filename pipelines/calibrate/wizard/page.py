"""Page of the calibration wizard: image, current step, expected uncertainty.

A card shows the expected landing uncertainty, its budget and the effect of each answer. The first
five steps ask; the sixth shows residuals and uncertainty, verifies a known length and saves.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui
from nicegui.events import GenericEventArguments, MouseEventArguments
from numpy.typing import NDArray

from calib.board import Board
from calib.calibration import Known
from metrology import ImpactVisionError, UncertaintySource, UsageError, measurands, read_number
from pipelines.calibrate.wizard.answers import (
    STEP_NAMES,
    Answers,
    BallKind,
    board_pictures,
    board_size,
    distance_from,
    fine_pitch_from,
    lens_from_board,
    lens_from_file,
    pitch_from,
    rate_from,
)
from pipelines.calibrate.wizard.drawing import (
    LABELS,
    PAGE_STYLE,
    RAMP,
    Place,
    PlaceRow,
    Places,
    field,
    grid_lines,
    handles,
    marks,
    millimetres,
    note,
    phrase,
    residual_arrows,
    shaded_map,
)
from pipelines.calibrate.wizard.session import (
    Session,
    compare_length,
    with_ball,
    with_corners,
    with_grid,
)
from pipelines.web import HOLD, RELEASE, SCRIPT, Jobs

__all__ = [
    "PANELS",
    "WizardPage",
]

LINES_SHOWN, CHANGES_SHOWN = 5, 5
"""Lines of the budget and changes shown: as many as a card holds without scrolling."""

SOURCE_WORDS = {UncertaintySource.BALL_PLANE_GUESS: "ball plane only assumed"}


def outlook_card(session: Session) -> None:
    """Draw the card."""
    found = session.outlook
    with ui.column().classes("wz-card w-full gap-2").props("data-test=outlook aria-live=polite"):
        ui.html("<h2>Expected landing uncertainty</h2>", sanitize=False)
        std = found.std
        if std is None or found.distance is None:
            ui.label("unknown").classes("wz-big").props("data-test=std")
            note(phrase(found.problem or "a wall grid is needed"))
        else:
            ui.label(f"± {millimetres(std)}").classes("wz-big").props("data-test=std")
            where = "at an assumed landing" if found.assumed else "at the landing"
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
            ui.label(SOURCE_WORDS.get(line.source, line.source)).style("width: 13rem; flex: none")
            with ui.element("div").style("flex: 1"):
                ui.element("div").classes("wz-bar").style(
                    f"width: {max(1.0, 100.0 * line.std / largest):.0f}%"
                )
            ui.label(millimetres(line.std)).style("width: 4.5rem; text-align: right; flex: none")


def _changes(session: Session) -> None:
    known = [change for change in session.changes if change.after is not None]
    if not known:
        return
    ui.separator()
    with ui.column().classes("gap-0 w-full wz-small").props("data-test=changes"):
        for change in reversed(known[-CHANGES_SHOWN:]):
            before = millimetres(change.before)
            ui.label(f"{change.label}: {before} → {millimetres(change.after)}")


FloatArray = NDArray[np.float64]

PICTURE_URL, FIRST_URL = "/scene.png", "/first.png"
"""The median scene, and the first frame, in which the ball is usually at rest."""

LOUPE_ZOOM, LOUPE_PX = 7, 168
"""Magnification and size on the screen, px: shows 24 px of the image, enough around a crossing."""

GRAB_FRACTION = 0.03
"""Distance within which a handle is grabbed, as a fraction of the image's width (chosen)."""

ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, -1), "ArrowDown": (0, 1)}

POLL_S = 0.25
"""s between updates from the session: a quarter second appears immediate (chosen)."""


class WizardPage:
    """One window onto the session, which holds all state.

    Parameters
    ----------
    session : Session
    jobs : Jobs
    measure : callable
        Measures with the saved file.
    """

    def __init__(self, session: Session, jobs: Jobs, measure: Callable[[], None]) -> None:
        self.session = session
        self.measure = measure
        self.jobs = jobs
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
        ui.add_css(PAGE_STYLE)
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
        """The row of steps; never redrawn, so that no click on it is lost."""
        with (
            ui.element("nav")
            .props('aria-label="Steps"')
            .classes("row items-center gap-1 wz-card w-full")
        ):
            for index, name in enumerate(STEP_NAMES):
                button = ui.button(
                    f"{index + 1}  {phrase(name)[:-1]}",
                    on_click=lambda _, index=index: self.go(index),
                )
                button.props(f'flat dense color=inherit data-test="step-{index + 1}"')
                self._steps.append(button.classes("wz-step"))

    def _mark(self) -> None:
        """Mark the current step in the row of steps."""
        for index, button in enumerate(self._steps):
            button.props(f"aria-current={'step' if index == self.session.step else 'false'}")
            done = index < self.session.step
            button.classes(add="wz-done" if done else "", remove="" if done else "wz-done")
        self._back.set_enabled(self.session.step > 0)
        self._next.set_visibility(self.session.step < len(STEP_NAMES) - 1)

    @ui.refreshable_method
    def panel(self) -> None:
        """The current step."""
        self._following.clear()
        self._drawn = self._known
        with ui.column().classes("wz-card w-full gap-3").props("data-test=panel"):
            number = self.session.step
            ui.html(f"<h2>{number + 1}. {phrase(STEP_NAMES[number])[:-1]}</h2>", sanitize=False)
            self.status()
            PANELS[number](self)

    def follows(self, follow: Callable[[], None]) -> None:
        """Update a part of the current step on changes without redrawing it.

        Parameters
        ----------
        follow : callable
            Shows the state; called now and after each change.
        """
        self._following.append(follow)
        follow()

    @property
    def _known(self) -> tuple[object, ...]:
        """State on which the current step depends."""
        session = self.session
        return session.step, len(session.changes), session.grid_problem, session.ball_problem

    @ui.refreshable_method
    def status(self) -> None:
        """The running job, or why it failed."""
        if self.jobs.busy:
            with ui.row().classes("items-center gap-2").props("role=status"):
                ui.spinner(size="sm").props("aria-hidden=true")
                ui.label(f"{phrase(self.jobs.busy)[:-1]} …").props("data-test=busy")
        if self.jobs.problem:
            note(phrase(self.jobs.problem), "wz-bad", alert=True)

    @ui.refreshable_method
    def outlook(self) -> None:
        """The expected uncertainty."""
        outlook_card(self.session)

    def go(self, step: int) -> None:
        """Show another step."""
        self.session.step = min(max(step, 0), len(STEP_NAMES) - 1)
        self.places.leave()
        self.jobs.problem = self.saving_problem = ""
        self.show()

    def show(self) -> None:
        """Redraw everything."""
        self._revision = self.jobs.revision
        self._mark()
        self.redraw_panel()
        self.outlook.refresh()
        self.draw()

    def redraw_panel(self) -> None:
        """Redraw the current step; the focus is kept."""
        self.panel.refresh()
        ui.run_javascript(RELEASE)

    def draw(self) -> None:
        """Draw overlay and loupe, and update the current step."""
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
            'tabindex=0 role=application data-test=picture aria-label="The scene. Select a '
            'position in the step next to it; arrow keys move it by 1 px, Shift: 10, Alt: 0.1."'
        )
        self._image.on("keydown", self._key, args=["key", "shiftKey", "altKey"])
        with ui.row().classes("items-start gap-3 no-wrap"):
            self._loupe = ui.element("div").classes("wz-loupe").props("aria-hidden=true")
            wide, high = (LOUPE_ZOOM * length for length in scene.size)
            self._loupe.style(f"background-size: {wide}px {high}px")
            with ui.column().classes("gap-1"):
                self._where = ui.label().classes("wz-small").props("data-test=where")
                ui.label(
                    "Select a position with its button, then click in the image. By keyboard: Tab "
                    "to the image, arrow keys move the position (Shift: 10 px, Alt: 0.1 px)."
                ).classes("wz-small")

    def _mouse(self, event: MouseEventArguments) -> None:
        px = np.array([event.image_x, event.image_y]) - 0.5
        if event.type == "mousedown":
            self._dragged = self.places.grabbed(px, GRAB_FRACTION) or self.places.active
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
        """Show the results of jobs.

        The step is redrawn only while the user neither types nor presses anything in it; the
        browser holds clicks back until then.
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
            return  # the window is closed or reloading


def _safe(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")


def places_of(page: "WizardPage", *keys: str) -> None:
    """Rows for positions."""
    for key in keys:

        def choose(key: str = key) -> None:
            page.places.active = key
            page.draw()

        def moved(x: float, y: float, key: str = key) -> None:
            page.places.active = key
            page.places.put(key, np.array([x, y]), final=True)
            page.draw()

        row = PlaceRow(Place(key, LABELS[key]), choose, moved)

        def follow(key: str = key, row: PlaceRow = row) -> None:
            at = page.places.where(key)
            px = None if at is None else (float(at[0]), float(at[1]))
            row.show(px, active=page.places.active == key)

        page.follows(follow)


LAYERS = {"uncertainty": "Uncertainty map", "residuals": "Residual arrows", "grid": "Grid lines"}


def check_step(page: "WizardPage") -> None:
    """Draw the panel."""
    session = page.session

    @ui.refreshable
    def legend() -> None:
        _legend(page)

    def layer(value: str) -> None:
        session.layer = value  # type: ignore[assignment]
        legend.refresh()
        page.draw()

    ui.radio(LAYERS, value=session.layer, on_change=lambda event: layer(event.value)).props(
        "dense inline data-test=layer"
    )
    legend()
    ui.separator()
    _known_length(page)
    ui.separator()
    _saving(page)


def _legend(page: "WizardPage") -> None:
    found, grid = page.session.outlook.calibration, page.session.answers.grid
    if found is None or grid is None:
        note("Nothing to check yet: find the wall grid first (step 3).", "wz-warn")
        return
    if page.session.layer == "uncertainty":
        scale = shaded_map(found)[1]
        with ui.row().classes("w-full items-center no-wrap gap-2 wz-small"):
            ui.label(millimetres(scale.low))
            ui.element("div").style(
                f"flex: 1; height: 12px; background: linear-gradient(to right, {', '.join(RAMP)})"
            )
            ui.label(millimetres(scale.high))
        note("Standard uncertainty of positions on the ball's plane, relative to the ball at rest.")
    elif page.session.layer == "residuals":
        _, factor, rms = residual_arrows(found, grid)
        note(
            f"Arrows from fitted to measured crossings, × {factor:g}; rms length {rms:.2f} px."
            " Arrows that rotate or have a common direction in one region indicate a bent wall or "
            "a distortion that the lens model can't represent."
        )
        note(f"χ² per degree of freedom {found.chi2_per_dof:.2f} (1: consistent with the noise).")


def _known_length(page: "WizardPage") -> None:
    session = page.session
    note("Verify a known length: select each end and click it in the image.", "text-body2")
    places_of(page, "end0", "end1")

    def plane(wall: bool) -> None:
        session.on_wall = wall
        judge()

    def length(text: str) -> None:
        session.known_length = text
        judge()

    ui.radio(
        {True: "on the wall", False: "on the ball's plane"},
        value=session.on_wall,
        on_change=lambda event: plane(event.value),
    ).props("dense inline data-test=plane")
    field("Known length (or empty)", session.known_length, length, test="known-length")
    shown = ui.label().props("data-test=length role=status").classes("w-full")

    def judge() -> None:
        there = session.outlook.calibration is not None and len(session.ends) == 2
        shown.set_visibility(there)
        if session.outlook.calibration is None or not there:
            return
        compared = compare_length(
            session.outlook.calibration,
            session.ends["end0"],
            session.ends["end1"],
            session.known_length,
            on_wall=session.on_wall,
        )
        shown.set_text(compared.text)
        add, remove = ("wz-bad", "text-body2") if compared.disagrees else ("text-body2", "wz-bad")
        shown.classes(add=add, remove=remove)

    page.follows(judge)


def _saving(page: "WizardPage") -> None:
    session = page.session
    out = session.answers.out
    there = out.exists()
    note(f"Writes {out} and lens.toml next to it{' (replaces the old files)' if there else ''}.")

    def save() -> None:
        page.saving_problem = ""
        try:
            session.save()
        except ImpactVisionError as problem:
            page.saving_problem = problem.in_one_line
        saved.refresh()
        enable()

    with ui.row().classes("gap-2"):
        button = ui.button("Save", on_click=save)
        button.props("unelevated no-caps color=teal-9 data-test=save")
        measure = ui.button("Measure", on_click=page.measure)
        measure.props("unelevated no-caps color=teal-9 data-test=measure")

    @ui.refreshable
    def saved() -> None:
        _saved(page)

    saved()

    def enable() -> None:
        button.set_enabled(session.outlook.calibration is not None and not page.jobs.busy)
        measure.set_enabled(session.written is not None)

    page.follows(enable)


def _saved(page: "WizardPage") -> None:
    written = page.session.written
    if page.saving_problem:
        note(phrase(page.saving_problem), "wz-bad", alert=True)
    elif written is not None:
        clip = page.session.answers.scene.info.path.name
        ui.label(
            f"Saved {written.setup} and {written.lens.name}. Now: vision measure {clip} "
            f"--setup {written.setup}"
        ).props("data-test=saved role=status").classes("text-body2")


OTHER = "another ball"

LENS_SOURCES = {"grid": "From the wall grid", "file": "Lens file", "board": "Images of a board"}


def _do(page: "WizardPage", label: str, changed: Callable[[Answers], Answers]) -> None:
    page.jobs.submit("computing", lambda: page.session.apply(label, changed))


def _draft(page: "WizardPage", label: str, value: str, name: str) -> Any:
    """A field read by a button; its text survives a redraw of the step."""
    drafts = page.session.drafts

    def keep(text: str) -> None:
        drafts[name] = text

    return field(label, drafts.get(name, value), keep, test=name)


def _clip_step(page: "WizardPage") -> None:
    answers = page.session.answers
    info, rate = answers.scene.info, answers.scene.rate
    stated = "none" if info.capture_fps_metadata is None else f"{info.capture_fps_metadata:g} fps"
    facts = (
        f"{info.codec}, {info.bit_depth} bit, {info.duration_s:.2f} s as played, at "
        f"{info.container_fps:.4g} frames per second; capture rate in the metadata: {stated}."
    )
    note(facts)
    for warning in info.warnings:
        note(warning, "wz-warn")
    value = f"{answers.capture_fps:g}" if answers.rate_known else ""
    field(
        "Capture rate of the camera, frames per second",
        value,
        lambda text: _do(
            page, f"capture rate {text or 'open'}", lambda a: replace(a, fps=rate_from(text))
        ),
        test="fps",
    )
    if not answers.rate_known:
        note(
            f"Unknown: {rate.fps:g} fps is assumed. Every time and speed scales with it, and "
            "gravity can't be used as a scale. Find it in the camera's menu or manual.",
            "wz-warn",
        )
    else:
        source = "as entered" if answers.fps is not None else f"from the {rate.source}"
        note(f"{answers.capture_fps:g} fps, {source}: free fall also determines the scale.")


def _lens_step(page: "WizardPage") -> None:
    session = page.session
    lens = session.answers.lens
    note(
        "The wall grid also determines the lens. A lens calibrated beforehand helps if the camera "
        "is perpendicular to the wall: then a grid can't separate focal length from distance."
    )

    def read_file(path: str) -> None:
        session.lens_path = path
        if path:
            size = session.answers.scene.size
            _do(page, "lens file", lambda a: replace(a, lens=lens_from_file(Path(path), size)))

    ways = ui.radio(
        LENS_SOURCES, value=session.lens_source, on_change=lambda event: choose(event.value)
    ).props("dense data-test=lens-way")
    ways.classes("w-full")

    def choose(way: str) -> None:
        session.lens_source = way
        if way == "grid" and session.answers.lens is not None:
            _do(page, "lens from the grid", lambda a: replace(a, lens=None))
        page.redraw_panel()

    if session.lens_source == "file":
        field("Path of the lens file (TOML)", session.lens_path, read_file, test="lens-file")
    elif session.lens_source == "board":
        _board_fields(page)
    if lens is not None:
        focal, std = lens.prior.lens.fx, lens.prior.std[0]
        note(f"{phrase(lens.description)} Focal length {focal:.1f} ± {focal * std:.1f} px.")


def _board_fields(page: "WizardPage") -> None:
    session = page.session
    folder = _draft(page, "Folder of the images", session.lens_path, "board")
    size = _draft(page, "Inner corners, columns x rows", "8x6", "board-size")
    square = _draft(page, "Side of a square", "25 mm", "board-square")
    charuco = ui.checkbox("ChArUco: markers in the white squares").props("dense")

    def measure() -> None:
        session.lens_path = str(folder.value)
        wanted = session.answers.scene.size

        def changed(answers: Answers) -> Answers:
            columns, rows = board_size(str(size.value))
            side = pitch_from(str(square.value))
            board = Board(columns, rows, side, bool(charuco.value))
            pictures = board_pictures(Path(str(folder.value)))
            return replace(answers, lens=lens_from_board(pictures, board, wanted))

        page.jobs.submit("calibrating the lens", lambda: session.apply("lens calibrated", changed))

    ui.button("Calibrate the lens", on_click=measure).props("outline no-caps color=teal-9")


def _wall_step(page: "WizardPage") -> None:
    session = page.session
    answers = session.answers

    def set_pitch(text: str) -> None:
        find(f"squares of {text}", lambda a: replace(a, pitch=pitch_from(text)))

    def set_fine(text: str) -> None:
        find(
            f"fine lines {text or 'none'}",
            lambda a: replace(a, fine_pitch=fine_pitch_from(text, a.pitch)),
        )

    def find(label: str, changed: Callable[[Answers], Answers]) -> None:
        again = with_corners if session.by_hand else with_grid
        page.jobs.submit(
            "searching for the wall grid", lambda: session.apply(label, lambda a: again(changed(a)))
        )

    with ui.row().classes("w-full no-wrap gap-2"):
        pitch = field("Side of a square", f"{1e3 * answers.pitch:g} mm", set_pitch, test="pitch")
        shown = "" if answers.fine_pitch is None else f"{1e3 * answers.fine_pitch:g} mm"
        field("Distance of fine lines (or empty)", shown, set_fine, test="fine")
        pitch.classes("grow")
    _wall_found(page)

    def by_hand(wanted: bool) -> None:
        session.by_hand = wanted
        page.places.active = "corner0" if wanted else None
        if not wanted:
            page.jobs.submit("searching for the wall grid", session.find_grid)
        page.redraw_panel()
        page.draw()

    ui.switch(
        "Set four corners by hand", value=session.by_hand, on_change=lambda e: by_hand(e.value)
    ).props("dense data-test=by-hand")
    if session.by_hand:
        _corner_fields(page)
    note("Origin of the wall coordinates (moved to the nearest crossing):")
    places_of(page, "origin")


def _wall_found(page: "WizardPage") -> None:
    grid, problem = page.session.answers.grid, page.session.grid_problem
    if grid is not None:
        how = {
            "found": "Found automatically",
            "corners": "Measured between your corners",
            "hand": "Your four corners",
        }[page.session.answers.grid_source]
        noise = float(np.sqrt(np.median(np.trace(grid.covariance_px2, axis1=1, axis2=2) / 2.0)))
        note(
            f"{how}: {len(grid.nodes)} crossings, each ± {noise:.2f} px, "
            f"{'dark' if grid.dark else 'bright'} lines.",
            "text-body2",
        )
    elif problem:
        note(phrase(problem), "wz-bad", alert=True)
        note("You can still set four corners by hand.")


def _corner_fields(page: "WizardPage") -> None:
    session = page.session
    note(
        "Drag each handle onto a crossing (use the loupe) and enter the number of squares between."
    )
    places_of(page, "corner0", "corner1", "corner2", "corner3")
    wide, high = session.answers.squares
    with ui.row().classes("w-full no-wrap gap-2"):
        across = _draft(page, "Squares across", str(wide), "across")
        up = _draft(page, "Squares up", str(high), "up")

    def measure() -> None:
        corners = page.places.corners.copy()

        def changed(answers: Answers) -> Answers:
            if not (str(across.value).isdecimal() and str(up.value).isdecimal()):
                raise UsageError(
                    "the number of squares between the handles must be whole",
                    hint="Enter a number such as 6.",
                )
            squares = (int(across.value), int(up.value))
            return with_corners(replace(answers, corners=corners, squares=squares))

        page.jobs.submit(
            "measuring between the corners", lambda: session.apply("corners set", changed)
        )

    ui.button("Measure between the corners", on_click=measure).props(
        "outline no-caps color=teal-9 data-test=measure-corners"
    )


def _ball_step(page: "WizardPage") -> None:
    session = page.session
    answers = session.answers
    names = [kind.name for kind in session.presets]
    ball = answers.ball
    chosen = None if ball is None else ball.name if answers.ball_named else OTHER
    ui.select(
        [*names, OTHER], value=chosen, label="Ball", on_change=lambda event: choose(event.value)
    ).props("dense outlined data-test=ball").classes("w-full")

    def choose(name: str) -> None:
        kind = {kind.name: kind for kind in session.presets}.get(name)
        if kind is None:
            like = ball or BallKind("ball", 0.2)
            own = BallKind("ball", like.diameter, like.mass)
            _do(page, "another ball", lambda a: with_ball(a, own, named=False))
        else:
            _do(page, f"ball {name}", lambda a: with_ball(a, kind, named=True))

    def size(text: str, weight: str) -> None:
        def changed(answers: Answers) -> Answers:
            diameter = read_number(text, measurands.BALL_DIAMETER)
            mass = read_number(weight, measurands.BALL_MASS) if weight else None
            return with_ball(answers, BallKind("ball", diameter, mass), named=False)

        _do(page, f"ball of {text}", changed)

    def set_height(text: str) -> None:
        def changed(answers: Answers) -> Answers:
            known = distance_from(text)
            return replace(answers, support_height=None if known is None else known.value)

        _do(page, "support height", changed)

    if ball is not None and not answers.ball_named:
        diameter = f"{1e3 * ball.diameter:g} mm"
        mass = "" if ball.mass is None else f"{ball.mass:g} kg"
        with ui.row().classes("w-full no-wrap gap-2"):
            field("Diameter", diameter, lambda text: size(text, mass), test="diameter")
            field("Mass (or empty)", mass, lambda text: size(diameter, text), test="mass")
    elif ball is not None:
        weight = "" if ball.mass is None else f", {1e3 * ball.mass:.0f} g"
        note(f"Diameter {1e3 * ball.diameter:.2f} mm{weight}.")
    height = "" if answers.support_height is None else f"{answers.support_height:g} m"
    field("Height of the support (height of fall)", height, set_height, test="support")
    _followed(page)
    places_of(page, "rest", "landing")


def _followed(page: "WizardPage") -> None:
    session = page.session
    seen = session.answers.seen
    if seen is not None and seen.rest_px is not None:
        landed = "" if seen.landing_px is None else " to its lowest position, the landing"
        note(f"The ball was tracked from rest{landed}.", "text-body2")
        return
    note(
        phrase(session.ball_problem.partition(". ")[0])
        + " Set its positions by hand, or select the ball and track it from there."
        if session.ball_problem
        else "The ball is not tracked yet: this determines its rest, landing and size."
    )

    def follow() -> None:
        at = session.answers.rest_px
        point = None if at is None else (float(at[0]), float(at[1]))
        page.jobs.submit("tracking the ball", lambda: session.follow_ball(point))

    ui.button("Track the ball", on_click=follow).props(
        "outline no-caps color=teal-9 data-test=follow"
    )


def _distances_step(page: "WizardPage") -> None:
    answers = page.session.answers
    note("Both may be empty: grid, ball and free fall determine them, less precisely than a tape.")
    _taped_field(page, "camera_distance", "Camera to wall", answers.camera_distance)
    _taped_field(page, "ball_plane_offset", "Ball's plane to wall", answers.ball_plane_offset)
    found = page.session.outlook.calibration
    if found is not None:
        for estimate in found.depth_estimates:
            text = f"{estimate.value:.3f} ± {estimate.std:.3f} m"
            note(f"Ball's plane to wall from {estimate.source} alone: {text}.")
        note(f"Camera to wall from all data: {found.camera_distance:.3f} m.")


def _taped_field(page: "WizardPage", key: str, label: str, known: Known | None) -> None:
    value = "" if known is None else f"{known.value:.10g} m"
    std = f"{1e3 * (0.005 if known is None else known.std):g} mm"

    def entered(text: str, spread: str) -> None:
        def changed(answers: Answers) -> Answers:
            given = distance_from(f"{text} ± {spread}") if text else None
            return replace(answers, **{key: given})  # type: ignore[arg-type]

        _do(page, f"{label.lower()} {text or 'open'}", changed)

    with ui.row().classes("w-full no-wrap gap-2"):
        field(f"{label} (measured)", value, lambda text: entered(text, std), test=key)
        spread = field("uncertainty ±", std, lambda text: entered(value, text), test=f"{key}-std")
        spread.style("max-width: 8rem")


PANELS: tuple[Callable[["WizardPage"], None], ...] = (
    _clip_step,
    _lens_step,
    _wall_step,
    _ball_step,
    _distances_step,
    check_step,
)

"""Each draws the panel of one step."""
