"""A folder of clips as a campaign: cards and points of its ledger, marks, runs."""

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any

import tomli_w
from pydantic import TypeAdapter, ValidationError

from metrology import (
    ImpactVisionError,
    Quantity,
    UsageError,
    parse_toml,
    read_small_text,
    write_text_whole,
)
from metrology.quantity import format_quantity
from pipelines.app.corrections import TypedInputs, mistake_in
from pipelines.app.openings import free_place
from pipelines.campaign.conduct import CampaignOptions, conduct, results_folder
from pipelines.campaign.ledger import Entry, Ledger, State
from pipelines.campaign.results import read_lab_book
from pipelines.campaign.run import find_clips
from pipelines.report.inputs import for_people
from pipelines.terminal import as_typed

__all__ = ["WANTED_STD", "ClipCard", "FolderInputs", "FolderSession", "FolderState", "Wanted"]

MIN_CERTAIN_PROBABILITY = 0.9
"""Probability of the motion kind below which a clip is listed first (chosen)."""

CARD_QUANTITIES = ("contact_time", "ball_speed", "launch_angle", "cor")

WANTED_STD = 0.01
"""Standard uncertainty of restitution that a campaign is planned for (chosen: 1 %)."""

MAX_REASON = 500
"""Characters of a reason (chosen: a sentence or two)."""


@dataclass(frozen=True)
class FolderInputs(TypedInputs):
    """Inputs of a campaign as a person types them; empty ones are not given.

    Attributes
    ----------
    trials, setup, fps, ball, wall_grid : str
        Arguments of `vision campaign`; paths start at the folder.
    """

    trials: str = ""
    setup: str = ""
    fps: str = ""
    ball: str = ""
    wall_grid: str = ""


@dataclass(frozen=True)
class ClipCard:
    """A clip of a campaign as it is displayed.

    Attributes
    ----------
    error, bad, pointed, motion : str
        Why it failed; why it is marked as bad; the point on the ball; the kind of motion.
    unsure : bool
        Whether it failed or its motion is uncertain.
    frame : bool
        Whether there is a picture of it.
    values : dict of str to str
        Quantities with ± and unit.
    stamp : str
        Changes when it is measured again.
    """

    clip: str
    path: str
    state: str
    error: str = ""
    bad: str = ""
    pointed: str = ""
    motion: str = ""
    unsure: bool = False
    frame: bool = False
    values: tuple[tuple[str, str], ...] = ()
    stamp: str = ""


@dataclass(frozen=True)
class Wanted:
    """Strikes that would make a ball's law as certain as `WANTED_STD` where it is least so.

    Attributes
    ----------
    speed, std : float
        Impact speed, m/s, and the law's standard uncertainty there.
    strikes : int
        At the least; 0 if there are enough.
    """

    ball: str
    speed: float
    std: float
    strikes: int


@dataclass(frozen=True)
class FolderState:
    """State of a campaign.

    Attributes
    ----------
    counts : dict of str to int
        Clips by state.
    cards : tuple of ClipCard
        The uncertain ones first.
    points : tuple of (float, float, str, bool)
        Impact speed, coefficient of restitution, clip, and whether it counts.
    law : tuple of (float, float)
        The fitted law: speeds and values.
    wanted : tuple of Wanted
        A ball each.
    """

    counts: dict[str, int]
    cards: tuple[ClipCard, ...]
    points: tuple[tuple[float, float, str, bool], ...]
    law: tuple[tuple[float, float], ...]
    wanted: tuple[Wanted, ...] = ()


class FolderSession:
    """A campaign that the page shows, and runs itself if it has a folder of clips.

    Parameters
    ----------
    out : Path
        Folder of results.
    clips : Path, optional
        Folder of clips; without one the campaign command runs it.

    Attributes
    ----------
    problem : str
        Why the last run ended; empty if it succeeded.
    asked, closed : Event
        A clip was marked or a ball selected; the page was closed.
    """

    def __init__(self, out: Path, clips: Path | None = None) -> None:
        self.out, self.clips = out, clips
        self.running = clips is None
        self.problem = ""
        self.asked, self.closed = Event(), Event()
        self._lock = Lock()
        self.inputs = FolderInputs()
        if clips is not None:
            try:
                self.inputs = _read_inputs(clips)
            except ImpactVisionError as problem:
                self.problem = problem.in_one_line

    @classmethod
    def of(cls, clips: Path) -> "FolderSession":
        """Campaign of a folder of clips, with its results within."""
        return cls(results_folder([clips], None), clips)

    def wait(self) -> bool:
        """Wait until a clip is marked or a ball selected (true), or the page closes (false)."""
        while not self.closed.is_set():
            if self.asked.wait(0.3):
                self.asked.clear()
                return True
        return False

    def begin(self, inputs: FolderInputs) -> None:
        """Measure what is not measured yet, with these inputs; they are kept in the folder."""
        assert self.clips is not None
        self.inputs = inputs
        try:
            write_text_whole(_inputs_file(self.clips), tomli_w.dumps(inputs.given()))
        except ImpactVisionError as problem:
            self.problem = problem.in_one_line
            return
        self._run()

    def paste(self, text: str) -> str:
        """Keep a table copied from a spreadsheet as the lab book.

        Parameters
        ----------
        text : str
            Lines of cells between tabs, the first with the names of the columns.

        Returns
        -------
        str
            Name of its new file in the folder.

        Raises
        ------
        ImpactVisionError
            If it is no lab book; then nothing is kept.
        """
        assert self.clips is not None
        place = free_place(self.clips, "trials.csv")
        write_text_whole(place, text.strip("\r\n") + "\n")
        try:
            read_lab_book(place)
        except ImpactVisionError:
            place.unlink()
            raise
        return place.name

    def sheet(self) -> str:
        """The lab book in use as text; without one, a row for each clip, its cells to be filled."""
        assert self.clips is not None
        place = self.clips / self.inputs.trials
        try:
            if place.suffix == ".csv":
                return read_small_text(place, what="the lab book")
            rows = [f"{one.name}\t\t\t" for one in find_clips([self.clips])]
        except ImpactVisionError:
            return ""
        return "\n".join(["clip\tball\tbackswing_deg\tsession", *rows])

    def finish(self) -> None:
        """Wait until nothing is being measured any more."""
        while self.running:
            time.sleep(0.2)

    def as_command(self) -> str:
        """The same campaign as a command."""
        words = ["vision", "campaign", str(self.clips or self.out)]
        for name, text in self._arguments().items():
            words += [f"--{name.replace('_', '-')}", str(text)]
        return as_typed([*words, "--out", self.out])

    def as_python(self) -> str:
        """The same campaign in Python."""
        given = {**self._arguments(), "out": self.out}
        arguments = "".join(f", {name}={str(text)!r}" for name, text in given.items())
        called = f"iv.campaign({str(self.clips or self.out)!r}{arguments})"
        return f"import impact_vision as iv\n\nc = {called}\nprint(c)"

    def mark(self, clip: str, reason: str | None) -> None:
        """Mark a trial as bad, or remove the mark with None.

        Raises
        ------
        UsageError
            If there is no such clip.
        """
        kept = None if reason is None else reason.strip()[:MAX_REASON] or None
        self._change(lambda ledger: ledger.exclude(clip, kept))

    def point(self, clip: str, x: float, y: float) -> None:
        """Select the ball at a point of the picture, as fractions of its width and height.

        Raises
        ------
        UsageError
            If there is no such clip, or it was never measured.
        """
        with Ledger(self.out) as ledger:
            sizes = {
                one.order.clip: (one.document or {}).get("clip", {}) for one in ledger.entries()
            }
        size = sizes.get(clip, {})
        if "width" not in size or not (0.0 <= x <= 1.0 and 0.0 <= y <= 1.0):
            raise UsageError(
                f"{clip} has no picture to point at", hint="Open the clip, and select the ball."
            )
        at = f"{x * size['width']:.1f},{y * size['height']:.1f}"
        self._change(lambda ledger: ledger.point_at(clip, at))

    def picture(self, clip: str) -> bytes | None:
        """Picture of a clip of the ledger; None for any other name."""
        path = self.out / "frames" / f"{clip}.jpg"
        if not self._has_ledger() or not path.is_file():
            return None
        with Ledger(self.out) as ledger:
            known = any(entry.order.clip == clip for entry in ledger.entries())
        return path.read_bytes() if known else None

    def state(self) -> FolderState:
        """What the ledger and the results hold now.

        Raises
        ------
        UsageError
            If the ledger is damaged.
        """
        if not self._has_ledger():
            clips = [] if self.clips is None else find_clips([self.clips])
            cards = [ClipCard(one.name, str(one), State.WAITING) for one in clips]
            return FolderState({State.WAITING: len(cards)}, tuple(cards), (), ())
        with Ledger(self.out) as ledger:
            counts = {str(key): number for key, number in ledger.counts().items()}
            pointed = ledger.points()
            entries = [*ledger.entries()]
        cards = [_card(one, pointed.get(one.order.clip, ""), self.out) for one in entries]
        cards.sort(key=lambda one: not one.unsure)
        points = [point for one in entries if (point := _point(one)) is not None]
        return FolderState(counts, tuple(cards), tuple(points), *_laws(self.out / "summary.json"))

    def _has_ledger(self) -> bool:
        return (self.out / "ledger.sqlite").is_file()

    def _arguments(self) -> dict[str, Any]:
        given: dict[str, Any] = self.inputs.given()
        if self.clips is not None:
            for name in given.keys() & {"trials", "setup"}:
                given[name] = self.clips / given[name]
        return given

    def _change(self, change: Callable[[Ledger], None]) -> None:
        with Ledger(self.out) as ledger:
            change(ledger)
        self.asked.set()
        if self.clips is not None:
            self._run()

    def _run(self) -> None:
        with self._lock:
            self.asked.set()
            if not self.running:
                self.running = True
                Thread(target=self._work, daemon=True).start()

    def _work(self) -> None:
        """Run the campaign until nothing was asked for meanwhile."""
        assert self.clips is not None
        try:
            while True:
                with self._lock:
                    if not self.asked.is_set():
                        self.running = False
                        return
                    self.asked.clear()
                self.out.mkdir(parents=True, exist_ok=True)
                conduct(CampaignOptions((self.clips,), self.out, **self._arguments()))
                self.problem = ""
        except (ImpactVisionError, OSError) as problem:
            self.problem = getattr(problem, "in_one_line", str(problem))
        finally:
            self.running = False


def _inputs_file(clips: Path) -> Path:
    return clips / "vision-app.toml"


def _read_inputs(clips: Path) -> FolderInputs:
    """Inputs kept in the folder; without them the files that are usually there.

    Raises
    ------
    UsageError
        If the file is damaged.
    """
    file = _inputs_file(clips)
    if not file.is_file():
        there = [name for name in ("setup.toml", "lab.toml") if (clips / name).is_file()]
        trials = [name for name in ("trials.csv", "trials.xlsx") if (clips / name).is_file()]
        return FolderInputs(*(names[0] if names else "" for names in (trials, there)))
    held = parse_toml(read_small_text(file, what="the inputs"), str(file))
    try:
        return TypeAdapter(FolderInputs).validate_python(held)
    except ValidationError as problem:
        known = ", ".join(sorted(one.name for one in fields(FolderInputs)))
        raise UsageError(
            f"{file}: {mistake_in(problem)}", hint=f"Keep only {known}, or delete the file."
        ) from problem


def _card(entry: Entry, pointed: str, folder: Path) -> ClipCard:
    document = entry.document or {}
    quantities = document.get("quantities", {})
    motion = document.get("motion", {})
    probability = motion.get("probability")
    finished = entry.state in (State.DONE, State.FAILED)
    uncertain = probability is not None and probability < MIN_CERTAIN_PROBABILITY
    said = f"{motion.get('kind')}, {probability:.2f}" if uncertain else ""
    values = [
        (name, format_quantity(for_people(Quantity(name, one["value"], one["std"], one["unit"]))))
        for name in CARD_QUANTITIES
        if (one := quantities.get(name, {})).get("value") is not None
    ]
    clip = entry.order.clip
    return ClipCard(
        clip=clip,
        path=entry.order.path,
        state=str(entry.state),
        error=entry.error or "",
        bad=entry.excluded or "",
        pointed=pointed,
        motion=said,
        unsure=finished and (entry.state == State.FAILED or uncertain),
        frame=(folder / "frames" / f"{clip}.jpg").is_file(),
        values=tuple(values),
        stamp=f"{entry.attempts}-{entry.state}-{entry.seconds}",
    )


def _point(entry: Entry) -> tuple[float, float, str, bool] | None:
    quantities = (entry.document or {}).get("quantities", {})
    speed, cor = (
        quantities.get(name, {}).get("value") for name in ("pendulum_speed_before", "cor")
    )
    if not isinstance(speed, int | float) or not isinstance(cor, int | float):
        return None
    return float(speed), float(cor), entry.order.clip, entry.excluded is None


def _laws(summary: Path) -> tuple[tuple[tuple[float, float], ...], tuple[Wanted, ...]]:
    """Fitted laws of the last results, one after another, and what each lacks; none without."""
    try:
        balls = json.loads(summary.read_text(encoding="utf-8"))["balls"]
        known = {name: ball["cor_at"] for name, ball in balls.items() if ball.get("cor_at")}
        law = [(float(at["speed"]), float(at["value"])) for own in known.values() for at in own]
        wanted = [_wanted(name, balls[name]) for name in known if balls[name]["precision"]]
        return tuple(law), tuple(wanted)
    except (OSError, ValueError, TypeError, LookupError, AttributeError):
        return (), ()


def _wanted(name: str, ball: dict[str, Any]) -> Wanted:
    """Strikes to add where the law is known least; their scatter averages, common errors do not."""
    speed, std = max(((at["speed"], at["std"]) for at in ball["cor_at"]), key=lambda at: at[1])
    lacking = ball["precision"]["repeatability"] ** 2 * (WANTED_STD**-2 - std**-2)
    return Wanted(name, float(speed), float(std), max(math.ceil(lacking), 0))
