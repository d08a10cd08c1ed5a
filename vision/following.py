"""From a clip to tracks without a click: static scene, what moved before it, ball, pendulum."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError
from vision.ball.ball import BallFits, follow_ball
from vision.ball.choice import Choice, choose_ball, rivals, uncovered, untangled
from vision.ball.circles import Circles, find_circles
from vision.ball.linking import Path, link_circles
from vision.ball.outline.refine import refine_ball
from vision.ball.rest import Rest, find_rest
from vision.clip.footage import Footage
from vision.motion import motion_of
from vision.pendulum.search import Striker, find_striker, pendulum_track
from vision.scene.scene import Scene
from vision.tracks import Followed, MotionKind, MotionModel, PendulumTrack, Track, Tracks
from vision.workers import side_by_side

if TYPE_CHECKING:
    from vision.clip.clip import Clip

__all__ = ["follow"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]
Point = tuple[float, float] | tuple[float, float, int]

# Frames looked at over the whole action, at first and at most.
_LOOKS = 48
_MOST_LOOKS = 256
# Between looks a thing goes no further than this, in radii, if more looks can help it.
_LONGEST_STEP = 2.5
_MOST_CLOSER = 150


def follow(
    clip: "Clip",
    capture_fps: float,
    *,
    ball_at: Point | None = None,
    mass_at: Point | None = None,
    progress: Callable[[float], None] | None = None,
) -> Tracks:
    """Find and follow the ball and the pendulum mass through a clip.

    Parameters
    ----------
    clip : Clip
        The clip.
    capture_fps : float
        Frames per second at which it was recorded.
    ball_at : tuple, optional
        x, y (px) and, if wanted, frame of a point on the ball, where the automatic choice is wrong.
    mass_at : tuple, optional
        The same for the pendulum mass, just before contact.
    progress : callable, optional
        Called with the part done, 0 to 1.

    Returns
    -------
    Tracks

    Raises
    ------
    NotFoundError
        If nothing round moves in the clip, or nothing where the user points.
    """
    footage = Footage(clip)
    scene = Scene(footage)
    _tell(progress, 0.2)
    choice = choose_ball(_paths(scene), _located(ball_at, footage.first))
    if choice is None:
        raise _no_ball(ball_at)
    _tell(progress, 0.4)
    rough = follow_ball(scene, choice.ball)
    if len(rough.frame) < 3:
        raise _no_ball(ball_at)
    _tell(progress, 0.6)
    rest = find_rest(rough.frame, rough.centre, float(np.median(rough.radius)))
    striker = None
    if rest is not None and not choice.struck:
        striker = find_striker(scene, rest, rough, mass_at)
    _tell(progress, 0.8)
    fits = refine_ball(scene, rough, None if striker is None else striker.mass.hides)
    _tell(progress, 1.0)
    ball = _track(fits, capture_fps)
    rest_frames = None if rest is None else (rest.first, rest.last)
    motion = motion_of(
        ball, rest_frames, pendulum=striker is not None, struck_by_another=choice.struck
    )
    if motion.kind is MotionKind.SWING:
        # What seemed to lie still was at its turning point.
        rest_frames = None
    tracks = Tracks(
        ball=ball,
        pendulum=_pendulum(striker, rest, capture_fps),
        background=scene.background.image,
        rest_frames=rest_frames,
        others=_others(scene, choice, capture_fps),
        warnings=tuple(_warnings(choice, rest, striker) + _camera_warnings(scene)),
        shift_px=scene.shifts(),
        motion=motion,
    )
    return tracks.later(footage.first, footage.whole_count, capture_fps)


def _others(scene: Scene, choice: Choice, fps: float) -> tuple[Followed, ...]:
    """What else is round and moves; the one that struck the ball as finely as the ball itself."""
    tracks = []
    for place, path in enumerate(choice.others):
        fits = follow_ball(scene, path) if choice.struck and place == 0 else None
        if fits is not None and len(fits.frame) >= 5:
            tracks.append(Followed(_track(refine_ball(scene, fits), fps), MotionModel.ROLL))
        else:
            tracks.append(Followed(_path_track(path, fps)))
    return tuple(tracks)


def _camera_warnings(scene: Scene) -> list[str]:
    shifts = scene.shifts()
    if shifts is None:
        return []
    step = np.hypot(*np.diff(shifts, axis=0).T)
    usual = float(np.median(step))
    worst = int(np.argmax(step))
    if step[worst] > max(1.5, 8.0 * usual):
        return [
            f"The camera was bumped between frames {worst} and {worst + 1} "
            f"(by {step[worst]:.1f} px); the frames are registered on the scene."
        ]
    return ["The camera moved (hand-held?); all frames are registered on the still scene."]


def _tell(progress: Callable[[float], None] | None, part: float) -> None:
    if progress is not None:
        progress(part)


def _paths(scene: Scene) -> list[Path]:
    """Round things that moved, looked for as densely as they move fast and meet."""
    found: dict[int, Circles] = {}
    count = _LOOKS
    while True:
        paths = _linked(scene, scene.spread(count), found)
        if len(found) >= min(scene.count, _MOST_LOOKS) or _longest_step(paths) < _LONGEST_STEP:
            break
        count = min(2 * count, _MOST_LOOKS)
    if uncovered(scene, found):
        looks = np.array(sorted(found), dtype=np.int64)
        found.clear()
        paths = _linked(scene, looks, found)
    closer = _meetings(paths, np.array(sorted(found), dtype=np.int64))
    return untangled(_linked(scene, closer, found) if len(closer) else paths)


def _linked(scene: Scene, looks: IntArray, found: dict[int, Circles]) -> list[Path]:
    """Paths through what is found at these looks and was found at earlier ones."""
    new = np.setdiff1d(looks, np.array(sorted(found), dtype=np.int64))
    found |= dict(zip(new.tolist(), _circles(scene, new), strict=True))
    every = np.array(sorted(found), dtype=np.int64)
    return link_circles(every, [found[int(index)] for index in every])


def _longest_step(paths: list[Path]) -> float:
    """How far the likely things go from look to look, in radii; without any, without end."""
    steps = [path.step for path in rivals(paths)]
    return max(steps, default=np.inf)


def _circles(scene: Scene, looks: IntArray) -> list[Circles]:
    """Round things in each of these frames."""
    noise = scene.background.noise

    def find(pair: tuple[FloatImage, FloatImage]) -> Circles:
        return find_circles(*pair, noise)

    seen = ((picture, scene.expected(index)) for index, picture in scene.pictures(looks))
    return list(side_by_side(find, seen))


def _meetings(paths: list[Path], looks: IntArray) -> IntArray:
    """Frames around moments in which two like things meet: a closer look tells who is who."""
    stride = int(np.ceil(np.median(np.diff(looks)))) if len(looks) > 1 else 1
    if stride <= 1:
        return np.zeros(0, dtype=np.int64)
    wanted: set[int] = set()
    likely = rivals(paths)
    for place, path in enumerate(likely):
        for other in likely[place + 1 :]:
            common, own, theirs = np.intersect1d(path.frame, other.frame, return_indices=True)
            gap = np.hypot(*(path.centre_px[own] - other.centre_px[theirs]).T)
            for frame in common[gap < 5.0 * path.radius]:
                wanted |= set(range(int(frame) - 2 * stride, int(frame) + 2 * stride + 1))
    inside = [frame for frame in wanted if looks[0] <= frame <= looks[-1]]
    return np.array(sorted(inside)[:_MOST_CLOSER], dtype=np.int64)


def _located(point: Point | None, first: int) -> tuple[float, float, int | None] | None:
    """A point with its frame, if it has one, counted from the action's first."""
    if point is None:
        return None
    return float(point[0]), float(point[1]), (int(point[2]) - first if len(point) == 3 else None)


def _no_ball(ball_at: Point | None) -> NotFoundError:
    if ball_at is not None:
        return NotFoundError(
            f"nothing round passes x = {ball_at[0]:g}, y = {ball_at[1]:g} px",
            hint="Give a point on the ball in the frame that you name: --ball-at X,Y,FRAME.",
        )
    return NotFoundError(
        "no ball found: nothing round moves before a still background",
        hint="Check that the ball moves in the clip and is at least 5 pixels across, "
        "or point at it with --ball-at X,Y,FRAME.",
    )


def _track(fits: BallFits, fps: float) -> Track:
    covariance = fits.fits.covariance
    return Track(
        frame=fits.frame,
        time_s=fits.frame / fps,
        centre_px=fits.centre,
        covariance_px2=covariance,
        bound_px2=fits.fits.bound,
        radius_px=fits.radius,
        radius_std_px=np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2)),
        quality=fits.fits.contrast,
    )


def _path_track(path: Path, fps: float) -> Track:
    count = len(path.frame)
    std = 0.05 * path.radius_px + 0.2
    covariance = std[:, None, None] ** 2 * np.eye(2)
    return Track(
        frame=path.frame,
        time_s=path.frame / fps,
        centre_px=path.centre_px,
        covariance_px2=covariance,
        bound_px2=np.zeros((count, 2, 2)),
        radius_px=path.radius_px,
        radius_std_px=std,
        quality=path.coverage,
    )


def _pendulum(striker: Striker | None, rest: Rest | None, fps: float) -> PendulumTrack | None:
    return None if striker is None or rest is None else pendulum_track(striker, rest, fps)


def _warnings(choice: Choice, rest: Rest | None, striker: Striker | None) -> list[str]:
    said = []
    if choice.struck:
        said.append(
            "Several balls move; the one that lay still and was struck is measured, "
            "the others are listed."
        )
    elif choice.others:
        said.append(
            f"{1 + len(choice.others)} round things move; the clearest is taken for the ball. "
            "Point at another with --ball-at X,Y,FRAME."
        )
    if striker is not None:
        said += striker.warnings
    elif rest is not None and not choice.struck:
        said.append("No pendulum was found behind the ball; point at its mass with --mass-at X,Y.")
    return said
