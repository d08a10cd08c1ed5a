"""How long a clip takes to render, one core: ``OMP_NUM_THREADS=1 python bench/render_speed.py``."""

import sys
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from sample_videos import Shake, default_scene, render_clip, staged
from sample_videos.scene import Scene


def seconds(scene: Scene, frames: int) -> tuple[float, float]:
    """Processor and wall-clock seconds for `frames` frames, stroke, stage and H.264 included."""
    cpu, wall = time.process_time(), time.perf_counter()
    staged_scene, shot = staged(120.0, scene)
    with TemporaryDirectory() as folder:
        render_clip(replace(staged_scene, frames=frames), shot, Path(folder) / "clip.mp4")
    return time.process_time() - cpu, time.perf_counter() - wall


def main(arguments: list[str]) -> None:
    """Print a table."""
    cv2.setNumThreads(1)
    frames = int(arguments[0]) if arguments else 300
    plain = default_scene(size=(432, 240))
    rolling = replace(plain, shutter=replace(plain.shutter, readout=1.0 / 800.0))
    scenes = {
        "432x240": plain,
        "432x240, rolling shutter": rolling,
        "432x240, hand-held": replace(plain, shake=Shake(amplitude=1.5)),
        "640x360": default_scene(size=(640, 360)),
        "208x116": default_scene(size=(208, 116)),
    }
    print(f"| scene | processor s for {frames} frames | wall s |\n|---|---|---|")
    for name, scene in scenes.items():
        cpu, wall = seconds(scene, frames)
        print(f"| {name} | {cpu:.1f} | {wall:.1f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
