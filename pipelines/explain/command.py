"""`vision explain`: find missing physics, write the improved model as a setup."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from measuring.setup.cor_file import read_cor_file, with_laws
from measuring.setup.file import load_setup
from metrology import UsageError, write_each, write_text_whole
from mismatch import ExplainedCampaign
from mismatch.trial_table import TableExplained
from physics.effects import CATALOGUE, Effect
from pipelines.doors import CorLawOption, FileRole, ResultsJsonOption, SetupOption
from pipelines.explain.campaign import (
    explain_clips,
    explain_files,
    explain_table_file,
    is_trial_table,
)
from pipelines.interop.tables import (
    PROJECT_SUFFIXES,
    TABLE_SUFFIXES,
    made_elsewhere,
    parse_columns,
)
from pipelines.terminal import screen, write_json

__all__ = ["explain_command", "improved_setup"]

SIMULATED = frozenset({"flight", "contact", "swing"})


def improved_setup(setup: Path, explained: ExplainedCampaign | TableExplained) -> str:
    """Text of the setup file with the named effects in its [model].

    Everything else stays as written. Instrument faults are not part of a motion model, and a setup
    file contains every effect in its usual form only: others are listed in a comment.
    """
    kept, inside = [], False
    for line in setup.read_text(encoding="utf-8").splitlines():
        stripped = line.strip()
        if stripped.startswith("["):
            inside = stripped.startswith("[model")
        if not inside:
            kept.append(line)
    lines = [*_without_trailing_blank(kept), "", "[model]"]
    entries = _entries(explained)
    held = [(e, v) for e, v in entries if _simulated(e)]
    names = ", ".join(f'"{name}"' for name in ("gravity", *(e.id for e, _ in held)))
    lines.append(f"effects = [{names}]")
    for effect, values in held:
        lines += ["", f"[model.{effect.id}]"]
        lines += [f"{name} = {float(value):.8g}" for name, value in values.items()]
    for effect, values in entries:
        if not _simulated(effect):
            numbers = ", ".join(f"{name} = {float(v):.6g}" for name, v in values.items())
            form = f" ({effect.form.replace('_', ' ')})" if effect.form else ""
            lines += ["", f"# {effect.id}{form}: {effect.statement} {numbers}"]
    return "\n".join(lines) + "\n"


def _entries(
    explained: ExplainedCampaign | TableExplained,
) -> tuple[tuple[Effect, Mapping[str, float]], ...]:
    if isinstance(explained, TableExplained):
        return (explained.model if explained.best is None else explained.best.model).entries
    best = explained.naming.best
    return (explained.prepared.model if best is None else best.fit.model).entries


def _simulated(effect: Effect) -> bool:
    """Whether `simulate` can use the effect: physics, in the form that a setup file means."""
    forms = CATALOGUE.get(effect.id, ())
    usual = bool(forms) and forms[0].form == effect.form
    return effect.phase in SIMULATED and usual


def _without_trailing_blank(lines: list[str]) -> list[str]:
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    return lines


_InputsArgument = Annotated[
    list[Path] | None,
    typer.Argument(help="BALL.csv, a table of trials, or clips.", metavar="[BALL.csv | CLIP...]"),
]
_PendulumOption = Annotated[Path | None, typer.Option(help="Samples of the pendulum (CSV).")]
_TrialsOption = Annotated[
    Path | None,
    typer.Option(help="Clips only: lab book with columns clip,backswing_deg,ball."),
]
_StrikesOption = Annotated[
    bool | None,
    typer.Option(
        "--strikes/--flights",
        help="Clips only: also compare the swing before each strike, or flights alone; default:"
        " with the swing if the setup states pendulum and support.",
    ),
]
_ColumnsOption = Annotated[
    str | None,
    typer.Option(help="Column map of a foreign table: 't=Time (s), x=X (cm), y=Y (cm), ball=A'."),
]
_HoldOutOption = Annotated[
    str | None, typer.Option(help="Trials excluded from the fit, separated by commas.")
]
_EffectsOption = Annotated[Path | None, typer.Option(help="Python file with your own effects.")]
_ReportOption = Annotated[
    Path | None, typer.Option(help="Write the report (HTML)."), FileRole.WRITES
]
_PlotOption = Annotated[
    Path | None, typer.Option(help="Write the plots (.png or .svg)."), FileRole.WRITES
]
_ModelOption = Annotated[
    Path | None,
    typer.Option(help="Write the improved model as a setup file (TOML)."),
    FileRole.WRITES,
]
_QuietOption = Annotated[bool, typer.Option(help="Print only requested results.")]


def explain_command(
    inputs: _InputsArgument = None,
    setup: SetupOption = None,
    pendulum: _PendulumOption = None,
    trials: _TrialsOption = None,
    strikes: _StrikesOption = None,
    columns: _ColumnsOption = None,
    cor_law: CorLawOption = None,
    hold_out: _HoldOutOption = None,
    effects: _EffectsOption = None,
    json_file: ResultsJsonOption = None,
    report: _ReportOption = None,
    plot: _PlotOption = None,
    model: _ModelOption = None,
    quiet: _QuietOption = False,
) -> None:
    """Find where simulation and recording differ and which physics is missing.

    Example: vision explain ball.csv --pendulum pendulum.csv --setup setup.toml --report story.html
    """
    if setup is None:
        raise UsageError(
            "explain needs a setup file: it defines the baseline model",
            hint="Run vision explain BALL.csv --setup SETUP.toml",
        )
    ball = _ball_file(inputs or [])
    known = load_setup(setup)
    if columns is not None:
        known = replace(known, columns={**known.columns, **parse_columns(columns)})
    if cor_law is not None:
        known = with_laws(known, read_cor_file(cor_law))
    held = tuple(name.strip() for name in hold_out.split(",")) if hold_out else None
    explained: ExplainedCampaign | TableExplained
    with _stages_shown(quiet):
        if inputs and ball is None:
            explained = explain_clips(inputs, known, held, effects, trials, strikes=strikes)
        elif ball is not None and _of_trials(ball, known.columns):
            _refuse_samples(ball, pendulum)
            explained = explain_table_file(ball, known, held, effects)
        else:
            explained = explain_files(ball, pendulum, known, held, effects)
    document = explained.verdict.to_json()
    writers: list[Callable[[], object]] = [partial(write_json, document, json_file)]
    if plot is not None:
        from pipelines.explain.report import draw_explained

        writers.append(partial(draw_explained, explained, plot))
    if report is not None:
        from pipelines.explain.report import write_explain_report

        given = [*(inputs or []), pendulum, setup, effects, trials]
        read = [path for path in given if path is not None]
        writers.append(partial(write_explain_report, explained, report, read))
    if model is not None:
        writers.append(lambda: write_text_whole(model, improved_setup(setup, explained)))
    if not quiet and json_file != "-":
        writers.append(partial(print, explained.verdict.text()))
    write_each(writers)


@contextmanager
def _stages_shown(quiet: bool) -> Iterator[None]:
    """Show the stages of the search on stderr: as a status on a terminal, else one line each."""
    if quiet:
        yield
        return
    console, log = screen(errors=True), logging.getLogger("mismatch")
    before = log.level
    with console.status("Read the tables") as status:

        class Shown(logging.Handler):
            def emit(self, record: logging.LogRecord) -> None:
                text = record.getMessage()
                if console.is_terminal:
                    status.update(text)
                else:
                    console.print(f"{text}.", soft_wrap=True)

        handler = Shown()
        log.addHandler(handler)
        log.setLevel(logging.INFO)
        try:
            yield
        finally:
            log.removeHandler(handler)
            log.setLevel(before)


def _refuse_samples(ball: Path, pendulum: Path | None) -> None:
    if pendulum is not None:
        raise UsageError(
            f"{ball} has one row per trial; samples of a pendulum can't be combined with it",
            hint="Omit --pendulum.",
        )


def _of_trials(path: Path, columns: Mapping[str, str]) -> bool:
    return not made_elsewhere(path, columns) and is_trial_table(path)


def _ball_file(inputs: list[Path]) -> Path | None:
    if not inputs:
        return None
    known = (*PROJECT_SUFFIXES, *TABLE_SUFFIXES)
    tables = [path for path in inputs if path.suffix.lower() in known]
    if len(tables) == len(inputs) == 1:
        return tables[0]
    if tables:
        raise UsageError(
            "pass either one ball file or clips, not both and not several tables",
            hint="Put all trials into one file with a column `trial`.",
        )
    return None
