"""`measure`, `Clip`, `render` and `calibrate`: clips in Python."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from measuring import measurement as chain
from measuring.chain import measure_clip
from measuring.measurement import bob_pendulum, track_covariance, tracks_as_frame
from measuring.setup.file import Setup, SetupLike, read_setup, setup_from
from measuring.setup.tables import ModelSetup, checked_values
from metrology import (
    CalibrationError,
    ClipError,
    NotFoundError,
    Quantity,
    UsageError,
    measurands,
    read_number,
)
from pipelines.api.quantities import (
    At,
    Given,
    HasQuantities,
    QuantityView,
    angle_from,
    length_text,
    measure_options,
    point_from,
)
from pipelines.api.shown import correlated, notebook_progress
from pipelines.api.wording import in_python, worded_for_python
from pipelines.calibrate.command import find_unattended
from pipelines.calibrate.saving import lens_for, setup_text
from pipelines.calibrate.session import Session, session_of
from pipelines.measure.files import (
    measurement_as_dict,
    measurement_as_row,
    overlay_marks,
    report_input,
    without_formulas,
)
from pipelines.render import NOISE, RenderOptions, parse_size, planned_scene
from pipelines.report.page import results_html, write_report
from pipelines.report.plots import plot_panel, plots_figure
from sample_videos import Truth, render_clip
from vision.clip.clip import ClipReader
from vision.clip.clip import ClipReader as Recording
from vision.clip.footage import choose_capture_rate
from vision.clip.picture import ClipInfo, GrayImage
from vision.finding.selection import FoundObjects
from vision.overlay import write_overlay
from vision.stages import GivenObjects, candidate_table, detection_table, given_objects
from vision.tracks import Motion, MotionKind

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from matplotlib.axes import Axes
    from numpy.typing import NDArray
    from uncertainties.core import AffineScalarFunc

    from pipelines.api.explained import Verdict
    from pipelines.report.plots import Picture

__all__ = ["CalibratedClip", "Clip", "Measurement", "calibrate", "measure", "render"]


class Measurement(HasQuantities):
    """All results of one clip. Every quantity is also an attribute: ``m.ball_speed``.

    Parameters
    ----------
    record : measuring.measurement.ClipMeasurement
        Result of the measuring chain.
    setup : Setup, optional
        With which it was measured.

    Attributes
    ----------
    quantities : Mapping of str to QuantityView
        In the order of the results table; missing ones carry a reason.
    warnings : tuple of str
        Whole sentences; contradictory inputs and what is assumed come first.
    record : measuring.measurement.ClipMeasurement
        The result itself: tracks in pixels, calibration, fits.
    """

    def __init__(self, record: chain.ClipMeasurement, setup: Setup | None = None) -> None:
        self.record = record
        self._setup = Setup() if setup is None else setup
        super().__init__((*record.quantities, *record.other_speeds), Path(record.info.path).name)
        self.warnings = tuple(map(in_python, record.warnings))
        self._correlated: dict[str, AffineScalarFunc] | None = None

    @property
    def motion(self) -> Motion:
        """Observed motion, with its probability."""
        return self.record.tracks.motion

    @property
    def detections(self) -> "pd.DataFrame":
        """All round objects found, as `vision.detect` returns them."""
        return detection_table(self._found().seen)

    @property
    def tracklets(self) -> "pd.DataFrame":
        """These linked to objects, as `vision.link`; with `probability`, 1 where `measured`."""
        return candidate_table(self._found())

    def _found(self) -> FoundObjects:
        found = self.record.tracks.found
        if found is None:
            raise NotFoundError("nothing was searched in a clip", hint="Measure the clip itself.")
        return found

    @property
    def tracks(self) -> "pd.DataFrame":
        """All tracks, one row per object and frame, with the columns of the track CSV."""
        return tracks_as_frame(self.record)

    def covariance(self, name: str = "ball", *, metres: bool = True) -> "NDArray[np.float64]":
        """Covariances (N, 2, 2) of an object's rows in `tracks`, m² or px²."""
        return track_covariance(self.record, name, metres=metres)

    def to_dict(self) -> dict[str, Any]:
        """JSON document of one clip (contract)."""
        return measurement_as_dict(self.record)

    def to_frame(self) -> "pd.DataFrame":
        """One row with the columns of the CSV of results."""
        import pandas as pd

        return pd.DataFrame([without_formulas(measurement_as_row(self.record))])

    @overload
    def ufloat(self, name: str, /) -> "AffineScalarFunc": ...

    @overload
    def ufloat(self, *names: str) -> "tuple[AffineScalarFunc, ...]": ...

    def ufloat(self, *names: str) -> "AffineScalarFunc | tuple[AffineScalarFunc, ...]":
        """One or several quantities of the package `uncertainties`, with their covariances.

        All quantities of a measurement are correlated as their common sources demand:
        ``speed, before = m.ufloat("ball_speed", "pendulum_speed_before")``; ``speed / before`` has
        the right uncertainty.

        Parameters
        ----------
        *names : str

        Raises
        ------
        MeasurementError
            If there is no value.
        UsageError
            For an unknown name.
        """
        for name in names:
            if name not in self.quantities:
                raise UsageError(
                    f"a measurement has no {name!r}", hint=f"It has {', '.join(self.quantities)}."
                )
            float(self.quantities[name])
        if self._correlated is None:
            self._correlated = correlated(self.quantities, self.record.joint)
        found = tuple(self._correlated[self.quantities[name].name] for name in names)
        return found[0] if len(found) == 1 else found

    @worded_for_python
    def explain(self, *, setup: SetupLike = None, **options: Any) -> "Verdict":
        """Where the tracks and the model disagree, and which physics is missing: `explain`.

        Parameters
        ----------
        setup : Setup or path, optional
            Default: the one of the measurement.
        **options
            As for `explain`.
        """
        from pipelines.api.explained import Verdict, explain
        from pipelines.explain.campaign import explain_campaign
        from pipelines.explain.clips import (
            campaign_from_clips,
            campaign_of_flight,
            has_rig,
            with_rig,
        )

        record = replace(self.record, axes=None)
        tracks, kind = tracks_as_frame(record), record.motion.measured_as
        known = self._setup if setup is None else setup_from(setup)
        if kind is MotionKind.STRIKE:
            # as `vision explain CLIP`: with what the clip's own calibration leaves open
            rig, path = with_rig(known), record.info.path
            struck = campaign_from_clips(
                [path], rig, measure=lambda *_: record, strikes=has_rig(known)
            )
            return Verdict(explain_campaign(struck, rig, **options))
        if record.tracks.pendulum is not None:
            return explain(pendulum=tracks, setup=known, **options)
        if kind not in (MotionKind.FLIGHT, MotionKind.DROP, MotionKind.SWING):
            raise NotFoundError(
                f"there is no model of a {record.motion.kind.noun} to compare the tracks with",
                hint="Strikes, flights, drops, bounces and swings are explained.",
            )
        if known.model == ModelSetup():
            known = replace(known, model=ModelSetup(effects=("gravity",)))
        if kind is not MotionKind.SWING:
            return Verdict(explain_campaign(campaign_of_flight(record, known), known, **options))
        bob = tracks[tracks["object"] == "ball"].assign(object="pendulum")
        if known.pendulum is None:
            known = replace(known, pendulum=bob_pendulum(record, known.ball))
        return explain(pendulum=bob, setup=known, **options)

    @worded_for_python
    def plot(self, ax: "Axes | None" = None, *, panel: str = "path") -> "Picture | Axes":
        """Gap, speeds, path and residuals as a matplotlib figure, or one of them on your axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
        panel : {"gap", "speeds", "path", "residuals"}
            What is drawn on `ax`.

        Raises
        ------
        UsageError
            If there is nothing to draw.
        """
        shown = report_input(self.record, None)
        return plots_figure(shown) if ax is None else plot_panel(shown, ax, panel)

    def overlay(self, path: str | os.PathLike[str]) -> Path:
        """Write a video of the clip with tracks, outlines, grid and landing point."""
        out = Path(path)
        clip = self._film()
        write_overlay(out, clip, self.record.tracks, overlay_marks(self.record))
        return out

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the one-page HTML report."""
        out = Path(path)
        write_report(out, report_input(self.record, self._film()))
        return out

    def _repr_html_(self) -> str:
        still = report_input(self.record, self._clip()).still_png
        return results_html(self._title, self._plain, self.warnings, still)

    def _clip(self) -> ClipReader | None:
        """The clip, if its file still exists."""
        try:
            return self._film()
        except ClipError:
            return None

    def _film(self) -> ClipReader:
        return ClipReader.open(self.record.info.path, every=self.record.info.every)


def _corrected(tracklets: object) -> GivenObjects:
    """A corrected table, or the file of one."""
    if not isinstance(tracklets, str | os.PathLike):
        return given_objects(tracklets)
    # tables of files need pandas
    from pipelines.interop.corrected import read_corrected

    return read_corrected(Path(tracklets))


@worded_for_python
@checked_values
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
    every: int = 1,
    kind: str | None = None,
    tracklets: object = None,
    pivot_at: tuple[float, float] | str | None = None,
    landing_at: tuple[float, float] | str | None = None,
    axes: tuple[float, ...] | str | None = None,
) -> Measurement:
    """Measure one clip.

    Parameters
    ----------
    path : path
        Video file or folder of pictures.
    setup : Setup or path, optional
        Setup of the lab.
    fps : float or str, optional
        Capture rate, 1/s, or text such as "600 fps"; takes precedence over the setup.
    ball : str or float, optional
        A preset ("jokku", "basketball"), or a diameter: "220 mm", or in m.
    wall_grid : str or float, optional
        Side of the wall's grid squares: "50mm", or in m.
    ball_at, mass_at : (x, y) or (x, y, frame), optional
        A point on the ball, or on the pendulum's mass, px.
    cache : bool
        Reuse stages of an earlier measurement of the same clip.
    scale : str or float, optional
        Scale in the plane of motion, if known: "409.9 px/m ± 2 px/m", "2.44 mm/px", or in m/px. The
        wall is then not calibrated.
    every : int
        Read only every n-th picture of a long fast recording; the times stay those of the camera.
    kind : str, optional
        The kind of motion ("drop", "swing", …), where the one found is wrong.
    tracklets : DataFrame or path, optional
        `Measurement.tracklets`, corrected: the rows with 1 in the column `measured` are followed.
    pivot_at : (x, y), optional
        The pendulum's pivot, px, where the fitted one is wrong.
    landing_at : (x, y), optional
        The ball's centre at landing, px, where the one found is wrong or none is found.
    axes : (x, y) or (x, y, degrees), optional
        Origin of the positions in metres, px, and counter-clockwise turn of their x axis.

    Returns
    -------
    Measurement
        Missing quantities carry a reason.

    Raises
    ------
    UsageError
        For invalid options.
    ClipError
        If the clip can't be read.
    NotFoundError
        If nothing moves in it.

    Examples
    --------
    >>> m = iv.measure("a.mp4", setup="lab.toml", wall_grid="50mm", ball="jokku")  # doctest: +SKIP
    >>> m.ball_speed  # doctest: +SKIP
    ball_speed: 5.2012 ± 0.0093 m/s
    """
    options = measure_options(
        *(setup, fps, ball, wall_grid, ball_at, mass_at),
        cache=cache,
        scale=scale,
        every=every,
        kind=kind,
        pivot_at=pivot_at,
        landing_at=landing_at,
        axes=axes,
    )
    if tracklets is not None:
        options = replace(options, corrected=_corrected(tracklets))
    with notebook_progress() as progress:
        return Measurement(measure_clip(Path(path), options, progress), options.known)


class TimedFrame(NamedTuple):
    """A gray frame, (H, W) uint8 or uint16, and its time on the camera's clock, s."""

    image: GrayImage
    time_s: float


class Clip:
    """A recording; iterate over it for frames and times, repeatedly.

    Frames are upright with square pixels; interlaced fields are separated. Nothing is kept in
    memory.

    Parameters
    ----------
    path : path
        Video file or folder of pictures.
    fps : float or str, optional
        Capture rate; default: from the file.

    Attributes
    ----------
    info : ClipInfo
        Size, frames, codec and rates of the file.
    capture_fps : float
        1/s.

    Raises
    ------
    ClipError
        If the file can't be read.

    Examples
    --------
    >>> for image, time_s in iv.Clip("a.mp4", fps=600):  # doctest: +SKIP
    ...     print(time_s, image.mean())
    """

    @checked_values
    def __init__(self, path: str | os.PathLike[str], *, fps: Given | None = None) -> None:
        self._recording = Recording.open(path)
        given = None if fps is None else read_number(fps, measurands.CAPTURE_RATE, "fps")
        self.capture_fps = choose_capture_rate(self._recording.info, given, None).fps

    @classmethod
    def open(cls, path: str | os.PathLike[str], *, fps: Given | None = None) -> "Clip":
        """Same as the constructor."""
        return cls(path, fps=fps)

    @property
    def info(self) -> ClipInfo:
        """Properties of the file."""
        return self._recording.info

    @property
    def warnings(self) -> tuple[str, ...]:
        """Anomalies of the file, including damage found so far."""
        return self._recording.warnings

    @property
    def times(self) -> NDArray[np.float64]:
        """Times (frames,) on the camera's clock, s."""
        return self._recording.capture_times(self.capture_fps)

    def __len__(self) -> int:
        return self.info.frames

    def __iter__(self) -> Iterator[TimedFrame]:
        times = self.times
        for frame in self._recording.frames():
            yield TimedFrame(frame.gray, float(times[frame.index]))

    @checked_values
    def frame(self, index: int) -> TimedFrame:
        """One frame, counted from 0; earlier ones are decoded, too, since seeks are not exact."""
        if not 0 <= index < len(self):
            raise IndexError(f"the clip has frames 0 to {len(self) - 1}, no {index}")
        image = next(iter(self._recording.frames(index, index + 1))).gray
        return TimedFrame(image, float(self.times[index]))

    def __repr__(self) -> str:
        info = self.info
        return (
            f"Clip({str(info.path)!r}: {info.width} × {info.height} px, {info.frames} frames,"
            f" {self.capture_fps:g} fps)"
        )


@worded_for_python
@checked_values
def render(
    path: str | os.PathLike[str],
    *,
    setup: SetupLike = None,
    backswing: Given | QuantityView = "120 deg",
    ball: str | None = None,
    size: str | tuple[int, int] = (432, 240),
    frames: int | None = None,
    seed: int = 1,
    fps: Given | None = None,
    shutter: Given | None = None,
    view: str = "landing",
    noise: str = "good",
    effects: Sequence[str] = (),
    mirrored: bool = False,
) -> Truth:
    """Render the experiment with a virtual camera; write the truth next to the clip.

    Parameters
    ----------
    path : path
        The clip to write: .mp4, or another ending that the codec supports.
    setup : Setup or path, optional
        Where it has no value, that of the paper's experiment is used.
    backswing : str or QuantityView
        Angle with its unit: "90 deg"; or the number ``backswing_deg``.
    ball : str, optional
        A preset, or a ball of the setup.
    size : (width, height) or str
        px, or "432x240".
    frames : int, optional
        Default: until shortly after landing.
    seed : int
        The same seed gives the same clip.
    fps : float or str, optional
        Capture rate, 1/s; default: that of the setup, else 600.
    shutter : float or str, optional
        Exposure time, s, or text such as "1/2000 s".
    view : {"landing", "impact", "oblique"}
    noise : {"none", "low", "good", "high", "dim"}
    effects : sequence of str
        Effects of the catalogue with their values: "magnus:spin=10".
    mirrored : bool
        Strike the ball to the left.

    Returns
    -------
    Truth
        True motion, frame by frame.

    Raises
    ------
    UsageError
        For invalid options.
    """
    if noise not in NOISE:
        raise UsageError(f"noise {noise!r} is not known", hint=f"One of {', '.join(NOISE)}.")
    out = Path(path)
    if not out.absolute().parent.is_dir():
        raise UsageError(
            f"can't write {out}: there is no folder {out.parent}",
            hint="Create the folder first, or name another.",
        )
    text = size if isinstance(size, str) else f"{size[0]}x{size[1]}"
    options = RenderOptions(
        backswing=angle_from("backswing", backswing),
        ball=ball,
        size=parse_size(text),
        frames=frames,
        seed=seed,
        fps=None if fps is None else read_number(fps, measurands.CAPTURE_RATE, "fps"),
        shutter=None if shutter is None else read_number(shutter, measurands.SHUTTER, "shutter"),
        view=view,
        noise=NOISE[noise],
        effects=tuple(effects),
        mirrored=mirrored,
    )
    scene, shot = planned_scene(setup_from(setup), options)
    return render_clip(scene, shot, out)


class CalibratedClip(HasQuantities):
    """A calibrated view: camera, wall, ball plane, and the expected landing distance.

    Parameters
    ----------
    session : Session
        With a wall grid.
    note : str
        What was not found; empty otherwise.

    Attributes
    ----------
    quantities : Mapping of str to QuantityView
        ``camera_distance``, ``ball_plane_offset`` and the expected ``landing_distance``, m.
    calibration : calib.calibration.Calibration
        Camera, lens and planes with their covariance.
    warnings : tuple of str
    """

    def __init__(self, session: Session, note: str = "") -> None:
        outlook = session.outlook
        if outlook.calibration is None:
            raise CalibrationError(outlook.problem)
        self._session = session
        self.calibration: Calibration = outlook.calibration
        self.warnings = tuple(map(in_python, (*((note,) if note else ()), *outlook.warnings)))
        title = f"Calibration of {session.answers.scene.info.path.name}"
        found = [
            self._depth("camera_distance", lambda c: c.camera_distance),
            self._depth("ball_plane_offset", lambda c: c.ball_plane_offset),
        ]
        if outlook.distance is not None:
            found.append(
                Quantity.measured("landing_distance", outlook.distance, "m", outlook.budget)
            )
        super().__init__(found, title)

    def _depth(self, name: str, value: Callable[[Calibration], float]) -> Quantity:
        budget = self.calibration.budget(value)
        return Quantity.measured(name, value(self.calibration), "m", budget)

    @property
    def setup(self) -> Setup:
        """The calibration as a setup for `measure`."""
        answers = self._session.answers
        return read_setup(setup_text(answers, self._session.outlook), folder=answers.out.parent)

    def save(self, path: str | os.PathLike[str]) -> tuple[Path, Path]:
        """Write the setup file, and ``lens.toml`` next to it."""
        out = Path(path)
        self._session.answers = replace(self._session.answers, out=out)
        written = self._session.save()
        # a calibrated view has a wall grid, and with it a lens file
        return written.setup, written.lens or lens_for(out)


@worded_for_python
@checked_values
def calibrate(
    path: str | os.PathLike[str],
    *,
    fps: Given | None = None,
    lens: str | os.PathLike[str] | None = None,
    wall_grid: Given | None = None,
    fine_grid: Given | None = None,
    ball: Given | None = None,
    ball_at: At = None,
    support_height: Given | None = None,
    camera_distance: Given | None = None,
    ball_plane: Given | None = None,
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
    wall_grid, fine_grid : str or float, optional
        Side of a square, and pitch of the fine lines (or "none"): "50mm", or in m.
    ball : str or float, optional
        A preset, or "220 mm, 0.4 kg", or a diameter in m.
    ball_at : (x, y), optional
        The ball at rest, px.
    support_height, camera_distance, ball_plane : str or float, optional
        Height of fall; measured distances from camera to wall and from ball plane to wall:
        "4.00 m ± 5 mm", or in m.

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
        For invalid options.
    """
    rest = point_from("ball_at", ball_at)
    session = session_of(
        Path(path),
        Path("setup.toml"),
        fps=None if fps is None else str(fps),
        lens=None if lens is None else os.fspath(lens),
        wall_grid=length_text(wall_grid),
        fine_grid=length_text(fine_grid),
        ball=length_text(ball),
        ball_at=None if rest is None else f"{rest[0]!r},{rest[1]!r}",
        support_height=length_text(support_height),
        camera_distance=length_text(camera_distance),
        ball_plane=length_text(ball_plane),
    )
    return CalibratedClip(session, find_unattended(session))
