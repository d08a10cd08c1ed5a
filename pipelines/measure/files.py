"""Output of a measurement: table, JSON, CSV, tracks, overlay, plots, report."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from measuring.impact import Impact, gap_after, gap_before
from measuring.inputs import QuantityName, kinds_of, main_quantities
from measuring.measurement import BALL, ClipMeasurement, alternative_kinds, in_metres
from measuring.metres import arm_along_bar
from measuring.results import MAX_LANDING_GAP_S
from metrology import Quantity, UsageError, write_each, write_text_whole
from metrology.files import printable
from pipelines.report import (
    Curve,
    GapRecord,
    Moment,
    PathRecord,
    ReportInput,
    SpeedRecord,
)
from pipelines.report.inputs import quantity_label, quantity_rows, quantity_text
from vision.clip.clip import ClipReader
from vision.overlay import OverlayMarks, overlay_still, png_bytes
from vision.stages import candidate_table, detect, detection_table, interpret, link
from vision.tracks import FollowedObject, Motion, MotionKind, Tracks

if TYPE_CHECKING:
    import pandas as pd

    from vision.finding.selection import FoundObjects

__all__ = [
    "WantedFiles",
    "column_name",
    "column_of",
    "measurement_as_dict",
    "measurement_as_json",
    "measurement_as_row",
    "measurements_as_csv",
    "overlay_marks",
    "report_input",
    "results_table",
    "software_version",
    "without_formulas",
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
    """JSON document of one clip (contract); `names` selects quantities."""
    info, rate = measured.info, measured.rate
    kept = [item for item in measured.quantities if names is None or item.name in names]
    other_speeds = _other_speeds(measured, names)
    return {
        "clip": {"path": str(info.path), **_values(info, "sha256 width height frames codec")},
        "time_base": {
            "capture_fps": rate.fps,
            "std": rate.std if rate.known else None,
            "source": rate.source,
            "gravity_check": _as_json(measured.gravity),
        },
        "motion": _motion(measured.tracks.motion),
        "ball": {"reasons": list(measured.tracks.reasons)},
        "others": [
            *(_other(f"ball_{k}", item) for k, item in enumerate(measured.tracks.others, start=2)),
            *(_other(None, item) for item in measured.tracks.dismissed),
        ],
        "quantities": {item.name: _as_json(item) for item in kept},
        "beside": {item.name: _as_json(item) for item in other_speeds},
        "budget": {
            item.name: _budget(item)
            for item in (*kept, *other_speeds, measured.gravity)
            if item.known
        },
        "checks": [
            _values(item, "name passed outcome power statement") | {"outcome": item.outcome.value}
            for item in measured.checks
        ],
        "defaults": [
            _values(known, "name key value value_from std std_from unit source")
            | {"key": known.key or None}
            for known in measured.defaults
        ],
        "warnings": list(measured.warnings),
        "software": {"version": software_version()},
    }


def _values(item: object, names: str) -> dict[str, Any]:
    """Attributes of an object by their names."""
    return {name: getattr(item, name) for name in names.split()}


def _other(name: str | None, item: FollowedObject) -> dict[str, Any]:
    """Another moving object: its name in the track table (None: not listed) and the evidence."""
    frame = item.track.frame
    return {
        "object": name,
        "label": item.model.value,
        "reasons": list(item.reasons),
        "frames": [int(frame[0]), int(frame[-1])] if len(frame) else None,
        "radius_px": float(np.median(item.track.radius_px)) if len(frame) else None,
        "ball_at": None if item.ball_at is None else list(item.ball_at),
    }


def measurement_as_json(measured: ClipMeasurement, names: Sequence[str] | None = None) -> str:
    """JSON text of one clip (contract); `names` selects quantities."""
    document = measurement_as_dict(measured, names)
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    # a name that is no UTF-8 becomes a JSON escape
    return text.encode("utf-8", "backslashreplace").decode()


def _motion(motion: Motion) -> dict[str, Any]:
    """Motion kind, its probability and evidence, and the alternatives."""
    return {
        "kind": motion.kind.value,
        "probability": motion.probability,
        "reasons": list(motion.reasons),
        "alternatives": {kind.value: probability for kind, probability in motion.alternatives},
    }


def _other_speeds(measured: ClipMeasurement, names: Sequence[str] | None) -> tuple[Quantity, ...]:
    """The ball's speed by the paper's methods, if launch quantities are requested."""
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
    """NAME_UNIT of the CSV; no unit for 1."""
    return name + _SUFFIX.get(unit, f"_{unit}")


def column_of(quantity: Quantity) -> str:
    """Column of a quantity in the CSV: NAME_UNIT; no unit for 1."""
    return column_name(quantity.name, quantity.unit)


def measurement_as_row(
    measured: ClipMeasurement, names: Sequence[str] | None = None
) -> dict[str, object]:
    """One row of results: clip, the main quantities of the motion seen, then all others.

    Other speeds, rate, kind of motion and reasons follow.
    """
    row: dict[str, object] = {"clip": str(measured.info.path)}
    main = main_quantities(measured.motion.measured_as)
    kept = [item for item in measured.quantities if names is None or item.name in names]
    kept.sort(key=lambda item: main.index(item.name) if item.name in main else len(main))
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
    rows = [without_formulas(measurement_as_row(one, names)) for one in measured]
    import pandas as pd

    return pd.DataFrame(rows).to_csv(index=False, lineterminator="\n")


def without_formulas(row: Mapping[str, object]) -> dict[str, object]:
    """The row with text that a spreadsheet would run as a formula made harmless.

    A clip may be named ``=cmd|…``: an apostrophe in front makes it text.
    """
    shown = {name: printable(cell) if isinstance(cell, str) else cell for name, cell in row.items()}
    return {
        name: f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA_STARTS) else cell
        for name, cell in shown.items()
    }


def results_table(measured: ClipMeasurement, names: Sequence[str] | None = None) -> Table:
    """Table of the results for a terminal; print it on `pipelines.terminal.screen`."""
    table = Table(title=Path(measured.info.path).name, title_justify="left")
    table.add_column("quantity")
    table.add_column("value ± standard uncertainty", overflow="fold")
    asked = [
        item
        for item in measured.quantities
        if item.known or measured.motion.measured_as in kinds_of(item.name)
        if names is None or item.name in names
    ]
    speeds = [item for item in _other_speeds(measured, names) if item.known]
    for label, text, _ in quantity_rows([*asked, *speeds]):
        table.add_row(label, text)
    return table


_WRITTEN_PROJECTS = (".trk", ".kva")
"""Of Tracker and Kinovea; other names get the track CSV."""


@dataclass(frozen=True)
class WantedFiles:
    """Requested output files; `json` may be "-" for stdout."""

    csv: Path | None = None
    json: str | None = None
    tracks: Path | None = None
    overlay: Path | None = None
    plot: Path | None = None
    report: Path | None = None
    detections: Path | None = None
    tracklets: Path | None = None
    quiet: bool = False

    def files(self) -> dict[str, Path]:
        """Option as typed → file, for the requested files."""
        named = {
            "--csv": self.csv,
            "--json": None if self.json in (None, "-") else Path(str(self.json)),
            "--tracks": self.tracks,
            "--overlay": self.overlay,
            "--plot": self.plot,
            "--report": self.report,
            "--detections": self.detections,
            "--tracklets": self.tracklets,
        }
        return {option: path for option, path in named.items() if path is not None}

    @property
    def pictures(self) -> bool:
        """Whether a picture is requested that shows more than the requested quantities."""
        return not (self.overlay is None and self.plot is None and self.report is None)

    def require_clip(self, clip: Path | None) -> None:
        """Refuse an overlay without a clip.

        Raises
        ------
        UsageError
        """
        if clip is None and self.overlay is not None:
            raise UsageError(
                "--overlay needs the clip, which is not given",
                hint="vision measure CLIP --from-tracks FILE --overlay FILE.mp4",
            )

    def write_unchosen(self, clip: ClipReader) -> None:
        """Write the tables of what was found in a clip in which no ball was.

        Raises
        ------
        UsageError
            As `write`.
        """
        if self.detections is None and self.tracklets is None:
            return
        seen = detect(clip)
        if self.detections is not None:
            write_text_whole(self.detections, _as_csv(seen))
        if self.tracklets is not None and len(seen):
            linked = link(seen)
            weighed = interpret(linked).set_index("tracklet")["probability"]
            linked = linked.assign(probability=linked["tracklet"].map(weighed), measured=0)
            write_text_whole(self.tracklets, _as_csv(linked))

    def require_following(self) -> None:
        """Refuse tables of objects found where no clip is followed.

        Raises
        ------
        UsageError
        """
        if self.detections is not None or self.tracklets is not None:
            raise UsageError(
                "--detections and --tracklets list what is found in a clip; with tracks of another"
                " program nothing is searched",
                hint="Omit --from-tracks, or omit these files.",
            )

    def write(self, measured: ClipMeasurement, clip: Path | None, names: Sequence[str]) -> None:
        """Write all files, each completely or not at all; one that fails does not stop the others.

        Without a clip there is no overlay, and the report has no pictures of it.

        Raises
        ------
        ImpactVisionError
            As `write_each`.
        """
        writers: dict[str, Callable[[Path], None]] = {
            "csv": lambda path: write_text_whole(path, measurements_as_csv([measured], names)),
            "json": lambda path: write_text_whole(
                path, measurement_as_json(measured, names) + "\n"
            ),
            "tracks": lambda path: _write_tracks(path, measured, clip),
            "detections": lambda path: _write_found(
                path, measured, lambda found: detection_table(found.seen)
            ),
            "tracklets": lambda path: _write_found(path, measured, candidate_table),
            "overlay": lambda path: _write_overlay(path, measured, clip),
            "report": lambda path: _write_report(path, measured, clip),
            "plot": lambda path: _write_plot(path, measured),
        }
        write_each(partial(writers[option[2:]], path) for option, path in self.files().items())


def _write_found(
    path: Path, measured: ClipMeasurement, table: "Callable[[FoundObjects], pd.DataFrame]"
) -> None:
    if measured.tracks.found is not None:
        write_text_whole(path, _as_csv(table(measured.tracks.found)))


# imported where it is used: each import takes longer than measuring from the cache
def _write_overlay(path: Path, measured: ClipMeasurement, clip: Path | None) -> None:
    if clip is None:
        return
    from vision.overlay import write_overlay

    film = ClipReader.open(clip, every=measured.info.every)
    write_overlay(path, film, measured.tracks, overlay_marks(measured))


def _write_report(path: Path, measured: ClipMeasurement, clip: Path | None) -> None:
    from pipelines.report.page import write_report

    film = None if clip is None else ClipReader.open(clip, every=measured.info.every)
    write_report(path, report_input(measured, film))


def _write_plot(path: Path, measured: ClipMeasurement) -> None:
    from pipelines.report.plots import write_plot

    write_plot(path, report_input(measured, None))


def _write_tracks(path: Path, measured: ClipMeasurement, clip: Path | None) -> None:
    """Write the track CSV, or another program's project if the file ending is that of one."""
    if path.suffix.lower() in _WRITTEN_PROJECTS:
        from pipelines.interop.measured import external_of, write_tracks

        write_tracks(path, external_of(measured, path, clip))
        return
    from measuring.measurement import tracks_as_csv

    write_text_whole(path, tracks_as_csv(measured))


def _as_csv(table: "pd.DataFrame") -> str:
    # six digits: 0.01 px in a 4K picture, finer than any detection
    return table.to_csv(index=False, lineterminator="\n", float_format="%.6g")


FloatArray = NDArray[np.float64]

_PENDULUM_STRETCH_S = 0.08
"""s around contact in plots (chosen: five contact times on either side)."""

_CAPTIONED_QUANTITIES = ("contact_time", "ball_speed", "launch_angle", "landing_distance", "cor")


def overlay_marks(measured: ClipMeasurement) -> OverlayMarks:
    """Marks of the overlay in addition to the tracks."""
    fps = measured.rate.fps
    captions = tuple(
        f"{quantity_label(item.name)}: {quantity_text(item)}"
        for item in measured.quantities
        if item.name in _CAPTIONED_QUANTITIES and item.known
    )
    grid = None if measured.grid is None else measured.grid.points_px
    marks = OverlayMarks(captions=captions, grid_px=grid, capture_fps=fps)
    impact = measured.impact
    if impact is not None and impact.contact is not None:
        first = int(np.ceil(impact.contact.onset_s * fps))
        last = int(np.floor(impact.contact.release_s * fps))
        if last >= first:
            marks = replace(marks, contact=(first, last))
    landing = measured.quantity("landing_distance")
    calibration = measured.calibration
    if measured.tracks.landing_px is not None:
        marks = replace(marks, landing_px=measured.tracks.landing_px)
    elif landing.value is not None and calibration is not None and impact is not None:
        x, y = _landing_spot(impact, landing.value)
        spot = np.array([impact.tracks.direction * x, y, calibration.ball_plane_offset])
        marks = replace(marks, landing_px=calibration.camera.project(spot))
    return marks


def report_input(measured: ClipMeasurement, clip: ClipReader | None) -> ReportInput:
    """Content of the one-page report; `clip` adds a still picture."""
    impact, info = measured.impact, measured.info
    facts = (
        ("clip", printable(str(info.path))),
        ("picture", f"{info.width} × {info.height} px, {info.frames} frames, {info.codec}"),
        ("capture rate", f"{measured.rate.fps:g} fps ({measured.rate.source})"),
    )
    main = [str(name) for name in main_quantities(measured.motion.measured_as)]
    every = (*measured.quantities, *measured.other_speeds, measured.gravity)
    place = {name: number for number, name in enumerate(main)}
    base = ReportInput(
        title=f"Measurement of {printable(Path(info.path).name)}",
        facts=facts,
        quantities=tuple(sorted(every, key=lambda one: place.get(one.name, len(place)))),
        checks=measured.checks,
        warnings=measured.warnings,
        version=software_version(),
        defaults=tuple(known.in_words for known in measured.defaults),
        seen=_seen(measured.tracks),
    )
    if clip is not None:
        marks = overlay_marks(measured)
        frame = None if marks.contact is None else marks.contact[0]
        still = overlay_still(clip, measured.tracks, marks, frame=frame)
        base = replace(base, still_png=png_bytes(still))
    if measured.plane is None:
        return base
    if impact is None:
        return _of_track(base, measured)
    gap, path = _gap(measured, impact), _path(measured, impact)
    return replace(base, gap=gap, speeds=_speeds(impact), path=path)


def _of_track(base: ReportInput, measured: ClipMeasurement) -> ReportInput:
    """The report with path and speeds of what moves without a strike."""
    tracks = measured.tracks
    moving = {BALL: tracks.ball}
    if measured.motion.measured_as is MotionKind.COLLISION:
        moving |= {f"{BALL}_{k}": one.track for k, one in enumerate(tracks.others, start=2)}
    found = {name: in_metres(measured, name, track) for name, track in moving.items()}
    speeds = tuple(
        _frame_speed(name, moving[name].time_s, *metric)
        for name, metric in found.items()
        if metric is not None and len(moving[name]) > 1
    )
    metric = found[BALL]
    if metric is None:
        return base
    place, std = metric[0], np.sqrt(np.diagonal(metric[1], axis1=1, axis2=2))
    return replace(base, speeds=speeds, path=PathRecord(tracks.ball.time_s, *place.T, *std.T))


def _seen(tracks: Tracks) -> tuple[tuple[str, str], ...]:
    """Motion and moving objects, each with its evidence and how to point at it."""
    motion = tracks.motion
    left = alternative_kinds(motion)
    beside = [f"Alternatives: {left}."] if left else []
    lines = [
        (f"{motion.kind.value}, probability {motion.probability:.2f}", (*motion.reasons, *beside)),
        ("ball", tracks.reasons),
    ]
    named = [(f"ball_{place}", item) for place, item in enumerate(tracks.others, start=2)]
    for name, item in (*named, *(("also moves", item) for item in tracks.dismissed)):
        evidence = (f"{item.model.value}.", *item.reasons)
        if item.ball_at is not None:
            x, y, frame = item.ball_at
            evidence = (*evidence, f"If this is the ball: --ball-at {x},{y},{frame}.")
        lines.append((name, evidence))
    return tuple((name, " ".join(texts)) for name, texts in lines if texts)


def _gap(measured: ClipMeasurement, impact: Impact) -> GapRecord | None:
    view, contact, tracks = impact.view, impact.contact, impact.tracks
    if view is None or contact is None:
        return None
    start, end = contact.onset_s - 0.02, contact.release_s + 0.02
    seen = (tracks.swing_time_s > start) & (tracks.swing_time_s < end)
    common, at, ball_at = np.intersect1d(
        tracks.swing_time_s[seen], tracks.ball_time_s, return_indices=True
    )
    phi, std = tracks.swing_rad[seen][at], tracks.swing_std_rad[seen][at]
    arm = tracks.ball_m[ball_at] - view.pivot
    gap = arm[:, 0] * np.cos(phi) + arm[:, 1] * np.sin(phi) - view.radius
    middle = 0.5 * (contact.onset_s + contact.release_s)
    gap -= np.where(common < middle, *contact.face)
    reach = np.hypot(*arm.T)
    spread = np.hypot(std * reach, np.sqrt(tracks.ball_cov_m2[ball_at, 0, 0]))
    before = np.linspace(start, contact.onset_s + 0.003, 40)
    after = np.linspace(contact.release_s - 0.003, end, 40)
    fits = (
        Curve(before, gap_before(view, before) - contact.face[0], "before contact"),
        Curve(after, gap_after(view, after) - contact.face[1], "after contact"),
    )
    moments = [
        Moment(at, measured.quantity(name).std or 0.0)
        for at, name in ((contact.onset_s, "contact_start"), (contact.release_s, "contact_end"))
    ]
    return GapRecord(common, gap, spread, moments[0], moments[1], fits)


def _speeds(impact: Impact) -> tuple[SpeedRecord, ...]:
    tracks = impact.tracks
    ball = _frame_speed("ball", tracks.ball_time_s, tracks.ball_m, tracks.ball_cov_m2)
    flown = impact.flight.time_s
    states = impact.flight.states(flown)
    curve = Curve(flown, np.hypot(states[:, 2], states[:, 3]), "fitted flight")
    return (replace(ball, fits=(curve,)), *_pendulum_speed(impact))


def _pendulum_speed(impact: Impact) -> tuple[SpeedRecord, ...]:
    """Speed of the pendulum at the point of contact; nothing is fitted across contact."""
    view, contact, tracks = impact.view, impact.contact, impact.tracks
    if view is None or contact is None:
        return ()
    arm = arm_along_bar(tracks.rest_m - view.pivot, view.before.state(contact.onset_s)[0])
    near = np.abs(tracks.swing_time_s - contact.onset_s) < _PENDULUM_STRETCH_S
    time, angle = tracks.swing_time_s[near], tracks.swing_rad[near]
    step = np.diff(time)
    std = arm * np.hypot(tracks.swing_std_rad[near][1:], tracks.swing_std_rad[near][:-1]) / step
    sides = (
        (view.before, time[time < contact.onset_s], "swing before"),
        (view.after, time[time > contact.release_s], "swing after"),
    )
    fits = tuple(
        Curve(at, arm * np.array([swing.state(float(t))[1] for t in at]), label)
        for swing, at, label in sides
    )
    middle = 0.5 * (time[1:] + time[:-1])
    return (SpeedRecord("pendulum", middle, arm * np.diff(angle) / step, std, fits),)


def _frame_speed(
    label: str, time_s: FloatArray, position: FloatArray, covariance: FloatArray
) -> SpeedRecord:
    """Displacement per frame, the paper's method (Fig. 18)."""
    step = np.diff(time_s)
    near = step < 3 * np.median(step)
    speed = np.hypot(*np.diff(position, axis=0).T) / step
    variance = np.trace(covariance, axis1=1, axis2=2) / 2
    std = np.sqrt(variance[1:] + variance[:-1]) / step
    middle = 0.5 * (time_s[1:] + time_s[:-1])
    return SpeedRecord(label, middle[near], speed[near], std[near])


def _landing_spot(impact: Impact, distance: float) -> tuple[float, float]:
    """The ball's centre where it lands, `distance` from its rest: (x, y) in the ball plane, m."""
    if impact.tracks.landing is not None:
        x, y = impact.tracks.landing[0]
        return float(x), float(y)
    flight, x = impact.flight, float(impact.tracks.rest_m[0]) + distance
    drawn_s = np.linspace(flight.reference_s, impact.last_flight_s + MAX_LANDING_GAP_S, 500)
    states = flight.states(drawn_s)
    return x, float(np.interp(x, states[:, 0], states[:, 1]))


def _path(measured: ClipMeasurement, impact: Impact) -> PathRecord:
    tracks, flight = impact.tracks, impact.flight
    std = np.sqrt(np.diagonal(tracks.ball_cov_m2, axis1=1, axis2=2))
    drawn_s = np.linspace(flight.time_s[0], flight.time_s[-1], 120)
    states = flight.states(drawn_s)
    used = np.isin(tracks.ball_time_s, flight.time_s)
    landing = measured.quantity("landing_distance")
    spot = None
    if landing.value is not None:
        spot = _landing_spot(impact, landing.value)
    return PathRecord(
        tracks.ball_time_s,
        tracks.ball_m[:, 0],
        tracks.ball_m[:, 1],
        std[:, 0],
        std[:, 1],
        (Curve(states[:, 0], states[:, 1], "fitted flight"),),
        spot,
        landing.std,
        flight.time_s,
        flight.residual_m[:, 0],
        flight.residual_m[:, 1],
        std[used].mean(axis=1),
    )
