"""Drawing of the wizard's page: SVG overlays, user-set positions, fields."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from html import escape
from typing import Any

import cv2
import numpy as np
from nicegui import ui
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.grid import WallGrid, pixel_grid
from pipelines.calibrate.wizard.answers import Answers
from pipelines.calibrate.wizard.session import Session, starting_corners
from pipelines.web import Jobs

__all__ = [
    "LABELS",
    "PAGE_STYLE",
    "MapScale",
    "Place",
    "PlaceRow",
    "Places",
    "TextField",
    "encoded",
    "field",
    "grid_lines",
    "handles",
    "marks",
    "millimetres",
    "note",
    "phrase",
    "residual_arrows",
    "ruler",
    "shaded_map",
]

FloatArray = NDArray[np.float64]

LINE, MARK, ARROW, HANDLE = "#00a395", "#d6156c", "#b3261e", "#d35400"

RAMP = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")
"""Viridis, dark for small values."""

MAX_GRID_LINES = 120
"""Wall lines drawn (chosen: more merge into a grey surface and load slowly)."""

MAX_ARROWS = 300
"""Arrows of the lens map drawn (chosen, for the same reason)."""

LINE_POINTS = 24
"""Points of the polygon that draws a line distorted by the lens (chosen)."""


@dataclass(frozen=True)
class MapScale:
    """Range of the map's colours: smallest and largest uncertainty, m."""

    low: float
    high: float


def encoded(picture: NDArray[np.uint8]) -> bytes:
    """PNG of a picture."""
    return bytes(cv2.imencode(".png", picture)[1])


def _stroke(size: tuple[int, int], width: float) -> str:
    """Line width that appears equal on small and large images."""
    return f"{width * size[0] / 640:.2f}"


def grid_lines(grid: WallGrid) -> str:
    """Fitted coarse lines in the region of the grid, and its origin."""
    height, width = grid.area.shape
    step = max(1, width // 320)
    coordinates = grid.map(pixel_grid((height, width))[::step, ::step])
    inside = grid.area[::step, ::step]
    parts: list[str] = []
    for family in range(2):
        values = np.where(np.isfinite(coordinates[..., family]), coordinates[..., family], 0.0)
        seen = values[inside]
        first, last = int(np.ceil(seen.min())), int(np.floor(seen.max()))
        every = max(1, (last - first) // MAX_GRID_LINES)
        for level in range(first, last + 1, every):
            parts += _level(values - level, inside, step)
    body = "".join(parts)
    stroke = _stroke((width, height), 0.7)
    lines = f'<path d="{body}" fill="none" stroke="{LINE}" stroke-width="{stroke}" opacity="0.8"/>'
    return lines + _origin(grid)


def _level(values: FloatArray, inside: NDArray[np.bool_], step: int) -> Iterable[str]:
    """Segments of the line where values change sign, along the longer axis."""
    for axis in (0, 1):
        a, b = (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])
        ok = inside[:-1] if axis == 0 else inside[:, :-1]
        slope = np.abs(np.gradient(values, axis=axis)) >= np.abs(np.gradient(values, axis=1 - axis))
        slope = slope[:-1] if axis == 0 else slope[:, :-1]
        crossing = (a * b <= 0) & (a != b) & ok & slope
        rows, columns = np.nonzero(crossing)
        part = a[rows, columns] / (a[rows, columns] - b[rows, columns])
        x = (columns + (part if axis == 1 else 0.0)) * step
        y = (rows + (part if axis == 0 else 0.0)) * step
        order = np.argsort(x if axis == 0 else y)
        yield from _runs(np.asarray(x[order]), np.asarray(y[order]), 2.5 * step, axis)


def _runs(x: FloatArray, y: FloatArray, gap: float, axis: int) -> Iterable[str]:
    if len(x) < 2:
        return
    along = x if axis == 0 else y
    breaks = np.flatnonzero(np.diff(along) > gap) + 1
    for run in np.split(np.arange(len(x)), breaks):
        if len(run) < 2:
            continue
        chosen = run[np.unique(np.linspace(0, len(run) - 1, LINE_POINTS).astype(int))]
        points = " ".join(f"{x[i]:.1f},{y[i]:.1f}" for i in chosen)
        yield f"M{points}"


def _origin(grid: WallGrid) -> str:
    start = grid.points_px[np.argmin(np.abs(grid.wall_m).sum(axis=1))]
    px = grid.map.inverse(-grid.origin_m[np.newaxis] / grid.pitch_m, start[np.newaxis])[0]
    if not np.isfinite(px).all():
        return ""
    size = grid.size
    x, y = px
    arm = 14 * size[0] / 640
    return (
        f'<path d="M{x - arm:.1f},{y:.1f}H{x + arm:.1f}M{x:.1f},{y - arm:.1f}V{y + arm:.1f}"'
        f' stroke="{MARK}" stroke-width="{_stroke(size, 1.6)}"/>'
        + _label(px + 4 * size[0] / 640 * np.array([1.0, -1.0]), "0, 0", MARK, size)
    )


def _label(px: FloatArray, text: str, colour: str, size: tuple[int, int]) -> str:
    font = 11 * size[0] / 640
    anchor = "end" if px[0] > 0.85 * size[0] else "start"
    return (
        f'<text x="{px[0]:.1f}" y="{px[1]:.1f}" font-size="{font:.1f}" fill="{colour}" '
        f'style="paint-order: stroke; font-weight: 600" stroke="#fff" '
        f'stroke-width="{0.3 * font:.2f}" '
        f'text-anchor="{anchor}" font-family="sans-serif">{escape(text)}</text>'
    )


def handles(corners: FloatArray, active: int | None, size: tuple[int, int]) -> str:
    """Four handles and the frame between them."""
    radius = 6 * size[0] / 640
    frame = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    stroke = _stroke(size, 1.4)
    parts = [f'<polygon points="{frame}" fill="none" stroke="{HANDLE}" stroke-width="{stroke}"/>']
    for number, (x, y) in enumerate(corners):
        fill = HANDLE if number == active else "none"
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{fill}" fill-opacity="0.4" '
            f'stroke="{HANDLE}" stroke-width="{_stroke(size, 2)}"/>'
        )
        parts.append(_label(np.array([x + radius, y - radius]), str(number + 1), HANDLE, size))
    return "".join(parts)


def marks(answers: Answers, radius_px: float | None) -> str:
    """The ball at rest, the landing point and the path between."""
    size = answers.scene.size
    parts = []
    flight = None if answers.seen is None else answers.seen.flight
    if flight is not None:
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in flight.centre_px[::3])
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="{MARK}" '
            f'stroke-width="{_stroke(size, 1)}" stroke-dasharray="{_stroke(size, 4)}"/>'
        )
    landing, seen = answers.landing
    named = [(answers.rest, "ball at rest", True)]
    named.append((landing, "landing" if seen else "landing (assumed)", seen))
    for px, name, sure in named:
        if px is None:
            continue
        ring = radius_px or 7 * size[0] / 640
        dash = "" if sure else f' stroke-dasharray="{_stroke(size, 3)}"'
        parts.append(
            f'<circle cx="{px[0]:.1f}" cy="{px[1]:.1f}" r="{ring:.1f}" fill="none" '
            f'stroke="{MARK}" stroke-width="{_stroke(size, 1.6)}"{dash}/>'
            f'<circle cx="{px[0]:.1f}" cy="{px[1]:.1f}" r="{_stroke(size, 1.5)}" fill="{MARK}"/>'
        )
        parts.append(_label(px - np.array([0.0, 1.3 * ring]), name, MARK, size))
    return "".join(parts)


def residual_arrows(calibration: Calibration, grid: WallGrid) -> tuple[str, float, float]:
    """Arrows from fitted to measured crossings.

    Returns
    -------
    svg : str
    factor : float
        Magnification of the arrows.
    rms : float
        Root mean square length, px.
    """
    wall = np.c_[grid.wall_m, np.zeros(len(grid.nodes))]
    fitted = calibration.grid_camera.project(wall)
    error = grid.points_px - fitted
    length = np.hypot(*error.T)
    rms = float(np.sqrt(np.mean(length**2)))
    usual = max(float(np.median(length)), 1e-3)
    factor = float(10.0 ** np.floor(np.log10(12.0 * grid.size[0] / 640 / usual)))
    factor *= 5.0 if 5.0 * factor * usual < 12.0 * grid.size[0] / 640 else 1.0
    chosen = np.unique(np.linspace(0, len(error) - 1, MAX_ARROWS).astype(int))
    body = "".join(
        f"M{x:.1f},{y:.1f}l{dx:.2f},{dy:.2f}"
        for (x, y), (dx, dy) in zip(fitted[chosen], factor * error[chosen], strict=True)
    )
    dots = "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{_stroke(grid.size, 1.2)}"/>'
        for x, y in fitted[chosen]
    )
    stroke = _stroke(grid.size, 1.3)
    svg = f'<path d="{body}" fill="none" stroke="{ARROW}" stroke-width="{stroke}"/>'
    return f'{svg}<g fill="{ARROW}">{dots}</g>', factor, rms


def shaded_map(calibration: Calibration) -> tuple[str, MapScale]:
    """Uncertainty of positions on the ball plane, from the ball at rest, over the picture."""
    width = calibration.lens.width
    step = max(8, width // 40)
    px, std = calibration.uncertainty_map(step)
    finite = std[np.isfinite(std)]
    if len(finite) == 0:
        return "", MapScale(0.0, 0.0)
    scale = MapScale(float(finite.min()), float(np.percentile(finite, 98)))
    colour = _colouring(scale)
    cells = "".join(
        f'<rect x="{x - step / 2:.1f}" y="{y - step / 2:.1f}" width="{_cell_side(x, width, step)}" '
        f'height="{_cell_side(y, calibration.lens.height, step)}" '
        f'fill="{colour(value)}"/>'
        for (x, y), value in zip(px.reshape(-1, 2), std.ravel(), strict=True)
        if np.isfinite(value)
    )
    return f'<g opacity="0.6">{cells}</g>', scale


def _cell_side(at: float, length: int, step: int) -> float:
    """Side of a cell; the last one of a row ends at the image's edge."""
    return step + 0.3 if at + step < length else length - at + 0.5 * step


def _colouring(scale: MapScale) -> Callable[[float], str]:
    stops = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in RAMP], dtype=float)
    places = np.linspace(0.0, 1.0, len(RAMP))
    span = max(scale.high - scale.low, 1e-12)

    def colour(value: float) -> str:
        part = min(max((value - scale.low) / span, 0.0), 1.0)
        red, green, blue = (int(np.interp(part, places, stops[:, i])) for i in range(3))
        return f"#{red:02x}{green:02x}{blue:02x}"

    return colour


def ruler(ends: Mapping[str, FloatArray], size: tuple[int, int]) -> str:
    """The two ends of a length and the line between them."""
    arm = 6 * size[0] / 640
    body = "".join(
        f"M{x - arm:.1f},{y:.1f}H{x + arm:.1f}M{x:.1f},{y - arm:.1f}V{y + arm:.1f}"
        for x, y in ends.values()
    )
    if len(ends) == 2:
        (x, y), (u, v) = ends.values()
        body += f"M{x:.1f},{y:.1f}L{u:.1f},{v:.1f}"
    return (
        f'<path d="{body}" fill="none" stroke="{MARK}" stroke-width="{_stroke(size, 1.6)}"/>'
        if body
        else ""
    )


LABELS = {
    "corner0": "1 lower left",
    "corner1": "2 lower right",
    "corner2": "3 upper right",
    "corner3": "4 upper left",
    "origin": "Origin",
    "rest": "Ball at rest",
    "landing": "Landing",
    "end0": "One end",
    "end1": "Other end",
}

BY_STEP = {
    2: ("corner0", "corner1", "corner2", "corner3", "origin"),
    3: ("rest", "landing"),
    5: ("end0", "end1"),
}


class Places:
    """Positions set by the user, and which one clicks and arrow keys move.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        Runs slow work.

    Attributes
    ----------
    active : str or None
        Key of the position being set.
    """

    def __init__(self, session: Session, jobs: Jobs) -> None:
        self._session = session
        self._jobs = jobs
        self.active: str | None = None

    @property
    def by_hand(self) -> bool:
        """Whether the four handles are shown."""
        return self._session.by_hand

    @property
    def corners(self) -> FloatArray:
        """The handles, (4, 2), px."""
        session = self._session
        if session.handles is None:
            answers = session.answers
            session.handles = (
                starting_corners(answers.grid, answers.scene.size)
                if answers.corners is None
                else answers.corners.copy()
            )
        return session.handles

    def label(self, key: str) -> str:
        """Name of a position on the page."""
        return LABELS[key]

    def leave(self) -> None:
        """Reset the selection for another step."""
        if self.active not in BY_STEP.get(self._session.step, ()):
            self.active = None

    def where(self, key: str) -> FloatArray | None:
        """Coordinates of a position, px; None if not set."""
        answers = self._session.answers
        if key.startswith("corner"):
            return np.asarray(self.corners[int(key[-1])])
        if key.startswith("end"):
            return self._session.ends.get(key)
        if key in self._session.moving:
            return self._session.moving[key]
        if key == "origin":
            return answers.origin_px
        return answers.rest if key == "rest" else answers.landing[0]

    def grabbed(self, px: FloatArray, fraction: float) -> str | None:
        """The handle near a point, if handles are shown."""
        if self._session.step != 2 or not self.by_hand:
            return None
        far = np.linalg.norm(self.corners - px, axis=1)
        nearest = int(np.argmin(far))
        near = far[nearest] < fraction * self._session.answers.scene.size[0]
        return f"corner{nearest}" if near else None

    def put(self, key: str, px: FloatArray, *, final: bool) -> None:
        """Move a position; `final` when the mouse button is released."""
        session = self._session
        px = np.clip(px, -0.5, np.array(session.answers.scene.size) - 0.5)
        if key.startswith("corner"):
            self.corners[int(key[-1])] = px
        elif key.startswith("end"):
            session.ends[key] = px
        elif not final:
            session.moving[key] = px
        else:
            session.moving[key] = px
            self._jobs.submit("computing the uncertainty", lambda: self._settle(key, px))

    def _settle(self, key: str, px: FloatArray) -> None:
        session = self._session
        if session.moving.get(key) is not px:
            return  # superseded, as while a key is held down
        if key == "origin":
            session.apply("origin set", lambda answers: _with_origin(answers, px))
        else:
            fields: dict[str, Any] = {f"{key}_px": px}
            session.update(f"{LABELS[key].lower()} set", **fields)
        if session.moving.get(key) is px:
            del session.moving[key]

    def ruler(self) -> str:
        """Drawing of the length to verify."""
        return ruler(self._session.ends, self._session.answers.scene.size)


def _with_origin(answers: Answers, px: FloatArray) -> Answers:
    grid = None if answers.grid is None else answers.grid.with_origin(px, snap=True)
    return replace(answers, origin_px=px, grid=grid)


PAGE_STYLE = """
body { background: var(--ground, #f3f5f6); color: var(--ink, #1d2b33); }
.wz-step { min-width: 0; color: var(--ink, #37474f); text-transform: none;
  border-radius: 6px; padding: 2px 10px; }
.wz-step[aria-current=step] { background: #0b5c66 !important; color: #fff !important; }
.wz-step.wz-done { color: var(--accent, #0b5c66); text-decoration: underline; }
.wz-card { background: var(--card, #fff); border: 1px solid var(--line, #d8dee2);
  border-radius: 8px; padding: 14px 16px; }
.wz-big { font-size: 2rem; font-weight: 650; line-height: 1.1; font-variant-numeric: tabular-nums; }
.wz-bar { height: 8px; background: #0b8a8f; border-radius: 2px; }
.wz-small { font-size: 0.85rem; color: var(--muted, #4a5b65); }
.wz-warn { background: var(--warn-ground, #fff4d6); border-left: 4px solid #c98a00;
  padding: 6px 10px; font-size: 0.9rem; }
.wz-bad { background: var(--bad-ground, #fde8e6); border-left: 4px solid #b3261e;
  padding: 6px 10px; }
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
    """A position in the image that the user can set.

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
    """Show a remark; an alert is read aloud immediately by screen readers."""
    label = ui.label(text).classes(kind + " w-full")
    if alert:
        label.props("role=alert")


class TextField:
    """A text field that reports changed text when it loses focus or Enter is pressed.

    Parameters
    ----------
    label : str
    value : str
    on_change : callable
    test : str
        Its name for focus and tests.
    """

    def __init__(
        self, label: str, value: str, on_change: Callable[[str], None], *, test: str
    ) -> None:
        self.shown = ui.input(label, value=value).props(f'dense outlined data-test="{test}"')
        self._on_change = on_change
        self._last = value
        self.shown.props["data-told"] = value
        self.shown.on("blur", self._left)
        self.shown.on("keydown.enter", self._left)
        self.shown.classes("w-full")

    @property
    def text(self) -> str:
        """Its text."""
        return str(self.shown.value or "").strip()

    def show(self, value: str) -> None:
        """Show another value, unless the user is typing."""
        if self.text == self._last and value != self._last:
            self._changed(value)
            self.shown.set_value(value)

    def _changed(self, text: str) -> None:
        self._last = text
        self.shown.props["data-told"] = text
        self.shown.update()

    def _left(self) -> None:
        text = self.text
        if text != self._last:
            self._changed(text)
            self._on_change(text)


def field(label: str, value: str, on_change: Callable[[str], None], *, test: str) -> Any:
    """The input of a `TextField`."""
    return TextField(label, value, on_change, test=test).shown


class PlaceRow:
    """A row for a position: a button to select it, and its coordinates.

    Parameters
    ----------
    place : Place
    choose : callable
    moved : callable
        Called with the coordinates entered, px.
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
        """Show its coordinates, px, and whether it is selected."""
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
