"""Units and setup checked against free swings."""

import numpy as np
import pytest
from scipy.special import ellipk

from metrology import UsageError
from mismatch.forward import Forward
from mismatch.records import Baseline, CampaignRecords, Trial, lay_out
from mismatch.sanity import keeps_time, refuse_nonsense
from physics.bodies import PAPER_PENDULUM

RATE = np.sqrt(
    PAPER_PENDULUM.mass * 9.80665 * PAPER_PENDULUM.com / PAPER_PENDULUM.inertia
)  # small swings, rad/s


class Swings:
    """The attributes of a prepared campaign that the check reads."""

    def __init__(self, amplitudes, pace=1.0, written=1.0, slowing=0.0, noise=0.0):
        time = np.arange(0.0, 8.0, 1.0 / 60.0)
        trials = []
        for number, amplitude in enumerate(amplitudes):
            # the period of a pendulum, exactly; its shape is close to a sine
            rate = RATE * np.pi / (2.0 * ellipk(np.sin(amplitude / 2.0) ** 2))
            rate *= pace if number % 2 else 1.0
            angle = written * np.maximum(amplitude - slowing * time, 0.0) * np.cos(rate * time)
            angle += np.random.default_rng(number).normal(0.0, noise, time.size)
            trials.append(Trial(str(number), np.zeros(0), np.zeros((0, 3)), time, angle))
        baseline = Baseline({}, PAPER_PENDULUM)
        records = lay_out(CampaignRecords(tuple(trials)), baseline)
        spans = np.full(len(trials), 8.0)
        self.forward = Forward(baseline, records, "swing", spans, spans, 96, (1.2, 0.3, 1.2))
        self.fit = None


def test_a_consistent_pendulum_passes():
    refuse_nonsense(
        CampaignRecords((Trial("1", *(np.zeros(0),) * 4),)), Swings([0.2, 0.7, 1.1, 0.4])
    )


@pytest.mark.parametrize("degrees", [0.5, 1.0, 1.5])
def test_small_angles_in_degrees_look_isochronous(degrees):
    amplitudes = np.radians(degrees) * np.array([1.0, 0.6, 0.3, 0.8])
    swings = Swings(amplitudes, written=180.0 / np.pi)
    assert keeps_time(swings.forward)
    refuse_nonsense(CampaignRecords((Trial("1", *(np.zeros(0),) * 4),)), swings)


def test_a_pendulum_in_radians_is_not_isochronous():
    assert not keeps_time(Swings([0.2, 0.7, 1.1, 0.4]).forward)


def test_wide_and_small_swings_of_one_spring_are_of_one_pendulum():
    # written 57 times too wide, their frequency is still that of small swings
    amplitudes = np.radians([1.5, 0.2, 1.5, 0.2])
    refuse_nonsense(None, Swings(amplitudes, written=180.0 / np.pi))


def test_trials_of_two_pendulums_are_refused():
    with pytest.raises(UsageError, match="several pendulums"):
        refuse_nonsense(None, Swings([0.2, 0.25, 0.2, 0.25], pace=1.3))


def test_noise_after_rest_is_no_swing():
    # dry friction reduces every swing by the same amount: 0.1 rad after 2 s of 8
    refuse_nonsense(None, Swings([0.1, 0.5, 0.12, 0.6], slowing=0.05, noise=0.006))
