"""The commands under `vision cache`."""

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperGroup

from measuring.cache import FOLDER_VARIABLE, Cache, is_private

__all__ = ["CACHE_COMMANDS", "CacheGroup"]


class CacheGroup(TyperGroup):
    """The commands under `vision cache`."""


def show_command() -> None:
    """Show the cache folder and its size.

    Example: vision cache show
    """
    kept = Cache.of_user()
    if kept.folder is None:
        typer.echo(f"the cache is off ({FOLDER_VARIABLE}=off)")
        return
    typer.echo(f"{kept.folder}: {kept.size() / 1e6:.1f} MB of {kept.limit_bytes / 1e6:.0f} MB")
    if kept.folder.exists() and not is_private(kept.folder.stat):
        typer.echo(
            "It is not read: the folder is another user's, or others may write to it.\n"
            f"Make it yours (chmod go-w {kept.folder}), or set {FOLDER_VARIABLE} to another folder."
        )


def clear_command() -> None:
    """Empty the cache; every clip is then measured again.

    Example: vision cache clear
    """
    typer.echo(f"{Cache.of_user().clear() / 1e6:.1f} MB removed")


CACHE_COMMANDS: dict[str, Callable[..., Any]] = {"show": show_command, "clear": clear_command}
"""Commands under `vision cache`, by name."""
