"""The strike of ``../shared/inputs`` as further programs write its positions."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

__all__ = ["REFUSED_TABLES", "TABLES", "Strike", "strike_text"]

FloatArray = NDArray[np.float64]

_STRIKE = Path(os.environ.get("IMPACT_VISION_SHARED", "../shared")) / "inputs"


def _lines(columns: Sequence[FloatArray], mark: str = "\t", decimal: str = ".") -> str:
    rows = (
        mark.join("" if np.isnan(v) else f"{v:.5f}".replace(".", decimal) for v in row)
        for row in zip(*columns, strict=True)
    )
    return "\n".join(rows) + "\n"


def _names(mark: str, *lines: Sequence[str]) -> str:
    return "".join(mark.join(line) + "\n" for line in lines)


class Strike:
    """Frames from 0, times in s, and positions of mass and ball in m, x right and y up."""

    def __init__(self) -> None:
        table = pd.read_csv(_STRIKE / "r16_wide_two_objects.csv")
        self.frame = np.arange(len(table), dtype=float)
        self.time = self.frame / 600.0
        columns = np.asarray(table, dtype=float).T
        self.mass, self.ball = columns[1:3], columns[3:5]

    def in_space(self, up: str, metre: float = 1000.0) -> tuple[FloatArray, ...]:
        """Ball and mass in space, in mm unless said otherwise."""
        deep = np.full(len(self.time), 0.012)
        return tuple(
            metre * one
            for x, y in (self.ball, self.mass)
            for one in ((x, deep, y) if up == "z" else (x, y, deep))
        )


def _qualisys(strike: Strike) -> str:
    axes = [f"{name} {axis}" for name in ("ball", "mass") for axis in "XYZ"]
    head = f"NO_OF_FRAMES\t{len(strike.time)}\nFREQUENCY\t600\nMARKER_NAMES\tball\tmass\n"
    head += _names("\t", ["Frame", "Time", *axes])
    return head + _lines((strike.frame + 1.0, strike.time, *strike.in_space("z")))


def _opensim(strike: Strike) -> str:
    head = _names(
        "\t",
        ["PathFileType", "4", "(X/Y/Z)", "strike.trc"],
        ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigNumFrames"],
        ["600", "600", str(len(strike.time)), "2", "mm", str(len(strike.time))],
        ["Frame#", "Time", "ball", "", "", "mass", "", ""],
        ["", "", "X1", "Y1", "Z1", "X2", "Y2", "Z2"],
    )
    return head + "\n" + _lines((strike.frame + 1.0, strike.time, *strike.in_space("y")))


def _optitrack(strike: Strike) -> str:
    head = "Format Version,1.23,Capture Frame Rate,600.0,Length Units,Meters\n\n" + _names(
        ",",
        ["", "", *["Marker"] * 6],
        ["", "", *["ball"] * 3, *["mass"] * 3],
        ["", "", *["3A"] * 3, *["3B"] * 3],
        ["", "", *["Position"] * 6],
        ["Frame", "Time (Seconds)", *"XYZXYZ"],
    )
    return head + _lines((strike.frame, strike.time, *strike.in_space("y", 1.0)), ",")


def _labview(strike: Strike) -> str:
    count = str(len(strike.time))
    head = _names(
        "\t",
        ["LabVIEW Measurement", ""],
        ["Separator", "Tab"],
        ["Decimal_Separator", "."],
        ["Date", "2024/05/14"],
        ["***End_of_Header***", ""],
        ["Channels", "2", ""],
        ["Samples", count, count],
        ["Date", "2024/05/14", "2024/05/14"],
        ["Y_Unit_Label", "m", "m"],
        ["X_Dimension", "Time", "Time"],
        ["X0", "0", "0"],
        ["***End_of_Header***", "", ""],
        ["Time", "ball x", "ball y"],
    )
    return head + _lines((strike.time, *strike.ball))


def _pymecavideo(strike: Strike) -> str:
    head = "# pymecavideo\n# video = D:/tp/choc.avi\n# t1 = 0.0\n#t\tX1\tY1\n"
    return head + _lines((strike.time, *strike.ball), decimal=",")


def _regressi(strike: Strike) -> str:
    head = "EVARISTE REGRESSI WINDOWS 1.0\n£3 NOM VAR\nt\nX\nY\n£3 UNITE VAR\ns\nm\nm\n"
    head += f"&{len(strike.time)} VALEUR VAR\n"
    return head + _lines((strike.time, *strike.ball), " ")


def _pages(strike: Strike) -> str:
    """A table on pages: its header stands above each of them."""
    head, half = "t (s),x (m),y (m)\n", len(strike.time) // 2
    columns = (strike.time, *strike.ball)
    return "".join(
        head + _lines([one[part] for one in columns], ",")
        for part in (slice(half), slice(half, None))
    )


def _russian(strike: Strike) -> str:
    head = "Время, с;Координата x, м;Координата y, м\n"
    return head + _lines((strike.time, *strike.ball), ";", ",")


def _markdown(strike: Strike) -> str:
    head = "| t (s) | x (m) | y (m) |\n|---|---|---|\n"
    body = _lines((strike.time, *strike.ball), " | ")
    return head + "".join(f"| {line} |\n" for line in body.splitlines())


TABLES: dict[str, Callable[[Strike], str]] = {
    "Qualisys, z up": _qualisys,
    "OpenSim TRC": _opensim,
    "OptiTrack": _optitrack,
    "LabVIEW": _labview,
    "pymecavideo": _pymecavideo,
    "Regressi": _regressi,
    "a header on each page": _pages,
    "Russian heads": _russian,
    "Markdown": _markdown,
}
"""Tables that come out right, by the program."""


def _phyphox(strike: Strike) -> str:
    heads = [f'"Linear Acceleration {axis} (m/s^2)"' for axis in "xyz"]
    head = _names(",", ['"Time (s)"', *heads])
    return head + _lines((strike.time, *strike.ball, strike.time), ",")


def _bare_markers(strike: Strike) -> str:
    head = "NO_OF_FRAMES\t303\nFREQUENCY\t600\nMARKER_NAMES\tball\tmass\n"
    return head + _lines(strike.in_space("z"))


REFUSED_TABLES: dict[str, tuple[Callable[[Strike], str], str]] = {
    "phyphox, accelerations": (_phyphox, "holds no positions"),
    "Qualisys without heads": (_bare_markers, "Write a name above every column"),
}
"""Tables that do not hold what is needed, and the cure."""


def strike_text(write: Callable[[Strike], str]) -> str:
    """The strike as a program writes it."""
    return write(Strike())
