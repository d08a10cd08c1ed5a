"""Small clips of one stroke, and what goes wrong with clips."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from physics.bodies import BASKETBALL
from sample_videos import Scene, Shot, default_scene, render_frames, staged
from sample_videos.render import write_clip
from sample_videos.scene import Encoding

__all__ = ["FPS", "Frames", "corrupted", "rendered", "stroke", "written"]

Frames = list[NDArray[np.uint8]]

FPS = 200.0
SIZE = (240, 134)
ENCODING = Encoding(rate_factor=16.0)


def stroke(fps: float = FPS, *, before_s: float = 0.0838) -> tuple[Scene, Shot]:
    """A basketball struck from 60 deg, landing in view."""
    scene = default_scene(ball=BASKETBALL, size=SIZE, reach=1.33, seed=3)
    return staged(60.0, replace(scene, shutter=replace(scene.shutter, fps=fps, first=-before_s)))


def rendered(scene: Scene, shot: Shot) -> Frames:
    return list(render_frames(scene, shot)[0])


def written(frames: Frames, path: Path) -> Path:
    write_clip(frames, path, ENCODING)
    return path


def corrupted(clip: Path, path: Path, *, parts: int = 3, seed: int = 5) -> Path:
    """The clip with the pictures in one of its parts overwritten: the middle, its index as is."""
    with av.open(str(clip)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.size]
        places = [(packet.pos, packet.size) for packet in packets if packet.pos is not None]
    data = bytearray(clip.read_bytes())
    lost = len(places) // parts
    first = (len(places) - lost) // 2
    noise = np.random.default_rng(seed)
    for place, size in places[first : first + lost]:
        data[place : place + size] = noise.bytes(size)
    path.write_bytes(data)
    return path
