"""Page of `vision campaign --watch`: progress, selection of balls, bad trials."""

import json
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fastapi import FastAPI, HTTPException, WebSocket
from fastapi.responses import FileResponse, HTMLResponse
from pydantic import BaseModel, Field
from starlette.websockets import WebSocketDisconnect

from metrology import UsageError
from pipelines.campaign.ledger import Entry, Ledger, State
from pipelines.web import serve_app

__all__ = ["WatchPage", "watch_app", "watched"]

MIN_CERTAIN_PROBABILITY = 0.9
"""Probability of the motion kind below which a clip is listed first (chosen)."""
CARD_QUANTITIES = ("contact_time", "ball_speed", "launch_angle", "cor")
_PAGE = Path(__file__).with_name("watch.html")


class Mark(BaseModel):
    """A request to mark a trial as bad, or to remove the mark."""

    clip: str = Field(max_length=1024)
    reason: str | None = Field(default=None, max_length=500)


class Point(BaseModel):
    """Position of the ball in the frame shown, as fractions of its width."""

    clip: str = Field(max_length=1024)
    x: float = Field(ge=0.0, le=1.0, allow_inf_nan=False)
    y: float = Field(ge=0.0, le=4.0, allow_inf_nan=False)


class WatchPage:
    """State of the page: requests, and whether it is open.

    Parameters
    ----------
    folder : Path
        Of the campaign.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.asked = threading.Event()
        self.closed = threading.Event()
        self.running = True

    def wait(self) -> bool:
        """Wait until a clip is marked or a ball selected (true), or the page closes (false)."""
        while not self.closed.is_set():
            if self.asked.wait(0.3):
                self.asked.clear()
                return True
        return False


def watch_app(watched: WatchPage) -> FastAPI:
    """Web application of the page.

    Parameters
    ----------
    watched : WatchPage
    """
    app = FastAPI(openapi_url=None)
    folder = watched.folder

    @app.get("/")
    def page() -> HTMLResponse:
        return HTMLResponse(_PAGE.read_text(encoding="utf-8"))

    @app.get("/state")
    def state() -> dict[str, Any]:
        if not (folder / "ledger.sqlite").is_file():
            return {"counts": {}, "clips": [], "running": True}
        with Ledger(folder) as ledger:
            counts = {str(key): number for key, number in ledger.counts().items()}
            points = ledger.points()
            clips = [_clip(entry, points, folder) for entry in ledger.entries()]
        order = {True: 0, False: 1}
        clips.sort(key=lambda one: order[one["unsure"]])
        return {"counts": counts, "clips": clips, "running": watched.running}

    @app.get("/frame/{clip}")
    def frame(clip: str) -> FileResponse:
        path = folder / "frames" / f"{clip}.jpg"
        if not _known(folder, clip) or not path.is_file():
            raise HTTPException(404)
        return FileResponse(path, headers={"cache-control": "no-store"})

    @app.post("/mark")
    def mark(asked: Mark) -> dict[str, bool]:
        reason = None if asked.reason is None else asked.reason.strip() or None
        _change(folder, lambda ledger: ledger.exclude(asked.clip, reason))
        watched.asked.set()
        return {"done": True}

    @app.post("/ball")
    def ball(asked: Point) -> dict[str, bool]:
        with Ledger(folder) as ledger:
            width = next(
                (
                    (entry.document or {}).get("clip", {}).get("width")
                    for entry in ledger.entries()
                    if entry.order.clip == asked.clip
                ),
                None,
            )
        if width is None:
            raise HTTPException(404)
        at = f"{asked.x * width:.1f},{asked.y * width:.1f}"
        _change(folder, lambda ledger: ledger.point_at(asked.clip, at))
        watched.asked.set()
        return {"done": True}

    @app.websocket("/here")
    async def here(socket: WebSocket) -> None:
        """Stays open as long as the page, to detect when it is left."""
        await socket.accept()
        try:
            while True:
                await socket.receive_text()
        except WebSocketDisconnect:
            return

    return app


def _known(folder: Path, clip: str) -> bool:
    with Ledger(folder) as ledger:
        return any(entry.order.clip == clip for entry in ledger.entries())


def _change(folder: Path, change: Callable[[Ledger], None]) -> None:
    try:
        with Ledger(folder) as ledger:
            change(ledger)
    except UsageError as problem:
        raise HTTPException(404, problem.message) from problem


def _clip(entry: Entry, points: dict[str, str], folder: Path) -> dict[str, Any]:
    """Content of a clip's card."""
    document = entry.document or {}
    quantities = document.get("quantities", {})
    motion = document.get("motion", {})
    probability = motion.get("probability")
    finished = entry.state in (State.DONE, State.FAILED)
    uncertain = probability is not None and probability < MIN_CERTAIN_PROBABILITY
    return {
        "clip": entry.order.clip,
        "state": str(entry.state),
        "error": entry.error,
        "bad": entry.excluded,
        "pointed": points.get(entry.order.clip),
        "motion": motion.get("kind"),
        "probability": probability,
        "unsure": finished and (entry.state == State.FAILED or uncertain),
        "frame": (folder / "frames" / f"{entry.order.clip}.jpg").is_file(),
        "values": {
            name: {key: quantities[name].get(key) for key in ("value", "std", "unit")}
            for name in CARD_QUANTITIES
            if quantities.get(name, {}).get("value") is not None
        },
        "stamp": json.dumps([entry.attempts, str(entry.state), entry.seconds]),
    }


def watched(folder: Path, on_address: Callable[[str], None], *, browse: bool = True) -> WatchPage:
    """Serve the page during a campaign until it is closed.

    Parameters
    ----------
    folder : Path
        Of the campaign.
    on_address : callable
        Called with the page's address.
    browse : bool
        Whether to open a browser.
    """
    page = WatchPage(folder)

    def opened(address: str) -> None:
        on_address(address)
        if browse:
            webbrowser.open(address)

    def serving() -> None:
        try:
            serve_app(
                watch_app(page), opened, what="campaign's page", command="vision campaign --watch"
            )
        finally:
            page.closed.set()

    threading.Thread(target=serving, daemon=True).start()
    return page
