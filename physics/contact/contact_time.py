"""How long ball and pendulum stay in touch, as a law of the impact speed."""

from dataclasses import dataclass

from physics.arrays import FloatOrArray
from physics.domain import require_positive

__all__ = ["ContactTimeLaw"]


@dataclass(frozen=True)
class ContactTimeLaw:
    """Δt(v) = Δt₀ (v / v₀)^(−(n − 1)/(n + 1)): a spring of force k δⁿ, by dimension analysis.

    With n = 1 (a linear spring) the contact time does not depend on speed, with n = 3/2 (Hertz) it
    falls as v^(−1/5). An inflated shell lies between.

    Attributes
    ----------
    reference_time : float
        Δt₀, s.
    reference_speed : float
        v₀, m/s.
    exponent : float
        n, the power of the compression in the contact force; 1 to 3.
    """

    reference_time: float
    reference_speed: float = 2.5
    exponent: float = 1.34

    def __post_init__(self) -> None:
        require_positive("a contact time", self.reference_time, "s")
        require_positive("the speed of a reference contact time", self.reference_speed, "m/s")
        require_positive("the exponent of the contact force", self.exponent)

    def __call__(self, speed: FloatOrArray) -> FloatOrArray:
        """Contact time in s at impact speed `speed` (m/s), shaped as `speed`."""
        power = -(self.exponent - 1.0) / (self.exponent + 1.0)
        ratio: FloatOrArray = (speed / self.reference_speed) ** power
        return self.reference_time * ratio
