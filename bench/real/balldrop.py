"""Sports balls dropped from a height: drag, confounded with a scale error."""

from pathlib import Path

import numpy as np
import pandas as pd

from bench.real.falling import fall_of, predict
from bench.real.row import Explain, Row, words
from metrology import write_text_whole

__all__ = ["convert", "rows"]

HAND = 0.2
"""s; start of a drop that is discarded because a hand may still touch the ball."""
DENSITY = 1.2
VOLLEYBALL = (0.27, 0.21)
"""Mass and diameter by the rules of each sport; the recording gives none."""


def _bodies(source: Path) -> pd.DataFrame:
    bodies = pd.read_csv(source / "objects.csv").set_index("object")
    bodies.loc["volleyball", ["mass_kg", "diameter_m"]] = VOLLEYBALL
    return bodies


def _drop(source: Path, body: str, trial: int) -> tuple[np.ndarray, np.ndarray]:
    drops = pd.read_csv(source / "drops.csv")
    one = drops[(drops["object"] == body) & (drops["trial"] == trial) & (drops["t_s"] >= HAND)]
    return one["t_s"].to_numpy(), one["y_m"].to_numpy()


def convert(source: Path, target: Path, bodies: tuple[str, ...], trials: tuple[int, ...]) -> None:
    """Write ball.csv and setup.toml of the drops of some balls."""
    target.mkdir(parents=True, exist_ok=True)
    parts, sections = [], []
    facts = _bodies(source)
    for body in bodies:
        sections.append(
            f'[balls.{body}]\nmass = "{facts.loc[body, "mass_kg"]} kg"\n'
            f'diameter = "{facts.loc[body, "diameter_m"]} m"\n'
        )
        for trial in trials:
            time, height = _drop(source, body, trial)
            parts.append(
                pd.DataFrame({"trial": f"{body}-{trial}", "ball": body, "t_s": time, "y_m": height})
            )
    pd.concat(parts).to_csv(target / "ball.csv", index=False, lineterminator="\n")
    write_text_whole(
        target / "setup.toml",
        f"""[air]
density = "{DENSITY} kg/m^3"
viscosity = "1.82e-5 Pa s"

[model]
effects = ["gravity"]

"""
        + "\n".join(sections),
    )


def rows(source: Path, cache: Path, explain: Explain) -> list[Row]:
    """Effects named over all drops; landing of one drop predicted from another."""
    bodies = tuple(str(name) for name in _bodies(source).index)
    facts = _bodies(source)
    convert(source, cache / "balldrop", bodies, (1, 2))
    whole = explain(cache / "balldrop", cache / "balldrop" / "answer.json")
    errors = []
    for body in bodies:
        for trained, tested in ((1, 2), (2, 1)):
            folder = cache / f"balldrop_{body}_{trained}"
            convert(source, folder, (body,), (trained,))
            answer = explain(folder, folder / "answer.json")
            mass, diameter = facts.loc[body, ["mass_kg", "diameter_m"]]
            fall = fall_of(answer, mass, diameter, DENSITY)
            time, height = _drop(source, body, tested)
            known = time <= time[0] + 0.5 * (time[-1] - time[0])
            errors.append(float(abs(predict(fall, time, height, known)[-1] - height[-1])))
    together = any({"drag", "length_scale"} <= (group | whole.ids) for group in whole.groups)
    return [
        Row("balldrop: landing error, one drop predicts the other", "median 0.7 m, mean 1.0 m",
            "0.5 m", f"median {np.median(errors):.2f} m, mean {np.mean(errors):.2f} m"),
        Row("balldrop: drag and scale reported as confounded", "yes", "yes",
            f"{'yes' if together else 'no'} ({words(whole)})"),
    ]  # fmt: skip
