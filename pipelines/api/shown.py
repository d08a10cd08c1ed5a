"""Progress in notebooks, and quantities as numbers with their covariances."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from measuring.budget import JointCovariance
from pipelines.api.quantities import QuantityView

if TYPE_CHECKING:
    from uncertainties.core import AffineScalarFunc

__all__ = ["correlated", "notebook_progress"]

_PATIENCE_S = 1.0
"""Time without a sign of life, s (convention: Nielsen 1993)."""


@contextmanager
def notebook_progress() -> Iterator[Callable[[str, float], None] | None]:
    """Yield a function that shows a step and its fraction in a notebook; None elsewhere."""
    shell: Any = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if getattr(shell, "kernel", None) is None:
        yield None
        return
    import IPython.display

    draw: Any = IPython.display.display

    shown: list[Any] = []
    began = time.monotonic()

    def show(step: str, part: float) -> None:
        text = {"text/plain": f"{step}: {100.0 * part:.0f} %"}
        if shown:
            shown[0].update(text, raw=True)
        elif time.monotonic() > began + _PATIENCE_S:
            shown.append(draw(text, raw=True, display_id=True))

    try:
        yield show
    finally:
        if shown:
            shown[0].update({"text/plain": ""}, raw=True)


def correlated(
    quantities: Mapping[str, QuantityView], joint: JointCovariance | None
) -> dict[str, "AffineScalarFunc"]:
    """Numbers of `uncertainties` for all known quantities; without `joint` independent ones."""
    from uncertainties import correlated_values

    names = [name for name, view in quantities.items() if view.known]
    values = [float(quantities[name]) for name in names]
    covariance = np.diag([(quantities[name].std or 0.0) ** 2 for name in names])
    at = {} if joint is None else {name: place for place, name in enumerate(joint.names)}
    if joint is not None and at.keys() >= set(names):
        rows = [at[name] for name in names]
        covariance = joint.covariance[np.ix_(rows, rows)]
    return dict(zip(names, correlated_values(values, covariance, tags=names), strict=True))
