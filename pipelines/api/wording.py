"""Messages in the words of Python: arguments in place of options of the commands."""

import re
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from metrology import ImpactVisionError

__all__ = ["in_python", "worded_for_python"]

_ARGUMENTS = (
    "fps", "ball", "wall-grid", "fine-grid", "ball-at", "mass-at", "scale", "setup", "lens",
    "support-height", "camera-distance", "ball-plane", "backswing", "impact-speed", "cor", "drag",
    "trials", "every", "hold-out", "out", "jobs", "pendulum", "tracklets", "detections",
)  # fmt: skip
"""Options that are arguments of the same name."""

_VALUE = r"""'[^']*'|"[^"]*"|[A-Z][A-Z,|]*\b|\d[\w.,]*(?:\s?±\s?\d[\w.]*)?|jokku\b|basketball\b"""

_OPTION = rf"--(?:{'|'.join(_ARGUMENTS)})(?![\w-])(?:[ =](?:{_VALUE}))?"

_OPTIONS = re.compile(rf"{_OPTION}(?: {_OPTION})*")

_ONE = re.compile(rf"--({'|'.join(_ARGUMENTS)})(?![\w-])(?:[ =]({_VALUE}))?")


def in_python(text: str) -> str:
    """A message of the commands with the arguments of the functions.

    Parameters
    ----------
    text : str
        ``"Pass --wall-grid 50mm."``

    Returns
    -------
    str
        ``'Pass wall_grid="50mm".'``
    """
    return _OPTIONS.sub(lambda found: ", ".join(map(_argument, _ONE.finditer(found[0]))), text)


def _argument(found: re.Match[str]) -> str:
    name, value = found[1].replace("-", "_"), found[2]
    if value is None:
        return name
    bare = value.rstrip(".,")
    after = value[len(bare) :]
    if bare[0] in "'\"":
        shown = '"' + bare[1:-1] + '"'
    elif re.fullmatch(r"[A-Z][A-Z|]*|\d+(\.\d+)?", bare):
        shown = bare
    elif re.fullmatch(r"[A-Z\d.]+(,[A-Z\d.]+)+", bare):
        shown = f"({bare.replace(',', ', ')})"
    else:
        shown = f'"{bare}"'
    return f"{name}={shown}{after}"


Values = ParamSpec("Values")
Result = TypeVar("Result")


def worded_for_python(function: Callable[Values, Result]) -> Callable[Values, Result]:
    """A function whose errors name its arguments, not the options of a command."""

    @wraps(function)
    def called(*values: Values.args, **named: Values.kwargs) -> Result:
        try:
            return function(*values, **named)
        except ImpactVisionError as problem:
            problem.message = in_python(problem.message)
            problem.hint = None if problem.hint is None else in_python(problem.hint)
            problem.args = (problem.message,)
            raise

    return called
