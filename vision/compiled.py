"""Compiled pixel loops: interpolation, and comparison of a layer with a picture.

A layer is an appearance T with an opacity α at points; where it covers it, a picture shows b·α·T +
(1 − α)·B, with the scene B behind it and a free brightness b. Points, appearances and opacities are
the rows x, y, T, α of a float32 array (4, n); pictures are float32, too. A placement maps a point p
of the layer to the picture as m + M p and is given as (m_x, m_y, M_xx, M_xy, M_yx, M_yy); its
derivative by a parameter has the same form.
"""

import math

import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled

__all__ = [
    "CORRELATED_PIXELS",
    "MIN_VISIBLE",
    "Moments",
    "gains_along",
    "most_gained",
    "registered",
    "registration_moments",
]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
Single = np.float32
Four = tuple[np.float32, np.float32, np.float32, np.float32]
Moments = tuple[float, float, float, float, float, float]
"""Fraction of the opaque layer in view; median size of the residual, gray levels; log-likelihood
gain over the scene alone; explained fraction of the difference from the scene; weighted squares of
the residual; sum of the weights."""

CORRELATED_PIXELS = 4.0
"""Correlated pixels that count as one (chosen): neighbours share interpolation and coding
errors."""

MIN_VISIBLE = 0.33
"""Minimum fraction of a layer in view (chosen)."""

_ONE, _HALF, _QUARTER = np.float32(1.0), np.float32(0.5), np.float32(0.25)
# Keys' cubic convolution (1981) with the slope that reproduces a straight line; OpenCV's slope of
# -0.75 shifts edges by up to 0.03 px.
_A = np.float32(-0.5)
_A2, _A3 = np.float32(1.5), np.float32(2.5)
_A4, _A5, _A8 = np.float32(-2.0), np.float32(-2.5), np.float32(-4.0)
_ROBUST_SIGMAS = np.float32(3.0)
_LIKELIHOOD_FACTOR = float(_ROBUST_SIGMAS * _ROBUST_SIGMAS) / (2.0 * CORRELATED_PIXELS)
_STD_OF_MEDIAN, _MIN_RESIDUAL_SIZE = 1.4826, 0.7
"""Standard deviation over median size of a normal variable (derived); and minimum size of
residuals over the noise (chosen)."""
_HISTOGRAM_BINS = 512
"""Bins of a histogram of gray values over twice their mean (chosen: quantiles to half a per
cent)."""
_MAX_STEP_PX, _MAX_TURN_STEP = 1.5, 0.1
"""Maximum step of a registration, px and rad (chosen)."""
_NEGLIGIBLE_STEP_PX, _SMALL_STEP_PX, _MAX_SETTLED_STEP_PX, _MAX_LOST_FRACTION = 4e-3, 5e-2, 0.5, 0.7
"""Steps, px, that are negligible, that may be followed by a negligible one, and that mean no
convergence; and maximum fraction of a step lost to redescending weights (chosen)."""
_RIDGE, _BRIGHTNESS_RIDGE = 1e-6, 1e-3
"""Relative ridges that keep normal equations regular where pixels do not determine a direction
(chosen: far below the information elsewhere)."""


@compiled
def _cubic(part: Single) -> Four:
    """Weights of four neighbours, the first one pixel before the point."""
    ahead = part + _ONE
    first = ((_A * ahead - _A5) * ahead + _A8) * ahead - _A4
    second = (_A2 * part - _A3) * part * part + _ONE
    back = _ONE - part
    third = (_A2 * back - _A3) * back * back + _ONE
    return first, second, third, _ONE - first - second - third


@compiled
def _slope(part: Single) -> Four:
    """Weights of four neighbours for the central difference, interpolated linearly."""
    near, far = _HALF * (_ONE - part), _HALF * part
    return -near, -far, near, far


@compiled
def _smooth(part: Single) -> Four:
    """Weights of four neighbours for the mean (1/4, 1/2, 1/4) of three, interpolated linearly."""
    near, far = _QUARTER * (_ONE - part), _QUARTER * part
    return near, near + near + far, near + far + far, far


@compiled
def _row(weights: Four, line: FloatImage, column: int) -> Single:
    before = weights[0] * line[column - 1] + weights[1] * line[column]
    return Single(before + weights[2] * line[column + 1] + weights[3] * line[column + 2])


@compiled
def _shown(picture: FloatImage, x: Single, y: Single) -> Single:
    """Gray level at a point at least two pixels from the border."""
    column, row = int(x), int(y)
    across, down = _cubic(x - Single(column)), _cubic(y - Single(row))
    level = Single(0.0)
    for k in range(4):
        level += down[k] * _row(across, picture[row - 1 + k], column)
    return level


@compiled
def _shown_with_slopes(
    picture: FloatImage, x: Single, y: Single
) -> tuple[np.float32, np.float32, np.float32]:
    """Gray level at a point and its smoothed slopes along x and y, which are more robust."""
    column, row = int(x), int(y)
    u, v = x - Single(column), y - Single(row)
    across, slope_across, smooth_across = _cubic(u), _slope(u), _smooth(u)
    down, slope_down, smooth_down = _cubic(v), _slope(v), _smooth(v)
    level, along_x, along_y = Single(0.0), Single(0.0), Single(0.0)
    for k in range(4):
        line = picture[row - 1 + k]
        level += down[k] * _row(across, line, column)
        along_x += smooth_down[k] * _row(slope_across, line, column)
        along_y += slope_down[k] * _row(smooth_across, line, column)
    return level, along_x, along_y


@compiled
def _ranked(values: FloatImage, place: int) -> float:
    """Value of a rank among few values, which are sorted in place."""
    for k in range(1, len(values)):
        value, j = values[k], k
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return float(values[place])


@compiled
def _median(size: FloatImage, count: int) -> float:
    """Upper median of the first `count` values, all at least 0."""
    total = 0.0
    for k in range(count):
        total += size[k]
    if total <= 0.0:
        return 0.0
    # Half of them lie below twice their mean.
    per_bin = (_HISTOGRAM_BINS - 1) / (2.0 * total / count)
    # np.zeros would take longer to compile than this whole function.
    bins = np.empty(_HISTOGRAM_BINS, dtype=np.int64)
    for k in range(_HISTOGRAM_BINS):
        bins[k] = 0
    for k in range(count):
        bins[int(min(size[k] * per_bin, _HISTOGRAM_BINS - 1.0))] += 1
    wanted, place = count // 2, 0
    while wanted >= bins[place]:
        wanted -= bins[place]
        place += 1
    near = np.empty(bins[place], dtype=np.float32)
    found = 0
    for k in range(count):
        if int(min(size[k] * per_bin, _HISTOGRAM_BINS - 1.0)) == place:
            near[found] = size[k]
            found += 1
    return _ranked(near, wanted)


@compiled
def _lay(
    layer: FloatImage,
    placing: FloatArray,
    picture: FloatImage,
    behind: FloatImage,
    gain: float,
    hidden: FloatArray,
    compare: bool,
    shining: bool,
    work: FloatImage,
) -> tuple[float, float]:
    """Place a layer in front of the scene; return its visible opaque fraction and its brightness.

    The brightness is fitted to the picture, or with `shining` to the picture minus the scene that
    shows through the layer.

    The rows of `work` (6, n) become: 1 where a point counts; the picture minus what shows through;
    its slopes along x and y; the appearance in front; and, to `compare`, the picture minus the
    scene.
    """
    height, width = picture.shape
    light = Single(gain)
    mx, my, xx = Single(placing[0]), Single(placing[1]), Single(placing[2])
    xy, yx, yy = Single(placing[3]), Single(placing[4]), Single(placing[5])
    hx, hy, hidden_square = Single(hidden[0]), Single(hidden[1]), Single(hidden[2] * hidden[2])
    hides = hidden[2] > 0.0
    whole, seen, own, cross = 0.0, 0.0, 0.0, 0.0
    for k in range(layer.shape[1]):
        x = mx + xx * layer[0, k] + xy * layer[1, k]
        y = my + yx * layer[0, k] + yy * layer[1, k]
        opacity = layer[3, k]
        look = opacity * layer[2, k] * light
        whole += opacity
        work[4, k] = look
        free = x > 1 and y > 1 and x < width - 2 and y < height - 2
        if free and hides:
            dx, dy = x - hx, y - hy
            free = dx * dx + dy * dy > hidden_square
        if not free:
            work[0, k] = work[1, k] = work[2, k] = work[3, k] = work[5, k] = Single(0.0)
            continue
        level, along_x, along_y = _shown_with_slopes(picture, x, y)
        if shining:
            own += look * layer[2, k] * light
            cross += look * level
        clear = (_ONE - opacity) * light
        if clear > 0:
            scene, scene_x, scene_y = _shown_with_slopes(behind, x, y)
            work[5, k] = level - light * scene
            level -= clear * scene
            along_x -= clear * scene_x
            along_y -= clear * scene_y
        elif compare:
            work[5, k] = level - light * _shown(behind, x, y)
        work[0, k], work[1, k], work[2, k], work[3, k] = _ONE, level, along_x, along_y
        seen += opacity
        if not shining:
            own += look * look
            cross += look * level
    return seen / max(whole, 1e-12), cross / max(own, 1e-9)


@compiled
def _weigh(bright: float, noise: float, work: FloatImage) -> float:
    """Residuals in the row of differences, weights in the first; return the residuals' size."""
    light = Single(bright)
    size = np.empty(work.shape[1], dtype=np.float32)
    count = 0
    for k in range(work.shape[1]):
        work[1, k] -= light * work[4, k]
        if work[0, k] > 0:
            size[count] = abs(work[1, k])
            count += 1
    scale = max(_STD_OF_MEDIAN * _median(size, count), _MIN_RESIDUAL_SIZE * noise)
    per = Single(1.0 / (_ROBUST_SIGMAS * scale))
    for k in range(work.shape[1]):
        off = work[1, k] * per
        weight = _ONE / (_ONE + off * off)
        work[0, k] *= weight * weight
    return scale


@compiled
def _compared(layer: FloatImage, noise: float, work: FloatImage) -> tuple[float, float]:
    """Log-likelihood gain over the scene alone, and the explained fraction of the difference."""
    per = Single(1.0 / (_ROBUST_SIGMAS * noise))
    gained, there, left = 0.0, 0.0, 0.0
    for k in range(layer.shape[1]):
        if work[0, k] > 0:
            opacity = layer[3, k]
            with_it, without = work[1, k] * per, work[5, k] * per
            ratio = (_ONE + without * without) / (_ONE + with_it * with_it)
            gained += opacity * math.log(ratio)
            there += opacity * abs(work[5, k])
            left += opacity * abs(work[1, k])
    return _LIKELIHOOD_FACTOR * gained, 1.0 - left / max(there, 1e-9)


def most_gained(differs: FloatImage, opacity: FloatArray, noise: float) -> float:
    """Log-likelihood gain of a layer that explains every difference from the scene (n,)."""
    return float(
        _LIKELIHOOD_FACTOR * (opacity @ np.log1p((differs / (_ROBUST_SIGMAS * noise)) ** 2))
    )


@compiled
def _sum_up(
    layer: FloatImage, ways: FloatArray, work: FloatImage, normal: FloatArray, pull: FloatArray
) -> tuple[float, float]:
    """Normal equations of the parameters and, last, the brightness; weighted squares, weights."""
    count, points = ways.shape[0], layer.shape[1]
    columns = np.empty((count + 1, points), dtype=np.float32)
    for i in range(count):
        sx, sy, xx = Single(ways[i, 0]), Single(ways[i, 1]), Single(ways[i, 2])
        xy, yx, yy = Single(ways[i, 3]), Single(ways[i, 4]), Single(ways[i, 5])
        for k in range(points):
            x, y = layer[0, k], layer[1, k]
            columns[i, k] = work[2, k] * (sx + xx * x + xy * y)
            columns[i, k] += work[3, k] * (sy + yx * x + yy * y)
    for k in range(points):
        columns[count, k] = -work[4, k]
    weighted = np.empty(points, dtype=np.float32)
    for i in range(count + 1):
        for k in range(points):
            weighted[k] = work[0, k] * columns[i, k]
        for j in range(i + 1):
            total = 0.0
            for k in range(points):
                total += weighted[k] * columns[j, k]
            normal[i, j] = normal[j, i] = total
        total = 0.0
        for k in range(points):
            total += weighted[k] * work[1, k]
        pull[i] = total
    squares, weights = 0.0, 0.0
    for k in range(points):
        squares += work[0, k] * work[1, k] * work[1, k]
        weights += work[0, k]
    return squares, weights


@compiled
def registration_moments(
    layer: FloatImage,
    placing: FloatArray,
    ways: FloatArray,
    picture: FloatImage,
    behind: FloatImage,
    gain: float,
    noise: float,
    hidden: FloatArray,
    compare: bool,
    normal: FloatArray,
    pull: FloatArray,
) -> Moments:
    """Compare a layer with a picture.

    Parameters
    ----------
    layer : (4, n) float32 array
    placing : (6,) array
    ways : (k, 6) array
        Derivatives of the placement by its parameters.
    picture, behind : (H, W) float32 arrays
        As filmed, and the scene behind the layer at reference brightness.
    gain : float
        Brightness of the picture over that of the scene.
    noise : float
        Standard deviation of a pixel, gray levels.
    hidden : (3,) array
        Centre x, y and radius of a disc that may be hidden by another object, px; radius 0 for
        none.
    compare : bool
        Whether to compare with the scene alone; otherwise gain and explained fraction are 0.
    normal, pull : (k + 1, k + 1) and (k + 1,) arrays
        Filled with the robust normal equations, brightness last: the step is −normal⁻¹ pull.
    """
    work = np.zeros((6, layer.shape[1]), dtype=np.float32)
    seen, bright = _lay(layer, placing, picture, behind, gain, hidden, compare, False, work)
    scale = _weigh(bright, noise, work)
    gained, explained = 0.0, 0.0
    if compare:
        gained, explained = _compared(layer, noise, work)
    squares, weights = _sum_up(layer, ways, work, normal, pull)
    return seen, scale, gained, explained, squares, weights


@compiled
def gains_along(
    layer: FloatImage,
    placings: FloatArray,
    picture: FloatImage,
    behind: FloatImage,
    gain: float,
    noise: float,
    hidden: FloatArray,
) -> FloatArray:
    """Log-likelihood gain over the scene alone at each of several placements (k, 6): (k,).

    −∞ where less than a third of the layer is in view.
    """
    work = np.zeros((6, layer.shape[1]), dtype=np.float32)
    gains = np.empty(len(placings))
    for i in range(len(placings)):
        gains[i] = -np.inf
        seen, bright = _lay(layer, placings[i], picture, behind, gain, hidden, True, False, work)
        if seen >= MIN_VISIBLE:
            _weigh(bright, noise, work)
            gains[i] = _compared(layer, noise, work)[0]
    return gains


@compiled
def _solve(matrix: FloatArray, right: FloatArray, found: FloatArray) -> None:
    """Solve a small positive definite system, by elimination."""
    count = len(right)
    left = np.empty((count, count))
    for i in range(count):
        found[i] = right[i]
        for j in range(count):
            left[i, j] = matrix[i, j]
    for i in range(count):
        for j in range(i + 1, count):
            share = left[j, i] / left[i, i]
            for k in range(i, count):
                left[j, k] -= share * left[i, k]
            found[j] -= share * found[i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            found[i] -= left[i, k] * found[k]
        found[i] /= left[i, i]


@compiled
def registered(
    layer: FloatImage,
    start: FloatArray,
    prior: FloatArray,
    picture: FloatImage,
    behind: FloatImage,
    gain: float,
    noise: float,
    hidden: FloatArray,
    iterations: int,
    normal: FloatArray,
) -> tuple[bool, float, float, float, float, float, float]:
    """Shift and rotate a rigid layer until it explains a picture best, by Gauss–Newton steps.

    Parameters
    ----------
    layer, picture, behind, gain, noise, hidden
        See `registration_moments`.
    start : (3,) array
        Initial position of its origin (px) and rotation (rad).
    prior : (3, 3) array
        Prior information of these.
    iterations : int
        Maximum number of steps.
    normal : (4, 4) array
        Filled with the final normal equations.

    Returns
    -------
    settled : bool
    x, y, turn : float
    scale, rms_residual : float
        Median size of the residual, and its weighted root mean square over noise.
    seen : float
        Visible opaque fraction.
    """
    pose, step, pull, now = start.copy(), np.zeros(3), np.zeros(4), np.zeros(4)
    placing, ways = np.empty(6), np.zeros((3, 6))
    ways[0, 0] = ways[1, 1] = 1.0
    work = np.zeros((6, layer.shape[1]), dtype=np.float32)
    opaque = 0.0
    for k in range(layer.shape[1]):
        opaque += layer[3, k]
    scale, rms_residual, seen = noise, 0.0, 0.0
    before, latest = np.inf, np.inf
    for count in range(iterations):
        cosine, sine = math.cos(pose[2]), math.sin(pose[2])
        placing[0], placing[1], placing[2] = pose[0], pose[1], cosine
        placing[3], placing[4], placing[5] = -sine, sine, cosine
        ways[2, 2], ways[2, 3], ways[2, 4], ways[2, 5] = -sine, -cosine, cosine, -sine
        seen, bright = _lay(layer, placing, picture, behind, gain, hidden, False, True, work)
        if seen < MIN_VISIBLE:
            return False, pose[0], pose[1], pose[2], scale, rms_residual, seen
        scale = _weigh(bright, noise, work)
        squares, weights = _sum_up(layer, ways, work, normal, pull)
        rms_residual = math.sqrt(squares / (weights + 1e-9)) / noise
        for i in range(3):
            normal[i, i] += _RIDGE
            for j in range(3):
                normal[i, j] += scale * scale * prior[i, j]
                pull[i] += scale * scale * prior[i, j] * (pose[j] - start[j])
        normal[3, 3] += _BRIGHTNESS_RIDGE * opaque
        _solve(normal, pull, now)
        # Redescending weights shorten steps by a constant fraction, estimated from past steps.
        along, square = 0.0, 1e-12
        for i in range(3):
            along -= now[i] * step[i]
            square += step[i] * step[i]
        longer = 1.0 - min(max(along / square, 0.0), _MAX_LOST_FRACTION) if count > 0 else 1.0
        for i in range(3):
            step[i] = -now[i] / longer
        before, latest = latest, math.hypot(step[0], step[1])
        limit = min(1.0, _MAX_STEP_PX / max(latest, 1e-9))
        pose[0] += limit * step[0]
        pose[1] += limit * step[1]
        pose[2] += limit * min(max(step[2], -_MAX_TURN_STEP), _MAX_TURN_STEP)
        if limit < 1.0:
            step[0] = step[1] = step[2] = 0.0
        if latest < _NEGLIGIBLE_STEP_PX and before < _SMALL_STEP_PX:
            break
    return latest <= _MAX_SETTLED_STEP_PX, pose[0], pose[1], pose[2], scale, rms_residual, seen
