"""One flight to the floor: adaptive integration with an event at landing, in three dimensions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from metrology import DomainError
from physics.arrays import FloatArray
from physics.domain import require_finite, require_positive
from physics.flight.events import Event, Path, follow_until
from physics.flight.forces import Acceleration, SpinRate, total_acceleration

__all__ = ["FlightPath", "fly"]


@dataclass(frozen=True)
class FlightPath:
    """A path from launch (time 0) to landing (last row).

    World frame: x along the wall, y up, z towards the camera.

    Attributes
    ----------
    time : (N,) array
        s.
    position, velocity : (N, 3) array
        Ball's centre, m and m/s.
    spin : (N, 3) array
        rad/s.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    spin: FloatArray

    @property
    def landing_time(self) -> float:
        """Seconds after launch."""
        return float(self.time[-1])

    @property
    def landing_position(self) -> FloatArray:
        """(3,) array, m."""
        return np.asarray(self.position[-1])

    @property
    def landing_velocity(self) -> FloatArray:
        """(3,) array, m/s."""
        return np.asarray(self.velocity[-1])


def fly(
    position: Sequence[float],
    velocity: Sequence[float],
    forces: Sequence[Acceleration],
    *,
    spin: Sequence[float] = (0.0, 0.0, 0.0),
    spin_rate: SpinRate | None = None,
    floor: float = 0.0,
    longest: float = 60.0,
    samples: int = 201,
    tolerance: float = 1e-10,
) -> FlightPath:
    """Fly a ball until its centre comes down to `floor` (steps b to e of the paper).

    Parameters
    ----------
    position, velocity : three floats
        At launch, m and m/s.
    forces : sequence of Acceleration
        Their sum accelerates the ball.
    spin : three floats
        At launch, rad/s, a vector along the axis.
    spin_rate : SpinRate, optional
        Without it the spin is constant.
    floor : float
        Height of the centre at landing, m (the ball's radius where its lowest point touches down).
    longest : float
        Longest flight followed, s.
    samples : int
        Rows of the path.
    tolerance : float
        Relative and absolute tolerance of the solver (DOP853).

    Returns
    -------
    FlightPath

    Raises
    ------
    DomainError
        If the ball starts below the floor or does not land within `longest`.
    """
    start = np.array([*position, *velocity, *spin], dtype=np.float64)
    for name, part in (("position", start[:3]), ("velocity", start[3:6]), ("spin", start[6:])):
        require_finite(f"the {name} at launch", part)
    require_positive("the longest flight", longest, "s")
    if start[1] < floor:
        raise DomainError(f"a flight can't start below the floor ({start[1]:.3f} < {floor:.3f} m)")
    path = _path(start, forces, spin_rate, floor, longest, tolerance)
    time = np.linspace(0.0, path.end, samples)
    states = path.at(time).T
    states[-1] = path.state
    return FlightPath(time, states[:, :3], states[:, 3:6], states[:, 6:])


def _path(
    start: FloatArray,
    forces: Sequence[Acceleration],
    spin_rate: SpinRate | None,
    floor: float,
    longest: float,
    tolerance: float,
) -> Path:
    def rates(time: float, state: FloatArray) -> FloatArray:
        x, y, z, vx, vy, vz, wx, wy, wz = state.tolist()
        place, move, turn = (x, y, z), (vx, vy, vz), (wx, wy, wz)
        gain = total_acceleration(forces, time, place, move, turn)
        slow = spin_rate(time, place, move, turn) if spin_rate is not None else (0.0, 0.0, 0.0)
        return np.array([vx, vy, vz, *gain, *slow])

    def lands(_: float, state: FloatArray) -> float:
        return float(state[1]) - floor

    path = follow_until(
        rates,
        start,
        (0.0, longest),
        [Event(lands, -1.0)],
        method="DOP853",
        relative=max(tolerance, 3e-14),
        absolute=tolerance,
    )
    if path.ended_by is None:
        raise DomainError(
            f"the ball has not landed after {longest:g} s",
            hint="Is there gravity, and is the wind or lift of a believable size?",
        )
    return path
