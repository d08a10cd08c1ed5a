import numpy as np
import pytest

from tests.vision.painted import GAMMA, exposed, wall, with_ball
from vision.edge_profile import EdgeProfile
from vision.outline import OutlineFit, OutlineShape, RingPixels, fit_outline


def _pixels(gray: np.ndarray, scene: np.ndarray, noise: float) -> RingPixels:
    rows, columns = np.mgrid[0 : gray.shape[0], 0 : gray.shape[1]]
    value, behind = gray.ravel().astype(float), scene.ravel().astype(float)
    slope = GAMMA * np.clip(value / 255, 0.05, 1) ** (GAMMA - 1)
    return RingPixels(
        columns.ravel().astype(float),
        rows.ravel().astype(float),
        255 * (value / 255) ** GAMMA,
        255 * (behind / 255) ** GAMMA,
        noise * slope,
        np.ones(value.shape, dtype=bool),
    )


def _fit(
    centre: tuple[float, float],
    seed: int,
    *,
    noise: float = 1.0,
    free: int = 3,
    known: bool = True,
    albedo: float = 0.25,
) -> OutlineFit:
    scene = wall(60, 60)
    gray = exposed(with_ball(scene, centre, 12.0, albedo), noise, seed)
    empty = exposed(scene, 0.0, 0)
    if not known:
        empty = np.full_like(empty, int(np.median(empty)))
    start = np.array([round(centre[0]), round(centre[1])], dtype=float)
    fit = fit_outline(
        _pixels(gray, empty, np.hypot(noise, 0.5)),
        EdgeProfile(12.0, 0.5, 0.0),
        start,
        OutlineShape(12.0 if free == 2 else 12.3, np.zeros(2)),
        smear=np.zeros(2),
        free=free,
        inner=3.0,
        outer=3.0,
    )
    assert fit is not None
    return fit


CENTRES = [(29.2, 30.4), (30.5, 28.9), (31.37, 31.81), (28.64, 29.13), (30.02, 30.55)]


def test_centre_is_found_to_a_few_hundredths_of_a_pixel() -> None:
    errors = [np.array(_fit(c, i).centre) - c for i, c in enumerate(CENTRES)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.03


def test_lines_behind_the_ball_pull_it_unless_the_background_is_known() -> None:
    aware = [_fit(centre, seed, albedo=0.55) for seed, centre in enumerate(CENTRES)]
    blind = [_fit(centre, seed, albedo=0.55, known=False) for seed, centre in enumerate(CENTRES)]
    assert sum(fit.misfit for fit in blind) > 1.5 * sum(fit.misfit for fit in aware)


def test_radius_is_found() -> None:
    assert _fit((30.2, 29.7), 3).shape.radius == pytest.approx(12.0, abs=0.06)


def test_scatter_is_near_the_bound() -> None:
    fits = [_fit((30.3, 29.6), seed, noise=3.0, free=2) for seed in range(30)]
    scatter = np.std([fit.centre for fit in fits], axis=0)
    bound = np.sqrt(np.median([np.diag(fit.bound)[:2] for fit in fits], axis=0))
    assert np.all(scatter < 1.8 * bound)
    assert np.all(scatter > 0.5 * bound)


def test_covariance_is_honest() -> None:
    fits = [_fit((30.3, 29.6), seed, noise=3.0, free=2) for seed in range(40)]
    scatter = np.var([fit.centre for fit in fits], axis=0)
    claimed = np.median([np.diag(fit.covariance) for fit in fits], axis=0)
    assert np.all(claimed / scatter < 4.0)
    assert np.all(claimed / scatter > 0.25)


def test_nothing_is_claimed_outside_the_picture() -> None:
    pixels = _pixels(*(np.full((20, 20), 100, np.uint8),) * 2, 1.0)
    fit = fit_outline(
        pixels,
        EdgeProfile(5.0, 0.5, 0.0),
        np.array([60.0, 60.0]),
        OutlineShape(5.0, np.zeros(2)),
        smear=np.zeros(2),
    )
    assert fit is None


def test_edge_profile_runs_from_ball_to_background_and_widens_with_smear() -> None:
    profile = EdgeProfile(15.0, 0.5, 3.0)
    depth = np.linspace(-4, 4, 81)
    sharp = profile(depth, np.zeros(81))
    smeared = profile(depth, np.full(81, 3.0))
    assert sharp[0, 0] == pytest.approx(1.0, abs=1e-6)
    assert sharp[0, -1] == pytest.approx(0.0, abs=1e-6)
    assert smeared[1].min() > sharp[1].min()
