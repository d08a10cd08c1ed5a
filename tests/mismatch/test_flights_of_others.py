"""Flights with small instrument errors and an unmeasured drag."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from metrology import Defaults
from mismatch import explain
from mismatch.candidates import candidates_for
from mismatch.fitting.prepare import prepare
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial
from physics.effects import CATALOGUE

GRAVITY = 9.806


def flights(across=0.0, along=0.0, turned=0.0, stretched=1.0, noise=1e-3, seed=3, spatial=False):
    """Throws of a tennis ball with forces normal to and along the velocity, and frame errors."""
    rng = np.random.default_rng(seed)
    cosine, sine = np.cos(turned), np.sin(turned)
    frame = stretched * np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    trials = []
    for number in range(8):
        time = np.arange(0.0, 0.9, 1.0 / 100.0)
        speed, up = rng.uniform(3.0, 6.0), np.radians(rng.uniform(20.0, 65.0))
        side = rng.uniform(-0.5, 0.5) if spatial else 0.0
        start = [0.0, 1.0, 0.0, speed * np.cos(up), speed * np.sin(up), side]

        def rate(_, s):
            vx, vy, vz = s[3:]
            return [vx, vy, vz, -across * vy + along * vx, -GRAVITY + across * vx + along * vy, 0.0]

        path = solve_ivp(rate, (0.0, 1.0), start, t_eval=time, rtol=1e-9, atol=1e-11).y[:3].T
        seen = path @ frame.T + noise * rng.standard_normal(path.shape)
        if not spatial:
            seen[:, 2] = np.nan
        trials.append(Trial(str(number), time, seen, np.zeros(0), np.zeros(0)))
    return CampaignRecords(tuple(trials))


def tennis(**given):
    return Baseline({"": BallModel("", 0.0577, 0.066)}, **given)


DEFAULT_DRAG = {"drag": {"drag_coefficient": Defaults.DRAG_COEFFICIENT.known}}


@pytest.mark.slow
@pytest.mark.parametrize(
    "assumed",
    [
        pytest.param({}, id="no drag"),
        pytest.param({"effects": DEFAULT_DRAG, "unmeasured": frozenset({"drag"})}, id="unmeasured"),
    ],
)
def test_a_force_normal_to_the_velocity_in_a_vacuum_is_no_lift(assumed):
    # A lift proportional to the speed has the same form, but comes with drag.
    verdict = explain(flights(across=0.15), tennis(**assumed))
    assert [effect.id for effect in verdict.effects] == ["unnamed"]
    assert verdict.location.phase == "flight"


def test_an_assumed_drag_that_is_absent_is_fitted_as_zero():
    verdict = explain(flights(), tennis(effects=DEFAULT_DRAG, unmeasured=frozenset({"drag"})))
    assert verdict.verdict == "no_mismatch"
    (note,) = (note for note in verdict.notes if "no drag coefficient" in note)
    assert "may be another's" in note


def test_an_unusually_small_drag_is_reported_only_if_significant():
    assumed = tennis(effects=DEFAULT_DRAG, unmeasured=frozenset({"drag"}))
    notes = explain(flights(noise=0.1), assumed).notes
    (note,) = (note for note in notes if "no drag coefficient" in note)
    assert "another's" not in note


@pytest.mark.slow
def test_a_measured_drag_that_is_absent_is_reported():
    verdict = explain(flights(), tennis(effects=DEFAULT_DRAG))
    assert "drag" in {one for group in verdict.indistinguishable for one in group} | {
        effect.id for effect in verdict.effects
    }


@pytest.mark.slow
def test_an_absent_stated_drag_gives_no_other_names():
    verdict = explain(flights(across=0.15), tennis(effects=DEFAULT_DRAG))
    named = {effect.id: effect for effect in verdict.effects}
    assert set(named) == {"drag", "unnamed"}
    (coefficient,) = named["drag"].parameters
    assert coefficient.value == pytest.approx(0.0, abs=3.0 * coefficient.std)
    assert coefficient.std < 0.05


@pytest.mark.slow
def test_a_lift_with_a_scale_error_needs_no_second_air_force():
    verdict = explain(flights(across=0.15, along=-0.06, stretched=1.05), tennis())
    named = {effect.id for effect in verdict.effects if effect.probability >= 0.5}
    assert "asymmetric_wake" not in named
    assert named & {"magnus", "unnamed"}


@pytest.mark.parametrize("spatial", [False, True])
def test_axes_level_to_a_spirit_level_are_no_finding(spatial):
    campaign = flights(turned=np.radians(0.3), stretched=1.006, spatial=spatial)
    verdict = explain(campaign, tennis())
    assert verdict.verdict == "no_mismatch"


@pytest.mark.parametrize("degrees", [0.7, 2.5])
def test_badly_levelled_axes_are_reported(degrees):
    verdict = explain(flights(turned=np.radians(degrees)), tennis())
    assert [effect.id for effect in verdict.effects] == ["camera_roll"]
    assert verdict.effects[0].probability > 0.5
    (roll,) = [p for p in verdict.effects[0].parameters if p.name == "roll"]
    assert roll.value == pytest.approx(np.radians(degrees), abs=3.0 * roll.std)


def test_positions_in_space_exclude_errors_of_a_single_camera():
    known = prepare(flights(spatial=True), tennis())
    laws = [effect for forms in CATALOGUE.values() for effect in forms]
    ids = {one.id for one in candidates_for(known.forward, known.fit.model, laws)}
    assert not ids & {"parallax", "lens_distortion", "rolling_shutter"}
    known = prepare(flights(), tennis())
    ids = {one.id for one in candidates_for(known.forward, known.fit.model, laws)}
    assert ids >= {"parallax", "lens_distortion", "rolling_shutter"}


def test_an_off_centre_marker_on_a_spinning_ball_is_not_correlated_noise():
    # Its frequency differs between throws; in short pieces it resembles slow noise.
    rng, seen = np.random.default_rng(4), flights(noise=1e-4)
    trials = []
    for trial in seen.trials[:5]:
        phase, rate = rng.uniform(0.0, 2.0 * np.pi), 2.0 * np.pi * rng.uniform(4.0, 6.0)
        turned = rate * trial.ball_time + phase
        round_it = np.column_stack([np.cos(turned), np.sin(turned), 0.0 * turned])
        trials.append(replace(trial, position=trial.position + 5e-4 * round_it))
    prepared = prepare(CampaignRecords(tuple(trials)), tennis())
    assert prepared.noise.inflation[:2] == pytest.approx(1.0)
    assert prepared.fit.reduced_chi2 > 5.0


def in_moving_air(air, seed=5):
    """Throws of a foam ball in space, with the wind `air` as a function of position."""
    rng = np.random.default_rng(seed)
    drag = 0.45 * 0.5 * 1.2 * np.pi / 4.0 * 0.15**2 / 0.02
    trials = []
    for number in range(8):
        time = np.arange(0.0, rng.uniform(0.6, 0.8), 1.0 / 120.0)
        speed, up, side = rng.uniform(3.0, 6.0), rng.uniform(0.2, 0.9), rng.normal(0.0, 0.1)
        start = speed * np.array([np.cos(up) * np.cos(side), np.sin(up), np.cos(up) * np.sin(side)])

        def rate(_, s):
            past = s[3:] - air(s[:3])
            return [*s[3:], *(-drag * np.linalg.norm(past) * past - [0.0, GRAVITY, 0.0])]

        path = solve_ivp(rate, (0.0, 1.0), [0.0, 1.2, 0.0, *start], t_eval=time, rtol=1e-9)
        seen = path.y[:3].T + 2e-3 * rng.standard_normal((time.size, 3))
        trials.append(Trial(str(number), time, seen, np.zeros(0), np.zeros(0)))
    return CampaignRecords(tuple(trials)), Baseline(
        {"": BallModel("", 0.02, 0.15)}, air_density=1.2,
        effects={"drag": {"drag_coefficient": 0.45}},
    )  # fmt: skip


@pytest.mark.slow
def test_a_side_wind_is_reported_as_wind_only():
    verdict = explain(*in_moving_air(lambda place: np.array([-1.5, 0.0, 0.6])))
    (named,) = verdict.effects
    assert named.id == "wind"
    assert named.probability > 0.9
    found = {p.name: p for p in named.parameters}
    for name, truth in (("wind_x", -1.5), ("wind_z", 0.6)):
        assert found[name].value == pytest.approx(truth, abs=4.0 * found[name].std)
        assert found[name].std < 0.1


@pytest.mark.slow
def test_a_local_side_jet_is_an_unnamed_force_out_of_the_plane():
    def jet(place):
        return np.array([0.0, 0.0, -2.5 * np.exp(-(((place[0] - 0.8) / 0.25) ** 2))])

    verdict = explain(*in_moving_air(jet))
    named = {effect.id: effect for effect in verdict.effects}
    assert named["unnamed"].probability == max(effect.probability for effect in verdict.effects)
    assert "camera_roll" not in named
    where = {p.name: p for p in named["unnamed"].parameters}["place"]
    assert where.value == pytest.approx(0.8, abs=0.05)
    assert named["unnamed"].form == "out_of_plane"
