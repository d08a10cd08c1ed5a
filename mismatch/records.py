"""Lay campaigns out in even arrays, one row per trial, and estimate their noise.

A campaign holds what was recorded, in metres, radians and seconds; a baseline holds what the
laboratory states. Noise is estimated from what local polynomials leave over short stretches: its
white part, its correlation, and outliers.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, TypedDict

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, irfft, next_fast_len, rfft
from scipy.optimize import minimize
from scipy.special import chdtri, fdtrc

from metrology import Defaults, SetupError, TooLittleDataError, UsageError
from physics.bodies import GRAVITY, Pendulum
from physics.domain import FloatArray
from physics.effects import Effect, Level

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

__all__ = [
    "BallModel",
    "Baseline",
    "CampaignRecords",
    "ContactTable",
    "Noise",
    "Records",
    "Scatter",
    "Trial",
    "estimate_noise",
    "fit_spectrum",
    "lay_out",
    "settings_of",
    "shared_deviance",
    "slow_cosines",
    "slow_noise",
    "whiteness",
    "with_clock_jitter",
]

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
    _spline: "CubicSpline" = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.impact_speed.size < 2 or np.any(np.diff(self.impact_speed) <= 0.0):
            raise SetupError(
                "a contact_outcome table needs at least two rows with increasing impact_speed",
                hint="Give two impact speeds or more, the lowest first.",
            )
        from scipy.interpolate import CubicSpline

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
    unmeasured : frozenset of str
        Ids among them whose values nobody stated: defaults, of which neither size nor presence is
        known.
    scatter : Scatter
        Priors of the trial-to-trial differences.
    position_noise, angle_noise : float or None
        A claim, m and rad.
    instruments : tuple of Effect
        Faults that the instrument may have in each trial anew, and in all alike: each parameter as
        far as its width says.
    assumed : frozenset of str
        Ids among them that nothing has measured: the setup takes them to be none.
    """

    balls: Mapping[str, BallModel]
    pendulum: Pendulum | None = None
    rest_height: float | None = None
    air_density: float = Defaults.AIR_DENSITY.known
    air_viscosity: float = Defaults.AIR_VISCOSITY.known
    gravity: float = GRAVITY
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    unmeasured: frozenset[str] = frozenset()
    scatter: Scatter = Scatter()
    position_noise: float | None = None
    angle_noise: float | None = None
    instruments: tuple[Effect, ...] = ()
    assumed: frozenset[str] = frozenset()

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


@dataclass(frozen=True)
class Trial:
    """One recorded shot, drop, flight or swing. Every trial has a clock of its own.

    Attributes
    ----------
    name : str
        What the column ``trial`` says.
    ball_time : (n,) array
        s, increasing.
    position : (n, 3) array
        Ball's centre x, y, z, m; NaN where a coordinate was not measured.
    pendulum_time, pendulum_angle : (m,) array
        s and rad.
    ball : str or None
        Name of the ball.
    backswing : float or None
        Nominal back-swing angle, rad.
    position_std : (n, 3) array or None
        Claimed standard uncertainty, m. Tested against the data, not believed.
    session : str or None
        Name of the sitting that it was recorded in, for which instruments were set up anew.
    """

    name: str
    ball_time: FloatArray
    position: FloatArray
    pendulum_time: FloatArray
    pendulum_angle: FloatArray
    ball: str | None = None
    backswing: float | None = None
    position_std: FloatArray | None = None
    session: str | None = None

    def __post_init__(self) -> None:
        for name, times in (("ball", self.ball_time), ("pendulum", self.pendulum_time)):
            if times.size > 1 and np.any(np.diff(times) <= 0.0):
                raise UsageError(
                    f"trial {self.name}: the {name}'s clock does not run forward",
                    hint="Times must increase within a trial; are two trials mixed?",
                )

    @property
    def samples(self) -> int:
        """Number of rows, ball and pendulum together."""
        return self.ball_time.size + self.pendulum_time.size


@dataclass(frozen=True)
class CampaignRecords:
    """Trials that one model should explain.

    Attributes
    ----------
    trials : tuple of Trial
        In the order they were recorded.
    notes : tuple of str
        What was set right or left out while reading.
    """

    trials: tuple[Trial, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.trials:
            raise TooLittleDataError(
                "there is no trial in the data",
                hint="Name trials in the column trial, and fill their rows.",
            )

    @property
    def channels(self) -> tuple[int, ...]:
        """Indices of the coordinates that were measured (0, 1, 2 for x, y, z)."""
        return tuple(
            axis
            for axis in range(3)
            if any(np.isfinite(trial.position[:, axis]).any() for trial in self.trials)
        )


@dataclass(frozen=True)
class Records:
    """Samples of T trials, padded to S ball rows and P pendulum rows.

    Attributes
    ----------
    ball_time : (T, S) array
        s on each trial's own clock; padding repeats the last time.
    position : (T, S, 3) array
        m; zero where unused.
    ball_used : (T, S, 3) bool array
        Which coordinates take part in fits.
    pendulum_time, pendulum_angle : (T, P) array
        s, rad.
    pendulum_used : (T, P) bool array
        Which angles take part.
    sigma : (T, 4) array
        White noise of x, y, z (m) and angle (rad).
    backswing : (T,) array
        Nominal, rad; NaN where not known.
    mass, diameter, launch_angle : (T,) array
        Of each trial's ball.
    ball_index : (T,) int array
        Which of `ball_names` flies.
    ball_names : tuple of str
        Balls in the campaign.
    inflation : (4,) array
        Variance in `sigma` over that of one sample, by channel: memory of the noise.
    session_index : (T,) int array
        Which of `session_names` a trial belongs to; empty where none is named.
    session_names : tuple of str
        Sessions of the campaign.
    setting_index : (T,) int array
        Which of `setting_names`, a ball at a nominal back-swing, a trial repeats; empty where no
        back-swing is known.
    setting_names : tuple of str
        Settings of the campaign.
    jitter : (T, S, 3) array
        How far a ball moves while its clock is off by one standard deviation, in units of `sigma`;
        empty for a clock that is right.
    slow : (3, K) array
        Variance of a ball's slowest errors by coordinate, beyond that of white noise and in its
        units; empty where they are no larger.
    places : (T,) array
        Place of each trial in the campaign that these trials are a part of, −½ to ½; empty where
        they are all.
    """

    ball_time: FloatArray
    position: FloatArray
    ball_used: NDArray[np.bool_]
    pendulum_time: FloatArray
    pendulum_angle: FloatArray
    pendulum_used: NDArray[np.bool_]
    sigma: FloatArray
    backswing: FloatArray
    mass: FloatArray
    diameter: FloatArray
    launch_angle: FloatArray
    ball_index: NDArray[np.int64]
    ball_names: tuple[str, ...]
    inflation: FloatArray = field(default_factory=lambda: np.ones(4))
    session_index: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    session_names: tuple[str, ...] = ()
    setting_index: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    setting_names: tuple[str, ...] = ()
    jitter: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 3)))
    slow: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    places: FloatArray = field(default_factory=lambda: np.zeros(0))

    def groups(self, level: Level) -> tuple[NDArray[np.int64], tuple[str, ...]]:
        """Which trials share a value at a level: group of each trial (T,), names of the groups.

        None of either where nothing says so; trials have no names here, and share nothing.
        """
        if level is Level.BALL:
            return self.ball_index, self.ball_names
        if level is Level.SESSION:
            return self.session_index, self.session_names
        if level is Level.SETTING:
            return self.setting_index, self.setting_names
        return np.zeros(0, dtype=np.int64), ()

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.ball_time.shape[0])

    @property
    def order(self) -> FloatArray:
        """(T,) place of each trial in the campaign, −½ to ½."""
        if self.places.size:
            return self.places
        count = self.trials
        return np.arange(count) / max(count - 1, 1) - 0.5

    @property
    def used(self) -> NDArray[np.bool_]:
        """(T, 3S + P) which entries of the stacked record take part: x, y, z, then angles."""
        flat = np.moveaxis(self.ball_used, -1, 1).reshape(self.trials, -1)
        return np.concatenate([flat, self.pendulum_used], axis=1)

    @property
    def values(self) -> FloatArray:
        """(T, 3S + P) the stacked record."""
        flat = np.moveaxis(self.position, -1, 1).reshape(self.trials, -1)
        return np.concatenate([flat, self.pendulum_angle], axis=1)

    @property
    def weights(self) -> FloatArray:
        """(T, 3S + P) one over sigma where used, else zero."""
        s, p = self.ball_time.shape[1], self.pendulum_time.shape[1]
        sigma = np.concatenate(
            [np.repeat(self.sigma[:, :3], s, axis=1), np.repeat(self.sigma[:, 3:], p, axis=1)],
            axis=1,
        )
        return np.where(self.used, 1.0 / sigma, 0.0)

    def weighed(self, differences: FloatArray) -> FloatArray:
        """Differences (..., T, 3S + P) from the record in units of their noise, white.

        A clock that is off moves all coordinates of a row together, along the ball's path; slow
        errors move all rows of a coordinate together.
        """
        scaled = np.asarray(differences * self.weights)
        scaled = self._along_the_way(scaled, lambda size: 1.0 / np.sqrt(1.0 + size))
        return self._slowest(scaled, lambda size: 1.0 / np.sqrt(1.0 + size))

    def unweighed(self, residual: FloatArray) -> FloatArray:
        """What `weighed` was given, m and rad; zero where unused."""
        weights = self.weights
        scaled = self._slowest(residual, lambda size: np.sqrt(1.0 + size))
        scaled = self._along_the_way(scaled, lambda size: np.sqrt(1.0 + size))
        return np.where(weights > 0.0, scaled / np.where(weights > 0.0, weights, 1.0), 0.0)

    def _along_the_way(
        self, scaled: FloatArray, factor: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Rows with the part along the ball's path multiplied by a function of (jitter/noise)²."""
        if not self.jitter.size:
            return scaled
        s = self.ball_time.shape[1]
        ball = scaled[..., : 3 * s].reshape(*scaled.shape[:-1], 3, s)
        along = np.moveaxis(np.where(self.ball_used, self.jitter, 0.0), -1, 1)
        size = np.square(along).sum(axis=1)
        share = (factor(size) - 1.0) / np.maximum(size, 1e-30)
        moved = ball + along * ((ball * along).sum(axis=-2) * share)[..., None, :]
        return np.concatenate(
            [moved.reshape(*scaled.shape[:-1], 3 * s), scaled[..., 3 * s :]], axis=-1
        )

    @property
    def remembers(self) -> bool:
        """Whether the noise has a memory, so that a record's rows err together."""
        return bool(np.any(self.inflation > 1.0)) or bool(np.any(self.slow > 0.0))

    @cached_property
    def _cosines(self) -> FloatArray:
        return slow_cosines(self, self.slow.shape[1])

    def _slowest(
        self, scaled: FloatArray, factor: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Records with their slowest cosines multiplied by a function of their excess variance."""
        if not np.any(self.slow > 0.0):
            return scaled
        s = self.ball_time.shape[1]
        ball = scaled[..., : 3 * s].reshape(*scaled.shape[:-1], 3, s)
        found = np.einsum("...tcs,tcsk->...tck", ball, self._cosines, optimize=True)
        found *= factor(self.slow) - 1.0
        moved = ball + np.einsum("...tck,tcsk->...tcs", found, self._cosines, optimize=True)
        return np.concatenate(
            [moved.reshape(*scaled.shape[:-1], 3 * s), scaled[..., 3 * s :]], axis=-1
        )

    @property
    def count(self) -> int:
        """Number of entries that take part."""
        return int(self.used.sum())

    @property
    def expected(self) -> float:
        """Chi-square that noise alone leaves: sigma of slow quantities is wide for one sample.

        What a clock that jitters adds has no memory, and is no wider than it is.
        """
        ball = self.ball_used.sum(axis=(0, 1)) / self.inflation[:3]
        total = float(ball.sum() + self.pendulum_used.sum() / self.inflation[3])
        if self.jitter.size:
            along = np.square(np.where(self.ball_used, self.jitter, 0.0))
            size = along.sum(axis=-1)
            total += float(
                ((size - (along / self.inflation[:3]).sum(axis=-1)) / (1.0 + size)).sum()
            )
        return total

    @property
    def tell_memory(self) -> bool:
        """Whether any flight is long enough to determine the memory of its noise."""
        return bool(self.ball_used.any(axis=2).sum(axis=1).max(initial=0) >= MIN_SAMPLES)

    def keeping(self, kept: NDArray[np.bool_]) -> "Records":
        """Records in which only entries marked in `kept` (T, 3S + P) still take part."""
        s = self.ball_time.shape[1]
        ball = np.moveaxis(kept[:, : 3 * s].reshape(self.trials, 3, s), 1, -1)
        return replace(
            self,
            ball_used=self.ball_used & ball,
            pendulum_used=self.pendulum_used & kept[:, 3 * s :],
        )

    def of_trials(self, rows: NDArray[np.int64]) -> "Records":
        """Records of some trials alone, in order; groups keep their names."""
        each = {
            name: value[rows]
            for name, value in vars(self).items()
            if name in _BY_TRIAL and len(value) == self.trials
        }
        return replace(self, **each, places=self.order[rows])

    def chosen(self, trials: NDArray[np.bool_]) -> "Records":
        """Records in which only the marked trials (T,) still take part."""
        return replace(
            self,
            ball_used=self.ball_used & trials[:, None, None],
            pendulum_used=self.pendulum_used & trials[:, None],
        )


_BY_TRIAL = frozenset(
    {
        "ball_time", "position", "ball_used", "pendulum_time", "pendulum_angle", "pendulum_used",
        "sigma", "backswing", "mass", "diameter", "launch_angle", "ball_index", "session_index",
        "setting_index", "jitter",
    }
)  # fmt: skip
"""Fields of `Records` with a row for each trial."""

ROWS_OF_A_COSINE = 3
"""Rows for each slow cosine at least, lest what is called slow be all there is."""


def slow_cosines(records: Records, count: int) -> FloatArray:
    """(T, 3, S, count) orthonormal cosines over the ball's rows, from the slowest bend on.

    Place and speed, which each record has of its own, are taken out; zero where a record is too
    short for a cosine.
    """
    trials, rows = records.ball_time.shape
    found = np.zeros((trials, 3, rows, count))
    for trial, axis in np.ndindex(trials, 3):
        used = np.flatnonzero(records.ball_used[trial, :, axis])
        most = min(count, used.size // ROWS_OF_A_COSINE)
        if most < 1:
            continue
        time = records.ball_time[trial, used]
        share = (time - time[0]) / max(float(time[-1] - time[0]), 1e-12)
        bends = np.cos(np.pi * np.outer(share, np.arange(2, most + 2)))
        basis, _ = np.linalg.qr(np.column_stack([np.ones(used.size), share, bends]))
        found[trial, axis, used, :most] = basis[:, 2:]
    return found


def lay_out(campaign: CampaignRecords, baseline: Baseline) -> Records:
    """Pad a campaign's trials to even arrays and attach the bodies of the baseline.

    Raises
    ------
    SetupError
        If the baseline does not describe a trial's ball.
    """
    trials = campaign.trials
    count = len(trials)
    s = max(1, *(t.ball_time.size for t in trials))
    p = max(1, *(t.pendulum_time.size for t in trials))
    ball_time, position = np.zeros((count, s)), np.zeros((count, s, 3))
    ball_used = np.zeros((count, s, 3), dtype=bool)
    pendulum_time, angle = np.zeros((count, p)), np.zeros((count, p))
    pendulum_used = np.zeros((count, p), dtype=bool)
    bodies = [baseline.ball(t.ball) if t.ball_time.size else None for t in trials]
    names = tuple(dict.fromkeys(body.name for body in bodies if body is not None))
    for row, trial in enumerate(trials):
        n, m = trial.ball_time.size, trial.pendulum_time.size
        if n:
            ball_time[row, :n], ball_time[row, n:] = trial.ball_time, trial.ball_time[-1]
            finite = np.isfinite(trial.position)
            position[row, :n] = np.where(finite, trial.position, 0.0)
            ball_used[row, :n] = finite
        if m:
            pendulum_time[row, :m] = trial.pendulum_time
            pendulum_time[row, m:] = trial.pendulum_time[-1]
            angle[row, :m] = trial.pendulum_angle
            pendulum_used[row, :m] = np.isfinite(trial.pendulum_angle)
            angle[row] = np.nan_to_num(angle[row])
    backswing = np.array([np.nan if t.backswing is None else t.backswing for t in trials])
    ball_index = np.array([0 if b is None else names.index(b.name) for b in bodies], dtype=np.int64)
    return Records(
        ball_time,
        position,
        ball_used,
        pendulum_time,
        angle,
        pendulum_used,
        np.ones((count, 4)),
        backswing,
        np.array([1.0 if b is None else b.mass for b in bodies]),
        np.array([0.1 if b is None else b.diameter for b in bodies]),
        np.array(
            [np.nan if b is None or b.launch_angle is None else b.launch_angle for b in bodies]
        ),
        ball_index,
        names or ("",),
        **_sessions(trials),
        **_settings(backswing, ball_index),
    )


class _Sessions(TypedDict, total=False):
    session_index: NDArray[np.int64]
    session_names: tuple[str, ...]


def _sessions(trials: Sequence[Trial]) -> _Sessions:
    """Sessions in the order of their first trials; trials of none belong to one without a name."""
    sessions = [trial.session or "" for trial in trials]
    names = tuple(dict.fromkeys(sessions))
    if names == ("",):
        return {}
    index = np.array([names.index(one) for one in sessions], dtype=np.int64)
    return {"session_index": index, "session_names": names}


class _Settings(TypedDict, total=False):
    setting_index: NDArray[np.int64]
    setting_names: tuple[str, ...]


def _settings(backswing: FloatArray, ball: NDArray[np.int64]) -> _Settings:
    """Settings in the order of their first trials; none where a back-swing is not known."""
    index = settings_of(backswing, list(ball))
    if not index.size or index.min() < 0:
        return {}
    first = [int(np.flatnonzero(index == one)[0]) for one in range(int(index.max()) + 1)]
    names = tuple(f"{np.degrees(backswing[k]):.4g}°, ball {int(ball[k]) + 1}" for k in first)
    return {"setting_index": index, "setting_names": names}


def settings_of(values: FloatArray, names: Sequence[object]) -> NDArray[np.int64]:
    """Setting of each trial (T,): same name, and values that agree to a millionth; -1 if none."""
    found: dict[tuple[object, float], int] = {}
    setting = np.full(len(values), -1, dtype=np.int64)
    for trial, (value, name) in enumerate(zip(values, names, strict=True)):
        if np.isfinite(value):
            setting[trial] = found.setdefault((name, round(float(value), 6)), len(found))
    return setting


DEGREE = 6

"""Degree of the polynomial taken off a stretch: what a flight or half a swing does is below."""

MIN_SAMPLES = 24

"""Rows of a piece: more than three for each coefficient of what is taken off."""

APART = 0.001

"""Probability below which channels are said to have different memories."""

LARGEST_INFLATION = 40.0

"""Factor on a variance: beyond six standard deviations a record says nothing, and how far beyond
does not matter."""

RHOS = 1.0 - np.geomspace(0.7, 0.025, 12)

"""Correlations from one row to the next that are tried, from a memory of one row to forty."""

PACES = 7

"""Groups of cosines, octaves from slow to fast, by which a shape is held against the powers."""

EACH_COSINE = 200
"""Cosines of a record up to which each one's expected power is computed; beyond, a polynomial takes
less than 1e-3 of it along. Chosen; insensitive between 100 and all of them
(tests/mismatch/records/test_spectrum.py)."""

COSINE_STEP = 0.02
"""Relative distance of the cosines computed beyond: the power between them is off by 1e-4 of it."""

SHARES = np.linspace(0.03, 0.99, 33)

"""Shares of correlated noise that are tried, 3 % apart. Some white noise is always left of pixels,
but where the rest remembers twenty rows, 3 % would be more than half of the fastest power."""


@dataclass(frozen=True)
class Spectrum:
    """Noise model of a channel.

    Attributes
    ----------
    variance : float
        Of one sample, in squared units of the input.
    share : float
        Part of it that is correlated.
    rho : float
        Correlation of that part from one sample to the next.
    inflation : float
        Noise power at the pace of slow physics over the variance; 1 if white.
    """

    variance: float
    share: float
    rho: float
    inflation: float = 1.0


def _density(share: float, rho: float, omega: FloatArray) -> FloatArray:
    shape = (1.0 - rho**2) / (1.0 - 2.0 * rho * np.cos(omega) + rho**2)
    return np.asarray(1.0 - share + share * shape)


def _orders(size: int) -> NDArray[np.int64]:
    """Cosines of a record whose expected power is computed; the power between them is smooth."""
    each = np.arange(DEGREE + 2, min(size, EACH_COSINE))
    if size <= EACH_COSINE:
        return each
    count = int(np.ceil(np.log(size / EACH_COSINE) / COSINE_STEP)) + 1
    rest = np.geomspace(EACH_COSINE, size - 1, count).astype(np.int64)
    return np.concatenate([each, np.unique(rest)])


@lru_cache(maxsize=512)
def _expected(size: int) -> tuple[FloatArray, FloatArray]:
    """Powers that noise of unit variance leaves in the cosines kept: white (n,), correlated (R, n).

    A polynomial takes its part of slow noise along, from cosines beyond its degree as well.
    """
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), DEGREE + 1))
    orders = _orders(size)
    seen = np.sqrt(2.0 / size) * np.cos(np.pi / size * np.outer(orders, np.arange(size) + 0.5))
    seen -= (seen @ basis) @ basis.T
    # A row's power under a memory of rho^|i - j| is what it has in common with itself, lag by lag.
    padded = next_fast_len(2 * size, real=True)
    lags = irfft(np.abs(rfft(seen, padded, axis=1)) ** 2, padded, axis=1)[:, :size]
    lags[:, 1:] *= 2.0
    white, slow = np.sum(seen * seen, axis=1), RHOS[:, None] ** np.arange(size) @ lags.T
    every = np.arange(DEGREE + 2, size)
    if orders.size == every.size:
        return white, slow
    filled = np.array([np.interp(every, orders, one) for one in (white, *slow)])
    return filled[0], filled[1:]


@dataclass(frozen=True)
class SpectrumFit:
    """How well every shape of a spectrum fits a channel.

    Attributes
    ----------
    deviance : (R, S) array
        −2 log likelihood by correlation (`RHOS`) and correlated share (`SHARES`).
    variance, rise : (R, S) arrays
        Variance of one sample, and power at the pace of slow physics over it.
    extrapolation : (R, S) array
        Part of the deviance that keeps the power small where no cosine shows it.
    flat : float
        Deviance of white noise.
    level : float
        Variance if the noise is white.
    misfit : (R, S) array
        Deviance of the powers' means by pace from those of the shape; about `PACES` if it holds.
    """

    deviance: FloatArray
    variance: FloatArray
    rise: FloatArray
    extrapolation: FloatArray
    flat: float
    level: float
    misfit: FloatArray

    @property
    def holds(self) -> bool:
        """Whether the most probable shape fits the powers at every pace.

        What a motion leaves over falls off faster than any noise with a memory, or peaks.
        """
        at = np.unravel_index(int(np.argmin(self.deviance)), self.deviance.shape)
        return bool(self.misfit[at] < chdtri(PACES, APART))

    def chosen(self, significant: float, shared: FloatArray | None = None) -> Spectrum:
        """White unless memory gains `significant`; the shape by `shared` deviances if given."""
        if self.flat - self.deviance.min() < significant:
            return Spectrum(self.level, 0.0, 0.0)
        cost = self.deviance if shared is None else shared
        # Short records leave a ridge of equally good answers; their mean beats any one of them.
        weight = np.exp(-0.5 * (cost - cost.min()))
        weight /= weight.sum()
        variance = float(np.exp(np.sum(weight * np.log(self.variance))))
        power_there = float(np.exp(np.sum(weight * np.log(self.variance * self.rise))))
        at = np.unravel_index(int(np.argmin(cost)), cost.shape)
        inflation = float(np.clip(power_there / variance, 1.0, LARGEST_INFLATION))
        return Spectrum(variance, float(SHARES[at[1]]), float(RHOS[at[0]]), inflation)


def fit_spectrum(
    pieces: list[tuple[FloatArray, FloatArray]], slow_mode: float = 1.0
) -> SpectrumFit | None:
    """Fit the spectrum of many short records of the same noise.

    Parameters
    ----------
    pieces : list of (time, value)
        Stretches over which the physics is smooth, outliers gone.
    slow_mode : float
        Cosine of a piece at whose pace slow physics competes with noise.

    Returns
    -------
    SpectrumFit or None
        None if the pieces are too few or too short.
    """
    powers, whites, slows, sizes, paces = [], [], [], [], []
    for time, value in pieces:
        if value.size < MIN_SAMPLES:
            continue
        u = (time - time.mean()) / max(float(np.ptp(time)), 1e-12) * 2.0
        basis, _ = np.linalg.qr(np.vander(u, DEGREE + 1))
        left = value - basis @ (basis.T @ value)
        powers.append(np.asarray(dct(left, norm="ortho"))[DEGREE + 2 :] ** 2)
        white, slow = _expected(value.size)
        whites.append(white)
        slows.append(slow)
        sizes.append(np.full(value.size, value.size))
        paces.append(np.arange(DEGREE + 2, value.size) / value.size)
    if not powers:
        return None
    power, white = np.concatenate(powers), np.concatenate(whites)
    slow = np.concatenate(slows, axis=1)
    omega = np.pi * slow_mode / float(np.median(np.concatenate(sizes)))
    cost, levels = np.zeros((RHOS.size, SHARES.size)), np.zeros((RHOS.size, SHARES.size))
    rise, misfit = np.zeros_like(cost), np.zeros_like(cost)
    octaves = np.ceil(power.size * 2.0 ** np.arange(1 - PACES, 0)).astype(int)
    groups = np.split(np.argsort(np.concatenate(paces), kind="stable"), octaves)
    groups = [group for group in groups if group.size]
    for j, share in enumerate(SHARES):
        density = (1.0 - share) * white + share * slow
        levels[:, j] = np.mean(power / density, axis=1)
        rise[:, j] = [float(_density(share, rho, np.array(omega))) for rho in RHOS]
        cost[:, j] = np.log(levels[:, j]) * power.size + np.log(density).sum(axis=1)
        scaled = power / density / levels[:, j : j + 1]
        means = np.array([scaled[:, group].mean(axis=1) for group in groups])
        misfit[:, j] = np.array([g.size for g in groups]) @ (
            means - 1.0 - np.log(np.maximum(means, 1e-300))
        )
    # Power below the slowest cosine seen is an extrapolation: the less of it the better.
    guess = 2.0 * np.log(levels * rise)
    level = float(np.mean(power / white))
    flat = np.log(level) * (power.size + 2.0) + float(np.log(white).sum())
    return SpectrumFit(cost + guess, levels, rise, guess, float(flat), level, misfit)


def shared_deviance(fits: list[SpectrumFit]) -> FloatArray | None:
    """Deviance of one shape for several channels; None where they clearly have shapes of their own.

    One tracker saw them all, so one memory is likely, and their records determine it together.
    """
    if len(fits) < 2:
        return None
    total = np.sum([fit.deviance for fit in fits], axis=0)
    apart = float(total.min() - sum(fit.deviance.min() for fit in fits))
    if apart > chdtri(2 * (len(fits) - 1), APART):
        return None
    # One memory is one extrapolation, however many channels it was seen in.
    guess = np.mean([fit.extrapolation for fit in fits], axis=0)
    return np.asarray(total - (len(fits) - 1) * guess)


def whiteness(pieces: list[tuple[FloatArray, FloatArray]], low: int = 8) -> float:
    """Probability that standardised residuals have no more low-frequency power than white noise.

    The power of the `low` slowest cosines of each piece is compared with its other power.
    """
    slow, n_slow, fast, n_fast = 0.0, 0, 0.0, 0
    for _, value in pieces:
        if value.size < MIN_SAMPLES:
            continue
        power = np.asarray(dct(value, norm="ortho")) ** 2
        slow += float(power[:low].sum())
        n_slow += low
        fast += float(power[low:].sum())
        n_fast += value.size - low
    if not n_slow or not n_fast or fast <= 0.0:
        return 1.0
    ratio = (slow / n_slow) / (fast / n_fast)
    return float(fdtrc(n_slow, n_fast, ratio))


STRETCHES = ((36, 4), (24, 4), (16, 4), (12, 5), (9, 5))

"""Rows of a stretch and degree of the polynomial through it, longest first."""

OUTLIER = 4.8

"""Standard deviations: of 600 rows one in a thousand stretches has one farther off."""

ENOUGH = 12.0

"""Degrees of freedom from which a variance can be compared."""

SIGNIFICANT = 9.0

"""Gain in deviance from which noise is correlated."""

LIKELY = 1.0

"""Gain in deviance that is enough for a correlated part where another channel clearly has one."""

SMOOTH = 2.0

"""Variance about a polynomial over the local one up to which what is left counts as noise."""

BENT = 3.0

"""Variance about longer stretches over that about shorter ones from which it is the motion that
bends: noise with a memory of a few rows raises it less."""

UNKNOWN_SIGMA = 1e-3

"""m or rad, where too few rows are left to estimate it."""


@dataclass(frozen=True)
class Noise:
    """What the record says about its own noise.

    Attributes
    ----------
    sigma : (T, 4) array
        White noise of x, y, z (m) and angle (rad) by trial.
    inflation : (4,) array
        Noise power at low frequency over white, by channel: what slow physics competes with.
    outliers : (T, M) bool array
        Rows that do not belong, in the stacked order of `Records`.
    jitter : float
        s, scatter of the ball's times about those that are written.
    """

    sigma: FloatArray
    inflation: FloatArray
    outliers: NDArray[np.bool_]
    jitter: float = 0.0

    @property
    def effective(self) -> FloatArray:
        """(T, 4) sigma that, taken as white, gives slow quantities their true uncertainty."""
        return self.sigma * np.sqrt(self.inflation)


@dataclass
class _NoiseSums:
    squares: float = 0.0
    dof: float = 0.0


def _stretches(time: FloatArray, rows: NDArray[np.int64], length: int) -> list[NDArray[np.int64]]:
    """Cut rows where the record has a hole, then into stretches of even length."""
    if rows.size < 5:
        return []
    gaps = np.diff(time[rows])
    cuts = np.flatnonzero(gaps > 6.0 * np.median(gaps)) + 1
    pieces = []
    for run in np.split(rows, cuts):
        if run.size >= 5:
            pieces.extend(np.array_split(run, max(1, round(run.size / length))))
    return pieces


def _off_polynomial(
    time: FloatArray, value: FloatArray, highest: int
) -> tuple[FloatArray, FloatArray]:
    """What a polynomial leaves, and which fraction of each row's variance it leaves."""
    basis = _polynomials(time.tobytes(), highest)
    return value - basis @ (basis.T @ value), 1.0 - np.square(basis).sum(axis=1)


@lru_cache(maxsize=8192)
def _polynomials(times: bytes, highest: int) -> FloatArray:
    """Orthonormal polynomials (N, D) at times that all channels of a record share."""
    time = np.frombuffer(times)
    degree = 4 if time.size >= 16 else (3 if time.size >= 10 else 2)
    if highest > 4 and time.size >= 8:
        degree = highest
    u = (time - time.mean()) / max(np.ptp(time), 1e-12) * 2.0
    return np.asarray(np.linalg.qr(np.vander(u, degree + 1))[0])


def _channel(
    time: FloatArray, value: FloatArray, used: NDArray[np.bool_], segments: FloatArray
) -> tuple[list[_NoiseSums], NDArray[np.bool_]]:
    """Sums of one channel over all trials, by the longest stretches that the motion does not bend.

    About stretches longer than its own time scale a motion is no polynomial, and what is left is
    motion; the shorter the stretch the less. Noise is left alike by all of them (a choice of scale
    by comparison: Lepski, Theory Probab. Appl. 35, 454 (1991)).
    """
    tried = [_over(time, value, used, segments, *scale) for scale in STRETCHES]
    levels = np.array([_level(sums) for sums, _ in tried])
    least = np.nanmin(levels) if np.isfinite(levels).any() else np.nan
    chosen = int(np.argmax(levels < BENT * least)) if np.isfinite(least) else 0
    return tried[chosen]


def _level(sums: list[_NoiseSums]) -> float:
    dof = sum(s.dof for s in sums)
    return sum(s.squares for s in sums) / dof if dof >= ENOUGH else float("nan")


def _over(
    time: FloatArray,
    value: FloatArray,
    used: NDArray[np.bool_],
    segments: FloatArray,
    length: int,
    highest: int,
) -> tuple[list[_NoiseSums], NDArray[np.bool_]]:
    """Sums of one channel about polynomials, with outliers found and left out."""
    outliers = np.zeros_like(used)
    pieces: list[tuple[int, NDArray[np.int64]]] = []
    for trial in range(used.shape[0]):
        for segment in np.unique(segments[trial][used[trial]]):
            rows = np.flatnonzero(used[trial] & (segments[trial] == segment))
            pieces.extend((trial, piece) for piece in _stretches(time[trial], rows, length))
    spread = []
    for trial, rows in pieces:
        left, remaining = _off_polynomial(time[trial, rows], value[trial, rows], highest)
        spread.append(left / np.sqrt(np.maximum(remaining, 0.05)))
    sums = [_NoiseSums() for _ in range(used.shape[0])]
    if not pieces:
        return sums, outliers
    rough = max(1.4826 * float(np.median(np.abs(np.concatenate(spread)))), 1e-12)
    for trial, rows in pieces:
        kept = rows
        for _ in range(6):
            left, remaining = _off_polynomial(time[trial, kept], value[trial, kept], highest)
            size = np.abs(left) / np.sqrt(np.maximum(remaining, 0.05)) / rough
            worst = int(np.argmax(size))
            if size[worst] < OUTLIER or kept.size < 8:
                break
            outliers[trial, kept[worst]] = True
            kept = np.delete(kept, worst)
        total = sums[trial]
        total.squares += float(left @ left)
        total.dof += float(remaining.sum())
    return sums, outliers


def _by_trial(sums: list[_NoiseSums]) -> FloatArray:
    """Sigma by trial, pooled unless a trial clearly differs."""
    dof = np.array([s.dof for s in sums])
    squares = np.array([s.squares for s in sums])
    if dof.sum() < 3.0:
        return np.full(len(sums), np.nan)
    pooled = float(squares.sum() / dof.sum())
    own = np.where(dof > 3.0, squares / np.maximum(dof, 1.0), pooled)
    apart = np.abs(np.log(np.maximum(own, 1e-30) / max(pooled, 1e-30)))
    differs = apart > 4.5 * np.sqrt(2.0 / np.maximum(dof, 1.0))
    return np.sqrt(np.where(differs, own, pooled))


def _spectrum(
    time: FloatArray,
    value: FloatArray,
    used: NDArray[np.bool_],
    segments: FloatArray,
    sigma: FloatArray,
    slow_mode: float,
    still: bool,
    throughout: bool,
) -> SpectrumFit | None:
    pieces = []
    for trial in range(used.shape[0]):
        for segment in np.unique(segments[trial][used[trial]]):
            rows = used[trial] & (segments[trial] == segment)
            pieces.append((time[trial, rows], value[trial, rows] / sigma[trial]))
    # A swing over many periods, or a path through something local, is no polynomial as a whole.
    while pieces and (still or _longest(pieces) >= 2 * MIN_SAMPLES):
        found = fit_spectrum(pieces, slow_mode)
        if found is None or found.chosen(SIGNIFICANT).variance < SMOOTH or (still and found.holds):
            return found
        if throughout or _longest(pieces) < 2 * MIN_SAMPLES:
            return None
        halves: list[tuple[FloatArray, FloatArray]] = []
        for t, v in pieces:
            count = 2 if t.size >= 2 * MIN_SAMPLES else 1
            parts = zip(np.array_split(t, count), np.array_split(v, count), strict=True)
            halves.extend(parts)
        pieces = halves
    return None


def _longest(pieces: Sequence[tuple[FloatArray, FloatArray]]) -> int:
    return max(time.size for time, _ in pieces)


def _alike(channels: Sequence[Spectrum]) -> Spectrum:
    """What channels of one tracker have in common."""
    first = channels[0]
    return Spectrum(
        float(np.exp(np.mean([np.log(one.variance) for one in channels]))),
        first.share,
        first.rho,
        float(np.exp(np.mean([np.log(one.inflation) for one in channels]))),
    )


def _channel_of(records: Records, channel: int) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Times, values and use of a coordinate of the ball (0 to 2) or of the pendulum's angle (3)."""
    if channel < 3:
        return records.ball_time, records.position[..., channel], records.ball_used[..., channel]
    return records.pendulum_time, records.pendulum_angle, records.pendulum_used


def _memory(fits: dict[int, SpectrumFit]) -> dict[int, Spectrum]:
    """Spectra of the channels of one tracker: if one has memory, others need less evidence."""
    remembers = any(one.chosen(SIGNIFICANT).share > 0.0 for one in fits.values())
    shared = shared_deviance(list(fits.values())) if remembers else None
    level = LIKELY if remembers else SIGNIFICANT
    return {channel: one.chosen(level, shared) for channel, one in fits.items()}


def estimate_noise(
    records: Records,
    ball_segments: FloatArray,
    pendulum_segments: FloatArray,
    floor: tuple[float, float] = (1e-6, 1e-6),
    slow_mode: float = 1.0,
    still: bool = False,
    throughout: bool = False,
) -> Noise:
    """Learn the noise from the record.

    Parameters
    ----------
    records : Records
        Only entries that take part are used.
    ball_segments : (T, S) array, and
    pendulum_segments : (T, P) array
        Labels; a stretch never spans two labels (rest and flight, before and after contact).
    floor : (position, angle)
        Smallest sigma believed, m and rad (the resolution of the file).
    slow_mode : float
        Cosine of a record at whose pace physics competes with noise: the slowest, or a faster one
        where free initial states take the slowest along.
    still : bool
        Whether the motion was taken off: what is rough about a polynomial may then be noise that
        remembers as many rows as the polynomial follows.
    throughout : bool
        Whether a memory must hold over whole stretches, and in every channel: where nothing but
        the record itself determines a motion, what bends one channel or a part is no noise.

    Returns
    -------
    Noise
    """
    sigma = np.full((records.trials, 4), np.nan)
    inflation = np.ones(4)
    parts: list[NDArray[np.bool_]] = []
    fits: dict[int, SpectrumFit] = {}
    for channel in range(4):
        segments = ball_segments if channel < 3 else pendulum_segments
        time, value, used = _channel_of(records, channel)
        sums, outliers = _channel(time, value, used, segments)
        parts.append(outliers)
        mine = np.maximum(_by_trial(sums), floor[channel // 3])
        if np.isfinite(mine).all():
            sigma[:, channel] = mine
            one = _spectrum(
                time, value, used & ~outliers, segments, mine, slow_mode, still, throughout
            )
            if one is not None:
                fits[channel] = one
    seen = np.flatnonzero(np.isfinite(sigma).all(axis=0)).tolist()
    found = {} if throughout and len(fits) < len(seen) else _memory(fits)
    if still and found and all(one.share > 0.0 for one in found.values()):
        # The memory of a channel that something bends is taken from the others.
        found = dict.fromkeys(seen, _alike(list(found.values()))) | found
    for channel, spectrum in found.items():
        if spectrum.share > 0.0:
            # A local polynomial swallows part of correlated noise; the spectrum sees it all.
            sigma[:, channel] *= np.sqrt(spectrum.variance)
            inflation[channel] = spectrum.inflation
    sigma = np.where(np.isfinite(sigma), sigma, UNKNOWN_SIGMA)
    return Noise(sigma, inflation, np.concatenate(parts, axis=1))


OVERLAP = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)

"""How often second differences of white noise say the same: one plus twice the squares of their
correlations with the next and the next but one."""

FREE_START = 2
"""Coefficients of a path that a throw's free place and velocity take along."""

MIN_PACES = 20.0

"""Second differences from which jitter of the clock is distinguished from that of positions."""


def with_clock_jitter(noise: Noise, left: Records, velocity: FloatArray) -> Noise:
    """The noise with what a clock that jitters has of it distinguished from that of places.

    A wrong time moves a ball along its path, the more the faster it is, and all its coordinates
    together. Second differences show it: what a model leaves over bends far less.

    Parameters
    ----------
    noise : Noise
        White.
    left : Records
        Records with a fit taken off.
    velocity : (T, S, 3) array
        m/s, of the ball.
    """
    if np.any(noise.inflation > 1.0):
        return noise
    shown, along_path = _second_differences(noise, left, velocity)
    axes = np.isfinite(shown).any(axis=0)
    shown, along_path = shown[:, axes], along_path[:, axes]
    if not axes.any() or shown.shape[0] < MIN_PACES:
        return noise

    def deviance(logs: FloatArray) -> float:
        variance, clock = np.exp(2.0 * logs[:-1]), np.exp(2.0 * logs[-1])
        together = 1.0 + clock * (np.square(along_path) / variance).sum(axis=1)
        along = (shown * along_path / variance).sum(axis=1)
        misfit = (np.square(shown) / variance).sum(axis=1) - clock * np.square(along) / together
        return float((misfit + np.log(together)).sum() + shown.shape[0] * np.log(variance).sum())

    plain = 0.5 * np.log(np.square(shown).mean(axis=0))
    tried = -0.5 * np.log(np.square(along_path).sum(axis=1).mean())
    none = deviance(np.append(plain, tried - 20.0))
    found = minimize(deviance, np.append(plain - 0.3, tried), method="Nelder-Mead",
                     options={"xatol": 1e-3, "fatol": 1e-2, "maxfev": 600})  # fmt: skip
    if none - float(found.fun) < SIGNIFICANT * OVERLAP:
        return noise
    # Second differences show how noise is shared out, but see less of what is slower than they are.
    size = max(1.0, float(np.square(shown).mean()) ** -0.5)
    sigma = noise.sigma.copy()
    sigma[:, np.flatnonzero(axes)] *= size * np.exp(found.x[:-1])
    return replace(noise, sigma=sigma, jitter=size * float(np.exp(found.x[-1])))


def slow_noise(residual: FloatArray, records: Records) -> FloatArray:
    """Power of what a fit leaves at the pace of physics over that of white noise: x, y, z, angle.

    One for all where the record is long enough to determine the memory of its noise, and where
    chance leaves as much. It is estimated from the bends that a free start does not take along, up
    to those that the noise was estimated for.

    Parameters
    ----------
    residual : (T, M) array
        Over the noise, in the stacked order of `Records`.
    """
    found, s = np.ones(4), records.ball_time.shape[1]
    if records.tell_memory:
        return found
    squares, counts = np.zeros(4), np.zeros(4)
    for trial in range(records.trials):
        for axis in range(3):
            rows = np.flatnonzero(records.ball_used[trial, :, axis])
            if rows.size > 2 * FREE_START:
                bends = _polynomials(records.ball_time[trial, rows].tobytes(), 0)[:, FREE_START:]
                left = bends.T @ residual[trial, axis * s + rows]
                squares[axis] += float(left @ left)
                counts[axis] += left.size
    total = float(counts.sum())
    if total == 0.0 or squares.sum() <= chdtri(total, APART):
        return found
    return np.maximum(found, squares / np.maximum(counts, 1.0))


def _second_differences(
    noise: Noise, left: Records, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, 3) second differences of places over their noise, and velocities in the same unit.

    As large as one sample's noise each; NaN along coordinates that were not recorded.
    """
    seen = left.ball_used.any(axis=(0, 1))
    shown, along_path = [], []
    for trial in range(left.trials):
        rows = np.flatnonzero(left.ball_used[trial][:, seen].all(axis=1))
        if rows.size < 3:
            continue
        steps = np.diff(left.ball_time[trial, rows])
        even = np.maximum(steps[1:], steps[:-1]) < 1.5 * np.median(steps)
        scaled = left.position[trial, rows] / noise.sigma[trial, :3]
        bent = (scaled[2:] - 2.0 * scaled[1:-1] + scaled[:-2]) / np.sqrt(6.0)
        shown.append(np.where(seen, bent, np.nan)[even])
        along_path.append((velocity[trial, rows[1:-1]] / noise.sigma[trial, :3])[even])
    if not shown:
        return np.zeros((0, 3)), np.zeros((0, 3))
    return np.concatenate(shown), np.concatenate(along_path)
