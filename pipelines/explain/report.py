"""The story of a verdict as one HTML page that needs nothing else.

Pictures of a verdict: what was recorded over both simulations, and what each leaves over.
"""

import base64
import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import numpy as np
from jinja2 import Environment
from matplotlib.axes import Axes
from matplotlib.mathtext import math_to_image
from numpy.typing import NDArray

from metrology import write_text_whole
from mismatch import Explained, Verdict
from mismatch.fitting.fit import Fit
from mismatch.fitting.normal_equations import spread_laws
from mismatch.table.explain import TableExplained
from mismatch.verdict import NamedEffect
from physics.domain import FloatArray
from pipelines.explain.plots import figure_of
from pipelines.figures import Picture

__all__ = ["explain_report_html", "verdict_html", "write_explain_report"]

MOST_PANELS = 6
"""Panels, so that a page shows all of them at a size that can be read."""

BASELINE, IMPROVED, SEEN = "tab:red", "tab:blue", "0.25"

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class TrialMisfit:
    """Root mean square of what is left of one trial, mm or mrad, before and after."""

    name: str
    before: float
    after: float | None

    @property
    def removed(self) -> float | None:
        """Share of it that the answer takes away."""
        return None if self.after is None else 1.0 - self.after / max(self.before, 1e-12)


@dataclass(frozen=True)
class _Track:
    """A trial's rows along one pair of axes: recorded, and as both models have it."""

    across: FloatArray
    seen: FloatArray
    before: FloatArray
    after: FloatArray | None


def _predicted(explained: Explained, fit: Fit) -> FloatArray:
    forward = explained.prepared.forward
    nuisance = spread_laws(forward, fit.nuisance, fit.law_offsets)
    return np.asarray(forward.predict([fit.model.order()], nuisance[None])[0])


def _answer(explained: Explained) -> Fit | None:
    """The fit that the verdict stands for; None where it names nothing."""
    best = explained.naming.best
    return None if best is None or not explained.verdict.effects else best.fit


def _rows(explained: Explained, axis: int) -> slice:
    size = explained.prepared.forward.records.ball_time.shape[1]
    return slice(axis * size, (axis + 1) * size) if axis < 3 else slice(3 * size, None)


def _used(explained: Explained, axis: int) -> NDArray[np.bool_]:
    return explained.prepared.forward.records.used[:, _rows(explained, axis)]


def _axes(explained: Explained) -> tuple[int, ...]:
    return tuple(axis for axis in range(4) if _used(explained, axis).any())


def _time(explained: Explained, axis: int) -> FloatArray:
    records = explained.prepared.forward.records
    time = records.ball_time if axis < 3 else records.pendulum_time
    start = explained.prepared.fit.nuisance[:, :1]
    return time - (start if explained.prepared.forward.mode == "impact" else time[:, :1])


def _tracks(explained: Explained) -> tuple[list[_Track | None], str, str]:
    """Each trial's path with the names of both axes: x and y of a flight, else over time."""
    records = explained.prepared.forward.records
    axes = _axes(explained)
    flat = {0, 1} <= set(axes)
    up = 1 if 1 in axes else axes[0]
    values, answer = records.values, _answer(explained)
    before = _predicted(explained, explained.prepared.fit)
    after = None if answer is None else _predicted(explained, answer)
    found: list[_Track | None] = []
    for trial in range(records.trials):
        seen = _used(explained, up)[trial]
        if flat:
            seen = seen & _used(explained, 0)[trial]
        if not seen.any():
            found.append(None)
            continue
        at = _rows(explained, up)
        across = _time(explained, up)[trial, seen]
        if flat:
            across = values[trial, _rows(explained, 0)][seen]
        found.append(
            _Track(
                across,
                values[trial, at][seen],
                before[trial, at][seen],
                None if after is None else after[trial, at][seen],
            )
        )
    unit = "angle / rad" if up == 3 else f"{AXES[up]} / m"
    return found, "x / m" if flat else "time / s", unit


def paths_figure(explained: Explained) -> Picture:
    """Recorded paths over both simulations: up to six trials each by itself, then all together."""
    tracks, across, up = _tracks(explained)
    shown = [k for k, track in enumerate(tracks) if track is not None]
    picked = [
        shown[k] for k in np.linspace(0, len(shown) - 1, min(MOST_PANELS, len(shown)), dtype=int)
    ]
    names = explained.trials
    rows = 1 + -(-len(picked) // 2)
    figure = Picture(figsize=(7.2, 2.3 * rows), layout="constrained")
    grid = figure.add_gridspec(rows, 2)
    for place, trial in enumerate(picked):
        axis = figure.add_subplot(grid[1 + place // 2, place % 2])
        _draw(axis, [tracks[trial]], size=3.0)
        axis.set_title(f"trial {names[trial]}", fontsize=9)
        axis.set_xlabel(across, fontsize=8)
        axis.set_ylabel(up, fontsize=8)
    together = figure.add_subplot(grid[0, :])
    _draw(together, tracks, size=1.5)
    together.set_title(f"all {len(shown)} trials", fontsize=9)
    together.set_xlabel(across)
    together.set_ylabel(up)
    handles, labels = together.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=9)
    return figure


def _draw(axis: Axes, tracks: list[_Track | None], size: float) -> None:
    first = True
    for track in tracks:
        if track is None:
            continue
        axis.plot(
            track.across, track.seen, ".", ms=size, color=SEEN, label="recorded" if first else None
        )
        axis.plot(track.across, track.before, "-", lw=1.0, color=BASELINE, alpha=0.8,
                  label="simulated before" if first else None)  # fmt: skip
        if track.after is not None:
            axis.plot(track.across, track.after, "-", lw=1.0, color=IMPROVED,
                      label="simulated with what was left out" if first else None)  # fmt: skip
        first = False
    axis.tick_params(labelsize=8)


def _left(explained: Explained, fit: Fit, axis: int) -> FloatArray:
    """Recorded less simulated, mm or mrad, by trial and row."""
    at = _rows(explained, axis)
    return 1e3 * (explained.prepared.forward.records.values - _predicted(explained, fit))[:, at]


def residuals_figure(explained: Explained) -> Picture:
    """What both simulations leave over, every trial a line, over time and over what matters."""
    axes = _axes(explained)
    figure = Picture(figsize=(7.2, 2.5 * len(axes)), layout="constrained")
    panels = figure.subplots(len(axes), 2, squeeze=False)
    answer = _answer(explained)
    for row, axis in enumerate(axes):
        used, time = _used(explained, axis), _time(explained, axis)
        coordinate, name = _coordinate(explained, axis)
        fits = [(explained.prepared.fit, BASELINE, "before")]
        if answer is not None:
            fits.append((answer, IMPROVED, "after"))
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


def _coordinate(explained: Explained, axis: int) -> tuple[FloatArray, str]:
    """What a force of this kind goes with: speed in flight, angular velocity in a swing."""
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


def misfit_by_trial(explained: Explained) -> tuple[TrialMisfit, ...]:
    """What is left of every trial before and after, in mm (mrad for swings alone)."""
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
    return tuple(found)


FORCES = "Mean residual in units of the noise over time, and the missing force with its 95 % band."

TABLE = "Recorded minus model for each number, over impact speed."

CELL = """<div style="max-width:60rem"><p><b>{{ headline }}</b></p>
{% for line in lines %}<p>{{ line }}</p>{% endfor %}</div>"""


def verdict_html(verdict: Verdict) -> str:
    """The story in plain words as HTML for a notebook's cell."""
    headline, *lines = verdict.text().splitlines()
    return Environment(autoescape=True).from_string(CELL).render(headline=headline, lines=lines)


def _page() -> str:
    return (files("pipelines.explain") / "page.html.j2").read_text(encoding="utf-8")


@dataclass(frozen=True)
class _Told:
    """A named effect with its law as a picture (SVG, base64), as text, and where it is from."""

    named: NamedEffect
    law: str
    text: str
    source: str


@dataclass(frozen=True)
class _File:
    name: str
    digest: str


def _png(figure: Picture) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _typeset(law: str) -> str:
    """A formula as SVG, base64; empty where matplotlib can't set it."""
    buffer = io.BytesIO()
    try:
        math_to_image(f"${law}$", buffer, dpi=150, format="svg")
    except (ValueError, RuntimeError):
        return ""
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _told(explained: Explained | TableExplained) -> list[_Told]:
    if isinstance(explained, TableExplained):
        members = () if explained.best is None else explained.best.members
    else:
        best = explained.naming.best
        members = () if best is None else best.members
    told = []
    for named in explained.verdict.effects:
        effect = next((m.effect for m in members if m.id == named.id), None)
        law = "" if effect is None else effect.law
        source = "" if effect is None else effect.source
        told.append(_Told(named, _typeset(law), law, source))
    return told


def _provenance(paths: Sequence[Path]) -> list[_File]:
    return [
        _File(path.name, hashlib.sha256(path.read_bytes()).hexdigest())
        for path in paths
        if path.is_file()
    ]


def explain_report_html(
    explained: Explained | TableExplained, rests_on: Sequence[Path] = ()
) -> str:
    """The page as text; `rests_on` are its files, told with their hashes."""
    page = Environment(autoescape=True).from_string(_page())
    common = {
        "v": explained.verdict,
        "headline": explained.verdict.text().splitlines()[0],
        "effects": _told(explained),
        "png": _png(figure_of(explained)),
        "sources": _provenance(rests_on),
        "version": version("impact-vision"),
    }
    if isinstance(explained, TableExplained):
        return page.render(**common, caption=TABLE)
    forward = explained.prepared.forward
    swings = forward.mode == "swing"
    return page.render(
        **common,
        caption=FORCES,
        paths=_png(paths_figure(explained)),
        residuals=_png(residuals_figure(explained)),
        trials=misfit_by_trial(explained),
        unit="mrad" if swings else "mm",
        swings=swings,
        count=forward.records.count,
    )


def write_explain_report(
    explained: Explained | TableExplained, path: Path, rests_on: Sequence[Path] = ()
) -> None:
    """Write the page."""
    write_text_whole(path, explain_report_html(explained, rests_on))
