"""Read and write projects of Tracker and annotations of Kinovea.

Tracker (https://physlets.org/tracker; .trk, .trz, and its text export) stores marks in pixels whose
origin is the corner of the first pixel, half a pixel from the pixel centres used here; the axes'
angle is in degrees (``ImageCoordSystem.FrameData`` of the Open Source Physics library).

Kinovea (https://www.kinovea.org; .kva) stores a track as ``x;y;t`` in pixels from the corner of the
first pixel and ticks of its clip; older versions count the ticks from the track's first mark. A
track's plane is a line or a quadrilateral of known size (``CalibratorHelper`` of its source).
"""

import math
import re
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import cv2
import numpy as np
from numpy.typing import NDArray

from metrology import Defaults, UsageError, parse_quantity
from pipelines.interop.external import (
    ExternalTrack,
    ExternalTracks,
    PlaneOfMotion,
    Program,
    numbers,
    read_bytes,
    read_member,
    root_of,
    text_of,
)

__all__ = [
    "PIXEL_CORNER",
    "kinovea_annotations",
    "read_kva",
    "read_trk",
    "tracker_project",
]

FloatArray = NDArray[np.float64]

PIXEL_CORNER = 0.5
"""px: origin of Tracker and Kinovea (corner of the first pixel) relative to its centre."""
CLICKED_STD_PX = 0.5
"""px: standard uncertainty of a clicked end of a calibration stick, per coordinate (assumed)."""

_OBJECT = "org.opensourcephysics.cabrillo.tracker."
_MEDIA = "org.opensourcephysics.media.core."
_PROJECT = "Tracker project"
_FRAME_INDEX = re.compile(r"\[(\d+)\]$")


def read_trk(path: Path) -> ExternalTracks:
    """Read a Tracker project: a .trk file, or the .trz archive with its clip.

    Raises
    ------
    UsageError
        If it can't be read, or contains no marks.
    """
    packed = path.suffix.lower() == ".trz"
    data = read_member(path, ".trk", "Tracker archive") if packed else read_bytes(path, _PROJECT)
    root = root_of(data, path, _PROJECT)
    if root.get("class") != _OBJECT + "TrackerPanel":
        raise UsageError(
            f"{path} is not a {_PROJECT}", hint="Save one in Tracker with File > Save Tab As…"
        )
    interval_ms = _number_at(_inside(root, "clipcontrol"), "delta_t")
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
            f"{path} contains no marked point mass", hint="Mark or autotrack one in Tracker first."
        )
    width, height = _number_at(root, "width"), _number_at(root, "height")
    video = _inside(_inside(root, "videoclip"), "video")
    rate = None if not interval_ms else 1000.0 / interval_ms
    return ExternalTracks(
        path=path,
        program=Program.TRACKER,
        tracks=tuple(_timed(track, rate) for track in marked),
        size=None if width is None or height is None else (int(width), int(height)),
        fps=rate,
        plane=_plane_of_axes(root, sticks, path),
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


def _number_at(parent: Element | None, name: str) -> float | None:
    text = _text(parent, name)
    try:
        value = math.nan if text is None else float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _frame_data(item: Element) -> dict[int, Element]:
    """Entries of ``framedata`` by frame index."""
    held = _property(item, "framedata")
    found: dict[int, Element] = {}
    for one in [] if held is None else held.findall("property"):
        index = _FRAME_INDEX.match(one.get("name") or "")
        entry = one.find("object")
        if index is not None and entry is not None:
            found[int(index[1])] = entry
    return found


def _point_mass(item: Element, number: int) -> ExternalTrack:
    rows = []
    for frame, entry in sorted(_frame_data(item).items()):
        x, y = _number_at(entry, "x"), _number_at(entry, "y")
        if x is not None and y is not None:
            rows.append((frame, x - PIXEL_CORNER, y - PIXEL_CORNER))
    table = np.array(rows, dtype=float).reshape(-1, 3)
    name = _text(item, "name") or f"mass {chr(ord('A') + number % 26)}"
    return ExternalTrack(name, table[:, 0].astype(np.int64), table[:, 1:])


def _stick_px(item: Element) -> list[float]:
    """Lengths of a stick or tape, px."""
    lengths = []
    for entry in _frame_data(item).values():
        ends = [_number_at(entry, name) for name in ("x1", "y1", "x2", "y2")]
        if None not in ends:
            x1, y1, x2, y2 = (float(end or 0.0) for end in ends)
            lengths.append(math.hypot(x2 - x1, y2 - y1))
    return lengths


def _plane_of_axes(root: Element, sticks: list[float], path: Path) -> PlaneOfMotion | None:
    entries = _frame_data(_inside(root, "coords") or Element("none"))
    if not entries:
        return None
    axes = entries[min(entries)]
    origin = [_number_at(axes, name) for name in ("xorigin", "yorigin")]
    scale, across = _number_at(axes, "xscale"), _number_at(axes, "yscale")
    if None in origin or scale is None or scale <= 0.0 or (scale == 1.0 and across == 1.0):
        # a project without a calibration has 1 px per unit
        return None
    try:
        unit_m = parse_quantity(f"1 {_text(root, 'length_unit') or 'm'}", "m")
    except UsageError as problem:
        raise UsageError(
            f"{path}: {problem.message}",
            hint="Set the unit of length in Tracker's clip settings to m, cm or mm.",
        ) from problem
    longest = max(sticks, default=0.0)
    clicked = math.sqrt(2.0) * CLICKED_STD_PX / longest if longest > 0.0 else 0.0
    return PlaneOfMotion(
        px_per_m=scale / unit_m,
        relative_std=math.hypot(clicked, Defaults.STICK_SCALE.std),
        origin_px=np.array([float(part or 0.0) for part in origin]) - PIXEL_CORNER,
        turn_rad=math.radians(_number_at(axes, "angle") or 0.0),
    )


def tracker_project(external: ExternalTracks) -> str:
    """Text of a .trk file with one point mass per track.

    Parameters
    ----------
    external : ExternalTracks
        Its frames count from the clip's first; the clip's path is relative to the output.
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
        _add_mass(held, track, _TRACK_COLOURS[number % len(_TRACK_COLOURS)])
    indent(root, space="    ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


_TRACK_COLOURS = ((255, 0, 0), (0, 160, 255), (0, 200, 0), (255, 160, 0))
"""Red, green, blue of 255: distinguishable on a bright wall, as in Tracker."""


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
    origin = plane.origin_px + PIXEL_CORNER
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
    for frame, (x, y) in zip(track.frame, track.px + PIXEL_CORNER, strict=True):
        mark = _add_object(held, f"[{int(frame)}]", kind)
        _add(mark, "x", "double", float(x))
        _add(mark, "y", "double", float(y))


_ANNOTATION = "Kinovea annotation file"
_MAX_FRAME_NUMBER = 2.0**31
"""Largest frame count of any container."""
_MAX_SCALE_VARIATION = 0.02
"""Relative (assumed): if the local scale of a quadrilateral varies by more along the track, it is
refused."""


def read_kva(path: Path) -> ExternalTracks:
    """Read a Kinovea annotation file (format 1.3 and later).

    Raises
    ------
    UsageError
        If it can't be read, contains no track, or a plane that is oblique to the motion.
    """
    root = root_of(read_bytes(path, _ANNOTATION), path, _ANNOTATION)
    if root.tag != "KinoveaVideoAnalysis":
        raise UsageError(
            f"{path} is not a {_ANNOTATION}", hint="Save one in Kinovea with File > Save."
        )
    ticks = _positive(text_of(root, "AverageTimeStampsPerFrame")) or 1.0
    start = _number(text_of(root, "FirstTimeStamp")) or 0.0
    rate = _positive(text_of(root, "CaptureFramerate")) or _positive(text_of(root, "UserFramerate"))
    tracks = [_track(one, k, ticks, start, rate) for k, one in enumerate(root.iter("Track"))]
    marked = tuple(track for track in tracks if len(track))
    if not marked:
        raise UsageError(f"{path} contains no track", hint="Track a point in Kinovea first.")
    size = numbers(text_of(root, "ImageSize"), 2)
    return ExternalTracks(
        path=path,
        program=Program.KINOVEA,
        tracks=marked,
        size=None if size is None else (int(size[0]), int(size[1])),
        fps=rate,
        plane=_plane_of_grid(root, marked, path),
        clip=text_of(root, "OriginalFilename"),
    )


def _number(text: str | None) -> float | None:
    try:
        value = math.nan if text is None else float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _positive(text: str | None) -> float | None:
    value = _number(text)
    return value if value is not None and value > 0.0 else None


def _track(
    item: Element, number: int, ticks: float, start: float, rate: float | None
) -> ExternalTrack:
    points = [numbers(point.text, 3) for point in item.iter("TrackPoint")]
    rows = np.array([point for point in points if point is not None], dtype=float).reshape(-1, 3)
    label = item.find("MainLabel")
    name = item.get("name") or (None if label is None else label.get("Text"))
    begins = _number(text_of(item, "TimePosition"))
    tick = rows[:, 2]
    with np.errstate(over="ignore", invalid="ignore"):
        if begins is not None and len(tick) and tick[0] < begins - 0.5 * ticks:
            # before 0.8.16 ticks counted from the track's first mark
            tick = tick - tick[0] + begins
        counted = np.rint((tick - start) / ticks)
    if not (np.isfinite(rows).all() and (np.abs(counted) < _MAX_FRAME_NUMBER).all()):
        raise UsageError(
            f"track {name or number + 1}: a mark has no valid position or time",
            hint="Open the file in Kinovea and save it again, or export the track as text.",
        )
    frame, first = np.unique(counted.astype(np.int64), return_index=True)
    px = rows[first, :2] - PIXEL_CORNER
    return ExternalTrack(
        (name or f"track {number + 1}").strip(),
        frame,
        px,
        None if rate is None else frame / rate,
    )


def _plane_of_grid(
    root: Element, tracks: tuple[ExternalTrack, ...], path: Path
) -> PlaneOfMotion | None:
    held = root.find("Calibration")
    if held is None:
        return _old_scale(root, tracks)
    unit_m = _unit_m(held)
    line, quad = held.find("CalibrationLine"), held.find("CalibrationPlane")
    if unit_m is None or (line is None and quad is None):
        return None
    origin = numbers(text_of(line if line is not None else quad, "Origin"), 2)  # type: ignore[arg-type]
    middle = np.median(np.vstack([track.px for track in tracks]), axis=0)
    placed = origin is not None and bool(np.isfinite(origin).all()) and line is not None
    zero = np.array(origin) - PIXEL_CORNER if placed else middle
    if line is not None:
        per_m, spread = _line_scale(line, unit_m)
        if per_m is None:
            return None
        turn = _line_turn(line)
        return PlaneOfMotion(per_m, math.hypot(spread, Defaults.STICK_SCALE.std), zero, turn)
    assert quad is not None
    return _quad_scale(quad, unit_m, tracks, path)


def _unit_m(held: Element) -> float | None:
    unit = held.find("Unit")
    word = None if unit is None else unit.get("Abbreviation")
    try:
        return None if word in (None, "px", "%") else parse_quantity(f"1 {word}", "m")
    except UsageError:
        return None


def _line_scale(line: Element, unit_m: float) -> tuple[float | None, float]:
    """Pixels per metre of a line, with the relative uncertainty of its clicked ends."""
    length, segment = _positive(text_of(line, "Length")), line.find("Segment")
    if length is not None and segment is not None:
        ends = [numbers(text_of(segment, name), 2) for name in ("A", "B")]
        if ends[0] is None or ends[1] is None:
            return None, 0.0
        long = math.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1])
        if long <= 0.0:
            return None, 0.0
        return long / (length * unit_m), math.sqrt(2.0) * CLICKED_STD_PX / long
    per_px = _positive(text_of(line, "Scale"))
    return (None, 0.0) if per_px is None or per_px == 1.0 else (1.0 / (per_px * unit_m), 0.0)


def _line_turn(line: Element) -> float:
    """Angle of the x axis above the image rows, rad: 0 unless the line defines an axis."""
    segment, kind = line.find("Segment"), text_of(line, "Axis")
    if segment is None or kind not in _AXIS_ANGLES:
        return 0.0
    start, end = (numbers(text_of(segment, name), 2) for name in ("A", "B"))
    if start is None or end is None:
        return 0.0
    slope = math.atan2(start[1] - end[1], end[0] - start[0]) - _AXIS_ANGLES[kind]
    # a line from right to left or downwards defines the same axis
    return math.remainder(slope, math.pi)


_AXIS_ANGLES = {"LineHorizontal": 0.0, "LineVertical": math.pi / 2}
"""``CalibrationAxis``: angle of the axis that the line defines, rad."""


def _quad_scale(
    quad: Element, unit_m: float, tracks: tuple[ExternalTrack, ...], path: Path
) -> PlaneOfMotion | None:
    """Scale of a quadrilateral along the tracks; refused if it varies."""
    size, shape = numbers(text_of(quad, "Size"), 2), quad.find("Quadrilateral")
    corners = [] if shape is None else [numbers(text_of(shape, name), 2) for name in "ABCD"]
    if size is None or len(corners) < 4 or None in corners:
        return None
    image = np.array(corners, dtype=np.float32) - np.float32(PIXEL_CORNER)
    # A, B, C, D: top left, top right, bottom right, bottom left
    world = np.array([(0, size[1]), size, (size[0], 0), (0, 0)], dtype=np.float32)
    mapping = cv2.getPerspectiveTransform(image, world * np.float32(unit_m))
    px = np.vstack([track.px for track in tracks])

    def metres(points: FloatArray) -> FloatArray:
        return np.asarray(cv2.perspectiveTransform(points[np.newaxis], mapping)[0], dtype=float)

    right, down = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    along = np.hypot(*(metres(px + right) - metres(px)).T)
    across = np.hypot(*(metres(px + down) - metres(px)).T)
    usual = float(np.median(np.concatenate([along, across])))
    if max(np.ptp(along), np.ptp(across), abs(np.median(along) - np.median(across))) > (
        _MAX_SCALE_VARIATION * usual
    ):
        raise UsageError(
            f"{path}: the calibrated plane is oblique, its scale varies along the track",
            hint="Pass the clip with --from-tracks, so that its wall can be calibrated, "
            "or a scale of the plane of motion with --scale.",
        )
    step = metres(px + right) - metres(px)
    turn = -float(np.median(np.arctan2(step[:, 1], step[:, 0])))
    origin = cv2.perspectiveTransform(np.zeros((1, 1, 2)), np.linalg.inv(mapping))[0, 0]
    return PlaneOfMotion(
        1.0 / usual, Defaults.STICK_SCALE.std, np.asarray(origin, dtype=float), turn
    )


def _old_scale(root: Element, tracks: tuple[ExternalTrack, ...]) -> PlaneOfMotion | None:
    """``CalibrationHelp`` of versions before 0.8.16."""
    held = root.find("CalibrationHelp")
    if held is None:
        return None
    per_px, unit = _positive(text_of(held, "PixelToUnit")), held.find("LengthUnit")
    word = None if unit is None else unit.get("UserUnitLength")
    if per_px is None or word in (None, "px"):
        return None
    origin = numbers(text_of(held, "CoordinatesOrigin"), 2)
    zero = tracks[0].px[0] if origin is None or origin[0] < 0 else np.array(origin) - PIXEL_CORNER
    return PlaneOfMotion(
        1.0 / (per_px * parse_quantity(f"1 {word}", "m")), Defaults.STICK_SCALE.std, zero
    )


def kinovea_annotations(external: ExternalTracks) -> str:
    """Text of a .kva file with one trajectory per track; one tick per frame of the clip.

    Parameters
    ----------
    external : ExternalTracks
        Its frames count from the clip's first.
    """
    root = Element("KinoveaVideoAnalysis")
    # Kinovea requires this order: sizes and times come first
    SubElement(root, "FormatVersion").text = "2.0"
    SubElement(root, "Producer").text = "impact-vision"
    SubElement(root, "OriginalFilename").text = Path(external.clip or external.path.name).stem
    width, height = external.size or (0, 0)
    SubElement(root, "ImageSize").text = f"{width};{height}"
    SubElement(root, "AverageTimeStampsPerFrame").text = "1"
    rate = repr(float(external.fps or 1.0))
    SubElement(root, "CaptureFramerate").text = rate
    SubElement(root, "UserFramerate").text = rate
    SubElement(root, "FirstTimeStamp").text = "0"
    SubElement(root, "SelectionStart").text = "0"
    if external.plane is not None:
        _add_calibration(root, external.plane)
    held = SubElement(root, "Tracks")
    for track in external.tracks:
        _add_track(held, track)
    indent(root, space="  ")
    return '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _point(point: FloatArray) -> str:
    # Kinovea uses float32: 8 digits are exact
    return ";".join(f"{value:.8g}" for value in np.asarray(point) + PIXEL_CORNER)


def _add_calibration(root: Element, plane: PlaneOfMotion) -> None:
    held = SubElement(root, "Calibration")
    line = SubElement(held, "CalibrationLine")
    SubElement(line, "Length").text = "1"
    segment = SubElement(line, "Segment")
    end = plane.pixels(np.array([[0.0, 0.0], [1.0, 0.0]]))
    SubElement(segment, "A").text = _point(end[0])
    SubElement(segment, "B").text = _point(end[1])
    SubElement(line, "Origin").text = _point(plane.origin_px)
    SubElement(line, "Offset").text = "0;0"
    SubElement(line, "Axis").text = "LineHorizontal"
    SubElement(held, "Unit", {"Abbreviation": "m"}).text = "Meters"


def _add_track(parent: Element, track: ExternalTrack) -> None:
    item = SubElement(parent, "Track", {"name": track.name})
    SubElement(item, "TimePosition").text = str(int(track.frame[0])) if len(track) else "0"
    points = SubElement(item, "TrackPointList", {"Count": str(len(track))})
    for frame, px in zip(track.frame, track.px, strict=True):
        SubElement(points, "TrackPoint").text = f"{_point(px)};{int(frame)}"
    label = SubElement(item, "MainLabel", {"Text": track.name})
    SubElement(label, "SpacePosition").text = "20;-20"
    SubElement(label, "TimePosition").text = str(int(track.frame[0])) if len(track) else "0"
    style = SubElement(item, "DrawingStyle")
    for tag, key, value in (
        ("Color", "color", "255;255;140;0"),
        ("LineSize", "line size", "2"),
        ("TrackShape", "track shape", "Solid;false"),
    ):
        SubElement(SubElement(style, tag, {"Key": key}), "Value").text = value
