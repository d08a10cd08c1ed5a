"""Find recordings that are not part of the repository."""

import os
from pathlib import Path

import pytest


def shared_folder(name: str) -> Path:
    """A folder of recordings in $IMPACT_VISION_SHARED or ../shared; skips the test if absent."""
    root = Path(os.environ.get("IMPACT_VISION_SHARED", Path(__file__).parents[2] / "shared"))
    folder = root / name
    if not folder.is_dir():
        pytest.skip(f"recordings {name!r} not found; set IMPACT_VISION_SHARED")
    return folder
