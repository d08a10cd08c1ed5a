"""Rockets coasting upwards: drag and air density decreasing with height."""

from pathlib import Path

import numpy as np
import pandas as pd

from bench.real.falling import fall_of, predict
from bench.real.row import Explain, Row, words
from metrology import write_text_whole

__all__ = ["convert", "rows"]

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


def rows(source: Path, cache: Path, explain: Explain) -> list[Row]:
    """Effects named on each coast, and the error of the second half predicted from the first."""
    truth = pd.read_csv(source / "truth.csv").set_index("object")
    coast = pd.read_csv(source / "coast.csv")
    named, errors = [], []
    for rocket, facts in truth.iterrows():
        folder = cache / f"rocket_{rocket}"
        convert(source, folder, str(rocket))
        answer = explain(folder, folder / "answer.json")
        named.append(f"{rocket}: {words(answer)}")
        half = cache / f"rocket_{rocket}_half"
        convert(source, half, str(rocket), 0.5)
        answer = explain(half, half / "answer.json")
        fall = fall_of(
            answer,
            facts["mass_burnout_kg"],
            facts["diameter_m"],
            _pad_density(facts["elevation_m"]),
        )
        one = coast[coast["object"] == rocket]
        time, height = one["t_s"].to_numpy(), one["z_m"].to_numpy()
        known = time <= time.max() / 2
        left = (predict(fall, time, height, known) - height)[~known]
        errors.append(float(np.sqrt(np.mean(left**2))))
    drag = sum("drag" in line for line in named)
    lapse = sum("density_lapse" in line for line in named)
    each = ", ".join(f"{error:.1f}" for error in errors)
    return [
        Row("rocket_coast: drag, then density decreasing with height", "drag", "both",
            f"drag on {drag} of {len(named)}, density_lapse on {lapse} ({' / '.join(named)})"),
        Row("rocket_coast: median error of the predicted half", "12 m", "10 m",
            f"{np.median(errors):.1f} m ({each})"),
    ]  # fmt: skip
