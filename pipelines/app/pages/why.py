"""Page Why: whether the model explains the clip, and which physics is missing."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from nicegui import ui

from pipelines.api.explained import Verdict
from pipelines.api.measured import Measurement
from pipelines.app.corrections import ClipInputs, Corrections, options_of
from pipelines.app.pages.clip import copy_card, job_status
from pipelines.app.pages.frame import heading
from pipelines.app.session import ClipSession
from pipelines.app.words import Say
from pipelines.terminal import as_typed
from pipelines.web import Jobs
from vision.tracks import MotionKind

__all__ = ["ClipExplained", "WhyPage", "command_of", "explained"]

_WITH_STRIKE = (MotionKind.STRIKE, MotionKind.COLLISION)
"""Motions that the model of the set-up has; of others it has gravity alone."""

POLL_S = 0.3
"""s between updates (chosen: appears immediate)."""


@dataclass(frozen=True)
class ClipExplained:
    """The engine's answer for a clip.

    Attributes
    ----------
    sentence : str
        The answer in one sentence.
    picture : bytes
        PNG of the residuals before and after.
    report : str
        The report of `vision explain`: also recording and models, formula, proof, what was tried,
        and what to measure next.
    """

    sentence: str
    picture: bytes
    report: str

    @classmethod
    def of(cls, verdict: Verdict) -> "ClipExplained":
        """Answer of a verdict."""
        sentence = repr(verdict).strip().partition("\n")[0]
        with TemporaryDirectory() as folder:
            report = verdict.report(Path(folder) / "report.html").read_text("utf-8")
        return cls(sentence, verdict.plot()._repr_png_(), report)


def explained(clip: ClipSession) -> ClipExplained:
    """Compare the clip's tracks with the model, as `vision explain CLIP` does.

    Raises
    ------
    ImpactVisionError
        If there is too little to compare.
    """
    assert clip.measured is not None
    options = options_of(clip.path, clip.corrections, corrected=False)
    return ClipExplained.of(Measurement(clip.measured, options.known).explain())


def command_of(clip: ClipSession) -> str:
    """The same as a command; empty where that would measure with other inputs."""
    known = clip.corrections
    setup = known.inputs.setup
    if not setup or known != Corrections(ClipInputs(setup=setup)):
        return ""
    return as_typed(["vision", "explain", clip.path, "--setup", clip.path.parent / setup])


class WhyPage:
    """The page in one window.

    Parameters
    ----------
    jobs : Jobs
        Run the engine.
    """

    def __init__(self, clip: ClipSession, jobs: Jobs, say: Say) -> None:
        self.clip, self.jobs, self.say = clip, jobs, say
        self._revision = -1

    def build(self) -> None:
        """Lay the page out."""
        say, clip = self.say, self.clip
        with ui.column().classes("va-page"):
            with ui.column().classes("va-card"):
                heading("h1", say("why_of", name=clip.path.name))
                struck = clip.measured is None or clip.measured.motion.measured_as in _WITH_STRIKE
                ui.label(say("why_note" if struck else "why_alone")).classes("va-small")
                if clip.measured is None:
                    ui.label(say("nothing_to_export")).props("data-test=empty")
                    return
                button = ui.button(say("explain"), on_click=self._explain)
                button.props("unelevated dense data-test=explain")
                self.answer()
            copy_card(say, command_of(clip), f"{clip.as_python()}\nprint(m.explain())")
        ui.timer(POLL_S, self._poll)

    @ui.refreshable_method
    def answer(self) -> None:
        """The answer, or why there is none."""
        found = self.clip.explained
        job_status(self.jobs, self.say)
        if found is not None:
            ui.label(found.sentence).props("data-test=sentence").style("font-weight: 650")
            ui.image(f"/why/{self.clip.number}/picture").props(
                f'alt="{self.say("why_picture")}"'
            ).style("max-width: 900px; background: #fff")
            link = ui.element("a").classes("va-pick").props("target=_blank data-test=why-report")
            with link.props(f'href="/why/{self.clip.number}/report"'):
                ui.label(self.say("why_report"))
                ui.label(self.say("why_report_note")).classes("va-small")

    def _explain(self) -> None:
        clip = self.clip

        def work() -> None:
            clip.explained = explained(clip)

        self.jobs.submit(self.say("explaining"), work)

    def _poll(self) -> None:
        if self.jobs.revision != self._revision:
            self._revision = self.jobs.revision
            self.answer.refresh()
