"""Explain tables and clips: read files, build the baseline, run the engine."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd

from measuring.setup.file import BallSetup, Origin, Setup, rig_of, setup_from
from metrology import Defaults, SetupError, TooLittleDataError, UsageError
from mismatch import ExplainedCampaign, Options, explain_in_full
from mismatch.fitting.stated import stated_inputs
from mismatch.records import (
    BallModel,
    Baseline,
    CampaignRecords,
    ContactTable,
    Scatter,
    Trial,
)
from mismatch.sanity import FARTHEST, in_other_unit
from mismatch.trial_table import CHANNELS, TableExplained, TrialTable, explain_table
from physics import bodies
from physics.contact import contact_outcomes
from physics.domain import FloatArray
from physics.effects import Effect, EffectId
from pipelines.explain.clips import (
    ClipCampaign,
    campaign_from_clips,
    clip_facts,
    flight_rows,
    has_rig,
    is_track_table,
    swing_rows,
    unknown_widths,
    with_rig,
    within_calibration,
)
from pipelines.explain.own_effects import check_effect, effect_limits, load_effects
from pipelines.explain.tabular import (
    NoTableError,
    Sheet,
    TableLike,
    name_of,
    numbers_of,
    read_sheet,
)
from pipelines.interop.tables import made_elsewhere, read_samples

__all__ = [
    "baseline_for_balls",
    "baseline_from_setup",
    "explain_campaign",
    "explain_clips",
    "explain_files",
    "explain_table_file",
    "is_trial_table",
    "load_campaign",
    "load_trial_table",
]

SAMPLE_UNITS = {"t": "s", "x": "m", "y": "m", "z": "m", "phi": "rad", "backswing": "deg"}
"""Stem of each column of numbers → its unit."""

NUMBER_COLUMNS = (
    "t_s", "x_m", "y_m", "z_m", "phi_rad", "backswing_deg", "x_m_std", "y_m_std", "z_m_std",
)  # fmt: skip

TEXT_COLUMNS = ("ball", "session")
"""Columns of words that are constant within a trial."""
COARSE_CLOCK_FRACTION = 0.2
"""Fraction of rows with a repeated time from which the clock is too coarse (chosen)."""
MAX_TRIAL_ROWS = 8000
"""Rows per trial (chosen: more add no information about its motion)."""

MAX_SAMPLES = 120_000
"""Rows of a campaign fitted at once (chosen: more take minutes and add no information)."""

MAX_TRIALS = 400
"""Trials of a campaign fitted at once (chosen)."""

MIN_RUN_ROWS = 6
"""Consecutive rows that form a stretch of record rather than misplaced rows (chosen)."""

CONTACT_TABLE_SPEEDS = np.array([0.6, 0.9, 1.3, 1.8, 2.4, 3.0, 3.6, 4.2])
"""m/s: impact speeds of the tabulated contact. The paper's rig strikes at 1 to 4 m/s; the spacing
is smaller at low speeds, where gravity matters more."""


def _checked(sheet: Sheet, needed: tuple[str, ...]) -> tuple[pd.DataFrame, list[str]]:
    """The table with numeric columns parsed, and notes on cells that failed."""
    table, what, notes = sheet.table, sheet.name, list(sheet.notes)
    missing = [name for name in needed if name not in table.columns]
    if missing:
        raise UsageError(
            f"{what} has no column {', '.join(missing)}; it has {', '.join(table.columns)}",
            hint="Input of `vision explain`: columns trial, t_s and at least one of x_m, y_m, z_m.",
        )
    if table.empty:
        raise UsageError(f"{what} has a header but no rows", hint="Write one row per sample.")
    for name in NUMBER_COLUMNS:
        if name in table.columns:
            positive = name.endswith("_std")
            table[name] = numbers_of(table, name, what, notes, positive=positive)
    nameless = table["trial"].isna()
    if nameless.any():
        notes.append(f"{what}: {int(nameless.sum())} rows without a trial name are ignored")
        table = table[~nameless]
    return table, notes


def _tidied(
    table: pd.DataFrame, value_columns: list[str], what: str
) -> tuple[pd.DataFrame, list[str]]:
    """Drop rows without time or values and duplicates; sort each trial by time."""
    notes = []
    count = len(table)
    bad = table["t_s"].isna() | ~np.isfinite(table["t_s"]) | table[value_columns].isna().all(axis=1)
    table = table[~bad]
    if int(bad.sum()):
        notes.append(f"{what}: {int(bad.sum())} of {count} rows lack a time or values; ignored")
    doubled = table.duplicated(["trial", "t_s"])
    apart = doubled & ~table.duplicated(["trial", "t_s", *value_columns])
    if float(apart.mean() if len(apart) else 0.0) > COARSE_CLOCK_FRACTION:
        raise UsageError(
            f"{what}: {int(apart.sum())} of {count} rows repeat a time of their trial with other"
            " values",
            hint="Check whether times are rounded, or two recordings share one trial name.",
        )
    if int(doubled.sum()):
        notes.append(f"{what}: {int(doubled.sum())} rows repeat a time of their trial; ignored")
        table = table[~doubled]
    table = _drop_contradictory(table, what, notes)
    times = table.groupby("trial", sort=False)["t_s"]
    set_back = [str(name) for name, t in times if _set_back(t.to_numpy())]
    if set_back:
        names = ", ".join(set_back[:4])
        table = table[~table["trial"].isin(set_back)]
        if table.empty:
            raise UsageError(
                f"{what}: the time jumps back within trial {names}",
                hint="If several trials share this name, give each its own name and clock.",
            )
        notes.append(f"{what}: the time jumps back within trial {names}; trial ignored")
        times = table.groupby("trial", sort=False)["t_s"]
    backwards = times.apply(lambda t: bool((t.diff() < 0).any()))
    if bool(backwards.any()):
        names = ", ".join(str(name) for name in backwards[backwards].index[:4])
        notes.append(f"{what}: rows of trial {names} were not in order; sorted by time")
        table = table.sort_values(["trial", "t_s"], kind="stable")
    return _subsampled(table, what, notes), notes


def _drop_contradictory(table: pd.DataFrame, what: str, notes: list[str]) -> pd.DataFrame:
    """Drop trials that state two balls, sessions or back-swings."""
    contradictions = {
        "backswing_deg": "two back-swings",
        "ball": "two balls",
        "session": "two sessions",
    }
    for column, said in contradictions.items():
        if column not in table:
            continue
        stated = table.groupby("trial", sort=False)[column].nunique()
        torn = [str(name) for name in stated[stated > 1].index]
        if not torn:
            continue
        names = f"{', '.join(torn[:4])}{', …' if len(torn) > 4 else ''}"
        table = table[~table["trial"].astype(str).isin(torn)]
        if table.empty:
            raise UsageError(
                f"{what}: the column {column} states {said} within trial {names}",
                hint="Each trial has one. If several trials share this name, rename them.",
            )
        notes.append(f"{what}: trial {names} states {said} in {column}; trial ignored")
    return table


def _subsampled(table: pd.DataFrame, what: str, notes: list[str]) -> pd.DataFrame:
    """Every n-th row of long trials, and every n-th of many trials."""
    names = table["trial"].drop_duplicates()
    if len(names) > MAX_TRIALS:
        stride = -(-len(names) // MAX_TRIALS)
        notes.append(f"{what}: of {len(names)} trials one in {stride} is used")
        table = table[table["trial"].isin(set(names.iloc[::stride]))]
    trials = table.groupby("trial", sort=False)
    sizes = trials["t_s"].transform("size").to_numpy()
    most = min(MAX_TRIAL_ROWS, max(MAX_SAMPLES // max(trials.ngroups, 1), MIN_RUN_ROWS))
    every = -(-sizes // most)
    if sizes.size == 0 or int(every.max()) < 2:
        return table
    place = trials.cumcount().to_numpy()
    notes.append(
        f"{what}: trials of more than {most} rows are reduced, the longest to one row in"
        f" {int(every.max())}"
    )
    kept: pd.DataFrame = table[place % every == 0]
    return kept


def _set_back(time: FloatArray) -> bool:
    """Whether the time jumps back, so that two runs of rows cover the same time.

    Misplaced single rows do not count: sorted, they form one record.
    """
    cuts = np.flatnonzero(np.diff(time) < 0.0) + 1
    runs = [run for run in np.split(time, cuts) if run.size >= MIN_RUN_ROWS]
    spans = sorted((float(run.min()), float(run.max())) for run in runs)
    return any(later[0] < earlier[1] for earlier, later in itertools.pairwise(spans))


def _numbers(table: pd.DataFrame, column: str) -> FloatArray:
    return np.asarray(table[column], dtype=np.float64)


def _samples(
    source: TableLike, needed: tuple[str, ...], setup: Setup
) -> tuple[pd.DataFrame, list[str]]:
    """Rows of the ball, or of the pendulum if `phi_rad` is needed; notes on reading them."""
    trial = source.stem if isinstance(source, Path) else "1"
    if isinstance(source, Path) and made_elsewhere(source, setup.columns):
        # import here: it needs the measuring chain
        from pipelines.interop.measured import track_table

        source = track_table(source, setup.columns)
    notes: tuple[str, ...] = ()
    if isinstance(source, Path) and "phi_rad" not in needed:
        source, notes = _foreign(source, setup.columns)
    sheet = read_sheet(source, SAMPLE_UNITS, ("trial", *TEXT_COLUMNS))
    sheet = replace(sheet, notes=(*notes, *sheet.notes))
    table = sheet.table
    if is_track_table(table):
        if "phi_rad" in needed:
            table = swing_rows(table, trial)
        else:
            table = flight_rows(table, trial, _rest_height(setup))
        table = table.assign(trial=table.get("trial", trial))
    return _checked(replace(sheet, table=table), needed)


def _foreign(path: Path, said: Mapping[str, str]) -> tuple[TableLike, tuple[str, ...]]:
    """Samples of a table with other columns than ours, with notes; the path of any other.

    A table with some of our columns is reported by those that it lacks.
    """
    if path.suffix.lower() == ".xlsx":
        return read_samples(path, said)
    columns: set[str] = set()
    try:
        columns = set(read_sheet(path, SAMPLE_UNITS, rows=1).table.columns)
    except NoTableError:
        raise
    except UsageError:
        if not path.is_file():
            return path, ()
    places = columns & {"x_m", "y_m", "z_m"}
    if is_track_table(pd.DataFrame(columns=list(columns))) or ("t_s" in columns and places):
        return path, ()
    try:
        return read_samples(path, said)
    except UsageError:
        if not columns or not (places or "t_s" in columns):
            raise
        return path, ()


def _rest_height(setup: Setup) -> float:
    """Height of the resting ball's centre, m; 0 if the support or the ball is unknown."""
    ball = setup.ball or next(iter(setup.balls.values()), None)
    if setup.support is None or ball is None:
        return 0.0
    return setup.support.height + 0.5 * ball.diameter


def load_campaign(
    ball_csv: TableLike | None, pendulum_csv: TableLike | None, setup: Setup
) -> CampaignRecords:
    """Read the tables of a campaign.

    Parameters
    ----------
    ball_csv, pendulum_csv : Path, DataFrame or None
        As in the contract; one of them may be missing. For a track table of ``vision measure
        --tracks`` the free flight, or the free swing, is selected.
    setup : Setup
        Gives the ball if the file has no column ``ball``.

    Raises
    ------
    UsageError
        For files that can't be read, lack a column, or are empty.
    TooLittleDataError
        If no row of the ball's file is usable.
    """
    if ball_csv is None and pendulum_csv is None:
        raise UsageError(
            "no table of a ball or of a pendulum was given",
            hint="Pass a table of the ball (BALL.csv), of the pendulum (--pendulum), or clips.",
        )
    balls: dict[str, pd.DataFrame] = {}
    swings: dict[str, pd.DataFrame] = {}
    notes: list[str] = []
    tracked = False
    if ball_csv is not None:
        balls, tracked, notes = _balls_of(ball_csv, setup)
    if pendulum_csv is not None:
        swings, swing_tracked, more = _swings_of(pendulum_csv, setup)
        notes += more
        tracked = tracked or swing_tracked
    names = list(dict.fromkeys([*balls, *swings]))
    if ball_csv is not None:
        names = [name for name in names if name in balls]
        alone = [name for name in swings if name not in balls]
        if not names:
            raise TooLittleDataError(
                f"{name_of(ball_csv)}: no row has a time and a position",
                hint="To analyse a free swing alone, omit the ball's table.",
            )
        if pendulum_csv is not None and swings and len(alone) == len(swings):
            raise UsageError(
                f"{name_of(ball_csv)} and {name_of(pendulum_csv)} have no trial in common",
                hint="Use the same trial names in both tables.",
            )
        if alone:
            notes.append(f"trial {', '.join(alone[:6])} has no ball; trial ignored")
    trials = tuple(_trial(name, balls.get(name), swings.get(name)) for name in names)
    if tracked:
        return ClipCampaign(trials, tuple(notes), unknown_widths(trials), calibrated=False)
    return CampaignRecords(trials, tuple(notes))


_Read = tuple[dict[str, pd.DataFrame], bool, list[str]]


def _balls_of(ball_csv: TableLike, setup: Setup) -> _Read:
    """Rows of the ball by trial, whether they come from a clip, and notes."""
    table, notes = _samples(ball_csv, ("trial", "t_s"), setup)
    tracked = is_track_table(table)
    axes = [name for name in ("x_m", "y_m", "z_m") if name in table.columns]
    if not axes:
        raise UsageError(
            f"{name_of(ball_csv)} has no column with a position",
            hint="Add x_m, y_m or z_m.",
        )
    table, more = _tidied(table, axes, name_of(ball_csv))
    return _by_trial(table), tracked, [*notes, *more]


def _swings_of(pendulum_csv: TableLike, setup: Setup) -> _Read:
    """Rows of the pendulum by trial, whether they come from a clip, and notes."""
    table, notes = _samples(pendulum_csv, ("trial", "t_s", "phi_rad"), setup)
    tracked = is_track_table(table)
    table, more = _tidied(table, ["phi_rad"], name_of(pendulum_csv))
    if table.empty:
        raise UsageError(
            f"{name_of(pendulum_csv)}: no row has a time and an angle",
            hint="Omit the pendulum's table, or fill its column phi_rad.",
        )
    if float(np.nanmax(np.abs(_numbers(table, "phi_rad")))) > 2.0 * math.pi:
        raise UsageError(
            f"{name_of(pendulum_csv)} has angles beyond a full turn",
            hint="Give phi_rad in radians.",
        )
    return _by_trial(table), tracked, [*notes, *more]


def _by_trial(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return {str(name): part for name, part in table.groupby("trial", sort=False)}


def _trial(name: str, ball: pd.DataFrame | None, swing: pd.DataFrame | None) -> Trial:
    time, position, std = np.zeros(0), np.zeros((0, 3)), None
    words: dict[str, str | None] = dict.fromkeys(TEXT_COLUMNS)
    backswing = None
    if ball is not None:
        time = _numbers(ball, "t_s")
        blank = np.full(time.shape, np.nan)
        position = np.column_stack(
            [_numbers(ball, axis) if axis in ball else blank for axis in ("x_m", "y_m", "z_m")]
        )
        if "x_m_std" in ball or "y_m_std" in ball:
            std = np.column_stack(
                [
                    _numbers(ball, axis) if axis in ball else blank
                    for axis in ("x_m_std", "y_m_std", "z_m_std")
                ]
            )
        words = {name: _word(ball, name) for name in TEXT_COLUMNS}
        if "backswing_deg" in ball and ball["backswing_deg"].notna().any():
            backswing = math.radians(float(ball["backswing_deg"].dropna().iloc[0]))
    swing_time, angle = np.zeros(0), np.zeros(0)
    if swing is not None:
        swing_time, angle = _numbers(swing, "t_s"), _numbers(swing, "phi_rad")
    return Trial(
        name, time, position, swing_time, angle, words["ball"], backswing, std, words["session"]
    )


def _word(table: pd.DataFrame, column: str) -> str | None:
    """A trial's entry in a column of words; None if empty."""
    said = [] if column not in table else table[column].dropna().tolist()
    return str(said[0]).strip() if said else None


def baseline_from_setup(setup: Setup, campaign: CampaignRecords) -> Baseline:
    """Build the engine's baseline from the setup file.

    A ball with a contact table uses it; otherwise the time-resolved contact model is tabulated.
    Only balls named in the campaign are included.

    Raises
    ------
    SetupError
        If a ball is not described, or the model lists an unknown effect.
    """
    struck = setup.pendulum is not None and all(
        trial.backswing is not None for trial in campaign.trials if trial.ball_time.size
    )
    named = {trial.ball or "" for trial in campaign.trials if trial.ball_time.size}
    return baseline_for_balls(setup, named, struck)


def baseline_for_balls(setup: Setup, named: Iterable[str], struck: bool) -> Baseline:
    """As `baseline_from_setup`, for balls by name; `struck` by the pendulum, or thrown.

    Raises
    ------
    SetupError
        As there.
    """
    balls = {name: _ball_model(name, setup, struck) for name in sorted(named)}
    known = {f.name for f in fields(Scatter)}
    scatter = {
        name: value
        for name, value in vars(setup.scatter).items()
        if value is not None and name in known
    }
    return Baseline(
        balls,
        setup.pendulum,
        None if setup.support is None else setup.support.height,
        setup.air.density,
        setup.air.viscosity,
        bodies.GRAVITY,
        _model_effects(setup),
        _unmeasured(setup),
        replace(Scatter(), **scatter),
        setup.noise.position,
        setup.noise.angle,
        stated_inputs(_stated_errors(setup, balls, struck)),
    )


def _stated_errors(
    setup: Setup, balls: Mapping[str, BallModel], struck: bool
) -> dict[str, float | None]:
    """Relative standard uncertainties that the setup states; balls share the largest."""
    pendulum, std, air = setup.pendulum, setup.pendulum_std, rig_of(setup, None).air_density
    found: dict[str, float | None] = {}
    if balls and air.std_from is Origin.SETUP:
        found["air_density"] = air.relative_std
    if (struck or not balls) and pendulum is not None:
        for name in ("inertia", "pendulum_mass", "com", "length"):
            key = name.removeprefix("pendulum_")
            size = getattr(std, key)
            found[name] = size / getattr(pendulum, key) if size else None
    known = [setup.balls.get(name) or setup.ball for name in balls]
    for name, key in (("ball_mass", "mass"), ("diameter", "diameter")):
        sizes = [
            getattr(ball, f"{key}_std") / getattr(ball, key)
            for ball in known
            if ball is not None and getattr(ball, key) and getattr(ball, f"{key}_std")
        ]
        found[name] = max(sizes, default=None)
    return found


def _model_effects(setup: Setup) -> Mapping[str, Mapping[str, float]]:
    effects: dict[str, Mapping[str, float]] = {}
    for name in setup.model.effects:
        if name == EffectId.GRAVITY:
            continue
        given = dict(setup.model.parameters.get(name, {}))
        if name == EffectId.DRAG and not given:
            given = {"drag_coefficient": Defaults.DRAG_COEFFICIENT.known}
        effects[name] = given
    return effects


def _unmeasured(setup: Setup) -> frozenset[str]:
    """Effects of the model that are there by default, or without a magnitude."""
    drag = str(EffectId.DRAG)
    open_ = drag in setup.model.effects and not setup.model.parameters.get(drag)
    return frozenset({drag}) if open_ else frozenset()


def _ball_model(name: str, setup: Setup, struck: bool) -> BallModel:
    ball = setup.balls.get(name)
    if ball is None:
        ball = setup.ball
    if ball is None and len(setup.balls) == 1 and name == "":
        ball = next(iter(setup.balls.values()))
    if ball is None and name in bodies.BALLS:
        preset = bodies.BALLS[name]
        ball = BallSetup(name, preset.diameter, preset.mass, preset.launch_angle, preset.cor)
    if ball is None:
        raise SetupError(
            f"the setup does not describe the ball {name!r}" if name else "the setup has no ball",
            hint="Add [ball], or [balls.NAME] for each name in the column `ball`.",
        )
    mass = ball.mass
    if mass is None:
        raise SetupError(
            f"the ball {name or ball.name!r} has no mass",
            hint='Add mass = "0.353 kg" to its table, or give it with the diameter, as in'
            ' --ball "0.2 m, 0.353 kg".',
        )
    table = _contact_table(ball, setup) if struck and ball.launch_angle is not None else None
    return BallModel(name, mass, ball.diameter, ball.launch_angle, table)


def _contact_table(ball: BallSetup, setup: Setup) -> ContactTable | None:
    if ball.contact_outcome:
        rows = sorted(ball.contact_outcome, key=lambda row: row.impact_speed)
        return ContactTable(
            np.array([row.impact_speed for row in rows]),
            np.array(
                [
                    (
                        row.cor, row.contact_time, row.pendulum_speed_after, row.pendulum_angle,
                        row.ball_x, row.ball_y, row.ball_vx, row.ball_vy,
                    )
                    for row in rows
                ]
            ),
        )  # fmt: skip
    if ball.cor is None or setup.pendulum is None:
        return None
    support = setup.support or bodies.PAPER_SUPPORT
    outcome = contact_outcomes(setup.pendulum, ball.body(), support, CONTACT_TABLE_SPEEDS)
    columns = (
        outcome.cor, outcome.contact_time, outcome.pendulum_speed_after, outcome.pendulum_angle,
        outcome.ball_x, outcome.ball_y, outcome.ball_vx, outcome.ball_vy,
    )  # fmt: skip
    return ContactTable(CONTACT_TABLE_SPEEDS, np.column_stack([np.asarray(c) for c in columns]))


RESULT_COLUMNS = {
    "impact_speed": ("impact_speed_m_s", "pendulum_speed_before_m_s"),
    "ball_speed": ("ball_speed_m_s",),
    "range": ("range_m", "landing_distance_m"),
}

"""Column names of each result; the second ones are those of `vision measure --csv`."""

TRIAL_UNITS = {
    "impact_speed": "m_s", "pendulum_speed_before": "m_s", "ball_speed": "m_s",
    "range": "m", "landing_distance": "m", "backswing": "deg", "backswing_angle": "deg",
}  # fmt: skip

"""Stem of each column of numbers → its unit."""

BACKSWING_COLUMNS = ("backswing_deg", "backswing_angle_deg")

TRIAL_COLUMNS = ("trial", "clip")


def is_trial_table(path: TableLike) -> bool:
    """Whether a table has one row per trial: results, and no times."""
    try:
        columns = set(read_sheet(path, TRIAL_UNITS, rows=1).table.columns)
    except UsageError:
        return False  # the reader of samples reports the error
    results = {name for key in ("ball_speed", "range") for name in RESULT_COLUMNS[key]}
    return "t_s" not in columns and bool(columns & (results | {*RESULT_COLUMNS["impact_speed"]}))


def load_trial_table(path: TableLike) -> TrialTable:
    """Read a table with one row per trial.

    Raises
    ------
    UsageError
        If it can't be read, has no rows, or contains impossible numbers.
    """
    sheet = read_sheet(path, TRIAL_UNITS, ("trial", "clip", "ball"))
    what, notes = name_of(path), list(sheet.notes)
    table = _without_excluded(_without_doubles(sheet.table, notes), notes)

    def column(name: str | None, *, positive: bool = False) -> FloatArray:
        if name is None or name not in table:
            return np.full(len(table), np.nan)
        return numbers_of(table, name, what, notes, positive=positive)

    found = {key: _first(table, names) for key, names in RESULT_COLUMNS.items()}
    values = np.column_stack([column(found[key]) for key in CHANNELS])
    stds = np.column_stack(
        [column(f"{name}_std" if (name := found[key]) else None, positive=True) for key in CHANNELS]
    )
    backswing = np.deg2rad(column(_first(table, BACKSWING_COLUMNS)))
    name = _first(table, TRIAL_COLUMNS)
    names = (
        [str(n) for n in table[name]] if name else [str(k + 1) for k in range(len(table))]
    )  # fmt: skip
    _require_bounds(values, [found[key] for key in CHANNELS], names, what)
    balls: list[str | None] = [None] * len(table)
    if "ball" in table:
        balls = [None if pd.isna(b) else str(b).strip() for b in table["ball"]]
    started = np.isfinite(values[:, 0]) | np.isfinite(backswing)
    kept = started & np.isfinite(values[:, 1:]).any(axis=1)
    left_out = [n for n, k in zip(names, kept, strict=True) if not k]
    if left_out and kept.any():
        notes.append(
            f"{len(left_out)} rows lack a start or a result and are ignored:"
            f" trial {', '.join(left_out[:6])}"
        )
    whole = TrialTable(tuple(names), tuple(balls), values, stds, backswing, tuple(notes))
    return whole.chosen(kept) if kept.any() else whole


def _require_bounds(
    values: FloatArray, columns: Sequence[str | None], names: Sequence[str], what: str
) -> None:
    """Refuse the first impossible speed or range, by trial and column, and units that differ."""
    wrong = np.argwhere((values <= 0.0) | (values > FARTHEST))
    if wrong.size:
        row, channel = wrong[0]
        raise UsageError(
            f"{what}: {columns[channel]} is {values[row, channel]:g} in trial {names[row]};"
            f" speeds and ranges must be positive and below {FARTHEST:g}",
            hint="The range is measured from the ball's centre at rest in the direction of flight,"
            " in metres. Correct the cell, or leave it empty.",
        )
    for channel, other in enumerate(in_other_unit(column) for column in values.T):
        if other.any():
            which = ", ".join(np.array(names)[other][:6])
            raise UsageError(
                f"{what}: {columns[channel]} of trial {which} is far larger than in the other"
                " trials, by about the factor of a unit, so units seem to differ by row",
                hint="Write all rows in the unit of the header, or the unit into each cell.",
            )


def _first(table: pd.DataFrame, names: Sequence[str]) -> str | None:
    return next((name for name in names if name in table.columns), None)


def _without_doubles(table: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    if table.empty:
        raise UsageError("the table has a header but no rows", hint="Write one row per trial.")
    doubled = table.duplicated()
    if int(doubled.sum()):
        notes.append(f"{int(doubled.sum())} duplicate rows are ignored")
        table = table[~doubled]
    name = _first(table, TRIAL_COLUMNS)
    if name is not None and table[name].duplicated().any():
        again = ", ".join(str(n) for n in table.loc[table[name].duplicated(), name].unique()[:4])
        notes.append(f"trial {again} has several rows; each counts as a separate trial")
    return table.reset_index(drop=True)


EXCLUDED_COLUMN = "excluded"
"""Column of a campaign's results that gives the reason why a clip is excluded."""


def _without_excluded(table: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    if EXCLUDED_COLUMN not in table:
        return table
    kept = table[EXCLUDED_COLUMN].isna() | (table[EXCLUDED_COLUMN].astype(str).str.strip() == "")
    if kept.all():
        return table
    notes.append(f"{int((~kept).sum())} rows with a reason in {EXCLUDED_COLUMN} are ignored")
    return table[kept].reset_index(drop=True)


OwnEffects = Path | Sequence[Effect] | None

"""User-defined effects: a Python file that contains them, or the objects."""


def explain_files(
    ball: TableLike | None,
    pendulum: TableLike | None,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> ExplainedCampaign:
    """Explain a campaign from its tables; with the fits needed by plots and reports.

    Parameters
    ----------
    ball, pendulum : Path, DataFrame or None
        Tables as in the contract; one may be missing.
    setup : Path or Setup
        The lab's setup.
    hold_out : tuple of str, optional
        Names of trials excluded from the fit.
    effects : Path or sequence of Effect, optional
        User-defined effects.

    Raises
    ------
    UsageError
        For files that can't be read or lack required columns.
    TooLittleDataError
        If there are too few data.
    """
    known = setup_from(setup)
    return explain_campaign(load_campaign(ball, pendulum, known), known, hold_out, effects)


def explain_clips(
    clips: Sequence[Path],
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
    trials: Path | None = None,
    *,
    strikes: bool | None = None,
) -> ExplainedCampaign:
    """Measure clips and explain them as one campaign, one trial per clip.

    Parameters
    ----------
    clips : sequence of Path
        One strike each; a clip that can't be measured is skipped and noted.
    setup : Path or Setup
        The lab's setup.
    hold_out : tuple of str, optional
        Names of clips (without ending) excluded from the fit.
    effects : Path or sequence of Effect, optional
        User-defined effects.
    trials : Path, optional
        A table of the clips with their back-swings and balls.
    strikes : bool, optional
        Also compare the swing before each strike, if all back-swings are known; by default if
        the setup states pendulum and support.

    Raises
    ------
    ClipError, MeasurementError
        If no clip can be read and measured.
    """
    stated = setup_from(setup)
    known = with_rig(stated)
    facts = None if trials is None else clip_facts(trials)
    compared = has_rig(stated) if strikes is None else strikes
    campaign = campaign_from_clips(clips, known, facts, strikes=compared)
    return explain_campaign(campaign, known, hold_out, effects)


def explain_table_file(
    table: TableLike,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> TableExplained:
    """Explain a table with one row per trial.

    Raises
    ------
    UsageError
        For an invalid table or setup.
    TooLittleDataError
        If there are too few trials.
    """
    rows, own = load_trial_table(table), _own(effects)
    names = {name or "" for name in rows.balls}
    baseline = baseline_for_balls(setup_from(setup), names, struck=True)
    with effect_limits(own):
        return explain_table(rows, baseline, own=own, hold_out=hold_out or ())


def explain_campaign(
    campaign: CampaignRecords,
    known: Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> ExplainedCampaign:
    """Explain a campaign that has been read or measured."""
    baseline = baseline_from_setup(known, campaign)
    if isinstance(campaign, ClipCampaign):
        instruments = (*baseline.instruments, *campaign.instruments)
        baseline = replace(baseline, instruments=instruments, assumed=campaign.assumed)
    own = _own(effects)
    with effect_limits(own):
        explained = explain_in_full(
            campaign, baseline, options=Options(hold_out=hold_out or (), effects=own)
        )
    if not isinstance(campaign, ClipCampaign):
        return explained
    verdict = within_calibration(explained.verdict, campaign.widths, known=campaign.calibrated)
    return replace(explained, verdict=verdict)


def _own(effects: OwnEffects) -> tuple[Effect, ...]:
    if isinstance(effects, Path):
        return load_effects(effects)
    for effect in effects or ():
        check_effect(effect)
    return tuple(effects or ())
