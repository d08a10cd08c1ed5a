"""Swinging bodies of several makes, painted before a wall with a ball at rest; angles known."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.vision.ball.painted import PaintedClip, exposed, wall
from vision.ball.ball import BallFits
from vision.ball.outline import nothing_found
from vision.clip.footage import Footage
from vision.scene import FilmedScene
from vision.tracks import Rest

FloatArray = NDArray[np.float64]

SCALE = 3
STRIKE = 30
HEIGHT, WIDTH, RADIUS = 104, 168, 11.0


@dataclass(frozen=True)
class Make:
    """How a pendulum looks: half sizes of its mass (round where they are equal and `round`), px.

    Its face may be seen as a strip: how wide, px, and its light. A shadow of somebody out of view
    may sweep over the wall: what part of the light it takes, where it is at the strike, px, and how
    far it goes in a frame.
    """

    half: tuple[float, float] = (8.0, 8.0)
    round: bool = False
    rod: float = 1.2
    arm: float = 62.0
    pivot: tuple[float, float] = (60.0, 12.0)
    light: float = 0.15
    view: tuple[float, float] = (0.0, 1.0)
    rate: float = 0.03
    swings: bool = True
    swept: tuple[float, float, float] = (0.0, 0.0, 0.0)
    strip: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Filmed:
    """A clip with what the striker's search asks for, and where its mass was."""

    scene: FilmedScene
    rest: Rest
    ball: BallFits
    angle: FloatArray
    middle: FloatArray


def filmed(make: Make, *, mirrored: bool = False, frames: int = 54, every: int = 1) -> Filmed:
    """Paint and hand on a strike at frame 30, or what a slower camera keeps of it."""
    view = np.array([[1.0, make.view[0]], [0.0, make.view[1]]])
    pivot = np.array(make.pivot)
    reach = np.array([make.half[0] + RADIUS, make.arm])
    rest = pivot + view @ reach
    time = np.arange(0, frames, every) - float(STRIKE)
    angle = np.where(time < 0, make.rate, 0.75 * make.rate) * time
    speed = make.rate * make.arm * 1.45
    flown = np.maximum(time, 0.0)
    centre = rest + np.column_stack([speed * flown, -0.3 * speed * flown])
    arms = np.column_stack([np.sin(angle), np.cos(angle)])
    middle = pivot + make.arm * arms @ view.T
    scene = wall(HEIGHT, WIDTH)
    pictures = []
    for index in range(len(time)):
        swung = float(angle[index]) if make.swings else -0.5
        light = _with_mass(scene * _passing(time[index], make.swept), make, view, swung)
        light = _with_ball(light, centre[index])
        picture = exposed(light, 1.5, index)
        pictures.append(picture[:, ::-1].copy() if mirrored else picture)
    if mirrored:
        centre[:, 0], middle[:, 0] = WIDTH - 1 - centre[:, 0], WIDTH - 1 - middle[:, 0]
    fits = nothing_found(len(time))
    fits.centre[:] = centre
    fits.radius[:] = RADIUS
    way = centre[-1] - centre[0]
    last = (STRIKE + 1) // every
    length = float(np.hypot(*way))
    going = Rest(0, last, centre[0], way / length, every * length / (frames - STRIKE))
    footage = Footage(PaintedClip(pictures))  # type: ignore[arg-type]
    return Filmed(FilmedScene(footage), going, BallFits(np.arange(len(time)), fits), angle, middle)


def _passing(time: float, swept: tuple[float, float, float]) -> FloatArray:
    """Part of the light that a wide shadow with soft edges leaves on the wall."""
    depth, place, speed = swept
    x = np.arange(WIDTH) - (place + speed * time)
    dark = np.clip((x + 45.0) / 14.0, 0.0, 1.0) * np.clip((25.0 - x) / 14.0, 0.0, 1.0)
    return np.asarray(np.broadcast_to(1.0 - depth * dark, (HEIGHT, WIDTH)))


def _with_mass(light: FloatArray, make: Make, view: FloatArray, angle: float) -> FloatArray:
    down = np.array([np.sin(angle), np.cos(angle)])
    side = np.array([np.cos(angle), -np.sin(angle)])
    pivot = np.array(make.pivot)
    middle = make.arm * down
    wide, tall = make.half
    if make.round:
        turn = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
        ring = wide * np.column_stack([np.cos(turn), np.sin(turn)])
    else:
        ring = np.array(
            [a * wide * side + b * tall * down for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        )
    width = make.rod * side
    bar = np.array([width, -width, make.arm * down - width, make.arm * down + width])
    rear, shade_of_strip = 1.0 - make.strip[0] / wide, make.strip[1]
    strip = np.array(
        [a * wide * side + b * tall * down for a, b in ((1, 1), (rear, 1), (rear, -1), (1, -1))]
    )
    shapes = [(bar, 0.4), (middle + ring, make.light)]
    shapes += [(middle + strip, shade_of_strip)] if make.strip[0] > 0.0 else []
    for shape, shade in shapes:
        part = _covered(pivot + shape @ view.T)
        if make.round and shape is not bar:
            # a bob lit from above: its shading stays as it swings
            rows = np.arange(HEIGHT)[:, np.newaxis] - (pivot + middle @ view.T)[1]
            shaded = shade - 0.2 * np.clip(rows / tall, -1.0, 1.0)
            light = light * (1.0 - part) + shaded * part
            continue
        light = light * (1.0 - part) + shade * part
    return light


def _with_ball(light: FloatArray, centre: FloatArray) -> FloatArray:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    part = np.clip(RADIUS + 0.5 - np.hypot(x - centre[0], y - centre[1]), 0.0, 1.0)
    return light * (1.0 - part) + part * (0.45 - 0.1 * (y - centre[1]) / RADIUS)


def _covered(corners: FloatArray) -> FloatArray:
    canvas = np.zeros((HEIGHT * SCALE, WIDTH * SCALE), np.uint8)
    points = np.rint(((corners + 0.5) * SCALE - 0.5) * 16).astype(np.int32)
    cv2.fillPoly(canvas, [points], 255, lineType=cv2.LINE_AA, shift=4)
    return np.asarray(canvas.reshape(HEIGHT, SCALE, WIDTH, SCALE).mean(axis=(1, 3)) / 255.0)
