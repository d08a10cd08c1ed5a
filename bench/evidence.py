"""Collect stored results of bench.golden for the evidence pages.

Run: python -m bench.evidence FOLDER

FOLDER holds the records of one commit (STORE/COMMIT of bench.golden). Without clips in it, only the
tables (campaigns and real data) are replaced. Writes docs/results/evidence.json;
`python -m bench.insert` then fills the pages.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from bench.insert import rounded
from metrology.files import write_text_whole

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "evidence.json"
QUANTITIES = (
    "contact_time",
    "ball_speed",
    "launch_angle",
    "landing_distance",
    "cor",
    "pendulum_speed_before",
    "gravity_check",
    "fall_acceleration",
)


def _clip(record: dict[str, Any]) -> dict[str, Any]:
    """Motion, and value, std and truth of the quantities on the pages."""
    truth = record.get("truth", {})
    true = truth.get("quantities", {})
    found = record.get("quantities", {})
    compared = [
        (found[name]["value"] - true[name]) / found[name]["std"]
        for name in found
        if true.get(name) is not None
        and found[name].get("value") is not None
        and found[name]["std"]
    ]
    return {
        "kind": record.get("motion", {}).get("kind"),
        "probability": record.get("motion", {}).get("probability"),
        "kinds": list(truth.get("kinds", ())),
        "cpu_s": record["cpu_s"],
        "within_95": sum(abs(z) < 1.96 for z in compared),
        "beyond_4": sum(abs(z) > 4.0 for z in compared),
        "compared": len(compared),
        "quantities": {
            name: {
                "value": found[name]["value"],
                "std": found[name]["std"],
                "true": true[name],
            }
            for name in QUANTITIES
            if found.get(name, {}).get("value") is not None and true.get(name) is not None
        },
    }


def _table(record: dict[str, Any]) -> dict[str, Any]:
    """Verdict, names with probabilities, and the truth."""
    effects = record.get("effects", {})
    return {
        "verdict": record.get("verdict"),
        "effects": {name: effect["probability"] for name, effect in effects.items()},
        "groups": record.get("groups", []),
        "names": record.get("truth", {}).get("names", []),
        "verdicts": record.get("truth", {}).get("verdicts", []),
        "cpu_s": record["cpu_s"],
    }


def collected(folder: Path) -> dict[str, Any]:
    """Results of every record below `folder`."""
    results: dict[str, Any] = {"commit": folder.name, "clips": {}, "tables": {}}
    for path in sorted(folder.rglob("record.json")):
        key = path.parent.relative_to(folder).as_posix()
        record = json.loads(path.read_text(encoding="utf-8"))
        is_table = key.startswith(("concealed", "realdata"))
        shelf = results["tables" if is_table else "clips"]
        shelf[key] = _table(record) if is_table else _clip(record)
    return results


def main() -> None:
    """Write the results file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    results = rounded(collected(parser.parse_args().folder.resolve()))
    results["tables_commit"] = results["commit"]
    if not results["clips"]:
        known = json.loads(RESULTS.read_text(encoding="utf-8"))
        results = {**results, "commit": known["commit"], "clips": known["clips"]}
    write_text_whole(RESULTS, json.dumps(results, indent=1) + "\n")
    print(f"{len(results['clips'])} clips, {len(results['tables'])} tables")


if __name__ == "__main__":
    main()
