"""Propose bodies that swing into the resting ball, from pictures in colour.

A body that turns about a pivot stands still in pictures that are turned back about it. Pictures
just before contact are turned back for many pivots and rates; each pixel then compares two
explanations: one colour that moves with the body, or the scene behind it. Where the body explains
more than the scene, on either side of the scene's colour, its outline appears; its shadow appears
for another pivot, and dims the scene evenly by one ratio.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.pendulum.arc import ImagedSwing, Patch
from vision.pendulum.layer import thick_part
from vision.scene import FilmedScene, median_of
from vision.tracks import Rest

__all__ = ["SwingPrior", "SwungBody", "face_gap", "propose_bodies", "swing_prior"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

_WIDTH_PX, _RADIUS_PX, _COARSE_RADIUS_PX = 320, 12.0, 8.0
"""Maximum width of the working pictures, and of the ball's radius in them and in the first, coarse
search, px (chosen; a mass of a third of the ball is then 5 px across)."""
_APPROACH_RADII, _APPROACH_PICTURES, _SCENE_PICTURES = 3.0, 10, 15
"""Flight of the ball, radii, that lasts as long as the approach that is compared; numbers of
pictures of it and of a scene (chosen)."""
_BEHIND, _BESIDE = 4.0, 2.6
"""Ball radii behind its centre and to either side in which a body is sought (chosen)."""
_COLOURS = np.array(
    [[0.114, 0.587, 0.299], [0.7, -0.35, -0.35], [0.0, -0.7, 0.7]], dtype=np.float32
)
"""Lightness, blueness and redness of blue, green and red (convention: lightness of ITU-R BT.601);
the noise of a camera is nearly independent in them."""
_MAX_SQUARE = 25.0
"""Squared standard deviations from which a pixel counts no more (derived: five sigma)."""
_MIN_LOG_ODDS = 2.0
"""Log odds of a pixel, averaged over its neighbours, from which it belongs to the body (derived:
odds of 7 to 1)."""
_FREE_COLOURS = 3.0
"""Log odds that a free colour of a pixel costs (derived: half the log of ten pictures, for three
channels)."""
_MIN_VISIBLE = 0.4
"""Minimum fraction of the pictures that show a pixel of the body (chosen)."""
_IN_VIEW = 0.99
"""Minimum weight of an interpolated pixel that is in view (derived: rounding)."""
_NEAR, _CLEAR = 1.0, 0.1
"""Ball radii from the target within which a body begins, and from the ball at which it is cut out
(chosen)."""
_MIN_PIXELS, _MIN_APPROACH = 12, 4
"""Minimum number of pixels of a body, and of pictures of an approach (chosen)."""
_BEFORE_LAST, _CONTACT = 0.5, 0.15
"""Flight of the ball, radii, that lasts as long as from the picture to which others are turned back
until the ball is last taken for resting, and as the part of contact before that (chosen)."""
_AS_SHADOW = 1.0
"""Log odds that a body loses which a shadow explains as well (chosen: it has e times the evidence
where it is none)."""
_STEADY, _STEADY_FRACTION = 4.0, 0.8
"""Squared standard deviations within which a pixel shows the scene before contact, and minimum
fraction of the approach in which it does where that scene is known (chosen)."""
_LIT_RADII = 2.0
"""Ball radii over which the light of a shadow of something out of view is even (chosen)."""
_FAINT, _LIT, _MIXED = 0.25, 0.3, 0.5
"""Fractions: of a body's usual log odds, less than which is no part of it; of a pixel's log odds
that a shadow leaves where it is none; and of a body that is no shadow, from which on the rest is
taken for its shadow (chosen)."""
_PIVOTS = 2.5 * 1.6 ** np.arange(6)
_RATES = 0.4 * 1.22 ** np.arange(6)
_TILTS = np.deg2rad([-15.0, 0.0, 15.0])
"""Grid of the first search: pivots in ball radii from the point of contact, speeds over the ball's,
and tilts of the arm (chosen: steps that leave half of the evidence between them)."""
_REFINED, _REFINEMENTS = 2, 3
"""Number of first guesses that are refined, and of rounds (chosen)."""


@dataclass(frozen=True)
class SwingPrior:
    """What is known of a strike before it is seen; fitted by `training/fit_striker.py`.

    Attributes
    ----------
    speed, pivot, tilt : (float, float)
        Centre and scale: log speed of the body over the ball's, log distance of the pivot from the
        point of contact in ball radii, and tilt of the arm in rad.
    face : (float, float)
        Distance of the body from the point of contact beyond the way that it has to go, ball radii.
    """

    speed: tuple[float, float]
    pivot: tuple[float, float]
    tilt: tuple[float, float]
    face: tuple[float, float]

    def log_odds(self, motion: FloatArray) -> float:
        """Log prior of tilt, log pivot distance and log speed (heavy-tailed: Cauchy's)."""
        terms = zip(motion, (self.tilt, self.pivot, self.speed), strict=True)
        return -sum(math.log1p(((one - middle) / scale) ** 2) for one, (middle, scale) in terms)


@cache
def swing_prior() -> SwingPrior:
    """The prior as it was fitted."""
    text = resources.files("vision.pendulum").joinpath("swing_prior.json").read_text("utf-8")
    fitted = json.loads(text)["fitted"]
    names = ("speed", "pivot", "tilt", "face")
    return SwingPrior(*((fitted[name]["centre"], fitted[name]["scale"]) for name in names))


@dataclass(frozen=True)
class SwungBody:
    """A body that may strike the ball.

    Attributes
    ----------
    frame : int
        Frame in which its patch was cut out.
    patch : Patch
        Its appearance.
    swing : ImagedSwing
        Its arc; angle 0 is that frame.
    angles : dict of int to float
        Its angle in frames of the approach, rad.
    log_odds : float
        Evidence for it, up to a constant of the clip.
    gray : float
        Fraction of the squared contrast that lightness alone gives.
    colour : (2,) array
        Direction of the contrast in the plane of C_B and C_R.
    with_arm : bool
        Whether the patch holds its arm, too; the middle is that of the body alone.
    """

    frame: int
    patch: Patch
    swing: ImagedSwing
    angles: dict[int, float]
    log_odds: float
    gray: float
    colour: FloatArray
    with_arm: bool = False


@dataclass(frozen=True)
class _Approach:
    """Pictures before contact at the working size, and how unlike the scene they are.

    Attributes
    ----------
    scale : float
        Working over full size.
    frames : (n,) int array
    layers : list of (h, w, 5) float32 arrays
        Three colours in standard deviations of noise, misfit of the scene, and whether in view.
    behind : (h, w, 3) float32 array
        The scene without the body, in the same units.
    noise : (3,) array
        That unit, gray levels.
    """

    scale: float
    frames: NDArray[np.int64]
    layers: list[FloatImage]
    behind: FloatImage
    noise: FloatArray

    def reduced(self, by: float) -> "_Approach":
        """The same at a smaller size."""

        def small(image: FloatImage) -> FloatImage:
            # OpenCV resizes four channels at most
            parts = [image[..., :3], image[..., 3:]] if image.shape[2] > 4 else [image]
            return np.dstack(
                [cv2.resize(one, None, fx=by, fy=by, interpolation=cv2.INTER_AREA) for one in parts]
            )

        layers = [small(one) for one in self.layers]
        return _Approach(self.scale * by, self.frames, layers, small(self.behind), self.noise)


def _even(first: int, last: int, count: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(first, max(last, first), count).round().astype(np.int64))


def _approach(scene: FilmedScene, rest: Rest, radius: float) -> _Approach:
    """Read the pictures, once, in colour."""
    height, width = scene.shape
    scale = min(1.0, _WIDTH_PX / width, _RADIUS_PX / radius)
    size = (max(round(width * scale), 2), max(round(height * scale), 2))
    before = max(rest.last - rest.frames_along(_CONTACT, radius), 0)
    back = rest.frames_along(_APPROACH_RADII, radius, _APPROACH_PICTURES - 2)
    frames = scene.shown(_even(max(before - back, 0), before, _APPROACH_PICTURES))
    still = scene.shown(_even(rest.first, before, _SCENE_PICTURES))
    whole = scene.shown(_even(0, scene.count - 1, _SCENE_PICTURES))
    late = scene.shown(_even(round(0.75 * scene.count), scene.count - 1, _SCENE_PICTURES // 2))
    pictures: dict[int, FloatImage] = {}
    every = np.unique(np.concatenate([frames, still, whole, late]))
    for index, image in scene.coloured_small(every, size):
        even = image.astype(np.float32) / np.float32(scene.views[index].gain)
        pictures[index] = np.asarray(cv2.transform(even, _COLOURS), dtype=np.float32)
    usual, early, end = (
        median_of([pictures[index] for index in some.tolist()]) for some in (whole, still, late)
    )
    off = np.abs(np.stack([pictures[index] for index in whole.tolist()]) - usual)
    # a turned picture is interpolated, and a body's light changes a little on its way
    usual_off = np.array([np.median(off[..., colour]) for colour in range(3)], dtype=np.float32)
    noise = 1.5 * np.maximum(1.4826 * usual_off, 0.7) + 1.0
    usual, early, end = (np.asarray(one / noise, dtype=np.float32) for one in (usual, early, end))
    shown = [np.asarray(pictures[index] / noise, dtype=np.float32) for index in frames.tolist()]
    # a slow body may hide the scene for most of the time before; the rest of the clip shows it
    steady = np.mean([_square(one - early) < _STEADY for one in shown], axis=0)
    unlike = _square(early - usual) > _MAX_SQUARE
    hidden = unlike & (_square(usual - end) < _STEADY) & (steady < _STEADY_FRACTION)
    behind = np.where(hidden[..., None], usual, early)
    # and a body that hangs there for long is no scene
    hung = unlike & (_square(early - end) < _STEADY)
    usual = np.where(hung[..., None], early, usual)
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    centre = (rest.centre_px + 0.5) * scale - 0.5
    free = np.hypot(x - centre[0], y - centre[1]) > radius * scale + 1.0
    layers = []
    for colours in shown:
        lit = behind * _light(colours, behind, radius * scale)[..., None]
        misfits = [_square(colours - one) for one in (behind, usual, lit)]
        misfit = np.minimum(np.min(misfits, axis=0), _MAX_SQUARE)
        layers.append(np.dstack([colours, misfit, free]).astype(np.float32))
    return _Approach(scale, frames, layers, behind, noise)


def _square(colours: FloatImage) -> FloatImage:
    """Sum of the squares of three colours; twenty times as fast as a sum over so short an axis."""
    one, two, three = np.moveaxis(colours, -1, 0)
    return np.asarray(one * one + two * two + three * three)


def _light(colours: FloatImage, scene: FloatImage, radius: float) -> FloatImage:
    """Light of a picture over that of the scene, even over more than a body covers."""
    ratio = np.clip(100.0 * colours[..., 0] / np.maximum(scene[..., 0], 1.0), 0.0, 255.0)
    size = 2 * max(round(_LIT_RADII * radius), 1) + 1
    return np.asarray(cv2.medianBlur(ratio.astype(np.uint8), size).astype(np.float32) / 100.0)


@dataclass(frozen=True)
class _MotionEvidence:
    """Log odds of a swinging body over the scene alone for one motion.

    Attributes
    ----------
    odds : (h, w) float32 array
        Of each pixel of the region, in the picture at contact.
    body : (h, w) bool array
        The body.
    total : float
        Sum over the body, less what it would cover of the ball.
    """

    odds: FloatImage
    body: BoolArray
    total: float


class _Region:
    """The part of the picture behind the ball at contact, and motions of a body through it.

    A motion is the tilt of the arm, rad, and the logs of the pivot's distance from the point of
    contact in ball radii and of the body's speed over the ball's.
    """

    def __init__(
        self, approach: _Approach, rest: Rest, radius: float, at: tuple[float, float] | None
    ) -> None:
        self.approach, self.rest = approach, rest
        scale = approach.scale
        self.before_last = rest.frames_along(_BEFORE_LAST, radius)
        self.radius, self.speed = radius * scale, rest.speed_px * scale
        self.centre = (rest.centre_px + 0.5) * scale - 0.5
        self.contact = self.centre - self.radius * rest.direction
        along = rest.direction
        across = np.array([along[1], -along[0]])
        self.up = across if across[1] < 0 else -across
        ends = [(1.0, _BESIDE), (1.0, -_BESIDE), (-_BEHIND, _BESIDE), (-_BEHIND, -_BESIDE)]
        corners = self.centre + self.radius * np.array(ends) @ np.array([along, across])
        low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
        x, y = np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1)
        self.x, self.y = (np.asarray(one, dtype=np.float32) for one in np.meshgrid(x, y))
        self.from_ball = np.hypot(self.x - self.centre[0], self.y - self.centre[1]) - self.radius
        self.within = self.from_ball < -1.5
        self.from_contact = np.hypot(self.x - self.contact[0], self.y - self.contact[1])
        target = self.contact if at is None else (np.array(at) + 0.5) * scale - 0.5
        self.from_target = np.hypot(self.x - target[0], self.y - target[1])
        behind = (self.x - self.centre[0]) * along[0] + (self.y - self.centre[1]) * along[1] < 0.0
        if at is None:
            self.from_target = np.where(behind, np.maximum(self.from_ball, 0.0), np.inf)

    def pivot_and_rate(self, motion: FloatArray) -> tuple[FloatArray, float]:
        """Pivot, px of the working picture, and rate, rad per frame from +x towards +y."""
        cosine, sine = math.cos(motion[0]), math.sin(motion[0])
        arm = np.array([[cosine, -sine], [sine, cosine]]) @ self.up
        length = math.exp(motion[1]) * self.radius
        turned = np.array([arm[1], -arm[0]]) @ self.rest.direction
        return self.contact + length * arm, math.copysign(
            math.exp(motion[2]) * self.speed / length, turned
        )

    def turned_back(self, motion: FloatArray, images: list[FloatImage]) -> Iterator[FloatImage]:
        """Pictures of the approach turned to where the body is at contact."""
        pivot, rate = self.pivot_and_rate(motion)
        x, y = self.x - np.float32(pivot[0]), self.y - np.float32(pivot[1])
        for frame, image in zip(self.approach.frames.tolist(), images, strict=True):
            angle = rate * (frame - self.rest.last + self.before_last)
            cosine, sine = np.float32(math.cos(angle)), np.float32(math.sin(angle))
            u = np.float32(pivot[0]) + cosine * x - sine * y
            v = np.float32(pivot[1]) + sine * x + cosine * y
            turned = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
            yield np.asarray(turned, dtype=np.float32)

    def evidence(self, motion: FloatArray) -> _MotionEvidence:
        """Compare the body with the scene for one motion."""
        seen = np.stack(list(self.turned_back(motion, self.approach.layers)))
        weight = (seen[..., 4] > _IN_VIEW).astype(np.float32)
        colour = _mean(seen[..., :3], weight)
        left = np.minimum(_square(seen[..., :3] - colour), _MAX_SQUARE)
        odds = 0.5 * ((seen[..., 3] - left) * weight).sum(axis=0) - _FREE_COLOURS
        odds = np.where(weight.mean(axis=0) >= _MIN_VISIBLE, odds, np.float32(0.0))
        odds = np.asarray(cv2.blur(odds, (3, 3)))
        body, total = self._body(odds)
        return _MotionEvidence(odds, body, total - float(np.maximum(odds, 0.0)[self.within].sum()))

    def _body(self, odds: FloatImage) -> tuple[BoolArray, float]:
        """The connected pixels with most evidence that reach the target."""
        likely = (odds > _MIN_LOG_ODDS) & ~self.within
        count, labels = cv2.connectedComponents(likely.astype(np.uint8))
        near = np.unique(labels[likely & (self.from_target < _NEAR * self.radius)])
        if len(near) == 0:
            return np.zeros(odds.shape, dtype=bool), 0.0
        sums = np.bincount(labels.ravel(), odds.ravel(), count)
        best = int(near[np.argmax(sums[near])])
        return np.asarray(labels == best), float(sums[best])

    def gap(self, motion: FloatArray, body: BoolArray) -> float:
        """Distance of a body from the point of contact beyond the way it had to go, ball radii."""
        ahead = math.exp(motion[2]) * self.speed * self.before_last
        return (float(self.from_contact[body].min()) - ahead) / self.radius

    def log_odds(self, motion: FloatArray, prior: SwingPrior) -> float:
        """Log odds of a motion; evidence counts by its log, since pixels share their errors."""
        evidence = self.evidence(motion)
        if not evidence.body.any() or evidence.total <= 1.0:
            return -math.inf
        off = (self.gap(motion, evidence.body) - prior.face[0]) / prior.face[1]
        face = math.log1p(off * off)
        return math.log(evidence.total) + prior.log_odds(motion) - face

    def _shown(self, motion: FloatArray) -> tuple[FloatImage, FloatImage, FloatImage]:
        """Pictures turned back, the scene behind them likewise, and which pixels are in view."""
        seen = np.stack(list(self.turned_back(motion, self.approach.layers)))
        early = [self.approach.behind] * len(seen)
        behind = np.stack(list(self.turned_back(motion, early)))
        return seen, behind, (seen[..., 4] > _IN_VIEW).astype(np.float32)

    def beyond_shadow(self, motion: FloatArray) -> FloatImage:
        """Log odds of a body over a shadow: the scene dimmed evenly by one ratio, by pixel."""
        seen, behind, weight = self._shown(motion)
        colour = _mean(seen[..., :3], weight)
        left = np.minimum(_square(seen[..., :3] - colour), _MAX_SQUARE)
        product = ((seen[..., :3] * behind).sum(axis=3) * weight).sum(axis=0)
        square = (_square(behind) * weight).sum(axis=0)
        ratio = np.clip(product / np.maximum(square, 1e-6), 0.0, 1.0)
        dimmed = _square(seen[..., :3] - ratio[..., None] * behind)
        shadow = np.minimum(np.minimum(dimmed, seen[..., 3]), _MAX_SQUARE)
        return np.asarray(cv2.blur(0.5 * ((shadow - left) * weight).sum(axis=0), (3, 3)))

    def contrast(self, motion: FloatArray, body: BoolArray) -> tuple[float, FloatArray]:
        """Fraction of the squared contrast in lightness, and the direction of that in colour."""
        seen, behind, weight = self._shown(motion)
        apart = (_mean(seen[..., :3], weight) - _mean(behind, weight))[body].astype(np.float64)
        square = apart.T @ apart
        gray = float(square[0, 0] / max(float(np.trace(square)), 1e-9))
        axis = np.linalg.eigh(square[1:, 1:])[1][:, 1]
        levels = np.linalg.inv(_COLOURS) @ np.array([0.0, *(axis * self.approach.noise[1:])])
        light = _COLOURS[0] @ levels
        colour = np.array([(levels[0] - light) / 1.772, (levels[2] - light) / 1.402])
        return gray, colour / max(float(np.hypot(*colour)), 1e-9)


def _mean(colours: FloatImage, weight: FloatImage) -> FloatImage:
    """Colour (h, w, 3) over pictures (n, h, w, 3) in which it is in view."""
    total = (colours * weight[..., None]).sum(axis=0)
    return np.asarray(total / np.maximum(weight.sum(axis=0), 1.0)[..., None])


def propose_bodies(
    scene: FilmedScene, rest: Rest, radius: float, at: tuple[float, float] | None = None
) -> tuple[SwungBody, ...]:
    """Propose bodies that swing into the resting ball.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.
    radius : float
        Ball radius, px.
    at : tuple of float, optional
        A point on the body just before contact, px, where the user gave one.

    Returns
    -------
    tuple of SwungBody
        Most probable first; empty if nothing swings towards the ball.
    """
    if rest.last < _MIN_APPROACH:
        return ()
    prior = swing_prior()
    approach = _approach(scene, rest, radius)
    if len(approach.frames) < _MIN_APPROACH:
        return ()
    fine = _Region(approach, rest, radius, at)
    by = min(_COARSE_RADIUS_PX / fine.radius, 1.0)
    coarse = fine if by == 1.0 else _Region(approach.reduced(by), rest, radius, at)
    grid = np.array(
        [(a, math.log(b), math.log(c)) for a in _TILTS for b in _PIVOTS for c in _RATES]
    )
    odds = np.array([coarse.log_odds(motion, prior) for motion in grid])
    found: list[tuple[float, FloatArray, _MotionEvidence]] = []
    for motion in _distinct(grid, odds):
        best = _refined(fine, motion, prior)
        evidence = fine.evidence(best)
        if not evidence.body.any():
            continue
        beyond = np.maximum(fine.beyond_shadow(best), 0.0)[evidence.body].sum()
        alike = 1.0 - float(beyond / np.maximum(evidence.odds, 0.0)[evidence.body].sum())
        value = fine.log_odds(best, prior) - _AS_SHADOW * max(alike, 0.0)
        if not any(_same(evidence.body, other.body) for _, _, other in found):
            found.append((value, best, evidence))
    found.sort(key=lambda one: -one[0])
    cut: list[SwungBody] = []
    for value, motion, evidence in found:
        head = _head(fine, motion, evidence)
        for part, with_arm in ((head, False), (head | evidence.body, True)):
            one = _cut_out(scene, fine, motion, head, part)
            if one is not None:
                cut.append(replace(one, log_odds=value, with_arm=with_arm))
    return tuple(cut)


def face_gap(scene: FilmedScene, rest: Rest, radius: float, motion: FloatArray) -> float | None:
    """Distance of the body of a known motion from the point of contact beyond its way, radii.

    Parameters
    ----------
    radius : float
        Ball radius, px.
    motion : (3,) array
        Tilt, log pivot distance and log speed, as in `SwingPrior`.

    Returns
    -------
    float or None
        None where no body shows in that motion.
    """
    region = _Region(_approach(scene, rest, radius), rest, radius, None)
    body = region.evidence(motion).body
    return region.gap(motion, body) if body.any() else None


def _distinct(grid: FloatArray, odds: FloatArray) -> list[FloatArray]:
    """The best motions of a grid that are not next to a better one."""
    steps = np.array([_TILTS[1] - _TILTS[0], math.log(1.6), math.log(1.22)])
    kept: list[FloatArray] = []
    for place in np.argsort(-odds):
        apart = [np.abs((grid[place] - one) / steps)[1:].max() for one in kept]
        if min(apart, default=np.inf) > 1.5:
            kept.append(grid[place])
        if len(kept) == _REFINED:
            break
    return kept


def _refined(region: _Region, motion: FloatArray, prior: SwingPrior) -> FloatArray:
    """Climb to the most probable motion, one coordinate after the other, by parabolas."""
    best, value = motion.copy(), region.log_odds(motion, prior)
    steps = np.array([_TILTS[1] - _TILTS[0], math.log(1.6), math.log(1.22)]) / 2.0
    for _ in range(_REFINEMENTS):
        for axis in (2, 1, 0):
            step = np.eye(3)[axis] * steps[axis]
            low, high = (region.log_odds(best + side * step, prior) for side in (-1.0, 1.0))
            bend = low - 2.0 * value + high
            move = 0.5 * (low - high) / bend if bend < -1e-9 else float(np.sign(high - low))
            for trial in (best + float(np.clip(move, -1.0, 1.0)) * step, best - step, best + step):
                there = region.log_odds(trial, prior)
                if there > value:
                    best, value = trial, there
                    break
        steps /= 2.0
    return best


def _same(one: BoolArray, other: BoolArray) -> bool:
    return bool((one & other).sum() > 0.5 * min(one.sum(), other.sum()))


def _head(region: _Region, motion: FloatArray, evidence: _MotionEvidence) -> BoolArray:
    """The thick part of a body that is next to the ball, without its arm and its shadow."""
    body, odds = evidence.body, evidence.odds
    near = body & (region.from_target < _NEAR * region.radius)
    body = body & (odds > _FAINT * float(np.percentile(odds[near], 90.0)))
    lit = body & (region.beyond_shadow(motion) > _LIT * odds)
    if odds[lit].sum() > _MIXED * odds[body].sum():
        body = lit
    return thick_part(body, np.exp(-np.minimum(region.from_target / region.radius, 50.0)))


def _disc(size: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)


def _cut_out(
    scene: FilmedScene, region: _Region, motion: FloatArray, head: BoolArray, part: BoolArray
) -> SwungBody | None:
    """The body at full size in the last frame of the approach in which it is clear of the ball."""
    pivot, rate = region.pivot_and_rate(motion)
    x, y = region.x[part], region.y[part]
    rest, scale = region.rest, region.approach.scale
    frame, angle = int(region.approach.frames[0]), 0.0
    for frame in region.approach.frames[::-1].tolist():
        angle = rate * (frame - rest.last + region.before_last)
        spots = pivot + (np.column_stack([x, y]) - pivot) @ _turn(angle).T
        gap = np.hypot(*(spots - region.centre).T).min() - region.radius
        if gap > max(2.0 * scale, _CLEAR * region.radius):
            break
    else:
        return None
    corners = (np.array([spots.min(axis=0), spots.max(axis=0)]) + 0.5) / scale - 0.5
    margin = 2.0 / scale + 2.0
    limit = np.array(scene.shape[::-1]) - 1
    low = np.clip(np.floor(corners[0] - margin), 0, limit).astype(int)
    high = np.clip(np.ceil(corners[1] + margin), 0, limit).astype(int)
    if (high - low < 2).any():
        return None
    columns, rows = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    places = (np.stack([columns, rows], axis=-1) + 0.5) * scale - 0.5
    back = pivot + (places - pivot) @ _turn(-angle).T
    first = np.array([region.x[0, 0], region.y[0, 0]])
    u, v = np.moveaxis((back - first).astype(np.float32), -1, 0)
    covered = cv2.remap(part.astype(np.float32), u, v, cv2.INTER_LINEAR)
    middle = cv2.remap(head.astype(np.float32), u, v, cv2.INTER_LINEAR)
    around = cv2.dilate(covered, _disc(2 * round(margin) - 1)) > 0.0
    from_ball = np.linalg.norm(places - region.centre, axis=2)
    inside = around & (from_ball > region.radius + 2.0 * scale)
    if np.count_nonzero(covered[inside] > 0.5) < _MIN_PIXELS:
        return None
    weights, own = (one[inside].astype(np.float64) for one in (covered, middle))
    spot = np.column_stack([columns[inside], rows[inside]]).astype(np.float64)
    anchor = own @ spot / max(float(own.sum()), 1e-9)
    look = scene.picture(frame)[rows[inside], columns[inside]] / scene.views[frame].gain
    x, y = (spot - anchor).T
    patch = Patch(x, y, look.astype(np.float64), weights)
    swing = ImagedSwing((pivot + 0.5) / scale - 0.5, 0.0, 1.0, anchor, turns=True)
    angles = {one: rate * (one - frame) for one in region.approach.frames.tolist()}
    return SwungBody(frame, patch, swing, angles, 0.0, *region.contrast(motion, part))


def _turn(angle: float) -> FloatArray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])
