"""Figures that show themselves in a notebook and are written whole."""

import io
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from metrology import UsageError, written_whole

__all__ = ["Picture", "save_figure"]

_SUFFIXES = (".png", ".svg")


class Picture(Figure):
    """A matplotlib figure that a notebook shows without `pyplot`."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def save_figure(figure: Figure, path: Path, hint: str | None = None) -> None:
    """Write a figure as .png or .svg, whole or not at all.

    Raises
    ------
    UsageError
        For another kind of file, or a folder that can't be written to.
    """
    kind = path.suffix.lower()
    if kind not in _SUFFIXES:
        raise UsageError(f"a plot is a .png or .svg file, not {path.name}", hint=hint)
    # without a date the same figure is the same file
    metadata: dict[str, Any] = {"Date": None} if kind == ".svg" else {}
    with written_whole(path) as temporary:
        figure.savefig(temporary, metadata=metadata)
