"""Scales without a grid: what a camera that looks aslant may do to them."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from calib.grid import no_grid, only_stripes
from metrology import CalibrationError
from pipelines.calibrate.plan import Filming, film_scene, planned_setup, planned_tracks
from pipelines.measure import metres
from pipelines.measure.chain import FollowedClip, measure_tracks
from pipelines.measure.inputs import gather_inputs
from pipelines.measure.metres import BallScale
from vision.clip.footage import CaptureRate, RateSource

FILMING = Filming(width=432, height=240, tape_std_m=0.005, fps=300.0)


def test_lengths_along_the_rows_are_as_long_as_a_camera_square_to_them_sees_them() -> None:
    aslant = math.radians(30.0)
    places = np.array([[0.0, 0.0], [1.2, 0.0], [0.4, 0.7]])
    # from far away: rows are seen shorter by the cosine of the slant, columns as long as they are
    seen = places * [math.cos(aslant), -1.0] * 200.0 + [90.0, 150.0]
    rest = seen[0]
    scale = BallScale(1.0 / 200.0, rest, rest, foreshortening=math.cos(aslant))
    assert scale.point(seen) == pytest.approx(places, abs=1e-9)


def _share_of_speed(
    monkeypatch: pytest.MonkeyPatch, refusal: Callable[[], CalibrationError]
) -> float:
    scene, shot = film_scene(FILMING)

    def refused(*_: object, **__: object) -> None:
        raise refusal()

    monkeypatch.setattr(metres, "find_wall_grid", refused)
    inputs = gather_inputs(planned_setup(FILMING, scene), None, None)
    rate = CaptureRate(FILMING.fps, 0.1, RateSource.OPTION)
    clock = np.arange(scene.frames, dtype=float)
    tracks = planned_tracks(FILMING, scene, shot)
    results = measure_tracks(FollowedClip(tracks, clock, rate, inputs)).results
    speed = next(item for item in results.quantities if item.name == "ball_speed")
    assert speed.value is not None
    assert speed.std is not None
    true = float(shot.contact.outcome.ball_speed)
    assert abs(speed.value - true) < 3.0 * speed.std
    return speed.std / speed.value


def test_lines_in_one_direction_alone_may_be_a_grid_seen_far_aslant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # a camera 30° aside sees rows shorter by 13 %: that is 2.6 standard uncertainties at most
    assert _share_of_speed(monkeypatch, only_stripes) > 0.05
    assert _share_of_speed(monkeypatch, no_grid) < 0.05
