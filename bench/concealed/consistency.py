"""Whether an answer contradicts itself: statements that no sceptic would accept side by side."""

from collections.abc import Mapping
from typing import Any

__all__ = ["contradictions"]

SURE = 0.5
"""Probability from which a name is stated rather than suggested."""

HARDLY = 1.0
"""Chi-square units below which held-out trials fit no better."""

NOISE_P = 1e-3
"""Whiteness below which residuals are no noise."""


def contradictions(raw: Mapping[str, Any]) -> list[str]:
    """What in the JSON of a verdict can't be true together.

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
        found.append("nothing is missing, and yet something is named, placed or proved")
    if kind == "explained" and len(sure) < len(effects):
        found.append("found, and yet less likely than not")
    if kind == "explained" and groups:
        found.append("found, and yet something else is not excluded")
    if kind in ("explained", "ambiguous") and not effects:
        found.append("found, and yet nothing is named")
    if kind == "unexplained" and sure:
        found.append("nothing explains it, and yet a name is likely")
    if kind == "ambiguous" and not groups and "in doubt" not in remainder["statement"]:
        found.append("in doubt, and no reason is given")
    if any(group[0] not in names for group in groups):
        found.append("a name is not excluded in place of one that is not given")
    # Chi-square has the error of metres in it, beside what each launch's own scatter took of it.
    if sure and held and held["ratio_95"][1] < 1.0 and held.get("chi2_gain", 0.0) <= HARDLY:
        found.append("a name is likely, and predicts worse")
    if groups and not raw["next_measurement"]:
        found.append("several answers, and nothing that would part them")
    said = remainder["statement"]
    if remainder["white"] and "still holds structure" in said:
        found.append("noise, and structure")
    if not remainder["white"] and "cannot be told from noise" in said:
        found.append("no noise, and noise")
    if any(a["why_not"].startswith("fits worse by -") for a in raw["alternatives"]):
        found.append("an alternative fits worse by less than nothing")
    return found
