"""A place or a time read off by a function of itself is an error of reading, not a force."""

from dataclasses import dataclass

import numpy as np
import pytest

from mismatch import explain
from physics.effects import Effect, Parameter
from tests.mismatch.synthetic import struck_campaign


@dataclass(frozen=True)
class BentRuler(Effect):
    """A wall scale that is off to and fro over a metre."""

    id: str = "bent_ruler"
    statement: str = "made for this test"
    law: str = r"x + a \sin(2 \pi x / 1.1)"
    source: str = "made for this test"
    phase: str = "measurement"
    parameters: tuple[Parameter, ...] = (Parameter("a", "m", 0.01, -1.0, 1.0),)

    def image(self, values, view):
        return view.x + values["a"] * np.sin(2.0 * np.pi * view.x / 1.1), view.y, view.z


@dataclass(frozen=True)
class HumpedClock(Effect):
    """A clock that runs ahead in the middle of a flight and is right again at its end."""

    id: str = "humped_clock"
    statement: str = "made for this test"
    law: str = r"t + a \exp(-(t - 0.2)^2 / 0.005)"
    source: str = "made for this test"
    phase: str = "measurement"
    parameters: tuple[Parameter, ...] = (Parameter("a", "s", 0.001, -1.0, 1.0),)

    def clock(self, values, time):
        return time + values["a"] * np.exp(-np.square(np.asarray(time) - 0.2) / 0.005)


@pytest.mark.parametrize(
    ("fault", "size", "channel"),
    [
        pytest.param(BentRuler(), {"a": 0.004}, "reading along the path", id="ruler"),
        pytest.param(HumpedClock(), {"a": 0.002}, "reading of the time", id="clock"),
    ],
)
def test_what_reads_off_is_an_error_of_reading_and_no_force(fault, size, channel):
    verdict = explain(*struck_campaign((fault, size), trials=8, noise=5e-4))
    assert [effect.id for effect in verdict.effects] == ["unnamed"]
    assert verdict.effects[0].form == channel
    assert verdict.effects[0].probability > 0.5
