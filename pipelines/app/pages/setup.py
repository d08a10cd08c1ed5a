"""Page Set up: cards of answers on the frame, uncertainty to expect, Measure."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from metrology import ImpactVisionError
from pipelines.app.corrections import ClipInputs, cure_of
from pipelines.app.pages.clip import copy_card, job_status
from pipelines.app.pages.frame import ClipFrame, FramePoint, heading
from pipelines.app.session import ClipSession
from pipelines.app.words import Say, on_page, translated
from pipelines.calibrate.answers import ANSWER_OPTIONS, EMPTY_ANSWERS, Answers, text_of
from pipelines.calibrate.corners import starting_corners
from pipelines.calibrate.drawing import RAMP, grid_lines, path_line, shaded_map
from pipelines.calibrate.outlook import compare_length
from pipelines.calibrate.session import Session, session_of, with_corners
from pipelines.terminal import as_typed
from pipelines.web import Jobs

__all__ = ["SETUP_NAME", "SetupPage", "command_of", "python_of", "started"]

POLL_S = 0.25
"""s between updates from the session (chosen: appears immediate)."""

SETUP_NAME = "setup.toml"
"""Set-up file, next to the clip; the same name as of `vision calibrate`."""

MAX_BUDGET_LINES, MAX_CHANGES = 5, 3
"""Lines of the budget and changes shown (chosen: a card holds them without scrolling)."""

_CARDS: tuple[tuple[str, tuple[tuple[str, str, str], ...]], ...] = (
    ("rate", (("fps", "fps", "600 fps"),)),
    ("wall", (("wall_grid", "wall_grid", "50 mm"), ("fine_grid", "fine_grid", "10 mm"))),
    (
        "ball",
        (("ball", "ball_and_mass", "220 mm, 0.4 kg"), ("support_height", "support", "0.312 m")),
    ),
    (
        "distances",
        (
            ("camera_distance", "camera_distance", "4.00 m ± 5 mm"),
            ("ball_plane", "ball_plane", "0.45 m ± 5 mm"),
        ),
    ),
    (
        "pendulum",
        (
            ("pendulum_mass", "pendulum_mass", "2.50 kg ± 5 g"),
            ("pendulum_length", "pendulum_length", "0.480 m ± 1 mm"),
            ("pendulum_com", "pendulum_com", "0.420 m ± 3 mm"),
            ("pendulum_period", "pendulum_period", "1.36 s ± 0.01 s"),
            ("pendulum_inertia", "pendulum_inertia", "0.482 kg m^2 ± 1 %"),
        ),
    ),
    ("lens", (("lens", "lens_file", "lens.toml"),)),
)
"""Cards: key of the title, and their answers with the key of the label and an example."""

_GRID = ("corner0", "corner1", "corner2", "corner3")
_BAR = ("end0", "end1")


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
        setup=clip.parent / inputs.setup if inputs.setup else None,
        fps=inputs.fps or None,
        wall_grid=inputs.wall_grid or None,
        ball=inputs.ball or None,
    )
    session.find_grid()
    return session


def command_of(answers: Answers) -> str:
    """The same calibration as a command."""
    words: list[str] = ["vision", "calibrate", str(answers.scene.info.path)]
    if answers.begun is not None:
        words += ["--setup", str(answers.begun)]
    for name in ANSWER_OPTIONS:
        if text := text_of(answers, name):
            words += [f"--{name.replace('_', '-')}", text]
    return as_typed([*words, "--yes", "--out", answers.out])


def python_of(answers: Answers) -> str:
    """The same calibration in Python, which has no use for the pendulum."""
    given = {name: text_of(answers, name) for name in ANSWER_OPTIONS if "pendulum" not in name}
    arguments = "".join(f", {name}={text!r}" for name, text in given.items() if text)
    clip = str(answers.scene.info.path)
    return f"import impact_vision as iv\n\nc = iv.calibrate({clip!r}{arguments})\nprint(c)"


def _millimetres(length: float | None) -> str:
    """A length in mm with two or three digits, or a dash."""
    if length is None:
        return "–"
    value = 1e3 * length
    return f"{value:.0f} mm" if value >= 99.5 else f"{value:.2g} mm"


class SetupPage:
    """The page in one window.

    Parameters
    ----------
    jobs : Jobs
        Run what takes longer than a moment.
    measured : callable
        Called once the set-up file is in use and the clip is being measured.
    """

    def __init__(
        self, clip: ClipSession, jobs: Jobs, say: Say, measured: Callable[[], None]
    ) -> None:
        self.clip, self.jobs, self.say, self._measured = clip, jobs, say, measured
        self._frame = ClipFrame(clip, say)
        self._fields: dict[str, Any] = {}
        self._notes: dict[str, ui.label] = {}
        self._texts: dict[str, str] = {}
        self._known: dict[str, str] = {}
        self._drawn: object = None
        self._ends: dict[str, tuple[float, float]] = {}
        self._under = "grid"
        self._by_hand = False

    @property
    def session(self) -> Session | None:
        """The calibration; None until the clip is opened."""
        return self.clip.calibration

    def build(self) -> None:
        """Lay the page out; what depends on the clip follows when it is opened."""
        if self.session is None:
            self.jobs.submit(self.say("opening_clip"), self._start)
        say = self.say
        with ui.column().classes("va-page"):
            with ui.row().classes("w-full items-baseline gap-3"):
                heading("h1", say("setup_of", name=self.clip.path.name))
                self._facts = ui.label().classes("va-small")
            with ui.element("div").classes("va-columns va-ends"):
                with ui.element("div").classes("va-column"), ui.column().classes("va-card"):
                    self._frame.build()
                    with ui.row().classes("items-center gap-2"):
                        for kind in ("rest", "landing", "origin"):
                            self._frame.button(kind, say(f"point_{kind}"))
                        layers = {one: say(f"layer_{one}") for one in ("grid", "map", "none")}
                        layer = ui.select(layers, value=self._under, on_change=self._show_layer)
                        layer.props(f'dense outlined aria-label="{say("layer")}" data-test=layer')
                    self.legend()
                with ui.element("div").classes("va-column"):
                    self.status()
                    self.outlook()
                    with ui.row().classes("w-full items-center gap-2"):
                        ui.button(say("measure"), on_click=partial(self._save, True)).props(
                            "unelevated data-test=measure"
                        )
                        ui.button(say("save"), on_click=partial(self._save, False)).props(
                            "outline data-test=save"
                        )
                    self.saved()
                    self._length_card()
                with ui.element("div").classes("va-column"):
                    with ui.element("div").classes("va-cards").props("data-test=panel"):
                        for key, answers in _CARDS:
                            self._card(key, answers)
                    self.repeats()
        ui.timer(POLL_S, self._poll)

    def _card(self, key: str, answers: tuple[tuple[str, str, str], ...]) -> None:
        say = self.say
        with ui.column().classes("va-card").props(f"data-test=card-{key}"):
            heading("h2", say(f"card_{key}"))
            for name, label, example in answers:
                field = ui.input(say(label), placeholder=example)
                field.props(f"dense outlined stack-label data-test={name}").classes("w-full")
                for event in ("keydown.enter", "blur"):
                    field.on(event, partial(self._answer, name, say(label)))
                self._fields[name] = field
            if key == "wall":
                self._handles()
            if key == "ball":
                follow = ui.button(say("track_ball"), on_click=self._follow)
                follow.props("outline dense data-test=follow")
            self._notes[key] = ui.label().classes("va-small").style("white-space: pre-line")

    def _noted(self, key: str, session: Session) -> list[str]:
        say, answers = self.say, session.answers
        calibration = session.outlook.calibration
        if key == "rate":
            rate = answers.rate
            known = say("rate_known" if rate.known else "rate_assumed", fps=f"{rate.fps:g}")
            return [known]
        if key == "wall":
            if (grid := answers.grid) is None:
                return [session.grid_problem] if session.grid_problem else []
            noise = math.sqrt(np.median(np.trace(grid.covariance_px2, axis1=1, axis2=2) / 2.0))
            pitch = "" if answers.setup.wall.grid else say("pitch_assumed")
            how = say(f"grid_{answers.grid_source}", count=len(grid.nodes), std=f"{noise:.2f}")
            return [how, *([pitch] if pitch else [])]
        if key == "ball":
            if answers.tracks is None:
                return [session.ball_problem or say("not_tracked")]
            return [say("tracked_to_landing" if answers.landing[1] else "tracked")]
        if key == "distances" and calibration is not None:
            alone = [
                (translated(str(one.source), say), f"{one.value:.3f} ± {one.std:.3f} m")
                for one in calibration.depth_estimates
            ]
            found = [say("depth_from", source=name, value=value) for name, value in alone]
            return [say("distances_note"), *found]
        if key == "lens" and answers.lens is not None:
            focal, std = answers.lens.lens.fx, answers.lens.std[0]
            return [say("focal", value=f"{focal:.1f} ± {focal * std:.1f} px")]
        return [say(f"{key}_note")] if key in ("pendulum", "lens", "distances") else []

    def _handles(self) -> None:
        say = self.say
        hand = ui.checkbox(say("by_hand"), on_change=lambda event: self._set_by_hand(event.value))
        hand.props("dense data-test=by-hand")
        with ui.row().classes("w-full no-wrap gap-2") as row:
            squares = [
                ui.number(say(key), value=value, step=1, precision=0)
                .props(f"dense outlined stack-label data-test={key}")
                .classes("grow")
                for key, value in (("across", 10), ("up", 5))
            ]
            button = ui.button(say("measure_corners"), on_click=lambda: self._corners(squares))
            button.props("outline dense data-test=measure-corners")
        row.bind_visibility_from(hand, "value")

    def _length_card(self) -> None:
        say = self.say
        with ui.element("details").classes("va-card").props("data-test=length"):
            heading("summary", say("verify_length")).classes("inline")
            with ui.row().classes("w-full items-center gap-2"):
                self._frame.button("end0", say("place_ends"))
                self._length = ui.input(say("known_length"), placeholder="0.500 m")
                self._length.props("dense outlined stack-label data-test=known-length")
                self._length.on("keydown.enter", lambda: self.length.refresh())
                self._length.on("blur", lambda: self.length.refresh())
                planes = {True: say("on_wall"), False: say("on_ball_plane")}
                self._plane = ui.select(planes, value=True, on_change=self.length.refresh)
                self._plane.props(f'dense outlined aria-label="{say("plane")}" data-test=plane')
            self.length()

    @ui.refreshable_method
    def length(self) -> None:
        """Length between the two ends, compared with the known one."""
        session = self.session
        if session is None or session.outlook.calibration is None or len(self._ends) < len(_BAR):
            return
        first, second = (np.array(self._ends[key]) for key in _BAR)
        compared = compare_length(
            session.outlook.calibration,
            first,
            second,
            str(self._length.value or ""),
            on_wall=bool(self._plane.value),
        )
        kind = "va-note bad" if compared.disagrees else "va-note"
        ui.label(compared.text).classes(kind).props("role=status data-test=compared")

    @ui.refreshable_method
    def status(self) -> None:
        """The running job, or why it failed."""
        job_status(self.jobs, self.say)

    @ui.refreshable_method
    def outlook(self) -> None:
        """The expected uncertainty, what it is made of, and contradictions with their cures."""
        say, session = self.say, self.session
        if session is None:
            return
        found = session.outlook
        with ui.column().classes("va-card").props("data-test=outlook aria-live=polite"):
            heading("h2", say("expected"))
            if found.std is None or found.distance is None:
                ui.label(say("expected_open")).classes("va-small").props("data-test=std")
                scaled = session.answers.grid is None and session.answers.inputs.ball is not None
                problem = say("ball_is_scale") if scaled else found.problem
                if problem:
                    ui.label(on_page(problem, say)).classes("va-note warn")
            else:
                with ui.element("div").classes("va-figure"), ui.element("b"):
                    ui.label(f"± {_millimetres(found.std)}").props("data-test=std")
                key = "expected_assumed" if found.assumed else "expected_at"
                ui.label(say(key, distance=f"{found.distance:.3f} m")).classes("va-small")
                with ui.element("div").classes("va-budget"):
                    for line in found.budget[:MAX_BUDGET_LINES]:
                        ui.label(translated(str(line.source), say))
                        ui.label(_millimetres(line.std)).style("text-align: right")
                        part = 100.0 * line.std / found.budget[0].std
                        ui.element("div").classes("va-bar").style(f"width: {part:.0f}%")
            for warning in found.warnings:
                with ui.column().classes("va-note warn gap-1"):
                    ui.label(on_page(warning, say))
                    for finding in found.findings:
                        if finding.sentence == warning:
                            self._cures(finding.cures)
            self._changes(session)

    def _cures(self, options: tuple[str, ...]) -> None:
        labels = {name: label for _, answers in _CARDS for name, label, _ in answers}
        for name, text in filter(None, (cure_of(one, labels) for one in options)):
            label = self.say(labels[name])
            button = ui.button(
                self.say("cure", what=label, text=text),
                on_click=partial(self._take, name, label, text),
            )
            button.props(f"outline dense no-caps data-test=cure-{name}")

    def _changes(self, session: Session) -> None:
        known = [one for one in session.changes if one.after is not None]
        with ui.column().classes("gap-0 va-small").props("data-test=changes"):
            for one in reversed(known[-MAX_CHANGES:]):
                label = translated(one.label, self.say)
                ui.label(f"{label}: {_millimetres(one.before)} → {_millimetres(one.after)}")

    @ui.refreshable_method
    def legend(self) -> None:
        """Colours of the uncertainty map."""
        found = None if self.session is None else self.session.outlook.calibration
        if found is None or self._under != "map":
            return
        scale = shaded_map(found)[1]
        with ui.row().classes("w-full items-center no-wrap gap-2 va-small"):
            ui.label(_millimetres(scale.low))
            ui.element("div").style(
                f"flex: 1; height: 12px; background: linear-gradient(to right, {', '.join(RAMP)})"
            )
            ui.label(_millimetres(scale.high))
        ui.label(self.say("map_note")).classes("va-small")

    @ui.refreshable_method
    def saved(self) -> None:
        """Where the files are written to, or were."""
        if (session := self.session) is None:
            return
        out, written = session.answers.out, session.written
        key = "written" if written else "replaces" if out.exists() else "writes"
        name = str(written or out)
        ui.label(self.say(key, name=name)).classes("va-small").props("data-test=saved role=status")

    @ui.refreshable_method
    def repeats(self) -> None:
        """The same calibration as a command and in Python."""
        # the command without questions needs a wall grid
        if self.session is not None and self.session.answers.grid is not None:
            answers = self.session.answers
            copy_card(self.say, command_of(answers), python_of(answers))

    def on_viewer(self, name: str, sent: dict[str, Any]) -> None:
        """React to a point that was placed or dragged."""
        placed = self._frame.placed(name, sent) if name in ("pointed", "moved") else None
        session = self.session
        if placed is None or session is None:
            return
        px = np.array([placed.x, placed.y])
        if placed.kind in _BAR:
            self._ends[placed.kind] = (placed.x, placed.y)
            if placed.pointed and placed.kind == "end0":
                self._frame.point("end1", shown_as="end0")
            self.length.refresh()
        elif placed.kind in _GRID:
            corners = self._handles_of(session.answers)
            corners[_GRID.index(placed.kind)] = px
            session.answers = replace(session.answers, corners=corners)
        elif placed.kind == "origin":
            self._submit("computing", lambda: session.apply("origin", partial(_with_origin, px)))
        elif placed.kind in ("rest", "landing"):
            fields: dict[str, Any] = {f"{placed.kind}_px": px}
            said = self.say(f"point_{placed.kind}")
            self._submit("computing", lambda: session.update(said, **fields))
        self._frame.points(self._points(session.answers))

    def _points(self, answers: Answers) -> list[FramePoint]:
        say = self.say
        landing, seen = answers.landing
        label = "point_landing" if seen else "landing_assumed"
        points = [
            FramePoint(kind, float(px[0]), float(px[1]), say(label))
            for kind, px, label in (
                ("landing", landing, label),
                ("rest", answers.rest, "point_rest"),
                ("origin", answers.origin_px, "point_origin"),
            )
            if px is not None
        ]
        if self._by_hand:
            points += [
                FramePoint(kind, float(x), float(y), str(k + 1), _GRID[k - 1])
                for k, (kind, (x, y)) in enumerate(
                    zip(_GRID, self._handles_of(answers), strict=True)
                )
            ]
        return points + [FramePoint(key, x, y, "", "end0") for key, (x, y) in self._ends.items()]

    @staticmethod
    def _handles_of(answers: Answers) -> Any:
        if answers.corners is not None:
            return answers.corners.copy()
        return starting_corners(answers.grid, answers.scene.size)

    def _set_by_hand(self, wanted: bool) -> None:
        session = self.session
        self._by_hand = bool(wanted)
        if session is None:
            return
        if not wanted and session.answers.corners is not None:
            self._submit("searching_grid", session.find_grid)
        self._frame.points(self._points(session.answers))

    def _corners(self, squares: list[Any]) -> None:
        session = self.session
        if session is None:
            return
        across, up = (int(one.value or 0) for one in squares)
        corners = self._handles_of(session.answers)

        def changed(answers: Answers) -> Answers:
            return with_corners(replace(answers, corners=corners, squares=(across, up)))

        self._submit("measuring_corners", lambda: session.apply(self.say("by_hand"), changed))

    def _answer(self, name: str, label: str) -> None:
        """Take over a field once it differs from what is known."""
        text = str(self._fields[name].value or "").strip()
        if text != self._texts.get(name, ""):
            self._texts[name] = text
            self._take(name, label, text)

    def _take(self, name: str, label: str, text: str) -> None:
        session = self.session
        if session is not None:
            given = "" if text.lower() in EMPTY_ANSWERS else text
            self._submit("computing", lambda: session.answer(label, name, given))

    def _follow(self) -> None:
        session = self.session
        if session is not None:
            at = session.answers.rest_px
            point = None if at is None else (float(at[0]), float(at[1]))
            self._submit("tracking_ball", lambda: session.follow_ball(point))

    def _submit(self, key: str, work: Callable[[], object]) -> None:
        self.jobs.submit(self.say(key), work)

    def _show_layer(self, event: Any) -> None:
        self._under = str(event.value)
        self._draw_layer()
        self.legend.refresh()

    def _draw_layer(self) -> None:
        session = self.session
        if session is None:
            return
        answers, found = session.answers, session.outlook.calibration
        drawn = path_line(answers)
        if self._under == "grid" and answers.grid is not None:
            drawn = grid_lines(answers.grid) + drawn
        elif self._under == "map" and found is not None:
            drawn = shaded_map(found)[0] + drawn
        ui.run_javascript(f"visionViewer.under({json.dumps(drawn)})")

    def _start(self) -> None:
        if self.clip.calibration is None:
            self.clip.calibration = started(self.clip.path, self.clip.corrections.inputs)
            self.clip.calibration.look_for_ball()

    def _poll(self) -> None:
        opened = self._frame.open()
        if opened:
            self._facts.text = self._frame.facts()
        session = self.session
        known = (self.jobs.revision, session is None or len(session.changes))
        if known == self._drawn and not opened:
            return
        self._drawn = known
        self.status.refresh()
        if session is None:
            return
        self._show_texts(session.answers)
        for key, note in self._notes.items():
            note.set_text("\n".join(on_page(one, self.say) for one in self._noted(key, session)))
        for part in (self.outlook, self.length, self.legend, self.saved, self.repeats):
            part.refresh()
        self._frame.points(self._points(session.answers))
        self._draw_layer()

    def _show_texts(self, answers: Answers) -> None:
        """Show what has changed; a text that was refused, or is being typed, stays."""
        if self.jobs.busy:
            return
        for name, field in self._fields.items():
            text = text_of(answers, name)
            if text != self._known.get(name, ""):
                self._known[name] = self._texts[name] = text
                field.set_value(text)

    def _save(self, measure: bool) -> None:
        session, now = self.session, self.clip.corrections
        if session is None:
            return
        self.jobs.problem = ""
        try:
            written = session.save()
        except ImpactVisionError as problem:
            self.jobs.problem = problem.in_one_line
        self.status.refresh()
        self.saved.refresh()
        if self.jobs.problem or not measure:
            return
        setup, folder = written.setup.absolute(), self.clip.path.parent.absolute()
        setup = setup.relative_to(folder) if setup.parent == folder else setup
        asked = replace(now, inputs=ClipInputs(setup=str(setup)), stick=None)
        if asked == now:
            self.clip.begin()
        else:
            self.clip.change(asked)
        self._measured()


def _with_origin(px: Any, answers: Answers) -> Answers:
    grid = None if answers.grid is None else answers.grid.with_origin(px, snap=True)
    return replace(answers, origin_px=px, grid=grid)
