"""What others' methods say of the same files: sparse regression, Gaussian-process discrepancy.

Regression and Gaussian process know nothing of contacts, swings, cameras or confounding; what they
find in the free flights is put into the words of the catalogue where it has any.
"""

import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bench.concealed.contest.answer import Answer, Named
from bench.concealed.contest.flights import (
    GRAVITY,
    FreeFlight,
    baseline_residual,
    free_flights,
    smoothed,
)
from bench.concealed.contest.lowest_bic import lowest_bic
from bench.concealed.world.shots import Array
from metrology import UsageError

__all__ = ["PEERS"]

HINT = "Install the package with its extra: pip install impact-vision[bench]."
TERMS = ("1", "vx", "vy", "|v|vx", "|v|vy")
# Below this an acceleration (m/s²) can't be told from what differentiating the noise leaves.
LEAST_ACCELERATION = 0.3


def _features(velocity: Array) -> Array:
    speed = np.hypot(velocity[:, 0], velocity[:, 1])[:, None]
    return np.concatenate([velocity, speed * velocity], axis=1)


def _names(x_terms: Array, y_terms: Array) -> tuple[str, ...]:
    """Catalogue ids for the accelerations (m/s²) that each term adds along x and along y."""
    one, along, across, fast_along, fast_across = range(5)
    x, y = np.abs(x_terms) > 0, np.abs(y_terms) > 0
    names = set()
    if x[fast_along] or y[fast_across]:
        names.add("drag")
    if x[across] and y[along] and x_terms[across] * y_terms[along] < 0:
        names.add("magnus")
    if x[fast_across] and y[fast_along]:
        names.add("asymmetric_wake")
    if y[one]:
        names.add("buoyancy")
    if x[one]:
        names.add("wind")
    if not names and (x.any() or y.any()):
        names.add("unnamed")
    return tuple(sorted(names))


def _answer(names: tuple[str, ...], seconds: float) -> Answer:
    if not names:
        return Answer("no_mismatch", seconds=seconds)
    named = tuple(Named(name, None, {}) for name in names)
    return Answer("explained", named, phase="flight", seconds=seconds)


def _sizes(coefficients: Array, features: Array) -> Array:
    """Coefficients (2, 5) as typical accelerations; what is too small becomes zero."""
    scale = np.concatenate([[1.0], np.sqrt(np.mean(features**2, axis=0))])
    sizes = coefficients * scale
    return np.where(np.abs(sizes) < LEAST_ACCELERATION, 0.0, sizes)


def _ensemble(flights: list[FreeFlight]) -> tuple[str, ...]:
    try:
        import pysindy
    except ImportError as problem:
        raise UsageError("the peer pysindy is not installed", hint=HINT) from problem
    features, targets = [], []
    for flight in flights:
        velocity, acceleration = smoothed(flight, 1), smoothed(flight, 2)
        k = flight.drag_per_mass * np.hypot(velocity[:, 0], velocity[:, 1])[:, None]
        features.append(_features(velocity))
        targets.append(acceleration + [0, GRAVITY] + k * velocity)
    columns, target = np.concatenate(features), np.concatenate(targets)
    scale = np.sqrt(np.mean(columns**2, axis=0))
    design = np.concatenate([np.ones((len(columns), 1)), columns / scale], axis=1)
    optimizer = pysindy.EnsembleOptimizer(
        pysindy.STLSQ(threshold=LEAST_ACCELERATION, alpha=1e-6), bagging=True, n_models=20
    )
    np.random.seed(0)  # noqa: NPY002 - the only seed its bagging takes
    optimizer.fit(design, target)
    kept = np.mean([np.abs(c) > 0 for c in optimizer.coef_list], axis=0) > 0.6
    sizes = np.where(kept, np.median(optimizer.coef_list, axis=0), 0.0)
    return _names(sizes[0], sizes[1])


def _weak(flights: list[FreeFlight]) -> tuple[str, ...]:
    try:
        import pysindy
    except ImportError as problem:
        raise UsageError("the peer pysindy is not installed", hint=HINT) from problem
    found = []
    np.random.seed(0)  # noqa: NPY002 - the only seed its test functions take
    for flight in flights:
        velocity = smoothed(flight, 1)
        library = pysindy.WeakPDELibrary(
            function_library=pysindy.CustomLibrary(
                [lambda u: u, lambda u, w: np.hypot(u, w) * u, lambda u, w: np.hypot(u, w) * w],
                interaction_only=True,
            ),
            spatiotemporal_grid=flight.time,
            include_bias=True,
            K=60,
        )
        model = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=1e-4, alpha=1e-6), feature_library=library
        )
        model.fit(velocity, t=flight.time)
        known = np.zeros((2, 5))
        known[1, 0] = -GRAVITY
        known[0, 3] = known[1, 4] = -flight.drag_per_mass
        found.append(_sizes(np.asarray(model.coefficients()) - known, _features(velocity)))
    often = np.mean([np.abs(sizes) > 0 for sizes in found], axis=0) > 0.6
    sizes = np.where(often, np.median(found, axis=0), 0.0)
    return _names(sizes[0], sizes[1])


def _gaussian_process(flights: list[FreeFlight]) -> tuple[str, ...]:
    try:
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    except ImportError as problem:
        raise UsageError("the peer scikit-learn is not installed", hint=HINT) from problem
    gain = 0.0
    for flight in flights:
        residual = baseline_residual(flight)[::3]
        when = ((flight.time - flight.time[0]) / (flight.time[-1] - flight.time[0]))[::3, None]
        for channel in residual.T:
            scaled = channel / channel.std()
            plain = GaussianProcessRegressor(WhiteKernel(1.0)).fit(when, scaled)
            kernel = ConstantKernel(0.1, (1e-4, 10)) * RBF(0.3, (0.1, 2)) + WhiteKernel(1.0)
            rich = GaussianProcessRegressor(kernel).fit(when, scaled)
            gain += rich.log_marginal_likelihood_value_ - plain.log_marginal_likelihood_value_
    # Two more hyperparameters in each channel, by BIC.
    samples = sum(2 * len(flight.time[::3]) for flight in flights)
    return ("unnamed",) if gain > 2 * np.log(samples) else ()


def _timed(method: Callable[[list[FreeFlight]], tuple[str, ...]]) -> Callable[[Path], Answer]:
    def run(folder: Path) -> Answer:
        start = time.perf_counter()
        with warnings.catch_warnings():
            # Their warnings on ill-conditioned fits don't stop them from answering.
            warnings.simplefilter("ignore")
            names = method(free_flights(folder))
        return _answer(names, time.perf_counter() - start)

    return run


PEERS: dict[str, Callable[[Path], Answer]] = {
    "pysindy, ensemble": _timed(_ensemble),
    "pysindy, weak form": _timed(_weak),
    "Gaussian-process discrepancy": _timed(_gaussian_process),
    "plain lowest BIC": lowest_bic,
}
"""Each peer takes a campaign folder and gives an answer."""
