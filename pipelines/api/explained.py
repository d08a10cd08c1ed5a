"""`explain`: where simulation and data disagree, and which physics is missing."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from measuring.setup.file import SetupLike, setup_from
from measuring.setup.tables import checked_values
from metrology import UsageError
from mismatch import EngineVerdict as Answer
from mismatch import ExplainedCampaign
from mismatch.trial_table import TableExplained
from physics.effects import Effect
from pipelines.api.wording import worded_for_python
from pipelines.explain.campaign import explain_files, explain_table_file
from pipelines.explain.report import figure_of, verdict_html, write_explain_report
from pipelines.explain.tabular import TableLike

if TYPE_CHECKING:
    import pandas as pd

    from pipelines.report.plots import Picture

__all__ = ["Verdict", "explain"]


class Verdict:
    """The engine's answer, printable.

    Parameters
    ----------
    explained : ExplainedCampaign or TableExplained
        Answer and fits.

    Attributes
    ----------
    answer : mismatch.EngineVerdict
        Location, effects, alternatives, held-out test and remainder, as dataclasses.
    """

    def __init__(self, explained: ExplainedCampaign | TableExplained) -> None:
        self._explained = explained
        self.answer: Answer = explained.verdict

    @property
    def verdict(self) -> str:
        """One of no_mismatch, explained, ambiguous, unexplained."""
        return str(self.to_dict()["verdict"])

    @property
    def effects(self) -> dict[str, float]:
        """Ids of the missing effects, strongest first, with their probabilities."""
        return {effect.id: effect.probability for effect in self.answer.effects}

    def to_dict(self) -> dict[str, Any]:
        """JSON document of `vision explain` (contract)."""
        return self.answer.to_json()

    def plot(self) -> "Picture":
        """Residuals before and after, and the missing force with its band."""
        return figure_of(self._explained)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the one-page HTML report."""
        out = Path(path)
        write_explain_report(self._explained, out)
        return out

    def __repr__(self) -> str:
        return self.answer.text()

    def _repr_html_(self) -> str:
        return verdict_html(self.answer)


@worded_for_python
@checked_values
def explain(
    *,
    balls: "pd.DataFrame | str | os.PathLike[str] | None" = None,
    pendulum: "pd.DataFrame | str | os.PathLike[str] | None" = None,
    trials: "pd.DataFrame | str | os.PathLike[str] | None" = None,
    setup: SetupLike = None,
    hold_out: Sequence[str] = (),
    effects: Sequence[Effect] | str | os.PathLike[str] = (),
) -> Verdict:
    """Find where simulation and data disagree and name the missing physics.

    Parameters
    ----------
    balls : DataFrame or path, optional
        Samples of the ball: ``trial``, ``t_s`` and ``x_m``, ``y_m`` or ``z_m``, m; optionally
        ``ball``, ``backswing_deg``, ``…_std``. Or a track table of `measure`.
    pendulum : DataFrame or path, optional
        Samples of the pendulum: ``trial``, ``t_s``, ``phi_rad`` (0 at the lowest point).
    trials : DataFrame or path, optional
        Instead of samples, a few numbers per trial: impact speed, ball speed, range.
    setup : Setup or path
        Baseline model and apparatus.
    hold_out : sequence of str
        Trials to keep out of the fit; by default the engine chooses.
    effects : sequence of Effect, or path
        Your own effects, or a Python file with them.

    Returns
    -------
    Verdict

    Raises
    ------
    UsageError
        For tables that lack what is needed.
    TooLittleDataError
        If there are too few data.
    """
    known = setup_from(setup)
    own = Path(effects) if isinstance(effects, str | os.PathLike) else tuple(effects)
    for one in () if isinstance(own, Path) else own:
        if not isinstance(one, Effect):
            raise UsageError(f"{one!r} is no effect", hint="An effect is an iv.effects.Effect.")
    names = (hold_out,) if isinstance(hold_out, str) else hold_out
    held = tuple(str(name) for name in names) or None
    if trials is not None:
        if balls is not None or pendulum is not None:
            raise UsageError(
                "explain takes samples or a table of trials, not both",
                hint="Omit `trials`, or `balls` and `pendulum`.",
            )
        return Verdict(explain_table_file(_table(trials), known, held, own))
    return Verdict(
        explain_files(
            None if balls is None else _table(balls),
            None if pendulum is None else _table(pendulum),
            known,
            held,
            own,
        )
    )


def _table(given: "pd.DataFrame | str | os.PathLike[str]") -> TableLike:
    if isinstance(given, str | os.PathLike):
        return Path(given)
    if not hasattr(given, "columns"):
        raise UsageError(f"{given!r} is no table", hint="Pass a DataFrame or the path of a table.")
    return cast("TableLike", given)
