"""The missing force itself, over time: a smoother on what the baseline leaves over.

The force is a row of overlapping hats in time with a smoothness prior (a Gaussian process cut into
hats); positions are linear in it through the forward model, so its posterior is Gaussian and exact.
"""

from dataclasses import dataclass, replace

import numpy as np

from mismatch.fitting.fit import Fit
from mismatch.fitting.scan import scan
from mismatch.model.candidates import Candidate
from mismatch.model.forward import Forward
from physics.domain import FloatArray, Number, Vector
from physics.effects import Effect, FlightState, Parameter, Phase, SwingState, Values

__all__ = ["LatentForce", "missing_force"]


@dataclass(frozen=True)
class _Hat(Effect):
    """A force (or torque) of hat shape in time (or angle), one of a row."""

    id: str = "hat"
    statement: str = ""
    law: str = ""
    source: str = ""
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (Parameter("strength", "N", 0.01, -1e9, 1e9),)
    form: str = "horizontal"
    middle: float = 0.0
    width: float = 1.0

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Hat in time."""
        shape = np.maximum(0.0, 1.0 - np.abs(flight.time - self.middle) / self.width)
        size = values["strength"] * shape + 0.0 * np.asarray(flight.x)
        nothing = np.zeros_like(size)
        return (size, nothing, nothing) if self.form == "horizontal" else (nothing, size, nothing)


@dataclass(frozen=True)
class _AngleHat(_Hat):
    """A torque of hat shape in the pendulum's angle."""

    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = (Parameter("strength", "N m", 0.02, -1e9, 1e9),)
    form: str = "angle"

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Hat in the angle."""
        shape = np.maximum(0.0, 1.0 - np.abs(swing.phi - self.middle) / self.width)
        return values["strength"] * shape


@dataclass(frozen=True)
class LatentForce:
    """A force over time, or a torque over angle, with its band.

    Attributes
    ----------
    channel : str
        horizontal, vertical or angle.
    place : (n,) array
        s after release, or rad.
    value, std : (n,) array
        N, or N m.
    """

    channel: str
    place: FloatArray
    value: FloatArray
    std: FloatArray


def missing_force(forward: Forward, base: Fit, hats: int = 12) -> tuple[LatentForce, ...]:
    """Posterior of the missing force in flight and of the missing torque in the swing.

    Parameters
    ----------
    forward, base
        The predictor and the refitted baseline.
    hats : int
        How many hats span the flight (or the angles swung through).

    Returns
    -------
    tuple of LatentForce
        One for each direction that was recorded.
    """
    found = []
    if forward.mode != "swing":
        end = float(np.median(forward.flight_time))
        middles = np.linspace(0.0, end, hats)
        both = [
            replace(_Hat(), form=way, middle=float(m), width=end / (hats - 1))
            for way in ("horizontal", "vertical")
            for m in middles
        ]
        found += _posterior(forward, base, both, middles, ("horizontal", "vertical"))
    if forward.records.pendulum_used.any() and forward.mode != "flight":
        angles = forward.records.pendulum_angle[forward.records.pendulum_used]
        middles = np.linspace(float(angles.min()), float(angles.max()), hats)
        width = float(middles[1] - middles[0])
        row = [replace(_AngleHat(), middle=float(m), width=width) for m in middles]
        found += _posterior(forward, base, row, middles, ("angle",))
    return tuple(found)


def _posterior(
    forward: Forward,
    base: Fit,
    hats: list[_Hat] | list[_AngleHat],
    middles: FloatArray,
    channels: tuple[str, ...],
) -> list[LatentForce]:
    scored = scan(forward, base, [Candidate(hat, (), 1) for hat in hats])
    n = middles.size
    # Second differences are penalised; the weight is the one of highest evidence.
    second = np.diff(np.eye(n), n=2, axis=0)
    rough = np.kron(np.eye(len(channels)), second.T @ second)
    ridge = 1e-6 * np.eye(rough.shape[0])
    scale = float(np.median(np.diag(scored.information)))
    best, chosen = -np.inf, (np.zeros(rough.shape[0]), np.eye(rough.shape[0]))
    for weight in scale * np.logspace(-4, 6, 21):
        prior = weight * (rough + ridge)
        posterior = scored.information + prior
        mean = np.linalg.solve(posterior, scored.score)
        evidence = 0.5 * float(scored.score @ mean)
        evidence += 0.5 * float(np.linalg.slogdet(prior)[1] - np.linalg.slogdet(posterior)[1])
        if evidence > best:
            best, chosen = evidence, (mean, np.linalg.inv(posterior))
    mean, covariance = chosen
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return [
        LatentForce(name, middles, mean[k * n : (k + 1) * n], std[k * n : (k + 1) * n])
        for k, name in enumerate(channels)
    ]
