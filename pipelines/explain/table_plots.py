"""One figure for a trial table: what is left of each number before and after."""

import numpy as np
from matplotlib.axes import Axes

from mismatch.table.explain import TableExplained
from mismatch.table.search import Answer
from pipelines.figures import Picture

__all__ = ["figure_of_table"]

LABELS = ("impact speed: recorded − model / (m/s)", "ball speed: recorded − model / (m/s)",
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
        axis.set_ylabel(LABELS[channel])
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
