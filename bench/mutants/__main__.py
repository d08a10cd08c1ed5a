"""`python -m bench.mutants`: break lines, one at a time, in a copy; count what is noticed.

A mutant whose line is no longer there is told as gone: name another line in `catalogue`.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.mutants.catalogue import MUTANTS, Mutant

ROOT = Path(__file__).parents[2]
WANTED = 45
"""Mutants of all that must be caught: nine of ten."""
TIMEOUT_S = 300


def copied(into: Path) -> None:
    """What git knows of, as it stands."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"],
        cwd=ROOT, capture_output=True, check=True,
    )  # fmt: skip
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (ROOT / name).is_file() and not name.startswith("docs/"):
            (into / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, into / name)


def fails(copy: Path, tests: str) -> bool:
    """Whether the tests notice that something is wrong."""
    command = [sys.executable, "-B", "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", tests]
    place = {**os.environ, "PYTHONPATH": str(copy)}
    try:
        run = subprocess.run(command, cwd=copy, env=place, capture_output=True, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return True
    if run.returncode not in (0, 1):
        print(run.stdout.decode()[-2000:])
        raise RuntimeError(f"{tests} did not run")
    return run.returncode == 1


def tried(copy: Path, mutant: Mutant) -> str:
    """``caught``, ``survived`` or ``gone``."""
    module = copy / mutant.path
    text = module.read_text(encoding="utf-8") if module.is_file() else ""
    if text.count(mutant.before) != 1:
        return "gone"
    try:
        module.write_text(text.replace(mutant.before, mutant.after), encoding="utf-8")
        return "caught" if fails(copy, mutant.tests) else "survived"
    finally:
        module.write_text(text, encoding="utf-8")


def main(names: list[str]) -> int:
    """Try all, or those whose names hold one of the words given."""
    chosen = [m for m in MUTANTS if not names or any(word in m.name for word in names)]
    found: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        copied(Path(folder))
        for mutant in chosen:
            found.append(tried(Path(folder), mutant))
            print(f"{found[-1]:9s} {mutant.name}  ({mutant.path}; {mutant.tests})", flush=True)
    caught = found.count("caught")
    print(f"{caught} of {len(chosen)} are caught; {WANTED} of {len(MUTANTS)} must be")
    return 0 if caught >= WANTED * len(chosen) / len(MUTANTS) else 1


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
