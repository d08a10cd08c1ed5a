"""A rod on an encoder shaft: dry and viscous bearing friction."""

from pathlib import Path

import numpy as np
import pandas as pd

from metrology import write_text_whole

__all__ = ["convert"]

ROD_LENGTH = 0.124
ROD_MASS = 0.1
"""kg; not stated by the source. Torques scale with it, nothing else does."""


def _after_the_hand(swing: pd.DataFrame) -> pd.DataFrame:
    """First turning point used; before it a hand touches the rod."""
    angle = swing["theta_deg"].to_numpy()
    # Noise produces several crossings of the lowest point; a half swing lasts longer.
    crossings = np.flatnonzero(np.diff(np.sign(angle)) != 0)
    first, second = crossings[np.diff(crossings, prepend=-1000) > 25][:2]
    return swing.iloc[first + int(np.argmax(np.abs(angle[first:second]))) :]


def convert(source: Path, target: Path, trials: tuple[int, ...] = (1, 2, 3)) -> None:
    """Write pendulum.csv and setup.toml of the releases `trials`, cut to the free swing."""
    target.mkdir(parents=True, exist_ok=True)
    swings = pd.read_csv(source / "swings.csv")
    parts = [_after_the_hand(swings[swings["trial"] == trial]) for trial in trials]
    table = pd.concat(parts)
    pd.DataFrame(
        {
            "trial": table["trial"],
            "t_s": table["t_s"],
            "phi_rad": np.round(np.radians(table["theta_deg"]), 6),
        }
    ).to_csv(target / "pendulum.csv", index=False, lineterminator="\n")
    inertia = ROD_MASS * ROD_LENGTH**2 / 3
    write_text_whole(
        target / "setup.toml",
        f"""[pendulum]
length = "{ROD_LENGTH} m"
inertia = "{inertia:.6g} kg m^2"
mass = "{ROD_MASS} kg"
com = "{ROD_LENGTH / 2} m"

[noise]
angle = "{np.radians(0.09) / np.sqrt(12):.2g} rad"
""",
    )
