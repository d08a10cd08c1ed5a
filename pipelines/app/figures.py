"""Numbers of a measurement for the page, each with how far it can be trusted."""

from dataclasses import dataclass
from enum import StrEnum

from measuring.checker.scene import Finding
from measuring.checks import Check, CheckKind, CheckOutcome
from measuring.inputs import (
    LENGTHLESS_UNITS,
    TIMELESS_UNITS,
    kinds_of,
    main_quantities,
)
from measuring.measurement import ClipMeasurement, motion_warning
from metrology import Contribution, Quantity
from metrology.quantity import format_pair, format_unit
from pipelines.report.inputs import for_people, quantity_label

__all__ = ["Figure", "Standing", "figures_of"]

LARGE_FIGURES = 4
"""Numbers that are displayed large (convention of the page)."""


class Standing(StrEnum):
    """How far a number can be trusted."""

    SOUND = "sound"
    ASSUMED = "assumed"
    CONTRADICTED = "contradicted"
    MISSING = "missing"


@dataclass(frozen=True)
class Figure:
    """A number as it is displayed.

    Attributes
    ----------
    name : str
        As in the results table.
    value, std, unit : str
        Without a value: empty.
    why : str
        What is assumed, what contradicts it, or why there is no value.
    budget : tuple of (str, str, float)
        Source, its contribution with the unit, its fraction of the variance; largest first.
    """

    name: str
    label: str
    value: str
    std: str
    unit: str
    standing: Standing
    why: str = ""
    budget: tuple[tuple[str, str, float], ...] = ()


_CONTRADICTED_QUANTITIES = {
    CheckKind.COR_AGREEMENT: ("cor_speeds", "cor_launch", "cor_range", "cor"),
    CheckKind.BALL_SPEEDS: ("ball_speed",),
    CheckKind.CONTACT_BOUND: ("contact_time",),
    CheckKind.PENDULUM_LENGTH: ("pendulum_speed_before", "pendulum_speed_after", "cor"),
    CheckKind.PASSIVE: ("pendulum_speed_after", "ball_speed", "cor"),
    CheckKind.RELEASE: ("ball_speed", "launch_angle"),
    CheckKind.STEADY_FALL: ("fall_acceleration", "flight_speed"),
    CheckKind.MOMENTUM: ("speed_after", "other_speed_after", "cor_collision"),
}
"""Quantities that a failed check contradicts; the other checks concern rate and scale."""


def figures_of(measured: ClipMeasurement) -> tuple[Figure, ...]:
    """Quantities of the observed motion, the main ones first, those without a value last."""
    kind = measured.motion.measured_as
    main = [str(name) for name in main_quantities(kind)]
    own = [item for item in measured.quantities if item.known or kind in kinds_of(item.name)]
    place = {name: number for number, name in enumerate(main)}
    own.sort(key=lambda item: (not item.known, place.get(item.name, len(place))))
    return tuple(_figure(item, measured) for item in own)


def _figure(item: Quantity, measured: ClipMeasurement) -> Figure:
    label = quantity_label(item.name)
    if item.value is None:
        return Figure(item.name, label, "", "", "", Standing.MISSING, item.reason or "")
    standing, why = _standing(item, measured)
    shown = for_people(item)
    assert shown.value is not None
    unit = format_unit(shown.unit)
    value, std = format_pair(shown.value, shown.std)
    budget = _budget(shown.budget, shown.std, unit)
    return Figure(item.name, label, value, std or "", unit, standing, why, budget)


def _budget(
    lines: tuple[Contribution, ...], std: float | None, unit: str
) -> tuple[tuple[str, str, float], ...]:
    ordered = sorted(lines, key=lambda line: -abs(line.std))
    total = std or 1.0
    return tuple(
        (str(line.source), f"{abs(line.std):.2g} {unit}".strip(), (line.std / total) ** 2)
        for line in ordered
    )


def _standing(item: Quantity, measured: ClipMeasurement) -> tuple[Standing, str]:
    for finding in measured.findings:
        if finding.key != "facts" and _changes(finding, item.unit):
            # the messages have the rest of it, and the cure
            return Standing.CONTRADICTED, f"{finding.sentence.partition('. ')[0].rstrip('.')}."
    for check in measured.checks:
        if check.outcome is CheckOutcome.FAILED and _contradicts(check, item):
            return Standing.CONTRADICTED, check.statement
    # every number is one of the kind of motion that is assumed
    if doubt := motion_warning(measured.motion):
        return Standing.ASSUMED, doubt[0]
    for assumption in measured.assumed:
        if item.name in assumption.concerned:
            return Standing.ASSUMED, assumption.sentence
    return Standing.SOUND, ""


def _changes(finding: Finding, unit: str) -> bool:
    """Whether the input at fault changes quantities of a unit."""
    unchanged = TIMELESS_UNITS if finding.key in ("rate", "pace") else LENGTHLESS_UNITS
    return unit not in unchanged


def _contradicts(check: Check, item: Quantity) -> bool:
    names = _CONTRADICTED_QUANTITIES.get(check.kind)
    return item.unit not in ("1", "deg") if names is None else item.name in names
