"""``cor.toml``: fitted laws of restitution per ball, with covariance.

::

    [balls.jokku]
    law = "exponential"         # e = a exp(-b v) + d; power: e = 1 - a v^(1/5); constant: d
    parameters = { a = 0.1073, b = 0.2685, d = 0.6746 }
    covariance = [[…], […], […]]         # of the parameters, in that order; b in s/m
    speeds = [1.12, 3.92]                # m/s, between which it was fitted
    strike_scatter = 0.005               # one sigma, strike to strike
    session_scatter = 0.002              # one sigma, session to session
    probability = 0.88                   # of this law, the most probable; default 1

    [[balls.jokku.other_laws]]           # further laws compatible with the strikes, same keys
    law = "constant"
    probability = 0.12
    parameters = { d = 0.7311 }
    covariance = [[1e-4]]

The law used is the mean of the laws, weighted by probability; its uncertainty includes that of the
choice of law (Hoeting et al., Statistical Science 14, 382, 1999).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from metrology import SetupError, UsageError, parse_toml, read_small_text, write_text_whole
from physics.bodies import Ball
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
from pipelines.setup.tables import Setup

__all__ = [
    "BallLaw",
    "FittedLaw",
    "LawKind",
    "law_of_ball",
    "read_cor_file",
    "with_laws",
    "write_cor_file",
]


class LawKind(StrEnum):
    """The laws that a campaign fits."""

    EXPONENTIAL = "exponential"
    POWER = "power"
    CONSTANT = "constant"


PARAMETERS = {
    LawKind.EXPONENTIAL: ("a", "b", "d"),
    LawKind.POWER: ("a",),
    LawKind.CONSTANT: ("d",),
}
"""Names in the order of the covariance."""

_MAX_SUM_ERROR = 1e-3
"""Maximum deviation of the sum of probabilities from 1 (chosen: rounding to three digits)."""

PARAMETER_STEP = 1e-6
"""Step of the numerical derivative, in each parameter's unit (chosen; parameters: 0.1 to 1)."""


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """One law of restitution and its probability among those compared.

    Attributes
    ----------
    kind : LawKind
    parameters : mapping of str to float
        exponential: e = a exp(−b v) + d, b in s/m; power: e = 1 − a v^(1/5); constant: e = d.
    covariance : (P, P) array
        Of the parameters, in the order of `PARAMETERS`.
    probability : float
        In (0, 1].
    """

    kind: LawKind
    parameters: Mapping[str, float]
    covariance: FloatArray
    probability: float = 1.0

    @property
    def law(self) -> CorLaw:
        """The law e(v)."""
        return _law(self.kind, self._vector)

    @property
    def _vector(self) -> FloatArray:
        return np.array([self.parameters[name] for name in PARAMETERS[self.kind]])

    def value_at(self, speed: float) -> float:
        """Coefficient of restitution at an impact speed, m/s, also outside (0, 1]."""
        return _value(self.kind, self._vector, speed)

    def std_at(self, speed: float) -> float:
        """Standard uncertainty of the law at an impact speed, m/s."""
        centre = self._vector
        slope = np.array(
            [
                (
                    _value(self.kind, centre + PARAMETER_STEP * axis, speed)
                    - _value(self.kind, centre - PARAMETER_STEP * axis, speed)
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
    ball : str
    laws : tuple of FittedLaw
        Laws compared, the most probable first; their probabilities sum to 1.
    speeds : (2,) tuple of float
        m/s, range of the fit.
    strike_scatter, session_scatter : float
        One sigma, strike to strike and session to session.
    """

    ball: str
    laws: tuple[FittedLaw, ...]
    speeds: tuple[float, float]
    strike_scatter: float = 0.0
    session_scatter: float = 0.0

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
        own = float(np.hypot(self.strike_scatter, self.session_scatter))
        return replace(scatter, cor_law=self.std_at(speed), cor=own or scatter.cor)

    def struck(self, ball: Ball) -> Ball:
        """The ball with this law and its speed range."""
        return replace(ball, cor=self.law, cor_range=self.speeds)


def _value(kind: LawKind, vector: FloatArray, speed: float) -> float:
    match kind:
        case LawKind.EXPONENTIAL:
            a, b, d = vector
            return float(a * np.exp(-b * speed) + d)
        case LawKind.POWER:
            return float(1.0 - vector[0] * speed**0.2)
        case LawKind.CONSTANT:
            return float(vector[0])


def _law(kind: LawKind, vector: FloatArray) -> CorLaw:
    match kind:
        case LawKind.EXPONENTIAL:
            a, b, d = (float(v) for v in vector)
            return ExponentialCor(a, b, 0.0, d)
        case LawKind.POWER:
            return PowerLawCor(float(vector[0]))
        case LawKind.CONSTANT:
            return ConstantCor(float(vector[0]))


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
    laws = tuple(_fitted_law(one, where) for one in tables)
    law = BallLaw(name, laws, table.speeds, table.strike_scatter, table.session_scatter)
    try:
        law.law(low), law.law(high)
    except UsageError as problem:
        raise SetupError(f"{where}: {problem.message}", hint=problem.hint) from problem
    return law


def _fitted_law(table: _LawTable, where: str) -> FittedLaw:
    wanted = PARAMETERS[table.law]
    if set(table.parameters) != set(wanted):
        raise SetupError(
            f"{where}: the {table.law.value} law has the parameters"
            f" {', '.join(wanted)}, not {', '.join(table.parameters)}",
            hint="Use the file as written by `vision campaign`, or name every parameter.",
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
    return FittedLaw(table.law, table.parameters, covariance, table.probability)


def write_cor_file(path: Path, laws: Mapping[str, BallLaw]) -> None:
    """Write the laws of a campaign, completely or not at all."""
    balls = {
        name: {
            **_law_table(law.laws[0]),
            "speeds": [float(v) for v in law.speeds],
            "strike_scatter": float(law.strike_scatter),
            "session_scatter": float(law.session_scatter),
            **({"other_laws": [_law_table(one) for one in law.laws[1:]]} if law.laws[1:] else {}),
        }
        for name, law in laws.items()
    }
    write_text_whole(path, tomli_w.dumps({"balls": balls}))


def _law_table(law: FittedLaw) -> dict[str, Any]:
    return {
        "law": law.kind.value,
        "probability": float(law.probability),
        "parameters": {key: float(law.parameters[key]) for key in PARAMETERS[law.kind]},
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
    own = max(float(np.hypot(law.strike_scatter, law.session_scatter)) for law in laws.values())
    scatter = replace(setup.scatter, cor_law=law_std, cor=own or setup.scatter.cor)
    return replace(setup, ball=ball, balls=balls, scatter=scatter)
