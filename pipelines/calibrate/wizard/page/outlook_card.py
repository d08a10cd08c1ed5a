"""The card that says how sure a landing will be, where it comes from, and what each answer did."""

from nicegui import ui

from metrology import UncertaintySource
from pipelines.calibrate.wizard.page.parts import millimetres, note, phrase
from pipelines.calibrate.wizard.session import Session

__all__ = ["outlook_card"]

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
