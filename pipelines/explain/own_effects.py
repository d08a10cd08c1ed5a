"""User-defined effects: load and check them in a separate process.

``vision effects check FILE`` reports what an effect lacks; `vision explain --effects FILE` runs the
same check first. Code that loops, exits or crashes does so in that process, which has a time limit;
the message states the cause.
"""

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, get_args

import numpy as np
import typer
from typer.core import TyperGroup

from metrology import UsageError
from mismatch.candidates import refuse_unusable
from physics.effects import Effect
from physics.effects.base import CameraView, Contact, FlightState, Outcome, Phase, SwingState

__all__ = ["EFFECT_COMMANDS", "EffectCommands", "check_effect", "effect_limits", "load_effects"]

LOAD_TIMEOUT_S = 30.0
"""s: limit for loading and checking a file of effects; loading the catalogue takes one."""

MAX_CHECK_BYTES = 3 << 29
"""1.5 GiB: limit for checking; catalogue and one effect take a fifth of it."""

RUN_TIMEOUT_S = 900
"""s: limit for a campaign with user-defined effects; without them it takes a thirtieth."""


class EffectCommands(TyperGroup):
    """Commands for user-defined effects."""


def load_effects(path: Path, seconds: float = LOAD_TIMEOUT_S) -> tuple[Effect, ...]:
    """Load effects from a Python file: the instances in its list ``EFFECTS``, or all instances.

    Raises
    ------
    UsageError
        If the file can't be read or run, contains no effect, or one that can't be fitted.
    """
    if not path.is_file():
        raise UsageError(f"there is no file {path}", hint="Check the path passed as --effects.")
    _try_apart(path, seconds)
    return _loaded(path)


@contextlib.contextmanager
def effect_limits(effects: Sequence[Effect]) -> Iterator[None]:
    """Stop user-defined effects that exit, print without limit or run too long.

    Raises
    ------
    UsageError
        If one of them does.
    """
    if not effects:
        yield
        return
    names = ", ".join(effect.id for effect in effects)

    def late(_number: int, _frame: FrameType | None) -> None:
        raise UsageError(
            f"no result after {RUN_TIMEOUT_S} s with the effects {names}",
            hint="Their hooks must return for every strength; check for endless loops.",
        )

    timed = hasattr(signal, "SIGALRM") and threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGALRM, late) if timed else None
    if timed:
        signal.alarm(RUN_TIMEOUT_S)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    except SystemExit as problem:
        raise UsageError(
            f"one of the effects {names} ends the program",
            hint="Its hooks must return values and never call sys.exit.",
        ) from problem
    finally:
        if timed:
            signal.alarm(0)
            signal.signal(signal.SIGALRM, before)


def check_effect(effect: Effect) -> None:
    """Check that an effect meets the catalogue's requirements.

    Raises
    ------
    UsageError
        States what it lacks.
    """
    refuse_unusable(effect)
    if effect.phase not in get_args(Phase):
        _refuse(
            effect,
            f"acts in an unknown phase {effect.phase!r}",
            f"Its phase must be one of {', '.join(get_args(Phase))}.",
        )
    for hook in sorted(effect.hooks):
        before = _untouched(hook)
        for fraction in (0.0, 0.1):
            found = _called(effect, hook, fraction)
            if not all(np.all(np.isfinite(part)) for part in found):
                _refuse(
                    effect,
                    f"returns values that are not finite numbers in its hook {hook}",
                    "Return finite numbers for every state.",
                )
            same = all(np.allclose(a, b, atol=1e-9) for a, b in zip(found, before, strict=True))
            if fraction == 0.0 and not same:
                _refuse(
                    effect,
                    f"acts at its neutral values in its hook {hook}",
                    "At the neutral values of its parameters it must change nothing.",
                )


def _refuse(effect: Effect, why: str, help_: str) -> None:
    raise UsageError(f"the effect {effect.id!r} {why}", hint=help_)


def _values(effect: Effect, fraction: float) -> dict[str, Any]:
    """Neutral values plus a fraction of each strength's scale, within its bounds."""
    moved: dict[str, Any] = dict(effect.neutral)
    for p in effect.strengths:
        up = p.neutral + fraction * p.scale
        moved[p.name] = up if up <= p.upper else max(p.neutral - fraction * p.scale, p.lower)
    return moved


def _states() -> dict[str, Any]:
    """A state of every kind, as arrays of trials by samples like the engine's."""
    trials, steps = np.linspace(-0.5, 0.5, 3)[:, None], np.linspace(0.0, 1.0, 4)
    plain = np.ones((3, 1))
    flight = FlightState(
        0.4 * steps + 0.01, 0.3 + 0.8 * steps, 0.9 - 0.3 * steps, 0.0 * steps, 2.0 * plain,
        1.0 - steps, 0.0 * steps, 0.35 * plain, 0.2 * plain, 1.18, 1.85e-5, 9.81, 0.47, 1.0,
        3.0 * plain, trials,
    )  # fmt: skip
    swing = SwingState(steps - 0.6, 2.0 - steps, 1.6, 6.0, 0.46, 0.55, 9.81, trials)
    contact = Contact(6.0 * plain, 0.15, 0.55, 1.6, 0.35 * plain, 0.2 * plain, 0.7, 9.81, trials)
    outcome = Outcome(
        *(value * plain for value in (0.016, 2.0, 0.16, 0.01, 0.41, 0.0, 2.0, 0.2, 0.0))
    )
    view = CameraView(
        0.4 * steps, 0.3 + 0.8 * steps, 0.9 - 0.3 * steps, 0.0 * steps, 2.0 * plain, 1.0 - steps,
        0.0 * steps, steps - 0.6, 2.0 - steps, 0.0, 0.4, 0.6, 0.5, 0.6, 0.55,
    )  # fmt: skip
    return {"flight": flight, "swing": swing, "contact": contact, "outcome": outcome, "view": view}


def _untouched(hook: str) -> tuple[Any, ...]:
    """Return value of a hook that adds nothing."""
    made = _states()
    view = made["view"]
    if hook == "contact":
        return tuple(getattr(made["outcome"], f.name) for f in fields(Outcome))
    plain: dict[str, tuple[Any, ...]] = {
        "force": (0.0, 0.0, 0.0),
        "torque": (0.0,),
        "start": (1.0,),
        "clock": (view.time,),
        "image": (view.x, view.y, view.z),
        "angle": (view.phi,),
    }
    return plain[hook]


def _called(effect: Effect, hook: str, fraction: float) -> tuple[Any, ...]:
    """Return value of a hook, by component."""
    made, values = _states(), _values(effect, fraction)
    given: dict[str, tuple[Any, ...]] = {
        "force": (made["flight"],),
        "torque": (made["swing"],),
        "start": (1.0,),
        "contact": (made["contact"], made["outcome"]),
        "clock": (made["view"].time,),
        "image": (made["view"],),
        "angle": (made["view"],),
    }
    try:
        found = getattr(effect, hook)(values, *given[hook])
    except Exception as problem:  # a user's file may raise anything
        _refuse(
            effect,
            f"fails in its hook {hook}: {type(problem).__name__}: {problem}",
            "Its hooks receive arrays that broadcast over trials and parameter sets.",
        )
    if hook == "contact":
        if not isinstance(found, Outcome):
            _refuse(
                effect,
                f"returns a {type(found).__name__} for the outcome of the contact",
                "Return an Outcome from contact: dataclasses.replace(outcome, …).",
            )
        return tuple(getattr(found, f.name) for f in fields(Outcome))
    if hook in ("force", "image"):
        if not isinstance(found, tuple | list) or len(found) != 3:
            _refuse(
                effect,
                f"does not return three components in its hook {hook}",
                "Return a tuple: components along x, y and z.",
            )
        return tuple(found)
    if found is None:
        _refuse(effect, f"returns nothing in its hook {hook}", "Return its value.")
    return (found,)


@contextlib.contextmanager
def _leaving_no_bytecode() -> Iterator[None]:
    """Import without writing bytecode into the user's folder."""
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before


def _loaded(path: Path) -> tuple[Effect, ...]:
    spec = importlib.util.spec_from_file_location("effects_of_the_user", path)
    if spec is None or spec.loader is None:
        raise UsageError(f"{path} is not a Python file", hint="Pass a file that ends in .py.")
    module = importlib.util.module_from_spec(spec)
    try:
        with contextlib.redirect_stdout(sys.stderr), _leaving_no_bytecode():
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as problem:  # a user's file may raise anything
        raise UsageError(
            f"{path} stops with {type(problem).__name__}: {problem}",
            hint="Run it with python to find the line.",
        ) from problem
    listed = getattr(module, "EFFECTS", None)
    if listed is None:
        found = list(vars(module).values())
    elif isinstance(listed, list | tuple):
        found = list(listed)
        _refuse_strangers(path, found)
    else:
        raise UsageError(
            f"EFFECTS in {path} is not a list but {listed!r}",
            hint="Write EFFECTS = [MyEffect(...)], a list of instances.",
        )
    effects = tuple(item for item in found if isinstance(item, Effect))
    if not effects:
        raise UsageError(
            f"{path} contains no effect",
            hint="Subclass physics.effects.Effect and list an instance in EFFECTS.",
        )
    return effects


def _refuse_strangers(path: Path, listed: Sequence[object]) -> None:
    for item in listed:
        if isinstance(item, type) and issubclass(item, Effect):
            raise UsageError(
                f"EFFECTS in {path} contains the class {item.__name__}",
                hint=f"List an instance of it: {item.__name__}(...).",
            )
        if not isinstance(item, Effect):
            raise UsageError(
                f"EFFECTS in {path} contains {item!r}, which is not an effect",
                hint="Subclass physics.effects.Effect and list instances.",
            )


def _try_apart(path: Path, seconds: float) -> None:
    """Load and check the file in a separate process.

    Raises
    ------
    UsageError
        With its message, or how the process ended.
    """
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        command = [sys.executable, "-m", "pipelines.explain.own_effects", str(path), str(answer)]
        try:
            ended = subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, timeout=seconds, check=False
            )
        except subprocess.TimeoutExpired as problem:
            raise UsageError(
                f"{path} did not return within {seconds:.0f} s",
                hint="Check for endless loops in the file or in a hook.",
            ) from problem
        if not answer.exists():
            raise UsageError(
                f"{path} ends the program (exit code {ended.returncode}) before its effects are"
                " read",
                hint="A file of effects must only define them, not end or replace the program.",
            )
        told = json.loads(answer.read_text(encoding="utf-8"))
    if told:
        raise UsageError(told["message"], hint=told["hint"])


def _answer(path: Path, answer: Path) -> None:
    """Run in the separate process: load, check, and write down errors."""
    told: dict[str, str | None] = {}
    before = threading.active_count()
    try:
        effects = _loaded(path)
        if threading.active_count() > before:
            raise UsageError(
                f"{path} starts threads, which would run during the fit",
                hint="A file of effects must only define them.",
            )
        for effect in effects:
            try:
                check_effect(effect)
            except SystemExit:
                _refuse(effect, "ends the program", "Its hooks must never call sys.exit.")
    except UsageError as problem:
        told = {"message": problem.message, "hint": problem.hint}
    answer.write_text(json.dumps(told), encoding="utf-8")


def _limit_memory() -> None:
    """Limit memory, so that excessive use raises MemoryError instead of exhausting the machine."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (MAX_CHECK_BYTES, MAX_CHECK_BYTES))


def check_command(
    file: Annotated[Path, typer.Argument(help="A Python file with effects.", metavar="FILE")],
) -> None:
    """Check a file of your own effects before using it in `vision explain --effects`.

    Example: vision effects check my_effects.py
    """
    for effect in load_effects(file):
        hooks = ", ".join(sorted(effect.hooks))
        strengths = ", ".join(f"{p.name} ({p.unit})" for p in effect.strengths)
        sys.stdout.write(f"{effect.id}: acts through {hooks}; to be fitted: {strengths}\n")


EFFECT_COMMANDS = {"check": check_command}


if __name__ == "__main__":
    _limit_memory()
    _answer(Path(sys.argv[1]), Path(sys.argv[2]))
    # os._exit: threads started by the file would keep the process alive
    os._exit(0)
