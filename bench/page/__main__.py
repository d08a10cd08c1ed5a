"""Measure the page in a real browser and write docs/results/page.json.

Run: python -m bench.page [ROW…]

Rows: first_numbers, long, actions, lessons, campaign, report, code; default: all. Needs Chromium.
"""

import argparse
import json
import tempfile
from pathlib import Path

from bench.insert import read_results, rounded
from bench.page.rows import ROWS
from bench.page.served import ROOT, chromium
from metrology.files import write_text_whole

RESULTS = ROOT / "docs" / "results" / "page.json"


def main() -> None:
    """Measure the rows asked for, and keep the others."""
    parser = argparse.ArgumentParser(prog="python -m bench.page", description=__doc__)
    parser.add_argument("rows", nargs="*", choices=[[], *ROWS], metavar="ROW")
    found = read_results(RESULTS.name)
    with chromium() as browser:
        for name in parser.parse_args().rows or ROWS:
            with tempfile.TemporaryDirectory() as folder:
                found[name] = rounded(ROWS[name](browser, Path(folder)), 3)
            print(name, json.dumps(found[name]), flush=True)
            write_text_whole(RESULTS, json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
