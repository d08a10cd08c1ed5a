"""What a campaign says in numbers: ``summary.json``."""

from collections.abc import Sequence
from typing import Any

from pipelines.campaign.analysis.balls import BallAnalysis, CampaignAnalysis
from pipelines.campaign.analysis.cor_law import CorLawFit, Estimate
from pipelines.campaign.ledger import State
from pipelines.campaign.results import ClipResult
from pipelines.setup.cor_file import BallLaw

__all__ = ["laws_of", "summarise"]

_SPEEDS = 9
"""Speeds at which `cor_at` tells the law, across the range fitted."""


def summarise(results: Sequence[ClipResult], analysis: CampaignAnalysis) -> dict[str, Any]:
    """The campaign as the contract's ``summary.json``.

    Parameters
    ----------
    results : sequence of ClipResult
    analysis : CampaignAnalysis
    """
    states = [result.state for result in results]
    return {
        "clips": {
            "done": states.count(State.DONE),
            "failed": states.count(State.FAILED),
            "waiting": states.count(State.WAITING) + states.count(State.RUNNING),
            "excluded": sum(result.excluded is not None for result in results),
        },
        "balls": {ball.ball or "ball": _ball(ball) for ball in analysis.balls},
        "sensors": {
            one.sensor.column: {
                "quantity": one.sensor.quantity,
                "unit": one.sensor.unit,
                "pairs": one.agreement.pairs,
                "bias": {"value": one.agreement.bias, "std": one.agreement.bias_std},
                "limits_of_agreement": [one.agreement.lower, one.agreement.upper],
                "biased": one.agreement.biased,
            }
            for one in analysis.sensors
        },
        "outliers": [
            {"clip": ball.clips[item.index].clip, "why": _why(ball, item.index, item.critical)}
            for ball in analysis.balls
            for item in ball.outliers
        ],
        "failed": [
            {"clip": result.clip, "why": result.error}
            for result in results
            if result.state == State.FAILED
        ],
        "excluded": [
            {"clip": result.clip, "why": result.excluded}
            for result in results
            if result.excluded is not None
        ],
    }


def laws_of(analysis: CampaignAnalysis) -> dict[str, BallLaw]:
    """The likeliest law of each ball, as `simulate`, `plan` and `explain` take it."""
    return {
        ball.ball or "ball": _ball_law(ball.ball or "ball", ball.fits[0])
        for ball in analysis.balls
        if ball.fits
    }


def _ball_law(name: str, fit: CorLawFit) -> BallLaw:
    return BallLaw(
        ball=name,
        kind=fit.law,
        parameters={key: item.value for key, item in fit.parameters.items()},
        covariance=fit.covariance,
        speeds=fit.speeds,
        strike_scatter=fit.strike_scatter.value,
        session_scatter=fit.session_scatter.value,
    )


def _why(ball: BallAnalysis, index: int, critical: float) -> str:
    return (
        f"its restitution is {abs(ball.distances[index]):.1f} standard deviations off the law of"
        f" {ball.ball or 'the ball'} (generalised ESD test, 5 %, {critical:.1f} allowed)"
    )


def _ball(ball: BallAnalysis) -> dict[str, Any]:
    if not ball.fits:
        return {"law": None, "reason": ball.why_no_law, "clips": len(ball.clips)}
    fit = ball.fits[0]
    low, high = fit.speeds
    speeds = [low + (high - low) * i / (_SPEEDS - 1) for i in range(_SPEEDS)]
    precision = ball.precision
    return {
        "law": str(fit.law),
        "clips": len(ball.clips),
        "speeds": [low, high],
        "parameters": {name: _estimate(item) for name, item in fit.parameters.items()},
        "covariance": fit.covariance.tolist(),
        "strike_scatter": _estimate(fit.strike_scatter),
        "session_scatter": _estimate(fit.session_scatter),
        "cor_at": [_at(fit, speed) for speed in speeds],
        "laws": {str(other.law): other.probability for other in ball.fits},
        "precision": None
        if precision is None
        else {
            "repeatability": precision.repeatability,
            "repeatability_95": [precision.repeatability_low, precision.repeatability_high],
            "between_sessions": precision.between,
            "reproducibility": precision.reproducibility,
            "sessions": precision.sessions,
        },
        "range_rms_m": None if ball.ranges is None else ball.ranges.rms(),
    }


def _estimate(item: Estimate) -> dict[str, Any]:
    return {"value": item.value, "std": item.std, "interval_95": [item.low, item.high]}


def _at(fit: CorLawFit, speed: float) -> dict[str, Any]:
    following = fit.next_strike(speed)
    return {
        "speed": speed,
        **_estimate(fit.at(speed)),
        "next_strike_95": [following.low, following.high],
    }
