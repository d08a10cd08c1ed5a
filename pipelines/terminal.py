"""Terminal output, JSON, commands as text, repeated warnings, command groups."""

import json
import os
import re
import shlex
import sys
import webbrowser
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import typer
from rich.console import Console
from rich.text import Text
from typer.core import TyperGroup

__all__ = [
    "DefaultCommandGroup",
    "announce_page",
    "as_typed",
    "counted",
    "has_display",
    "screen",
    "write_json",
]

MIN_WIDTH_COLUMNS = 40
"""Minimum terminal width for a table, columns (chosen; some shells report COLUMNS=0)."""

_SHOWN_CONTROLS = {code: f"\\x{code:02x}" for code in (*range(32), 127, *range(128, 160))}

for _kept in "\n\t":
    del _SHOWN_CONTROLS[ord(_kept)]


class _Screen(Console):
    """A console that shows control characters of names and files as escapes."""

    def render_str(self, text: str, **how: Any) -> Text:
        shown = text.translate(_SHOWN_CONTROLS).encode("utf-8", "backslashreplace").decode()
        return super().render_str(shown, **how)


def screen(*, errors: bool = False) -> Console:
    r"""Console that prints names and messages literally.

    Parameters
    ----------
    errors : bool
        On stderr instead of stdout.

    Returns
    -------
    Console
        Table cells are literal, too: ``[support]`` stays as it is, and an escape character is
        shown as ``\x1b``.
    """
    console = _Screen(stderr=errors, markup=False, emoji=False, highlight=False)
    console.width = max(console.width, MIN_WIDTH_COLUMNS)
    return console


def write_json(document: object, to: str | None) -> bool:
    """Write results to a file, or to stdout for ``-``; whether nothing else may go there."""
    if to is None:
        return False
    from metrology import write_text_whole

    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if to == "-":
        sys.stdout.write(text)
        return True
    write_text_whole(Path(to), text)
    return False


def as_typed(words: Sequence[object]) -> str:
    """Words of a command as they are typed in this system's shell."""
    texts = [str(word) for word in words]
    if sys.platform == "win32":
        return " ".join(f'"{text}"' if " " in text else text for text in texts)
    return shlex.join(texts)


def has_display() -> bool:
    """Whether a browser window can be opened."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def announce_page(address: str, *, browser: bool, otherwise: str = "") -> None:
    """Open the browser, or print how to.

    Parameters
    ----------
    browser : bool
        Whether one is wanted.
    otherwise : str
        What to do without a browser.
    """
    shown = browser and has_display() and webbrowser.open(address)
    typer.echo(f"The page is open at\n  {address}")
    if shown:
        typer.echo("Close its window when done, or press Ctrl-C.")
    else:
        port = address.split("/")[2].rpartition(":")[2]
        typer.echo(
            "Open this address in a browser on this machine (it works once). From another machine,"
            f" run first: ssh -L {port}:127.0.0.1:{port} THIS_MACHINE. {otherwise}Ctrl-C ends it."
        )
    sys.stdout.flush()


_SHOWN_NUMBER = re.compile(r"\d+(?:\.\d+)?")


def counted(warnings: Sequence[Iterable[str]]) -> list[str]:
    """Warnings of several clips, each once with the number of clips, the most frequent first.

    Warnings that differ only in their numbers count as one; the first is shown.

    Parameters
    ----------
    warnings : sequence of iterable of str
        Of each clip.
    """
    clips: Counter[str] = Counter()
    example: dict[str, str] = {}
    for one in warnings:
        shapes = {_SHOWN_NUMBER.sub("#", text): text for text in one}
        clips.update(shapes.keys())
        example = shapes | example
    of = len(warnings)
    return [f"warning, {number} of {of} clips: {example[s]}" for s, number in clips.most_common()]


_HELP = frozenset({"--help", "-h"})


class DefaultCommandGroup(TyperGroup):
    """A group with a default command, whose first argument may follow the group's name directly.

    Attributes
    ----------
    meant : str
        The default command.
    spelled : mapping of str to str
        First words that select a command of another name.
    asks_for_help : bool
        Whether ``--help``, or no argument, refers to the group instead of the default command.
    """

    meant: ClassVar[str] = ""
    spelled: ClassVar[Mapping[str, str]] = {}
    asks_for_help: ClassVar[bool] = True

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Insert the name of the default command where it is missing."""
        first = args[0] if args else None
        about_group = self.asks_for_help and (first is None or first in _HELP)
        if first is not None and first in self.spelled:
            args = [self.spelled[first], *args[1:]]
        elif first not in self.commands and not about_group:
            args = [self.meant, *args]
        return super().parse_args(ctx, args)
