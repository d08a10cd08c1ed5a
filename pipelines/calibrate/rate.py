"""`vision calibrate rate`: the camera's true capture rate from a light of known rate in view."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from calib.time_base import rate_from_blinking
from metrology import UsageError, parse_quantity
from pipelines.calibrate.wizard.parsing import point_from, rate_from
from vision.clip.capture_rate import choose_capture_rate
from vision.clip.clip import Clip

__all__ = ["rate_command"]


def rate_command(
    clip: Annotated[Path, typer.Argument(help="A clip with the blinking light in view.")],
    light_at: Annotated[str, typer.Option(help="Where the light is: X,Y in px.")],
    blink: Annotated[str, typer.Option(help="How often it blinks, such as '10 Hz'.")],
    blink_std: Annotated[str, typer.Option(help="How well that is known.")] = "0 Hz",
    around: Annotated[int, typer.Option(help="Half the side of the place looked at, px.")] = 4,
    fps: Annotated[
        str | None, typer.Option(help="The rate the camera is thought to have; within a third.")
    ] = None,
) -> None:
    """Measure the capture rate from a light in view that blinks at a known rate."""
    film = Clip.open(clip)
    column, row = point_from(light_at, (film.info.width, film.info.height))
    if around < 0:
        raise UsageError(f"--around {around} is no size", hint="Give px, 0 or more.")
    top, left = max(0, round(float(row)) - around), max(0, round(float(column)) - around)
    place = np.s_[top : round(float(row)) + around + 1, left : round(float(column)) + around + 1]
    rate = choose_capture_rate(film.info, None if fps is None else rate_from(fps))
    found = rate_from_blinking(
        [float(frame.gray[place].mean()) for frame in film.frames()],
        parse_quantity(blink, "Hz"),
        blink_std_hz=parse_quantity(blink_std, "Hz"),
        nominal_fps=rate.fps,
    )
    typer.echo(f"capture rate {found.fps:.3f} ± {found.std:.3f} fps, by the {found.source}")
    typer.echo(f"in the setup file: capture_fps = {found.fps:.6g}")
    if abs(found.fps - rate.fps) > max(4.0 * found.std, 1e-3 * rate.fps):
        typer.echo(f"{rate.fps:g} fps, from the {rate.source}, is not what it is", err=True)
