"""Local web page: access control, background jobs and the server.

The page is bound to 127.0.0.1, but other programs, users and web pages in the same browser can send
requests there. Protection: a one-time token in the address is exchanged for a cookie; requests must
use the page's own host name (against DNS rebinding) and origin (against other sites); only one
window may be open. Jobs run one after another on a thread, so that the page stays responsive and
jobs never race.
"""

import asyncio
import hmac
import secrets
import signal
import socket
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from html import escape
from http.cookies import CookieError, SimpleCookie
from threading import Lock, Thread
from types import FrameType
from typing import Any
from urllib.parse import parse_qs

import uvicorn
from fastapi import FastAPI

from metrology import ImpactVisionError, UsageError
from pipelines.processes import Terminated

__all__ = ["LEAVING_PATH", "Guard", "Jobs", "serve_app"]

LEAVING_PATH = "/leaving"
"""Path to which a window reports that it is being closed or reloaded."""

Scope = MutableMapping[str, Any]

Message = MutableMapping[str, Any]

Receive = Callable[[], Awaitable[Message]]

Send = Callable[[Message], Awaitable[None]]

App = Callable[[Scope, Receive, Send], Awaitable[None]]

HOSTS = ("127.0.0.1", "localhost")

RELOAD_S = 2.5
"""s that a reloading window may still seem open (chosen; browsers need less)."""

LEAVING_S = 20.0
"""s within which a leaving window must be gone (chosen); later it counts as open again."""

RETRY_S = 2
"""s until a refused window asks again (chosen); by a script, since a `refresh` header does not load
an address anew that names a part of the page."""

POLICY = 1008
"""WebSocket close code of a policy violation (RFC 6455, 7.4.1)."""

HEADERS = (
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (
        b"content-security-policy",
        b"default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self'"
        b" 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'"
        b" ws://127.0.0.1:* ws://localhost:*; object-src 'none'; base-uri 'none';"
        b" frame-ancestors 'none'; form-action 'none'",
    ),
)
"""On every answer. The policy admits nothing from other computers; the components of the page
need scripts within it."""


class Guard:
    """ASGI middleware that admits one window of one browser.

    Parameters
    ----------
    app : ASGI application
    port : int
        Port of the page.
    token : str, optional
        Drawn at random if not given.
    reload_s : float
        How long a second window waits for the first to close before it is refused, s.
    """

    def __init__(
        self,
        app: App,
        port: int,
        *,
        token: str | None = None,
        reload_s: float = RELOAD_S,
    ) -> None:
        if not 0 < port < 65536:
            raise UsageError(f"{port} is no port", hint="Give 1 to 65535.")
        self._app = app
        self._hosts = tuple(f"{name}:{port}" for name in HOSTS)
        self._origins = tuple(f"http://{host}" for host in self._hosts)
        self._token: str | None = token or secrets.token_urlsafe(24)
        self._session = secrets.token_urlsafe(24)
        self._cookie = f"vision-app-{port}"
        self._reload_s = reload_s
        self._windows = 0
        self._seen = False
        self._left_at = time.monotonic()
        self._leaving_until = -float("inf")
        self.address = f"http://{self._hosts[0]}/?token={self._token}"

    @property
    def windows(self) -> int:
        """Number of open windows."""
        return self._windows

    def empty_for(self) -> float:
        """Seconds since the last window closed; 0 while one is open or none was opened yet."""
        return 0.0 if self._windows or not self._seen else time.monotonic() - self._left_at

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Admit the page's own requests and refuse all others."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await self._websocket(scope, receive, send)
        elif scope["type"] == "http":
            await self._http(scope, receive, send)

    async def _http(self, scope: Scope, receive: Receive, send: Send) -> None:
        reason = self._foreign(scope, strict=scope["method"] not in ("GET", "HEAD"))
        if reason:
            await _answer(send, 403, "Not from here", reason)
        elif self._has_cookie(scope):
            await self._guest(scope, receive, send)
        elif self._takes_token(scope):
            cookie = f"{self._cookie}={self._session}; Path=/; HttpOnly; SameSite=Lax"
            await _answer(
                send, 303, "", "", [(b"location", b"/"), (b"set-cookie", cookie.encode())]
            )
        else:
            await _answer(
                send,
                403,
                "This address does not open the page",
                "Its key is missing or was already used: a key admits one browser, once. Open the "
                "whole address shown in the terminal. To use another browser, start "
                "'vision app' again.",
            )

    async def _guest(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == LEAVING_PATH and scope["method"] == "POST":
            self._leaving_until = time.monotonic() + LEAVING_S
            # a body would be read as the next request on the same connection
            await send({"type": "http.response.start", "status": 204, "headers": [*HEADERS]})
            await send({"type": "http.response.body", "body": b""})
        elif scope["path"] != "/":
            await self._app(scope, receive, _with_headers(send))
        elif b"token=" in scope.get("query_string", b""):
            await _answer(send, 303, "", "", [(b"location", b"/")])
        elif await self._vacant(but_leaving=True):
            self._seen, self._left_at = True, time.monotonic()
            await self._app(scope, receive, _with_headers(send))
        else:
            await _answer(
                send,
                409,
                "The page is open in another window",
                "Continue there, or close that window: this one then opens by itself. No work is "
                "lost.",
                script=f"setTimeout(() => location.reload(), {1000 * RETRY_S})",
            )

    async def _websocket(self, scope: Scope, receive: Receive, send: Send) -> None:
        refused = bool(self._foreign(scope, strict=True)) or not self._has_cookie(scope)
        if refused or not await self._vacant():
            await receive()
            await send({"type": "websocket.close", "code": POLICY})
            return
        self._windows += 1
        self._seen = True
        self._leaving_until = -float("inf")
        try:
            await self._app(scope, receive, send)
        finally:
            self._windows -= 1
            self._left_at = time.monotonic()

    async def _vacant(self, *, but_leaving: bool = False) -> bool:
        """Whether no window is open; waits shortly for one that is reloading.

        A browser keeps the old page and its connection until it has the new one: a window that
        reported leaving counts as closed for the page, but not for the connection.
        """
        until = time.monotonic() + self._reload_s
        while self._windows and time.monotonic() < until:
            if but_leaving and time.monotonic() < self._leaving_until:
                return True
            await asyncio.sleep(0.05)
        return not self._windows

    def _foreign(self, scope: Scope, *, strict: bool) -> str:
        """Why a request does not come from the page itself; empty if it does."""
        hosts = list(_values(scope, b"host"))
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return f"Open this page at http://{self._hosts[0]}/."
        origins = list(_values(scope, b"origin"))
        if (strict and not origins) or any(origin not in self._origins for origin in origins):
            return "Another page made this request. Open this page at its own address."
        return ""

    def _has_cookie(self, scope: Scope) -> bool:
        for header in _values(scope, b"cookie"):
            try:
                morsel = SimpleCookie(header).get(self._cookie)
            except CookieError:
                continue
            if morsel and hmac.compare_digest(morsel.value.encode(), self._session.encode()):
                return True
        return False

    def _takes_token(self, scope: Scope) -> bool:
        """Whether the request carries the token, which is then used up."""
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [])
        if scope["path"] != "/" or scope["method"] != "GET" or self._token is None or not given:
            return False
        if not hmac.compare_digest(given[0].encode(), self._token.encode()):
            return False
        self._token = None
        return True


def _values(scope: Scope, name: bytes) -> Iterable[str]:
    return (value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name)


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *HEADERS]}
        await send(message)

    return sending


async def _answer(
    send: Send,
    status: int,
    title: str,
    text: str,
    headers: Iterable[tuple[bytes, bytes]] = (),
    script: str = "",
) -> None:
    body = (
        "<!doctype html><html lang=en><meta charset=utf-8>"
        f"<title>{escape(title)}</title>"
        "<body style='font: 18px/1.5 system-ui, sans-serif; max-width: 40rem; margin: 4rem auto;"
        " padding: 0 1rem'>"
        f"<h1 style='font-size: 1.5rem'>{escape(title)}</h1><p>{escape(text)}</p>"
        f"<script>{script}</script></body></html>"
    ).encode()
    start = [
        (b"content-type", b"text/html; charset=utf-8"),
        (b"content-length", str(len(body)).encode()),
        (b"cache-control", b"no-store"),
        *HEADERS,
        *headers,
    ]
    await send({"type": "http.response.start", "status": status, "headers": start})
    await send({"type": "http.response.body", "body": body})


class Jobs:
    """Jobs run in order on a thread that ends with the program.

    Attributes
    ----------
    problem : str
        Why the last job failed; empty if it succeeded.
    revision : int
        Increases whenever a job begins or ends.
    """

    def __init__(self) -> None:
        self.problem = ""
        self.revision = 0
        self._lock = Lock()
        self._waiting: deque[tuple[str, Callable[[], object]]] = deque()
        self._thread: Thread | None = None
        self._now = ""

    @property
    def busy(self) -> str:
        """Label of the running job; empty if there is none."""
        with self._lock:
            return self._now or (self._waiting[0][0] if self._waiting else "")

    def submit(self, label: str, job: Callable[[], object]) -> None:
        """Queue `job`; the project's errors end up in `problem`."""
        with self._lock:
            self._waiting.append((label, job))
            self.revision += 1
            if self._thread is None:
                self._thread = Thread(target=self._work, daemon=True)
                self._thread.start()

    def _work(self) -> None:
        try:
            while (job := self._next()) is not None:
                try:
                    job()
                    self.problem = ""
                except ImpactVisionError as problem:
                    self.problem = problem.in_one_line
        finally:
            # also after a bug: the next job then starts a new thread
            with self._lock:
                self._thread, self._now = None, ""
                self.revision += 1

    def _next(self) -> Callable[[], object] | None:
        with self._lock:
            self.revision += 1
            if not self._waiting:
                # cleared under the lock: submit must not rely on a thread that is about to end
                self._thread, self._now = None, ""
                return None
            self._now, job = self._waiting.popleft()
            return job


POLL_INTERVAL_S = 0.5
"""s between two checks for open windows (chosen)."""


def serve_app(
    app: FastAPI,
    opened: Callable[[str], None],
    *,
    port: int = 0,
    grace_s: float,
    stopper: Callable[[Callable[[], None]], None] = lambda stop: None,
) -> None:
    """Serve a page until its window is closed or the program is interrupted.

    Parameters
    ----------
    opened : callable
        Called with the address once the server answers.
    port : int
        0 selects a free port.
    grace_s : float
        How long the page may stay closed before this returns, s.
    stopper : callable
        Called with a function that stops the server.

    Raises
    ------
    UsageError
        If the port is taken.
    KeyboardInterrupt
        If the user interrupts; `Terminated` at SIGTERM.
    """
    listener = _listening(port)
    guard = Guard(app, listener.getsockname()[1])
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
    asyncio.run(_until_left(server, guard, listener, opened, grace_s))
    if server.ended_by == signal.SIGTERM:
        raise Terminated
    if server.ended_by is not None:
        raise KeyboardInterrupt


class _Server(uvicorn.Server):
    """Record the signal and stop.

    The base class would raise it again: lost where the parent shell ignores it, and before the page
    is closed in order.
    """

    ended_by: int | None = None

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.ended_by = sig if self.ended_by is None else self.ended_by
        self.force_exit, self.should_exit = self.should_exit, True


def _listening(port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.bind(("127.0.0.1", port))
    except OSError as problem:
        listener.close()
        raise UsageError(
            f"port {port} is not available: {problem.strerror}",
            hint="Omit --port to use a free one.",
        ) from problem
    listener.listen()
    return listener


def _stop(server: uvicorn.Server) -> None:
    server.should_exit = True


async def _until_left(
    server: uvicorn.Server,
    guard: Guard,
    listener: socket.socket,
    opened: Callable[[str], None],
    grace_s: float,
) -> None:
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    while not server.started and not serving.done():
        await asyncio.sleep(0.02)
    if not serving.done():
        opened(guard.address)
    while not serving.done():
        await asyncio.wait({serving}, timeout=POLL_INTERVAL_S)
        if guard.empty_for() > grace_s:
            _stop(server)
    await serving
