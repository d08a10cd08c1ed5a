"""Convert clips and track tables to trials with calibration uncertainties.

A track runs from the ball at rest through contact and flight to the bounce. A model of free motion
holds only in between; the limits are determined from the track itself. Errors allowed by the
calibration are compared with instrument faults that the engine names.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from measuring.measurement import steady_px
from measuring.setup.file import Setup
from metrology import (
    ClipError,
    Defaults,
    MeasurementError,
    NotFoundError,
    UncertaintySource,
    UsageError,
)
from mismatch import EngineVerdict
from mismatch.records import CampaignRecords, Trial
from mismatch.verdict import DOUBTED, Doubt, NamedEffect
from physics.bodies import GRAVITY, PAPER_PENDULUM, PAPER_SUPPORT, Pendulum
from physics.effects import Effect, Form, Level
from physics.effects.measurement import (
    BehindTheBall,
    CameraRoll,
    LengthScale,
    OriginOffset,
    PivotElsewhere,
    WanderingCentre,
    WanderingMass,
)
from pipelines.explain.tabular import numbers_of, read_sheet

if TYPE_CHECKING:
    from calib.calibration import Calibration
    from measuring.chain import MeasureOptions
    from measuring.measurement import ClipMeasurement

__all__ = [
    "ClipCampaign",
    "ClipFacts",
    "calibration_widths",
    "campaign_from_clips",
    "campaign_of_flight",
    "clear_interval",
    "clip_facts",
    "common_widths",
    "flight_rows",
    "has_rig",
    "is_track_table",
    "outline_fractions",
    "swing_rows",
    "trial_of",
    "unknown_widths",
    "with_rig",
    "within_calibration",
]

FloatArray = NDArray[np.float64]

MIN_FLIGHT_ROWS = 8
"""Rows: fewer do not distinguish a flight from a contact (chosen)."""

MIN_REST_ROWS = 5
"""Rows at the start in which the ball must be at rest: fewer do not distinguish noise from a slow
drift (chosen)."""

MAX_DEVIATION = 4.0
"""Standard deviations from the free motion beyond which a row does not belong to it (chosen)."""


def is_track_table(table: pd.DataFrame) -> bool:
    """Whether the table contains tracks of objects, in a column ``object``."""
    return {"object", "t_s"} <= set(table.columns)


def flight_rows(table: pd.DataFrame, name: str, rest_height: float = 0.0) -> pd.DataFrame:
    """The ball's free flight, x forward from rest, y up from the floor; one trial per clip.

    Parameters
    ----------
    table : DataFrame
        Track table; a column ``trial`` distinguishes clips.
    name : str
        Name of the trial without such a column.
    rest_height : float
        Height of the resting ball's centre, m.

    Raises
    ------
    UsageError
        If the ball has no metric positions, or the track has no flight.
    """
    return pd.concat(
        [_flight(part, trial, rest_height) for trial, part in _trials(table, name, "ball")],
        ignore_index=True,
    )


def swing_rows(table: pd.DataFrame, name: str) -> pd.DataFrame:
    """The pendulum's free swing until it meets the ball; one trial per clip.

    Parameters
    ----------
    table, name
        As in `flight_rows`.

    Raises
    ------
    UsageError
        If the table has no pendulum with angles.
    """
    parts = []
    for trial, swing in _trials(table, name, "pendulum"):
        if "phi_rad" not in swing or swing["phi_rad"].isna().all():
            raise UsageError(
                f"{name}: the pendulum has no angles (phi_rad)",
                hint="Measure the clip with --tracks: it writes phi_rad if a swing is visible.",
            )
        touched = _time_before_contact(_of(table, trial, "ball"))
        parts.append(swing if touched is None else swing[swing["t_s"] < touched])
    return pd.concat(parts, ignore_index=True)


def _trials(table: pd.DataFrame, name: str, kind: str) -> list[tuple[str, pd.DataFrame]]:
    named = table if "trial" in table else table.assign(trial=name)
    mine = named[named["object"] == kind].sort_values(["trial", "t_s"], kind="stable")
    if mine.empty:
        raise UsageError(
            f"{name} contains no rows of a {kind}",
            hint="The column object must contain ball or pendulum.",
        )
    return [(str(trial), part) for trial, part in mine.groupby("trial", sort=False)]


def _of(table: pd.DataFrame, trial: str, kind: str) -> pd.DataFrame:
    mine = table[table["object"] == kind]
    if "trial" in mine:
        mine = mine[mine["trial"].astype(str) == trial]
    return mine.sort_values("t_s")


def _departure_time(ball: pd.DataFrame) -> float | None:
    """Time at which the ball leaves its rest position, s; None if it is never at rest."""
    if len(ball) < MIN_FLIGHT_ROWS:
        return None
    position = steady_px(ball)
    still = position[:MIN_REST_ROWS]
    spread = np.median(np.abs(np.diff(position, n=2, axis=0)), axis=0) / (0.6745 * np.sqrt(6.0))
    away = np.abs(position - np.median(still, axis=0)).max(axis=1)
    off = away > MAX_DEVIATION * np.sqrt(2.0) * max(float(spread.max()), 1e-6)
    if off[:MIN_REST_ROWS].any():
        return None
    # three rows in succession: a single deviating row is an outlier
    gone = [row for row in np.flatnonzero(off) if off[row : row + 3].all()]
    return float(ball["t_s"].iloc[gone[0]]) if gone else None


def _clear(ball: pd.DataFrame, left: float) -> NDArray[np.bool_]:
    """Rows in which the ball is more than its radius from rest: contact has ended by then."""
    position, before = steady_px(ball), (ball["t_s"] < left).to_numpy()
    away = np.hypot(*(position - np.nanmedian(position[before], axis=0)).T)
    reach = ball["radius_px"].median() if "radius_px" in ball else 0.0
    return np.asarray((ball["t_s"] >= left) & (away > (0.0 if np.isnan(reach) else reach)))


def _time_before_contact(ball: pd.DataFrame) -> float | None:
    """A time before the pendulum meets the ball, s; None if the ball is never at rest.

    The ball's motion is detected some frames after first contact. The time it then takes to move by
    its radius, subtracted once more, is early enough.
    """
    left = _departure_time(ball)
    if left is None:
        return None
    clear = ball.loc[_clear(ball, left), "t_s"]
    return left if clear.empty else left - (float(clear.iloc[0]) - left)


def _flight(ball: pd.DataFrame, trial: str, rest_height: float) -> pd.DataFrame:
    known = ball.dropna(subset=["x_m", "y_m"])
    if len(known) < MIN_FLIGHT_ROWS:
        raise UsageError(
            f"trial {trial}: the table has no positions of the ball in metres",
            hint="Measure the clip with --wall-grid or --ball to set the scale.",
        )
    left = _departure_time(known)
    moving = known if left is None else known[_clear(known, left)]
    time = moving["t_s"].to_numpy(float)
    place = moving[["x_m", "y_m"]].to_numpy(float)
    first, end = _free_stretch(time, place)
    if end - first < MIN_FLIGHT_ROWS:
        raise UsageError(
            f"trial {trial}: the track contains no free flight",
            hint="The ball must fly for at least ten frames; check the overlay.",
        )
    flight = moving.iloc[first:end].copy()
    forward = 1.0 if place[end - 1, 0] >= place[first, 0] else -1.0
    start = place[first]
    if left is not None:
        start = known.loc[known["t_s"] < left, ["x_m", "y_m"]].median().to_numpy(float)
    flight["x_m"] = forward * (flight["x_m"] - start[0])
    flight["y_m"] = flight["y_m"] - (start[1] - rest_height if left is not None else 0.0)
    return flight.assign(trial=trial)


def _free_stretch(time: FloatArray, place: FloatArray) -> tuple[int, int]:
    """Rows [first, end) of one smooth free motion, grown from its middle.

    Over a second, free flight with drag is a cubic in time to far below the noise of any track; a
    push at its beginning or a bounce at its end is not.
    """
    end = _bounce(time, place[:, 1])
    first, stop = end // 4, max(end - end // 8, end // 4 + MIN_FLIGHT_ROWS)
    stop = min(stop, end)
    noise: FloatArray | None = None
    for _ in range(2 * len(time)):
        inside = slice(first, stop)
        if stop - first < MIN_FLIGHT_ROWS:
            return first, first
        centre, half = time[inside].mean(), max(float(np.ptp(time[inside])) / 2.0, 1e-9)
        fits = [np.polyfit((time[inside] - centre) / half, row, 3) for row in place[inside].T]
        off = np.stack([place[:, k] - np.polyval(fits[k], (time - centre) / half) for k in (0, 1)])
        if noise is None:
            # from the middle, which is free: rows added later must not raise the limit
            noise = np.sqrt((off[:, inside] ** 2).sum(axis=1) / (stop - first - 4))
        free = np.all(np.abs(off) < MAX_DEVIATION * noise[:, np.newaxis], axis=0)
        # one deviating row is an outlier, two in succession end the free motion
        grown = (
            first - 1 if first > 0 and free[max(first - 2, 0) : first].any() else first,
            stop + 1 if stop < end and free[stop : min(stop + 2, end)].any() else stop,
        )
        if grown == (first, stop):
            return first, stop
        first, stop = grown
    return first, stop


def _bounce(time: FloatArray, height: FloatArray) -> int:
    """First row after the ball turns upwards again, or the number of rows."""
    if len(time) < MIN_FLIGHT_ROWS:
        return len(time)
    rate = np.gradient(height, time)
    smooth = np.convolve(rate, np.ones(5) / 5.0, mode="same")
    noise = float(np.median(np.abs(np.diff(rate)))) + 1e-9
    falling = np.flatnonzero(smooth < -3.0 * noise)
    if not len(falling):
        return len(time)
    rising = np.flatnonzero(smooth > 3.0 * noise)
    after = rising[rising > falling[0]]
    if not len(after):
        return len(time)
    lowest = int(np.argmin(height[falling[0] : after[0] + 1])) + int(falling[0])
    return lowest


MAX_CALIBRATION_DEVIATION = 2.5
"""Standard deviations within which a fault is consistent with the calibration: 99 % of them."""

OUTLINE_PX = 0.15
"""px: drift of a ball's fitted outline along its flight, from its shading (assumed)."""

OWN_CALIBRATION = (
    "the clip itself instead of its track table: vision explain CLIP compares the result with the"
    " clip's own calibration"
)

MIN_RELATIVE_AXIS = 1e-12
"""Relative length of a covariance axis below which it is rounding error."""

FAULT_PARAMETERS = {
    "time_base": "rate_error",
    "length_scale": "scale_error",
    "camera_roll": "roll",
    "parallax": "plane_error",
    "lens_distortion": "radial",
}

"""Parameter name of an instrument fault, by the fault's id."""


def calibration_widths(measured: "ClipMeasurement") -> dict[str, float]:
    """Standard uncertainties of rate and scale (relative) and of roll (rad) of one clip.

    From the calibration and from the drift of the ball's outline: slow errors shared by all clips.
    Without a calibration the roll is not measured.

    Returns
    -------
    dict
        By the id of the corresponding effect.
    """
    rate = measured.rate.std / measured.rate.fps
    if measured.calibration is None:
        return {
            "time_base": rate,
            "length_scale": _relative_scale_std(measured),
        }
    px = measured.tracks.ball.centre_px
    if measured.impact is not None:
        px = px[np.isin(measured.tracks.ball.frame, measured.impact.tracks.ball_frame)]
    scale, roll = _scale_and_roll(measured.calibration, px[:: max(1, len(px) // 40)])
    # free fall sets time and length scale of a flight, along the columns of the image
    along, fall = outline_fractions(px)
    return {
        "time_base": math.hypot(rate, 0.5 * fall),
        "length_scale": math.hypot(scale, fall),
        "camera_roll": math.hypot(roll, along),
    }


SCALE_SOURCES = frozenset(
    {UncertaintySource.BALL_DIAMETER, UncertaintySource.SCALE, UncertaintySource.CAMERA_SLANT}
)
"""Sources of the scale's uncertainty without a grid."""


def _relative_scale_std(measured: "ClipMeasurement") -> float:
    """Relative uncertainty of the scale without a grid, from the budget of the speed."""
    names = ("ball_speed", "flight_speed", "fall_acceleration")
    speed = next((one for one in map(measured.quantity, names) if one.value), None)
    if speed is None or not speed.value:
        return Defaults.BALL_DIAMETER.std
    parts = [part.std for part in speed.budget if part.source in SCALE_SOURCES]
    return max(math.hypot(*parts) / speed.value, Defaults.BALL_DIAMETER.std)


def outline_fractions(px: np.ndarray) -> tuple[float, float]:
    """Outline drift relative to a path's (N, 2) extent along and across the image rows."""
    along, fall = OUTLINE_PX / np.maximum(np.ptp(px, axis=0), OUTLINE_PX)
    return float(along), float(fall)


def _scale_and_roll(calibration: "Calibration", px: np.ndarray) -> tuple[float, float]:
    """Standard uncertainties of scale and roll of a track, from the calibration's covariance."""
    std = np.sqrt(np.maximum(np.diag(calibration.covariance), 0.0))
    free = std > 0.0
    outer = np.outer(std[free], std[free])
    lengths, axes = np.linalg.eigh(calibration.covariance[np.ix_(free, free)] / outer)
    nothing = np.zeros((len(px), 2, 2))
    from measuring.metres import CameraMapping

    def track(step: np.ndarray) -> np.ndarray:
        moved = np.zeros(std.size)
        moved[free] = step * std[free]
        here = calibration.with_parameters(calibration.vector + moved)
        metres, _ = CameraMapping(here).ball(px, nothing)
        # as complex numbers about their centre, scale and rotation are one factor
        flat = metres[:, 0] + 1j * metres[:, 1]
        return np.asarray(flat - flat.mean())

    base = track(np.zeros(int(free.sum())))
    factors = [
        np.vdot(base, track(math.sqrt(length) * axis)) / np.vdot(base, base) - 1.0
        for length, axis in zip(lengths, axes.T, strict=True)
        if length > MIN_RELATIVE_AXIS
    ]
    return (
        float(np.sqrt(sum(factor.real**2 for factor in factors))),
        float(np.sqrt(sum(factor.imag**2 for factor in factors))),
    )


def clip_faults(measured: "ClipMeasurement") -> tuple[Effect, ...]:
    """Faults of one clip, with the measured uncertainties as widths of their parameters.

    The drift of the ball's centre along its flight comes first. For a strike follow those of the
    mass, the axis and the ball's rest position; scale and roll as in `calibration_widths`.
    """
    if measured.impact is None:
        return ()
    # import here: it needs the measuring chain
    from vision.pendulum.arc import LOOK_PX

    tracks = measured.impact.tracks
    # uncertainty of a centre that is not visible as frame-to-frame noise is slow drift
    flying = tracks.ball_cov_m2[tracks.ball_time_s >= _release(measured) - 1e-9]
    seen = np.sqrt(np.diag(np.median(flying, axis=0)))
    slow, fixed = WanderingCentre(), BehindTheBall()
    wander = (
        _with_widths(slow, np.repeat(seen, len(slow.orders))),
        _with_widths(fixed, np.repeat(seen, len(fixed.orders)), (Level.CAMPAIGN,)),
    )
    if measured.tracks.pendulum is None:
        return wander
    metres_per_px = tracks.radius_m / float(np.median(measured.tracks.ball.radius_px))
    axis = np.sqrt(np.diag(measured.tracks.pendulum.pivot_covariance_px2)) * metres_per_px
    widths = calibration_widths(measured)
    arm = float(measured.tracks.pendulum.arm_px) * metres_per_px
    about, turns = Form.ABOUT_THE_START, WanderingMass()
    return (
        *wander,
        _with_widths(turns, [LOOK_PX * metres_per_px / arm] * len(turns.parameters)),
        _with_widths(PivotElsewhere(), axis),
        _with_widths(OriginOffset(id="rest_elsewhere"), tracks.rest_std_m),
        _with_widths(LengthScale(id="scale_of_the_clip", form=about), [widths["length_scale"]]),
        _with_widths(
            CameraRoll(id=ROLL_OF_THE_CLIP, form=about),
            [widths.get("camera_roll", Defaults.CAMERA_ROLL.std)],
        ),
    )


ROLL_OF_THE_CLIP = "roll_of_the_clip"

CAMERA_LEVELS = (Level.CAMPAIGN, Level.TRIAL)
"""An error may be common to all clips of a camera or differ per clip: both take the full width."""


def _with_widths(
    fault: Effect, widths: Sequence[float] | FloatArray, levels: tuple[Level, ...] = CAMERA_LEVELS
) -> Effect:
    held = tuple(
        replace(p, width=float(width), expected=0.0)
        for p, width in zip(fault.parameters, widths, strict=True)
    )
    return replace(fault, sharp=False, parameters=held, levels=levels)


def common_faults(clips: Sequence[tuple[Effect, ...]]) -> tuple[Effect, ...]:
    """Faults of a campaign, each with the median width over its clips; none if a clip has none."""
    return tuple(
        _with_widths(
            alike[0],
            np.median([[p.width for p in one.parameters] for one in alike], axis=0),
            alike[0].levels,
        )
        for alike in zip(*clips, strict=False)
    )


def common_widths(clips: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Widths of a campaign: the median over its clips, which share a camera."""
    rows = list(clips)
    names = [name for name in FAULT_PARAMETERS if all(name in row for row in rows)]
    return {name: float(np.median([row[name] for row in rows])) for name in names if rows}


def unknown_widths(trials: Iterable[Trial]) -> dict[str, float]:
    """Typical calibration uncertainties, for tracks without calibration data.

    A track table gives positions, but not the uncertainty of camera, plane and clock.

    Parameters
    ----------
    trials : iterable of Trial
        Their paths give a minimum size of the image.

    Returns
    -------
    dict
        By the id of the corresponding effect.
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
    """Remove instrument faults from a verdict that the calibration allows.

    If only such faults are named, nothing is missing. If the calibration is unknown, its typical
    uncertainties are not sufficient evidence: the names stay, downgraded. Next to physics, or far
    beyond the widths, a verdict is unchanged.

    Parameters
    ----------
    widths : mapping
        Id of a fault → standard uncertainty of the calibration in it.
    known : bool
        Whether the widths are from the recording's own calibration.
    """
    if not widths:
        return verdict
    notes = (*verdict.notes, _widths_text(widths, known))
    if not verdict.effects or not all(_allowed(effect, widths) for effect in verdict.effects):
        return replace(verdict, notes=notes)
    sizes = ", ".join(
        f"{effect.id} {p.name} = {p.value:.2g} ± {p.std:.1g}"
        for effect in verdict.effects
        for p in effect.parameters
        if p.name == FAULT_PARAMETERS[effect.id]
    )
    if not known:
        doubted = (replace(e, probability=min(e.probability, DOUBTED)) for e in verdict.effects)
        return replace(
            verdict,
            verdict="ambiguous",
            effects=tuple(doubted),
            next_measurement=OWN_CALIBRATION,
            notes=(*notes, f"{sizes} is uncertain: {Doubt.UNKNOWN_CALIBRATION.value}"),
        )
    return replace(
        verdict,
        verdict="no_mismatch",
        location=None,
        effects=(),
        indistinguishable=(),
        next_measurement=None,
        notes=(*notes, f"{sizes} is not significant: the calibration allows it"),
    )


def _allowed(effect: NamedEffect, widths: Mapping[str, float]) -> bool:
    return effect.id in widths and any(
        p.name == FAULT_PARAMETERS[effect.id]
        and abs(p.value) <= MAX_CALIBRATION_DEVIATION * math.hypot(widths[effect.id], p.std)
        for p in effect.parameters
    )


def _widths_text(widths: Mapping[str, float], known: bool) -> str:
    roll = widths.get("camera_roll")
    text = (
        f"rate ± {100.0 * widths['time_base']:.2g} %, scale ±"
        f" {100.0 * widths['length_scale']:.2g} %, roll"
        f" {'unknown' if roll is None else f'± {math.degrees(roll):.2g}°'}"
    )
    if known:
        return f"uncertainty of the calibration: {text}"
    return (
        f"the table does not state its calibration's uncertainty; assumed: {text}, depth of the"
        f" plane ± {100.0 * widths['parallax']:.2g} %, displacement by an uncalibrated lens at the"
        f" edge of the image {100.0 * Defaults.LENS_DISTORTION.std:.2g} %"
    )


MAX_CLIP_WARNINGS = 3
"""Warnings passed on per clip (chosen); `vision measure` shows all."""


@dataclass(frozen=True)
class ClipFacts:
    """The lab's entries about one clip; None if missing.

    Attributes
    ----------
    backswing : float or None
        rad.
    ball, session : str or None
        Their names.
    """

    backswing: float | None = None
    ball: str | None = None
    session: str | None = None


@dataclass(frozen=True)
class ClipCampaign(CampaignRecords):
    """Trials from clips, with the uncertainties of their calibration.

    Attributes
    ----------
    widths : mapping
        Id of an instrument fault → standard uncertainty of the calibration in it.
    calibrated : bool
        Whether the widths are from the clips' own calibration rather than typical values.
    instruments : tuple of Effect
        Faults of axis, resting ball, scale and horizontal, per clip and common to all clips of a
        camera.
    assumed : frozenset of str
        Ids of those that nothing has measured.
    """

    widths: Mapping[str, float] = field(default_factory=dict)
    calibrated: bool = True
    instruments: tuple[Effect, ...] = ()
    assumed: frozenset[str] = frozenset()


def clip_facts(path: Path) -> dict[str, ClipFacts]:
    """Read a table of clips: ``clip``, and any of ``backswing_deg``, ``ball``, ``session``.

    Returns
    -------
    dict
        By the clip's name without folder and ending.

    Raises
    ------
    UsageError
        If the file can't be read, or has no column ``clip``.
    """
    table = read_sheet(path, {"backswing": "deg"}, ("clip", "ball", "session")).table
    if "clip" not in table or not {"backswing_deg", "ball", "session"} & set(table.columns):
        raise UsageError(
            f"{path} has the columns {', '.join(table.columns)}",
            hint="A table of clips needs a column clip, and backswing_deg, ball or session.",
        )
    nothing = pd.Series(np.nan, index=table.index)
    angles = nothing.to_numpy()
    if "backswing_deg" in table:
        said: list[str] = []
        angles = numbers_of(table, "backswing_deg", path.name, said)
        if said:
            raise UsageError(said[0].removesuffix("; they are ignored"), hint="Correct the cells.")
    words = [table.get(column, nothing) for column in ("ball", "session")]
    facts = {}
    for name, angle, *said in zip(table["clip"], angles, *words, strict=True):
        facts[Path(str(name).strip()).stem] = ClipFacts(
            None if pd.isna(angle) else math.radians(float(angle)),
            *(None if pd.isna(word) else str(word).strip() for word in said),
        )
    return facts


def campaign_from_clips(
    clips: Sequence[Path],
    setup: Setup,
    facts: Mapping[str, ClipFacts] | None = None,
    measure: "Callable[[Path, MeasureOptions], ClipMeasurement] | None" = None,
    *,
    strikes: bool = False,
) -> ClipCampaign:
    """Measure clips and convert their tracks to trials.

    Flights are compared; with `strikes` also the preceding swing. A clip whose back-swing is
    neither given nor visible starts from the angle implied by its speed before contact without
    losses; losses of the swing are then only detectable in the recorded part.
    A clip that can't be measured is skipped and noted, unless none can.

    Parameters
    ----------
    facts : mapping, optional
        Clip's name → the lab's entries about it.
    measure : callable, optional
        The measuring chain, if other than `measure_clip`.
    strikes : bool
        Also compare the swing before the strike; the uncertainties of axis, rest position, scale,
        horizontal and centres are then parameters of the model.

    Raises
    ------
    UsageError
        If two clips have one name.
    ClipError, MeasurementError
        If no clip can be read and measured: the first clip's reason.
    """
    from measuring.chain import MeasureOptions, measure_clip

    _refuse_same_names(clips)
    known, setup = facts or {}, with_rig(setup)
    found: list[tuple[Trial, ClipMeasurement]] = []
    notes: list[str] = []
    refused: dict[Path, ClipError | MeasurementError] = {}
    for path in clips:
        about = known.get(path.stem, ClipFacts())
        try:
            measured = (measure or measure_clip)(path, MeasureOptions(setup=setup, ball=about.ball))
            trial, said = trial_of(path.stem, measured, setup, about)
        except (ClipError, MeasurementError) as problem:
            refused[path] = problem
            continue
        found.append((trial, measured))
        notes += [f"{path.name}: {text}" for text in said]
    if not found:
        raise next(iter(refused.values()))
    missed = [f"{path.name} could not be measured: {why.message}" for path, why in refused.items()]
    told = all(_struck(trial, setup) for trial, _ in found)
    trials = [_seen_clearly(trial, clear_interval(one, setup)) for trial, one in found]
    faults = [clip_faults(one) for _, one in found]
    if not (strikes and told):
        # without a whole strike, the swing can't be compared
        trials = [_flight_only(trial) for trial in trials]
        faults = [tuple(f for f in one if isinstance(f, WanderingCentre)) for one in faults]
        notes.insert(0, _why_flights(told))
    common = common_widths([calibration_widths(one) for _, one in found])
    level = frozenset() if "camera_roll" in common else frozenset({ROLL_OF_THE_CLIP})
    return ClipCampaign(
        tuple(trials), (*missed, *notes), common, instruments=common_faults(faults),
        assumed=level,
    )  # fmt: skip


def _refuse_same_names(clips: Sequence[Path]) -> None:
    names = [path.stem for path in clips]
    again = sorted({name for name in names if names.count(name) > 1})
    if again:
        raise UsageError(
            f"two clips are called {again[0]}", hint="Rename one: the name identifies the trial."
        )


def campaign_of_flight(measured: "ClipMeasurement", setup: Setup) -> ClipCampaign:
    """The free flight of a ball that nothing strikes, until its first bounce, as one trial.

    What a camera that is not calibrated may do to a path has its typical size.

    Raises
    ------
    UsageError
        If there is no scale, or no flight.
    """
    from measuring.measurement import tracks_as_frame

    name = measured.info.path.stem
    # gravity is along y of the picture, not of axes that were turned
    rows = flight_rows(tracks_as_frame(replace(measured, axes=None)), name)
    place, std = (
        rows.reindex(columns=[f"{axis}_m{end}" for axis in "xyz"]).to_numpy(float)
        for end in ("", "_std")
    )
    none, ball = np.zeros(0), None if setup.ball is None else setup.ball.name
    trial = Trial(name, rows["t_s"].to_numpy(float), place, none, none, ball, None, std, None)
    slow = WanderingCentre()
    drift = _with_widths(slow, np.repeat(np.nanmedian(std[:, :2], axis=0), len(slow.orders)))
    widths = unknown_widths([trial]) | calibration_widths(measured)
    return ClipCampaign((trial,), measured.warnings[:MAX_CLIP_WARNINGS], widths, True, (drift,))


def with_rig(setup: Setup) -> Setup:
    """The setup with the paper's pendulum and support where it states none."""
    return replace(
        setup,
        pendulum=setup.pendulum or PAPER_PENDULUM,
        support=setup.support or PAPER_SUPPORT,
    )


def has_rig(setup: Setup) -> bool:
    """Whether a setup states pendulum and support; an assumed rig would differ from it."""
    return None not in (setup.pendulum, setup.support)


def _why_flights(from_backswing: bool) -> str:
    if not from_backswing:
        return "only flights are compared: not every strike has a known back-swing"
    return "only flights are compared; pass --strikes to include the swing"


def _release(measured: "ClipMeasurement") -> float:
    """Time at which the ball is free, in the first frame of its flight, s."""
    return -math.inf if measured.impact is None else float(measured.impact.flight.time_s[0])


def _struck(trial: Trial, setup: Setup) -> bool:
    """Whether the baseline can simulate the trial from the back-swing on."""
    ball = setup.balls.get(trial.ball or "", setup.ball)
    told = ball is not None and (
        bool(ball.contact_outcome) or None not in (ball.cor, ball.launch_angle, ball.mass)
    )
    return told and trial.backswing is not None


def clear_interval(measured: "ClipMeasurement", setup: Setup) -> tuple[float, float, float]:
    """Times from and until which only the wall is behind the ball, and end of the swing, s.

    Until it has moved by its radius the ball is next to the mass; where its lower rim covers the
    foot of the wall it is in front of the floor and its own shadow. Without a calibrated camera
    that position is found in the image.
    """
    impact = measured.impact
    if impact is None:
        return -math.inf, math.inf, math.inf
    tracks, radius = impact.tracks, impact.tracks.radius_m
    away = np.hypot(*(tracks.ball_m - tracks.rest_m).T)
    gone = (away > radius) & (tracks.ball_time_s >= _release(measured))
    first = float(tracks.ball_time_s[gone][0]) if gone.any() else _release(measured)
    # a ball takes longer to move by its radius than a contact lasts
    touched = _release(measured) - (first - _release(measured))
    if measured.calibration is None or setup.support is None:
        flying = gone & (tracks.ball_time_s <= impact.last_flight_s + 1e-9)
        return first, _before_another_surface(measured, flying), touched
    floor = float(tracks.rest_m[1]) - setup.support.height - radius
    camera = measured.calibration.camera.position
    nearer = measured.calibration.ball_plane_offset / measured.calibration.camera_distance
    foot = floor + (float(camera[1]) - floor) * nearer
    over = (tracks.ball_m[:, 1] - radius < foot) & (tracks.ball_time_s > first)
    return first, float(tracks.ball_time_s[over][0]) if over.any() else math.inf, touched


SURFACE_CHANGE_RATIO = 2.0
"""Standard deviation of the background along a ball's outline, relative to its usual value along
the flight, from which another surface is behind it (chosen: the wall's own variation)."""

RIM_FRACTION = 0.15
"""Width of the zone evaluated by the outline fit, on either side, as a fraction of the radius."""

BACKGROUND_QUANTILES = (0.02, 0.98)
"""Quantiles that bound the background: 2 % of the pixels may be faulty (chosen)."""


def _before_another_surface(measured: "ClipMeasurement", flying: NDArray[np.bool_]) -> float:
    """Time from which the ball stays in front of another surface until its flight ends, s.

    A floor biases the outline towards its side, and the ball's shadow is on it.

    Parameters
    ----------
    flying : (N,) bool array
        Rows of its flight clear of the mass.
    """
    ball, impact = measured.tracks.ball, measured.impact
    if impact is None or not flying.any():
        return math.inf
    flying_s = impact.tracks.ball_time_s[flying]
    rows = np.flatnonzero(np.isin(ball.frame, impact.tracks.ball_frame[flying]))
    background = np.asarray(measured.tracks.background, dtype=np.float64)
    down, across = np.mgrid[: background.shape[0], : background.shape[1]]
    spread = np.full(flying_s.size, math.inf)
    for at, row in enumerate(rows):
        away = np.hypot(across - ball.centre_px[row, 0], down - ball.centre_px[row, 1])
        near = background[np.abs(away / ball.radius_px[row] - 1.0) < RIM_FRACTION]
        if near.size:
            spread[at] = np.ptp(np.quantile(near, BACKGROUND_QUANTILES))
    one_surface = np.flatnonzero(spread <= SURFACE_CHANGE_RATIO * np.median(spread))
    end = int(one_surface[-1]) + 1
    return float(flying_s[end]) if end < flying_s.size else math.inf


def _seen_clearly(trial: Trial, clear: tuple[float, float, float]) -> Trial:
    """The flight where it is clear, and the preceding swing.

    Next to the mass the ball's outline is biased, and so is the mass behind the ball and near its
    turning point: ten times more than before the strike.
    """
    flying = (trial.ball_time >= clear[0] - 1e-9) & (trial.ball_time < clear[1] - 1e-9)
    std = None if trial.position_std is None else trial.position_std[flying]
    falling = trial.pendulum_time < clear[2]
    return replace(
        trial,
        ball_time=trial.ball_time[flying],
        position=trial.position[flying],
        pendulum_time=trial.pendulum_time[falling],
        pendulum_angle=trial.pendulum_angle[falling],
        position_std=std,
    )


def _flight_only(trial: Trial) -> Trial:
    nothing = np.zeros(0)
    return replace(trial, pendulum_time=nothing, pendulum_angle=nothing, backswing=None)


def trial_of(
    name: str, measured: "ClipMeasurement", setup: Setup, about: ClipFacts | None = None
) -> tuple[Trial, list[str]]:
    """Convert one clip's tracks to a trial, with notes on assumptions.

    Raises
    ------
    NotFoundError
        If no strike was measured in the clip.
    """
    facts = about or ClipFacts()
    if measured.impact is None:
        raise NotFoundError(
            f"{name}: no strike was measured in this clip",
            hint="Run vision measure on it: it reports what is missing.",
        )
    tracks = measured.impact.tracks
    notes = list(measured.warnings[:MAX_CLIP_WARNINGS])
    named = setup.balls.get(facts.ball or "", setup.ball)
    rest_height = 0.0
    if setup.support is not None:
        radius = 0.5 * named.diameter if named is not None else tracks.radius_m
        rest_height = setup.support.height + radius
    # after a bounce the flight is over
    flying = tracks.ball_time_s <= measured.impact.last_flight_s + 1e-9
    moved = (tracks.ball_m - tracks.rest_m + np.array([0.0, rest_height]))[flying]
    blank = np.full(moved.shape[0], np.nan)
    covariance = tracks.ball_cov_m2[flying]
    std = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]], axis=1))
    backswing = facts.backswing
    if backswing is None:
        backswing, said = _backswing(measured, setup)
        notes += said
    ball = facts.ball or (None if setup.ball is None else setup.ball.name)
    trial = Trial(
        name, tracks.ball_time_s[flying], np.column_stack([moved, blank]), tracks.swing_time_s,
        tracks.swing_rad, ball, backswing, np.column_stack([std, blank]), facts.session,
    )  # fmt: skip
    return trial, notes


def _backswing(measured: "ClipMeasurement", setup: Setup) -> tuple[float | None, list[str]]:
    angle = measured.quantity("backswing_angle")
    if angle.value is not None:
        return math.radians(angle.value), []
    speed = measured.quantity("pendulum_speed_before").value
    contact = None if setup.ball is None else setup.ball.launch_angle
    if setup.pendulum is None or speed is None or contact is None:
        return None, []
    note = "back-swing not visible; estimated from the speed before contact"
    return _lossless_backswing(setup.pendulum, speed, contact), [note]


def _lossless_backswing(pendulum: Pendulum, speed: float, contact: float) -> float:
    rate = speed / pendulum.length
    drop = rate**2 * pendulum.inertia / (2.0 * pendulum.mass * GRAVITY * pendulum.com)
    return math.acos(float(np.clip(math.cos(contact) - drop, -1.0, 1.0)))
