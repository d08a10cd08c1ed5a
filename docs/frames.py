"""Draw a good frame and three bad ones for the page on filming.

Run: python docs/frames.py

Writes docs/pictures/good_frame.png and docs/pictures/bad_frames.png.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from calib.camera import Camera
from physics.bodies import BALLS
from sample_videos.film import Film
from sample_videos.scene import BallLook, Scene
from sample_videos.shot import default_scene, staged

PICTURES = Path(__file__).parent / "pictures"
SIZE = (640, 360)
FLIGHT_S = 0.16
"""Time after first contact of the frame shown, s; chosen."""


def _frame(scene: Scene, time: float = FLIGHT_S) -> np.ndarray:
    scene, shot = staged(60.0, scene)
    film = Film(scene, shot.motion)
    number = round((time - scene.shutter.first) * scene.shutter.fps)
    return np.asarray(film.frame(number)[:, :, ::-1])


def _save(figure: Figure, name: str) -> None:
    path = PICTURES / name
    figure.savefig(path, dpi=110)
    picture = Image.open(path).convert("RGB").quantize(128, Image.Quantize.FASTOCTREE)
    picture.save(path, optimize=True)


def main() -> None:
    """Render the frames and write the pictures."""
    scene = default_scene(ball=BALLS["basketball"], size=SIZE, reach=1.4, seed=4)
    figure = Figure(figsize=(8, 4.5))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(_frame(scene))
    axes.set_axis_off()
    _save(figure, "good_frame.png")
    slow = replace(scene.shutter, fps=30.0, exposure=1 / 30, first=-0.1)
    wall = scene.room.wall.colour
    pale = replace(scene, look=BallLook("plain", wall, gloss=0.0))
    lens = scene.camera.lens
    near = Camera.facing_wall(lens, [0.1, 0.75, 2.6], yaw=0.35, roll=0.12)
    bad = (
        ("Shutter open for 1/30 s: the ball smears", replace(scene, shutter=slow)),
        ("Ball of the wall's colour: weak outline", pale),
        ("Oblique, tilted, landing out of view", replace(scene, camera=near)),
    )
    figure = Figure(figsize=(5.2, 9.4), layout="constrained")
    for axes, (title, scene_) in zip(figure.subplots(3, 1), bad, strict=True):
        axes.imshow(_frame(scene_))
        axes.set_title(title, fontsize=11)
        axes.set_axis_off()
    _save(figure, "bad_frames.png")


if __name__ == "__main__":
    main()
