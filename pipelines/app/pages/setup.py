"""Page Set up: the steps of the calibration on the open clip, then Measure."""

from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from metrology import UsageError
from pipelines.app.corrections import ClipInputs, Corrections
from pipelines.app.session import ClipSession
from pipelines.app.words import Say
from pipelines.calibrate.command import session_of
from pipelines.calibrate.wizard.page import WizardPage
from pipelines.calibrate.wizard.session import Session
from pipelines.web import Jobs

__all__ = ["SETUP_NAME", "SetupPage", "started"]

POLL_S = 0.3
"""s between two looks whether the clip is opened (chosen)."""

SETUP_NAME = "setup.toml"
"""Set-up file, next to the clip; the same name as of `vision calibrate`."""


def started(clip: Path, inputs: ClipInputs) -> Session:
    """Calibration of a clip with what is known of it; the wall grid is searched.

    Raises
    ------
    ClipError
        If the clip can't be read.
    UsageError
        If an input is invalid.
    """
    session = session_of(
        clip,
        clip.with_name(SETUP_NAME),
        fps=inputs.fps or None,
        wall_grid=inputs.wall_grid or None,
        ball=inputs.ball or None,
    )
    session.find_grid()
    return session


class SetupPage:
    """The page in one window.

    Parameters
    ----------
    clip : ClipSession
    jobs : Jobs
        Run the work of the steps.
    say : Say
    measured : callable
        Called once the set-up file is in use and the clip is being measured.
    """

    def __init__(
        self, clip: ClipSession, jobs: Jobs, say: Say, measured: Callable[[], None]
    ) -> None:
        self.clip, self.jobs, self.say, self._measured = clip, jobs, say, measured
        self._drawn = False

    def build(self) -> None:
        """Lay the page out; the steps follow when the clip is opened."""
        if self.clip.wizard is None:
            self.jobs.submit("opening the clip", self._start)
        self.steps()
        self._timer = ui.timer(POLL_S, self._poll)

    @ui.refreshable_method
    def steps(self) -> None:
        """The steps, or why there are none yet."""
        wizard = self.clip.wizard
        with ui.column().classes("va-page"):
            if wizard is not None:
                self._drawn = True
                WizardPage(wizard, self.jobs, self._measure).build()
            elif self.jobs.problem:
                note = ui.label(self.jobs.problem).classes("va-note bad")
                note.props("role=alert data-test=problem")
            else:
                with ui.row().classes("va-card items-center").props("role=status"):
                    ui.spinner(size="sm").props("aria-hidden=true")
                    ui.label(self.say("opening"))

    def _start(self) -> None:
        if self.clip.wizard is None:
            self.clip.wizard = started(self.clip.path, self.clip.corrections.inputs)

    def _poll(self) -> None:
        if self._drawn or (self.clip.wizard is None and not self.jobs.problem):
            return
        self._timer.deactivate()
        self.steps.refresh()

    def _measure(self) -> None:
        wizard, now = self.clip.wizard, self.clip.corrections
        if wizard is None or wizard.written is None:
            raise UsageError("nothing is saved yet", hint="Save the set-up first.")
        setup, folder = wizard.written.setup.absolute(), self.clip.path.parent.absolute()
        setup = setup.relative_to(folder) if setup.parent == folder else setup
        asked = Corrections(ClipInputs(setup=str(setup)), now.ball, now.mass)
        if asked == now:
            self.clip.begin()
        else:
            self.clip.change(asked)
        self._measured()
