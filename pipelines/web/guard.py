"""The door of the local page: who may come in, and when the house is empty.

The page is bound to 127.0.0.1, but other programs, other users and web pages in the same browser
reach that too. So: a token in the address that works once and is exchanged for a cookie; requests
only under the page's own name (against DNS rebinding) and from the page itself (against other
sites); one window at a time.
"""

import asyncio
import hmac
import secrets
import time
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from html import escape
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from metrology import UsageError
from pipelines.calibrate.wizard.page.script import LEAVING_PATH

__all__ = ["Guard"]

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

HOSTS = ("127.0.0.1", "localhost")
RELOAD_S = 2.5
"""s that a window that is being reloaded may still seem to be there: a browser takes less."""
LEAVING_S = 20.0
"""s that a window that said it goes may take to be gone: then it is taken to have stayed."""
RETRY_S = 2
"""How long a refused window waits before it asks again."""
POLICY = 1008
"""WebSocket: closed because a rule was broken (RFC 6455, 7.4.1)."""
HEADERS = (
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
)


class Guard:
    """ASGI middleware around the page.

    Parameters
    ----------
    app : ASGI application
    port : int
        Where the page is served.
    token : str, optional
        One is drawn if not given.
    reload_s : float
        How long a second window waits for the first to go before it is refused, s.
    """

    def __init__(
        self, app: App, port: int, *, token: str | None = None, reload_s: float = RELOAD_S
    ) -> None:
        if not 0 < port < 65536:
            raise UsageError(f"{port} is no port", hint="Give 1 to 65535.")
        self._app = app
        self._hosts = tuple(f"{name}:{port}" for name in HOSTS)
        self._origins = tuple(f"http://{host}" for host in self._hosts)
        self._token: str | None = token or secrets.token_urlsafe(24)
        self._session = secrets.token_urlsafe(24)
        self._cookie = f"vision-calibrate-{port}"
        self._reload_s = reload_s
        self._windows = 0
        self._seen = False
        self._left_at = time.monotonic()
        self._leaving_until = -float("inf")
        self.address = f"http://{self._hosts[0]}/?token={self._token}"

    @property
    def windows(self) -> int:
        """Windows that are open."""
        return self._windows

    def empty_for(self) -> float:
        """Seconds since the last window went, 0 while there is one or none came yet."""
        return 0.0 if self._windows or not self._seen else time.monotonic() - self._left_at

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let in what belongs here, refuse the rest."""
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
                "This address does not open the calibration",
                "Its key is missing, or was used before: a key opens one browser, once. Use the "
                "whole address that the terminal shows; to use another browser, start "
                "'vision calibrate' again.",
            )

    async def _guest(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == LEAVING_PATH and scope["method"] == "POST":
            self._leaving_until = time.monotonic() + LEAVING_S
            # without a body: what follows on the same connection would be taken for it
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
                "The calibration is open in another window",
                "Go on there, or close it: then it goes on here by itself. Nothing is lost by "
                "that.",
                [(b"refresh", str(RETRY_S).encode())],
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
        """Whether no window is open, waiting a little for one that is being reloaded.

        A browser keeps the old page, and its connection, until it has the new one: a window that
        said it goes counts as gone for the page, though not for the connection.
        """
        until = time.monotonic() + self._reload_s
        while self._windows and time.monotonic() < until:
            if but_leaving and time.monotonic() < self._leaving_until:
                return True
            await asyncio.sleep(0.05)
        return not self._windows

    def _foreign(self, scope: Scope, *, strict: bool) -> str:
        """Why a request does not come from the page itself, empty if it does."""
        hosts = list(_values(scope, b"host"))
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return f"This page answers only under http://{self._hosts[0]}/."
        origins = list(_values(scope, b"origin"))
        if (strict and not origins) or any(origin not in self._origins for origin in origins):
            return "Another page asked for this one; open it by its own address."
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
        """Whether the request brings the token; it is used up then."""
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
) -> None:
    body = (
        "<!doctype html><html lang=en><meta charset=utf-8>"
        f"<title>{escape(title)}</title>"
        "<body style='font: 18px/1.5 system-ui, sans-serif; max-width: 40rem; margin: 4rem auto;"
        " padding: 0 1rem'>"
        f"<h1 style='font-size: 1.5rem'>{escape(title)}</h1><p>{escape(text)}</p></body></html>"
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
