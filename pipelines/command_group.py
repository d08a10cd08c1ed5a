"""Groups of commands in which one is meant where none is named: `vision campaign CLIPS`."""

from collections.abc import Mapping
from typing import ClassVar

import typer
from typer.core import TyperGroup

__all__ = ["DefaultCommandGroup"]

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
