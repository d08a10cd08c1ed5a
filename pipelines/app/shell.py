"""Frame of the page: head line, pages, addresses of frames, style and server."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from pipelines.app.corrections import ClipInputs
from pipelines.app.pages.addresses import app_of
from pipelines.app.pages.clip import ClipPage
from pipelines.app.pages.export import ExportPage
from pipelines.app.pages.folder import FolderPage
from pipelines.app.pages.open import OpenPage
from pipelines.app.pages.setup import SetupPage
from pipelines.app.pages.why import WhyPage
from pipelines.app.session import AppSession
from pipelines.app.words import LANGUAGES, Say, says
from pipelines.web import LEAVING_PATH, serve_app

__all__ = ["AppWindow", "serve_page"]

MAX_SILENCE_S = 30.0
"""s without a sign of a window until it counts as gone, and until the program then ends (chosen: a
browser loads the page in less, also while measuring occupies all cores)."""


class AppWindow:
    """One window; a reload builds another one from the same session."""

    def __init__(self, session: AppSession) -> None:
        self.session = session
        self._page: ClipPage | SetupPage | None = None

    @property
    def say(self) -> Say:
        """Texts of the chosen language."""
        return says(self.session.language)

    def build(self) -> None:
        """Lay the page out."""
        ui.add_head_html('<link rel="stylesheet" href="/app/style.css">')
        ui.add_body_html('<script src="/app/viewer.js"></script>')
        ui.add_body_html(f"<script>{_NAVIGATION}</script>")
        ui.page_title(self.say("title"))
        self._dark = ui.dark_mode(self.session.dark)
        ui.on("vision_page", lambda event: self._turn(str(event.args)))
        ui.on("vision_dark", lambda event: self._begin_as_system(bool(event.args)))
        for name in ("moved", "pointed", "span", "undo", "redo"):
            ui.on(f"vision_{name}", lambda event, name=name: self._on_viewer(name, event))
        with ui.column().classes("w-full gap-0"):
            self.head()
            with ui.element("div").classes("w-full"):
                self.content()
        self._name_page()

    def _name_page(self) -> None:
        names = (self.session.page, self.session.language, self.say("drop"))
        ui.run_javascript(f"visionShow(...{json.dumps(names)})")

    @ui.refreshable_method
    def head(self) -> None:
        """Links to the pages, language, light or dark."""
        say, session = self.say, self.session
        with ui.row().classes("va-top va-hidden-in-print"):
            with ui.element("nav").props(f'aria-label="{say("pages")}"'):
                for name in pages_of(session):
                    current = "page" if name == session.page else "false"
                    link = ui.element("a").props(
                        f'href="#{name}" aria-current={current} data-test="page-{name}"'
                    )
                    with link:
                        ui.label(say(name))
            ui.space()
            language = ui.select(LANGUAGES, value=session.language, on_change=self._speak)
            language.props(f'dense borderless aria-label="{say("language")}" data-test=language')
            self._switch = ui.switch(say("dark"), value=bool(session.dark), on_change=self._darken)
            self._switch.props("dense data-test=dark")
            ui.button(say("close"), on_click=self._quit).props("flat dense data-test=quit")

    @ui.refreshable_method
    def content(self) -> None:
        """The page itself."""
        session, say = self.session, self.say
        self._page = None
        if session.page == "clip" and session.clip is not None:
            self._page = ClipPage(session, session.clip, say)
            self._page.build()
        elif session.page == "folder" and session.folder_session is not None:
            folder = session.folder_session
            FolderPage(folder, say, self._open_of_folder).build()
        elif session.page == "setup" and session.clip is not None:
            self._page = SetupPage(session.clip, session.jobs, say, partial(self.go, "clip"))
            self._page.build()
        elif session.page == "why" and session.clip is not None:
            WhyPage(session.clip, session.jobs, say).build()
        elif session.page == "export" and session.clip is not None:
            ExportPage(session.clip, session.jobs, say).build()
        else:
            OpenPage(say, self._open, session.folder, session.recent).build()

    def _open(self, place: Path) -> None:
        self.session.open_place(place)
        self.show()

    def _open_of_folder(self, clip: Path) -> None:
        folder = self.session.folder_session
        given = {} if folder is None else folder.inputs.given()
        given.pop("trials", None)
        if "setup" in given and folder is not None and folder.clips is not None:
            given["setup"] = str(folder.clips / given["setup"])
        self.session.open_clip(clip, ClipInputs(**given) if given else None)
        self.show()

    def go(self, page: str) -> None:
        """Show another page."""
        self._turn(page)
        self._name_page()

    def show(self) -> None:
        """Draw head and page anew, and name the page in the address."""
        self._redraw()
        self._name_page()

    def _turn(self, page: str) -> None:
        """Show the page that the address names; the browser may already be at the next one."""
        if page in pages_of(self.session) and page != self.session.page:
            self.session.page = page
            self._redraw()

    def _redraw(self) -> None:
        self.head.refresh()
        self.content.refresh()

    def _on_viewer(self, name: str, event: GenericEventArguments) -> None:
        if self._page is not None:
            self._page.on_viewer(name, event.args if isinstance(event.args, dict) else {})

    def _speak(self, event: Any) -> None:
        self.session.language = event.value
        self.show()

    def _darken(self, event: Any) -> None:
        self.session.dark = bool(event.value)
        self._dark.set_value(self.session.dark)

    def _begin_as_system(self, dark: bool) -> None:
        """Set the switch as the system has it, unless it was used."""
        if self.session.dark is None and self._switch.value != dark:
            self._switch.value = dark

    def _quit(self) -> None:
        text = json.dumps(self.say("closed"))
        ui.run_javascript(
            f"document.body.replaceChildren(document.createElement('p'));"
            f"document.body.firstChild.textContent = {text};"
        )
        ui.timer(0.3, self.session.stop, once=True)


_NAVIGATION = (
    """
// what the components leave without a name for screen readers; a file is chosen by the keyboard in
// its field, not in the button around it
let visionDrop = "";
const visionName = () => {
  for (const image of document.querySelectorAll("img:not([alt])")) image.alt = "";
  for (const bar of document.querySelectorAll("[role=progressbar]:not([aria-label])"))
    bar.ariaLabel = document.title;
  for (const field of document.querySelectorAll(".q-uploader__input")) {
    if (field.ariaLabel === visionDrop && field.tabIndex === 0) continue;
    field.ariaLabel = visionDrop;
    field.tabIndex = 0;
    field.closest("a").role = "presentation";
    field.closest("a").removeAttribute("tabindex");
  }
};
new MutationObserver(visionName).observe(document.body, {childList: true, subtree: true});
window.visionShow = (page, language, drop) => {
  document.documentElement.lang = language;
  visionDrop = drop;
  emitEvent("vision_dark", matchMedia("(prefers-color-scheme: dark)").matches);
  visionName();
  if (location.hash === "#" + page) return;
  history[location.hash ? "pushState" : "replaceState"](null, "", "#" + page);
};
// of links within the page, and of back and forward
window.addEventListener("popstate", () => emitEvent("vision_page", location.hash.slice(1)));
window.addEventListener("beforeunload", () => navigator.sendBeacon("LEAVING"));
"""
).replace("LEAVING", LEAVING_PATH)
"""The address names the page, so that the browser's back and forward work."""


def pages_of(session: AppSession) -> tuple[str, ...]:
    """Pages that can be shown now."""
    folder = ("folder",) if session.folder_session is not None else ()
    clip = ("clip", "setup", "why", "export") if session.clip is not None else ()
    return ("open", *folder, *clip)


def serve_page(
    session: AppSession,
    opened: Callable[[str], None],
    *,
    port: int = 0,
    grace_s: float = MAX_SILENCE_S,
) -> None:
    """Serve the page until its window is closed or the program is interrupted.

    Parameters
    ----------
    opened : callable
        Called with the address once it is served.
    port : int
        0 for any free one.
    grace_s : float
        Time the page may be closed before the program ends, s.

    Raises
    ------
    UsageError
        If the port is in use.
    KeyboardInterrupt
        If the user interrupts.
    """
    app = app_of(session)
    ui.run_with(
        app,
        root=lambda: AppWindow(session).build(),
        title="Impact vision",
        dark=None,
        reconnect_timeout=MAX_SILENCE_S,
        show_welcome_message=False,
    )

    def take(stop: Callable[[], None]) -> None:
        session.stop = stop

    serve_app(app, opened, port=port, grace_s=grace_s, stopper=take)
