"""What a contestant says of a campaign, whoever it is."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench.concealed.consistency import contradictions

__all__ = ["Answer", "Named", "answer_from_json"]


@dataclass(frozen=True)
class Named:
    """One effect that was named: parameters as name -> (value, standard uncertainty or None)."""

    id: str
    probability: float | None
    parameters: Mapping[str, tuple[float, float | None]]


@dataclass(frozen=True)
class Answer:
    """A verdict in a form that can be scored; `failure` says why there is none."""

    verdict: str
    named: tuple[Named, ...] = ()
    groups: tuple[frozenset[str], ...] = ()
    next_measurement: str = ""
    phase: str = ""
    channel: str = ""
    t_start: float | None = None
    t_end: float | None = None
    rmse_before: float | None = None
    rmse_after: float | None = None
    seconds: float = 0.0
    failure: str = ""
    contradictions: tuple[str, ...] = ()

    @property
    def ids(self) -> frozenset[str]:
        """Ids of the effects named."""
        return frozenset(named.id for named in self.named)


def _parameters(raw: Mapping[str, Any]) -> dict[str, tuple[float, float | None]]:
    return {
        name: (float(entry["value"]), None if entry.get("std") is None else float(entry["std"]))
        for name, entry in raw.items()
        if isinstance(entry, Mapping) and isinstance(entry.get("value"), int | float)
    }


def answer_from_json(raw: Mapping[str, Any], seconds: float) -> Answer:
    """An answer from the JSON that `vision explain` writes."""
    location = raw.get("location") or {}
    held_out = raw.get("held_out") or {}
    named = tuple(
        Named(effect["id"], effect.get("probability"), _parameters(effect.get("parameters") or {}))
        for effect in raw.get("effects") or ()
    )
    return Answer(
        verdict=str(raw.get("verdict")),
        named=named,
        groups=tuple(frozenset(group) for group in raw.get("indistinguishable") or ()),
        next_measurement=str(raw.get("next_measurement") or ""),
        phase=str(location.get("phase") or ""),
        channel=str(location.get("channel") or ""),
        t_start=location.get("t_start_s"),
        t_end=location.get("t_end_s"),
        rmse_before=held_out.get("rmse_before_m"),
        rmse_after=held_out.get("rmse_after_m"),
        seconds=seconds,
        failure=str(raw.get("failure") or ""),
        contradictions=tuple(contradictions(raw)) if "remainder" in raw else (),
    )
