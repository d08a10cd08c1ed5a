"""Report page (HTML) and figures (SVG, PNG) of a campaign."""

import base64
import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from metrology import write_text_whole
from metrology.files import written_whole
from metrology.quantity import format_pair
from physics import bodies
from physics.cor_fit import AveragedLaw
from pipelines.campaign.analysis import BallAnalysis, CampaignAnalysis, SensorAnalysis
from pipelines.campaign.ledger import State
from pipelines.campaign.results import SENSORS, ClipResult
from pipelines.doors import DATE
from pipelines.law import LAW_FORMULAS
from pipelines.report.plots import draw_into

__all__ = ["ReportFacts", "draw_figures", "svg_text", "write_figures", "write_report"]

FloatArray = NDArray[np.float64]

_BALL_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Distinguishable with any colour vision (Okabe and Ito 2008)."""

_FIGURE_SIZE = (7.0, 4.2)
"""Figure size, inches: the width of an A4 page without margins."""

_FSR = SENSORS[0]


def draw_figures(analysis: CampaignAnalysis, *, against_paper: bool = False) -> dict[str, Figure]:
    """Draw every figure that the data allow; keys are names.

    Parameters
    ----------
    against_paper : bool
        Draw the paper's laws of the paper's balls for comparison.
    """
    balls = [ball for ball in analysis.balls if ball.clips]
    drawn: dict[str, Figure] = {}
    if not balls:
        return drawn
    drawn["cor"] = _cor(balls, against_paper)
    others = {
        "contact_time": _contact_time(balls),
        "ball_speed": _against_speed(balls, "ball_speed", "ball's speed after contact / (m/s)"),
        "launch_angle": _against_speed(balls, "launch_angle", "launch angle / deg"),
        "impulse": _impulse(balls),
        "energy_loss": _energy(balls),
        "ranges": _ranges(balls),
    }
    drawn |= {name: figure for name, figure in others.items() if figure is not None}
    for one in analysis.sensors:
        drawn[f"agreement_{one.sensor.quantity}"] = _agreement(one)
    return drawn


def _axes(x: str, y: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=_FIGURE_SIZE, layout="constrained")
    axes = figure.add_subplot()
    _styled(axes, y).set_xlabel(x)
    return figure, axes


def _styled(axes: Axes, y: str) -> Axes:
    axes.set_ylabel(y)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.6)
    return axes


_SPEED_AXIS = "impact speed / (m/s)"


def _of(clips: Sequence[ClipResult], name: str) -> tuple[FloatArray, FloatArray]:
    pairs = np.array([clip.quantity(name) for clip in clips]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _speeds(ball: BallAnalysis) -> FloatArray:
    return _of(ball.clips, "pendulum_speed_before")[0]


def _points(axes: Axes, x: FloatArray, y: FloatArray, std: FloatArray, **style: Any) -> None:
    axes.errorbar(x, y, std, fmt="o", ms=3.5, lw=0.8, **style)


def _label(ball: BallAnalysis) -> str:
    return ball.ball or "ball"


def _cor(balls: Sequence[BallAnalysis], against_paper: bool) -> Figure:
    figure, axes = _axes(_SPEED_AXIS, "coefficient of restitution")
    for ball, colour in zip(balls, _cycle(), strict=False):
        speed, (cor, std) = _speeds(ball), _of(ball.clips, "cor")
        _points(axes, speed, cor, std, color=colour, label=_label(ball))
        for outlier in ball.outliers:
            at = speed[outlier.index], cor[outlier.index]
            axes.plot(*at, "o", ms=11, mfc="none", mec=colour)
            axes.annotate(
                ball.clips[outlier.index].clip,
                at,
                fontsize=7,
                xytext=(6, 6),
                textcoords="offset points",
            )
        if ball.fits:
            _band(axes, ball, colour)
        known = bodies.BALLS.get(ball.ball)
        if against_paper and known is not None:
            grid = np.linspace(*_span(speed), 60)
            axes.plot(grid, known.cor(grid), ":", color=colour, label=f"{_label(ball)}, paper")
    _legend(figure)
    return figure


def _legend(figure: Figure) -> Figure | None:
    """Add a legend below the axes: inside it would hide points; None if nothing is drawn."""
    if not any(axes.get_legend_handles_labels()[1] for axes in figure.axes):
        return None
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    return figure


def _band(axes: Axes, ball: BallAnalysis, colour: str) -> None:
    fit = ball.fits[0]
    grid = np.linspace(*fit.speeds, 40)
    averaged = AveragedLaw(ball.fits)
    of_law = [averaged.at(v) for v in grid]
    following = [averaged.next_strike(v) for v in grid]
    label = f"{_label(ball)}: mean of the laws (most probable: {fit.law}, {fit.probability:.0%})"
    axes.plot(grid, [e.value for e in of_law], color=colour, lw=1.4, label=label)
    for band, alpha in ((of_law, 0.3), (following, 0.12)):
        low, high = [e.low for e in band], [e.high for e in band]
        axes.fill_between(grid, low, high, color=colour, alpha=alpha, lw=0)


def _span(values: FloatArray) -> tuple[float, float]:
    return float(np.nanmin(values)), float(np.nanmax(values))


def _cycle() -> tuple[str, ...]:
    return _BALL_COLOURS * 8


def _against_speed(
    balls: Sequence[BallAnalysis], quantity: str, label: str, factor: float = 1.0
) -> Figure | None:
    figure, axes = _axes(_SPEED_AXIS, label)
    for ball, colour in _measured(balls, quantity):
        value, std = _of(ball.clips, quantity)
        whole = np.isfinite(value)
        shown = factor * value[whole], factor * std[whole]
        _points(axes, _speeds(ball)[whole], *shown, color=colour, label=f"{_label(ball)}, video")
        if quantity == _FSR.quantity:
            _sensor_and_model(axes, ball, colour, factor)
    return _legend(figure)


def _measured(balls: Sequence[BallAnalysis], quantity: str) -> list[tuple[BallAnalysis, str]]:
    """Balls with a value of the quantity, each with its colour."""
    return [
        (ball, colour)
        for ball, colour in zip(balls, _cycle(), strict=False)
        if np.isfinite(_of(ball.clips, quantity)[0]).any()
    ]


def _contact_time(balls: Sequence[BallAnalysis]) -> Figure | None:
    return _against_speed(balls, _FSR.quantity, "contact time / ms", 1e3)


def _sensor_and_model(axes: Axes, ball: BallAnalysis, colour: str, factor: float) -> None:
    """Add the contact times of the force sensor and of the contact model."""
    speed = _speeds(ball)
    read = [None if one.strike is None else one.strike.sensor(_FSR) for one in ball.clips]
    seen = np.array([np.nan if pair is None else pair[0] for pair in read])
    if np.isfinite(seen).any():
        axes.plot(speed, factor * seen, "x", ms=5, color=colour, label=f"{_label(ball)}, FSR")
    known = bodies.BALLS.get(ball.ball)
    if known is not None:
        grid = np.linspace(*_span(speed), 40)
        time = factor * np.asarray(known.contact_time(grid))
        axes.plot(grid, time, "--", lw=1, color=colour, label=f"{_label(ball)}, contact model")


def _impulse(balls: Sequence[BallAnalysis]) -> Figure | None:
    figure = Figure(figsize=(_FIGURE_SIZE[0], 1.5 * _FIGURE_SIZE[1]), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    _styled(upper, "external impulse / (N s)")
    _styled(lower, "mean contact force / N").set_xlabel(_SPEED_AXIS)
    for ball, colour in _measured(balls, "external_impulse"):
        speed, (impulse, std) = _speeds(ball), _of(ball.clips, "external_impulse")
        _points(upper, speed, impulse, std, color=colour, label=f"{_label(ball)}, measured")
        label = f"{_label(ball)}, Eq. 9 with its COR"
        upper.plot(speed, ball.impulse[:, 0], "_", ms=9, color=colour, label=label)
        time, time_std = _of(ball.clips, "contact_time")
        force = impulse / time
        force_std = force * np.hypot(std / impulse, time_std / time)
        _points(lower, speed, force, force_std, color=colour)
    return _legend(figure)


def _energy(balls: Sequence[BallAnalysis]) -> Figure | None:
    figure, axes = _axes(_SPEED_AXIS, "energy lost by the pendulum / J")
    for ball, colour in _measured(balls, "energy_loss"):
        speed, (lost, std) = _speeds(ball), _of(ball.clips, "energy_loss")
        _points(axes, speed, lost, std, color=colour, label=f"{_label(ball)}, Eq. 19")
        label = f"{_label(ball)}, Eq. 20 (approximate)"
        axes.plot(speed, ball.energy_loss[:, 1], "_", ms=9, color=colour, label=label)
    return _legend(figure)


def _ranges(balls: Sequence[BallAnalysis]) -> Figure | None:
    held = [ball for ball in balls if ball.ranges is not None]
    if not held:
        return None
    figure, axes = _axes(_SPEED_AXIS, "range: model − measured / mm")
    axes.axhline(0, color="0.3", lw=0.8)
    marks: tuple[tuple[str, str, str, bool], ...] = (
        ("numerical", "o", "numerical", True),
        ("variable", "^", "analytic, variable COR", False),
        ("constant", "s", "analytic, constant COR", False),
    )
    for ball, colour in zip(held, _cycle(), strict=False):
        found = ball.ranges
        assert found is not None
        for name, mark, label, filled in marks:
            axes.errorbar(
                found.speed,
                1e3 * (getattr(found, name) - found.measured),
                1e3 * found.measured_std,
                fmt=mark,
                ms=4,
                lw=0.6,
                color=colour,
                mfc=colour if filled else "none",
                label=f"{_label(ball)}, {label}",
            )
    _legend(figure)
    return figure


def _agreement(one: SensorAnalysis) -> Figure:
    found, unit = one.agreement, one.sensor.unit
    figure, axes = _axes(
        f"mean of camera and {one.sensor.label} / {unit}",
        f"camera − {one.sensor.label} / {unit}",
    )
    axes.plot(found.means, found.differences, "o", ms=4, color=_BALL_COLOURS[0])
    axes.axhline(
        found.bias, color=_BALL_COLOURS[1], label=f"bias {found.bias:.3g} ± {found.bias_std:.2g}"
    )
    for limit in (found.lower, found.upper):
        axes.axhline(limit, color=_BALL_COLOURS[1], ls="--", lw=1)
        axes.axhspan(
            limit - 1.96 * found.limits_std,
            limit + 1.96 * found.limits_std,
            color=_BALL_COLOURS[1],
            alpha=0.12,
            lw=0,
        )
    axes.set_title(
        f"{one.sensor.quantity.replace('_', ' ')}: 95 % limits of agreement", fontsize=10
    )
    axes.legend(fontsize=8)
    return figure


def svg_text(figure: Figure) -> str:
    """Figure as SVG text."""
    buffer = io.StringIO()
    draw_into(buffer, figure, ".svg")
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def write_figures(figures: dict[str, Figure], folder: Path) -> None:
    """Write each figure as ``.svg`` and ``.png``, each atomically."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        for suffix in (".svg", ".png"):
            path = folder / f"{name}{suffix}"
            with written_whole(path) as temporary:
                draw_into(temporary, figure, suffix, dpi=150)


PLOT_CAPTIONS = {
    "cor": "Coefficient of restitution against impact speed: one point per clip (± one standard"
    " uncertainty), mean of the laws (line), 95 % band of the law (dark) and of the next strike"
    " (light). Rings mark outliers. Compare the paper's Figs 20 and 21.",
    "contact_time": "Contact time by video, force sensor and contact model (Fig. 13).",
    "ball_speed": "Speed of the ball after contact (Fig. 18).",
    "launch_angle": "Launch angle; the paper assumes it constant for each ball.",
    "impulse": "External impulse as measured and by Eq. 9; below, mean contact force (Fig. 17).",
    "energy_loss": "Energy lost by the pendulum, exact and by the paper's approximation"
    " (Fig. 15, Eqs 18 to 23).",
    "ranges": "Ranges predicted from each impact speed by three models, minus the range measured"
    " (Table 5, Fig. 22).",
}


@dataclass(frozen=True)
class ReportFacts:
    """Origin of the campaign.

    Attributes
    ----------
    setup : str or None
        Name of the setup file.
    notes : tuple of str
        What was recognised or assumed in the input files.
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
    folder: Path | None = None,
) -> None:
    """Write the page atomically; all text in it is escaped.

    `folder` holds the clips' pictures; without it, the folder of `path`.
    """
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
        outliers=_outliers(folder or path.parent, analysis),
        excluded=[item for item in results if item.excluded is not None],
        copies=[item for item in results if item.elsewhere is not None],
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
        clips=[_clip(item) for item in done[:_MAX_REPORT_ROWS]],
        unlisted=max(0, len(done) - _MAX_REPORT_ROWS),
        made=os.environ.get(DATE, ""),
    )
    write_text_whole(path, page)


def _caption(name: str) -> str:
    if name in PLOT_CAPTIONS:
        return PLOT_CAPTIONS[name]
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
        "formula": LAW_FORMULAS[fit.law],
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
    said = {True: "significant bias", False: "no significant bias", None: "too few pairs"}
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
                    "why": ball.why_outlying(item),
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


_MAX_REPORT_ROWS = 2000
"""Rows of the page's table (chosen: the page stays below 5 MB)."""

_CLIP_COLUMNS = (
    ("pendulum_speed_before", "impact speed, m/s"),
    ("cor", "COR"),
    ("contact_time", "contact time, s"),
    ("ball_speed", "ball speed, m/s"),
    ("launch_angle", "launch angle, deg"),
    ("landing_distance", "landing, m"),
)


def _clip(item: ClipResult) -> dict[str, object]:
    cells = []
    for name, _ in _CLIP_COLUMNS:
        value, std = item.quantity(name)
        cells.append("–" if value != value else _pm(value, std))
    return {
        "clip": item.clip,
        "ball": item.ball or "–",
        "session": item.session or "–",
        "cells": cells,
        "warnings": len(item.warnings),
    }
