"""``cor.toml``: fitted laws of restitution per ball, with covariance.

::

    [balls.jokku]
    law = "exponential"         # e = a exp(-b v) + d; power: e = 1 - a v^(1/5); constant: d;
                                # linear: d + k v; free: e1 ... e9, evenly over the speeds
    parameters = { a = 0.1073, b = 0.2685, d = 0.6746 }
    covariance = [[…], […], […]]         # of the parameters, in that order; b in s/m
    speeds = [1.12, 3.92]                # m/s, between which it was fitted
    strike_scatter = 0.005               # one sigma, strike to strike
    session_scatter = 0.002              # one sigma, session to session
    level_scatter = 0.003                # one sigma, level (setting) to level
    probability = 0.88                   # of this law, the most probable; default 1

    [[balls.jokku.other_laws]]           # further laws compatible with the strikes, same keys
    law = "constant"
    probability = 0.12
    parameters = { d = 0.7311 }
    covariance = [[1e-4]]

The law used is the mean of the laws, weighted by probability; its uncertainty includes that of the
choice of law (Hoeting et al., Statistical Science 14, 382, 1999).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from measuring.setup.tables import Setup
from metrology import SetupError, UsageError, parse_toml, read_small_text, write_text_whole
from physics.bodies import Ball
from physics.cor_fit import FREE_KNOTS, LAW_PARAMETERS, CorLawFit, LawKind, curve
from physics.domain import FloatArray
from physics.forward import PlanScatter
from physics.restitution import (
    ConstantCor,
    CorLaw,
    ExponentialCor,
    ExpressionCor,
    PowerLawCor,
    law_as_text,
)

__all__ = [
    "BallLaw",
    "FittedLaw",
    "ball_law",
    "law_of_ball",
    "read_cor_file",
    "with_laws",
    "write_cor_file",
]


_MAX_SUM_ERROR = 1e-3
"""Maximum deviation of the sum of probabilities from 1 (chosen: rounding to three digits)."""

PARAMETER_STEP = 1e-6
"""Step of the numerical derivative, in each parameter's unit (chosen; parameters: 0.1 to 1)."""


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """One law of restitution and its probability among those compared.

    Attributes
    ----------
    parameters : mapping of str to float
        As `LAW_PARAMETERS`; b and k in s/m.
    covariance : (P, P) array
        Of the parameters, in the order of `LAW_PARAMETERS`.
    probability : float
        In (0, 1].
    speeds : (2,) tuple of float
        m/s, over which the free form has its knots.
    """

    kind: LawKind
    parameters: Mapping[str, float]
    covariance: FloatArray
    probability: float = 1.0
    speeds: tuple[float, float] = (1.0, 4.0)

    @property
    def law(self) -> CorLaw:
        """The law e(v); of the free form, straight between its knots."""
        return _law(self.kind, self._vector, self.speeds)

    @property
    def _vector(self) -> FloatArray:
        return np.array([self.parameters[name] for name in LAW_PARAMETERS[self.kind]])

    def value_at(self, speed: float) -> float:
        """Coefficient of restitution at an impact speed, m/s, also outside (0, 1]."""
        return self._value(self._vector, speed)

    def _value(self, vector: FloatArray, speed: float) -> float:
        return float(curve(self.kind, vector[None, :], np.array([speed]), self.speeds)[0, 0])

    def std_at(self, speed: float) -> float:
        """Standard uncertainty of the law at an impact speed, m/s."""
        centre = self._vector
        slope = np.array(
            [
                (
                    self._value(centre + PARAMETER_STEP * axis, speed)
                    - self._value(centre - PARAMETER_STEP * axis, speed)
                )
                / (2.0 * PARAMETER_STEP)
                for axis in np.eye(len(centre))
            ]
        )
        return float(np.sqrt(max(slope @ self.covariance @ slope, 0.0)))


@dataclass(frozen=True, eq=False)
class BallLaw:
    """Laws of restitution of a ball from a campaign.

    Attributes
    ----------
    laws : tuple of FittedLaw
        Laws compared, the most probable first; their probabilities sum to 1.
    speeds : (2,) tuple of float
        m/s, range of the fit.
    strike_scatter, session_scatter, level_scatter : float
        One sigma, strike to strike, session to session and level to level.
    """

    ball: str
    laws: tuple[FittedLaw, ...]
    speeds: tuple[float, float]
    strike_scatter: float = 0.0
    session_scatter: float = 0.0
    level_scatter: float = 0.0

    @property
    def law(self) -> CorLaw:
        """Mean of the laws, weighted by probability."""
        if len(self.laws) == 1:
            return self.laws[0].law
        parts = [f"{one.probability!r}*({law_as_text(one.law)})" for one in self.laws]
        return ExpressionCor(" + ".join(parts))

    def std_at(self, speed: float) -> float:
        """Standard uncertainty of the mean law at an impact speed, m/s, with the choice of law."""
        weights = np.array([one.probability for one in self.laws])
        values = np.array([one.value_at(speed) for one in self.laws])
        own = np.array([one.std_at(speed) for one in self.laws])
        apart = values - weights @ values
        return float(np.sqrt(weights @ (own**2 + apart**2)))

    def scatter_at(self, speed: float, scatter: PlanScatter) -> PlanScatter:
        """Scatter with the campaign's restitution at an impact speed, m/s."""
        return replace(scatter, cor_law=self.std_at(speed), cor=self.scatter or scatter.cor)

    @property
    def scatter(self) -> float:
        """One sigma of a strike in a new session at a new level."""
        return float(
            np.linalg.norm([self.strike_scatter, self.session_scatter, self.level_scatter])
        )

    def struck(self, ball: Ball) -> Ball:
        """The ball with this law and its speed range."""
        return replace(ball, cor=self.law, cor_range=self.speeds)


def _law(kind: LawKind, vector: FloatArray, speeds: tuple[float, float]) -> CorLaw:
    values = [float(v) for v in vector]
    match kind:
        case LawKind.EXPONENTIAL:
            a, b, d = values
            return ExponentialCor(a, b, 0.0, d)
        case LawKind.POWER:
            return PowerLawCor(values[0])
        case LawKind.LINEAR:
            return ExpressionCor(f"{values[0]!r} + ({values[1]!r})*v")
        case LawKind.CONSTANT:
            return ConstantCor(values[0])
    return ExpressionCor(_free_text(vector, speeds))


def _free_text(vector: FloatArray, speeds: tuple[float, float]) -> str:
    """Formula of the straight lines between the knots; the end slopes continue beyond them."""
    knots = np.linspace(*speeds, FREE_KNOTS)
    slopes = np.diff(vector) / np.diff(knots)
    bends = zip(np.diff(slopes), knots[1:-1], strict=True)
    hinges = " + ".join(f"({bend:.6g})*max(v - {knot:.6g}, 0)" for bend, knot in bends)
    return f"{vector[0]:.8g} + ({slopes[0]:.8g})*(v - {knots[0]:.6g}) + {hinges}"


_MIN_LAW_PROBABILITY = 1e-3
"""Probability below which a law is dropped: it changes the mean curve by less than 0.1 % of
its difference from it."""


def ball_law(name: str, fits: Sequence[CorLawFit]) -> BallLaw:
    """The fits of a ball in the form that the file keeps."""
    kept = [fit for fit in fits if fit.probability >= _MIN_LAW_PROBABILITY]
    total = sum(fit.probability for fit in kept)
    shares = np.array([fit.probability / total for fit in kept])
    scatters = [
        shares @ [one.value for one in each]
        for each in zip(
            *((fit.strike_scatter, fit.session_scatter, fit.level_scatter) for fit in kept),
            strict=True,
        )
    ]
    laws = tuple(
        FittedLaw(
            fit.law,
            {key: item.value for key, item in fit.parameters.items()},
            fit.covariance,
            float(share),
            fit.speeds,
        )
        for fit, share in zip(kept, shares, strict=True)
    )
    return BallLaw(name, laws, fits[0].speeds, *(float(one) for one in scatters))


def _number(written: Any) -> Any:
    """A number, or the ``value`` of a table (its ``std`` is in the covariance, too)."""
    return written.get("value") if isinstance(written, dict) else written


Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Parameter = Annotated[Finite, BeforeValidator(_number)]


class _LawTable(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)

    law: LawKind
    parameters: dict[str, Parameter]
    covariance: list[list[Finite]]
    probability: Annotated[Finite, Field(gt=0, le=1)] = 1.0


class _BallTable(_LawTable):
    other_laws: tuple[_LawTable, ...] = ()
    speeds: tuple[Finite, Finite]
    strike_scatter: Annotated[Finite, Field(ge=0, le=1)] = 0.0
    session_scatter: Annotated[Finite, Field(ge=0, le=1)] = 0.0
    level_scatter: Annotated[Finite, Field(ge=0, le=1)] = 0.0


class _CorFile(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)

    balls: dict[str, _BallTable]


def read_cor_file(path: Path) -> dict[str, BallLaw]:
    """Read the laws of a ``cor.toml`` by ball.

    Raises
    ------
    SetupError
        If it can't be read, lacks a number, or its covariance is invalid.
    """
    text = read_small_text(
        path,
        what="the laws of restitution in",
        hint="Give the cor.toml that `vision campaign` wrote.",
        error=SetupError,
    )
    try:
        tables = _CorFile.model_validate(parse_toml(text, str(path))).balls
    except ValidationError as problem:
        first = problem.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise SetupError(
            f"{path}: {where}: {first['msg']}",
            hint="A ball has law, parameters, covariance and speeds.",
        ) from problem
    return {name: _ball_law(name, table, path) for name, table in tables.items()}


def _ball_law(name: str, table: _BallTable, path: Path) -> BallLaw:
    where = f"{path}: balls.{name}"
    low, high = table.speeds
    if not 0.0 < low <= high:
        raise SetupError(
            f"{where}: speeds {low:g} to {high:g} m/s are not a range",
            hint="Write speeds = [lowest, highest], both above zero.",
        )
    tables = (table, *table.other_laws)
    total = sum(one.probability for one in tables)
    if abs(total - 1.0) > _MAX_SUM_ERROR:
        raise SetupError(
            f"{where}: the probabilities of its laws sum to {total:g}",
            hint="Give the probabilities of all laws compared; they must sum to 1.",
        )
    laws = tuple(_fitted_law(one, where, table.speeds) for one in tables)
    scatters = table.strike_scatter, table.session_scatter, table.level_scatter
    law = BallLaw(name, laws, table.speeds, *scatters)
    try:
        law.law(low), law.law(high)
    except UsageError as problem:
        raise SetupError(f"{where}: {problem.message}", hint=problem.hint) from problem
    return law


def _fitted_law(table: _LawTable, where: str, speeds: tuple[float, float]) -> FittedLaw:
    wanted = LAW_PARAMETERS[table.law]
    if set(table.parameters) != set(wanted):
        raise SetupError(
            f"{where}: the {table.law.value} law has the parameters"
            f" {', '.join(wanted)}, not {', '.join(table.parameters)}",
            hint="Use the file as written by `vision campaign`, or name every parameter.",
        )
    if table.law is LawKind.FREE and speeds[0] == speeds[1]:
        raise SetupError(
            f"{where}: a free law needs a range of speeds", hint="Write speeds = [lowest, highest]."
        )
    size = len(wanted)
    if [len(row) for row in table.covariance] != [size] * size:
        raise SetupError(
            f"{where}: the covariance is not {size} by {size}",
            hint="Write a row and a column for each parameter.",
        )
    covariance = np.array(table.covariance)
    scale = float(np.abs(covariance).max()) or 1.0
    lowest = float(np.linalg.eigvalsh(0.5 * (covariance + covariance.T)).min())
    if np.abs(covariance - covariance.T).max() > 1e-9 * scale or lowest < -1e-9 * scale:
        raise SetupError(
            f"{where}: the covariance is not a valid covariance matrix",
            hint="It must be symmetric, with no variance below zero.",
        )
    return FittedLaw(table.law, table.parameters, covariance, table.probability, speeds)


def write_cor_file(path: Path, laws: Mapping[str, BallLaw]) -> None:
    """Write the laws of a campaign, completely or not at all."""
    balls = {
        name: {
            **_law_table(law.laws[0]),
            "speeds": [float(v) for v in law.speeds],
            "strike_scatter": float(law.strike_scatter),
            "session_scatter": float(law.session_scatter),
            "level_scatter": float(law.level_scatter),
            **({"other_laws": [_law_table(one) for one in law.laws[1:]]} if law.laws[1:] else {}),
        }
        for name, law in laws.items()
    }
    write_text_whole(path, tomli_w.dumps({"balls": balls}))


def _law_table(law: FittedLaw) -> dict[str, Any]:
    return {
        "law": law.kind.value,
        "probability": float(law.probability),
        "parameters": {key: float(law.parameters[key]) for key in LAW_PARAMETERS[law.kind]},
        "covariance": [[float(v) for v in row] for row in law.covariance],
    }


def law_of_ball(laws: Mapping[str, BallLaw], ball: str) -> BallLaw:
    """Law of a ball; if the file has only one law, that one.

    Raises
    ------
    UsageError
        If the file has only other balls.
    """
    if ball in laws:
        return laws[ball]
    if len(laws) == 1:
        return next(iter(laws.values()))
    raise UsageError(
        f"there is no law of restitution for the ball {ball!r}",
        hint=f"There are laws for {', '.join(laws) or 'none'}: choose one with --ball.",
    )


def with_laws(setup: Setup, laws: Mapping[str, BallLaw]) -> Setup:
    """A setup with the laws of a campaign and their uncertainty."""
    balls = {
        name: replace(ball, cor=laws[name].law) if name in laws else ball
        for name, ball in setup.balls.items()
    }
    ball = setup.ball
    if ball is not None and (ball.name in laws or len(laws) == 1):
        ball = replace(ball, cor=law_of_ball(laws, ball.name).law)
    law_std = max(law.std_at(v) for law in laws.values() for v in law.speeds)
    own = max(law.scatter for law in laws.values())
    scatter = replace(setup.scatter, cor_law=law_std, cor=own or setup.scatter.cor)
    return replace(setup, ball=ball, balls=balls, scatter=scatter)
