"""Tables of the setup file: schema, dataclasses in SI, TOML output.

A value is a float; its standard uncertainty is ``…_std``, None if not given
(`pipelines.setup.file` has the defaults).
"""

import copy
import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, wraps
from numbers import Complex, Integral, Real
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import (
    Annotated,
    Any,
    ParamSpec,
    TypeAlias,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import tomli_w
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator

from metrology import (
    Defaults,
    Given,
    Measurand,
    SetupError,
    UsageError,
    measurands,
    read_given,
    read_number,
    write_text_whole,
)
from physics import bodies
from physics.air import Air
from physics.effects import MAX_SIZE, Parameter
from physics.restitution import CorLaw, law_as_text

__all__ = [
    "AirSetup",
    "AirTable",
    "BallSetup",
    "BallTable",
    "CameraSetup",
    "ContactOutcomeRow",
    "Measured",
    "ModelSetup",
    "ModelTable",
    "NoiseSetup",
    "PendulumStd",
    "PendulumTable",
    "ScatterSetup",
    "Setup",
    "SetupSchema",
    "WallSetup",
    "checked_values",
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


def _number_in(what: Measurand) -> BeforeValidator:
    def parse(typed: Any) -> float:
        try:
            return read_number(typed, what)
        except UsageError as problem:
            raise ValueError(problem.in_one_line) from problem

    return BeforeValidator(parse)


Angle = Annotated[float, _number_in(measurands.ANGLE_STD)]

Fraction = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]

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

    impact_speed: Annotated[float, _number_in(measurands.SPEED)]
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
    """``[scatter]``: standard deviation from trial to trial."""

    backswing: Angle | None = None
    launch_angle: Angle | None = None
    cor: Fraction | None = None
    cor_law: Fraction | None = None
    launch_angle_law: Angle | None = None


class NoiseTable(_Table):
    """``[noise]``: stated noise of the tracks."""

    position: Annotated[float, _number_in(measurands.POSITION_STD)] | None = None
    angle: Annotated[float, _number_in(measurands.ANGLE_STD), Field(gt=0)] | None = None


class ModelTable(BaseModel):
    """``[model]``: effects of the baseline, and a table of parameters for each."""

    model_config = ConfigDict(extra="allow", frozen=True)

    effects: tuple[str, ...] = ("gravity", "drag")


class ColumnsTable(_Table):
    """``[columns]``: columns and objects of a table of tracks."""

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
    """A parameter of an effect of the catalogue, optionally with unit and uncertainty.

    Parameters
    ----------
    effect, key : str
        Id of the effect and name of its parameter.
    typed : Any
        A number or a text.

    Raises
    ------
    SetupError
        If the effect has no such parameter, or the value is outside its physical range.
    """
    from physics.effects import CATALOGUE

    known: dict[str, Parameter] = {p.name: p for e in CATALOGUE[effect] for p in e.parameters}
    if key not in known:
        raise SetupError(
            f"there is no key 'model.{effect}.{key}'{nearest(key, known)}",
            hint=f"It has {', '.join(known)}.",
        )
    p = known[key]
    size = MAX_SIZE[p.in_units_of]
    lower, upper = size * p.lower, size * p.upper
    example = size * (p.expected if p.expected is not None else p.scale)
    what = Measurand(
        p.meaning or p.name,
        p.unit,
        lower,
        upper,
        f"possible are {lower:g} to {upper:g}",
        f"{example:g} {p.unit if p.unit != '1' else ''}",
    )
    try:
        return read_given(typed, what)
    except UsageError as problem:
        raise SetupError(
            f"[model.{effect}] {key}: {problem.message}", hint=problem.hint
        ) from problem


def nearest(name: str, known: Iterable[str]) -> str:
    """End of a message that names the nearest valid name."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.0)
    return f"; the nearest is '{near[0]}'" if near else ""


Values = ParamSpec("Values")
Result = TypeVar("Result")


def checked_values(function: Callable[Values, Result]) -> Callable[Values, Result]:
    """Check a call against the function's signature; state what it takes if it does not fit.

    Raises
    ------
    UsageError
        For an unknown keyword, too few or too many values, or one of the wrong type.
    """
    signature = inspect.signature(function)
    known = [name for name in signature.parameters if name not in ("self", "cls")]
    asked = function.__qualname__.removesuffix(".__init__")

    @wraps(function)
    def called(*values: Values.args, **named: Values.kwargs) -> Result:
        takes = f"It takes {', '.join(known)}."
        _rename(named, known)
        for name in named.keys() - set(known):
            raise UsageError(f"{asked} has no {name!r}{nearest(name, known)}", hint=takes)
        try:
            given = signature.bind(*values, **named).arguments
        except TypeError as problem:
            raise UsageError(f"{asked}: {problem}", hint=takes) from None
        hints = _hints(function)
        for name in given.keys() & hints.keys():
            if not _fits(given[name], hints[name]):
                raise UsageError(
                    f"{asked}: {name} can't be {given[name]!r}",
                    hint="It takes one clip. Several: iv.campaign([…], out='results')."
                    if (asked, name) == ("measure", "path")
                    and isinstance(given[name], list | tuple)
                    else f"See help({asked}) for what it takes.",
                )
        return function(*values, **named)

    return called


def _rename(named: dict[str, Any], known: Sequence[str]) -> None:
    """Other names of an argument that takes an angle: ``backswing_deg=90``, ``backswing_angle``."""
    for other in [name for name in named if name not in known]:
        stem = other.removesuffix("_deg").removesuffix("_angle")
        if stem != other and stem in known and stem not in named:
            value = named.pop(other)
            number = isinstance(value, Real) and other.endswith("_deg")
            named[stem] = f"{float(value)!r} deg" if number else value


@cache
def _hints(function: Callable[..., object]) -> Mapping[str, Any]:
    """Type hints of a function, if they can be resolved without further imports."""
    try:
        return get_type_hints(function)
    except NameError:  # a pandas type, which is imported only when needed
        return {}


_NUMBERS = {float: Real, int: Integral, complex: Complex}


def _fits(value: object, kind: Any) -> bool:
    """Whether a value matches a type; NumPy arrays count as sequences, NumPy numbers as numbers."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is tuple and Ellipsis not in parts:
        return (
            isinstance(value, Iterable)
            and len(found := list(value)) == len(parts)
            and all(map(_fits, found, parts))
        )
    if origin in (Sequence, tuple):
        return (
            isinstance(value, Iterable)
            and not isinstance(value, str | bytes | Mapping)
            and all(_fits(one, parts[0]) for one in value)
        )
    if origin is Mapping:
        return isinstance(value, Mapping) and all(_fits(key, parts[0]) for key in value)
    plain = _NUMBERS.get(kind, origin or kind)
    return not isinstance(plain, type) or plain is object or isinstance(value, plain)


SCATTER_UNITS = {"cor": "", "cor_law": ""}
"""Units of [scatter] other than angles."""

Measured: TypeAlias = tuple[float, float]
"""Value and standard uncertainty, SI."""


@dataclass(frozen=True)
class CameraSetup:
    """Camera, SI; lengths measured by hand as (value, standard uncertainty)."""

    capture_fps: float | None = None
    distance_to_wall: Measured | None = None
    principal_point_on_wall: tuple[Measured, Measured] | None = None
    shutter: float | None = None
    lens: Path | None = None
    capture_fps_std: float | None = None
    shutter_std: float | None = None


@dataclass(frozen=True)
class WallSetup:
    """Pitch of the grid and of its gradations, m; offset of the ball plane as (value, std), m."""

    grid: float | None = None
    fine_grid: float | None = None
    ball_plane_offset: Measured | None = None
    grid_std: float | None = None
    fine_grid_std: float | None = None


@dataclass(frozen=True)
class BallSetup:
    """A ball: at least its diameter, m; mass, kg, angle, rad, and COR if given.

    `contact_outcome` is the baseline's contact by impact speed (may be empty).
    """

    name: str
    diameter: float
    mass: float | None = None
    launch_angle: float | None = None
    cor: CorLaw | None = None
    contact_outcome: tuple[ContactOutcomeRow, ...] = ()
    diameter_std: float | None = None
    mass_std: float | None = None
    launch_angle_std: float | None = None

    @classmethod
    def preset(cls, name: str) -> "BallSetup":
        """One of the paper's balls (Table 4).

        Raises
        ------
        KeyError
            If there is no preset of that name.
        """
        ball = bodies.BALLS[name]
        return cls(name, ball.diameter, ball.mass, ball.launch_angle, ball.cor)

    def body(self) -> bodies.Ball:
        """The ball as the physics needs it.

        Raises
        ------
        SetupError
            If mass, launch angle or coefficient of restitution is not known.
        """
        missing = [key for key in ("mass", "launch_angle", "cor") if getattr(self, key) is None]
        if missing or self.mass is None or self.launch_angle is None or self.cor is None:
            raise SetupError(
                f"the ball {self.name!r} has no {' and no '.join(missing)}",
                hint="Add it to the ball's table in the setup file, or name a preset.",
            )
        preset = bodies.BALLS.get(self.name)
        if preset is None:
            return bodies.Ball(self.name, self.mass, self.diameter, self.launch_angle, self.cor)
        return replace(
            preset,
            mass=self.mass,
            diameter=self.diameter,
            launch_angle=self.launch_angle,
            cor=self.cor,
        )


@dataclass(frozen=True)
class PendulumStd:
    """Standard uncertainties of the pendulum's properties, SI, if given."""

    length: float | None = None
    inertia: float | None = None
    mass: float | None = None
    com: float | None = None
    effective_mass: float | None = None


@dataclass(frozen=True)
class AirSetup:
    """Air, SI: readings of thermometer, barometer and hygrometer, or density and viscosity."""

    temperature: float | None = None
    pressure: float | None = None
    humidity: float | None = None
    density: float | None = None
    viscosity: float | None = None
    temperature_std: float | None = None
    pressure_std: float | None = None
    humidity_std: float | None = None
    density_std: float | None = None
    viscosity_std: float | None = None

    @property
    def read_off(self) -> bool:
        """Whether a reading of thermometer, barometer or hygrometer is given."""
        return not (self.temperature is None and self.pressure is None and self.humidity is None)

    @property
    def air(self) -> Air:
        """Moist air from the readings, with defaults where there are none."""
        base = self.at(0.0, 0.0, 0.0)
        return replace(
            base,
            density=base.density if self.density is None else self.density,
            viscosity=base.viscosity if self.viscosity is None else self.viscosity,
        )

    def at(self, warmer: float, denser: float, damper: float) -> Air:
        """Air with shifted temperature (K), pressure (Pa) and humidity."""
        if not self.read_off:
            return Air(Defaults.AIR_DENSITY.known, Defaults.AIR_VISCOSITY.known)
        temperature = self.temperature or Defaults.AIR_TEMPERATURE.known
        pressure = self.pressure or Defaults.AIR_PRESSURE.known
        humidity = Defaults.HUMIDITY.known if self.humidity is None else self.humidity
        moved = min(max(humidity + damper, 0.0), 1.0)
        return Air.moist(temperature + warmer, pressure + denser, moved)


@dataclass(frozen=True)
class ScatterSetup:
    """Standard deviation from trial to trial; angles in rad."""

    backswing: float | None = None
    launch_angle: float | None = None
    cor: float | None = None
    cor_law: float | None = None
    launch_angle_law: float | None = None


@dataclass(frozen=True)
class NoiseSetup:
    """Stated noise of the tracks: m and rad."""

    position: float | None = None
    angle: float | None = None


@dataclass(frozen=True)
class ModelSetup:
    """Effects of the baseline model, their parameters and given uncertainties."""

    effects: tuple[str, ...] = ("gravity", "drag")
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    stds: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Setup:
    """Content of setup file and options; SI, frozen; `having` returns changed copies.

    `pendulum` and `ball` are None if not given; `balls` has the named balls of a campaign,
    `columns` the columns of other programs' tables.

    Examples
    --------
    >>> setup = Setup().having({"ball.preset": "jokku", "ball.mass": "0.351 kg ± 1 g"})
    >>> setup.ball.mass, setup.ball.mass_std
    (0.351, 0.001)
    """

    camera: CameraSetup = CameraSetup()
    wall: WallSetup = WallSetup()
    ball: BallSetup | None = None
    balls: Mapping[str, BallSetup] = field(default_factory=dict)
    pendulum: bodies.Pendulum | None = None
    support: bodies.Support | None = None
    air_known: AirSetup = AirSetup()
    scatter: ScatterSetup = ScatterSetup()
    noise: NoiseSetup = NoiseSetup()
    model: ModelSetup = ModelSetup()
    path: Path | None = field(default=None, compare=False)
    pendulum_std: PendulumStd = PendulumStd()
    support_std: float | None = None
    columns: Mapping[str, str] = field(default_factory=dict)

    @property
    def air(self) -> Air:
        """The air of the lab."""
        return self.air_known.air

    @classmethod
    @checked_values
    def load(cls, path: str | PathLike[str]) -> "Setup":
        """Read a setup file.

        Raises
        ------
        SetupError
            As `pipelines.setup.file.load_setup`.
        """
        from pipelines.setup.file import load_setup

        return load_setup(Path(path))

    def to_toml(self) -> str:
        """The text of a setup file that reads back as this setup."""
        return setup_as_toml(self)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the setup file and return its path."""
        write_text_whole(Path(path), self.to_toml())
        return Path(path)

    @checked_values
    def having(self, keys: Mapping[str, Any]) -> "Setup":
        """Copy of the setup with some keys changed, checked like a file.

        Parameters
        ----------
        keys : mapping
            Dotted keys of the setup file to their values; None removes a key.

        Raises
        ------
        SetupError
            As `pipelines.setup.file.read_setup`.
        """
        from pipelines.setup.file import setup_from_document

        return replace(setup_from_document(changed(document_of(self), keys)), path=self.path)


# wrong types are refused when a setup is created, too
Setup.__init__ = checked_values(Setup.__init__)  # type: ignore[method-assign]

_UNITS = {
    "capture_fps": "fps",
    "shutter": "s",
    "grid": "m",
    "fine_grid": "m",
    "mass": "kg",
    "diameter": "m",
    "launch_angle": "rad",
    "length": "m",
    "inertia": "kg m^2",
    "com": "m",
    "effective_mass": "kg",
    "temperature": "K",
    "pressure": "Pa",
    "humidity": "",
    "density": "kg/m^3",
    "viscosity": "Pa s",
}


def setup_as_toml(setup: Setup) -> str:
    """Text of a setup file that reads back as `setup`."""
    return tomli_w.dumps(document_of(setup))


def changed(document: Mapping[str, Any], keys: Mapping[str, Any]) -> dict[str, Any]:
    """A document with dotted keys set, or removed where the new value is None.

    Raises
    ------
    SetupError
        If a key leads through something that is not a table.
    """
    new = copy.deepcopy(dict(document))
    for dotted, value in keys.items():
        *tables, last = dotted.split(".")
        here = new
        for name in tables:
            here = here.setdefault(name, {})
            if not isinstance(here, dict):
                raise SetupError(
                    f"{dotted}: {name!r} is not a table", hint="Write TABLE.NAME, as in ball.mass."
                )
        if value is None:
            here.pop(last, None)
        else:
            here[last] = value
    return new


def document_of(setup: Setup) -> dict[str, Any]:
    """TOML document of a setup: nested dicts of text and numbers, only given values."""
    camera, wall = setup.camera, setup.wall
    measured_lengths = {
        "distance_to_wall": _measured_text(camera.distance_to_wall),
        "lens": None if camera.lens is None else str(_absolute(camera.lens)),
        "principal_point_on_wall": None
        if camera.principal_point_on_wall is None
        else [_measured_text(part) for part in camera.principal_point_on_wall],
    }
    document: dict[str, Any] = {
        "camera": _numbers(camera, "capture_fps", "shutter") | measured_lengths,
        "wall": _numbers(wall, "grid", "fine_grid")
        | {"ball_plane_offset": _measured_text(wall.ball_plane_offset)},
        "ball": None if setup.ball is None else _ball(setup.ball),
        "balls": {name: _ball(ball) for name, ball in setup.balls.items()},
        "pendulum": _pendulum(setup),
        "support": {}
        if setup.support is None
        else {"height": _number(setup.support.height, setup.support_std, "m")},
        "air": _numbers(
            setup.air_known, "temperature", "pressure", "humidity", "density", "viscosity"
        ),
        "scatter": {
            name: _number(value, None, SCATTER_UNITS.get(name, "rad"))
            for name, value in vars(setup.scatter).items()
            if value is not None
        },
        "noise": {
            name: _number(value, None, unit)
            for name, value, unit in (
                ("position", setup.noise.position, "m"),
                ("angle", setup.noise.angle, "rad"),
            )
            if value is not None
        },
        "model": _model(setup),
        "columns": dict(setup.columns),
    }
    return {name: kept for name, table in document.items() if (kept := _given_only(table))}


def _given_only(table: Any) -> dict[str, Any]:
    return {} if table is None else {k: v for k, v in table.items() if v is not None}


def _absolute(path: Path) -> Path:
    return path if path.is_absolute() else path.absolute()


def _number(value: float, std: float | None, unit: str) -> str | float:
    if std is None and not unit:
        return value
    spread = "" if std is None else f" ± {std!r} {unit}"
    return f"{value!r} {unit}{spread}".strip()


def _numbers(table: object, *names: str) -> dict[str, Any]:
    return {
        name: _number(value, getattr(table, f"{name}_std"), _UNITS[name])
        for name in names
        if (value := getattr(table, name)) is not None
    }


def _measured_text(measured: Measured | None) -> str | None:
    return None if measured is None else f"{measured[0]!r} m ± {measured[1]!r} m"


def _ball(ball: BallSetup) -> dict[str, Any]:
    table = _numbers(ball, "mass", "diameter", "launch_angle")
    if ball.name in bodies.BALLS:
        table["preset"] = ball.name
    preset = bodies.BALLS.get(ball.name)
    if ball.cor is not None and (preset is None or ball.cor != preset.cor):
        table["cor"] = law_as_text(ball.cor)
    if ball.contact_outcome:
        table["contact_outcome"] = [row.model_dump() for row in ball.contact_outcome]
    return table


def _pendulum(setup: Setup) -> dict[str, Any]:
    if setup.pendulum is None:
        return {}
    return {
        name: _number(value, getattr(setup.pendulum_std, name), _UNITS[name])
        for name in ("length", "inertia", "mass", "com", "effective_mass")
        if (value := getattr(setup.pendulum, name)) is not None
    }


def _model(setup: Setup) -> dict[str, Any]:
    model = setup.model
    tables = {
        effect: {
            name: _number(value, model.stds.get(effect, {}).get(name), "")
            for name, value in values.items()
        }
        for effect, values in model.parameters.items()
    }
    return {"effects": list(model.effects)} | tables
