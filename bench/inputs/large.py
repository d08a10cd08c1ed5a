"""CPU time and memory of large inputs: a 4K clip, a sheet of a million rows, one of many columns.

Run: python -m bench.inputs.large [--json FILE]

Each input is made in a temporary folder and given to the command in a process of its own, with
numerical libraries on one thread and nothing kept of earlier runs.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from bench.inputs.__main__ import written
from metrology import write_text_whole
from vision.clip.clip import ClipReader

_STRIKE = Path(os.environ.get("IMPACT_VISION_SHARED", "../shared")) / "inputs"
_WIDTH_4K = 3840
_FRAMES = 60
_ROWS = 1_000_000
_COLUMNS = 500_000


def _clip(folder: Path) -> tuple[str, ...]:
    """The strike of ``../shared/inputs``, every fifth frame of it, enlarged to 4K."""
    frames = [
        np.asarray(one.gray, np.uint8)
        for one in ClipReader.open(_STRIKE / "base_strike.mkv").frames()
    ]
    high, wide = frames[0].shape
    size = (_WIDTH_4K, 2 * round(0.5 * high * _WIDTH_4K / wide))
    step = len(frames) // _FRAMES
    large = [
        cv2.resize(one, size, interpolation=cv2.INTER_CUBIC) for one in frames[::step][:_FRAMES]
    ]
    clip = written(large, folder / "large.mp4")
    return ("measure", str(clip), "--setup", str(_STRIKE / "lab.toml"), "--fps", str(600 // step))


def _long(folder: Path) -> tuple[str, ...]:
    time = np.arange(_ROWS) / 1000.0
    table = np.column_stack([time, 0.3 + 0.1 * np.sin(time), 0.4 + 0.1 * np.cos(time)])
    np.savetxt(folder / "long.csv", table, "%.4f", ",", header="t (s),x (m),y (m)", comments="")
    return ("measure", "--from-tracks", str(folder / "long.csv"), "--ball", "jokku")


def _wide(folder: Path) -> tuple[str, ...]:
    path = folder / "wide.csv"
    names = ",".join(f"c{k}" for k in range(_COLUMNS))
    path.write_text(f"{names}\n{','.join(['1'] * _COLUMNS)}\n", encoding="utf-8")
    return ("measure", "--from-tracks", str(path), "--ball", "jokku")


_LARGE: dict[str, Callable[[Path], tuple[str, ...]]] = {
    "4K, 60 frames": _clip,
    "a million rows": _long,
    "500,000 columns": _wide,
}


def _cost(words: tuple[str, ...]) -> tuple[float, float, int]:
    """CPU time, s, largest memory, MB, and exit code of a command; run in a fresh process."""
    environment = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    done = subprocess.run(
        [sys.executable, "-c", "from pipelines.cli import app; app()", *words, "--quiet"],
        env={**os.environ, **environment, "IMPACT_VISION_CACHE": "off"},
        stdout=subprocess.DEVNULL,
        check=False,
    )
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0, done.returncode


def main() -> None:
    """Print and store the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.inputs.large")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    found = {}
    print("| input | CPU, s | memory, MB | exit code |\n|---|---|---|---|")
    for name, make in _LARGE.items():
        with tempfile.TemporaryDirectory() as place, get_context("fork").Pool(1) as pool:
            seconds, megabytes, code = pool.apply(_cost, (make(Path(place)),))
        found[name] = {"seconds": round(seconds, 1), "megabytes": round(megabytes), "code": code}
        print(f"| {name} | {seconds:.1f} | {megabytes:.0f} | {code} |", flush=True)
    if asked.json is not None:
        write_text_whole(asked.json, json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
