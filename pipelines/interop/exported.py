"""What was measured here, in the form in which other programs take it."""

import os
from pathlib import Path

import numpy as np

from pipelines.interop.external import ExternalTrack, ExternalTracks, PlaneOfMotion, Program
from pipelines.measure.files.tracks import tracks_as_frame
from pipelines.measure.measurement import ClipMeasurement

__all__ = ["external_of"]

_LEAST_ROWS = 3
"""Rows: two places give a velocity, the third shows whether it is one."""


def external_of(measured: ClipMeasurement, path: Path, clip: Path | None) -> ExternalTracks:
    """Tracks of a measurement with the scale and axes at the ball's rest.

    Parameters
    ----------
    measured : ClipMeasurement
    path : Path
        Where they are to be written: the clip is named relative to it.
    clip : Path or None
    """
    table = tracks_as_frame(measured)
    tracks = tuple(
        ExternalTrack(
            name=str(name),
            frame=rows["frame"].to_numpy(np.int64),
            px=rows[["x_px", "y_px"]].to_numpy(float),
            time_s=rows["t_s"].to_numpy(float),
        )
        for name, rows in table.groupby("object", sort=False)
    )
    ball = table[table["object"] == "ball"].dropna(subset=["x_m", "y_m"])
    plane = None
    if len(ball) >= _LEAST_ROWS:
        plane = _plane(ball[["x_px", "y_px"]].to_numpy(float), ball[["x_m", "y_m"]].to_numpy(float))
    named = None
    if clip is not None:
        named = Path(os.path.relpath(clip.resolve(), path.resolve().parent)).as_posix()
    return ExternalTracks(
        path=path,
        program=Program.IMPACT_VISION,
        tracks=tracks,
        size=(measured.info.width, measured.info.height),
        fps=measured.rate.fps,
        plane=plane,
        clip=named,
    )


def _plane(px: np.ndarray, metres: np.ndarray) -> PlaneOfMotion | None:
    """Scale and turn that carry the ball's pixels into its metres best (Umeyama 1991).

    Other programs know one scale and one turn; perspective and the lens are left out.
    """
    # y of the picture points down
    seen = (px - px.mean(axis=0)) * [1.0, -1.0]
    real = metres - metres.mean(axis=0)
    size = float((seen**2).sum())
    if size <= 0.0:
        return None
    along = float((seen * real).sum()) / size
    across = float((seen[:, 0] * real[:, 1] - seen[:, 1] * real[:, 0]).sum()) / size
    per_px = float(np.hypot(along, across))
    if per_px <= 0.0:
        return None
    turn = -float(np.arctan2(across, along))
    plane = PlaneOfMotion(1.0 / per_px, 0.0, np.zeros(2), turn)
    # where x = y = 0 in metres
    origin = px.mean(axis=0) + plane.pixels(-metres.mean(axis=0)[np.newaxis])[0]
    return PlaneOfMotion(1.0 / per_px, 0.0, origin, turn)
