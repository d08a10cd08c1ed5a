"""Lens from pictures of a chessboard or ChArUco board, and how good it is.

`lens.toml`: a lens written down, with its uncertainties; and the board to print.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.camera.board import Board, BoardView, find_board
from calib.camera.camera import Lens, rotation_matrix
from calib.camera.lens_fit import (
    FLOOR,
    MODELS,
    NAMES,
    BoardFit,
    LensPrior,
    fit_boards,
    held_out_errors,
    prior_of,
)
from calib.camera.lens_yaml import YAML_SUFFIXES, lens_yaml, read_lens_yaml
from metrology import (
    CalibrationError,
    SetupError,
    parse_toml,
    read_small_text,
    write_text_whole,
    written_whole,
)

__all__ = [
    "Board",
    "BoardView",
    "calibrate_lens",
    "find_board",
    "lens_toml",
    "prior_toml",
    "read_lens",
    "write_board",
    "write_lens",
]

FloatArray = NDArray[np.float64]

LEAST_VIEWS = 6
"""Views of the board: each gives two equations for the lens (Zhang 2000), which has ten unknowns
with its distortion; one more shows what is wrong."""

LEAST_TILT_SPREAD = np.radians(8.0)
"""rad: views square on tell focal length and distance by their ratio only (Zhang 2000); a tilt of
8° changes scale across a board, a fifth of its distance wide, by 3 %."""

LEAST_COVERAGE = 0.35
"""Share of the picture: distortion grows with the third power of the radius, and a third of the
area ends at 0.6 of the way to the corner, where k1 does a fifth of what it does there."""

OUTLIER_AT = 3.5
"""Robust standard deviations: one honest view in some thousands is farther off."""

FOLDS = 8
"""Parts for the held-out error, at most: an eighth of the views kept out leaves a lens fitted
nearly as well as with all."""

RICHER_ERROR_RATIO = 0.97

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
        if best is None or error < RICHER_ERROR_RATIO * best[0]:
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


A4_M = (0.297, 0.210)
"""m: the sheet, ISO 216."""


def lens_toml(calibration: LensCalibration) -> str:
    """Text of a lens file."""
    lens = calibration.lens
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {getattr(lens, name)!r}" for name in NAMES]
    lines += ["", "[std]"]
    lines += [f"{name} = {calibration.std.get(name, 0.0)!r}" for name in NAMES]
    lines += [
        "",
        "[prior]",
        "# what it all amounts to in log focal length, principal point x and y (px), k1 and k2",
        f"std = {calibration.prior.std.tolist()!r}",
        f"correlation = {np.round(calibration.prior.related, 9).tolist()!r}",
        "",
        "[quality]",
        f'model = "{calibration.model}"',
        f"held_out_rms_px = {calibration.held_out_rms_px!r}",
        f"views = {len(calibration.used)}",
        f"coverage = {calibration.coverage!r}",
    ]
    return "\n".join(lines) + "\n"


def write_lens(path: Path, calibration: LensCalibration) -> None:
    """Write a lens file, whole or not at all: YAML of OpenCV and ROS where its name says so."""
    if path.suffix.lower() in YAML_SUFFIXES:
        write_text_whole(path, lens_yaml(calibration.prior, path.stem))
    else:
        write_text_whole(path, lens_toml(calibration))


def prior_toml(prior: LensPrior) -> str:
    """Text of a lens file for a lens that was read from elsewhere."""
    lens = prior.lens
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {float(getattr(lens, name))!r}" for name in NAMES]
    lines += [
        "",
        "[prior]",
        "# log focal length, principal point x and y (px), k1 and k2",
        f"std = {prior.std.tolist()!r}",
        f"correlation = {np.round(prior.related, 9).tolist()!r}",
    ]
    return "\n".join(lines) + "\n"


def read_lens(path: Path, *, width: int | None = None, height: int | None = None) -> LensPrior:
    """Read a lens file (TOML, or YAML of OpenCV or ROS) for a picture of the given size.

    Parameters
    ----------
    path : Path
    width, height : int, optional
        Size of the clip's picture; the lens is scaled to it. The clip must show the whole picture.

    Raises
    ------
    SetupError
        If the file is missing or wrong, or its picture has another shape.
    """
    if path.suffix.lower() in YAML_SUFFIXES:
        return _for_picture(read_lens_yaml(path), width, height)
    text = read_small_text(
        path,
        what="the lens file",
        hint="Write one with `vision calibrate lens`.",
        error=SetupError,
    )
    table = parse_toml(text, f"the lens file {path}")
    numbers = table.get("lens", {})
    missing = [n for n in ("width", "height", *NAMES[:4]) if n not in numbers]
    if missing:
        raise SetupError(
            f"{path} lacks {', '.join(missing)} in its table [lens]",
            hint="Write it anew with `vision calibrate lens`.",
        )
    lens = Lens(
        int(numbers["width"]),
        int(numbers["height"]),
        *(float(numbers.get(name, 0.0)) for name in NAMES),
    )
    return _for_picture(_prior(lens, table, path), width, height)


def _for_picture(prior: LensPrior, width: int | None, height: int | None) -> LensPrior:
    """The lens scaled to a picture of the same shape."""
    lens = prior.lens
    if width is None or height is None:
        return prior
    if abs(width / height - lens.width / lens.height) > 0.01 * width / height:
        raise SetupError(
            f"the lens was calibrated at {lens.width}×{lens.height} px, the clip has "
            f"{width}×{height}: another shape",
            hint="Calibrate in the mode the clip is filmed in: other modes crop the sensor.",
        )
    return prior.resized(width, height)


def _prior(lens: Lens, table: dict[str, Any], path: Path) -> LensPrior:
    """Uncertainty as the file has it: with correlations, or of each parameter by itself."""
    given = table.get("prior", {})
    if "std" in given and "correlation" in given:
        std, related = (np.asarray(given[key], dtype=float) for key in ("std", "correlation"))
        if std.shape != (5,) or related.shape != (5, 5):
            raise SetupError(
                f"the table [prior] of {path} needs 5 and 5 × 5 numbers",
                hint="Write it anew with `vision calibrate lens`.",
            )
        return LensPrior(lens, np.maximum(std, FLOOR), related)
    own = {name: float(table.get("std", {}).get(name, 0.0)) for name in NAMES}
    spread = [own["fx"] / lens.fx, own["cx"], own["cy"], own["k1"], own["k2"]]
    return LensPrior(lens, np.maximum(np.array(spread), FLOOR))


def write_board(path: Path, board: Board) -> None:
    """Write a board to print at 100 % on A4 paper, as PDF.

    Raises
    ------
    SetupError
        If the board does not fit the paper.
    """
    size = np.array([board.columns + 1, board.rows + 1]) * board.square_m
    if np.any(size > np.array(A4_M) - 0.01):
        raise SetupError(
            f"a board of {1e3 * size[0]:.0f} × {1e3 * size[1]:.0f} mm does not fit A4 paper",
            hint="Choose fewer or smaller squares.",
        )
    cells = (board.columns + 1, board.rows + 1)
    pixels = (cells[0] * 96, cells[1] * 96)
    if board.charuco:
        picture = np.asarray(board.opencv().generateImage(pixels))
    else:
        parity = np.add.outer(np.arange(cells[1]), np.arange(cells[0])) % 2
        small = (255 * parity).astype(np.uint8)
        picture = np.asarray(cv2.resize(small, pixels, interpolation=cv2.INTER_NEAREST))
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.hashsalt": "board"}):
        figure = Figure(figsize=(A4_M[0] / 0.0254, A4_M[1] / 0.0254))
        left, bottom = (np.array(A4_M) - size) / 2.0 / A4_M
        axes = figure.add_axes((left, bottom, size[0] / A4_M[0], size[1] / A4_M[1]))
        axes.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest", aspect="auto")
        axes.set_axis_off()
        note = f"print at 100 %; each square {1e3 * board.square_m:g} mm; measure it before use"
        figure.text(0.5, 0.015, note, ha="center", fontsize=7)
        with written_whole(path) as temporary:
            figure.savefig(temporary, format="pdf")
