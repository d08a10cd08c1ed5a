"""The paper's analysis of each ball of a campaign.

Ranges by three models from each strike's impact speed, against those measured (Table 5).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError, UsageError
from physics.bodies import Ball, lost_by_pendulum, lost_by_pendulum_approximate
from physics.contact.impact import external_impulse
from physics.forward import Experiment, closed_form_landing, impulsive_launch, numerical_landing
from pipelines.campaign.analysis.cor_law import CorLawFit, CorPoints, fit_cor_laws
from pipelines.campaign.analysis.precision import (
    Agreement,
    Outlier,
    Precision,
    agreement,
    find_outliers,
    precision,
)
from pipelines.campaign.lab_book import SENSORS, SensorColumn
from pipelines.campaign.results import ClipResult
from pipelines.model.options import choose_ball, experiment_of
from pipelines.setup.file import Setup

__all__ = ["BallAnalysis", "CampaignAnalysis", "SensorAnalysis", "analyse"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Ranges:
    """Landing distances of N strikes, m.

    Attributes
    ----------
    speed : (N,) array
        Impact speed, m/s.
    measured, measured_std : (N,) array
    numerical : (N,) array
        The paper's steps a to e with drag in both directions and the fitted law.
    variable : (N,) array
        Eqs 13 to 16 with the fitted law.
    constant : (N,) array
        Eqs 13 to 16 with the law's value at rest, as the paper's "constant".
    """

    speed: FloatArray
    measured: FloatArray
    measured_std: FloatArray
    numerical: FloatArray
    variable: FloatArray
    constant: FloatArray

    def rms(self) -> dict[str, float]:
        """Root mean square of model less measured, m, for each model."""
        return {
            name: float(np.sqrt(np.nanmean((getattr(self, name) - self.measured) ** 2)))
            for name in ("numerical", "variable", "constant")
        }


def ranges(
    experiment: Experiment,
    cor: Callable[[FloatArray], FloatArray],
    speed: FloatArray,
    measured: FloatArray,
    measured_std: FloatArray,
) -> Ranges:
    """Foretell the range of each strike.

    Parameters
    ----------
    experiment : Experiment
    cor : callable
        Fitted law: impact speed (m/s) to e.
    speed, measured, measured_std : (N,) array
        m/s and m.
    """
    ball: Ball = experiment.ball
    at_rest = np.full_like(speed, float(cor(np.zeros(1))[0]))
    values = np.clip(cor(speed), 1e-3, 1.0)
    at_rest = np.clip(at_rest, 1e-3, 1.0)
    time = np.asarray(ball.contact_time(speed))
    launch = impulsive_launch(experiment, speed, values, time)
    constant = impulsive_launch(experiment, speed, at_rest, time)
    return Ranges(
        speed,
        measured,
        measured_std,
        np.asarray(numerical_landing(experiment, launch).distance),
        np.asarray(closed_form_landing(experiment, launch).distance),
        np.asarray(closed_form_landing(experiment, constant).distance),
    )


SPEED, COR = "pendulum_speed_before", "cor"


@dataclass(frozen=True)
class SensorAnalysis:
    """Camera against one sensor, over all clips."""

    sensor: SensorColumn
    agreement: Agreement


@dataclass(frozen=True)
class BallAnalysis:
    """What the clips of one ball say together.

    Attributes
    ----------
    ball : str
    clips : tuple of ClipResult
        Used and with both impact speed and COR, N of them.
    points : CorPoints or None
    fits : tuple of CorLawFit
        The likeliest law first; empty with too few clips.
    why_no_law : str or None
    outliers : tuple of Outlier
        Indices into `clips`.
    distances : (N,) array
        Standardised residuals against the law.
    precision : Precision or None
        Of the COR's residuals, within and between sessions.
    ranges : Ranges or None
        Of the clips with a landing, where the ball's mass and diameter are known.
    impulse : (N, 2) array
        External impulse by Eq. 8 from the pendulum's speeds, and as measured, N s.
    energy_loss : (N, 2) array
        The pendulum's, exact and by the paper's Eq. 20, J.
    """

    ball: str
    clips: tuple[ClipResult, ...]
    points: CorPoints | None
    fits: tuple[CorLawFit, ...]
    why_no_law: str | None
    outliers: tuple[Outlier, ...]
    distances: FloatArray
    precision: Precision | None
    ranges: Ranges | None
    impulse: FloatArray
    energy_loss: FloatArray


@dataclass(frozen=True)
class CampaignAnalysis:
    """The campaign as a whole.

    Attributes
    ----------
    balls : tuple of BallAnalysis
    sensors : tuple of SensorAnalysis
        Those with two pairs at least.
    """

    balls: tuple[BallAnalysis, ...]
    sensors: tuple[SensorAnalysis, ...]


def analyse(results: Sequence[ClipResult], setup: Setup, ball: str | None) -> CampaignAnalysis:
    """Analyse what was measured; clips marked as bad are left out.

    Parameters
    ----------
    results : sequence of ClipResult
    setup : Setup
    ball : str or None
        Ball of the clips for which the lab book names none.
    """
    used = [result for result in results if result.used]
    names = sorted({result.ball or ball or "" for result in used})
    return CampaignAnalysis(
        tuple(
            _ball(name, [one for one in used if (one.ball or ball or "") == name], setup)
            for name in names
        ),
        tuple(_sensors(used)),
    )


def _column(results: Sequence[ClipResult], name: str) -> tuple[FloatArray, FloatArray]:
    pairs = np.array([result.quantity(name) for result in results]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _ball(name: str, results: Sequence[ClipResult], setup: Setup) -> BallAnalysis:
    speed, cor = _column(results, SPEED)[0], _column(results, COR)[0]
    clips = tuple(
        result
        for result, whole in zip(results, np.isfinite(speed) & np.isfinite(cor), strict=True)
        if whole
    )
    points = _points(clips) if clips else None
    fits: tuple[CorLawFit, ...] = ()
    why = "no clip of this ball gave both impact speed and restitution"
    if points is not None:
        try:
            fits = fit_cor_laws(points)
        except TooLittleDataError as problem:
            why = problem.in_one_line
    distances = _distances(points, fits) if points is not None and fits else np.zeros(0)
    experiment = _experiment(name, setup)
    parameters = 0 if not fits else len(fits[0].parameters)
    return BallAnalysis(
        ball=name,
        clips=clips,
        points=points,
        fits=fits,
        why_no_law=None if fits else why,
        outliers=find_outliers(distances),
        distances=distances,
        precision=None
        if points is None or not fits
        else precision(_residuals(points, fits[0]), points.session, parameters),
        ranges=_ranges(results, experiment, fits),
        impulse=_impulse(clips, experiment),
        energy_loss=_energy(clips, experiment),
    )


def _points(clips: Sequence[ClipResult]) -> CorPoints:
    (speed, speed_std), (cor, std) = _column(clips, SPEED), _column(clips, COR)
    shared = _shared(clips)
    own = np.sqrt(np.maximum(std**2 - (shared**2).sum(axis=1), (0.05 * std) ** 2))
    if len(speed) > 2 and np.ptp(speed) > 0:
        # an error of the impact speed acts through the slope, where the law is not flat
        slope = float(np.polyfit(speed, cor, 1)[0])
        own = np.hypot(own, slope * speed_std)
    sessions = sorted({clip.session for clip in clips})
    numbers = np.array([sessions.index(clip.session) for clip in clips])
    return CorPoints(speed, cor, own, shared, numbers)


def _shared(clips: Sequence[ClipResult]) -> FloatArray:
    lines = [clip.shared for clip in clips]
    sources = sorted({source for line in lines for source in line})
    return np.array([[line.get(source, 0.0) for source in sources] for line in lines]).reshape(
        len(clips), len(sources)
    )


def _residuals(points: CorPoints, fit: CorLawFit) -> FloatArray:
    return np.array([e - fit.at(v).value for v, e in zip(points.speed, points.cor, strict=True)])


def _distances(points: CorPoints, fits: Sequence[CorLawFit]) -> FloatArray:
    scatter = fits[0].strike_scatter.value
    return _residuals(points, fits[0]) / np.hypot(points.std, scatter)


def _experiment(name: str, setup: Setup) -> Experiment | None:
    """The lab's apparatus with this ball; None where its mass or diameter is not known."""
    try:
        return experiment_of(setup, choose_ball(setup, name or None))
    except UsageError:
        return None


def _ranges(
    results: Sequence[ClipResult], experiment: Experiment | None, fits: Sequence[CorLawFit]
) -> Ranges | None:
    speed, (landed, std) = _column(results, SPEED)[0], _column(results, "landing_distance")
    whole = np.isfinite(speed) & np.isfinite(landed)
    if experiment is None or not fits or not whole.any():
        return None

    def cor(at: FloatArray) -> FloatArray:
        return np.array([fits[0].at(float(v)).value for v in at])

    return ranges(experiment, cor, speed[whole], landed[whole], std[whole])


def _impulse(clips: Sequence[ClipResult], experiment: Experiment | None) -> FloatArray:
    measured = _column(clips, "external_impulse")[0]
    if experiment is None:
        return np.stack([np.full_like(measured, np.nan), measured], axis=1)
    speed, cor = _column(clips, SPEED)[0], _column(clips, COR)[0]
    mass = experiment.pendulum.mass_at_contact
    by_cor = external_impulse(mass, experiment.ball.mass, cor, speed)
    return np.stack([np.asarray(by_cor), measured], axis=1)


def _energy(clips: Sequence[ClipResult], experiment: Experiment | None) -> FloatArray:
    before, after = _column(clips, SPEED)[0], _column(clips, "pendulum_speed_after")[0]
    if experiment is None:
        return np.full((len(clips), 2), np.nan)
    impulse = _column(clips, "external_impulse")[0]
    pendulum = experiment.pendulum
    return np.stack(
        [
            np.asarray(lost_by_pendulum(pendulum, before, after)),
            np.asarray(lost_by_pendulum_approximate(pendulum, before, impulse)),
        ],
        axis=1,
    )


def _sensors(results: Sequence[ClipResult]) -> list[SensorAnalysis]:
    found = []
    for sensor in SENSORS:
        camera = _column(results, sensor.quantity)[0]
        read = [None if one.strike is None else one.strike.sensor(sensor) for one in results]
        values = np.array([np.nan if pair is None else pair[0] for pair in read])
        compared = agreement(camera, values)
        if compared is not None:
            found.append(SensorAnalysis(sensor, compared))
    return found


def by_clip(results: Sequence[ClipResult]) -> Mapping[str, ClipResult]:
    """Results by the clip's name."""
    return {result.clip: result for result in results}
