"""Everything a campaign's folder holds besides the ledger, written anew from the ledger."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from metrology import write_text_whole
from pipelines.campaign.analysis.balls import CampaignAnalysis, analyse
from pipelines.campaign.figures import draw_figures, write_figures
from pipelines.campaign.lab_book import LabBook, Strike
from pipelines.campaign.ledger import Ledger
from pipelines.campaign.report import ReportFacts, write_report
from pipelines.campaign.results import ClipResult, clip_results, results_frame, write_tables
from pipelines.campaign.summary import laws_of, summarise
from pipelines.setup.cor_file import write_cor_file
from pipelines.setup.file import Setup

__all__ = ["Edition", "Published", "publish", "publish_tables"]


@dataclass(frozen=True)
class Edition:
    """What a campaign's pages are made from, besides the ledger.

    Attributes
    ----------
    folder : Path
    book : LabBook or None
    strikes : mapping of str to Strike or None
        By the clip's name.
    setup : Setup
    ball : str or None
        Ball of clips for which the lab book names none.
    facts : ReportFacts
    against_paper : bool
        Draw the paper's laws beside one's own.
    """

    folder: Path
    book: LabBook | None
    strikes: Mapping[str, Strike | None]
    setup: Setup
    ball: str | None
    facts: ReportFacts
    against_paper: bool = False

    def frame(self, ledger: Ledger) -> pd.DataFrame:
        """The table of results."""
        return results_frame(ledger.entries(), self.strikes, self.book)

    def results(self, ledger: Ledger) -> list[ClipResult]:
        """What the ledger holds of the campaign's clips."""
        return clip_results(ledger.entries(), self.strikes)


@dataclass(frozen=True)
class Published:
    """What was written."""

    results: list[ClipResult]
    frame: pd.DataFrame
    analysis: CampaignAnalysis


def publish_tables(edition: Edition, ledger: Ledger) -> None:
    """Write the tables alone: cheap enough to do while clips come in."""
    write_tables(edition.frame(ledger), edition.folder)


def publish(edition: Edition, ledger: Ledger) -> Published:
    """Write tables, figures, laws, summary and report; each whole or not at all."""
    results = edition.results(ledger)
    frame = edition.frame(ledger)
    write_tables(frame, edition.folder)
    analysis = analyse(results, edition.setup, edition.ball)
    figures = draw_figures(analysis, against_paper=edition.against_paper)
    write_figures(figures, edition.folder / "figures")
    summary = json.dumps(summarise(results, analysis), indent=2, ensure_ascii=False)
    write_text_whole(edition.folder / "summary.json", summary + "\n")
    laws = laws_of(analysis)
    if laws:
        write_cor_file(edition.folder / "cor.toml", laws)
    write_report(edition.folder / "report.html", edition.facts, results, analysis, figures)
    return Published(results, frame, analysis)
