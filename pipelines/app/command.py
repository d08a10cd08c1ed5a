"""Command `vision app`: open the page in the browser."""

import os
import signal
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
    from pipelines.app.session import AppSession
    from pipelines.calibrate.session import Session

__all__ = ["app_command", "set_up_clip", "watch_campaign"]


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
    with _leaving(session):
        session.measurer.start()
        if place is not None:
            session.open_place(place.absolute())
        serve_page(session, partial(announce_page, browser=browser), port=port)
        folder = session.folder_session
        if folder is not None and folder.running:
            typer.echo("The page is closed; the campaign goes on. Ctrl-C stops it, and the same")
            typer.echo("folder opened again resumes it.")
            folder.finish()


def set_up_clip(calibration: "Session", *, browser: bool, port: int) -> None:
    """Serve the page at Set up until it is closed.

    Parameters
    ----------
    calibration : Session
        The calibration it shows.
    browser : bool
        Whether to open the browser.
    port : int
        0 for any free one.
    """
    from pipelines.app.session import AppSession
    from pipelines.app.shell import serve_page
    from pipelines.app.words import users_language

    session = AppSession(users_language())

    def opened(address: str) -> None:
        session.set_up(calibration)
        otherwise = "Without a browser pass all options and --yes. "
        announce_page(address, browser=browser, otherwise=otherwise)

    with _leaving(session):
        serve_page(session, opened, port=port)
        written = calibration.written
        said = "nothing was saved" if written is None else f"wrote {written}"
        typer.echo(f"the page was closed; {said}", err=written is None)


@contextmanager
def _leaving(session: "AppSession") -> Iterator[None]:
    """Close the session at the end and leave at once, with the exit code of a signal if one came.

    The interpreter's own exit ends threads amid native code, which aborts the program.
    """
    code = 0
    try:
        yield
    except KeyboardInterrupt as stop:
        code = 128 + (signal.SIGTERM if isinstance(stop, Terminated) else signal.SIGINT)
    except BaseException:
        session.end()
        raise
    try:
        session.end()
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


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
