"""HTML report and figures of a verdict, for campaigns and trial tables."""

import base64
import hashlib
import io
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import numpy as np
from jinja2 import Environment
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.mathtext import math_to_image
from numpy.typing import NDArray

from metrology import write_text_whole, written_whole
from mismatch import EngineVerdict, ExplainedCampaign
from mismatch.candidates import Candidate
from mismatch.fitting.fit import Fit, spread_laws
from mismatch.forward import Forward
from mismatch.search.locate import flight_state, swing_state
from mismatch.search.naming import missing_force
from mismatch.search.unnamed import Drift
from mismatch.trial_table import Answer, TableExplained
from mismatch.verdict import NamedEffect
from physics.domain import FloatArray, Vector
from physics.effects import Coordinate, Effect, EffectId, FlightState, Values
from pipelines.doors import DATE
from pipelines.explain.tried import rows_of_tried
from pipelines.report.plots import Picture, draw_into

__all__ = [
    "draw_explained",
    "explain_report_html",
    "figure_of",
    "verdict_html",
    "write_explain_report",
]

TABLE_LABELS = ("impact speed: recorded − model / (m/s)", "ball speed: recorded − model / (m/s)",
          "range: recorded − model / m")  # fmt: skip

MARKERS = "osD^v<>P"


def figure_of_table(explained: TableExplained) -> Picture:
    """Residuals against impact speed, one panel per result, balls by marker."""
    forward = explained.forward
    table = forward.table
    channels = [k for k in range(3) if table.present[k]]
    if not np.isfinite(table.backswing).any() and 0 in channels:
        channels.remove(0)
    figure = Picture(figsize=(5.6 * len(channels), 4.2), layout="constrained")
    axes = figure.subplots(1, len(channels), squeeze=False)[0]
    speed = table.values[:, 0]
    if not np.isfinite(speed).all():
        nothing = np.zeros((1, table.trials, 4))
        speed = forward.predict([explained.model], nothing)[0, :, 0]
    for axis, channel in zip(axes, channels, strict=True):
        answers = [(explained.null, "tab:red", "baseline")]
        if explained.best is not None:
            answers.append((explained.best, "tab:blue", " + ".join(explained.best.ids)))
        for answer, colour, name in answers:
            _panel(axis, explained, answer, speed, channel, colour, name)
        axis.axhline(0.0, color="0.6", lw=0.8)
        axis.set_xlabel("impact speed / (m/s)")
        axis.set_ylabel(TABLE_LABELS[channel])
        axis.legend(fontsize=8)
    return figure


def _panel(
    axis: Axes,
    explained: TableExplained,
    answer: Answer,
    speed: np.ndarray,
    channel: int,
    colour: str,
    name: str,
) -> None:
    records = explained.forward.forward.records
    residual = explained.residual(answer)[:, channel]
    std = np.nan_to_num(explained.forward.table.stds[:, channel])
    for index, ball in enumerate(records.ball_names):
        mine = np.flatnonzero(records.ball_index == index)
        mine = mine[np.argsort(speed[mine])]
        axis.errorbar(
            speed[mine], residual[mine], std[mine], fmt=MARKERS[index % len(MARKERS)],
            ms=5, lw=0.8, color=colour, label=f"{name}{f' ({ball})' if ball else ''}",
        )  # fmt: skip
        # Repeats of a speed differ by chance: the line joins their means.
        at, place = np.unique(np.round(speed[mine], 6), return_inverse=True)
        mean = np.bincount(place, residual[mine]) / np.bincount(place)
        axis.plot(at, mean, "-", lw=0.8, color=colour)


FORCE_LABELS = {
    "horizontal": "horizontal force / N",
    "vertical": "vertical force / N",
    "angle": "torque / N m",
}


def _binned(forward: Forward, fit: Fit, channel: int, axis: Axes, colour: str, name: str) -> None:
    records = forward.records
    s = records.ball_time.shape[1]
    at = slice(channel * s, (channel + 1) * s) if channel < 3 else slice(3 * s, None)
    mask = records.used[:, at]
    if not mask.any():
        return
    time = records.ball_time if channel < 3 else records.pendulum_time
    start = fit.nuisance[:, :1] if forward.mode == "impact" else time[:, :1]
    since = (time - start)[mask]
    residual = fit.residual[:, at][mask]
    edges = np.linspace(since.min(), since.max() + 1e-9, 41)
    place = np.clip(np.searchsorted(edges, since, side="right") - 1, 0, 39)
    count = np.bincount(place, minlength=40)
    mean = np.bincount(place, residual, minlength=40) / np.maximum(count, 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    kept = count > 0
    axis.errorbar(
        middle[kept], mean[kept], 1.0 / np.sqrt(count[kept]), fmt=".-", ms=4, lw=0.8,
        color=colour, label=name,
    )  # fmt: skip


def figure_of(explained: ExplainedCampaign | TableExplained) -> Picture:
    """Residuals by channel and the missing force by direction; for tables against impact speed."""
    if isinstance(explained, TableExplained):
        return figure_of_table(explained)
    forward, base = explained.prepared.forward, explained.prepared.fit
    best = explained.naming.best if explained.verdict.effects else None
    channels = [k for k in range(3) if forward.records.ball_used[..., k].any()]
    if forward.records.pendulum_used.any():
        channels.append(3)
    # with a baseline that is out of phase with a long swing, phase errors resemble torques
    seen = {("horizontal", "vertical", "out_of_plane", "angle")[k] for k in channels}
    found = missing_force(forward, base) if _is_force(explained) else ()
    forces = [force for force in found if force.channel in seen]
    rows = 2 if forces else 1
    columns = max(len(channels), len(forces), 1)
    figure = Picture(figsize=(4.2 * columns, 3.2 * rows), layout="constrained")
    axes = np.atleast_2d(figure.subplots(rows, columns, squeeze=False))
    for place in range(columns):
        axis = axes[0, place]
        if place < len(channels):
            channel = channels[place]
            _binned(forward, base, channel, axis, "tab:red", "baseline")
            if best is not None:
                _binned(forward, best.fit, channel, axis, "tab:blue", " + ".join(best.ids))
            axis.axhline(0.0, color="0.6", lw=0.8)
            axis.set_ylabel(f"{('x', 'y', 'z', 'angle')[channel]}: mean residual / sigma")
            since = "touch" if forward.mode == "impact" else "sample"
            axis.set_xlabel(f"time after first {since} / s")
            axis.locator_params(axis="x", nbins=6)
            axis.legend(fontsize=8)
        else:
            axis.set_axis_off()
        if rows == 1:
            continue
        axis = axes[1, place]
        if place < len(forces):
            force = forces[place]
            axis.fill_between(
                force.place, force.value - 1.96 * force.std, force.value + 1.96 * force.std,
                alpha=0.3, color="tab:green", lw=0,
            )  # fmt: skip
            axis.plot(force.place, force.value, color="tab:green")
            axis.axhline(0.0, color="0.6", lw=0.8)
            axis.set_ylabel(f"missing {FORCE_LABELS[force.channel]}")
            axis.set_xlabel("angle / rad" if force.channel == "angle" else "time after release / s")
        else:
            axis.set_axis_off()
    return figure


def _is_force(explained: ExplainedCampaign) -> bool:
    """Whether a force over time describes what is missing: forces or torques alone are named.

    An error of the instrument or of the contact has no force in flight. Where nothing is named the
    location decides.
    """
    if explained.prepared.forward.mode == "swing" or explained.verdict.verdict == "no_mismatch":
        return False
    members = _members(explained)
    if not members:
        where = explained.verdict.location
        return where is not None and where.phase in ("flight", "swing")
    return all({"force", "torque"} & set(member.effect.hooks) for member in members)


def draw_explained(explained: ExplainedCampaign | TableExplained, path: Path) -> None:
    """Write the figure as PNG or SVG."""
    figure = figure_of(explained)
    with written_whole(path) as part:
        draw_into(part, figure, path.suffix or ".png", dpi=130)


MAX_PANELS = 6
"""Panels per page (chosen: readable size)."""

BASELINE_COLOUR, IMPROVED_COLOUR, RECORDED_COLOUR = "tab:red", "tab:blue", "0.25"

AXES = ("x", "y", "z")

MAX_TABLE_PARAMETERS = 6
"""Parameters of a law shown as a table (chosen); more are drawn as a curve."""

REPORTED_LIBRARIES = ("numpy", "scipy")
"""Libraries whose versions may affect the numbers."""

CURVE_BINS = 24
"""Intervals of a coordinate in which rows are averaged (chosen)."""

MIN_CURVE_ROWS = 8
"""Rows needed to draw a curve (chosen)."""

LAW_DRAWS = 60
"""Draws of a law's parameters for its band (chosen)."""

COORDINATE_LABELS = {
    Coordinate.TIME: "time after release / s",
    Coordinate.PLACE: "position along the path / m",
    Coordinate.HEIGHT: "height / m",
    Coordinate.SPEED: "speed / (m/s)",
    Coordinate.RATE: "angular velocity / (rad/s)",
    Coordinate.ANGLE: "angle / rad",
    Coordinate.DIRECTION: "direction above the horizontal / rad",
    Coordinate.ORDER: "order of the trial, first to last",
}

FLIGHT_COORDINATES = frozenset(
    {
        Coordinate.TIME, Coordinate.PLACE, Coordinate.HEIGHT, Coordinate.SPEED,
        Coordinate.DIRECTION,
    }
)  # fmt: skip

"""Coordinates of a flight."""

DIRECTION_WORDS = {
    "horizontal": "forward",
    "vertical": "upward",
    "along_velocity": "along the path",
    "normal_to_velocity": "at right angles to the path",
}


@dataclass(frozen=True)
class TrialMisfit:
    """Root mean square residual of one trial, mm or mrad, before and after."""

    name: str
    before: float
    after: float | None

    @property
    def removed(self) -> float | None:
        """Fraction removed by the improved model."""
        return None if self.after is None else 1.0 - self.after / max(self.before, 1e-12)


@dataclass(frozen=True)
class _Track:
    """A trial's rows along one pair of axes: recorded, and in both models."""

    across: FloatArray
    seen: FloatArray
    before: FloatArray
    after: FloatArray | None


def _predicted(explained: ExplainedCampaign, fit: Fit) -> FloatArray:
    forward = explained.prepared.forward
    nuisance = spread_laws(forward, fit.model, fit.nuisance, fit.law_offsets)
    return np.asarray(forward.predict([fit.model.order()], nuisance[None])[0])


def _answer(explained: ExplainedCampaign) -> Fit | None:
    """The fit of the named effects; None if none is named."""
    best = explained.naming.best
    return None if best is None or not explained.verdict.effects else best.fit


def _rows(explained: ExplainedCampaign, axis: int) -> slice:
    size = explained.prepared.forward.records.ball_time.shape[1]
    return slice(axis * size, (axis + 1) * size) if axis < 3 else slice(3 * size, None)


def _used(explained: ExplainedCampaign, axis: int) -> NDArray[np.bool_]:
    return explained.prepared.forward.records.used[:, _rows(explained, axis)]


def _axes(explained: ExplainedCampaign) -> tuple[int, ...]:
    return tuple(axis for axis in range(4) if _used(explained, axis).any())


def _time(explained: ExplainedCampaign, axis: int) -> FloatArray:
    records = explained.prepared.forward.records
    time = records.ball_time if axis < 3 else records.pendulum_time
    start = explained.prepared.fit.nuisance[:, :1]
    return time - (start if explained.prepared.forward.mode == "impact" else time[:, :1])


def _misfit_axis(explained: ExplainedCampaign) -> int:
    """Axis in which the answer removes most chi-square; without one, that of the largest misfit."""
    forward, answer = explained.prepared.forward, _answer(explained)

    def size(fit: Fit, axis: int) -> float:
        residual = fit.residual[:, _rows(explained, axis)]
        return float(np.square(residual).sum())

    def gained(axis: int) -> float:
        return size(explained.prepared.fit, axis) - (size(answer, axis) if answer else 0.0)

    axes = _axes(explained)
    return axes[0] if forward.mode == "swing" or len(axes) == 1 else max(axes, key=gained)


def _tracks(explained: ExplainedCampaign, axis: int, across_x: bool) -> list[_Track | None]:
    """Each trial's record along an axis, against x or against time."""
    records, answer = explained.prepared.forward.records, _answer(explained)
    before = _predicted(explained, explained.prepared.fit)
    after = None if answer is None else _predicted(explained, answer)
    at, time = _rows(explained, axis), _time(explained, axis)
    found: list[_Track | None] = []
    for trial in range(records.trials):
        seen = _used(explained, axis)[trial]
        if across_x:
            seen = seen & _used(explained, 0)[trial]
        if not seen.any():
            found.append(None)
            continue
        across = records.values[trial, _rows(explained, 0)] if across_x else time[trial]
        found.append(
            _Track(
                across[seen],
                records.values[trial, at][seen],
                before[trial, at][seen],
                None if after is None else after[trial, at][seen],
            )
        )
    return found


def paths_figure(explained: ExplainedCampaign) -> Picture:
    """All paths, then up to six trials in the coordinate of the misfit, minus the baseline."""
    axes, axis = _axes(explained), _misfit_axis(explained)
    flat = {0, 1} <= set(axes) and axis < 3
    up = 1 if flat else axis
    whole, apart = _tracks(explained, up, flat), _tracks(explained, axis, False)
    shown = [k for k, track in enumerate(apart) if track is not None]
    picked = [
        shown[k] for k in np.linspace(0, len(shown) - 1, min(MAX_PANELS, len(shown)), dtype=int)
    ]
    rows = 1 + -(-len(picked) // 2)
    figure = Picture(figsize=(7.2, 2.3 * rows), layout="constrained")
    grid = figure.add_gridspec(rows, 2)
    name, unit = ("angle", "mrad") if axis == 3 else (AXES[axis], "mm")
    before = " before" if _answer(explained) else ""
    for place, trial in enumerate(picked):
        panel = figure.add_subplot(grid[1 + place // 2, place % 2])
        _draw_difference(panel, apart[trial])
        panel.set_title(f"trial {explained.trials[trial]}", fontsize=9)
        panel.set_xlabel("time / s", fontsize=8)
        panel.set_ylabel(f"{name} − model{before} / {unit}", fontsize=8)
    together = figure.add_subplot(grid[0, :])
    _draw(together, whole, size=1.5)
    together.set_title(f"all {len(shown)} trials" if len(shown) > 1 else "", fontsize=9)
    together.set_xlabel("x / m" if flat else "time / s")
    together.set_ylabel("angle / rad" if up == 3 else f"{AXES[up]} / m")
    handles, labels = together.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=9)
    return figure


def _draw_difference(axis: Axes, track: _Track | None) -> None:
    """One trial minus the baseline simulation, mm or mrad."""
    if track is None:
        return
    axis.plot(track.across, 1e3 * (track.seen - track.before), ".", ms=3.0, color=RECORDED_COLOUR)
    axis.axhline(0.0, lw=1.0, color=BASELINE_COLOUR, alpha=0.8)
    if track.after is not None:
        axis.plot(
            track.across, 1e3 * (track.after - track.before), "-", lw=1.2, color=IMPROVED_COLOUR
        )
    axis.tick_params(labelsize=8)


def _draw(axis: Axes, tracks: list[_Track | None], size: float) -> None:
    first = True
    changed = any(track is not None and track.after is not None for track in tracks)
    name = "simulated before" if changed else "simulated"
    for track in tracks:
        if track is None:
            continue
        axis.plot(
            track.across,
            track.seen,
            ".",
            ms=size,
            color=RECORDED_COLOUR,
            label="recorded" if first else None,
        )
        axis.plot(track.across, track.before, "-", lw=1.0, color=BASELINE_COLOUR, alpha=0.8,
                  label=name if first else None)  # fmt: skip
        if track.after is not None:
            axis.plot(track.across, track.after, "-", lw=1.0, color=IMPROVED_COLOUR,
                      label="simulated with the missing effect" if first else None)  # fmt: skip
        first = False
    axis.tick_params(labelsize=8)


def _left(explained: ExplainedCampaign, fit: Fit, axis: int) -> FloatArray:
    """Recorded − simulated, mm or mrad, by trial and row."""
    at = _rows(explained, axis)
    return 1e3 * (explained.prepared.forward.records.values - _predicted(explained, fit))[:, at]


def residuals_figure(explained: ExplainedCampaign) -> Picture:
    """Residuals of both simulations, one line per trial, against time and speed."""
    axes = _axes(explained)
    figure = Picture(figsize=(7.2, 2.5 * len(axes)), layout="constrained")
    panels = figure.subplots(len(axes), 2, squeeze=False)
    answer = _answer(explained)
    for row, axis in enumerate(axes):
        used, time = _used(explained, axis), _time(explained, axis)
        coordinate, name = _coordinate(explained, axis)
        fits = [(explained.prepared.fit, BASELINE_COLOUR, "before")]
        if answer is not None:
            fits.append((answer, IMPROVED_COLOUR, "after"))
        for fit, colour, label in fits:
            left = _left(explained, fit, axis)
            for panel, along in ((panels[row, 0], time), (panels[row, 1], coordinate)):
                for trial in range(len(left)):
                    seen = used[trial]
                    panel.plot(along[trial, seen], left[trial, seen], ".", ms=1.5, alpha=0.6,
                               color=colour, label=label if trial == 0 else None)  # fmt: skip
        what = "angle / mrad" if axis == 3 else f"{AXES[axis]} / mm"
        panels[row, 0].set_ylabel(f"recorded − simulated\n{what}", fontsize=9)
        panels[row, 0].set_xlabel("time / s", fontsize=9)
        panels[row, 1].set_xlabel(name, fontsize=9)
        for panel in panels[row]:
            panel.axhline(0.0, color="0.6", lw=0.8)
            panel.tick_params(labelsize=8)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=9, markerscale=5)
    return figure


def _coordinate(explained: ExplainedCampaign, axis: int) -> tuple[FloatArray, str]:
    """Coordinate of the residuals: speed in flight, angular velocity in a swing."""
    fit = _answer(explained) or explained.prepared.fit
    predicted, time = _predicted(explained, fit), _time(explained, axis)
    swinging = axis == 3
    squares = np.zeros(time.shape)
    for one in (3,) if swinging else tuple(a for a in _axes(explained) if a < 3):
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = np.gradient(predicted[:, _rows(explained, one)], axis=1) / np.gradient(
                time, axis=1
            )
        squares += np.square(np.nan_to_num(rate, posinf=0.0, neginf=0.0))
    name = "angular speed / (rad/s)" if swinging else "speed / (m/s)"
    return np.sqrt(squares), name


def law_figure(explained: ExplainedCampaign) -> Picture | None:
    """Each named force or torque against its coordinate, with its 95 % band.

    None if no force or torque is named.
    """
    curves = [curve for member in _members(explained) for curve in _curve(explained, member.effect)]
    if not curves:
        return None
    titles = list(dict.fromkeys(curve.title for curve in curves))
    figure = Picture(figsize=(7.2, 2.9 * len(titles)), layout="constrained")
    panels = figure.subplots(len(titles), 1, squeeze=False)[:, 0]
    for curve in curves:
        axis = panels[titles.index(curve.title)]
        (line,) = axis.plot(curve.along, curve.size, "-", lw=1.4, label=curve.ball)
        axis.fill_between(
            curve.along, curve.low, curve.high, color=line.get_color(), alpha=0.25, lw=0
        )
        axis.set_title(curve.title, fontsize=10)
        axis.set_xlabel(curve.along_name, fontsize=9)
        axis.set_ylabel(curve.size_name, fontsize=9)
        axis.tick_params(labelsize=8)
    for axis in panels:
        axis.axhline(0.0, color="0.6", lw=0.8)
        if len(axis.get_legend_handles_labels()[1]) > 1:
            axis.legend(fontsize=8)
    return figure


@dataclass(frozen=True)
class _Curve:
    """A law against its coordinate: mean of the rows, and 95 % band from its parameters."""

    along: FloatArray
    size: FloatArray
    low: FloatArray
    high: FloatArray
    title: str
    ball: str
    along_name: str
    size_name: str


def _members(explained: ExplainedCampaign) -> tuple[Candidate, ...]:
    best = explained.naming.best
    return () if best is None or not explained.verdict.effects else best.members


def _curve(explained: ExplainedCampaign, effect: Effect) -> list[_Curve]:
    """The law's curve for each ball; empty if the effect is no force or torque."""
    best = explained.naming.best
    acting = None if best is None else _acting(explained, best.fit, effect)
    if best is None or acting is None:
        return []
    records = explained.prepared.forward.records
    rows = np.broadcast_to(records.ball_index[:, None], acting.used.shape)[acting.used]
    names = records.ball_names if acting.flying else ("",)
    found = []
    for index, ball in enumerate(names):
        mine = rows == index if acting.flying else np.ones(rows.size, dtype=bool)
        if int(mine.sum()) > MIN_CURVE_ROWS:
            found.append(_banded(best.fit, effect, acting, mine, ball))
    return found


@dataclass(frozen=True)
class _Acting:
    """Rows at which a law acts, its coordinate there, and its magnitude for given parameters."""

    used: NDArray[np.bool_]
    place: FloatArray
    size: Callable[[Values], FloatArray]
    name: str
    along: str
    flying: bool


def _acting(explained: ExplainedCampaign, fit: Fit, effect: Effect) -> _Acting | None:
    forward = explained.prepared.forward
    if "force" in effect.hooks:
        flight, since = flight_state(forward, fit)
        used = forward.records.ball_used.any(axis=-1) & (np.asarray(flight.time) > 0.0)

        def forces(values: Values) -> dict[str, FloatArray]:
            parts = _directions(effect.force(values, flight), flight)
            return {way: np.broadcast_to(f, since.shape)[used] for way, f in parts.items()}

        parts = forces(_values(fit, effect))
        largest = max(parts, key=lambda way: float(np.abs(parts[way]).sum()))
        way = effect.form if effect.form in parts else largest
        place = np.broadcast_to(np.asarray(flight.along(effect.coordinate)), since.shape)[used]
        along = effect.coordinate if effect.coordinate in FLIGHT_COORDINATES else Coordinate.SPEED
        return _Acting(
            used, place, lambda values: forces(values)[way], f"force {DIRECTION_WORDS[way]} / N",
            COORDINATE_LABELS[along], True,
        )  # fmt: skip
    if isinstance(effect, Drift):
        return _drifting(forward, effect)
    swing = swing_state(forward, fit)
    if "torque" not in effect.hooks or swing is None:
        return None
    used = forward.records.pendulum_used
    along = Coordinate.ANGLE if effect.coordinate is Coordinate.ANGLE else Coordinate.RATE
    over = swing.phi if along is Coordinate.ANGLE else swing.omega

    def torque(values: Values) -> FloatArray:
        return np.broadcast_to(np.asarray(effect.torque(values, swing)), used.shape)[used]

    place = np.broadcast_to(np.asarray(over), used.shape)[used]
    return _Acting(used, place, torque, "torque / N m", COORDINATE_LABELS[along], False)


def _drifting(forward: Forward, effect: Drift) -> _Acting:
    """The drift of a contact, at the rows of every trial."""
    used = np.atleast_1d(forward.records.ball_used.any(axis=-1))
    place = np.broadcast_to(forward.records.order[:, None], used.shape)[used]
    unit = effect.strengths[0].unit
    name = effect.form.replace("_", " ") + (f" / {unit}" if unit != "1" else "")
    return _Acting(
        used,
        place,
        lambda values: effect.size(values, place),
        name,
        COORDINATE_LABELS[Coordinate.ORDER],
        False,
    )


def _banded(
    fit: Fit, effect: Effect, acting: _Acting, mine: NDArray[np.bool_], ball: str
) -> _Curve:
    """Means of rows in equal intervals of the coordinate, for the fit and for draws about it."""
    place = acting.place[mine]
    edges = np.linspace(place.min(), place.max() + 1e-12, CURVE_BINS + 1)
    which = np.clip(np.searchsorted(edges, place, side="right") - 1, 0, CURVE_BINS - 1)
    count = np.bincount(which, minlength=CURVE_BINS)
    kept = count > 0

    def means(values: Values) -> FloatArray:
        sums = np.bincount(which, acting.size(values)[mine], minlength=CURVE_BINS)
        return np.asarray((sums / np.maximum(count, 1))[kept])

    values = dict(_values(fit, effect))
    own = [k for k, item in enumerate(fit.free) if fit.model.entries[item.entry][0] is effect]
    names = [fit.free[k].parameter.name for k in own]
    middle = [float(values[name]) for name in names]
    spread = fit.reduced_chi2 * fit.covariance[np.ix_(own, own)]
    draws = np.random.default_rng(5).multivariate_normal(middle, spread, LAW_DRAWS)
    bounds = [(fit.free[k].parameter.lower, fit.free[k].parameter.upper) for k in own]
    draws = np.clip(draws, *np.array(bounds).T) if bounds else draws
    moved = np.array([means(values | dict(zip(names, draw, strict=True))) for draw in draws])
    low, high = np.quantile(moved, [0.025, 0.975], axis=0)
    what = "an uncatalogued force" if effect.id == EffectId.UNNAMED else effect.id.replace("_", " ")
    middles = (0.5 * (edges[1:] + edges[:-1]))[kept]
    return _Curve(middles, means(values), low, high, what, ball, acting.along, acting.name)


def _values(fit: Fit, effect: Effect) -> Values:
    return next(values for held, values in fit.model.entries if held is effect)


def _directions(force: Vector, flight: FlightState) -> dict[str, FloatArray]:
    """A force by direction, N."""
    fx, fy, fz = (np.asarray(part) for part in force)
    speed = np.maximum(flight.speed, 1e-9)
    return {
        "horizontal": fx,
        "vertical": fy,
        "along_velocity": (fx * flight.vx + fy * flight.vy + fz * flight.vz) / speed,
        "normal_to_velocity": (fy * flight.vx - fx * flight.vy) / speed,
    }


def misfit_by_trial(explained: ExplainedCampaign) -> tuple[TrialMisfit, ...]:
    """Residual of every trial before and after, in mm (mrad for swings alone)."""
    axes = [a for a in _axes(explained) if a < 3] or [3]
    answer = _answer(explained)
    found = []
    for trial, name in enumerate(explained.trials):
        sizes: list[float | None] = []
        for fit in (explained.prepared.fit, answer):
            if fit is None:
                sizes.append(None)
                continue
            left = np.concatenate(
                [_left(explained, fit, a)[trial][_used(explained, a)[trial]] for a in axes]
            )
            sizes.append(float(np.sqrt(np.mean(left**2))) if left.size else None)
        if sizes[0] is not None:
            found.append(TrialMisfit(name, sizes[0], sizes[1]))
    return (*found, _together(explained, found, axes))


def _together(
    explained: ExplainedCampaign, rows: list[TrialMisfit], axes: list[int]
) -> TrialMisfit:
    """All trials as one row, each weighed by its number of samples."""
    counts = {
        name: sum(int(_used(explained, a)[k].sum()) for a in axes)
        for k, name in enumerate(explained.trials)
    }
    weights = np.array([counts[row.name] for row in rows], dtype=float)

    def mean(values: list[float]) -> float:
        return float(np.sqrt(np.average(np.square(values), weights=weights)))

    after = [row.after for row in rows if row.after is not None]
    return TrialMisfit(
        "all", mean([row.before for row in rows]), mean(after) if len(after) == len(rows) else None
    )


def _noise(explained: ExplainedCampaign) -> float:
    """Residual expected from noise alone, mm or mrad."""
    axes = [a for a in _axes(explained) if a < 3] or [3]
    return 1e3 * float(np.sqrt(np.mean(np.square(explained.prepared.noise.sigma[:, axes]))))


FORCES = (
    "Above: mean residual in units of the noise, against time. Below: the missing force estimated"
    " from the residuals alone, with its 95 % band; one curve for all trials."
)

MEANS = "Mean residual in units of the noise, against time."

TABLE = (
    "Recorded − model for each result, against impact speed; lines join the means at each speed."
)

HTML = """<div style="max-width:60rem"><p><b>{{ headline }}</b></p>
{% for line in lines %}<p>{{ line }}</p>{% endfor %}</div>"""


def verdict_html(verdict: EngineVerdict) -> str:
    """Summary of the verdict as HTML for a notebook cell."""
    headline, *lines = verdict.text().splitlines()
    return Environment(autoescape=True).from_string(HTML).render(headline=headline, lines=lines)


def _page() -> str:
    return (files("pipelines.explain") / "page.html.j2").read_text(encoding="utf-8")


@dataclass(frozen=True)
class _EffectSection:
    """A named effect with its law as a picture (SVG, base64), as text, and its source."""

    named: NamedEffect
    law: str
    text: str
    source: str

    @property
    def table(self) -> bool:
        """Whether its parameters are shown as a table; otherwise a curve is drawn."""
        return len(self.named.parameters) <= MAX_TABLE_PARAMETERS


@dataclass(frozen=True)
class _ReportFile:
    name: str
    digest: str


def _png(figure: Picture) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _typeset(law: str) -> str:
    """A formula as SVG, base64; empty if matplotlib can't typeset it."""
    buffer = io.BytesIO()
    law = re.sub(r"\\tfrac(\d)(\d)", r"\\frac{\1}{\2}", law).replace(r"\tfrac", r"\frac")
    law = re.sub(r"\\(mathbf|boldsymbol) ?(\\[A-Za-z]+|[A-Za-z])", r"\\\1{\2}", law)
    try:
        with rc_context({"svg.hashsalt": "impact-vision"}):
            math_to_image(f"${law}$", buffer, dpi=150, format="svg")
    except (ValueError, RuntimeError):
        return ""
    undated = re.sub(rb"<dc:date>.*?</dc:date>", b"", buffer.getvalue())
    return base64.b64encode(undated).decode("ascii")


def _effect_sections(explained: ExplainedCampaign | TableExplained) -> list[_EffectSection]:
    if isinstance(explained, TableExplained):
        members = () if explained.best is None else explained.best.members
    else:
        best = explained.naming.best
        members = () if best is None else best.members
    sections = []
    for named in explained.verdict.effects:
        effect = next((m.effect for m in members if m.id == named.id), None)
        law = "" if effect is None else effect.law
        source = "" if effect is None else effect.source
        sections.append(_EffectSection(named, _typeset(law), law, source))
    return sections


def _provenance(paths: Sequence[Path]) -> list[_ReportFile]:
    return [
        _ReportFile(path.name, hashlib.sha256(path.read_bytes()).hexdigest())
        for path in paths
        if path.is_file()
    ]


def explain_report_html(
    explained: ExplainedCampaign | TableExplained, rests_on: Sequence[Path] = ()
) -> str:
    """The page as text; `rests_on` are its input files, listed with their hashes."""
    page = Environment(autoescape=True).from_string(_page())
    common = {
        "v": explained.verdict,
        "headline": explained.verdict.headline,
        "effects": _effect_sections(explained),
        "png": _png(figure_of(explained)),
        "sources": _provenance(rests_on),
        "version": version("impact-vision"),
        "made": os.environ.get(DATE, ""),
        "libraries": ", ".join(f"{name} {version(name)}" for name in REPORTED_LIBRARIES),
    }
    if isinstance(explained, TableExplained):
        return page.render(**common, means=TABLE)
    forward = explained.prepared.forward
    swings = forward.mode == "swing"
    laws = law_figure(explained)
    return page.render(
        **common,
        means=FORCES if _is_force(explained) else MEANS,
        laws="" if laws is None else _png(laws),
        noise=_noise(explained),
        paths=_png(paths_figure(explained)),
        residuals=_png(residuals_figure(explained)),
        trials=misfit_by_trial(explained),
        unit="mrad" if swings else "mm",
        swings=swings,
        count=forward.records.count,
        threshold=explained.naming.threshold,
        tried=rows_of_tried(explained.naming, explained.verdict),
    )


def write_explain_report(
    explained: ExplainedCampaign | TableExplained, path: Path, rests_on: Sequence[Path] = ()
) -> None:
    """Write the page."""
    write_text_whole(path, explain_report_html(explained, rests_on))
