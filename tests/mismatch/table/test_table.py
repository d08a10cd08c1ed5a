"""The engine on trial tables: known truth, Table 5 of Ryu et al., bad input."""

from dataclasses import replace

import numpy as np
import pytest

from measuring.setup.file import read_setup
from metrology import SetupError, TooLittleDataError, UsageError
from mismatch.forward import ForwardModel
from mismatch.trial_table import TrialTable, explain_table, table_forward
from physics.bodies import PAPER_PENDULUM, PAPER_SUPPORT
from physics.effects import CATALOGUE
from physics.forward import Experiment, time_resolved_landing
from physics.restitution import ConstantCor
from pipelines.explain.campaign import baseline_for_balls
from pipelines.paper import BACKSWINGS_DEG, TABLE_5, constant_law, measured_speeds
from tests.mismatch.table.trial_tables import BALLS, SETUP, lab, simulated_table


def test_the_table_model_is_the_forward_model_of_physics():
    table = simulated_table(1, speeds=True)
    baseline = lab()
    model = ForwardModel(((CATALOGUE["drag"][0], {"drag_coefficient": 0.47}),))
    seen = table_forward(table, baseline).predict([model], np.zeros((1, table.trials, 4)))[0]
    ball = read_setup(SETUP).balls["jokku"].body()
    mine = np.array([name == "jokku" for name in table.balls])
    experiment = Experiment(replace(ball, cor=ConstantCor(0.75)), PAPER_PENDULUM, PAPER_SUPPORT)
    outcome, landing = time_resolved_landing(experiment, table.values[mine, 0], step=0.005)
    # The engine interpolates a table of contacts.
    np.testing.assert_allclose(seen[mine, 2], landing.distance, atol=5e-4)
    speed = np.hypot(outcome.ball_vx, outcome.ball_vy)
    np.testing.assert_allclose(seen[mine, 1], speed, rtol=1e-3)


def test_nothing_is_named_when_nothing_is_missing():
    verdict = explain_table(simulated_table(3), lab()).verdict
    assert verdict.verdict == "no_mismatch"
    assert not verdict.effects
    assert verdict.location is None


def test_velocity_dependent_restitution_is_found_from_ball_speeds():
    verdict = explain_table(simulated_table(4, "velocity_dependent_cor"), lab()).verdict
    assert [e.id for e in verdict.effects] == ["velocity_dependent_cor"]
    slope = verdict.effects[0].parameters[0]
    assert abs(slope.value + 0.02) < 3.0 * slope.std
    assert verdict.held_out is not None
    assert verdict.held_out.rmse_after < verdict.held_out.rmse_before
    assert verdict.location is not None
    assert "m/s" in verdict.location.statement


def test_ranges_alone_do_not_separate_offset_and_scale():
    table = simulated_table(2, "origin_offset", speeds=False, stated=False)
    verdict = explain_table(table, lab()).verdict
    assert verdict.verdict == "ambiguous"
    assert {"origin_offset", "parallax"} <= set(verdict.indistinguishable[0])
    assert verdict.next_measurement
    assert any("without uncertainties" in note for note in verdict.notes)


def _repeated(seed: int, concealed: str, shared: float) -> TrialTable:
    """Ball speeds of ten trials at each setting, off by what the setting's trials share."""
    table = simulated_table(seed, concealed, backswing=True, stated=False, repeats=10)
    setting, values = table.setting, table.values.copy()
    means = np.bincount(setting, values[:, 0]) / np.bincount(setting)
    values[:, 0], values[:, 2] = means[setting], np.nan
    off = np.random.default_rng(seed).normal(0.0, shared, means.size)
    values[:, 1] *= 1.0 + off[setting]
    return replace(table, values=values, backswing=np.full(table.trials, np.nan))


def test_errors_that_repeats_share_are_no_law_however_often_they_are_repeated():
    """Ping-pong balls had a second effect at 0.61 from six heights, ten drops at each."""
    off = explain_table(_repeated(1, "", 0.012), lab()).verdict
    assert all(effect.probability < 0.5 for effect in off.effects)
    assert off.verdict != "no_mismatch"
    law = explain_table(_repeated(1, "velocity_dependent_cor", 0.0), lab()).verdict
    assert law.effects[0].id == "velocity_dependent_cor"
    assert law.effects[0].probability > 0.9


def test_swing_losses_are_found_from_the_impact_speeds():
    table = simulated_table(5, "pendulum_drag", backswing=True)
    verdict = explain_table(table, lab()).verdict
    swing = {"pendulum_drag", "viscous_damping", "bearing_friction", "backswing_offset"}
    assert {e.id for e in verdict.effects} <= swing
    assert verdict.effects
    assert verdict.location is not None
    assert verdict.location.phase == "swing"


def _table_5(kind: str) -> TrialTable:
    """Measured ranges of Ryu et al. at their impact speeds."""
    names = [ball for ball in BALLS for _ in range(4)]
    values = np.full((8, 3), np.nan)
    values[:, 0] = np.concatenate([measured_speeds(ball) for ball in BALLS])
    values[:, 2] = [float(text) for ball in BALLS for text in TABLE_5[ball][kind]]
    angle = np.deg2rad(np.tile(BACKSWINGS_DEG, 2))
    return TrialTable(
        tuple(str(k) for k in range(1, 9)), tuple(names), values, np.full((8, 3), np.nan), angle
    )


def _constant_lab():
    from physics.bodies import BALLS as PRESETS

    text = SETUP
    for ball, old in (("jokku", "0.75"), ("basketball", "0.90")):
        law = constant_law(PRESETS[ball])
        text = text.replace(f'cor = "{old}"', f'cor = "{float(law(1.0)):.4f}"')
    return baseline_for_balls(read_setup(text), BALLS, struck=True)


def test_table_5_needs_velocity_dependent_restitution():
    table = replace(_table_5("experiment"), backswing=np.full(8, np.nan))
    verdict = explain_table(table, _constant_lab()).verdict
    assert verdict.verdict == "ambiguous"
    assert verdict.effects[0].id == "velocity_dependent_cor"
    assert verdict.effects[0].parameters[0].value < 0.0
    assert verdict.next_measurement is not None
    assert "ball_speed_m_s" in verdict.next_measurement
    tried = {one for other in verdict.alternatives for one in other.ids}
    grouped = {one for group in verdict.indistinguishable for one in group}
    assert tried | grouped >= {"velocity_dependent_cor", "drag"}
    # Nothing in the catalogue reduces the residuals to the reading resolution.
    assert not verdict.remainder.white


def test_a_swing_faster_than_free_fall_is_reported():
    verdict = explain_table(_table_5("experiment"), _constant_lab()).verdict
    faster = [note for note in verdict.notes if "without losses" in note]
    assert len(faster) == 1
    assert faster[0].startswith("trial 2 ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"values": (2, 1000.0)}, "metres"),
        ({"values": (2, 3.0)}, "contradicts"),
        ({"values": (1, 0.01)}, "times what the setup expects"),
        ({"values": (2, -1.0)}, "positive"),
    ],
)
def test_units_and_swapped_columns_are_refused(change, said):
    table = simulated_table(6)
    column, factor = change["values"]
    values = table.values.copy()
    values[:, column] *= factor
    with pytest.raises(UsageError, match=said) as caught:
        explain_table(replace(table, values=values), lab())
    assert caught.value.hint


def test_too_few_trials_or_no_start_are_refused():
    table = simulated_table(7)
    with pytest.raises(TooLittleDataError, match="too little"):
        explain_table(table.chosen(np.arange(table.trials) < 3), lab())
    blank = table.values.copy()
    blank[:, 0] = np.nan
    with pytest.raises(UsageError, match="neither an impact speed nor a back-swing"):
        explain_table(replace(table, values=blank), lab())
    blank = table.values.copy()
    blank[:, 1:] = np.nan
    with pytest.raises(UsageError, match="neither a ball speed nor a range"):
        explain_table(replace(table, values=blank), lab())


def test_identical_trials_are_noted():
    table = simulated_table(8, "origin_offset", angles=(90.0,), repeats=4)
    verdict = explain_table(table, lab()).verdict
    assert any("alike" in note for note in verdict.notes)


def test_a_setup_without_a_pendulum_is_refused():
    baseline = replace(lab(), pendulum=None)
    with pytest.raises(SetupError, match="pendulum"):
        explain_table(simulated_table(9), baseline)


def test_trials_can_be_held_out_by_name():
    table = simulated_table(4, "velocity_dependent_cor")
    verdict = explain_table(table, lab(), hold_out=["1", "16"]).verdict
    assert verdict.held_out is not None
    assert verdict.held_out.trials == ("1", "16")
    with pytest.raises(UsageError, match="no trial"):
        explain_table(table, lab(), hold_out=["nobody"])
