"""The kind of motion of tracked objects, as the measurement uses it."""

import math

import numpy as np

from metrology.kept import KeptResults
from vision.motions.kinds import interpret
from vision.motions.models import Observations
from vision.motions.segments import EventKind
from vision.tracks import Motion, MotionKind, PendulumTrack, Track

__all__ = ["interpret_tracks"]


def interpret_tracks(
    ball: Track,
    pendulum: PendulumTrack | None = None,
    striker: Track | None = None,
    given: MotionKind | None = None,
    kept: KeptResults | None = None,
    *,
    struck: bool = False,
) -> Motion:
    """Determine what happens to a ball.

    Parameters
    ----------
    ball : Track
        The tracked object.
    pendulum : PendulumTrack, optional
        The pendulum that came to it.
    striker : Track, optional
        Another object that came to it, where no pendulum did.
    given : MotionKind, optional
        The kind that a person states.
    kept : KeptResults, optional
        Of an earlier call for the same striker.
    struck : bool
        Whether the pendulum surely gave the ball its speed.
    """
    came = striker if pendulum is None else pendulum.track
    found = interpret(
        _observed(ball),
        None if came is None else _observed(came),
        hangs=pendulum is not None and _hangs(pendulum),
        struck=struck,
        given=given,
        kept=kept,
    )
    stated = () if given is None else (f"That it is a {given.noun} was given.",)
    ranked = sorted(found.probabilities.items(), key=lambda item: -item[1])
    return Motion(
        found.kind,
        found.probability,
        (*stated, *found.reasons),
        found.frames,
        tuple(item for item in ranked if item[0] is not found.kind),
        found.gravity_px,
        tuple((str(one.kind), round(one.frame)) for one in found.events if one.kind in _SHOWN),
        given is not None,
    )


_SHOWN = (
    EventKind.RELEASE,
    EventKind.CONTACT,
    EventKind.BOUNCE,
    EventKind.LANDING,
    EventKind.STOP,
)
"""Events that a person looks for; turning points and changes are many."""


def _observed(track: Track) -> Observations:
    """A track as its positions with their standard uncertainty."""
    std = np.sqrt(0.5 * np.trace(track.covariance_px2, axis1=1, axis2=2))
    radius = float(np.median(track.radius_px)) if len(track) else 1.0
    return Observations.of(track.frame, track.centre_px, std, radius)


def _hangs(pendulum: PendulumTrack) -> bool:
    """Whether the path of the mass is significantly an arc about a pivot above it."""
    std = math.sqrt(float(np.linalg.eigvalsh(pendulum.pivot_covariance_px2)[-1]))
    lowest = float(np.max(pendulum.track.centre_px[:, 1])) if len(pendulum.track) else -math.inf
    return lowest - float(pendulum.pivot_px[1]) > 2.0 * std
