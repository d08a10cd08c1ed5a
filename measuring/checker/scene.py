"""Check rate, scale, ball, grid and distances against each other and gravity.

Each finding names the input at fault, the value with which everything fits, and the option that
sets it. All commands ask this module, so that the same input gives the same finding everywhere.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.grid import WallGrid
from calib.solve import FOCAL_OVER_WIDTH, LOG_FOCAL_STD
from measuring.checker.balance import Cause, Contradictory, Input, Relation, weigh
from measuring.checker.fall import Fall, find_fall
from measuring.checker.pace import SlowPart, find_slow_part
from metrology import Defaults
from metrology.quantity import format_value

__all__ = ["Finding", "SceneFacts", "equations_of", "findings_of", "upright"]

FloatArray = NDArray[np.float64]

_OUTLINE_STD_PX, _OUTLINE_STD = 0.35, 0.01
"""Std of an observed radius, px and relative (fitted: bench.inputs.wrong, clips with a known
set-up; blur and lighting enlarge small balls by up to 0.8 px)."""

_FALL_STD = 0.007
"""Relative std of a fall against g after its correction for drag (fitted: likewise)."""

_MAX_RISING_DRAG = 0.5
"""Fraction of a rising ball's acceleration that is the air's, at most (chosen: more would need a
scale or ball that is wrong by more than the linear equations can say)."""

_SLOW_STD_PX = 0.15
"""Std of slowly varying errors of a track, px (fitted: likewise, falls against grids of seven clips
differ by 0.17 px rms; more than in `calib.solve`, since the path is not fitted by a model here)."""

_WALL_STD, _WALL_STD_PER_TANGENT = 0.003, 0.06
"""Relative std of the wall's local scale at the ball: of lines in the picture (chosen: `calib`
finds them to 0.1 %, lenses bend by some tenths), and per tangent of the angle between the optical
axis and the wall's normal (fitted: training/fit_wall_scale.py, drawn cameras)."""

_RATIO_BOUNDS = (0.6, 1.0)
"""Distance of the ball's plane from the camera over that of the wall, where it was not measured
(derived: not behind the wall; chosen: not nearer than two fifths of the distance to it)."""

_USUAL_RATIO, _USUAL_RATIO_STD = 0.92, 0.07
"""That ratio as usual, with its relative std (chosen: half a metre in front of a wall 4 to 10 m
away)."""

_FPS = (24, 25, 30, 48, 50, 60, 90, 100, 120, 150, 180, 200, 240, 250, 300, 400, 420, 480, 500)
_USUAL = {
    "rate": (*map(float, _FPS), 600.0, 720.0, 960.0, 1000.0, 1200.0, 2000.0),
    "grid": (0.005, 0.01, 0.02, 0.025, 0.0254, 0.03, 0.04, 0.05, 0.0508, 0.1, 0.2),
}
"""Usual values, 1/s and m."""

_SIGMA, _USUAL_RELATIVE = 2.58, 0.05
"""Standard deviations (derived: the probability of 1 % at which the rest agrees, `balance`), and
relative difference or half a standard deviation, within which a usual value is proposed (derived: a
quarter of the way between usual pitches)."""

_MIN_SEEN = 10
"""Rows of a flight that is used (chosen)."""

_MAX_SLANT = 0.35
"""Horizontal over vertical acceleration of a fall (chosen: a camera rolled by 20°)."""

_ERRORS = (
    (0.5, "it may be the radius"),
    (math.pi, "it may be the circumference"),
    (10.0, "the unit may be cm instead of mm"),
    (0.1, "the unit may be mm instead of cm"),
)
"""Stated over true value of usual slips."""


@dataclass(frozen=True, eq=False)
class SceneFacts:
    """What is stated of a scene and what was seen in it.

    Attributes
    ----------
    frame : (N,) array
        Times of the ball, in pictures of the camera.
    centre_px : (N, 2) array
    radius_px : (N,) array or None
        Observed radius; None if it was not observed.
    flies : bool
        Whether the ball may fly freely in part of the track.
    rate : tuple of float or None
        Stated pictures per second with their std.
    ball : tuple of float or None
        Diameter with its std, m.
    scale : tuple of float or None
        m/px with its std.
    pitch_stated : bool
        False if its pitch is assumed.
    camera_distance, plane_offset : tuple of float or None
        With their std, m.
    drag : tuple of float or None
        Deceleration by the air over the square of the speed, with its std, 1/m.
    fall : tuple of float or None
        Acceleration of the free fall without air and perspective, with its std, px per picture
        squared at the median place; None if it is to be estimated from the track.
    """

    frame: FloatArray
    centre_px: FloatArray
    radius_px: FloatArray | None
    flies: bool
    rate: tuple[float, float] | None
    ball: tuple[float, float] | None
    scale: tuple[float, float] | None = None
    grid: WallGrid | None = None
    pitch_stated: bool = True
    pitch_relative_std: float = Defaults.GRID_PITCH.std
    camera_distance: tuple[float, float] | None = None
    plane_offset: tuple[float, float] | None = None
    drag: tuple[float, float] | None = None
    fall: tuple[float, float] | None = None


@dataclass(frozen=True)
class Finding:
    """A contradiction, or facts that are missing.

    Attributes
    ----------
    key : str
        The input at fault: "rate", "ball", "grid", "distance", "scale", "pace" (two speeds in one
        recording); "facts" if some are missing.
    sentence : str
        Cause and cure.
    option : str
        What sets the value: ``--wall-grid 50mm``.
    value, std : float or None
        With which everything fits, SI.
    cures : tuple of str
        Options of which each alone makes everything fit and is likely; `option` is the first.
    """

    key: str
    sentence: str
    option: str
    value: float | None = None
    std: float | None = None
    cures: tuple[str, ...] = ()


def findings_of(facts: SceneFacts) -> tuple[Finding, ...]:
    """Contradictions among the facts, each with cause and cure; empty if they agree."""
    slow = find_slow_part(facts.frame, facts.centre_px)
    if slow is not None:
        # with two clocks nothing else can be compared
        return (_two_clocks(slow, facts.frame),)
    facts = upright(facts)
    missing = _missing(facts, _fall(facts))
    if missing is not None:
        return (missing,)
    inputs, relations = equations_of(facts)
    found = weigh(inputs, relations)
    if found is None:
        return ()
    # the ball's plane is in front of the wall
    causes = [cause for cause in found.causes if cause.key != "ratio" or cause.value < 1.0]
    names = [relation.name for relation in relations]
    if not causes:
        return (_unresolved(found, [one for one in inputs if one.stated], names),)
    return (_joined(found, [_cure(cause, facts) for cause in causes], names),)


def _two_clocks(slow: SlowPart, frame: FloatArray) -> Finding:
    first, last = (round(float(frame[row])) for row in (slow.first, slow.last))
    if math.isinf(slow.factor):
        sentence = (
            f"Likely cause: frames {first} to {last} show one picture, frozen by an editor, and the"
            f" ball then goes on: cut frames {first + 1} to {last} out, and measure again."
        )
        return Finding("pace", sentence, "")
    sentence = (
        f"Likely cause: frames {first} to {last} are in slow motion, about {slow.factor:.1f} times"
        " slower than the rest: the recording was exported with two speeds, and no time across"
        " them holds. Export it again at one speed (in the telephone's editor, extend the slow"
        " motion over the whole clip), or cut out these frames and measure them alone with --fps"
        " RATE, the camera's rate in slow motion."
    )
    return Finding("pace", sentence, "--fps")


def upright(facts: SceneFacts) -> SceneFacts:
    """The facts as a camera at right angles to the wall would see them.

    The wall behind a plane parallel to it is a similar image of that plane, so that the grid's map
    removes perspective from the ball's path as well.
    """
    if facts.grid is None or not len(facts.centre_px):
        return facts
    seen = facts.grid.map
    middle = np.median(facts.centre_px, axis=0)
    here = seen.jacobian(middle)
    back = np.linalg.inv(here)
    place = middle + (seen(facts.centre_px) - seen(middle)) @ back.T
    radius = facts.radius_px
    if radius is not None:
        local = np.linalg.det(seen.jacobian(facts.centre_px)) / np.linalg.det(here)
        radius = radius * np.sqrt(np.abs(local))
    if not np.isfinite(place).all():
        return facts
    return replace(facts, centre_px=place, radius_px=radius)


def _unresolved(found: Contradictory, inputs: Sequence[Input], names: Sequence[str]) -> Finding:
    labels = [_PHRASES[one.key] for one in inputs]
    return Finding(
        "several",
        f"Likely cause: the inputs contradict each other (χ² {found.chi2:.0f} for"
        f" {found.degrees} excess equations of {_listed(names)}), and no single change makes them"
        f" fit. Check {_listed(labels)}, and that the ball was tracked.",
        "",
    )


_PHRASES = {
    "rate": "the capture rate (--fps)",
    "ball": "the ball's diameter (--ball)",
    "grid": "the grid's pitch (--wall-grid)",
    "scale": "the scale (--scale)",
    "ratio": "the distances in [camera] and [wall] of the setup file",
}


def _fall(facts: SceneFacts) -> Fall | None:
    if not facts.flies or len(facts.frame) < _MIN_SEEN:
        return None
    fall = find_fall(facts.frame, facts.centre_px)
    if fall is None:
        return None
    across, down = fall.acceleration
    return fall if down > 0.0 and abs(across) < _MAX_SLANT * down else None


def _missing(facts: SceneFacts, fall: Fall | None) -> Finding | None:
    """Facts without which there are neither metres nor seconds."""
    sized = facts.ball is not None and facts.radius_px is not None
    scaled = sized or facts.scale is not None or facts.grid is not None
    if facts.rate is not None or scaled:
        return None
    seen = []
    length, example = "--scale", "--scale '410 px/m'"
    if facts.radius_px is not None and len(facts.radius_px):
        seen.append(f"the ball is {2.0 * float(np.median(facts.radius_px)):.0f} px wide")
        length = "--ball"
        example = "--ball 220mm (instead of the ball: --wall-grid 50mm or --scale '410 px/m')"
    if fall is not None:
        falls = format_value(float(fall.acceleration[1]), fall.std, "px")
        seen.append(f"it falls with {falls} per picture squared")
    text = f" Seen: {' and '.join(seen)}." if seen else ""
    return Finding(
        "facts",
        "Two facts are missing: the camera's rate and one length. Pass both, for example --fps 240"
        f" {example}.{text}",
        f"--fps RATE {length} VALUE",
    )


def equations_of(facts: SceneFacts) -> tuple[list[Input], list[Relation]]:
    """What is stated, and the equations between it and what was seen."""
    fall = _fall(facts)
    inputs: list[Input] = []
    relations: list[Relation] = []
    if facts.rate is not None:
        inputs.append(Input("rate", facts.rate[0], max(facts.rate[1] / facts.rate[0], 1e-4)))
    if facts.scale is not None:
        inputs.append(Input("scale", facts.scale[0], max(facts.scale[1] / facts.scale[0], 1e-3)))
    rows = slice(None) if fall is None else slice(fall.first, fall.last + 1)
    if facts.ball is not None and facts.radius_px is not None:
        wide = 2.0 * float(np.median(facts.radius_px[rows]))
        inputs.append(Input("ball", facts.ball[0], max(facts.ball[1] / facts.ball[0], 1e-3)))
        std = math.hypot(_OUTLINE_STD, 2.0 * _OUTLINE_STD_PX / wide)
        relations.append(
            Relation("the ball's outline", {"scale": 1.0, "ball": -1.0}, 1.0 / wide, std)
        )
    if facts.grid is not None and len(facts.centre_px):
        inputs.append(Input("grid", facts.grid.pitch_m, facts.pitch_relative_std))
        inputs.append(_plane_ratio(facts))
        middle = np.median(facts.centre_px, axis=0)
        period = 1.0 / np.linalg.norm(facts.grid.map.jacobian(middle), axis=-1)
        tangent = math.sqrt(_axis_over_normal(facts.grid)[0] ** 2 - 1.0)
        relations.append(
            Relation(
                "the grid",
                {"scale": 1.0, "grid": -1.0, "ratio": -1.0},
                1.0 / float(np.sqrt(np.prod(period))),
                math.hypot(_WALL_STD, _WALL_STD_PER_TANGENT * tangent),
            )
        )
    if facts.fall is not None:
        size, std = facts.fall
        powers, known = {"scale": 1.0, "rate": 2.0}, Defaults.GRAVITY.known / size
        relations.append(Relation("free fall", powers, known, math.hypot(_FALL_STD, std / size)))
    elif fall is not None:
        size = float(np.hypot(*fall.acceleration))
        # another scale or ball slows it otherwise: to first order, a power of each
        slowed, slowed_std, metres, diameter = _drag_fraction(facts, fall)
        powers, known = {"scale": 1.0 + slowed, "rate": 2.0}, metres**slowed
        if diameter is not None:
            powers["ball"] = 2.0 * slowed
            known *= diameter ** (2.0 * slowed)
        half = 0.5 * float(facts.frame[fall.last] - facts.frame[fall.first])
        slow = 2.0 * _SLOW_STD_PX / half**2
        relations.append(
            Relation(
                "free fall",
                powers,
                known * Defaults.GRAVITY.known * (1.0 - slowed) / size,
                float(np.linalg.norm([_FALL_STD, slowed_std, fall.std / size, slow / size])),
            )
        )
    return inputs, relations


def _drag_fraction(facts: SceneFacts, fall: Fall) -> tuple[float, float, float, float | None]:
    """Fraction of g by which the air slows a fall, its std, and the m/px and ball at which it does.

    The fraction is negative for a rising ball.
    """
    rows = slice(fall.first, fall.last + 1)
    down = float(fall.acceleration[1])
    wide = None if facts.radius_px is None else 2.0 * float(np.median(facts.radius_px[rows]))
    # by the ball's outline or the stated scale, and by the fall itself
    points: list[tuple[float, float | None]] = []
    if facts.ball is not None and wide is not None:
        points.append((facts.ball[0] / wide, facts.ball[0]))
    elif facts.scale is not None:
        points.append((facts.scale[0], None))
    if facts.rate is not None:
        metres = Defaults.GRAVITY.known / down / facts.rate[0] ** 2
        points.append((metres, None if wide is None or facts.ball is None else wide * metres))
    if facts.drag is None or not points:
        return 0.0, 0.0, 1.0, None

    def pull(point: tuple[float, float | None]) -> float:
        metres, diameter = point
        if facts.ball is None or diameter is None:
            return metres
        return metres * (diameter / facts.ball[0]) ** 2

    # a wrong rate or ball exaggerates one of them
    metres, diameter = min(points, key=pull)
    frame, place = facts.frame[rows], facts.centre_px[rows]
    slope = np.polyfit(frame, place, 2)
    velocity = 2.0 * slope[0] * frame[:, np.newaxis] + slope[1]
    squared = float(np.mean(np.hypot(*velocity.T) * velocity[:, 1]))
    # over the fall seen, in px and pictures: neither the rate nor seconds are needed
    per_px = pull((metres, diameter)) / down * squared
    whole = 1.0 + max(facts.drag[0] * per_px, _MAX_RISING_DRAG - 1.0)
    return (whole - 1.0) / whole, facts.drag[1] * abs(per_px) / whole**2, metres, diameter


def _plane_ratio(facts: SceneFacts) -> Input:
    """Scale of the ball's plane over the wall's, 1 − z/Z, as measured or within its bounds."""
    unknown = Input("ratio", _USUAL_RATIO, _USUAL_RATIO_STD, stated=False, bounds=_RATIO_BOUNDS)
    if facts.camera_distance is None or facts.plane_offset is None:
        return unknown
    (far, far_std), (near, near_std) = facts.camera_distance, facts.plane_offset
    # measured along the optical axis; the planes' distances are at right angles to them
    longer, longer_std = _axis_over_normal(facts.grid)
    gap = near / far * longer
    ratio = 1.0 - gap
    if not 0.0 < ratio <= 1.0:
        return unknown
    std = gap * float(np.linalg.norm([near_std / near, far_std / far, longer_std / longer]))
    return Input("ratio", ratio, max(std / ratio, 1e-3))


def _axis_over_normal(grid: WallGrid | None) -> tuple[float, float]:
    """Distance to the wall along the optical axis over that at right angles to it, with its std.

    The area of a square in the picture falls with the third power of its depth, whose slope is the
    tangent of the angle over the focal length; the focal length is unknown.
    """
    if grid is None:
        return 1.0, 0.0
    middle, step = 0.5 * (np.array(grid.size) - 1.0), 0.05 * grid.size[0]
    ends = middle + step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    areas = np.log(np.abs(np.linalg.det(grid.map.jacobian(ends))))
    slope = np.hypot(areas[0] - areas[1], areas[2] - areas[3]) / (2.0 * step)
    tangent = float(slope) * FOCAL_OVER_WIDTH * grid.size[0] / 3.0
    longer = math.hypot(1.0, tangent)
    return longer, LOG_FOCAL_STD * tangent**2 / longer


_USUAL_VALUE, _PLAIN, _ODD = range(3)
"""Ranks of a cure: a usual value, an input without usual values, a value between usual ones."""


@dataclass(frozen=True)
class _Cure:
    cause: Cause
    label: str
    stated: str
    fits: str
    option: str
    rank: int
    slip: str

    @property
    def instead(self) -> str:
        return f"{self.fits} instead of {self.stated}"

    @property
    def in_words(self) -> str:
        if self.cause.key == "ratio":
            return f"{self.label} is wrong: {self.option}"
        return f"{self.label} is {self.instead}: {self.option}{self.slip}"


def _cure(cause: Cause, facts: SceneFacts) -> _Cure:
    value, usual = _usual(cause)
    near = [one for one in _USUAL.get(cause.key, ()) if abs(one - cause.value) < _SIGMA * cause.std]
    rank = _USUAL_VALUE if usual else _ODD if cause.key in _USUAL and not near else _PLAIN
    if cause.key == "rate":
        return _made(cause, "the capture rate", "fps", 1.0, f"--fps {value:.6g}", rank)
    if cause.key == "ball":
        return _made(cause, "the ball's diameter", "mm", 1e3, f"--ball {1e3 * value:.4g}mm", rank)
    if cause.key == "grid":
        label = "the wall grid" if facts.pitch_stated else "the wall grid, assumed"
        return _made(cause, label, "mm", 1e3, f"--wall-grid {1e3 * value:.4g}mm", rank)
    if cause.key == "scale":
        option = f"--scale '{1e3 * value:.4g} mm/px'"
        return _made(cause, "the scale", "mm/px", 1e3, option, rank)
    return _made(cause, _DISTANCES, "", 1.0, _distances(cause, facts), rank)


_DISTANCES = "one of the two distances (camera to wall, ball to wall)"


def _distances(cause: Cause, facts: SceneFacts) -> str:
    """Each distance with which everything fits, as in the set-up file, and its uncertainty."""
    assert facts.camera_distance is not None
    assert facts.plane_offset is not None
    near, far = facts.plane_offset[0], facts.camera_distance[0]
    gap = 1.0 - cause.value
    ball = format_value(far * gap, far * cause.std, "m")
    camera = format_value(near / gap, near / gap**2 * cause.std, "m")
    return (
        f'measure both again. distance_to_wall = "{camera}" in [camera] of the set-up file'
        f' (--camera-distance of calibrate), or ball_plane_offset = "{ball}" in [wall]'
        " (--ball-plane)"
    )


def _made(cause: Cause, label: str, unit: str, factor: float, option: str, rank: int) -> _Cure:
    stated = f"{factor * cause.stated:.4g} {unit}".strip()
    fits = f"{format_value(factor * cause.value, factor * cause.std, unit or '1')}"
    ratio = cause.stated / cause.value
    slips = [text for slip, text in _ERRORS if abs(math.log(ratio / slip)) < _USUAL_RELATIVE]
    slip = f" ({slips[0]})" if slips and cause.key == "ball" else ""
    return _Cure(cause, label, stated, fits, option, rank, slip)


def _usual(cause: Cause) -> tuple[float, bool]:
    """A usual value near the estimate, or the estimate itself."""
    near = [
        value
        for value in _USUAL.get(cause.key, ())
        if abs(value - cause.value) < max(_SIGMA * cause.std, 0.0)
        and abs(value - cause.value) < max(_USUAL_RELATIVE * cause.value, 0.5 * cause.std)
    ]
    if not near:
        return float(f"{cause.value:.3g}"), False
    return min(near, key=lambda value: abs(value - cause.value)), True


def _joined(found: Contradictory, cures: Sequence[_Cure], names: Sequence[str]) -> Finding:
    cures = sorted(cures, key=lambda cure: (cure.rank, cure.cause.chi2))
    # rates and pitches come in steps: a value between them is the last explanation
    odd = [cure for cure in cures if cure.rank == _ODD and cures[0].rank < _ODD]
    likely, best, others = cures[: len(cures) - len(odd)], cures[0], _listed(names)
    if len(likely) == 1:
        wanted = "another one" if best.cause.key == "ratio" else best.instead
        sentence = (
            f"Likely cause: {best.label} does not fit the rest ({others}). With {wanted}"
            f" everything fits (χ² {best.cause.chi2_before:.0f} → {best.cause.chi2:.0f}):"
            f" {best.option}{best.slip}."
        )
    else:
        choices = "; ".join(cure.in_words for cure in likely)
        sentence = (
            f"Likely cause: the inputs contradict each other (χ² {found.chi2:.0f} for"
            f" {found.degrees} excess equations of {others}). One change makes everything fit:"
            f" {choices}."
        )
    if odd:
        sentence += f" Less likely: {'; '.join(cure.in_words for cure in odd)}."
    cause, options = best.cause, tuple(one.option for one in likely)
    return Finding(cause.key, sentence, best.option, cause.value, cause.std, options)


def _listed(names: Sequence[str]) -> str:
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"
