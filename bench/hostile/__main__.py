"""Draw hostile inputs, run them and count the outcomes by class.

Run: python -m bench.hostile [--seconds 600] [--seed N] [--kinds KIND…] [--jobs N] [--replay]

Half of the inputs are damaged, half are valid but extreme. A seed always draws the same inputs.
Each input that fails is written to bench/hostile/kept, whose cases the tests replay (--replay).
"""

import argparse
import json
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from bench.hostile.case import Fault, Kind, kept, load_commands, read_case, tried
from bench.hostile.damaged import STRATEGIES, drawn


@dataclass(frozen=True)
class Found:
    """Number of inputs by class and exit code, and of faults by type."""

    codes: Counter[tuple[Kind, int]]
    faults: Counter[Fault]

    def __add__(self, other: "Found") -> "Found":
        return Found(self.codes + other.codes, self.faults + other.faults)


def campaign(seconds: float, kinds: tuple[Kind, ...], keep: Path, seed: int) -> Found:
    """Draw and run rounds of inputs until the time is over."""
    found = Found(Counter(), Counter())
    done: set[str] = set()
    until, turn = time.monotonic() + seconds, 0
    while True:
        for kind in kinds:
            for case in drawn(kind, STRATEGIES[kind][1], 1000 * seed + turn):
                if time.monotonic() > until:
                    return found
                if case.name in done:
                    continue
                done.add(case.name)
                ran, faults = tried(case)
                found.codes[kind, ran.code] += 1
                found.faults.update(faults)
                if faults:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{case.name}.json").write_text(case.text() + "\n", encoding="utf-8")
                    words = f"{' '.join(case.arguments)[:120]!r}: {ran.said.strip()[-160:]}"
                    print(f"{case.name}: {', '.join(faults)}: {words}", file=sys.stderr, flush=True)
        turn += 1


def on_cores(jobs: int, seconds: float, kinds: tuple[Kind, ...], keep: Path, seed: int) -> Found:
    """The same in several processes, each with its own seeds."""
    if jobs == 1:
        return campaign(seconds, kinds, keep, seed)
    # forked processes share the loaded commands
    with ProcessPoolExecutor(jobs, mp_context=get_context("fork")) as pool:
        runs = [
            pool.submit(campaign, seconds, kinds, keep, 100 * seed + job) for job in range(jobs)
        ]
        return sum((run.result() for run in runs), Found(Counter(), Counter()))


def replayed() -> int:
    """Run every kept case; 1 if any fails again."""
    failed = 0
    for path in kept():
        ran, found = tried(read_case(path))
        failed += bool(found)
        if found:
            print(f"{path.name}: {', '.join(found)}\n{ran.said[-2000:]}", file=sys.stderr)
    print(f"{len(kept())} cases, {failed} fail")
    return min(failed, 1)


def table(found: Found) -> list[str]:
    """The result as a Markdown table."""
    rows = ["| | required | found |", "|---|---|---|"]
    rows += [f"| inputs tried | 2,000 | {found.codes.total():,} |"]
    rows += [f"| {fault} | 0 | {found.faults[fault]} |" for fault in Fault]
    for kind in Kind:
        codes = {code: number for (one, code), number in found.codes.items() if one is kind}
        ended = ", ".join(f"{codes[code]} × {code}" for code in sorted(codes))
        rows.append(f"| {kind}: exit codes | | {sum(codes.values())}: {ended} |")
    beyond = sum(number for (_, code), number in found.codes.items() if code != 2)
    return [*rows, f"| passed input validation | | {beyond / max(1, found.codes.total()):.0%} |"]


def main() -> None:
    """Draw, run, count."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", choices=[kind.name for kind in Kind])
    parser.add_argument("--jobs", type=int, default=1, help="processes, each with its own seeds")
    parser.add_argument("--keep", type=Path, default=Path(__file__).with_name("kept"))
    parser.add_argument("--json", type=Path, help="store the counts, for the docs")
    parser.add_argument("--replay", action="store_true", help="run only the kept cases")
    asked = parser.parse_args()
    load_commands()
    if asked.replay:
        sys.exit(replayed())
    kinds = tuple(Kind[name] for name in asked.kinds or [kind.name for kind in STRATEGIES])
    found = on_cores(asked.jobs, asked.seconds, kinds, asked.keep, asked.seed)
    print("\n".join(table(found)))
    if asked.json is not None:
        inputs: Counter[str] = Counter()
        for (kind, _), number in found.codes.items():
            inputs[kind.value] += number
        faults = {fault.value: number for fault, number in found.faults.items()}
        text = json.dumps({"inputs": inputs, "faults": faults}, indent=1)
        asked.json.write_text(text + "\n", encoding="utf-8")
    sys.exit(min(found.faults.total(), 1))


if __name__ == "__main__":
    main()
