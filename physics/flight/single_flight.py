"""One flight to the floor in bare floats: what an optimiser calls thousands of times."""

from collections.abc import Sequence

from metrology import DomainError
from physics.flight.forces import Acceleration, SpinRate
from physics.flight.march import BallState, runge_kutta_step

__all__ = ["fly_one"]


def fly_one(
    state: BallState,
    forces: Sequence[Acceleration],
    spin_rate: SpinRate | None = None,
    *,
    floor: float = 0.0,
    step: float = 0.02,
    longest: float = 20.0,
) -> tuple[float, BallState]:
    """Fly one ball to the floor with classical fourth-order steps and no arrays.

    Parameters
    ----------
    state : BallState
        At launch, floats.
    forces, spin_rate
        The model.
    floor : float
        Height of the ball's centre at landing, m.
    step : float
        s; 0.02 s keeps flights of balls under a second to 0.1 mm.
    longest : float
        Longest flight followed, s.

    Returns
    -------
    float
        Landing time, s.
    BallState
        At landing.

    Raises
    ------
    DomainError
        If the ball starts below the floor or has not landed within `longest`.
    """
    if state.position[1] < floor:
        raise DomainError("a flight can't start below the floor")
    time = 0.0
    while time < longest:
        after = runge_kutta_step(time, state, step, forces, spin_rate)
        if after.position[1] <= floor and after.velocity[1] < 0.0:
            return _land(time, state, after, step, forces, spin_rate, floor)
        state, time = after, time + step
    raise DomainError(
        f"the ball has not landed after {longest:g} s",
        hint="Is there gravity, and is the wind or lift of a believable size?",
    )


def _land(
    time: float,
    state: BallState,
    after: BallState,
    step: float,
    forces: Sequence[Acceleration],
    spin_rate: SpinRate | None,
    floor: float,
) -> tuple[float, BallState]:
    """Newton's method on the length of the last step."""
    fall = step
    for _ in range(6):
        miss = float(after.position[1]) - floor
        fall -= miss / float(after.velocity[1])
        after = runge_kutta_step(time, state, fall, forces, spin_rate)
        if abs(float(after.position[1]) - floor) < 1e-10:
            break
    return time + fall, after
