"""The four stages of following as tables: detect, link, interpret, refine.

Each table can be read, corrected by hand and passed on to the next stage. Pixel
centres are integers, (0, 0) is the centre of the top-left pixel, y points down; with a hand-held
camera places are those of the still scene.
"""

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError, UsageError
from vision.ball.ball import follow_ball
from vision.ball.path import BallPath
from vision.ball.refine import refine_ball
from vision.clip.clip import ClipReader
from vision.clip.footage import Footage
from vision.finding.detection import Detections, with_small
from vision.finding.detection import detect as detected
from vision.finding.linking import MIN_FOUND_ROWS, Tracklet, link_parameters, node_worth
from vision.finding.linking import link as linked
from vision.finding.selection import FEATURES, FoundObjects, select, tracklet_features
from vision.scene import FilmedScene

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "GivenObjects",
    "candidate_table",
    "detect",
    "detection_table",
    "given_objects",
    "interpret",
    "link",
    "refine",
    "tracklet_table",
]

FloatArray = NDArray[np.float64]

_COLOURS = ("blue", "green", "red")
_SINGLE = ("coverage", "sharpness", "evenness", "light")
_CONTRASTS = tuple(f"contrast_{colour}" for colour in _COLOURS)
_COLUMNS = ("frame", "x_px", "y_px", "radius_px", *_SINGLE, *_CONTRASTS, *_COLOURS)


def detect(clip: "str | Path | ClipReader") -> "pd.DataFrame":
    """Find round objects in each frame that some background of the clip does not show.

    Parameters
    ----------
    clip : path or ClipReader
        The clip.

    Returns
    -------
    DataFrame
        A row for each object found: `frame`, `x_px`, `y_px`, `radius_px`, `score` (log odds that
        its edges are an object's), `kind` (``shadow`` where it dims its background evenly, else
        ``object``), `coverage` (part of the outline with an edge), `sharpness` (of these edges,
        units of noise), `evenness` (spread of the ratio to the background, about 1 for a shadow),
        `light` (that ratio), `contrast_blue` to `contrast_red` and `blue` to `red` (gray levels).
        `attrs["shape"]` holds height and width of the picture.

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
        The rows that belong to a tracklet, with `tracklet` (0 has the most), `log_odds`, and
        `corner_std_px`: above 0 for a body of any shape, of which no outline is fitted.


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
    clip: "str | Path | ClipReader", tracklets: "pd.DataFrame", tracklet: int | None = None
) -> "pd.DataFrame":
    """Fit the outline of one tracklet in each frame.

    Parameters
    ----------
    clip : path or ClipReader
        The clip.
    tracklets : DataFrame
        As `link` returns, corrected where it was wrong.
    tracklet : int, optional
        Which one; by default the rows marked in a column `measured`, else tracklet 0.

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

    if tracklet is None and "measured" in tracklets and tracklets["measured"].any():
        rows = tracklets[tracklets["measured"] == 1].sort_values("frame")
    else:
        rows = tracklets[tracklets["tracklet"] == (tracklet or 0)].sort_values("frame")
    if len(rows) < 2:
        raise NotFoundError(
            f"the table has no tracklet {tracklet or 0} of two rows or more",
            hint=f"Pass one of {sorted(tracklets['tracklet'].unique().tolist())}.",
        )
    footage, scene = _scene(clip)
    places = rows[["x_px", "y_px"]].to_numpy(dtype=np.float64)
    frame = np.array([footage.of_clip(frame) for frame in rows["frame"].tolist()])
    path = BallPath(frame, places, rows["radius_px"].to_numpy(np.float64))
    fits = follow_ball(scene, path)
    if len(fits) == 0:
        raise NotFoundError(
            "no outline was found along the tracklet",
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
    columns |= {"radius_px": seen.radius_px, "score": node_worth(seen, link_parameters())}
    columns["kind"] = np.where(seen.dims_evenly, "shadow", "object")
    columns |= {name: getattr(seen, name) for name in _SINGLE}
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
        part["corner_std_px"] = one.corner_std_px or 0.0
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def candidate_table(found: FoundObjects) -> "pd.DataFrame":
    """Tracklets of a followed clip: columns of `link`, `probability`, and 1 where `measured`."""
    table = tracklet_table(list(found.tracklets))
    table["probability"] = found.selection.probability[table["tracklet"].to_numpy()]
    table["measured"] = (table["tracklet"] == found.chosen).astype(int)
    return table


@dataclass(frozen=True)
class GivenObjects:
    """A corrected table, which takes the place of detecting, or of detecting and linking.

    Attributes
    ----------
    digest : str
        Of its numbers.
    tracklets : tuple of Tracklet
        Empty for a table of detections.
    measured : int or None
        Place of the tracklet that is marked; None leaves the choice to the probabilities.
    """

    digest: str
    seen: Detections = field(repr=False)
    tracklets: tuple[Tracklet, ...] = field(repr=False)
    measured: int | None = None

    @property
    def point(self) -> tuple[float, float, int] | None:
        """Place and frame of the first row that is marked."""
        if self.measured is None:
            return None
        marked = self.tracklets[self.measured]
        x, y = marked.centre_px[0]
        return float(x), float(y), int(marked.frame[0])

    def require_within(self, count: int) -> None:
        """Refuse rows beyond a clip of so many frames.

        Raises
        ------
        UsageError
        """
        last = int(self.seen.frame[-1])
        if last >= count:
            raise UsageError(
                f"the corrected table has a row in frame {last}; the clip has {count} frames",
                hint="Pass the clip that was followed, with the same --every; frames count from 0.",
            )

    def in_footage(self, footage: Footage) -> "GivenObjects":
        """The rows in a part of the clip, with its frame numbers.

        Raises
        ------
        NotFoundError
            If fewer than three of the marked rows are in it.
        """
        first, stop = footage.first, footage.first + len(footage.shown)

        def inside(rows: Detections) -> Detections:
            own = rows.at((rows.frame >= first) & (rows.frame < stop))
            frame = np.array([footage.of_clip(number) for number in own.frame.tolist()], int)
            return replace(own, frame=frame)

        parts = [replace(one, seen=inside(one.seen)) for one in self.tracklets]
        kept = [place for place, part in enumerate(parts) if len(part) >= MIN_FOUND_ROWS]
        if self.measured is not None and self.measured not in kept:
            raise NotFoundError(
                f"frames {first} to {stop - 1} hold fewer than {MIN_FOUND_ROWS} marked rows",
                hint="Mark more rows with measured = 1.",
            )
        place = None if self.measured is None else kept.index(self.measured)
        tracklets = tuple(parts[place] for place in kept)
        return GivenObjects(self.digest, inside(self.seen), tracklets, place)


def given_objects(table: object) -> GivenObjects:
    """Read a corrected table of tracklets or of detections.

    Parameters
    ----------
    table : DataFrame
        As `link` or `detect` returns, or as `vision measure` writes; frames are those of the clip.
        Rows with 1 in a column `measured` are the measured object, whatever their tracklet.

    Returns
    -------
    GivenObjects
        Without tracklets of fewer than three rows.

    Raises
    ------
    UsageError
        If columns are missing, a number is none, or an object has two rows of one frame.
    """
    rows = _numbers(table)
    named = repr(list(rows)).encode()
    digest = hashlib.sha256(named + rows.to_numpy().tobytes()).hexdigest()
    if "tracklet" not in rows:
        return GivenObjects(digest, _detections(rows), ())
    marked = rows["measured"].to_numpy() == 1.0
    rows.loc[marked, "tracklet"] = -1.0
    objects = [own for _, own in rows.groupby("tracklet") if len(own) >= MIN_FOUND_ROWS]
    for own in objects:
        _refuse_repeated(own)
    if not objects or 0 < marked.sum() < MIN_FOUND_ROWS:
        raise UsageError(
            f"the corrected table has no object of {MIN_FOUND_ROWS} rows or more to measure",
            hint="Mark the rows of the measured object with 1 in the column measured.",
        )
    # the marked rows come first
    measured = 0 if marked.any() else None
    return GivenObjects(digest, _detections(rows), tuple(map(_tracklet, objects)), measured)


_WHOLE = ("frame", "tracklet", "measured")


def _numbers(table: object) -> "pd.DataFrame":
    """The columns that are used, as numbers; empty features get the tracklet's medians."""
    import pandas as pd

    if not isinstance(table, pd.DataFrame):
        raise UsageError(f"{table!r} is no table", hint="Pass a DataFrame or the path of a table.")
    missing = [name for name in _COLUMNS if name not in table]
    if missing or len(table) == 0:
        lacks = f"lacks the columns {', '.join(missing)}" if missing else "is empty"
        raise UsageError(
            f"the corrected table {lacks}",
            hint="Correct a table that --tracklets or --detections wrote, and keep its columns.",
        )
    names = ("tracklet", "log_odds", "measured", "corner_std_px")
    optional = [name for name in names if name in table]
    rows = table[[*_COLUMNS, *optional]].apply(pd.to_numeric, errors="coerce").astype(float)
    if "measured" in rows:
        rows.loc[table["measured"].isna(), "measured"] = 0.0
    elif "tracklet" in rows:
        rows["measured"] = 0.0
    for name in ("x_px", "y_px", "radius_px", *_WHOLE):
        if name in rows:
            _refuse_wrong(name, rows[name].to_numpy(), table)
    groups = rows["tracklet"] if "tracklet" in rows else np.zeros(len(rows))
    medians = rows.groupby(groups).transform("median")
    filled: pd.DataFrame = rows.fillna(medians).fillna(rows.median()).fillna(1.0)
    return filled


def _refuse_wrong(name: str, values: FloatArray, table: "pd.DataFrame") -> None:
    wrong = ~np.isfinite(values)
    if name in _WHOLE:
        wrong |= (values < 0) | (values != np.floor(values))
    if name == "measured":
        wrong |= values > 1
    if name == "radius_px":
        wrong |= values <= 0
    if wrong.any():
        place = int(np.argmax(wrong))
        raise UsageError(
            f"row {place + 1} of the corrected table: {name} is {table[name].iloc[place]}",
            hint="Frames and tracklets count from 0, positions are in px, measured is 0 or 1.",
        )


def _refuse_repeated(own: "pd.DataFrame") -> None:
    repeated = own["frame"][own["frame"].duplicated()]
    if len(repeated):
        number = int(own["tracklet"].iloc[0])
        name = "measured object" if number < 0 else f"tracklet {number}"
        raise UsageError(
            f"the {name} has two rows in frame {int(repeated.iloc[0])}",
            hint="Keep one row of each object a frame; set measured to 0 in the others.",
        )


def _scene(clip: "str | Path | ClipReader") -> tuple[Footage, FilmedScene]:
    footage = Footage(ClipReader.open(Path(clip)) if isinstance(clip, str | Path) else clip)
    return footage, FilmedScene(footage)


def _detections(table: "pd.DataFrame") -> Detections:
    ordered = table.sort_values("frame", kind="stable")
    return Detections(
        ordered["frame"].to_numpy(np.int64),
        ordered[["x_px", "y_px"]].to_numpy(np.float64),
        ordered["radius_px"].to_numpy(np.float64),
        ordered["coverage"].to_numpy(np.float64),
        ordered["sharpness"].to_numpy(np.float64),
        ordered[list(_CONTRASTS)].to_numpy(np.float64),
        ordered[list(_COLOURS)].to_numpy(np.float64),
        ordered["evenness"].to_numpy(np.float64),
        ordered["light"].to_numpy(np.float64),
    )


def _tracklet(rows: "pd.DataFrame") -> Tracklet:
    odds = float(rows["log_odds"].iloc[0]) if "log_odds" in rows else 0.0
    std = float(rows["corner_std_px"].iloc[0]) if "corner_std_px" in rows else 0.0
    return Tracklet(_detections(rows), odds, std if std > 0.0 else None)


def _shape(table: "pd.DataFrame", shape: tuple[int, int] | None) -> tuple[int, int]:
    """Height and width given, kept with the table, or as far as anything was found."""
    if shape is not None:
        return shape
    if "shape" in table.attrs:
        height, width = table.attrs["shape"]
        return int(height), int(width)
    return int(table["y_px"].max()) + 1, int(table["x_px"].max()) + 1
