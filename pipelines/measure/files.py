"""A measurement as files: table, JSON, CSV, tracks, pictures.

What comes out: table, JSON, CSV of results, as the contract spells them.

Where the results of a measuring command go; checked before minutes of work, not after.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from metrology import Quantity, UsageError, write_text_whole
from pipelines.measure.inputs import QuantityName, kinds_of
from pipelines.measure.measurement import ClipMeasurement
from pipelines.report.inputs import quantity_label, quantity_text
from vision.clip.clip import ClipReader
from vision.overlay import OVERLAY_SUFFIXES
from vision.tracks import FollowedObject, Motion

__all__ = [
    "WantedFiles",
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
    measured: ClipMeasurement, names: Sequence[str] | None = None
) -> dict[str, Any]:
    """The contract's JSON of one clip; `names` keeps only some quantities."""
    info, rate = measured.info, measured.rate
    kept = [item for item in measured.quantities if names is None or item.name in names]
    other_speeds = _other_speeds(measured, names)
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
        "others": [
            *(
                _other(f"ball_{place}", thing)
                for place, thing in enumerate(measured.tracks.others, start=2)
            ),
            *(_other(None, thing) for thing in measured.tracks.dismissed),
        ],
        "quantities": {item.name: _as_json(item) for item in kept},
        "beside": {item.name: _as_json(item) for item in other_speeds},
        "budget": {
            item.name: _budget(item)
            for item in (*kept, *other_speeds, measured.gravity)
            if item.known
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


def _other(name: str | None, thing: FollowedObject) -> dict[str, Any]:
    """What else moved, as the track table names it (None: it is not in there), and why it is so."""
    frame = thing.track.frame
    return {
        "object": name,
        "label": thing.model.value,
        "reasons": list(thing.reasons),
        "frames": [int(frame[0]), int(frame[-1])] if len(frame) else None,
        "radius_px": float(np.median(thing.track.radius_px)) if len(frame) else None,
    }


def measurement_as_json(measured: ClipMeasurement, names: Sequence[str] | None = None) -> str:
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


def _other_speeds(measured: ClipMeasurement, names: Sequence[str] | None) -> tuple[Quantity, ...]:
    """The ball's speed the paper's ways, where its speed is asked for."""
    return measured.other_speeds if names is None or QuantityName.LAUNCH_ANGLE in names else ()


def _as_json(quantity: Quantity) -> dict[str, Any]:
    if quantity.value is None:
        return {"value": None, "unit": quantity.unit, "reason": quantity.reason}
    whole = quantity.name == QuantityName.CONTACT_FRAMES
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
    measured: ClipMeasurement, names: Sequence[str] | None = None
) -> dict[str, object]:
    """One row of results: clip, quantities, the paper's ways, rate and its source, reasons."""
    row: dict[str, object] = {"clip": str(measured.info.path)}
    kept = [item for item in measured.quantities if names is None or item.name in names]
    items = (*kept, *_other_speeds(measured, names))
    for item in items:
        row[column_of(item)], row[f"{column_of(item)}_std"] = item.value, item.std
    row |= {
        "capture_fps": measured.rate.fps,
        "capture_fps_std": measured.rate.std if measured.rate.known else None,
        "capture_fps_source": str(measured.rate.source),
        "motion": measured.tracks.motion.kind.value,
    }
    return row | {f"reason_{item.name}": item.reason or "" for item in items}


def measurements_as_csv(
    measured: Sequence[ClipMeasurement], names: Sequence[str] | None = None
) -> str:
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


def results_table(measured: ClipMeasurement, names: Sequence[str] | None = None) -> Table:
    """Table of the results for a terminal; print it on `pipelines.terminal.screen`."""
    table = Table(title=Path(measured.info.path).name, title_justify="left")
    table.add_column("quantity")
    table.add_column("value ± standard uncertainty", overflow="fold")
    other_speeds = [item for item in _other_speeds(measured, names) if item.known]
    for item in (*measured.quantities, *other_speeds):
        seen = item.known or measured.motion.kind in kinds_of(item.name)
        if item in other_speeds or (seen and (names is None or item.name in names)):
            table.add_row(quantity_label(item.name), quantity_text(item))
    return table


_PLOT_SUFFIXES = (".png", ".svg")

_PROJECT_SUFFIXES = (".trk", ".kva")

"""Of Tracker and Kinovea; whatever else is asked for gets the track CSV."""


@dataclass(frozen=True)
class WantedFiles:
    """The files asked for; `json` may be "-" for stdout."""

    csv: Path | None = None
    json: str | None = None
    tracks: Path | None = None
    overlay: Path | None = None
    plot: Path | None = None
    report: Path | None = None
    quiet: bool = False

    def files(self) -> dict[str, Path]:
        """What people typed → the file, of those that are wanted."""
        named = {
            "--csv": self.csv,
            "--json": None if self.json in (None, "-") else Path(str(self.json)),
            "--tracks": self.tracks,
            "--overlay": self.overlay,
            "--plot": self.plot,
            "--report": self.report,
        }
        return {option: path for option, path in named.items() if path is not None}

    @property
    def pictures(self) -> bool:
        """Whether any of them shows more of the clip than the quantities that were asked for."""
        return not (self.overlay is None and self.plot is None and self.report is None)

    def require_kinds(self) -> None:
        """Refuse an overlay or a plot whose name does not say what kind of file it is.

        Raises
        ------
        UsageError
        """
        files = self.files()
        for kinds, given in (("--overlay", OVERLAY_SUFFIXES), ("--plot", _PLOT_SUFFIXES)):
            if kinds in files and files[kinds].suffix.lower() not in given:
                raise UsageError(
                    f"{kinds} {files[kinds]}: its name does not say what kind of file it is",
                    hint=f"Name a file that ends in {', '.join(given)}.",
                )

    def require_clip(self, clip: Path | None) -> None:
        """Refuse pictures of a clip that is not given.

        Raises
        ------
        UsageError
        """
        if clip is None and self.overlay is not None:
            raise UsageError(
                "--overlay draws on the clip, which is not given",
                hint="vision measure CLIP --from-tracks FILE --overlay FILE.mp4",
            )

    def write(self, measured: ClipMeasurement, clip: Path | None, names: Sequence[str]) -> None:
        """Write all files; each is written whole or not at all.

        Without a clip there is no overlay, and the report has no pictures of it.

        Raises
        ------
        UsageError
            If one can't be written.
        """
        # each of these imports what takes longer to load than a clip to measure again
        files = self.files()
        if self.csv is not None:
            write_text_whole(self.csv, measurements_as_csv([measured], names))
        if "--json" in files:
            write_text_whole(files["--json"], measurement_as_json(measured, names) + "\n")
        if self.tracks is not None:
            _write_tracks(self.tracks, measured, clip)
        if self.overlay is not None and clip is not None:
            from pipelines.measure.pictures import overlay_marks
            from vision.overlay.overlay import write_overlay

            write_overlay(
                self.overlay, ClipReader.open(clip), measured.tracks, overlay_marks(measured)
            )
        if self.plot is not None:
            from pipelines.measure.pictures import report_input
            from pipelines.report.plots import write_plot

            write_plot(self.plot, report_input(measured, None))
        if self.report is not None:
            from pipelines.measure.pictures import report_input
            from pipelines.report.page import write_report

            write_report(
                self.report, report_input(measured, None if clip is None else ClipReader.open(clip))
            )


def _write_tracks(path: Path, measured: ClipMeasurement, clip: Path | None) -> None:
    """The track CSV, or the project of another program where the name says so."""
    if path.suffix.lower() in _PROJECT_SUFFIXES:
        from pipelines.interop.measured import external_of, write_tracks

        write_tracks(path, external_of(measured, path, clip))
        return
    from pipelines.measure.track_table import tracks_as_csv

    write_text_whole(path, tracks_as_csv(measured))
