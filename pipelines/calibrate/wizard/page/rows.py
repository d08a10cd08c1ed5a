"""Rows on the page for places in the picture."""

from typing import TYPE_CHECKING

import numpy as np

from pipelines.calibrate.wizard.page.parts import Place, PlaceRow
from pipelines.calibrate.wizard.page.places import LABELS

if TYPE_CHECKING:
    from pipelines.calibrate.wizard.page.page import WizardPage

__all__ = ["places_of"]


def places_of(page: "WizardPage", *keys: str) -> None:
    """Rows for places."""
    for key in keys:

        def choose(key: str = key) -> None:
            page.places.active = key
            page.draw()

        def moved(x: float, y: float, key: str = key) -> None:
            page.places.active = key
            page.places.put(key, np.array([x, y]), final=True)
            page.draw()

        row = PlaceRow(Place(key, LABELS[key]), choose, moved)

        def follow(key: str = key, row: PlaceRow = row) -> None:
            at = page.places.where(key)
            px = None if at is None else (float(at[0]), float(at[1]))
            row.show(px, active=page.places.active == key)

        page.follows(follow)
