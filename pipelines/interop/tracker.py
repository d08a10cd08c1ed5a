"""Tracker's projects (.trk, .trz) read and written, and its text export read.

Tracker (https://physlets.org/tracker) stores marks in pixels whose origin is the corner of the
first pixel, half a pixel off the pixel centres used here; the axes' angle is in degrees
(``ImageCoordSystem.FrameData`` of the Open Source Physics library).
"""

import math
import re
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import NDArray

from metrology import Defaults, UsageError, parse_quantity
from pipelines.interop.external import (
    ExternalTrack,
    ExternalTracks,
    PlaneOfMotion,
    Program,
    read_bytes,
    read_member,
    root_of,
)

__all__ = ["CORNER_PX", "read_trk", "tracker_project"]

FloatArray = NDArray[np.float64]

CORNER_PX = 0.5
"""Tracker's 0 is the corner of the first pixel, ours its centre."""
CLICKED_STD_PX = 0.5
"""px: how well an end of a calibration stick is clicked, each coordinate."""

_OBJECT = "org.opensourcephysics.cabrillo.tracker."
_MEDIA = "org.opensourcephysics.media.core."
_WHAT = "Tracker project"
_INDEX = re.compile(r"\[(\d+)\]$")


def read_trk(path: Path) -> ExternalTracks:
    """Read a Tracker project: a .trk file, or the .trz archive with its clip.

    Raises
    ------
    UsageError
        If it can't be read, or holds no marks.
    """
    packed = path.suffix.lower() == ".trz"
    data = read_member(path, ".trk", "Tracker archive") if packed else read_bytes(path, _WHAT)
    root = root_of(data, path, _WHAT)
    if root.get("class") != _OBJECT + "TrackerPanel":
        raise UsageError(
            f"{path} is no {_WHAT}", hint="Save one in Tracker with File > Save Tab As…"
        )
    interval_ms = _number(_inside(root, "clipcontrol"), "delta_t")
    tracks: list[ExternalTrack] = []
    sticks: list[float] = []
    for item in _inside_all(root, "tracks"):
        kind = (item.get("class") or "").removeprefix(_OBJECT)
        if kind == "PointMass":
            tracks.append(_point_mass(item, len(tracks)))
        elif kind in ("TapeMeasure", "CalibrationStick"):
            sticks += _stick_px(item)
    marked = tuple(track for track in tracks if len(track))
    if not marked:
        raise UsageError(
            f"{path} holds no marked point mass", hint="Mark or autotrack one in Tracker first."
        )
    width, height = _number(root, "width"), _number(root, "height")
    video = _inside(_inside(root, "videoclip"), "video")
    rate = None if not interval_ms else 1000.0 / interval_ms
    return ExternalTracks(
        path=path,
        program=Program.TRACKER,
        tracks=tuple(_timed(track, rate) for track in marked),
        size=None if width is None or height is None else (int(width), int(height)),
        fps=rate,
        plane=_plane(root, sticks, path),
        clip=_text(video, "path"),
    )


def _timed(track: ExternalTrack, rate: float | None) -> ExternalTrack:
    if rate is None:
        return track
    return ExternalTrack(track.name, track.frame, track.px, track.frame / rate)


def _property(parent: Element | None, name: str) -> Element | None:
    if parent is None:
        return None
    return next((one for one in parent.findall("property") if one.get("name") == name), None)


def _inside(parent: Element | None, name: str) -> Element | None:
    held = _property(parent, name)
    return None if held is None else held.find("object")


def _inside_all(parent: Element, name: str) -> list[Element]:
    held = _property(parent, name)
    if held is None:
        return []
    found = (one.find("object") for one in held.findall("property"))
    return [one for one in found if one is not None]


def _text(parent: Element | None, name: str) -> str | None:
    held = _property(parent, name)
    return None if held is None or held.text is None else held.text.strip()


def _number(parent: Element | None, name: str) -> float | None:
    text = _text(parent, name)
    try:
        value = math.nan if text is None else float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _frame_data(item: Element) -> dict[int, Element]:
    """Entries of ``framedata`` by the index of their picture."""
    held = _property(item, "framedata")
    found: dict[int, Element] = {}
    for one in [] if held is None else held.findall("property"):
        index = _INDEX.match(one.get("name") or "")
        entry = one.find("object")
        if index is not None and entry is not None:
            found[int(index[1])] = entry
    return found


def _point_mass(item: Element, number: int) -> ExternalTrack:
    rows = []
    for frame, entry in sorted(_frame_data(item).items()):
        x, y = _number(entry, "x"), _number(entry, "y")
        if x is not None and y is not None:
            rows.append((frame, x - CORNER_PX, y - CORNER_PX))
    table = np.array(rows, dtype=float).reshape(-1, 3)
    name = _text(item, "name") or f"mass {chr(ord('A') + number % 26)}"
    return ExternalTrack(name, table[:, 0].astype(np.int64), table[:, 1:])


def _stick_px(item: Element) -> list[float]:
    """Lengths of a stick or tape, px."""
    lengths = []
    for entry in _frame_data(item).values():
        ends = [_number(entry, name) for name in ("x1", "y1", "x2", "y2")]
        if None not in ends:
            x1, y1, x2, y2 = (float(end or 0.0) for end in ends)
            lengths.append(math.hypot(x2 - x1, y2 - y1))
    return lengths


def _plane(root: Element, sticks: list[float], path: Path) -> PlaneOfMotion | None:
    entries = _frame_data(_inside(root, "coords") or Element("none"))
    if not entries:
        return None
    axes = entries[min(entries)]
    origin = [_number(axes, name) for name in ("xorigin", "yorigin")]
    scale, across = _number(axes, "xscale"), _number(axes, "yscale")
    if None in origin or scale is None or scale <= 0.0 or (scale == 1.0 and across == 1.0):
        # 1 px per unit is what a project without a calibration has
        return None
    try:
        unit_m = parse_quantity(f"1 {_text(root, 'length_unit') or 'm'}", "m")
    except UsageError as problem:
        raise UsageError(f"{path}: {problem.message}") from problem
    longest = max(sticks, default=0.0)
    clicked = math.sqrt(2.0) * CLICKED_STD_PX / longest if longest > 0.0 else 0.0
    return PlaneOfMotion(
        px_per_m=scale / unit_m,
        relative_std=math.hypot(clicked, Defaults.STICK_SCALE.std),
        origin_px=np.array([float(part or 0.0) for part in origin]) - CORNER_PX,
        turn_rad=math.radians(_number(axes, "angle") or 0.0),
    )


def tracker_project(external: ExternalTracks) -> str:
    """Text of a .trk file with one point mass per track.

    Parameters
    ----------
    external : ExternalTracks
        Its frames count from the clip's first; its clip is named relative to where the file goes.
    """
    root = Element("object", {"class": _OBJECT + "TrackerPanel"})
    if external.size is not None:
        _add(root, "width", "double", float(external.size[0]))
        _add(root, "height", "double", float(external.size[1]))
    last = max((int(track.frame.max()) for track in external.tracks if len(track)), default=0)
    _add_clip(root, external, last + 1)
    if external.fps is not None:
        control = _add_object(root, "clipcontrol", _MEDIA + "StepperClipControl")
        _add(control, "rate", "double", 1.0)
        _add(control, "delta_t", "double", 1000.0 / external.fps)
    _add_axes(root, external.plane)
    if external.plane is not None:
        _add(root, "length_unit", "string", "m")
    held = SubElement(
        root,
        "property",
        {"name": "tracks", "type": "collection", "class": "java.util.ArrayList"},
    )
    for number, track in enumerate(external.tracks):
        _add_mass(held, track, _COLOURS[number % len(_COLOURS)])
    indent(root, space="    ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


_COLOURS = ((255, 0, 0), (0, 160, 255), (0, 200, 0), (255, 160, 0))
"""Red, green, blue of 255: colours that are told apart on a bright wall, as Tracker starts with."""


def _add(parent: Element, name: str, kind: str, value: object) -> None:
    SubElement(parent, "property", {"name": name, "type": kind}).text = (
        repr(value) if isinstance(value, float) else str(value)
    )


def _add_object(parent: Element, name: str, kind: str) -> Element:
    held = SubElement(parent, "property", {"name": name, "type": "object"})
    return SubElement(held, "object", {"class": kind})


def _add_clip(root: Element, external: ExternalTracks, count: int) -> None:
    clip = _add_object(root, "videoclip", _MEDIA + "VideoClip")
    if external.clip is not None:
        video = _add_object(clip, "video", "org.opensourcephysics.media.xuggle.XuggleVideo")
        _add(video, "path", "string", external.clip)
    _add(clip, "video_framecount", "int", count)
    _add(clip, "startframe", "int", 0)
    _add(clip, "stepsize", "int", 1)
    _add(clip, "stepcount", "int", count)
    _add(clip, "starttime", "double", 0.0)


def _add_axes(root: Element, plane: PlaneOfMotion | None) -> None:
    if plane is None:
        return
    coords = _add_object(root, "coords", _MEDIA + "ImageCoordSystem")
    for name in ("fixedorigin", "fixedangle", "fixedscale"):
        _add(coords, name, "boolean", "true")
    kind = _MEDIA + "ImageCoordSystem$FrameData"
    held = SubElement(
        coords, "property", {"name": "framedata", "type": "array", "class": f"[L{kind};"}
    )
    axes = _add_object(held, "[0]", kind)
    origin = plane.origin_px + CORNER_PX
    _add(axes, "xorigin", "double", float(origin[0]))
    _add(axes, "yorigin", "double", float(origin[1]))
    _add(axes, "angle", "double", math.degrees(plane.turn_rad))
    _add(axes, "xscale", "double", float(plane.px_per_m))
    _add(axes, "yscale", "double", float(plane.px_per_m))


def _add_mass(parent: Element, track: ExternalTrack, colour: tuple[int, int, int]) -> None:
    item = SubElement(parent, "property", {"name": "item", "type": "object"})
    mass = SubElement(item, "object", {"class": _OBJECT + "PointMass"})
    _add(mass, "mass", "double", 1.0)
    _add(mass, "name", "string", track.name)
    shade = _add_object(mass, "color", "java.awt.Color")
    for name, value in zip(("red", "green", "blue", "alpha"), (*colour, 255), strict=True):
        _add(shade, name, "int", value)
    _add(mass, "footprint", "string", "Footprint.Diamond")
    _add(mass, "visible", "boolean", "true")
    _add(mass, "trail", "boolean", "true")
    kind = _OBJECT + "PointMass$FrameData"
    held = SubElement(
        mass, "property", {"name": "framedata", "type": "array", "class": f"[L{kind};"}
    )
    for frame, (x, y) in zip(track.frame, track.px + CORNER_PX, strict=True):
        mark = _add_object(held, f"[{int(frame)}]", kind)
        _add(mark, "x", "double", float(x))
        _add(mark, "y", "double", float(y))
