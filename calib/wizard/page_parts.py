"""Pieces of the page that several steps use: fields, rows for a place in the picture, phrases."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nicegui import ui

__all__ = [
    "FOCUS",
    "REFOCUS",
    "STYLE",
    "TYPING",
    "Place",
    "field",
    "millimetres",
    "note",
    "phrase",
    "place_row",
]

STYLE = """
body { background: #f3f5f6; color: #1d2b33; }
.wz-step { min-width: 0; color: #37474f; text-transform: none;
  border-radius: 6px; padding: 2px 10px; }
.wz-step[aria-current=step] { background: #0b5c66 !important; color: #fff !important; }
.wz-step.wz-done { color: #0b5c66; text-decoration: underline; }
.wz-card { background: #fff; border: 1px solid #d8dee2; border-radius: 8px; padding: 14px 16px; }
.wz-big { font-size: 2rem; font-weight: 650; line-height: 1.1; font-variant-numeric: tabular-nums; }
.wz-bar { height: 8px; background: #0b8a8f; border-radius: 2px; }
.wz-small { font-size: 0.85rem; color: #4a5b65; }
.wz-warn { background: #fff4d6; border-left: 4px solid #c98a00; padding: 6px 10px;
  font-size: 0.9rem; }
.wz-bad { background: #fde8e6; border-left: 4px solid #b3261e; padding: 6px 10px; }
.wz-loupe { flex: none; width: 168px; height: 168px; border-radius: 6px; border: 1px solid #9fb0ba;
  background-repeat: no-repeat; image-rendering: pixelated; position: relative;
  overflow: hidden; }
.wz-loupe::before, .wz-loupe::after { content: ''; position: absolute; background: #ff4f8b; }
.wz-loupe::before { left: 50%; top: 20%; bottom: 20%; width: 1px; }
.wz-loupe::after { top: 50%; left: 20%; right: 20%; height: 1px; }
.wz-picture { outline-offset: 2px; width: 100%; cursor: crosshair; }
.wz-picture img { -webkit-user-drag: none; user-select: none; }
.wz-picture:focus-visible { outline: 3px solid #0b8a8f; }
h1 { font-size: 1.25rem !important; font-weight: 650 !important; line-height: 1.3 !important;
  margin: 0 !important; }
h2 { font-size: 1.1rem !important; font-weight: 650 !important; line-height: 1.3 !important;
  margin: 0 !important; }
"""

FOCUS = """<script>document.addEventListener("focusin", event => {
  const named = event.target.closest("[data-test]");
  window.wizardFocus = named ? named.dataset.test : null;
});</script>"""
"""Remembers what has the focus, since a step that is drawn anew loses it."""
REFOCUS = """setTimeout(() => {
  if (document.activeElement !== document.body || !window.wizardFocus) return;
  const named = document.querySelector(`[data-test="${window.wizardFocus}"]`);
  if (named) named.focus();
}, 30)"""
TYPING = """(() => { const at = document.activeElement;
  return at.dataset.told !== undefined && at.value !== at.dataset.told; })()"""
"""Whether something is typed that was not yet told."""


@dataclass(frozen=True)
class Place:
    """A place in the picture that the user can set.

    Attributes
    ----------
    key : str
        Its name inside the page.
    label : str
        Its name on the page.
    """

    key: str
    label: str


def millimetres(length: float | None) -> str:
    """A length in mm with two or three digits, or an em dash."""
    if length is None:
        return "—"
    value = 1e3 * length
    return f"{value:.0f} mm" if value >= 99.5 else f"{value:.2g} mm"


def phrase(text: str) -> str:
    """The text as a sentence."""
    return text[:1].upper() + text[1:] + ("" if text[-1:] in ".!?" else ".")


def note(text: str, kind: str = "wz-small", *, alert: bool = False) -> None:
    """A remark; as an alert it is read aloud at once."""
    label = ui.label(text).classes(kind + " w-full")
    if alert:
        label.props("role=alert")


def field(label: str, value: str, told: Callable[[str], None], *, test: str) -> Any:
    """A text field that tells its text when it is left or Enter is pressed, if it has changed."""
    shown = ui.input(label, value=value).props(f'dense outlined data-test="{test}"')
    shown.props["data-told"] = value
    last = [value]

    def tell() -> None:
        text = str(shown.value or "").strip()
        if text != last[0]:
            last[0] = text
            shown.props["data-told"] = text
            told(text)

    shown.on("blur", tell)
    shown.on("keydown.enter", tell)
    return shown.classes("w-full")


def place_row(
    place: Place,
    px: tuple[float, float] | None,
    *,
    active: bool,
    choose: Callable[[], None],
    moved: Callable[[float, float], None],
) -> None:
    """A row for a place: choose it for clicks and arrow keys, or write its coordinates."""
    with ui.row().classes("w-full items-center no-wrap gap-2"):
        ui.button(place.label, on_click=choose).props(
            f"dense no-caps {'unelevated' if active else 'outline'} color=teal-9 "
            f'aria-pressed={"true" if active else "false"} data-test="place-{place.key}"'
        ).classes("grow").style("min-width: 9rem")
        shown = ["" if px is None else f"{value:.1f}" for value in px or (0.0, 0.0)]

        def told(axis: int, text: str) -> None:
            shown[axis] = text
            try:
                x, y = (float(part) for part in shown)
            except ValueError:
                return
            moved(x, y)

        for axis, name in enumerate("xy"):
            field(
                f"{name}, px",
                shown[axis],
                lambda text, axis=axis: told(axis, text),  # type: ignore[misc]
                test=f"{place.key}-{name}",
            ).style("max-width: 6rem")
