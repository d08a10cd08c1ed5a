"""Pieces of the page that several steps use: fields, rows for a place in the picture, phrases."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nicegui import ui

__all__ = [
    "STYLE",
    "Place",
    "PlaceRow",
    "TextField",
    "field",
    "millimetres",
    "note",
    "phrase",
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


class TextField:
    """A text field that tells its text when it is left or Enter is pressed, if it has changed.

    Parameters
    ----------
    label : str
    value : str
    told : callable
    test : str
        Its name for focus and tests.
    """

    def __init__(self, label: str, value: str, told: Callable[[str], None], *, test: str) -> None:
        self.shown = ui.input(label, value=value).props(f'dense outlined data-test="{test}"')
        self._tell = told
        self._last = value
        self.shown.props["data-told"] = value
        self.shown.on("blur", self._left)
        self.shown.on("keydown.enter", self._left)
        self.shown.classes("w-full")

    @property
    def text(self) -> str:
        """What stands in it."""
        return str(self.shown.value or "").strip()

    def show(self, value: str) -> None:
        """Show another value, unless somebody is typing."""
        if self.text == self._last and value != self._last:
            self._told(value)
            self.shown.set_value(value)

    def _told(self, text: str) -> None:
        self._last = text
        self.shown.props["data-told"] = text
        self.shown.update()

    def _left(self) -> None:
        text = self.text
        if text != self._last:
            self._told(text)
            self._tell(text)


def field(label: str, value: str, told: Callable[[str], None], *, test: str) -> Any:
    """The input of a `TextField`."""
    return TextField(label, value, told, test=test).shown


class PlaceRow:
    """A row for a place: choose it for clicks and arrow keys, or write its coordinates.

    Parameters
    ----------
    place : Place
    choose : callable
    moved : callable
        Told the coordinates that were written, px.
    """

    def __init__(
        self, place: Place, choose: Callable[[], None], moved: Callable[[float, float], None]
    ) -> None:
        self._moved = moved
        with ui.row().classes("w-full items-center no-wrap gap-2"):
            self._button = ui.button(place.label, on_click=choose)
            self._button.props(f'dense no-caps color=teal-9 data-test="place-{place.key}"')
            self._button.classes("grow").style("min-width: 9rem")
            self._fields = [
                TextField(f"{name}, px", "", self._written, test=f"{place.key}-{name}")
                for name in "xy"
            ]
            for shown in self._fields:
                shown.shown.style("max-width: 6rem")

    def show(self, px: tuple[float, float] | None, *, active: bool) -> None:
        """Show where it is, px, and whether it is the one that is set."""
        add, remove = ("unelevated", "outline") if active else ("outline", "unelevated")
        pressed = "true" if active else "false"
        self._button.props(f"{add} aria-pressed={pressed}", remove=remove)
        for shown, value in zip(self._fields, px or (None, None), strict=True):
            shown.show("" if value is None else f"{value:.1f}")

    def _written(self, _: str) -> None:
        try:
            x, y = (float(shown.text) for shown in self._fields)
        except ValueError:
            return
        self._moved(x, y)
