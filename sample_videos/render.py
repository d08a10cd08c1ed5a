"""Render a scene to memory, or to a clip with its truth file.

Clips are H.264, MJPEG, lossless FFV1, or a folder of pictures.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from tempfile import mkdtemp

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from metrology import UsageError, written_whole
from sample_videos.film import Film
from sample_videos.scene import Encoding, Scene
from sample_videos.shot import SceneMotion, Shot
from sample_videos.truth import Truth, film_truth, write_truth

__all__ = ["REPEATABLE", "SUFFIXES_OF", "render_clip", "render_frames", "write_clip"]

Picture = NDArray[np.uint8]

SUFFIXES_OF = {
    "h264": (".mp4", ".mov", ".mkv"),
    "mjpeg": (".avi", ".mov", ".mkv"),
    "ffv1": (".mkv", ".avi"),
    "png": ("",),
}

"""File names that each codec may have; a folder of pictures has none."""

PIXEL_FORMATS = {"h264": "yuv420p", "mjpeg": "yuvj420p", "ffv1": "bgr0"}

# x264's AVX-512 code gives another clip at every run, of the same pictures and on one thread; the
# code for SSE4.2, which NumPy asks of a processor anyhow, gives what AVX2's gives, every time
REPEATABLE = {"x264-params": "asm=SSE4.2"}


def write_clip(frames: Iterable[Picture], path: Path, encoding: Encoding) -> None:
    """Write frames (H, W, 3), uint8, blue green red; whole or not at all.

    Raises
    ------
    UsageError
        If the name does not go with the codec, the size can't be encoded, or the place can't be
        written to.
    """
    if path.suffix.lower() not in SUFFIXES_OF[encoding.codec]:
        wanted = ", ".join(SUFFIXES_OF[encoding.codec]) if encoding.codec != "png" else "no suffix"
        raise UsageError(
            f"{path.name} does not go with the codec {encoding.codec}",
            hint=f"Use {wanted}.",
        )
    if encoding.codec == "png":
        _write_folder(frames, path)
        return
    with written_whole(path) as temporary:
        _write_video(frames, temporary, encoding)


def _write_video(frames: Iterable[Picture], path: Path, encoding: Encoding) -> None:
    rate = Fraction(encoding.container_fps).limit_denominator(1001)
    pixel = PIXEL_FORMATS[encoding.codec]
    with av.open(str(path), "w") as container:
        stream = None
        for index, picture in enumerate(frames):
            if stream is None:
                stream = container.add_stream(
                    "libx264" if encoding.codec == "h264" else encoding.codec, rate=rate
                )
                stream.height, stream.width = picture.shape[:2]
                stream.pix_fmt = pixel
                stream.thread_count = 1
                if encoding.codec != "ffv1" and encoding.rate_factor is None:
                    stream.bit_rate = int(encoding.bitrate)
                if encoding.codec == "h264":
                    if picture.shape[0] % 2 or picture.shape[1] % 2:
                        raise UsageError(
                            f"H.264 can't hold {picture.shape[1]} x {picture.shape[0]} px",
                            hint="Use an even width and height.",
                        )
                    stream.options = {"preset": "medium", "profile": "high", **REPEATABLE}
                    if encoding.rate_factor is not None:
                        stream.options |= {"crf": f"{encoding.rate_factor:g}"}
                    stream.codec_context.colorspace = 5
                    stream.codec_context.color_range = 1
            frame = _converted(picture, encoding.codec)
            frame.pts = index
            frame.time_base = 1 / rate
            container.mux(stream.encode(frame))
        if stream is None:
            raise UsageError("a clip of no frames can't be written")
        container.mux(stream.encode(None))


def _converted(picture: Picture, codec: str) -> av.VideoFrame:
    if codec == "h264":
        # the scaler in FFmpeg cuts luma off where this one rounds: half a gray level on the mean
        planes = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420), dtype=np.uint8)
        return av.VideoFrame.from_ndarray(planes, format="yuv420p")
    return av.VideoFrame.from_ndarray(picture, format="bgr24").reformat(format=PIXEL_FORMATS[codec])


def _write_folder(frames: Iterable[Picture], path: Path) -> None:
    if path.exists():
        raise UsageError(
            f"the folder {path} exists", hint="Choose another name, or remove it first."
        )
    try:
        temporary = Path(mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    except OSError as problem:
        raise UsageError(
            f"can't write {path}: {problem.strerror}",
            hint="Choose a folder inside an existing one that you may write to.",
        ) from problem
    try:
        count = 0
        for count, picture in enumerate(frames, 1):
            cv2.imwrite(str(temporary / f"{count - 1:06d}.png"), picture)
        if count == 0:
            raise UsageError("a clip of no frames can't be written")
        temporary.chmod(0o755)
        temporary.replace(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def render_frames(scene: Scene, shot: Shot | SceneMotion) -> tuple[Iterator[Picture], Truth]:
    """Frames (H, W, 3), uint8, blue green red, as an iterator, and the truth about them.

    Parameters
    ----------
    shot : Shot or SceneMotion
        A stroke (see `strike`, `staged`), or any motion of ball and pendulum.
    """
    film, stroke = _film(scene, shot)
    return film.frames(), film_truth(film, stroke)


def render_clip(
    scene: Scene,
    shot: Shot | SceneMotion,
    path: Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Truth:
    """Film a scene to `path` (frames are written as they are rendered) with its truth file.

    Parameters
    ----------
    progress : callable, optional
        Called with the number of frames done and the number of all.

    Raises
    ------
    UsageError
        If the file can't be written, or its name does not go with the codec.
    """
    film, stroke = _film(scene, shot)
    total = len(film.kept())

    def counted() -> Iterator[Picture]:
        for done, picture in enumerate(film.frames(), 1):
            yield picture
            if progress is not None:
                progress(done, total)

    truth = film_truth(film, stroke)
    write_clip(counted(), path, scene.encoding)
    write_truth(truth, path)
    return truth


def _film(scene: Scene, shot: Shot | SceneMotion) -> tuple[Film, Shot | None]:
    if isinstance(shot, Shot):
        return Film(scene, shot.motion), shot
    return Film(scene, shot), None
