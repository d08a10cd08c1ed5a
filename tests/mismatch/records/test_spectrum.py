"""Autocorrelation of tracking noise, estimated from short records."""

from dataclasses import replace

import numpy as np
import pytest

from mismatch import records, sanity
from mismatch.fitting.prepare import prepare
from mismatch.records import SIGNIFICANT, CampaignRecords, fit_spectrum, shared_deviance
from mismatch.sanity import DroppedInEach, dropped_in_each
from tests.mismatch.synthetic import struck_campaign, thrown_campaign


def tracks(share: float, rho: float, sizes: tuple[int, ...], seed: int):
    """Straight lines under white noise and a first-order autoregression of unit variance."""
    rng = np.random.default_rng(seed)
    pieces = []
    for size in sizes:
        kicks, slow = rng.normal(size=size), np.empty(size)
        slow[0] = kicks[0]
        for k in range(1, size):
            slow[k] = rho * slow[k - 1] + np.sqrt(1.0 - rho**2) * kicks[k]
        time = np.arange(size) / 600.0
        white = rng.normal(size=size)
        pieces.append((time, 3.0 * time + np.sqrt(1 - share) * white + np.sqrt(share) * slow))
    return pieces


@pytest.mark.parametrize(("share", "rho"), [(0.2, 0.85), (0.4, 0.72), (0.4, 0.85), (0.6, 0.9)])
def test_slow_noise_of_short_records_is_not_underestimated(share, rho):
    # At the frequency of half a wave over the longer records, where slow physics is.
    near = 1.0 - 2.0 * rho * np.cos(np.pi / 220) + rho**2
    truth = 1.0 - share + share * (1.0 - rho**2) / near
    fits = [fit_spectrum(tracks(share, rho, (220, 110) * 8, seed), 1.0) for seed in range(8)]
    found = [fit.chosen(SIGNIFICANT) for fit in fits]
    powers = [one.variance * one.inflation for one in found]
    assert 0.6 * truth < np.exp(np.mean(np.log(powers))) < 1.6 * truth


def test_a_record_of_a_few_rows_is_fitted_without_a_warning():
    """Twenty-seven heights of a falling filter gave a warning and a misfit that is no number."""
    for size in range(8, 30):
        found = fit_spectrum(tracks(0.0, 0.5, (size,), size))
        assert found is None or np.isfinite(found.misfit).all()


def test_powers_of_a_long_record_are_those_of_every_cosine(monkeypatch):
    """A swing of two minutes took 3 GB for the powers of all cosines at once."""
    few = records._expected.__wrapped__(1500)
    monkeypatch.setattr(records, "EACH_COSINE", 1500)
    every = records._expected.__wrapped__(1500)
    for some, exact in zip(few, every, strict=True):
        assert some == pytest.approx(exact, rel=2e-3)


def test_white_noise_has_no_memory():
    fits = [fit_spectrum(tracks(0.0, 0.5, (110, 80) * 12, seed)) for seed in range(6)]
    found = [fit.chosen(SIGNIFICANT) for fit in fits]
    assert all(one.inflation == 1.0 for one in found)
    assert np.mean([one.variance for one in found]) == pytest.approx(1.0, abs=0.03)


def remembering(
    campaign: CampaignRecords, size: float, rho: float, every: int = 4
) -> CampaignRecords:
    """Every n-th row of a campaign, with autoregressive noise in each channel."""
    rng = np.random.default_rng(5)

    def errors(rows: int) -> np.ndarray:
        kicks = rng.normal(0.0, size * np.sqrt(1.0 - rho**2), rows + 60)
        found = [0.0]
        for kick in kicks:
            found.append(rho * found[-1] + kick)
        return np.array(found[len(found) - rows :])

    made = []
    for trial in campaign.trials:
        position, angle = trial.position[::every].copy(), trial.pendulum_angle[::every].copy()
        for axis in (0, 1):
            position[:, axis] += errors(len(position))
        made.append(
            replace(
                trial, ball_time=trial.ball_time[::every], position=position,
                pendulum_time=trial.pendulum_time[::every],
                pendulum_angle=angle + errors(angle.size),
            )
        )  # fmt: skip
    return replace(campaign, trials=tuple(made))


def test_noise_correlated_over_five_rows_is_separated_from_motion():
    """A quartic through nine rows follows such noise; as white noise it would be half too low."""
    campaign, baseline = struck_campaign(seed=3, noise=1e-6)
    prepared = prepare(remembering(campaign, 1e-3, 0.8), baseline)
    seen = [0, 1, 3]
    assert np.median(prepared.noise.sigma, axis=0)[seen] == pytest.approx(1e-3, rel=0.25)
    # The power of such noise at low frequency is (1 + rho) / (1 - rho) times its variance.
    assert prepared.noise.inflation[seen] == pytest.approx(9.0, rel=0.4)
    assert prepared.fit.reduced_chi2 < 1.3


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_throws_with_correlated_noise_name_nothing(seed):
    campaign, baseline = thrown_campaign(seed)
    prepared = prepare(remembering(campaign, 3e-3, 0.8, every=1), baseline)
    seen = [0, 1]
    assert np.median(prepared.noise.sigma, axis=0)[seen] == pytest.approx(3e-3, rel=0.25)
    assert prepared.noise.inflation[seen] == pytest.approx(9.0, rel=0.5)
    assert prepared.fit.reduced_chi2 < 1.3


def test_a_random_walk_is_noise():
    """With 3 % of white noise its high-frequency power would double."""
    rho = 0.95
    for seed in range(6):
        found = fit_spectrum(tracks(1.0, rho, (160,) * 10, seed))
        assert found.holds
        # A parabola removes a fraction of the power of such a slow walk.
        assert found.chosen(SIGNIFICANT).inflation > 10.0


@pytest.mark.parametrize(
    "course",
    [
        lambda t: np.sin(2.0 * np.pi * t / 0.05),
        lambda t: 2e3 * np.maximum(t - 0.15, 0.0) ** 2,
        lambda t: np.exp(-(((t - 0.2) / 0.02) ** 2)),
    ],
    ids=["many periods", "a push that begins", "a bump"],
)
def test_a_misfit_of_the_motion_is_not_correlated_noise(course):
    for seed in range(4):
        pieces = tracks(0.0, 0.5, (220,) * 8, seed)
        moving = [(time, value + 10.0 * course(time)) for time, value in pieces]
        assert not fit_spectrum(moving).holds
        assert fit_spectrum(tracks(0.9, 0.8, (220,) * 8, seed)).holds


def test_too_few_samples_give_no_spectrum():
    assert fit_spectrum(tracks(0.0, 0.5, (12, 9), 1)) is None


def test_channels_of_one_tracker_share_their_correlation():
    fits = [fit_spectrum(tracks(0.4, 0.85, (220, 110) * 4, seed)) for seed in range(30)]
    omega = np.pi / 220
    truth = 0.6 + 0.4 * (1.0 - 0.85**2) / (1.0 - 1.7 * np.cos(omega) + 0.85**2)
    alone = [np.log(fit.chosen(1.0).inflation / truth) for fit in fits]
    together = []
    for k in range(0, 30, 3):
        shared = shared_deviance(fits[k : k + 3])
        together += [np.log(fit.chosen(1.0, shared).inflation / truth) for fit in fits[k : k + 3]]
    assert np.sqrt(np.mean(np.square(together))) < 0.85 * np.sqrt(np.mean(np.square(alone)))


def test_channels_with_different_correlation_are_not_pooled():
    slow = fit_spectrum(tracks(0.6, 0.93, (220, 110) * 8, 1))
    white = fit_spectrum(tracks(0.0, 0.5, (220, 110) * 8, 2))
    assert shared_deviance([slow, white]) is None
    assert white.chosen(SIGNIFICANT).inflation == 1.0


def test_the_search_for_a_jump_in_each_trial_has_a_cost():
    prepared = prepare(*struck_campaign(seed=3))
    jumps = dropped_in_each(prepared.forward, prepared.fit)
    # The best instants of a campaign without jumps gain tens of chi-square by the search alone.
    assert len(jumps.instants) == 8
    assert jumps.search_cost > 10.0


def test_a_gap_of_a_fraction_of_a_frame_pays_for_being_rare(monkeypatch):
    """A careful laboratory had dropped_frames 0.49: a twentieth of a frame in each trial."""

    def paid(gap: float) -> float:
        lost = DroppedInEach(instants=(0.1, 0.2, 0.15, 0.25, 0.1, 0.2, 0.15, 0.25))
        prepared = prepare(*struck_campaign((lost, {"gap": gap}), seed=3))
        with_price = dropped_in_each(prepared.forward, prepared.fit)
        monkeypatch.setattr(sanity, "UNCATALOGUED", 0.0)
        without = dropped_in_each(prepared.forward, prepared.fit)
        monkeypatch.undo()
        return with_price.search_cost - without.search_cost

    assert paid(0.2 / 600.0) == pytest.approx(6.0)
    assert paid(2.0 / 600.0) == pytest.approx(0.0)
