"""Page Export: the A4 sheet, and files written next to the clip."""

from functools import partial
from pathlib import Path

from nicegui import ui

from pipelines.app.exports import EXPORTS, Export, written
from pipelines.app.pages.clip import copy_card, job_status
from pipelines.app.pages.frame import heading
from pipelines.app.session import ClipSession
from pipelines.app.words import Say, on_page
from pipelines.web import Jobs

__all__ = ["ExportPage"]

POLL_S = 0.2
"""s between updates (chosen: appears immediate)."""


class ExportPage:
    """The page in one window.

    Parameters
    ----------
    jobs : Jobs
        Writes the files.
    """

    def __init__(self, clip: ClipSession, jobs: Jobs, say: Say) -> None:
        self.clip, self.jobs, self.say = clip, jobs, say
        self._revision = -1

    def build(self) -> None:
        """Lay the page out."""
        say = self.say
        with ui.column().classes("va-page"):
            with ui.column().classes("va-card"):
                heading("h1", say("export_of", name=self.clip.path.name))
                if self.clip.measured is None:
                    ui.label(say("nothing_to_export")).props("data-test=empty")
                    return
                link = ui.element("a").props('href="/sheet" target="_blank" data-test=sheet')
                with link.classes("va-pick"):
                    ui.label(say("sheet"))
                    ui.label(say("sheet_note")).classes("va-small")
                ui.label(say("export_note", folder=self.clip.path.parent)).classes("va-small")
                with ui.element("div").classes("va-grid"):
                    for export in EXPORTS:
                        self._pick(export)
                self.status()
            copy_card(say, self.clip.as_command(), self.clip.as_python())
        ui.timer(POLL_S, self._poll)

    def _pick(self, export: Export) -> None:
        with ui.element("button").classes("va-pick") as one:
            ui.label(self.say(f"export_{export.key}"))
            ui.label(export.path_for(self.clip.path).name).classes("va-small")
        one.props(f"type=button data-test=export-{export.key}")
        one.on("click", partial(self._write, export))

    @ui.refreshable_method
    def status(self) -> None:
        """The file being written, those written, or why one was not."""
        job_status(self.jobs, self.say)
        for path in self.clip.written:
            ui.label(self.say("written", name=path)).classes("va-note").props("data-test=written")

    def _write(self, export: Export) -> None:
        clip, measured = self.clip, self.clip.measured
        if measured is None:
            return
        python, word = clip.as_python(), partial(on_page, say=self.say)

        def work() -> None:
            path: Path = written(export, clip.path, measured, python, word)
            clip.written = (*(one for one in clip.written if one != path), path)

        self.jobs.submit(self.say("writing", name=export.path_for(clip.path).name), work)

    def _poll(self) -> None:
        if self.jobs.revision != self._revision:
            self._revision = self.jobs.revision
            self.status.refresh()
