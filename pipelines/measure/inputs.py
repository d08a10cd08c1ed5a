"""What the chain starts from besides the pictures: setup file, options and presets, merged."""

import math
from dataclasses import dataclass

import numpy as np

from metrology import UsageError, parse_quantity
from physics import bodies
from physics.flight.air import Air
from pipelines.setup.file import BallSetup, Setup, ball_from_option

__all__ = ["Inputs", "gather_inputs"]

DIAMETER_SHARE = 0.002
"""Standard uncertainty of a ball's diameter over the diameter (a tape around the girth)."""
HEIGHT_STD_M = 0.001
GRAVITY_STD = 0.01
DRAG_COEFFICIENT, DRAG_STD = 0.45, 0.1
SPIN_STD = 4.0
"""rad/s: what friction at the face gives a ball struck off the side; nobody sees it in the clip."""
STIFFNESS_SHARE = 0.02


@dataclass(frozen=True)
class Inputs:
    """Known before looking, SI; what is None was not said and has no preset.

    Attributes
    ----------
    setup : Setup
        As read.
    ball : BallSetup or None
        The ball struck.
    pendulum : Pendulum
        The lab's, or the paper's where nothing was said.
    fall : float or None
        How far the ball falls from rest to landing (height of the support), m.
    air : Air
    gravity : float
        m/s².
    grid_pitch, fine_pitch : float
        m.
    assumed : tuple of str
        What was taken from the paper because nobody said otherwise.
    arm_share : float
        Factor on the pendulum's arm: its visible side is nearer to the camera than the ball plane.
    after_share : float
        Factor on the pendulum's rate after contact, while the bar rings and the ball is in the way.
    """

    setup: Setup
    ball: BallSetup | None
    pendulum: bodies.Pendulum
    fall: float | None
    air: Air
    gravity: float
    grid_pitch: float
    fine_pitch: float
    assumed: tuple[str, ...]
    arm_share: float = 1.0
    after_share: float = 1.0

    @property
    def pendulum_stiffness(self) -> float:
        """Ω² = m g d / I of the free swing, 1/s²."""
        body = self.pendulum
        return body.mass * self.gravity * body.com / body.inertia

    @property
    def drag_per_metre(self) -> tuple[float, float]:
        """K = ρ S C_D / 2 m with its std, 1/m; a guess where the mass is unknown."""
        if self.ball is None or self.ball.mass is None:
            return 0.02, 0.02
        area = math.pi * self.ball.diameter**2 / 4
        per_coefficient = 0.5 * self.air.density * area / self.ball.mass
        return DRAG_COEFFICIENT * per_coefficient, DRAG_STD * per_coefficient

    @property
    def lift_std(self) -> float:
        """Lift per speed that an unseen slow spin may cause, 1/s: ½ ρ S R ω / m."""
        if self.ball is None or self.ball.mass is None:
            return 0.02
        radius = self.ball.diameter / 2
        area = math.pi * radius**2
        return 0.5 * self.air.density * area * radius * SPIN_STD / self.ball.mass


def gather_inputs(setup: Setup, ball: str | None, wall_grid: str | None) -> Inputs:
    """Merge setup file and options; an option wins.

    Raises
    ------
    UsageError
        If an option is no quantity, preset or pitch.
    """
    chosen = ball_from_option(ball) if ball is not None else setup.ball
    if chosen is None and len(setup.balls) == 1:
        chosen = next(iter(setup.balls.values()))
    pitch = setup.wall.grid or 0.05
    if wall_grid is not None:
        pitch = parse_quantity(wall_grid, "m")
        if not 0.001 <= pitch <= 2.0:
            raise UsageError(
                f"--wall-grid {wall_grid} would be squares of {pitch:g} m",
                hint="Give the side of a square with its unit, such as 50mm.",
            )
    assumed = []
    pendulum = setup.pendulum
    if pendulum is None:
        pendulum = bodies.PAPER_PENDULUM
        assumed.append("inertia and mass of the pendulum are the paper's (Table 2)")
    fall = None if setup.support is None else setup.support.height
    if fall is None and chosen is not None and chosen.name in bodies.BALLS:
        fall = bodies.PAPER_SUPPORT.height
        assumed.append("the support is as high as the paper's (0.312 m)")
    return Inputs(
        setup=setup,
        ball=chosen,
        pendulum=pendulum,
        fall=fall,
        air=setup.air,
        gravity=float(np.float64(bodies.GRAVITY)),
        grid_pitch=pitch,
        fine_pitch=setup.wall.fine_grid or pitch / 5,
        assumed=tuple(assumed),
    )
