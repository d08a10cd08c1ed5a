"""Compiled loops over pixels: gray levels between them, and a layer held against a picture.

A layer is a look T with an opacity α at points; a picture shows b·α·T + (1 − α)·B where it lies,
with the scene B behind it and a brightness b that is free. Points, looks and opacities are the rows
x, y, T, α of a float32 array (4, n); pictures are float32, too. A placing maps a point p of the
layer to the picture as m + M p and is given as (m_x, m_y, M_xx, M_xy, M_yx, M_yy); a way in which a
placing changes is given alike, per unit of what changes it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from metrology.compiled import compiled

__all__ = [
    "CORRELATED_PIXELS",
    "LEAST_SEEN",
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
"""Part of the opaque layer in view; usual size of the residual, gray levels; log-likelihood gained
over the scene alone; part explained of what differs from the scene; weighted squares of the
residual; sum of the weights."""

CORRELATED_PIXELS = 4.0
"""Neighbouring residuals share interpolation and coding errors; so many pixels count as one."""

LEAST_SEEN = 0.33
"""Opaque part of a layer that has to be in view to tell where it is."""

_ONE, _HALF, _QUARTER = np.float32(1.0), np.float32(0.5), np.float32(0.25)
# Keys' cubic convolution (1981) with the one slope that draws a straight line straight; OpenCV's
# slope of -0.75 shifts what is seen by up to 0.03 px.
_A = np.float32(-0.5)
_A2, _A3 = np.float32(1.5), np.float32(2.5)
_A4, _A5, _A8 = np.float32(-2.0), np.float32(-2.5), np.float32(-4.0)
_ROBUST = np.float32(3.0)
_GAIN = float(_ROBUST * _ROBUST) / (2.0 * CORRELATED_PIXELS)
# Standard deviation over median size of a normal variable; of the noise, what residuals have at
# the least.
_STD_OF_MEDIAN, _LEAST_SCALE = 1.4826, 0.7
_BINS = 512
"""Bins of a histogram of gray values, over twice their mean: a quantile is then good to half a per
cent."""
# Of a registration: longest step, px, and turn, rad; when it has come to rest
# and when it has not, px; the most of each step by which redescending weights make it fall short;
# what keeps the normal equations regular.
_LONGEST_PX, _MOST_TURN = 1.5, 0.1
_SHORT, _SHORTISH, _UNSETTLED, _MOST_SHARE = 4e-3, 5e-2, 0.5, 0.7
"""px, px, px and share: steps that matter to no measurement, that may still be chance, that are no
rest; and the most of a step that is taken for the next."""
_RIDGE, _LOOK_RIDGE = 1e-6, 1e-3
"""Relative: ridges that keep a matrix of full rank where pixels do not tell a direction; far below
what they tell else."""


@compiled
def _cubic(part: Single) -> Four:
    """Weights of four neighbours, the first one pixel before the point's own."""
    ahead = part + _ONE
    first = ((_A * ahead - _A5) * ahead + _A8) * ahead - _A4
    second = (_A2 * part - _A3) * part * part + _ONE
    back = _ONE - part
    third = (_A2 * back - _A3) * back * back + _ONE
    return first, second, third, _ONE - first - second - third


@compiled
def _slope(part: Single) -> Four:
    """Weights of four neighbours for half the difference of neighbours, drawn linearly between."""
    near, far = _HALF * (_ONE - part), _HALF * part
    return -near, -far, near, far


@compiled
def _smooth(part: Single) -> Four:
    """Weights of four neighbours for a quarter, half and quarter of three, drawn linearly."""
    near, far = _QUARTER * (_ONE - part), _QUARTER * part
    return near, near + near + far, near + far + far, far


@compiled
def _row(weights: Four, line: FloatImage, column: int) -> Single:
    before = weights[0] * line[column - 1] + weights[1] * line[column]
    return Single(before + weights[2] * line[column + 1] + weights[3] * line[column + 2])


@compiled
def _shown(picture: FloatImage, x: Single, y: Single) -> Single:
    """Gray level at a point that has two pixels beyond it on every side."""
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
    """Gray level there and its slopes along x and y; smooth ones are less led astray."""
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
    """One of few values by its place in their order, which they are put into."""
    for k in range(1, len(values)):
        value, j = values[k], k
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return float(values[place])


@compiled
def _median(size: FloatImage, count: int) -> float:
    """Upper middle of the first so many values, all at least 0."""
    total = 0.0
    for k in range(count):
        total += size[k]
    if total <= 0.0:
        return 0.0
    # half of them lie below twice their mean
    per_bin = (_BINS - 1) / (2.0 * total / count)
    # an array of zeros takes the compiler longer than all that is here
    bins = np.empty(_BINS, dtype=np.int64)
    for k in range(_BINS):
        bins[k] = 0
    for k in range(count):
        bins[int(min(size[k] * per_bin, _BINS - 1.0))] += 1
    wanted, place = count // 2, 0
    while wanted >= bins[place]:
        wanted -= bins[place]
        place += 1
    near = np.empty(bins[place], dtype=np.float32)
    found = 0
    for k in range(count):
        if int(min(size[k] * per_bin, _BINS - 1.0)) == place:
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
    """Put a layer before the scene; returns its opaque part in view, and its brightness.

    The brightness is told by the picture, or else by that less what shines through the layer.

    The rows of `work` (6, n) become: 1 where a point counts; the picture less what shines through;
    the slopes of that along x and y; the look in front; and, to `compare`, the picture less the
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
    """Residuals in the row of differences, weights in the first; returns their usual size."""
    light = Single(bright)
    size = np.empty(work.shape[1], dtype=np.float32)
    count = 0
    for k in range(work.shape[1]):
        work[1, k] -= light * work[4, k]
        if work[0, k] > 0:
            size[count] = abs(work[1, k])
            count += 1
    scale = max(_STD_OF_MEDIAN * _median(size, count), _LEAST_SCALE * noise)
    per = Single(1.0 / (_ROBUST * scale))
    for k in range(work.shape[1]):
        off = work[1, k] * per
        weight = _ONE / (_ONE + off * off)
        work[0, k] *= weight * weight
    return scale


@compiled
def _compared(layer: FloatImage, noise: float, work: FloatImage) -> tuple[float, float]:
    """Log-likelihood gained over the scene alone, and the part explained of what differs."""
    per = Single(1.0 / (_ROBUST * noise))
    gained, there, left = 0.0, 0.0, 0.0
    for k in range(layer.shape[1]):
        if work[0, k] > 0:
            opacity = layer[3, k]
            with_it, without = work[1, k] * per, work[5, k] * per
            ratio = (_ONE + without * without) / (_ONE + with_it * with_it)
            gained += opacity * math.log(ratio)
            there += opacity * abs(work[5, k])
            left += opacity * abs(work[1, k])
    return _GAIN * gained, 1.0 - left / max(there, 1e-9)


def most_gained(differs: FloatImage, opacity: FloatArray, noise: float) -> float:
    """Log-likelihood that a layer gains which explains all that differs from the scene (n,)."""
    return float(_GAIN * (opacity @ np.log1p((differs / (_ROBUST * noise)) ** 2)))


@compiled
def _sum_up(
    layer: FloatImage, ways: FloatArray, work: FloatImage, normal: FloatArray, pull: FloatArray
) -> tuple[float, float]:
    """Normal equations of the ways and, last, of the brightness; weighted squares and weights."""
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
    """Hold a layer against a picture.

    Parameters
    ----------
    layer : (4, n) float32 array
    placing : (6,) array
    ways : (k, 6) array
        By which the placing may change.
    picture, behind : (H, W) float32 arrays
        As filmed, and the scene behind the layer in reference brightness.
    gain : float
        Brightness of the picture over that of the scene.
    noise : float
        Standard deviation of a pixel, gray levels.
    hidden : (3,) array
        Centre x, y and radius of a disc in which something else may be in front, px; nothing is
        where the radius is 0.
    compare : bool
        Whether to compare with the scene alone; else gained and explained are 0.
    normal, pull : (k + 1, k + 1) and (k + 1,) arrays
        Take the robust normal equations, of the brightness last: the step is −normal⁻¹ pull.

    Returns
    -------
    Moments
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
    """Log-likelihood gained over the scene alone at each of several placings (k, 6): (k,).

    −∞ where less than a third of the layer is in view.
    """
    work = np.zeros((6, layer.shape[1]), dtype=np.float32)
    gains = np.empty(len(placings))
    for i in range(len(placings)):
        gains[i] = -np.inf
        seen, bright = _lay(layer, placings[i], picture, behind, gain, hidden, True, False, work)
        if seen >= LEAST_SEEN:
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
    """Shift and turn a rigid layer until it explains a picture best, by Gauss–Newton.

    Parameters
    ----------
    layer, picture, behind, gain, noise, hidden
        See `registration_moments`.
    start : (3,) array
        Where its origin lies (px) and its turn (rad) at first.
    prior : (3, 3) array
        Information by which it is held to that.
    iterations : int
        Steps at most.
    normal : (4, 4) array
        Takes the normal equations at the end.

    Returns
    -------
    settled : bool
    x, y, turn : float
    scale, rms_residual : float
        Usual size of the residual, and its weighted root mean square over noise.
    seen : float
        Opaque part in view.
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
        if seen < LEAST_SEEN:
            return False, pose[0], pose[1], pose[2], scale, rms_residual, seen
        scale = _weigh(bright, noise, work)
        squares, weights = _sum_up(layer, ways, work, normal, pull)
        rms_residual = math.sqrt(squares / (weights + 1e-9)) / noise
        for i in range(3):
            normal[i, i] += _RIDGE
            for j in range(3):
                normal[i, j] += scale * scale * prior[i, j]
                pull[i] += scale * scale * prior[i, j] * (pose[j] - start[j])
        normal[3, 3] += _LOOK_RIDGE * opaque
        _solve(normal, pull, now)
        # Redescending weights make steps fall short by a constant share: it is learnt on the way.
        along, square = 0.0, 1e-12
        for i in range(3):
            along -= now[i] * step[i]
            square += step[i] * step[i]
        longer = 1.0 - min(max(along / square, 0.0), _MOST_SHARE) if count > 0 else 1.0
        for i in range(3):
            step[i] = -now[i] / longer
        before, latest = latest, math.hypot(step[0], step[1])
        limit = min(1.0, _LONGEST_PX / max(latest, 1e-9))
        pose[0] += limit * step[0]
        pose[1] += limit * step[1]
        pose[2] += limit * min(max(step[2], -_MOST_TURN), _MOST_TURN)
        if limit < 1.0:
            step[0] = step[1] = step[2] = 0.0
        if latest < _SHORT and before < _SHORTISH:
            break
    return latest <= _UNSETTLED, pose[0], pose[1], pose[2], scale, rms_residual, seen
