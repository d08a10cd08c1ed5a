"""Measurement to what people look at: overlay, plot and report."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from metrology.quantity import format_quantity
from pipelines.measure.files import software_version
from pipelines.measure.fits.contact_fit import arm_along_bar, gap_after, gap_before
from pipelines.measure.impact import Impact
from pipelines.measure.measurement import ClipMeasurement
from pipelines.report import (
    Curve,
    GapRecord,
    Moment,
    PathRecord,
    ReportInput,
    SpeedRecord,
)
from pipelines.report.inputs import quantity_label
from vision.clip.clip import ClipReader
from vision.overlay.overlay import OverlayMarks, overlay_still, png_bytes

__all__ = ["overlay_marks", "report_input"]

FloatArray = NDArray[np.float64]

_PENDULUM_STRETCH_S = 0.08

"""s around the contact that are drawn: five contacts long on either side."""

_CAPTIONS = ("contact_time", "ball_speed", "launch_angle", "landing_distance", "cor")


def overlay_marks(measured: ClipMeasurement) -> OverlayMarks:
    """What the overlay draws beside the tracks."""
    fps = measured.rate.fps
    captions = tuple(
        f"{quantity_label(item.name)}: {format_quantity(item)}"
        for item in measured.quantities
        if item.name in _CAPTIONS and item.known
    )
    grid = None if measured.grid is None else measured.grid.points_px
    marks = OverlayMarks(captions=captions, grid_px=grid, capture_fps=fps)
    impact = measured.impact
    if impact is not None and impact.contact is not None:
        first = int(np.ceil(impact.contact.onset_s * fps))
        last = int(np.floor(impact.contact.release_s * fps))
        if last >= first:
            marks = replace(marks, contact=(first, last))
    landing = measured.quantity("landing_distance")
    calibration = measured.calibration
    if landing.value is not None and calibration is not None and impact is not None:
        rest = impact.tracks.rest_m
        landed = impact.flight.states(np.array([measured.quantity("landing_time").value]))[0]
        spot = np.array(
            [
                impact.tracks.direction * (rest[0] + landing.value),
                landed[1],
                calibration.ball_plane_offset,
            ]
        )
        marks = replace(marks, landing_px=calibration.camera.project(spot))
    return marks


def report_input(measured: ClipMeasurement, clip: ClipReader | None) -> ReportInput:
    """What the one-page report shows; `clip` for a still, None for none."""
    impact, info = measured.impact, measured.info
    facts = (
        ("clip", str(info.path)),
        ("picture", f"{info.width} × {info.height} px, {info.frames} frames, {info.codec}"),
        ("capture rate", f"{measured.rate.fps:g} fps ({measured.rate.source})"),
    )
    base = ReportInput(
        title=f"Measurement of {Path(info.path).name}",
        facts=facts,
        quantities=(*measured.quantities, *measured.other_speeds, measured.gravity),
        checks=measured.checks,
        warnings=measured.warnings,
        version=software_version(),
        defaults=tuple(known.in_words for known in measured.defaults),
    )
    if clip is not None:
        base = replace(
            base, still_png=png_bytes(overlay_still(clip, measured.tracks, overlay_marks(measured)))
        )
    if impact is None or (
        measured.calibration is None and measured.quantity("ball_speed").value is None
    ):
        return base
    gap, path = _gap(measured, impact), _path(measured, impact)
    return replace(base, gap=gap, speeds=_speeds(impact), path=path)


def _gap(measured: ClipMeasurement, impact: Impact) -> GapRecord | None:
    view, contact, tracks = impact.view, impact.contact, impact.tracks
    if view is None or contact is None:
        return None
    start, end = contact.onset_s - 0.02, contact.release_s + 0.02
    seen = (tracks.swing_time_s > start) & (tracks.swing_time_s < end)
    common, at, ball_at = np.intersect1d(
        tracks.swing_time_s[seen], tracks.ball_time_s, return_indices=True
    )
    phi, std = tracks.swing_rad[seen][at], tracks.swing_std_rad[seen][at]
    arm = tracks.ball_m[ball_at] - view.pivot
    gap = arm[:, 0] * np.cos(phi) + arm[:, 1] * np.sin(phi) - view.radius - contact.face_offset
    reach = np.hypot(*arm.T)
    spread = np.hypot(std * reach, np.sqrt(tracks.ball_cov_m2[ball_at, 0, 0]))
    before = np.linspace(start, contact.onset_s + 0.003, 40)
    after = np.linspace(contact.release_s - 0.003, end, 40)
    fits = (
        Curve(before, gap_before(view, before) - contact.face_offset, "closing"),
        Curve(after, gap_after(view, after) - contact.face_offset, "opening"),
    )
    moments = [
        Moment(at, measured.quantity(name).std or 0.0)
        for at, name in ((contact.onset_s, "contact_start"), (contact.release_s, "contact_end"))
    ]
    return GapRecord(common, gap, spread, moments[0], moments[1], fits)


def _speeds(impact: Impact) -> tuple[SpeedRecord, ...]:
    tracks = impact.tracks
    ball = _frame_speed("ball", tracks.ball_time_s, tracks.ball_m, tracks.ball_cov_m2)
    flown = impact.flight.time_s
    states = impact.flight.states(flown)
    curve = Curve(flown, np.hypot(states[:, 2], states[:, 3]), "fitted flight")
    return (replace(ball, fits=(curve,)), *_pendulum_speed(impact))


def _pendulum_speed(impact: Impact) -> tuple[SpeedRecord, ...]:
    """The pendulum's, at the point of contact; nothing is fitted across the event."""
    view, contact, tracks = impact.view, impact.contact, impact.tracks
    if view is None or contact is None:
        return ()
    arm = arm_along_bar(tracks.rest_m - view.pivot, view.before.state(contact.onset_s)[0])
    near = np.abs(tracks.swing_time_s - contact.onset_s) < _PENDULUM_STRETCH_S
    time, angle = tracks.swing_time_s[near], tracks.swing_rad[near]
    step = np.diff(time)
    std = arm * np.hypot(tracks.swing_std_rad[near][1:], tracks.swing_std_rad[near][:-1]) / step
    sides = (
        (view.before, time[time < contact.onset_s], "swing before"),
        (view.after, time[time > contact.release_s], "swing after"),
    )
    fits = tuple(
        Curve(at, arm * np.array([swing.state(float(t))[1] for t in at]), label)
        for swing, at, label in sides
    )
    middle = 0.5 * (time[1:] + time[:-1])
    return (SpeedRecord("pendulum", middle, arm * np.diff(angle) / step, std, fits),)


def _frame_speed(
    label: str, time_s: FloatArray, position: FloatArray, covariance: FloatArray
) -> SpeedRecord:
    """Displacement per frame: the paper's way (Fig. 18)."""
    step = np.diff(time_s)
    near = step < 3 * np.median(step)
    speed = np.hypot(*np.diff(position, axis=0).T) / step
    variance = np.trace(covariance, axis1=1, axis2=2) / 2
    std = np.sqrt(variance[1:] + variance[:-1]) / step
    middle = 0.5 * (time_s[1:] + time_s[:-1])
    return SpeedRecord(label, middle[near], speed[near], std[near])


def _path(measured: ClipMeasurement, impact: Impact) -> PathRecord:
    tracks, flight = impact.tracks, impact.flight
    std = np.sqrt(np.diagonal(tracks.ball_cov_m2, axis1=1, axis2=2))
    drawn_s = np.linspace(flight.time_s[0], flight.time_s[-1], 120)
    states = flight.states(drawn_s)
    used = np.isin(tracks.ball_time_s, flight.time_s)
    landing = measured.quantity("landing_distance")
    spot = None
    if landing.value is not None:
        fall = measured.quantity("landing_time").value
        height = float(flight.states(np.array([fall]))[0, 1])
        spot = (float(tracks.rest_m[0]) + landing.value, height)
    return PathRecord(
        tracks.ball_time_s,
        tracks.ball_m[:, 0],
        tracks.ball_m[:, 1],
        std[:, 0],
        std[:, 1],
        (Curve(states[:, 0], states[:, 1], "fitted flight"),),
        spot,
        landing.std,
        flight.time_s,
        flight.residual_m[:, 0],
        flight.residual_m[:, 1],
        std[used].mean(axis=1),
    )
