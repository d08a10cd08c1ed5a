"""Compare followed objects with the truth on all clips whose truth is known.

Run: python -m bench.scenes [NAME…] [--shared FOLDER]

Rendered scenes have truth.json; real clips have truth/NAME.csv, marked by eye, with an uncertainty
for every frame. The Markdown table has these columns:

- near: fraction of the true frames followed to within half a radius;
- RMS px: root mean square error over those frames;
- within: fraction of the true frames within max(1 px, 1.5 × the truth's uncertainty);
- 2σ: fraction of the frames inside the two-dimensional 95.4 % region of the stated covariance
  plus the truth's;
- > 8σ: frames further than eight stated standard uncertainties from the truth.
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
    parser.add_argument("names", nargs="*", help="fragments of names of clips (default: all)")
    parser.add_argument(
        "--shared", type=Path, default=Path(os.environ.get("IMPACT_VISION_SHARED", "../shared"))
    )
    chosen = parser.parse_args()
    print(HEAD)
    real, drawn = Coverage(), Coverage()
    for clip, name, truths, rate in clips_of(chosen.shared):
        if not chosen.names or any(one in name for one in chosen.names):
            kind = drawn if any(truth.steady for truth in truths) else real
            for text in following_lines(clip, name, truths, rate, kind):
                print(text, flush=True)
    print(f"\nRendered: {drawn.summary}.\nReal: {real.summary}.")


if __name__ == "__main__":
    main()
