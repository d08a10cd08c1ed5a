"""Impact speeds that the paper measured but does not print, and its Eqs 26 and 27."""

import numpy as np
from scipy.optimize import brentq

from physics.arrays import FloatArray
from physics.bodies import BALLS, PAPER_PENDULUM, Ball
from physics.contact.impact import external_impulse
from physics.restitution.restitution import ConstantCor, CorLaw, ExponentialCor
from pipelines.paper.printed import TABLE_6

__all__ = [
    "EFFECTIVE_MASS",
    "RATIONAL",
    "backswing_by_rational",
    "constant_law",
    "law_of",
    "measured_speeds",
    "speed_by_rational",
    "speed_for",
]

EFFECTIVE_MASS = PAPER_PENDULUM.mass_at_contact

RATIONAL = {
    "jokku": (9.594, -85.5, -0.2311, 152.3, 6.66),
    "basketball": (9.554, -98.12, -1.5070, 154.2, 7.267),
}
"""Eqs 26, 27: p₁, p₂, p₃, q₁, q₂ of (p₁ b² + p₂ b + p₃) / (b² + q₁ b + q₂), b in
degrees and the speed in m/s, as the paper prints them."""


def constant_law(ball: Ball) -> ConstantCor:
    """The paper's constant COR: its fitted law at zero speed."""
    law = ball.cor
    return law.at_rest if isinstance(law, ExponentialCor) else ConstantCor(float(law(0.0)))


def law_of(ball: Ball, kind: str) -> CorLaw:
    """Eq. 24 or 25: ``variable`` or ``constant``."""
    return ball.cor if kind == "variable" else constant_law(ball)


def speed_for(ball: Ball, law: CorLaw, impulse: float) -> float:
    """Eq. 9 with e(v), solved for the impact speed, m/s."""

    def miss(speed: float) -> float:
        impulse_here = external_impulse(EFFECTIVE_MASS, ball.mass, law(speed), speed)
        return float(impulse_here) - impulse

    return float(brentq(miss, 1e-3, 50.0, xtol=1e-14))


def measured_speeds(name: str) -> FloatArray:
    """Impact speeds (4,) at 30, 60, 90, 120 deg, m/s, recovered from both rows of Table 6."""
    ball = BALLS[name]
    rows = [
        [speed_for(ball, law_of(ball, kind), float(text)) for text in TABLE_6[name][kind]]
        for kind in ("variable", "constant")
    ]
    return np.asarray(np.mean(rows, axis=0))


def speed_by_rational(name: str, backswing_deg: float) -> float:
    """Eq. 26 or 27 as printed, m/s."""
    p1, p2, p3, q1, q2 = RATIONAL[name]
    b = backswing_deg
    return (p1 * b**2 + p2 * b + p3) / (b**2 + q1 * b + q2)


def backswing_by_rational(name: str, speed: float) -> float:
    """Eq. 26 or 27 solved for the back-swing angle, degrees."""
    return float(brentq(lambda b: speed_by_rational(name, b) - speed, 15.0, 400.0, xtol=1e-12))
