"""A spherical bob in place of the striking block."""

from dataclasses import replace

import numpy as np

from sample_videos import default_scene, render_frames, staged
from sample_videos.scene import Scene


def first_frame(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    scene, shot = staged(60.0, scene)
    frames, truth = render_frames(replace(scene, frames=1), shot)
    return next(iter(frames)).astype(float), truth.frames.mass_px[0]


def test_a_bob_is_rendered_at_its_true_position() -> None:
    scene = default_scene(size=(160, 90), view="impact")
    scene = replace(scene, sensor=replace(scene.sensor, full_well=0.0, read_noise=0.0))
    scene = replace(scene, shutter=replace(scene.shutter, first=-0.03))
    large = replace(scene, room=replace(scene.room, bob_radius=0.05))
    tiny = replace(scene, room=replace(scene.room, bob_radius=0.001))
    bob, place = first_frame(large)
    none, _ = first_frame(tiny)
    there = np.abs(bob - none).max(axis=2)
    there[there < 0.5 * there.max()] = 0.0
    rows, columns = np.nonzero(there)
    near = np.hypot(columns - place[0], rows - place[1]) < 12.0
    middle = np.array([columns[near].mean(), rows[near].mean()])
    assert np.hypot(*(middle - place)) < 1.0
    assert near.sum() > 0.5 * np.count_nonzero(there)
