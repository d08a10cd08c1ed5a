"""Campaign statistics: restitution laws, precision, outliers, agreement, ranges.

The law of restitution is fitted by `physics.cor_fit`; clips with the same back-swing in the lab
book share a level.

Repeatability and reproducibility follow ISO 5725-2, the agreement of camera and sensor Bland and
Altman (Lancet 327, 307, 1986), outliers the generalised ESD test (Rosner, Technometrics 25, 165,
1983). Ranges of three models are compared with those measured, as in the paper's Table 5.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import t as student

from measuring.setup.file import Setup
from metrology import TooLittleDataError, UsageError
from physics.bodies import Ball, lost_by_pendulum, lost_by_pendulum_approximate
from physics.contact import external_impulse
from physics.cor_fit import CorLawFit, CorPoints, fit_cor_laws, repeated_levels
from physics.forward import Experiment, closed_form_landing, impulsive_launch, numerical_landing
from pipelines.campaign.results import SENSORS, ClipResult, SensorColumn
from pipelines.model import choose_ball, experiment_of

__all__ = [
    "Agreement",
    "BallAnalysis",
    "CampaignAnalysis",
    "Outlier",
    "Precision",
    "SensorAnalysis",
    "agreement",
    "analyse",
    "find_outliers",
    "precision",
]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Precision:
    """Standard deviations as defined by ISO 5725-2, in the unit of the values.

    Attributes
    ----------
    repeatability : float
        s_r, within a session.
    repeatability_low, repeatability_high : float
        95 % interval of s_r.
    between : float or None
        s_L, between sessions; None with one session.
    reproducibility : float or None
        s_R = √(s_r² + s_L²).
    values, sessions : int
        Numbers of values and sessions.
    """

    repeatability: float
    repeatability_low: float
    repeatability_high: float
    between: float | None
    reproducibility: float | None
    values: int
    sessions: int

    @property
    def limit(self) -> float:
        """Repeatability limit r = 2.8 s_r of the difference of two strikes in a session (95 %)."""
        return 1.96 * math.sqrt(2.0) * self.repeatability


def precision(values: FloatArray, session: NDArray[np.int64], fitted: int = 0) -> Precision | None:
    """Precision of `values` (N,); None where no session has two.

    Parameters
    ----------
    values : (N,) array
        Residuals against the law at each impact speed, or values at one level.
    session : (N,) int array
    fitted : int
        Number of the law's parameters, subtracted from the degrees of freedom.
    """
    names, number = np.unique(session, return_counts=True)
    within = len(values) - len(names) - fitted
    if within < 1:
        return None
    means = np.array([values[session == name].mean() for name in names])
    own_mean = means[np.searchsorted(names, session)]
    inner = float(((values - own_mean) ** 2).sum())
    s_r2 = inner / within
    between: float | None = None
    if len(names) > 1:
        grand = values.mean()
        outer = float((number * (means - grand) ** 2).sum()) / (len(names) - 1)
        typical = (len(values) - (number**2).sum() / len(values)) / (len(names) - 1)
        between = float(np.sqrt(max(0.0, (outer - s_r2) / typical)))
    return Precision(
        repeatability=float(np.sqrt(s_r2)),
        repeatability_low=float(np.sqrt(inner / chi2.ppf(0.975, within))),
        repeatability_high=float(np.sqrt(inner / chi2.ppf(0.025, within))),
        between=between,
        reproducibility=None if between is None else float(np.hypot(np.sqrt(s_r2), between)),
        values=len(values),
        sessions=len(names),
    )


@dataclass(frozen=True)
class Agreement:
    """Differences camera − sensor of N pairs, in the unit of both.

    Attributes
    ----------
    bias, bias_std : float
        Mean difference and its standard uncertainty.
    scatter : float
        Standard deviation of the differences.
    lower, upper : float
        95 % limits of agreement.
    limits_std : float
        Standard uncertainty of either limit, √(3/N) standard deviations.
    means, differences : (N,) array
    """

    bias: float
    bias_std: float
    scatter: float
    lower: float
    upper: float
    limits_std: float
    pairs: int
    means: FloatArray
    differences: FloatArray

    @property
    def biased(self) -> bool | None:
        """Whether the bias is significant at 95 %; None with fewer than three pairs."""
        if self.pairs < 3:
            return None
        return bool(abs(self.bias) > student.ppf(0.975, self.pairs - 1) * self.bias_std)


def agreement(camera: FloatArray, sensor: FloatArray) -> Agreement | None:
    """Compare pairs (N,); None with fewer than two."""
    both = np.isfinite(camera) & np.isfinite(sensor)
    camera, sensor = camera[both], sensor[both]
    number = len(camera)
    if number < 2:
        return None
    differences, means = camera - sensor, (camera + sensor) / 2
    bias, scatter = float(differences.mean()), float(differences.std(ddof=1))
    return Agreement(
        bias=bias,
        bias_std=scatter / np.sqrt(number),
        scatter=scatter,
        lower=bias - 1.96 * scatter,
        upper=bias + 1.96 * scatter,
        limits_std=float(np.sqrt(3 / number) * scatter),
        pairs=number,
        means=means,
        differences=differences,
    )


ESD_SIGNIFICANCE = 0.05
"""Probability that a clean set has any outlier named (convention of Rosner 1983)."""

_MAX_OUTLIER_FRACTION = 0.2
"""Fraction: more than a fifth are another population rather than outliers (chosen)."""


@dataclass(frozen=True)
class Outlier:
    """A value named by the test.

    Attributes
    ----------
    index : int
        Index into the values tested.
    distance : float
        Distance from the mean of the other values, in their standard deviations.
    critical : float
        Largest distance allowed by the test.
    """

    index: int
    distance: float
    critical: float


def find_outliers(values: FloatArray) -> tuple[Outlier, ...]:
    """Outliers among `values` (N,), the furthest first; empty with fewer than six values.

    Values are standardised residuals against a law, so that slow and fast strikes are comparable.
    """
    kept = np.flatnonzero(np.isfinite(values))
    number = len(kept)
    if number < 6:
        return ()
    removed: list[Outlier] = []
    named = 0
    for i in range(1, max(1, int(_MAX_OUTLIER_FRACTION * number)) + 1):
        sample = values[kept]
        spread = float(sample.std(ddof=1))
        if spread == 0:
            break
        distances = np.abs(sample - sample.mean()) / spread
        worst = int(distances.argmax())
        critical = _critical(number, i)
        removed.append(Outlier(int(kept[worst]), float(distances[worst]), critical))
        if distances[worst] > critical:
            named = i
        kept = np.delete(kept, worst)
    return tuple(removed[:named])


def _critical(number: int, i: int) -> float:
    left = number - i
    quantile = student.ppf(1 - ESD_SIGNIFICANCE / (2 * (left + 1)), left - 1)
    return float(left * quantile / np.sqrt((left - 1 + quantile**2) * (left + 1)))


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
        """Root mean square of model − measured, m, for each model."""
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
    """Predict the range of each strike.

    Parameters
    ----------
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


IMPACT_SPEED_NAME, COR_NAME = "pendulum_speed_before", "cor"


@dataclass(frozen=True)
class SensorAnalysis:
    """Comparison of the camera with one sensor, over all clips."""

    sensor: SensorColumn
    agreement: Agreement


@dataclass(frozen=True)
class BallAnalysis:
    """Results of the clips of one ball.

    Attributes
    ----------
    clips : tuple of ClipResult
        Clips used that have both impact speed and COR, N of them.
    fits : tuple of CorLawFit
        The most probable law first; empty with too few clips.
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

    def why_outlying(self, item: Outlier) -> str:
        """Reason why a clip is named: distance from the other clips and from the law."""
        stated = abs(self.distances[item.index])
        return (
            f"its restitution is {item.distance:.1f} standard deviations from the other clips;"
            f" {item.critical:.1f} allowed (generalised ESD test:"
            f" {ESD_SIGNIFICANCE:.0%} of clean campaigns name one clip). It is {stated:.1f} stated"
            f" standard uncertainties from the law of {self.ball or 'the ball'}"
        )


@dataclass(frozen=True)
class CampaignAnalysis:
    """The campaign as a whole.

    Attributes
    ----------
    sensors : tuple of SensorAnalysis
        Sensors with at least two pairs.
    """

    balls: tuple[BallAnalysis, ...]
    sensors: tuple[SensorAnalysis, ...]


def analyse(results: Sequence[ClipResult], setup: Setup, ball: str | None) -> CampaignAnalysis:
    """Analyse all clips that were measured and not marked as bad.

    Parameters
    ----------
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
    speed, cor = _column(results, IMPACT_SPEED_NAME)[0], _column(results, COR_NAME)[0]
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
    (speed, speed_std), (cor, std) = _column(clips, IMPACT_SPEED_NAME), _column(clips, COR_NAME)
    shared = _shared(clips)
    own = np.sqrt(np.maximum(std**2 - (shared**2).sum(axis=1), (0.05 * std) ** 2))
    if len(speed) > 2 and np.ptp(speed) > 0:
        # an error of the impact speed changes e through the slope of the law
        slope = float(np.polyfit(speed, cor, 1)[0])
        own = np.hypot(own, slope * speed_std)
    sessions = sorted({clip.session for clip in clips})
    numbers = np.array([sessions.index(clip.session) for clip in clips])
    return CorPoints(speed, cor, own, shared, numbers, _levels(clips))


def _levels(clips: Sequence[ClipResult]) -> NDArray[np.int64] | None:
    """Clips of the same back-swing in the lab book; None without repeats or lab book."""
    given = [None if clip.strike is None else clip.strike.backswing_deg for clip in clips]
    if None in given:
        return None
    return repeated_levels(np.array(given, dtype=np.float64))


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
    """The lab's apparatus with this ball; None if its mass or diameter is missing."""
    try:
        return experiment_of(setup, choose_ball(setup, name or None))
    except UsageError:
        return None


def _ranges(
    results: Sequence[ClipResult], experiment: Experiment | None, fits: Sequence[CorLawFit]
) -> Ranges | None:
    speed, (landed, std) = (
        _column(results, IMPACT_SPEED_NAME)[0],
        _column(results, "landing_distance"),
    )
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
    speed, cor = _column(clips, IMPACT_SPEED_NAME)[0], _column(clips, COR_NAME)[0]
    mass = experiment.pendulum.mass_at_contact
    by_cor = external_impulse(mass, experiment.ball.mass, cor, speed)
    return np.stack([np.asarray(by_cor), measured], axis=1)


def _energy(clips: Sequence[ClipResult], experiment: Experiment | None) -> FloatArray:
    before, after = _column(clips, IMPACT_SPEED_NAME)[0], _column(clips, "pendulum_speed_after")[0]
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
