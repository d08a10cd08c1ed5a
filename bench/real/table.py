"""Run the sets of recordings and build their table."""

from functools import partial
from pathlib import Path

from bench.real import balldrop, juggling_mocap, rocket_coast, rod_pendulum
from bench.real.plain_sets import heights_rows, made_rows, plain_rows
from bench.real.row import Explain, Row

__all__ = ["MADE", "real_rows", "real_table"]

MADE = "made"
"""Name of the set of simulated recordings."""

SETS = {
    "rod_pendulum": rod_pendulum.rows,
    "encoder_pendulum": partial(
        plain_rows, asked="dry bearing, 0.0011 N m", at_least="9.5 mrad", aim="6.9 mrad"
    ),
    "encoder_pendulum_b": partial(
        plain_rows, asked="dry and quadratic", at_least="both, 0.85", aim="4.2 mrad"
    ),
    "coffee_filter": partial(
        plain_rows, asked="drag with dragged air", at_least="drag or silent", aim="drag"
    ),
    "tabletennis_rally": partial(
        plain_rows, asked="drag, a spin for each flight", at_least="both, 0.85", aim="3.1 mm"
    ),
    "rebound_heights": heights_rows,
    "three_drops": partial(
        plain_rows, asked="drag, a C_D for each ball", at_least="drag", aim="0.47, 0.83"
    ),
    "pingpong_throws": partial(
        plain_rows, asked="not decided", at_least="no name above 0.5", aim="unexplained"
    ),
    "rocket_coast": rocket_coast.rows,
    "balldrop": balldrop.rows,
    "juggling_mocap": juggling_mocap.rows,
}


def real_rows(source: Path, cache: Path, explain: Explain, chosen: str | None = None) -> list[Row]:
    """Rows of every set found in `source` and of the simulated ones, or of the chosen set."""
    found = []
    for name, rows in SETS.items():
        if (source / name).is_dir() and chosen in (None, name):
            found += rows(source / name, cache, explain)
    if chosen in (None, MADE):
        found += made_rows(cache, explain)
    return found


def real_table(rows: list[Row]) -> list[str]:
    """Table as Markdown lines."""
    lines = ["| recording | required | goal | measured |", "|---|---|---|---|"]
    lines += [f"| {r.asked} | {r.at_least} | {r.aim} | {r.measured} |" for r in rows]
    return [*lines, ""]
