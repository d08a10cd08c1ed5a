"""Page Open: drop a clip, type its path, recent ones, samples, how to film."""

from collections.abc import Callable
from functools import partial
from importlib.resources import files
from pathlib import Path

from nicegui import ui
from nicegui.events import MultiUploadEventArguments

from metrology import ImpactVisionError
from pipelines.app.openings import (
    Recent,
    Sample,
    free_place,
    kept_once,
    place_from,
    placed_sample,
    samples,
)
from pipelines.app.pages.frame import heading
from pipelines.app.words import Say, on_page

__all__ = ["OpenPage"]

_SAMPLE_NAMES = {"strike": "strike", "drop": "drop_kind", "swing": "swing"}


class OpenPage:
    """The page in one window.

    Parameters
    ----------
    opened : callable
        Called with the clip or folder that was chosen.
    folder : Path
        Where dropped clips and samples are copied to.
    """

    def __init__(
        self, say: Say, opened: Callable[[Path], None], folder: Path, recent: Recent
    ) -> None:
        self.say, self._opened, self._folder, self._recent = say, opened, folder, recent

    def build(self) -> None:
        """Lay the page out."""
        say = self.say
        with ui.column().classes("va-page"):
            with ui.column().classes("va-card"):
                heading("h1", say("open_title"))
                drop = ui.upload(
                    label=say("drop"),
                    auto_upload=True,
                    multiple=True,
                    on_multi_upload=self._dropped,
                    on_rejected=lambda: ui.notify(say("left_out")),
                )
                drop.props('flat bordered data-test=drop accept="video/*,.webp,.tif,.tiff,.mkv"')
                drop.classes("w-full")
                self._choose_folder(drop)
                ui.label(say("drop_note", folder=self._folder)).classes("va-small")
                with ui.row().classes("w-full items-center gap-2 no-wrap"):
                    field = ui.input(say("path_of"), placeholder="clips/strike.mp4")
                    field.props("dense outlined stack-label data-test=place").classes("grow")
                    field.on("keydown.enter", lambda: self._typed(str(field.value or "")))
                    button = ui.button(say("open"))
                    button.on_click(lambda: self._typed(str(field.value or "")))
                    button.props("unelevated data-test=open")
                self._problem = ui.label().classes("va-note bad").props("role=alert")
                self._problem.props("data-test=problem").set_visibility(False)
            if places := self._recent.places():
                self._group("recent", [(one.name, str(one.parent), one) for one in places])
            with ui.column().classes("va-card"):
                heading("h2", say("samples"))
                with ui.element("div").classes("va-grid"):
                    for sample in samples():
                        name, about = say(_SAMPLE_NAMES[sample.kind]), say(f"sample_{sample.kind}")
                        self._pick(name, about, f"sample-{sample.kind}", self._copy(sample))
            self._how_to_film()

    def _choose_folder(self, drop: ui.upload) -> None:
        """A button that hands the clips of a folder over as if they were dropped together."""
        field = ui.element("input").props("type=file webkitdirectory hidden")
        add = f"getElement({drop.id}).$refs.qRef.addFiles([...event.target.files])"
        field.on("change", js_handler=f"event => {{ {add}; event.target.value = ''; }}")
        button = ui.button(self.say("choose_folder")).props("outline dense data-test=choose-folder")
        button.on("click", js_handler=f"() => getHtmlElement({field.id}).click()")

    def _group(self, key: str, entries: list[tuple[str, str, Path]]) -> None:
        with ui.column().classes("va-card"):
            heading("h2", self.say(key))
            with ui.element("div").classes("va-grid"):
                for name, about, path in entries:
                    self._pick(name, about, key, partial(Path, path))

    def _pick(self, name: str, about: str, test: str, place: Callable[[], Path]) -> None:
        with ui.element("button").classes("va-pick").props(f"type=button data-test={test}") as one:
            ui.label(name)
            ui.label(about).classes("va-small")
        one.on("click", lambda: self._try(place))

    def _copy(self, sample: Sample) -> Callable[[], Path]:
        return lambda: placed_sample(sample, self._folder / "vision-samples")

    def _how_to_film(self) -> None:
        with ui.column().classes("va-card"):
            heading("h2", self.say("how_to_film"))
            with ui.element("div").classes("va-grid"):
                for key in ("film_good", "film_bad"):
                    picture = files("pipelines.app").joinpath(f"{key}.svg").read_text("utf-8")
                    with ui.element("figure").style("max-width: 420px"):
                        ui.html(picture, sanitize=False)
                        with ui.element("figcaption"):
                            ui.label(self.say(key))

    def _typed(self, text: str) -> None:
        self._try(lambda: place_from(text))

    def _try(self, place: Callable[[], Path]) -> None:
        try:
            self._opened(place())
        except ImpactVisionError as problem:
            self._show(on_page(problem.in_one_line, self.say))

    def _show(self, problem: str) -> None:
        self._problem.text = problem
        self._problem.set_visibility(True)

    async def _dropped(self, event: MultiUploadEventArguments) -> None:
        """Copy a clip, or several into a folder of their own."""
        folder, several = self._folder, len(event.files) > 1
        try:
            if several:
                folder = free_place(folder, "clips")
                folder.mkdir()
            for file in event.files:
                place = free_place(folder, file.name)
                await file.save(place)
                place = folder if several else kept_once(place, file.name)
        except ImpactVisionError as problem:
            self._show(on_page(problem.in_one_line, self.say))
        except OSError as problem:
            self._show(self.say("not_copied", why=problem.strerror or problem))
        else:
            self._opened(place)
