"""Fits of e(v): exponential, visco-elastic power law, constant; and which the data prefer."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import lmfit
import numpy as np
from scipy.special import stdtrit

from metrology import DomainError, TooLittleDataError
from physics.domain import FloatArray, require_positive
from physics.restitution import ConstantCor, CorLaw, ExponentialCor, PowerLawCor

__all__ = ["CorFit", "FittedParameter", "compare_cor_fits", "fit_cor"]


@dataclass(frozen=True)
class FittedParameter:
    """A parameter of a fit.

    Attributes
    ----------
    name : str
    value, std : float
        Estimate and standard uncertainty; infinite where the data do not determine it.
    low, high : float
        95 % interval of Student's t with the fit's degrees of freedom.
    """

    name: str
    value: float
    std: float
    low: float
    high: float


@dataclass(frozen=True)
class CorFit:
    """A fitted law.

    Attributes
    ----------
    model : str
        "exponential", "power" or "constant".
    law : CorLaw
    parameters : tuple of FittedParameter
    chi2 : float
        Sum of squared residuals over std² (over 1 where no std was given).
    dof : int
    aicc, bic : float
        Corrected Akaike and Bayesian information criteria; infinite with too few points.
    """

    model: str
    law: CorLaw
    parameters: tuple[FittedParameter, ...]
    chi2: float
    dof: int
    aicc: float
    bic: float


def _exponential(v: FloatArray, amplitude: float, rate: float, floor: float) -> FloatArray:
    return np.asarray(amplitude * np.exp(-rate * v) + floor)


def _power(v: FloatArray, coefficient: float) -> FloatArray:
    return np.asarray(1.0 - coefficient * v**0.2)


def _constant(v: FloatArray, value: float) -> FloatArray:
    return np.full_like(v, value)


def _law(model: str, best: dict[str, float]) -> CorLaw:
    if model == "exponential":
        return ExponentialCor(best["amplitude"], best["rate"], 0.0, best["floor"])
    return PowerLawCor(best["coefficient"]) if model == "power" else ConstantCor(best["value"])


def fit_cor(
    speed: FloatArray, cor: FloatArray, std: FloatArray | None = None, *, model: str
) -> CorFit:
    """Fit one law of restitution by least squares (lmfit).

    Eqs 24 and 25 of the paper write a exp(−b v − c) + d; a and c are one parameter between them,
    so the fit has amplitude = a exp(−c), rate = b and floor = d.

    Parameters
    ----------
    speed, cor : (N,) array
        m/s and 1.
    std : (N,) array, optional
        Standard uncertainty of each e; without it the scatter of the residuals sets the scale.
    model : str
        "exponential", "power" or "constant".

    Returns
    -------
    CorFit

    Raises
    ------
    TooLittleDataError
        With fewer points than parameters.
    DomainError
        For an unknown model or speeds that are not positive.
    """
    start: dict[str, dict[str, Any]] = {
        "exponential": {
            "amplitude": {"value": max(float(np.ptp(cor)), 0.02) * 1.5},
            "rate": {"value": 1.0 / max(float(np.mean(speed)), 0.1), "min": 1e-4, "max": 20.0},
            "floor": {"value": float(np.min(cor)) - 0.02, "min": -1.0, "max": 1.5},
        },
        "power": {"coefficient": {"value": 0.2}},
        "constant": {"value": {"value": float(np.mean(cor))}},
    }
    functions: dict[str, Callable[..., FloatArray]] = {
        "exponential": _exponential,
        "power": _power,
        "constant": _constant,
    }
    if model not in functions:
        raise DomainError(f"there is no law {model!r}", hint=f"There are: {', '.join(functions)}.")
    require_positive("the impact speed", speed, "m/s")
    fit = _least_squares(functions[model], speed, cor, std, start[model])
    return _report(model, _law(model, fit.best_values), fit, len(speed), std is not None)


def compare_cor_fits(
    speed: FloatArray, cor: FloatArray, std: FloatArray | None = None
) -> tuple[CorFit, ...]:
    """All laws that the number of points allows, the preferred first.

    Preferred by the corrected Akaike criterion; by BIC where there are too few points for it.
    """
    fits = []
    for model, parameters in (("exponential", 3), ("power", 1), ("constant", 1)):
        if len(speed) >= parameters:
            fits.append(fit_cor(speed, cor, std, model=model))
    if not fits:
        raise TooLittleDataError("no points, no law of restitution")
    enough = all(math.isfinite(fit.aicc) for fit in fits)
    return tuple(sorted(fits, key=lambda fit: fit.aicc if enough else fit.bic))


def _least_squares(
    function: Callable[..., FloatArray],
    x: FloatArray,
    y: FloatArray,
    std: FloatArray | None,
    start: dict[str, dict[str, Any]],
) -> Any:
    if len(x) < len(start):
        raise TooLittleDataError(f"{len(x)} points can't determine {len(start)} parameters")
    model = lmfit.Model(function)
    parameters = model.make_params(**start)
    return model.fit(
        y,
        parameters,
        weights=None if std is None else 1.0 / np.asarray(std),
        scale_covar=std is None,
        max_nfev=20_000,
        fit_kws={"xtol": 1e-14, "ftol": 1e-14},
        **{model.independent_vars[0]: x},
    )


def _report(model: str, law: CorLaw, fit: Any, points: int, absolute: bool) -> CorFit:
    free = fit.nvarys
    dof = points - free
    width = float(stdtrit(dof, 0.975)) if dof > 0 else math.inf
    parameters = []
    for name, parameter in fit.params.items():
        known = parameter.stderr is not None and (dof > 0 or absolute)
        std = float(parameter.stderr) if known else math.inf
        value = float(parameter.value)
        half = 1.96 * std if absolute else width * std
        parameters.append(FittedParameter(name, value, std, value - half, value + half))
    chi2 = float(np.sum(np.asarray(fit.residual) ** 2))
    # with no std given the residuals' own scale counts as one more parameter
    count = free if absolute else free + 1
    deviance = chi2 if absolute else points * math.log(max(chi2, 1e-30) / points)
    spare = points - count - 1
    aicc = deviance + 2 * count + (2 * count * (count + 1) / spare if spare > 0 else math.inf)
    return CorFit(
        model, law, tuple(parameters), chi2, dof, aicc, deviance + count * math.log(points)
    )
