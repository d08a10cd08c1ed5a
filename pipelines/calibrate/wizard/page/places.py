"""Places in the picture that the user can set, and what setting each of them does."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.calibrate.wizard.answers import Answers
from pipelines.calibrate.wizard.corners import starting_corners
from pipelines.calibrate.wizard.page.drawing import ruler
from pipelines.calibrate.wizard.session import Session
from pipelines.web.guard import Jobs

__all__ = ["LABELS", "Places"]

FloatArray = NDArray[np.float64]

LABELS = {
    "corner0": "1 lower left",
    "corner1": "2 lower right",
    "corner2": "3 upper right",
    "corner3": "4 upper left",
    "origin": "Origin",
    "rest": "Ball at rest",
    "landing": "Landing",
    "end0": "One end",
    "end1": "Other end",
}
BY_STEP = {2: ("corner0", "corner1", "corner2", "corner3", "origin"), 3: ("rest", "landing")}
BY_STEP[5] = ("end0", "end1")


class Places:
    """Where the places are, and which one clicks and arrow keys move.

    Parameters
    ----------
    session : Session
    jobs : Jobs
        What takes time is done there.

    Attributes
    ----------
    active : str or None
        Key of the place that is being set.
    """

    def __init__(self, session: Session, jobs: Jobs) -> None:
        self._session = session
        self._jobs = jobs
        self.active: str | None = None

    @property
    def by_hand(self) -> bool:
        """Whether the four handles are shown."""
        return self._session.by_hand

    @property
    def corners(self) -> FloatArray:
        """The handles, (4, 2), px."""
        session = self._session
        if session.handles is None:
            answers = session.answers
            session.handles = (
                starting_corners(answers.grid, answers.scene.size)
                if answers.corners is None
                else answers.corners.copy()
            )
        return session.handles

    def label(self, key: str) -> str:
        """Name of a place on the page."""
        return LABELS[key]

    def leave(self) -> None:
        """Another step: its places come first now."""
        if self.active not in BY_STEP.get(self._session.step, ()):
            self.active = None

    def where(self, key: str) -> FloatArray | None:
        """Where a place is, px; None while it is not set."""
        answers = self._session.answers
        if key.startswith("corner"):
            return np.asarray(self.corners[int(key[-1])])
        if key.startswith("end"):
            return self._session.ends.get(key)
        if key in self._session.moving:
            return self._session.moving[key]
        if key == "origin":
            return answers.origin_px
        return answers.rest if key == "rest" else answers.landing[0]

    def grabbed(self, px: FloatArray, share: float) -> str | None:
        """The handle near a place, if handles are shown."""
        if self._session.step != 2 or not self.by_hand:
            return None
        far = np.linalg.norm(self.corners - px, axis=1)
        nearest = int(np.argmin(far))
        near = far[nearest] < share * self._session.answers.scene.size[0]
        return f"corner{nearest}" if near else None

    def put(self, key: str, px: FloatArray, *, final: bool) -> None:
        """Put a place somewhere; `final` when the mouse is let go."""
        session = self._session
        px = np.clip(px, -0.5, np.array(session.answers.scene.size) - 0.5)
        if key.startswith("corner"):
            self.corners[int(key[-1])] = px
        elif key.startswith("end"):
            session.ends[key] = px
        elif not final:
            session.moving[key] = px
        else:
            session.moving[key] = px
            self._jobs.submit("working out the uncertainty", lambda: self._settle(key, px))

    def _settle(self, key: str, px: FloatArray) -> None:
        session = self._session
        if session.moving.get(key) is not px:
            return  # moved on since, as by a key held down
        if key == "origin":
            session.apply("origin set", lambda answers: _with_origin(answers, px))
        else:
            fields: dict[str, Any] = {f"{key}_px": px}
            session.update(f"{LABELS[key].lower()} set", **fields)
        if session.moving.get(key) is px:
            del session.moving[key]

    def ruler(self) -> str:
        """Drawing of the length to verify."""
        return ruler(self._session.ends, self._session.answers.scene.size)


def _with_origin(answers: Answers, px: FloatArray) -> Answers:
    grid = None if answers.grid is None else answers.grid.with_origin(px, snap=True)
    return replace(answers, origin_px=px, grid=grid)
