"""What is left over after a fit, and what the data say about their noise."""

import numpy as np

from mismatch.fitting.fit import Fit
from mismatch.fitting.hypotheses import Hypothesis
from mismatch.fitting.prepare import Prepared
from mismatch.model.forward import Forward
from mismatch.records.campaign import Campaign
from mismatch.records.spectrum import whiteness
from mismatch.search.locate import scan_windows
from mismatch.verdict import Remainder
from physics.arrays import FloatArray

__all__ = ["base_parameters", "noise_notes", "reduced_chi2", "remainder_of"]


def reduced_chi2(prepared: Prepared, chi2: float, count: int) -> float:
    """Chi-square per degree of freedom, against white noise as estimated."""
    inflation = prepared.noise.inflation
    used = prepared.forward.records.used
    s = prepared.forward.records.ball_time.shape[1]
    share = [used[:, k * s : (k + 1) * s].sum() for k in range(3)] + [used[:, 3 * s :].sum()]
    mean = float(np.average(inflation, weights=np.maximum(share, 1e-9)))
    return float(chi2 * mean / max(count - base_parameters(prepared), 1))


def base_parameters(prepared: Prepared) -> int:
    """How many trial-to-trial values the data alone determine (those without a prior)."""
    per_trial = {"impact": 1, "flight": 4, "swing": 2}[prepared.forward.mode]
    return per_trial * prepared.forward.records.trials


def _whiteness(forward: Forward, fit: Fit) -> float:
    records = forward.records
    s = records.ball_time.shape[1]
    pieces: list[tuple[FloatArray, FloatArray]] = []
    for trial in range(records.trials):
        for k in range(4):
            at = slice(k * s, (k + 1) * s) if k < 3 else slice(3 * s, None)
            mask = records.used[trial, at]
            time = records.ball_time[trial] if k < 3 else records.pendulum_time[trial]
            pieces.append((time[mask], fit.residual[trial, at][mask]))
    return whiteness(pieces)


def remainder_of(prepared: Prepared, best: Hypothesis | None) -> Remainder:
    """What is left after the best model, and whether it can be told from noise."""
    forward = prepared.forward
    fit = prepared.fit if best is None else best.fit
    probability = _whiteness(forward, fit)
    before = _whiteness(forward, prepared.fit)
    reduced = reduced_chi2(prepared, fit.chi2, fit.count)
    correlated = bool((prepared.noise.inflation > 1.0).any())
    scanned = scan_windows(forward, fit)
    spread = 4.0 * np.sqrt(2.0 / max(fit.count, 1)) * (2.0 if correlated else 1.0)
    white = bool(reduced < 1.0 + spread) and not scanned.significant
    if not correlated:
        white = white and probability > 1e-3
    subject = "The baseline's residuals" if best is None else "What remains after the best model"
    verb = "cannot be told from noise" if white else "still holds structure"
    told = f"{subject} {verb} (chi2 per degree of freedom {reduced:.2f})."
    if correlated:
        # Noise that remembers is never white: its p-value would accuse the model of the noise.
        return Remainder(white, told)
    if best is None:
        told += f" Whiteness of the residuals: p = {probability:.1g}."
    else:
        told += f" Whiteness of the residuals: p = {before:.1g} before, {probability:.1g} after."
    return Remainder(white, told)


def noise_notes(campaign: Campaign, prepared: Prepared) -> tuple[str, ...]:
    """What the data say about their noise, where it is not as claimed."""
    notes = []
    noise, base = prepared.noise, prepared.forward.baseline
    used = prepared.forward.records.ball_used.any(axis=(0, 1))
    position = float(np.sqrt(np.mean(noise.sigma[:, :3][:, used] ** 2))) if used.any() else None
    for what, claim, found, unit in (
        ("positions", base.position_noise, position, "m"),
        ("angles", base.angle_noise, float(np.mean(noise.sigma[:, 3])), "rad"),
    ):
        if claim is not None and found is not None and not 0.85 < found / claim < 1.18:
            notes.append(
                f"the noise of the {what} is {found:.2g} {unit}, not {claim:.2g} as claimed"
            )
    if (noise.inflation > 1.5).any():
        worst = float(noise.inflation.max())
        notes.append(
            f"neighbouring samples share errors: slow quantities are {np.sqrt(worst):.1f} times"
            " less certain than white noise would leave them"
        )
    stated = [t.position_std for t in campaign.trials if t.position_std is not None]
    if stated and position is not None:
        values = np.concatenate([one.reshape(-1) for one in stated])
        values = values[np.isfinite(values) & (values > 0.0)]
        # Squares of the smallest numbers are zero.
        largest = float(values.max(initial=0.0)) or position
        column = largest * float(np.sqrt(np.mean((values / largest) ** 2))) or position
        if not 0.85 < position / column < 1.18:
            notes.append(
                f"the file states {column:.2g} m for its positions' uncertainty, they scatter by"
                f" {position:.2g} m; the scatter was used"
            )
    count = int(noise.outliers.sum())
    if count:
        notes.append(f"{count} samples are outliers and were left out")
    return tuple(notes)
