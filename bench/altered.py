"""Altered copies of clips, with options and truth altered accordingly.

Clips are mirrored, rotated, padded, cropped, resized, brightened, re-encoded, re-muxed, extended
by still frames, thinned and re-timed.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cases import Case
from sample_videos.render import REPEATABLE

Pictures = list[NDArray[np.uint8]]
CLOCK_QUANTITIES = ("contact_start", "contact_end")
RATE_BOUND = ("contact_frames",)


@dataclass(frozen=True)
class Way:
    """An alteration of a clip.

    Attributes
    ----------
    change : callable
        Maps the frames to altered frames.
    before, after : int
        Number of noisy copies of the first and the last frame added before and after.
    every : int
        Every n-th frame is kept.
    dropped : float
        Fraction of frames dropped at random; the others keep their times.
    codec, suffix, options : str, str, dict
        Codec, container and encoder options.
    rotation : int or None
        Rotation in the display metadata, °.
    mirrored : bool
        Whether left and right are exchanged; distances along the wall in the setup change sign.
    """

    name: str
    change: Callable[[Pictures], Pictures] = lambda all_: all_
    before: int = 0
    after: int = 0
    every: int = 1
    dropped: float = 0.0
    codec: str = "libx264"
    suffix: str = ".mp4"
    options: dict[str, str] = field(default_factory=lambda: {"crf": "16", "preset": "fast"})
    rotation: int | None = None
    mirrored: bool = False


def resized(factor: float) -> Callable[[Pictures], Pictures]:
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return lambda all_: [
        np.asarray(
            cv2.resize(one, None, fx=factor, fy=factor, interpolation=method), dtype=np.uint8
        )
        for one in all_
    ]


def gained(gain: float, power: float = 1.0) -> Callable[[Pictures], Pictures]:
    return lambda all_: [
        np.clip(255.0 * gain * (one / 255.0) ** power, 0, 255).astype(np.uint8) for one in all_
    ]


def noisy(pictures: Pictures) -> Pictures:
    """Noise of 6 gray levels and flicker of 8 %."""
    rng = np.random.default_rng(1)
    return [
        np.clip(
            one * (1 + 0.08 * np.sin(1.05 * index)) + rng.normal(0, 6, one.shape), 0, 255
        ).astype(np.uint8)
        for index, one in enumerate(pictures)
    ]


def cropped(pictures: Pictures) -> Pictures:
    height, width = pictures[0].shape
    rows, columns = height // 30, width // 30
    return [one[rows : height - rows, columns : width - columns] for one in pictures]


WAYS = (
    Way("mirrored", lambda all_: [one[:, ::-1] for one in all_], mirrored=True),
    Way("turned by 90°", lambda all_: [np.rot90(one) for one in all_]),
    Way(
        "turned by 90° and back by metadata", lambda all_: [np.rot90(o) for o in all_], rotation=-90
    ),
    Way("padded", lambda all_: [np.pad(one, 16) for one in all_]),
    Way("cropped", cropped),
    Way("halved", resized(0.5)),
    Way("doubled", resized(2.0)),
    Way("brightened", gained(1.2)),
    Way("dimmed, another transfer curve", gained(0.6, 1.6)),
    Way("noise of 6 levels, flicker of 8 %", noisy),
    Way("MJPEG", codec="mjpeg", suffix=".avi", options={"qmin": "2", "qmax": "4"}),
    Way(
        "VP9", codec="libvpx-vp9", suffix=".webm", options={"crf": "20", "b": "0", "cpu-used": "6"}
    ),
    Way(
        "H.265",
        codec="libx265",
        options={
            "crf": "18",
            "preset": "fast",
            "x265-params": "log-level=1:pools=none:frame-threads=1:asm=sse4.2",
        },
    ),
    Way("crushed to a fiftieth", options={"crf": "36", "preset": "fast"}),
    Way("another container", suffix=".mkv"),
    Way("0.1 s still before and after", before=60, after=60),
    Way("1 s still before and after", before=600, after=600),
    Way("5 s still before and after", before=3000, after=3000),
    Way("every second frame", every=2),
    Way("frames dropped, times kept", dropped=0.1),
    Way("folder of pictures", suffix=""),
)


def still(picture: NDArray[np.uint8], count: int, seed: int) -> Pictures:
    rng = np.random.default_rng(seed)
    return [
        np.clip(picture + rng.normal(0, 1.5, picture.shape), 0, 255).astype(np.uint8)
        for _ in range(count)
    ]


def read(path: Path) -> Pictures:
    with av.open(str(path)) as container:
        return [
            np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8)
            for frame in container.decode(video=0)
        ]


def written(pictures: Pictures, stamps: list[int], path: Path, way: Way) -> Path:
    """Write frames as a clip of 30 frames per second, or as a folder of images."""
    if way.suffix == "":
        path.mkdir()
        for index, picture in enumerate(pictures):
            cv2.imwrite(str(path / f"{index:05d}.png"), picture)
        return path
    pix_fmt = "yuvj420p" if way.codec == "mjpeg" else "yuv420p"
    height, width = (length - length % 2 for length in pictures[0].shape)
    # without bitexact a Matroska file gets another random number at every run
    with av.open(str(path), "w", options={"fflags": "+bitexact"}) as container:
        options = way.options | (REPEATABLE if way.codec == "libx264" else {})
        stream = container.add_stream(way.codec, rate=30, options=options)
        stream.thread_count = 1
        stream.width, stream.height, stream.pix_fmt = width, height, pix_fmt
        if way.rotation is not None:
            stream.set_display_rotation(way.rotation)
        for picture, stamp in zip(pictures, stamps, strict=True):
            whole = np.ascontiguousarray(picture[:height, :width])
            frame = av.VideoFrame.from_ndarray(whole, format="gray").reformat(format=pix_fmt)
            frame.pts, frame.time_base = stamp, Fraction(1, 30)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def altered(case: Case, way: Way, folder: Path) -> Case:
    """The case with its altered clip, and options and truth altered accordingly."""
    pictures = read(case.path)
    pictures = [
        *still(pictures[0], way.before, 2),
        *pictures[:: way.every],
        *still(pictures[-1], way.after, 3),
    ]
    kept = np.random.default_rng(4).random(len(pictures)) >= way.dropped
    stamps = [int(index) for index in np.flatnonzero(kept)]
    pictures = way.change([pictures[index] for index in stamps])
    name = f"{case.name}-{WAYS.index(way)}{way.suffix}".replace(" ", "_")
    fps = case.fps / way.every
    setup = case.options.setup
    nominal = (setup.camera.capture_fps or case.fps) / way.every
    foot = setup.camera.principal_point_on_wall
    if way.mirrored and foot is not None:
        foot = ((-foot[0][0], foot[0][1]), foot[1])
    camera = replace(setup.camera, capture_fps=nominal, principal_point_on_wall=foot)
    options = replace(case.options, setup=replace(setup, camera=camera))
    later = way.before / case.fps
    bound = RATE_BOUND if way.every > 1 or way.dropped else ()
    truth = {
        key: value + later if key in CLOCK_QUANTITIES else value
        for key, value in case.truth.items()
        if key not in bound
    }
    path = written(pictures, stamps, folder / name, way)
    return replace(case, name=f"{case.name} ({way.name})", path=path, options=options, fps=fps,
                   truth=truth)  # fmt: skip
