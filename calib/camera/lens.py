"""Lens from pictures of a chessboard or ChArUco board, and how good it is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera.board import Board, BoardView, find_board
from calib.camera.camera import Lens, rotation_matrix
from calib.camera.lens_fit import MODELS, NAMES, BoardFit, fit_boards, held_out_errors
from calib.camera.lens_prior import LensPrior, prior_of
from metrology import CalibrationError

__all__ = ["Board", "BoardView", "LensCalibration", "calibrate_lens", "find_board"]

FloatArray = NDArray[np.float64]

LEAST_VIEWS = 6
LEAST_TILT_SPREAD = np.radians(8.0)
LEAST_COVERAGE = 0.35
OUTLIER_AT = 3.5
FOLDS = 8
WORTH_IT = 0.97
"""A richer model must bring the held-out error down to this part of the simpler one's."""


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """A lens and how well it is known.

    Attributes
    ----------
    lens : Lens
    std : dict of str to float
        Standard uncertainty of each parameter, by its name in `Lens`.
    prior : LensPrior
        The same as what a clip's calibration starts from: correlations kept.
    held_out_rms_px : float
        Reprojection error in views that took no part in the fit: the views are dealt into 8 parts,
        lens and board are fitted to all parts but one, and each view of that one is given the pose
        that suits it best; root mean square, over all corners of all used views, of the distance
        between projected and measured corner.
    rms_px : float
        Reprojection error in the views of the fit.
    used, dropped : tuple of str
        Names of the pictures used, and of those left out as outliers.
    coverage : float
        Share of the picture's area the corners cover.
    model : str
        What was fitted: the simplest model with about the lowest held-out error.
    warnings : tuple of str
    """

    lens: Lens
    std: dict[str, float]
    prior: LensPrior
    held_out_rms_px: float
    rms_px: float
    used: tuple[str, ...]
    dropped: tuple[str, ...]
    coverage: float
    model: str
    warnings: tuple[str, ...] = ()


def calibrate_lens(views: Sequence[BoardView | None]) -> LensCalibration:
    """Fit the lens to views of a board.

    Parameters
    ----------
    views : sequence of BoardView or None
        None for pictures in which no board was found.

    Returns
    -------
    LensCalibration

    Raises
    ------
    CalibrationError
        If there are too few views, or all are alike.
    """
    seen = [view for view in views if view is not None]
    if not seen:
        raise CalibrationError(
            f"the board was found in none of {len(views)} pictures",
            hint="Check the board's size: it counts inner corners, one less than squares.",
        )
    if len(seen) < LEAST_VIEWS:
        raise CalibrationError(
            f"the board was found in only {len(seen)} of {len(views)} pictures",
            hint=f"At least {LEAST_VIEWS} are needed, better 15, tilted in different directions; "
            "the board's size counts inner corners.",
        )
    if len({view.size for view in seen}) > 1:
        # Cameras that crop differ by a pixel or two between modes; the commonest size wins
        sizes = [view.size for view in seen]
        common = max(set(sizes), key=sizes.count)
        odd = [view for view in seen if max(abs(np.subtract(view.size, common))) > 2]
        if odd:
            raise CalibrationError(
                f"{odd[0].name} is {odd[0].size[0]}×{odd[0].size[1]} px, the others are not",
                hint="All pictures must come from one camera in one mode.",
            )
    fits, kept, dropped = _without_outliers(seen)
    spread = _tilt_spread(fits[-1].poses[:, :3])
    if spread < LEAST_TILT_SPREAD:
        raise CalibrationError(
            f"all views are alike: the board's tilt varies by only {np.degrees(spread):.1f} deg",
            hint="Tilt the board by 20 to 40 degrees, to all sides.",
        )
    fit, held_out = _chosen(fits, kept)
    lens = fit.to_lens(kept[0].size)
    # What the fit leaves over is not all noise: the covariance is for what predicts other views
    covariance = fit.covariance * max(1.0, 0.5 * held_out**2 / fit.noise_px**2)
    std = dict(zip(NAMES, np.sqrt(np.diag(covariance)).tolist(), strict=False))
    coverage = _coverage(kept)
    notes = [f"left out as outliers: {', '.join(view.name for view in dropped)}"] if dropped else []
    if coverage < LEAST_COVERAGE:
        notes.append(
            f"the board covers only {100 * coverage:.0f} % of the picture: "
            "distortion outside is extrapolated; hold the board into the corners too"
        )
    return LensCalibration(
        lens=lens,
        std=std,
        prior=prior_of(lens, covariance, np.concatenate([view.points_px for view in kept])),
        held_out_rms_px=held_out,
        rms_px=fit.rms_px,
        used=tuple(view.name for view in kept),
        dropped=tuple(view.name for view in dropped),
        coverage=coverage,
        model=fit.model.name,
        warnings=tuple(notes),
    )


def _without_outliers(
    views: list[BoardView],
) -> tuple[list[BoardFit], list[BoardView], list[BoardView]]:
    """Fits of all models to the views that agree, those views, and the ones left out.

    The richest model is the judge: a simpler one blames the views that reach farthest out.
    """
    kept, dropped = views, list[BoardView]()
    for _ in range(3):
        fits = _fits(kept)
        rms = fits[-1].view_rms_px
        bad = [v for v, value in zip(kept, rms, strict=True) if value > _outlier_limit(rms)]
        if not bad or len(kept) - len(bad) < LEAST_VIEWS:
            return fits, kept, dropped
        dropped += bad
        kept = [view for view in kept if view not in bad]
    return _fits(kept), kept, dropped


def _fits(views: Sequence[BoardView]) -> list[BoardFit]:
    fits: list[BoardFit] = []
    for model in MODELS:
        fits.append(fit_boards(views, model, fits[-1] if fits else None))
    return fits


def _chosen(fits: Sequence[BoardFit], views: Sequence[BoardView]) -> tuple[BoardFit, float]:
    """The simplest fit with about the lowest held-out error, and that error."""
    best: tuple[float, BoardFit] | None = None
    for fit in fits:
        error = _held_out(views, fit)
        if best is None or error < WORTH_IT * best[0]:
            best = (error, fit)
    assert best is not None
    return best[1], best[0]


def _outlier_limit(rms: FloatArray) -> float:
    middle = float(np.median(rms))
    spread = 1.4826 * float(np.median(np.abs(rms - middle)))
    return middle + OUTLIER_AT * max(spread, 0.05 * middle)


def _tilt_spread(turns: FloatArray) -> float:
    """Largest angle between the boards' normals, rad."""
    normals = np.array([rotation_matrix(turn)[:, 2] for turn in turns])
    return float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())


def _coverage(views: Sequence[BoardView]) -> float:
    """Share of 8 by 6 fields of the picture that hold a corner or lie within a board."""
    width, height = views[0].size
    covered = np.zeros((60, 80), dtype=np.uint8)
    for view in views:
        hull = cv2.convexHull((view.points_px * [80 / width, 60 / height]).astype(np.float32))
        cv2.fillConvexPoly(covered, np.round(hull).astype(np.int32), 1)
    return float(covered.mean())


def _held_out(views: Sequence[BoardView], whole: BoardFit) -> float:
    """Reprojection error of views not used in the fit, root mean square over all corners, px.

    The pose of a held-out view is its own; lens and board come from the others.
    """
    squares: list[float] = []
    folds = min(FOLDS, len(views) // 2)
    for fold in range(folds):
        training = [index for index in range(len(views)) if index % folds != fold]
        start = replace(whole, poses=whole.poses[training])
        fit = fit_boards([views[index] for index in training], whole.model, start)
        for index in range(fold, len(views), folds):
            error = held_out_errors(fit, views[index], whole.poses[index])
            squares += list((error**2).sum(axis=1))
    return float(np.sqrt(np.mean(squares)))
