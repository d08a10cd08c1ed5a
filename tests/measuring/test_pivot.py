"""A pivot that a person states."""

from dataclasses import replace

import numpy as np
import pytest

from measuring.chain import measure_clip
from measuring.metres import STATED_STD_PX
from measuring.setup.file import load_setup
from metrology import UsageError
from pipelines.api.quantities import measure_options
from tests.pipelines.app.small import CLIP, strike


def test_a_stated_pivot_replaces_the_fitted_one() -> None:
    found = strike()
    assert found.tracks.pendulum is not None
    x, y = found.tracks.pendulum.pivot_px
    options = measure_options(load_setup(CLIP.with_suffix(".toml")), cache=True)
    lower = measure_clip(CLIP, replace(options, pivot_at=(float(x), float(y) + 15.0)))
    pendulum = lower.tracks.pendulum
    assert pendulum is not None
    assert np.allclose(pendulum.pivot_px, (x, y + 15.0))
    assert np.allclose(np.sqrt(np.diag(pendulum.pivot_covariance_px2)), STATED_STD_PX)
    # a shorter arm turns by more while the mass moves as far
    assert np.ptp(pendulum.angle_rad) > 1.02 * np.ptp(found.tracks.pendulum.angle_rad)
    here = measure_clip(CLIP, replace(options, pivot_at=(float(x), float(y))))
    before, after = (one.quantity("pendulum_speed_before") for one in (found, here))
    assert before.value is not None
    assert after.value is not None
    assert before.std is not None
    assert abs(before.value - after.value) < before.std
    assert not any("stated pivot" in one for one in here.warnings)


def test_a_pivot_far_from_where_the_mass_turns_is_doubted() -> None:
    found = strike().tracks.pendulum
    assert found is not None
    x, y = found.pivot_px.tolist()
    options = measure_options(
        load_setup(CLIP.with_suffix(".toml")), pivot_at=(x, y - 80.0), cache=True
    )
    measured = measure_clip(CLIP, options)
    warning = next(one for one in measured.warnings if "stated pivot" in one)
    assert "80 px" in warning
    assert "--pivot-at" in warning
    # what rests on it is withheld, the ball's flight is not
    assert measured.quantity("pendulum_speed_before").reason == warning
    assert measured.quantity("ball_speed").known


@pytest.mark.parametrize(
    ("pivot", "message"),
    [
        ("120,-8,3", "names a frame"),
        ("high", "is not X,Y"),
        ("nan,2", "is not X,Y"),
    ],
)
def test_a_wrong_pivot_is_refused(pivot: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        measure_options(pivot_at=pivot)


def test_a_pivot_on_the_mass_is_refused() -> None:
    pendulum = strike().tracks.pendulum
    assert pendulum is not None
    x, y = pendulum.track.centre_px[0].tolist()
    options = measure_options(load_setup(CLIP.with_suffix(".toml")), pivot_at=(x, y), cache=True)
    with pytest.raises(UsageError, match="path of the pendulum's mass"):
        measure_clip(CLIP, options)
