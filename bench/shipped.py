"""Render the sample clips of the package: python -m bench.shipped [FOLDER]."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from metrology import write_text_whole
from physics.bodies import BALLS
from sample_videos.render import render_frames, write_clip
from sample_videos.scene import Scene
from sample_videos.shot import default_scene, staged
from sample_videos.truth import write_truth

__all__ = ["CLIPS", "FOLDER", "Sample", "make_clip"]

FOLDER = Path(__file__).parents[1] / "sample_videos" / "clips"

RATE_FACTORS = (12.0, 14.0, 15.0, 16.0, 17.0, 18.0, 20.0, 22.0, 24.0, 26.0, 28.0)
"""Quality factors (CRF of x264, 0 best to 51), tried in order until the file is small enough."""

TAPE_STD = 0.003
"""m; standard deviation of the hand-measured distances."""


@dataclass(frozen=True)
class Sample:
    """One sample clip.

    Attributes
    ----------
    reach : float
        Approximate landing distance, m.
    kilobytes : float
        Largest file size, kB.
    """

    name: str
    ball: str
    backswing_deg: float
    size: tuple[int, int]
    reach: float
    seed: int
    kilobytes: float


CLIPS = (
    Sample("jokku_120", "jokku", 119.9, (640, 360), 2.60, 5, 590.0),
    Sample("basketball_60", "basketball", 60.2, (432, 240), 1.33, 3, 560.0),
    Sample("jokku_90_small", "jokku", 90.1, (208, 116), 1.94, 4, 400.0),
)


def make_clip(sample: Sample, folder: Path) -> Path:
    """Render one clip with its truth and the setup a laboratory would record."""
    scene = default_scene(
        ball=BALLS[sample.ball], size=sample.size, reach=sample.reach, seed=sample.seed
    )
    scene, shot = staged(sample.backswing_deg, scene)
    frames, truth = render_frames(scene, shot)
    pictures = list(frames)
    path = folder / f"{sample.name}.mp4"
    # a target bit rate degrades the first frames most, and they show the rest position
    for factor in RATE_FACTORS:
        encoding = replace(scene.encoding, rate_factor=factor)
        write_clip(pictures, path, encoding)
        if path.stat().st_size < 1000 * sample.kilobytes:
            break
    write_truth(replace(truth, scene=replace(scene, encoding=encoding)), path)
    write_text_whole(folder / f"{sample.name}.toml", _setup(scene))
    return path


def _setup(scene: Scene) -> str:
    """Setup file: nominal frame rate and hand-measured distances."""
    rng = np.random.default_rng([scene.seed, 31])
    camera = scene.camera
    foot = camera.axis_foot
    lengths = [camera.position[2], foot[0], foot[1], scene.room.plane]
    far, x, y, plane = (f"{v + rng.normal(0, TAPE_STD):.3f} +- 0.005 m" for v in lengths)
    return f"""# What a laboratory would record; the truth is in the file .truth.json.
[camera]
capture_fps = {scene.shutter.fps:g}
distance_to_wall = "{far}"
principal_point_on_wall = ["{x}", "{y}"]
shutter = "{scene.shutter.exposure:g} s"

[wall]
grid = "{1000 * scene.room.wall.pitch:g} mm"
fine_grid = "{1000 * scene.room.wall.fine_pitch:g} mm"
ball_plane_offset = "{plane}"

[ball]
preset = "{scene.ball.name}"
"""


def main(arguments: list[str]) -> None:
    """Render all clips into the given folder (default: that of the package)."""
    folder = Path(arguments[0]) if arguments else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for sample in CLIPS:
        path = make_clip(sample, folder)
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
