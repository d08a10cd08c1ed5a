"""The campaign on one page that opens without a network."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import median

from jinja2 import Environment, StrictUndefined
from matplotlib.figure import Figure

from metrology import write_text_whole
from metrology.quantity import format_pair
from pipelines.campaign.analysis.balls import BallAnalysis, CampaignAnalysis, SensorAnalysis
from pipelines.campaign.analysis.cor_law import AveragedLaw
from pipelines.campaign.figures import svg_text
from pipelines.campaign.ledger import State
from pipelines.campaign.results import ClipResult

__all__ = ["ReportFacts", "write_report"]

CAPTIONS = {
    "cor": "Coefficient of restitution against impact speed: points are clips (± one standard"
    " uncertainty), the line is the likeliest law, the dark band where the law lies, the light band"
    " where the next strike will lie (95 %). Rings are outliers. As the paper's Figs 20 and 21.",
    "contact_time": "Contact time by video, force sensor and contact model (Figs 11 to 13).",
    "ball_speed": "Speed of the ball after contact (Fig. 18).",
    "launch_angle": "Launch angle, which the paper takes as constant for each ball.",
    "impulse": "External impulse as measured and by Eq. 9; below, the mean contact force"
    " (Fig. 17).",
    "energy_loss": "Energy that the pendulum loses, exact and by the paper's approximation"
    " (Fig. 15, Eqs 18 to 23).",
    "ranges": "Ranges foretold from each impact speed by three models, less the range measured"
    " (Table 5, Fig. 22).",
}


@dataclass(frozen=True)
class ReportFacts:
    """Where the campaign came from.

    Attributes
    ----------
    title : str
    version : str
    setup : str or None
        Name of the setup file.
    notes : tuple of str
        What was recognised or assumed on reading.
    """

    title: str
    version: str
    setup: str | None
    notes: tuple[str, ...] = ()


def write_report(
    path: Path,
    facts: ReportFacts,
    results: Sequence[ClipResult],
    analysis: CampaignAnalysis,
    figures: dict[str, Figure],
) -> None:
    """Write the page whole or not at all; every text in it is escaped."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    done = [item for item in results if item.state == State.DONE]
    source = files("pipelines.campaign").joinpath("report.html.j2").read_text(encoding="utf-8")
    page = environment.from_string(source).render(
        facts=facts,
        counts=_counts(results),
        balls=[_ball(ball) for ball in analysis.balls],
        sessions=_sessions(analysis),
        sensors=[_sensor(one) for one in analysis.sensors],
        outliers=_outliers(path.parent, analysis),
        excluded=[item for item in results if item.excluded is not None],
        failed=[item for item in results if item.state == State.FAILED],
        waiting=[item for item in results if item.state == State.WAITING],
        warned=_warned(results),
        figures=[
            (
                _caption(name),
                _uri("image/svg+xml", svg_text(figure).encode()),
            )
            for name, figure in figures.items()
        ],
        clips=[_clip(item) for item in done[:_LISTED]],
        unlisted=max(0, len(done) - _LISTED),
    )
    write_text_whole(path, page)


def _caption(name: str) -> str:
    if name in CAPTIONS:
        return CAPTIONS[name]
    quantity = name.removeprefix("agreement_").replace("_", " ")
    return f"Camera against sensor: {quantity} (Bland and Altman)."


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _counts(results: Sequence[ClipResult]) -> dict[str, str]:
    seconds = [item.seconds for item in results if item.seconds is not None]
    counts = {str(state): str(sum(item.state == state for item in results)) for state in State}
    counts["median"] = f"{median(seconds):.1f} s" if seconds else "–"
    return counts


def _pm(value: float, std: float, unit: str = "") -> str:
    shown, spread = format_pair(value, std)
    return f"{shown} ± {spread}{unit}"


def _ball(ball: BallAnalysis) -> dict[str, object]:
    if not ball.fits:
        return {"name": ball.ball or "ball", "clips": len(ball.clips), "why": ball.why_no_law}
    fit = ball.fits[0]
    low, high = fit.speeds
    middle = 0.5 * (low + high)
    averaged = AveragedLaw(ball.fits)
    following = averaged.next_strike(middle)
    laws = ", ".join(f"{one.law} {one.probability:.0%}" for one in ball.fits)
    found = ball.precision
    return {
        "name": ball.ball or "ball",
        "clips": len(ball.clips),
        "why": None,
        "law": str(fit.law),
        "formula": _FORMULA[str(fit.law)],
        "laws": laws,
        "parameters": [(name, _pm(item.value, item.std)) for name, item in fit.parameters.items()],
        "at": [
            (f"{v:.2f}", _pm(averaged.at(v).value, averaged.at(v).std)) for v in (low, middle, high)
        ],
        "next": f"{following.low:.3f} to {following.high:.3f} at {middle:.2f} m/s",
        "scatter": _pm(fit.strike_scatter.value, fit.strike_scatter.std),
        "precision": None
        if found is None
        else {
            "r": f"{found.repeatability:.4f} ({found.repeatability_low:.4f} to"
            f" {found.repeatability_high:.4f})",
            "R": "–" if found.reproducibility is None else f"{found.reproducibility:.4f}",
            "limit": f"{found.limit:.4f}",
            "sessions": found.sessions,
        },
        "ranges": None
        if ball.ranges is None
        else {name: f"{1e3 * value:.0f} mm" for name, value in ball.ranges.rms().items()},
    }


_FORMULA = {
    "exponential": "e = a exp(−b v) + d",
    "power": "e = 1 − a v^(1/5)",
    "constant": "e = d",
}


def _sessions(analysis: CampaignAnalysis) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for ball in analysis.balls:
        for session in sorted({clip.session for clip in ball.clips}):
            chosen = [i for i, clip in enumerate(ball.clips) if clip.session == session]
            away = [ball.distances[i] for i in chosen] if len(ball.distances) else []
            rows.append(
                {
                    "ball": ball.ball or "ball",
                    "session": session or "–",
                    "clips": len(chosen),
                    "away": f"{sum(away) / len(away):+.2f}" if away else "–",
                }
            )
    return rows


def _sensor(one: SensorAnalysis) -> dict[str, str]:
    found, sensor = one.agreement, one.sensor
    said = {True: "biased beyond chance", False: "no bias beyond chance", None: "can't tell"}
    return {
        "quantity": sensor.quantity.replace("_", " "),
        "sensor": sensor.label,
        "pairs": str(found.pairs),
        "bias": _pm(found.bias, found.bias_std, f" {sensor.unit}"),
        "limits": f"{found.lower:.3g} to {found.upper:.3g} {sensor.unit}",
        "said": said[found.biased],
    }


def _outliers(folder: Path, analysis: CampaignAnalysis) -> list[dict[str, object]]:
    found: list[dict[str, object]] = []
    for ball in analysis.balls:
        for item in ball.outliers:
            clip = ball.clips[item.index]
            picture = folder / "frames" / f"{clip.clip}.jpg"
            found.append(
                {
                    "clip": clip.clip,
                    "why": f"{abs(ball.distances[item.index]):.1f} standard deviations off the law"
                    f" of {ball.ball or 'the ball'}; the test allows {item.critical:.1f}",
                    "picture": _uri("image/jpeg", picture.read_bytes())
                    if picture.is_file()
                    else None,
                }
            )
    return found


def _warned(results: Sequence[ClipResult]) -> list[tuple[str, int]]:
    counts: dict[str, int] = {}
    for item in results:
        for warning in item.warnings:
            counts[warning] = counts.get(warning, 0) + 1
    return sorted(counts.items(), key=lambda pair: -pair[1])[:20]


_LISTED = 2000
"""Rows of the page's table: a browser scrolls them at once, and the page stays below 5 MB."""
_SHOWN = (
    ("pendulum_speed_before", "impact speed, m/s"),
    ("cor", "COR"),
    ("contact_time", "contact time, s"),
    ("ball_speed", "ball speed, m/s"),
    ("launch_angle", "launch angle, deg"),
    ("landing_distance", "landing, m"),
)


def _clip(item: ClipResult) -> dict[str, object]:
    cells = []
    for name, _ in _SHOWN:
        value, std = item.quantity(name)
        cells.append("–" if value != value else _pm(value, std))
    return {
        "clip": item.clip,
        "ball": item.ball or "–",
        "session": item.session or "–",
        "cells": cells,
        "warnings": len(item.warnings),
    }
