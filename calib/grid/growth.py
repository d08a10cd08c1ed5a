"""Candidates for the wall grid: every seed grown, the likeliest first."""

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.grid.phase import COHERENT, GridMap, Support, grow
from calib.grid.spectrum import Seed, find_seeds
from metrology import CalibrationError

__all__ = ["growths", "no_grid", "only_stripes", "ranked"]

FloatArray = NDArray[np.float64]

SEEDS_TRIED = 12
SEARCH_WIDTH = 960
ENOUGH_AREA = 0.7
MOST_UNEVEN = 1.6
LEAST_AREA = 0.03
RIVAL = 0.9
"""Waves that explain this much of what the best explain may be the grid's as well."""
GENERATOR = 0.3
"""The same for waves of which the best are overtones."""
OVERTONES = range(2, 13)
SAME = 0.003
"""Cycles per px by which waves known over many periods differ at most where they are one."""


def growths(gray: FloatArray) -> list[tuple[GridMap, Support]]:
    """Grow maps from the seeds in a picture.

    Parameters
    ----------
    gray : (H, W) array
        Gray levels, none negative.

    Returns
    -------
    list of (GridMap, Support)
        Best first; others only if they explain nearly as much of the picture, or explain the best.

    Raises
    ------
    CalibrationError
        If nothing repeats in two directions.
    """
    stripes = 0.0
    for image, ratio in _resolutions(gray):
        grown: list[tuple[GridMap, Support]] = []
        seeds = find_seeds(image)
        for seed in _distinct(seeds)[:SEEDS_TRIED]:
            grid_map, support = grow(image, seed)
            stripes = max(stripes, _striped(support))
            grown.append((grid_map.resized(ratio[0], ratio[1]), support))
            best = max(grown, key=lambda one: one[1].worth)
            lengths = np.linalg.norm(best[0].jacobian(best[0].centre), axis=1)
            if best[1].area.mean() > ENOUGH_AREA and lengths.max() < MOST_UNEVEN * lengths.min():
                break
        grown.sort(key=lambda one: one[1].worth, reverse=True)
        if grown and grown[0][1].area.mean() > LEAST_AREA:
            return ranked(grown)
        if seeds:
            clearest = max(seeds, key=lambda seed: seed.leading)
            stripes = max(stripes, _striped(grow(image, clearest)[1]))
    if stripes > 0.3:
        raise only_stripes()
    raise no_grid()


def ranked(grown: list[tuple[GridMap, Support]]) -> list[tuple[GridMap, Support]]:
    """Order maps: generators of the best, then the best, then what explains nearly as much.

    Parameters
    ----------
    grown : list of (GridMap, Support)
        The best first.
    """
    best, support = grown[0]
    generators = [
        (one, seen)
        for one, seen in grown[1:]
        if seen.worth > GENERATOR * support.worth
        and seen.area.mean() > 0.5 * support.area.mean()
        and _overtone(one, best) < _overtone(best, one)
    ]
    rivals = [one for one in grown[1:] if one[1].worth > RIVAL * support.worth]
    return [*generators, grown[0], *rivals]


def _overtone(one: GridMap, other: GridMap) -> float:
    """Lowest order at which the other map's waves are overtones of this one's, as pixels see them.

    To the pixels a wave is the same whatever whole number of cycles per px is added to it: fine
    lines that are too fine for them come back as coarse ones. Infinite where there is none.
    """
    waves, overtones = one.jacobian(other.centre), other.jacobian(other.centre)

    def order(wave: FloatArray) -> float:
        if min(np.abs(side * ground - wave).max() for ground in waves for side in (-1, 1)) < SAME:
            return 1.0
        for times in OVERTONES:
            for ground in waves:
                rests = (times * ground - wave, times * ground + wave)
                if min(np.abs(rest - np.round(rest)).max() for rest in rests) < SAME:
                    return float(times)
        return float("inf")

    highest = max(order(wave) for wave in overtones)
    return highest if highest > 1.0 else float("inf")


def _striped(support: Support) -> float:
    """Share of the picture in which at least one family of lines is seen."""
    return float((support.coherence > COHERENT).any(axis=0).mean())


def no_grid() -> CalibrationError:
    """Refusal of a picture without any grid."""
    return CalibrationError(
        "no grid is in view: nothing repeats in two directions",
        hint="Light the wall evenly, focus on it, and let its squares be 3 px wide or more.",
    )


def only_stripes() -> CalibrationError:
    """Refusal of lines in one direction only."""
    return CalibrationError(
        "there are lines in one direction, but none that cross them: stripes are no grid",
        hint="The wall needs lines both along and across.",
    )


def _resolutions(gray: FloatArray) -> list[tuple[FloatArray, tuple[float, float]]]:
    """Pictures to search, each with the factors back to the full size."""
    height, width = gray.shape
    if width <= SEARCH_WIDTH:
        return [(gray, (1.0, 1.0))]
    factor = int(np.ceil(width / SEARCH_WIDTH))
    size = (width // factor, height // factor)
    small = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), dtype=np.float64)
    return [(small, (width / size[0], height / size[1])), (gray, (1.0, 1.0))]


def _distinct(seeds: list[Seed]) -> list[Seed]:
    """Drop seeds that show the waves of an earlier one nearby: trying them twice tells nothing."""
    kept: list[Seed] = []
    for seed in seeds:
        twins = [
            other
            for other in kept
            if np.abs(np.abs(other.waves) - np.abs(seed.waves)).max() < 0.5 / seed.window
        ]
        if len(twins) < 2:
            kept.append(seed)
    return kept
