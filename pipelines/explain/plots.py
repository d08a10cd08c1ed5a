"""One figure for a verdict: residuals before and after, and the missing force with its band.

One figure for a trial table: what is left of each number before and after.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from metrology import written_whole
from mismatch import Explained
from mismatch.fitting.fit import Fit
from mismatch.model.forward import Forward
from mismatch.search.latent import missing_force
from mismatch.table.explain import TableExplained
from mismatch.table.search import Answer
from pipelines.figures import Picture

__all__ = ["draw_explained", "figure_of"]

TABLE_LABELS = ("impact speed: recorded − model / (m/s)", "ball speed: recorded − model / (m/s)",
          "range: recorded − model / m")  # fmt: skip

MARKERS = "osD^v<>P"


def figure_of_table(explained: TableExplained) -> Picture:
    """Residuals against impact speed, one panel for each number, balls by marker."""
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
            speed[mine], residual[mine], std[mine], fmt=f"{MARKERS[index % len(MARKERS)]}-",
            ms=5, lw=0.8, color=colour, label=f"{name}{f' ({ball})' if ball else ''}",
        )  # fmt: skip


LABELS = {
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


def figure_of(explained: Explained | TableExplained) -> Picture:
    """Residuals by channel, and the missing force by direction; of a table, by impact speed."""
    if isinstance(explained, TableExplained):
        return figure_of_table(explained)
    forward, base = explained.prepared.forward, explained.prepared.fit
    best = explained.naming.best if explained.verdict.effects else None
    channels = [k for k in range(3) if forward.records.ball_used[..., k].any()]
    if forward.records.pendulum_used.any():
        channels.append(3)
    # About a baseline that is out of step with a long swing no torque can be told from its phase.
    seen = {("horizontal", "vertical", "out_of_plane", "angle")[k] for k in channels}
    found = () if forward.mode == "swing" else missing_force(forward, base)
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
            axis.set_xlabel("time after first touch / s")
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
            axis.set_ylabel(f"missing {LABELS[force.channel]}")
            axis.set_xlabel("angle / rad" if force.channel == "angle" else "time after release / s")
        else:
            axis.set_axis_off()
    return figure


def draw_explained(explained: Explained | TableExplained, path: Path) -> None:
    """Write the figure as PNG or SVG."""
    figure = figure_of(explained)
    with written_whole(path) as part:
        figure.savefig(part, format=path.suffix.lstrip(".") or "png", dpi=130)
