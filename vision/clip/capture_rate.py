"""How many frames per second the camera took, who says so, and how well it is known."""

import math
from dataclasses import dataclass
from enum import StrEnum

from metrology import UsageError
from vision.clip.info import ClipInfo

__all__ = ["CaptureRate", "RateSource", "choose_capture_rate", "nominal_rate_std"]


class RateSource(StrEnum):
    """Who says how fast the camera ran; in the order in which they are believed."""

    OPTION = "option"
    SETUP = "setup"
    METADATA = "metadata"
    CONTAINER = "container"
    ASSUMED = "assumed"


ASSUMED_FPS = 600.0
HIGH_SPEED_FPS = 119.0
"""From here up a container's rate is the camera's; 119.88 is the slowest nominal "120"."""

# A nominal rate may be the broadcast one, 1000/1001 of it (SMPTE ST 12): a rectangle of that width.
_NOMINAL_SPREAD = (1.0 / 1001.0) / math.sqrt(12.0)


@dataclass(frozen=True)
class CaptureRate:
    """Frame rate of the camera.

    Attributes
    ----------
    fps : float
        Frames (fields, where they are separated) per second of real time.
    std : float
        Its standard uncertainty, 1/s; infinite where the rate is only assumed.
    source : RateSource
        Where the number comes from.
    notice : str or None
        What the user must know about it.
    """

    fps: float
    std: float
    source: RateSource
    notice: str | None = None

    @property
    def known(self) -> bool:
        """Whether anything tells the rate: only then are there seconds."""
        return math.isfinite(self.std)


def nominal_rate_std(fps: float) -> float:
    """Standard uncertainty of a rate that is only known by its name, 1/s: 600 may be 599.4."""
    return fps * _NOMINAL_SPREAD


def choose_capture_rate(
    info: ClipInfo,
    option: float | None = None,
    setup: float | None = None,
    *,
    option_std: float | None = None,
    setup_std: float | None = None,
) -> CaptureRate:
    """Choose: option, else setup file, metadata, container rate if high; 600 is assumed at last.

    Parameters
    ----------
    info : ClipInfo
        Of the clip.
    option, setup : float, optional
        Rate from the command line and from the setup file, 1/s.
    option_std, setup_std : float, optional
        Their standard uncertainties, 1/s; if not given, nominal and broadcast rate are both held
        possible.

    Returns
    -------
    CaptureRate

    Raises
    ------
    UsageError
        If a given rate is not positive.
    """
    if option is not None:
        return _given(option, option_std, RateSource.OPTION, info)
    if setup is not None:
        return _given(setup, setup_std, RateSource.SETUP, info)
    if info.capture_fps_metadata is not None:
        metadata_fps = info.capture_fps_metadata
        return CaptureRate(metadata_fps, nominal_rate_std(metadata_fps), RateSource.METADATA)
    rate = info.container_fps
    if info.container_declares_rate and rate >= HIGH_SPEED_FPS:
        return CaptureRate(rate, nominal_rate_std(rate), RateSource.CONTAINER)
    said = f"{rate:.4g} frames per second" if info.container_declares_rate else "no frame rate"
    return CaptureRate(
        ASSUMED_FPS,
        math.inf,
        RateSource.ASSUMED,
        f"CAPTURE RATE ASSUMED: {info.path.name} declares {said} and not the camera's rate; "
        f"{ASSUMED_FPS:g} fps is assumed. Times and speeds are given only where a free fall with a "
        "known scale tells the rate: give the true one with --fps RATE or capture_fps in the "
        "setup file.",
    )


def _given(fps: float, std: float | None, source: RateSource, info: ClipInfo) -> CaptureRate:
    if not (math.isfinite(fps) and fps > 0):
        raise UsageError(
            f"a capture rate of {fps:g} fps makes no sense", hint="Give it as --fps 600."
        )
    told = info.capture_fps_metadata
    notice = None
    if told is not None and abs(told / fps - 1.0) > 0.005:
        notice = (
            f"The file itself says {told:g} fps, the {source} {fps:g} fps; the {source} is used."
        )
    return CaptureRate(fps, nominal_rate_std(fps) if std is None else std, source, notice)
