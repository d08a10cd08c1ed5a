"""The result of one clip: quantities, checks and warnings, and what the pictures are drawn from."""

from dataclasses import dataclass

from calib.calibration import Calibration
from calib.grid.grid import WallGrid
from metrology import Quantity
from pipelines.measure.fits.impact import Impact
from pipelines.report import Check
from pipelines.setup.rig import Known
from vision.clip.capture_rate import CaptureRate
from vision.clip.info import ClipInfo
from vision.tracks import Tracks

__all__ = ["QUANTITY_UNITS", "Measurement"]

QUANTITY_UNITS: dict[str, str] = {
    "contact_frames": "1",
    "contact_time": "s",
    "contact_start": "s",
    "contact_end": "s",
    "pendulum_speed_before": "m/s",
    "pendulum_speed_after": "m/s",
    "ball_speed": "m/s",
    "launch_angle": "deg",
    "landing_distance": "m",
    "landing_distance_on_wall": "m",
    "landing_time": "s",
    "cor_speeds": "1",
    "cor_launch": "1",
    "cor_range": "1",
    "cor": "1",
    "external_impulse": "N s",
    "energy_loss": "J",
    "backswing_angle": "deg",
    "ball_plane_offset": "m",
    "camera_distance": "m",
}
"""Quantities of the contract with their units; ``cor`` fuses the three roads."""


@dataclass(frozen=True)
class Measurement:
    """All that was measured in one clip.

    Attributes
    ----------
    info : ClipInfo
    rate : CaptureRate
    quantities : tuple of Quantity
        In the order of `QUANTITY_UNITS`; those that can't be measured say why.
    beside : tuple of Quantity
        The ball's speed the paper's ways: per frame (Fig. 18), and from the pendulum (Eq. 7).
    gravity : Quantity
        Free-fall acceleration of the flight: the self-check of rate and scale.
    checks : tuple of Check
    warnings : tuple of str
    tracks : Tracks
        In pixels.
    grid : WallGrid or None
        The wall's lines, where they gave a calibration.
    calibration : Calibration or None
        None where no grid was found.
    impact : Impact or None
        None where no strike could be measured.
    defaults : tuple of Known
        Numbers of the rig whose value or uncertainty nobody gave.
    """

    info: ClipInfo
    rate: CaptureRate
    quantities: tuple[Quantity, ...]
    beside: tuple[Quantity, ...]
    gravity: Quantity
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    tracks: Tracks
    grid: WallGrid | None
    calibration: Calibration | None
    impact: Impact | None
    defaults: tuple[Known, ...] = ()

    def quantity(self, name: str) -> Quantity:
        """The quantity of that name."""
        return next(item for item in self.quantities if item.name == name)
