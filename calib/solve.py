"""Fit camera, lens and ball plane to the wall grid and further evidence.

Seen perpendicularly, a grid determines only the ratio of focal length and distance, the scale of
the wall. A broad prior on the focal length keeps the fit finite, and the covariance describes the
correlation; measured distances, ball diameter or free fall then constrain their combinations. If no
distance is measured by hand, a free fall enters the fit: gravity gives the scale.

The module also detects a moved camera (`camera_movement`), and predicts noise and grid of a planned
camera. An edge located by least squares attains the Cramér–Rao bound: noise over contrast, smaller
for a longer and sharper edge. Tracking adds errors of other origin (shading, pattern, shadows,
compression), which on recordings with known truth, ray-traced and real, are about 0.05 px for a
ball and 0.15 px for a pendulum's mass, independent of size.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.calibration import (
    PARAMETERS,
    BallOutlines,
    Calibration,
    DepthEstimate,
    Evidence,
    FreeFall,
    Known,
    Source,
    plausible,
)
from calib.camera import Camera, Lens
from calib.grid import GridMap, WallGrid
from calib.lens import LensPrior
from metrology import CalibrationError, UncertaintySource
from metrology.least_squares import Downhill, descend

__all__ = [
    "BOARD_LENS_STD",
    "LensPrior",
    "PictureNoise",
    "SeenFall",
    "Solved",
    "board_lens",
    "calibrate",
    "camera_movement",
    "edge_std",
    "lens_of_view",
    "planned_grid",
    "solve",
]

FloatArray = NDArray[np.float64]

Residuals = Callable[[Calibration], FloatArray]
"""Whitened residuals (n,) of a calibration, or (K, n) of a stack of them."""

FOCAL_OVER_WIDTH, LOG_FOCAL_STD = 1.25, 0.5
"""Focal length of an unknown lens over picture width, and std of its logarithm (chosen: 24° to 100°
angle of view)."""

PRINCIPAL_POINT_STD = 0.01
"""Std of the principal point of an unknown lens, fraction of the width (chosen: a few tens of
pixels of a few thousand)."""

K1_STD, K2_STD = 0.3, 0.1
"""Std of the distortion of an unknown lens, 1 (chosen: from a fish-eye, -0.3, to a telephoto,
0)."""

RELATIVE_DEPTH, RELATIVE_DEPTH_STD = 0.1, 0.1
"""Prior of ball plane offset over camera distance, and its std (chosen: half a metre of four to
five, with zero and twice that within one std)."""

DEPTH_SOURCES = {
    UncertaintySource.BALL_PLANE_OFFSET: ("ball_plane_offset",),
    UncertaintySource.BALL_DIAMETER: ("outlines",),
    UncertaintySource.FREE_FALL: ("fall",),
}

INTRINSICS = ("log_focal", "principal_x", "principal_y", "k1", "k2")

UNTESTED_SOURCES = (
    UncertaintySource.GRID_LINES,
    UncertaintySource.LENS_UNKNOWN,
    UncertaintySource.LENS_CALIBRATION,
    UncertaintySource.BALL_PLANE_GUESS,
)

INPUT_OUTLIER_SIGMAS = 3.5
"""Residual of an input, standard deviations (derived: exceeded by one correct input in 2000)."""

MIN_SUSPECT_CHI2_GAIN = 2.0 * math.log(20.0)
"""Difference of chi² between suspected inputs (chosen: odds of twenty)."""

_CAMERA_PARAMETERS = 10
"""Camera parameters determined by the grid's crossings (derived: 6 pose, focal length, principal
point x and y, distortion)."""

_MIN_UNCHANGED_WEIGHT = 0.8
"""Weight of the crossings below which the fit is repeated (chosen): above, the position changes by
less than a tenth of its uncertainty, and scaling the covariance suffices."""

_PATCHES_ACROSS = 6
"""Patches along the picture's longer side within which errors correlate (chosen: the size of a
ball, a mass or a person)."""

_MIN_PATCHES, _MIN_PATCH_CROSSINGS = 6, 2.0
"""Minimum number of patches, and of crossings per patch, to estimate their correlation (chosen)."""

MAX_GRID_CHI2 = 10.0
"""Chi² per degree of freedom (chosen): crossings whose covariance matches a smooth map and that
miss a camera by three times that have wrong labels."""

MAX_SCENE_STEPS = 40
"""Maximum number of Gauss-Newton steps (chosen): no convergence by then means contradicting
inputs."""

DIFFERENCE_STEPS: FloatArray = np.array(
    [1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-4, 1e-2, 1e-2, 1e-4, 1e-4, 1e-4, 1e-4]
)
"""Steps of finite differences in the parameters' units (rad, m, log, px, log) (chosen: a hundredth
of a calibration's uncertainty, far above rounding)."""

FALL_POINTS = 24
"""Maximum number of averaged positions of a fall (derived: runs so short change the acceleration to
fourth order only)."""

SIZE_POINTS, SIZE_CORRELATION_LENGTH, SIZE_UNCORRELATED_FRACTION = 15, 0.2, 0.1
"""Number of radii used along the path; correlation length of their errors, fraction of the path;
and uncorrelated fraction of their variance (chosen)."""


def calibrate(
    grid: WallGrid, evidence: Evidence | None = None, *, lens: LensPrior | None = None
) -> Calibration:
    """Fit camera, lens and ball plane.

    Parameters
    ----------
    grid : WallGrid
        The measured grid.
    evidence : Evidence, optional
        Measured distances, ball, free fall.
    lens : LensPrior, optional
        Lens known beforehand; without it the lens comes from the grid's straight lines.

    Raises
    ------
    CalibrationError
        If no camera fits the grid.
    """
    evidence = evidence or Evidence()
    start = _start(grid, evidence, lens)
    blocks = _blocks(grid, evidence, lens)
    present = [n for n, keys in DEPTH_SOURCES.items() if getattr(evidence, keys[0]) is not None]
    found, contradictions = _reconciled(grid, start, blocks, present)
    fitted, sources, chi2, weight = found.fitted, found.sources, found.chi2, found.weight
    if grid.line_share.any():
        rows = _jacobian(found.blocks[UncertaintySource.GRID_LINES], fitted)
        covariance = np.sum([s.covariance for s in sources], axis=0)
        together = Source(
            UncertaintySource.GRID_LINES, covariance @ _line_information(grid, rows) @ covariance
        )
        sources = tuple(together if s.name is UncertaintySource.GRID_LINES else s for s in sources)
    if not np.isfinite(chi2) or chi2 > MAX_GRID_CHI2:
        raise CalibrationError(
            f"no camera fits the grid's lines (chi² {chi2:.0f} per degree of freedom)",
            hint="Check that the wall is flat. For a strongly distorting lens pass a lens.toml.",
        )
    estimates = _depths(found, present)
    known = any(name in found.blocks for name in present)
    if weight.min() >= _MIN_UNCHANGED_WEIGHT:
        widened = 1.0 / float(weight.min()) ** 2
        sources = tuple(
            Source(
                s.name,
                s.covariance * (widened if s.name is UncertaintySource.GRID_LINES else 1.0),
            )
            for s in sources
        )
    return Calibration(
        lens=fitted.grid_camera.lens,
        orientation=fitted.grid_camera.rotation,
        vector=np.where(np.char.startswith(PARAMETERS, "turn"), 0.0, fitted.vector),
        sources=sources,
        rest_px=fitted.rest_px,
        rest_xy=fitted.rest_xy,
        ball_radius=fitted.ball_radius,
        depth_estimates=estimates,
        depth_known=known,
        chi2_per_dof=chi2,
        warnings=grid.warnings + contradictions,
    )


@dataclass(frozen=True, eq=False)
class _ReweightedFit:
    """A fit with crossings weighted for their correlation.

    Attributes
    ----------
    blocks : dict of UncertaintySource to callable
        As weighted.
    chi2 : float
        Of the grid's crossings, per degree of freedom, before weighting.
    weight : (n,) array
        Weights of their residuals.
    """

    fitted: Calibration
    sources: tuple[Source, ...]
    blocks: dict[UncertaintySource, Residuals]
    chi2: float
    weight: FloatArray


def _reweighted_fit(
    grid: WallGrid, start: Calibration, blocks: dict[UncertaintySource, Residuals]
) -> _ReweightedFit:
    fitted, sources = _fit(start, blocks)
    every = blocks[UncertaintySource.GRID_LINES]
    nodes = every(fitted)
    chi2 = float(nodes @ nodes / max(len(nodes) - _CAMERA_PARAMETERS, 1))
    weight = _patch_weights(grid, nodes.reshape(-1, 2))
    if weight.min() < _MIN_UNCHANGED_WEIGHT:
        # With a lower weight of the lines, the other inputs gain influence: fit again.
        blocks = blocks | {UncertaintySource.GRID_LINES: lambda c: every(c) * weight}
        fitted, sources = _fit(start, blocks)
    return _ReweightedFit(fitted, sources, blocks, chi2, weight)


def _depths(found: _ReweightedFit, present: list[UncertaintySource]) -> tuple[DepthEstimate, ...]:
    return tuple(
        _depth_from_one_input(name, found.fitted, found.blocks)
        for name in present
        if name in found.blocks
    )


def _reconciled(
    grid: WallGrid,
    start: Calibration,
    blocks: dict[UncertaintySource, Residuals],
    present: list[UncertaintySource],
) -> tuple[_ReweightedFit, tuple[str, ...]]:
    """Fit without the inputs that contradict the others, and warnings about them."""
    found = _reweighted_fit(grid, start, blocks)
    told: list[str] = []
    while suspects := _suspects(found.fitted, found.blocks):
        told.append(_disagreement(tuple(suspects), _depths(found, present)))
        if len(suspects) > 1:
            doubtful = _widened(found.blocks, suspects)
            fitted, sources = _fit(found.fitted, doubtful)
            return replace(found, fitted=fitted, sources=sources, blocks=doubtful), tuple(told)
        # Start from the beginning: the wrong input also distorted the weights of the lines.
        blocks = {name: block for name, block in blocks.items() if name not in suspects}
        found = _reweighted_fit(grid, start, blocks)
    return found, tuple(told)


def _start(grid: WallGrid, evidence: Evidence, lens: LensPrior | None) -> Calibration:
    width, height = grid.size
    guess = lens.lens if lens else Lens.centred(width, height, FOCAL_OVER_WIDTH * width)
    wall = np.c_[grid.wall_m, np.zeros(len(grid.nodes))]
    best: tuple[float, FloatArray, FloatArray] | None = None
    _, turns, shifts, errors = cv2.solvePnPGeneric(
        wall, grid.points_px, guess.matrix, guess.coefficients, flags=cv2.SOLVEPNP_IPPE
    )
    for turn, shift, error in zip(turns, shifts, errors, strict=True):
        rotation = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)
        position = -rotation.T @ np.asarray(shift, dtype=np.float64).ravel()
        if position[2] > 0.0 and (best is None or float(error[0]) < best[0]):
            best = (float(error[0]), rotation, position)
    if best is None:
        raise CalibrationError(
            "the grid appears mirrored",
            hint="Un-mirror the clip, or film the wall directly.",
        )
    x, y, distance = best[2]
    depth = (
        evidence.ball_plane_offset.value
        if evidence.ball_plane_offset
        else RELATIVE_DEPTH * distance
    )
    values = [x, y, np.log(distance), np.log(guess.fx), guess.cx, guess.cy, guess.k1, guess.k2]
    return Calibration(
        lens=guess,
        orientation=best[1],
        vector=np.array([0.0, 0.0, 0.0, *values, depth, 0.0]),
        sources=(),
        rest_px=evidence.rest_px,
        rest_xy=np.array([0.0, evidence.rest_height]),
        ball_radius=evidence.ball_radius,
    )


def _blocks(
    grid: WallGrid, evidence: Evidence, lens: LensPrior | None
) -> dict[UncertaintySource, Residuals]:
    """Whitened residuals by source; each source is independent of the others."""
    wall = np.c_[grid.wall_m, np.zeros(len(grid.nodes))]
    whitened = _whitening(grid)

    def nodes(c: Calibration) -> FloatArray:
        true = np.exp(c.parameters.log_pitch)[..., np.newaxis, np.newaxis] * wall
        error = whitened(c.grid_camera.project(true) - grid.points_px)
        return np.asarray(np.nan_to_num(error.reshape(*error.shape[:-2], -1), nan=1e3))

    blocks: dict[UncertaintySource, Residuals] = {UncertaintySource.GRID_LINES: nodes}
    if lens is None:
        width, height = grid.size
        centre = [np.log(FOCAL_OVER_WIDTH * width), (width - 1) / 2, (height - 1) / 2, 0.0, 0.0]
        spread = [
            LOG_FOCAL_STD,
            PRINCIPAL_POINT_STD * width,
            PRINCIPAL_POINT_STD * width,
            K1_STD,
            K2_STD,
        ]
        name, known_to = UncertaintySource.LENS_UNKNOWN, np.diag(1.0 / np.array(spread))
    else:
        known = lens.lens
        centre = [np.log(known.fx), known.cx, known.cy, known.k1, known.k2]
        name, known_to = (
            UncertaintySource.LENS_CALIBRATION,
            np.linalg.inv(np.linalg.cholesky(lens.covariance)),
        )
    pitch_std = evidence.pitch_relative_std
    blocks[UncertaintySource.GRID_PITCH] = lambda c: _one(c.parameters.log_pitch / pitch_std)
    intrinsics = [PARAMETERS.index(n) for n in INTRINSICS]
    blocks[name] = lambda c: (c.vector[..., intrinsics] - np.array(centre)) @ known_to.T
    _add_distances(blocks, evidence)
    _add_ball(blocks, evidence)

    def share(c: Calibration) -> FloatArray:
        p = c.parameters
        return _one(
            (p.ball_plane_offset / np.exp(p.log_distance) - RELATIVE_DEPTH) / RELATIVE_DEPTH_STD
        )

    blocks[UncertaintySource.BALL_PLANE_GUESS] = share
    return blocks


def _one(residual: ArrayLike) -> FloatArray:
    """A single residual, or that of each element of a stack, as a block of one."""
    return np.asarray(residual, dtype=np.float64)[..., np.newaxis]


def _whitening(grid: WallGrid) -> Callable[[FloatArray], FloatArray]:
    """Function that whitens errors (N, 2), px, of the crossings."""
    if not grid.line_share.any():
        root = np.linalg.inv(np.linalg.cholesky(grid.covariance_px2))
        return lambda error: _transformed(root, error)
    across = grid.map.jacobian(grid.points_px)
    std = np.sqrt(np.einsum("nfi,nij,nfj->nf", across, grid.covariance_px2, across))
    return lambda error: np.asarray(_transformed(across, error) / std)


def _transformed(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Matrices (N, 2, 2) times vectors (..., N, 2): a fifth of the time of `numpy.einsum`."""
    x, y = vectors[..., 0], vectors[..., 1]
    rows = [matrices[:, row, 0] * x + matrices[:, row, 1] * y for row in range(2)]
    return np.stack(rows, axis=-1)


def _patch_weights(grid: WallGrid, error: FloatArray) -> FloatArray:
    """Weights (2 N,) of the crossings' whitened errors (N, 2), reduced where patches agree.

    An object in front of the wall, its shadow, or a poster displaces all crossings near it alike,
    so that many of them contain the information of a few. Their correlation is the intraclass
    correlation from an analysis of variance. The weights are divided by the root of the design
    effect (Kish 1965), and by that of chi² per degree of freedom where it exceeds 1.
    """
    spare = max(error.size - _CAMERA_PARAMETERS, 1)
    scatter = max(1.0, float((error**2).sum()) / spare)
    place = np.floor(grid.points_px * (_PATCHES_ACROSS / max(grid.size))).astype(np.int64)
    _, patch, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    patch = patch.ravel()
    weight = np.full_like(error, 1.0 / np.sqrt(scatter))
    patches, each = len(count), len(error) / len(count)
    if patches < _MIN_PATCHES or each < _MIN_PATCH_CROSSINGS:
        return weight.ravel()
    for column in range(2):
        off = error[:, column]
        if grid.line_share[column] > 0.0:
            # Errors common to a line are treated separately.
            line, many = np.unique(grid.nodes[:, column], return_inverse=True, return_counts=True)[
                1:
            ]
            off = off - (np.bincount(line, off) / many)[line]
        mean = np.bincount(patch, off) / count
        between = float(count @ (mean - off.mean()) ** 2) / (patches - 1)
        within = float(((off - mean[patch]) ** 2).sum()) / (len(off) - patches)
        if between > (1.0 + 2.0 * np.sqrt(2.0 / (patches - 1))) * within:
            share = (between - within) / (between - within + each * within)
            alike = float(count @ count) / len(off)
            weight[:, column] /= np.sqrt(1.0 + share * (alike - 1.0))
    return weight.ravel()


def _line_information(grid: WallGrid, rows: FloatArray) -> FloatArray:
    """Information (P, P) of the parameters from correlated errors along lines.

    The weights remain those of independent errors: the common error of a line may drift from line
    to line, and weights based on its randomness would follow the drift.
    """
    per_family = rows.reshape(-1, 2, rows.shape[1])
    spread = rows.T @ rows
    for f, share in enumerate(grid.line_share):
        own = per_family[:, f]
        line = np.unique(grid.nodes[:, f], return_inverse=True)[1]
        summed = np.zeros((line.max() + 1, rows.shape[1]))
        np.add.at(summed, line, own)
        spread += share * (summed.T @ summed - own.T @ own)
    return np.asarray(spread)


def _add_distances(blocks: dict[UncertaintySource, Residuals], evidence: Evidence) -> None:
    def add(
        name: UncertaintySource, known: Known | None, value: Callable[[Calibration], FloatArray]
    ) -> None:
        if known is not None:
            blocks[name] = lambda c: _one((value(c) - known.value) / known.std)

    def place(axis: int) -> Callable[[Calibration], FloatArray]:
        return lambda c: _of_each(c, c.camera.position)[..., axis]

    def foot(axis: int) -> Callable[[Calibration], FloatArray]:
        return lambda c: _of_each(c, c.camera.axis_foot)[..., axis]

    add(UncertaintySource.CAMERA_DISTANCE, evidence.camera_distance, lambda c: _distance(c))
    add(UncertaintySource.CAMERA_X, evidence.camera_x, place(0))
    add(UncertaintySource.CAMERA_Y, evidence.camera_y, place(1))
    add(UncertaintySource.AXIS_FOOT_X, evidence.axis_foot_x, foot(0))
    add(UncertaintySource.AXIS_FOOT_Y, evidence.axis_foot_y, foot(1))
    add(
        UncertaintySource.BALL_PLANE_OFFSET,
        evidence.ball_plane_offset,
        lambda c: c.parameters.ball_plane_offset,
    )


def _of_each(c: Calibration, points: FloatArray) -> FloatArray:
    """The one point of a calibration (D,), or of each of a stack (K, D) out of (K, 1, D)."""
    return points if c.vector.ndim == 1 else points[:, 0]


def _distance(c: Calibration) -> FloatArray:
    return np.asarray(np.exp(c.parameters.log_distance))


def _add_ball(blocks: dict[UncertaintySource, Residuals], evidence: Evidence) -> None:
    outlines, fall = evidence.outlines, evidence.fall
    if outlines is not None:
        radius = 0.5 * outlines.diameter.value
        chosen = np.unique(np.linspace(0, len(outlines.std_px) - 1, SIZE_POINTS).astype(int))
        whitening = _size_whitening(outlines, chosen)

        def size(c: Calibration) -> FloatArray:
            seen = c.outline_radius(outlines.centre_px[chosen], radius)
            return np.asarray((seen - outlines.radius_px[chosen]) @ whitening.T)

        blocks[UncertaintySource.BALL_DIAMETER] = size
    if fall is not None:
        blocks[UncertaintySource.FREE_FALL] = lambda c: _one(_fall_residuals(c, fall))


def _size_whitening(outlines: BallOutlines, chosen: NDArray[np.intp]) -> FloatArray:
    """Matrix (n, n) that whitens errors of selected outline radii.

    The bias of an outline has a constant part and one that changes along the path, as slowly as the
    ball rotates and the background changes; each is as large as the common uncertainty.
    """
    relative = outlines.diameter.std / outlines.diameter.value
    size = relative * np.median(outlines.radius_px)
    place = np.linspace(0.0, 1.0, len(chosen))
    alike = np.exp(-0.5 * ((place - place[:, np.newaxis]) / SIZE_CORRELATION_LENGTH) ** 2)
    share = len(outlines.std_px) / len(chosen)
    covariance = np.diag(outlines.std_px[chosen] ** 2 / share) + size**2
    covariance += outlines.common_std_px**2 * (
        1.0 + alike + SIZE_UNCORRELATED_FRACTION * np.eye(len(chosen))
    )
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _fall_residuals(c: Calibration, fall: FreeFall) -> FloatArray:
    # Means over short runs change the acceleration only to fourth order.
    runs = np.array_split(np.arange(len(fall.time_s)), min(FALL_POINTS, len(fall.time_s)))
    time = np.array([fall.time_s[run].mean() for run in runs])
    time -= time.mean()
    px = np.array([fall.centre_px[run].mean(axis=0) for run in runs])
    y = c.position(px)[0][..., 1]
    noise = np.array([np.sqrt((fall.std_px[run] ** 2).mean() / len(run)) for run in runs])
    # The weights depend on the noise alone: the scale is the same for all runs.
    design = np.stack([np.ones_like(time), time, -0.5 * time**2], axis=1) / noise[:, np.newaxis]
    normal = np.linalg.inv(design.T @ design)
    acceleration = (y / noise) @ (design @ normal[2])
    p = c.parameters
    scale = (np.exp(p.log_distance) - p.ball_plane_offset) / np.exp(p.log_focal)
    spread = np.hypot(np.sqrt(normal[2, 2]) * scale, fall.acceleration.std)
    return np.asarray((acceleration - fall.acceleration.value) / spread)


def _fit(
    start: Calibration, blocks: dict[UncertaintySource, Residuals]
) -> tuple[Calibration, tuple[Source, ...]]:
    """The best fit, and the contribution of each block to its covariance."""

    def residuals(c: Calibration) -> FloatArray:
        return np.concatenate([block(c) for block in blocks.values()], axis=-1)

    def looking(c: Calibration) -> Downhill[FloatArray]:
        value, jacobian = residuals(c), _jacobian(residuals, c)
        normal = jacobian.T @ jacobian
        step = np.asarray(-np.linalg.solve(normal, jacobian.T @ value), dtype=np.float64)
        return Downhill(float(value @ value), step, float(step @ normal @ step))

    current = descend(
        start,
        looking,
        lambda c, step, share: c.with_parameters(c.vector + share * step),
        lambda c, _: float((value := residuals(c)) @ value),
        # Remaining gain in chi², compared with 1.
        settled=lambda seen, _: seen.gain < 1e-6,
        most_steps=MAX_SCENE_STEPS,
    )
    jacobian = _jacobian(residuals, current)
    scaled = jacobian * DIFFERENCE_STEPS
    covariance = (
        DIFFERENCE_STEPS[:, np.newaxis] * np.linalg.inv(scaled.T @ scaled) * DIFFERENCE_STEPS
    )
    sources, at = [], 0
    for name, block in blocks.items():
        length = len(block(current))
        rows = jacobian[at : at + length]
        at += length
        sources.append(Source(name, covariance @ (rows.T @ rows) @ covariance))
    return current, tuple(sources)


def _jacobian(residuals: Residuals, at: Calibration) -> FloatArray:
    """Central differences for all parameters, from one stack of calibrations."""
    moved = np.diag(DIFFERENCE_STEPS)
    stack = at.with_parameters(np.concatenate([at.vector + moved, at.vector - moved]))
    ahead, behind = np.split(residuals(stack), 2)
    return np.asarray((ahead - behind).T / (2.0 * DIFFERENCE_STEPS))


def _depth_from_one_input(
    name: UncertaintySource, fitted: Calibration, blocks: dict[UncertaintySource, Residuals]
) -> DepthEstimate:
    """Ball plane offset from only one of the inputs that determine it."""
    kept = {n: block for n, block in blocks.items() if n is name or n not in DEPTH_SOURCES}
    alone, sources = _fit(fitted, kept)
    depth = PARAMETERS.index("ball_plane_offset")
    variance = sum(float(s.covariance[depth, depth]) for s in sources)
    return DepthEstimate(name, alone.ball_plane_offset, float(np.sqrt(variance)))


def _total(c: Calibration, blocks: dict[UncertaintySource, Residuals]) -> float:
    return float(sum(float(np.sum(block(c) ** 2)) for block in blocks.values()))


def _suspects(
    fitted: Calibration, blocks: dict[UncertaintySource, Residuals]
) -> dict[UncertaintySource, float]:
    """Inputs that may be wrong, with the chi² each removal saves; none where all agree."""
    inputs = [name for name in blocks if name not in UNTESTED_SOURCES]
    spare = {name: len(blocks[name](fitted)) - 1 for name in inputs}
    strain = sum(float(np.sum(blocks[name](fitted) ** 2)) - spare[name] for name in inputs)
    if len(inputs) < 2 or strain < INPUT_OUTLIER_SIGMAS**2 / 2.0:
        return {}
    whole = _total(fitted, blocks)
    relief = {}
    for name in inputs:
        kept = {other: block for other, block in blocks.items() if other is not name}
        relief[name] = whole - _total(_fit(fitted, kept)[0], kept) - spare[name]
    most = max(relief.values())
    if most < INPUT_OUTLIER_SIGMAS**2:
        return {}
    likely = sorted(relief, key=lambda name: relief[name], reverse=True)
    return {name: relief[name] for name in likely if relief[name] > most - MIN_SUSPECT_CHI2_GAIN}


def _widened(
    blocks: dict[UncertaintySource, Residuals], suspects: dict[UncertaintySource, float]
) -> dict[UncertaintySource, Residuals]:
    """Scale the uncertainty of each suspected input to its residual."""

    def less(block: Residuals, share: float) -> Residuals:
        return lambda c: block(c) * share

    return {
        name: less(block, 1.0 / math.sqrt(suspects[name])) if name in suspects else block
        for name, block in blocks.items()
    }


def _disagreement(
    suspects: tuple[UncertaintySource, ...], estimates: tuple[DepthEstimate, ...]
) -> str:
    """Message that inputs contradict each other, the suspected one, and the consequence."""
    told = [f"{1e3 * e.value:.0f} ± {1e3 * e.std:.0f} mm by {e.source}" for e in estimates]
    listed = f" (distance of the ball plane from the wall: {', '.join(told)})" if told else ""
    if len(suspects) == 1:
        likeliest = f"most probably wrong is {suspects[0]}; it is not used"
    else:
        likeliest = f"one of these is wrong: {', '.join(suspects)}; their weights are reduced"
    return f"the inputs contradict each other{listed}; {likeliest}"


@dataclass(frozen=True)
class Movement:
    """Movement of the wall's crossings in the picture between two recordings.

    Attributes
    ----------
    px : float
        Root mean square movement, px.
    std : float
        Its expectation from noise alone, px.
    moved : bool
        Whether it is significant and larger than a tenth of a px.
    """

    px: float
    std: float
    moved: bool

    def __str__(self) -> str:
        if not self.moved:
            return f"the camera has not moved ({self.px:.2f} px)"
        return f"the camera moved by {self.px:.1f} px"


def camera_movement(old: WallGrid, new: WallGrid) -> Movement:
    """Compare two pictures of the same wall by the same camera.

    The grid repeats, so the movement is known only modulo a pitch.

    Raises
    ------
    CalibrationError
        If the pictures differ in size.
    """
    if old.size != new.size:
        raise CalibrationError(
            f"the old picture has {old.size[0]}×{old.size[1]} px, the new one "
            f"{new.size[0]}×{new.size[1]}",
            hint="Film in the mode the calibration was made in.",
        )
    columns, rows = (np.linspace(0.1, 0.9, 9) * (length - 1) for length in old.size)
    px = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    wall = new.map(px) - old.map(px)
    wall -= np.round(np.median(wall, axis=0))
    step = np.linalg.solve(new.map.jacobian(px), wall[..., np.newaxis])[..., 0]
    length = float(np.sqrt((step**2).sum(axis=-1).mean()))
    # A map has ten parameters, fitted to two coordinates of each crossing.
    noise = 0.0
    for grid in (old, new):
        variance = float(np.median(np.trace(grid.covariance_px2, axis1=1, axis2=2)))
        noise += variance * 5.0 / len(grid.nodes)
    std = float(np.sqrt(noise))
    return Movement(length, std, length > max(4.0 * std, 0.1))


MAX_FALL_DISAGREEMENT = 3.0
"""Disagreement of a fall, standard deviations (derived: exceeded by one correct fall in 370)."""

PATH_POINTS = 9
"""Positions on the trajectory that represents the flight (chosen: a parabola needs three)."""

PATH_STD_PX = 1e-4
"""Std of these positions, px (chosen: negligible; the fall's own uncertainty has the noise)."""


@dataclass(frozen=True, eq=False)
class SeenFall:
    """Acceleration of a flight in a calibrated scene, and its expected value.

    Attributes
    ----------
    apparent : Known
        Acceleration by this calibration, drag subtracted, m/s²; its standard uncertainty contains
        the noise of the track and twice the relative uncertainty of the capture rate, not that of
        the calibration.
    gravity : float
        Local gravity, m/s².
    px : (N, 2) array or None
        Positions of the flight in the picture; None for the middle of the picture.
    """

    apparent: Known
    gravity: float
    px: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Solved:
    """A calibrated scene and its inputs.

    Attributes
    ----------
    evidence : Evidence
        Without a fall used in addition.
    contradiction : str or None
        Message if a fall contradicts everything else; the fall is not used then.
    """

    calibration: Calibration
    grid: WallGrid
    evidence: Evidence
    lens: LensPrior | None = None
    contradiction: str | None = None

    def weighing(self, fall: SeenFall) -> "Solved":
        """Repeat the fit with a fall, as measured by this calibration, as further input.

        Raises
        ------
        CalibrationError
            If the acceleration of the fall is not positive, or it puts the ball behind the wall.
        """
        value, std = fall.apparent.value, fall.apparent.std
        if not (value > 0.0 and std > 0.0 and fall.gravity > 0.0):
            raise CalibrationError(
                f"a free fall of {value:.3g} ± {std:.2g} m/s² gives no scale",
                hint="Track more of the flight, or do not use the free fall.",
            )
        before = self.calibration
        time, path = _fall_path(before, fall)
        told = FreeFall(path, time, np.full(len(time), PATH_STD_PX), Known(fall.gravity, std))

        def log_acceleration(c: Calibration) -> float:
            y = c.position(path)[0][:, 1]
            return math.log(-2.0 * float(np.polyfit(time, y, 2)[0]))

        slope = before.gradient(log_acceleration)
        prior = float(slope @ before.covariance @ slope)
        wanted = math.log(fall.gravity / value)
        if abs(wanted) >= MAX_FALL_DISAGREEMENT * math.hypot(
            math.sqrt(max(prior, 0.0)), std / value
        ):
            return replace(self, contradiction=_contradiction(before, slope, wanted, fall))
        evidence = replace(self.evidence, fall=told)
        return replace(self, calibration=_fitted(self.grid, evidence, self.lens))


def solve(
    grid: WallGrid,
    evidence: Evidence | None = None,
    *,
    lens: LensPrior | None = None,
    see_fall: Callable[[Calibration], SeenFall | None] | None = None,
) -> Solved:
    """Calibrate a scene from all its inputs.

    Parameters
    ----------
    grid : WallGrid
        The measured grid.
    evidence : Evidence, optional
        Measured distances, ball, free fall.
    lens : LensPrior, optional
        Lens known beforehand; without it the lens comes from the grid's straight lines.
    see_fall : callable, optional
        Returns the fall measured by a calibration, or None; called if no measured distance gives
        the scale.

    Raises
    ------
    CalibrationError
        If no camera fits the grid.
    ContradictionError
        If the ball plane would be behind the wall or behind the camera.
    """
    evidence = evidence or Evidence()
    solved = Solved(_fitted(grid, evidence, lens), grid, evidence, lens)
    if see_fall is None or evidence.taped:
        return solved
    fall = see_fall(solved.calibration)
    return solved if fall is None else solved.weighing(fall)


def _fitted(grid: WallGrid, evidence: Evidence, lens: LensPrior | None) -> Calibration:
    try:
        return plausible(calibrate(grid, evidence, lens=lens))
    except np.linalg.LinAlgError as problem:
        raise CalibrationError(
            "no camera can be fitted: the crossings of the grid lie in one line",
            hint="Show more of the wall.",
        ) from problem


def _fall_path(calibration: Calibration, fall: SeenFall) -> tuple[FloatArray, FloatArray]:
    """Trajectory with the given acceleration in the flight's region: times and outline centres."""
    gravity, px = fall.apparent.value, fall.px
    width, height = calibration.lens.width, calibration.lens.height
    if px is None:
        px = np.array([[0.5 * width, 0.35 * height], [0.5 * width, 0.65 * height]])
    seen = calibration.position(px)[0]
    low, high = seen.min(axis=0), seen.max(axis=0)
    reach = math.sqrt(2.0 * (high[1] - low[1]) / gravity)
    time = np.linspace(-reach, reach, PATH_POINTS)
    centre = np.stack(
        [
            0.5 * (low[0] + high[0]) + 0.5 * (high[0] - low[0]) * time / reach,
            high[1] - 0.5 * gravity * time**2,
            np.full(PATH_POINTS, calibration.ball_plane_offset),
        ],
        axis=-1,
    )
    if calibration.ball_radius is None:
        return time, calibration.camera.project(centre)
    return time, calibration.camera.sphere_outline(centre, calibration.ball_radius)[0]


def _contradiction(
    calibration: Calibration, slope: FloatArray, wanted: float, fall: SeenFall
) -> str:
    """Message of a contradicting fall, and the input that needs the smallest correction."""
    candidates: list[tuple[float, str]] = []
    for source in calibration.sources:
        effect = math.sqrt(max(0.0, float(slope @ source.covariance @ slope)))
        if effect > 0.0:
            candidates.append((abs(wanted) / effect, source.name))
    faster = 100.0 * math.expm1(0.5 * wanted)
    percent = 100.0 * abs(math.expm1(-wanted))
    return (
        f"the ball falls with {fall.apparent.value:.2f} ± {fall.apparent.std:.2f} m/s² instead of "
        f"{fall.gravity:.2f}: lengths on its plane are {percent:.1f} % too "
        f"{'short' if wanted > 0.0 else 'long'}. Most probably wrong: {min(candidates)[1]}, or the "
        f"capture rate, which would have to change by {faster:+.1f} %"
    )


BALL_ERROR_PX, MASS_ERROR_PX, CROSSING_ERROR_PX = 0.05, 0.15, 0.3
"""Errors of tracking besides noise, px: ball and mass (fitted: recordings with known truth, see
above), and a crossing of the grid (chosen)."""
HIDDEN_FRACTION = 0.3
"""Fraction of the wall hidden by pendulum, stand and ball (chosen, as in the rendered scenes)."""
MIN_CROSSINGS = 12
"""Minimum number of crossings (derived: `calib.grid.MIN_NODES`)."""
MIN_PITCH_PX = 3.0
"""Minimum pitch, px (chosen): above the 2.5 px where lines may alias
(`calib.grid.MIN_PERIOD_PX`)."""
FULL_WELL, READ_NOISE, SENSOR_GAMMA, WALL_BRIGHTNESS = 9000.0, 18.0, 2.2, 0.66
"""Full well and read noise of a small sensor's pixel, electrons; gamma; and brightness of a well
exposed wall, fraction of full scale (chosen: typical values)."""
REFERENCE_EXPOSURE_S = 1e-3
"""Exposure that `light` refers to, s (convention)."""
BOARD_LENS_STD: FloatArray = np.array([1e-3, 0.5, 0.5, 2e-3, 2e-3])
"""Std of relative focal length, principal point (px), k1, k2 after twenty board pictures
(chosen)."""


@dataclass(frozen=True)
class PictureNoise:
    """Noise, contrast and sharpness of a planned picture.

    Attributes
    ----------
    gray_std : float
        Noise of a pixel of the wall, gray levels of 255.
    contrast : float
        Step between ball or mass and background, gray levels.
    blur_px : float
        Standard deviation of the point spread, px.
    """

    gray_std: float
    contrast: float = 80.0
    blur_px: float = 0.6

    @classmethod
    def by_light(cls, light: float, exposure_s: float) -> "PictureNoise":
        """Photon and read noise of a camera whose gain makes the wall bright.

        Parameters
        ----------
        light : float
            1 where the wall is well exposed at 1/1000 s without any gain; a lit gymnasium has
            about 0.1.
        exposure_s : float
            Shutter, s.
        """
        full = min(light * exposure_s / REFERENCE_EXPOSURE_S, 1.0)
        electrons = WALL_BRIGHTNESS * FULL_WELL * full
        relative = np.sqrt(electrons + READ_NOISE**2) / electrons
        gray = 255.0 * WALL_BRIGHTNESS ** (1.0 / SENSOR_GAMMA)
        return cls(float(gray * relative / SENSOR_GAMMA))


def edge_std(
    noise: PictureNoise, radius_px: ArrayLike, way_px: ArrayLike, own: float
) -> FloatArray:
    """Standard uncertainty of the centre of a disc along one axis, px.

    Parameters
    ----------
    radius_px : (...) array
        Radius of the disc, px.
    way_px : (...) array
            Motion during the exposure, px: a uniform smear.
    own : float
        Error of tracking besides noise, px.
    """
    radius = np.asarray(radius_px, dtype=np.float64)
    spread = np.sqrt(noise.blur_px**2 + np.asarray(way_px) ** 2 / 12.0)
    bound = noise.gray_std / noise.contrast * np.sqrt(2.0 * spread / (np.sqrt(np.pi) * radius))
    return np.asarray(np.hypot(bound, own))


def lens_of_view(width: int, height: int, horizontal_rad: float) -> Lens:
    """A lens by its horizontal angle of view."""
    return Lens.centred(width, height, 0.5 * (width - 1) / np.tan(0.5 * horizontal_rad))


def board_lens(lens: Lens) -> LensPrior:
    """The lens with the uncertainty of a board calibration."""
    return LensPrior(lens, BOARD_LENS_STD)


def planned_grid(camera: Camera, pitch_m: float = 0.05) -> WallGrid:
    """Expected crossings of the wall's grid in the picture, some hidden by the scene.

    Parameters
    ----------
    camera : Camera
        In the world.
    pitch_m : float
        Distance between lines, m.

    Raises
    ------
    CalibrationError
        If the lines would be too close, or too few in view.
    """
    lens = camera.lens
    corners = [[0, 0], [lens.width - 1, 0], [0, lens.height - 1], [lens.width - 1, lens.height - 1]]
    reach = camera.to_plane(np.array(corners, dtype=float), 0.0)
    if not np.isfinite(reach).all():
        raise CalibrationError(
            "the camera would point past the wall", hint="Turn it towards the wall."
        )
    low, high = np.floor(reach.min(axis=0) / pitch_m), np.ceil(reach.max(axis=0) / pitch_m)
    columns, rows = (np.arange(a, b + 1) for a, b in zip(low, high, strict=True))
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.int64)
    px = camera.project(np.c_[pitch_m * nodes, np.zeros(len(nodes))])
    inside = ((px > 1.0) & (px < [lens.width - 2.0, lens.height - 2.0])).all(axis=1)
    apart = lens.fx * pitch_m / camera.position[2]
    if apart < MIN_PITCH_PX:
        raise CalibrationError(
            f"the lines of the wall would be {apart:.1f} px apart",
            hint="Film with more pixels, from nearer, or with a narrower view.",
        )
    # Objects in front of the wall hide a block of it, low and on one side.
    kept = np.flatnonzero(inside)[: int((1.0 - HIDDEN_FRACTION) * inside.sum())]
    if len(kept) < MIN_CROSSINGS:
        raise CalibrationError(
            f"only {len(kept)} crossings of the wall's grid would be in view",
            hint="Film from farther away, or with a wider view.",
        )
    return WallGrid(
        size=(lens.width, lens.height),
        pitch_m=pitch_m,
        nodes=nodes[kept],
        points_px=px[kept],
        covariance_px2=np.broadcast_to(CROSSING_ERROR_PX**2 * np.eye(2), (len(kept), 2, 2)),
        map=_map(camera, pitch_m),
        area=np.ones((lens.height, lens.width), dtype=bool),
        dark=True,
        fine_ratio=None,
        origin_m=np.zeros(2),
    )


def _map(camera: Camera, pitch_m: float) -> GridMap:
    """Map of the wall without the lens's distortion."""
    lens = camera.lens
    focal = np.array([lens.fx, lens.fy])
    to_camera = np.column_stack(
        [pitch_m * camera.rotation[:, :2], -camera.rotation @ camera.position]
    )
    to_grid = np.linalg.inv(to_camera)
    rows = to_grid / to_grid[2, 2]
    return GridMap(
        np.array([lens.cx, lens.cy]),
        focal,
        np.concatenate([rows[0], rows[1], rows[2, :2], np.zeros(2)]),
    )
