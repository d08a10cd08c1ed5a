"""Coefficient of restitution: laws e(v) and their parser.

Laws in text are parsed, never executed.
"""

import ast
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

import numpy as np

from metrology import DomainError, UsageError
from physics.domain import FloatOrArray, Number

__all__ = [
    "ConstantCor",
    "CorLaw",
    "ExponentialCor",
    "ExpressionCor",
    "NoValueError",
    "PowerLawCor",
    "ShiftedCor",
    "law_as_text",
    "parse_cor_law",
    "require_cor",
    "require_real",
]


class NoValueError(DomainError):
    """A law of restitution without a real value at an impact speed."""


class CorLaw(Protocol):
    """A law e(v): coefficient of restitution by impact speed in m/s, for floats and arrays."""

    def __call__(self, speed: FloatOrArray) -> FloatOrArray:
        """Coefficient of restitution at impact speed `speed`, m/s."""
        ...


def require_cor(value: Number, speed: Number | None = None) -> None:
    """Reject a coefficient of restitution outside (0, 1]; `speed`, m/s, is for the message.

    Raises
    ------
    DomainError
        If any entry is outside, or not a number.
    """
    values = np.asarray(value, dtype=np.float64)
    outside = ~((values > 0.0) & (values <= 1.0))
    if not outside.any():
        return
    at = ""
    if speed is not None:
        speeds = np.broadcast_to(np.asarray(speed, dtype=np.float64), values.shape)
        at = f" at an impact speed of {speeds[outside].flat[0]:.3g} m/s"
    raise DomainError(
        f"a coefficient of restitution must be above 0 and at most 1, not"
        f" {values[outside].flat[0]:.4g}{at}",
        hint="Use speeds at which the law holds, or give a number such as 0.75.",
    )


def _checked(value: FloatOrArray, speed: FloatOrArray) -> FloatOrArray:
    require_cor(value, speed)
    return value


@dataclass(frozen=True)
class ConstantCor:
    """The same coefficient of restitution at every speed.

    Attributes
    ----------
    value : float
        In (0, 1].
    """

    value: float

    def __post_init__(self) -> None:
        require_cor(self.value)

    def __call__(self, speed: FloatOrArray) -> FloatOrArray:
        """Coefficient of restitution, shaped as `speed`."""
        return speed * 0.0 + self.value


@dataclass(frozen=True)
class ExponentialCor:
    """Negative exponential e(v) = a exp(−b v − c) + d (Eqs 24, 25 of the paper).

    Attributes
    ----------
    amplitude, rate, shift, floor : float
        a (1), b (s/m), c (1), d (1).
    """

    amplitude: float
    rate: float
    shift: float
    floor: float

    def __call__(self, speed: FloatOrArray) -> FloatOrArray:
        """Coefficient of restitution, shaped as `speed` (m/s)."""
        decay: FloatOrArray = np.exp(-self.rate * speed - self.shift)
        return _checked(self.amplitude * decay + self.floor, speed)

    @property
    def at_rest(self) -> ConstantCor:
        """The paper's "constant" law: the value at v = 0."""
        return ConstantCor(self.amplitude * math.exp(-self.shift) + self.floor)


@dataclass(frozen=True)
class PowerLawCor:
    """Visco-elastic contact, e(v) = 1 − a v^p with p = 1/5.

    Kuwabara and Kono, Jpn. J. Appl. Phys. 26, 1230 (1987): leading term for spheres in Hertz
    contact with a viscous part. Speeds at which it would be zero or negative are rejected.

    Attributes
    ----------
    coefficient : float
        a, in (s/m)^p.
    exponent : float
        p.
    """

    coefficient: float
    exponent: float = 0.2

    def __call__(self, speed: FloatOrArray) -> FloatOrArray:
        """Coefficient of restitution, shaped as `speed` (m/s)."""
        root: FloatOrArray = speed**self.exponent
        return _checked(1.0 - self.coefficient * root, speed)


@dataclass(frozen=True)
class ShiftedCor:
    """Another law plus a straight line in the speed: e(v) + offset + slope (v − pivot_speed).

    Attributes
    ----------
    law : CorLaw
        The unmodified law.
    offset : float
        Added at every speed (variation between trials, an error of the law).
    slope : float
        s/m.
    pivot_speed : float
        Speed at which the slope contributes nothing, m/s.
    """

    law: CorLaw
    offset: float = 0.0
    slope: float = 0.0
    pivot_speed: float = 2.5

    def __call__(self, speed: FloatOrArray) -> FloatOrArray:
        """Coefficient of restitution, shaped as `speed` (m/s)."""
        shift = self.offset + self.slope * (speed - self.pivot_speed)
        return _checked(self.law(speed) + shift, speed)


_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}

_VARIABLE = "v"

"""Name of the impact speed in the text of a law."""

_FUNCTION_ARGUMENTS = {"min": 2, "max": 2}

"""Number of arguments of a function in a law; one if not listed."""

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "tanh": np.tanh,
    "abs": np.abs,
    "min": np.minimum,
    "max": np.maximum,
}

_CONSTANTS = {"pi": math.pi, "e": math.e}

_MAX_LAW_CHARACTERS = 1000

"""Maximum length of a law, characters: more than the mean of all fitted laws (cor.toml) has."""


@dataclass(frozen=True)
class ExpressionCor:
    """A law written as text in the impact speed `v` (m/s), such as ``0.13*exp(-0.27*v) + 0.67``.

    The text is parsed to a syntax tree in which only numbers, `v`, + − * / **, and the functions
    exp, log, sqrt, tanh, abs, min, max are allowed; it is never executed as code.

    Attributes
    ----------
    text : str
        The law as typed.
    """

    text: str
    _tree: ast.expr = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.text) > _MAX_LAW_CHARACTERS:
            raise UsageError(
                f"a law of restitution of {len(self.text)} characters is too long",
                hint="Shorten it: six digits per number suffice.",
            )
        try:
            tree = ast.parse(self.text.strip().replace("^", "**"), mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError) as problem:
            raise _bad_law(self.text, "it is no formula") from problem
        _check(tree, self.text)
        object.__setattr__(self, "_tree", tree)

    def __call__(self, speed: FloatOrArray) -> FloatOrArray:
        """Coefficient of restitution, shaped as `speed` (m/s)."""
        try:
            with np.errstate(all="ignore"):
                value = _evaluate(self._tree, speed) + speed * 0.0
        except (ZeroDivisionError, OverflowError, TypeError) as problem:
            raise self._no_value(speed) from problem
        if np.iscomplexobj(value) or not np.all(np.isfinite(np.asarray(value))):
            raise self._no_value(speed)
        return _checked(cast(FloatOrArray, value), speed)

    def _no_value(self, speed: Number) -> NoValueError:
        return NoValueError(
            f"the law of restitution {self.text!r} has no value at {speed} m/s",
            hint="It must give a number above 0 and at most 1 at every speed used.",
        )


def _bad_law(text: str, why: str) -> UsageError:
    return UsageError(
        f"{text!r} is not a law of restitution: {why}",
        hint="Write a number, or a formula in v (m/s) such as '0.13*exp(-0.27*v) + 0.67'.",
    )


def _check(node: ast.expr, text: str) -> None:
    match node:
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            _check(left, text)
            _check(right, text)
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
            _check(operand, text)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS:
            wanted = _FUNCTION_ARGUMENTS.get(name, 1)
            if len(arguments) != wanted:
                raise _bad_law(text, f"{name} takes {wanted} argument(s)")
            for argument in arguments:
                _check(argument, text)
        case ast.Constant(value=value) if type(value) in (int, float):
            pass
        case ast.Name(id=name) if name == _VARIABLE or name in _CONSTANTS:
            pass
        case _:
            raise _bad_law(text, f"{ast.unparse(node)!r} is not allowed in it")


def _evaluate(node: ast.expr, speed: Any) -> Any:
    match node:
        case ast.BinOp(left=left, op=op, right=right):
            return _OPERATORS[type(op)](_evaluate(left, speed), _evaluate(right, speed))
        case ast.UnaryOp(op=op, operand=operand):
            return _OPERATORS[type(op)](_evaluate(operand, speed))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return _FUNCTIONS[name](*(_evaluate(argument, speed) for argument in arguments))
        case ast.Constant(value=value):
            return float(cast(float, value))
        case ast.Name(id=name):
            return speed if name == _VARIABLE else _CONSTANTS[name]
    raise AssertionError("the tree was checked when the law was read")


def parse_cor_law(text: str | float) -> CorLaw:
    """Parse a law of restitution.

    Parameters
    ----------
    text : str or float
        A number in (0, 1], or a formula in the impact speed ``v`` in m/s.

    Returns
    -------
    CorLaw
        Callable on floats and arrays.

    Raises
    ------
    UsageError
        If the text is not an allowed formula; DomainError if it is a number outside (0, 1].
    """
    if isinstance(text, int | float):
        return ConstantCor(float(text))
    try:
        return ConstantCor(float(text))
    except DomainError:
        raise
    except ValueError:
        return ExpressionCor(text)


_TESTED_SPEEDS = 200

"""Speeds tested between slowest and fastest (chosen: 2.6 % apart)."""


def require_real(law: CorLaw, slowest: float, fastest: float) -> None:
    """Reject a law without a real value at some impact speed, or never inside (0, 1].

    Parameters
    ----------
    slowest, fastest : float
        Range to test, m/s.

    Raises
    ------
    DomainError
        If the law is not a real number at one of the speeds, or outside (0, 1] at all of them.
    """
    outside: DomainError | None = None
    within = 0
    for speed in np.geomspace(slowest, fastest, _TESTED_SPEEDS).tolist():
        try:
            law(speed)
            within += 1
        except NoValueError:
            raise
        except DomainError as problem:
            outside = problem
    if within == 0 and outside is not None:
        raise outside


def law_as_text(law: CorLaw) -> str | float:
    """Text of a law in a setup file: a number, or a formula in v (m/s).

    Raises
    ------
    UsageError
        For a law without a formula.
    """
    match law:
        case ConstantCor(value=value):
            return value
        case ExponentialCor(amplitude=a, rate=b, shift=c, floor=d):
            return f"{a!r}*exp(-({b!r})*v - ({c!r})) + {d!r}"
        case ExpressionCor(text=text):
            return text
        case PowerLawCor(coefficient=a, exponent=p):
            return f"1 - {a!r}*v**{p!r}"
        case ShiftedCor(law=inner, offset=offset, slope=slope, pivot_speed=pivot):
            return f"{law_as_text(inner)} + ({offset!r}) + ({slope!r})*(v - {pivot!r})"
    raise UsageError(f"a law of kind {type(law).__name__} has no formula")
