"""A setup written back as TOML: SI numbers with their units, ± where an uncertainty was given."""

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from metrology import SetupError
from physics import bodies
from physics.restitution.restitution import law_as_text
from pipelines.setup.tables import BallSetup, Measured, Setup

__all__ = ["changed", "document_of", "setup_as_toml"]

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
    """A document with dotted keys set, or taken out where the new value is None.

    Raises
    ------
    SetupError
        If a key leads through something that is no table.
    """
    new = copy.deepcopy(dict(document))
    for dotted, value in keys.items():
        *tables, last = dotted.split(".")
        here = new
        for name in tables:
            here = here.setdefault(name, {})
            if not isinstance(here, dict):
                raise SetupError(f"{dotted}: {name!r} is no table")
        if value is None:
            here.pop(last, None)
        else:
            here[last] = value
    return new


def document_of(setup: Setup) -> dict[str, Any]:
    """The TOML document of a setup: nested dicts of text and numbers, nothing that was not said."""
    camera, wall = setup.camera, setup.wall
    taped = {
        "distance_to_wall": _taped(camera.distance_to_wall),
        "lens": None if camera.lens is None else str(_absolute(camera.lens)),
        "principal_point_on_wall": None
        if camera.principal_point_on_wall is None
        else [_taped(part) for part in camera.principal_point_on_wall],
    }
    document: dict[str, Any] = {
        "camera": _numbers(camera, "capture_fps", "shutter") | taped,
        "wall": _numbers(wall, "grid", "fine_grid")
        | {"ball_plane_offset": _taped(wall.ball_plane_offset)},
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
            name: _number(value, None, "rad" if name not in ("cor", "cor_law") else "")
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
    }
    return {name: kept for name, table in document.items() if (kept := _said(table))}


def _said(table: Any) -> dict[str, Any]:
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


def _taped(measured: Measured | None) -> str | None:
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
