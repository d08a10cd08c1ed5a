"""`measure`: one clip to a measurement that prints, plots and reports itself."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metrology import ClipError
from pipelines.api.quantities import At, Given, Quantities, QuantityView, SetupLike, measure_options
from pipelines.measure import measurement as chain
from pipelines.measure.chain import measure_clip
from pipelines.measure.files.output import harmless, measurement_as_dict, measurement_as_row
from pipelines.measure.files.pictures import overlay_marks, report_input
from pipelines.measure.files.tracks import track_covariance, tracks_as_frame
from pipelines.report.notebook import results_html
from pipelines.report.page import write_report
from pipelines.report.plots import plots_figure
from vision.clip.clip import ClipReader
from vision.overlay.overlay import write_overlay
from vision.tracks import Motion

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

    from pipelines.figures import Picture

__all__ = ["Measurement", "measure"]


class Measurement:
    """All that was measured in one clip. Every quantity is an attribute, too: ``m.ball_speed``.

    Parameters
    ----------
    record : pipelines.measure.measurement.ClipMeasurement
        What the chain hands on.

    Attributes
    ----------
    quantities : Mapping of str to QuantityView
        In the order of the results table; those that can't be measured say why.
    record : pipelines.measure.measurement.ClipMeasurement
        The chain's own result: tracks in pixels, calibration, fits.
    """

    def __init__(self, record: chain.ClipMeasurement) -> None:
        self.record = record
        self.quantities: Mapping[str, QuantityView] = Quantities(
            (*record.quantities, *record.other_speeds), Path(record.info.path).name
        )

    def __getattr__(self, name: str) -> QuantityView:
        quantities = self.__dict__.get("quantities", {})
        if name in quantities:
            found: QuantityView = quantities[name]
            return found
        raise AttributeError(f"a measurement has no {name!r}; its quantities: {[*quantities]}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.quantities]

    @property
    def motion(self) -> Motion:
        """What was seen to happen, with its probability."""
        return self.record.tracks.motion

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know, in whole sentences."""
        return self.record.warnings

    @property
    def tracks(self) -> "pd.DataFrame":
        """All tracks, one row per object and frame; the columns of the track CSV (px, m, rad)."""
        return tracks_as_frame(self.record)

    def covariance(self, name: str = "ball", *, metres: bool = True) -> "NDArray[np.float64]":
        """Covariances (N, 2, 2) of an object's rows in `tracks`, m² or px²."""
        return track_covariance(self.record, name, metres=metres)

    def to_dict(self) -> dict[str, Any]:
        """The contract's JSON of one clip."""
        return measurement_as_dict(self.record)

    def to_frame(self) -> "pd.DataFrame":
        """One row: the columns of the CSV of results."""
        import pandas as pd

        return pd.DataFrame([harmless(measurement_as_row(self.record))])

    def plot(self) -> "Picture":
        """Gap, speeds, path and residuals as a matplotlib figure.

        Raises
        ------
        UsageError
            If nothing was followed that could be drawn.
        """
        return plots_figure(report_input(self.record, None))

    def overlay(self, path: str | os.PathLike[str]) -> Path:
        """Write a video with tracks, outlines, grid and landing point drawn into the clip."""
        out = Path(path)
        clip = ClipReader.open(self.record.info.path)
        write_overlay(out, clip, self.record.tracks, overlay_marks(self.record))
        return out

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the one-page HTML report."""
        out = Path(path)
        write_report(out, report_input(self.record, ClipReader.open(self.record.info.path)))
        return out

    def __repr__(self) -> str:
        return repr(self.quantities)

    def _repr_html_(self) -> str:
        shown = report_input(self.record, self._clip())
        return results_html(
            Path(self.record.info.path).name,
            (*self.record.quantities, *self.record.other_speeds),
            self.warnings,
            shown.still_png,
        )

    def _clip(self) -> ClipReader | None:
        """The clip where it still is."""
        try:
            return ClipReader.open(self.record.info.path)
        except ClipError:
            return None


def measure(
    path: str | os.PathLike[str],
    *,
    setup: SetupLike = None,
    fps: Given | None = None,
    ball: Given | None = None,
    wall_grid: Given | None = None,
    ball_at: At = None,
    mass_at: At = None,
    cache: bool = True,
    scale: Given | None = None,
) -> Measurement:
    """Measure one clip.

    Parameters
    ----------
    path : path
        Video file or folder of pictures.
    setup : Setup or path, optional
        What the lab knows.
    fps : float or str, optional
        Capture rate, 1/s or such as "600 fps"; goes before the setup's.
    ball : str or float, optional
        A preset ("jokku", "basketball"), or a diameter: "220 mm", or in m.
    wall_grid : str or float, optional
        Side of the wall's squares: "50mm", or in m.
    ball_at, mass_at : (x, y) or (x, y, frame), optional
        A point on the ball, or on the pendulum's mass, px.
    cache : bool
        Take up stages of an earlier measurement of the same clip.
    scale : str or float, optional
        Of the plane of motion, where somebody knows it: "409.9 px/m ± 2 px/m", "2.44 mm/px", or in
        m/px. The wall is not calibrated then.

    Returns
    -------
    Measurement
        Quantities that can't be measured carry their reason.

    Raises
    ------
    UsageError
        For options that can't be.
    ClipError
        If the clip can't be read.
    NotFoundError
        If nothing in it moves.

    Examples
    --------
    >>> m = iv.measure("a.mp4", setup="lab.toml", wall_grid="50mm", ball="jokku")  # doctest: +SKIP
    >>> m.ball_speed  # doctest: +SKIP
    ball_speed: 5.2012 ± 0.0093 m/s
    """
    options = measure_options(
        setup, fps, ball, wall_grid, ball_at, mass_at, cache=cache, scale=scale
    )
    return Measurement(measure_clip(Path(path), options))
