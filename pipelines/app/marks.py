"""Outlines, events and candidates of a clip for the viewer, as plain JSON."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from measuring.measurement import ClipMeasurement
from pipelines.measure.files import overlay_marks
from vision.tracks import PendulumTrack, Track

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["EVENTS", "marks_of"]

EVENTS = ("contact", "landing", "release", "bounce", "stop", "begins", "ends")
"""Names of events."""

MAX_CANDIDATES = 12
"""Found objects that are offered (chosen: the most probable; more hide the picture)."""


def marks_of(
    measured: ClipMeasurement | None, candidates: "pd.DataFrame | None" = None
) -> dict[str, Any]:
    """Everything drawn over the frames.

    Parameters
    ----------
    measured : ClipMeasurement or None
        Without one only the candidates are drawn.
    candidates : DataFrame, optional
        Tracklets found in the clip.

    Returns
    -------
    dict
        ``objects``: each with ``name``, ``kind`` (ball, mass, other) and columns ``frame``, ``x``,
        ``y``, ``r`` of the frames' pixels; ``candidates`` likewise; ``events``: frames with names;
        ``contact``: first and last frame, or None; ``pivot`` and ``landing``: points or None;
        ``fps``: of the camera, or None.
    """
    shift = None if measured is None else measured.tracks.shift_px
    document: dict[str, Any] = {
        "objects": [],
        "candidates": _candidates(candidates, shift),
        "events": [],
        "fps": None,
        "contact": None,
        "pivot": None,
        "landing": None,
    }
    if measured is None:
        return document
    document["fps"] = measured.rate.fps
    tracks = measured.tracks
    document["objects"].append(_object("ball", "ball", tracks.ball, shift))
    if tracks.pendulum is not None:
        document["objects"].append(_object("pendulum", "mass", tracks.pendulum.track, shift))
        document["pivot"] = _pivot(tracks.pendulum)
    for place, other in enumerate(tracks.others, start=2):
        document["objects"].append(_object(f"ball_{place}", "other", other.track, shift))
    drawn = overlay_marks(measured)
    document["contact"] = None if drawn.contact is None else [int(one) for one in drawn.contact]
    if drawn.landing_px is not None and np.isfinite(drawn.landing_px).all():
        document["landing"] = [round(float(one), 2) for one in drawn.landing_px]
    document["events"] = _events(measured, document["contact"])
    return document


def _pivot(pendulum: PendulumTrack) -> list[float] | None:
    if not np.isfinite(pendulum.pivot_px).all():
        return None
    return [round(float(one), 2) for one in pendulum.pivot_px]


def _object(
    name: str, kind: str, track: Track, shift: NDArray[np.float64] | None
) -> dict[str, Any]:
    return {"name": name, "kind": kind} | _columns(
        track.frame, track.centre_px, track.radius_px, shift
    )


def _columns(
    frame: NDArray[np.int64],
    centre: NDArray[np.float64],
    radius: NDArray[np.float64],
    shift: NDArray[np.float64] | None,
) -> dict[str, Any]:
    if shift is not None:
        centre = centre + shift[np.clip(frame, 0, len(shift) - 1)]
    sound = np.isfinite(centre).all(axis=1) & np.isfinite(radius)
    return {
        "frame": frame[sound].astype(int).tolist(),
        "x": np.round(centre[sound, 0], 2).tolist(),
        "y": np.round(centre[sound, 1], 2).tolist(),
        "r": np.round(radius[sound], 2).tolist(),
    }


def _candidates(
    table: "pd.DataFrame | None", shift: NDArray[np.float64] | None
) -> list[dict[str, Any]]:
    """The most probable tracklets; of those without a probability, the longest."""
    if table is None or not len(table):
        return []
    ranked = table.groupby("tracklet").agg(likely=("probability", "first"), rows=("frame", "size"))
    ranked = ranked.sort_values(["likely", "rows"], ascending=False).head(MAX_CANDIDATES)
    found = []
    for number in ranked.index:
        own = table[table["tracklet"] == number]
        columns = _columns(
            own["frame"].to_numpy(np.int64),
            own[["x_px", "y_px"]].to_numpy(np.float64),
            own["radius_px"].to_numpy(np.float64),
            shift,
        )
        measured = bool((own["measured"] == 1).any())
        likely = round(float(ranked.loc[number, "likely"]), 3)
        found.append({"name": int(number), "measured": measured, "likely": likely} | columns)
    return found


def _events(measured: ClipMeasurement, contact: list[int] | None) -> list[dict[str, Any]]:
    """Named frames, in order; of those of one moment the first that is known best."""
    motion, fps = measured.tracks.motion, measured.rate.fps
    known: list[tuple[int, str]] = []
    if contact is not None:
        known.append((contact[0], "contact"))
        landing = measured.quantity("landing_time")
        start = measured.quantity("contact_start")
        if landing.value is not None and start.value is not None:
            known.append((round((start.value + landing.value) * fps), "landing"))
    known += [(at, name) for name, at in motion.events if name != "contact" or contact is None]
    if contact is None and motion.frames is not None:
        known += zip(motion.frames, ("begins", "ends"), strict=True)
    events: list[tuple[int, str]] = []
    for at, name in known:
        if all(abs(at - other) > 1 for other, _ in events):
            events.append((at, name))
    last = max(measured.info.frames - 1, 0)
    return [{"frame": min(int(at), last), "name": name} for at, name in sorted(events)]
