"""Clips that ship with the package, and the scene renderer that made them.

`default_scene` gives a scene, `staged` the stroke that happens in it; `render_clip` films it to a
file with its truth, `render_frames` frame by frame into memory.
"""

from sample_videos.motion import HermiteCurve, Piece, SampledMotion, SceneMotion, SceneState
from sample_videos.presets import default_scene, staged
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
from sample_videos.shot import Physics, Shot, strike
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
