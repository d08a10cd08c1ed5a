"""Effects written by users: accepted as declared or refused with a message."""

import time
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from metrology import UsageError
from mismatch.candidates import MAX_SHAPES, candidates_for, refuse_unusable, within_patience
from mismatch.fitting.prepare import prepare
from physics.effects import Effect, Extent, Parameter
from tests.mismatch.synthetic import thrown_campaign


class Thread(Effect):
    """A thread that pulls the ball back."""

    def force(self, values, flight):
        nothing = np.zeros_like(np.asarray(flight.vx))
        return -values["strength"] * flight.x, nothing, nothing


def thread(*parameters, identity="thread", **more):
    return Thread(identity, "A thread.", "F = -k x", "this lab", "flight", parameters, **more)


STRENGTH = Parameter("strength", "N", 0.1, 0.0, 7.0)


@pytest.fixture(scope="module")
def prepared():
    return prepare(*thrown_campaign())


def test_a_parameter_keeps_the_bounds_of_its_user(prepared):
    place = Parameter("place", "m", 0.3, -2.0, 2.0, grid=(-1.0, 1.0))
    pool = candidates_for(prepared.forward, prepared.model, [thread(STRENGTH, place)])
    mine = [c for c in pool if c.id == "thread"]
    assert mine[0].effect.parameters == (STRENGTH, place)
    assert [dict(c.shape)["place"] for c in mine] == [-1.0, 1.0]


def test_a_declared_grid_spans_the_campaign(prepared):
    place = Parameter("x0", "m", 0.1, -9.0, 9.0, grid=(0.0, 1.0), over=Extent.WAY)
    pool = candidates_for(prepared.forward, prepared.model, [thread(STRENGTH, place)])
    found = [dict(c.shape)["x0"] for c in pool if c.id == "thread"]
    xs = prepared.forward.records.position[..., 0]
    assert found == pytest.approx([np.nanmin(xs), np.nanmax(xs)], abs=0.15)


def test_too_many_shapes_are_an_error(prepared):
    grid = tuple(np.linspace(0.0, 1.0, MAX_SHAPES + 1))
    many = thread(STRENGTH, Parameter("x0", "m", 0.1, -1.0, 2.0, grid=grid))
    with pytest.raises(UsageError, match=f"{MAX_SHAPES + 1} combinations"):
        candidates_for(prepared.forward, prepared.model, [many])


@dataclass(frozen=True)
class Listing(Thread):
    """A thread with a mutable field."""

    numbers: list = field(default_factory=list)


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (thread(), "nothing to fit"),
        (thread(STRENGTH, identity="drag"), "an id that the catalogue has"),
        (thread(STRENGTH, identity="unnamed"), "an id that the catalogue has"),
        (thread(STRENGTH, STRENGTH), "two parameters of one name"),
        (thread(replace(STRENGTH, scale=np.nan)), "a number that is none"),
        (thread(replace(STRENGTH, lower=8.0)), "leave no room"),
        (thread(replace(STRENGTH, lower=1.0)), "neutral value"),
        (Effect("idle", "", "", "", "flight", (STRENGTH,)), "overrides no hook"),
        (Listing("thread", "", "", "", "flight", (STRENGTH,)), "a field that may change"),
    ],
)
def test_an_effect_that_cannot_be_fitted_is_refused(effect, said):
    with pytest.raises(UsageError, match=said):
        refuse_unusable(effect)


def test_another_form_of_a_known_law_is_accepted():
    refuse_unusable(thread(STRENGTH, identity="drag", form="of a thread"))


def test_an_effect_that_does_not_return_is_an_error():
    with pytest.raises(UsageError, match="has not answered"):
        within_patience(thread(STRENGTH), lambda: time.sleep(2.0), 0.05)
