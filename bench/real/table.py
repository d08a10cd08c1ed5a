"""The four sets, run in turn, and their table."""

from pathlib import Path

from bench.real import balldrop, juggling_mocap, rocket_coast, rod_pendulum
from bench.real.row import Explain, Row

__all__ = ["real_rows", "real_table"]

SETS = {
    "rod_pendulum": rod_pendulum.rows,
    "rocket_coast": rocket_coast.rows,
    "balldrop": balldrop.rows,
    "juggling_mocap": juggling_mocap.rows,
}


def real_rows(source: Path, cache: Path, explain: Explain, chosen: str | None = None) -> list[Row]:
    """Rows of every set that lies below `source`, or of the chosen one."""
    found = []
    for name, rows in SETS.items():
        if (source / name).is_dir() and chosen in (None, name):
            found += rows(source / name, cache, explain)
    return found


def real_table(rows: list[Row]) -> list[str]:
    """Markdown lines."""
    lines = ["| recording | at least | aim | measured |", "|---|---|---|---|"]
    lines += [f"| {r.asked} | {r.at_least} | {r.aim} | {r.measured} |" for r in rows]
    return [*lines, ""]
