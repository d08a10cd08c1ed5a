"""The same questions on a text terminal."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from metrology import ImpactVisionError, NotFoundError
from pipelines.calibrate.wizard.answers import (
    Answers,
    ball_from,
    distance_from,
    fine_pitch_from,
    lens_from_file,
    pitch_from,
    point_from,
    rate_from,
)
from pipelines.calibrate.wizard.session import Session, with_ball

__all__ = ["Dialogue", "ask_all", "told_of"]

Changed = Callable[[Answers, str], Answers]


class Dialogue:
    """Somebody to ask.

    Parameters
    ----------
    ask : callable
        Takes a question and what an empty answer means; returns the answer.
    say : callable
        Takes a line to show.
    """

    def __init__(self, ask: Callable[[str, str], str], say: Callable[[str], None]) -> None:
        self.ask = ask
        self.say = say

    def until_right(
        self, session: Session, question: str, default: str, label: str, changed: Changed
    ) -> None:
        """Ask until the answer makes sense, and tell what it did; an empty answer keeps."""
        while True:
            text = self.ask(question, default).strip()
            if text == default:
                return
            try:
                session.apply(label, partial(_with_text, changed, text))
            except ImpactVisionError as problem:
                self.say(f"  {problem.in_one_line}")
                continue
            self.say(f"  {told_of(session)}")
            return


def _with_text(changed: Changed, text: str, answers: Answers) -> Answers:
    return changed(answers, text)


def told_of(session: Session) -> str:
    """What the last answer did to the expected uncertainty, in words."""
    found = session.outlook
    if found.std is None:
        return found.problem
    change = session.changes[-1]
    before = "" if change.before is None else f", before {1e3 * change.before:.3g} mm"
    where = "a supposed landing" if found.supposed else "the landing"
    return f"{where} is expected to ± {1e3 * found.std:.3g} mm{before}"


def ask_all(session: Session, talk: Dialogue, given: frozenset[str] = frozenset()) -> None:
    """Go through the six steps.

    Parameters
    ----------
    session : Session
        Its answers are the defaults.
    talk : Dialogue
    given : frozenset of str
        Questions that options have answered already: "fps", "lens", "wall", "ball", "support",
        "camera_distance", "ball_plane".
    """
    info = session.answers.scene.info
    talk.say(f"1 clip: {info.path.name}, {info.width} × {info.height} px, {info.frames} frames")
    if "fps" not in given:
        _ask_rate(session, talk)
    if "lens" not in given:
        talk.until_right(session, "2 lens file (empty: from the wall grid)", "", "lens", _lens)
    _ask_wall(session, talk, given)
    _ask_ball(session, talk, given)
    for key, question in (
        ("camera_distance", "5 camera to wall by tape, such as '4.00 m ± 5 mm' (empty: not taped)"),
        ("ball_plane", "  ball's plane to wall by tape (empty: not taped)"),
    ):
        if key not in given:
            field = "ball_plane_offset" if key == "ball_plane" else key
            talk.until_right(session, question, "", question.strip("5 "), _distance(field))
    found = session.outlook
    if found.calibration is None:
        talk.say(f"6 check: {found.problem}")
        return
    talk.say(f"6 check: χ² per degree of freedom {found.calibration.chi2_per_dof:.2f}")
    for line in found.budget[:5]:
        talk.say(f"  {line.source}: {1e3 * line.std:.3g} mm")
    for warning in found.warnings:
        talk.say(f"  {warning}")


def _ask_rate(session: Session, talk: Dialogue) -> None:
    known = session.answers.rate_known
    default = f"{session.answers.capture_fps:g}" if known else ""
    question = "  capture rate, frames per second" + ("" if known else " (empty: not known)")
    talk.until_right(session, question, default, "capture rate", _rate)


def _ask_wall(session: Session, talk: Dialogue, given: frozenset[str]) -> None:
    if "wall" not in given:
        pitch = f"{1e3 * session.answers.pitch:g} mm"
        talk.until_right(session, "3 side of a square of the wall grid", pitch, "squares", _pitch)
        fine = session.answers.fine_pitch
        shown = "none" if fine is None else f"{1e3 * fine:g} mm"
        talk.until_right(session, "  fine lines apart, or none", shown, "fine lines", _fine)
    talk.say("3 looking for the wall grid …")
    session.find_grid()
    grid = session.answers.grid
    if grid is None:
        talk.say(f"  {session.grid_problem}")
    else:
        talk.say(f"  {len(grid.nodes)} crossings; {told_of(session)}")


def _ask_ball(session: Session, talk: Dialogue, given: frozenset[str]) -> None:
    if "ball" not in given:
        names = ", ".join(kind.name for kind in session.presets)
        question = f"4 ball: {names}, or diameter and mass ('220 mm, 0.4 kg'; empty: not known)"
        talk.until_right(session, question, "", "ball", lambda a, text: _ball(session, a, text))
    if "support" not in given:
        height = session.answers.support_height
        shown = "" if height is None else f"{height:g} m"
        talk.until_right(session, "  height of the support", shown, "support height", _support)
    if session.answers.rest_px is not None:
        return
    talk.say("  following the ball …")
    try:
        session.follow_ball()
        talk.say(f"  {told_of(session)}")
    except NotFoundError as problem:
        talk.say(f"  {problem.in_one_line}")
        question = "  the ball at rest in the picture, X,Y in px (empty: not known)"
        talk.until_right(session, question, "", "ball at rest", _rest)


def _rate(answers: Answers, text: str) -> Answers:
    return replace(answers, fps=rate_from(text))


def _lens(answers: Answers, text: str) -> Answers:
    return replace(answers, lens=lens_from_file(Path(text), answers.scene.size))


def _pitch(answers: Answers, text: str) -> Answers:
    return replace(answers, pitch=pitch_from(text))


def _fine(answers: Answers, text: str) -> Answers:
    return replace(answers, fine_pitch=fine_pitch_from(text, answers.pitch))


def _ball(session: Session, answers: Answers, text: str) -> Answers:
    kind = ball_from(text, session.presets)
    return with_ball(answers, kind, named=kind in session.presets)


def _support(answers: Answers, text: str) -> Answers:
    known = distance_from(text)
    return replace(answers, support_height=None if known is None else known.value)


def _rest(answers: Answers, text: str) -> Answers:
    return replace(answers, rest_px=point_from(text, answers.scene.size))


def _distance(field: str) -> Changed:
    def changed(answers: Answers, text: str) -> Answers:
        known = distance_from(text)
        if field == "camera_distance":
            return replace(answers, camera_distance=known)
        return replace(answers, ball_plane_offset=known)

    return changed
