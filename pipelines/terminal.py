"""What people read on a terminal: words as they are, never taken for markup or for commands.

Groups of commands in which one is meant where none is named: `vision campaign CLIPS`.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import typer
from rich.console import Console
from rich.text import Text
from typer.core import TyperGroup

__all__ = ["DefaultCommandGroup", "screen"]

NARROWEST = 40

"""Columns of a terminal below which a table has no room (some shells say COLUMNS=0)."""

_SHOWN = {code: f"\\x{code:02x}" for code in (*range(32), 127, *range(128, 160))}

for _kept in "\n\t":
    del _SHOWN[ord(_kept)]


class _Screen(Console):
    """A console on which control characters of names and files are shown, not obeyed."""

    def render_str(self, text: str, **how: Any) -> Text:
        return super().render_str(text.translate(_SHOWN), **how)


def screen(*, errors: bool = False) -> Console:
    r"""A console on which brackets and colons of names and messages stay what they are.

    Parameters
    ----------
    errors : bool
        On stderr instead of stdout.

    Returns
    -------
    Console
        Tables printed on it take their cells literally, too: ``[support]`` is a word, and an
        escape sequence is shown as ``\x1b``.
    """
    console = _Screen(stderr=errors, markup=False, emoji=False, highlight=False)
    console.width = max(console.width, NARROWEST)
    return console


_HELP = frozenset({"--help", "-h"})


class DefaultCommandGroup(TyperGroup):
    """A group whose first word may also be an argument of one of its commands.

    Attributes
    ----------
    meant : str
        The command that is meant then.
    spelled : mapping of str to str
        First words that stand for a command of another name.
    asks_for_help : bool
        Whether ``--help``, or no word at all, is about the group instead of the command.
    """

    meant: ClassVar[str] = ""
    spelled: ClassVar[Mapping[str, str]] = {}
    asks_for_help: ClassVar[bool] = True

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Put the command's name in where it is left out."""
        first = args[0] if args else None
        about_group = self.asks_for_help and (first is None or first in _HELP)
        if first is not None and first in self.spelled:
            args = [self.spelled[first], *args[1:]]
        elif first not in self.commands and not about_group:
            args = [self.meant, *args]
        return super().parse_args(ctx, args)
