"""What was measured before, found again where nothing that it follows from has changed.

Two stages are kept: what was followed hangs on the clip, its rate and the points that somebody
shows; the measurement on all that was said besides.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipelines.cache import Cache, clip_digest
from pipelines.measure.measurement import Measurement
from vision.clip.clip import Clip
from vision.clip.info import ClipInfo
from vision.tracks import Tracks

if TYPE_CHECKING:
    from pipelines.measure.chain import MeasureOptions

__all__ = ["Watched", "remembered", "watched"]

_Progress = Callable[[str, float], None]
_Measure = Callable[..., Measurement]


def remembered(measure: _Measure) -> _Measure:
    """Let a function that measures a clip first look whether it was measured before.

    Parameters
    ----------
    measure : callable
        Takes a path, options and a progress callable.
    """

    @functools.wraps(measure)
    def measured(
        path: Path,
        options: "MeasureOptions | None" = None,
        progress: _Progress | None = None,
    ) -> Measurement:
        path = Path(path)
        kept = Cache.of_user(wanted=options is not None and options.cache)
        if kept.folder is None or options is None or not path.exists():
            return measure(path, options, progress)
        lens = options.setup.camera.lens
        lens_digest = clip_digest(lens) if lens is not None and lens.is_file() else None
        key = kept.key("measurement", clip_digest(path), lens_digest, options)
        found = kept.get(key)
        if isinstance(found, Measurement):
            return replace(found, info=replace(found.info, path=path))
        made = measure(path, options, progress)
        kept.put(key, made)
        return made

    return measured


@dataclass(frozen=True, eq=False)
class Watched:
    """What following a clip to its end gave.

    Attributes
    ----------
    tracks : Tracks
    clock : (F,) array
        Mid-exposure time of every frame, in frames of the camera.
    info : ClipInfo
        With the count of the frames that came out of it.
    warnings : tuple of str
        Of the clip, with what could not be decoded.
    """

    tracks: Tracks
    clock: NDArray[np.float64]
    info: ClipInfo
    warnings: tuple[str, ...]


def watched(
    clip: Clip, capture_fps: float, options: "MeasureOptions", follow: Callable[[], Tracks]
) -> Watched:
    """Follow a clip, or take up how it was followed before.

    Parameters
    ----------
    clip : Clip
    capture_fps : float
        Frames per second at which it is followed.
    options : MeasureOptions
        The points that somebody shows, and whether anything may be kept.
    follow : callable
        Does it.
    """
    kept = Cache.of_user(wanted=options.cache)
    key = kept.key("tracks", clip.info.sha256, capture_fps, options.ball_at, options.mass_at)
    found = kept.get(key)
    if isinstance(found, Watched):
        return replace(found, info=replace(found.info, path=clip.info.path))
    tracks = follow()
    made = Watched(tracks, clip.capture_times(1.0), clip.info, clip.warnings)
    kept.put(key, made)
    return made
