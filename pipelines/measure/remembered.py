"""Measurements made before, found again where nothing that they follow from has changed."""

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.cache import Cache, clip_digest
from pipelines.measure.measurement import Measurement

if TYPE_CHECKING:
    from pipelines.measure.chain import MeasureOptions

__all__ = ["remembered"]

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
