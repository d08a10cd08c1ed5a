"""Page Folder: progress, a card for each clip, restitution against speed."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import run, ui
from nicegui.events import GenericEventArguments

from metrology import ImpactVisionError
from pipelines.app.campaign import (
    WANTED_STD,
    ClipCard,
    FolderInputs,
    FolderSession,
    FolderState,
    Wanted,
)
from pipelines.app.graphs import SERIES_COLOURS
from pipelines.app.pages.cells import show_cells
from pipelines.app.pages.clip import copy_card
from pipelines.app.pages.frame import heading
from pipelines.app.words import Say, label_of, on_page

__all__ = ["FolderPage", "cor_options"]

POLL_S = 1.0
"""s between two looks into the ledger (chosen: a clip takes longer)."""

MAX_CARDS = 60
"""Cards shown (chosen: more slow the browser down); the uncertain ones come first."""

_FOLDER_FIELDS = (
    ("trials", "trials", "trials.csv"),
    ("setup", "setup_input", "setup.toml"),
    ("fps", "fps", "600 fps"),
    ("ball", "ball_input", "jokku"),
    ("wall_grid", "wall_grid", "50 mm"),
)


def cor_options(state: FolderState, say: Say) -> dict[str, Any]:
    """ECharts options of restitution against impact speed."""
    # on a light and on a dark page
    gray = {"color": "#80909a"}
    axis = {
        "type": "value",
        "scale": True,
        "nameLocation": "middle",
        "axisLabel": gray,
        "nameTextStyle": gray,
        "axisLine": {"lineStyle": gray},
        "splitLine": {"lineStyle": {"opacity": 0.25}},
    }
    series: list[dict[str, Any]] = [
        {
            "name": say(key),
            "type": "scatter",
            "symbolSize": 9,
            "itemStyle": {"color": colour, "borderColor": SERIES_COLOURS[0]},
            "data": [
                {"value": [speed, cor], "name": clip}
                for speed, cor, clip, counts in state.points
                if counts is wanted
            ],
        }
        for key, wanted, colour in (
            ("counts", True, SERIES_COLOURS[0]),
            ("excluded", False, "transparent"),
        )
    ]
    law = {"name": say("law"), "type": "line", "showSymbol": False, "data": [*map(list, state.law)]}
    drawn = [one["name"] for one in (*series, law) if one["data"]]
    return {
        "animation": False,
        "legend": {"top": 0, "left": 0, "textStyle": gray, "data": drawn},
        "grid": {"left": 56, "right": 14, "top": 32, "bottom": 42},
        "tooltip": {"trigger": "item", "formatter": "{b}"},
        "xAxis": {**axis, "name": "v / (m/s)", "nameGap": 26},
        "yAxis": {**axis, "name": say("cor_axis"), "nameGap": 42},
        "series": [*series, law],
    }


class FolderPage:
    """The page in one window.

    Parameters
    ----------
    opened : callable
        Called with a clip's path to open it.
    """

    def __init__(self, folder: FolderSession, say: Say, opened: Callable[[Path], None]) -> None:
        self.folder, self.say, self._opened = folder, say, opened
        self._cards: dict[str, tuple[ClipCard, Any]] = {}
        self._reasons: dict[str, Any] = {}
        self._points: object = None
        self._show = "all"
        self._asking = False

    def build(self) -> None:
        """Lay the page out."""
        say = self.say
        with ui.column().classes("va-page"):
            with ui.column().classes("va-card"):
                heading("h1", say("campaign_of", name=(self.folder.clips or self.folder.out).name))
                self._bar = ui.linear_progress(0.0, show_value=False).props("color=teal")
                self._bar.props(f'aria-label="{say("progress")}"')
                self._counts = ui.label().props("role=status data-test=counts")
                self._problem = ui.label().classes("va-note bad").props("role=alert")
                self._problem.props("data-test=problem").set_visibility(False)
                if self.folder.clips is not None:
                    self._form()
            if self.folder.clips is not None:
                self.repeats()
            with ui.column().classes("va-card") as self._plot:
                heading("h2", say("cor_graph"))
                self._chart = ui.echart(
                    cor_options(FolderState({}, (), (), ()), say),
                    on_point_click=lambda event: self._open_named(event.name),
                ).classes("va-graph")
                self._chart.props(f'role=img aria-label="{say("cor_graph")}"')
                ui.label(say("cor_note")).classes("va-small")
                self._wanted = ui.label().props("role=status data-test=wanted")
                self._wanted.style("white-space: pre-line")
            self._plot.set_visibility(False)
            with ui.row().classes("items-center gap-2") as self._filter:
                choice = {name: say(f"show_{name}") for name in ("all", "unsure", "bad")}
                ui.radio(choice, value="all", on_change=self._choose).props(
                    "inline dense data-test=show"
                )
            ui.label(say("folder_note")).classes("va-small")
            self._grid = ui.element("div").classes("va-grid")
        ui.timer(POLL_S, self._poll, immediate=True)

    def _form(self) -> None:
        say, texts = self.say, {}
        with ui.element("div").classes("va-form"):
            for name, key, example in _FOLDER_FIELDS:
                value = getattr(self.folder.inputs, name)
                field = ui.input(say(key), value=value, placeholder=example)
                texts[name] = field.props(f"dense outlined stack-label data-test={name}")

        def begin() -> None:
            asked = {name: str(field.value or "").strip() for name, field in texts.items()}
            self.folder.begin(FolderInputs(**asked))
            self.repeats.refresh()

        with ui.row().classes("w-full items-center gap-3"):
            button = ui.button(say("measure_all"), on_click=begin)
            button.props("unelevated dense data-test=measure-all")
        with ui.element("details").props("data-test=sheet"):
            heading("summary", say("paste")).classes("inline")
            cells = ui.element("div").classes("w-full q-py-sm")
            sheet = ui.textarea(say("paste_here"), value=self.folder.sheet())
            sheet.props("dense outlined stack-label data-test=pasted").classes("w-full")
            with cells:
                show_cells(sheet, say)
            ui.button(say("paste_use"), on_click=lambda: self._try(paste)).props(
                "outline dense data-test=paste"
            )

        def paste() -> None:
            texts["trials"].value = self.folder.paste(str(sheet.value or ""))

    @ui.refreshable_method
    def repeats(self) -> None:
        """The same campaign as a command and in Python."""
        copy_card(self.say, self.folder.as_command(), self.folder.as_python())

    def _choose(self, event: Any) -> None:
        self._show = event.value

    async def _poll(self) -> None:
        if self._asking:
            return
        self._asking = True
        try:
            state = await run.io_bound(self.folder.state)
        except ImpactVisionError as problem:
            self._say_problem(on_page(problem.in_one_line, self.say))
        else:
            if state is not None:
                self._draw(state)
        finally:
            self._asking = False

    def _say_problem(self, problem: str) -> None:
        self._problem.text = problem
        self._problem.set_visibility(bool(problem))

    def _draw(self, state: FolderState) -> None:
        count = {
            name: state.counts.get(name, 0) for name in ("done", "failed", "running", "waiting")
        }
        total = sum(count.values())
        self._bar.set_value((count["done"] + count["failed"]) / max(total, 1))
        key = "folder_running" if self.folder.running else "folder_counts"
        self._counts.text = self.say(key, **count)
        self._say_problem(on_page(self.folder.problem, self.say))
        self._plot.set_visibility(bool(state.points))
        self._filter.set_visibility(bool(state.cards))
        if (state.points, state.law) != self._points:
            self._points = (state.points, state.law)
            self._chart.options.update(cor_options(state, self.say))
            self._chart.update()
            self._wanted.text = "\n".join(self._sentence(one) for one in state.wanted)
        wanted = [one for one in state.cards if self._is_wanted(one)][:MAX_CARDS]
        names = {one.clip for one in wanted}
        for clip in self._cards.keys() - names:
            self._cards.pop(clip)[1].delete()
        for place, one in enumerate(wanted):
            self._place(one, place)

    def _sentence(self, wanted: Wanted) -> str:
        """What a ball's law lacks."""
        key = "film_more" if wanted.strikes else "filmed_enough"
        values = {"std": f"{wanted.std:.2g}", "speed": f"{wanted.speed:.2g}"}
        said = self.say(key, target=f"{WANTED_STD:g}", count=wanted.strikes, **values)
        return f"{wanted.ball}: {said}" if wanted.ball else said

    def _is_wanted(self, card: ClipCard) -> bool:
        if self._show == "unsure":
            return card.unsure
        return bool(card.bad) if self._show == "bad" else True

    def _place(self, card: ClipCard, place: int) -> None:
        """Draw a card anew if it changed, unless a reason is being typed in it."""
        known = self._cards.get(card.clip)
        if known is None:
            with self._grid:
                box = ui.column().classes("va-card").props(f'data-test="clip-{quote(card.clip)}"')
        elif known[0] == card:
            known[1].style(f"order: {place}")
            return
        else:
            box = known[1]
            reason = self._reasons.get(card.clip)
            if known[0].bad == card.bad and reason is not None and reason.value:
                return
            box.clear()
        self._cards[card.clip] = (card, box)
        with box.style(f"order: {place}"):
            self._content(card)

    def _content(self, card: ClipCard) -> None:
        say = self.say
        link = ui.element("button").classes("va-pick").props("type=button data-test=open-clip")
        with link:
            ui.label(card.clip)
        link.on("click", partial(self._open, card.path))
        if card.frame:
            image = ui.element("img").classes("w-full").style("cursor: crosshair")
            address = f"/thumb/{quote(card.clip, safe='')}?{quote(card.stamp)}"
            image.props(f'src="{address}" alt="{say("frame_of")}" data-test=picture')
            image.on(
                "click",
                partial(self._point, card.clip),
                js_handler="(e) => emit(e.offsetX / e.target.clientWidth,"
                " e.offsetY / e.target.clientHeight)",
            )
        for name, text in card.values:
            with ui.element("div").classes("va-pair va-small"):
                ui.label(label_of(name, say))
                ui.label(text).classes("whitespace-nowrap")
        if not card.values:
            ui.label(say(f"state_{card.state}")).classes("va-small")
        if card.error:
            ui.label(on_page(card.error, say)).classes("va-note bad")
        if card.motion:
            kind, _, probability = card.motion.partition(", ")
            said = say("motion", kind=say(f"kind_{kind}"), p=probability)
            ui.label(said).classes("va-note warn")
        if card.pointed:
            ui.label(say("pointed", at=card.pointed)).classes("va-small")
        self._marking(card)

    def _marking(self, card: ClipCard) -> None:
        say = self.say
        if card.bad:
            ui.label(say("bad", why=card.bad)).classes("va-note warn")
            button = ui.button(say("unmark"), on_click=partial(self._mark, card.clip, None))
            button.props("flat dense data-test=unmark")
        elif card.state == "done":
            with ui.row().classes("w-full items-center gap-2"):
                why = ui.input(placeholder=say("why_bad")).classes("grow").style("min-width: 15em")
                why.props(f'dense outlined maxlength=500 aria-label="{say("why_bad")}"')
                self._reasons[card.clip] = why

                def mark() -> None:
                    reason, why.value = str(why.value or "").strip(), ""
                    if reason:
                        self._mark(card.clip, reason)

                why.on("keydown.enter", mark)
                button = ui.button(say("mark"), on_click=mark).classes("whitespace-nowrap")
                button.props("flat dense data-test=mark")

    def _mark(self, clip: str, reason: str | None) -> None:
        self._try(lambda: self.folder.mark(clip, reason))

    def _point(self, clip: str, event: GenericEventArguments) -> None:
        try:
            x, y = (float(one) for one in event.args)
        except (TypeError, ValueError):
            return
        self._try(lambda: self.folder.point(clip, x, y))

    def _try(self, change: Callable[[], None]) -> None:
        try:
            change()
        except ImpactVisionError as problem:
            ui.notify(on_page(problem.in_one_line, self.say), type="negative")

    def _open_named(self, clip: str) -> None:
        known = self._cards.get(clip)
        if known is not None:
            self._open(known[0].path)

    def _open(self, path: str) -> None:
        if Path(path).exists():
            self._opened(Path(path))
        else:
            ui.notify(self.say("gone", name=path), type="negative")
