"""Calibration session: calibrated scene, uncertainty, corner grid, files.

Where the wall grid is not found automatically, four handles on its crossings define its squares;
the image between them is rectified and searched for lines. Without lines the handles themselves
are the grid.
"""

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.calibration import BallOutlines, Calibration, Evidence, FreeFall, Known
from calib.grid import GridMap, WallGrid, find_wall_grid, refitted
from calib.lens import LENS_PARAMETERS, MIN_LENS_STD
from calib.solve import solve
from metrology import (
    CalibrationError,
    Contribution,
    Defaults,
    NotFoundError,
    SetupError,
    UncertaintySource,
    UsageError,
    measurands,
    read_number,
    refuse_unwritable,
    written_whole,
)
from pipelines.calibrate.wizard.answers import Answers, BallKind, BallSeen, WallSource, track_ball
from pipelines.checker.scene import SceneFacts, findings_of
from pipelines.measure.inputs import UNKNOWN_DRAG
from vision.clip.footage import nominal_rate_std

__all__ = [
    "Session",
    "compare_length",
    "grid_from_corners",
    "length_between",
    "lens_for",
    "outlook",
    "read_view",
    "save",
    "setup_text",
    "starting_corners",
    "with_ball",
    "with_corners",
    "with_grid",
]

FloatArray = NDArray[np.float64]

PLACE_STD_PX = 0.2
"""px: standard uncertainty of a tracked or assumed landing point (assumed)."""

CLICK_STD_PX = 0.5
"""px: standard uncertainty of a clicked position (assumed)."""

DEFAULT_GRAVITY = Known(Defaults.GRAVITY.known, Defaults.GRAVITY.std)

DRAG_RELATIVE_STD = 0.4
"""Relative uncertainty of the mean drag: 20 % of the default C_D, and the speed enters squared."""

UNKNOWN_DRAG_ACCELERATION = Known(0.1, 0.1)
"""m/s²: mean vertical drag deceleration of a ball of unknown mass (assumed)."""


@dataclass(frozen=True, eq=False)
class Outlook:
    """Results from the current answers.

    Attributes
    ----------
    calibration : Calibration or None
        None without data to calibrate with.
    distance : float or None
        From rest to landing on the ball plane, m.
    budget : tuple of Contribution
        Contributions to the uncertainty of `distance`, m, largest first.
    assumed : bool
        Whether the landing point is only assumed.
    problem : str
        Why there is no calibration; empty otherwise.
    warnings : tuple of str
    """

    calibration: Calibration | None
    distance: float | None = None
    budget: tuple[Contribution, ...] = ()
    assumed: bool = True
    problem: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def std(self) -> float | None:
        """Expected standard uncertainty of the landing distance, m."""
        if self.distance is None:
            return None
        return math.sqrt(sum(line.std**2 for line in self.budget))


@dataclass(frozen=True)
class Length:
    """A length between two clicked positions: value and standard uncertainty, m."""

    value: float
    std: float


def outlook(answers: Answers) -> Outlook:
    """Calibrate with all answers and propagate to the landing distance."""
    if answers.grid is None:
        return Outlook(None, problem="There is no wall grid yet: step 3.")
    prior = None if answers.lens is None else answers.lens.prior
    try:
        found = solve(answers.grid, evidence_of(answers), lens=prior).calibration
    except CalibrationError as problem:
        causes = [finding.sentence for finding in findings_of(facts_of(answers))]
        return Outlook(None, problem=" ".join([*causes, problem.in_one_line]))
    landing, seen = answers.landing
    rest = answers.rest
    start = np.zeros(2) if rest is None else found.position(rest)[0]

    def landing_x(c: Calibration) -> float:
        return float(c.position(landing)[0][0])

    distance = abs(landing_x(found) - float(start[0]))
    if not math.isfinite(distance):
        return Outlook(found, problem="The line of sight to the landing point misses the wall.")
    noise = found.position(landing, _landing_noise(answers))[1]
    lines = [
        *found.budget(landing_x),
        Contribution(UncertaintySource.BALL_CENTRE, math.sqrt(noise[0, 0])),
    ]
    shown = [line for line in lines if line.std > 0.0]
    shown.sort(key=lambda line: -line.std)
    causes = [finding.sentence for finding in findings_of(facts_of(answers))]
    warnings = (*causes, *found.warnings)
    return Outlook(found, distance, tuple(shown), not seen, warnings=warnings)


def facts_of(answers: Answers) -> SceneFacts:
    """The facts that the checker compares, as `measure` has them from clip and setup file."""
    flight = None if answers.seen is None else answers.seen.flight
    empty = np.zeros(0)
    fps = answers.capture_fps
    ball, far, near = answers.ball, answers.camera_distance, answers.ball_plane_offset
    return SceneFacts(
        frame=empty if flight is None else flight.frame.astype(float),
        centre_px=np.zeros((0, 2)) if flight is None else flight.centre_px,
        radius_px=None if flight is None else flight.radius_px,
        flies=flight is not None,
        rate=(fps, nominal_rate_std(fps)) if answers.rate_known else None,
        ball=None if ball is None else (ball.diameter, Defaults.BALL_DIAMETER.std * ball.diameter),
        grid=answers.grid,
        camera_distance=None if far is None else (far.value, far.std),
        plane_offset=None if near is None else (near.value, near.std),
        drag=_drag_per_metre(ball),
    )


def _drag_per_metre(ball: BallKind | None) -> tuple[float, float]:
    """Deceleration by the air over the square of the speed, with its std, 1/m."""
    if ball is None or ball.mass is None:
        return UNKNOWN_DRAG, UNKNOWN_DRAG
    area = math.pi * ball.diameter**2 / 4.0
    drag = Defaults.DRAG_COEFFICIENT
    per_coefficient = 0.5 * Defaults.AIR_DENSITY.known * area / ball.mass
    return drag.known * per_coefficient, drag.std * per_coefficient


def evidence_of(answers: Answers) -> Evidence:
    """Information besides the grid."""
    evidence = Evidence(
        rest_px=answers.rest,
        camera_distance=answers.camera_distance,
        ball_plane_offset=answers.ball_plane_offset,
    )
    ball = answers.ball
    if ball is None:
        return evidence
    radius = 0.5 * ball.diameter
    height = 0.0 if answers.support_height is None else answers.support_height + radius
    evidence = replace(
        evidence, ball_radius=radius, rest_height=height, outlines=_outlines(answers)
    )
    if evidence.taped or not answers.rate_known:
        return evidence
    return replace(evidence, fall=_fall(answers))


def _outlines(answers: Answers) -> BallOutlines | None:
    flight = None if answers.seen is None else answers.seen.flight
    if flight is None or answers.ball is None:
        return None
    diameter = answers.ball.diameter
    return BallOutlines.followed(
        flight.centre_px,
        flight.radius_px,
        flight.radius_std_px,
        Known(diameter, Defaults.BALL_DIAMETER.std_of(diameter)),
    )


def _fall(answers: Answers) -> FreeFall | None:
    """The flight as free fall, corrected for mean drag."""
    flight = None if answers.seen is None else answers.seen.flight
    if flight is None or answers.ball is None:
        return None
    # tracking used the earlier rate; only the product of rate and time matters
    time = flight.frame / answers.capture_fps
    drag = _drag(answers, time)
    by_rate = (
        2.0 * DEFAULT_GRAVITY.value * nominal_rate_std(answers.capture_fps) / answers.capture_fps
    )
    std = math.hypot(DEFAULT_GRAVITY.std, drag.std, by_rate)
    across = np.sqrt(np.einsum("nii->n", flight.covariance_px2) / 2.0)
    return FreeFall(flight.centre_px, time, across, Known(DEFAULT_GRAVITY.value - drag.value, std))


def _drag(answers: Answers, time: FloatArray) -> Known:
    ball, seen = answers.ball, answers.seen
    assert ball is not None
    assert seen is not None
    assert seen.flight is not None
    if ball.mass is None:
        return UNKNOWN_DRAG_ACCELERATION
    metres = 0.5 * ball.diameter / float(np.median(seen.flight.radius_px))
    path = seen.flight.centre_px * metres
    mean = (path[-1] - path[0]) / (time[-1] - time[0])
    taken = _drag_per_metre(ball)[0] * float(np.hypot(*mean)) * float(mean[1])
    return Known(taken, DRAG_RELATIVE_STD * abs(taken) + 0.01)


def _landing_noise(answers: Answers) -> FloatArray:
    clicked = answers.landing_px is not None
    return (CLICK_STD_PX if clicked else PLACE_STD_PX) ** 2 * np.eye(2)


def length_between(
    calibration: Calibration, first: FloatArray, second: FloatArray, *, on_wall: bool
) -> Length:
    """A length between two positions in the image, on the wall or on the ball plane.

    Parameters
    ----------
    calibration : Calibration
    first, second : (2,) array
        Px.
    on_wall : bool
        Whether on the wall rather than on the ball plane.
    """
    px = np.stack([first, second])

    def length(c: Calibration, at: FloatArray = px) -> float:
        camera = c.grid_camera
        ends = camera.to_plane(at, 0.0 if on_wall else c.ball_plane_offset)
        return float(np.hypot(*(ends[1] - ends[0])))

    systematic = sum(line.std**2 for line in calibration.budget(length))
    clicks = 0.0
    for step in np.eye(4).reshape(4, 2, 2):
        slope = length(calibration, px + 0.5 * step) - length(calibration, px - 0.5 * step)
        clicks += (CLICK_STD_PX * slope) ** 2
    return Length(length(calibration), math.sqrt(systematic + clicks))


MAX_LENGTH_DEVIATION = 3.0
"""Standard deviations: 0.3 % of correct lengths deviate by more."""


@dataclass(frozen=True)
class LengthComparison:
    """Comparison with a known length.

    Attributes
    ----------
    text : str
    disagrees : bool
        Whether it contradicts the calibration.
    """

    text: str
    disagrees: bool = False


def compare_length(
    calibration: Calibration, first: FloatArray, second: FloatArray, known: str, *, on_wall: bool
) -> LengthComparison:
    """Measure between two positions and compare with a known length.

    Parameters
    ----------
    calibration : Calibration
    first, second : (2,) array
        Px.
    known : str
        The length as entered; empty for none.
    on_wall : bool
        Otherwise on the ball's plane.
    """
    length = length_between(calibration, first, second, on_wall=on_wall)
    plane = "on the wall" if on_wall else "on the ball's plane"
    if not np.isfinite(length.value):
        return LengthComparison("The line of sight to one end misses the wall.", disagrees=True)
    text = f"{length.value:.4f} ± {length.std:.4f} m between the ends, {plane}."
    if not known.strip():
        return LengthComparison(text)
    try:
        true = read_number(known, measurands.DISTANCE)
    except UsageError as problem:
        return LengthComparison(f"{text} {problem.in_one_line}", disagrees=True)
    off = length.value - true
    ratio = abs(off) / length.std
    agrees = (
        "agrees"
        if ratio < MAX_LENGTH_DEVIATION
        else "disagrees: check the grid's pitch and the ends"
    )
    return LengthComparison(
        f"{text} {1e3 * off:+.1f} mm off, {ratio:.1f} standard deviations: {agrees}.",
        ratio >= MAX_LENGTH_DEVIATION,
    )


HANDLE_STD_PX = 0.7
"""px: standard uncertainty of a handle set with the loupe (assumed: half a pixel to one)."""

SQUARE_PX = (32, 60)
"""px per square of the rectified image, smallest and largest: below, fine lines of a tenth alias;
above, it is slow."""

MAX_RECTIFIED_PX = 1400
"""px: largest side of the rectified image (chosen; walls rarely need more)."""

RATIOS = (1, 2, 4, 5, 10)
"""Fine squares per coarse one: common divisions of rulers and grids."""

MAX_RATIO_ERROR = 0.05
"""Relative difference of the measured ratio from the nearest of `RATIOS`; neighbours differ by at
least 20 %."""


def starting_corners(grid: WallGrid | None, size: tuple[int, int]) -> FloatArray:
    """Initial handles, (4, 2): on crossings of the grid, or else inside the image."""
    box = np.array([[0.2, 0.8], [0.8, 0.8], [0.8, 0.2], [0.2, 0.2]]) * (np.array(size) - 1.0)
    if grid is None:
        return box
    used: list[int] = []
    for corner in box:
        far = np.linalg.norm(grid.points_px - corner, axis=1)
        far[used] = np.inf
        used.append(int(np.argmin(far)))
    return np.asarray(grid.points_px[used])


def grid_from_corners(
    picture: NDArray[np.generic],
    corners: FloatArray,
    squares: tuple[int, int],
    *,
    pitch_m: float,
    fine_pitch_m: float | None,
) -> tuple[WallGrid, WallSource]:
    """Measure the grid between four handles.

    Parameters
    ----------
    picture : (H, W) array
    corners : (4, 2) array
        Lower left, lower right, upper right, upper left, px.
    squares : tuple of int
        Squares between them, across and up.
    pitch_m, fine_pitch_m : float
        m.

    Returns
    -------
    WallGrid
        Its origin is the lower left handle.
    source : {"corners", "hand"}
        Whether lines were measured between the handles, or only the handles are used.

    Raises
    ------
    UsageError
        If the handles enclose no area in that order, or no square is between them.
    """
    wide, high = squares
    scale, warp = _straightening(corners, squares)
    height, width = picture.shape
    size = (int(wide * scale) + 1, int(high * scale) + 1)
    gray = np.asarray(picture, dtype=np.float32)
    straight = cv2.warpPerspective(gray, warp, size, flags=cv2.INTER_CUBIC)
    try:
        found = find_wall_grid(straight, pitch_m=pitch_m, fine_pitch_m=fine_pitch_m)
        ratio = _ratio(found, scale)
    except CalibrationError:
        return _by_hand(corners, squares, (width, height), pitch_m), "hand"
    found = replace(found, nodes=found.nodes + np.round(_origin_shift(found, scale)).astype(int))
    return _in_picture(found, warp, corners, (width, height), pitch_m / ratio), "corners"


def _straightening(corners: FloatArray, squares: tuple[int, int]) -> tuple[float, FloatArray]:
    """Px per square, and the homography (3, 3) that rectifies the image between the handles.

    Raises
    ------
    UsageError
        If the handles enclose no area in their order, or no square is between them.
    """
    wide, high = squares
    if wide < 1 or high < 1:
        raise UsageError("no square is between the handles", hint="Enter 1 or more squares.")
    turns = np.diff(np.vstack([corners, corners[:2]]), axis=0)
    cross = turns[:-1, 0] * turns[1:, 1] - turns[:-1, 1] * turns[1:, 0]
    if not (cross < -16.0).all():
        raise UsageError(
            "the four handles are out of order or in a line",
            hint="Order: lower left, lower right, upper right, upper left.",
        )
    sides = np.linalg.norm(turns, axis=1)
    per_square = float(max(sides[[0, 2]].max() / wide, sides[[1, 3]].max() / high))
    scale = float(np.clip(1.2 * per_square, *SQUARE_PX))
    scale = min(scale, MAX_RECTIFIED_PX / max(wide, high))
    flat = np.array([[0, high], [wide, high], [wide, 0], [0, 0]], dtype=np.float64) * scale
    warp = cv2.getPerspectiveTransform(corners.astype(np.float32), flat.astype(np.float32))
    return scale, np.asarray(warp, dtype=np.float64)


def _in_picture(
    found: WallGrid, warp: FloatArray, corners: FloatArray, size: tuple[int, int], pitch_m: float
) -> WallGrid:
    """Map a grid found in the rectified image to the original image."""
    width, height = size
    back = np.asarray(np.linalg.inv(warp), dtype=np.float64)
    jacobian = _jacobian(back, found.points_px)
    points = _moved(back, found.points_px)
    covariance = jacobian @ found.covariance_px2 @ np.swapaxes(jacobian, 1, 2)
    grid_map = _map_through(points, found.nodes.astype(np.float64), (width, height))
    area = np.zeros((height, width), dtype=np.uint8)
    cv2.fillConvexPoly(area, np.round(corners).astype(np.int32), 1)
    inverse = np.linalg.inv(grid_map.jacobian(points))
    residual = np.einsum("nij,nj->ni", inverse, grid_map(points) - found.nodes)
    return WallGrid(
        size=(width, height),
        pitch_m=pitch_m,
        nodes=found.nodes,
        points_px=points,
        covariance_px2=covariance,
        residual_px=residual,
        map=grid_map,
        area=area > 0,
        dark=found.dark,
        fine_ratio=found.fine_ratio,
        origin_m=np.zeros(2),
        warnings=found.warnings,
    )


def _ratio(found: WallGrid, scale: float) -> int:
    """Number of lines' squares per square entered."""
    middle = np.array(found.size) / 2.0
    period = 1.0 / np.linalg.norm(found.map.jacobian(middle), axis=1)
    ratio = scale / float(np.sqrt(period.prod()))
    best = min(RATIOS, key=lambda candidate: abs(np.log(ratio / candidate)))
    if abs(np.log(ratio / best)) > MAX_RATIO_ERROR:
        raise CalibrationError(
            "the lines between the handles do not match the number of squares entered",
            hint="Drag the handles onto crossings of the grid.",
        )
    return best


def _origin_shift(found: WallGrid, scale: float) -> FloatArray:
    """Shift of the nodes that makes the lower left handle (0, 0)."""
    corner = np.array([0.0, found.size[1] - 1.0])
    return -np.asarray(found.map(corner))


def _by_hand(
    corners: FloatArray, squares: tuple[int, int], size: tuple[int, int], pitch_m: float
) -> WallGrid:
    wide, high = squares
    nodes = np.array([[0, 0], [wide, 0], [wide, high], [0, high]])
    area = np.zeros(size[::-1], dtype=np.uint8)
    cv2.fillConvexPoly(area, np.round(corners).astype(np.int32), 1)
    return WallGrid(
        size=size,
        pitch_m=pitch_m,
        nodes=nodes,
        points_px=corners,
        covariance_px2=np.tile(HANDLE_STD_PX**2 * np.eye(2), (4, 1, 1)),
        residual_px=np.zeros((4, 2)),
        map=_homography(corners, nodes.astype(np.float64), size),
        area=area > 0,
        dark=True,
        fine_ratio=None,
        origin_m=np.zeros(2),
        warnings=(
            "no lines were found between the handles: the grid is as accurate as the four handles "
            "set by hand",
        ),
    )


def _homography(px: FloatArray, nodes: FloatArray, size: tuple[int, int]) -> GridMap:
    """Map from pixels to grid coordinates, a bare homography."""
    centre = (np.array(size) - 1.0) / 2.0
    scale = np.full(2, size[0] / 2.0)
    near = (px - centre) / scale
    matrix = np.asarray(cv2.findHomography(near, nodes)[0], dtype=np.float64)
    matrix = matrix / matrix[2, 2]
    parameters = np.concatenate([matrix[0], matrix[1], matrix[2, :2], np.zeros(2)])
    return GridMap(centre, scale, parameters)


def _map_through(px: FloatArray, nodes: FloatArray, size: tuple[int, int]) -> GridMap:
    """Map including the lens's distortion, through all crossings."""
    grid_map = _homography(px, nodes, size)
    weight = np.full(nodes.shape, 1e4)
    for _ in range(4):
        grid_map = refitted(grid_map, px, nodes - grid_map(px), weight)
    return grid_map


def _moved(matrix: FloatArray, px: FloatArray) -> FloatArray:
    lifted = np.c_[px, np.ones(len(px))] @ matrix.T
    return np.asarray(lifted[:, :2] / lifted[:, 2:])


def _jacobian(matrix: FloatArray, px: FloatArray) -> FloatArray:
    steps = [_moved(matrix, px + 0.5 * e) - _moved(matrix, px - 0.5 * e) for e in np.eye(2)]
    return np.stack(steps, axis=-1)


VIEW = "[view]"


@dataclass(frozen=True)
class Written:
    """Files that were written."""

    setup: Path
    lens: Path


def save(
    answers: Answers, outlook: Outlook, check: Callable[[str, Path], None] | None = None
) -> Written:
    """Write both files, or none.

    Parameters
    ----------
    answers : Answers
    outlook : Outlook
        Of these answers.
    check : callable, optional
        Called with the setup file's text and its folder; raises if the text is invalid.

    Raises
    ------
    UsageError
        If nothing is calibrated yet, or a file can't be written.
    """
    if answers.grid is None or outlook.calibration is None:
        raise UsageError(
            f"nothing is calibrated yet: {outlook.problem}",
            hint="Find the wall grid first."
            if answers.grid is None
            else "Correct that input; then save again.",
        )
    text = setup_text(answers, outlook)
    if check is not None:
        check(text, answers.out.parent)
    lens = lens_for(answers.out)
    lens_text = _lens_text(answers, outlook.calibration) + _view_text(answers.grid)
    refuse_unwritable(answers.out)
    # Both contents are on the disk before either file gets its name.
    with written_whole(lens) as lens_file, written_whole(answers.out) as setup_file:
        lens_file.write_text(lens_text, encoding="utf-8")
        setup_file.write_text(text, encoding="utf-8")
    return Written(answers.out, lens)


def lens_for(setup: Path) -> Path:
    """The lens file that belongs to a setup file."""
    return setup.parent / "lens.toml"


def setup_text(answers: Answers, outlook: Outlook) -> str:
    """Text of the setup file."""
    lines = [f"# Written by `vision calibrate {_comment(answers.scene.info.path.name)}`."]
    if outlook.std is not None and outlook.distance is not None:
        where = "assumed landing" if outlook.assumed else "landing"
        lines.append(
            f"# Expected: {where} {outlook.distance:.3f} m from rest, "
            f"± {1e3 * outlook.std:.1f} mm from the calibration."
        )
    lines += ["[camera]"]
    if answers.rate_known:
        lines.append(f"capture_fps = {answers.capture_fps!r}")
    else:
        lines.append("# capture_fps = 600   # unknown; every time and speed scales with it")
    if answers.camera_distance is not None:
        lines.append(f'distance_to_wall = "{_taped(answers.camera_distance)}"')
    if answers.lens is not None:
        lines.append('lens = "lens.toml"')
    else:
        lines += [
            "# The grid of each clip determines the lens. For clips that show less of the grid:",
            '# lens = "lens.toml"',
        ]
    lines += ["", "[wall]", f'grid = "{_millimetres(answers.pitch)}"']
    if answers.fine_pitch is not None:
        lines.append(f'fine_grid = "{_millimetres(answers.fine_pitch)}"')
    if answers.ball_plane_offset is not None:
        lines.append(f'ball_plane_offset = "{_taped(answers.ball_plane_offset)}"')
    if answers.ball is not None:
        lines += ["", "[ball]"]
        if answers.ball_named:
            lines.append(f'preset = "{answers.ball.name}"')
        else:
            lines.append(f'diameter = "{_millimetres(answers.ball.diameter)}"')
            if answers.ball.mass is not None:
                lines.append(f'mass = "{answers.ball.mass:g} kg"')
    if answers.support_height is not None:
        lines += ["", "[support]", f'height = "{answers.support_height:.10g} m"']
    return "\n".join(lines) + "\n"


def _comment(text: str) -> str:
    """Join to one line, for a comment."""
    return "".join(character if character.isprintable() else "?" for character in text)


def _millimetres(length: float) -> str:
    return f"{1e3 * length:.10g} mm"


def _taped(known: Known) -> str:
    return f"{known.value:.10g} m ± {1e3 * known.std:.6g} mm"


def _lens_text(answers: Answers, calibration: Calibration) -> str:
    if answers.lens is not None:
        return answers.lens.text.split(VIEW, 1)[0].rstrip() + "\n"
    lens = calibration.grid_camera.lens
    covariance = calibration.covariance[6:11, 6:11]
    std = np.maximum(np.sqrt(np.diag(covariance)), MIN_LENS_STD)
    related = covariance / np.outer(std, std)
    np.fill_diagonal(related, 1.0)
    own = {"fx": lens.fx * std[0], "fy": lens.fy * std[0]}
    own |= dict(zip(("cx", "cy", "k1", "k2"), std[1:].tolist(), strict=True))
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {float(getattr(lens, name))!r}" for name in LENS_PARAMETERS]
    lines += ["", "[std]", *(f"{name} = {float(value)!r}" for name, value in own.items())]
    lines += [
        "",
        "[prior]",
        "# in log focal length, principal point x and y (px), k1 and k2",
        f"std = {std.tolist()!r}",
        f"correlation = {np.round(related, 9).tolist()!r}",
        "",
        "[quality]",
        'model = "from the straight lines of the wall grid"',
    ]
    return "\n".join(lines) + "\n"


def _view_text(grid: WallGrid) -> str:
    """The wall as seen by the camera, to detect later camera moves."""
    variance = float(np.median(np.trace(grid.covariance_px2, axis1=1, axis2=2)))
    return "\n".join(
        [
            "",
            VIEW,
            "# position of the wall's grid in the image, for `vision calibrate check`",
            f"size = {list(grid.size)!r}",
            f"pitch_m = {grid.pitch_m!r}",
            f"centre = {grid.map.centre.tolist()!r}",
            f"scale = {grid.map.scale.tolist()!r}",
            f"parameters = {grid.map.parameters.tolist()!r}",
            f"variance_px2 = {variance / len(grid.nodes)!r}",
            "",
        ]
    )


def read_view(lens: Path) -> WallGrid:
    """The view of the wall stored in a lens file; its map only, no crossings.

    Raises
    ------
    SetupError
        If the file is missing or contains no view.
    """
    try:
        view = tomllib.loads(lens.read_text(encoding="utf-8"))["view"]
        arrays = (np.array(view[key], float) for key in ("centre", "scale", "parameters"))
        grid_map = GridMap(*arrays)
        size = (int(view["size"][0]), int(view["size"][1]))
        pitch, variance = float(view["pitch_m"]), float(view["variance_px2"])
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, IndexError) as problem:
        raise SetupError(
            f"{lens} does not contain the camera's view of the wall",
            hint="`vision calibrate CLIP` writes it next to the setup file; or compare two clips: "
            "`vision calibrate check NEW_CLIP --against OLD_CLIP`.",
        ) from problem
    return WallGrid(
        size=size,
        pitch_m=pitch,
        nodes=np.zeros((1, 2), dtype=np.int64),
        points_px=np.zeros((1, 2)),
        covariance_px2=0.5 * variance * np.eye(2)[np.newaxis],
        residual_px=np.zeros((1, 2)),
        map=grid_map,
        area=np.zeros(size[::-1], dtype=bool),
        dark=True,
        fine_ratio=None,
        origin_m=np.zeros(2),
    )


@dataclass(frozen=True)
class OutlookChange:
    """Effect of one answer on the expected uncertainty of the landing distance, m."""

    label: str
    before: float | None
    after: float | None


class Session:
    """Answers and results; outlives every window that shows it.

    Parameters
    ----------
    answers : Answers
        Initial answers.
    presets : sequence of BallKind
        Balls available by name.
    check : callable, optional
        Called with the setup file's text and folder before it is written.

    Attributes
    ----------
    answers : Answers
    outlook : Outlook
        Of `answers`.
    changes : list of OutlookChange
        Oldest first.
    step : int
        Current step, from 0.
    written : Written or None
        Files written so far.
    grid_problem : str
        Why no grid was found; empty otherwise.
    ball_problem : str
        Why no ball was tracked; empty otherwise.
    lens_source, lens_path : str
        Origin of the lens: "grid", "file" or "board"; and the path as entered.
    by_hand : bool
        Whether the four handles are shown.
    handles : (4, 2) array or None
        Their positions, px.
    drafts : dict of str to str
        Texts of fields that a button reads, by the field's name.
    ends : dict of str to (2,) array
        Ends of the length to verify, px.
    moving : dict of str to (2,) array
        Positions set but not yet processed, px.
    layer : {"residuals", "uncertainty", "grid"}
        Layer drawn in step 6.
    known_length, on_wall
        The length to verify, as entered, and whether it is on the wall.
    """

    def __init__(
        self,
        answers: Answers,
        presets: Sequence[BallKind] = (),
        check: Callable[[str, Path], None] | None = None,
    ) -> None:
        self.answers = answers
        self.presets = tuple(presets)
        self.outlook = Outlook(None, problem="There is no wall grid yet: step 3.")
        self.changes: list[OutlookChange] = []
        self.step = 0
        self.written: Written | None = None
        self.grid_problem = self.ball_problem = ""
        self.lens_source, self.lens_path = "grid" if answers.lens is None else "file", ""
        self.by_hand = False
        self.handles: FloatArray | None = None
        self.drafts: dict[str, str] = {}
        self.ends: dict[str, FloatArray] = {}
        self.moving: dict[str, FloatArray] = {}
        self.layer: Literal["residuals", "uncertainty", "grid"] = "uncertainty"
        self.known_length = ""
        self.on_wall = True
        self._check = check
        self._lock = Lock()

    def apply(self, label: str, changed: Callable[[Answers], Answers]) -> Outlook:
        """Change the answers and update the results; safe to call from several threads.

        Raises
        ------
        ImpactVisionError
            Whatever `changed` raises; nothing changes then.
        """
        with self._lock:
            answers = changed(self.answers)
            now = outlook(answers)
            self.changes.append(OutlookChange(label, self.outlook.std, now.std))
            self.answers, self.outlook = answers, now
            return now

    def update(self, label: str, **fields: Any) -> Outlook:
        """Replace fields of the answers."""
        return self.apply(label, lambda answers: replace(answers, **fields))

    def find_grid(self) -> None:
        """Find the wall grid automatically; `grid_problem` states why there is none."""
        try:
            self.apply("wall grid found", with_grid)
            self.grid_problem = ""
        except CalibrationError as problem:
            self.grid_problem = problem.in_one_line
            self.update("no wall grid found", grid=None)

    def follow_ball(self, ball_at: tuple[float, float] | None = None) -> BallSeen:
        """Track the ball through the clip.

        Raises
        ------
        NotFoundError
            If nothing round moves.
        """
        scene = self.answers.scene
        seen = track_ball(scene.info.path, self.answers.capture_fps, ball_at=ball_at)
        self.update("ball tracked, landing found", seen=seen, rest_px=None, landing_px=None)
        return seen

    def look_for_ball(self) -> None:
        """Track the ball if there is one; `ball_problem` states why there is none."""
        try:
            self.follow_ball()
            self.ball_problem = ""
        except NotFoundError as problem:
            self.ball_problem = problem.in_one_line

    def save(self) -> Written:
        """Write `setup.toml` and `lens.toml`.

        Raises
        ------
        UsageError
            If nothing is calibrated, or the files can't be written.
        """
        self.written = save(self.answers, self.outlook, self._check)
        return self.written


def with_grid(answers: Answers) -> Answers:
    """Find the wall grid in the scene.

    Raises
    ------
    CalibrationError
        If none is found.
    """
    grid = find_wall_grid(
        answers.scene.picture, pitch_m=answers.pitch, fine_pitch_m=answers.fine_pitch
    )
    if answers.origin_px is not None:
        grid = grid.with_origin(answers.origin_px, snap=True)
    return replace(answers, grid=grid, grid_source="found", corners=None)


def with_corners(answers: Answers) -> Answers:
    """Measure the grid between the handles.

    Raises
    ------
    UsageError
        If the handles are out of order.
    """
    corners = answers.corners
    if corners is None:
        corners = starting_corners(answers.grid, answers.scene.size)
    grid, source = grid_from_corners(
        answers.scene.picture,
        corners,
        answers.squares,
        pitch_m=answers.pitch,
        fine_pitch_m=answers.fine_pitch,
    )
    if answers.origin_px is not None:
        grid = grid.with_origin(answers.origin_px, snap=True)
    return replace(answers, grid=grid, grid_source=source, corners=corners)


def with_ball(answers: Answers, kind: BallKind | None, *, named: bool) -> Answers:
    """Set a ball, with the height of its usual support if none is given."""
    height = answers.support_height
    if height is None and kind is not None:
        height = kind.support_height
    return replace(answers, ball=kind, ball_named=named, support_height=height)
