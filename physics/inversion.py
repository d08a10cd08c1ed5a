"""The coefficient of restitution from the landing distance: Eq. 17 as the implicit law it is."""

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from metrology import Contribution, DomainError, Quantity, UncertaintySource
from physics.air import Air
from physics.bodies import GRAVITY, Ball, Pendulum, Support
from physics.contact import cor_from_ball_speed
from physics.domain import FloatArray, Number, require_non_negative, require_positive
from physics.flight import drag_free_distance
from physics.restitution import require_cor

__all__ = [
    "RangeInputs",
    "cor_from_range",
    "impact_speed_from_range",
    "monte_carlo_cor",
    "propagate_cor",
    "sensitivities",
]


@dataclass(frozen=True)
class RangeInputs:
    """All that Eq. 17 takes; each a float, or an array over trials or Monte-Carlo draws.

    Attributes
    ----------
    distance : float or array
        x of the ball's centre at landing from rest, m.
    impact_speed : float or array
        v_M⁰, m/s.
    contact_time : float or array
        Δt, s.
    launch_angle : float or array
        θ, rad.
    support_height : float or array
        h_s, m.
    ball_mass, effective_mass : float or array
        m_B and M_E, kg.
    ball_diameter : float or array
        m.
    drag_coefficient : float or array
    air_density : float or array
        kg/m³.
    gravity : float or array
        m/s².
    """

    distance: Number
    impact_speed: Number
    contact_time: Number
    launch_angle: Number
    support_height: Number
    ball_mass: Number
    effective_mass: Number
    ball_diameter: Number
    drag_coefficient: Number
    air_density: Number
    gravity: Number = GRAVITY

    @classmethod
    def of(
        cls,
        pendulum: Pendulum,
        ball: Ball,
        support: Support,
        air: Air,
        *,
        distance: Number,
        impact_speed: Number,
        contact_time: Number,
        drag_coefficient: Number,
        gravity: float = GRAVITY,
    ) -> Self:
        """Gather the inputs from bodies and what was measured."""
        return cls(
            distance,
            impact_speed,
            contact_time,
            ball.launch_angle,
            support.height,
            ball.mass,
            pendulum.mass_at_contact,
            ball.diameter,
            drag_coefficient,
            air.density,
            gravity,
        )

    @property
    def drag_constant(self) -> Number:
        """K = ρ S C_D / (2 m), 1/m."""
        area = 0.25 * np.pi * self.ball_diameter**2
        return 0.5 * self.air_density * area * self.drag_coefficient / self.ball_mass


def _check_inputs(inputs: RangeInputs) -> None:
    for name in ("distance", "impact_speed", "ball_mass", "effective_mass", "ball_diameter"):
        require_positive(f"the {name.replace('_', ' ')}", getattr(inputs, name))
    for name in ("contact_time", "support_height", "drag_coefficient", "air_density"):
        require_non_negative(f"the {name.replace('_', ' ')}", getattr(inputs, name))
    require_positive("gravity", inputs.gravity, "m/s^2")


def _ball_speed(inputs: RangeInputs, carried: Number) -> Number:
    """Speed that lands the ball at the distance, if contact carried it by `carried` along θ (m)."""
    cosine, sine = np.cos(inputs.launch_angle), np.sin(inputs.launch_angle)
    flown = drag_free_distance(inputs.distance - carried * cosine, inputs.drag_constant)
    fall = inputs.support_height + carried * sine + flown * sine / cosine
    if np.any(np.asarray(fall) <= 0.0) or np.any(np.asarray(flown) <= 0.0):
        raise DomainError(
            "no ball launched at this angle lands at this distance",
            hint="Check the distance, the support height and the launch angle.",
        )
    speed: Number = flown / cosine * (inputs.gravity / (2.0 * fall)) ** 0.5
    return speed


def cor_from_range(inputs: RangeInputs) -> Number:
    """Coefficient of restitution from where the ball landed (Eq. 17).

    v_M^avg on the right of Eq. 17 depends on e through v_M; the equation is iterated to a fixed
    point, which the small share of the contact in the whole path makes a strong contraction.

    Parameters
    ----------
    inputs : RangeInputs

    Returns
    -------
    float or array
        e. Not limited to (0, 1]: measured distances may say otherwise.

    Raises
    ------
    DomainError
        For inputs outside their domain or a distance that no launch at θ reaches.
    """
    _check_inputs(inputs)
    mean_speed: Number = inputs.impact_speed
    before: Number = np.inf
    ball_speed: Number = 0.0
    for _ in range(60):
        ball_speed = _ball_speed(inputs, mean_speed * inputs.contact_time)
        after = inputs.impact_speed - inputs.ball_mass * ball_speed / inputs.effective_mass
        mean_speed = 0.5 * (inputs.impact_speed + after)
        moved = float(np.max(np.abs(ball_speed - before)))
        if moved < 1e-13 * float(np.max(np.abs(ball_speed))):
            break
        before = ball_speed
    else:
        raise DomainError(
            "Eq. 17 has no fixed point for these inputs",
            hint="Is the contact time in seconds? It should be some hundredths.",
        )
    return cor_from_ball_speed(
        inputs.effective_mass, inputs.ball_mass, inputs.impact_speed, ball_speed
    )


def impact_speed_from_range(inputs: RangeInputs, cor: Number) -> Number:
    """Eq. 22 (with its exponent put right): the impact speed that lands the ball at the distance.

    Parameters
    ----------
    inputs : RangeInputs
        `impact_speed` is only the first guess.
    cor : float or array
        e, known.

    Returns
    -------
    float or array
        v_M⁰, m/s.

    Raises
    ------
    DomainError
        As `cor_from_range`; and for e outside (0, 1].
    """
    _check_inputs(inputs)
    require_cor(cor)
    share = inputs.effective_mass * (1.0 + cor) / (inputs.effective_mass + inputs.ball_mass)
    kept = 1.0 - 0.5 * inputs.ball_mass * share / inputs.effective_mass
    speed: Number = inputs.impact_speed
    for _ in range(60):
        before = speed
        speed = _ball_speed(inputs, kept * speed * inputs.contact_time) / share
        if float(np.max(np.abs(speed - before))) < 1e-13 * float(np.max(np.abs(speed))):
            return speed
    raise DomainError("Eq. 22 has no fixed point for these inputs")


def sensitivities(inputs: RangeInputs, step: float = 1e-5) -> dict[str, float]:
    """∂e/∂(input) of every input at a point, by central differences.

    Parameters
    ----------
    inputs : RangeInputs
        Floats.
    step : float
        Relative step.

    Returns
    -------
    dict of str to float
        By field name; per unit of the input.
    """
    result = {}
    for name in (f.name for f in fields(inputs)):
        centre = float(getattr(inputs, name))
        delta = step * abs(centre) if centre else step
        low, high = max(centre - delta, 0.0), centre + delta
        pair = np.asarray(cor_from_range(replace(inputs, **{name: np.array([low, high])})))
        result[name] = float((pair[1] - pair[0]) / (high - low))
    return result


def propagate_cor(inputs: RangeInputs, stds: dict[str, float]) -> Quantity:
    """E with its uncertainty by linear propagation, one budget line per input (GUM, 5.1.2).

    Parameters
    ----------
    inputs : RangeInputs
        Floats.
    stds : dict of str to float
        Standard uncertainty by field name, in the field's unit; what is absent is taken as exact.

    Returns
    -------
    Quantity
        ``cor_range``.

    Raises
    ------
    DomainError
        For a name that is no input.
    """
    names = {f.name for f in fields(inputs)}
    if unknown := set(stds) - names:
        raise DomainError(f"{sorted(unknown)} are no inputs of Eq. 17; they are {sorted(names)}")
    slopes = sensitivities(inputs)
    budget = tuple(
        Contribution(UncertaintySource(name.replace("_", " ")), abs(slopes[name]) * std)
        for name, std in stds.items()
    )
    return Quantity.measured("cor_range", float(cor_from_range(inputs)), "1", budget)


def monte_carlo_cor(
    inputs: RangeInputs, stds: dict[str, float], *, draws: int = 10_000, seed: int = 1
) -> FloatArray:
    """Draws of e with every input normally distributed (GUM supplement 1).

    Parameters
    ----------
    inputs : RangeInputs
        Floats.
    stds : dict of str to float
        As in `propagate_cor`.
    draws : int
    seed : int

    Returns
    -------
    (draws,) array
    """
    generator = np.random.default_rng(seed)
    drawn = {
        name: generator.normal(float(getattr(inputs, name)), std, draws)
        for name, std in stds.items()
    }
    return np.array(np.broadcast_to(cor_from_range(replace(inputs, **drawn)), (draws,)))
