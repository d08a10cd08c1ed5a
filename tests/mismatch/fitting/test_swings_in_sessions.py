"""Free swings of several sessions with different bearing friction."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mismatch.candidates import candidates_for
from mismatch.fitting.fit import Ending
from mismatch.fitting.hypotheses import Hypothesis, fit_hypothesis
from mismatch.fitting.prepare import Prepared, prepare
from mismatch.fitting.scan import own_values
from mismatch.records import Baseline, CampaignRecords, Trial
from mismatch.verdict import hold_out
from physics.bodies import Pendulum
from physics.effects import CATALOGUE, Level

RIG = Pendulum(0.55, 0.5, 2.0, 0.45)
STIFFNESS = RIG.mass * 9.80665 * RIG.com / RIG.inertia
NOISE = 1e-3


def _swings(*torques: tuple[str, float, float], seed: int = 1) -> CampaignRecords:
    """A swing for each (session, dry torque in N m, viscous coefficient in N m s)."""
    rng = np.random.default_rng(seed)
    trials = []
    for number, (session, dry, viscous) in enumerate(torques):
        time = np.arange(0.0, rng.uniform(5.0, 7.0), 1.0 / 40.0)
        pace = STIFFNESS * rng.uniform(0.99, 1.01)

        def rate(_, s, dry=dry, viscous=viscous, pace=pace):
            lost = (dry * np.sign(s[1]) + viscous * s[1]) / RIG.inertia
            return [s[1], -pace * np.sin(s[0]) - lost]

        start = [rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.2), 0.0]
        seen = solve_ivp(rate, (0.0, 7.0), start, t_eval=time, rtol=1e-8, max_step=0.02).y[0]
        seen = seen + rng.normal(0.0, 3e-3) + NOISE * rng.standard_normal(time.size)
        blank = np.zeros(0)
        trials.append(Trial(str(number), blank, np.zeros((0, 3)), time, seen, session=session))
    return CampaignRecords(tuple(trials))


def _known(campaign: CampaignRecords) -> Prepared:
    return prepare(campaign, Baseline({}, RIG))


def _fitted(known: Prepared, identity: str, level: Level) -> Hypothesis:
    pool = candidates_for(known.forward, known.model, CATALOGUE[identity][:1], unnamed=False)
    (member,) = (one for one in pool if one.effect.level is level)
    strengths = [np.array([member.effect.strengths[0].scale])]
    return fit_hypothesis(known.forward, known.fit, [member], strengths)


@pytest.mark.parametrize(
    ("identity", "worn", "oiled"),
    [("bearing_friction", 0.06, 0.02), ("viscous_damping", 0.05, 0.02)],
)
def test_the_bearing_of_each_session_is_estimated(identity, worn, oiled):
    dry = identity == "bearing_friction"
    of = {"worn": worn, "oiled": oiled}
    rows = [(s, v if dry else 0.0, 0.0 if dry else v) for s, v in of.items() for _ in range(2)]
    known = _known(_swings(*rows))
    shared, each = (_fitted(known, identity, at) for at in (Level.CAMPAIGN, Level.SESSION))
    assert each.fit.ending is Ending.CONVERGED
    assert each.reduced_chi2 < 1.2
    assert each.penalised_gain > shared.penalised_gain + 100.0
    own = own_values(known.forward, each.fit, each.members[0].effect)
    assert own is not None
    assert known.forward.records.groups(Level.SESSION)[1] == tuple(of)
    assert np.all(np.abs(own.value[:, 0] - list(of.values())) < 4.0 * own.std[:, 0])
    assert np.all(own.std < 1e-3)


def test_sessions_of_one_bearing_share_it():
    known = _known(_swings(*((session, 0.04, 0.0) for session in "aabb")))
    shared, each = (
        _fitted(known, "bearing_friction", at) for at in (Level.CAMPAIGN, Level.SESSION)
    )
    assert shared.penalised_gain > each.penalised_gain
    assert each.reduced_chi2 < 1.2


def _held_out_error(*rows: tuple[str, float, float]) -> float:
    """Held-out error over the noise for the last of three swings of the first session."""
    known = _known(_swings(*rows))
    each = _fitted(known, "bearing_friction", Level.SESSION)
    kept = hold_out(known.forward, known.fit, each, np.arange(len(rows)) == 2)
    assert kept is not None
    return kept.rmse_after / NOISE


@pytest.mark.slow
def test_a_session_is_predicted_from_its_other_swings():
    others = (("b", 0.02, 0.0), ("b", 0.02, 0.0))
    known = (("a", 0.06, 0.0), ("a", 0.06, 0.0))
    assert _held_out_error(*known, ("a", 0.06, 0.0), *others) < 1.3
    # A bearing fitted to the held-out swing itself would absorb all of this.
    assert _held_out_error(*known, ("a", 0.04, 0.0), *others) > 5.0
