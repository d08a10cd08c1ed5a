"""Track tables of `vision measure --tracks` as input: the free motion in them, cut out.

A track goes from the ball at rest through contact and flight to the bounce; a model of free motion
holds only between. Where it begins and ends is told by the track itself.
"""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from metrology import UsageError

__all__ = ["flight_rows", "is_track_table", "swing_rows"]

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
            raise UsageError(f"{name}: the pendulum has no angles (phi_rad)")
        touched = _touched(_of(table, trial, "ball"))
        parts.append(swing if touched is None else swing[swing["t_s"] < touched])
    return pd.concat(parts, ignore_index=True)


def _trials(table: pd.DataFrame, name: str, kind: str) -> list[tuple[str, pd.DataFrame]]:
    named = table if "trial" in table else table.assign(trial=name)
    mine = named[named["object"] == kind].sort_values(["trial", "t_s"], kind="stable")
    if mine.empty:
        raise UsageError(f"{name} holds no rows of a {kind}")
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
        raise UsageError(f"trial {trial}: no free flight is in this track")
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
