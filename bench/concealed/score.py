"""Score answers against keys."""

from dataclasses import dataclass

from bench.concealed.answer import Answer
from bench.concealed.campaign import Hidden, Key

__all__ = ["Judgement", "judge", "local_start_error"]

# A force that two catalogue effects mimic at this chi-square cost need not be reported as unnamed.
MIMICKED = 25.0
MEASUREMENT = frozenset(
    [
        "time_base",
        "length_scale",
        "camera_roll",
        "parallax",
        "lens_distortion",
        "rolling_shutter",
        "origin_offset",
        "dropped_frames",
    ]
)


# A rotation or scaling about another centre is the same one plus a shift, exactly.
SHIFTED = frozenset(["camera_roll", "length_scale", "parallax"])


@dataclass(frozen=True)
class Judgement:
    """One campaign's answer, judged.

    Attributes
    ----------
    named : bool
        Something was named (or declared as a group).
    physics_named : bool
        Some of it is physics, not the instrument.
    right : bool
        Every concealed effect is named or in a declared group, and nothing else is named.
    covered : bool
        Every concealed effect is named or in a declared group.
    unnamed_said, direction_right, place_right : bool
        For forces in no catalogue.
    grouped : bool
        For exact twins: one declared group contains both, and a separating measurement is given.
    start_error : float or None
        Start of a local effect, as a fraction of the flight.
    group_size : int
        Ids in the largest declared group.
    """

    key: Key
    answer: Answer
    named: bool
    physics_named: bool
    right: bool
    covered: bool
    unnamed_said: bool
    direction_right: bool
    place_right: bool
    grouped: bool
    start_error: float | None
    group_size: int


def _companions(truth: frozenset[str], answer: Answer) -> frozenset[str]:
    """Ids allowed in the answer: the truth and the members of its declared group."""
    allowed = set(truth)
    if truth & SHIFTED:
        allowed.add("origin_offset")
    for group in answer.groups:
        if group & truth:
            allowed |= group
    return frozenset(allowed)


def _in_a_group(identity: str, answer: Answer) -> bool:
    return any(identity in group for group in answer.groups)


def _place_right(hidden: Hidden, key: Key, answer: Answer) -> bool:
    if answer.phase != hidden.phase:
        return False
    if not hidden.local or answer.t_start is None or answer.t_end is None:
        return True
    spans = [(start, end) for start, end, _ in _local_spans(key)]
    if not spans:
        return True
    low = min(start for start, _ in spans)
    high = max(end for _, end in spans)
    return answer.t_start < high and answer.t_end > low


def _local_spans(key: Key) -> list[tuple[float, float, float]]:
    """Start and end of the local effect after first contact and flight duration, by trial."""
    return [
        (t.local_start - t.touch, t.local_end - t.touch, t.landing - t.release)
        for t in key.trials
        if t.local_start is not None and t.local_end is not None
    ]


def local_start_error(key: Key, answer: Answer) -> float | None:
    """Error of a local effect's start (s after first contact) as a fraction of the flight.

    An effect bound to a position starts at different times: any time between them has no error.
    """
    spans = _local_spans(key)
    if not spans or not any(hidden.local for hidden in key.effects):
        return None
    if answer.t_start is None:
        return float("inf")
    starts = [start for start, _, _ in spans]
    flight = sorted(duration for _, _, duration in spans)[len(spans) // 2]
    outside = max(min(starts) - answer.t_start, answer.t_start - max(starts), 0.0)
    return outside / flight


def judge(key: Key, answer: Answer) -> Judgement:
    """Compare an answer with its key."""
    truth = frozenset(hidden.id for hidden in key.effects)
    said = answer.ids
    claimed = said.union(*answer.groups) if answer.verdict != "no_mismatch" else said
    covered = bool(truth) and all(t in said or _in_a_group(t, answer) for t in truth)
    extras = said - _companions(truth, answer)
    unnamed = "unnamed" in said or (answer.verdict == "unexplained" and not said)
    first = key.effects[0] if key.effects else None
    direction = first is not None and (not first.channels or answer.channel in first.channels)
    twins = frozenset(key.twins)
    grouped = any(twins <= group for group in answer.groups) and bool(answer.next_measurement)
    return Judgement(
        key=key,
        answer=answer,
        named=bool(claimed),
        physics_named=bool(claimed - MEASUREMENT),
        right=covered and not extras,
        covered=covered,
        unnamed_said=unnamed or _in_a_group("unnamed", answer),
        direction_right=direction,
        place_right=first is not None and _place_right(first, key, answer),
        grouped=bool(twins) and grouped,
        start_error=local_start_error(key, answer),
        group_size=max((len(group) for group in answer.groups), default=0),
    )
