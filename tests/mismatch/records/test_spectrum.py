"""Memory of tracking noise, learnt from short records without a bias."""

import numpy as np
import pytest

from mismatch.fitting.prepare import prepare
from mismatch.records import SIGNIFICANT, fit_spectrum, shared_deviance
from mismatch.sanity import dropped_in_each
from tests.mismatch.synthetic import struck_campaign


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
def test_slow_noise_of_short_records_is_not_underrated(share, rho):
    # At the pace of one half wave over the longer records, where slow physics is.
    near = 1.0 - 2.0 * rho * np.cos(np.pi / 220) + rho**2
    truth = 1.0 - share + share * (1.0 - rho**2) / near
    fits = [fit_spectrum(tracks(share, rho, (220, 110) * 8, seed), 1.0) for seed in range(8)]
    found = [fit.chosen(SIGNIFICANT) for fit in fits]
    powers = [one.variance * one.inflation for one in found]
    assert 0.6 * truth < np.exp(np.mean(np.log(powers))) < 1.6 * truth


def test_white_noise_has_no_memory():
    fits = [fit_spectrum(tracks(0.0, 0.5, (110, 80) * 12, seed)) for seed in range(6)]
    found = [fit.chosen(SIGNIFICANT) for fit in fits]
    assert all(one.inflation == 1.0 for one in found)
    assert np.mean([one.variance for one in found]) == pytest.approx(1.0, abs=0.03)


def test_too_few_samples_say_nothing_of_a_spectrum():
    assert fit_spectrum(tracks(0.0, 0.5, (12, 9), 1)) is None


def test_channels_of_one_tracker_tell_their_memory_together():
    fits = [fit_spectrum(tracks(0.4, 0.85, (220, 110) * 4, seed)) for seed in range(30)]
    omega = np.pi / 220
    truth = 0.6 + 0.4 * (1.0 - 0.85**2) / (1.0 - 1.7 * np.cos(omega) + 0.85**2)
    alone = [np.log(fit.chosen(1.0).inflation / truth) for fit in fits]
    together = []
    for k in range(0, 30, 3):
        shared = shared_deviance(fits[k : k + 3])
        together += [np.log(fit.chosen(1.0, shared).inflation / truth) for fit in fits[k : k + 3]]
    assert np.sqrt(np.mean(np.square(together))) < 0.85 * np.sqrt(np.mean(np.square(alone)))


def test_channels_with_memories_of_their_own_are_left_apart():
    slow = fit_spectrum(tracks(0.6, 0.93, (220, 110) * 8, 1))
    white = fit_spectrum(tracks(0.0, 0.5, (220, 110) * 8, 2))
    assert shared_deviance([slow, white]) is None
    assert white.chosen(SIGNIFICANT).inflation == 1.0


def test_looking_for_a_jump_in_each_trial_pays_for_the_search():
    prepared = prepare(*struck_campaign(seed=3))
    jumps = dropped_in_each(prepared.forward, prepared.fit)
    # The best instants of a blameless campaign gain tens of chi-square, all of it by the search.
    assert len(jumps.instants) == 8
    assert jumps.looks > 10.0
