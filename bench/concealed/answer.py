"""Read the JSON of `vision explain` as an answer and check its consistency."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Answer", "Named", "answer_from_json", "contradictions"]


@dataclass(frozen=True)
class Named:
    """A named effect; parameters map a name to (value, standard uncertainty or None)."""

    id: str
    probability: float | None
    parameters: Mapping[str, tuple[float, float | None]]


@dataclass(frozen=True)
class Answer:
    """A verdict to be scored; `failure` is the reason if there is none.

    `alternatives` are the ids of other answers and the evidence that each lacks.
    """

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
    alternatives: tuple[tuple[frozenset[str], float], ...] = ()

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
        alternatives=tuple(
            (frozenset(other["ids"]), float(other["delta_bic"]))
            for other in raw.get("alternatives") or ()
        ),
    )


SURE = 0.5
"""Probability above which a name is stated rather than suggested."""

HARDLY = 1.0
"""Chi-square gain below which held-out trials do not fit better."""


def contradictions(raw: Mapping[str, Any]) -> list[str]:
    """Statements in the JSON of a verdict that contradict each other.

    Parameters
    ----------
    raw : mapping
        As `vision explain --json` writes it.
    """
    kind, effects = raw["verdict"], raw["effects"]
    groups, held, remainder = raw["indistinguishable"], raw["held_out"], raw["remainder"]
    names = {effect["id"] for effect in effects}
    sure = [e["id"] for e in effects if e["probability"] > SURE]
    found = []
    if kind == "no_mismatch" and (effects or groups or raw["location"] or held):
        found.append("no mismatch, but an effect, a location or a proof is given")
    if kind == "explained" and len(sure) < len(effects):
        found.append("explained, but with a probability below one half")
    if kind == "explained" and groups:
        found.append("explained, but an alternative is not excluded")
    if kind in ("explained", "ambiguous") and not effects:
        found.append("explained or ambiguous, but nothing is named")
    if kind == "unexplained" and sure:
        found.append("unexplained, but a name is probable")
    if kind == "ambiguous" and not groups and "in doubt" not in remainder["statement"]:
        found.append("ambiguous without a reason")
    if any(group[0] not in names for group in groups):
        found.append("an alternative to a name that is not given")
    # The chi-square gain includes effects on each launch that the error in metres does not.
    if sure and held and held["ratio_95"][1] < 1.0 and held.get("chi2_gain", 0.0) <= HARDLY:
        found.append("a name is probable, but predicts worse")
    if groups and not raw["next_measurement"]:
        found.append("several answers without a measurement to separate them")
    said = remainder["statement"]
    if remainder["white"] and "still holds structure" in said:
        found.append("white remainder with structure")
    if not remainder["white"] and "cannot be distinguished from noise" in said:
        found.append("remainder that is not white called noise")
    if any(a["why_not"].startswith("fits worse by -") for a in raw["alternatives"]):
        found.append("an alternative fits better than the answer")
    return found
