"""The paper's figures that can be drawn from what it prints: ours as lines, the print as points."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from metrology import UsageError
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
from pipelines.model.simulate import BLUE, GRAY, ORANGE, saved_figure
from pipelines.paper import printed
from pipelines.paper.audit import (
    EFFECTIVE_MASS,
    backswing_by_rational,
    law_of,
    measured_speeds,
    speed_by_rational,
    speed_for,
)

__all__ = ["FIGURES", "draw_figures"]

_COLOURS = {"variable": BLUE, "constant": ORANGE}
_ANGLES = np.array(printed.BACKSWINGS_DEG, dtype=np.float64)


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
    measured = _numbers(printed.TABLE_5[ball.name]["experiment"])
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
    axes.plot(_ANGLES, _numbers(printed.TABLE_6[ball.name]["variable"]), "ko", ms=4)
    axes.set(xlabel="back-swing angle (deg)", ylabel="external impulse (N s)")


def _implied_cor(ball: Ball) -> FloatArray:
    impulse = _numbers(printed.TABLE_6[ball.name]["variable"])
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
        row = _numbers(printed.TABLE_5[ball.name][kind])
        axes.plot(row, np.zeros(4), "|", color=_COLOURS[kind], ms=10, label=f"printed, {kind}")
    measured = _numbers(printed.TABLE_5[ball.name]["experiment"])
    axes.plot(measured, np.zeros(4), "ko", ms=4, label="printed, experiment")
    axes.set(xlabel="x (m)", ylabel="height above the floor (m)", ylim=(-0.02, 0.62))
    axes.legend(loc="upper right", fontsize=8)


def _figure_23(axes: Axes, ball: Ball) -> None:
    speeds = _grid(0.2, 4.5)
    for kind, colour in _COLOURS.items():
        axes.plot(speeds, _impulses(ball, kind, speeds), color=colour, label=f"{kind} COR")
        points = _numbers(printed.TABLE_6[ball.name][kind])
        axes.plot(measured_speeds(ball.name), points, "o", color=colour, mec="black", ms=4)
    axes.set(xlabel="collision velocity (m/s)", ylabel="external impulse (N s)")
    axes.legend()


def _figure_25(axes: Axes, ball: Ball) -> None:
    wanted = np.array(printed.WANTED_IMPULSES[ball.name])
    impulses = np.linspace(0.3, float(wanted[-1]) * 1.1, 60)
    for kind, colour in _COLOURS.items():
        law = law_of(ball, kind)
        speeds = [speed_for(ball, law, float(j)) for j in impulses]
        axes.plot(impulses, speeds, color=colour, label=f"{kind} COR")
        points = _numbers(printed.TABLE_7[ball.name][kind])
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
    wanted = np.array(printed.WANTED_IMPULSES[ball.name])
    impulses = np.linspace(0.6 * float(wanted[0]), float(wanted[-1]) * 1.05, 60)
    for kind, colour in _COLOURS.items():
        law = law_of(ball, kind)
        angles = [
            backswing_by_rational(ball.name, speed_for(ball, law, float(j))) for j in impulses
        ]
        axes.plot(impulses, angles, color=colour, label=f"{kind} COR")
        points = _numbers(printed.TABLE_8[ball.name][kind])
        axes.plot(wanted, points, "o", color=colour, mec="black", ms=4)
    axes.set(xlabel="external impulse (N s)", ylabel="back-swing angle (deg)")
    axes.legend()


def _figure_30(axes: Axes, ball: Ball) -> None:
    wanted = np.array(printed.WANTED_DISTANCES[ball.name])
    axes.plot(wanted, wanted, color=GRAY, lw=0.8, label="desired")
    axes.plot(wanted, _numbers(printed.TABLE_10[ball.name]), "ko", ms=4, label="printed average")
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
