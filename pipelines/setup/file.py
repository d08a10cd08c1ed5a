"""The setup file: what a lab knows, read once and handed on as bodies of the physics room.

Contract: every key is optional; an unknown key is an error that names the nearest right one.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from metrology import (
    Defaults,
    Given,
    SetupError,
    UnitError,
    UsageError,
    measurands,
    parse_toml,
    read_given,
    read_small_text,
)
from physics import bodies
from physics.effects import CATALOGUE
from physics.restitution import CorLaw, parse_cor_law, require_real
from physics.swing import frictionless_speed
from pipelines.setup.tables import (
    AirSetup,
    AirTable,
    BallSetup,
    BallTable,
    CameraSetup,
    ContactOutcomeRow,
    Measured,
    ModelSetup,
    ModelTable,
    NoiseSetup,
    PendulumStd,
    PendulumTable,
    ScatterSetup,
    Setup,
    SetupSchema,
    WallSetup,
    nearest,
    read_parameter,
)

__all__ = [
    "AirSetup",
    "BallSetup",
    "CameraSetup",
    "ModelSetup",
    "NoiseSetup",
    "ScatterSetup",
    "Setup",
    "WallSetup",
    "ball_from_option",
    "load_setup",
    "read_setup",
    "setup_from_document",
]

GRAVITY_EFFECT = "gravity"
"""Always in a model; named in its list of effects, but no entry of the catalogue."""

SLOWEST, FASTEST = 0.05, 8.0
"""m/s: impact speeds at which a law of restitution must have a value where no pendulum says more;
8 m/s is what a pendulum of 1.6 m length reaches from upright."""

MOST_TOLD = 12
"""Mistakes of a setup file that one message tells: half a screen."""


def load_setup(path: Path) -> Setup:
    """Read a setup file.

    Raises
    ------
    SetupError
        If the file is missing, is no TOML, has an unknown key or a value out of range.
    """
    text = read_small_text(
        path, what="the setup file", hint="Check the path given to --setup.", error=SetupError
    )
    return replace(read_setup(text, str(path), folder=path.parent), path=path)


def read_setup(text: str, name: str = "setup", *, folder: Path = Path()) -> Setup:
    """Read the text of a setup file; `folder` is where relative paths in it start.

    Raises
    ------
    SetupError
        As `load_setup`.
    """
    return setup_from_document(parse_toml(text, name), name, folder=folder)


def setup_from_document(
    document: Mapping[str, Any], name: str = "setup", *, folder: Path = Path()
) -> Setup:
    """Check the document of a setup file (nested tables) and turn it into SI.

    Raises
    ------
    SetupError
        As `load_setup`.
    """
    try:
        schema = SetupSchema.model_validate(document)
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
        return BallSetup.preset(text)
    try:
        diameter = read_given(text, measurands.BALL_DIAMETER, "--ball")
    except UnitError as problem:
        raise UsageError(
            f"--ball {text!r} is neither a preset nor a diameter",
            hint=f"Presets: {', '.join(bodies.BALLS)}; or a diameter such as '220 mm'.",
        ) from problem
    return BallSetup(text, diameter.value, diameter_std=diameter.std)


def _build(schema: SetupSchema, folder: Path) -> Setup:
    camera, wall = schema.camera, schema.wall
    point = camera.principal_point_on_wall
    pendulum = None if schema.pendulum is None else _pendulum(schema.pendulum)
    fastest = FASTEST
    if pendulum is not None:
        fastest = float(frictionless_speed(pendulum, np.pi, 0.0))
    return Setup(
        camera=CameraSetup(
            _value(camera.capture_fps),
            _taped(camera.distance_to_wall),
            None if point is None else (_tape(point[0]), _tape(point[1])),
            _value(camera.shutter),
            None if camera.lens is None else folder / camera.lens,
            _std(camera.capture_fps),
            _std(camera.shutter),
        ),
        wall=WallSetup(
            _value(wall.grid),
            _value(wall.fine_grid),
            _taped(wall.ball_plane_offset),
            _std(wall.grid),
            _std(wall.fine_grid),
        ),
        ball=None if schema.ball is None else _ball("ball", schema.ball, fastest),
        balls={name: _ball(name, table, fastest) for name, table in schema.balls.items()},
        pendulum=pendulum,
        support=None
        if schema.support.height is None
        else bodies.Support(schema.support.height.value),
        air_known=_air(schema.air),
        scatter=ScatterSetup(**schema.scatter.model_dump()),
        noise=NoiseSetup(**schema.noise.model_dump()),
        model=_model(schema.model),
        pendulum_std=PendulumStd()
        if schema.pendulum is None
        else PendulumStd(**{key: _std(given) for key, given in schema.pendulum}),
        support_std=_std(schema.support.height),
        columns=schema.columns.model_dump(exclude_none=True),
    )


def _value(given: Given | None) -> float | None:
    return None if given is None else given.value


def _std(given: Given | None) -> float | None:
    return None if given is None else given.std


def _tape(given: Given) -> Measured:
    std = Defaults.TAPE.std_of(given.value) if given.std is None else given.std
    return given.value, std


def _taped(given: Given | None) -> Measured | None:
    return None if given is None else _tape(given)


def _ball(name: str, table: BallTable, fastest: float) -> BallSetup:
    preset_name = table.preset or (name if name in bodies.BALLS else None)
    if preset_name is not None and preset_name not in bodies.BALLS:
        raise SetupError(
            f"there is no ball preset {preset_name!r}", hint=f"Presets: {', '.join(bodies.BALLS)}."
        )
    if preset_name is not None:
        base = BallSetup.preset(preset_name)
    elif table.diameter is not None:
        base = BallSetup(name, table.diameter.value)
    else:
        raise SetupError(
            f"the ball {name!r} has no diameter",
            hint='Add diameter = "220 mm", or preset = "jokku".',
        )
    changes: dict[str, Any] = {}
    for key in ("mass", "diameter", "launch_angle"):
        given: Given | None = getattr(table, key)
        if given is not None:
            changes |= {key: given.value, f"{key}_std": given.std}
    if table.cor is not None:
        speeds = [row.impact_speed for row in table.contact_outcome]
        changes["cor"] = _cor_law(name, table.cor, max([fastest, *speeds]))
    return replace(base, contact_outcome=table.contact_outcome, **changes)


def _cor_law(name: str, text: str | float, fastest: float) -> CorLaw:
    try:
        law = parse_cor_law(text)
        require_real(law, SLOWEST, fastest)
    except UsageError as problem:
        raise SetupError(f"ball {name!r}, cor: {problem.message}", hint=problem.hint) from problem
    return law


def _pendulum(table: PendulumTable) -> bodies.Pendulum:
    paper = bodies.PAPER_PENDULUM
    given = {key: value.value for key, value in table if value is not None}
    # a pendulum of the lab's own does not have the paper's effective mass: I/L² then
    effective_mass = given.pop("effective_mass", None if given else paper.effective_mass)
    return replace(paper, **given, effective_mass=effective_mass)


def _air(table: AirTable) -> AirSetup:
    values = {key: _value(given) for key, given in table}
    stds = {f"{key}_std": _std(given) for key, given in table}
    return AirSetup(**values, **stds)


def _model(table: ModelTable) -> ModelSetup:
    known = (GRAVITY_EFFECT, *CATALOGUE)
    for name in table.effects:
        if name not in known:
            raise SetupError(f"[model] effects: there is no effect {name!r}{nearest(name, known)}")
    parameters: dict[str, dict[str, float]] = {}
    stds: dict[str, dict[str, float]] = {}
    for effect, values in (table.model_extra or {}).items():
        if effect not in CATALOGUE:
            raise SetupError(f"there is no key 'model.{effect}'{nearest(effect, CATALOGUE)}")
        if not isinstance(values, dict):
            raise SetupError(
                f"[model] {effect} is not a table of numbers",
                hint=f"Write [model.{effect}] and a line for each parameter.",
            )
        read = {key: read_parameter(effect, key, typed) for key, typed in values.items()}
        parameters[effect] = {key: given.value for key, given in read.items()}
        stds[effect] = {key: g.std for key, g in read.items() if g.std is not None}
    return ModelSetup(table.effects, parameters, {k: v for k, v in stds.items() if v})


def _explain(problem: ValidationError, name: str) -> str:
    lines = []
    errors = problem.errors()
    for error in errors[:MOST_TOLD]:
        where = ".".join(str(part) for part in error["loc"])
        if error["type"] == "extra_forbidden":
            nearest = _nearest_key(tuple(str(part) for part in error["loc"]))
            lines.append(f"{name}: there is no key '{where}'{nearest}")
        else:
            text = error["msg"].removeprefix("Value error, ")
            lines.append(f"{name}: {where}: {text}")
    if len(errors) > MOST_TOLD:
        lines.append(f"{name}: and {len(errors) - MOST_TOLD} more of that kind")
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
    return nearest(location[-1], model.model_fields)
