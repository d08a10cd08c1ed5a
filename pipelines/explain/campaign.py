"""Explaining campaigns, tables and clips: from files to bodies and samples to the engine's answer.

Tables with a few numbers per trial are read and held against the setup's model.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd

from metrology import Defaults, SetupError, TooLittleDataError, UsageError
from mismatch import EngineVerdict, Explained, Options, explain_in_full
from mismatch.records import (
    BallModel,
    Baseline,
    CampaignRecords,
    ContactTable,
    Scatter,
    Trial,
)
from mismatch.sanity import FARTHEST
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
    is_track_table,
    states_the_rig,
    swing_rows,
    unknown_widths,
    with_rig,
    within_calibration,
)
from pipelines.explain.own_effects import check_effect, load_effects, under_guard
from pipelines.explain.tabular import Sheet, TableLike, name_of, numbers_of, read_sheet
from pipelines.interop.tables import made_elsewhere
from pipelines.setup.file import BallSetup, Setup, load_setup

__all__ = [
    "baseline_for_balls",
    "baseline_from_setup",
    "explain_campaign",
    "explain_clips",
    "explain_files",
    "explain_files_in_full",
    "explain_table_file",
    "is_trial_table",
    "load_campaign",
    "load_trial_table",
]

UNITS = {"t": "s", "x": "m", "y": "m", "z": "m", "phi": "rad", "backswing": "deg"}
"""Stem of each column of numbers → its unit."""

NUMBERS = (
    "t_s", "x_m", "y_m", "z_m", "phi_rad", "backswing_deg", "x_m_std", "y_m_std", "z_m_std",
)  # fmt: skip

STATED = ("ball", "session")
"""Columns of words that say one thing of each trial."""

COARSE = 0.2
"""Share of rows that repeat a time from which it is the clock that is wrong, not a few rows."""
MOST_ROWS = 8000
"""Rows of one trial beyond which more of them tell nothing new about its motion."""

MOST_SAMPLES = 120_000
"""Rows of a campaign that are fitted at once: more take minutes and tell nothing new."""

MOST_TRIALS = 400
"""Trials of a campaign that are fitted at once."""

LEAST_RUN = 6
"""Rows in a row that are a stretch of record, not rows out of order."""

TABLE_SPEEDS = np.array([0.6, 0.9, 1.3, 1.8, 2.4, 3.0, 3.6, 4.2])
"""m/s, where contacts are followed in time for the table: the paper's rig strikes between 1 and 4;
closer together below, where the weight counts for more."""


def _checked(sheet: Sheet, needed: tuple[str, ...]) -> tuple[pd.DataFrame, list[str]]:
    """The table with its numbers as numbers, and what of it was no number."""
    table, what, notes = sheet.table, sheet.name, list(sheet.notes)
    missing = [name for name in needed if name not in table.columns]
    if missing:
        raise UsageError(
            f"{what} has no column {', '.join(missing)}; it has {', '.join(table.columns)}",
            hint="See the input of `vision explain`: trial, t_s and at least one of x_m, y_m, z_m.",
        )
    if table.empty:
        raise UsageError(f"{what} has a header but no rows", hint="Write one row for each sample.")
    for name in NUMBERS:
        if name in table.columns:
            positive = name.endswith("_std")
            table[name] = numbers_of(table, name, what, notes, positive=positive)
    nameless = table["trial"].isna()
    if nameless.any():
        notes.append(f"{what}: {int(nameless.sum())} rows name no trial; they are left out")
        table = table[~nameless]
    return table, notes


def _tidied(
    table: pd.DataFrame, value_columns: list[str], what: str
) -> tuple[pd.DataFrame, list[str]]:
    """Drop rows without a time or any value, and rows given twice; put each trial in order."""
    notes = []
    count = len(table)
    bad = table["t_s"].isna() | ~np.isfinite(table["t_s"]) | table[value_columns].isna().all(axis=1)
    table = table[~bad]
    if int(bad.sum()):
        notes.append(f"{what}: {int(bad.sum())} of {count} rows have no time or no value; left out")
    doubled = table.duplicated(["trial", "t_s"])
    apart = doubled & ~table.duplicated(["trial", "t_s", *value_columns])
    if float(apart.mean() if len(apart) else 0.0) > COARSE:
        raise UsageError(
            f"{what}: {int(apart.sum())} of {count} rows repeat a time of their trial with another"
            " value",
            hint="Are the times rounded, or two things recorded under one trial's name?",
        )
    if int(doubled.sum()):
        notes.append(f"{what}: {int(doubled.sum())} rows repeat a time of their trial; left out")
        table = table[~doubled]
    table = _of_one_mind(table, what, notes)
    times = table.groupby("trial", sort=False)["t_s"]
    set_back = [str(name) for name, t in times if _set_back(t.to_numpy())]
    if set_back:
        names = ", ".join(set_back[:4])
        table = table[~table["trial"].isin(set_back)]
        if table.empty:
            raise UsageError(
                f"{what}: the clock is set back within trial {names}",
                hint="Are several trials under one name? Each needs a name and a clock of its own.",
            )
        notes.append(f"{what}: the clock is set back within trial {names}; left out")
        times = table.groupby("trial", sort=False)["t_s"]
    backwards = times.apply(lambda t: bool((t.diff() < 0).any()))
    if bool(backwards.any()):
        names = ", ".join(str(name) for name in backwards[backwards].index[:4])
        notes.append(f"{what}: the clock runs backwards in trial {names}; rows were sorted by time")
        table = table.sort_values(["trial", "t_s"], kind="stable")
    return _thinned(table, what, notes), notes


def _of_one_mind(table: pd.DataFrame, what: str, notes: list[str]) -> pd.DataFrame:
    """Without trials that state two balls, two sessions or two back-swings."""
    told = {"backswing_deg": "two back-swings", "ball": "two balls", "session": "two sessions"}
    for column, said in told.items():
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
                f"{what}: the column {column} says {said} within trial {names}",
                hint="Each trial has one; are several trials under one name?",
            )
        notes.append(f"{what}: trial {names} states {said} in {column}; left out")
    return table


def _thinned(table: pd.DataFrame, what: str, notes: list[str]) -> pd.DataFrame:
    """Every n-th row of trials, and every n-th trial, where there are more than a fit can use."""
    names = table["trial"].drop_duplicates()
    if len(names) > MOST_TRIALS:
        stride = -(-len(names) // MOST_TRIALS)
        notes.append(f"{what}: of {len(names)} trials one in {stride} is used")
        table = table[table["trial"].isin(set(names.iloc[::stride]))]
    trials = table.groupby("trial", sort=False)
    sizes = trials["t_s"].transform("size").to_numpy()
    most = min(MOST_ROWS, max(MOST_SAMPLES // max(trials.ngroups, 1), LEAST_RUN))
    every = -(-sizes // most)
    if sizes.size == 0 or int(every.max()) < 2:
        return table
    place = trials.cumcount().to_numpy()
    notes.append(
        f"{what}: trials of more than {most} rows are thinned, to one row in"
        f" {int(every.max())} of the longest"
    )
    kept: pd.DataFrame = table[place % every == 0]
    return kept


def _set_back(time: FloatArray) -> bool:
    """Whether a clock was set back, so that two runs of rows claim the same time.

    Rows out of order are another matter: sorted, they are one record again.
    """
    cuts = np.flatnonzero(np.diff(time) < 0.0) + 1
    runs = [run for run in np.split(time, cuts) if run.size >= LEAST_RUN]
    spans = sorted((float(run.min()), float(run.max())) for run in runs)
    return any(later[0] < earlier[1] for earlier, later in itertools.pairwise(spans))


def _numbers(table: pd.DataFrame, column: str) -> FloatArray:
    return np.asarray(table[column], dtype=np.float64)


def _samples(
    source: TableLike, needed: tuple[str, ...], setup: Setup
) -> tuple[pd.DataFrame, list[str]]:
    """Rows of the ball, or where `phi_rad` is needed, of the pendulum; notes on reading them."""
    trial = source.stem if isinstance(source, Path) else "1"
    if isinstance(source, Path) and made_elsewhere(source, setup.columns):
        # comes with the measuring chain
        from pipelines.interop.measured import track_table

        source = track_table(source, setup.columns)
    sheet = read_sheet(source, UNITS, ("trial", *STATED))
    table = sheet.table
    if is_track_table(table):
        if "phi_rad" in needed:
            table = swing_rows(table, trial)
        else:
            table = flight_rows(table, trial, _rest_height(setup))
        table = table.assign(trial=table.get("trial", trial))
    return _checked(replace(sheet, table=table), needed)


def _rest_height(setup: Setup) -> float:
    """Height of the resting ball's centre, m; 0 where the support or the ball is not known."""
    ball = setup.ball or next(iter(setup.balls.values()), None)
    if setup.support is None or ball is None:
        return 0.0
    return setup.support.height + 0.5 * ball.diameter


def load_campaign(
    ball_csv: TableLike | None, pendulum_csv: TableLike | None, setup: Setup
) -> CampaignRecords:
    """Read a campaign.

    Parameters
    ----------
    ball_csv, pendulum_csv : Path, DataFrame or None
        As in the contract; one of them may be missing. A track table of ``vision measure --tracks``
        serves as either: the free flight, or the free swing, is cut out of it.
    setup : Setup
        For the name of the ball where the file has no column ``ball``.

    Returns
    -------
    CampaignRecords

    Raises
    ------
    UsageError
        For files that can't be read, lack a column, or hold nothing.
    TooLittleDataError
        If no row of the ball's file is usable.
    """
    if ball_csv is None and pendulum_csv is None:
        raise UsageError(
            "there is neither a ball's nor a pendulum's file to explain",
            hint="Give a table of the ball (BALL.csv), of the pendulum (--pendulum), or clips.",
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
                hint="Without the ball's table the pendulum is taken to swing freely.",
            )
        if pendulum_csv is not None and swings and len(alone) == len(swings):
            raise UsageError(
                f"{name_of(ball_csv)} and {name_of(pendulum_csv)} have no trial in common",
                hint="A trial goes by the same name in both tables.",
            )
        if alone:
            notes.append(f"no ball was seen in trial {', '.join(alone[:6])}; left out")
    trials = tuple(_trial(name, balls.get(name), swings.get(name)) for name in names)
    if tracked:
        return ClipCampaign(trials, tuple(notes), unknown_widths(trials), calibrated=False)
    return CampaignRecords(trials, tuple(notes))


_Read = tuple[dict[str, pd.DataFrame], bool, list[str]]


def _balls_of(ball_csv: TableLike, setup: Setup) -> _Read:
    """Rows of the ball by trial, whether they come from a clip, and what is to be told."""
    table, notes = _samples(ball_csv, ("trial", "t_s"), setup)
    tracked = is_track_table(table)
    axes = [name for name in ("x_m", "y_m", "z_m") if name in table.columns]
    if not axes:
        raise UsageError(
            f"{name_of(ball_csv)} has no column with a position",
            hint="x_m, y_m or z_m is needed.",
        )
    table, more = _tidied(table, axes, name_of(ball_csv))
    return _by_trial(table), tracked, [*notes, *more]


def _swings_of(pendulum_csv: TableLike, setup: Setup) -> _Read:
    """Rows of the pendulum by trial, whether they come from a clip, and what is to be told."""
    table, notes = _samples(pendulum_csv, ("trial", "t_s", "phi_rad"), setup)
    tracked = is_track_table(table)
    table, more = _tidied(table, ["phi_rad"], name_of(pendulum_csv))
    if table.empty:
        raise UsageError(
            f"{name_of(pendulum_csv)}: no row has a time and an angle",
            hint="Leave the pendulum's table away, or fill its column phi_rad.",
        )
    if float(np.nanmax(np.abs(_numbers(table, "phi_rad")))) > 2.0 * math.pi:
        raise UsageError(
            f"{name_of(pendulum_csv)} has angles beyond a full turn",
            hint="phi_rad is in radians.",
        )
    return _by_trial(table), tracked, [*notes, *more]


def _by_trial(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return {str(name): part for name, part in table.groupby("trial", sort=False)}


def _trial(name: str, ball: pd.DataFrame | None, swing: pd.DataFrame | None) -> Trial:
    time, position, std = np.zeros(0), np.zeros((0, 3)), None
    words: dict[str, str | None] = dict.fromkeys(STATED)
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
        words = {name: _word(ball, name) for name in STATED}
        if "backswing_deg" in ball and ball["backswing_deg"].notna().any():
            backswing = math.radians(float(ball["backswing_deg"].dropna().iloc[0]))
    swing_time, angle = np.zeros(0), np.zeros(0)
    if swing is not None:
        swing_time, angle = _numbers(swing, "t_s"), _numbers(swing, "phi_rad")
    return Trial(
        name, time, position, swing_time, angle, words["ball"], backswing, std, words["session"]
    )


def _word(table: pd.DataFrame, column: str) -> str | None:
    """What a trial's rows say in a column of words; None where they don't."""
    said = [] if column not in table else table[column].dropna().tolist()
    return str(said[0]).strip() if said else None


def baseline_from_setup(setup: Setup, campaign: CampaignRecords) -> Baseline:
    """What the setup file says, as the engine's baseline.

    A ball with a contact table uses it; without one the project's time-resolved contact is
    tabulated. Bodies are made only for the balls that the campaign names.

    Raises
    ------
    SetupError
        If a ball is not described, or the model holds an effect that does not exist.
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
    )


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
    """Effects of the model that stand there by default, or without a size."""
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
            hint='Add mass = "0.353 kg" to its table.',
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
    outcome = contact_outcomes(setup.pendulum, ball.body(), support, TABLE_SPEEDS)
    columns = (
        outcome.cor, outcome.contact_time, outcome.pendulum_speed_after, outcome.pendulum_angle,
        outcome.ball_x, outcome.ball_y, outcome.ball_vx, outcome.ball_vy,
    )  # fmt: skip
    return ContactTable(TABLE_SPEEDS, np.column_stack([np.asarray(c) for c in columns]))


COLUMNS = {
    "impact_speed": ("impact_speed_m_s", "pendulum_speed_before_m_s"),
    "ball_speed": ("ball_speed_m_s",),
    "range": ("range_m", "landing_distance_m"),
}

"""Names of each number; the second ones are those that `vision measure --csv` writes."""

TRIAL_UNITS = {
    "impact_speed": "m_s", "pendulum_speed_before": "m_s", "ball_speed": "m_s",
    "range": "m", "landing_distance": "m", "backswing": "deg", "backswing_angle": "deg",
}  # fmt: skip

"""Stem of each column of numbers → its unit."""

BACKSWING = ("backswing_deg", "backswing_angle_deg")

TRIAL = ("trial", "clip")


def is_trial_table(path: TableLike) -> bool:
    """Whether a table's header is that of a trial table: numbers of trials, and no times."""
    try:
        columns = set(read_sheet(path, TRIAL_UNITS, rows=1).table.columns)
    except UsageError:
        return False  # told in full when its samples are read
    results = {name for key in ("ball_speed", "range") for name in COLUMNS[key]}
    return "t_s" not in columns and bool(columns & (results | {*COLUMNS["impact_speed"]}))


def load_trial_table(path: TableLike) -> TrialTable:
    """Read a trial table.

    Raises
    ------
    UsageError
        If it can't be read, has no rows, or holds numbers that can't be.
    """
    sheet = read_sheet(path, TRIAL_UNITS, ("trial", "clip", "ball"))
    what, notes = name_of(path), list(sheet.notes)
    table = _without_excluded(_without_doubles(sheet.table, notes), notes)

    def column(name: str | None, *, positive: bool = False) -> FloatArray:
        if name is None or name not in table:
            return np.full(len(table), np.nan)
        return numbers_of(table, name, what, notes, positive=positive)

    found = {key: _first(table, names) for key, names in COLUMNS.items()}
    values = np.column_stack([column(found[key]) for key in CHANNELS])
    stds = np.column_stack(
        [column(f"{name}_std" if (name := found[key]) else None, positive=True) for key in CHANNELS]
    )
    backswing = np.deg2rad(column(_first(table, BACKSWING)))
    name = _first(table, TRIAL)
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
            f"{len(left_out)} rows lack a start or a result and were left out:"
            f" trial {', '.join(left_out[:6])}"
        )
    whole = TrialTable(tuple(names), tuple(balls), values, stds, backswing, tuple(notes))
    return whole.chosen(kept) if kept.any() else whole


def _require_bounds(
    values: FloatArray, columns: Sequence[str | None], names: Sequence[str], what: str
) -> None:
    """Refuse the first speed or range that can't be, by trial and column."""
    wrong = np.argwhere((values <= 0.0) | (values > FARTHEST))
    if wrong.size:
        row, channel = wrong[0]
        raise UsageError(
            f"{what}: {columns[channel]} is {values[row, channel]:g} in trial {names[row]};"
            f" speeds and ranges are above zero, and below {FARTHEST:g}",
            hint="The range runs from the ball's centre at rest the way the ball flies, in metres."
            " Correct the cell, or leave it empty.",
        )


def explain_trial_table(
    path: TableLike,
    setup: Setup,
    hold_out: Sequence[str] = (),
    own: Sequence[Effect] = (),
) -> TableExplained:
    """Explain a trial table with the setup's model.

    Raises
    ------
    UsageError
        For a table or setup that can't be used.
    TooLittleDataError
        If there are too few trials.
    """
    table = load_trial_table(path)
    baseline = baseline_for_balls(setup, {name or "" for name in table.balls}, struck=True)
    return explain_table(table, baseline, own=own, hold_out=hold_out)


def _first(table: pd.DataFrame, names: Sequence[str]) -> str | None:
    return next((name for name in names if name in table.columns), None)


def _without_doubles(table: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    if table.empty:
        raise UsageError("the table has a header but no rows", hint="Write one row for each trial.")
    doubled = table.duplicated()
    if int(doubled.sum()):
        notes.append(f"{int(doubled.sum())} rows are given twice; left out")
        table = table[~doubled]
    name = _first(table, TRIAL)
    if name is not None and table[name].duplicated().any():
        again = ", ".join(str(n) for n in table.loc[table[name].duplicated(), name].unique()[:4])
        notes.append(f"trial {again} has several rows; each is taken as a trial of its own")
    return table.reset_index(drop=True)


EXCLUDED = "excluded"
"""Column in which the results of a campaign say why a clip is left out: marked as bad, a copy."""


def _without_excluded(table: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    if EXCLUDED not in table:
        return table
    kept = table[EXCLUDED].isna() | (table[EXCLUDED].astype(str).str.strip() == "")
    if kept.all():
        return table
    notes.append(f"{int((~kept).sum())} rows say in {EXCLUDED} why they don't count; left out")
    return table[kept].reset_index(drop=True)


OwnEffects = Path | Sequence[Effect] | None

"""A user's own effects: a Python file that holds them, or the objects."""


def explain_files(
    ball: TableLike | None,
    pendulum: TableLike | None,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> EngineVerdict:
    """Explain a campaign from its tables.

    Parameters
    ----------
    ball, pendulum : Path, DataFrame or None
        Tables as in the contract; one may be missing.
    setup : Path or Setup
        What the lab knows.
    hold_out : tuple of str, optional
        Names of trials to keep out of the fit.
    effects : Path or sequence of Effect, optional
        A user's own.

    Returns
    -------
    EngineVerdict

    Raises
    ------
    UsageError
        For files that can't be read or don't hold what is needed.
    TooLittleDataError
        If there is too little to tell.
    """
    return explain_files_in_full(ball, pendulum, setup, hold_out, effects).verdict


def explain_files_in_full(
    ball: TableLike | None,
    pendulum: TableLike | None,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> Explained:
    """As `explain_files`, with the fits that plots and reports need."""
    known = setup if isinstance(setup, Setup) else load_setup(setup)
    return explain_campaign(load_campaign(ball, pendulum, known), known, hold_out, effects)


def explain_clips(
    clips: Sequence[Path],
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
    trials: Path | None = None,
    *,
    strikes: bool | None = None,
) -> Explained:
    """Measure clips and explain them as one campaign, one trial a clip.

    Parameters
    ----------
    clips : sequence of Path
        One strike each; what can't be measured is left out and noted.
    setup : Path or Setup
        What the lab knows.
    hold_out : tuple of str, optional
        Names of clips (without ending) to keep out of the fit.
    effects : Path or sequence of Effect, optional
        A user's own.
    trials : Path, optional
        A table of the clips with their back-swings and balls.
    strikes : bool, optional
        Compare the swing before each strike, too, where all back-swings are known; by default where
        the setup states pendulum and support.

    Raises
    ------
    ClipError, MeasurementError
        If no clip can be read and measured.
    """
    stated = setup if isinstance(setup, Setup) else load_setup(setup)
    known = with_rig(stated)
    facts = None if trials is None else clip_facts(trials)
    compared = states_the_rig(stated) if strikes is None else strikes
    campaign = campaign_from_clips(clips, known, facts, strikes=compared)
    return explain_campaign(campaign, known, hold_out, effects)


def explain_table_file(
    table: TableLike,
    setup: Path | Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> TableExplained:
    """Explain a table with a few numbers per trial.

    Raises
    ------
    UsageError
        For a table or setup that can't be used.
    TooLittleDataError
        If there are too few trials.
    """
    known = setup if isinstance(setup, Setup) else load_setup(setup)
    own = _own(effects)
    with under_guard(own):
        return explain_trial_table(table, known, hold_out or (), own)


def explain_campaign(
    campaign: CampaignRecords,
    known: Setup,
    hold_out: tuple[str, ...] | None = None,
    effects: OwnEffects = None,
) -> Explained:
    """Explain a campaign that has been read or measured already."""
    baseline = baseline_from_setup(known, campaign)
    if isinstance(campaign, ClipCampaign):
        baseline = replace(baseline, instruments=campaign.instruments, assumed=campaign.assumed)
    own = _own(effects)
    with under_guard(own):
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
