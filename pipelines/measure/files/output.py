"""What comes out: table, JSON, CSV of results, as the contract spells them."""

import json
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rich.table import Table

from metrology import Quantity
from pipelines.measure.measurement import Measurement
from pipelines.measure.names import kinds_of
from pipelines.report.labels import quantity_label, quantity_text
from vision.tracks import Motion

__all__ = [
    "column_name",
    "column_of",
    "harmless",
    "measurement_as_dict",
    "measurement_as_json",
    "measurement_as_row",
    "measurements_as_csv",
    "results_table",
    "software_version",
]

_SUFFIX = {"1": "", "m/s": "_m_s", "N s": "_N_s", "m/s^2": "_m_s2", "1/s": "_1_s", "px/s": "_px_s"}
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def software_version() -> str:
    """Version of the installed distribution."""
    try:
        return version("impact-vision")
    except PackageNotFoundError:
        return "0+unknown"


def measurement_as_dict(
    measured: Measurement, names: Sequence[str] | None = None
) -> dict[str, Any]:
    """The contract's JSON of one clip; `names` keeps only some quantities."""
    info, rate = measured.info, measured.rate
    kept = [item for item in measured.quantities if names is None or item.name in names]
    beside = _beside(measured, names)
    return {
        "clip": {
            "path": str(info.path),
            "sha256": info.sha256,
            "width": info.width,
            "height": info.height,
            "frames": info.frames,
            "codec": info.codec,
        },
        "time_base": {
            "capture_fps": rate.fps,
            "std": rate.std if rate.known else None,
            "source": rate.source,
            "gravity_check": _as_json(measured.gravity),
        },
        "motion": _motion(measured.tracks.motion),
        "quantities": {item.name: _as_json(item) for item in kept},
        "beside": {item.name: _as_json(item) for item in beside},
        "budget": {
            item.name: _budget(item) for item in (*kept, *beside, measured.gravity) if item.known
        },
        "checks": [
            {
                "name": item.name,
                "passed": item.passed,
                "outcome": item.outcome.value,
                "power": item.power,
                "statement": item.statement,
            }
            for item in measured.checks
        ],
        "defaults": [
            {
                "name": known.name,
                "key": known.key or None,
                "value": known.value,
                "value_from": known.value_from,
                "std": known.std,
                "std_from": known.std_from,
                "unit": known.unit,
                "source": known.source,
            }
            for known in measured.defaults
        ],
        "warnings": list(measured.warnings),
        "software": {"version": software_version()},
    }


def measurement_as_json(measured: Measurement, names: Sequence[str] | None = None) -> str:
    """JSON of one clip, as the contract has it; `names` keeps only some quantities."""
    document = measurement_as_dict(measured, names)
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)


def _motion(motion: Motion) -> dict[str, Any]:
    """What was seen to happen, what speaks for it, and what else it could be."""
    return {
        "kind": motion.kind.value,
        "probability": motion.probability,
        "reasons": list(motion.reasons),
        "alternatives": {kind.value: share for kind, share in motion.alternatives},
    }


def _beside(measured: Measurement, names: Sequence[str] | None) -> tuple[Quantity, ...]:
    """The ball's speed the paper's ways, where its speed is asked for."""
    return measured.beside if names is None or "launch_angle" in names else ()


def _as_json(quantity: Quantity) -> dict[str, Any]:
    if quantity.value is None:
        return {"value": None, "unit": quantity.unit, "reason": quantity.reason}
    whole = quantity.name == "contact_frames"
    return {
        "value": int(quantity.value) if whole else quantity.value,
        "std": quantity.std,
        "unit": quantity.unit,
    }


def _budget(quantity: Quantity) -> list[dict[str, Any]]:
    """Lines of the budget, largest first."""
    lines = sorted(quantity.budget, key=lambda line: -line.std)
    return [
        {"source": str(line.source), "std": line.std, "shared": line.source.shared_by_setup}
        for line in lines
    ]


def column_name(name: str, unit: str) -> str:
    """NAME_UNIT as the CSV spells it, nothing for 1."""
    return name + _SUFFIX.get(unit, f"_{unit}")


def column_of(quantity: Quantity) -> str:
    """Column of a quantity in the CSV: NAME_UNIT, nothing for 1."""
    return column_name(quantity.name, quantity.unit)


def measurement_as_row(
    measured: Measurement, names: Sequence[str] | None = None
) -> dict[str, object]:
    """One row of results: clip, quantities, the paper's ways, rate and its source, reasons."""
    row: dict[str, object] = {"clip": str(measured.info.path)}
    kept = [item for item in measured.quantities if names is None or item.name in names]
    items = (*kept, *_beside(measured, names))
    for item in items:
        row[column_of(item)], row[f"{column_of(item)}_std"] = item.value, item.std
    row |= {
        "capture_fps": measured.rate.fps,
        "capture_fps_std": measured.rate.std if measured.rate.known else None,
        "capture_fps_source": str(measured.rate.source),
        "motion": measured.tracks.motion.kind.value,
    }
    return row | {f"reason_{item.name}": item.reason or "" for item in items}


def measurements_as_csv(measured: Sequence[Measurement], names: Sequence[str] | None = None) -> str:
    """CSV of results, one row per clip."""
    rows = [harmless(measurement_as_row(one, names)) for one in measured]
    import pandas as pd

    return pd.DataFrame(rows).to_csv(index=False, lineterminator="\n")


def harmless(row: Mapping[str, object]) -> dict[str, object]:
    """The row with no text in it that a spreadsheet would run as a formula.

    A clip may be called ``=cmd|…``: an apostrophe before it keeps it a word.
    """
    return {
        name: f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA_STARTS) else cell
        for name, cell in row.items()
    }


def results_table(measured: Measurement, names: Sequence[str] | None = None) -> Table:
    """Table of the results for a terminal; print it on `pipelines.terminal.screen`."""
    table = Table(title=Path(measured.info.path).name, title_justify="left")
    table.add_column("quantity")
    table.add_column("value ± standard uncertainty", overflow="fold")
    beside = [item for item in _beside(measured, names) if item.known]
    for item in (*measured.quantities, *beside):
        seen = item.known or measured.motion.kind in kinds_of(item.name)
        if item in beside or (seen and (names is None or item.name in names)):
            table.add_row(quantity_label(item.name), quantity_text(item))
    return table
