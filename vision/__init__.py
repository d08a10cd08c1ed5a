"""Read clips, track ball and pendulum mass, and find events.

The four stages of following can be used alone: `vision.detect`, `vision.link`, `vision.interpret`
and `vision.refine` take and return tables (see `vision.stages`).
"""

from typing import Any

__all__ = ["detect", "interpret", "link", "refine"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from vision import stages

        return getattr(stages, name)
    raise AttributeError(f"module 'vision' has no attribute {name!r}")
