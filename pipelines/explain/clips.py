"""Clips as a campaign: the measuring chain, its tracks in metres, one trial a clip.

Track tables of `vision measure --tracks` as input: the free motion in them, cut out.

A track goes from the ball at rest through contact and flight to the bounce; a model of free motion
holds only between. Where it begins and ends is told by the track itself.

What a calibration leaves open, against faults of the instrument that are named.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

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
from pipelines.setup.file import Setup

if TYPE_CHECKING:
    from calib.calibration import Calibration
    from pipelines.measure.chain import MeasureOptions
    from pipelines.measure.measurement import ClipMeasurement

__all__ = [
    "ClipCampaign",
    "ClipFacts",
    "before_the_wall",
    "calibration_widths",
    "campaign_from_clips",
    "clip_facts",
    "common_widths",
    "flight_rows",
    "is_track_table",
    "outline_shares",
    "states_the_rig",
    "swing_rows",
    "trial_of",
    "unknown_widths",
    "with_rig",
    "within_calibration",
]

FloatArray = NDArray[np.float64]

LEAST_ROWS = 8

"""Fewer rows tell no flight from a contact."""

STILL_ROWS = 5

"""Rows at the start in which a ball must lie still: fewer do not tell the noise from a creeping
ball."""

OFF = 4.0

"""Standard deviations off the free motion at which a row no longer belongs to it."""


def is_track_table(table: pd.DataFrame) -> bool:
    """Whether the table is one of tracks: several objects, told by the column ``object``."""
    return {"object", "t_s"} <= set(table.columns)


def flight_rows(table: pd.DataFrame, name: str, rest_height: float = 0.0) -> pd.DataFrame:
    """The ball's free flight, x forward from rest, y up from the floor; a trial each.

    Parameters
    ----------
    table : DataFrame
        Track table; a column ``trial`` tells several clips apart.
    name : str
        What to call the trial where there is no such column.
    rest_height : float
        Height of the resting ball's centre, m.

    Raises
    ------
    UsageError
        If the ball has no metres, or no flight is in the track.
    """
    return pd.concat(
        [_flight(part, trial, rest_height) for trial, part in _trials(table, name, "ball")],
        ignore_index=True,
    )


def swing_rows(table: pd.DataFrame, name: str) -> pd.DataFrame:
    """The pendulum's free swing, up to where it meets the ball; a trial each.

    Parameters
    ----------
    table, name
        As in `flight_rows`.

    Raises
    ------
    UsageError
        If there is no pendulum with angles in the table.
    """
    parts = []
    for trial, swing in _trials(table, name, "pendulum"):
        if "phi_rad" not in swing or swing["phi_rad"].isna().all():
            raise UsageError(
                f"{name}: the pendulum has no angles (phi_rad)",
                hint="Measure the clip with --tracks: it writes phi_rad where a swing is seen.",
            )
        touched = _touched(_of(table, trial, "ball"))
        parts.append(swing if touched is None else swing[swing["t_s"] < touched])
    return pd.concat(parts, ignore_index=True)


def _trials(table: pd.DataFrame, name: str, kind: str) -> list[tuple[str, pd.DataFrame]]:
    named = table if "trial" in table else table.assign(trial=name)
    mine = named[named["object"] == kind].sort_values(["trial", "t_s"], kind="stable")
    if mine.empty:
        raise UsageError(
            f"{name} holds no rows of a {kind}",
            hint="The column object says what a row is of: ball or pendulum.",
        )
    return [(str(trial), part) for trial, part in mine.groupby("trial", sort=False)]


def _of(table: pd.DataFrame, trial: str, kind: str) -> pd.DataFrame:
    mine = table[table["object"] == kind]
    if "trial" in mine:
        mine = mine[mine["trial"].astype(str) == trial]
    return mine.sort_values("t_s")


def _leaves(ball: pd.DataFrame) -> float | None:
    """When the ball leaves its place, s; None where it never lies still."""
    if len(ball) < LEAST_ROWS:
        return None
    position = ball[["x_px", "y_px"]].to_numpy(float)
    still = position[:STILL_ROWS]
    spread = np.median(np.abs(np.diff(position, n=2, axis=0)), axis=0) / (0.6745 * np.sqrt(6.0))
    away = np.abs(position - np.median(still, axis=0)).max(axis=1)
    off = away > OFF * np.sqrt(2.0) * max(float(spread.max()), 1e-6)
    if off[:STILL_ROWS].any():
        return None
    # three rows in a row: one that is off by itself is an outlier
    gone = [row for row in np.flatnonzero(off) if off[row : row + 3].all()]
    return float(ball["t_s"].iloc[gone[0]]) if gone else None


def _clear(ball: pd.DataFrame, left: float) -> NDArray[np.bool_]:
    """Rows in which the ball has left its place by its own radius: no contact lasts so long."""
    rest = ball.loc[ball["t_s"] < left, ["x_px", "y_px"]].median()
    away = np.hypot(ball["x_px"] - rest["x_px"], ball["y_px"] - rest["y_px"])
    reach = ball["radius_px"].median() if "radius_px" in ball else 0.0
    return np.asarray((ball["t_s"] >= left) & (away > (0.0 if np.isnan(reach) else reach)))


def _touched(ball: pd.DataFrame) -> float | None:
    """A moment before the pendulum meets the ball, s; None where the ball never lies still.

    The ball is seen to leave some frames after the first touch: as long again as it then takes to
    move by its radius is early enough.
    """
    left = _leaves(ball)
    if left is None:
        return None
    clear = ball.loc[_clear(ball, left), "t_s"]
    return left if clear.empty else left - (float(clear.iloc[0]) - left)


def _flight(ball: pd.DataFrame, trial: str, rest_height: float) -> pd.DataFrame:
    known = ball.dropna(subset=["x_m", "y_m"])
    if len(known) < LEAST_ROWS:
        raise UsageError(
            f"trial {trial}: the ball has no metres in this table",
            hint="Measure the clip with --wall-grid or --ball, so that a scale is known.",
        )
    left = _leaves(known)
    moving = known if left is None else known[_clear(known, left)]
    time = moving["t_s"].to_numpy(float)
    place = moving[["x_m", "y_m"]].to_numpy(float)
    first, end = _free_stretch(time, place)
    if end - first < LEAST_ROWS:
        raise UsageError(
            f"trial {trial}: no free flight is in this track",
            hint="The ball must fly through ten frames or more; look at the overlay.",
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
    """Rows [first, end) that one smooth free motion goes through, grown from its middle.

    Free flight with drag is a cubic in time to far below the noise of any track over a second;
    a push at its beginning or a bounce at its end is not.
    """
    end = _bounce(time, place[:, 1])
    first, stop = end // 4, max(end - end // 8, end // 4 + LEAST_ROWS)
    stop = min(stop, end)
    noise: FloatArray | None = None
    for _ in range(2 * len(time)):
        inside = slice(first, stop)
        if stop - first < LEAST_ROWS:
            return first, first
        centre, half = time[inside].mean(), max(float(np.ptp(time[inside])) / 2.0, 1e-9)
        fits = [np.polyfit((time[inside] - centre) / half, row, 3) for row in place[inside].T]
        off = np.stack([place[:, k] - np.polyval(fits[k], (time - centre) / half) for k in (0, 1)])
        if noise is None:
            # of the middle, which is surely free: rows let in later must not widen the door
            noise = np.sqrt((off[:, inside] ** 2).sum(axis=1) / (stop - first - 4))
        free = np.all(np.abs(off) < OFF * noise[:, np.newaxis], axis=0)
        # one row that is off is an outlier, two in a row are the end of the free motion
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
    if len(time) < LEAST_ROWS:
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


def calibration_widths(measured: "ClipMeasurement") -> dict[str, float]:
    """Standard uncertainties of rate and scale (relative) and of roll (rad) of one clip.

    The calibration's, and what the ball's outline adds: slow errors that all clips share. Without
    a calibration nothing has measured the roll.

    Returns
    -------
    dict
        By the id of the effect that such an error would be.
    """
    rate = measured.rate.std / measured.rate.fps
    if measured.calibration is None or measured.impact is None:
        return {
            "time_base": rate,
            "length_scale": _stretched(measured),
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


STRETCHING = frozenset(
    {UncertaintySource.BALL_DIAMETER, UncertaintySource.SCALE, UncertaintySource.CAMERA_SLANT}
)
"""What leaves the size of a path open where no grid tells it."""


def _stretched(measured: "ClipMeasurement") -> float:
    """By what share a path may be too long where no grid tells, as its speed's own budget says."""
    speed = measured.quantity("ball_speed")
    if not speed.value:
        return Defaults.BALL_DIAMETER.std
    parts = [part.std for part in speed.budget if part.source in STRETCHING]
    return max(math.hypot(*parts) / speed.value, Defaults.BALL_DIAMETER.std)


def outline_shares(px: np.ndarray) -> tuple[float, float]:
    """What a wandering outline is of a path's (N, 2) extent along and across the picture's rows."""
    along, fall = OUTLINE_PX / np.maximum(np.ptp(px, axis=0), OUTLINE_PX)
    return float(along), float(fall)


def _scale_and_roll(calibration: "Calibration", px: np.ndarray) -> tuple[float, float]:
    """How far the calibration's covariance stretches and turns a track, one sigma each."""
    std = np.sqrt(np.maximum(np.diag(calibration.covariance), 0.0))
    free = std > 0.0
    outer = np.outer(std[free], std[free])
    lengths, axes = np.linalg.eigh(calibration.covariance[np.ix_(free, free)] / outer)
    nothing = np.zeros((len(px), 2, 2))
    from pipelines.measure.metres import CameraMapping

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


def left_open(measured: "ClipMeasurement") -> tuple[Effect, ...]:
    """What one clip leaves open: faults whose parameters have its uncertainties as widths.

    How far the ball's centre may wander along its flight comes first. Of a strike, how far the mass
    may, where the axis is and where the ball rests, as measured; scale and roll as in
    `calibration_widths`.
    """
    if measured.impact is None:
        return ()
    # comes with the measuring chain
    from vision.pendulum.arc import LOOK_PX

    tracks = measured.impact.tracks
    # What is stated of a centre and does not show from frame to frame is slow.
    flying = tracks.ball_cov_m2[tracks.ball_time_s >= _release(measured) - 1e-9]
    seen = np.sqrt(np.diag(np.median(flying, axis=0)))
    slow, fixed = WanderingCentre(), BehindTheBall()
    wander = (
        _held(slow, np.repeat(seen, len(slow.orders))),
        _held(fixed, np.repeat(seen, len(fixed.orders)), (Level.CAMPAIGN,)),
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
        _held(turns, [LOOK_PX * metres_per_px / arm] * len(turns.parameters)),
        _held(PivotElsewhere(), axis),
        _held(OriginOffset(id="rest_elsewhere"), tracks.rest_std_m),
        _held(LengthScale(id="scale_of_the_clip", form=about), [widths["length_scale"]]),
        _held(
            CameraRoll(id=ROLL_OF_THE_CLIP, form=about),
            [widths.get("camera_roll", Defaults.CAMERA_ROLL.std)],
        ),
    )


ROLL_OF_THE_CLIP = "roll_of_the_clip"

IN_EACH = (Level.CAMPAIGN, Level.TRIAL)
"""One camera errs alike in all clips, and each clip anew: either takes the whole width."""


def _held(
    fault: Effect, widths: Sequence[float] | FloatArray, levels: tuple[Level, ...] = IN_EACH
) -> Effect:
    held = tuple(
        replace(p, width=float(width), expected=0.0)
        for p, width in zip(fault.parameters, widths, strict=True)
    )
    return replace(fault, sharp=False, parameters=held, levels=levels)


def common_faults(clips: Sequence[tuple[Effect, ...]]) -> tuple[Effect, ...]:
    """Faults of a campaign, each as wide as the median of its clips says; none if a clip has none.

    One camera errs alike in all clips, and each clip anew: either takes the whole width.
    """
    return tuple(
        _held(
            alike[0],
            np.median([[p.width for p in one.parameters] for one in alike], axis=0),
            alike[0].levels,
        )
        for alike in zip(*clips, strict=False)
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
    roll = widths.get("camera_roll")
    told = (
        f"the rate to {100.0 * widths['time_base']:.2g} %, the scale to"
        f" {100.0 * widths['length_scale']:.2g} % and the roll"
        f" {'not at all' if roll is None else f'to {math.degrees(roll):.2g} deg'}"
    )
    if known:
        return f"the calibration knows {told}"
    return (
        f"the table does not tell how well its clip was calibrated; usual is {told}, the depth of"
        f" the plane to {100.0 * widths['parallax']:.2g} %, and a lens that nobody measured"
        f" displaces the picture's edge by {100.0 * Defaults.LENS_DISTORTION.std:.2g} %"
    )


MOST_WARNINGS = 3

"""Warnings of one clip that are passed on: further ones are there if the clip is measured."""


@dataclass(frozen=True)
class ClipFacts:
    """What the lab wrote down about one clip; None where it did not.

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
    """Trials from clips, with what their calibration leaves open.

    Attributes
    ----------
    widths : mapping
        Id of a fault of the instrument → standard uncertainty of the calibration in it.
    calibrated : bool
        Whether the widths are of the clips' own calibration, or what is usual of one.
    instruments : tuple of Effect
        What each clip leaves open of where its axis, its resting ball, its scale and its horizontal
        are, and all clips of a camera alike.
    assumed : frozenset of str
        Ids among them of what nothing has measured.
    """

    widths: Mapping[str, float] = field(default_factory=dict)
    calibrated: bool = True
    instruments: tuple[Effect, ...] = ()
    assumed: frozenset[str] = frozenset()


def clip_facts(path: Path) -> dict[str, ClipFacts]:
    """Read a table of clips: ``clip``, and ``backswing_deg``, ``ball``, ``session``, or some.

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
            hint="A table of clips has a column clip, and backswing_deg, ball or session.",
        )
    nothing = pd.Series(np.nan, index=table.index)
    angles = nothing.to_numpy()
    if "backswing_deg" in table:
        said: list[str] = []
        angles = numbers_of(table, "backswing_deg", path.name, said)
        if said:
            raise UsageError(said[0].removesuffix("; they are left out"), hint="Mend these cells.")
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
    """Measure clips and lay their tracks out as trials.

    Flights are compared; with `strikes` the swing that leads to them, too. A clip whose back-swing
    is neither told nor in view starts from the angle that its speed before contact implies without
    losses; losses of the swing can then only be seen in the recorded part.
    A clip that can't be measured is left out and noted, unless none can.

    Parameters
    ----------
    clips : sequence of Path
    setup : Setup
    facts : mapping, optional
        Clip's name → what the lab wrote down about it.
    measure : callable, optional
        The measuring chain, if another than `measure_clip`.
    strikes : bool
        Compare the swing before the strike, too: what clips leave open of axis, rest, scale,
        horizontal and centres is then open in the model, as far as it is stated.

    Raises
    ------
    UsageError
        If two clips have one name.
    ClipError, MeasurementError
        If no clip can be read and measured: the first clip's reason.
    """
    from pipelines.measure.chain import MeasureOptions, measure_clip

    names = [path.stem for path in clips]
    again = sorted({name for name in names if names.count(name) > 1})
    if again:
        raise UsageError(
            f"two clips are called {again[0]}", hint="Every clip is a trial and needs its own name."
        )
    known, setup = facts or {}, with_rig(setup)
    trials: list[Trial] = []
    widths: list[dict[str, float]] = []
    faults: list[tuple[Effect, ...]] = []
    clear: list[tuple[float, float, float]] = []
    notes: list[str] = []
    refused: list[tuple[Path, ClipError | MeasurementError]] = []
    for path in clips:
        about = known.get(path.stem, ClipFacts())
        try:
            measured = (measure or measure_clip)(path, MeasureOptions(setup=setup, ball=about.ball))
            trial, said = trial_of(path.stem, measured, setup, about)
        except (ClipError, MeasurementError) as problem:
            refused.append((path, problem))
            continue
        trials.append(trial)
        clear.append(before_the_wall(measured, setup))
        widths.append(calibration_widths(measured))
        faults.append(left_open(measured))
        notes += [f"{path.name}: {text}" for text in said]
    if not trials:
        raise refused[0][1]
    left_out = [
        f"{path.name} could not be measured and is left out: {why.message}" for path, why in refused
    ]
    told = all(_struck(trial, setup) for trial in trials)
    trials = [_seen_clearly(t, c) for t, c in zip(trials, clear, strict=True)]
    if not (strikes and told):
        # Without a whole strike to compare, a swing is no part of a free flight.
        trials = [_flight_only(trial) for trial in trials]
        faults = [tuple(f for f in one if isinstance(f, WanderingCentre)) for one in faults]
        notes.insert(0, _why_flights(told))
    common = common_widths(widths)
    level = frozenset() if "camera_roll" in common else frozenset({ROLL_OF_THE_CLIP})
    return ClipCampaign(
        tuple(trials), (*left_out, *notes), common, instruments=common_faults(faults),
        assumed=level,
    )  # fmt: skip


def with_rig(setup: Setup) -> Setup:
    """The setup with the paper's pendulum and support where it is silent, as the chain assumes."""
    return replace(
        setup,
        pendulum=setup.pendulum or PAPER_PENDULUM,
        support=setup.support or PAPER_SUPPORT,
    )


def states_the_rig(setup: Setup) -> bool:
    """Whether a setup says what struck: a supposed rig would be told from the real one."""
    return None not in (setup.pendulum, setup.support)


def _why_flights(told: bool) -> str:
    if not told:
        return "not every strike is known from its back-swing on: flights are compared"
    return "flights are compared; --strikes compares the swing that leads to them, too"


def _release(measured: "ClipMeasurement") -> float:
    """When the ball is free in the first frame of its flight, s."""
    return -math.inf if measured.impact is None else float(measured.impact.flight.time_s[0])


def _struck(trial: Trial, setup: Setup) -> bool:
    """Whether the baseline can follow the trial from the back-swing on."""
    ball = setup.balls.get(trial.ball or "", setup.ball)
    told = ball is not None and (
        bool(ball.contact_outcome) or None not in (ball.cor, ball.launch_angle, ball.mass)
    )
    return told and trial.backswing is not None


def before_the_wall(measured: "ClipMeasurement", setup: Setup) -> tuple[float, float, float]:
    """From when to when the wall alone is behind and beside the ball, and the swing ends, s.

    Until it has left its place by its own radius the mass is beside it; where its lower rim covers
    the foot of the wall it is seen before the floor and its own shadow. Where no camera is known,
    the picture tells where that is.
    """
    impact = measured.impact
    if impact is None:
        return -math.inf, math.inf, math.inf
    tracks, radius = impact.tracks, impact.tracks.radius_m
    away = np.hypot(*(tracks.ball_m - tracks.rest_m).T)
    gone = (away > radius) & (tracks.ball_time_s >= _release(measured))
    first = float(tracks.ball_time_s[gone][0]) if gone.any() else _release(measured)
    # A ball takes longer to go its own radius than a contact lasts.
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


OTHER_SURFACE = 2.0
"""Spread of the background along a ball's outline, over what is usual along its flight, from which
another surface is behind it: a boundary that shows as much as the wall itself does."""

RIM = 0.15
"""Share of the radius on either side of an outline that its fit looks at."""

OUTER = (0.02, 0.98)
"""Quantiles between which a background spreads: two in a hundred pixels may be faulty."""


def _before_another_surface(measured: "ClipMeasurement", flying: NDArray[np.bool_]) -> float:
    """When the ball comes before a surface that it then stays before to the end of its flight, s.

    A floor draws the outline towards its own side, and a ball's shadow lies on it.

    Parameters
    ----------
    flying : (N,) bool array
        Clear rows of its flight.
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
        near = background[np.abs(away / ball.radius_px[row] - 1.0) < RIM]
        if near.size:
            spread[at] = np.ptp(np.quantile(near, OUTER))
    one_surface = np.flatnonzero(spread <= OTHER_SURFACE * np.median(spread))
    end = int(one_surface[-1]) + 1
    return float(flying_s[end]) if end < flying_s.size else math.inf


def _seen_clearly(trial: Trial, clear: tuple[float, float, float]) -> Trial:
    """The flight where it is clear, and the swing that leads to it.

    Beside the mass the ball at rest is drawn aside, and the mass itself behind the ball and about
    where it turns: ten times as far as before it struck.
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
    """One clip's tracks as a trial, with notes on what was assumed.

    Raises
    ------
    NotFoundError
        If no strike could be measured in the clip.
    """
    facts = about or ClipFacts()
    if measured.impact is None:
        raise NotFoundError(
            f"{name}: no strike could be measured in this clip",
            hint="vision measure says what is missing.",
        )
    tracks = measured.impact.tracks
    notes = list(measured.warnings[:MOST_WARNINGS])
    named = setup.balls.get(facts.ball or "", setup.ball)
    rest_height = 0.0
    if setup.support is not None:
        radius = 0.5 * named.diameter if named is not None else tracks.radius_m
        rest_height = setup.support.height + radius
    # What bounces is no flight any more.
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
    note = "the back-swing is not in view; taken from the speed before contact"
    return _lossless_backswing(setup.pendulum, speed, contact), [note]


def _lossless_backswing(pendulum: Pendulum, speed: float, contact: float) -> float:
    rate = speed / pendulum.length
    drop = rate**2 * pendulum.inertia / (2.0 * pendulum.mass * GRAVITY * pendulum.com)
    return math.acos(float(np.clip(math.cos(contact) - drop, -1.0, 1.0)))
