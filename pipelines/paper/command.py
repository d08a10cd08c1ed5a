"""`vision paper`: the tables beside the print, the investigation of Table 5, and the figures.

The generated parts of docs/model.md: the audit, the candidates for Table 5, the pictures.

Run ``python -m pipelines.paper.command docs/model.md`` after a change of the physics.

The paper's figures that can be drawn from what it prints: ours as lines, the print as points.
"""

import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from matplotlib.axes import Axes
from rich.table import Table

from metrology import UsageError, write_text_whole
from physics.air import DRAG_CURVES, PAPER_AIR, SOCCER_LIFT, SUBCRITICAL_DRAG
from physics.bodies import (
    BALLS,
    PAPER_PENDULUM,
    Ball,
    lost_by_pendulum,
    lost_by_pendulum_approximate,
)
from physics.contact import external_impulse
from physics.domain import FloatArray
from physics.flight import FlightPath, fly
from physics.forward import (
    Experiment,
    impulsive_launch,
    numerical_landing,
    paper_impact,
    time_resolved_landing,
)
from physics.swing import frictionless_speed
from pipelines.doors import FileRole
from pipelines.model.simulate import BLUE, GRAY, ORANGE, saved_figure
from pipelines.paper.audit import (
    ALLOWANCE,
    BACKSWINGS_DEG,
    EFFECTIVE_MASS,
    TABLE_5,
    TABLE_6,
    TABLE_7,
    TABLE_8,
    TABLE_10,
    WANTED_DISTANCES,
    WANTED_IMPULSES,
    Cell,
    Explanation,
    as_rows,
    audit,
    backswing_by_rational,
    conclusions,
    contact_candidate,
    draw_sensitivities,
    implied_fits,
    investigate,
    law_of,
    measured_speeds,
    speed_by_rational,
    speed_for,
    swing_checks,
)
from pipelines.terminal import screen

__all__ = [
    "FIGURES",
    "draw_figures",
    "paper_command",
    "sections",
]

_COLOURS = {"variable": BLUE, "constant": ORANGE}
_ANGLES = np.array(BACKSWINGS_DEG, dtype=np.float64)


def _numbers(texts: tuple[str, ...]) -> FloatArray:
    return np.array([float(text) for text in texts])


def _grid(low: float, high: float) -> FloatArray:
    return np.linspace(low, high, 80)


def _speeds_by_energy(ball: Ball, degrees: FloatArray) -> FloatArray:
    return np.asarray(frictionless_speed(PAPER_PENDULUM, np.deg2rad(degrees), ball.launch_angle))


def _figure_2(axes: Axes, ball: Ball) -> None:
    reynolds = np.logspace(3.5, 6, 400)
    for curve, style in zip(DRAG_CURVES.values(), ("-", "--", ":"), strict=True):
        inside = (reynolds >= curve.valid[0]) & (reynolds <= curve.valid[1])
        axes.plot(reynolds, np.asarray(curve(reynolds)), color=GRAY, lw=0.7, ls=style)
        colour = {"smooth": "black", "soccer": BLUE, "basketball": ORANGE}[curve.name]
        axes.plot(
            reynolds[inside],
            np.asarray(curve(reynolds[inside])),
            style,
            color=colour,
            label=curve.name,
        )
    top = PAPER_AIR.reynolds(7.0, ball.diameter)
    axes.axvspan(PAPER_AIR.reynolds(1.8, ball.diameter), top, color=GRAY, alpha=0.15, lw=0)
    axes.text(top * 0.9, 0.02, "this experiment", ha="right", color=GRAY)
    axes.set(xscale="log", xlabel="Reynolds number", ylabel="drag coefficient", ylim=(0, 0.7))
    axes.legend(loc="upper right")


def _figure_5(axes: Axes, ball: Ball) -> None:
    parameter = _grid(0.0, 0.4)
    axes.plot(parameter, np.asarray(SOCCER_LIFT(parameter, 2e5)), color=BLUE, label="soccer ball")
    axes.plot(SOCCER_LIFT.spin_parameter, SOCCER_LIFT.lift, "o", color="black", ms=4)
    axes.plot(parameter, parameter, color=GRAY, ls=":", label="C_L = Sp")
    axes.set(xlabel="spin parameter Sp = ω r / v", ylabel="lift coefficient")
    axes.legend()


def _paper_flight(ball: Ball, speed: float, kind: str) -> tuple[Experiment, FlightPath]:
    experiment = Experiment(ball)
    launch = impulsive_launch(experiment, speed, float(law_of(ball, kind)(speed)))
    angle, advance = ball.launch_angle, float(launch.advance)
    flight = fly(
        experiment.flight,
        (advance * np.cos(angle), experiment.rest_height + advance * np.sin(angle), 0.0),
        (float(launch.speed) * np.cos(angle), float(launch.speed) * np.sin(angle), 0.0),
        floor=ball.radius,
    )
    return experiment, flight


def _figure_11(axes: Axes, ball: Ball) -> None:
    experiment, flight = _paper_flight(ball, float(measured_speeds(ball.name)[3]), "variable")
    speed = np.linalg.norm(flight.velocity, axis=1)
    share = 0.5 * experiment.air.density * ball.area * SUBCRITICAL_DRAG
    axes.plot(flight.time, share * speed * flight.velocity[:, 0], color=BLUE, label="drag, x")
    axes.plot(flight.time, share * speed * flight.velocity[:, 1], color=ORANGE, label="drag, y")
    axes.axhline(ball.mass * experiment.gravity, color=GRAY, label="weight")
    axes.set(xlabel="time of flight (s)", ylabel="force (N)")
    axes.legend(loc="center right")


def _figure_12(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    speeds = _speeds_by_energy(ball, degrees)
    experiment = Experiment(ball)
    launch = impulsive_launch(experiment, speeds, np.asarray(ball.cor(speeds)))
    axes.plot(
        degrees,
        np.asarray(numerical_landing(experiment, launch).distance),
        color=BLUE,
        label="steps a to e",
    )
    some = np.linspace(25, 125, 12)
    _, landing = time_resolved_landing(experiment, _speeds_by_energy(ball, some))
    axes.plot(some, np.asarray(landing.distance), color=ORANGE, label="contact in time")
    measured = _numbers(TABLE_5[ball.name]["experiment"])
    axes.plot(_ANGLES, measured, "ko", ms=4, label="printed average")
    axes.set(xlabel="back-swing angle (deg)", ylabel="distance (m)")
    axes.legend()


def _figure_15(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    speeds = _speeds_by_energy(ball, degrees)
    after = paper_impact(Experiment(ball), speeds)
    exact = np.asarray(lost_by_pendulum(PAPER_PENDULUM, speeds, after.speed_after))
    rough = np.asarray(lost_by_pendulum_approximate(PAPER_PENDULUM, speeds, after.impulse))
    axes.plot(degrees, exact, color=BLUE, label="½ I (ω₁² − ω₂²)")
    axes.plot(degrees, rough, color=ORANGE, ls="--", label="v_M⁰ F̃ (Eqs 20, 21)")
    axes.set(xlabel="back-swing angle (deg)", ylabel="energy the pendulum loses (J)")
    axes.legend()


def _figure_16(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    speeds = _speeds_by_energy(ball, degrees)
    after = paper_impact(Experiment(ball), speeds)
    axes.plot(degrees, speeds, color=BLUE, label="before, frictionless")
    axes.plot(degrees, np.asarray(after.speed_after), color=ORANGE, label="after")
    axes.plot(_ANGLES, measured_speeds(ball.name), "ko", ms=4, label="implied by Table 6")
    axes.set(xlabel="back-swing angle (deg)", ylabel="speed of the pendulum (m/s)")
    axes.legend()


def _impulses(ball: Ball, kind: str, speeds: FloatArray) -> FloatArray:
    cor = np.asarray(law_of(ball, kind)(speeds))
    return np.asarray(external_impulse(EFFECTIVE_MASS, ball.mass, cor, speeds))


def _figure_17(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    axes.plot(degrees, _impulses(ball, "variable", _speeds_by_energy(ball, degrees)), color=BLUE)
    axes.plot(_ANGLES, _numbers(TABLE_6[ball.name]["variable"]), "ko", ms=4)
    axes.set(xlabel="back-swing angle (deg)", ylabel="external impulse (N s)")


def _implied_cor(ball: Ball) -> FloatArray:
    impulse = _numbers(TABLE_6[ball.name]["variable"])
    speeds = measured_speeds(ball.name)
    share = EFFECTIVE_MASS * ball.mass / (EFFECTIVE_MASS + ball.mass)
    return np.asarray(impulse / (share * speeds) - 1.0)


def _figure_19(axes: Axes, ball: Ball) -> None:
    degrees = _grid(25, 125)
    axes.plot(degrees, np.asarray(ball.cor(_speeds_by_energy(ball, degrees))), color=BLUE)
    axes.plot(_ANGLES, _implied_cor(ball), "ko", ms=4)
    axes.set(xlabel="back-swing angle (deg)", ylabel="coefficient of restitution")


def _figure_20(axes: Axes, ball: Ball) -> None:
    axes.plot(measured_speeds(ball.name), _implied_cor(ball), "ko-", ms=4, lw=0.8)
    axes.set(xlabel="speed of the pendulum (m/s)", ylabel="coefficient of restitution")


def _figure_21(axes: Axes, ball: Ball) -> None:
    speeds = _grid(0.0, 6.0)
    for kind in ("variable", "constant"):
        law = law_of(ball, kind)
        axes.plot(speeds, np.asarray(law(speeds)), color=_COLOURS[kind], label=f"{kind} COR")
    axes.plot(measured_speeds(ball.name), _implied_cor(ball), "ko", ms=4, label="by Table 6")
    axes.set(xlabel="speed of the pendulum (m/s)", ylabel="coefficient of restitution")
    axes.legend()


def _figure_22(axes: Axes, ball: Ball) -> None:
    for kind in ("variable", "constant"):
        for speed in measured_speeds(ball.name):
            _, flight = _paper_flight(ball, float(speed), kind)
            style = "-" if kind == "variable" else "--"
            x, y = flight.position[:, 0], flight.position[:, 1] - ball.radius
            first = f"steps a to e, {kind}" if speed == measured_speeds(ball.name)[0] else None
            axes.plot(x, y, style, color=_COLOURS[kind], lw=1.0, label=first)
        row = _numbers(TABLE_5[ball.name][kind])
        axes.plot(row, np.zeros(4), "|", color=_COLOURS[kind], ms=10, label=f"printed, {kind}")
    measured = _numbers(TABLE_5[ball.name]["experiment"])
    axes.plot(measured, np.zeros(4), "ko", ms=4, label="printed, experiment")
    axes.set(xlabel="x (m)", ylabel="height above the floor (m)", ylim=(-0.02, 0.62))
    axes.legend(loc="upper right", fontsize=8)


def _figure_23(axes: Axes, ball: Ball) -> None:
    speeds = _grid(0.2, 4.5)
    for kind, colour in _COLOURS.items():
        axes.plot(speeds, _impulses(ball, kind, speeds), color=colour, label=f"{kind} COR")
        points = _numbers(TABLE_6[ball.name][kind])
        axes.plot(measured_speeds(ball.name), points, "o", color=colour, mec="black", ms=4)
    axes.set(xlabel="collision velocity (m/s)", ylabel="external impulse (N s)")
    axes.legend()


def _figure_25(axes: Axes, ball: Ball) -> None:
    wanted = np.array(WANTED_IMPULSES[ball.name])
    impulses = np.linspace(0.3, float(wanted[-1]) * 1.1, 60)
    for kind, colour in _COLOURS.items():
        law = law_of(ball, kind)
        speeds = [speed_for(ball, law, float(j)) for j in impulses]
        axes.plot(impulses, speeds, color=colour, label=f"{kind} COR")
        points = _numbers(TABLE_7[ball.name][kind])
        axes.plot(wanted, points, "o", color=colour, mec="black", ms=4)
    axes.set(xlabel="external impulse (N s)", ylabel="collision velocity (m/s)")
    axes.legend()


def _figure_27(axes: Axes, ball: Ball) -> None:
    degrees = _grid(20, 140)
    fitted = [speed_by_rational(ball.name, float(b)) for b in degrees]
    axes.plot(degrees, fitted, color=BLUE, label="Eq. 26 or 27 as printed")
    axes.plot(degrees, _speeds_by_energy(ball, degrees), color=GRAY, ls=":", label="frictionless")
    axes.plot(_ANGLES, measured_speeds(ball.name), "ko", ms=4, label="implied by Table 6")
    axes.set(xlabel="back-swing angle (deg)", ylabel="speed before impact (m/s)")
    axes.legend()


def _figure_28(axes: Axes, ball: Ball) -> None:
    wanted = np.array(WANTED_IMPULSES[ball.name])
    impulses = np.linspace(0.6 * float(wanted[0]), float(wanted[-1]) * 1.05, 60)
    for kind, colour in _COLOURS.items():
        law = law_of(ball, kind)
        angles = [
            backswing_by_rational(ball.name, speed_for(ball, law, float(j))) for j in impulses
        ]
        axes.plot(impulses, angles, color=colour, label=f"{kind} COR")
        points = _numbers(TABLE_8[ball.name][kind])
        axes.plot(wanted, points, "o", color=colour, mec="black", ms=4)
    axes.set(xlabel="external impulse (N s)", ylabel="back-swing angle (deg)")
    axes.legend()


def _figure_30(axes: Axes, ball: Ball) -> None:
    wanted = np.array(WANTED_DISTANCES[ball.name])
    axes.plot(wanted, wanted, color=GRAY, lw=0.8, label="desired")
    axes.plot(wanted, _numbers(TABLE_10[ball.name]), "ko", ms=4, label="printed average")
    axes.set(xlabel="desired distance (m)", ylabel="distance (m)")
    axes.legend()


Painter = Callable[[Axes, Ball], None]

FIGURES: dict[str, tuple[Painter, tuple[str, ...]]] = {
    "02": (_figure_2, ("basketball",)),
    "05": (_figure_5, ("basketball",)),
    "11": (_figure_11, ("jokku",)),
    "12": (_figure_12, tuple(BALLS)),
    "15": (_figure_15, tuple(BALLS)),
    "16": (_figure_16, tuple(BALLS)),
    "17": (_figure_17, tuple(BALLS)),
    "19": (_figure_19, tuple(BALLS)),
    "20": (_figure_20, tuple(BALLS)),
    "21": (_figure_21, tuple(BALLS)),
    "22": (_figure_22, tuple(BALLS)),
    "23": (_figure_23, ("jokku",)),
    "24": (_figure_23, ("basketball",)),
    "25": (_figure_25, ("jokku",)),
    "26": (_figure_25, ("basketball",)),
    "27": (_figure_27, tuple(BALLS)),
    "28": (_figure_28, ("jokku",)),
    "29": (_figure_28, ("basketball",)),
    "30": (_figure_30, ("jokku",)),
    "31": (_figure_30, ("basketball",)),
}
"""Figure number to painter and the balls it shows. Figs 13, 14 and 18 have no printed numbers."""


def draw_figures(folder: Path, only: tuple[str, ...] = ()) -> tuple[Path, ...]:
    """Draw the figures into `folder` as PNG.

    Parameters
    ----------
    folder : Path
        Made if it does not exist.
    only : tuple of str
        Figure numbers ("05"); empty for all.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    UsageError
        If the folder can't be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise UsageError(f"can't make the folder {folder}: {problem.strerror}") from problem
    files = []
    for number, (painter, balls) in FIGURES.items():
        if only and number not in only:
            continue
        path = folder / f"figure_{number}.png"
        with saved_figure(path, width=4.8 * len(balls), height=3.4) as figure:
            panels: Any = np.ravel(figure.subplots(1, len(balls), squeeze=False))
            for axes, name in zip(panels, balls, strict=True):
                painter(axes, BALLS[name])
                if number not in ("02", "05"):
                    axes.set_title(name, fontsize=9)
        files.append(path)
    return tuple(files)


def paper_document(
    cells: tuple[Cell, ...], explanations: tuple[Explanation, ...]
) -> dict[str, Any]:
    """The contract's JSON with the candidates for Table 5 and the checks of the text added."""
    return {
        "cells": as_rows(cells),
        "table_5": [
            {
                "candidate": e.name,
                "data": e.data,
                "parameters": dict(e.parameters),
                "rms_m": e.rms,
                "largest_m": e.largest,
                "allowed": e.allowed,
                "believable_values": e.physical,
            }
            for e in explanations
        ],
        "conclusions": [asdict(conclusion) for conclusion in conclusions()],
        "swing": [asdict(check) for check in swing_checks()],
    }


def _cell_table(cells: tuple[Cell, ...], number: int, notes: list[str]) -> Table:
    table = Table(title=f"Table {number}")
    for name, justify in (("row", "left"), ("column", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for name in ("print", "ours", "difference"):
        table.add_column(name, justify="right")
    table.add_column("verdict")
    table.add_column("note", justify="right")
    for cell in cells:
        if cell.table == number:
            mark = str(notes.index(cell.note) + 1) if cell.note else ""
            table.add_row(
                cell.row,
                cell.column,
                f"{cell.printed:.6g}",
                f"{cell.ours:.6g}",
                f"{cell.difference:+.2g}",
                cell.verdict,
                mark,
            )
    return table


def _candidate_table(explanations: tuple[Explanation, ...]) -> Table:
    table = Table(title="Table 5: what could be missing")
    for name in ("data", "candidate"):
        table.add_column(name)
    for name in ("rms (mm)", "largest (mm)"):
        table.add_column(name, justify="right")
    table.add_column("verdict")
    for e in explanations:
        verdict = "allowed" if e.allowed else "excluded"
        if e.allowed and not e.physical:
            verdict = "fits, with values no lab would have"
        table.add_row(e.data, e.name, f"{e.rms * 1e3:.1f}", f"{e.largest * 1e3:.1f}", verdict)
    return table


def paper_command(
    json_to: Annotated[
        str | None,
        typer.Option("--json", help="Cells as JSON; - for stdout.", metavar="FILE"),
        FileRole.WRITES,
    ] = None,
    csv_to: Annotated[
        Path | None, typer.Option("--csv", help="Cells as CSV."), FileRole.WRITES
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Draw the figures into this folder.", metavar="DIR")
    ] = None,
    table: Annotated[int | None, typer.Option(help="Show only this table.", metavar="N")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print no tables.")] = False,
) -> None:
    """Recompute every table of the paper beside the print, and redraw its figures.

    Example: vision paper --table 6 --figures figures
    """
    cells = audit()
    if table is not None:
        if table not in {cell.table for cell in cells}:
            raise UsageError(f"there is no table {table} to recompute", hint="Tables 2 to 10.")
        cells = tuple(cell for cell in cells if cell.table == table)
    explained = table in (None, 5)
    candidates = (*investigate("simulated"), *investigate("experiment")) if explained else ()
    document = json.dumps(
        paper_document(cells, candidates), indent=2, ensure_ascii=False, allow_nan=False
    )
    if csv_to is not None:
        _write_csv(csv_to, cells)
    if figures is not None:
        draw_figures(figures)
        draw_sensitivities(figures / "sensitivity_of_cor.png")
    if json_to not in (None, "-"):
        write_text_whole(Path(str(json_to)), document + "\n")
    if json_to == "-":
        sys.stdout.write(document + "\n")
    elif not quiet:
        _show(cells, candidates)


def _write_csv(path: Path, cells: tuple[Cell, ...]) -> None:
    import pandas as pd

    write_text_whole(path, pd.DataFrame(as_rows(cells)).to_csv(index=False))


def _show(cells: tuple[Cell, ...], candidates: tuple[Explanation, ...]) -> None:
    console = screen()
    for number in sorted({cell.table for cell in cells}):
        notes = list(dict.fromkeys(c.note for c in cells if c.table == number and c.note))
        console.print(_cell_table(cells, number, notes))
        for count, note in enumerate(notes, 1):
            console.print(f"  {count}: {note}")
    if candidates:
        console.print(_candidate_table(candidates))
    for conclusion in conclusions():
        values = ", ".join(f"{name} {value:+.3f}" for name, value in conclusion.elasticity.items())
        word = "holds" if conclusion.holds else "does not hold"
        console.print(f"{conclusion.claim}: {word} ({values})")
    for check in swing_checks():
        if check.flagged:
            console.print(
                f"{check.ball}, {check.backswing_deg} deg: the measured {check.measured:.4f} m/s is"
                f" above the frictionless limit of {check.limit:.4f} m/s; it needs"
                f" {check.backswing_needed_deg:.1f} deg",
            )
    for verdict, count in Counter(cell.verdict for cell in cells).most_common():
        console.print(f"{count:4d} cells: {verdict}")


PICTURES = ("02", "05", "12", "22", "27")

"""Figures of the paper shown on the page."""


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def _audit_section(cells: tuple[Cell, ...]) -> str:
    counts = Counter((cell.table, cell.verdict) for cell in cells)
    verdicts = list(dict.fromkeys(cell.verdict for cell in cells))
    tables = sorted({cell.table for cell in cells})
    summary = _table(
        ("table", *verdicts),
        [(str(t), *(str(counts.get((t, v), 0)) for v in verdicts)) for t in tables],
    )
    parts = [summary]
    for number in tables:
        mine = [cell for cell in cells if cell.table == number]
        rows = [
            (
                cell.row,
                cell.column,
                f"{cell.printed:.6g}",
                f"{cell.ours:.5g}",
                f"{cell.difference:+.2g}",
                cell.verdict,
                cell.note,
            )
            for cell in mine
        ]
        header = ("row", "column", "print", "ours", "difference", "verdict", "note")
        parts.append(f"#### Table {number}\n\n{_table(header, rows)}")
    return "\n\n".join(parts)


def _candidates_section() -> str:
    rows = []
    for data in ("simulated", "experiment"):
        for e in investigate(data):
            if not e.allowed:
                verdict = "excluded"
            else:
                verdict = "allowed" if e.physical else "fits, with values no lab would have"
            count = str(len(e.parameters))
            rows.append(
                (data, e.name, count, f"{e.rms * 1e3:.1f}", f"{e.largest * 1e3:.1f}", verdict)
            )
    allowance = ", ".join(f"{name} {value * 1e3:.0f} mm" for name, value in ALLOWANCE.items())
    header = ("distances", "candidate", "free numbers", "rms (mm)", "largest (mm)", "verdict")
    return f"Largest miss allowed: {allowance}.\n\n{_table(header, rows)}"


def _launch_section() -> str:
    rows = []
    for name in BALLS:
        constant, turned = contact_candidate(name)
        for speed, fixed, angle in zip(measured_speeds(name), constant, turned, strict=True):
            rows.append((name, f"{speed:.3f}", f"{fixed:.1f}", f"{angle:.1f}"))
    header = ("ball", "impact speed (m/s)", "paper's launch angle (deg)", "contact in time (deg)")
    return _table(header, rows)


def _conclusions_section() -> str:
    rows = [
        (
            c.claim,
            *(f"{c.elasticity[name]:+.3f}" for name in BALLS),
            "holds" if c.holds else "does not hold",
        )
        for c in conclusions()
    ]
    return _table(("claim", *BALLS, "verdict"), rows)


def _swing_section() -> str:
    rows = [
        (
            check.ball,
            str(check.backswing_deg),
            f"{check.measured:.4f}",
            f"{check.measured / check.limit:.4f}",
            f"{check.backswing_needed_deg:.1f}",
            "too fast" if check.flagged else "",
        )
        for check in swing_checks()
    ]
    header = ("ball", "back-swing (deg)", "speed (m/s)", "of the limit", "needs (deg)", "flag")
    return _table(header, rows)


def _fits_section() -> str:
    rows = []
    for name in BALLS:
        for fit in implied_fits(name):
            values = ", ".join(
                f"{p.name} {p.value:.4f} ({p.low:.4f} to {p.high:.4f})" for p in fit.parameters
            )
            rows.append(
                (name, fit.model, values, str(fit.dof), f"{fit.chi2:.3g}", f"{fit.bic:.4g}")
            )
    return _table(("ball", "law", "parameters (95 %)", "dof", "χ²", "BIC"), rows)


def sections() -> dict[str, str]:
    """All generated parts by the name in their markers."""
    return {
        "launch": _launch_section(),
        "conclusions": _conclusions_section(),
        "fits": _fits_section(),
        "swing": _swing_section(),
        "table-5": _candidates_section(),
        "audit": _audit_section(audit()),
    }


def filled(text: str, parts: dict[str, str]) -> str:
    """`text` with what stands between ``<!-- NAME:begin -->`` and ``<!-- NAME:end -->`` replaced.

    Raises
    ------
    UsageError
        If a marker is missing.
    """
    for name, part in parts.items():
        pattern = re.compile(f"(<!-- {name}:begin -->).*?(<!-- {name}:end -->)", re.DOTALL)
        found = pattern.search(text)
        if found is None:
            raise UsageError(f"the page has no place for {name!r}")
        begin, end = (f"<!-- {name}:{edge} -->" for edge in ("begin", "end"))
        text = "".join((text[: found.start()], begin, "\n", part, "\n", end, text[found.end() :]))
    return text


def refresh(page: Path) -> None:
    """Fill the page's generated parts and draw its pictures beside it."""
    write_text_whole(page, filled(page.read_text(encoding="utf-8"), sections()))
    folder = page.parent / "pictures"
    for path in draw_figures(folder, only=PICTURES):
        path.replace(folder / f"model_{path.name}")
    draw_sensitivities(folder / "model_sensitivity.png")


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    refresh(Path(sys.argv[1]))
