"""A rod on an encoder shaft: dry and viscous bearing friction."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from bench.concealed.answer import Answer
from bench.real.row import Explain, Row, words
from metrology import write_text_whole

__all__ = ["convert", "held_out_rmse", "rows"]

ROD_LENGTH = 0.124
ROD_MASS = 0.1
"""kg; not stated by the source. Torques scale with it, nothing else does."""


def _after_the_hand(swing: pd.DataFrame) -> pd.DataFrame:
    """First turning point used; before it a hand touches the rod."""
    angle = swing["theta_deg"].to_numpy()
    # Noise produces several crossings of the lowest point; a half swing lasts longer.
    crossings = np.flatnonzero(np.diff(np.sign(angle)) != 0)
    first, second = crossings[np.diff(crossings, prepend=-1000) > 25][:2]
    return swing.iloc[first + int(np.argmax(np.abs(angle[first:second]))) :]


def convert(source: Path, target: Path, trials: tuple[int, ...] = (1, 2, 3)) -> None:
    """Write pendulum.csv and setup.toml of the releases `trials`, cut to the free swing."""
    target.mkdir(parents=True, exist_ok=True)
    swings = pd.read_csv(source / "swings.csv")
    parts = [_after_the_hand(swings[swings["trial"] == trial]) for trial in trials]
    table = pd.concat(parts)
    pd.DataFrame(
        {
            "trial": table["trial"],
            "t_s": table["t_s"],
            "phi_rad": np.round(np.radians(table["theta_deg"]), 6),
        }
    ).to_csv(target / "pendulum.csv", index=False, lineterminator="\n")
    inertia = ROD_MASS * ROD_LENGTH**2 / 3
    write_text_whole(
        target / "setup.toml",
        f"""[pendulum]
length = "{ROD_LENGTH} m"
inertia = "{inertia:.6g} kg m^2"
mass = "{ROD_MASS} kg"
com = "{ROD_LENGTH / 2} m"

[noise]
angle = "{np.radians(0.09) / np.sqrt(12):.2g} rad"
""",
    )


def _swing(parameters: np.ndarray, law: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Angles from phi'' = -w2 sin phi - b phi' - c sign phi' and an initial state."""
    frequency, viscous, dry, quadratic = law

    def rate(_: float, state: np.ndarray) -> list[float]:
        slowing = (
            viscous * state[1]
            + dry * np.tanh(state[1] / 0.02)
            + quadratic * state[1] * abs(state[1])
        )
        return [state[1], -frequency * np.sin(state[0]) - slowing]

    span = (time[0], time[-1])
    return np.asarray(
        solve_ivp(rate, span, parameters, "LSODA", t_eval=time, rtol=1e-7, atol=1e-8).y[0]
    )


def _law(answer: Answer) -> np.ndarray | None:
    """Torque coefficients over inertia of the named effects; None for other physics."""
    inertia = ROD_MASS * ROD_LENGTH**2 / 3
    carried = {
        "viscous_damping": ("viscous_coefficient", 1),
        "bearing_friction": ("dry_torque", 2),
        "pendulum_drag": ("drag_torque", 3),
    }
    law = np.zeros(4)
    for named in answer.named:
        if named.id in carried:
            parameter, place = carried[named.id]
            if parameter not in named.parameters:
                return None
            law[place] = named.parameters[parameter][0] / inertia
    return law


def held_out_rmse(source: Path, answer: Answer, trained: tuple[int, ...], tested: int) -> float:
    """RMSE (deg) on a held-out release: torques from the answer, w0 from the other releases."""
    law = _law(answer)
    if law is None:
        return float("nan")
    swings = pd.read_csv(source / "swings.csv")
    pieces = {
        trial: _after_the_hand(swings[swings["trial"] == trial]) for trial in (*trained, tested)
    }

    def angles(trial: int) -> tuple[np.ndarray, np.ndarray]:
        piece = pieces[trial].iloc[::4]
        return piece["t_s"].to_numpy(), np.radians(piece["theta_deg"].to_numpy())

    def residuals(values: np.ndarray, frequency: float, trial: int) -> np.ndarray:
        time, seen = angles(trial)
        law[0] = frequency
        return _swing(values, law, time) - seen

    def joint(values: np.ndarray) -> np.ndarray:
        starts = values[1:].reshape(-1, 2)
        return np.concatenate(
            [residuals(s, values[0], t) for s, t in zip(starts, trained, strict=True)]
        )

    start = np.concatenate([[120.0], *[[angles(trial)[1][0], 0.0] for trial in trained]])
    # The solution is accurate to 1e-7; finite differences need larger steps.
    frequency = least_squares(joint, start, x_scale="jac", diff_step=1e-4).x[0]
    fitted = least_squares(
        residuals, [angles(tested)[1][0], 0.01], args=(frequency, tested), diff_step=1e-4
    )
    return float(np.degrees(np.sqrt(np.mean(fitted.fun**2))))


def rows(source: Path, cache: Path, explain: Explain) -> list[Row]:
    """Effects named on all three releases, and the error on each release when held out."""
    convert(source, cache / "rod_pendulum")
    whole = explain(cache / "rod_pendulum", cache / "rod_pendulum" / "answer.json")
    squares = []
    for tested in (1, 2, 3):
        trained = tuple(trial for trial in (1, 2, 3) if trial != tested)
        folder = cache / f"rod_pendulum_without_{tested}"
        convert(source, folder, trained)
        answer = explain(folder, folder / "answer.json")
        squares.append(held_out_rmse(source, answer, trained, tested) ** 2)
    both = whole.ids == {"bearing_friction", "viscous_damping"}
    return [
        Row("rod_pendulum: dry and viscous, no third", "both", "both",
            f"{'yes' if both else 'no'} ({words(whole)})"),
        Row("rod_pendulum: held-out RMSE", "0.9°", "0.8°", f"{np.sqrt(np.mean(squares)):.2f}°"),
    ]  # fmt: skip
