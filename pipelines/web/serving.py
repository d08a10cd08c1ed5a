"""Serving the page on 127.0.0.1 until its window is closed."""

import asyncio
import signal
import socket
from collections.abc import Callable
from types import FrameType

import uvicorn
from fastapi import FastAPI, Request, Response
from nicegui import ui

from metrology import UsageError
from pipelines.calibrate.wizard.drawing import encoded
from pipelines.calibrate.wizard.page import FIRST_URL, PICTURE_URL, WizardPage
from pipelines.calibrate.wizard.session import Session
from pipelines.web.guard import Guard, Jobs

__all__ = ["GRACE_S", "serve", "serve_app"]

GRACE_S = 8.0
"""s that nobody may look before the program ends: a reload on a slow machine takes less."""
LOOK_EVERY_S = 0.5


def serve(
    session: Session,
    jobs: Jobs,
    opened: Callable[[str], None],
    *,
    port: int = 0,
    grace_s: float = GRACE_S,
) -> None:
    """Serve the page until its window is closed or the program is interrupted.

    Parameters
    ----------
    session : Session
    jobs : Jobs
    opened : callable
        Called with the address once it answers.
    port : int
        0 for one that is free.
    grace_s : float
        How long the page may be closed before the program ends, s.

    Raises
    ------
    UsageError
        If the port is taken.
    KeyboardInterrupt
        If the user interrupts.
    """
    app = FastAPI(openapi_url=None)
    stop: list[Callable[[], None]] = []
    scene = session.answers.scene
    pictures = {PICTURE_URL: encoded(scene.picture), FIRST_URL: encoded(scene.first)}

    def picture(request: Request) -> Response:
        return Response(pictures[request.url.path], media_type="image/png")

    def root() -> None:
        WizardPage(session, jobs, lambda: stop[0]()).build()

    for url in pictures:
        app.add_api_route(url, picture)
    ui.run_with(app, root=root, title="Calibration", show_welcome_message=False)
    serve_app(app, opened, port=port, grace_s=grace_s, stopper=stop.append)


def serve_app(
    app: FastAPI,
    opened: Callable[[str], None],
    *,
    port: int = 0,
    grace_s: float = GRACE_S,
    stopper: Callable[[Callable[[], None]], None] = lambda stop: None,
    what: str = "calibration",
    command: str = "vision calibrate",
) -> None:
    """Serve a page behind the guard until its window is closed or the program is interrupted.

    Parameters
    ----------
    app : FastAPI
    opened : callable
        Called with the address once it answers.
    port : int
        0 for one that is free.
    grace_s : float
        How long the page may be closed before this returns, s.
    stopper : callable
        Is given what ends the page.
    what, command : str
        What the page is, and what starts it, for who is refused.

    Raises
    ------
    UsageError
        If the port is taken.
    KeyboardInterrupt
        If the user interrupts.
    """
    door = _listening(port)
    guard = Guard(app, door.getsockname()[1], what=what, command=command)
    config = uvicorn.Config(
        guard,
        lifespan="on",
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=1,
    )
    server = _Server(config)
    stopper(lambda: _stop(server))
    asyncio.run(_until_left(server, guard, door, opened, grace_s))
    if server.interrupted:
        raise KeyboardInterrupt


class _Server(uvicorn.Server):
    """Remembers an interrupt: raised again, it is lost where the shell has it ignored."""

    interrupted = False

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.interrupted = self.interrupted or sig == signal.SIGINT
        super().handle_exit(sig, frame)


def _listening(port: int) -> socket.socket:
    door = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        door.bind(("127.0.0.1", port))
    except OSError as problem:
        door.close()
        raise UsageError(
            f"port {port} can't be had: {problem.strerror}", hint="Leave --port out."
        ) from problem
    door.listen()
    return door


def _stop(server: uvicorn.Server) -> None:
    server.should_exit = True


async def _until_left(
    server: uvicorn.Server,
    guard: Guard,
    door: socket.socket,
    opened: Callable[[str], None],
    grace_s: float,
) -> None:
    serving = asyncio.create_task(server.serve(sockets=[door]))
    while not server.started and not serving.done():
        await asyncio.sleep(0.02)
    if not serving.done():
        opened(guard.address)
    while not serving.done():
        await asyncio.wait({serving}, timeout=LOOK_EVERY_S)
        if guard.empty_for() > grace_s:
            _stop(server)
    await serving
