"""The setup file: what a lab knows, read once and handed on as bodies of the physics room.

Contract: every key is optional; an unknown key is an error that names the nearest right one.
"""

import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from metrology import SetupError, UnitError, UsageError, parse_quantity
from physics import bodies
from physics.flight.air import PAPER_AIR, Air
from physics.restitution.restitution import CorLaw, parse_cor_law
from pipelines.setup.schema import (
    AirTable,
    BallTable,
    ContactOutcomeRow,
    Measured,
    ModelTable,
    PendulumTable,
    SetupSchema,
)

__all__ = [
    "BallSetup",
    "CameraSetup",
    "ModelSetup",
    "NoiseSetup",
    "ScatterSetup",
    "Setup",
    "WallSetup",
    "ball_from_option",
    "load_setup",
    "parse_setup",
]


@dataclass(frozen=True)
class CameraSetup:
    """What is known of the camera, SI; lengths as (value, standard uncertainty)."""

    capture_fps: float | None = None
    distance_to_wall: Measured | None = None
    principal_point_on_wall: tuple[Measured, Measured] | None = None
    shutter: float | None = None
    lens: Path | None = None


@dataclass(frozen=True)
class WallSetup:
    """Pitch of the grid and of its gradations, m; offset of the ball plane as (value, std), m."""

    grid: float | None = None
    fine_grid: float | None = None
    ball_plane_offset: Measured | None = None


@dataclass(frozen=True)
class BallSetup:
    """What is known of a ball: at least its diameter, m; mass kg, angle rad, COR where given.

    `contact_outcome` is what the baseline expects a contact to do, by impact speed (may be empty).
    """

    name: str
    diameter: float
    mass: float | None = None
    launch_angle: float | None = None
    cor: CorLaw | None = None
    contact_outcome: tuple[ContactOutcomeRow, ...] = ()

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
class ScatterSetup:
    """Trial-to-trial scatter, one sigma; angles in rad."""

    backswing: float | None = None
    launch_angle: float | None = None
    cor: float | None = None
    cor_law: float | None = None
    launch_angle_law: float | None = None


@dataclass(frozen=True)
class NoiseSetup:
    """A claim about the noise of the tracks: m and rad."""

    position: float | None = None
    angle: float | None = None


@dataclass(frozen=True)
class ModelSetup:
    """Effects of the baseline model and their parameters."""

    effects: tuple[str, ...] = ("gravity", "drag")
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Setup:
    """All that the setup file and the options say.

    `pendulum`, `ball` are None where nothing was said; `balls` holds the named balls of a campaign.
    """

    camera: CameraSetup = CameraSetup()
    wall: WallSetup = WallSetup()
    ball: BallSetup | None = None
    balls: Mapping[str, BallSetup] = field(default_factory=dict)
    pendulum: bodies.Pendulum | None = None
    support: bodies.Support | None = None
    air: Air = PAPER_AIR
    scatter: ScatterSetup = ScatterSetup()
    noise: NoiseSetup = NoiseSetup()
    model: ModelSetup = ModelSetup()
    path: Path | None = None


def load_setup(path: Path) -> Setup:
    """Read a setup file.

    Raises
    ------
    SetupError
        If the file is missing, is no TOML, has an unknown key or a value out of range.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise SetupError(
            f"can't read the setup file {path}: {problem}", hint="Check the path given to --setup."
        ) from problem
    return replace(parse_setup(text, str(path), folder=path.parent), path=path)


def parse_setup(text: str, name: str = "setup", *, folder: Path = Path()) -> Setup:
    """Parse the text of a setup file; `folder` is where relative paths in it start.

    Raises
    ------
    SetupError
        As `load_setup`.
    """
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise SetupError(f"{name} is not valid TOML: {problem}") from problem
    try:
        schema = SetupSchema.model_validate(raw)
    except ValidationError as problem:
        raise SetupError(_explain(problem, name)) from problem
    try:
        return _build(schema, folder)
    except SetupError as problem:
        raise SetupError(f"{name}: {problem.message}", hint=problem.hint) from problem


def ball_from_option(text: str) -> BallSetup:
    """Ball named with ``--ball``: a preset's name, or a diameter such as ``220mm``.

    Raises
    ------
    UsageError
        If it is neither.
    """
    if text in bodies.BALLS:
        return _preset(text)
    try:
        diameter = parse_quantity(text, "m")
    except UnitError as problem:
        raise UsageError(
            f"--ball {text!r} is neither a preset nor a diameter",
            hint=f"Presets: {', '.join(bodies.BALLS)}; or a diameter such as '220 mm'.",
        ) from problem
    if not 0.001 <= diameter <= 2:
        raise UsageError(
            f"--ball {text!r} would be a ball of {diameter:g} m",
            hint="Give the diameter with its unit, such as '220 mm'.",
        )
    return BallSetup(text, diameter)


def _preset(name: str) -> BallSetup:
    ball = bodies.BALLS[name]
    return BallSetup(name, ball.diameter, ball.mass, ball.launch_angle, ball.cor)


def _build(schema: SetupSchema, folder: Path) -> Setup:
    camera = schema.camera
    lens = None if camera.lens is None else folder / camera.lens
    return Setup(
        camera=CameraSetup(
            camera.capture_fps,
            camera.distance_to_wall,
            camera.principal_point_on_wall,
            camera.shutter,
            lens,
        ),
        wall=WallSetup(schema.wall.grid, schema.wall.fine_grid, schema.wall.ball_plane_offset),
        ball=None if schema.ball is None else _ball("ball", schema.ball),
        balls={name: _ball(name, table) for name, table in schema.balls.items()},
        pendulum=None if schema.pendulum is None else _pendulum(schema.pendulum),
        support=None if schema.support.height is None else bodies.Support(schema.support.height),
        air=_air(schema.air),
        scatter=ScatterSetup(**schema.scatter.model_dump()),
        noise=NoiseSetup(**schema.noise.model_dump()),
        model=_model(schema.model),
    )


def _ball(name: str, table: BallTable) -> BallSetup:
    preset_name = table.preset or (name if name in bodies.BALLS else None)
    if preset_name is not None and preset_name not in bodies.BALLS:
        raise SetupError(
            f"there is no ball preset {preset_name!r}", hint=f"Presets: {', '.join(bodies.BALLS)}."
        )
    if preset_name is not None:
        base = _preset(preset_name)
    elif table.diameter is not None:
        base = BallSetup(name, table.diameter)
    else:
        raise SetupError(
            f"the ball {name!r} has no diameter",
            hint='Add diameter = "220 mm", or preset = "jokku".',
        )
    given: dict[str, Any] = {
        key: value
        for key in ("mass", "diameter", "launch_angle")
        if (value := getattr(table, key)) is not None
    }
    if table.cor is not None:
        try:
            given["cor"] = parse_cor_law(table.cor)
        except UsageError as problem:
            raise SetupError(
                f"ball {name!r}, cor: {problem.message}", hint=problem.hint
            ) from problem
    return replace(base, contact_outcome=table.contact_outcome, **given)


def _pendulum(table: PendulumTable) -> bodies.Pendulum:
    paper = bodies.PAPER_PENDULUM
    given = {key: value for key, value in table.model_dump().items() if value is not None}
    # a pendulum of the lab's own does not have the paper's effective mass: I/L² then
    effective_mass = given.pop("effective_mass", None if given else paper.effective_mass)
    return replace(paper, **given, effective_mass=effective_mass)


def _air(table: AirTable) -> Air:
    if {"temperature", "pressure", "humidity"} & table.model_fields_set:
        base = Air.moist(
            table.temperature or 299.15,
            table.pressure or 101325.0,
            0.5 if table.humidity is None else table.humidity,
        )
    else:
        base = PAPER_AIR
    overrides = {
        key: value for key in ("density", "viscosity") if (value := getattr(table, key)) is not None
    }
    return replace(base, **overrides)


def _model(table: ModelTable) -> ModelSetup:
    parameters: dict[str, dict[str, float]] = {}
    for name, values in (table.model_extra or {}).items():
        if not isinstance(values, dict) or not all(
            isinstance(value, int | float) for value in values.values()
        ):
            raise SetupError(
                f"[model] {name} is not a table of numbers",
                hint=f"Write [model.{name}] and a line for each parameter.",
            )
        parameters[name] = {key: float(value) for key, value in values.items()}
    return ModelSetup(table.effects, parameters)


def _explain(problem: ValidationError, name: str) -> str:
    lines = []
    for error in problem.errors():
        where = ".".join(str(part) for part in error["loc"])
        if error["type"] == "extra_forbidden":
            nearest = _nearest_key(tuple(str(part) for part in error["loc"]))
            lines.append(f"{name}: there is no key '{where}'{nearest}")
        else:
            text = error["msg"].removeprefix("Value error, ")
            lines.append(f"{name}: {where}: {text}")
    return "\n".join(lines)


def _nearest_key(location: tuple[str, ...]) -> str:
    model: type[BaseModel] = SetupSchema
    for part in location[:-1]:
        if model is SetupSchema and part in ("ball", "balls"):
            model = BallTable
        elif part == "contact_outcome":
            model = ContactOutcomeRow
        elif (found := model.model_fields.get(part)) is not None:
            inner = found.annotation
            candidates = [inner, *getattr(inner, "__args__", ())]
            model = next(
                (
                    item
                    for item in candidates
                    if isinstance(item, type) and issubclass(item, BaseModel)
                ),
                model,
            )
    near = difflib.get_close_matches(location[-1], model.model_fields, n=1, cutoff=0.0)
    return f"; the nearest is '{near[0]}'" if near else ""
