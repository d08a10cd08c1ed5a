"""Where the face of the pendulum mass is, from what is seen of it and what is known of it."""

import numpy as np
from numpy.typing import NDArray

from pipelines.measure.inputs import Inputs
from pipelines.measure.metres import MetricTracks

__all__ = ["NEAR_SHARE", "STEEL", "face_lead", "pivot_in_plane"]

FloatArray = NDArray[np.float64]

UNSEEN_SLANT = 0.25
"""Slope of a line of sight from a camera of which nothing is known but that it sees the strike."""
STEEL, THICKNESS_SHARE = 7850.0, 0.3
"""kg/m³; how far the thickness of a mass may be from that of a cube of steel as heavy."""
THICKNESSES = (0.4, 2.0)
"""Thickness a mass may have, over that of such a cube."""
SLANT_STD, _TELLING_SLANT = 0.03, 0.1
NEAR_SHARE = 0.6
"""Of half the thickness of a mass that the plane in which it is followed is in front of its middle:
most of what is seen of it are the edges of its near side."""
STRUCK_OFF_CENTRE_M = 0.002
"""m: how far off the middle of the face a ball is struck that was set up by eye and rule."""
IMPACT_ANGLE_STD = np.radians(0.4)
PIVOT_SHARE = 0.15
"""Of half the thickness of the mass: its sides turn to the camera as it swings, which moves the
centre of its arc."""


def pivot_in_plane(tracks: MetricTracks, inputs: Inputs) -> FloatArray:
    """Pivot in the ball plane.

    The arc that is followed is nearer to the camera by part of the half thickness.

    Parameters
    ----------
    tracks : MetricTracks
        With a pendulum.
    inputs : Inputs
        Its numbers.

    Returns
    -------
    (2,) array
        m.
    """
    assert tracks.pivot_m is not None
    if tracks.eye_m is None or tracks.spherical:
        return tracks.pivot_m
    half = _half_thickness(inputs)
    if _shows_its_face(tracks, inputs) and abs(tracks.face_slant or 0.0) > _TELLING_SLANT:
        half = (tracks.lead_m - tracks.middle_lead_m) / abs(tracks.face_slant or 1.0)
    nearer = NEAR_SHARE * half / float(tracks.eye_m[2])
    foot = tracks.eye_m[:2]
    return np.asarray(foot + (tracks.pivot_m - foot) / (1.0 + nearer))


def face_lead(
    tracks: MetricTracks, inputs: Inputs, radius: float, onset: float
) -> tuple[float, float]:
    """Lead of the face before contact is looked at: as seen, and from the impact angle.

    Parameters
    ----------
    tracks : MetricTracks
        With a pendulum.
    inputs : Inputs
        Its numbers.
    radius : float
        Of the ball, m.
    onset : float
        About when they touch, s.

    Returns
    -------
    lead, std : float
        Of the face before the line from pivot to mass, m.
    """
    assert tracks.pivot_m is not None
    pivot = pivot_in_plane(tracks, inputs)
    arm = tracks.rest_m - pivot
    reach = float(np.hypot(*arm))
    seen, seen_std = _seen_lead(tracks, inputs)
    phi = float(np.interp(onset, tracks.swing_time_s, tracks.swing_rad))
    seen += float((tracks.pivot_m - pivot) @ [np.cos(phi), np.sin(phi)])
    if inputs.ball is None or inputs.ball.launch_angle is None:
        return seen, seen_std
    angle = inputs.ball.launch_angle
    written = float(arm[0] * np.cos(angle) + arm[1] * np.sin(angle)) - radius
    pivot_std = PIVOT_SHARE * _half_thickness(inputs)
    weights = np.array([seen_std, float(np.hypot(IMPACT_ANGLE_STD * reach, pivot_std))]) ** -2.0
    mean = float(weights @ [seen, written] / weights.sum())
    return mean, float(weights.sum() ** -0.5)


def _seen_lead(tracks: MetricTracks, inputs: Inputs) -> tuple[float, float]:
    """Lead of the middle of the face: between its rims, or behind the foremost edge, m, and std."""
    if tracks.spherical:
        return tracks.lead_m, tracks.lead_std_m
    if _shows_its_face(tracks, inputs):
        return tracks.middle_lead_m, float(np.hypot(tracks.middle_lead_std_m, _off_centre(tracks)))
    ahead, ahead_std = _edge_before_face(tracks, inputs)
    return tracks.lead_m - ahead, float(np.hypot(tracks.lead_std_m, ahead_std))


def _shows_its_face(tracks: MetricTracks, inputs: Inputs) -> bool:
    """Whether the strip seen is as wide as the face of such a mass can look from there."""
    if not np.isfinite(tracks.middle_lead_std_m):
        return False
    if tracks.face_slant is None:
        low, high = 0.0, UNSEEN_SLANT
    else:
        low, high = -tracks.face_slant - SLANT_STD, -tracks.face_slant + SLANT_STD
    strip = (tracks.lead_m - tracks.middle_lead_m) / _half_thickness(inputs)
    return THICKNESSES[0] * low < strip < THICKNESSES[1] * high


def _off_centre(tracks: MetricTracks) -> float:
    """What a ball that is not struck in the middle of the face's depth shifts, m."""
    return STRUCK_OFF_CENTRE_M * abs(tracks.face_slant or UNSEEN_SLANT)


def _edge_before_face(tracks: MetricTracks, inputs: Inputs) -> tuple[float, float]:
    """How far the foremost edge seen lies ahead of the middle of the face, m, and its uncertainty.

    From a camera off to one side, the near or the far edge of a thick mass stands out ahead of
    where the face meets the ball.
    """
    half = _half_thickness(inputs)
    if tracks.face_slant is None:
        return 0.0, UNSEEN_SLANT * half
    ahead = abs(tracks.face_slant) * half
    return ahead, half * float(np.hypot(THICKNESS_SHARE * tracks.face_slant, SLANT_STD))


def _half_thickness(inputs: Inputs) -> float:
    """Half the thickness of the mass, m, were it a cube of steel."""
    return float(0.5 * (inputs.pendulum.mass / STEEL) ** (1.0 / 3.0))
