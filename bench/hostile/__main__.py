"""``python -m bench.hostile --seconds 600``: hostile inputs drawn, run and counted by class.

Each case that fails is kept in ``bench/hostile/kept`` and replayed by the tests. ``--seed`` draws
the same cases again; ``--log FILE`` adds what every case said, from which ``--messages 40`` shows
some at random, to be read by a person. Half of the draws are turned away at a door, half get past
it into the work. ``--jobs 2`` draws on two cores, each with seeds of its own.

A log makes a run that can be left and taken up: cases that stand in it are drawn, and not run
again, and the table counts the whole log, each input once. ``--inputs 2000`` ends it there; exit
code 3 says that it has not come so far yet.
"""

import argparse
import functools
import json
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from bench.hostile.case import Case, Fault, Kind, Ran, faults_of, kept, read_case, run_case
from bench.hostile.draw import STRATEGIES, drawn
from bench.hostile.warm import load_commands


def tried(case: Case) -> tuple[Ran, tuple[Fault, ...]]:
    """Run a case in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
        inside = Path(folder) / "case"
        inside.mkdir()
        ran = run_case(case, inside)
    return ran, faults_of(case, ran)


@dataclass(frozen=True)
class Found:
    """What came of a run of cases.

    Attributes
    ----------
    codes : Counter
        Cases by door and exit code.
    faults : Counter
        Faults by kind.
    """

    codes: Counter[tuple[Kind, int]]
    faults: Counter[Fault]

    def __add__(self, other: "Found") -> "Found":
        return Found(self.codes + other.codes, self.faults + other.faults)


@dataclass(frozen=True)
class Wish:
    """How much to run.

    Attributes
    ----------
    seconds : float
    inputs : int or None
        End where the log holds so many.
    kinds : tuple of Kind
    keep, log : Path or None
        Folder for cases that fail; file that takes what every case said.
    """

    seconds: float
    inputs: int | None
    kinds: tuple[Kind, ...]
    keep: Path | None
    log: Path | None


def campaign(wish: Wish, of: int) -> Found:
    """Draw and run rounds of cases until the time is over, or there are enough."""
    found = Found(Counter(), Counter())
    done = {line["name"] for line in logged(wish.log)}
    until, turn = time.monotonic() + wish.seconds, 0
    while True:
        for kind in wish.kinds:
            for case in drawn(kind, STRATEGIES[kind][1], 1000 * of + turn):
                if time.monotonic() > until or (wish.inputs and len(done) >= wish.inputs):
                    return found
                if case.name in done:
                    continue
                ran, faults = tried(case)
                done.add(case.name)
                found.codes[kind, ran.code] += 1
                found.faults.update(faults)
                _note(case, ran, faults, wish.keep, wish.log)
        turn += 1


def on_cores(jobs: int, wish: Wish, of: int) -> Found:
    """The same on several cores: each draws with seeds of its own."""
    if jobs == 1:
        return campaign(wish, of)
    if wish.inputs is not None:
        # each sees what the log held before, and what it adds itself
        held = len(logged(wish.log))
        wish = replace(wish, inputs=held + -(-max(0, wish.inputs - held) // jobs))
    # forks, since each case is one: processes that begin anew would load all commands again
    with ProcessPoolExecutor(jobs, mp_context=get_context("fork")) as pool:
        parts = [pool.submit(campaign, wish, 100 * of + job) for job in range(jobs)]
        return sum((part.result() for part in parts), Found(Counter(), Counter()))


def logged(log: Path | None) -> list[dict[str, Any]]:
    """Lines of a log, each input once."""
    if log is None or not log.exists():
        return []
    lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return list({line["name"]: line for line in lines}.values())


def found_in(lines: list[dict[str, Any]]) -> Found:
    """What a log holds, all pieces of its run together."""
    codes = Counter((Kind(line["kind"]), int(line["code"])) for line in lines)
    return Found(codes, Counter(Fault(fault) for line in lines for fault in line["faults"]))


@functools.cache
def commit() -> str:
    """Of this tree; with a mark where files differ from it."""
    asked = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty=+"]
    return subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()


def _note(
    case: Case, ran: Ran, found: tuple[Fault, ...], keep: Path | None, log: Path | None
) -> None:
    if log is not None:
        line = {
            "kind": case.kind, "arguments": case.arguments, "code": ran.code, "said": ran.said,
            "seconds": round(ran.seconds, 2), "faults": found, "name": case.name,
            "commit": commit(),
        }  # fmt: skip
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
    if found and keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        (keep / f"{case.name}.json").write_text(case.text() + "\n", encoding="utf-8")
        last = ran.said.strip().splitlines()[-1:] or [""]
        print(
            f"{case.name}: {', '.join(found)}: {' '.join(case.arguments)[:120]!r}: {last[0][:160]}",
            file=sys.stderr,
            flush=True,
        )


def replayed() -> int:
    """Run every case that failed once; how many fail again."""
    failed = 0
    for path in kept():
        ran, found = tried(read_case(path))
        failed += bool(found)
        if found:
            print(f"{path.name}: {', '.join(found)}\n{ran.said[-2000:]}", file=sys.stderr)
    print(f"{len(kept())} cases, {failed} fail")
    return min(failed, 1)


def table(found: Found) -> list[str]:
    """The result as markdown."""
    rows = [f"| inputs tried | 2,000 | {found.codes.total():,} |"]
    rows += [f"| {fault} | 0 | {found.faults[fault]} |" for fault in Fault]
    for kind in Kind:
        codes = {code: number for (door, code), number in found.codes.items() if door is kind}
        ended = ", ".join(f"{codes[code]} × {code}" for code in sorted(codes))
        rows.append(f"| {kind}: exit codes | | {sum(codes.values())}: {ended} |")
    beyond = sum(number for (_, code), number in found.codes.items() if code != 2)
    return [*rows, f"| got past the doors | | {beyond / max(1, found.codes.total()):.0%} |"]


def commits(lines: list[dict[str, Any]]) -> list[tuple[str, int]]:
    """By which trees a log was written, and how many of its lines each."""
    return Counter(str(line.get("commit")) for line in lines).most_common()


NOT_YET = 3
"""Exit code of a run that has not come to the end yet."""


def messages(log: Path, number: int, of: int) -> None:
    """Show messages at random, for a person to read."""
    refused = [line for line in logged(log) if line["code"] in (2, 3, 4)]
    for line in random.Random(of).sample(refused, min(number, len(refused))):
        print(f"[{line['code']}] vision {' '.join(line['arguments'])[:100]!r}\n{line['said']}")


def main() -> None:
    """Draw, run, count."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--inputs", type=int, help="end where --log holds so many")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", choices=[kind.name for kind in Kind])
    parser.add_argument("--jobs", type=int, default=1, help="processes, each with its own seeds")
    parser.add_argument("--keep", type=Path, default=Path(__file__).with_name("kept"))
    parser.add_argument("--log", type=Path)
    parser.add_argument("--replay", action="store_true", help="the cases kept, and draw none")
    parser.add_argument("--messages", type=int, help="show so many of --log, and run nothing")
    asked = parser.parse_args()
    if asked.messages:
        messages(asked.log, asked.messages, asked.seed)
        return
    load_commands()
    if asked.replay:
        sys.exit(replayed())
    kinds = tuple(Kind[name] for name in asked.kinds or [kind.name for kind in STRATEGIES])
    wish = Wish(asked.seconds, asked.inputs, kinds, asked.keep, asked.log)
    found = on_cores(asked.jobs, wish, asked.seed)
    lines = logged(asked.log)
    if lines:
        found = found_in(lines)
        print("run at " + ", ".join(f"{sha} × {n}" for sha, n in commits(lines)), file=sys.stderr)
    print("| | at most | found |\n|---|---|---|")
    print("\n".join(table(found)))
    if found.faults.total():
        sys.exit(1)
    sys.exit(NOT_YET if asked.inputs and found.codes.total() < asked.inputs else 0)


if __name__ == "__main__":
    main()
