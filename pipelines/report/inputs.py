"""Content of a report: quantities, checks, warnings, curves, and their labels.

Positions and times are SI: x from the ball's centre at rest, y up from the floor, time from the
first frame.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from measuring.checks import Check
from metrology import Quantity
from metrology.quantity import format_quantity, format_value

__all__ = [
    "Curve",
    "GapRecord",
    "Moment",
    "PathRecord",
    "ReportInput",
    "SpeedRecord",
    "for_people",
    "quantity_label",
    "quantity_rows",
    "quantity_text",
]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Moment:
    """An instant with its standard uncertainty, s."""

    time_s: float
    std_s: float


@dataclass(frozen=True)
class Curve:
    """A fitted curve: two arrays of the same length and a label."""

    x: FloatArray
    y: FloatArray
    label: str


@dataclass(frozen=True)
class GapRecord:
    """Distance between the pendulum's face and the ball around contact.

    Attributes
    ----------
    time_s, gap_m, gap_std_m : (N,) arrays
        Measured gap; negative where ball and face overlap (the ball is compressed).
    onset, release : Moment or None
        Start and end of contact.
    fits : tuple of Curve
        The branches before and after contact.
    """

    time_s: FloatArray
    gap_m: FloatArray
    gap_std_m: FloatArray
    onset: Moment | None = None
    release: Moment | None = None
    fits: tuple[Curve, ...] = ()


@dataclass(frozen=True)
class SpeedRecord:
    """Speed of one body.

    Attributes
    ----------
    label : str
        "ball" or "pendulum".
    time_s, speed, speed_std : (N,) arrays
        Speed frame by frame, m/s.
    fits : tuple of Curve
        Speed of the fitted motion.
    """

    label: str
    time_s: FloatArray
    speed: FloatArray
    speed_std: FloatArray
    fits: tuple[Curve, ...] = ()


@dataclass(frozen=True)
class PathRecord:
    """The ball's path on the wall and the residuals of its fit.

    Attributes
    ----------
    time_s, x_m, y_m, x_std_m, y_std_m : (N,) arrays
        Centres with standard uncertainties.
    fits : tuple of Curve
        Fitted path (x, y).
    landing : (2,) tuple of float or None
        Where the ball's centre is at landing, m.
    landing_std_m : float or None
        Standard uncertainty of the landing distance, m.
    residual_time_s, residual_x_m, residual_y_m, residual_std_m : (M,) arrays
        Measured minus fitted, for the frames of the fit.
    """

    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    x_std_m: FloatArray
    y_std_m: FloatArray
    fits: tuple[Curve, ...] = ()
    landing: tuple[float, float] | None = None
    landing_std_m: float | None = None
    residual_time_s: FloatArray | None = None
    residual_x_m: FloatArray | None = None
    residual_y_m: FloatArray | None = None
    residual_std_m: FloatArray | None = None


@dataclass(frozen=True)
class ReportInput:
    """Content of the page.

    Attributes
    ----------
    title : str
        Heading, usually the clip's name.
    facts : tuple of (str, str)
        Clip and setup: name and value, in order.
    quantities : tuple of Quantity
        In the order of the results table.
    still_png : bytes or None
        A frame with the overlay.
    version : str
        Of the software.
    defaults : tuple of str
        Default values that were used, a line each.
    seen : tuple of (str, str)
        Motion, ball and other moving objects, each with the evidence for it.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    quantities: tuple[Quantity, ...]
    checks: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()
    gap: GapRecord | None = None
    speeds: tuple[SpeedRecord, ...] = ()
    path: PathRecord | None = None
    still_png: bytes | None = None
    version: str = ""
    defaults: tuple[str, ...] = ()
    seen: tuple[tuple[str, str], ...] = ()

    def worded(self, word: Callable[[str], str]) -> Self:
        """The same with other words in its messages."""
        said = [
            one if one.reason is None else replace(one, reason=word(one.reason))
            for one in self.quantities
        ]
        return replace(
            self,
            quantities=tuple(said),
            checks=tuple(replace(one, statement=word(one.statement)) for one in self.checks),
            warnings=tuple(map(word, self.warnings)),
            defaults=tuple(map(word, self.defaults)),
            seen=tuple((name, word(evidence)) for name, evidence in self.seen),
        )


COUNTS = frozenset({"contact_frames"})
"""Quantities that are whole numbers."""

_LABELS = {
    "contact_frames": "contact frames",
    "contact_time": "contact time Δt",
    "contact_start": "contact begins",
    "contact_end": "contact ends",
    "pendulum_speed_before": "pendulum speed before",
    "pendulum_speed_after": "pendulum speed after",
    "ball_speed": "ball speed at release",
    "launch_angle": "launch angle",
    "landing_distance": "landing distance, corrected",
    "landing_distance_on_wall": "landing distance as read on the wall",
    "landing_time": "time from first contact to landing",
    "cor_speeds": "COR from the speeds (Eq. 2)",
    "cor_launch": "COR from the launch (Eqs 9–10)",
    "cor_range": "COR from the range (Eq. 17)",
    "cor": "COR, mean of the estimates",
    "external_impulse": "external impulse on the ball",
    "energy_loss": "energy the pendulum loses (Eq. 18)",
    "backswing_angle": "back-swing angle",
    "ball_plane_offset": "ball plane in front of the wall",
    "camera_distance": "camera to wall",
    "fall_acceleration": "acceleration of the fall",
    "flight_speed": "speed at the first frame of the flight",
    "flight_angle": "angle at the first frame of the flight",
    "swing_period": "period of the swing",
    "swing_damping": "damping of the swing",
    "speed_before": "speed before, of the ball initially at rest",
    "speed_after": "speed after, of the ball initially at rest",
    "other_speed_before": "speed before, of the other ball",
    "other_speed_after": "speed after, of the other ball",
    "cor_collision": "COR along the line of centres",
    "cor_bounce": "COR of the first bounce",
    "roll_acceleration": "acceleration along the line",
    "roll_speed": "speed at the first frame of the roll",
    "gravity_check": "free fall of the flight",
    "ball_speed_per_frame": "ball speed by displacement per frame (Fig. 18)",
    "ball_speed_eq7": "ball speed from the pendulum (Eq. 7)",
}


def quantity_label(name: str) -> str:
    """Label of a quantity; without one, its name in words."""
    own = name.removesuffix("_px")
    return _LABELS.get(own, own.replace("_", " "))


def quantity_text(quantity: Quantity) -> str:
    """Value ± std with its unit, a count without decimals; the reason where there is no value."""
    if quantity.value is None:
        return f"– {quantity.reason}"
    if quantity.name in COUNTS:
        return f"{quantity.value:.0f} ± {quantity.std:.1f}"
    if quantity.std == 0.0:
        return format_value(quantity.value, None, quantity.unit)
    return format_quantity(for_people(quantity))


def quantity_rows(quantities: Iterable[Quantity]) -> list[tuple[str, str, bool]]:
    """Label, text and whether it is known: first what is known, then each reason, once for all."""
    known, missing = [], dict[str, list[str]]()
    for one in quantities:
        label, text = quantity_label(one.name), quantity_text(one)
        if one.known:
            known.append((label, text, True))
        else:
            missing.setdefault(text, []).append(label)
    return known + [("; ".join(labels), text, False) for text, labels in missing.items()]


def for_people(quantity: Quantity) -> Quantity:
    """The quantity in the unit that people read; files hold SI."""
    if quantity.name not in _IN_MILLISECONDS or quantity.value is None or quantity.std is None:
        return quantity
    budget = tuple(replace(line, std=1e3 * line.std) for line in quantity.budget)
    value, std = 1e3 * quantity.value, 1e3 * quantity.std
    return replace(quantity, value=value, std=std, unit="ms", budget=budget)


_IN_MILLISECONDS = frozenset({"contact_time", "contact_start", "contact_end"})
"""Times that people read in ms; files hold seconds."""
