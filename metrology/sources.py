"""Where uncertainty comes from: one name for each input that a budget may list."""

from enum import StrEnum

__all__ = ["UncertaintySource"]


class UncertaintySource(StrEnum):
    """An input whose uncertainty enters a result (GUM 3.3); the value is what is printed.

    Decisions compare members, never the words.
    """

    TRACK_NOISE = "noise of the tracks"
    CAPTURE_RATE = "capture rate"
    RELEASE_INSTANT = "moment of release"
    FRAME_COUNT = "onset and release between frames"
    COR_MEAN = "the estimates together"
    PENDULUM_INERTIA = "inertia of the pendulum"
    PENDULUM_ARM = "depth of the mass' visible side"
    PENDULUM_RINGING = "pendulum just after contact"
    SUPPORT_HEIGHT = "height of the support"
    BALL_MASS = "mass of the ball"
    CAMERA_ROLL = "roll of the camera, no grid to tell"
    CAMERA_SLANT = "slant of the camera, no grid to tell"
    SCALE = "scale of lengths"
    PERSPECTIVE = "depth of the motion's plane"
    DRAG = "drag of the air"
    MODEL = "what the model of the motion leaves out"
    LANDING_SEEN = "landing as seen"
    CONTRADICTION = "contradiction between estimates"

    GRID_LINES = "grid lines"
    GRID_PITCH = "pitch of the grid"
    LENS_UNKNOWN = "lens not known beforehand"
    LENS_CALIBRATION = "lens calibration"
    CAMERA_DISTANCE = "camera distance by tape"
    CAMERA_X = "camera place by tape, x"
    CAMERA_Y = "camera place by tape, y"
    AXIS_FOOT_X = "axis foot by tape, x"
    AXIS_FOOT_Y = "axis foot by tape, y"
    BALL_PLANE_OFFSET = "ball plane offset by tape"
    BALL_DIAMETER = "ball diameter"
    FREE_FALL = "free fall"
    BALL_PLANE_GUESS = "ball plane guessed"
    BALL_CENTRE = "ball in the picture"

    TRIAL_SCATTER = "scatter of the trials"
    COR = "coefficient of restitution"
    LAUNCH_ANGLE = "launch angle"
    CONTACT_TIME = "contact time"
    BACKSWING = "back-swing"
    DISTANCE = "distance"
    IMPACT_SPEED = "impact speed"
    EFFECTIVE_MASS = "effective mass"
    DRAG_COEFFICIENT = "drag coefficient"
    AIR_DENSITY = "air density"
    GRAVITY = "gravity"
    SUPPORT = "support height"
    MASS_OF_BALL = "ball mass"

    @property
    def shared_by_setup(self) -> bool:
        """Whether all clips of one laboratory and one setup file are off by it together.

        What is each clip's own (noise, where the camera was put down for it) averages out over a
        campaign; what is shared does not.
        """
        return self in _SHARED


_SHARED = frozenset(
    {
        UncertaintySource.CAPTURE_RATE,
        UncertaintySource.PENDULUM_INERTIA,
        UncertaintySource.PENDULUM_ARM,
        UncertaintySource.PENDULUM_RINGING,
        UncertaintySource.SUPPORT_HEIGHT,
        UncertaintySource.BALL_MASS,
        UncertaintySource.SCALE,
        UncertaintySource.PERSPECTIVE,
        UncertaintySource.CAMERA_ROLL,
        UncertaintySource.CAMERA_SLANT,
        UncertaintySource.GRID_PITCH,
        UncertaintySource.LENS_UNKNOWN,
        UncertaintySource.LENS_CALIBRATION,
        UncertaintySource.CAMERA_DISTANCE,
        UncertaintySource.CAMERA_X,
        UncertaintySource.CAMERA_Y,
        UncertaintySource.AXIS_FOOT_X,
        UncertaintySource.AXIS_FOOT_Y,
        UncertaintySource.BALL_PLANE_OFFSET,
        UncertaintySource.BALL_PLANE_GUESS,
        UncertaintySource.BALL_DIAMETER,
        UncertaintySource.DRAG_COEFFICIENT,
        UncertaintySource.AIR_DENSITY,
        UncertaintySource.GRAVITY,
        UncertaintySource.SUPPORT,
        UncertaintySource.MASS_OF_BALL,
        UncertaintySource.EFFECTIVE_MASS,
    }
)
