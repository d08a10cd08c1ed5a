"""Quantities for notebooks, and conversion of user input."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NoReturn

from measuring.budget import Propagation
from measuring.chain import MeasureOptions
from measuring.measurement import Axes
from measuring.setup.file import SetupLike, setup_from
from metrology import (
    Contribution,
    MeasurementError,
    Quantity,
    UsageError,
    measurands,
    read_given,
    read_number,
    read_scale,
)
from pipelines.api.wording import in_python
from pipelines.measure.files import column_of, without_formulas
from pipelines.report.inputs import quantity_label, quantity_rows, quantity_text
from pipelines.report.page import results_html
from vision.tracks import MotionKind

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "At",
    "Given",
    "HasQuantities",
    "Quantities",
    "QuantityView",
    "angle_from",
    "as_document",
    "as_row",
    "length_text",
    "measure_options",
    "point_from",
]


@dataclass(frozen=True)
class QuantityView:
    """A number with its standard uncertainty, or the reason why there is none.

    Attributes
    ----------
    name : str
        As in the results table ("launch_angle").
    value : float or None
        Best estimate; None if it could not be measured.
    std : float or None
        Combined standard uncertainty, k = 1.
    unit : str
    reason : str or None
        Why there is no value.
    contributions : tuple of Contribution
        Uncertainty budget, largest first.
    """

    name: str
    value: float | None
    std: float | None
    unit: str
    reason: str | None = None
    contributions: tuple[Contribution, ...] = ()

    @classmethod
    def of(cls, quantity: Quantity) -> "QuantityView":
        """View of a quantity."""
        lines = tuple(sorted(quantity.budget, key=lambda line: -line.std))
        return cls(
            quantity.name,
            quantity.value,
            quantity.std,
            quantity.unit,
            None if quantity.reason is None else in_python(quantity.reason),
            lines,
        )

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return self.value is not None

    @property
    def budget(self) -> "pd.DataFrame":
        """Sources with their `std` and `share` of the variance, largest first."""
        import pandas as pd

        total = sum(line.std**2 for line in self.contributions)
        rows = [
            (str(line.source), line.std, line.std**2 / total if total else 0.0)
            for line in self.contributions
        ]
        return pd.DataFrame(rows, columns=["source", "std", "share"])

    def _plain(self) -> Quantity:
        return Quantity(self.name, self.value, self.std, self.unit, self.reason, self.contributions)

    def __float__(self) -> float:
        if self.value is None:
            raise MeasurementError(f"there is no {quantity_label(self.name)}: {self.reason}")
        return self.value

    def __format__(self, spec: str) -> str:
        return format(float(self), spec) if spec else str(self)

    def __mul__(self, factor: float) -> "QuantityView":
        """The quantity times a plain number; its name and unit stay."""
        return self._scaled(_plain_number(factor))

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> "QuantityView":
        return self._scaled(1.0 / _plain_number(divisor))

    def __neg__(self) -> "QuantityView":
        return self._scaled(-1.0)

    def __add__(self, number: float) -> "QuantityView":
        return replace(self, value=float(self) + _plain_number(number))

    __radd__ = __add__

    def __sub__(self, number: float) -> "QuantityView":
        return self + -_plain_number(number)

    def __rsub__(self, number: float) -> "QuantityView":
        return -self + number

    def _no_power(self, other: object) -> NoReturn:
        raise UsageError(
            f"a power or a reciprocal of {self.name} is another quantity, with another unit",
            hint=f'Compute with m.ufloat("{self.name}"), which keeps the uncertainty, or with'
            " float(…), which drops it.",
        )

    __rtruediv__ = __pow__ = __rpow__ = _no_power

    def __abs__(self) -> "QuantityView":
        return self._scaled(math.copysign(1.0, float(self)))

    def __round__(self, digits: int | None = None) -> float:
        return round(float(self), digits)

    def __lt__(self, other: "float | QuantityView") -> bool:
        return float(self) < float(other)

    def __gt__(self, other: "float | QuantityView") -> bool:
        return float(self) > float(other)

    def __le__(self, other: "float | QuantityView") -> bool:
        return float(self) <= float(other)

    def __ge__(self, other: "float | QuantityView") -> bool:
        return float(self) >= float(other)

    def _scaled(self, factor: float) -> "QuantityView":
        std = None if self.std is None else abs(factor) * self.std
        lines = tuple(
            Contribution(line.source, abs(factor) * line.std) for line in self.contributions
        )
        return replace(self, value=factor * float(self), std=std, contributions=lines)

    def __str__(self) -> str:
        return quantity_text(self._plain())

    def __repr__(self) -> str:
        return f"{self.name}: {self}"

    def _repr_html_(self) -> str:
        return results_html("", [self._plain()])


def _plain_number(number: object) -> float:
    """A number without uncertainty.

    Raises
    ------
    UsageError
        For a second quantity: the errors of both have common sources.
    """
    if isinstance(number, QuantityView):
        raise UsageError(
            f"the errors of two quantities of one clip ({number.name} and another) are correlated",
            hint="Compute with m.ufloat(NAME), which keeps their correlation, or with float(…).",
        )
    return float(number)  # type: ignore[arg-type]


_OTHER_NAMES = {"backswing": "backswing_angle", "backswing_deg": "backswing_angle"}
"""Names of options and lab books for quantities of results."""


class Quantities(Mapping[str, QuantityView]):
    """Quantities by name, in the order of the results table.

    Parameters
    ----------
    quantities : iterable of Quantity
    title : str
        Heading.
    """

    def __init__(self, quantities: Iterable[Quantity], title: str = "") -> None:
        self._plain = tuple(quantities)
        self._views = {item.name: QuantityView.of(item) for item in self._plain}
        self._others = {column_of(item): item.name for item in self._plain} | _OTHER_NAMES
        self._title = title

    def __getitem__(self, name: str) -> QuantityView:
        """The quantity of a name, also of its column in tables: ``ball_speed_m_s``."""
        return self._views[name if name in self._views else self._others.get(name, name)]

    def __iter__(self) -> Iterator[str]:
        return iter(self._views)

    def __len__(self) -> int:
        return len(self._views)

    def __repr__(self) -> str:
        rows = quantity_rows(self._plain)
        wide = max((len(label) for label, _, known in rows if known), default=0)
        lines = [f"{label:<{wide}}  {text}" for label, text, _ in rows]
        return "\n".join([self._title, *lines] if self._title else lines)

    def _repr_html_(self) -> str:
        return results_html(self._title, self._plain)


class HasQuantities:
    """Base of results: every quantity is also an attribute.

    Parameters
    ----------
    quantities : iterable of Quantity
    title : str
        Heading of the table.

    Attributes
    ----------
    quantities : Mapping of str to QuantityView
        In the order of the results table; missing ones carry a reason.
    """

    warnings: tuple[str, ...]

    def __init__(self, quantities: Iterable[Quantity], title: str) -> None:
        self._plain, self._title = tuple(quantities), title
        self.quantities = Quantities(self._plain, title)

    def __getattr__(self, name: str) -> QuantityView:
        quantities = self.__dict__.get("quantities", {})
        if name in quantities:
            found: QuantityView = quantities[name]
            return found
        raise AttributeError(f"there is no {name!r}; its quantities: {[*quantities]}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.quantities]

    def to_dict(self) -> dict[str, Any]:
        """Document ``{"quantities": …, "warnings": …}`` of the contract."""
        return as_document(self.quantities, self.warnings)

    def __repr__(self) -> str:
        return repr(self.quantities)

    def _repr_html_(self) -> str:
        return results_html(self._title, self._plain, self.warnings)


def as_document(quantities: Quantities, warnings: Iterable[str]) -> dict[str, Any]:
    """Document ``{"quantities": …, "warnings": …}`` of the contract."""
    table: dict[str, Any] = {}
    for name, item in quantities.items():
        if item.value is None:
            table[name] = {"value": None, "unit": item.unit, "reason": item.reason}
        else:
            table[name] = {"value": item.value, "std": item.std, "unit": item.unit}
    return {"quantities": table, "warnings": list(warnings)}


def as_row(quantities: Quantities) -> dict[str, object]:
    """One row: NAME_UNIT and NAME_UNIT_std for each quantity."""
    row: dict[str, object] = {}
    for item in quantities.values():
        column = column_of(item._plain())
        row[column], row[f"{column}_std"] = item.value, item.std
    return without_formulas(row)


Given = float | str
"""A number in SI (angles: degrees), or a string with its unit."""

At = Sequence[float] | str | None
"""``(x, y)``, ``(x, y, frame)`` or ``"x,y"``, px."""


def measure_options(
    setup: SetupLike = None,
    fps: Given | None = None,
    ball: Given | None = None,
    wall_grid: Given | None = None,
    ball_at: At = None,
    mass_at: At = None,
    *,
    cache: bool = False,
    scale: Given | None = None,
    budget: Propagation = Propagation.RESPONSE,
    every: int = 1,
    kind: str | None = None,
    pivot_at: At = None,
    landing_at: At = None,
    axes: At = None,
) -> MeasureOptions:
    """Options of the measuring chain, each checked before any work.

    `cache` allows reading and writing earlier results. `scale` is that of the plane of motion (bare
    numbers: m/px) and takes precedence over the wall of the setup. `budget` selects how effects of
    the inputs are propagated. `every` reads every n-th picture only. `kind` is the kind of motion.
    `pivot_at` takes the place of the fitted pivot, `landing_at` that of the flight's end.
    `axes` are origin (px) and turn (degrees) of the axes of positions in metres.

    Raises
    ------
    UsageError, SetupError, UnitError
        For an invalid rate, point, quantity or setup.
    """
    if every < 1:
        raise UsageError(f"--every {every} is no step", hint="Pass 1 for all pictures, or more.")
    rate = None if fps is None else read_given(fps, measurands.CAPTURE_RATE, "--fps")
    if scale is not None and wall_grid is not None:
        raise UsageError(
            "--scale and --wall-grid both set the scale",
            hint="Give the scale of the plane of motion or the wall's grid, not both.",
        )
    return MeasureOptions(
        setup=setup_from(setup),
        fps=None if rate is None else rate.value,
        fps_std=None if rate is None else rate.std,
        ball=length_text(ball),
        wall_grid=length_text(wall_grid),
        ball_at=point_from("--ball-at", ball_at),
        mass_at=point_from("--mass-at", mass_at),
        pivot_at=_fixed_point("--pivot-at", pivot_at),
        landing_at=_fixed_point("--landing-at", landing_at),
        axes=None if axes is None else Axes(*_numbers("--axes", axes, "X,Y or X,Y,DEGREES")),
        scale_m_per_px=None if scale is None else read_scale(scale, "--scale"),
        budget=budget,
        cache=cache,
        every=every,
        kind=None if kind is None else _kind_from(kind),
    )


def _numbers(option: str, at: Any, form: str) -> list[float]:
    """Two or three finite numbers."""
    try:
        parts = [float(part) for part in (at.split(",") if isinstance(at, str) else at)]
    except (TypeError, ValueError):
        parts = []
    if len(parts) not in (2, 3) or not all(math.isfinite(part) for part in parts):
        raise UsageError(f"{option} {at!r} is not {form}", hint=f"As in {option} 120,88")
    return parts


def _fixed_point(option: str, at: At) -> tuple[float, float] | None:
    """A point that is the same in all frames."""
    if at is None:
        return None
    point = _numbers(option, at, "X,Y")
    if len(point) == 3:
        raise UsageError(
            f"{option} {at!r} names a frame, but the point is the same in all frames",
            hint=f"As in {option} 120,88.",
        )
    return point[0], point[1]


def _kind_from(text: str) -> MotionKind:
    kinds = [one.value for one in MotionKind if one is not MotionKind.NONE]
    if text not in kinds:
        raise UsageError(
            f"--kind {text!r} is no kind of motion", hint=f"One of {', '.join(kinds)}."
        )
    return MotionKind(text)


def length_text(length: Given | None) -> str | None:
    """A length as text; bare numbers are metres.

    Raises
    ------
    UsageError
        If it is neither text nor a number.
    """
    if length is None or isinstance(length, str):
        return length
    try:
        return f"{float(length)!r} m"
    except (TypeError, ValueError) as problem:
        raise UsageError(
            f"{length!r} is no length", hint="Write '50 mm', or a number of metres."
        ) from problem


def angle_from(name: str, angle: "Given | QuantityView") -> float:
    """An angle in rad from text with its unit, or from a quantity.

    Raises
    ------
    UsageError
        For a bare number, which may be degrees or radians.
    """
    if isinstance(angle, QuantityView):
        return math.radians(float(angle))
    return read_number(angle, measurands.BACKSWING, name)


def point_from(option: str, at: At) -> tuple[float, float] | tuple[float, float, int] | None:
    """A point in the picture, with a frame or without.

    Raises
    ------
    UsageError
        If it is not a point.
    """
    if at is None:
        return None
    parts = _numbers(option, at, "X,Y or X,Y,FRAME")
    if len(parts) == 2:
        return parts[0], parts[1]
    return parts[0], parts[1], int(parts[2])
