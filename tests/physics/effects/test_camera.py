"""What a camera shows, against a pinhole in three dimensions."""

import numpy as np
import pytest

from physics.effects import CATALOGUE, CameraView, Form

DISTANCE, AXIS = 3.0, np.array([0.9, 0.55])
MIDDLE, HALF = np.array([0.9, 0.4]), 0.9
X, Y = np.meshgrid(np.linspace(0.0, 1.8, 7), np.linspace(0.1, 0.7, 4))
VIEW = CameraView(0.0, X, Y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.4, *MIDDLE, HALF)


def seen_by(name, form, values):
    law = next(one for one in CATALOGUE[name] if one.form == form)
    where = dict(zip(("centre_along", "centre_up"), (AXIS - MIDDLE) / HALF, strict=True))
    return np.array(law.image(where | values, VIEW)[:2])


@pytest.mark.parametrize("slope", [(0.05, 0.0), (-0.05, 0.02), (0.0, 0.06)])
def test_a_plane_that_leans_shows_its_balls_as_a_pinhole_does(slope):
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
