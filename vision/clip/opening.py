"""What is settled when a video is opened: fields, orientation, clock, and what to warn of."""

from itertools import islice
from pathlib import Path
from typing import Literal

from vision.clip.fields import CombingDetector
from vision.clip.info import ClipInfo, Weave
from vision.clip.picture import Upright, bit_depth, upright_of
from vision.clip.video_file import VideoFile

__all__ = ["Fields", "open_video"]

Fields = Literal["auto", "progressive", "top_first", "bottom_first"]

# Looking for woven fields stops after this many pixels, some 0.05 s of decoding, but not before so
# many pictures; broadcast sizes, which alone are recorded in fields, are worth a longer look.
_COMBING_PIXELS = 16_000_000
_COMBING_PICTURES = 48
_BROADCAST_PICTURES = 300
_BROADCAST_HEIGHTS = (480, 486, 512, 576, 608, 1080, 1088)


def open_video(path: Path, fields: Fields) -> tuple[VideoFile, ClipInfo, Upright]:
    """Open a video file.

    Parameters
    ----------
    path : Path
        An existing file that is not empty.
    fields : {"auto", "progressive", "top_first", "bottom_first"}
        As in `Clip.open`.

    Returns
    -------
    video : VideoFile
    info : ClipInfo
    upright : Upright

    Raises
    ------
    ClipError
        If it can't be read.
    """
    video = VideoFile(path)
    times = video.packets.times
    weave, notes = _weave(video) if fields == "auto" else (fields, [])
    upright, note = upright_of(video.first_picture, video.pixel_aspect)
    notes += [note] if note else []
    parts = 1 if weave == "progressive" else 2
    height, width = video.first_picture.height, video.first_picture.width
    width = round(width * upright.stretch)
    if upright.stretch != 1.0:
        notes.append(
            f"Stored pixels are {upright.stretch:.4f} times as wide as high; pictures are "
            "stretched to square pixels."
        )
    rate = 1.0 / times.interval_s if times.interval_s > 0 else video.declared_rate
    info = ClipInfo(
        path=path,
        sha256=video.sha256(),
        width=height if upright.swap else width,
        height=width if upright.swap else height,
        frames=parts * len(times.seconds),
        codec=video.codec,
        container_fps=parts * rate,
        container_declares_rate=True,
        duration_s=float(times.seconds[-1]) + (parts - 1) * 0.5 / rate,
        rotation=upright.rotation,
        weave=weave,
        bit_depth=bit_depth(video.first_picture),
        capture_fps_metadata=video.capture_fps(),
        variable_rate=times.variable,
        warnings=tuple(_file_warnings(video) + notes),
    )
    return video, info, upright


def _weave(video: VideoFile) -> tuple[Weave, list[str]]:
    height, width = video.first_picture.height, video.first_picture.width
    broadcast = height in _BROADCAST_HEIGHTS
    least = _BROADCAST_PICTURES if broadcast else _COMBING_PICTURES
    detector = CombingDetector()
    for picture in islice(video.pictures(), max(least, _COMBING_PIXELS // (height * width))):
        if detector.wants(picture.index):
            detector.show(picture.gray())
        if detector.settled:
            break
    seen = detector.verdict()
    half_line = (
        "the fields are separated, which doubles the frame rate, and each is resampled onto the "
        "full picture's lines, which takes out the half-line offset between them"
    )
    if video.declared_interlaced:
        if seen != "progressive":
            return seen, [f"The clip is interlaced: {half_line}."]
        if detector.settled:
            return "progressive", [
                "The file calls its pictures interlaced, but what moves in them shows no combing; "
                "they are taken as whole pictures."
            ]
        return video.declared_order, [
            f"The clip is interlaced, says the file, and too little moves to check it: {half_line}."
        ]
    if seen == "progressive":
        return seen, []
    return seen, [f"The pictures are combed: two fields woven without a flag; {half_line}."]


def _file_warnings(video: VideoFile) -> list[str]:
    packets = video.packets
    times = packets.times
    found = len(times.seconds)
    notes = []
    if packets.declared > found + packets.edited_out:
        notes.append(
            f"The file is cut off: it declares {packets.declared} pictures and holds {found} "
            f"({100 * found / packets.declared:.0f} %); what is there is read."
        )
    elif packets.declared_s and found > 1 and not packets.declared:
        end = float(times.seconds[-1]) + times.interval_s
        # Sound may outlast the pictures in a whole file, and a last frame may be shown long.
        if not packets.whole and end < 0.98 * packets.declared_s - 2.0 * times.interval_s:
            notes.append(
                f"The file is cut off: it declares {packets.declared_s:.2f} s and ends at "
                f"{end:.2f} s ({100 * end / packets.declared_s:.0f} %); what is there is read."
            )
    if packets.corrupt:
        notes.append(f"{packets.corrupt} packets of the file are damaged.")
    if not packets.stamped:
        notes.append(
            "The file has no usable time stamps; its frames are taken to be evenly spaced at "
            f"{video.declared_rate:.4g} frames per second."
        )
    if times.missing:
        notes.append(
            f"{times.missing} frames are missing from an otherwise even clock (dropped while "
            "recording); the gaps keep their time."
        )
    return notes
