"""The circle of a swing against circles that were drawn, and its covariance against draws."""

import numpy as np
import pytest
from scipy.stats import binom

from vision.pendulum.arc import ImagedSwing, Pose, fit_arc, fit_imaged_swing

CENTRE, RADIUS, NOISE = np.array([310.0, -240.0]), 420.0, 0.3


def on_the_arc(span_deg: float, count: int) -> np.ndarray:
    """Points of a swing below its pivot."""
    angle = np.pi / 2 + np.deg2rad(np.linspace(-0.5, 0.5, count) * span_deg)
    return CENTRE + RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])


def test_exact_points_give_the_circle() -> None:
    found = fit_arc(on_the_arc(70.0, 40))
    assert found is not None
    assert found.centre_px == pytest.approx(CENTRE, abs=1e-3)
    assert found.radius_px == pytest.approx(RADIUS, abs=1e-3)
    assert found.span_rad == pytest.approx(np.deg2rad(70.0), abs=1e-4)


def test_centre_and_radius_are_as_sure_as_they_say() -> None:
    rng = np.random.default_rng(11)
    exact = on_the_arc(70.0, 30)
    scores = []
    for _ in range(200):
        found = fit_arc(exact + rng.normal(scale=NOISE, size=exact.shape))
        assert found is not None
        off = np.array([*(found.centre_px - CENTRE), found.radius_px - RADIUS])
        scores.append(off / np.sqrt(np.diag(found.covariance)))
    low, high = binom.ppf([0.0005, 0.9995], 200, 0.9545)
    inside = (np.abs(scores) <= 2.0).sum(axis=0)
    assert np.all((low <= inside) & (inside <= high)), inside


def test_a_few_points_that_are_wrong_move_little() -> None:
    rng = np.random.default_rng(12)
    points = on_the_arc(70.0, 60) + rng.normal(scale=NOISE, size=(60, 2))
    clean = fit_arc(points)
    points[[5, 20, 47]] += [0.0, 25.0]
    struck = fit_arc(points)
    assert clean is not None
    assert struck is not None
    spread = np.sqrt(np.diag(clean.covariance))
    assert np.all(np.abs(struck.centre_px - clean.centre_px) < 3.0 * spread[:2])


def test_how_far_the_body_turned_tells_the_radius_of_a_short_arc() -> None:
    rng = np.random.default_rng(13)
    exact = on_the_arc(3.0, 40)
    turns = np.arctan2(*(exact - CENTRE).T[::-1])
    off = {False: [], True: []}
    for _ in range(15):
        points = exact + rng.normal(scale=NOISE, size=exact.shape)
        for helped in off:
            found = fit_arc(points, turns + rng.normal(scale=1e-3, size=40) if helped else None)
            off[helped].append(np.inf if found is None else found.radius_px - RADIUS)
    spread = {helped: float(np.median(np.abs(values))) for helped, values in off.items()}
    assert spread[True] < 0.75 * spread[False]


@pytest.mark.parametrize("points", [np.zeros((4, 2)), np.column_stack([np.arange(9.0)] * 2)])
def test_too_few_points_and_straight_lines_are_no_arc(points: np.ndarray) -> None:
    assert fit_arc(points) is None


def test_poses_that_state_little_do_not_bend_the_swing() -> None:
    pivot, arm = np.array([60.0, 12.0]), 70.0
    angle = np.linspace(-0.3, 0.9, 120)
    off = np.random.default_rng(3).normal(0.0, 0.05, (120, 2))
    std = np.full(120, 0.1)
    # it slides along a line behind it, and its registration says that it is less sure
    sliding = angle > 0.6
    off[sliding, 1] += 10.0 * (angle[sliding] - 0.6)
    std[sliding] = 1.2
    poses = []
    for turn, stray, one in zip(angle, off, std, strict=True):
        anchor = pivot + arm * np.array([np.sin(turn), np.cos(turn)]) + stray
        poses.append(Pose(anchor, -turn, one**2 * np.eye(3), 1.0, 1.0))
    start = ImagedSwing(np.array([61.0, 10.0]), 0.0, 1.0, poses[30].anchor, True)
    assert fit_imaged_swing(start, poses).swing.pivot_px == pytest.approx(pivot, abs=0.7)


@pytest.mark.parametrize("arm", [50.0, 120.0])
@pytest.mark.parametrize("pulled_px", [-0.8, 0.0, 0.8])
def test_a_pivot_is_as_unsure_as_what_pulls_the_track_at_its_ends_leaves_it(
    arm: float, pulled_px: float
) -> None:
    pivot = np.array([60.0, 12.0])
    angle = np.linspace(-0.3, 0.5, 110)
    off = np.random.default_rng(8).normal(0.0, 0.05, (110, 2))
    # one of its sides that turns to the camera pulls it to and fro
    off[:, 0] += pulled_px * angle / 0.5
    poses = [
        Pose(
            pivot + arm * np.array([np.sin(turn), np.cos(turn)]) + stray,
            -turn,
            0.01 * np.eye(3),
            1.0,
            1.0,
        )
        for turn, stray in zip(angle, off, strict=True)
    ]
    start = ImagedSwing(np.array([61.0, 10.0]), 0.0, 1.0, poses[30].anchor, True)
    found = fit_imaged_swing(start, poses)
    error, std = found.swing.pivot_px - pivot, np.sqrt(np.diag(found.pivot_covariance_px2))
    assert np.all(np.abs(error) < 2.0 * std)
    assert np.all(std < 0.15 * arm)
    if pulled_px and arm == 50.0:
        assert abs(error[1]) > 1.0
