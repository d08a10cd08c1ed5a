"""Result of one clip: quantities, checks, warnings, and the tracks as a table."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.grid import WallGrid
from measuring.budget import JointCovariance
from measuring.checker.scene import Finding
from measuring.checks import Check
from measuring.impact import Impact
from measuring.inputs import QUANTITY_UNITS, Assumption
from measuring.metres import PlaneMapping
from measuring.setup.file import BallSetup, RigNumber
from metrology import NotFoundError, Quantity
from physics.bodies import Pendulum
from vision.clip.footage import CaptureRate
from vision.clip.picture import ClipInfo
from vision.pendulum.arc import Arc, fit_arc
from vision.tracks import Motion, MotionKind, Track, Tracks

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "QUANTITY_UNITS",
    "TRACK_COLUMNS",
    "Axes",
    "ClipMeasurement",
    "alternative_kinds",
    "bob_pendulum",
    "in_metres",
    "motion_warning",
    "on_axes",
    "steady_px",
    "swing_arc",
    "track_covariance",
    "tracks_as_csv",
    "tracks_as_frame",
]


FloatArray = NDArray[np.float64]

_CONFIDENT_PROBABILITY = 0.95
"""Probability of the motion kind below which a warning is given (convention: the level of stated
intervals)."""

_MIN_LISTED_PROBABILITY = 0.01
"""Minimum probability of an alternative motion kind to be listed (chosen)."""


def alternative_kinds(motion: Motion) -> str:
    """Other possible motion kinds with their probabilities; empty if there are none."""
    alternatives = [
        (kind, probability)
        for kind, probability in motion.alternatives
        if probability > _MIN_LISTED_PROBABILITY
    ]
    return ", ".join(f"{kind.value} {probability:.2f}" for kind, probability in alternatives)


def motion_warning(motion: Motion) -> tuple[str, ...]:
    """Warning if the motion kind is uncertain; empty otherwise."""
    if motion.kind is MotionKind.NONE and motion.is_doubtful:
        why = " ".join(motion.reasons)
        cure = "If another object is meant, point at it with --ball-at X,Y"
        return (f"the kind of motion is open. {why} {cure}, or pass more of the recording.",)
    if motion.kind is MotionKind.NONE or motion.measured_probability >= _CONFIDENT_PROBABILITY:
        return ()
    kind, left = motion.kind.noun, alternative_kinds(motion)
    alternatives = f" (alternatives: {left})" if left else ""
    said = f"the motion is a {kind} with a probability of only {motion.probability:.2f}"
    cure = "Show more of the motion, or point at the ball with another --ball-at"
    if motion.is_doubtful:
        why = "its quantities are not given, since they would more probably be wrong than right"
        return (f"{said}{alternatives}: {why}. {cure}; or state --kind {motion.kind.value}.",)
    return (f"{said}{alternatives}: its quantities hold only if it is a {kind}. {cure}.",)


@dataclass(frozen=True)
class Axes:
    """Axes of positions, placed in the picture.

    Attributes
    ----------
    x_px, y_px : float
        Origin.
    turn_deg : float
        Counter-clockwise turn of the x axis from the rows of the picture, degrees.
    """

    x_px: float
    y_px: float
    turn_deg: float = 0.0

    @property
    def turn(self) -> FloatArray:
        """Rotation (2, 2) of positions and displacements in rows, y up."""
        turn = np.radians(self.turn_deg)
        return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])


@dataclass(frozen=True)
class ClipMeasurement:
    """All results of one clip.

    Attributes
    ----------
    quantities : tuple of Quantity
        In the order of `QUANTITY_UNITS`; missing ones carry a reason.
    other_speeds : tuple of Quantity
        The ball's speed by the paper's methods: per frame (Fig. 18), from the pendulum (Eq. 7).
    gravity : Quantity
        Free-fall acceleration of the flight, the check of rate and scale.
    tracks : Tracks
        In pixels.
    grid : WallGrid or None
        Lines of the wall, if they gave a calibration.
    calibration : Calibration or None
        None if no grid was found.
    impact : Impact or None
        None if no strike was measured.
    defaults : tuple of RigNumber
        Properties of the apparatus whose value or uncertainty is a default.
    findings : tuple of Finding
        Inputs that contradict each other, each with cause and cure; they lead the warnings.
    assumed : tuple of Assumption
        What is assumed since it was not given; the sentences are among the warnings.
    joint : JointCovariance or None
        Covariance of the known quantities.
    plane : PlaneMapping or None
        Pixels to metres in the plane of motion; None without a scale.
    axes : Axes or None
        Where a person placed the axes of positions in metres.
    """

    info: ClipInfo
    rate: CaptureRate
    quantities: tuple[Quantity, ...]
    other_speeds: tuple[Quantity, ...]
    gravity: Quantity
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    tracks: Tracks
    grid: WallGrid | None
    calibration: Calibration | None
    impact: Impact | None
    defaults: tuple[RigNumber, ...] = ()
    findings: tuple[Finding, ...] = ()
    assumed: tuple[Assumption, ...] = ()
    joint: JointCovariance | None = None
    plane: PlaneMapping | None = None
    axes: Axes | None = None

    @property
    def motion(self) -> Motion:
        """Observed motion."""
        return self.tracks.motion

    def quantity(self, name: str) -> Quantity:
        """The quantity of that name."""
        return next(item for item in self.quantities if item.name == name)


BALL, PENDULUM = "ball", "pendulum"
"""Objects of a track table, as in its files."""

Metric = tuple[FloatArray, FloatArray]
"""Positions (N, 2), x right along the wall and y up, m; and their covariances (N, 2, 2), m²."""

TRACK_COLUMNS = (
    "frame", "t_s", "object", "x_px", "y_px", "x_px_std", "y_px_std",
    "x_m", "y_m", "x_m_std", "y_m_std", "radius_px", "phi_rad", "phi_rad_std", "phi_zero_std",
)  # fmt: skip

CAMERA_COLUMNS = ("camera_x_px", "camera_y_px")
"""Columns of a hand-held camera's clip: by how much the picture is shifted in a frame, px."""

_HALF_PX = 0.5


def tracks_as_frame(measured: ClipMeasurement) -> "pd.DataFrame":
    """All tracks, one row per object and frame; the columns are `TRACK_COLUMNS`.

    `x_px` and `y_px` are the place in the frame with its bars. Of a hand-held camera
    `CAMERA_COLUMNS` follow, which `steady_px` takes away; the metres are of the steady scene.

    `x_m` is to the right along the wall, `y_m` up, unless axes were placed; `phi_rad` is 0 at the
    lowest point of the swing, positive towards the ball. Empty where no scale, or no angle, is
    known. The standard uncertainties of a row are random and slowly varying errors; errors common
    to a clip (scale, ball plane) are in the budgets of the quantities; `phi_zero_std` is the common
    error of all angles.
    """
    import pandas as pd

    parts = []
    for name, track in _objects(measured).items():
        part = _rows(name, track, in_metres(measured, name, track))
        if name == PENDULUM:
            part["phi_rad"], part["phi_rad_std"] = _angles(measured)
            assert measured.tracks.pendulum is not None
            part["phi_zero_std"] = measured.tracks.pendulum.zero_std_rad
        elif name == BALL and (arc := swing_arc(measured)) is not None:
            part["phi_rad"], part["phi_rad_std"], part["phi_zero_std"] = _about(arc, track)
        parts.append(part)
    kept = [part for part in parts if len(part)] or parts[:1]
    table = pd.concat(kept, ignore_index=True).reindex(columns=list(TRACK_COLUMNS))
    table = table.astype(dict.fromkeys(("phi_rad", "phi_rad_std", "phi_zero_std"), float))
    shift = measured.tracks.shift_px
    if shift is not None:
        for axis, name in enumerate(CAMERA_COLUMNS):
            table[name] = shift[table["frame"].to_numpy(np.int64), axis]
            table[TRACK_COLUMNS[3 + axis]] += table[name]
    table[["x_px", "y_px"]] += np.array(measured.info.bars[:2])
    return table


def steady_px(table: "pd.DataFrame") -> FloatArray:
    """Places of a track table as a camera that stands still sees them (N, 2), px."""
    place = table[["x_px", "y_px"]].to_numpy(np.float64)
    if set(CAMERA_COLUMNS) <= set(table.columns):
        place = place - table[list(CAMERA_COLUMNS)].to_numpy(np.float64)
    return place


def tracks_as_csv(measured: ClipMeasurement) -> str:
    """Track CSV of the contract."""
    # eight digits: 0.01 px in a 4K picture, finer than any track
    return tracks_as_frame(measured).to_csv(index=False, lineterminator="\n", float_format="%.8g")


def track_covariance(measured: ClipMeasurement, name: str, *, metres: bool = True) -> FloatArray:
    """Covariances (N, 2, 2) of an object's rows in `tracks_as_frame`, m² or px².

    Raises
    ------
    NotFoundError
        If there is no such object, or no scale for metres.
    """
    objects = _objects(measured)
    if name not in objects:
        raise NotFoundError(
            f"there is no track of {name}", hint=f"There are: {', '.join(objects)}."
        )
    if not metres:
        return objects[name].covariance_px2
    metric = in_metres(measured, name, objects[name])
    if metric is None:
        raise NotFoundError(
            f"no scale is known for {name}", hint="For its covariance in px² pass metres=False."
        )
    return metric[1]


def _objects(measured: ClipMeasurement) -> dict[str, Track]:
    tracks = measured.tracks
    named = {BALL: tracks.ball}
    if tracks.pendulum is not None:
        named[PENDULUM] = tracks.pendulum.track
    return named | {f"ball_{k}": other.track for k, other in enumerate(tracks.others, start=2)}


def in_metres(measured: ClipMeasurement, name: str, track: Track) -> Metric | None:
    """Positions and covariances, by the camera, the ball's size or the given scale."""
    mapping = measured.plane
    if mapping is None:
        return None
    if name == PENDULUM:
        place = mapping.point(track.centre_px)
        spread = _covariance_in_metres(mapping.point, track)
    else:
        place, spread = mapping.ball(track.centre_px, track.covariance_px2)
    if measured.axes is None:
        return place, spread
    turn = measured.axes.turn
    return on_axes(measured, place), turn.T @ spread @ turn


def on_axes(measured: ClipMeasurement, place: FloatArray) -> FloatArray:
    """Positions (N, 2) of the plane of motion on the axes that were placed, m."""
    if measured.axes is None or measured.plane is None:
        return place
    origin = measured.plane.point(np.array([measured.axes.x_px, measured.axes.y_px]))
    return np.asarray((place - origin) @ measured.axes.turn)


def _covariance_in_metres(point: Callable[[FloatArray], FloatArray], track: Track) -> FloatArray:
    """Covariances in metres by the local scale."""
    steps = _HALF_PX * np.eye(2)
    slope = np.stack(
        [point(track.centre_px + step) - point(track.centre_px - step) for step in steps], axis=-1
    )
    return np.asarray(slope @ track.covariance_px2 @ np.swapaxes(slope, -1, -2))


def _angles(measured: ClipMeasurement) -> tuple[FloatArray, FloatArray]:
    """The pendulum's angle and its standard uncertainty, rad."""
    pendulum = measured.tracks.pendulum
    assert pendulum is not None
    if measured.impact is not None and len(measured.impact.tracks.swing_rad):
        metric = measured.impact.tracks
        return metric.swing_rad, metric.swing_std_rad
    return pendulum.angle_rad, pendulum.angle_std_rad


def swing_arc(measured: ClipMeasurement) -> Arc | None:
    """Circle on which a bob swings; None for other motions, and where it is a line."""
    if measured.motion.measured_as is not MotionKind.SWING:
        return None
    return fit_arc(measured.tracks.ball.centre_px)


def bob_pendulum(measured: ClipMeasurement, ball: BallSetup | None) -> Pendulum:
    """A bob on a light cord, as long as its circle.

    Raises
    ------
    NotFoundError
        If the path is no arc, or no scale is known.
    """
    arc = swing_arc(measured)
    if arc is None or measured.plane is None:
        missing = "scale is known" if arc is not None else "arc is seen"
        raise NotFoundError(
            f"no {missing}, so the length of the pendulum is unknown",
            hint="Give --wall-grid, --ball or --scale, or [pendulum] in the setup file.",
        )
    ends = measured.plane.point(arc.centre_px + np.array([[0.0, 0.0], [0.0, arc.radius_px]]))
    length = float(np.hypot(*(ends[1] - ends[0])))
    mass = 1.0 if ball is None or ball.mass is None else ball.mass
    radius = 0.0 if ball is None else 0.5 * ball.diameter
    return Pendulum(length, mass * (length**2 + 0.4 * radius**2), mass, length)


def _about(arc: Arc, track: Track) -> tuple[FloatArray, FloatArray, float]:
    """Angles of a bob about its circle's centre, their std and their common std, rad."""
    offset = track.centre_px - arc.centre_px
    angle = np.arctan2(offset[:, 0], offset[:, 1])
    across = np.column_stack([np.cos(angle), -np.sin(angle)])
    variance = np.einsum("ni,nij,nj->n", across, track.covariance_px2, across)
    common = math.sqrt(float(arc.covariance[0, 0])) / arc.radius_px
    return np.unwrap(angle), np.sqrt(variance) / arc.radius_px, common


def _rows(name: str, track: Track, metric: Metric | None) -> "pd.DataFrame":
    import pandas as pd

    std = np.sqrt(np.diagonal(track.covariance_px2, axis1=1, axis2=2))
    position = std_m = np.full((len(track), 2), np.nan)
    if metric is not None:
        position, std_m = metric[0], np.sqrt(np.diagonal(metric[1], axis1=1, axis2=2))
    return pd.DataFrame(
        {
            "frame": track.frame,
            "t_s": track.time_s,
            "object": name,
            "x_px": track.centre_px[:, 0],
            "y_px": track.centre_px[:, 1],
            "x_px_std": std[:, 0],
            "y_px_std": std[:, 1],
            "x_m": position[:, 0],
            "y_m": position[:, 1],
            "x_m_std": std_m[:, 0],
            "y_m_std": std_m[:, 1],
            "radius_px": track.radius_px,
        }
    )
