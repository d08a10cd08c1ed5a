"""Contact fit against closed-form contacts, and its priors."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from measuring.impact import (
    FaceHypothesis,
    ImpactView,
    contact_pulse,
    find_impact,
    fit_contact,
    gap_after,
    gap_before,
    touch_times,
)
from measuring.inputs import gather_inputs
from measuring.setup.file import Setup
from physics.contact import damping_for_cor
from tests.measuring.ideal_tracks import Noise, ideal_tracks, known_stroke

FloatArray = NDArray[np.float64]

CLOSE = {"rtol": 1e-10, "atol": 1e-12}
FIRST = -0.0838
MIDDLE = 0.007 - FIRST


@cache
def clean_view() -> ImpactView:
    scene, shot = known_stroke("jokku", 120.0)
    impact = find_impact(ideal_tracks(scene, shot, Noise()), gather_inputs(Setup(), "jokku", None))
    assert impact.view is not None
    return impact.view


def test_a_linear_spring_without_loss_is_half_a_sine() -> None:
    pulse = contact_pulse(1.0, 1.0)
    p = np.pi * pulse.phase
    assert pulse.compression == pytest.approx(np.sin(p) / np.pi, abs=1e-6)
    assert pulse.path == pytest.approx(0.5 * pulse.phase - np.sin(p) / (2.0 * np.pi), abs=2e-5)


def test_hertz_contact_lasts_as_long_as_the_textbook_says() -> None:
    # t v / δmax = 2.9432 (Johnson, Contact Mechanics, section 11.4)
    pulse = contact_pulse(1.5, 1.0)
    assert 1.0 / pulse.compression.max() == pytest.approx(2.9432, rel=2e-3)


def test_a_contact_that_loses_energy_moves_as_its_equation_of_motion_does() -> None:
    n, damping = 1.3, damping_for_cor(0.7)

    def rates(_: float, state: FloatArray) -> FloatArray:
        return np.array([state[1], -(max(state[0], 0.0) ** n) * (1.0 + damping * state[1])])

    steps = np.linspace(0.0, 1.0, 201)
    pulse = contact_pulse(n, 0.7)
    lasts = brentq(lambda t: solve_ivp(rates, (0.0, t), [0.0, 1.0], **CLOSE).y[0, -1], 2.5, 4.5)
    moved = solve_ivp(rates, (0.0, lasts), [0.0, 1.0], t_eval=steps * lasts, **CLOSE)
    assert moved.y[1, -1] == pytest.approx(-0.7, abs=1e-6)
    # what is interpolated between exponents is off by 1e-4 of the peak
    assert pulse.compression == pytest.approx(moved.y[0] / lasts, abs=5e-5)
    gone = (steps * lasts - moved.y[0]) / (1.7 * lasts)
    assert pulse.path == pytest.approx(gone, abs=5e-5)


def test_touch_is_where_the_gaps_close_and_open() -> None:
    view = clean_view()
    onset, release = touch_times(view, view.face_offset, MIDDLE)
    at = np.array([onset, release])
    assert gap_before(view, at)[0] == pytest.approx(view.face_offset, abs=2e-6)
    assert gap_after(view, at)[1] == pytest.approx(view.face_offset, abs=2e-6)


def test_a_ball_that_is_hardly_seen_leaves_the_face_where_it_was_known_to_be() -> None:
    view = clean_view()
    rng = np.random.default_rng(5)
    # a metre of noise on paths of centimetres: the outline may not run ahead at will to explain it
    dim = replace(
        view,
        position_m=view.position_m + rng.normal(0.0, 1.0, view.position_m.shape),
        std_m=np.full(len(view.std_m), 1.0),
    )
    found = fit_contact(dim, MIDDLE)
    off = found.face[0] - dim.face_offset
    assert abs(off) < np.sqrt(found.face_covariance[0, 0])
    assert np.sqrt(found.face_covariance[0, 0]) > dim.face_offset_std


def test_the_stated_offset_holds_as_often_as_it_says() -> None:
    view, draws = replace(clean_view(), face_offset_std=1.5e-3), 200
    rng = np.random.default_rng(11)
    z = np.empty(draws)
    for n in range(draws):
        known = view.face_offset + rng.normal(0.0, view.face_offset_std)
        noisy = replace(
            view,
            face_offset=known,
            position_m=view.position_m + rng.normal(0.0, 3e-4, view.position_m.shape),
            std_m=np.full(len(view.std_m), 3e-4),
        )
        found = fit_contact(noisy, MIDDLE)
        z[n] = (found.face[0] - view.face_offset) / np.sqrt(found.face_covariance[0, 0])
    # 95 % of 200 are 190, give or take 3.1: four times that is allowed
    assert np.count_nonzero(np.abs(z) < 1.96) >= 178
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.25


@pytest.mark.parametrize("std", [1e-4, 0.005, 0.03])
def test_a_hypothesis_of_the_face_is_a_probability_density(std: float) -> None:
    lead = np.linspace(0.04 - 8.0 * std, 0.04 + 8.0 * std, 4001)
    share = np.trapezoid(FaceHypothesis(0.04, std, 0.3).density(lead), lead)
    assert share == pytest.approx(0.3, rel=1e-6)


def test_a_face_seen_at_the_wrong_place_gives_way_to_the_push_of_the_ball() -> None:
    view = clean_view()
    right = fit_contact(view, MIDDLE)
    # 0.3 radii off, 30 times what is stated: another part of the mass was seen
    lead = view.face_offset + 0.03
    other = FaceHypothesis(lead, 0.4 * view.radius, 0.2)
    wrong = replace(view, face_offset=lead, face_offset_std=1e-3, face_alternatives=(other,))
    found = fit_contact(wrong, MIDDLE)
    lasts = found.release_s - found.onset_s
    assert lasts == pytest.approx(right.release_s - right.onset_s, abs=1.5e-3)
    assert found.face[0] == pytest.approx(view.face_offset, abs=4e-3)


def test_a_mass_whose_track_shifts_in_the_contact_leaves_the_duration_to_the_ball() -> None:
    view = clean_view()
    right = fit_contact(view, MIDDLE)
    arm = float(np.hypot(*(view.rest - view.pivot)))
    values = view.after.fitted.values.copy()
    values[0] += 0.006 / arm
    shifted = replace(view.after, fitted=replace(view.after.fitted, values=values))
    found = fit_contact(replace(view, after=shifted), MIDDLE)
    lasts = found.release_s - found.onset_s
    assert lasts == pytest.approx(right.release_s - right.onset_s, abs=1.5e-3)
    assert found.face[1] - found.face[0] == pytest.approx(-0.006, abs=3e-3)
