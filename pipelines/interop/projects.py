"""Kinovea's annotations (.kva) read and written.

Kinovea (https://www.kinovea.org) stores a track as ``x;y;t`` in pixels from the corner of the first
pixel and ticks of its clip; older versions count the ticks from the track's first mark. A track's
plane is a line or a quadrilateral of known size (``CalibratorHelper`` of its source).
"""

import math
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
    root_of,
    text_of,
)
from pipelines.interop.tracker import CLICKED_STD_PX, CORNER_PX

__all__ = ["kinovea_annotations", "read_kva"]

FloatArray = NDArray[np.float64]

_WHAT = "Kinovea annotation file"
_SQUARE = 0.02
"""Relative, supposed: a quadrilateral whose local scale differs by more over the track is no single
scale."""


def read_kva(path: Path) -> ExternalTracks:
    """Read a Kinovea annotation file (format 1.3 and later).

    Raises
    ------
    UsageError
        If it can't be read, holds no track, or a plane that looks aslant at the motion.
    """
    root = root_of(read_bytes(path, _WHAT), path, _WHAT)
    if root.tag != "KinoveaVideoAnalysis":
        raise UsageError(f"{path} is no {_WHAT}", hint="Save one in Kinovea with File > Save.")
    ticks = _positive(text_of(root, "AverageTimeStampsPerFrame")) or 1.0
    start = _number(text_of(root, "FirstTimeStamp")) or 0.0
    rate = _positive(text_of(root, "CaptureFramerate")) or _positive(text_of(root, "UserFramerate"))
    tracks = [_track(one, k, ticks, start, rate) for k, one in enumerate(root.iter("Track"))]
    marked = tuple(track for track in tracks if len(track))
    if not marked:
        raise UsageError(f"{path} holds no track", hint="Track a point in Kinovea first.")
    size = numbers(text_of(root, "ImageSize"), 2)
    return ExternalTracks(
        path=path,
        program=Program.KINOVEA,
        tracks=marked,
        size=None if size is None else (int(size[0]), int(size[1])),
        fps=rate,
        plane=_plane(root, marked, path),
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
    if begins is not None and len(tick) and tick[0] < begins - 0.5 * ticks:
        # before 0.8.16 a track counted from its own first mark
        tick = tick - tick[0] + begins
    frame = np.rint((tick - start) / ticks).astype(np.int64)
    frame, first = np.unique(frame, return_index=True)
    px = rows[first, :2] - CORNER_PX
    return ExternalTrack(
        (name or f"track {number + 1}").strip(),
        frame,
        px,
        None if rate is None else frame / rate,
    )


def _plane(root: Element, tracks: tuple[ExternalTrack, ...], path: Path) -> PlaneOfMotion | None:
    held = root.find("Calibration")
    if held is None:
        return _old_scale(root, tracks)
    unit_m = _unit_m(held)
    line, quad = held.find("CalibrationLine"), held.find("CalibrationPlane")
    if unit_m is None or (line is None and quad is None):
        return None
    origin = numbers(text_of(line if line is not None else quad, "Origin"), 2)  # type: ignore[arg-type]
    middle = np.median(np.vstack([track.px for track in tracks]), axis=0)
    zero = middle if origin is None or line is None else np.array(origin) - CORNER_PX
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
    """Pixels per metre of a line, with the relative uncertainty of clicking it."""
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
    """Angle of the x axis above the picture's rows, rad: 0 unless the line is said to lie along."""
    segment, kind = line.find("Segment"), text_of(line, "Axis")
    if segment is None or kind not in _ALONG:
        return 0.0
    start, end = (numbers(text_of(segment, name), 2) for name in ("A", "B"))
    if start is None or end is None:
        return 0.0
    slope = math.atan2(start[1] - end[1], end[0] - start[0]) - _ALONG[kind]
    # a line drawn from right to left or downwards means the same axis
    return math.remainder(slope, math.pi)


_ALONG = {"LineHorizontal": 0.0, "LineVertical": math.pi / 2}
"""``CalibrationAxis``: which of the axes the line is in the real world."""


def _quad_scale(
    quad: Element, unit_m: float, tracks: tuple[ExternalTrack, ...], path: Path
) -> PlaneOfMotion | None:
    """Scale of a quadrilateral where the tracks go; refused where it is not one scale."""
    size, shape = numbers(text_of(quad, "Size"), 2), quad.find("Quadrilateral")
    corners = [] if shape is None else [numbers(text_of(shape, name), 2) for name in "ABCD"]
    if size is None or len(corners) < 4 or None in corners:
        return None
    image = np.array(corners, dtype=np.float32) - np.float32(CORNER_PX)
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
        _SQUARE * usual
    ):
        raise UsageError(
            f"{path}: the calibrated plane is seen aslant, its scale changes along the track",
            hint="Give the clip with --from-tracks, so that its wall can be calibrated, "
            "or a scale of the plane of motion with --scale.",
        )
    step = metres(px + right) - metres(px)
    turn = -float(np.median(np.arctan2(step[:, 1], step[:, 0])))
    origin = cv2.perspectiveTransform(np.zeros((1, 1, 2)), np.linalg.inv(mapping))[0, 0]
    return PlaneOfMotion(
        1.0 / usual, Defaults.STICK_SCALE.std, np.asarray(origin, dtype=float), turn
    )


def _old_scale(root: Element, tracks: tuple[ExternalTrack, ...]) -> PlaneOfMotion | None:
    """``CalibrationHelp`` of the versions before 0.8.16."""
    held = root.find("CalibrationHelp")
    if held is None:
        return None
    per_px, unit = _positive(text_of(held, "PixelToUnit")), held.find("LengthUnit")
    word = None if unit is None else unit.get("UserUnitLength")
    if per_px is None or word in (None, "px"):
        return None
    origin = numbers(text_of(held, "CoordinatesOrigin"), 2)
    zero = tracks[0].px[0] if origin is None or origin[0] < 0 else np.array(origin) - CORNER_PX
    return PlaneOfMotion(
        1.0 / (per_px * parse_quantity(f"1 {word}", "m")), Defaults.STICK_SCALE.std, zero
    )


def kinovea_annotations(external: ExternalTracks) -> str:
    """Text of a .kva file with one trajectory per track; a tick is a picture of the clip.

    Parameters
    ----------
    external : ExternalTracks
        Its frames count from the clip's first.
    """
    root = Element("KinoveaVideoAnalysis")
    # Kinovea reads these in order: sizes and times come first
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
    # Kinovea holds a float32: 8 digits lose nothing
    return ";".join(f"{value:.8g}" for value in np.asarray(point) + CORNER_PX)


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
