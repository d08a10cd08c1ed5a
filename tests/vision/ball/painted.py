"""Clips painted for tests: a gridded wall, a shaded ball, a box on an arm; centres known."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.clip.picture import Frame

SUPERSAMPLING = 8
GAMMA = 1.85
PIVOT_PX = (60.0, 12.0)


@dataclass(frozen=True)
class PaintedClip:
    """What `follow` asks of a clip; `beats` are its frames' places on an even clock."""

    pictures: list[NDArray[np.uint8]]
    beats: tuple[int, ...] | None = None

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        for index in range(start, len(self.pictures) if stop is None else stop):
            beat = index if self.beats is None else self.beats[index]
            yield Frame(index, beat / 30.0, self.pictures[index])

    def without(self, lost: set[int]) -> "PaintedClip":
        """The same clip without some of its frames; the others keep their times."""
        kept = [index for index in range(len(self.pictures)) if index not in lost]
        return PaintedClip([self.pictures[index] for index in kept], tuple(kept))

    def colour_frames(
        self, start: int = 0, stop: int | None = None
    ) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        for index in range(start, len(self.pictures) if stop is None else stop):
            yield index, cv2.cvtColor(self.pictures[index], cv2.COLOR_GRAY2BGR)


@dataclass(frozen=True)
class PaintedColourClip:
    """The same of a clip in colour: pictures (H, W, 3), blue first, stored at half their colour."""

    pictures: list[NDArray[np.uint8]]

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        for index, picture in self.colour_frames(start, stop):
            yield Frame(index, index / 30.0, cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))

    def colour_frames(
        self, start: int = 0, stop: int | None = None
    ) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        for index in range(start, len(self.pictures) if stop is None else stop):
            both = cv2.cvtColor(self.pictures[index], cv2.COLOR_BGR2YCrCb)
            small = cv2.resize(both[:, :, 1:], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            both[:, :, 1:] = cv2.resize(small, both.shape[1::-1], interpolation=cv2.INTER_LINEAR)
            yield index, cv2.cvtColor(both, cv2.COLOR_YCrCb2BGR)


def wall(height: int, width: int, pitch: float = 23.0) -> NDArray[np.float64]:
    """Light (0 to 1) of a bright wall with thin lines."""
    y, x = np.mgrid[0:height, 0:width].astype(float)
    light = 0.75 + 0.05 * np.cos(x / 90.0) + 0.04 * np.sin(y / 70.0)
    lines = (np.abs((x + 5) % pitch - 1.0) < 1.0) | (np.abs((y + 9) % pitch - 1.0) < 1.0)
    return np.where(lines, 0.8 * light, light)


def cover(
    height: int, width: int, centre: tuple[float, float], radius: float
) -> NDArray[np.float64]:
    """Part of each pixel that a disc covers."""
    part = np.zeros((height, width))
    near = _near((height, width), np.array([centre]), radius)
    fine = (np.arange(SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5
    y, x = (np.arange(one.start, one.stop)[:, None] + fine[None] for one in near)
    inside = np.hypot(x.reshape(1, -1) - centre[0], y.reshape(-1, 1) - centre[1]) <= radius
    part[near] = inside.reshape(*y.shape, *x.shape).mean(axis=(1, 3))
    return part


def _near(shape: tuple[int, ...], places: NDArray[np.float64], reach: float) -> tuple[slice, slice]:
    """Rows and columns within reach of any of the places (N, 2): beyond, nothing is painted."""
    limit = np.array(shape[1::-1])
    first = np.clip(np.floor(places.min(axis=0) - reach).astype(int) - 1, 0, limit)
    last = np.clip(np.ceil(places.max(axis=0) + reach).astype(int) + 2, first, limit)
    return slice(int(first[1]), int(last[1])), slice(int(first[0]), int(last[0]))


def with_ball(
    light: NDArray[np.float64],
    centre: tuple[float, float],
    radius: float,
    albedo: float = 0.25,
) -> NDArray[np.float64]:
    """Put a ball, lit from above, before a scene."""
    height, width = light.shape
    y, x = np.mgrid[0:height, 0:width].astype(float)
    up = -(y - centre[1]) / radius
    out = np.sqrt(np.clip(1 - np.hypot(x - centre[0], y - centre[1]) ** 2 / radius**2, 0, 1))
    shade = albedo * (0.5 + 0.25 * np.clip(up, -1, 1) + 0.25 * out)
    part = cover(height, width, centre, radius)
    return light * (1 - part) + shade * part


def with_box(
    light: NDArray[np.float64],
    pivot: tuple[float, float],
    arm: float,
    angle: float,
    half: float,
    strip: float = 0.0,
    shadow: float = 0.0,
) -> NDArray[np.float64]:
    """Put a square mass on an arm before a scene; `angle` from straight down, to the right.

    Its foremost `strip` is darker, as a face in shade; its shadow on the wall reaches `shadow`
    ahead of it.
    """
    light = light * (1 - 0.35 * bar(light.shape, pivot, arm, angle, half, (0.0, half + shadow)))
    whole = bar(light.shape, pivot, arm, angle, half, (-half, half))
    side = bar(light.shape, pivot, arm, angle, half, (-half, half - strip))
    shade = 0.03 if strip else 0.15
    return light * (1 - whole) + (0.15 * side + shade * (whole - side))


def bar(
    shape: tuple[int, ...],
    pivot: tuple[float, float],
    arm: float,
    angle: float,
    half: float,
    across: tuple[float, float],
) -> NDArray[np.float64]:
    """Part of each pixel covered by a bar as tall as the mass, so far from the arm's line."""
    height, width = shape
    scale = 4
    along = np.array([np.sin(angle), np.cos(angle)])
    side = np.array([np.cos(angle), -np.sin(angle)])
    middle = np.array(pivot) + arm * along
    ends = ((1, across[1]), (1, across[0]), (-1, across[0]), (-1, across[1]))
    corners = [middle + half * a * along + b * side for a, b in ends]
    canvas = np.zeros((height * scale, width * scale), np.uint8)
    points = np.rint(((np.array(corners) + 0.5) * scale - 0.5) * 16).astype(np.int32)
    if across[1] > across[0]:
        cv2.fillPoly(canvas, [points], 255, lineType=cv2.LINE_AA, shift=4)
    part, near = np.zeros((height, width)), _near(shape, np.array(corners), 1.0)
    fine = canvas.reshape(height, scale, width, scale)[near[0], :, near[1]]
    part[near] = fine.mean(axis=(1, 3)) / 255.0
    return part


def exposed(
    light: NDArray[np.float64], noise: float, seed: int, gain: float = 1.0
) -> NDArray[np.uint8]:
    """What the camera writes: a little blur, transfer curve, noise, 8 bit."""
    blurred = cv2.GaussianBlur(light * gain, (0, 0), 0.5)
    gray = 255.0 * np.clip(blurred, 0, 1) ** (1 / GAMMA)
    gray += np.random.default_rng(seed).normal(0, noise, light.shape)
    return np.clip(np.rint(gray), 0, 255).astype(np.uint8)


def struck_ball(
    frames: int = 80,
    *,
    noise: float = 1.5,
    flicker: float = 0.0,
    slower: float = 1.0,
    begin: int = 0,
    strip: float = 0.0,
    shadow: float = 0.0,
) -> tuple[PaintedClip, NDArray[np.float64], NDArray[np.float64]]:
    """Paint a box swinging down, striking a resting ball at frame 40; ball centres and angles.

    With `slower`, everything moves so many times slower; the clip begins at frame `begin`.
    """
    height, width, radius = 120, 240, 11.0
    scene = wall(height, width)
    pivot, arm, half = PIVOT_PX, 62.0, 8.0
    rest = np.array([pivot[0] + half + radius, pivot[1] + arm])
    pictures, centres, angles = [], [], []
    for index in range(begin, begin + frames):
        time = (index - 40.0) / slower
        angle = 0.03 * time if time < 0 else 0.022 * time
        flight = max(time, 0.0)
        centre = rest + np.array([2.3 * flight, -0.9 * flight + 0.5 * 0.03 * flight**2])
        light = with_box(scene, pivot, arm, angle, half, strip, shadow)
        light = with_ball(light, (float(centre[0]), float(centre[1])), radius)
        gain = 1.0 + flicker * np.sin(1.1 * index)
        pictures.append(exposed(light, noise, index, gain))
        centres.append(centre)
        angles.append(angle)
    return PaintedClip(pictures), np.array(centres), np.array(angles)
