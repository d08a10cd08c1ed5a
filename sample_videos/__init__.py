"""Clips that ship with the package, and the scene renderer that made them.

`default_scene` returns a scene, `staged` adds its strike; `render_clip` films it to a
file with its truth, `render_frames` frame by frame into memory.
"""

from sample_videos.render import render_clip, render_frames
from sample_videos.scene import (
    BallLook,
    Encoding,
    Lamp,
    Lighting,
    LooseBall,
    Room,
    Scene,
    Sensor,
    Shake,
    Shutter,
    SwingingScale,
    Wall,
)
from sample_videos.shot import (
    HermiteCurve,
    Physics,
    Piece,
    SampledMotion,
    SceneMotion,
    SceneState,
    Shot,
    default_scene,
    staged,
    strike,
)
from sample_videos.truth import FrameTruth, Truth

__all__ = [
    "BallLook",
    "Encoding",
    "FrameTruth",
    "HermiteCurve",
    "Lamp",
    "Lighting",
    "LooseBall",
    "Physics",
    "Piece",
    "Room",
    "SampledMotion",
    "Scene",
    "SceneMotion",
    "SceneState",
    "Sensor",
    "Shake",
    "Shot",
    "Shutter",
    "SwingingScale",
    "Truth",
    "Wall",
    "default_scene",
    "render_clip",
    "render_frames",
    "staged",
    "strike",
]
