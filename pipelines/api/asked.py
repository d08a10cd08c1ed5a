"""What a user asks for, from numbers, strings, paths or objects alike."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

from metrology import UsageError, measurands, read_given, read_scale
from pipelines.measure.chain import MeasureOptions
from pipelines.setup.file import Setup, load_setup

__all__ = [
    "At",
    "Given",
    "SetupLike",
    "measure_options",
    "point_from",
    "setup_from",
]

SetupLike = Setup | str | os.PathLike[str] | None
Given = float | str
"""A number in SI (angles: degrees), or a string with its unit."""
At = Sequence[float] | str | None
"""``(x, y)``, ``(x, y, frame)`` or ``"x,y"``, px."""


def setup_from(setup: SetupLike) -> Setup:
    """The setup itself, read from its file, or an empty one.

    Raises
    ------
    SetupError
        If the file can't be read.
    """
    if setup is None:
        return Setup()
    return setup if isinstance(setup, Setup) else load_setup(Path(setup))


def measure_options(
    setup: SetupLike = None,
    fps: Given | None = None,
    ball: Given | None = None,
    wall_grid: Given | None = None,
    ball_at: At = None,
    mass_at: At = None,
    *,
    cache: bool = False,
    scale: Given | None = None,
) -> MeasureOptions:
    """Options of the measuring chain, each checked before any work.

    `cache` lets it take up what was measured before, and keep what it measures now. `scale` is that
    of the plane of motion (bare: m/px), and goes before the wall of the setup.

    Raises
    ------
    UsageError, SetupError, UnitError
        For a rate, point, quantity or setup that can't be.
    """
    rate = None if fps is None else read_given(fps, measurands.CAPTURE_RATE, "--fps")
    if scale is not None and wall_grid is not None:
        raise UsageError(
            "--scale and --wall-grid both say how large a pixel is",
            hint="Give the scale of the plane of motion, or the wall's squares, not both.",
        )
    return MeasureOptions(
        setup=setup_from(setup),
        fps=None if rate is None else rate.value,
        fps_std=None if rate is None else rate.std,
        ball=ball if ball is None or isinstance(ball, str) else f"{ball!r} m",
        wall_grid=_length_text(wall_grid),
        ball_at=point_from("--ball-at", ball_at),
        mass_at=point_from("--mass-at", mass_at),
        scale_m_per_px=None if scale is None else read_scale(scale, "--scale"),
        cache=cache,
    )


def _length_text(length: Given | None) -> str | None:
    return length if length is None or isinstance(length, str) else f"{length!r} m"


def point_from(option: str, at: At) -> tuple[float, float] | tuple[float, float, int] | None:
    """A point in the picture, with a frame or without.

    Raises
    ------
    UsageError
        If it is none.
    """
    if at is None:
        return None
    try:
        parts = [float(part) for part in (at.split(",") if isinstance(at, str) else at)]
    except (TypeError, ValueError):
        parts = []
    if len(parts) not in (2, 3) or not all(math.isfinite(part) for part in parts):
        raise UsageError(f"{option} {at!r} is not X,Y or X,Y,FRAME", hint=f"As in {option} 120,88")
    if len(parts) == 2:
        return parts[0], parts[1]
    return parts[0], parts[1], int(parts[2])
