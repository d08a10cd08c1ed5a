"""What is written by hand held against the library that does the same: accuracy, and time.

Run: python -m bench.house.libraries

Times are ratios of CPU time within one run, the two taken in turns.
"""

import asyncio
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import scipy.stats
from starlette.middleware.trustedhost import TrustedHostMiddleware

from pipelines.web import Guard
from vision.scene import Aligner

PICTURES, SHIFT_PX, NOISE, BODY = 40, 1.5, 2.0, 60
"""Frames per kind of scene, largest shift, noise in gray levels, side in px of what moves."""
DRAWS = 2000


def ratio(ours: Callable[[], Any], library: Callable[[], Any], rounds: int = 7) -> float:
    """CPU time of the library over ours, medians of runs in turns."""
    spent: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for times, work in zip(spent, (ours, library), strict=True):
            start = time.process_time()
            work()
            times.append(time.process_time() - start)
    return float(np.median(spent[1]) / np.median(spent[0]))


def spread() -> list[tuple[str, str]]:
    """Median absolute deviation: an expression, and scipy's function."""
    values = np.random.default_rng(1).normal(size=(400, 60))

    def by_hand() -> list[float]:
        return [1.4826 * float(np.median(np.abs(row))) for row in values]

    def scipys() -> list[float]:
        return [
            float(scipy.stats.median_abs_deviation(row, center=_zero, scale="normal"))
            for row in values
        ]

    apart = float(np.max(np.abs(np.array(by_hand()) / np.array(scipys()) - 1.0)))
    rows = [("median absolute deviation of 60: largest difference", f"{apart:.1e}"),
            ("… time of scipy.stats over ours", f"{ratio(by_hand, scipys):.1f}")]  # fmt: skip
    rows.append(("loading scipy.stats, s of CPU", f"{_loading('scipy.stats'):.2f}"))
    return rows


def _zero(values: np.ndarray, axis: int) -> float:
    return 0.0


def _loading(module: str) -> float:
    """CPU seconds of an import beyond numpy and scipy.optimize, which are loaded anyway."""
    code = (
        "import time, numpy, scipy.optimize, scipy.special; t = time.process_time(); "
        f"import {module}; print(time.process_time() - t)"
    )
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
            for _ in range(5)]  # fmt: skip
    return float(np.median([float(run.stdout) for run in runs]))


def bootstrap() -> list[tuple[str, str]]:
    """Interval of a ratio of held-out errors: five lines, and scipy's function."""
    rng = np.random.default_rng(2)
    before, after = rng.chisquare(3, 24) * 2.0, rng.chisquare(3, 24)

    def by_hand() -> np.ndarray:
        picks = np.random.default_rng(11).integers(0, before.size, (DRAWS, before.size))
        found = np.sqrt(before[picks].sum(axis=1) / after[picks].sum(axis=1))
        return np.asarray(np.quantile(found, [0.025, 0.975]))

    def scipys() -> np.ndarray:
        found = scipy.stats.bootstrap(
            (before, after),
            lambda a, b, axis: np.sqrt(a.sum(axis=axis) / b.sum(axis=axis)),
            paired=True, vectorized=True, n_resamples=DRAWS, method="percentile",
            random_state=np.random.default_rng(11),
        )  # fmt: skip
        return np.asarray(found.confidence_interval)

    ends = [", ".join(f"{end:.3f}" for end in one()) for one in (by_hand, scipys)]
    return [("95 % interval of a ratio by ours; by scipy.stats.bootstrap", "; ".join(ends)),
            ("… time of scipy.stats over ours", f"{ratio(by_hand, scipys):.1f}")]  # fmt: skip


def _scene(seed: int) -> np.ndarray:
    texture = np.random.default_rng(seed).normal(size=(300, 400)).astype(np.float32)
    return 120.0 + 60.0 * cv2.GaussianBlur(texture, (0, 0), 3.0) * 6.0


def _ecc(scene: np.ndarray, frame: np.ndarray) -> np.ndarray:
    warp = np.eye(2, 3, dtype=np.float32)
    ends = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-5)
    try:
        _, warp = cv2.findTransformECC(scene, frame, warp, cv2.MOTION_EUCLIDEAN, ends, None, 5)
    except cv2.error:
        return np.full(2, np.nan)
    middle = np.array([0.5 * (scene.shape[1] - 1), 0.5 * (scene.shape[0] - 1), 1.0])
    return np.asarray(warp @ middle - middle[:2])


def alignment() -> list[tuple[str, str]]:
    """Frames of a moved camera, without and with a body that moves in front of the scene."""
    rows = []
    for words, body in (("an empty scene", False), ("a body in front", True)):
        scene = _scene(3)
        aligner = Aligner(scene, NOISE)
        rng = np.random.default_rng(4)
        frames, shifts = [], []
        for _ in range(PICTURES):
            shift = rng.uniform(-SHIFT_PX, SHIFT_PX, 2)
            moved = cv2.warpAffine(
                scene, np.float32([[1, 0, shift[0]], [0, 1, shift[1]]]),
                scene.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT,
            )  # fmt: skip
            if body:
                x, y = rng.integers(0, 400 - BODY), rng.integers(0, 300 - BODY)
                moved[y : y + BODY, x : x + BODY] = 20.0
            frames.append(moved + rng.normal(scale=NOISE, size=scene.shape).astype(np.float32))
            shifts.append(shift)
        ours = np.array([aligner.view(frame).shift_px for frame in frames]) - shifts
        theirs = np.array([_ecc(scene, frame) for frame in frames]) - shifts
        errors = [f"{np.sqrt(np.nanmean(np.square(e))):.4f}" for e in (ours, theirs)]
        spent = ratio(lambda a=aligner, f=frames: [a.view(frame) for frame in f],
                      lambda s=scene, f=frames: [_ecc(s, frame) for frame in f], 3)  # fmt: skip
        rows.append((f"camera's shift, {words}: RMS error, px, ours; ECC", "; ".join(errors)))
        rows.append(("… time of findTransformECC over ours", f"{spent:.1f}"))
    return rows


def hosts() -> list[tuple[str, str]]:
    """Requests under names that are not the page's: which of two doors lets them through."""
    port = 8123

    async def inner(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    trusted = TrustedHostMiddleware(inner, allowed_hosts=["127.0.0.1", "localhost"])
    guard = Guard(inner, port, what="page", command="none")
    asked: dict[str, list[bytes]] = {
        "another name": [b"evil.example:8123"],
        "its name, another port": [b"127.0.0.1:80"],
        "two names": [b"127.0.0.1:8123", b"evil.example"],
        "none": [],
    }
    rows = []
    for words, names in asked.items():
        let = [asyncio.run(_status(app, names)) for app in (guard, trusted)]
        rows.append((f"host: {words}: ours; TrustedHostMiddleware", "; ".join(map(str, let))))
    return rows


async def _status(app: Any, names: list[bytes]) -> int:
    told: list[int] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: dict[str, Any]) -> None:
        told.append(message.get("status", 0))

    scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers":
             [(b"host", name) for name in names], "scheme": "http",
             "server": ("127.0.0.1", 8123), "client": ("127.0.0.1", 1)}  # fmt: skip
    await app(scope, receive, send)
    return told[0]


def main() -> None:
    """Print what each costs and reaches."""
    print("| | |\n|---|---|")
    for part in (spread, bootstrap, alignment, hosts):
        for what, value in part():
            print(f"| {what} | {value} |", flush=True)


if __name__ == "__main__":
    main()
