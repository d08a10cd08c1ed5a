"""Command `vision app`: open the page in the browser."""

import os
import sys
import webbrowser
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated

import typer

from metrology import UsageError
from pipelines.processes import Terminated
from pipelines.terminal import announce_page, has_display

if TYPE_CHECKING:
    from pipelines.app.campaign import FolderSession

__all__ = ["app_command", "watch_campaign"]


def app_command(
    place: Annotated[
        Path | None,
        typer.Argument(metavar="CLIP|FOLDER", help="A clip or a folder of clips; or choose there."),
    ] = None,
    language: Annotated[
        str | None, typer.Option("--language", help="en or de; default: of the system.")
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the browser.")] = True,
    port: Annotated[int, typer.Option(help="Port of the page; 0: any free one.", min=0)] = 0,
) -> None:
    """Open the page: measure a clip, see everything, correct by dragging.

    It is served to this computer only. Example: vision app strike.mp4
    """
    if place is not None and not place.exists():
        raise UsageError(f"there is no file {place}", hint="Check the name and the folder.")
    # import here: NiceGUI takes a second, which other commands must not pay
    from pipelines.app.session import AppSession
    from pipelines.app.shell import serve_page
    from pipelines.app.words import LANGUAGES, users_language

    if language is not None and language not in LANGUAGES:
        raise UsageError(f"no language {language!r}", hint=f"Pass {' or '.join(LANGUAGES)}.")
    session = AppSession(language or users_language())
    session.measurer.start()
    if place is not None:
        session.open_place(place.absolute())
    try:
        serve_page(session, partial(announce_page, what="page", browser=browser), port=port)
    except KeyboardInterrupt as stop:
        session.end()
        _leave(143 if isinstance(stop, Terminated) else 130)
        raise
    folder = session.folder_session
    if folder is not None and folder.running:
        typer.echo("The page is closed; the campaign goes on. Ctrl-C stops it, and the same folder")
        typer.echo("opened again resumes it.")
        try:
            folder.finish()
        except KeyboardInterrupt:
            _leave(130)
    session.end()


def watch_campaign(out: Path, on_address: Callable[[str], None]) -> "FolderSession":
    """Serve the page Folder during a campaign, on a thread, until it is closed.

    Parameters
    ----------
    out : Path
        Folder of results.
    on_address : callable
        Called with the page's address.
    """
    from pipelines.app.campaign import FolderSession
    from pipelines.app.session import AppSession
    from pipelines.app.shell import serve_page
    from pipelines.app.words import users_language

    session, folder = AppSession(users_language()), FolderSession(out)
    session.folder_session, session.page = folder, "folder"

    def opened(address: str) -> None:
        on_address(address)
        if has_display():
            webbrowser.open(address)

    def serving() -> None:
        try:
            serve_page(session, opened)
        finally:
            folder.closed.set()
            session.end()

    Thread(target=serving, daemon=True).start()
    return folder


def _leave(code: int) -> None:
    """Exit without waiting for threads that decode."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
