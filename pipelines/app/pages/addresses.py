"""Addresses of the page: style and script, frames, outlines, pictures, the sheet."""

from functools import partial
from html import escape
from importlib.resources import files
from typing import Literal

from fastapi import FastAPI, HTTPException, Response
from fastapi.responses import HTMLResponse, JSONResponse

from metrology import ImpactVisionError
from pipelines.app.exports import sheet_html
from pipelines.app.session import AppSession
from pipelines.app.words import label_of, on_page, says

__all__ = ["app_of"]

WAIT_FOR_FRAME_S = 4.0
"""s that a request waits for a frame that is not decoded yet (chosen: the browser asks again)."""

_STORED_A_DAY = {"cache-control": "private, max-age=86400, immutable"}
_NOT_STORED = {"cache-control": "no-store"}


def app_of(session: AppSession) -> FastAPI:
    """Web application: the page, its style and script, frames and marks of the open clip."""
    app = FastAPI(openapi_url=None)
    _own_files(app)
    _of_clip(app, session)
    _of_other_pages(app, session)
    return app


def _own_files(app: FastAPI) -> None:
    own = {
        name: (files("pipelines.app").joinpath(name).read_bytes(), kind)
        for name, kind in (("style.css", "text/css"), ("viewer.js", "text/javascript"))
    }

    @app.get("/app/{name}")
    def asset(name: str) -> Response:
        if name not in own:
            raise HTTPException(404)
        content, kind = own[name]
        return Response(content, media_type=kind, headers=_NOT_STORED)


def _of_clip(app: FastAPI, session: AppSession) -> None:
    @app.get("/frame/{number}/{index}")
    def frame(number: int, index: int) -> Response:
        clip = session.clip
        content = None
        if clip is not None and clip.number == number:
            content = clip.frames.jpeg(index, WAIT_FOR_FRAME_S)
        if content is None:
            raise HTTPException(404)
        return Response(content, media_type="image/jpeg", headers=_STORED_A_DAY)

    @app.get("/marks/{number}/{revision}")
    def marks(number: int, revision: int) -> JSONResponse:
        clip = session.clip
        if clip is None or clip.number != number:
            raise HTTPException(404)
        return JSONResponse(clip.marks(), headers=_NOT_STORED)

    @app.get("/sheet")
    def sheet() -> HTMLResponse:
        clip = session.clip
        if clip is None or clip.measured is None:
            raise HTTPException(404)
        say = says(session.language)
        label, word = partial(label_of, say=say), partial(on_page, say=say)
        try:
            text = sheet_html(clip.measured, clip.as_command(), label, word)
        except ImpactVisionError as problem:
            text = f"<!doctype html><p>{escape(word(problem.in_one_line))}</p>"
        return HTMLResponse(text, headers=_NOT_STORED)


def _of_other_pages(app: FastAPI, session: AppSession) -> None:
    @app.get("/thumb/{clip}")
    def thumb(clip: str) -> Response:
        folder = session.folder_session
        content = None if folder is None else folder.picture(clip)
        if content is None:
            raise HTTPException(404)
        return Response(content, media_type="image/jpeg", headers=_NOT_STORED)

    @app.get("/why/{number}/{part}")
    def why(number: int, part: Literal["picture", "report"]) -> Response:
        clip = session.clip
        if clip is None or clip.number != number or clip.explained is None:
            raise HTTPException(404)
        if part == "report":
            return HTMLResponse(clip.explained.report, headers=_NOT_STORED)
        return Response(clip.explained.picture, media_type="image/png", headers=_NOT_STORED)
