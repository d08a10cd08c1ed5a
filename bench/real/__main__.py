"""Run the engine on real and simulated recordings and print the table."""

import argparse
import json
import tempfile
from pathlib import Path

from bench.concealed.engine import engine_answer
from bench.real.named import named_in_all
from bench.real.table import real_rows, real_table
from metrology import write_text_whole

ROOT = Path(__file__).parents[2]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.real", description=__doc__)
    parser.add_argument("--source", type=Path, default=ROOT.parent / "shared" / "realdata")
    parser.add_argument("--set", dest="chosen", help="one set alone")
    parser.add_argument("--names", type=Path, help="write which names are right to this JSON file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        if options.names is not None:
            names = named_in_all(options.source, Path(cache), engine_answer)
            write_text_whole(options.names, json.dumps(names, indent=1) + "\n")
            return
        found = real_rows(options.source, Path(cache), engine_answer, options.chosen)
    print("\n".join(real_table(found)))


if __name__ == "__main__":
    main()
