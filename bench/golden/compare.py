"""Compare two sets of results: what moved, and whether it came nearer to the truth."""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

__all__ = ["MAX_MOVE", "Judged", "Move", "moves", "unlisted"]

MAX_MOVE = 0.2
"""Change in stated standard uncertainties up to which a value counts as the same; convention."""
MAX_PROBABILITY_MOVE = 0.01
"""Change of a probability up to which it counts as the same; convention."""
FAR_SIGMAS = 4.0
"""Standard uncertainties from the truth beyond which a value is better withheld; convention."""

Record = Mapping[str, Any]


class Judged(Enum):
    """Position relative to the truth after a change."""

    NEARER = "nearer"
    FARTHER = "farther"
    UNKNOWN = "truth unknown"


@dataclass(frozen=True)
class Move:
    """One change.

    Attributes
    ----------
    item, what : str
        Key of the item and name of what changed in it.
    before, after : str
        As printed.
    """

    item: str
    what: str
    before: str
    after: str
    judged: Judged

    def __str__(self) -> str:
        change = f"{self.before} → {self.after}"
        return f"{self.item}: {self.what}: {change} ({self.judged.value})"


def moves(
    before: Mapping[str, Record], after: Mapping[str, Record], truths: Mapping[str, Record]
) -> list[Move]:
    """Everything that moved in the items present in both sets.

    Parameters
    ----------
    before, after : mapping
        Item key to record.
    truths : mapping
        Item key to `names`, `verdicts`, `kinds` and `quantities`, as far as they are known.
    """
    return [
        move
        for key in before
        if key in after
        for move in _moves_of(key, before[key], after[key], truths.get(key, {}))
    ]


def unlisted(found: list[Move], allowed: list[str]) -> list[Move]:
    """Moves that are not nearer to the truth and whose item no entry of `allowed` starts."""
    return [
        move
        for move in found
        if move.judged is not Judged.NEARER
        and not any(f"{move.item}: {move.what}".startswith(name) for name in allowed)
    ]


def _moves_of(key: str, old: Record, new: Record, truth: Record) -> Iterator[Move]:
    for what in ("input", "failure"):
        if old.get(what) != new.get(what):
            yield Move(key, what, str(old.get(what)), str(new.get(what)), Judged.UNKNOWN)
    if "motion" in old and "motion" in new:
        yield from _motion_moves(key, old["motion"], new["motion"], truth.get("kinds") or ())
    known = truth.get("quantities", {})
    earlier, later = old.get("quantities", {}), new.get("quantities", {})
    for name in {**earlier, **later}:
        yield from _value_moves(key, name, earlier.get(name), later.get(name), known.get(name))
    if "verdict" in old and "verdict" in new:
        yield from _verdict_moves(key, old, new, truth)


def _judged(is_nearer: bool | None) -> Judged:
    if is_nearer is None:
        return Judged.UNKNOWN
    return Judged.NEARER if is_nearer else Judged.FARTHER


def _changed(
    key: str, what: str, pair: tuple[str, str], right: Collection[str] | None
) -> Iterator[Move]:
    """A changed word: nearer to the truth if only the new one is right."""
    was_right, is_right = (right is not None and word in right for word in pair)
    if pair[0] != pair[1]:
        yield Move(key, what, *pair, _judged(None if was_right == is_right else is_right))


def _probability_move(
    key: str, what: str, pair: tuple[float, float], right: bool | None
) -> Iterator[Move]:
    """A changed probability: higher is nearer to the truth if what it belongs to is right."""
    old, new = pair
    if abs(new - old) > MAX_PROBABILITY_MOVE:
        judged = _judged(None if right is None else (new > old) == right)
        yield Move(key, what, f"{old:.3f}", f"{new:.3f}", judged)


def _motion_moves(key: str, old: Record, new: Record, kinds: Collection[str]) -> Iterator[Move]:
    yield from _changed(key, "motion", (old["kind"], new["kind"]), kinds)
    if old["kind"] == new["kind"]:
        right = old["kind"] in kinds if kinds else None
        pair = (old["probability"], new["probability"])
        yield from _probability_move(key, "motion probability", pair, right)


def _shown(entry: Record | None) -> str:
    if entry is None:
        return "not given"
    std = entry.get("std")
    return f"{entry['value']:.6g}" + ("" if std is None else f" ± {std:.2g}")


def _value_moves(
    key: str, name: str, old: Record | None, new: Record | None, true: float | None
) -> Iterator[Move]:
    old, new = (one if one and one["value"] is not None else None for one in (old, new))
    judged: Judged | None = None
    if old is not None and new is not None:
        judged = _judged_value(old, new, true)
    elif (given := old or new) is not None:
        judged = Judged.UNKNOWN
        if true is not None:
            # a value far from the truth is better withheld
            is_far = abs(given["value"] - true) > FAR_SIGMAS * (given.get("std") or 0.0)
            judged = Judged.NEARER if is_far == (new is None) else Judged.FARTHER
    if judged is not None:
        yield Move(key, name, _shown(old), _shown(new), judged)


def _judged_value(old: Record, new: Record, true: float | None) -> Judged | None:
    """How a given value moved; None if it stayed."""
    std, later = old.get("std") or 0.0, new.get("std") or 0.0
    moved = abs(new["value"] - old["value"]) > MAX_MOVE * std
    if not moved and abs(later - std) <= MAX_MOVE * std:
        return None
    if true is None or (not moved and not (std and later)):
        return Judged.UNKNOWN
    if moved:
        return _judged(abs(new["value"] - true) < abs(old["value"] - true))
    return _judged(_log_score(new, true) < _log_score(old, true))


def _log_score(entry: Record, true: float) -> float:
    """Negative log density of the truth under the stated normal distribution, constant omitted."""
    value, std = float(entry["value"]), float(entry["std"])
    return math.log(std) + 0.5 * ((value - true) / std) ** 2


def _verdict_moves(key: str, old: Record, new: Record, truth: Record) -> Iterator[Move]:
    names = truth.get("names")
    yield from _changed(key, "verdict", (old["verdict"], new["verdict"]), truth.get("verdicts"))
    yield from _changed(key, "groups", (str(old["groups"]), str(new["groups"])), None)
    earlier, later = old["effects"], new["effects"]
    for name in {**earlier, **later}:
        right = None if names is None else name in names
        if name in earlier and name in later:
            yield from _effect_moves(key, name, earlier[name], later[name], right)
            continue
        was, is_now = (
            f"{one[name]['probability']:.3f}" if name in one else "not named"
            for one in (earlier, later)
        )
        judged = _judged(None if right is None else (name in later) == right)
        yield Move(key, name, was, is_now, judged)


def _effect_moves(
    key: str, name: str, old: Record, new: Record, right: bool | None
) -> Iterator[Move]:
    pair = (old["probability"], new["probability"])
    yield from _probability_move(key, f"{name} probability", pair, right)
    for parameter in {**old["parameters"], **new["parameters"]}:
        entries = (old["parameters"].get(parameter), new["parameters"].get(parameter))
        yield from _value_moves(key, f"{name} {parameter}", *entries, None)
