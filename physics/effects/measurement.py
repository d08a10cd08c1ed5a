"""Measurement errors of clock and camera as effects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from physics.bodies import GRAVITY
from physics.domain import FloatArray, Number, Vector
from physics.effects.base import (
    MIN_SMOOTHING_RATE,
    CameraView,
    Coordinate,
    Effect,
    Extent,
    Form,
    Level,
    Parameter,
    Phase,
    Values,
)

__all__ = [
    "CAMERA_ROTATION",
    "FURTHER_TERM",
    "ORIGIN_SHIFT",
    "OTHER_ROWS",
    "PITCH",
    "PLANE_SLOPE",
    "SLOW_ORDERS",
    "BehindTheBall",
    "CameraRoll",
    "DroppedFrames",
    "LengthScale",
    "LensDistortion",
    "OriginOffset",
    "Parallax",
    "PivotElsewhere",
    "ReadingLag",
    "RollingShutter",
    "TimeBase",
    "WanderingCentre",
    "WanderingMass",
]

ORIGIN_SHIFT = (
    Parameter("shift_x", "m", 0.005, -2.0, 2.0, meaning="of the origin, for a fault about a point"),
    Parameter("shift_y", "m", 0.005, -2.0, 2.0, meaning="of the origin, for a fault about a point"),
)
CAMERA_ROTATION = tuple(
    Parameter(
        f"{axis}_per_distance", "1/m", 0.005, -0.3, 0.3, width=0.03, expected=0.0,
        meaning=f"{axis} of the camera over its distance: five degrees at three metres are 0.03",
    )
    for axis in ("yaw", "pitch")
)  # fmt: skip
PLANE_SLOPE = tuple(
    Parameter(
        f"lean_{way}_per_distance", "1/m", 0.005, -0.3, 0.3, width=0.012, expected=0.0,
        meaning="slope of the ball's plane over the distance: two degrees at three metres",
    )
    for way in ("along", "up")
)  # fmt: skip
PITCH = Parameter("pitch", "rad", 0.005, -0.5, 0.5, meaning="turned about the x axis")
WRONG_RATES = tuple(
    ratio - 1.0
    for n in (1.2, 1.25, 2.0, 3.0, 4.0, 5.0, 8.0, 10.0, 16.0, 20.0, 24.0)
    for ratio in (1.0 / n, n)
)
"""Relative errors from confusing usual rates (convention): 50 for 60, 25 for 30, 30 for 600 fps."""

AXIS_STD = 3.0**-0.5
"""Std of the optical axis from the middle of the trajectories, half widths (derived): uniform
within one half width, for a picture that contains the trajectories and is half filled by them."""
OPTICAL_AXIS = tuple(
    Parameter(
        f"centre_{way}", "1", 0.5, -3.0, 3.0, grid=grid, width=AXIS_STD, expected=0.0,
        meaning=f"optical axis from the middle of the trajectories, {way}, in their half widths",
    )
    for way, grid in (("along", (-0.6, -0.2, 0.2, 0.6)), ("up", (-0.2, 0.1, 0.4)))
)  # fmt: skip

FURTHER_TERM = Parameter(
    "radial_4", "1/m^4", 5e-4, -0.1, 0.1, width=1.2e-3, expected=0.0,
    meaning="second radial term, over the fourth power of the distance: 0.1 at three metres",
)  # fmt: skip

PLUMB = "a plumb line in view"
RULER = "a ruler in the ball's plane, at two places in view"
CLOCK_CURE = "a clock of known rate in view (a blinking LED)"


@dataclass(frozen=True)
class TimeBase(Effect):
    """A capture rate other than stated."""

    id: str = "time_base"
    statement: str = "The camera's frame rate is not what the recording says."
    law: str = r"t = t_{rec} / (1 + \epsilon)"
    source: str = "time stamps as frame count over nominal rate"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "rate_error",
            "1",
            0.003,
            -0.97,
            40.0,
            meaning="true rate over stated, minus one",
            width=0.008,
            outliers=WRONG_RATES,
        ),
    )
    separating: str = CLOCK_CURE
    looseness: float = 0.02
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)
    coordinate: Coordinate = Coordinate.TIME

    def clock(self, values: Values, time: Number) -> Number:
        """Frames came faster by 1 + ε, so the true time is shorter than the counted one."""
        return time / (1.0 + values["rate_error"])


@dataclass(frozen=True)
class LengthScale(Effect):
    """A wrong length scale."""

    id: str = "length_scale"
    statement: str = "The length scale of the recording is wrong."
    law: str = r"\mathbf r_{rec} = (1 + \epsilon)\,\mathbf r"
    source: str = "a calibration ruler misread or out of the ball's plane"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "scale_error",
            "1",
            0.005,
            -0.5,
            1.0,
            meaning="recorded over true, minus one",
            width=0.02,
            outliers=(-0.5, 1.0),
        ),
    )
    form: str = Form.ABOUT_THE_ORIGIN
    separating: str = RULER
    looseness: float = 0.03
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)
    coordinate: Coordinate = Coordinate.PLACE

    def image(self, values: Values, view: CameraView) -> Vector:
        """Stretch about the origin on the floor, the ball's rest position, or any point."""
        error = values["scale_error"]
        if self.form == Form.ABOUT_THE_START:
            return (
                view.x + error * (view.x - view.rest_x),
                view.y + error * (view.y - view.rest_y),
                view.z * (1.0 + error),
            )
        stretch = 1.0 + error
        # A stretch about any point is one about the origin and a shift, which is linear.
        shift_x, shift_y = values.get("shift_x", 0.0), values.get("shift_y", 0.0)
        return view.x * stretch + shift_x, view.y * stretch + shift_y, view.z * stretch


@dataclass(frozen=True)
class CameraRoll(Effect):
    """A camera whose horizontal is not the world's."""

    id: str = "camera_roll"
    statement: str = "The camera is tilted: its horizontal is not the world's."
    law: str = r"\mathbf r_{rec} = R(\alpha)\,\mathbf r"
    source: str = "rotation of the picture about the optical axis"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "roll",
            "rad",
            0.005,
            -0.5,
            0.5,
            meaning="picture turned counter-clockwise",
            width=0.05,
        ),
    )
    form: str = Form.ABOUT_THE_ORIGIN
    separating: str = PLUMB
    looseness: float = 0.03
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)
    axes: int = 2
    coordinate: Coordinate = Coordinate.PLACE

    def image(self, values: Values, view: CameraView) -> Vector:
        """Rotate the picture."""
        if self.form == Form.THREE_AXES:
            roll, pitch = values["roll"], values["pitch"]
            return (
                view.x - roll * view.y,
                view.y + roll * view.x - pitch * view.z,
                view.z + pitch * view.y,
            )
        cosine, sine = np.cos(values["roll"]), np.sin(values["roll"])
        start = self.form == Form.ABOUT_THE_START
        x0, y0 = (view.rest_x, view.rest_y) if start else (0.0, 0.0)
        dx, dy = view.x - x0, view.y - y0
        x, y = x0 + cosine * dx - sine * dy, y0 + sine * dx + cosine * dy
        if self.form not in (Form.ABOUT_A_POINT, Form.PERSPECTIVE):
            return x, y, view.z
        # A rotation about any point is one about the origin and a shift, which is linear.
        x, y = x + values["shift_x"], y + values["shift_y"]
        if self.form == Form.ABOUT_A_POINT:
            return x, y, view.z
        across, up = x - view.centre_x, y - view.centre_y
        nearer = values["yaw_per_distance"] * across + values["pitch_per_distance"] * up
        return x + nearer * across, y + nearer * up, view.z

    def angle(self, values: Values, view: CameraView) -> Number:
        """The pendulum's angle rotates with the picture, unless it was read relative to it."""
        if self.form in (Form.BALL_ONLY, Form.ABOUT_THE_START, Form.ABOUT_A_POINT):
            return view.phi
        return view.phi + values["roll"]


def _off_axis(values: Values, view: CameraView) -> tuple[Number, Number]:
    """Distance of the ball from the optical axis, m."""
    x0 = view.centre_x + values["centre_along"] * view.half_width
    y0 = view.centre_y + values["centre_up"] * view.half_width
    return view.x - x0, view.y - y0


@dataclass(frozen=True)
class Parallax(Effect):
    """A ball that flies in another plane than that of the scale."""

    id: str = "parallax"
    statement: str = "The ball flies in another plane than the scale was made for (parallax)."
    law: str = r"\mathbf r_{rec} = \mathbf r + k\,(\mathbf r - \mathbf r_{foot})"
    source: str = "Fig. 9 of the paper: enlargement D/(D − d) about the foot of the optical axis"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "plane_error",
            "1",
            0.005,
            -0.5,
            0.5,
            meaning="relative error of the distance",
            width=0.05,
        ),
        *OPTICAL_AXIS,
    )
    separating: str = RULER
    looseness: float = 0.05
    axes: int = 2
    planar: bool = True
    coordinate: Coordinate = Coordinate.PLACE

    def image(self, values: Values, view: CameraView) -> Vector:
        """Stretch about the foot of the optical axis, by the plane's relative distance."""
        k = values["plane_error"]
        if self.form == Form.LEANING:
            along, up = view.x - view.centre_x, view.y - view.centre_y
            k = k + values["lean_along_per_distance"] * along
            k = k + values["lean_up_per_distance"] * up
        dx, dy = _off_axis(values, view)
        return view.x + k * dx, view.y + k * dy, view.z


@dataclass(frozen=True)
class LensDistortion(Effect):
    """A lens that bends straight lines."""

    id: str = "lens_distortion"
    statement: str = "The lens distorts: what is far from the picture's centre is displaced."
    law: str = (
        r"\mathbf r_{rec} = \mathbf c + (\mathbf r - \mathbf c)(1 + k |\mathbf r - \mathbf c|^2)"
    )
    source: str = "Brown, Photogramm. Eng. 37, 855 (1971), first radial term"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter("radial", "1/m^2", 0.005, -0.3, 0.3, meaning="positive: pincushion"),
        *OPTICAL_AXIS,
    )
    separating: str = "a picture of a grid with this lens"
    looseness: float = 0.15
    axes: int = 2
    planar: bool = True
    coordinate: Coordinate = Coordinate.PLACE

    def image(self, values: Values, view: CameraView) -> Vector:
        """Radial displacement with the cube of the distance from the axis."""
        dx, dy = _off_axis(values, view)
        square = np.square(dx) + np.square(dy)
        k = values["radial"] * square
        if self.form == Form.TWO_TERMS:
            k = k + values["radial_4"] * np.square(square)
        return view.x + k * dx, view.y + k * dy, view.z


OTHER_ROWS = Parameter(
    "pendulum_delay", "s", 2e-4, -0.02, 0.02, width=2e-3,
    meaning="how much later the rows of the pendulum are read than those of the resting ball",
)  # fmt: skip


@dataclass(frozen=True)
class RollingShutter(Effect):
    """Picture rows read one after the other."""

    id: str = "rolling_shutter"
    statement: str = "The picture's rows are read one after the other (rolling shutter)."
    law: str = r"t = t_{frame} + \kappa\,(y_0 - y)"
    source: str = "row-wise read-out of CMOS sensors"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter("delay", "s/m", 0.002, -0.2, 0.2, meaning="later per metre downward"),
    )
    separating: str = "a flash of light in view, or the same flight with the camera upside down"
    looseness: float = 0.02
    axes: int = 2
    planar: bool = True
    coordinate: Coordinate = Coordinate.PLACE

    def image(self, values: Values, view: CameraView) -> Vector:
        """Position of the ball when its row is read (first order in the delay)."""
        late = values["delay"] * (view.rest_y - view.y)
        return view.x + view.vx * late, view.y + view.vy * late, view.z + view.vz * late

    def angle(self, values: Values, view: CameraView) -> Number:
        """Angle of the pendulum when its rows are read, unless it was timed separately."""
        if self.form == Form.BALL_ONLY:
            return view.phi
        late = values.get("pendulum_delay", 0.0)
        late = late - values["delay"] * view.length * (1.0 - np.cos(view.phi))
        return view.phi + view.omega * late


@dataclass(frozen=True)
class OriginOffset(Effect):
    """A wrong origin."""

    id: str = "origin_offset"
    statement: str = "The origin of the recorded positions is off."
    law: str = r"\mathbf r_{rec} = \mathbf r + \mathbf d"
    source: str = "a misread zero of the wall scale"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter("offset_x", "m", 0.005, -2.0, 2.0, meaning="along the wall"),
        Parameter("offset_y", "m", 0.005, -2.0, 2.0, meaning="upward"),
    )
    separating: str = "the ball at rest in view together with the wall scale"
    looseness: float = 0.0
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)

    def image(self, values: Values, view: CameraView) -> Vector:
        """Shift."""
        return view.x + values["offset_x"], view.y + values["offset_y"], view.z


@dataclass(frozen=True)
class PivotElsewhere(Effect):
    """A pendulum angle read about another point than its axis."""

    id: str = "pivot_elsewhere"
    statement: str = "The pendulum's angle was read about another point than its axis."
    law: str = r"\varphi_{rec} = \varphi - (d_x \cos\varphi + d_y \sin\varphi) / L"
    source: str = "an axis fitted to the arc of the mass"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter("pivot_x", "m", 0.005, -0.2, 0.2, meaning="forward"),
        Parameter("pivot_y", "m", 0.005, -0.2, 0.2, meaning="up"),
    )
    separating: str = "the axis itself in view"
    looseness: float = 0.0
    sharp: bool = False

    def angle(self, values: Values, view: CameraView) -> Number:
        """Direction of the mass from the wrong point."""
        across = values["pivot_x"] * np.cos(view.phi) + values["pivot_y"] * np.sin(view.phi)
        return view.phi - across / view.length


@dataclass(frozen=True)
class ReadingLag(Effect):
    """An angle that lags by a constant in either direction: play, or encoder steps."""

    id: str = "reading_lag"
    statement: str = "The angle shown follows the pendulum with play."
    law: str = r"\varphi_{rec} = \varphi - h\,\mathrm{sign}\,\dot\varphi"
    source: str = (
        "an encoder counted at one edge of each step shows the step that it left, in both"
        " directions: half a step late"
    )
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter("lag", "rad", 1e-3, -0.1, 0.1, meaning="half of the play"),
    )
    separating: str = "the same angle approached slowly from either side"
    looseness: float = 0.0
    sharp: bool = False

    def angle(self, values: Values, view: CameraView) -> Number:
        """Late; at turning points, until the weight has moved it through the play."""
        fallen = (
            2.0 * GRAVITY / view.length * np.abs(np.sin(view.phi)) * 2.0 * np.abs(values["lag"])
        )
        return view.phi - values["lag"] * np.tanh(
            view.omega / np.sqrt(fallen + MIN_SMOOTHING_RATE**2)
        )


SLOW_ORDERS = (2, 3, 4)
"""Legendre orders of a slowly varying error of the centre (chosen): lower orders are a shift and a
stretch, effects of their own; higher ones are correlated noise."""
FINE_ORDERS = tuple(range(5, 13))
"""Orders of the error from objects on the wall (chosen): near the ends of a flight of two metres
the last ones resolve some centimetres."""
SLOW_TURNS = (2, 3)
"""Harmonics of the pendulum's angle in the illumination of a body (chosen): orders 0 and 1 are zero
and axis."""


def _of_orders(orders: Sequence[int]) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{way}_{n}", "m", 1e-3, -0.1, 0.1, meaning="of the ball's centre")
        for way in ("along", "up")
        for n in orders
    )


@dataclass(frozen=True)
class WanderingCentre(Effect):
    """Slowly varying error of a ball's centre from shading, occlusion and background."""

    id: str = "wandering_centre"
    statement: str = "The centre wanders about where the ball is, with light and what is hidden."
    law: str = r"\mathbf r_{rec} = \mathbf r + \sum_n \mathbf a_n P_n(x)"
    source: str = "outlines of shaded bodies, partly hidden"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = _of_orders(SLOW_ORDERS)
    looseness: float = 0.0
    sharp: bool = False
    orders: tuple[int, ...] = SLOW_ORDERS

    def image(self, values: Values, view: CameraView) -> Vector:
        """The ball's centre with a polynomial error along its trajectory."""
        place = np.clip((view.x - view.centre_x) / view.half_width, -1.2, 1.2)
        x, y = view.x, view.y
        for n in self.orders:
            shape = legendre.legval(place, np.eye(n + 1)[n])
            x, y = x + values[f"along_{n}"] * shape, y + values[f"up_{n}"] * shape
        return x, y, view.z


@dataclass(frozen=True)
class BehindTheBall(WanderingCentre):
    """Error of the centre from the wall behind it, equal for every ball that passes."""

    id: str = "behind_the_ball"
    statement: str = "What is behind the ball's outline draws its centre, alike in all trials."
    parameters: tuple[Parameter, ...] = _of_orders(FINE_ORDERS)
    orders: tuple[int, ...] = FINE_ORDERS


@dataclass(frozen=True)
class WanderingMass(Effect):
    """Slowly varying error of the pendulum mass's position, likewise."""

    id: str = "wandering_mass"
    statement: str = "The mass wanders about where it is, with light and what is hidden."
    law: str = r"\varphi_{rec} = \varphi + \sum_n a_n \cos n\varphi + b_n \sin n\varphi"
    source: str = "outlines of shaded bodies, partly hidden"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = tuple(
        Parameter(f"{way}_{n}", "rad", 3e-3, -0.3, 0.3, meaning="of the pendulum's angle")
        for way in ("cosine", "sine")
        for n in SLOW_TURNS
    )
    looseness: float = 0.0
    sharp: bool = False

    def angle(self, values: Values, view: CameraView) -> Number:
        """The mass with harmonic errors of its angle."""
        phi = view.phi
        for n in SLOW_TURNS:
            phi = phi + values[f"cosine_{n}"] * np.cos(n * view.phi)
            phi = phi + values[f"sine_{n}"] * np.sin(n * view.phi)
        return phi


@dataclass(frozen=True)
class DroppedFrames(Effect):
    """Dropped frames that the time stamps do not show."""

    id: str = "dropped_frames"
    statement: str = "Frames are missing from the recording, so its clock falls behind."
    law: str = r"t = t_{rec} + \delta\,\Theta(t_{rec} - t_d)"
    source: str = "time stamps as frame count over nominal rate"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = (
        Parameter("gap", "s", 0.002, -0.005, 0.5, meaning="time lost from the recording"),
        Parameter(
            "instant",
            "s",
            1.0 / 36.0,
            -1e4,
            1e4,
            grid=tuple(float(v) for v in np.linspace(0, 1, 36)),
            meaning="after contact onset, on the recording's clock",
            over=Extent.RECORD_TIME,
        ),
    )
    separating: str = CLOCK_CURE
    looseness: float = 0.05
    coordinate: Coordinate = Coordinate.TIME

    def clock(self, values: Values, time: Number) -> Number:
        """One step."""
        after: FloatArray = np.asarray(time, dtype=np.float64) - values["instant"]
        lost = (
            100.0 * np.maximum(after, 0.0)
            if self.form == Form.STEADILY
            else np.heaviside(after, 0.0)
        )
        return time + values["gap"] * lost
