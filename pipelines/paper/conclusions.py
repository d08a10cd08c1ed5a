"""The paper's four conclusions on Eq. 17, and its speeds against a frictionless swing."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physics.bodies import BALLS, PAPER_PENDULUM, PAPER_SUPPORT
from physics.flight.air import PAPER_AIR
from physics.restitution.fit import CorFit, compare_cor_fits
from physics.restitution.inversion import RangeInputs, cor_from_range, sensitivities
from physics.swing import backswing_for_speed, frictionless_speed
from pipelines.model.plots import BLUE, ORANGE, saved_figure
from pipelines.paper import printed
from pipelines.paper.speeds import EFFECTIVE_MASS, measured_speeds

__all__ = [
    "Conclusion",
    "SwingCheck",
    "conclusions",
    "draw_sensitivities",
    "implied_fits",
    "swing_checks",
]

_INPUTS = (
    "impact_speed",
    "distance",
    "launch_angle",
    "support_height",
    "effective_mass",
    "ball_mass",
    "contact_time",
    "ball_diameter",
    "drag_coefficient",
    "air_density",
)


READING_STD = 5.0 / (2.0 * math.sqrt(6.0))
"""deg: a triangular distribution between the protractor's 5-degree marks (GUM 4.3.9)."""


@dataclass(frozen=True)
class Conclusion:
    """A sentence of the paper and what Eq. 17 says.

    Attributes
    ----------
    claim : str
    elasticity : dict of str to float
        Relative change of e per relative change of an input, by ball.
    holds : bool
    """

    claim: str
    elasticity: dict[str, float]
    holds: bool


@dataclass(frozen=True)
class SwingCheck:
    """A measured impact speed beside what a frictionless swing can give.

    Attributes
    ----------
    ball : str
    backswing_deg : int
    measured, limit : float
        m/s.
    backswing_needed_deg : float
        Back-swing from which a frictionless pendulum would reach the measured speed.
    flagged : bool
        Whether it is above the limit by more than the protractor's reading explains.
    """

    ball: str
    backswing_deg: int
    measured: float
    limit: float
    backswing_needed_deg: float
    flagged: bool


def _point(name: str, index: int = 2) -> RangeInputs:
    """Inputs of Eq. 17 at one printed distance; 90 deg unless told."""
    ball, speed = BALLS[name], float(measured_speeds(name)[index])
    return RangeInputs.of(
        PAPER_PENDULUM,
        ball,
        PAPER_SUPPORT,
        PAPER_AIR,
        distance=float(printed.TABLE_5[name]["experiment"][index]),
        impact_speed=speed,
        contact_time=float(ball.contact_time(speed)),
        drag_coefficient=0.47,
    )


def _elasticities(name: str) -> dict[str, float]:
    point = _point(name)
    slopes, e = sensitivities(point), float(cor_from_range(point))
    return {key: slopes[key] * float(getattr(point, key)) / e for key in _INPUTS}


def conclusions() -> tuple[Conclusion, ...]:
    """The four sentences after Eq. 17, checked at the 90-deg point of both balls."""
    by_ball = {name: _elasticities(name) for name in BALLS}

    def of(key: str) -> dict[str, float]:
        return {name: values[key] for name, values in by_ball.items()}

    small = {name: max(abs(v[k]) for k in _INPUTS[-3:]) for name, v in by_ball.items()}
    claims = (
        ("COR falls as the colliding velocity rises", of("impact_speed"), -1),
        ("COR falls as the contact time rises", of("contact_time"), -1),
        ("COR rises with the mass of the ball", of("ball_mass"), 1),
    )
    checked = [
        Conclusion(claim, values, all(sign * value > 0.0 for value in values.values()))
        for claim, values, sign in claims
    ]
    last = "Cross section, air density and drag coefficient do not affect COR much"
    return (*checked, Conclusion(last, small, all(value < 0.3 for value in small.values())))


def swing_checks() -> tuple[SwingCheck, ...]:
    """All measured speeds against the frictionless swing from the printed back-swing angle."""
    found = []
    for name, ball in BALLS.items():
        for angle, speed in zip(printed.BACKSWINGS_DEG, measured_speeds(name), strict=True):
            limit = float(
                frictionless_speed(PAPER_PENDULUM, math.radians(angle), ball.launch_angle)
            )
            needed = backswing_for_speed(PAPER_PENDULUM, float(speed), ball.launch_angle)
            degrees = math.degrees(needed)
            found.append(
                SwingCheck(name, angle, float(speed), limit, degrees, degrees - angle > READING_STD)
            )
    return tuple(found)


def implied_fits(name: str) -> tuple[CorFit, ...]:
    """Laws of restitution fitted to the four e that Table 6 implies, the preferred first.

    The uncertainty is that of the table's last digit.
    """
    ball, speeds = BALLS[name], measured_speeds(name)
    share = EFFECTIVE_MASS * ball.mass / (EFFECTIVE_MASS + ball.mass) * speeds
    impulse = np.array([float(text) for text in printed.TABLE_6[name]["variable"]])
    std = np.asarray(1e-4 / math.sqrt(12.0) / share)
    return compare_cor_fits(speeds, np.asarray(impulse / share - 1.0), std)


def draw_sensitivities(path: Path) -> None:
    """Relative change of e per relative change of each input, both balls."""
    with saved_figure(path, 6.4, 3.8) as figure:
        axes = figure.subplots()
        places = np.arange(len(_INPUTS))
        bars = zip(BALLS, (BLUE, ORANGE), strict=True)
        for shift, (name, colour) in zip((-0.2, 0.2), bars, strict=True):
            values = _elasticities(name)
            axes.barh(
                places + shift, [values[key] for key in _INPUTS], 0.38, color=colour, label=name
            )
        axes.axvline(0.0, color="black", lw=0.8)
        axes.set_yticks(places, [key.replace("_", " ") for key in _INPUTS])
        axes.invert_yaxis()
        axes.set_xlabel("relative change of e per relative change of the input")
        axes.legend(loc="lower right")
