"""Juggled balls in a tilted frame with a wrong scale: no physics is missing."""

from pathlib import Path

import pandas as pd

from bench.real.row import Explain, Row, words
from metrology import write_text_whole

__all__ = ["convert", "rows"]


def convert(source: Path, target: Path, recording: str) -> None:
    """Write ball.csv (y up) and setup.toml of one recording."""
    target.mkdir(parents=True, exist_ok=True)
    flights = pd.read_csv(source / "flights.csv")
    one = flights[flights["recording"] == recording]
    # The recording has z up; a quarter turn about x keeps the frame right-handed.
    pd.DataFrame(
        {
            "trial": one["trial"],
            "t_s": one["t_s"],
            "x_m": one["x_m"],
            "y_m": one["z_m"],
            "z_m": -one["y_m"],
        }
    ).to_csv(target / "ball.csv", index=False, lineterminator="\n")
    write_text_whole(
        target / "setup.toml",
        """[ball]
mass = "0.12 kg"
diameter = "70 mm"

[air]
density = "1.2 kg/m^3"
viscosity = "1.82e-5 Pa s"

[model]
effects = ["gravity"]
""",
    )


def rows(source: Path, cache: Path, explain: Explain) -> list[Row]:
    """One row for each recording: drag is wrong, scale and tilt are right."""
    found = []
    for recording in pd.read_csv(source / "flights.csv")["recording"].unique():
        folder = cache / f"juggling_{recording}"
        convert(source, folder, recording)
        answer = explain(folder, folder / "answer.json")
        sizes = ", ".join(
            f"{named.id} {name} {value:.3g} ± {std or float('nan'):.1g}"
            for named in answer.named
            for name, (value, std) in named.parameters.items()
        )
        drag = "DRAG NAMED; " if "drag" in answer.ids else ""
        found.append(f"{recording}: {drag}{words(answer)} {sizes}".strip())
    return [Row("juggling_mocap: not drag: scale and tilt", "not drag", "with sizes",
                " / ".join(found))]  # fmt: skip
