"""Which tracklet is the measured object: a conditional logit with "none".

A few features of each tracklet, each a logarithm or a share, have weights fitted by
`training/fit_finding.py` to clips with truth; the probability of a choice is calibrated by the same
fit on clips kept out.
"""

import json
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Self

import numpy as np
from numpy.typing import NDArray

from vision.finding.detection import Detections
from vision.finding.linking import Tracklet
from vision.tracks import PlaceInClip

__all__ = ["FEATURES", "FoundObjects", "Selection", "select", "tracklet_features"]

FloatArray = NDArray[np.float64]

FEATURES = (
    "log_odds",
    "coverage",
    "sharpness",
    "radius",
    "travel",
    "moving",
    "roughness",
    "inside",
    "shadow",
    "share",
    "contrast",
    "rest",
)
"""Features of a tracklet, in the order of the weights."""


@dataclass(frozen=True)
class Selection:
    """Probabilities of the tracklets.

    Attributes
    ----------
    probability : (N,) array
        That each is the measured object.
    none : float
        That none is.
    alone : (N,) array
        That each would be if there were no other.
    """

    probability: FloatArray
    none: float
    alone: FloatArray

    @property
    def order(self) -> NDArray[np.int64]:
        """Tracklets, most probable first."""
        return np.argsort(-self.probability, kind="stable")


@dataclass(frozen=True)
class FoundObjects:
    """Detections and tracklets of a clip, and which tracklet is measured.

    Attributes
    ----------
    seen : Detections
    tracklets : tuple of Tracklet
    selection : Selection
    chosen : int
        The tracklet that is measured.
    pointed : bool
        Whether the user pointed at it.
    """

    seen: Detections
    tracklets: tuple[Tracklet, ...]
    selection: Selection
    chosen: int
    pointed: bool

    @property
    def ball(self) -> Tracklet:
        """The tracklet that is measured."""
        return self.tracklets[self.chosen]

    @property
    def rivals(self) -> list[Tracklet]:
        """The others, most probable first."""
        order = [place for place in self.selection.order.tolist() if place != self.chosen]
        return [self.tracklets[place] for place in order]

    @property
    def probability(self) -> float:
        """That it is the measured object."""
        return 1.0 if self.pointed else float(self.selection.probability[self.chosen])

    def in_clip(self, place: PlaceInClip) -> Self:
        """The same with the clip's frame numbers."""
        seen, *own = (
            replace(one, frame=place.frame(one.frame))
            for one in (self.seen, *(tracklet.seen for tracklet in self.tracklets))
        )
        pairs = zip(self.tracklets, own, strict=True)
        tracklets = tuple(replace(one, seen=rows) for one, rows in pairs)
        return replace(self, seen=seen, tracklets=tracklets)


@cache
def _weights() -> FloatArray:
    text = resources.files("vision.finding").joinpath("parameters.json").read_text("utf-8")
    values = json.loads(text)["selection"]
    return np.array([values[name]["value"] for name in (*FEATURES, "some")])


def _smooth_residual(tracklet: Tracklet) -> FloatArray:
    """Distance of each row from the middle of its neighbours, radii."""
    frame, centre = tracklet.frame.astype(np.float64), tracklet.centre_px
    before, after = frame[1:-1] - frame[:-2], frame[2:] - frame[1:-1]
    share = (before / (before + after))[:, None]
    middle = centre[:-2] + share * (centre[2:] - centre[:-2])
    return np.asarray(np.hypot(*(centre[1:-1] - middle).T) / tracklet.radius)


def tracklet_features(
    tracklets: list[Tracklet], searched: int, shape: tuple[int, int]
) -> FloatArray:
    """Features of tracklets.

    Parameters
    ----------
    tracklets : list of Tracklet
        All of a clip.
    searched : int
        Number of frames searched.
    shape : (2,) tuple of int
        Height and width of the picture, px.

    Returns
    -------
    (N, len(FEATURES)) array
    """
    rows = []
    for one in tracklets:
        seen, radius = one.seen, one.radius
        step = np.hypot(*np.diff(one.centre_px, axis=0).T) / radius
        span = np.hypot(*np.ptp(one.centre_px, axis=0)) / radius
        dims = np.median(seen.light) < 1.0
        even = np.log(max(float(np.median(seen.evenness)), 1.0))
        rows.append(
            [
                np.log(max(one.log_odds, 1.0)),
                float(np.median(seen.coverage)),
                np.log(max(float(np.median(seen.sharpness)), 1.0)),
                np.log(radius / shape[0]),
                np.log(0.1 + span),
                float(np.mean(step > _MOVES_RADII)),
                np.log(0.01 + float(np.quantile(_smooth_residual(one), 0.75))),
                _inside(one, tracklets),
                max(3.0 - even, 0.0) if dims else 0.0,
                np.log(len(one) / searched),
                np.log(1.0 + float(np.median(np.abs(seen.contrast).max(axis=1)))),
                _rest_share(one),
            ]
        )
    return np.array(rows, dtype=np.float64).reshape(-1, len(FEATURES))


def _rest_share(tracklet: Tracklet) -> float:
    """Share of the rows before it leaves its first place, where it goes on by more than that."""
    first = np.median(tracklet.centre_px[:_FIRST_ROWS], axis=0)
    away = np.hypot(*(tracklet.centre_px - first).T) / tracklet.radius
    near = np.flatnonzero(away < _LEAVES_RADII)
    if len(near) < _FIRST_ROWS or away[near[-1] :].max() < 1.0:
        return 0.0
    return float((near[-1] + 1) / len(tracklet))


_FIRST_ROWS, _LEAVES_RADII = 3, 0.3
"""Rows whose median is the first place (derived: fewer exclude no outlier); radii from which an
object has left it (derived: six times the scatter of centres found by votes)."""

_MOVES_RADII = 0.05
"""Radii between detections from which one moves. Derived: centres found by votes scatter by that
much."""


def _inside(one: Tracklet, tracklets: list[Tracklet]) -> float:
    """Largest share of the rows in which it lies within another larger one: a panel, a spot."""
    most = 0.0
    for other in tracklets:
        if other is one or other.radius < 1.2 * one.radius:
            continue
        _, own, theirs = np.intersect1d(one.frame, other.frame, return_indices=True)
        if len(own) == 0:
            continue
        away = np.hypot(*(one.centre_px[own] - other.centre_px[theirs]).T)
        within = np.count_nonzero(away < other.seen.radius_px[theirs]) / len(one)
        most = max(most, within * float(np.median(other.seen.coverage)))
    return most


def select(tracklets: list[Tracklet], searched: int, shape: tuple[int, int]) -> Selection:
    """Probability of each tracklet that it is the measured object.

    Parameters
    ----------
    tracklets : list of Tracklet
        All of a clip.
    searched : int
        Number of frames searched.
    shape : (2,) tuple of int
        Height and width of the picture, px.

    Returns
    -------
    Selection
    """
    features = tracklet_features(tracklets, searched, shape)
    weights = _weights()
    score = np.append(features @ weights[:-1] + weights[-1], 0.0)
    share = np.exp(score - score.max())
    share /= share.sum()
    alone = 1.0 / (1.0 + np.exp(-score[:-1]))
    return Selection(share[:-1], float(share[-1]), alone)
