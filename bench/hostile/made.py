"""The mistakes: what a person types, the cause, and the cure that the message must state."""

import os
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["BASE_CLIP", "LAB", "MISTAKES", "Mistake"]

_HOSTILE_SHARED = Path(os.environ.get("IMPACT_VISION_SHARED", "../shared")).resolve() / "inputs"

BASE_CLIP, LAB = _HOSTILE_SHARED / "base_strike.mkv", _HOSTILE_SHARED / "lab.toml"


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    Attributes
    ----------
    words : tuple of str
        Of the command; ``{clip}`` and ``{lab}`` are the strike and its set-up.
    cause : str
        Pattern of the first message.
    option : str
        Option whose stated value is the cure.
    line : tuple of str
        File ("" for the command), wrong text and right text, which the message must state.
    """

    kind: str
    name: str
    words: tuple[str, ...]
    cause: str
    option: str = ""
    line: tuple[str, str, str] = ("", "", "")
    files: Mapping[str, str] = field(default_factory=dict)


_FILM = ("measure", "{clip}", "--setup", "{lab}", "--quiet")
_SIMULATE = ("simulate", "--backswing", "90 deg", "--setup", "s.toml")


def _options() -> Iterator[Mistake]:
    wrong = (
        ("30 fps for 600", "--fps", "30", "capture rate"),
        ("300 fps for 600", "--fps", "300", "capture rate"),
        ("6000 fps for 600", "--fps", "6000", "capture rate"),
        ("grid of 40 mm for 50", "--wall-grid", "40mm", "wall grid"),
        ("grid of 100 mm for 50", "--wall-grid", "100mm", "wall grid"),
        ("grid of 5 mm for 50", "--wall-grid", "5mm", "wall grid"),
        ("the ball's radius", "--ball", "101mm", "diameter|ball"),
        ("the ball's girth", "--ball", "634mm", "diameter|ball"),
    )
    for name, option, value, cause in wrong:
        film = ("measure", "{clip}", "--setup", "{lab}")
        fps = () if option == "--fps" else ("--fps", "600")
        yield Mistake("Sizes and rates", name, (*film, *fps, option, value), cause, option)
    yield Mistake("Sizes and rates", "camera's tape 1.6 m short",
                  ("measure", "{clip}", "--setup", "s.toml", "--fps", "600"), "distances",
                  files={"s.toml": LAB.read_text().replace("4.601", "3.0")})  # fmt: skip
    typed = (
        ("no unit of the grid", ("--wall-grid", "50"), "unit|50 ?m|grid", ""),
        ("a rate in mm", ("--fps", "600 mm"), "fps|rate", ""),
        ("a ball of another name", ("--ball", "jocku"), "jocku", ("", "jocku", "jokku")),
        ("a ball without unit", ("--ball", "201.75"), "201.75", ""),
        ("a point of one number", ("--ball-at", "12"), "ball-at", ""),
        ("two scales", ("--scale", "1 mm/px", "--wall-grid", "50mm"), "both", ""),
        ("an option misspelled", ("--wallgrid", "50mm"), "wallgrid",
         ("", "--wallgrid", "--wall-grid")),
        ("an unknown ending of the plot", ("--plot", "a.jpeg2"), "plot", ""),
        ("a folder that does not exist", ("--csv", "no/such.csv"), "no", ""),
    )  # fmt: skip
    for name, more, cause, line in typed:
        fps = () if "--fps" in more else ("--fps", "600")
        yield Mistake("What is typed", name, (*_FILM, *fps, *more), cause,
                      line=line or ("", "", ""))  # fmt: skip
    yield Mistake("What is typed", "a command misspelled", ("mesure", "{clip}"), "mesure",
                  line=("", "mesure", "measure"))  # fmt: skip
    yield Mistake("What is typed", "a clip that does not exist", ("measure", "clp.mp4"), "clp.mp4")
    yield Mistake("What is typed", "a text as clip", ("measure", "a.mp4"), "a.mp4",
                  files={"a.mp4": "not a film"})  # fmt: skip
    yield Mistake("What is typed", "an angle without number",
                  ("simulate", "--backswing", "steep"), "backswing")  # fmt: skip
    yield Mistake("What is typed", "an angle without unit", ("simulate", "--backswing", "90"),
                  "degrees", line=("", "90", "90 deg"))  # fmt: skip
    yield Mistake("What is typed", "a distance out of reach", ("plan", "--distance", "90m"),
                  "reach|distance")  # fmt: skip
    yield Mistake("What is typed", "a file for a campaign's folder",
                  ("campaign", "{clip}", "--out", "res.csv"), "name of a file")  # fmt: skip


def _setups() -> Iterator[Mistake]:
    good = '[ball]\npreset = "jokku"\n[support]\nheight = "0.312 m"\n'
    wrong = (
        ("an unknown key", "height =", "hight =", "hight", ("s.toml", "hight", "height")),
        ("an unknown table", "[support]", "[suport]", "suport", ("s.toml", "suport", "support")),
        ("a ball misspelled", "jokku", "jocku", "jocku", ("s.toml", "jocku", "jokku")),
        ("no unit", '"0.312 m"', "312", "height", ""),
        ("a unit of mass for a height", "0.312 m", "0.312 kg", "height", ""),
        ("an unknown unit", "0.312 m", "0.312 metter", "height", ""),
        ("a negative height", "0.312 m", "-0.312 m", "height", ""),
        ("a missing quotation mark", '"0.312 m"', '"0.312 m', "line 4",
         ("s.toml", '"0.312 m', '"0.312 m"')),
        ("a value without quotation marks", '"0.312 m"', "0.312 m", "line 4",
         ("s.toml", "0.312 m", '"0.312 m"')),
        ("a key twice", "[support]", '[support]\nheight = "0.3 m"', "height|line", ""),
        ("the grid in the wrong table", "[support]", '[camera]\ngrid = "50 mm"\n[support]',
         r"belongs in the table \[wall\]", ""),
        ("words for a number", "0.312 m", "about a foot", "height", ""),
        ("an uncertainty without number", "0.312 m", "0.312 m ± some", "height", ""),
        ("typographic quotation marks", '"0.312 m"', "“0.312 m”", "straight",
         ("s.toml", "“0.312 m”", '"0.312 m"')),
        ("a colon for the sign", 'height = "0.312 m"', "height: 0.312 m", "height",
         ("s.toml", "height: 0.312 m", 'height = "0.312 m"')),
        ("a comment of C", "[support]", "// lab\n[support]", "comment",
         ("s.toml", "// lab", "# lab")),
        ("a table with a capital", "[support]", "[Support]", "nearest is 'support'",
         ("s.toml", "Support", "support")),
        ("a French key", "height =", "hauteur =", "nearest is 'height'",
         ("s.toml", "hauteur", "height")),
        ("a comma before three digits", "0.312 m", "31,200 cm", "decimals or thousands",
         ("s.toml", "31,200 cm", "31.200 cm")),
    )  # fmt: skip
    for name, old, new, cause, line in wrong:
        yield Mistake("Set-up file", name, _SIMULATE, cause, line=line or ("", "", ""),
                      files={"s.toml": good.replace(old, new)})  # fmt: skip
    yield Mistake("Set-up file", "a decimal comma is read", _SIMULATE, "", files={
        "s.toml": good.replace("0.312 m", "0,312 m")})  # fmt: skip
    yield Mistake("Set-up file", "a set-up that does not exist",
                  (*_SIMULATE[:-1], "no.toml"), "no.toml")  # fmt: skip


def _thrown(unit: float = 1.0, second: float = 1.0) -> list[tuple[float, float, float]]:
    rows, noise = [], random.Random(1)
    for number in range(120):
        t = number / 240.0
        x, y = 0.3 + 2.1 * t, 0.4 + 2.6 * t - 4.9 * t * t
        x, y = x + noise.gauss(0.0, 5e-4), y + noise.gauss(0.0, 5e-4)
        rows.append((t * second, x * unit, y * unit))
    return rows


def _table(head: str, rows: list[tuple[float, float, float]], order: str = "txy") -> str:
    lines = [head]
    for t, x, y in rows:
        cells = {"t": t, "x": x, "y": y}
        lines.append(",".join(f"{cells[letter]:.6g}" for letter in order))
    return "\n".join(lines) + "\n"


def _tables() -> Iterator[Mistake]:
    read = ("measure", "--from-tracks", "t.csv", "--ball", "220 mm")
    good = _table("t,x,y", _thrown())
    lines = good.splitlines()
    wrong = (
        ("centimetres without a unit", _table("t,x,y", _thrown(100.0)), "unit is cm", "--columns"),
        ("millimetres without a unit", _table("t,x,y", _thrown(1e3)), "unit is mm", "--columns"),
        ("inches without a unit", _table("t,x,y", _thrown(1 / 0.0254)), "unit is in", "--columns"),
        ("milliseconds without a unit", _table("t,x,y", _thrown(1.0, 1e3)), "and ms", "--columns"),
        ("x and y exchanged", _table("t,x,y", _thrown(), "tyx"), "exchanged|swapped", "--columns"),
        ("metres called centimetres", _table("t (s),x (cm),y (cm)", _thrown()), "cm|unit", ""),
        ("no column of time", _table("x,y", _thrown(), "xy"), "column found for t\\b", ""),
        ("no column of positions", _table("t", _thrown(), "t"), "x|position", ""),
        ("columns without names", "\n".join(lines[1:]) + "\n", "name|header|column", ""),
        ("words in a row", "\n".join([*lines[:40], "lost,ball,here", *lines[41:]]), "row", ""),
        ("a quotation mark that is not closed",
         "\n".join([*lines[:9], '"' + lines[9], *lines[10:]]), "line 10", ""),
        ("only three rows", "\n".join(lines[:4]) + "\n", "few|rows|points", ""),
        ("an empty file", "", "empty", ""),
        ("times that run backwards", "\n".join([lines[0], *reversed(lines[1:])]) + "\n",
         "backward|order|increas", ""),
    )  # fmt: skip
    for name, text, cause, option in wrong:
        yield Mistake("Tables of tracks", name, read, cause, option, files={"t.csv": text})
    yield Mistake("Tables of tracks", "a column that does not exist", (*read, "--columns", "x=X1"),
                  "X1", files={"t.csv": good})  # fmt: skip
    yield Mistake("Tables of tracks", "a semicolon table with decimal commas is read", read, "",
                  files={"t.csv": good.replace(",", ";").replace(".", ",")})  # fmt: skip


def _books() -> Iterator[Mistake]:
    run = ("campaign", "{clip}", "--trials", "b.csv", "--out", "out")
    wrong = (
        ("no column clip", "what,ball\nbase_strike.mkv,jokku\n", "clip"),
        ("a sensor without unit", "clip,landing_tape\nbase_strike.mkv,1.9\n", "unit"),
        ("a clip twice", "clip,ball\nbase_strike.mkv,jokku\nbase_strike,jokku\n", "twice|line"),
        ("a word for an angle", "clip,backswing_deg\nbase_strike.mkv,steep\n", "line 2"),
        ("an unknown ball", "clip,ball\nbase_strike.mkv,jocku\n", "jocku"),
        ("a landing in millimetres", "clip,landing_tape_m\nbase_strike.mkv,1937\n", "line 2"),
    )
    for name, text, cause in wrong:
        yield Mistake("Lab book", name, run, cause, files={"b.csv": text})


MISTAKES = (*_options(), *_setups(), *_tables(), *_books())
"""All of them."""
