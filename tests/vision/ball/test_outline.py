from dataclasses import replace

import numpy as np
import pytest

from tests.vision.ball.painted import GAMMA, cover, exposed, wall, with_ball
from vision.ball.edges import Cutouts, EdgeProfile
from vision.ball.outline import (
    RADIUS_STD_PX,
    FitRules,
    OutlineFits,
    Start,
    fit_outlines,
    panelled,
    weighted,
)


def _pieces(gray: np.ndarray, scene: np.ndarray, noise: float) -> Cutouts:
    value, behind = gray.astype(np.float32)[None], scene.astype(np.float32)[None]
    slope = GAMMA * np.clip(value / 255, 0.05, 1) ** (GAMMA - 1)
    return Cutouts(
        np.zeros((1, 2), dtype=np.int64),
        255 * (value / 255) ** np.float32(GAMMA),
        255 * (behind / 255) ** np.float32(GAMMA),
        np.asarray(1.0 / (noise * slope), dtype=np.float32),
    )


def _start(centre: tuple[float, float], radius: float) -> Start:
    return Start(
        np.round(np.array([centre], dtype=float)), np.array([[radius, 0.0, 0.0]]), np.zeros((1, 2))
    )


def _fit(
    centre: tuple[float, float],
    seed: int,
    *,
    noise: float = 1.0,
    free: int = 3,
    known: bool = True,
    albedo: float = 0.25,
) -> OutlineFits:
    scene = wall(60, 60)
    gray = exposed(with_ball(scene, centre, 12.0, albedo), noise, seed)
    empty = exposed(scene, 0.0, 0)
    if not known:
        empty = np.full_like(empty, int(np.median(empty)))
    fits = fit_outlines(
        _pieces(gray, empty, np.hypot(noise, 0.5)),
        EdgeProfile(12.0, 0.5, 0.0),
        _start(centre, 12.0 if free == 2 else 12.3),
        FitRules(free, inner=3.0, outer=3.0),
    )
    assert fits.found.all()
    return fits


CENTRES = [(29.2, 30.4), (30.5, 28.9), (31.37, 31.81), (28.64, 29.13), (30.02, 30.55)]


def test_centre_is_found_to_a_few_hundredths_of_a_pixel() -> None:
    errors = [_fit(c, i).centre[0] - c for i, c in enumerate(CENTRES)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.03


def test_lines_behind_the_ball_pull_it_unless_the_background_is_known() -> None:
    aware = [_fit(centre, seed, albedo=0.55) for seed, centre in enumerate(CENTRES)]
    blind = [_fit(centre, seed, albedo=0.55, known=False) for seed, centre in enumerate(CENTRES)]
    assert sum(fit.rms_residual[0] for fit in blind) > 1.5 * sum(
        fit.rms_residual[0] for fit in aware
    )


def test_the_sharpest_edge_does_not_outvote_all_others() -> None:
    angle = np.arange(24) * 2 * np.pi / 24
    std = np.where(np.arange(24) == 6, 0.004, 0.06)
    off = np.where(np.arange(24) == 6, -0.12, 0.04 * (-1.0) ** np.arange(24))
    along = np.column_stack([np.cos(angle), np.sin(angle), np.ones(24)])
    information = along[:, :, None] * along[:, None, :] / std[:, None, None] ** 2
    score = along * (off / std**2)[:, None]
    size, weight = np.full(24, 30.0), np.empty(24)
    weighted(information, score, size - 3.0, size, True, np.empty(24), weight)
    normal, pull = np.einsum("s,sij->ij", weight, information), weight @ score
    moved = np.linalg.solve(normal[:2, :2], pull[:2])
    assert np.hypot(*moved) < 0.015


def test_a_sector_in_which_a_panel_ends_is_told_by_its_misfit() -> None:
    square, size = np.full(12, 27.0), np.full(12, 30.0)
    square[4] = 27.0 * 9.0
    most = panelled(square, size, np.empty(12))
    assert np.flatnonzero(square / (size - 3.0) > most).tolist() == [4]


def test_radius_is_found() -> None:
    assert _fit((30.2, 29.7), 3).radius[0] == pytest.approx(12.0, abs=0.06)


def test_scatter_is_near_the_bound() -> None:
    fits = [_fit((30.3, 29.6), seed, noise=3.0, free=2) for seed in range(30)]
    scatter = np.std([fit.centre[0] for fit in fits], axis=0)
    bound = np.sqrt(np.median([np.diag(fit.bound[0]) for fit in fits], axis=0))
    assert np.all(scatter < 1.8 * bound)
    assert np.all(scatter > 0.5 * bound)


def test_covariance_is_honest() -> None:
    fits = [_fit((30.3, 29.6), seed, noise=3.0, free=2) for seed in range(40)]
    scatter = np.var([fit.centre[0] for fit in fits], axis=0)
    claimed = np.median([np.diag(fit.covariance[0]) for fit in fits], axis=0)
    assert np.all(claimed / scatter < 4.0)
    assert np.all(claimed / scatter > 0.25)


def test_nothing_is_claimed_outside_the_picture() -> None:
    pieces = _pieces(*(np.full((20, 20), 100, np.uint8),) * 2, 1.0)
    fits = fit_outlines(pieces, EdgeProfile(5.0, 0.5, 0.0), _start((60.0, 60.0), 5.0), FitRules(2))
    assert not fits.found.any()


def test_many_frames_at_once_are_fitted_as_each_alone() -> None:
    scene = wall(60, 60)
    empty = exposed(scene, 0.0, 0)
    alone = [
        _pieces(exposed(with_ball(scene, c, 12.0), 1.0, i), empty, 1.1)
        for i, c in enumerate(CENTRES)
    ]
    together = Cutouts(
        np.zeros((len(CENTRES), 2), dtype=np.int64),
        *(
            np.concatenate([getattr(one, name) for one in alone])
            for name in ("gray", "background", "inverse_noise")
        ),
    )
    starts = [_start(centre, 12.0) for centre in CENTRES]
    every = Start(
        np.concatenate([one.centre for one in starts]),
        np.concatenate([one.shape for one in starts]),
        np.zeros((len(CENTRES), 2)),
    )
    profile, rules = EdgeProfile(12.0, 0.5, 0.0), FitRules(2, inner=3.0, outer=3.0)
    batch = fit_outlines(together, profile, every, rules)
    single = [
        fit_outlines(one, profile, start, rules) for one, start in zip(alone, starts, strict=True)
    ]
    assert batch.centre == pytest.approx(np.concatenate([fit.centre for fit in single]), abs=1e-4)


def test_edge_profile_runs_from_ball_to_background_and_widens_with_smear() -> None:
    profile = EdgeProfile(15.0, 0.5, 3.0)
    depth = np.linspace(-4, 4, 81).astype(np.float32)
    sharp = profile(depth, np.zeros(81, np.float32))
    smeared = profile(depth, np.full(81, 3.0, np.float32))
    assert sharp[0][0] == pytest.approx(1.0, abs=1e-6)
    assert sharp[0][-1] == pytest.approx(0.0, abs=1e-6)
    assert sharp[0][40] == pytest.approx(0.5, abs=1e-3)
    assert smeared[1].min() > sharp[1].min()


def _hidden_below(pieces: Cutouts, row: int) -> Cutouts:
    noise = pieces.inverse_noise.copy()
    noise[:, row:] = 0.0
    return replace(pieces, inverse_noise=noise)


def test_a_held_radius_makes_the_middle_of_an_arc_as_uncertain_as_itself() -> None:
    scene = wall(60, 60)
    gray = exposed(with_ball(scene, (30.3, 29.6), 12.0), 1.0, 2)
    whole = _pieces(gray, exposed(scene, 0.0, 0), 1.1)
    std = []
    for pieces in (whole, _hidden_below(whole, 30)):
        start = _start((30.3, 29.6), 12.0)
        fits = fit_outlines(pieces, EdgeProfile(12.0, 0.5, 0.0), start, FitRules(2, 3.0, 3.0, 3.0))
        assert fits.found.all()
        std.append(np.sqrt(np.diag(fits.covariance[0])))
    # the top half of a rim lies as far up as the radius is large
    assert std[1][1] > 0.8 * RADIUS_STD_PX
    assert std[0][1] < 0.5 * RADIUS_STD_PX


def test_lines_around_a_large_ball_leave_its_outline_alone() -> None:
    scene, centre, radius = np.full((320, 320), 0.75), (160.3, 159.6), 137.0
    y, x = np.mgrid[0:320, 0:320].astype(float)
    turn = np.arctan2(y - centre[1], x - centre[0])
    lines = np.abs(np.mod(turn, np.radians(12.0)) - 0.1) < 0.02
    ball = np.where(lines, 0.05, 0.3 + 0.25 * np.cos(turn - 1.0))
    part = cover(320, 320, centre, radius)
    gray = exposed(scene * (1.0 - part) + ball * part, 1.0, 3)
    start = _start(centre, radius + 0.3)
    pieces = _pieces(gray, exposed(scene, 0.0, 0), 1.1)
    fits = fit_outlines(pieces, EdgeProfile(radius, 0.25, 0.0), start, FitRules(3, 13.7))
    assert fits.radius[0] == pytest.approx(radius, abs=0.03)
    assert fits.centre[0] == pytest.approx(np.array(centre), abs=0.03)
