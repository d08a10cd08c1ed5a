"""The part of a campaign that the peers look at: free flights, and what the setup says of them."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from bench.concealed.world.shots import Array

__all__ = ["FreeFlight", "baseline_residual", "free_flights", "smoothed"]

GRAVITY = 9.806
CLEAR_OF_CONTACT = 0.06
WINDOW_SECONDS = 0.05


@dataclass(frozen=True)
class FreeFlight:
    """Even times (n,), positions (n, 2) and the baseline's drag per mass (1/m) of one trial."""

    time: Array
    place: Array
    drag_per_mass: float


def _number(text: str | float) -> float:
    return float(str(text).split()[0])


def _drag(setup: dict, name: str | None) -> float:  # type: ignore[type-arg]
    ball = setup.get("balls", {}).get(name) or setup["ball"]
    coefficient = setup.get("model", {}).get("drag", {}).get("drag_coefficient", 0.0)
    diameter = _number(ball["diameter"]) / (1000 if "mm" in str(ball["diameter"]) else 1)
    density = _number(setup["air"]["density"])
    return 0.5 * density * coefficient * np.pi / 4 * diameter**2 / _number(ball["mass"])


def free_flights(folder: Path) -> list[FreeFlight]:
    """Flights of a campaign folder, resampled evenly, gross outliers taken out."""
    setup = tomllib.loads((folder / "setup.toml").read_text(encoding="utf-8"))
    table = pd.read_csv(folder / "ball.csv")
    flights = []
    for _, rows in table.groupby("trial"):
        time, place = rows["t_s"].to_numpy(), rows[["x_m", "y_m"]].to_numpy()
        if "pendulum" in setup:
            late = np.flatnonzero(place[:, 0] < CLEAR_OF_CONTACT)
            first = late[-1] + 1 if len(late) else 0
            time, place = time[first:], place[first:]
        if len(time) < 30:
            continue
        smooth = np.stack([np.polyval(np.polyfit(time, c, 5), time) for c in place.T], axis=1)
        off = np.abs(place - smooth).max(axis=1)
        kept = off < 6 * np.median(off)
        even = np.arange(time[0], time[-1], np.median(np.diff(time)))
        columns = [np.interp(even, time[kept], column[kept]) for column in place.T]
        name = rows["ball"].iloc[0] if "ball" in rows else None
        flights.append(FreeFlight(even, np.stack(columns, axis=1), _drag(setup, name)))
    return flights


def smoothed(flight: FreeFlight, order: int) -> Array:
    """Derivative of that order by Savitzky and Golay's filter, (n, 2)."""
    step = float(flight.time[1] - flight.time[0])
    window = min(2 * int(WINDOW_SECONDS / step / 2) + 1, len(flight.time) - 1 | 1)
    window = max(window, 7)
    return np.asarray(
        savgol_filter(flight.place, window, 3, deriv=order, delta=step, axis=0), dtype=float
    )


def baseline_residual(flight: FreeFlight) -> Array:
    """Positions less the baseline's flight from the best start, (n, 2)."""

    def rate(_: float, s: Array) -> list[float]:
        speed = np.hypot(s[2], s[3])
        k = flight.drag_per_mass * speed
        return [s[2], s[3], -k * s[2], -GRAVITY - k * s[3]]

    time = flight.time - flight.time[0]

    def residuals(start: Array) -> Array:
        path = solve_ivp(rate, (0, time[-1]), start, t_eval=time, rtol=1e-8, atol=1e-9)
        return np.asarray((flight.place - path.y[:2].T).ravel())

    velocity = smoothed(flight, 1)[0]
    fitted = least_squares(residuals, [*flight.place[0], *velocity], diff_step=1e-5)
    return np.asarray(fitted.fun).reshape(-1, 2)
