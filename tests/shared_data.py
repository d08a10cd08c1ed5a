"""Where recordings that are not part of the repository are looked for."""

import os
from pathlib import Path

import pytest


def shared_folder(name: str) -> Path:
    """Folder of recordings beside the checkout, or in $IMPACT_VISION_SHARED; else skip."""
    root = Path(os.environ.get("IMPACT_VISION_SHARED", Path(__file__).parents[2] / "shared"))
    folder = root / name
    if not folder.is_dir():
        pytest.skip(f"the recordings {name!r} are not beside this checkout")
    return folder
