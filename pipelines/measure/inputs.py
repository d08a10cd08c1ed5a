"""What the chain starts from besides the pictures: setup file, options and presets, merged."""

import math
from dataclasses import dataclass, replace

from metrology import measurands, read_given
from physics import bodies
from physics.flight.air import Air
from pipelines.setup.file import BallSetup, Setup, ball_from_option
from pipelines.setup.rig import Origin, Rig, rig_of

__all__ = ["Inputs", "gather_inputs"]

UNKNOWN_DRAG = 0.02
"""1/m, value and std of ½ρSC_D/m for a ball of unknown mass: 0.018 to 0.02 for the paper's balls,
0.02 to 0.05 for lighter ones."""
UNKNOWN_LIFT_STD = 0.02
"""1/s, lift per speed of such a ball at the spin that is supposed: 0.02 for the paper's balls."""


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
    rig : Rig
        Every number of the rig with its uncertainty, and which of them are defaults.
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
    rig: Rig
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
            return UNKNOWN_DRAG, UNKNOWN_DRAG
        area = math.pi * self.ball.diameter**2 / 4
        per_coefficient = 0.5 * self.air.density * area / self.ball.mass
        drag = self.rig.drag_coefficient
        std = math.hypot(drag.std, drag.value * self.rig.air_density.relative_std)
        return drag.value * per_coefficient, std * per_coefficient

    @property
    def lift_std(self) -> float:
        """Lift per speed that an unseen slow spin may cause, 1/s: ½ ρ S R ω / m."""
        if self.ball is None or self.ball.mass is None:
            return UNKNOWN_LIFT_STD
        radius = self.ball.diameter / 2
        area = math.pi * radius**2
        return 0.5 * self.air.density * area * radius * self.rig.spin.std / self.ball.mass


def gather_inputs(setup: Setup, ball: str | None, wall_grid: str | None) -> Inputs:
    """Merge setup file and options; an option wins.

    Raises
    ------
    UsageError
        If an option is no quantity, preset or pitch, or out of range.
    """
    chosen = setup.ball
    if ball is not None:
        chosen = setup.balls.get(ball) or ball_from_option(ball)
    if chosen is None and len(setup.balls) == 1:
        chosen = next(iter(setup.balls.values()))
    if wall_grid is not None:
        squares = read_given(wall_grid, measurands.GRID_PITCH, "--wall-grid")
        wall = replace(setup.wall, grid=squares.value, grid_std=squares.std)
        setup = replace(setup, wall=wall)
    rig = rig_of(setup, chosen)
    pitch = rig.grid_pitch.value
    assumed = []
    pendulum = setup.pendulum
    if pendulum is None:
        pendulum = bodies.PAPER_PENDULUM
        assumed.append("inertia and mass of the pendulum are the paper's (Table 2)")
    fall = None if rig.support_height is None else rig.support_height.value
    if rig.support_height is not None and rig.support_height.value_from is Origin.PRESET:
        assumed.append("the support is as high as the paper's (0.312 m)")
    return Inputs(
        setup=setup,
        ball=chosen,
        pendulum=pendulum,
        fall=fall,
        air=setup.air,
        gravity=rig.gravity.value,
        grid_pitch=pitch,
        fine_pitch=setup.wall.fine_grid or pitch / 5,
        rig=rig,
        assumed=tuple(assumed),
    )
