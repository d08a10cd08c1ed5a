"""The result of one clip: quantities, checks and warnings, and what the pictures are drawn from."""

from dataclasses import dataclass

from calib.calibration import Calibration
from calib.grid.grid import WallGrid
from metrology import Quantity
from pipelines.measure.impact import Impact
from pipelines.measure.inputs import QUANTITY_UNITS
from pipelines.report import Check
from pipelines.setup.rig import RigNumber
from vision.clip.footage import CaptureRate
from vision.clip.picture import ClipInfo
from vision.tracks import Motion, Tracks

__all__ = ["QUANTITY_UNITS", "ClipMeasurement"]


@dataclass(frozen=True)
class ClipMeasurement:
    """All that was measured in one clip.

    Attributes
    ----------
    info : ClipInfo
    rate : CaptureRate
    quantities : tuple of Quantity
        In the order of `QUANTITY_UNITS`; those that can't be measured say why.
    other_speeds : tuple of Quantity
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
    defaults : tuple of RigNumber
        Numbers of the rig whose value or uncertainty nobody gave.
    """

    info: ClipInfo
    rate: CaptureRate
    quantities: tuple[Quantity, ...]
    other_speeds: tuple[Quantity, ...]
    gravity: Quantity
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    tracks: Tracks
    grid: WallGrid | None
    calibration: Calibration | None
    impact: Impact | None
    defaults: tuple[RigNumber, ...] = ()

    @property
    def motion(self) -> Motion:
        """What was seen to happen."""
        return self.tracks.motion

    def quantity(self, name: str) -> Quantity:
        """The quantity of that name."""
        return next(item for item in self.quantities if item.name == name)
