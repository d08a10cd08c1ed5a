"""Setup file: reading, checks, and properties of the apparatus.

Every key is optional; an unknown key is an error that names the nearest valid one (contract).
"""

import difflib
import math
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from measuring.setup.tables import (
    AirSetup,
    BallSetup,
    BallTable,
    CameraSetup,
    ContactOutcomeRow,
    Measured,
    ModelSetup,
    ModelTable,
    NoiseSetup,
    PendulumStd,
    ScatterSetup,
    Setup,
    SetupSchema,
    WallSetup,
    nearest,
    read_parameter,
)
from metrology import (
    Default,
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
from metrology.quantity import format_value
from physics import bodies
from physics.restitution import CorLaw, parse_cor_law, require_real
from physics.swing import frictionless_speed

__all__ = [
    "SIZE_AND_MASS",
    "AirSetup",
    "BallSetup",
    "CameraSetup",
    "ModelSetup",
    "NoiseSetup",
    "Origin",
    "Rig",
    "RigNumber",
    "ScatterSetup",
    "Setup",
    "SetupLike",
    "WallSetup",
    "ball_from_option",
    "load_setup",
    "meant_name",
    "read_setup",
    "rig_of",
    "setup_from",
    "setup_from_document",
]

GRAVITY_EFFECT = "gravity"
"""Part of every model; allowed in its list of effects, but not in the catalogue."""

MIN_LAW_SPEED, MAX_LAW_SPEED = 0.05, 8.0
"""m/s: range in which a law of restitution must have values without a given pendulum (chosen: 8 m/s
is the speed of a pendulum of 1.6 m length released upright)."""

MAX_LISTED_MISTAKES = 12
"""Maximum number of mistakes listed in one message (chosen: half a screen)."""


SetupLike = Setup | str | os.PathLike[str] | None
"""A setup, its file, or none."""


def setup_from(setup: SetupLike) -> Setup:
    """The setup itself, read from its file, or an empty one.

    Raises
    ------
    SetupError
        If the file can't be read.
    """
    if setup is None:
        return Setup()
    return setup if isinstance(setup, Setup) else load_setup(Path(setup))


def load_setup(path: Path) -> Setup:
    """Read a setup file.

    Raises
    ------
    SetupError
        If the file is missing, is not TOML, has an unknown key or a value out of range.
    """
    text = read_small_text(
        path, what="the setup file", hint="Check the path given to --setup.", error=SetupError
    )
    return replace(read_setup(text, str(path), folder=path.parent), path=path)


def read_setup(text: str, name: str = "setup", *, folder: Path = Path()) -> Setup:
    """Read the text of a setup file; relative paths in it start at `folder`.

    Raises
    ------
    SetupError
        As `load_setup`.
    """
    return setup_from_document(parse_toml(text, name), name, folder=folder)


def setup_from_document(
    document: Mapping[str, Any], name: str = "setup", *, folder: Path = Path()
) -> Setup:
    """Check the document of a setup file (nested tables) and convert it to SI.

    Raises
    ------
    SetupError
        As `load_setup`.
    """
    try:
        schema = SetupSchema.model_validate(document)
    except ValidationError as problem:
        raise SetupError(_explain(problem, name), hint=_advice(problem)) from problem
    try:
        return _build(schema, folder)
    except SetupError as problem:
        raise SetupError(f"{name}: {problem.message}", hint=problem.hint) from problem


def meant_name(text: str, names: Iterable[str]) -> str:
    """The name that is written, or most probably meant: letter case is ignored; "" for none."""
    known = {name.casefold(): name for name in names}
    alike = difflib.get_close_matches(text.strip().casefold(), known, n=1, cutoff=0.75)
    return known[alike[0]] if alike else ""


SIZE_AND_MASS = re.compile(r"(?P<size>.*?),\s*(?P<mass>[^,]*(,\d+)?[^,]*g)\s*")
"""A comma may also be a decimal one."""


def ball_from_option(text: str) -> BallSetup:
    """Ball of ``--ball``: a preset's name or a diameter; ``220 mm, 0.35 kg`` adds the mass.

    Raises
    ------
    UsageError
        If it is neither.
    """
    if both := SIZE_AND_MASS.fullmatch(text):
        mass = read_given(both["mass"], measurands.BALL_MASS, "--ball, mass")
        known = ball_from_option(both["size"].strip())
        return replace(known, mass=mass.value, mass_std=mass.std)
    preset = meant_name(text, bodies.BALLS)
    if preset in bodies.BALLS and preset.casefold() == text.strip().casefold():
        return BallSetup.preset(preset)
    try:
        diameter = read_given(text, measurands.BALL_DIAMETER, "--ball")
    except UnitError as problem:
        meant = f"; did you mean {preset!r}?" if preset else ""
        raise UsageError(
            f"--ball {text!r} is neither a preset nor a diameter{meant}",
            hint=f"Presets: {', '.join(bodies.BALLS)}; or a diameter such as '220 mm', with the"
            " mass as in '220 mm, 0.35 kg'.",
        ) from problem
    return BallSetup(text, diameter.value, diameter_std=diameter.std)


def _build(schema: Any, folder: Path) -> Setup:
    camera = _in_si(schema.camera, CameraSetup)
    if camera["principal_point_on_wall"] is not None:
        camera["principal_point_on_wall"] = tuple(
            _with_default_std(part) for part in schema.camera.principal_point_on_wall
        )
    if schema.camera.lens is not None:
        camera["lens"] = folder / schema.camera.lens
    pendulum = None if schema.pendulum is None else _pendulum(schema.pendulum)
    fastest = MAX_LAW_SPEED
    if pendulum is not None:
        fastest = float(frictionless_speed(pendulum, np.pi, 0.0))
    height = schema.support.height
    return Setup(
        camera=CameraSetup(**camera),
        wall=WallSetup(**_in_si(schema.wall, WallSetup)),
        ball=None if schema.ball is None else _ball("ball", schema.ball, fastest),
        balls={name: _ball(name, table, fastest) for name, table in schema.balls.items()},
        pendulum=pendulum,
        support=None if height is None else bodies.Support(height.value),
        air_known=AirSetup(**_in_si(schema.air, AirSetup)),
        scatter=ScatterSetup(**_in_si(schema.scatter, ScatterSetup)),
        noise=NoiseSetup(**_in_si(schema.noise, NoiseSetup)),
        model=_model(schema.model),
        pendulum_std=PendulumStd()
        if schema.pendulum is None
        else PendulumStd(**{key: given and given.std for key, given in schema.pendulum}),
        support_std=None if height is None else height.std,
        columns=schema.columns.model_dump(exclude_none=True),
    )


def _in_si(table: BaseModel, kind: type) -> dict[str, Any]:
    """Values of a table by the names of its dataclass; a length by hand is a pair with its std."""
    names = {one.name for one in fields(kind)}
    found: dict[str, Any] = {}
    for key, given in table:
        if not isinstance(given, Given):
            found[key] = given
        elif f"{key}_std" in names:
            found |= {key: given.value, f"{key}_std": given.std}
        else:
            found[key] = _with_default_std(given)
    return found


def _with_default_std(given: Given) -> Measured:
    std = Defaults.TAPE.std_of(given.value) if given.std is None else given.std
    return given.value, std


def _ball(name: str, table: BallTable, fastest: float) -> BallSetup:
    preset_name = table.preset or (name if name in bodies.BALLS else None)
    if preset_name is not None and preset_name not in bodies.BALLS:
        meant = meant_name(preset_name, bodies.BALLS)
        raise SetupError(
            f"there is no ball preset {preset_name!r}"
            + (f"; did you mean {meant!r}?" if meant else ""),
            hint=f"Presets: {', '.join(bodies.BALLS)}.",
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
        require_real(law, MIN_LAW_SPEED, fastest)
    except UsageError as problem:
        raise SetupError(f"ball {name!r}, cor: {problem.message}", hint=problem.hint) from problem
    return law


def _pendulum(table: BaseModel) -> bodies.Pendulum:
    paper = bodies.PAPER_PENDULUM
    given = {key: value.value for key, value in table if value is not None}
    # another pendulum than the paper's has another effective mass: I/L²
    effective_mass = given.pop("effective_mass", None if given else paper.effective_mass)
    return replace(paper, **given, effective_mass=effective_mass)


def _model(table: ModelTable) -> ModelSetup:
    if table == ModelTable():
        return ModelSetup()
    from physics.effects import CATALOGUE

    known = (GRAVITY_EFFECT, *CATALOGUE)
    for name in table.effects:
        if name not in known:
            raise SetupError(
                f"[model] effects: there is no effect {name!r}{nearest(name, known)}",
                hint=f"Effects are {', '.join(known)}.",
            )
    parameters: dict[str, dict[str, float]] = {}
    stds: dict[str, dict[str, float]] = {}
    for effect, values in (table.model_extra or {}).items():
        if effect not in CATALOGUE:
            raise SetupError(
                f"there is no key 'model.{effect}'{nearest(effect, CATALOGUE)}",
                hint=f"Tables below [model] are named after effects: {', '.join(CATALOGUE)}.",
            )
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
    for error in errors[:MAX_LISTED_MISTAKES]:
        where = ".".join(str(part) for part in error["loc"])
        if error["type"] == "extra_forbidden":
            nearest = _nearest_key(tuple(str(part) for part in error["loc"]))
            lines.append(f"{name}: there is no key '{where}'{nearest}")
        else:
            text = error["msg"].removeprefix("Value error, ")
            own = error["type"] in ("value_error", "missing")
            if error["type"].startswith(("model", "dict")):
                text = "it is a table"
            typed = "" if own else f"; found {str(error['input'])[:40]!r}"
            lines.append(f"{name}: {where}: {text}{typed}")
    if len(errors) > MAX_LISTED_MISTAKES:
        lines.append(f"{name}: and {len(errors) - MAX_LISTED_MISTAKES} more mistakes")
    return "\n".join(lines)


_ADVICE = (
    ("extra_forbidden", "Correct the key, or delete its line."),
    ("missing", "Add the line."),
    ("float", "Write a number there, without quotes."),
    ("int", "Write a whole number there, without quotes."),
    ("finite", "Write a number there, without quotes."),
    ("model", "Write a table: its name in brackets, then a line for each key."),
    ("dict", "Write a table: its name in brackets, then a line for each key."),
    ("list", "Write a list in brackets."),
    ("tuple", "Write a list in brackets."),
    ("string", "Write a text in quotes there."),
)
"""Prefixes of pydantic's error types, and the advice for each."""


def _advice(problem: ValidationError) -> str:
    """Advice on the first mistake."""
    kind = problem.errors()[0]["type"]
    matching = (advice for start, advice in _ADVICE if kind.startswith(start))
    return next(matching, "Correct the line, or delete it.")


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
    key = location[-1]
    for table, field in SetupSchema.model_fields.items():
        if key in getattr(field.annotation, "model_fields", {}) and key not in model.model_fields:
            return f"; it belongs in the table [{table}]"
    return nearest(key, model.model_fields) or f"; known are {', '.join(model.model_fields)}"


class Origin(StrEnum):
    """Source of a value."""

    SETUP = "setup"
    PRESET = "preset"
    DEFAULT = "default"


@dataclass(frozen=True)
class RigNumber:
    """A property of the apparatus with its standard uncertainty and source.

    Attributes
    ----------
    name : str
        Plain name.
    key : str
        Key in the setup file ("pendulum.inertia"); "" if there is none.
    value, std : float
        In `unit`.
    unit : str
        SI.
    source : str
        Source of a default; "" if no default is used.
    """

    name: str
    key: str
    value: float
    std: float
    unit: str
    value_from: Origin
    std_from: Origin
    source: str = ""

    @property
    def relative_std(self) -> float:
        """Std over value; 0 for a value of zero."""
        return self.std / abs(self.value) if self.value else 0.0

    @property
    def defaulted(self) -> bool:
        """Whether value or uncertainty is a default."""
        return Origin.DEFAULT in (self.value_from, self.std_from)

    @property
    def in_words(self) -> str:
        """One line for a report: "mass of the ball: 0.3530 ± 0.0011 kg (its uncertainty is …)"."""
        text = format_value(self.value, self.std, self.unit)
        what = "a default" if self.value_from is Origin.DEFAULT else "its uncertainty is a default"
        return f"{self.name}: {text} ({what}: {self.source})"


@dataclass(frozen=True)
class Rig:
    """Properties of the apparatus that a measurement needs, with uncertainties.

    Attributes
    ----------
    inertia, pendulum_mass, com, length : RigNumber
        Pendulum, SI.
    effective_mass : RigNumber or None
        kg; None if it follows from inertia and length.
    support_height : RigNumber or None
        None if not given.
    ball_mass, ball_diameter, launch_angle : RigNumber or None
        None if not given.
    """

    inertia: RigNumber
    pendulum_mass: RigNumber
    com: RigNumber
    length: RigNumber
    effective_mass: RigNumber | None
    support_height: RigNumber | None
    ball_mass: RigNumber | None
    ball_diameter: RigNumber | None
    launch_angle: RigNumber | None
    gravity: RigNumber
    air_density: RigNumber
    drag_coefficient: RigNumber
    spin: RigNumber
    grid_pitch: RigNumber

    @property
    def numbers(self) -> tuple[RigNumber, ...]:
        """All known properties."""
        return tuple(known for known in vars(self).values() if known is not None)

    @property
    def defaults_used(self) -> tuple[RigNumber, ...]:
        """Properties whose value or uncertainty is a default."""
        return tuple(known for known in self.numbers if known.defaulted)

    @property
    def stiffness_relative_std(self) -> float:
        """Relative standard uncertainty of Ω² = m g d / I of the free swing."""
        parts = (self.pendulum_mass, self.gravity, self.com, self.inertia)
        return math.hypot(*(part.relative_std for part in parts))


def rig_of(setup: Setup, ball: BallSetup | None) -> Rig:
    """Apparatus of a setup and the struck ball."""
    body = setup.pendulum or bodies.PAPER_PENDULUM
    body_from = Origin.PRESET if setup.pendulum is None else Origin.SETUP
    std = setup.pendulum_std
    height = None if setup.support is None else setup.support.height
    height_from = Origin.SETUP
    if height is None and ball is not None and ball.name in bodies.BALLS:
        height, height_from = bodies.PAPER_SUPPORT.height, Origin.PRESET
    return Rig(
        inertia=_known("pendulum.inertia", body.inertia, std.inertia, Defaults.PENDULUM_INERTIA,
                       body_from),
        pendulum_mass=_known("pendulum.mass", body.mass, std.mass, Defaults.PENDULUM_MASS,
                             body_from),
        com=_known("pendulum.com", body.com, std.com, Defaults.CENTRE_OF_MASS, body_from),
        length=_known("pendulum.length", body.length, std.length, Defaults.PENDULUM_LENGTH,
                      body_from),
        effective_mass=None if body.effective_mass is None else _known(
            "pendulum.effective_mass", body.effective_mass, std.effective_mass,
            Defaults.EFFECTIVE_MASS, body_from,
        ),
        support_height=None if height is None else _known(
            "support.height", height, setup.support_std, Defaults.SUPPORT_HEIGHT, height_from
        ),
        **_of_ball(ball),
        gravity=_known("", None, None, Defaults.GRAVITY, Origin.DEFAULT),
        air_density=_air_density(setup),
        drag_coefficient=_drag(setup),
        spin=_known("", None, None, Defaults.SPIN, Origin.DEFAULT),
        grid_pitch=_known("wall.grid", setup.wall.grid, setup.wall.grid_std, Defaults.GRID_PITCH,
                          Origin.SETUP),
    )  # fmt: skip


def _known(
    key: str, value: float | None, std: float | None, default: Default, said_by: Origin
) -> RigNumber:
    """The given value and std, with defaults for the rest."""
    number = default.known if value is None else value
    return RigNumber(
        default.name,
        key,
        number,
        default.std_of(number) if std is None else std,
        default.unit,
        Origin.DEFAULT if value is None else said_by,
        Origin.DEFAULT if std is None else Origin.SETUP,
        default.source if std is None or value is None else "",
    )


def _of_ball(ball: BallSetup | None) -> dict[str, RigNumber | None]:
    if ball is None:
        return {"ball_mass": None, "ball_diameter": None, "launch_angle": None}
    preset = BallSetup.preset(ball.name) if ball.name in bodies.BALLS else BallSetup("", 0.0)

    def known(
        key: str, value: float | None, std: float | None, of_preset: float | None, default: Default
    ) -> RigNumber | None:
        if value is None:
            return None
        said_by = Origin.PRESET if std is None and value == of_preset else Origin.SETUP
        return _known(f"ball.{key}", value, std, default, said_by)

    return {
        "ball_mass": known(
            "mass", ball.mass, ball.mass_std, preset.mass, Defaults.BALL_MASS
        ),
        "ball_diameter": known(
            "diameter", ball.diameter, ball.diameter_std, preset.diameter,
            Defaults.BALL_DIAMETER,
        ),
        "launch_angle": known(
            "launch_angle", ball.launch_angle, ball.launch_angle_std,
            preset.launch_angle, Defaults.LAUNCH_ANGLE,
        ),
    }  # fmt: skip


def _air_density(setup: Setup) -> RigNumber:
    known = setup.air_known
    if known.density is not None or not known.read_off:
        return _known(
            "air.density", known.density, known.density_std, Defaults.AIR_DENSITY, Origin.SETUP
        )
    steps = (
        (known.temperature_std, Defaults.AIR_TEMPERATURE.std),
        (known.pressure_std, Defaults.AIR_PRESSURE.std),
        (known.humidity_std, Defaults.HUMIDITY.std),
    )
    stds = [default if given is None else given for given, default in steps]
    base = known.at(0.0, 0.0, 0.0).density
    moves = [known.at(*(s if i == j else 0.0 for j, s in enumerate(stds))) for i in range(3)]
    std = math.hypot(*(air.density - base for air in moves))
    text = None not in (known.temperature_std, known.pressure_std, known.humidity_std)
    return RigNumber(
        Defaults.AIR_DENSITY.name,
        "air.density",
        base,
        std,
        "kg/m^3",
        Origin.SETUP,
        Origin.SETUP if text else Origin.DEFAULT,
        "" if text else "thermometer 1 K, weather 10 hPa, humidity 20 %, if not given",
    )


def _drag(setup: Setup) -> RigNumber:
    """Drag coefficient of [model.drag], or the default."""
    given = setup.model.parameters.get("drag", {}).get("drag_coefficient")
    std = setup.model.stds.get("drag", {}).get("drag_coefficient")
    return _known(
        "model.drag.drag_coefficient", given, std, Defaults.DRAG_COEFFICIENT, Origin.SETUP
    )
