"""``python -m bench.hostile.reads [--clips 50]``: damaged clips read five times, pixel by pixel.

Bytes of a clip are overwritten at random behind its head; each reading must give the same frames,
with the same gray levels, or the same refusal.
"""

import argparse
import hashlib
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench.hostile.draw import _sound_clips
from metrology import ClipError
from vision.clip.clip import ClipReader

__all__ = ["damaged", "reading"]

READINGS = 5
_HEAD = 0.05
"""Share of the file that is left alone, so that most clips can still be opened."""


def damaged(data: bytes, of: int) -> bytes:
    """The clip with a few runs of noise in it."""
    rng = np.random.default_rng(of)
    raw = bytearray(data)
    for _ in range(rng.integers(1, 6)):
        at = int(rng.uniform(_HEAD, 1.0) * len(raw))
        run = rng.bytes(int(rng.integers(1, 200)))
        raw[at : at + len(run)] = run[: len(raw) - at]
    return bytes(raw)


def reading(path: Path) -> str:
    """Digest of all frames and times of a clip, or its refusal."""
    digest = hashlib.sha256()
    try:
        for frame in ClipReader.open(path).frames():
            digest.update(repr((frame.index, frame.time_s, frame.gray.shape)).encode())
            digest.update(np.ascontiguousarray(frame.gray).tobytes())
    except ClipError as problem:
        return str(problem)
    return digest.hexdigest()


def main() -> None:
    """Damage, read, compare."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile.reads", description=__doc__)
    parser.add_argument("--clips", type=int, default=50)
    asked = parser.parse_args()
    sound = _sound_clips()
    names = ("long.mp4", "a.mp4", "b.avi", "c.mkv")
    differ, read = 0, 0
    with tempfile.TemporaryDirectory(prefix="reads-") as folder:
        for number in range(asked.clips):
            name = names[number % len(names)]
            path = Path(folder) / f"{number}{Path(name).suffix}"
            path.write_bytes(damaged(sound[name], number))
            found = {reading(path) for _ in range(READINGS)}
            differ += len(found) > 1
            read += all(len(one) == 64 for one in found)
    print("| | at most | found |\n|---|---|---|")
    print(f"| {asked.clips} damaged clips, {READINGS} readings each: different results | 0 |"
          f" {differ} ({read} could be read) |")  # fmt: skip
    sys.exit(min(differ, 1))


if __name__ == "__main__":
    main()
