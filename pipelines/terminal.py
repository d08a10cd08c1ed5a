"""What people read on a terminal: words as they are, never taken for markup or for commands."""

from typing import Any

from rich.console import Console
from rich.text import Text

__all__ = ["screen"]

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
