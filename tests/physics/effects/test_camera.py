"""Camera effects compared with a pinhole camera in three dimensions."""

import numpy as np
import pytest

from physics.effects import CATALOGUE, CameraView, Form
from physics.effects.measurement import (
    BehindTheBall,
    PivotElsewhere,
    WanderingCentre,
    WanderingMass,
)

DISTANCE, AXIS = 3.0, np.array([0.9, 0.55])
MIDDLE, HALF = np.array([0.9, 0.4]), 0.9
X, Y = np.meshgrid(np.linspace(0.0, 1.8, 7), np.linspace(0.1, 0.7, 4))
VIEW = CameraView(0.0, X, Y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.4, *MIDDLE, HALF)


def seen_by(name, form, values):
    law = next(one for one in CATALOGUE[name] if one.form == form)
    where = dict(zip(("centre_along", "centre_up"), (AXIS - MIDDLE) / HALF, strict=True))
    return np.array(law.image(where | values, VIEW)[:2])


@pytest.mark.parametrize("slope", [(0.05, 0.0), (-0.05, 0.02), (0.0, 0.06)])
def test_a_tilted_plane_is_projected_as_by_a_pinhole(slope):
    along, up = slope
    nearer = 0.03 + along * (X - MIDDLE[0]) + up * (Y - MIDDLE[1])
    stretch = DISTANCE / (DISTANCE - nearer)
    shown = np.array([AXIS[0] + stretch * (X - AXIS[0]), AXIS[1] + stretch * (Y - AXIS[1])])
    lean = {"lean_along_per_distance": along / DISTANCE, "lean_up_per_distance": up / DISTANCE}
    seen = seen_by("parallax", Form.LEANING, {"plane_error": 0.03 / DISTANCE} | lean)
    # What goes with the square of the depth over the distance is left out.
    moved = np.abs(shown - np.array([X, Y])).max()
    assert np.abs(seen - shown).max() < 0.05 * moved


def test_a_lens_of_two_terms_is_brown_s():
    first, second = -0.12, 0.08
    u, v = (X - AXIS[0]) / DISTANCE, (Y - AXIS[1]) / DISTANCE
    r2 = u**2 + v**2
    bent = 1.0 + first * r2 + second * r2**2
    shown = np.array([AXIS[0] + DISTANCE * u * bent, AXIS[1] + DISTANCE * v * bent])
    terms = {"radial": first / DISTANCE**2, "radial_4": second / DISTANCE**4}
    assert seen_by("lens_distortion", Form.TWO_TERMS, terms) == pytest.approx(shown, abs=1e-12)


def _pendulum(phi):
    return CameraView(0.0, *(0.0,) * 6, phi, 0.0, 0.0, 0.4, *MIDDLE, HALF, 0.6)


def test_an_angle_refers_to_the_assumed_axis():
    phi = np.linspace(-0.6, 1.6, 23)
    told = PivotElsewhere().angle({"pivot_x": 4e-3, "pivot_y": -7e-3}, _pendulum(phi))
    seen = np.arctan2(0.6 * np.sin(phi) - 4e-3, 0.6 * np.cos(phi) - 7e-3)
    # What goes with the square of the distance is left out.
    assert told == pytest.approx(seen, abs=2.0 * (8.1e-3 / 0.6) ** 2)


@pytest.mark.parametrize("law", [WanderingCentre(), BehindTheBall()])
def test_slow_centre_errors_contain_no_shift_scale_or_rotation(law):
    """Those are faults of their own: what is left has none of them, over the way evenly passed."""
    x, weights = np.polynomial.legendre.leggauss(17)
    x = MIDDLE[0] + HALF * x
    view = CameraView(0.0, x, 0.0 * x, *(0.0,) * 7, 0.4, *MIDDLE, HALF)
    values = {p.name: 0.01 * (k + 1) for k, p in enumerate(law.parameters)}
    seen_x, seen_y, _ = law.image(values, view)
    for off in (np.asarray(seen_x) - x, np.asarray(seen_y)):
        assert np.abs(off).max() > 0.01
        assert np.abs([weights @ off, weights @ (off * (x - MIDDLE[0]))]).max() < 1e-12


def test_slow_angle_errors_contain_no_zero_and_no_axis_error():
    law = WanderingMass()
    values = {p.name: 0.01 * (k + 1) for k, p in enumerate(law.parameters)}
    phi = np.linspace(0.0, 2.0 * np.pi, 65)[:-1]
    turned = np.asarray(law.angle(values, _pendulum(phi))) - phi
    assert np.abs(turned).max() > 0.01
    assert np.abs([turned.mean(), turned @ np.cos(phi), turned @ np.sin(phi)]).max() < 1e-12
