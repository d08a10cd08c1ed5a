"""`vision cache`: what is kept of clips measured before."""

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperGroup

from pipelines.cache import FOLDER_VARIABLE, Cache

__all__ = ["CACHE_COMMANDS", "CacheGroup", "clear_command", "show_command"]


class CacheGroup(TyperGroup):
    """The commands under `vision cache`."""


def show_command() -> None:
    """Say where results are kept, and how much of the disk they take.

    Example: vision cache show
    """
    kept = Cache.of_user()
    if kept.folder is None:
        typer.echo(f"nothing is kept ({FOLDER_VARIABLE}=off)")
        return
    typer.echo(f"{kept.folder}: {kept.size() / 1e6:.1f} MB of {kept.limit_bytes / 1e6:.0f} MB")


def clear_command() -> None:
    """Remove what is kept; every clip is then measured afresh.

    Example: vision cache clear
    """
    typer.echo(f"{Cache.of_user().clear() / 1e6:.1f} MB removed")


CACHE_COMMANDS: dict[str, Callable[..., Any]] = {"show": show_command, "clear": clear_command}
"""Commands under `vision cache`, by name."""
