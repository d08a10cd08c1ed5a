"""Effects that the data leave undetermined are no confident answer."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from mismatch.candidates import Candidate, candidates_for
from mismatch.fitting.fit import Fit, free_parameters
from mismatch.fitting.hypotheses import Hypothesis, fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.forward import Model
from mismatch.records import CampaignRecords
from mismatch.search.unnamed import Notch, TorqueField
from mismatch.verdict import _like_its_weight, _own_like_noise, _undetermined, hold_out
from physics.bodies import PAPER_PENDULUM
from physics.domain import Vector
from physics.effects import Effect, FlightState, Level, Parameter, Values, effect_named
from physics.effects.measurement import DroppedFrames
from tests.mismatch.synthetic import struck_campaign


@pytest.mark.parametrize(("std", "open_"), [(0.1, False), (0.24, True)])
def test_a_torque_close_to_the_contact_is_undetermined(std, open_):
    notch = Notch()
    values = {"strength": -0.44, "place": 0.115, "reach": 0.024}
    model = Model(((notch, values),))
    fit = Fit(
        model, np.zeros((4, 4)), np.zeros((0, 2)), 100.0, 0.0, 100, 100.0, free_parameters(model),
        np.diag([std, 0.015, 0.012]) ** 2, np.zeros((4, 25)),
    )  # fmt: skip
    answer = Hypothesis((Candidate(notch, (("place", 0.1), ("reach", 0.03)), 26),), fit, 300.0)
    assert _undetermined(answer) is open_


@pytest.mark.parametrize(("std", "open_"), [(0.067, True), (0.02, False)])
def test_frames_lost_at_an_unknown_time_are_undetermined(std, open_):
    """One fall of a baseball: the gap and its time are correlated."""
    lost = DroppedFrames()
    model = Model(((lost, {"gap": 0.099, "instant": 0.23}),))
    fit = Fit(
        model, np.zeros((1, 4)), np.zeros((0, 2)), 45.0, 0.0, 45, 45.0, free_parameters(model),
        np.diag([std, 0.16]) ** 2, np.zeros((1, 45)),
    )  # fmt: skip
    answer = Hypothesis((Candidate(lost, (("instant", 0.2),), 36),), fit, 60.0)
    assert _undetermined(answer) is open_


@pytest.mark.parametrize(
    ("mean", "remembers", "known", "suspect"),
    [
        (0.12, True, True, True),
        (0.12, False, True, False),
        (1.5, True, True, False),
        (0.12, False, False, True),
        (1.5, False, False, False),
    ],
)
def test_per_trial_spins_about_zero_may_be_slow_noise(mean, remembers, known, suspect):
    """A per-trial spin of 0.12 ± 0.38 rad/s cannot be separated from slow noise."""
    lift = replace(effect_named("magnus"), level=Level.TRIAL)
    model = Model(((lift, {"spin": mean}),))
    fit = Fit(
        model, np.zeros((10, 6)), np.zeros((0, 2)), 3000.0, 0.0, 3000, 3000.0,
        free_parameters(model), np.diag([0.38]) ** 2, np.zeros((10, 320)),
    )  # fmt: skip
    answer = Hypothesis((Candidate(lift, (), 1),), fit, 60.0)
    seen = SimpleNamespace(remembers=remembers, tell_memory=known)
    forward = SimpleNamespace(records=seen)
    assert _own_like_noise(forward, answer) is suspect


def _answer(law: Effect, values: dict[str, float]) -> Hypothesis:
    model = Model(((law, values),))
    free = free_parameters(model)
    fit = Fit(
        model, np.zeros((4, 4)), np.zeros((0, 2)), 100.0, 0.0, 100, 100.0, free,
        np.eye(len(free)), np.zeros((4, 25)),
    )  # fmt: skip
    return Hypothesis((Candidate(law, (), 1),), fit, 300.0)


@pytest.mark.parametrize(
    ("course", "mode", "like"),
    [(np.sin, "impact", True), (np.cos, "impact", False), (np.sin, "swing", False)],
)
def test_a_torque_proportional_to_the_weight_may_be_the_inertia(course, mode, like):
    """A wrong inertia, mass or centre of mass leaves m g d sin φ in a strike."""
    angle = np.linspace(-1.0, 1.0, 60)
    law = TorqueField(low=-1.0, high=1.0)
    knots = np.linspace(law.low, law.high, len(law.parameters))
    values = {p.name: float(v) for p, v in zip(law.parameters, course(knots), strict=True)}
    forward = SimpleNamespace(
        mode=mode,
        baseline=SimpleNamespace(pendulum=PAPER_PENDULUM),
        records=SimpleNamespace(pendulum_angle=angle, pendulum_used=np.ones(60, dtype=bool)),
    )
    assert _like_its_weight(forward, _answer(law, values)) is like


def test_a_torque_at_one_angle_is_not_the_weight():
    angle = np.linspace(-1.6, 0.2, 60)
    law = Notch()
    forward = SimpleNamespace(
        mode="impact",
        baseline=SimpleNamespace(pendulum=PAPER_PENDULUM),
        records=SimpleNamespace(pendulum_angle=angle, pendulum_used=np.ones(60, dtype=bool)),
    )
    values = {"strength": 0.5, "place": -0.3, "reach": 0.03}
    assert not _like_its_weight(forward, _answer(law, values))


@dataclass(frozen=True)
class Fan(Effect):
    """A force upwards beyond two metres, which only hard shots reach."""

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Upwards beyond two metres."""
        nothing = np.zeros_like(np.asarray(flight.x))
        return nothing, values["strength"] / (1.0 + np.exp((2.0 - flight.x) / 0.02)), nothing


def test_held_out_trials_are_predictable_from_the_others():
    """Only the two hard shots reach it, and both would be held out as third of three."""
    law = Fan("fan", "", "", "", "flight", (Parameter("strength", "N", 0.1, -10.0, 10.0),))
    campaign, baseline = struck_campaign((law, {"strength": 1.0}))
    order = (0, 1, 3, 2, 4, 7, 5, 6)
    known = prepare(CampaignRecords(tuple(campaign.trials[k] for k in order)), baseline)
    pool = candidates_for(known.forward, known.fit.model, [law], unnamed=False)
    found = fit_hypothesis(known.forward, known.fit, pool, [np.zeros(1)])
    proof = hold_out(known.forward, known.fit, found)
    assert proof is not None
    assert {"2", "5"} < set(proof.trials)
    assert proof.rmse_after < proof.rmse_before
    assert proof.gain is not None
    assert proof.gain > 100.0
    asked = hold_out(known.forward, known.fit, found, np.arange(8) % 3 == 2)
    assert asked is not None
    assert asked.trials == ("2", "5")
    assert asked.rmse_after > 2.0 * asked.rmse_before
