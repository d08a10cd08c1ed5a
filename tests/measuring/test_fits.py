"""The fits of the measuring chain, held to motions made by other means."""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from measuring.flight_fit import FlightPriors, fit_flight, fit_swing
from measuring.results import frames_within
from metrology import NoFitError, TooLittleDataError
from metrology.least_squares import fit

FloatArray = NDArray[np.float64]

STIFFNESS = 17.0
TIME = np.arange(48) / 600.0
PRIORS = FlightPriors(9.806, 0.01, 0.02, 0.02, 0.0, 0.05)


def swung(phi: float, omega: float, time: FloatArray, at: float) -> FloatArray:
    """Angles of a free swing that is at (phi, omega) at time `at`."""

    def rates(_: float, state: FloatArray) -> list[float]:
        return [state[1], -STIFFNESS * np.sin(state[0])]

    ahead = solve_ivp(rates, (at, time[-1] + 1), [phi, omega], dense_output=True, rtol=1e-10)
    back = solve_ivp(rates, (at, time[0] - 1), [phi, omega], dense_output=True, rtol=1e-10)
    return np.asarray(np.where(time >= at, ahead.sol(time)[0], back.sol(time)[0]))


def flown(time: FloatArray, velocity: tuple[float, float], drag: float = 0.02) -> FloatArray:
    """Positions of a ball that flies from (0, 0.4) at time 0."""

    def rates(_: float, state: FloatArray) -> list[float]:
        pull = drag * np.hypot(state[2], state[3])
        return [state[2], state[3], -pull * state[2], -9.806 - pull * state[3]]

    start = [0.0, 0.4, *velocity]
    path = solve_ivp(rates, (0.0, time[-1]), start, t_eval=time, rtol=1e-10, atol=1e-12)
    return np.asarray(path.y[:2].T)


def covariances(count: int, std: float) -> FloatArray:
    return np.tile(np.eye(2) * std**2, (count, 1, 1))


@settings(deadline=None, max_examples=20)
@given(phi=st.floats(-1.0, 1.0), omega=st.floats(-8.0, 8.0), at=st.floats(0.0, 0.1))
def test_a_free_swing_is_found_again_exactly(phi: float, omega: float, at: float) -> None:
    angle = swung(phi, omega, TIME, at)
    found = fit_swing(TIME, angle, np.full(len(TIME), 1e-5), at, STIFFNESS, 0.3)
    assert found.state(at) == pytest.approx((phi, omega), abs=2e-4)
    assert found.angles(TIME) == pytest.approx(angle, abs=1e-6)


def test_the_stated_uncertainty_of_a_swing_holds_its_errors() -> None:
    rng = np.random.default_rng(1)
    angle, std = swung(0.1, 4.0, TIME, 0.08), 1e-3
    z = []
    for _ in range(60):
        seen = angle + rng.normal(0.0, std, len(TIME))
        found = fit_swing(TIME, seen, np.full(len(TIME), std), 0.08, STIFFNESS, 0.3)
        spread = np.sqrt(np.diag(found.fitted.covariance))
        z.append((np.array(found.state(0.08)) - [0.1, 4.0]) / spread[:2])
    # slow errors are allowed for, which white noise does not have
    assert np.all(np.sqrt(np.mean(np.square(z), axis=0)) < 1.3)
    assert np.all(np.sqrt(np.mean(np.square(z), axis=0)) > 0.2)


@pytest.mark.parametrize("frames", [0, 4])
def test_a_swing_hardly_seen_is_refused(frames: int) -> None:
    with pytest.raises(TooLittleDataError, match=f"only {frames} frames"):
        fit_swing(TIME[:frames], TIME[:frames], TIME[:frames], 0.0, STIFFNESS, 0.3)


@settings(deadline=None, max_examples=15)
@given(speed=st.floats(1.0, 8.0), angle=st.floats(-0.3, 0.6), drag=st.floats(0.0, 0.06))
def test_a_flight_is_found_again_exactly(speed: float, angle: float, drag: float) -> None:
    velocity = (speed * float(np.cos(angle)), speed * float(np.sin(angle)))
    time = np.arange(3, 150) / 600.0
    seen = flown(time, velocity, drag)
    found = fit_flight(time, seen, covariances(len(time), 1e-5), 0.0, PRIORS)
    assert found.states(np.array([0.0]))[0] == pytest.approx((0.0, 0.4, *velocity), abs=2e-3)
    assert np.abs(found.residual_m).max() < 2e-5


def test_where_and_when_a_flight_reaches_the_floor() -> None:
    time = np.arange(3, 200) / 600.0
    found = fit_flight(time, flown(time, (3.7, 0.9)), covariances(len(time), 1e-5), 0.0, PRIORS)
    landed = found.falls_to(0.1)
    assert landed is not None
    later = np.linspace(0.0, landed, 200)
    spot = flown(later, (3.7, 0.9))[-1]
    assert found.states(np.array([landed]))[0, :2] == pytest.approx(spot, abs=2e-4)
    assert spot[1] == pytest.approx(0.1, abs=2e-4)
    assert found.falls_to(-1e4) is None


def test_a_flight_tells_gravity_where_that_is_left_to_it() -> None:
    free = FlightPriors(9.806, np.inf, 0.02, 0.02, 0.0, 0.05)
    time = np.arange(3, 220) / 600.0
    found = fit_flight(time, flown(time, (3.7, 0.9)), covariances(len(time), 1e-4), 0.0, free)
    std = float(np.sqrt(found.fitted.covariance[6, 6]))
    assert found.fitted.values[6] == pytest.approx(9.806, abs=0.02)
    assert 0.001 < std < 0.3


def test_frames_that_are_far_off_hardly_move_a_flight() -> None:
    rng = np.random.default_rng(3)
    time = np.arange(3, 200) / 600.0
    seen = flown(time, (3.7, 0.9)) + rng.normal(0.0, 2e-4, (len(time), 2))
    seen[3:30:6] += [0.03, -0.03]
    found = fit_flight(time, seen, covariances(len(time), 2e-4), 0.0, PRIORS)
    error = found.states(np.array([0.0]))[0, 2:] - [3.7, 0.9]
    assert np.all(np.abs(error) < 3.0 * np.sqrt(np.diag(found.fitted.covariance))[2:4])
    assert np.all(np.abs(error) < 0.02)


def test_the_stated_uncertainty_of_a_flight_holds_its_errors() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(3, 120) / 600.0
    path, z = flown(time, (5.0, 1.0)), []
    for _ in range(40):
        seen = path + rng.normal(0.0, 5e-4, path.shape)
        found = fit_flight(time, seen, covariances(len(time), 5e-4), 0.0, PRIORS)
        spread = np.sqrt(np.diag(found.fitted.covariance))[:4]
        z.append((found.states(np.array([0.0]))[0] - [0.0, 0.4, 5.0, 1.0]) / spread)
    assert np.all(np.sqrt(np.mean(np.square(z), axis=0)) < 1.3)


def test_the_stated_uncertainty_of_a_flight_is_as_large_as_errors_that_wander() -> None:
    rng = np.random.default_rng(6)
    time, std = np.arange(3, 123) / 600.0, 5e-4
    path, z = flown(time, (5.0, 1.0)), []
    for _ in range(60):
        # as outlines do: half of it from frame to frame, and a walk as long as that is large
        walk = np.cumsum(rng.normal(0.0, std / np.sqrt(len(time)), path.shape), axis=0)
        seen = path + walk - walk.mean(axis=0) + rng.normal(0.0, 0.5 * std, path.shape)
        found = fit_flight(time, seen, covariances(len(time), std), 0.0, PRIORS)
        spread = np.sqrt(np.diag(found.fitted.covariance))[2:4]
        z.append((found.states(np.array([0.0]))[0, 2:] - [5.0, 1.0]) / spread)
    scatter = np.sqrt(np.mean(np.square(z), axis=0))
    assert np.all(scatter > 0.75)
    assert np.all(scatter < 1.25)


def test_a_flight_of_a_few_frames_is_refused() -> None:
    time = np.arange(5) / 600.0
    with pytest.raises(TooLittleDataError, match="only 5 frames"):
        fit_flight(time, flown(time + 1e-3, (3.0, 1.0)), covariances(5, 1e-4), 0.0, PRIORS)


def test_a_line_has_the_covariance_of_the_textbook() -> None:
    rng = np.random.default_rng(4)
    at = np.linspace(-1.0, 1.0, 400)
    seen = 2.0 + 3.0 * at + rng.normal(0.0, 1.0, len(at))
    found = fit(lambda v: v[0] + v[1] * at - seen, [0.0, 0.0])
    design = np.column_stack([np.ones_like(at), at])
    expected = np.linalg.inv(design.T @ design)
    assert found.covariance == pytest.approx(expected * found.chi2_per_dof, rel=1e-4, abs=1e-9)
    assert found.chi2_per_dof == pytest.approx(1.0, abs=0.3)


def test_noise_larger_than_claimed_widens_the_uncertainty() -> None:
    at = np.linspace(-1.0, 1.0, 400)
    seen = np.random.default_rng(5).normal(0.0, 3.0, len(at))
    found = fit(lambda v: v[0] + v[1] * at - seen, [0.0, 0.0])
    assert found.chi2_per_dof == pytest.approx(9.0, rel=0.35)


def lasting_noise(spread: float) -> np.ndarray:
    """Noise of which each value keeps nine tenths of the last, (400,)."""
    fresh = np.random.default_rng(6).normal(0.0, spread * np.sqrt(1.0 - 0.9**2), 400)
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -0.9], fresh))


def test_errors_that_last_count_by_their_own_size_and_no_less_than_was_claimed() -> None:
    at = np.linspace(-1.0, 1.0, 400)

    def misfit(spread: float) -> float:
        seen = lasting_noise(spread)
        return fit(lambda v: v[0] + v[1] * at - seen, [0.0, 0.0]).chi2_per_dof

    assert misfit(0.1) == pytest.approx(1.0, abs=0.02)
    # (1 + 0.9) / (1 - 0.9) frames are worth one
    assert 5.0 < misfit(1.0) < 19.0 * 1.5
    assert misfit(0.5) == pytest.approx(0.25 * misfit(1.0), rel=0.05)


def test_a_prior_holds_what_the_data_leave_open() -> None:
    found = fit(lambda v: np.full(20, v[0] - 1.0), [0.0, 0.0], [0.0, 5.0], [np.inf, 0.5])
    assert found.values == pytest.approx([1.0, 5.0], abs=1e-6)
    assert np.sqrt(found.covariance[1, 1]) == pytest.approx(0.5)


def test_a_search_that_would_overshoot_is_held_back() -> None:
    # Gauss-Newton's own steps diverge on arctan from beyond 1.39
    found = fit(lambda v: 2.0 * np.arctan(np.repeat(v, 10)), [20.0])
    assert found.values == pytest.approx([0.0], abs=1e-3)


def test_a_motion_that_is_no_number_is_refused() -> None:
    with pytest.raises(NoFitError, match="does not match this model"):
        fit(lambda v: np.full(10, np.nan) * v[0], [1.0])


def test_data_worth_less_than_they_say_are_worth_less_beside_a_prior() -> None:
    rng = np.random.default_rng(4)
    noise = np.zeros(400)
    for i in range(1, 400):
        noise[i] = 0.8 * noise[i - 1] + 3.0 * rng.normal()
    time = np.linspace(-1.0, 1.0, 400)
    slopes, stds = [], []
    for shift in range(0, 400, 25):
        left = np.roll(noise, shift)

        def residuals(values: FloatArray, left: FloatArray = left) -> FloatArray:
            return np.asarray(values[0] + values[1] * time - left)

        found = fit(residuals, [0.0, 0.0], [0.0, 0.0], [np.inf, 0.1])
        slopes.append(found.values[1])
        stds.append(np.sqrt(found.covariance[1, 1]))
    assert np.abs(slopes).max() < 1.5 * np.mean(stds)


@pytest.mark.parametrize("std", [0.03, 0.1, 0.4])
@pytest.mark.parametrize("together", [-0.8, 0.0, 0.8])
def test_a_count_of_frames_in_contact_is_as_sure_as_it_says(std: float, together: float) -> None:
    rng = np.random.default_rng(8)
    apart = std * np.sqrt(2.0 - 2.0 * together)
    off = rng.multivariate_normal([0, 0], std**2 * np.array([[1, together], [together, 1]]), 800)
    begun = rng.uniform(40.0, 41.0, 800)
    ended = begun + rng.uniform(6.0, 12.0, 800)
    true = np.floor(ended) - np.ceil(begun) + 1
    told = [
        frames_within(onset, release, (std, std, apart))
        for onset, release in zip(begun + off[:, 0], ended + off[:, 1], strict=True)
    ]
    z = np.array(
        [(count - n) / max(spread, 0.05) for (count, spread), n in zip(told, true, strict=True)]
    )
    assert np.mean(np.abs(z) <= 2.0) > 0.94
    assert np.mean(np.abs(z) > 4.0) < 0.003
