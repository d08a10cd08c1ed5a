"""The setup file as it is written: every key a lab may give, checked and turned into SI."""

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo

from metrology import UnitError, parse_quantity, parse_with_uncertainty

__all__ = ["Measured", "SetupSchema"]

TAPE_STD_M = 0.005

Measured = tuple[float, float]
"""Value and standard uncertainty, SI."""


def _parsed(unit: str) -> BeforeValidator:
    def parse(value: Any, info: ValidationInfo) -> float:
        try:
            return parse_quantity(value, unit)
        except UnitError as problem:
            raise ValueError(problem.message) from problem

    return BeforeValidator(parse)


def _taped(unit: str, default_std: float) -> BeforeValidator:
    def parse(value: Any, info: ValidationInfo) -> Measured:
        try:
            return parse_with_uncertainty(value, unit, default_std)
        except UnitError as problem:
            raise ValueError(problem.message) from problem

    return BeforeValidator(parse)


Length = Annotated[float, _parsed("m"), Field(gt=0)]
Position = Annotated[float, _parsed("m")]
Mass = Annotated[float, _parsed("kg"), Field(gt=0)]
Angle = Annotated[float, _parsed("rad"), Field(ge=-3.1416, le=3.1416)]
Spread = Annotated[float, Field(ge=0)]
TapedLength = Annotated[Measured, _taped("m", TAPE_STD_M)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class CameraTable(_Table):
    """``[camera]``."""

    capture_fps: Annotated[float, _parsed("1/s"), Field(gt=0)] | None = None
    distance_to_wall: TapedLength | None = None
    principal_point_on_wall: tuple[TapedLength, TapedLength] | None = None
    shutter: Annotated[float, _parsed("s"), Field(gt=0)] | None = None
    lens: str | None = None


class WallTable(_Table):
    """``[wall]``."""

    grid: Length | None = None
    fine_grid: Length | None = None
    ball_plane_offset: TapedLength | None = None


class ContactOutcomeRow(_Table):
    """One row of ``[[balls.NAME.contact_outcome]]``, SI throughout."""

    impact_speed: float = Field(gt=0)
    cor: float = Field(gt=0, le=1)
    contact_time: float = Field(gt=0)
    pendulum_speed_after: float
    pendulum_angle: float
    ball_x: float
    ball_y: float
    ball_vx: float
    ball_vy: float


class BallTable(_Table):
    """``[ball]`` and ``[balls.NAME]``."""

    preset: str | None = None
    mass: Mass | None = None
    diameter: Length | None = None
    launch_angle: Angle | None = None
    cor: float | str | None = None
    contact_outcome: tuple[ContactOutcomeRow, ...] = ()


class PendulumTable(_Table):
    """``[pendulum]``."""

    length: Length | None = None
    inertia: Annotated[float, _parsed("kg*m^2"), Field(gt=0)] | None = None
    mass: Mass | None = None
    com: Length | None = None
    effective_mass: Mass | None = None


class SupportTable(_Table):
    """``[support]``."""

    height: Length | None = None


class AirTable(_Table):
    """``[air]``."""

    temperature: Annotated[float, _parsed("kelvin"), Field(gt=0)] | None = None
    pressure: Annotated[float, _parsed("Pa"), Field(gt=0)] | None = None
    humidity: Annotated[float, Field(ge=0, le=1)] | None = None
    density: Annotated[float, _parsed("kg/m^3"), Field(gt=0)] | None = None
    viscosity: Annotated[float, _parsed("Pa*s"), Field(gt=0)] | None = None


class ScatterTable(_Table):
    """``[scatter]``: trial to trial, one sigma."""

    backswing: Annotated[float, _parsed("rad"), Field(ge=0)] | None = None
    launch_angle: Annotated[float, _parsed("rad"), Field(ge=0)] | None = None
    cor: Spread | None = None
    cor_law: Spread | None = None
    launch_angle_law: Annotated[float, _parsed("rad"), Field(ge=0)] | None = None


class NoiseTable(_Table):
    """``[noise]``: a claim about the tracks."""

    position: Annotated[float, _parsed("m"), Field(gt=0)] | None = None
    angle: Annotated[float, _parsed("rad"), Field(gt=0)] | None = None


class ModelTable(BaseModel):
    """``[model]``: effects of the baseline, and a table of parameters for each."""

    model_config = ConfigDict(extra="allow", frozen=True)

    effects: tuple[str, ...] = ("gravity", "drag")


class SetupSchema(_Table):
    """The whole file."""

    camera: CameraTable = CameraTable()
    wall: WallTable = WallTable()
    ball: BallTable | None = None
    balls: dict[str, BallTable] = Field(default_factory=dict)
    pendulum: PendulumTable | None = None
    support: SupportTable = SupportTable()
    air: AirTable = AirTable()
    scatter: ScatterTable = ScatterTable()
    noise: NoiseTable = NoiseTable()
    model: ModelTable = ModelTable()
