"""Predict vertical motion under gravity and drag from the effects an answer names."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from bench.concealed.answer import Answer

__all__ = ["Fall", "fall_of", "predict"]

GRAVITY = 9.80665


@dataclass(frozen=True)
class Fall:
    """Drag per mass k (1/m) at height zero, 1/H of the air (1/m), scale and rate errors."""

    drag_per_mass: float = 0.0
    inverse_scale_height: float = 0.0
    scale_error: float = 0.0
    rate_error: float = 0.0


def fall_of(answer: Answer, mass: float, diameter: float, density: float) -> Fall:
    """Vertical motion implied by the effects an answer names."""
    values = {named.id: named.parameters for named in answer.named}

    def value(identity: str, parameter: str) -> float:
        entry = values.get(identity, {}).get(parameter)
        return 0.0 if entry is None else entry[0]

    coefficient = value("drag", "drag_coefficient")
    return Fall(
        drag_per_mass=0.5 * density * np.pi / 4 * diameter**2 * coefficient / mass,
        inverse_scale_height=value("density_lapse", "inverse_scale_height"),
        scale_error=value("length_scale", "scale_error"),
        rate_error=value("time_base", "rate_error"),
    )


def _heights(start: np.ndarray, fall: Fall, time: np.ndarray) -> np.ndarray:
    def rate(_: float, state: np.ndarray) -> list[float]:
        thin = np.exp(-state[0] * fall.inverse_scale_height)
        return [state[1], -GRAVITY - fall.drag_per_mass * thin * state[1] * abs(state[1])]

    true_time = (time - time[0]) / (1 + fall.rate_error)
    path = solve_ivp(rate, (0, true_time[-1] + 1e-9), start, t_eval=true_time, rtol=1e-8, atol=1e-8)
    return np.asarray(path.y[0]) * (1 + fall.scale_error)


def predict(fall: Fall, time: np.ndarray, height: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Heights at all times; the initial state is fitted to the rows `known` only."""
    rise = np.polyfit(time[known] - time[0], height[known], 2)

    def residuals(start: np.ndarray) -> np.ndarray:
        return (_heights(start, fall, time) - height)[known]

    fitted = least_squares(residuals, [rise[2], rise[1]], x_scale=[1.0, 1.0], loss="soft_l1")
    return _heights(fitted.x, fall, time)
