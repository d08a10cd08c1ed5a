"""Whether the right thing is followed, and how finely, over everything whose truth is known.

Run: python -m bench.scenes --following [NAME…] [--shared FOLDER]

Foreign scenes and rendered clips carry truth.json (ball in flight and at rest); real clips carry
truth/NAME.csv, marked by eye, with an uncertainty for every frame. Printed as markdown:

- near: part of the true frames followed to within half a radius;
- RMS in flight, px, of frames that were near (and of all of them where it differs);
- 2σ: part of the frames within the two-dimensional interval of that probability (95.4 %), which
  for real clips is widened by the truth's own uncertainty;
- > 8σ: frames further off than eight stated standard uncertainties;
- within (real clips): part of the true frames within max(1 px, 1.5 × truth's uncertainty).
"""

import argparse
import os
from pathlib import Path

from bench.scenes.following import HEAD, Coverage, following_lines
from bench.scenes.truths import clips_of


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="parts of names of clips; all without")
    parser.add_argument(
        "--shared", type=Path, default=Path(os.environ.get("IMPACT_VISION_SHARED", "../shared"))
    )
    chosen = parser.parse_args()
    print(HEAD)
    real, drawn = Coverage(), Coverage()
    for clip, name, truths, rate in clips_of(chosen.shared):
        if not chosen.names or any(part in name for part in chosen.names):
            kind = drawn if any(truth.steady for truth in truths) else real
            for text in following_lines(clip, name, truths, rate, kind):
                print(text, flush=True)
    print(f"\nDrawn: {drawn.words}.\nReal: {real.words}.")


if __name__ == "__main__":
    main()
