"""The setup file as it is written: every key a lab may give, checked and turned into SI.

Parameters of effects as people type them: in ``[model.drag]`` and in ``--effect drag:…``.
"""

import difflib
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator

from metrology import Given, Measurand, SetupError, UsageError, measurands, read_given, read_number
from physics.effects import CATALOGUE, LARGEST_SIZE, Parameter

__all__ = [
    "AirTable",
    "BallTable",
    "ContactOutcomeRow",
    "ModelTable",
    "PendulumTable",
    "SetupSchema",
    "nearest",
    "read_parameter",
]


def _given(what: Measurand) -> PlainValidator:
    def parse(typed: Any) -> Given:
        try:
            return read_given(typed, what)
        except UsageError as problem:
            raise ValueError(problem.in_one_line) from problem

    return PlainValidator(parse)


def _number(what: Measurand) -> BeforeValidator:
    def parse(typed: Any) -> float:
        try:
            return read_number(typed, what)
        except UsageError as problem:
            raise ValueError(problem.in_one_line) from problem

    return BeforeValidator(parse)


Angle = Annotated[float, _number(measurands.ANGLE_STD)]

Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]

Finite = Annotated[float, Field(allow_inf_nan=False)]

CameraDistance = Annotated[Given, _given(measurands.CAMERA_DISTANCE)]

WallCoordinate = Annotated[Given, _given(measurands.WALL_COORDINATE)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class CameraTable(_Table):
    """``[camera]``."""

    capture_fps: Annotated[Given, _given(measurands.CAPTURE_RATE)] | None = None
    distance_to_wall: CameraDistance | None = None
    principal_point_on_wall: tuple[WallCoordinate, WallCoordinate] | None = None
    shutter: Annotated[Given, _given(measurands.SHUTTER)] | None = None
    lens: str | None = None


class WallTable(_Table):
    """``[wall]``."""

    grid: Annotated[Given, _given(measurands.GRID_PITCH)] | None = None
    fine_grid: Annotated[Given, _given(measurands.FINE_PITCH)] | None = None
    ball_plane_offset: Annotated[Given, _given(measurands.BALL_PLANE_OFFSET)] | None = None


class ContactOutcomeRow(_Table):
    """One row of ``[[balls.NAME.contact_outcome]]``, SI throughout."""

    impact_speed: Annotated[float, _number(measurands.SPEED)]
    cor: float = Field(gt=0, le=1)
    contact_time: float = Field(gt=0, le=10)
    pendulum_speed_after: Finite
    pendulum_angle: Finite
    ball_x: Finite
    ball_y: Finite
    ball_vx: Finite
    ball_vy: Finite


class BallTable(_Table):
    """``[ball]`` and ``[balls.NAME]``."""

    preset: str | None = None
    mass: Annotated[Given, _given(measurands.BALL_MASS)] | None = None
    diameter: Annotated[Given, _given(measurands.BALL_DIAMETER)] | None = None
    launch_angle: Annotated[Given, _given(measurands.LAUNCH_ANGLE)] | None = None
    cor: float | str | None = None
    contact_outcome: tuple[ContactOutcomeRow, ...] = ()


class PendulumTable(_Table):
    """``[pendulum]``."""

    length: Annotated[Given, _given(measurands.PENDULUM_LENGTH)] | None = None
    inertia: Annotated[Given, _given(measurands.PENDULUM_INERTIA)] | None = None
    mass: Annotated[Given, _given(measurands.PENDULUM_MASS)] | None = None
    com: Annotated[Given, _given(measurands.CENTRE_OF_MASS)] | None = None
    effective_mass: Annotated[Given, _given(measurands.EFFECTIVE_MASS)] | None = None


class SupportTable(_Table):
    """``[support]``."""

    height: Annotated[Given, _given(measurands.SUPPORT_HEIGHT)] | None = None


class AirTable(_Table):
    """``[air]``."""

    temperature: Annotated[Given, _given(measurands.AIR_TEMPERATURE)] | None = None
    pressure: Annotated[Given, _given(measurands.AIR_PRESSURE)] | None = None
    humidity: Annotated[Given, _given(measurands.HUMIDITY)] | None = None
    density: Annotated[Given, _given(measurands.AIR_DENSITY)] | None = None
    viscosity: Annotated[Given, _given(measurands.AIR_VISCOSITY)] | None = None


class ScatterTable(_Table):
    """``[scatter]``: trial to trial, one sigma."""

    backswing: Angle | None = None
    launch_angle: Angle | None = None
    cor: Share | None = None
    cor_law: Share | None = None
    launch_angle_law: Angle | None = None


class NoiseTable(_Table):
    """``[noise]``: a claim about the tracks."""

    position: Annotated[float, _number(measurands.POSITION_STD)] | None = None
    angle: Annotated[float, _number(measurands.ANGLE_STD), Field(gt=0)] | None = None


class ModelTable(BaseModel):
    """``[model]``: effects of the baseline, and a table of parameters for each."""

    model_config = ConfigDict(extra="allow", frozen=True)

    effects: tuple[str, ...] = ("gravity", "drag")


class ColumnsTable(_Table):
    """``[columns]``: what the columns of a table of tracks hold, and which track is which."""

    t: str | None = None
    frame: str | None = None
    x: str | None = None
    y: str | None = None
    object: str | None = None
    trial: str | None = None
    ball: str | None = None
    pendulum: str | None = None
    unit: str | None = None
    t_unit: str | None = None


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
    columns: ColumnsTable = ColumnsTable()


def read_parameter(effect: str, key: str, typed: Any) -> Given:
    """A parameter of an effect of the catalogue, with or without its unit and uncertainty.

    Parameters
    ----------
    effect, key : str
        Id of the effect and name of its parameter.
    typed : Any
        A number or a text.

    Raises
    ------
    SetupError
        If the effect has no such parameter, or nature does not allow the value.
    """
    known: dict[str, Parameter] = {p.name: p for e in CATALOGUE[effect] for p in e.parameters}
    if key not in known:
        raise SetupError(f"there is no key 'model.{effect}.{key}'{nearest(key, known)}")
    p = known[key]
    size = LARGEST_SIZE[p.in_units_of]
    lower, upper = size * p.lower, size * p.upper
    example = size * (p.expected if p.expected is not None else p.scale)
    what = Measurand(
        p.meaning or p.name,
        p.unit,
        lower,
        upper,
        f"nature allows {lower:g} to {upper:g}",
        f"{example:g} {p.unit if p.unit != '1' else ''}",
    )
    try:
        return read_given(typed, what)
    except UsageError as problem:
        raise SetupError(
            f"[model.{effect}] {key}: {problem.message}", hint=problem.hint
        ) from problem


def nearest(name: str, known: Iterable[str]) -> str:
    """Say which of the known names is the nearest, as the end of a message."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.0)
    return f"; the nearest is '{near[0]}'" if near else ""
