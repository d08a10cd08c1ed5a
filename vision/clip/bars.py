"""Bars burnt into a clip's pictures: found when it is opened, and cut off.

Editors fill pictures of another shape with bars (letterbox, pillarbox). Where they cover more than
half of a picture, every median over it is theirs: its noise seems to be zero, and the codec's noise
a change. Its middle is not where the lens's axis meets it, either.
"""

from collections.abc import Iterator
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.clip.picture import ClipInfo, Upright
from vision.clip.repeats import PictureSource

FloatImage = NDArray[np.float32]

__all__ = ["Bars", "TrimmedPictures", "bar_note", "find_bars"]

_MAX_OUTER_CHANGE = 2.0
"""Range of the gray levels of an outermost line in all pictures, of 255 for the brightest pixel
(derived: a codec's rounding; a sensor's black scatters by more over a whole clip)."""

_MAX_BAR_CHANGE = 24.0
"""Difference of a bar's other lines from that level, since the picture's edges ring (convention:
the limit of FFmpeg's cropdetect)."""

_MIN_EDGE_FRACTION = 0.5
"""Fraction of a bar's edge along which the picture differs from it (chosen: a scene fills it, an
object before black touches a small part)."""

_EDGE_LINES = 4
"""Lines on either side of a bar's edge by which the level has changed (convention: half a codec's
block, in which it is blurred; shading changes less)."""

_MIN_CONTENT = 0.25
"""Fraction of each side that a scene between bars fills (derived: 9 : 20 in 16 : 9 fills 0.253)."""


@dataclass(frozen=True)
class Bars:
    """Width of each bar, px of the pictures as stored.

    Attributes
    ----------
    top, bottom, left, right : int
        Even, so that fields and colour filters keep their order.
    """

    top: int = 0
    bottom: int = 0
    left: int = 0
    right: int = 0

    def inside(self, image: NDArray[Any]) -> NDArray[Any]:
        """The picture (H, W) or (H, W, 3) without bars."""
        height, width = image.shape[:2]
        part = image[self.top : height - self.bottom, self.left : width - self.right]
        return np.ascontiguousarray(part)

    def around(self, size: tuple[int, int], upright: Upright) -> tuple[int, int, int, int]:
        """Bars left, above, right and below of an upright frame, px.

        Parameters
        ----------
        size : (2,) tuple of int
            Height and width of the stored picture with bars, px.
        upright : Upright
        """
        scene = np.ones((size[0] - self.top - self.bottom, size[1] - self.left - self.right))
        whole = np.pad(scene, ((self.top, self.bottom), (self.left, self.right)))
        rows, columns = np.nonzero(turned := upright.apply(whole))
        height, width = turned.shape
        left, right = int(columns.min()), width - 1 - int(columns.max())
        return left, int(rows.min()), right, height - 1 - int(rows.max())


def bar_note(info: ClipInfo) -> tuple[str, ...]:
    """What was cut off, for the user."""
    if not any(info.bars):
        return ()
    (width, height), (left, above, _, _) = info.whole_size, info.bars
    return (
        f"Bars around the picture are cut off: of {width} × {height} px, {info.width} ×"
        f" {info.height} px are measured. Points you pass count from column {left} and line {above}"
        " of the file's picture, as in the overlay; track tables from its corner.",
    )


def find_bars(source: PictureSource) -> Bars:
    """Find outer lines and columns of one gray level in all pictures, with the scene next to them.

    Without bars this ends at the first picture that shows it.

    Parameters
    ----------
    source : object
        With `pictures()`.

    Returns
    -------
    Bars
    """
    found, scale = Bars(), np.float32(1.0)
    low = high = np.zeros((1, 1), np.float32)
    for count, picture in enumerate(source.pictures()):
        level = picture.gray().astype(np.float32)
        low = np.minimum(low, level) if count else level
        high = np.maximum(high, level) if count else level
        # files of 16 bit may use 12 of them
        scale = np.float32(255.0 / max(float(high.max()), 1.0))
        found = _bars_of(scale * low, scale * high)
        if found == Bars():
            return found
    before = None
    while found not in (before, Bars()):
        before, found = found, _edged(scale * low, scale * high, found)
    return found


def _bars_of(low: FloatImage, high: FloatImage) -> Bars:
    """Bars of pictures with these extremes of each pixel."""
    widths = []
    for darkest, brightest in ((low, high), (low.T, high.T)):
        dark, bright = darkest.min(axis=1), brightest.max(axis=1)
        widths += [_width(dark, bright), _width(dark[::-1], bright[::-1])]
    return Bars(*widths)


def _width(dark: FloatImage, bright: FloatImage) -> int:
    """Lines of a bar, from the extremes of each line, the outermost first."""
    if bright[0] - dark[0] > _MAX_OUTER_CHANGE:
        return 0
    level = 0.5 * (dark[0] + bright[0])
    beyond = np.flatnonzero(np.maximum(bright - level, level - dark) > _MAX_BAR_CHANGE)
    lines = int(beyond[0]) if len(beyond) else len(dark)
    return lines + lines % 2


def _edged(low: FloatImage, high: FloatImage, bars: Bars) -> Bars:
    """Bars that end at an edge in every picture: an object before black is soon elsewhere."""
    top, bottom, left, right = astuple(bars)
    height, width = low.shape
    if min(1.0 - (top + bottom) / height, 1.0 - (left + right) / width) < _MIN_CONTENT:
        return Bars()
    across = [image[:, left : width - right] for image in (low, high)]
    down = [image[top : height - bottom].T for image in (low, high)]
    return Bars(
        _with_edge(across, top),
        _with_edge([image[::-1] for image in across], bottom),
        _with_edge(down, left),
        _with_edge([image[::-1] for image in down], right),
    )


def _with_edge(extremes: list[FloatImage], bar: int) -> int:
    """Lines of a bar, the outermost first; 0 if the picture next to it is like it."""
    low, high = extremes
    beside, last = min(bar + _EDGE_LINES, len(low) - 1), max(bar - _EDGE_LINES, 0)
    step = np.maximum(low[beside] - high[last], low[last] - high[beside])
    return bar if float((step > _MAX_BAR_CHANGE).mean()) > _MIN_EDGE_FRACTION else 0


@dataclass(frozen=True)
class TrimmedPicture:
    """A picture without bars."""

    picture: Any
    bars: Bars

    @property
    def index(self) -> int:
        """Its number."""
        return int(self.picture.index)

    @property
    def time_s(self) -> float:
        """Its time, s."""
        return float(self.picture.time_s)

    def gray(self) -> NDArray[Any]:
        """Gray levels (H, W)."""
        return self.bars.inside(self.picture.gray())

    def colour(self) -> NDArray[np.uint8]:
        """Colour image (H, W, 3), blue first."""
        return self.bars.inside(self.picture.colour())


class TrimmedPictures:
    """The pictures of a source without bars.

    Parameters
    ----------
    source : object
        With `times_s` and `pictures()`.
    bars : Bars
    """

    def __init__(self, source: PictureSource, bars: Bars) -> None:
        self._source, self._bars = source, bars

    @property
    def damaged(self) -> int:
        """Pictures that could not be decoded."""
        return int(getattr(self._source, "damaged", 0))

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Time of every picture, s."""
        return self._source.times_s

    def pictures(self) -> Iterator[TrimmedPicture]:
        """Yield the pictures in order."""
        for picture in self._source.pictures():
            yield TrimmedPicture(picture, self._bars)
