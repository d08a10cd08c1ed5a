"""`calibrate`: the wall of a clip, found unattended; what the wizard writes, without the wizard."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from calib.calibration import Calibration
from metrology import CalibrationError, Quantity
from pipelines.api.quantities import Given, Quantities, QuantityView, as_document
from pipelines.calibrate.clip import find_unattended, session_of
from pipelines.calibrate.wizard.session import Session, setup_text
from pipelines.report.notebook import results_html
from pipelines.setup.file import Setup, read_setup

__all__ = ["CalibratedClip", "calibrate"]


class CalibratedClip:
    """A calibrated view: camera, wall and ball plane, with what to expect of a landing distance.

    Parameters
    ----------
    session : Session
        With its wall grid found.
    note : str
        What was not found, empty otherwise.

    Attributes
    ----------
    quantities : Mapping of str to QuantityView
        ``camera_distance``, ``ball_plane_offset`` and the expected ``landing_distance``, m.
    calibration : calib.calibration.Calibration
        Camera, lens and planes with their covariance: pixels to metres.
    warnings : tuple of str
    """

    def __init__(self, session: Session, note: str = "") -> None:
        outlook = session.outlook
        if outlook.calibration is None:
            raise CalibrationError(outlook.problem)
        self._session = session
        self.calibration: Calibration = outlook.calibration
        self.warnings = (*((note,) if note else ()), *outlook.warnings)
        title = f"Calibration of {session.answers.scene.info.path.name}"
        found = [
            self._depth("camera_distance", lambda c: c.camera_distance),
            self._depth("ball_plane_offset", lambda c: c.ball_plane_offset),
        ]
        if outlook.distance is not None:
            found.append(
                Quantity.measured("landing_distance", outlook.distance, "m", outlook.budget)
            )
        self._named, self._plain, self._title = Quantities(found, title), found, title
        self.quantities = self._named

    def _depth(self, name: str, value: Callable[[Calibration], float]) -> Quantity:
        budget = self.calibration.budget(value)
        return Quantity.measured(name, value(self.calibration), "m", budget)

    def __getattr__(self, name: str) -> QuantityView:
        quantities = self.__dict__.get("quantities", {})
        if name in quantities:
            found: QuantityView = quantities[name]
            return found
        raise AttributeError(f"there is no {name!r}; there are: {[*quantities]}")

    @property
    def setup(self) -> Setup:
        """What is known now, as a setup: hand it to `measure`."""
        answers = self._session.answers
        return read_setup(setup_text(answers, self._session.outlook), folder=answers.out.parent)

    def save(self, path: str | os.PathLike[str]) -> tuple[Path, Path]:
        """Write the setup file, and ``lens.toml`` beside it."""
        out = Path(path)
        self._session.answers = replace(self._session.answers, out=out)
        written = self._session.save()
        return written.setup, written.lens

    def to_dict(self) -> dict[str, Any]:
        """``{"quantities": …, "warnings": …}``."""
        return as_document(self._named, self.warnings)

    def __repr__(self) -> str:
        return repr(self._named)

    def _repr_html_(self) -> str:
        return results_html(self._title, self._plain, self.warnings)


def calibrate(
    path: str | os.PathLike[str],
    *,
    fps: Given | None = None,
    lens: str | os.PathLike[str] | None = None,
    wall_grid: str | None = None,
    fine_grid: str | None = None,
    ball: str | None = None,
    ball_at: str | None = None,
    support_height: str | None = None,
    camera_distance: str | None = None,
    ball_plane: str | None = None,
) -> CalibratedClip:
    """Find the wall grid of a clip and calibrate with it, unattended.

    Parameters
    ----------
    path : path
        The clip.
    fps : float or str, optional
        Capture rate, 1/s.
    lens : path, optional
        A lens file.
    wall_grid, fine_grid : str, optional
        Side of a square, and distance of the fine lines (or "none"): "50mm".
    ball : str, optional
        A preset, or "220 mm, 0.4 kg".
    ball_at : str, optional
        The ball at rest, "x,y" in px.
    support_height, camera_distance, ball_plane : str, optional
        How far the ball falls; camera to wall and ball's plane to wall by tape: "4.00 m ± 5 mm".

    Returns
    -------
    CalibratedClip

    Raises
    ------
    ClipError
        If the clip can't be read.
    CalibrationError
        If no wall grid is found.
    UsageError
        If something said can't be.
    """
    session = session_of(
        Path(path),
        Path("setup.toml"),
        fps=None if fps is None else str(fps),
        lens=None if lens is None else Path(lens),
        wall_grid=wall_grid,
        fine_grid=fine_grid,
        ball=ball,
        ball_at=ball_at,
        support_height=support_height,
        camera_distance=camera_distance,
        ball_plane=ball_plane,
    )
    return CalibratedClip(session, find_unattended(session))
