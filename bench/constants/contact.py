"""The constants about contacts held against true contacts of two sources.

Run: python -m bench.constants.contact [FOLDER...]

FOLDER holds one folder a clip with truth.json and setup.json, as for `bench.measure`; the clips
shipped are own renders. Nothing is measured here: true contact times, speeds and sizes stand beside
the bound that a ball's mass and size set, and beside the stretches of time, told in radii of the
ball's flight, in which a striker's speeds are compared. A bound that true contacts come near says
too little; one that they pass, too much.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.measure_truth import SHIPPED, Case, cases
from physics.contact import ContactTimeBound, contact_time_bound
from pipelines.measure.impact import USUAL_SPEED
from pipelines.measure.inputs import gather_inputs
from vision.pendulum.face import COMPARED_WAYS


@dataclass(frozen=True)
class Contact:
    """A true contact: its time, s; the bound; the way in radii that the ball flies meanwhile."""

    name: str
    own: bool
    time_s: float
    bound: ContactTimeBound
    radii: float


def contacts(found: list[Case]) -> Iterator[Contact]:
    """What the truth of each clip says of its contact."""
    for case in found:
        inputs = gather_inputs(case.options.setup, case.options.ball, None)
        ball, truth = inputs.ball, case.truth
        if ball is None or ball.mass is None:
            continue
        face = inputs.pendulum.mass_at_contact
        bound = contact_time_bound(ball.mass, ball.diameter, face, USUAL_SPEED)
        way = truth["ball_speed"] * truth["contact_time"] / (0.5 * ball.diameter)
        own = case.path.parent == SHIPPED
        yield Contact(case.name, own, truth["contact_time"], bound, way)


def main() -> None:
    """Print a row for each clip, and the extremes of both sources."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="*")
    rows = list(contacts(cases(*parser.parse_args().folders)))
    print("| clip | contact | shortest | longest | of the longest | radii flown |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        print(
            f"| {row.name} | {1e3 * row.time_s:.1f} ms | {1e3 * row.bound.shortest:.2f} ms "
            f"| {1e3 * row.bound.longest:.1f} ms | {row.time_s / row.bound.longest:.2f} "
            f"| {row.radii:.2f} |"
        )
    for name, chosen in (
        ("other renderer", [row for row in rows if not row.own]),
        ("own renders", [row for row in rows if row.own]),
    ):
        if not chosen:
            continue
        share = [row.time_s / row.bound.longest for row in chosen]
        radii = [row.radii for row in chosen]
        outside = sum(not row.bound.shortest < row.time_s < row.bound.longest for row in chosen)
        print(
            f"\n{name}: contact {min(share):.2f} to {max(share):.2f} of the longest (median "
            f"{np.median(share):.2f}), {outside} of {len(chosen)} outside the bound; the ball "
            f"flies {min(radii):.2f} to {max(radii):.2f} of its radius meanwhile, speeds are "
            f"compared from {COMPARED_WAYS[1]:g} on."
        )


if __name__ == "__main__":
    main()
