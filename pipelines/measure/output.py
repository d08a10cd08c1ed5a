"""What comes out: table, JSON, CSV of results, CSV of tracks, as the contract spells them."""

import json
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table

from metrology import Quantity
from metrology.formatting import format_quantity
from pipelines.measure.measurement import Measurement
from pipelines.measure.metres import MetricTracks
from pipelines.report import quantity_label

__all__ = [
    "measurement_as_json",
    "measurements_as_csv",
    "results_table",
    "software_version",
    "tracks_as_csv",
]

_SUFFIX = {"1": "", "m/s": "_m_s", "N s": "_N_s"}


def software_version() -> str:
    """Version of the installed distribution."""
    try:
        return version("impact-vision")
    except PackageNotFoundError:
        return "0+unknown"


def measurement_as_json(measured: Measurement, names: Sequence[str] | None = None) -> str:
    """JSON of one clip, as the contract has it; `names` keeps only some quantities."""
    info, rate = measured.info, measured.rate
    kept = [item for item in measured.quantities if names is None or item.name in names]
    document = {
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
        "quantities": {item.name: _as_json(item) for item in kept},
        "beside": {item.name: _as_json(item) for item in _beside(measured, names)},
        "checks": [
            {"name": item.name, "passed": item.passed, "statement": item.statement}
            for item in measured.checks
        ],
        "warnings": list(measured.warnings),
        "software": {"version": software_version()},
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)


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


def measurements_as_csv(measured: Sequence[Measurement], names: Sequence[str] | None = None) -> str:
    """One row per clip; columns ``clip`` and, for each quantity, NAME_UNIT and NAME_UNIT_std."""
    rows = []
    for one in measured:
        row: dict[str, object] = {"clip": str(one.info.path)}
        for item in one.quantities:
            if names is not None and item.name not in names:
                continue
            column = item.name + _SUFFIX.get(item.unit, f"_{item.unit}")
            row[column], row[f"{column}_std"] = item.value, item.std
        rows.append(row)
    return pd.DataFrame(rows).to_csv(index=False, lineterminator="\n")


def tracks_as_csv(measured: Measurement) -> str:
    """Track CSV: ball and pendulum, px and, where there is a calibration, m."""
    ball, pendulum = measured.tracks.ball, measured.tracks.pendulum
    metric = None if measured.impact is None else measured.impact.tracks
    calibrated = measured.calibration is not None
    parts = [_rows("ball", ball, metric if calibrated else None)]
    if pendulum is not None:
        parts.append(_rows("pendulum", pendulum.track, None))
    table = pd.concat([part for part in parts if len(part)], ignore_index=True)
    return table.to_csv(index=False, lineterminator="\n", float_format="%.6g")


def _rows(name: str, track: Any, metric: MetricTracks | None) -> pd.DataFrame:
    std = np.sqrt(np.diagonal(track.covariance_px2, axis1=1, axis2=2))
    empty = np.full(len(track), np.nan)
    x, y, x_std, y_std = empty, empty, empty, empty
    if metric is not None:
        x, y = metric.direction * metric.ball_m[:, 0], metric.ball_m[:, 1]
        x_std, y_std = np.sqrt(np.diagonal(metric.ball_cov_m2, axis1=1, axis2=2)).T
    return pd.DataFrame(
        {
            "frame": track.frame,
            "t_s": track.time_s,
            "object": name,
            "x_px": track.centre_px[:, 0],
            "y_px": track.centre_px[:, 1],
            "x_px_std": std[:, 0],
            "y_px_std": std[:, 1],
            "x_m": x,
            "y_m": y,
            "x_m_std": x_std,
            "y_m_std": y_std,
            "radius_px": track.radius_px,
        }
    )


def results_table(measured: Measurement, names: Sequence[str] | None = None) -> Table:
    """Table of the results for a terminal."""
    table = Table(title=Path(measured.info.path).name, title_justify="left")
    table.add_column("quantity")
    table.add_column("value ± standard uncertainty", overflow="fold")
    beside = [item for item in _beside(measured, names) if item.known]
    for item in (*measured.quantities, *beside):
        if names is None or item.name in names or item in beside:
            shown = _shown(item) if item.known else f"– {item.reason}"
            table.add_row(quantity_label(item.name), shown)
    return table


def _shown(item: Quantity) -> str:
    """As it is printed; a count has no decimals."""
    if item.name == "contact_frames" and item.value is not None:
        return f"{item.value:.0f} ± {item.std:.1f}"
    return format_quantity(item)
