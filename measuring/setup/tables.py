"""Tables of the setup file: dataclasses in SI, their schema, TOML output.

A value is a float; its standard uncertainty is ``…_std``, None if not given
(`measuring.setup.file` has the defaults). Each key is declared in its dataclass, with how it is
read and the unit in which it is written; the schema that checks a file is made of these.
"""

import copy
import difflib
import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
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
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    create_model,
)

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
from metrology.measurands import folded
from physics import bodies
from physics.air import Air
from physics.effects import MAX_SIZE, Parameter
from physics.restitution import CorLaw, law_as_text

__all__ = [
    "AirSetup",
    "BallSetup",
    "BallTable",
    "CameraSetup",
    "ContactOutcomeRow",
    "Measured",
    "ModelSetup",
    "ModelTable",
    "NoiseSetup",
    "PendulumStd",
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

WallCoordinate = Annotated[Given, _given(measurands.WALL_COORDINATE)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


def _key(typed: Any, unit: str = "") -> Any:
    """A key of the file: the type of what is written, and the unit in which it is saved."""
    return field(default=None, metadata={"typed": typed, "unit": unit})


def _given_key(what: Measurand, unit: str) -> Any:
    return _key(Annotated[Given, _given(what)], unit)


def _schema_of(table: type, name: str) -> Any:
    """The schema of a table, with the keys of its dataclass."""
    keys: dict[str, Any] = {
        one.name: (one.metadata["typed"] | None, None) for one in fields(table) if one.metadata
    }
    return create_model(name, __base__=_Table, **keys)


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


class ModelTable(BaseModel):
    """``[model]``: effects of the baseline, and a table of parameters for each."""

    model_config = ConfigDict(extra="allow", frozen=True)

    effects: tuple[str, ...] = ("gravity", "drag")


class SupportTable(_Table):
    """``[support]``."""

    height: Annotated[Given, _given(measurands.SUPPORT_HEIGHT)] | None = None


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


_OTHER_NAMES = {
    "capture_fps": "fps frame_rate framerate rate bildrate cadence",
    "mass": "weight masse masa gewicht poids peso",
    "diameter": "radius circumference girth umfang durchmesser diametre diametro size",
    "height": "hohe hauteur altura",
    "length": "lange longueur longitud",
    "grid": "pitch gitter grille cuadricula",
    "camera": "kamera camara",
    "wall": "wand mur pared",
    "ball": "kugel balle bola pelota",
    "pendulum": "pendel pendule pendulo",
    "air": "luft aire",
}
"""Other words, folded, for names of the setup file, in English, German, French and Spanish."""

_CONVERTED = {"radius": "twice the radius"} | dict.fromkeys(
    ("circumference", "girth", "umfang"), "the circumference over 3.1416"
)
"""How the named value follows from the one that is meant."""


def nearest(name: str, known: Iterable[str]) -> str:
    """End of a message that names the valid name that is meant; empty if none is similar."""
    names = list(known)
    asked = folded(re.sub(r"(?<=[a-z])(?=[A-Z])|[-\s]+", "_", name))
    meant = [one for one, words in _OTHER_NAMES.items() if one in names and asked in words.split()]
    meant = meant or difflib.get_close_matches(asked, names, n=1)
    value = f", {_CONVERTED[asked]}" if asked in _CONVERTED else ""
    return f"; the nearest is '{meant[0]}'{value}" if meant else ""


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


_NUMBER_KINDS = {float: Real, int: Integral, complex: Complex}


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
    plain = _NUMBER_KINDS.get(kind, origin or kind)
    return not isinstance(plain, type) or plain is object or isinstance(value, plain)


Measured: TypeAlias = tuple[float, float]
"""Value and standard uncertainty, SI."""


@dataclass(frozen=True)
class CameraSetup:
    """Camera, SI; lengths measured by hand as (value, standard uncertainty)."""

    capture_fps: float | None = _given_key(measurands.CAPTURE_RATE, "fps")
    distance_to_wall: Measured | None = _given_key(measurands.CAMERA_DISTANCE, "m")
    principal_point_on_wall: tuple[Measured, Measured] | None = _key(
        tuple[WallCoordinate, WallCoordinate], "m"
    )
    shutter: float | None = _given_key(measurands.SHUTTER, "s")
    lens: Path | None = _key(str)
    capture_fps_std: float | None = None
    shutter_std: float | None = None


@dataclass(frozen=True)
class WallSetup:
    """Pitch of the grid and of its gradations, m; offset of the ball plane as (value, std), m."""

    grid: float | None = _given_key(measurands.GRID_PITCH, "m")
    fine_grid: float | None = _given_key(measurands.FINE_PITCH, "m")
    ball_plane_offset: Measured | None = _given_key(measurands.BALL_PLANE_OFFSET, "m")
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

    length: float | None = _given_key(measurands.PENDULUM_LENGTH, "m")
    inertia: float | None = _given_key(measurands.PENDULUM_INERTIA, "kg m^2")
    mass: float | None = _given_key(measurands.PENDULUM_MASS, "kg")
    com: float | None = _given_key(measurands.CENTRE_OF_MASS, "m")
    effective_mass: float | None = _given_key(measurands.EFFECTIVE_MASS, "kg")


@dataclass(frozen=True)
class AirSetup:
    """Air, SI: readings of thermometer, barometer and hygrometer, or density and viscosity."""

    temperature: float | None = _given_key(measurands.AIR_TEMPERATURE, "K")
    pressure: float | None = _given_key(measurands.AIR_PRESSURE, "Pa")
    humidity: float | None = _given_key(measurands.HUMIDITY, "")
    density: float | None = _given_key(measurands.AIR_DENSITY, "kg/m^3")
    viscosity: float | None = _given_key(measurands.AIR_VISCOSITY, "Pa s")
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

    backswing: float | None = _key(Angle, "rad")
    launch_angle: float | None = _key(Angle, "rad")
    cor: float | None = _key(Fraction)
    cor_law: float | None = _key(Fraction)
    launch_angle_law: float | None = _key(Angle, "rad")


@dataclass(frozen=True)
class NoiseSetup:
    """Stated noise of the tracks: m and rad."""

    position: float | None = _key(Annotated[float, _number_in(measurands.POSITION_STD)], "m")
    angle: float | None = _key(
        Annotated[float, _number_in(measurands.ANGLE_STD), Field(gt=0)], "rad"
    )


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
            As `measuring.setup.file.load_setup`.
        """
        from measuring.setup.file import load_setup

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
            As `measuring.setup.file.read_setup`.
        """
        from measuring.setup.file import setup_from_document

        return replace(setup_from_document(changed(document_of(self), keys)), path=self.path)


def _required(table: Any) -> Any:
    return (table, table())


_PendulumTable = _schema_of(PendulumStd, "PendulumTable")

SetupSchema = create_model(
    "SetupSchema",
    __base__=_Table,
    camera=_required(_schema_of(CameraSetup, "CameraTable")),
    wall=_required(_schema_of(WallSetup, "WallTable")),
    ball=(BallTable | None, None),
    balls=(dict[str, BallTable], Field(default_factory=dict)),
    pendulum=(_PendulumTable | None, None),
    support=_required(SupportTable),
    air=_required(_schema_of(AirSetup, "AirTable")),
    scatter=_required(_schema_of(ScatterSetup, "ScatterTable")),
    noise=_required(_schema_of(NoiseSetup, "NoiseTable")),
    model=_required(ModelTable),
    columns=_required(ColumnsTable),
)
"""The whole file."""

# wrong types are refused when a setup is created, too
Setup.__init__ = checked_values(Setup.__init__)  # type: ignore[method-assign]


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
        "camera": _numbers(camera) | measured_lengths,
        "wall": _numbers(wall) | {"ball_plane_offset": _measured_text(wall.ball_plane_offset)},
        "ball": None if setup.ball is None else _ball(setup.ball),
        "balls": {name: _ball(ball) for name, ball in setup.balls.items()},
        "pendulum": {} if setup.pendulum is None else _numbers(setup.pendulum_std, setup.pendulum),
        "support": {}
        if setup.support is None
        else {"height": _number(setup.support.height, setup.support_std, "m")},
        "air": _numbers(setup.air_known),
        "scatter": _numbers(setup.scatter),
        "noise": _numbers(setup.noise),
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


def _numbers(table: Any, body: object = None) -> dict[str, Any]:
    """Values of a table's keys that are single numbers, with their uncertainties.

    The values are those of `body` if the table holds its uncertainties.
    """
    found = {}
    for key in fields(table):
        value = getattr(table if body is None else body, key.name, None)
        if key.metadata and isinstance(value, float | int):
            std = getattr(table, f"{key.name}_std" if body is None else key.name, None)
            found[key.name] = _number(value, std, key.metadata["unit"])
    return found


def _measured_text(measured: Measured | None) -> str | None:
    return None if measured is None else f"{measured[0]!r} m ± {measured[1]!r} m"


def _ball(ball: BallSetup) -> dict[str, Any]:
    table: dict[str, Any] = {
        key: _number(value, getattr(ball, f"{key}_std"), unit)
        for key, unit in (("mass", "kg"), ("diameter", "m"), ("launch_angle", "rad"))
        if (value := getattr(ball, key)) is not None
    }
    if ball.name in bodies.BALLS:
        table["preset"] = ball.name
    preset = bodies.BALLS.get(ball.name)
    if ball.cor is not None and (preset is None or ball.cor != preset.cor):
        table["cor"] = law_as_text(ball.cor)
    if ball.contact_outcome:
        table["contact_outcome"] = [row.model_dump() for row in ball.contact_outcome]
    return table


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
