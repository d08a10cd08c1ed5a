"""Systematic uncertainty: every input moved by itself, everything after it following (GUM 5.1).

What follows are optima, and how an optimum moves with an input is one linear solve (`moved_fit`),
chained from fit to fit. Doing every fit again gives the same at many times the cost, except where a
fit has no smooth optimum; it remains as the check.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from metrology import Contribution, Defaults, MeasurementError, UncertaintySource
from physics.bodies import Pendulum
from pipelines.measure.derived import DERIVED, derived_values
from pipelines.measure.fits.impact import Impact, find_impact, moved_impact
from pipelines.measure.inputs import Inputs
from pipelines.measure.metres import MetricTracks
from vision.clip.footage import CaptureRate

__all__ = ["ClipConditions", "Propagation", "merged", "systematic_budget", "values_after_move"]

FloatArray = NDArray[np.float64]

_STEP_SIGMAS = 0.3
"""Standard deviations of a step: the chain is straight over it, and it is far above rounding."""
_LEAST_AXIS = 1e-12
"""Of the correlation's largest: below lies rounding, not knowledge."""


class Propagation(StrEnum):
    """How what follows from a moved input is found."""

    RESPONSE = "response"
    """To first order, by linear response of every fit."""
    REFIT = "refit"
    """By every fit done anew."""


@dataclass(frozen=True)
class ClipConditions:
    """Everything that may be off for the whole clip at once.

    Attributes
    ----------
    inputs : Inputs
    rate : CaptureRate
    calibration : Calibration or None
        None where the ball's own size is the scale.
    scale : float
        Factor on lengths where there is no calibration.
    roll_rad, slant_rad : float
        How far the camera is turned about its axis, and about the vertical, where there is none.
    metres_per_px : (2,) tuple of float or None
        Scale in the plane of motion that somebody gives, with its standard uncertainty.
    """

    inputs: Inputs
    rate: CaptureRate
    calibration: Calibration | None
    scale: float = 1.0
    roll_rad: float = 0.0
    slant_rad: float = 0.0
    metres_per_px: tuple[float, float] | None = None


def values_after_move(
    impact: Impact,
    tracks: MetricTracks,
    inputs: Inputs,
    propagation: Propagation = Propagation.RESPONSE,
) -> FloatArray:
    """Derived values after inputs moved a little.

    Parameters
    ----------
    impact : Impact
        As fitted before the move.
    tracks : MetricTracks
        The same frames, in metres and seconds after the move.
    inputs : Inputs
        After the move.
    propagation : Propagation

    Returns
    -------
    (Q,) array
        In the order of `DERIVED`; NaN where nothing can be told.
    """
    try:
        if propagation is Propagation.RESPONSE:
            return derived_values(moved_impact(impact, tracks, inputs), inputs)
        times = None
        if impact.contact is not None:
            share = float(tracks.ball_time_s[-1] / impact.tracks.ball_time_s[-1])
            times = (impact.contact.onset_s * share, impact.contact.release_s * share)
        return derived_values(find_impact(tracks, inputs, times), inputs)
    except MeasurementError:
        return np.full(len(DERIVED), np.nan)


def systematic_budget(
    scene: ClipConditions, values: Callable[[ClipConditions], FloatArray], scale_std: float
) -> dict[UncertaintySource, FloatArray]:
    """Contribution of each input to each value.

    Parameters
    ----------
    scene : ClipConditions
        Best estimate.
    values : callable
        Does the chain again for a scene; (Q,).
    scale_std : float
        Relative uncertainty of the scale that somebody gives, or else of the ball's own size as
        one, where there is no calibration.

    Returns
    -------
    dict
        Source to (Q,) one-sigma contributions, NaN where a value is missing.
    """
    base = values(scene)
    table: dict[UncertaintySource, FloatArray] = {}
    for source, moved in _moved(scene, scale_std):
        table[source] = np.abs(values(moved) - base)
    if scene.calibration is not None:
        table |= _by_calibration(
            scene.calibration, base, lambda c: values(replace(scene, calibration=c))
        )
    return table


def _by_calibration(
    calibration: Calibration, base: FloatArray, values: Callable[[Calibration], FloatArray]
) -> dict[UncertaintySource, FloatArray]:
    """Contribution of each source of the calibration, by steps along its principal axes.

    Distance, focal length and depth may each be open by a third while the scale of the ball plane
    is known to a thousandth: only steps that keep to that correlation stay where the chain is
    linear.
    """
    std = np.sqrt(np.maximum(np.diag(calibration.covariance), 0.0))
    free = std > 0
    scaled = calibration.covariance[np.ix_(free, free)] / np.outer(std[free], std[free])
    lengths, axes = np.linalg.eigh(scaled)
    kept = lengths > _LEAST_AXIS
    axes, lengths = axes[:, kept], np.sqrt(lengths[kept])
    slope = np.zeros((len(base), len(lengths)))
    for index, (axis, length) in enumerate(zip(axes.T, lengths, strict=True)):
        step = np.zeros(len(std))
        step[free] = _STEP_SIGMAS * length * std[free] * axis
        slope[:, index] = (
            values(calibration.with_parameters(calibration.vector + step)) - base
        ) / (_STEP_SIGMAS * length)
    table = {}
    for part in calibration.sources:
        share = part.covariance[np.ix_(free, free)] / np.outer(std[free], std[free])
        spread = ((slope @ (axes.T @ share @ axes)) * slope).sum(axis=1)
        table[part.name] = np.sqrt(np.maximum(spread, 0.0))
    return table


def _moved(
    scene: ClipConditions, scale_std: float
) -> list[tuple[UncertaintySource, ClipConditions]]:
    inputs, rate = scene.inputs, scene.rate
    moved: list[tuple[UncertaintySource, ClipConditions]] = []
    if rate.known:
        faster = replace(rate, fps=rate.fps + rate.std)
        moved.append((UncertaintySource.CAPTURE_RATE, replace(scene, rate=faster)))
    rig = inputs.rig
    moved += [
        (source, replace(scene, inputs=replace(inputs, pendulum=body)))
        for source, body in _other_pendulums(inputs)
    ]
    nearer = replace(inputs, arm_share=inputs.arm_share * (1 + Defaults.VISIBLE_DEPTH.std))
    moved.append((UncertaintySource.PENDULUM_ARM, replace(scene, inputs=nearer)))
    ringing = replace(inputs, after_share=inputs.after_share * (1 + Defaults.RINGING.std))
    moved.append((UncertaintySource.PENDULUM_RINGING, replace(scene, inputs=ringing)))
    if inputs.fall is not None and rig.support_height is not None:
        higher = replace(inputs, fall=inputs.fall + rig.support_height.std)
        moved.append((UncertaintySource.SUPPORT_HEIGHT, replace(scene, inputs=higher)))
    if inputs.ball is not None and inputs.ball.mass is not None and rig.ball_mass is not None:
        ball = replace(inputs.ball, mass=inputs.ball.mass + rig.ball_mass.std)
        moved.append(
            (UncertaintySource.BALL_MASS, replace(scene, inputs=replace(inputs, ball=ball)))
        )
    if scene.calibration is None:
        moved.append(
            (UncertaintySource.CAMERA_ROLL, replace(scene, roll_rad=Defaults.CAMERA_ROLL.std))
        )
        moved.append(
            (UncertaintySource.CAMERA_SLANT, replace(scene, slant_rad=Defaults.CAMERA_SLANT.std))
        )
        if np.isfinite(scale_std):
            by_ball = scene.metres_per_px is None
            source = UncertaintySource.BALL_DIAMETER if by_ball else UncertaintySource.SCALE
            moved.append((source, replace(scene, scale=scene.scale * (1 + scale_std))))
    return moved


def _other_pendulums(inputs: Inputs) -> list[tuple[UncertaintySource, Pendulum]]:
    """The pendulum with each of its numbers one standard uncertainty larger.

    Mass and centre of mass only enter the stiffness of the swing, whose uncertainty its fit takes.
    """
    body, rig = inputs.pendulum, inputs.rig
    others = [
        (
            UncertaintySource.PENDULUM_INERTIA,
            replace(body, inertia=body.inertia * (1 + rig.inertia.relative_std)),
        ),
        (
            UncertaintySource.PENDULUM_LENGTH,
            replace(body, length=body.length * (1 + rig.length.relative_std)),
        ),
    ]
    if rig.effective_mass is not None:
        heavier = replace(body, effective_mass=rig.effective_mass.value + rig.effective_mass.std)
        others.append((UncertaintySource.EFFECTIVE_MASS, heavier))
    return others


def merged(
    table: dict[UncertaintySource, FloatArray], index: int, noise: float
) -> tuple[Contribution, ...]:
    """Budget of one value, largest first, from the table and the noise of the tracks."""
    lines = [Contribution(UncertaintySource.TRACK_NOISE, noise)]
    lines += [Contribution(name, float(column[index])) for name, column in table.items()]
    kept = [line for line in lines if np.isfinite(line.std) and line.std > 0]
    return tuple(sorted(kept, key=lambda line: -line.std))
