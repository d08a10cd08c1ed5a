"""Parameters of a batch of shots: bodies, nuisances, concealed effects.

No code is shared with the package under test, so that the proof is independent.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Shots", "concatenate", "repeat", "take"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shots:
    """A batch of shots; every field has shape (n,), SI, angles in rad.

    x right from the ball's centre at rest, y up from the floor, angles from the lowest point.
    """

    # bodies
    mass: Array
    radius: Array
    contact_angle: Array
    stiffness: Array
    force_exponent: Array
    length: Array
    inertia: Array
    pendulum_mass: Array
    com: Array
    face_offset: Array
    support_height: Array
    gravity: Array
    density: Array
    # restitution law a*exp(b*v + c) + d, then slope*(v - 2.5)
    cor_a: Array
    cor_b: Array
    cor_c: Array
    cor_d: Array
    # trial-to-trial variation
    backswing: Array
    cor_extra: Array
    tilt_extra: Array
    # air
    drag_coefficient: Array
    crisis_drop: Array
    crisis_speed: Array
    spin: Array
    spin_decay_rate: Array
    wind: Array
    buoyancy: Array
    wake_lift: Array
    # contact
    cor_slope: Array
    arm_error: Array
    off_centre: Array
    support_friction: Array
    contact_stretch: Array
    pivot_loss: Array
    shared_loss: Array
    support_loss: Array
    support_kick: Array
    # swing
    dry_torque: Array
    viscous_torque: Array
    quadratic_torque: Array
    # forces in no catalogue
    power_force: Array
    power: Array
    magnet_force: Array
    magnet_x: Array
    magnet_y: Array
    magnet_width: Array
    gust_force: Array
    gust_start: Array
    gust_length: Array
    ground_force: Array
    ground_height: Array
    notch_torque: Array
    notch_angle: Array
    notch_width: Array

    def __len__(self) -> int:
        return len(self.mass)


def concatenate(parts: list[Shots]) -> Shots:
    """All shots of `parts`, in order."""
    return Shots(
        **{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Shots)}
    )


def take(shots: Shots, index: NDArray[np.intp]) -> Shots:
    """The shots at `index`."""
    return replace(shots, **{f.name: getattr(shots, f.name)[index] for f in fields(Shots)})


def repeat(shots: Shots, times: int) -> Shots:
    """`times` copies, one whole set after the other."""
    return concatenate([shots] * times)
