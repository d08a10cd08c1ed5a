"""Slow motion between normal parts is found; strikes, bounces and falls are not taken for it."""

import numpy as np
import pytest

from measuring.checker.pace import find_slow_part, repeats_of
from measuring.checker.scene import SceneFacts, findings_of

G = 9.81


def flight(capture: np.ndarray) -> np.ndarray:
    return np.column_stack([1.9 * capture, 2.2 * capture - 0.5 * G * capture**2])


def ramp(factor: int, first: float = 0.15, last: float = 0.35) -> tuple[np.ndarray, np.ndarray]:
    """Playback and capture times of a flight with slow motion in its middle."""
    capture, now = [0.0], 0.0
    while now < 0.5:
        now += 1 / 240 if first < now < last else factor / 240
        capture.append(now)
    # a telephone writes even stamps
    return np.arange(len(capture)) / 30.0, np.array(capture)


@pytest.mark.parametrize("factor", [4, 8])
def test_slow_motion_between_two_normal_parts(factor: int) -> None:
    rng = np.random.default_rng(factor)
    playback, capture = ramp(factor)
    place = flight(capture) + rng.normal(0.0, 3e-4, (len(capture), 2))
    found = find_slow_part(playback, place)
    assert found is not None
    assert found.factor == pytest.approx(factor, rel=0.15)
    assert capture[found.first] == pytest.approx(0.15, abs=0.04)
    assert capture[found.last] == pytest.approx(0.35, abs=0.04)


def test_slow_motion_up_to_a_normal_part() -> None:
    rng = np.random.default_rng(5)
    playback, capture = ramp(4, first=-1.0)
    place = flight(capture) + rng.normal(0.0, 3e-4, (len(capture), 2))
    found = find_slow_part(playback, place)
    assert found is not None
    assert found.first == 0
    assert found.factor == pytest.approx(4.0, rel=0.15)


def test_a_few_fast_pictures_after_slow_motion() -> None:
    rng = np.random.default_rng(6)
    capture = np.concatenate([np.arange(121) / 600, 0.2 + 8 / 600 * np.arange(1, 13)])
    place = 200.0 * flight(capture) + rng.normal(0.0, 0.15, (len(capture), 2))
    found = find_slow_part(np.arange(len(capture)) / 30.0, place)
    assert found is not None
    assert found.first == 0
    assert found.last == pytest.approx(120, abs=4)
    assert found.factor == pytest.approx(8.0, rel=0.15)


def kick(time: np.ndarray) -> np.ndarray:
    """A falling ball that is hit downwards."""
    after = np.maximum(time - 0.4, 0.0)
    return np.column_stack([0.0 * time, 3.0 - 0.5 * G * time**2 - 6.0 * after])


def bounce(time: np.ndarray) -> np.ndarray:
    height = np.where(time < 0.3, 0.44 - 0.5 * G * time**2, 0.0)
    after = np.maximum(time - 0.3, 0.0)
    return np.column_stack([0.2 * time, height + 2.2 * after - 0.5 * G * after**2])


def push(time: np.ndarray) -> np.ndarray:
    """A rolling ball that another one hits from behind."""
    return np.column_stack([0.5 * time + 1.5 * np.maximum(time - 0.3, 0.0), 0.0 * time])


def brake(time: np.ndarray) -> np.ndarray:
    return np.column_stack([2.0 * time - 1.6 * np.maximum(time - 0.3, 0.0), 0.0 * time])


@pytest.mark.parametrize("motion", [flight, bounce, push, brake, kick])
def test_what_a_force_does_is_no_slow_motion(motion: object) -> None:
    rng = np.random.default_rng(2)
    time = np.arange(144) / 240
    place = motion(time) + rng.normal(0.0, 3e-4, (144, 2))  # type: ignore[operator]
    assert find_slow_part(time, place) is None


def test_the_finding_states_the_part_and_what_to_do() -> None:
    playback, capture = ramp(8)
    place = 400.0 * flight(capture) * [1.0, -1.0]
    facts = SceneFacts(playback * 30.0, place, None, True, (30.0, 0.01), (0.22, 0.001))
    (finding,) = findings_of(facts)
    assert finding.key == "pace"
    assert "in slow motion" in finding.sentence
    assert "Export it again at one speed" in finding.sentence


def test_doubled_rows_are_counted_and_a_rest_is_none() -> None:
    place = flight(np.arange(60) / 240)
    assert repeats_of(place) == 1
    assert repeats_of(np.repeat(place, 3, axis=0)) == 3
    assert repeats_of(np.concatenate([np.repeat(place[:1], 50, axis=0), place])) == 1
    rounded = np.round(place[:, :1] * [1.0, 0.0], 2)
    assert repeats_of(rounded) == 1


def test_a_swing_that_turns_round_is_no_slow_motion() -> None:
    for seed in range(90):
        rng = np.random.default_rng(seed)
        period, size = rng.uniform(30.0, 140.0), rng.uniform(15.0, 200.0)
        phase, count = rng.uniform(0.0, 6.28), int(rng.uniform(60, 260))
        noise, arm = np.exp(rng.uniform(np.log(0.03), np.log(0.6))), rng.uniform(100.0, 600.0)
        time = np.arange(float(count))
        damped = np.exp(-time * rng.uniform(0.0, 0.004))
        angle = size / arm * np.cos(2.0 * np.pi * time / period + phase) * damped
        place = arm * np.column_stack([np.sin(angle), np.cos(angle)])
        assert find_slow_part(time, place + rng.normal(0.0, noise, place.shape)) is None


def test_a_frozen_picture_in_a_flight() -> None:
    flown = np.maximum(np.arange(80) / 240.0 - 0.05, 0.0)
    path = np.column_stack([900.0 * flown, 400.0 - 300.0 * flown + 2000.0 * flown**2])
    shown = np.concatenate([path[:50], np.repeat(path[49:50], 30, axis=0), path[50:]])
    place = shown + np.random.default_rng(2).normal(0.0, 0.02, shown.shape)
    found = find_slow_part(np.arange(len(place), dtype=float), place)
    assert found is not None
    assert np.isinf(found.factor)
    assert (found.first, found.last) == (49, 79)
    # a ball that is caught and thrown again goes on otherwise
    place[80:] = place[79] - (place[80:] - place[79])
    assert find_slow_part(np.arange(len(place), dtype=float), place) is None


@pytest.mark.parametrize("seed", [46, 70, 98, 193, 198, 252])
def test_the_noise_of_a_rest_is_no_frozen_picture(seed: int) -> None:
    time = np.arange(160.0)
    flown = np.maximum(time - 60.0, 0.0)
    noise = np.where((time > 18.0) & (time < 29.0), 0.01, 0.07)
    place = np.column_stack([0.6 * flown, 0.003 * flown**2 - 0.4 * flown])
    place += np.random.default_rng(seed).normal(0.0, 1.0, (160, 2)) * noise[:, None]
    assert find_slow_part(time, place) is None
