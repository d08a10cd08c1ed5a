"""Which tracklet is the measured object: a conditional logit with "none".

A few features of each tracklet, each a logarithm or a share, have weights fitted by
`training/fit_finding.py` to clips with truth; the probability of a choice is calibrated by the same
fit on clips kept out.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Self

import numpy as np
from numpy.typing import NDArray

from vision.blow import blow_weights
from vision.finding.detection import Detections
from vision.finding.linking import Tracklet
from vision.tracks import PlaceInClip

__all__ = [
    "FEATURES",
    "FoundObjects",
    "Selection",
    "comes_to",
    "select",
    "tracklet_features",
]

FloatArray = NDArray[np.float64]

FEATURES = (
    "sharpness",
    "radius",
    "travel",
    "moving",
    "share",
    "rest",
    "met",
    "shadow",
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

    def after_looks(self, struck: Iterable[int]) -> "Selection":
        """The same where a pendulum surely struck some of the tracklets."""
        odds = np.ones(len(self.probability))
        odds[list(struck)] = np.exp(blow_weights().choice)
        probability = self.probability * odds
        whole = float(probability.sum()) + self.none
        alone = odds * self.alone / (odds * self.alone + 1.0 - self.alone)
        return Selection(probability / whole, self.none / whole, alone)

    def where_it_met(self, target: int, other: int) -> "Selection":
        """The same where one came to another at rest, which left: then that one is measured."""
        probability = self.probability.copy()
        probability[target] += probability[other]
        probability[other] = 0.0
        return replace(self, probability=probability)


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
        rows.append(
            [
                np.log(max(float(np.median(seen.sharpness)), 1.0)),
                np.log(radius / shape[0]),
                np.log(0.1 + span),
                float(np.mean(step > _MOVES_RADII)),
                np.log(len(one) / searched),
                _rest_share(one),
                _met(one, tracklets),
                float(np.mean(seen.dims_evenly)),
            ]
        )
    return np.array(rows, dtype=np.float64).reshape(-1, len(FEATURES))


def _left(tracklet: Tracklet) -> int:
    """Rows before it leaves its first place, where it goes on by more than a radius; else 0."""
    first = np.median(tracklet.centre_px[:_FIRST_ROWS], axis=0)
    away = np.hypot(*(tracklet.centre_px - first).T) / tracklet.radius
    near = np.flatnonzero(away < _LEAVES_RADII)
    if len(near) < _FIRST_ROWS or away[near[-1] :].max() < 1.0:
        return 0
    return int(near[-1]) + 1


def _rest_share(tracklet: Tracklet) -> float:
    """Share of the rows before it leaves its first place."""
    return _left(tracklet) / len(tracklet)


def _met(one: Tracklet, tracklets: list[Tracklet]) -> float:
    """Whether another of its size comes to it as it leaves its first place."""
    rows = _left(one)
    if rows == 0:
        return 0.0
    place, last = np.median(one.centre_px[:_FIRST_ROWS], axis=0), int(one.frame[rows - 1])
    others = (other for other in tracklets if other is not one)
    return float(any(comes_to(other, place, one.radius, last) for other in others))


def comes_to(other: Tracklet, place: FloatArray, radius: float, last: int) -> bool:
    """Whether an object comes to another of its size at rest and is beside it as that leaves.

    Parameters
    ----------
    other : Tracklet
        What may come.
    place : (2,) array
        Of the object at rest, px.
    radius : float
        Of the object at rest, px.
    last : int
        Its last frame of rest.

    Returns
    -------
    bool
    """
    near, before = np.abs(other.frame - last), other.frame < last
    if min(radius / other.radius, other.radius / radius) < _ALIKE:
        return False
    if near.min() > _FIRST_ROWS or np.count_nonzero(before) < _FIRST_ROWS:
        return False
    away = np.hypot(*(other.centre_px - place).T) / (radius + other.radius)
    gap = float(away[np.argmin(near)])
    return bool(0.5 < gap < 1.5 and away[before].max() > gap + 0.5)


_ALIKE = 0.6
"""Ratio of radii from which two objects are of a size. Convention: a striker's head is another."""

_FIRST_ROWS, _LEAVES_RADII = 3, 0.3
"""Rows whose median is the first place (derived: fewer exclude no outlier); radii from which an
object has left it (derived: six times the scatter of centres found by votes)."""

_MOVES_RADII = 0.05
"""Radii between detections from which one moves. Derived: centres found by votes scatter by that
much."""


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
