"""One frame: the stage, the shadows of what moves, and what moves, averaged over the exposure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.camera.camera import Camera
from sample_videos.renderer.actors import Actor
from sample_videos.renderer.coverage import PixelGrid, Window
from sample_videos.renderer.stage import Stage, window_of
from sample_videos.scene import Lamp

__all__ = ["Canvas", "exposed"]

FloatArray = NDArray[np.float64]
Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Canvas:
    """What a frame is painted on: the camera of this frame, its pixels, and the stage it sees."""

    camera: Camera
    grid: PixelGrid
    stage: Stage
    lamps: tuple[Lamp, ...]


def exposed(canvas: Canvas, actors: list[Actor]) -> Float32:
    """Light (H, W, 3), blue green red, on the mean over the exposure.

    `actors` are in painting order: each hides those before it.
    """
    picture = _background(canvas, actors)
    for group in _touching(actors):
        _paint(picture, canvas, group)
    return picture


def _background(canvas: Canvas, actors: list[Actor]) -> Float32:
    stage = canvas.stage
    picture = stage.lights[0].copy()
    for actor in actors:
        _dim_sky(picture, canvas, actor)
    for lamp, light in zip(canvas.lamps, stage.lights[1:], strict=True):
        free: Float32 | None = None
        for actor in actors:
            window = _shadow_window(canvas, actor, lamp)
            if window.empty:
                continue
            rows, columns = window.slices
            shade = actor.shade(stage.points[:, rows, columns], lamp)
            if free is None:
                free = np.ones(picture.shape[:2], dtype=np.float32)
            free[rows, columns] *= 1.0 - shade
        picture += light if free is None else light * free[..., np.newaxis]
    return picture


def _dim_sky(picture: Float32, canvas: Canvas, actor: Actor) -> None:
    height, width = picture.shape[:2]
    bounds = actor.shadow_points()
    middle = bounds.mean(axis=0)
    reach = 7.0 * float(np.abs(bounds - middle).max())
    around = middle + reach * np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]])
    window = window_of(canvas.camera.project(around), width, height)
    if window.empty:
        return
    rows, columns = window.slices
    points = canvas.stage.points[:, rows, columns]
    closed = actor.closes_sky(points, canvas.stage.normals[:, rows, columns])
    if closed is not None:
        picture[rows, columns] *= (1.0 - closed)[..., np.newaxis].astype(np.float32)


def _shadow_window(canvas: Canvas, actor: Actor, lamp: Lamp) -> Window:
    """Pixels in which the shadow can be: on the wall, on the floor, and on what stands between."""
    source = np.array(lamp.position)
    points = actor.shadow_points()
    middle = points.mean(axis=0)
    height, width = canvas.grid.xy.shape[1:]
    ray = points - source
    # the penumbra reaches as far beyond as the lamp is wide, times the lengthening
    with np.errstate(divide="ignore", invalid="ignore"):
        to_wall = np.where(ray[:, 2] < -1e-6, -source[2] / ray[:, 2], np.inf)
        to_floor = np.where(ray[:, 1] < -1e-6, -source[1] / ray[:, 1], np.inf)
    reach = np.minimum(np.minimum(to_wall, to_floor), 20.0)
    fall = source + ray * reach[:, np.newaxis]
    grown = lamp.radius * max(float(reach.max()) - 1.0, 0.0)
    on_wall = source + ray * np.minimum(to_wall, 20.0)[:, np.newaxis]
    on_floor = source + ray * np.minimum(to_floor, 20.0)[:, np.newaxis]
    spots = [fall]
    if np.any(to_floor < to_wall) and np.any(to_wall < to_floor):
        spots += [np.maximum(on_wall, 0.0 * on_wall + [-np.inf, 0, 0]), on_floor * [1, 0, 1]]
    spot = np.concatenate(spots)
    spot[:, 1:] = np.maximum(spot[:, 1:], 0.0)
    corners = np.concatenate([spot - grown, spot + grown, middle[np.newaxis]])
    corners[:, 1:] = np.maximum(corners[:, 1:], 0.0)
    corners[:, 2] = np.minimum(corners[:, 2], 0.6 * canvas.camera.position[2])
    return window_of(canvas.camera.project(corners), width, height, 1.0)


def _touching(actors: list[Actor]) -> list[list[Actor]]:
    """Actors whose pixels overlap, in painting order within each group."""
    groups: list[list[Actor]] = []
    for actor in actors:
        meets = [g for g in groups if any(_overlap(actor, other) for other in g)]
        groups = [g for g in groups if g not in meets]
        groups.append([a for g in meets for a in g] + [actor])
    order = {id(actor): i for i, actor in enumerate(actors)}
    return [sorted(g, key=lambda a: order[id(a)]) for g in groups]


def _hull(actor: Actor) -> Window:
    window = actor.windows[0]
    for other in actor.windows[1:]:
        window = window.joined(other)
    return window


def _overlap(one: Actor, two: Actor) -> bool:
    return _hull(one).overlaps(_hull(two))


def _paint(picture: Float32, canvas: Canvas, group: list[Actor]) -> None:
    parts = max(len(actor.windows) for actor in group)
    hulls = [h for h in map(_hull, group) if not h.empty]
    if not hulls:
        return
    hull = hulls[0]
    for other in hulls[1:]:
        hull = hull.joined(other)
    rows, columns = hull.slices
    under = picture[rows, columns]
    total = np.zeros_like(under)
    for part in range(parts):
        here = under.copy()
        for actor in group:
            own = part * len(actor.windows) // parts
            window = actor.windows[own]
            if window.empty:
                continue
            cover, light = actor.layer(own, window, canvas.grid.crop(window))
            inner = here[
                window.top - hull.top : window.bottom - hull.top,
                window.left - hull.left : window.right - hull.left,
            ]
            colour = np.moveaxis(light[::-1], 0, -1)
            inner += cover[..., np.newaxis] * (colour - inner)
        total += here
    picture[rows, columns] = total / parts
