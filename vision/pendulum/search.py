"""What strikes the ball: found among what moves, followed on its arc, with its face and a doubt.

Whatever goes round a pivot towards the resting ball, and nearly touches it when the ball leaves, is
the striker, whatever its shape. Several pieces of what moved are followed, each as a body that
turns with its arm and as one that does not; what explains the pictures best is taken, and how far
the next best is behind tells the doubt.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.ball.ball import BallFits
from vision.ball.rest import Rest
from vision.pendulum.bob import find_bob_face
from vision.pendulum.face import find_face
from vision.pendulum.imaged_swing import ImagedSwing
from vision.pendulum.mass import MassPoses
from vision.pendulum.mass_search import find_mass
from vision.pendulum.pendulum import Follower, Swinging, follow_on, follow_piece
from vision.pendulum.striker import Striking
from vision.scene.scene import Scene
from vision.scene.still import scene_before_strike
from vision.tracks import Face, PendulumTrack, Track

__all__ = ["Striker", "find_striker", "pendulum_track"]

FloatArray = NDArray[np.float64]
Point = tuple[float, float] | tuple[float, float, int]

# Two followed pieces are one body where their arcs share the pivot to so many px over the arm.
_SAME_PIVOT = 0.15
_SAME_RATE = 0.05
# A rival that explains less than this part of what the best one does is no rival.
_RIVAL = 0.3


@dataclass(frozen=True)
class Striker:
    """What struck the ball.

    Attributes
    ----------
    mass : MassPoses
        Where it was.
    swing : ImagedSwing
        Its arc in the picture.
    face : Face
        Where it strikes.
    reasons : tuple of str
        Why it is taken for the striker, in whole sentences.
    doubt : float
        0 where nothing else comes into question, towards 1 where another thing explains as much.
    """

    mass: MassPoses
    swing: ImagedSwing
    face: Face
    reasons: tuple[str, ...]
    doubt: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know."""
        if self.doubt < 0.5:
            return ()
        x, y = self.mass.anchor[-1]
        return (
            "Two things move towards the ball on different arcs; the one near "
            f"x = {x:.0f}, y = {y:.0f} px is taken for the pendulum's mass. "
            "Point at the right one with --mass-at X,Y.",
        )


def find_striker(
    scene: Scene, rest: Rest, ball: BallFits, mass_at: Point | None = None
) -> Striker | None:
    """Find and follow what strikes the ball.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    rest : Rest
        The ball before it is struck.
    ball : BallFits
        The ball.
    mass_at : tuple, optional
        x, y (px) of a point on the striker just before contact, where the user gave one.

    Returns
    -------
    Striker or None
        None if nothing swings towards the ball.
    """
    at = None if mass_at is None else (float(mass_at[0]), float(mass_at[1]))
    radius = float(np.median(ball.radius))
    before = scene_before_strike(scene, rest, radius)
    follower = Follower(scene, rest, ball, before)
    pieces = find_mass(scene, rest, radius, before, at)
    followed = [one for piece in pieces if (one := follow_piece(follower, piece)) is not None]
    if not followed:
        return None
    best = min(followed, key=lambda one: (one.striking, -one.gain))
    rivals = [one.gain for one in followed if one.striking <= best.striking and _other(one, best)]
    best = follow_on(follower, best)
    face = None
    if not best.swing.turns:
        face = find_bob_face(scene, best.mass, best.swing, rest, radius, before)
    if face is None:
        face = find_face(scene, best.mass, rest, radius, before)
    doubt = max(rivals, default=0.0) / max(best.gain, 1e-9)
    return Striker(best.mass, best.swing, face, _reasons(best), doubt if doubt > _RIVAL else 0.0)


def _other(one: Swinging, best: Swinging) -> bool:
    """Whether two followed pieces are different bodies: another pivot, or another rate."""
    arm = float(np.hypot(*(best.swing.centre_px - best.swing.pivot_px)))
    apart = float(np.hypot(*(one.swing.pivot_px - best.swing.pivot_px)))
    if apart > _SAME_PIVOT * arm:
        return True
    common = np.intersect1d(one.mass.frame, best.mass.frame)
    if len(common) < 2:
        return False
    turned = [
        float(np.ptp(each.swing.angle_of(each.mass.anchor[np.isin(each.mass.frame, common)])))
        for each in (one, best)
    ]
    return abs(turned[0] - turned[1]) > _SAME_RATE * max(turned)


def _reasons(best: Swinging) -> tuple[str, ...]:
    shape = "turns with its arm" if best.swing.turns else "keeps its look as it swings: it is round"
    words = {
        Striking.AGREES: "Its speeds before and after agree with the ball's.",
        Striking.UNKNOWN: "It is not seen on both sides of the strike.",
        Striking.CONTRADICTS: "Its speeds do not agree with the ball's.",
    }
    return (
        f"It swings about one pivot towards the ball in {len(best.mass.frame)} frames and {shape}.",
        words[best.striking],
    )


def pendulum_track(striker: Striker, rest: Rest, fps: float) -> PendulumTrack:
    """The striker as a track.

    Parameters
    ----------
    striker : Striker
    rest : Rest
        The ball before it is struck; it tells which way is forward.
    fps : float
        Frames per second.
    """
    mass, swing = striker.mass, striker.swing
    sign = 1.0 if rest.direction[0] >= 0 else -1.0
    # the angle in the plane of the swing, which a camera that looks aslant distorts
    offset = (mass.anchor - swing.pivot_px) @ np.linalg.inv(swing.view).T
    angle = np.unwrap(np.arctan2(sign * offset[:, 0], offset[:, 1]))
    covariance = np.array([pose.covariance[:2, :2] for pose in mass.poses])
    size = float(np.sqrt(mass.patch.opacity.sum() / np.pi))
    count = len(mass.frame)
    track = Track(
        frame=mass.frame,
        time_s=mass.frame / fps,
        centre_px=mass.anchor,
        covariance_px2=covariance,
        bound_px2=covariance / 4.0,
        radius_px=np.full(count, size),
        radius_std_px=np.full(count, 0.05 * size),
        quality=np.array([pose.seen for pose in mass.poses]),
    )
    return PendulumTrack(
        track=track,
        angle_rad=angle,
        angle_std_rad=np.array([np.sqrt(pose.covariance[2, 2]) for pose in mass.poses]),
        pivot_px=swing.pivot_px,
        pivot_covariance_px2=mass.arc.covariance[:2, :2],
        arm_px=float(np.hypot(*offset.T).mean()),
        face=striker.face,
    )
