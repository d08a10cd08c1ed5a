"""Damage sound campaigns as users do and check the engine's answers.

Required: no traceback, a documented exit code, and no name with a probability above 0.5.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from typer.testing import CliRunner

from bench.concealed.campaign import perform
from bench.concealed.sample import PAPER_LAB
from bench.concealed.world.design import Noise, draw_design
from bench.real.made import SwingRig, write_swings
from pipelines.cli import app

__all__ = ["DAMAGES", "SOUND", "Files", "Outcome", "explained"]

MAX_PROBABILITY = 0.5
"""Largest probability of a name in a damaged campaign."""

CODES = (0, 2, 3, 4)
"""Documented exit codes without 1, which reports a bug."""

Bytes = Callable[[str], bytes]


@dataclass(frozen=True)
class Files:
    """Two tables and a setup file; `written` formats a table as text."""

    ball: pd.DataFrame | None
    pendulum: pd.DataFrame | None
    setup: str
    written: Bytes = field(default=lambda text: text.encode())
    separator: str = ","
    decimal: str = "."

    def change(self, change: Callable[[pd.DataFrame], pd.DataFrame]) -> "Files":
        """Both tables with the same change."""
        return replace(
            self,
            ball=None if self.ball is None else change(self.ball.copy()),
            pendulum=None if self.pendulum is None else change(self.pendulum.copy()),
        )

    def like(self, other: "Files") -> bool:
        """Whether the other files have the same contents."""
        tables = ((self.ball, other.ball), (self.pendulum, other.pendulum))
        same = all(a is b or (a is not None and a.equals(b)) for a, b in tables)
        ways = (self.written, self.separator, self.decimal, self.setup)
        return same and ways == (other.written, other.separator, other.decimal, other.setup)

    def write(self, folder: Path) -> list[str]:
        """Write the files into a folder; returns the arguments of `vision explain`."""
        arguments = ["explain"]
        for name, table in (("ball.csv", self.ball), ("pendulum.csv", self.pendulum)):
            if table is None:
                continue
            text = table.to_csv(
                index=False, sep=self.separator, decimal=self.decimal, lineterminator="\n"
            )
            (folder / name).write_bytes(self.written(text))
            arguments += [] if name == "ball.csv" else ["--pendulum"]
            arguments.append(str(folder / name))
        (folder / "setup.toml").write_text(self.setup, encoding="utf-8")
        return [*arguments, "--setup", str(folder / "setup.toml")]


@dataclass(frozen=True)
class Outcome:
    """Outcome of a damaged campaign."""

    code: int
    verdict: str
    named: Mapping[str, float]
    said: str
    raised: str = ""

    @property
    def fails(self) -> str:
        """The violated requirement; empty if there is none."""
        if self.code not in CODES or self.raised:
            return "traceback"
        if any(p > MAX_PROBABILITY for p in self.named.values()):
            return "confident name"
        return ""


def explained(files: Files, folder: Path, more: tuple[str, ...] = ()) -> Outcome:
    """Run `vision explain` on the files."""
    out = folder / "verdict.json"
    out.unlink(missing_ok=True)
    result = CliRunner().invoke(app, [*files.write(folder), "--json", str(out), "--quiet", *more])
    wild = result.exception if not isinstance(result.exception, SystemExit | None) else None
    raw = json.loads(out.read_text(encoding="utf-8")) if out.exists() else {}
    named = {effect["id"]: float(effect["probability"]) for effect in raw.get("effects", ())}
    notes = "; ".join(raw.get("notes", ()))
    said = " ".join((result.stderr or "").split()) if result.exit_code else notes
    return Outcome(
        result.exit_code, str(raw.get("verdict", "refused")), named, said,
        repr(wild) if wild else "",
    )  # fmt: skip


def _struck(folder: Path) -> Files:
    rng = np.random.default_rng(12)
    design = draw_design(rng, PAPER_LAB)
    trials = 6
    timing = tuple(design.timing[i % len(design.timing)] for i in range(trials))
    design = replace(
        design, ball_of_trial=(0,) * trials, backswing_deg=np.array([30.0, 60.0, 90.0] * 2),
        timing=timing, fps=600.0, rest_frames=6, swing_seconds=0.2, follow_seconds=0.12,
        noise=Noise(0.001, 0.001, 0.0, 0.006, 0.0, 0.0, 1.0),
    )  # fmt: skip
    perform(rng, design, [], folder)
    tables = [pd.read_csv(folder / name) for name in ("ball.csv", "pendulum.csv")]
    return Files(*tables, (folder / "setup.toml").read_text(encoding="utf-8"))


def _thrown(_: Path) -> Files:
    rng = np.random.default_rng(2)
    t = np.round(np.arange(0.0, 0.6, 1.0 / 240.0), 6)
    parts = []
    for number in range(6):
        noise = 5e-4 * rng.standard_normal((2, t.size))
        x, y = (2.0 + 0.3 * number) * t, 1.5 + 2.0 * t - 0.5 * 9.80665 * t**2
        parts.append(
            pd.DataFrame({"trial": number, "t_s": t, "x_m": x + noise[0], "y_m": y + noise[1]})
        )
    setup = '[ball]\nmass = "0.5 kg"\ndiameter = "50 mm"\n[model]\neffects = ["gravity"]\n'
    return Files(pd.concat(parts, ignore_index=True).round(5), None, setup)


LOSSLESS = SwingRig(
    0.94, 0.94, 0.0, 0.0, 0.0, 0.0, 0.001, 1e-5, 60.0, 6.0, (0.42, 0.86, -0.69, 0.25)
)


def _swung(folder: Path) -> Files:
    write_swings(LOSSLESS, folder)
    swings = pd.read_csv(folder / "pendulum.csv")
    return Files(None, swings, (folder / "setup.toml").read_text(encoding="utf-8"))


SOUND: Mapping[str, Callable[[Path], Files]] = {
    "struck": _struck, "thrown": _thrown, "swung": _swung,
}  # fmt: skip
"""Campaigns without missing physics: strikes, free flights, free swings."""

VALUES = ("x_m", "y_m", "phi_rad")


def _values(table: pd.DataFrame) -> list[str]:
    return [name for name in VALUES if name in table]


def _each(table: pd.DataFrame, change: Callable[[pd.DataFrame, int], pd.DataFrame]) -> pd.DataFrame:
    """Change every trial separately."""
    parts = [change(part.copy(), k) for k, (_, part) in enumerate(table.groupby("trial"))]
    return pd.concat(parts, ignore_index=True)


def _all(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Callable[[Files], Files]:
    return lambda files: files.change(change)


def _by_trial(change: Callable[[pd.DataFrame, int], pd.DataFrame]) -> Callable[[Files], Files]:
    return lambda files: files.change(lambda table: _each(table, change))


def _shuffled(table: pd.DataFrame, number: int) -> pd.DataFrame:
    rng = np.random.default_rng(number)
    table[_values(table)] = table[_values(table)].to_numpy()[rng.permutation(len(table))]
    return table


def _noise(table: pd.DataFrame, number: int) -> pd.DataFrame:
    rng = np.random.default_rng(number)
    for name in _values(table):
        table[name] = rng.normal(table[name].mean(), table[name].std(), len(table)).round(6)
    return table


def _walk(table: pd.DataFrame, number: int) -> pd.DataFrame:
    rng = np.random.default_rng(number)
    for name in _values(table):
        steps = rng.normal(0.0, table[name].std() / np.sqrt(len(table)), len(table))
        table[name] = (table[name].iloc[0] + np.cumsum(steps)).round(6)
    return table


def _constant(table: pd.DataFrame, number: int) -> pd.DataFrame:
    for name in _values(table):
        table[name] = table[name].iloc[0]
    return table


def _circle(table: pd.DataFrame, number: int) -> pd.DataFrame:
    turn = 9.0 * (table["t_s"] - table["t_s"].iloc[0]) + number
    shapes = {"x_m": 0.4 * np.cos(turn), "y_m": 1.0 + 0.4 * np.sin(turn), "phi_rad": turn}
    for name in _values(table):
        table[name] = shapes[name].round(5)
    return table


def _over_the_top(table: pd.DataFrame, number: int) -> pd.DataFrame:
    if "phi_rad" in table:
        turn = 7.0 * (table["t_s"] - table["t_s"].iloc[0]) + number
        turn = turn + 0.3 * np.sin(turn)
        table["phi_rad"] = ((turn + np.pi) % (2 * np.pi) - np.pi).round(5)
    return table


def _degrees(table: pd.DataFrame) -> pd.DataFrame:
    if "phi_rad" in table:
        table["phi_rad"] = np.degrees(table["phi_rad"]).round(4)
    return table


def _small_degrees(table: pd.DataFrame) -> pd.DataFrame:
    if "phi_rad" in table:
        # Swings of about one degree, written in degrees.
        table["phi_rad"] = (table["phi_rad"] * 2.0).round(4)
    return table


def _gaps(table: pd.DataFrame, number: int) -> pd.DataFrame:
    since = table["t_s"] - table["t_s"].iloc[0]
    span = 0.95 if len(table) > 200 and since.max() > 3.0 else 0.3 * since.max()
    lost = (since > 0.35 * since.max()) & (since < 0.35 * since.max() + span)
    return table[~lost]


def _doubled_clock(table: pd.DataFrame, number: int) -> pd.DataFrame:
    table["t_s"] = np.repeat(table["t_s"].to_numpy()[: (len(table) + 1) // 2], 2)[: len(table)]
    return table


def _one_name(table: pd.DataFrame) -> pd.DataFrame:
    table["t_s"] = table["t_s"] + 1e-5 * table["trial"].astype(int)
    table["trial"] = 1
    return table.sort_values("t_s")


def _alternate(table: pd.DataFrame, change: Callable[[pd.DataFrame], None]) -> pd.DataFrame:
    def one(part: pd.DataFrame, number: int) -> pd.DataFrame:
        if number % 2:
            change(part)
        return part

    return _each(table, one)


def _other_pendulum(table: pd.DataFrame) -> None:
    table["t_s"] = table["t_s"].iloc[0] + 0.55 * (table["t_s"] - table["t_s"].iloc[0])


def _other_gravity(table: pd.DataFrame) -> None:
    since = table["t_s"] - table["t_s"].iloc[0]
    if "y_m" in table:
        table["y_m"] = table["y_m"] + 0.5 * (9.8 - 1.6) * since**2


def _mixed_swings(files: Files) -> Files:
    if files.ball is None or "backswing_deg" not in files.ball:
        return files
    names = files.ball["trial"].unique()
    stated = files.ball.groupby("trial")["backswing_deg"].first()
    moved = dict(zip(names, np.roll(stated.to_numpy(), 1), strict=True))
    return replace(files, ball=files.ball.assign(backswing_deg=files.ball["trial"].map(moved)))


def _changing_swing(files: Files) -> Files:
    if files.ball is None or "backswing_deg" not in files.ball:
        return files
    ball = files.ball.copy()
    ball["backswing_deg"] = np.where(np.arange(len(ball)) % 2 == 0, ball["backswing_deg"], 45.0)
    return replace(files, ball=ball)


def _with(column: str, value: object, every: int = 1) -> Callable[[Files], Files]:
    """A column of the tables overwritten in every n-th row."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        if column in table:
            table[column] = table[column].astype(object)
            table.loc[table.index[::every], column] = value
        return table

    return _all(change)


def _added(column: str, value: object) -> Callable[[Files], Files]:
    return lambda files: (
        files if files.ball is None else replace(files, ball=files.ball.assign(**{column: value}))
    )


def _scaled(columns: tuple[str, ...], factor: float) -> Callable[[Files], Files]:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        for name in columns:
            if name in table:
                table[name] = table[name] * factor
        return table

    return _all(change)


def _renamed(old: str, new: str, factor: float) -> Callable[[Files], Files]:
    def change(table: pd.DataFrame) -> pd.DataFrame:
        if old in table:
            table[old] = (table[old] * factor).round(6)
        return table.rename(columns={old: new})

    return _all(change)


def _twice(table: pd.DataFrame) -> pd.DataFrame:
    name = _values(table)[0]
    table.insert(len(table.columns), name, table[name] * 1.1, allow_duplicates=True)
    return table


def _few(table: pd.DataFrame) -> pd.DataFrame:
    return table.groupby("trial").head(5).head(10)


def _comma_in_commas(text: str) -> bytes:
    head, *rows = text.splitlines()
    return "\n".join([head, *(row.replace(".", ",") for row in rows)]).encode()


def _setup(old: str, new: str) -> Callable[[Files], Files]:
    return lambda files: replace(files, setup=files.setup.replace(old, new))


def _other_setup(files: Files) -> Files:
    setup = (
        '[ball]\nmass = "0.0027 kg"\ndiameter = "40 mm"\n[pendulum]\nlength = "0.2 m"\n'
        'inertia = "0.004 kg m^2"\nmass = "0.1 kg"\ncom = "0.2 m"\n'
    )
    return replace(files, setup=setup)


DAMAGES: Mapping[str, Callable[[Files], Files]] = {
    "nothing": lambda files: files,
    "samples shuffled within each trial": _by_trial(_shuffled),
    "noise alone": _by_trial(_noise),
    "a random walk": _by_trial(_walk),
    "a constant record": _by_trial(_constant),
    "a motion in a circle": _by_trial(_circle),
    "a pendulum over the top": _by_trial(_over_the_top),
    "angles in degrees": _all(_degrees),
    "small angles in degrees": _all(_small_degrees),
    "millimetres in columns of metres": _scaled(("x_m", "y_m"), 1e3),
    "centimetres in columns of metres": _scaled(("x_m", "y_m"), 1e2),
    "milliseconds in the column of seconds": _scaled(("t_s",), 1e3),
    "times multiplied by 1e12": _scaled(("t_s",), 1e12),
    "times near the largest number": _scaled(("t_s",), 1e300),
    "times multiplied by 1e-6": _scaled(("t_s",), 1e-6),
    "positions near the largest number": _scaled(("x_m", "y_m", "phi_rad"), 1e200),
    "positions near the smallest number": _scaled(("x_m", "y_m", "phi_rad"), 1e-200),
    "ten samples": _all(_few),
    "gaps of half a swing": _by_trial(_gaps),
    "every time twice": _by_trial(_doubled_clock),
    "all trials under one name": _all(_one_name),
    "every second trial of another pendulum": _all(lambda t: _alternate(t, _other_pendulum)),
    "every second trial under another gravity": _all(lambda t: _alternate(t, _other_gravity)),
    "back-swings of other trials": _mixed_swings,
    "a back-swing that changes within a trial": _changing_swing,
    "the setup of another experiment": _other_setup,
    "x and y exchanged": lambda f: f.change(
        lambda t: t.rename(columns={"x_m": "y_m", "y_m": "x_m"})
    ),
    "stated uncertainties of 1e-300": _added("x_m_std", 1e-300),
    "stated uncertainties of zero": _added("x_m_std", 0.0),
    "stated uncertainties below zero": _added("x_m_std", -0.001),
    "infinite stated uncertainties": _added("x_m_std", np.inf),
    "infinite positions": _with("x_m", "inf", 7),
    "infinite angles": _with("phi_rad", "inf", 7),
    "text among the positions": _with("x_m", "abc", 7),
    "text among the angles": _with("phi_rad", "abc", 7),
    "a column of text": _with("x_m", "abc"),
    "a column of angles as text": _with("phi_rad", "abc"),
    "text among the times": _with("t_s", "now", 5),
    "a back-swing as text": _with("backswing_deg", "thirty"),
    "no angle at all": _with("phi_rad", ""),
    "two columns of one name": _all(_twice),
    "decimal commas between commas": lambda f: replace(f, written=_comma_in_commas),
    "decimal commas between semicolons": lambda f: replace(f, separator=";", decimal=","),
    "semicolons": lambda f: replace(f, separator=";"),
    "tabs": lambda f: replace(f, separator="\t"),
    "UTF-16": lambda f: replace(f, written=lambda text: text.encode("utf-16")),
    "a byte-order mark": lambda f: replace(f, written=lambda text: text.encode("utf-8-sig")),
    "another code page": lambda f: replace(
        f, written=lambda text: text.replace("trial,", "trial,größe,", 1).encode("cp1252")
    ),
    "column in millimetres": _renamed("x_m", "x_mm", 1e3),
    "column in degrees": _renamed("phi_rad", "phi_deg", 180.0 / np.pi),
    "no bytes": lambda f: replace(f, written=lambda text: b""),
    "bytes of a picture": lambda f: replace(
        f, written=lambda text: b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 40
    ),
    "a header alone": lambda f: replace(f, written=lambda text: text.splitlines()[0].encode()),
    "a torn last row": lambda f: replace(f, written=lambda text: text[:-9].encode()),
    "noise claimed as 1e-300": lambda f: replace(
        f,
        setup="\n".join(
            'position = "1e-300 m"' if line.startswith("position") else line
            for line in f.setup.splitlines()
        ),
    ),
}
"""Damage by name."""
