"""What holds for one clip or campaign: the setup's numbers, and the defaults where it is silent."""

import math
from dataclasses import dataclass
from enum import StrEnum

from metrology import Default, Defaults
from metrology.quantity import format_value
from physics import bodies
from pipelines.setup.tables import BallSetup, Setup

__all__ = ["Origin", "Rig", "RigNumber", "rig_of"]


class Origin(StrEnum):
    """Who says so."""

    SETUP = "setup"
    PRESET = "preset"
    DEFAULT = "default"


@dataclass(frozen=True)
class RigNumber:
    """A number of the rig with its standard uncertainty, and who says so.

    Attributes
    ----------
    name : str
        In words.
    key : str
        Key of the setup file that would say it ("pendulum.inertia"); "" where there is none.
    value, std : float
        In `unit`.
    unit : str
        SI.
    value_from, std_from : Origin
    source : str
        Where a default comes from; "" where nothing was taken from the defaults.
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
        told = format_value(self.value, self.std, self.unit)
        what = "a default" if self.value_from is Origin.DEFAULT else "its uncertainty is a default"
        return f"{self.name}: {told} ({what}: {self.source})"


@dataclass(frozen=True)
class Rig:
    """Every number of the rig that measuring needs, each with its uncertainty.

    Attributes
    ----------
    inertia, pendulum_mass, com, length : RigNumber
        Pendulum, SI.
    effective_mass : RigNumber or None
        kg; None where it follows from inertia and length.
    support_height : RigNumber or None
        None where nobody said.
    ball_mass, ball_diameter, launch_angle : RigNumber or None
        None where the ball, or that of it, is not known.
    gravity, air_density, drag_coefficient, spin, grid_pitch : RigNumber
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
        """All that are known."""
        return tuple(known for known in vars(self).values() if known is not None)

    @property
    def defaults_used(self) -> tuple[RigNumber, ...]:
        """Those whose value or uncertainty is a default."""
        return tuple(known for known in self.numbers if known.defaulted)

    @property
    def stiffness_share(self) -> float:
        """Relative standard uncertainty of Ω² = m g d / I of the free swing."""
        parts = (self.pendulum_mass, self.gravity, self.com, self.inertia)
        return math.hypot(*(part.relative_std for part in parts))


def rig_of(setup: Setup, ball: BallSetup | None) -> Rig:
    """The rig of a setup and the ball that is struck."""
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
    """What is given, and the default for the rest."""
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
    told = None not in (known.temperature_std, known.pressure_std, known.humidity_std)
    return RigNumber(
        Defaults.AIR_DENSITY.name,
        "air.density",
        base,
        std,
        "kg/m^3",
        Origin.SETUP,
        Origin.SETUP if told else Origin.DEFAULT,
        "" if told else "thermometer 1 K, weather 10 hPa, humidity 20 %, where not given",
    )


def _drag(setup: Setup) -> RigNumber:
    """The drag coefficient of [model.drag], or the default."""
    given = setup.model.parameters.get("drag", {}).get("drag_coefficient")
    std = setup.model.stds.get("drag", {}).get("drag_coefficient")
    return _known(
        "model.drag.drag_coefficient", given, std, Defaults.DRAG_COEFFICIENT, Origin.SETUP
    )
