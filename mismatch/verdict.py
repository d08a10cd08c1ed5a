"""What the engine says: frozen, and as the contract's JSON."""

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

__all__ = [
    "Alternative",
    "HeldOut",
    "Location",
    "NamedEffect",
    "ParameterValue",
    "Remainder",
    "Verdict",
    "VerdictKind",
]

VerdictKind: TypeAlias = Literal["no_mismatch", "explained", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class ParameterValue:
    """A fitted number with its standard uncertainty."""

    name: str
    value: float
    std: float
    unit: str

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {"value": self.value, "std": self.std, "unit": self.unit}


@dataclass(frozen=True)
class NamedEffect:
    """Something that was left out, in words and numbers."""

    id: str
    statement: str
    probability: float
    parameters: tuple[ParameterValue, ...]
    form: str = ""

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {
            "id": self.id,
            "statement": self.statement,
            "probability": round(self.probability, 4),
            "parameters": {p.name: p.to_json() for p in self.parameters},
        }


@dataclass(frozen=True)
class Location:
    """Where simulation and recording part. Times in s after the first touch (or first sample)."""

    phase: str
    t_start_s: float | None
    t_end_s: float | None
    channel: str
    statement: str

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return dict(vars(self))


@dataclass(frozen=True)
class Alternative:
    """Another answer, and why it was not taken."""

    ids: tuple[str, ...]
    why_not: str
    delta_bic: float

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {
            "ids": list(self.ids),
            "why_not": self.why_not,
            "delta_bic": round(self.delta_bic, 1),
        }


@dataclass(frozen=True)
class HeldOut:
    """Prediction of trials kept out of the fit, before and after (m, or rad for swings)."""

    trials: tuple[str, ...]
    rmse_before: float
    rmse_after: float
    ratio_95: tuple[float, float]
    unit: str = "m"
    extrapolation_before: float | None = None
    extrapolation_after: float | None = None

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        out: dict[str, Any] = {
            f"rmse_before_{self.unit}": self.rmse_before,
            f"rmse_after_{self.unit}": self.rmse_after,
            "ratio_95": list(self.ratio_95),
            "trials": list(self.trials),
        }
        if self.extrapolation_before is not None:
            out["extrapolation"] = {
                f"rmse_before_{self.unit}": self.extrapolation_before,
                f"rmse_after_{self.unit}": self.extrapolation_after,
            }
        return out


@dataclass(frozen=True)
class Remainder:
    """What is left after the best model."""

    white: bool
    statement: str

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return dict(vars(self))


@dataclass(frozen=True)
class Verdict:
    """The engine's answer.

    Attributes
    ----------
    verdict : VerdictKind
        In one word.
    baseline_effects : tuple of str, and
    baseline_chi2_per_dof : float
        The model that was tested, and how well it fits with the estimated noise.
    location : Location or None
        None where there is no mismatch.
    effects : tuple of NamedEffect
        What was left out, strongest first.
    alternatives : tuple of Alternative
        Other answers, nearest first.
    indistinguishable : tuple of tuple of str
        Groups of ids that the data can't tell apart.
    next_measurement : str or None
        What would separate them.
    held_out : HeldOut or None
        None where too few trials were there to keep any aside.
    remainder : Remainder
        What stays unexplained.
    notes : tuple of str
        About the data: rows left out, noise against its claim, correlation.
    """

    verdict: VerdictKind
    baseline_effects: tuple[str, ...]
    baseline_chi2_per_dof: float
    location: Location | None
    effects: tuple[NamedEffect, ...]
    alternatives: tuple[Alternative, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    next_measurement: str | None
    held_out: HeldOut | None
    remainder: Remainder
    notes: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Exactly the contract's JSON, plus ``notes``."""
        return {
            "verdict": self.verdict,
            "baseline": {
                "effects": list(self.baseline_effects),
                "chi2_per_dof": self.baseline_chi2_per_dof,
            },
            "location": None if self.location is None else self.location.to_json(),
            "effects": [effect.to_json() for effect in self.effects],
            "alternatives": [other.to_json() for other in self.alternatives],
            "indistinguishable": [list(group) for group in self.indistinguishable],
            "next_measurement": self.next_measurement,
            "held_out": None if self.held_out is None else self.held_out.to_json(),
            "remainder": self.remainder.to_json(),
            "notes": list(self.notes),
        }

    def text(self) -> str:
        """The story in plain words."""
        lines = [_HEADLINES[self.verdict]]
        if self.location is not None:
            lines.append(self.location.statement)
        for effect in self.effects:
            numbers = ", ".join(
                f"{p.name} = {p.value:.4g} ± {p.std:.2g} {p.unit if p.unit != '1' else ''}".rstrip()
                for p in effect.parameters
            )
            lines.append(
                f"{effect.id} (probability {effect.probability:.2f}): {effect.statement} {numbers}"
            )
        lines.extend(
            f"The data can't tell apart: {', '.join(group)}." for group in self.indistinguishable
        )
        if self.next_measurement:
            lines.append(f"What would settle it: {self.next_measurement}.")
        if self.held_out is not None:
            h = self.held_out
            lines.append(
                f"Trials kept out of the fit: error {h.rmse_after:.3g} {h.unit} instead of"
                f" {h.rmse_before:.3g} {h.unit} (ratio {h.ratio_95[0]:.3g} to {h.ratio_95[1]:.3g})."
            )
            if h.extrapolation_before is not None and h.extrapolation_after is not None:
                lines.append(
                    "Fitted on the first 60 % of each track, the rest is predicted to"
                    f" {h.extrapolation_after:.3g} {h.unit} instead of"
                    f" {h.extrapolation_before:.3g} {h.unit}."
                )
        lines.append(self.remainder.statement)
        lines.extend(f"Note: {note}" for note in self.notes)
        return "\n".join(lines)


_HEADLINES: dict[str, str] = {
    "no_mismatch": "Nothing is missing: simulation and recording agree within the noise.",
    "explained": "Something was left out of the model, and it has been found.",
    "ambiguous": "Something was left out of the model; several explanations fit alike.",
    "unexplained": "Simulation and recording differ, and no known effect explains it.",
}
