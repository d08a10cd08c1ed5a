"""The door of the local page: token, cookie, Host, Origin, one window."""

import asyncio
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from metrology import UsageError
from pipelines.web import Guard

HOME = "http://127.0.0.1:8123"
SOCKET = "ws://127.0.0.1:8123/ws"
ORIGIN = {"origin": HOME}


async def page(_: Any) -> PlainTextResponse:
    return PlainTextResponse("the page")


async def talk(socket: WebSocket) -> None:
    await socket.accept()
    await socket.send_text("hello")
    await socket.receive()


def guarded() -> Guard:
    routes = [Route("/", page), Route("/save", page, methods=["POST"]), WebSocketRoute("/ws", talk)]
    return Guard(Starlette(routes=routes), 8123, reload_s=0.1)


def client(guard: Guard, base: str = HOME) -> TestClient:
    return TestClient(guard, base_url=base, follow_redirects=False)


def entered(guard: Guard) -> TestClient:
    browser = client(guard)
    assert browser.get(guard.address.removeprefix(HOME)).status_code == 303
    return browser


def test_the_address_opens_the_page_once_and_the_cookie_keeps_it_open() -> None:
    guard = guarded()
    browser = client(guard)
    first = browser.get(guard.address.removeprefix(HOME))
    assert (first.status_code, first.headers["location"]) == (303, "/")
    cookie = first.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=lax" in cookie
    assert browser.get("/").text == "the page"
    assert browser.get(guard.address.removeprefix(HOME)).headers["location"] == "/"
    stranger = client(guard)
    used = stranger.get(guard.address.removeprefix(HOME))
    assert used.status_code == 403
    assert "once" in used.text


def test_no_token_no_entry() -> None:
    guard = guarded()
    for path in ("/", "/?token=", "/?token=wrong", "/save"):
        assert client(guard).get(path).status_code == 403
    forged = client(guard)
    forged.cookies.set("vision-app-8123", "forged")
    assert forged.get("/").status_code == 403
    assert client(guard).get(guard.address.removeprefix(HOME)).status_code == 303


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "127.0.0.1:9999", "evil.example:8123", ""]
)
def test_a_foreign_host_is_refused_even_with_the_cookie(host: str) -> None:
    guard = guarded()
    browser = entered(guard)
    assert browser.get("/", headers={"host": host}).status_code == 403
    token = client(guard).get(guard.address.removeprefix(HOME), headers={"host": host})
    assert token.status_code == 403
    with (
        pytest.raises(WebSocketDisconnect),
        browser.websocket_connect(SOCKET, headers={"host": host, **ORIGIN}),
    ):
        pass


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9999"])
def test_a_foreign_origin_is_refused(origin: str) -> None:
    guard = guarded()
    browser = entered(guard)
    assert browser.get("/", headers={"origin": origin}).status_code == 403
    assert browser.post("/save", headers={"origin": origin}).status_code == 403
    with (
        pytest.raises(WebSocketDisconnect),
        browser.websocket_connect(SOCKET, headers={"origin": origin}),
    ):
        pass


def test_what_changes_things_must_say_where_it_comes_from() -> None:
    browser = entered(guarded())
    assert browser.post("/save").status_code == 403
    assert browser.post("/save", headers=ORIGIN).status_code == 200
    with pytest.raises(WebSocketDisconnect), browser.websocket_connect(SOCKET):
        pass


def test_a_websocket_needs_the_cookie() -> None:
    guard = guarded()
    with (
        pytest.raises(WebSocketDisconnect),
        client(guard).websocket_connect(SOCKET, headers=ORIGIN),
    ):
        pass
    with entered(guard).websocket_connect(SOCKET, headers=ORIGIN) as socket:
        assert socket.receive_text() == "hello"


def test_a_second_window_is_refused_until_the_first_is_gone() -> None:
    guard = guarded()
    browser = entered(guard)
    assert guard.empty_for() == 0.0
    with browser.websocket_connect(SOCKET, headers=ORIGIN) as socket:
        socket.receive_text()
        assert guard.windows == 1
        second = browser.get("/")
        assert second.status_code == 409
        assert "another window" in second.text
        # and loads itself again
        assert "location.reload()" in second.text
        with pytest.raises(WebSocketDisconnect), browser.websocket_connect(SOCKET, headers=ORIGIN):
            pass
    assert browser.get("/").status_code == 200
    assert guard.windows == 0


def test_a_window_that_says_it_goes_lets_the_next_one_in_once() -> None:
    guard = guarded()
    browser = entered(guard)
    with browser.websocket_connect(SOCKET, headers=ORIGIN) as socket:
        socket.receive_text()
        assert browser.post("/leaving").status_code == 403
        assert client(guard).post("/leaving", headers=ORIGIN).status_code == 403
        assert browser.get("/").status_code == 409
        assert browser.post("/leaving", headers=ORIGIN).status_code == 204
        assert browser.get("/").text == "the page"
        with pytest.raises(WebSocketDisconnect), browser.websocket_connect(SOCKET, headers=ORIGIN):
            pass
    with browser.websocket_connect(SOCKET, headers=ORIGIN) as socket:
        socket.receive_text()
        assert browser.get("/").status_code == 409


def test_the_house_is_empty_only_after_somebody_was_there(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("pipelines.web.time.monotonic", lambda: now[0])
    guard = Guard(Starlette(), 8123, reload_s=0.0)
    now[0] = 500.0
    assert guard.empty_for() == 0.0
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {"type": "http.request", "body": b"", "more_body": False}

    query = guard.address.partition("?")[2].encode()
    scope = {
        "type": "http",
        "method": "GET",
        "path": "/",
        "query_string": query,
        "headers": [(b"host", b"127.0.0.1:8123")],
    }
    asyncio.run(guard(scope, receive, send))
    cookie = dict(sent[0]["headers"])[b"set-cookie"].partition(b";")[0]
    scope = {**scope, "query_string": b"", "headers": [*scope["headers"], (b"cookie", cookie)]}
    asyncio.run(guard(scope, receive, send))
    now[0] = 507.0
    assert guard.empty_for() == 7.0


def test_answers_can_not_be_framed_or_guessed() -> None:
    browser = entered(guarded())
    for response in (browser.get("/"), client(guarded()).get("/")):
        assert response.headers["x-frame-options"] == "DENY"
        assert response.headers["x-content-type-options"] == "nosniff"
    assert guarded().address != guarded().address
    with pytest.raises(UsageError):
        Guard(Starlette(), 0)
