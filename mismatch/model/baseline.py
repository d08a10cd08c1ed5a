"""What the lab believes: bodies, contact, scatter, and the effects its model already holds."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from metrology import Defaults, SetupError
from physics.bodies import GRAVITY, Pendulum
from physics.domain import FloatArray

__all__ = ["BallModel", "Baseline", "ContactTable", "Scatter"]

COLUMNS = (
    "cor",
    "contact_time",
    "pendulum_speed",
    "pendulum_angle",
    "x",
    "y",
    "vx",
    "vy",
)


@dataclass(frozen=True)
class ContactTable:
    """What the baseline expects a contact to do, by impact speed.

    Attributes
    ----------
    impact_speed : (n,) array
        m/s, increasing.
    rows : (n, 8) array
        COR, contact time (s), pendulum speed after (m/s), pendulum angle at release (rad), ball's
        x, y (m; x from its rest position, y from the floor), vx, vy (m/s) at release.
    """

    impact_speed: FloatArray
    rows: FloatArray
    _spline: CubicSpline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.impact_speed.size < 2 or np.any(np.diff(self.impact_speed) <= 0.0):
            raise SetupError(
                "a contact_outcome table needs at least two rows with increasing impact_speed"
            )
        spline = CubicSpline(self.impact_speed, self.rows, axis=0, bc_type="not-a-knot")
        object.__setattr__(self, "_spline", spline)

    def __call__(self, speed: FloatArray) -> FloatArray:
        """Outcome at impact speeds of any shape; a straight line beyond the table's ends.

        Returns
        -------
        (8, ...) array
            The columns first.
        """
        inside = np.clip(speed, self.impact_speed[0], self.impact_speed[-1])
        values = np.asarray(self._spline(inside))
        beyond = np.asarray(speed - inside)[..., None]
        if np.any(beyond != 0.0):
            values = values + beyond * np.asarray(self._spline(inside, 1))
        return np.moveaxis(values, -1, 0)


@dataclass(frozen=True)
class BallModel:
    """A ball as the baseline has it.

    Attributes
    ----------
    name : str
        What the column ``ball`` says.
    mass, diameter : float
        kg, m.
    launch_angle : float or None
        Impact angle past the lowest point, rad.
    table : ContactTable or None
        None where no contact is modelled (free flights).
    """

    name: str
    mass: float
    diameter: float
    launch_angle: float | None = None
    table: ContactTable | None = None


@dataclass(frozen=True)
class Scatter:
    """What repeats imperfectly, one sigma; angles in rad."""

    backswing: float = Defaults.BACKSWING_SCATTER.std
    cor: float = Defaults.COR_SCATTER.std
    launch_angle: float = Defaults.LAUNCH_ANGLE_SCATTER.std
    cor_law: float = Defaults.COR_LAW.std
    launch_angle_law: float = Defaults.LAUNCH_ANGLE_LAW.std
    natural_frequency: float = 0.02
    angle_zero: float = Defaults.ANGLE_ZERO.std


@dataclass(frozen=True)
class Baseline:
    """The model that a campaign is held against.

    Attributes
    ----------
    balls : mapping
        Ball name → body; the entry "" serves trials that name none.
    pendulum : Pendulum or None
        None where only balls fly.
    rest_height : float or None
        Lowest point of the ball at rest above the floor, m.
    air_density, air_viscosity, gravity : float
        kg/m³, Pa s, m/s².
    effects : mapping
        Effect id → parameter values that the model already holds (gravity is always in).
    scatter : Scatter
        Priors of the trial-to-trial differences.
    position_noise, angle_noise : float or None
        A claim, m and rad.
    """

    balls: Mapping[str, BallModel]
    pendulum: Pendulum | None = None
    rest_height: float | None = None
    air_density: float = Defaults.AIR_DENSITY.known
    air_viscosity: float = Defaults.AIR_VISCOSITY.known
    gravity: float = GRAVITY
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    scatter: Scatter = Scatter()
    position_noise: float | None = None
    angle_noise: float | None = None

    def ball(self, name: str | None) -> BallModel:
        """Body of a trial.

        Raises
        ------
        SetupError
            If the setup does not know the ball.
        """
        if name is None or name == "":
            if "" in self.balls:
                return self.balls[""]
            if len(self.balls) == 1:
                return next(iter(self.balls.values()))
        elif name in self.balls:
            return self.balls[name]
        elif "" in self.balls and len(self.balls) == 1:
            return self.balls[""]
        raise SetupError(
            f"the setup does not describe the ball {name!r}",
            hint=f"Add a table [balls.{name}] with mass and diameter; known: "
            + ", ".join(self.balls),
        )
