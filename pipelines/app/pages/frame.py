"""The frame with outlines, time line and points, of the pages Clip and Set up."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import ui

from pipelines.app.marks import EVENTS
from pipelines.app.session import ClipSession
from pipelines.app.words import Say

__all__ = ["ClipFrame", "FramePoint", "PlacedAt", "heading"]


def heading(tag: str, text: str) -> ui.label:
    """A label within an element of that kind: h1, h2 or summary."""
    with ui.element(tag):
        return ui.label(text)


@dataclass(frozen=True)
class FramePoint:
    """A point that is drawn in every frame and can be dragged.

    Attributes
    ----------
    kind : str
        Its key.
    x, y : float
        px.
    join : str
        Key of another point, to which a line is drawn.
    """

    kind: str
    x: float
    y: float
    label: str = ""
    join: str = ""


@dataclass(frozen=True)
class PlacedAt:
    """A place in a frame that a person pointed at or dragged something to.

    Attributes
    ----------
    kind : str
        Of the object or point.
    x, y : float
        px, within the frame.
    pointed : bool
        Whether it was pointed at rather than dragged.
    """

    kind: str
    frame: int
    x: float
    y: float
    pointed: bool


class ClipFrame:
    """The frame in one window.

    Parameters
    ----------
    marks : str
        Address of the outlines; empty for none.
    """

    def __init__(self, clip: ClipSession, say: Say, marks: str = "") -> None:
        self.clip, self.say, self.marks = clip, say, marks
        self.mode = ""
        self._points: list[FramePoint] = []
        self._opened = False
        self._buttons: dict[str, Any] = {}

    def build(self) -> None:
        """Lay the frame out."""
        ui.element("div").props("id=viewer").classes("w-full")
        self._hint = ui.label(self.say("point_at")).classes("va-small").props("role=status")
        self._hint.set_visibility(False)

    def button(self, kind: str, label: str) -> None:
        """A button after which a place for the point can be selected in the frame."""
        button = ui.button(label, on_click=lambda: self.point(kind))
        button.props(f"outline dense aria-pressed=false data-test=point-{kind}")
        self._buttons[kind] = button

    def offer(self, kind: str, *, offered: bool) -> None:
        """Show or hide the button of a point."""
        self._buttons[kind].set_visibility(offered)

    def point(self, kind: str, *, shown_as: str = "") -> None:
        """Select a place for this kind next; again, or with "", none."""
        self.mode = "" if kind == self.mode else kind
        pressed = (shown_as or self.mode) if self.mode else ""
        for name, button in self._buttons.items():
            button.props(f"aria-pressed={'true' if pressed == name else 'false'}")
        self._hint.set_visibility(bool(self.mode))
        ui.run_javascript(f"visionViewer.mode({json.dumps(self.mode)})")

    def points(self, points: Sequence[FramePoint]) -> None:
        """Draw these points."""
        if list(points) != self._points:
            self._points = list(points)
            ui.run_javascript(f"visionViewer.points({json.dumps(self._drawn)})")

    @property
    def _drawn(self) -> list[dict[str, Any]]:
        return [vars(one) for one in self._points]

    def open(self) -> bool:
        """Show the clip once it is open; true the first time."""
        frames = self.clip.frames
        info = frames.info
        if info is None:
            return False
        if not self._opened:
            self._opened = True
            ui.run_javascript(f"visionViewer.open({json.dumps(self._config())})")
            return True
        if frames.ended and frames.ready != info.frames:
            ui.run_javascript(f"visionViewer.frames({frames.ready})")
        return False

    def facts(self) -> str:
        """Size, number of frames and rate of the clip; empty until it is open."""
        info = self.clip.frames.info
        if info is None:
            return ""
        rate = "" if info.capture_fps_metadata is None else f"{info.capture_fps_metadata:g} fps"
        return self.say(
            "facts",
            width=info.width,
            height=info.height,
            frames=info.frames,
            rate=rate or info.codec,
        )

    def placed(self, name: str, sent: Mapping[str, Any]) -> PlacedAt | None:
        """What the browser reports as placed; None if nothing was, or it is out of date."""
        mode, pointed = self.mode, name == "pointed"
        if pointed:
            self.point("")
        try:
            kind, frame = str(sent["object"]), int(sent["frame"])
            x, y = float(sent["x"]), float(sent["y"])
        except (KeyError, TypeError, ValueError):
            return None
        info = self.clip.frames.info
        if info is None or not 0 <= frame < info.frames or (pointed and kind != mode):
            return None
        x, y = min(max(x, -0.5), info.width - 0.5), min(max(y, -0.5), info.height - 0.5)
        return PlacedAt(kind, frame, round(x, 2), round(y, 2), pointed)

    def _config(self) -> dict[str, Any]:
        info, say = self.clip.frames.info, self.say
        assert info is not None
        names = ("stage", "timeline", "frame", "back", "forward", "play", "larger", "smaller")
        return {
            "host": "#viewer",
            "clip": self.clip.number,
            "width": info.width,
            "height": info.height,
            "frames": info.frames,
            "marks": self.marks,
            "points": self._drawn,
            "words": {
                **{name: say(name) for name in names},
                "objects": {name: say(name) for name in ("ball", "pendulum")},
                "events": {name: say(name) for name in EVENTS},
            },
        }
