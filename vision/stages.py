"""The four stages of following as tables: detect, link, interpret, refine.

Each table can be read, corrected by hand and passed on to the next stage. Pixel
centres are integers, (0, 0) is the centre of the top-left pixel, y points down; with a hand-held
camera places are those of the still scene.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from metrology import NotFoundError
from vision.ball.ball import follow_ball
from vision.ball.path import BallPath
from vision.ball.refine import refine_ball
from vision.clip.clip import ClipReader
from vision.clip.footage import Footage
from vision.finding.detection import Detections, with_small
from vision.finding.detection import detect as detected
from vision.finding.linking import Tracklet
from vision.finding.linking import link as linked
from vision.finding.selection import FEATURES, select, tracklet_features
from vision.scene import FilmedScene

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["detect", "interpret", "link", "refine", "tracklet_table"]

_COLOURS = ("blue", "green", "red")
_SINGLE = ("coverage", "sharpness", "evenness", "light")


def detect(clip: "str | Path | ClipReader") -> "pd.DataFrame":
    """Find round objects in each frame that some background of the clip does not show.

    Parameters
    ----------
    clip : path or ClipReader
        The clip.

    Returns
    -------
    DataFrame
        A row for each object found: `frame`, `x_px`, `y_px`, `radius_px`, `coverage` (part of the
        outline with an edge), `sharpness` (of these edges, units of noise), `evenness` (spread of
        the ratio to the background, about 1 for a shadow), `light` (that ratio), `contrast_blue`
        to `contrast_red` and `blue` to `red` (gray levels). `attrs["shape"]` holds height and
        width of the picture.

    Raises
    ------
    ClipError
        If the clip cannot be read.
    """
    footage, scene = _scene(clip)
    table = detection_table(with_small(scene, detected(scene)))
    table["frame"] = [footage.in_clip(frame) for frame in table["frame"].tolist()]
    table.attrs["shape"] = list(scene.shape)
    return table


def link(detections: "pd.DataFrame", shape: tuple[int, int] | None = None) -> "pd.DataFrame":
    """Link detections to tracklets by their log odds against false detections.

    Parameters
    ----------
    detections : DataFrame
        As `detect` returns.
    shape : (2,) tuple of int, optional
        Height and width of the picture, px; by default those that `detect` kept.

    Returns
    -------
    DataFrame
        The rows that belong to a tracklet, with `tracklet` (0 has the most) and `log_odds`.


    Raises
    ------
    NotFoundError
        If the table has no rows.
    """
    if len(detections) == 0:
        raise NotFoundError(
            "the table of detections is empty", hint="Check that something moves in the clip."
        )
    seen = _detections(detections)
    size = _shape(detections, shape)
    table = tracklet_table(linked(seen, np.unique(seen.frame), size))
    table.attrs["shape"] = list(size)
    return table


def interpret(tracklets: "pd.DataFrame", shape: tuple[int, int] | None = None) -> "pd.DataFrame":
    """Weigh which tracklet is the measured object.

    Parameters
    ----------
    tracklets : DataFrame
        As `link` returns.
    shape : (2,) tuple of int, optional
        Height and width of the picture, px.

    Returns
    -------
    DataFrame
        A row for each tracklet, most probable first: `tracklet`, `probability`, `first_frame`,
        `last_frame`, `radius_px`, and the features that the probability rests on. `attrs["none"]`
        is the probability that none is.
    """
    import pandas as pd

    numbers = sorted(tracklets["tracklet"].unique().tolist())
    objects = [_tracklet(tracklets[tracklets["tracklet"] == number]) for number in numbers]
    searched, size = int(tracklets["frame"].nunique()), _shape(tracklets, shape)
    chosen = select(objects, searched, size)
    table = pd.DataFrame(tracklet_features(objects, searched, size), columns=list(FEATURES))
    table.insert(0, "radius_px", [one.radius for one in objects])
    table.insert(0, "last_frame", [int(one.frame[-1]) for one in objects])
    table.insert(0, "first_frame", [int(one.frame[0]) for one in objects])
    table.insert(0, "probability", chosen.probability)
    table.insert(0, "tracklet", numbers)
    table = table.sort_values("probability", ascending=False, ignore_index=True)
    table.attrs["none"] = chosen.none
    return table


def refine(
    clip: "str | Path | ClipReader", tracklets: "pd.DataFrame", tracklet: int = 0
) -> "pd.DataFrame":
    """Fit the outline of one tracklet in each frame.

    Parameters
    ----------
    clip : path or ClipReader
        The clip.
    tracklets : DataFrame
        As `link` returns, corrected where it was wrong.
    tracklet : int
        Which one.

    Returns
    -------
    DataFrame
        `frame`, `x_px`, `y_px`, `x_px_std`, `y_px_std`, `radius_px`.

    Raises
    ------
    NotFoundError
        If the table has no such tracklet, or nothing round lies along it.
    """
    import pandas as pd

    rows = tracklets[tracklets["tracklet"] == tracklet].sort_values("frame")
    if len(rows) < 2:
        raise NotFoundError(
            f"the table has no tracklet {tracklet} of two rows or more",
            hint=f"Pass one of {sorted(tracklets['tracklet'].unique().tolist())}.",
        )
    footage, scene = _scene(clip)
    places = rows[["x_px", "y_px"]].to_numpy(dtype=np.float64)
    frame = np.array([footage.of_clip(frame) for frame in rows["frame"].tolist()])
    path = BallPath(frame, places, rows["radius_px"].to_numpy(np.float64))
    fits = follow_ball(scene, path)
    if len(fits) == 0:
        raise NotFoundError(
            f"no outline was found along tracklet {tracklet}",
            hint="Check its rows against the clip, or choose another tracklet.",
        )
    fits = refine_ball(scene, fits)
    std = np.sqrt(np.diagonal(fits.fits.covariance, axis1=1, axis2=2))
    return pd.DataFrame(
        {
            "frame": [footage.in_clip(frame) for frame in fits.frame.tolist()],
            "x_px": fits.centre[:, 0],
            "y_px": fits.centre[:, 1],
            "x_px_std": std[:, 0],
            "y_px_std": std[:, 1],
            "radius_px": fits.radius,
        }
    )


def detection_table(seen: Detections) -> "pd.DataFrame":
    """Detections as a table with the columns of `detect`."""
    import pandas as pd

    columns = {"frame": seen.frame, "x_px": seen.centre_px[:, 0], "y_px": seen.centre_px[:, 1]}
    columns |= {"radius_px": seen.radius_px} | {name: getattr(seen, name) for name in _SINGLE}
    for place, colour in enumerate(_COLOURS):
        columns[f"contrast_{colour}"] = seen.contrast[:, place]
        columns[colour] = seen.colour[:, place]
    return pd.DataFrame(columns)


def tracklet_table(tracklets: list[Tracklet]) -> "pd.DataFrame":
    """Tracklets as a table with the columns of `link`."""
    import pandas as pd

    parts = []
    for number, one in enumerate(tracklets):
        part = detection_table(one.seen)
        part.insert(0, "tracklet", number)
        part["log_odds"] = one.log_odds
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def _scene(clip: "str | Path | ClipReader") -> tuple[Footage, FilmedScene]:
    footage = Footage(ClipReader.open(Path(clip)) if isinstance(clip, str | Path) else clip)
    return footage, FilmedScene(footage)


def _detections(table: "pd.DataFrame") -> Detections:
    ordered = table.sort_values("frame", kind="stable")
    contrast = [f"contrast_{colour}" for colour in _COLOURS]
    return Detections(
        ordered["frame"].to_numpy(np.int64),
        ordered[["x_px", "y_px"]].to_numpy(np.float64),
        ordered["radius_px"].to_numpy(np.float64),
        ordered["coverage"].to_numpy(np.float64),
        ordered["sharpness"].to_numpy(np.float64),
        ordered[contrast].to_numpy(np.float64),
        ordered[list(_COLOURS)].to_numpy(np.float64),
        ordered["evenness"].to_numpy(np.float64),
        ordered["light"].to_numpy(np.float64),
    )


def _tracklet(rows: "pd.DataFrame") -> Tracklet:
    return Tracklet(_detections(rows), float(rows["log_odds"].iloc[0]))


def _shape(table: "pd.DataFrame", shape: tuple[int, int] | None) -> tuple[int, int]:
    """Height and width given, kept with the table, or as far as anything was found."""
    if shape is not None:
        return shape
    if "shape" in table.attrs:
        height, width = table.attrs["shape"]
        return int(height), int(width)
    return int(table["y_px"].max()) + 1, int(table["x_px"].max()) + 1
