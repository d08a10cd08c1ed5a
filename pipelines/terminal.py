"""What people read on a terminal: words as they are, never taken for markup."""

from rich.console import Console

__all__ = ["screen"]


def screen(*, errors: bool = False) -> Console:
    """A console on which brackets and colons of names and messages stay what they are.

    Parameters
    ----------
    errors : bool
        On stderr instead of stdout.

    Returns
    -------
    Console
        Tables printed on it take their cells literally, too: ``[support]`` is a word.
    """
    return Console(stderr=errors, markup=False, emoji=False, highlight=False)
