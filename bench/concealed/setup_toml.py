"""Facts a laboratory knows about a campaign, and the setup file with them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from metrology import write_text_whole

__all__ = ["BallFacts", "LabFacts", "Outcome", "setup_text", "write_setup"]

OUTCOME_KEYS = (
    "impact_speed",
    "cor",
    "contact_time",
    "pendulum_speed_after",
    "pendulum_angle",
    "ball_x",
    "ball_y",
    "ball_vx",
    "ball_vy",
)


@dataclass(frozen=True)
class Outcome:
    """Contact predicted by the baseline at one impact speed (SI, angles in rad)."""

    impact_speed: float
    cor: float
    contact_time: float
    pendulum_speed_after: float
    pendulum_angle: float
    ball_x: float
    ball_y: float
    ball_vx: float
    ball_vy: float


@dataclass(frozen=True)
class BallFacts:
    """One measured ball; `cor_law` is a function of the impact speed v (m/s)."""

    mass: float
    diameter: float
    launch_angle_deg: float
    cor_law: str
    contact_outcome: tuple[Outcome, ...] = ()


@dataclass(frozen=True)
class LabFacts:
    """Contents of a campaign's setup file (SI; angles in degrees where the name states it).

    `relative_std` holds the relative standard uncertainties that it states, if any.
    """

    balls: dict[str, BallFacts]
    pendulum_length: float
    pendulum_inertia: float
    pendulum_mass: float
    pendulum_com: float
    support_height: float
    air_density: float
    air_viscosity: float
    position_noise: float
    angle_noise: float
    capture_fps: float = 600.0
    effective_mass: float | None = None
    scatter: dict[str, str] = field(
        default_factory=lambda: {
            "backswing": "0.2 deg",
            "launch_angle": "0.2 deg",
            "cor": "0.005",
            "cor_law": "0.01",
            "launch_angle_law": "0.3 deg",
        }
    )
    drag_coefficient: float | None = None
    relative_std: Mapping[str, float] = field(default_factory=dict)

    def stated(self, name: str) -> str:
        """Uncertainty of an input as a set-up file writes it."""
        std = self.relative_std.get(name)
        return "" if std is None else f" ± {100.0 * std:g} %"


def _scatter_line(key: str, value: str) -> str:
    return f"{key} = {value}" if key.startswith("cor") else f'{key} = "{value}"'


def _ball_lines(name: str, ball: BallFacts, facts: LabFacts) -> list[str]:
    lines = [
        f"[balls.{name}]",
        f'mass = "{ball.mass:.6g} kg{facts.stated("ball_mass")}"',
        f'diameter = "{ball.diameter:.6g} m{facts.stated("diameter")}"',
        f'launch_angle = "{ball.launch_angle_deg:.6g} deg"',
        f'cor = "{ball.cor_law}"',
        "",
    ]
    for outcome in ball.contact_outcome:
        lines.append(f"[[balls.{name}.contact_outcome]]")
        lines += [f"{key} = {getattr(outcome, key):.10g}" for key in OUTCOME_KEYS]
        lines.append("")
    return lines


def setup_text(facts: LabFacts) -> str:
    """The setup file of a campaign, TOML, with the keys `vision explain` reads."""
    lines = [
        "[camera]",
        f"capture_fps = {facts.capture_fps:.10g}",
        "",
        "[pendulum]",
        f'length = "{facts.pendulum_length:.8g} m"',
        f'inertia = "{facts.pendulum_inertia:.8g} kg m^2{facts.stated("inertia")}"',
        f'mass = "{facts.pendulum_mass:.8g} kg{facts.stated("pendulum_mass")}"',
        f'com = "{facts.pendulum_com:.8g} m{facts.stated("com")}"',
    ]
    if facts.effective_mass is not None:
        lines.append(f'effective_mass = "{facts.effective_mass:.8g} kg"')
    lines += [
        "",
        "[support]",
        f'height = "{facts.support_height:.8g} m"',
        "",
        "[air]",
        f'density = "{facts.air_density:.8g} kg/m^3"',
        f'viscosity = "{facts.air_viscosity:.8g} Pa s"',
        "",
        "[scatter]",
        *(_scatter_line(key, value) for key, value in facts.scatter.items()),
        "",
        "[noise]",
        f'position = "{1000 * facts.position_noise:.6g} mm"',
        f'angle = "{facts.angle_noise:.6g} rad"',
        "",
        "[model]",
    ]
    if facts.drag_coefficient:
        lines += [
            'effects = ["gravity", "drag"]',
            "",
            "[model.drag]",
            f"drag_coefficient = {facts.drag_coefficient:.8g}",
        ]
    else:
        lines.append('effects = ["gravity"]')
    lines.append("")
    for name, ball in facts.balls.items():
        lines += _ball_lines(name, ball, facts)
    return "\n".join(lines)


def write_setup(path: Path, facts: LabFacts) -> None:
    """Write the setup file of a campaign."""
    write_text_whole(path, setup_text(facts))
