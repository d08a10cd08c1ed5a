"""The sixth step: look at residuals and uncertainty, verify a known length, save."""

from typing import TYPE_CHECKING

from nicegui import ui

from metrology import ImpactVisionError
from pipelines.calibrate.wizard.checking import verdict
from pipelines.calibrate.wizard.page.drawing import RAMP, residual_arrows, shaded_map
from pipelines.calibrate.wizard.page.parts import field, millimetres, note, phrase
from pipelines.calibrate.wizard.page.rows import places_of

if TYPE_CHECKING:
    from pipelines.calibrate.wizard.page.page import WizardPage

__all__ = ["check_step"]

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
        note("How far off a position on the ball's plane may be, against the ball at rest.")
    elif page.session.layer == "residuals":
        _, factor, rms = residual_arrows(found, grid)
        note(
            f"Arrows from fitted to measured crossings, {factor:g} times too long; root mean "
            f"square {rms:.2f} px. Arrows that swirl or point one way in one region tell of a "
            "bent wall or a lens the fit can't follow."
        )
        note(f"χ² per degree of freedom {found.chi2_per_dof:.2f} (1: as the noise has it).")


def _known_length(page: "WizardPage") -> None:
    session = page.session
    note("Verify a length you know: choose each end, click it in the picture.", "text-body2")
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
    field("Its known length (or empty)", session.known_length, length, test="known-length")
    shown = ui.label().props("data-test=length role=status").classes("w-full")

    def judge() -> None:
        there = session.outlook.calibration is not None and len(session.ends) == 2
        shown.set_visibility(there)
        if session.outlook.calibration is None or not there:
            return
        told = verdict(
            session.outlook.calibration,
            session.ends["end0"],
            session.ends["end1"],
            session.known_length,
            on_wall=session.on_wall,
        )
        shown.set_text(told.text)
        add, remove = ("wz-bad", "text-body2") if told.disagrees else ("text-body2", "wz-bad")
        shown.classes(add=add, remove=remove)

    page.follows(judge)


def _saving(page: "WizardPage") -> None:
    session = page.session
    out = session.answers.out
    there = out.exists()
    note(f"Writes {out} and, beside it, lens.toml{' (replacing what is there)' if there else ''}.")

    def save() -> None:
        page.saving_problem = ""
        try:
            session.save()
        except ImpactVisionError as problem:
            page.saving_problem = problem.in_one_line
        saved.refresh()

    with ui.row().classes("gap-2"):
        button = ui.button("Save", on_click=save)
        button.props("unelevated no-caps color=teal-9 data-test=save")
        ui.button("Close the wizard", on_click=page.finish).props(
            "outline no-caps color=teal-9 data-test=close"
        )

    @ui.refreshable
    def saved() -> None:
        _saved(page)

    saved()

    def enable() -> None:
        button.set_enabled(session.outlook.calibration is not None and not page.jobs.busy)

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
