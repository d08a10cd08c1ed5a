"""What a calibration leaves open, against faults of the instrument that are named."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from calib.calibration import Calibration
from metrology import Defaults
from mismatch import EngineVerdict
from mismatch.records.records import Trial
from mismatch.verdict import DOUBTED, Doubt, NamedEffect
from pipelines.measure.measurement import ClipMeasurement
from pipelines.measure.metres import CameraMapping

__all__ = [
    "calibration_widths",
    "common_widths",
    "outline_shares",
    "unknown_widths",
    "within_calibration",
]

COVERED = 2.5
"""Standard deviations within which a fault is what the calibration itself allows: 99 % of them."""

OUTLINE_PX = 0.15
"""How far the outline of a ball may wander along its flight, by its shading against the wall."""

OWN_CALIBRATION = (
    "the clip itself in place of its track table: vision explain CLIP holds what is found against"
    " the clip's own calibration"
)

LEAST_AXIS = 1e-12
"""Share of the largest axis below which one is rounding, not knowledge."""

PARAMETERS = {
    "time_base": "rate_error",
    "length_scale": "scale_error",
    "camera_roll": "roll",
    "parallax": "plane_error",
    "lens_distortion": "radial",
}
"""The strength of a fault of the instrument, by the fault's id."""


def calibration_widths(measured: ClipMeasurement) -> dict[str, float]:
    """Standard uncertainties of rate and scale (relative) and of roll (rad) of one clip.

    The calibration's, and what the ball's outline adds: slow errors that all clips share.

    Returns
    -------
    dict
        By the id of the effect that such an error would be.
    """
    rate = measured.rate.std / measured.rate.fps
    if measured.calibration is None or measured.impact is None:
        return {
            "time_base": rate,
            "length_scale": Defaults.BALL_DIAMETER.std,
            "camera_roll": Defaults.CAMERA_ROLL.std,
        }
    rows = np.isin(measured.tracks.ball.frame, measured.impact.tracks.ball_frame)
    px = measured.tracks.ball.centre_px[rows]
    scale, roll = _scale_and_roll(measured.calibration, px[:: max(1, len(px) // 40)])
    # free fall is the clock and the rule of a flight, and it is the picture's rows that show it
    along, fall = outline_shares(px)
    return {
        "time_base": math.hypot(rate, 0.5 * fall),
        "length_scale": math.hypot(scale, fall),
        "camera_roll": math.hypot(roll, along),
    }


def outline_shares(px: np.ndarray) -> tuple[float, float]:
    """What a wandering outline is of a path's (N, 2) extent along and across the picture's rows."""
    along, fall = OUTLINE_PX / np.maximum(np.ptp(px, axis=0), OUTLINE_PX)
    return float(along), float(fall)


def _scale_and_roll(calibration: Calibration, px: np.ndarray) -> tuple[float, float]:
    """How far the calibration's covariance stretches and turns a track, one sigma each."""
    std = np.sqrt(np.maximum(np.diag(calibration.covariance), 0.0))
    free = std > 0.0
    outer = np.outer(std[free], std[free])
    lengths, axes = np.linalg.eigh(calibration.covariance[np.ix_(free, free)] / outer)
    nothing = np.zeros((len(px), 2, 2))

    def track(step: np.ndarray) -> np.ndarray:
        moved = np.zeros(std.size)
        moved[free] = step * std[free]
        here = calibration.with_parameters(calibration.vector + moved)
        metres, _ = CameraMapping(here).ball(px, nothing)
        # As complex numbers about their middle: a stretch and a turn are one factor.
        flat = metres[:, 0] + 1j * metres[:, 1]
        return np.asarray(flat - flat.mean())

    base = track(np.zeros(int(free.sum())))
    factors = [
        np.vdot(base, track(math.sqrt(length) * axis)) / np.vdot(base, base) - 1.0
        for length, axis in zip(lengths, axes.T, strict=True)
        if length > LEAST_AXIS
    ]
    return (
        float(np.sqrt(sum(factor.real**2 for factor in factors))),
        float(np.sqrt(sum(factor.imag**2 for factor in factors))),
    )


def common_widths(clips: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Widths of a campaign: clips of one camera err together, so the median of theirs."""
    rows = list(clips)
    names = [name for name in PARAMETERS if all(name in row for row in rows)]
    return {name: float(np.median([row[name] for row in rows])) for name in names if rows}


def unknown_widths(trials: Iterable[Trial]) -> dict[str, float]:
    """Standard uncertainties that a calibration leaves open of which nothing is told.

    A table of tracks says where the ball was seen, not how well camera, plane and clock were known.

    Parameters
    ----------
    trials : iterable of Trial
        Their paths tell how large the picture is at least.

    Returns
    -------
    dict
        By the id of the effect that such an error would be.
    """
    spans = [
        np.nanmax(path, axis=0) - np.nanmin(path, axis=0)
        for path in (trial.position[:, :2] for trial in trials)
        if np.isfinite(path).any(axis=0).all()
    ]
    half = 0.5 * max((float(np.hypot(*span)) for span in spans), default=1.0)
    return {
        "time_base": Defaults.NOMINAL_RATE.std,
        "length_scale": Defaults.PLANE_SCALE.std,
        "camera_roll": Defaults.CAMERA_ROLL.std,
        "parallax": Defaults.PLANE_DEPTH.std,
        "lens_distortion": Defaults.LENS_DISTORTION.std / max(half, 1e-6) ** 2,
    }


def within_calibration(
    verdict: EngineVerdict, widths: Mapping[str, float], *, known: bool = True
) -> EngineVerdict:
    """The verdict without faults of the instrument that its own calibration allows.

    If nothing but such faults is named, nothing is missing: the calibration's uncertainty already
    says so. Where the calibration is not known, its usual widths can't say that much: the names
    stay, in doubt. Beside physics, or far beyond the widths, a verdict stays as it is.

    Parameters
    ----------
    verdict : EngineVerdict
    widths : mapping
        Id of a fault → standard uncertainty of the calibration in it.
    known : bool
        Whether the widths are those of the recording's own calibration.
    """
    if not widths:
        return verdict
    notes = (*verdict.notes, _told(widths, known))
    if not verdict.effects or not all(_allowed(effect, widths) for effect in verdict.effects):
        return replace(verdict, notes=notes)
    sizes = ", ".join(
        f"{effect.id} {p.name} = {p.value:.2g} ± {p.std:.1g}"
        for effect in verdict.effects
        for p in effect.parameters
        if p.name == PARAMETERS[effect.id]
    )
    if not known:
        doubted = (replace(e, probability=min(e.probability, DOUBTED)) for e in verdict.effects)
        return replace(
            verdict,
            verdict="ambiguous",
            effects=tuple(doubted),
            next_measurement=OWN_CALIBRATION,
            notes=(*notes, f"{sizes} is in doubt: {Doubt.UNKNOWN_CALIBRATION.value}"),
        )
    return replace(
        verdict,
        verdict="no_mismatch",
        location=None,
        effects=(),
        indistinguishable=(),
        next_measurement=None,
        notes=(*notes, f"{sizes} is no finding: it lies within what the calibration leaves open"),
    )


def _allowed(effect: NamedEffect, widths: Mapping[str, float]) -> bool:
    return effect.id in widths and any(
        p.name == PARAMETERS[effect.id]
        and abs(p.value) <= COVERED * math.hypot(widths[effect.id], p.std)
        for p in effect.parameters
    )


def _told(widths: Mapping[str, float], known: bool) -> str:
    told = (
        f"the rate to {100.0 * widths['time_base']:.2g} %, the scale to"
        f" {100.0 * widths['length_scale']:.2g} % and the roll to"
        f" {math.degrees(widths['camera_roll']):.2g} deg"
    )
    if known:
        return f"the calibration knows {told}"
    return (
        f"the table does not tell how well its clip was calibrated; usual is {told}, the depth of"
        f" the plane to {100.0 * widths['parallax']:.2g} %, and a lens that nobody measured"
        f" displaces the picture's edge by {100.0 * Defaults.LENS_DISTORTION.std:.2g} %"
    )
