"""Page Clip: frame with outlines, numbers, messages, inputs and graphs."""

import json
import math
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

from nicegui import ui

from measuring.measurement import Axes
from measuring.setup.file import SIZE_AND_MASS
from metrology import UsageError
from pipelines.app.corrections import FIXED_POINTS, ClipInputs, Corrections, Stick, cure_of
from pipelines.app.figures import LARGE_FIGURES, Figure, Standing
from pipelines.app.pages.frame import ClipFrame, FramePoint, PlacedAt, heading
from pipelines.app.pages.spans import SpanCard
from pipelines.app.session import AppSession, ClipSession
from pipelines.app.words import Say, hint_of, label_of, on_page, translated
from pipelines.web import Jobs
from vision.tracks import MotionKind

__all__ = ["ClipPage", "copy_card", "job_status", "standing_text"]

POLL_S = 0.2
"""s between updates from the session (chosen: appears immediate)."""

_FIELDS = (
    ("fps", "fps", "600 fps"),
    ("ball", "ball_input", "220 mm, 0.35 kg"),
    ("wall_grid", "wall_grid", "50 mm"),
    ("scale", "scale", "2.44 mm/px"),
    ("setup", "setup_input", "setup.toml"),
)
"""Inputs, the keys of their labels, and an example of each."""

ASKED = ("strike", "flight", "drop", "bounce", "swing", "collision")
"""Kinds of motion of which quantities are measured."""


_POINTED = (
    ("ball", "this_ball"),
    ("mass", "this_mass"),
    ("ignored", "ignore"),
    ("outline", "move_outline"),
    ("pivot", "pivot"),
    ("landing", "point_landing"),
    ("axes", "axes"),
    ("end0", "stick"),
)
"""What can be pointed at, and the keys of the buttons."""

_TURNS = {"axes_x": 0.0, "axes_y": 90.0}
"""Ends of axes, and their directions from the x axis, degrees."""

_STICK = ("end0", "end1")
_OBJECTS = ("ball", "mass", "ignored")
"""What can be placed in the frame: ends of a calibration stick, and objects."""


def _ends_of(stick: Stick | None) -> dict[str, tuple[float, float]]:
    if stick is None:
        return {}
    return {"end0": (stick.x0_px, stick.y0_px), "end1": (stick.x1_px, stick.y1_px)}


def standing_text(figure: Figure, say: Say) -> str:
    """How far a number can be trusted, in a sentence."""
    return say(str(figure.standing), why=on_page(figure.why, say))


class ClipPage:
    """The page of one clip in one window."""

    def __init__(self, session: AppSession, clip: ClipSession, say: Say) -> None:
        self.session, self.clip, self.say = session, clip, say
        self._revision = -1
        self._outlined = -1
        self._drawn: object = None
        self._numbered: object = None
        self._frame = ClipFrame(clip, say, self._marks_url)
        self._span: SpanCard | None = None
        self._stick: Stick | None = None
        self._ends = _ends_of(None)
        self._unreadable = False

    def build(self) -> None:
        """Lay the page out."""
        with ui.column().classes("va-page"):
            with ui.row().classes("w-full items-baseline gap-3"):
                heading("h1", self.clip.path.name).props("data-test=name")
                self._facts = ui.label().classes("va-small")
            with ui.element("div").classes("va-columns"):
                with ui.element("div").classes("va-column"):
                    self._frame_card()
                with ui.element("div").classes("va-column"):
                    self.status()
                    self.numbers()
                    self.messages()
                    self._inputs_card()
                    self.repeats()
                with ui.element("div").classes("va-column"):
                    self.graphs()
        ui.timer(POLL_S, self._poll)

    def _frame_card(self) -> None:
        say = self.say
        with ui.column().classes("va-card"):
            self._frame.build()
            with ui.row().classes("items-center gap-2 va-hidden-in-print"):
                for mode, key in _POINTED:
                    self._frame.button(mode, say(key))
                self._undo = ui.button(say("undo"), on_click=self.clip.undo)
                self._undo.props("flat dense data-test=undo")
                self._redo = ui.button(say("redo"), on_click=self.clip.redo)
                self._redo.props("flat dense data-test=redo")
                self._length = ui.input(say("stick_length"), placeholder="1 m ± 2 mm")
                self._length.props("dense outlined stack-label data-test=stick-length")
                self._length.on("keydown.enter", self._use_stick)
                found = ui.checkbox(say("show_found"), on_change=self._show_found)
                found.props("dense data-test=show-found")

    @ui.refreshable_method
    def status(self) -> None:
        """Progress, or why nothing was measured."""
        clip, say = self.clip, self.say
        problem = clip.frames.problem or clip.problem
        if clip.busy and not clip.frames.problem:
            with ui.column().classes("va-card").props("role=status data-test=busy"):
                said = say("measuring", step=say(clip.step))
                ui.label(said)
                ui.linear_progress(clip.part, show_value=False).props(
                    f'aria-label="{said}" color=teal'
                )
        if problem:
            note = (
                ui.label(on_page(problem, say))
                .classes("va-note bad")
                .props("role=alert data-test=problem")
            )
            note.style("white-space: pre-wrap")
        if clip.unsaved:
            ui.label(say("not_saved", why=clip.unsaved)).classes("va-note bad").props(
                "role=alert data-test=unsaved"
            )

    @ui.refreshable_method
    def numbers(self) -> None:
        """The numbers, the first four large."""
        say, measured = self.say, self.clip.measured
        with ui.column().classes("va-card").props("data-test=numbers aria-live=polite"):
            heading("h2", say("results"))
            if measured is None:
                if not self.clip.busy and self.clip.marks()["candidates"]:
                    ui.label(say("no_numbers", question=say("which_ball")))
                return
            motion = measured.motion
            kind, probability = say(f"kind_{motion.kind.value}"), f"{motion.probability:.2f}"
            said = say("motion", kind=kind, p=probability)
            ui.label(said).classes("va-small").props("data-test=motion")
            figures = self.clip.figures
            large = [one for one in figures if one.value][:LARGE_FIGURES]
            if not large and self._question:
                ui.label(on_page(self._question, say)).classes("va-note bad")
            # what holds of all is said once
            common = {standing_text(one, say) for one in large}
            if len(large) > 1 and len(common) == 1:
                self._standing(large[0])
            with ui.element("div").classes("va-large"):
                for figure in large:
                    self._large(figure, alone=len(large) == 1 or len(common) > 1)
            rest = [one for one in figures if one not in large]
            if rest:
                with ui.element("details").props("data-test=more"):
                    heading("summary", say("more", count=len(figures))).classes("inline")
                    for figure in rest:
                        self._small(figure)

    @property
    def _question(self) -> str:
        """What would have to be known for any number; empty if nothing is missing."""
        findings = () if self.clip.measured is None else self.clip.measured.findings
        return next((one.sentence for one in findings if one.key == "facts"), "")

    def _large(self, figure: Figure, *, alone: bool) -> None:
        with ui.element("div").classes("va-figure").props(f'data-test="figure-{figure.name}"'):
            self._label(figure).classes("va-label")
            with ui.element("div"):
                with ui.element("b"):
                    ui.label(figure.value).classes("inline")
                std = ui.label(f" ± {figure.std} {figure.unit}").classes("va-std inline")
                std.props(f'title="{hint_of("std", self.say)}"')
            if alone:
                self._standing(figure)
            self._budget(figure)

    def _label(self, figure: Figure) -> ui.label:
        """Its name, explained on hovering."""
        label = ui.label(label_of(figure.name, self.say))
        return label.props(f'title="{hint_of(figure.name, self.say)}"')

    def _small(self, figure: Figure) -> None:
        with ui.element("div").classes("va-row").props(f'data-test="figure-{figure.name}"'):
            ui.element("span").classes(f"va-stand {figure.standing}").props("aria-hidden=true")
            with ui.element("div"):
                self._label(figure)
                if figure.standing is not Standing.SOUND:
                    ui.label(standing_text(figure, self.say)).classes("va-small")
                self._budget(figure)
            shown = f"{figure.value} ± {figure.std} {figure.unit}" if figure.value else "–"
            ui.label(shown).classes("va-value")

    def _standing(self, figure: Figure) -> None:
        with ui.row().classes("items-baseline gap-2 no-wrap"):
            ui.element("span").classes(f"va-stand {figure.standing}").props("aria-hidden=true")
            ui.label(standing_text(figure, self.say)).classes("va-small")

    def _budget(self, figure: Figure) -> None:
        if not figure.budget:
            return
        # one element in place of a hundred: the page draws anew within a correction
        rows = "".join(
            f"<span>{escape(translated(source, self.say))}</span>"
            f'<span style="text-align: right">{escape(std)}</span>'
            f'<span class="va-bar" style="width: {min(100 * part, 100):.0f}%"></span>'
            for source, std, part in figure.budget
        )
        head = f'<summary class="va-small">{escape(self.say("made_of"))}</summary>'
        table = f'<div class="va-budget">{rows}</div>'
        ui.html(head + table, sanitize=False, tag="details")

    @ui.refreshable_method
    def messages(self) -> None:
        """Warnings of the measurement and of the file."""
        measured = self.clip.measured
        said = [] if measured is None else list(measured.warnings)
        if self._question in said and not any(one.value for one in self.clip.figures):
            said.remove(self._question)
        if not said:
            return
        findings = () if measured is None else measured.findings
        contradictions = {one.sentence: one.cures for one in findings}
        with ui.column().classes("va-card").props("data-test=messages"):
            heading("h2", self.say("messages"))
            for sentence in said:
                kind = "bad" if sentence in contradictions else "warn"
                with ui.column().classes(f"va-note {kind} gap-1"):
                    ui.label(on_page(sentence, self.say))
                    self._cures(contradictions.get(sentence, ()))

    def _cures(self, options: tuple[str, ...]) -> None:
        """A button for each input that alone resolves a contradiction."""
        keys = {name: key for name, key, _ in _FIELDS}
        for found in (cure_of(one, keys) for one in options):
            if found is None:
                continue
            name, text = found
            said = self.say("cure", what=self.say(keys[name]), text=text)
            button = ui.button(said, on_click=partial(self._use, name, text))
            button.props(f"outline dense no-caps data-test=cure-{name}")

    def _use(self, name: str, text: str) -> None:
        now = self.clip.corrections
        stick = None if name == "scale" else now.stick
        if name == "ball" and (known := SIZE_AND_MASS.fullmatch(now.inputs.ball)):
            text = f"{text}, {known['mass']}"
        self.clip.change(replace(now, inputs=replace(now.inputs, **{name: text}), stick=stick))

    def _inputs_card(self) -> None:
        say = self.say
        with ui.column().classes("va-card va-hidden-in-print").props("data-test=inputs"):
            heading("h2", say("inputs"))
            self._fields: dict[str, Any] = {}
            with ui.element("div").classes("va-form"):
                for name, key, example in _FIELDS:
                    text = getattr(self.clip.corrections.inputs, name)
                    field = ui.input(say(key), value=text, placeholder=example)
                    field.props(f"dense outlined stack-label data-test={name}")
                    field.on("keydown.enter", self._measure)
                    self._fields[name] = field
                kinds = {"": say("kind_found"), **{name: say(f"kind_{name}") for name in ASKED}}
                now = self.clip.corrections.inputs.kind
                choice = ui.select(kinds, value=now, label=say("kind"))
                choice.props("dense outlined stack-label data-test=kind")
                choice.on_value_change(self._measure_kind)
                self._fields["kind"] = choice
            ui.label(say("inputs_note")).classes("va-small")
            with ui.row().classes("items-center gap-2"):
                button = ui.button(say("measure"), on_click=self._measure)
                button.props("unelevated dense data-test=measure")
                reset = ui.button(say("reset"), on_click=self._reset)
                reset.props("flat dense data-test=reset")

    @ui.refreshable_method
    def repeats(self) -> None:
        """The same measurement as a command and in Python."""
        copy_card(self.say, self.clip.as_command(), self.clip.as_python())

    @ui.refreshable_method
    def graphs(self) -> None:
        """Graphs, whose clicks go to a frame."""
        say = self.say
        if not self.clip.graphs:
            return
        charts = []
        with ui.column().classes("va-card").props("data-test=graphs"):
            heading("h2", say("graphs"))
            ui.label(say("graphs_note")).classes("va-small va-hidden-in-print")
            with ui.element("div").classes("va-graphs"):
                for graph in self.clip.graphs:
                    with ui.element("figure"):
                        with ui.element("figcaption"):
                            ui.label(say(graph.name))
                        options = graph.options(partial(translated, say=say))
                        chart = ui.echart(options).classes("va-graph")
                        chart.props(f'role=img aria-label="{say(graph.name)}"')
                    name = say(graph.name)
                    charts.append({"id": chart.id, "time": graph.over_time, "name": name})
            self._span = SpanCard(self.clip.graphs, say)
            self._span.build()
        ui.run_javascript(f"visionViewer.charts({json.dumps(charts)})")

    def on_viewer(self, name: str, sent: dict[str, Any]) -> None:
        """React to the viewer: a dragged outline, a point, undo and redo."""
        if name in ("undo", "redo"):
            getattr(self.clip, name)()
            return
        if name == "span":
            if self._span is not None:
                self._span.select(sent)
            return
        placed = self._frame.placed(name, sent)
        if placed is None:
            return
        if placed.kind in _STICK:
            self._place_end(placed)
        elif placed.kind in FIXED_POINTS:
            at: dict[str, Any] = {placed.kind: (placed.x, placed.y)}
            self.clip.change(replace(self.clip.corrections, **at))
        elif placed.kind in ("axes", *_TURNS):
            self._place_axes(placed)
        elif placed.kind in (*_OBJECTS, "outline"):
            kind = "ball" if placed.kind == "outline" else placed.kind
            moved = not placed.pointed or kind != placed.kind
            self.clip.mark(kind, placed.frame, placed.x, placed.y, moved=moved)

    def _place_axes(self, placed: PlacedAt) -> None:
        """Move the origin, or turn the axes so that one of them points to the place."""
        now = self.clip.corrections
        axes = now.axes or Axes(placed.x, placed.y)
        if placed.kind == "axes":
            axes = replace(axes, x_px=placed.x, y_px=placed.y)
        else:
            x, y = placed.x - axes.x_px, axes.y_px - placed.y
            side = -1.0 if self._end_of_axis(axes, placed.kind)[2].startswith("−") else 1.0
            turn = math.degrees(math.atan2(side * y, side * x)) - _TURNS[placed.kind]
            axes = replace(axes, turn_deg=round((turn + 180.0) % 360.0 - 180.0, 2))
        self.clip.change(replace(now, axes=axes))

    def _end_of_axis(self, axes: Axes, kind: str) -> tuple[float, float, str]:
        """A point of an axis within the frame, and its label."""
        info = self.clip.frames.info
        assert info is not None
        arm, turn = 0.25 * min(info.width, info.height), axes.turn_deg + _TURNS[kind]
        x, y = arm * math.cos(math.radians(turn)), -arm * math.sin(math.radians(turn))
        if 0.0 <= axes.x_px + x < info.width and 0.0 <= axes.y_px + y < info.height:
            return axes.x_px + x, axes.y_px + y, kind[-1]
        return axes.x_px - x, axes.y_px - y, f"−{kind[-1]}"

    def _axes_points(self) -> list[FramePoint]:
        axes = self.clip.corrections.axes
        if axes is None or self.clip.frames.info is None:
            return []
        return [
            FramePoint("axes", axes.x_px, axes.y_px, "0"),
            *(FramePoint(kind, *self._end_of_axis(axes, kind), join="axes") for kind in _TURNS),
        ]

    def _place_end(self, placed: PlacedAt) -> None:
        self._ends[placed.kind] = (placed.x, placed.y)
        self._show_points()
        if placed.pointed and placed.kind == "end0":
            self._frame.point("end1", shown_as="end0")
        else:
            self._use_stick()

    def _use_stick(self) -> None:
        length = str(self._length.value or "").strip()
        if len(self._ends) < len(_STICK):
            return
        if not length:
            ui.notify(self.say("stick_needs_length"))
            return
        try:
            self.clip.place_stick(Stick(*self._ends["end0"], *self._ends["end1"], length))
        except UsageError as problem:
            ui.notify(on_page(problem.in_one_line, self.say), type="negative")

    def _show_points(self) -> None:
        points = [FramePoint(key, x, y, "", "end0") for key, (x, y) in self._ends.items()]
        points += self._axes_points()
        found, measured = self.clip.marks(), self.clip.measured
        struck = measured is not None and measured.motion.measured_as is MotionKind.STRIKE
        swung = measured is not None and measured.tracks.pendulum is not None
        # what contradicts the motion must stay visible to be taken back
        self._frame.offer("outline", offered=measured is not None)
        for key, offered in (("landing", struck), ("pivot", swung)):
            placed = getattr(self.clip.corrections, key) is not None
            self._frame.offer(key, offered=offered or placed)
        for key, label in (("pivot", "pivot"), ("landing", "point_landing")):
            at = getattr(self.clip.corrections, key) or found[key]
            if at is not None:
                points.append(FramePoint(key, at[0], at[1], self.say(label)))
        self._frame.points(points)

    def _take_stick(self) -> None:
        """Show the stick of the corrections, also after undo."""
        stick = self.clip.corrections.stick
        if stick != self._stick:
            self._stick = stick
            self._ends = _ends_of(stick)
            self._length.set_value("" if stick is None else stick.length)
        self._show_points()

    def _show_found(self, event: Any) -> None:
        ui.run_javascript(f"visionViewer.all({json.dumps(bool(event.value))})")

    def _measure(self) -> None:
        texts = {name: str(field.value or "").strip() for name, field in self._fields.items()}
        now = self.clip.corrections
        # a typed scale takes the place of a stick
        asked = replace(
            now, inputs=ClipInputs(**texts), stick=None if texts["scale"] else now.stick
        )
        if asked == now:
            self.clip.begin()
        else:
            self.clip.change(asked)

    def _measure_kind(self, event: Any) -> None:
        # also called when the page shows what undo restored
        if event.value != self.clip.corrections.inputs.kind:
            self._measure()

    def _reset(self) -> None:
        self.clip.change(Corrections(self.clip.corrections.inputs))

    def _poll(self) -> None:
        clip = self.clip
        if self._frame.open():
            self._facts.text = self._frame.facts()
        elif clip.frames.problem and clip.frames.info is None and not self._unreadable:
            self._unreadable = True
            self.status.refresh()
        if clip.revision == self._revision:
            return
        self._revision = clip.revision
        self.status.refresh()
        if clip.drawn != self._outlined:
            self._outlined = clip.drawn
            ui.run_javascript(f"visionViewer.marks({json.dumps(self._marks_url)})")
        history = clip.history
        self._undo.set_enabled(history.can_undo)
        self._redo.set_enabled(history.can_redo)
        drawn = (id(clip.measured), clip.busy, history.now)
        if drawn == self._drawn:
            return
        self._drawn = drawn
        self._take_stick()
        for name, field in self._fields.items():
            field.set_value(getattr(history.now.inputs, name))
        self.repeats.refresh()
        shown = (id(clip.measured), clip.measured is None and clip.busy)
        if shown != self._numbered:
            self._numbered = shown
            self.numbers.refresh()
            self.messages.refresh()
        if not clip.busy:
            self.graphs.refresh()

    @property
    def _marks_url(self) -> str:
        return f"/marks/{self.clip.number}/{self.clip.revision}"


def job_status(jobs: Jobs, say: Say) -> None:
    """The running job, or why the last one failed."""
    if jobs.busy:
        with ui.row().classes("items-center gap-2 no-wrap").props("role=status data-test=busy"):
            ui.spinner(size="sm").props("aria-hidden=true")
            ui.label(f"{on_page(jobs.busy, say)} …")
    if jobs.problem:
        note = ui.label(on_page(jobs.problem, say)).classes("va-note bad")
        note.props("role=alert data-test=problem")


def copy_card(say: Say, command: str, python: str) -> None:
    """A card with the same work as a command and in Python, each with a button to copy it.

    A text that is empty is left out.
    """
    with ui.column().classes("va-card va-hidden-in-print").props("data-test=repeats"):
        for key, text in (("as_command", command), ("as_python", python)):
            if not text:
                continue
            with ui.row().classes("w-full items-center justify-between"):
                ui.label(say(key)).classes("va-label")

                def copy(text: str = text) -> None:
                    ui.clipboard.write(text)
                    ui.notify(say("copied"))

                button = ui.button(say("copy"), on_click=copy)
                button.props(f'flat dense aria-label="{say("copy")}: {say(key)}"')
            with ui.element("pre").classes("va-code").props(f"data-test={key}"):
                ui.label(text)
