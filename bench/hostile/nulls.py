"""``python -m bench.hostile.nulls [--draws 100]``: campaigns in which there is nothing to be found.

Ranges or speeds of a table of trials permuted among its trials, or noise in their place; samples of
thrown balls shuffled or replaced by noise. Whatever is named in them with more than even odds is
invented.
"""

import argparse
import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from bench.hostile.case import Case, Kind, faults_of, named, run_case
from bench.hostile.draw import SETUP, table_text
from bench.hostile.warm import load_commands

__all__ = ["WAYS", "null_case"]

WAYS = ("ranges permuted", "ball speeds permuted", "noise for ranges", "noise samples", "shuffled")


def null_case(way: str, of: int) -> Case:
    """One such campaign."""
    rng = np.random.default_rng(of)
    if way in WAYS[:3]:
        rows = [line.split(",") for line in table_text().splitlines()]
        column = 3 if way == "ball speeds permuted" else 5
        values = np.array([float(row[column]) for row in rows[1:]])
        new = rng.permutation(values)
        if way == "noise for ranges":
            new = rng.uniform(values.min(), values.max(), len(values))
        for row, value in zip(rows[1:], new, strict=True):
            row[column] = f"{value:.4f}"
        text = "\n".join(",".join(row) for row in rows) + "\n"
    else:
        text = _samples(way, rng)
    files = {"b.csv": text.encode(), "lab.toml": SETUP.encode()}
    arguments = ("explain", "b.csv", "--setup", "lab.toml", "--json", "o.json")
    return Case(Kind.TABLE, arguments, files, ("o.json",))


def _samples(way: str, rng: np.random.Generator) -> str:
    """Four throws of 40 samples, in which nothing follows anything."""
    lines = ["trial,t_s,x_m,y_m"]
    for trial in range(4):
        time = np.arange(40) / 100.0
        where = np.column_stack([3.0 * time, 1.0 + 2.0 * time - 4.9 * time**2])
        where = where + rng.normal(0.0, 0.002, where.shape)
        if way == "shuffled":
            where = rng.permutation(where)
        else:
            where = rng.normal(where.mean(axis=0), where.std(axis=0), where.shape)
        lines += [
            f"t{trial},{t:.3f},{x:.4f},{y:.4f}" for t, (x, y) in zip(time, where, strict=True)
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Draw, run, count."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile.nulls", description=__doc__)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    load_commands()
    invented, codes, faults = [], Counter(), 0
    for number in range(asked.draws):
        way = WAYS[number % len(WAYS)]
        case = null_case(way, 1000 * asked.seed + number)
        with tempfile.TemporaryDirectory(prefix="nulls-") as folder:
            inside = Path(folder) / "case"
            inside.mkdir()
            ran = run_case(case, inside)
        found = () if ran.code else named(json.loads(ran.left["o.json"]))
        codes[ran.code] += 1
        faults += bool(faults_of(case, ran))
        if found:
            invented.append((way, found))
            print(f"{way}, seed {1000 * asked.seed + number}: {found}", file=sys.stderr, flush=True)
    ended = ", ".join(f"{number} × {code}" for code, number in sorted(codes.items()))
    print("| | at most | found |\n|---|---|---|")
    print(f"| noise and permuted campaigns, {asked.draws} draws: physics named | 0 |"
          f" {len(invented)} (exit codes {ended}; {faults} faults) |")  # fmt: skip
    sys.exit(min(len(invented), 1))


if __name__ == "__main__":
    main()
