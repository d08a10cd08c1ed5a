"""Messages with arguments of Python, or fields of the page, in place of options."""

import re
from collections.abc import Callable, Mapping
from functools import wraps
from typing import ParamSpec, TypeVar

from metrology import ImpactVisionError

__all__ = ["in_fields", "in_python", "worded_for_python"]

_ARGUMENTS = (
    "fps", "ball", "wall-grid", "fine-grid", "ball-at", "mass-at", "pivot-at", "landing-at", "axes",
    "scale", "setup", "lens", "support-height", "camera-distance", "ball-plane", "backswing",
    "impact-speed", "cor", "drag", "trials", "every", "hold-out", "out", "jobs", "pendulum",
    "tracklets", "detections", "kind",
)  # fmt: skip
"""Options that are arguments of the same name."""

_WORDS = (
    "jokku", "basketball", "strike", "flight", "drop", "bounce", "swing", "collision", "roll",
    "slide", "circle", "carried",
)  # fmt: skip
"""Values of options that are words."""

_VALUE = r"""'[^']*'|"[^"]*"|[A-Z][A-Z,|]*\b|\d[\w.,]*(?:\s?±\s?\d[\w.]*)?"""
_VALUE += "".join(rf"|{word}\b" for word in _WORDS)

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


_PASSED = re.compile(rf"(?:\b([Pp])ass )?--([a-z-]+\b)(?:[ =]({_VALUE}))?")


def in_fields(text: str, labels: Mapping[str, str]) -> str:
    """A message of the commands with the fields and buttons of a page.

    Parameters
    ----------
    text : str
        ``"Pass --wall-grid 50mm."``
    labels : mapping of str to str
        Of fields and buttons, by option. Others stay options.

    Returns
    -------
    str
        ``"Use “Wall grid” 50mm."``
    """

    def placed(found: re.Match[str]) -> str:
        passed, option, value = found.groups()
        if option not in labels:
            return found[0]
        verb = "" if passed is None else "Use " if passed == "P" else "use "
        # capitals stand for a value to be chosen
        bare = re.sub(r"^[A-Z][A-Z,|]*(?=[.,]?$)", "", value or "").strip("'\"")
        return f"{verb}“{labels[option]}”" + (f" {bare}" if bare.strip(".,") else bare)

    # one field after another
    return re.sub(r"(” \d[\w.]*) (?=“)", r"\1, ", _PASSED.sub(placed, text))


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
