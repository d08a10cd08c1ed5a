"""The mean of the estimates of restitution, and whether they agree, against draws."""

import numpy as np
from scipy.stats import binom

from measuring.budget import DERIVED
from measuring.checks import CheckOutcome
from measuring.gravity import ESTIMATES, MODEL_STD, fused_cor
from metrology import Contribution, Quantity, UncertaintySource

TRUE, DRAWS = 0.72, 400
NAMES = list(DERIVED)
AT = [NAMES.index(name) for name in ESTIMATES]
OWN = np.array([0.02, 0.012, 0.015])
SHARED = np.array([0.01, 0.008, 0.009])
"""What noise does to each estimate alone, and what one unsure length does to all of them."""
RANDOM = np.zeros((len(NAMES), len(NAMES)))
RANDOM[np.ix_(AT, AT)] = np.diag(OWN**2)
SYSTEMATIC = np.full(len(NAMES), np.nan)
SYSTEMATIC[AT] = SHARED
MODEL = np.array([MODEL_STD[name] for name in ESTIMATES])


def estimates(rng: np.random.Generator) -> np.ndarray:
    """Three estimates of one truth."""
    return TRUE + rng.normal(scale=OWN) + SHARED * rng.normal() + rng.normal(scale=MODEL)


def mean_of(values: np.ndarray, known: tuple[str, ...] = ESTIMATES):
    """The mean and the check of those that are known."""
    every = np.full(len(NAMES), np.nan)
    every[AT] = values
    line = (Contribution(UncertaintySource.TRACK_NOISE, 0.01),)
    found = {
        name: Quantity.measured(name, value, "1", line)
        if name in known
        else Quantity.missing(name, "1", "not seen")
        for name, value in zip(ESTIMATES, values, strict=True)
    }
    return fused_cor(every, RANDOM, {UncertaintySource.CAPTURE_RATE: SYSTEMATIC}, found)


def test_the_mean_is_as_sure_as_it_says_and_surer_than_each() -> None:
    rng = np.random.default_rng(21)
    means = [mean_of(estimates(rng))[0] for _ in range(DRAWS)]
    scores = np.array([(mean.value - TRUE) / mean.std for mean in means])
    for level, within in ((0.6827, 1.0), (0.9545, 2.0)):
        low, high = binom.ppf([0.0005, 0.9995], DRAWS, level)
        assert low <= (np.abs(scores) <= within).sum() <= high
    assert means[0].std < np.sqrt(OWN**2 + SHARED**2 + MODEL**2).min()


def test_honest_estimates_rarely_disagree_and_a_wrong_one_is_told() -> None:
    rng = np.random.default_rng(22)
    failed = sum(mean_of(estimates(rng))[1].outcome is CheckOutcome.FAILED for _ in range(DRAWS))
    assert failed <= binom.ppf(0.999, DRAWS, 0.003)
    wrong = estimates(rng) + np.array([0.0, 0.0, 0.2])
    assert mean_of(wrong)[1].outcome is CheckOutcome.FAILED


def test_what_is_missing_takes_no_part() -> None:
    values = np.array([0.7, 0.74, 9.0])
    mean, check = mean_of(values, ESTIMATES[:2])
    assert 0.7 < mean.value < 0.74
    assert check is not None
    alone, check = mean_of(values, ESTIMATES[:1])
    assert (alone.value, check) == (0.7, None)
    none, check = mean_of(values, ())
    assert (none.known, none.reason, check) == (False, "not seen", None)


def test_what_all_clips_share_stays_in_the_budget_of_the_mean() -> None:
    """Three standard deviations of the shared length, many clips: their mean is off by its line."""
    rng = np.random.default_rng(23)
    off = 3.0 * SHARED
    means = [mean_of(TRUE + rng.normal(scale=OWN) + off)[0] for _ in range(DRAWS)]
    lines = {line.source: line.std for line in means[0].budget}
    shared = lines[UncertaintySource.CAPTURE_RATE]
    left = np.mean([mean.value for mean in means]) - TRUE
    assert abs(left - 3.0 * shared) < 5.0 * means[0].std / np.sqrt(DRAWS)
    total = np.sqrt(sum(std**2 for std in lines.values()))
    assert abs(total - means[0].std) < 1e-6
    assert 0.0 < sum(std**2 for source, std in lines.items() if source.shared_by_setup) < total**2
