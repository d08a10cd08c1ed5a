"""Rockets coasting upwards: drag and air density decreasing with height."""

from pathlib import Path

import numpy as np
import pandas as pd

from metrology import write_text_whole

__all__ = ["convert"]

SEA_LEVEL_DENSITY = 1.225
DENSITY_HEIGHT = 10_400.0


def _pad_density(elevation: float) -> float:
    """Air density (kg/m³) at the pad, standard atmosphere."""
    return SEA_LEVEL_DENSITY * float(np.exp(-elevation / DENSITY_HEIGHT))


def convert(source: Path, target: Path, rocket: str, share: float = 1.0) -> None:
    """Write ball.csv and setup.toml of one rocket's coast, or of its first fraction."""
    target.mkdir(parents=True, exist_ok=True)
    coast = pd.read_csv(source / "coast.csv")
    coast = coast[coast["object"] == rocket]
    coast = coast[coast["t_s"] <= coast["t_s"].max() * share]
    pd.DataFrame({"trial": rocket, "t_s": coast["t_s"], "y_m": coast["z_m"]}).to_csv(
        target / "ball.csv", index=False, lineterminator="\n"
    )
    truth = pd.read_csv(source / "truth.csv").set_index("object").loc[rocket]
    write_text_whole(
        target / "setup.toml",
        f"""[ball]
mass = "{truth["mass_burnout_kg"]} kg"
diameter = "{truth["diameter_m"]} m"

[air]
density = "{_pad_density(truth["elevation_m"]):.4f} kg/m^3"
viscosity = "1.8e-5 Pa s"

[model]
effects = ["gravity"]
""",
    )
