"""Film a scene: into memory, or to a clip with its truth beside it."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sample_videos.encode import write_clip
from sample_videos.motion import Motion
from sample_videos.renderer.film import Film
from sample_videos.scene import Scene
from sample_videos.shot import Shot
from sample_videos.truth import Truth, film_truth, write_truth

__all__ = ["render_clip", "render_frames"]

Picture = NDArray[np.uint8]


def render_frames(scene: Scene, shot: Shot | Motion) -> tuple[Iterator[Picture], Truth]:
    """Frames (H, W, 3), uint8, blue green red, as an iterator, and the truth about them.

    Parameters
    ----------
    scene : Scene
    shot : Shot or Motion
        A stroke (see `strike`, `staged`), or any motion of ball and pendulum.
    """
    film, stroke = _film(scene, shot)
    return film.frames(), film_truth(film, stroke)


def render_clip(
    scene: Scene,
    shot: Shot | Motion,
    path: Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Truth:
    """Film a scene to `path` (frames are written as they are rendered) with its truth file.

    Parameters
    ----------
    progress : callable, optional
        Called with the number of frames done and the number of all.

    Raises
    ------
    UsageError
        If the file can't be written, or its name does not go with the codec.
    """
    film, stroke = _film(scene, shot)
    total = len(film.kept())

    def counted() -> Iterator[Picture]:
        for done, picture in enumerate(film.frames(), 1):
            yield picture
            if progress is not None:
                progress(done, total)

    truth = film_truth(film, stroke)
    write_clip(counted(), path, scene.encoding)
    write_truth(truth, path)
    return truth


def _film(scene: Scene, shot: Shot | Motion) -> tuple[Film, Shot | None]:
    if isinstance(shot, Shot):
        return Film(scene, shot.motion), shot
    return Film(scene, shot), None
