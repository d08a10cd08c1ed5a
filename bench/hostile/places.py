"""Hypothesis strategies for ledgers, names of files, and what is no file."""

import functools
import json
import shlex
import sqlite3
import tempfile
from collections.abc import Callable
from pathlib import Path

from hypothesis import strategies as st

from bench.hostile.case import Case, Kind

__all__ = ["PLACE_CASES"]

ODD_NAMES = (
    "\udcff", "a\udcffb", "$HOME", "$(id)", "`id`", "a=b", "=1+1", "\x1b[31mred", "a\x07b", "a\nb",
    "a\rb", "a\tb", "a b", " ", "-x", "--json", "%s%n", "{x}", "[bold]x[/bold]", "[/]", "a'b\"c",
    "*", "?", "~", "é", "球", "e\u0301", "\u202etxt", "\u200b", "x" * 240, "CON", "<b>", "&amp;",
    "a,b", "a;b", "a#b", "a\\b", "\x7f", "\x85", "@a", "..", "a:b", "|", ".hidden",
    "\x01",
)  # fmt: skip
"""File names without ending that some shell, table, page or terminal treats as more than a name."""

SHEET_WORDS = ("=1+1", "a\x0bb", "\x1b[2J", "state", "nan", "1e400", "x" * 3000, "<script>", "a\tb",
         "-", "@SUM(A1)", "é", "\x01", "None", "12 m", "+1", "\u2028", "\ud83d\ude00")  # fmt: skip
"""Texts of a lab book."""

HEADS = ("state", "motion", "ball_speed_m_s", "clip_", "error", "=1+1", "remark", "warnings", "cor",
         "reason_cor", "book_state", "landing_tape_cm", "backswing", "rope", "Session ", "x\x0by",
         "sha256", "excluded", "angle (deg)", "1", "é")  # fmt: skip
"""Heads of its further columns."""


def _named(name: str, suffix: str) -> str:
    return f"{name}{suffix}" if not name.startswith("-") else f"./{name}{suffix}"


def _commands() -> tuple[tuple[str, dict[str, str]], ...]:
    """Command lines with places for inputs and outputs, and what the places hold."""
    return (
        ("simulate --impact-speed 2.5 --setup {s} --json {j} --csv {c}", {"s": ".toml"}),
        ("simulate --impact-speed 2.5 --ball jokku --cor-law {w} --plot {p}", {"w": ".toml"}),
        ("convert {k} {c}", {"k": ".trk"}),
        ("measure --from-tracks {k} --fps 240 --json {j} --csv {c} --tracks {t} --report {h}",
         {"k": ".trk"}),
        ("measure {v} --fps 600 --json {j} --out {d}", {"v": ".mp4"}),
        ("law {l} --report {h} --save {o}", {"l": ".csv"}),
        ("campaign {v} --trials {b} --out {d}", {"v": ".mp4", "b": ".csv"}),
        ("effects check {e}", {"e": ".py"}),
        ("render --setup {s} --size 96x64 --frames 2 -o {m}", {"s": ".toml"}),
    )  # fmt: skip


_OUTPUTS = {"j": ".json", "c": ".csv", "p": ".svg", "t": ".csv", "h": ".html", "d": "",
            "o": ".toml", "m": ".mp4"}  # fmt: skip


@functools.cache
def _contents() -> dict[str, bytes]:
    from bench.hostile.damaged import EXAMPLE, LAWS, SETUP, sound_tracks
    from bench.hostile.valid import EFFECT

    rows = "".join(f"{1 + 0.3 * k:.2f},{0.75 - 0.01 * k:.3f}\n" for k in range(8))
    return {
        "s": SETUP.encode(), "w": LAWS.encode(), "k": sound_tracks()["a.trk"], "v": b"no video",
        "l": f"impact_speed_m_s,e\n{rows}".encode(), "b": b"",
        "e": EFFECT.format(**EXAMPLE).encode(),
    }  # fmt: skip


def _filled(line: str, names: dict[str, str]) -> tuple[str, ...]:
    return tuple(part.format(**names) for part in line.split())


def _case(kind: Kind, line: str, names: dict[str, str], special: dict[str, str]) -> Case:
    inputs = [key for key in names if key not in _OUTPUTS]
    files = {str(Path(names[key])): _contents()[key] for key in inputs if key not in special}
    if "b" in names and "b" not in special:
        files[str(Path(names["b"]))] = b"clip,ball\n"
    outputs = [str(Path(names[key])) for key in names if key in _OUTPUTS]
    if "m" in names:
        outputs.append(str(Path(names["m"]).with_suffix(".truth.json")))
    placed = {str(Path(names[key])): what for key, what in special.items()}
    return Case(kind, _filled(line, names), files, tuple(outputs), special=placed)


@st.composite
def name_cases(draw: st.DrawFn) -> Case:
    """A sound command whose files have names of any kind."""
    line, inputs = draw(st.sampled_from(_commands()))
    names = {}
    for number, (key, suffix) in enumerate((inputs | _OUTPUTS).items()):
        if f"{{{key}}}" in line:
            odd = draw(st.integers(0, 1)) == 0
            names[key] = _named(draw(st.sampled_from(ODD_NAMES)) if odd else f"f{number}", suffix)
    while len({str(Path(name)) for name in names.values()}) < len(names):
        names = {key: f"f{number}{name}" for number, (key, name) in enumerate(names.items())}
    return _case(Kind.NAMES, line, names, {})


SPECIALS = ("pipe", "folder", "nowhere", "itself", "/dev/zero", "/dev/full", "/dev/null", "/", ".")
"""A pipe, a folder, or the target of a link; "itself" is a link to itself."""


@st.composite
def place_cases(draw: st.DrawFn) -> Case:
    """A command for which a pipe, a folder, a device or a link is in the place of a file."""
    line, inputs = draw(st.sampled_from(_commands()))
    places = {key: f"{key}{suffix}" for key, suffix in (inputs | _OUTPUTS).items()}
    names = {key: name for key, name in places.items() if f"{{{key}}}" in line}
    wrong = draw(st.sampled_from([*names]))
    what = draw(st.sampled_from(SPECIALS))
    return _case(Kind.PLACES, line, names, {wrong: names[wrong] if what == "itself" else what})


@functools.cache
def _ledger() -> bytes:
    """A ledger with a clip that is done and one that failed."""
    from pipelines.campaign.ledger import AttemptOutcome, Ledger, State, WorkOrder

    document = {
        "quantities": {"ball_speed": {"value": 1.5, "std": 0.1, "unit": "m/s"},
                       "cor": {"value": None, "unit": "1", "reason": "no pendulum"}},
        "motion": {"kind": "strike", "probability": 0.9},
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        with Ledger(Path(folder)) as ledger:
            orders = [WorkOrder(f"{name}.mp4", f"{name}.mp4", "0", "0", "1") for name in "ab"]
            ledger.plan(orders, retry_failed=False)
            done = AttemptOutcome("a.mp4", State.DONE, 1.0, json.dumps(document))
            ledger.finish([done, AttemptOutcome("b.mp4", State.FAILED, 1.0, None, "no ball")])
        with sqlite3.connect(Path(folder) / "ledger.sqlite") as base:
            base.execute("PRAGMA journal_mode=DELETE")
        return (Path(folder) / "ledger.sqlite").read_bytes()


LEDGER_VALUES = ("NULL", "x'ff00'", "'[]'", "'{}'", "1e400", "-1", "''", "'\x1b[2J'", "'=1+1'",
          "zeroblob(9)",
          "'running'", "'done'", "'{\"quantities\": {\"cor\": {\"value\": 1e999, \"std\": 0}}}'",
          "9223372036854775807", "'a.mp4'", "char(0)", "char(55296)",
          "replace(hex(zeroblob(9999)),'0','[')"
          )  # fmt: skip
STATEMENTS = (
    "DROP TABLE clips", "ALTER TABLE clips RENAME TO others", "CREATE TABLE copies (x)",
    "PRAGMA user_version=99", "DELETE FROM clips", "PRAGMA encoding='UTF-16'",
    "CREATE VIEW v AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x+1 FROM n)"
    " SELECT x FROM n",
    "CREATE TRIGGER t AFTER UPDATE ON clips BEGIN DELETE FROM clips; END",
    "INSERT INTO clips SELECT * FROM clips", "CREATE INDEX i ON clips(error)",
    "ALTER TABLE clips ADD COLUMN mine",
)  # fmt: skip


def _edited(draw: st.DrawFn) -> bytes:
    """The ledger with a few statements run on it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ledger.sqlite"
        path.write_bytes(_ledger())
        base = sqlite3.connect(path)
        columns = [row[1] for row in base.execute("PRAGMA table_info(clips)")]
        for _ in range(draw(st.integers(1, 2))):
            column, value = draw(st.sampled_from(columns)), draw(st.sampled_from(LEDGER_VALUES))
            change = f"UPDATE clips SET {column}={value} WHERE rowid={draw(st.integers(1, 2))}"
            try:
                base.execute(draw(st.sampled_from((change,) * 9 + STATEMENTS)))
                base.commit()
            except sqlite3.Error:
                base.rollback()
        base.close()
        return path.read_bytes()


_CAMPAIGN = "campaign clips --trials trials.csv --out out --quiet"


@st.composite
def ledger_cases(draw: st.DrawFn) -> Case:
    """A campaign's folder whose ledger or lab book has changed since the last run."""
    from bench.hostile.damaged import bytes_changed

    lines = (_CAMPAIGN, _CAMPAIGN, "campaign status out", "campaign mark out a.mp4 --bad WORD")
    line = draw(st.sampled_from(lines))
    word = draw(st.sampled_from(SHEET_WORDS))
    heads = draw(st.lists(st.sampled_from(HEADS), max_size=3, unique=True))
    cells = draw(st.lists(st.sampled_from(SHEET_WORDS), min_size=len(heads), max_size=len(heads)))
    rows = [["clip", *heads], ["a", *cells], ["b", *("ok" for _ in cells)]]
    text = "\n".join(",".join(row) for row in rows) + "\n"
    how = draw(st.integers(0, 4))
    data = _ledger() if how == 0 else _edited(draw)
    if how == 1:
        data = bytes_changed(_ledger(), draw)
    files = {"clips/a.mp4": b"no video", "clips/b.mp4": b"none", "out/ledger.sqlite": data}
    files["trials.csv"] = text.encode("utf-8", "surrogatepass")
    if draw(st.integers(0, 9)) == 0:
        files["out/ledger.sqlite-wal"] = data[:100]
    arguments = tuple(word if part == "WORD" else part for part in shlex.split(line))
    plain = tuple(
        cell for cell in cells if cell.isprintable() and cell not in ("nan", "1e400", "-")
    )
    own = ("out", *(name for name in files if name.startswith("out/")))
    return Case(Kind.LEDGERS, arguments, files, own, cells=plain)


PLACE_CASES: dict[Kind, tuple[Callable[[], st.SearchStrategy[Case]], int]] = {
    Kind.LEDGERS: (ledger_cases, 10),
    Kind.NAMES: (name_cases, 10),
    Kind.PLACES: (place_cases, 10),
}
"""Strategy of each of these kinds and number of cases in a round."""
