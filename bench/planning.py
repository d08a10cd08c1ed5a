"""Compare errors predicted by `vision calibrate plan` with rendered clips.

Run: python -m bench.planning [--clips 2]

Three settings. Every clip has its own camera, grid, errors of hand-measured distances and image
noise; it is rendered, measured unattended and compared with its truth.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from measuring.chain import MeasureOptions, measure_clip
from measuring.setup.file import Setup
from physics.bodies import BASKETBALL, JOKKU
from pipelines.calibrate.plan import Filming, film_scene, planned_setup, predict_recording
from sample_videos.render import render_clip
from sample_videos.truth import Truth

SETTINGS = {
    "good light, distances measured": Filming(JOKKU, 90.0, 640, 360),
    "dim, small image, distances measured": Filming(
        BASKETBALL, 60.0, 432, 240, distance_m=3.5, light=0.1
    ),
    "half the rate, no distances": Filming(
        BASKETBALL, 90.0, 640, 360, fps=300.0, distance_m=4.6, tape_std_m=None
    ),
}
PLANNED_QUANTITIES = (
    "contact_time",
    "pendulum_speed_before",
    "pendulum_speed_after",
    "ball_speed",
    "launch_angle",
    "landing_distance",
    "landing_time",
    "cor",
)


@dataclass(frozen=True)
class Compared:
    """Predicted standard uncertainty and actual errors of one quantity in one setting."""

    name: str
    unit: str
    predicted: float
    errors: tuple[float, ...]
    stated: tuple[float, ...]

    @property
    def rms(self) -> float:
        """Root mean square of the errors; there must be at least one."""
        return float(np.sqrt(np.mean(np.square(self.errors))))


def filmed(filming: Filming, folder: Path) -> Iterator[tuple[str, float, float]]:
    """Render and measure one clip; yields name, error and stated uncertainty of quantities."""
    scene, shot = film_scene(filming)
    clip = folder / f"clip{filming.seed}.mp4"
    truth = true_quantities(render_clip(scene, shot, clip))
    setup = with_tape_errors(planned_setup(filming, scene), filming.seed)
    measured = measure_clip(clip, MeasureOptions(setup=setup))
    clip.unlink()
    for name in PLANNED_QUANTITIES:
        quantity = measured.quantity(name)
        if quantity.value is not None and quantity.std is not None and name in truth:
            yield name, quantity.value - truth[name], quantity.std


def true_quantities(truth: Truth) -> dict[str, float]:
    """Quantities with a value; the true combined COR is that of the speeds."""
    known = {name: value for name, (value, _) in truth.quantities.items() if value is not None}
    return known | {"cor": known["cor_speeds"]}


def with_tape_errors(setup: Setup, seed: int) -> Setup:
    """The setup with distances displaced by draws of their uncertainty."""
    rng = np.random.default_rng([seed, 41])
    camera, wall = setup.camera, setup.wall
    if camera.distance_to_wall is None or wall.ball_plane_offset is None:
        return setup
    (far, far_std), (plane, plane_std) = camera.distance_to_wall, wall.ball_plane_offset
    return replace(
        setup,
        camera=replace(camera, distance_to_wall=(far + rng.normal(0.0, far_std), far_std)),
        wall=replace(wall, ball_plane_offset=(plane + rng.normal(0.0, plane_std), plane_std)),
    )


def compared(filming: Filming, clips: int, *, first: int = 1) -> list[Compared]:
    """Predict one setting, render it `clips` times and compare."""
    forecast = predict_recording(filming)
    errors: dict[str, list[tuple[float, float]]] = {name: [] for name in PLANNED_QUANTITIES}
    with TemporaryDirectory() as folder:
        for seed in range(first, first + clips):
            for name, error, std in filmed(replace(filming, seed=seed), Path(folder)):
                errors[name].append((error, std))
    rows = []
    for quantity in forecast.quantities:
        if quantity.name in PLANNED_QUANTITIES and quantity.std is not None:
            pairs = errors[quantity.name]
            off, stated = tuple(e for e, _ in pairs), tuple(s for _, s in pairs)
            rows.append(Compared(quantity.name, quantity.unit, quantity.std, off, stated))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clips", type=int, default=2)
    clips = parser.parse_args().clips
    print("| setting | quantity | predicted ± | RMS error | RMS z | ± stated after | clips |")
    print("|---|---|---|---|---|---|---|")
    whole: list[float] = []
    for setting, filming in SETTINGS.items():
        for row in compared(filming, clips):
            z = np.array(row.errors) / row.predicted
            whole += z.tolist()
            found = "– | – | –"
            if row.errors:
                found = (
                    f"{row.rms:.2g} | {np.sqrt(np.mean(z**2)):.2f} | {np.median(row.stated):.2g}"
                )
            print(
                f"| {setting} | {row.name} | {row.predicted:.2g} {row.unit} | {found} "
                f"| {len(z)} of {clips} |",
                flush=True,
            )
    every = np.array(whole)
    print(
        f"| all | {len(every)} values | | | {np.sqrt(np.mean(every**2)):.2f} (median of abs(z) "
        f"{np.median(np.abs(every)):.2f}, 0.67 if normal) | | |"
    )


if __name__ == "__main__":
    main()
