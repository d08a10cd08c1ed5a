"""`render`: a synthetic clip with its truth."""

import os
from collections.abc import Sequence
from pathlib import Path

from metrology import UsageError, measurands, read_number
from pipelines.api.asked import Given, SetupLike, setup_from
from pipelines.model.options import angle_of
from pipelines.render import NOISE, RenderOptions, parse_size, planned_scene
from sample_videos import Truth, render_clip

__all__ = ["render"]


def render(
    path: str | os.PathLike[str],
    *,
    setup: SetupLike = None,
    backswing: Given = "120 deg",
    ball: str | None = None,
    size: str | tuple[int, int] = (432, 240),
    frames: int | None = None,
    seed: int = 1,
    fps: Given | None = None,
    shutter: Given | None = None,
    view: str = "landing",
    noise: str = "good",
    effects: Sequence[str] = (),
    mirrored: bool = False,
) -> Truth:
    """Film the experiment with a virtual camera; the truth is written beside the clip.

    Parameters
    ----------
    path : path
        The clip to write: .mp4, or what the codec wants.
    setup : Setup or path, optional
        The paper's experiment where it is silent.
    backswing : float or str
        deg, or such as "90 deg".
    ball : str, optional
        A preset, or a ball of the setup.
    size : (width, height) or str
        px, or "432x240".
    frames : int, optional
        Default: until shortly after landing.
    seed : int
        The same seed gives the same clip.
    fps : float or str, optional
        Capture rate, 1/s; default the setup's, else 600.
    shutter : float or str, optional
        Exposure time, s or such as "1/2000 s".
    view : {"landing", "impact", "oblique"}
    noise : {"none", "low", "good", "high", "dim"}
    effects : sequence of str
        Of the catalogue, with their values: "magnus:spin=10".
    mirrored : bool
        The ball is struck to the left.

    Returns
    -------
    Truth
        What really happened, frame by frame.

    Raises
    ------
    UsageError
        For options that can't be.
    """
    if noise not in NOISE:
        raise UsageError(f"noise {noise!r} is not known", hint=f"One of {', '.join(NOISE)}.")
    out = Path(path)
    if not out.absolute().parent.is_dir():
        raise UsageError(f"can't write {out}: there is no folder {out.parent}")
    text = size if isinstance(size, str) else f"{size[0]}x{size[1]}"
    options = RenderOptions(
        backswing=angle_of(str(backswing)),
        ball=ball,
        size=parse_size(text),
        frames=frames,
        seed=seed,
        fps=None if fps is None else read_number(fps, measurands.CAPTURE_RATE, "fps"),
        shutter=None if shutter is None else read_number(shutter, measurands.SHUTTER, "shutter"),
        view=view,
        noise=NOISE[noise],
        effects=tuple(effects),
        mirrored=mirrored,
    )
    scene, shot = planned_scene(setup_from(setup), options)
    return render_clip(scene, shot, out)
