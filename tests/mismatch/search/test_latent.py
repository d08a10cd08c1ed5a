"""The missing force over time compared with simulated forces."""

from dataclasses import dataclass

import numpy as np
import pytest

from mismatch.candidates import Candidate
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.forward import ForwardModel, batch_terms
from mismatch.search.naming import missing_force
from physics.effects import CATALOGUE, Effect, Parameter
from tests.mismatch.synthetic import struck_campaign


@dataclass(frozen=True)
class Blown(Effect):
    """A horizontal force sinusoidal in time with a fixed phase."""

    id: str = "blown"
    statement: str = "A draught that comes and goes."
    law: str = r"F = a \sin(\omega t + \phi)"
    source: str = "made for this test"
    phase: str = "flight"
    parameters: tuple[Parameter, ...] = (Parameter("a", "N", 0.1, -9.0, 9.0),)
    lag: float = 0.0

    def force(self, values, flight):
        size = values["a"] * np.sin(15.0 * flight.time + self.lag) + 0.0 * np.asarray(flight.x)
        return size, np.zeros_like(size), np.zeros_like(size)


@pytest.fixture(scope="module")
def blown():
    campaign, baseline = struck_campaign((Blown(), {"a": 0.3}), noise=3e-4)
    return prepare(campaign, baseline)


def test_the_missing_force_follows_a_change_of_sign(blown):
    horizontal, vertical = missing_force(blown.forward, blown.fit)[:2]
    inner = (horizontal.place > 0.05) & (horizontal.place < 0.35)
    true = 0.3 * np.sin(15.0 * horizontal.place)
    off = np.abs(horizontal.value - true)[inner]
    assert np.ptp(horizontal.value) > 0.4
    assert np.all(off < 3.0 * horizontal.std[inner] + 0.03)
    assert np.all(np.abs(vertical.value)[inner] < 4.0 * vertical.std[inner] + 0.03)


def test_laws_of_one_class_and_id_are_separate_in_a_scan(blown):
    laws = [Candidate(Blown(lag=lag)) for lag in (0.0, 1.2)]
    scored = scan(blown.forward, blown.fit, laws)
    correlation = scored.information[0, 1] / np.sqrt(np.prod(np.diag(scored.information)))
    assert abs(correlation) < 0.9
    gains = [scored.gain(index)[0] for index in range(2)]
    assert gains[0] > 2.0 * gains[1]


def test_lanes_group_identical_objects_only():
    drag, other = CATALOGUE["drag"][0], Blown()
    models = [ForwardModel(((drag, {"drag_coefficient": 0.1 * k}),)) for k in range(3)]
    models.append(ForwardModel(((drag, {"drag_coefficient": 0.5}), (Blown(lag=1.0), {"a": 1.0}))))
    models.append(ForwardModel(((other, {"a": 2.0}), (other, {"a": 3.0}))))
    terms = batch_terms(models)
    assert [(type(t.effect).__name__, t.rows.start, t.rows.stop) for t in terms] == [
        ("Drag", 0, 4), ("Blown", 3, 4), ("Blown", 4, 5), ("Blown", 4, 5),
    ]  # fmt: skip
