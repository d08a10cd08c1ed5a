"""Measure a fixed set of recordings and compare the results with bench/golden.json.

Run: python -m bench.golden [--quick] [--only PART...] [--jobs N] [--from-tracks COMMIT]
     python -m bench.golden --update [--allow ITEM...]
     python -m bench.golden compare COMMIT COMMIT

Results of every stage are kept in STORE/COMMIT (see `bench.golden.run`); items that are there are
not run again unless --fresh is given. A working tree with changes has a folder of its own, which is
always run afresh. Parts whose shared data ($IMPACT_VISION_SHARED, else ../shared) are missing are
skipped. The comparison prints what moved by more than 0.2 of its stated standard uncertainty, and
whether it came nearer to the truth.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

from bench.golden.compare import moves, unlisted
from bench.golden.items import CLIP_PARTS, GOLDEN_PARTS, ROOT, Item, items_of
from bench.golden.run import run_item
from metrology import write_text_whole

GOLDEN = ROOT / "bench" / "golden.json"
UNCOMPARED = ("truth", "message")
"""Entries of a record that are not written to golden.json."""

Records = dict[str, dict[str, Any]]


def commit_of(tree: Path) -> str:
    """Abbreviated commit of a working tree, with "-changed" if files differ from it."""

    def git(*words: str) -> str:
        command = ["git", "-C", str(tree), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!bench/golden.json")
    return git("rev-parse", "--short=9", "HEAD") + ("-changed" if changed else "")


def stored(folder: Path) -> Records:
    """All records below a commit's folder."""
    return {
        path.parent.relative_to(folder).as_posix(): json.loads(path.read_text(encoding="utf-8"))
        for path in sorted(folder.rglob("record.json"))
    }


def _work(task: tuple[Item, Path, Path | None]) -> tuple[str, dict[str, Any]]:
    item, folder, tracks_from = task
    return item.key, run_item(item, folder, tracks_from)


def measured(options: argparse.Namespace, folder: Path) -> Records:
    """Records of the wanted items, run where they are not in the folder yet."""
    fresh = options.fresh or folder.name.endswith("-changed")
    found: Records = {}
    tasks = []
    for item in items_of(options.only, options.quick):
        place, tracks_from = folder / item.key, None
        if options.from_tracks:
            tracks_from = options.store / options.from_tracks / item.key
            if item.part not in CLIP_PARTS or not (tracks_from / "tracks.pickle").exists():
                continue
        if item.source is not None and not item.source.exists():
            print(f"{item.key}: skipped, {item.source} is missing", flush=True)
        elif not fresh and (place / "record.json").exists():
            found[item.key] = json.loads((place / "record.json").read_text(encoding="utf-8"))
        else:
            tasks.append((item, place, tracks_from))
    for key, record in _done(tasks, options.jobs):
        # through JSON, so that fresh and stored records have the same types
        found[key] = json.loads(json.dumps(record))
        failure = f", {record['failure']['class']}" if record["failure"] else ""
        print(f"{key}: {record['cpu_s']} s of CPU{failure}", flush=True)
    return found


def _done(
    tasks: list[tuple[Item, Path, Path | None]], jobs: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    if jobs == 1:
        yield from map(_work, tasks)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_work, tasks)


def _report(before: Records, after: Records, allowed: list[str]) -> int:
    """Print what moved; the number of moves that are not nearer to the truth and not allowed."""
    truths = {key: record.get("truth", {}) for key, record in after.items()}
    found = moves(before, after, truths)
    both = [key for key in before if key in after]
    same = sum(_compared(before[key]) == _compared(after[key]) for key in both)
    print("\n".join(str(move) for move in found))
    bad = unlisted(found, allowed)
    print(f"New, not compared: {', '.join(key for key in after if key not in before) or 'none'}.")
    print(
        f"{len(both)} items compared, {same} identical to the last digit; {len(found)} values"
        f" moved, {len(found) - len(bad)} of them nearer to the truth or allowed."
    )
    return len(bad)


def _compared(record: dict[str, Any]) -> dict[str, Any]:
    return {key: entry for key, entry in _kept(record).items() if key != "cpu_s"}


def _kept(record: dict[str, Any]) -> dict[str, Any]:
    """What golden.json has of a record: no truth, no quantity without a value."""
    kept = {key: entry for key, entry in record.items() if key not in UNCOMPARED}
    if "quantities" in kept:
        values = kept["quantities"].items()
        kept["quantities"] = {name: one for name, one in values if one["value"] is not None}
    return kept


def _updated(before: Records, after: Records) -> str:
    """Text of golden.json: one line per value, items in their order."""
    records = before | {key: _kept(record) for key, record in after.items()}
    order = [item.key for item in items_of() if item.key in records]
    lines = ",\n".join(f"{json.dumps(key)}: {_lines(records[key])}" for key in order)
    return f"{{\n{lines}\n}}\n"


def _lines(record: dict[str, Any]) -> str:
    inner = []
    for name, entry in record.items():
        text = json.dumps(entry)
        if name in ("quantities", "effects") and entry:
            rows = ",\n  ".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in entry.items())
            text = f"{{\n  {rows}}}"
        inner.append(f" {json.dumps(name)}: {text}")
    return "{\n" + ",\n".join(inner) + "}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.golden",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("compare", nargs="*", help="compare COMMIT COMMIT: two stored runs")
    parser.add_argument("--quick", action="store_true", help="ten items, at most 3 min of CPU")
    parser.add_argument("--only", nargs="+", choices=list(GOLDEN_PARTS), metavar="PART")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--fresh", action="store_true", help="run stored items again")
    parser.add_argument("--from-tracks", metavar="COMMIT", help="measure the tracks of that run")
    parser.add_argument("--update", action="store_true", help="write bench/golden.json")
    parser.add_argument(
        "--allow", nargs="+", default=[], metavar="ITEM", help="items that may get worse"
    )
    default = user_cache_path("impact-vision", appauthor=False) / "golden"
    parser.add_argument("--store", type=Path, default=default)
    return parser.parse_args()


def main() -> int:
    """Exit code 0 if nothing moved away from the truth, 1 otherwise."""
    options = _options()
    if options.compare:
        if len(options.compare) != 3 or options.compare[0] != "compare":
            print("usage: python -m bench.golden compare COMMIT COMMIT", file=sys.stderr)
            return 2
        one, other = (stored(options.store / name) for name in options.compare[1:])
        return int(_report(one, other, options.allow) > 0)
    commit = commit_of(ROOT)
    if options.from_tracks:
        commit += f"-tracks-of-{options.from_tracks}"
    after = measured(options, options.store / commit)
    print(f"{sum(record['cpu_s'] for record in after.values()):.0f} s of CPU in {len(after)} items")
    before = json.loads(GOLDEN.read_text(encoding="utf-8")) if GOLDEN.exists() else {}
    bad = _report(before, after, options.allow)
    if options.update:
        if bad:
            print("golden.json is not written: name the items that moved with --allow.")
        else:
            write_text_whole(GOLDEN, _updated(before, after))
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
