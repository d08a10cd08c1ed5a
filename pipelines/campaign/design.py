"""`vision plan campaign`: strikes and back-swings needed for a wanted precision.

One strike at impact speed v gives e = f(v; θ) with variance s² = clip² + σ²; its information on θ
is g gᵀ / s² with g = ∂f/∂θ. The design is D-optimal: it maximises the determinant of the
information and thereby (Kiefer and Wolfowitz 1960) minimises the largest variance of the law over
the speeds, P s² / N for P parameters and N strikes. Contributions shared by all strikes of a
session or setup do not average out and are added.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.table import Table

from measuring.setup.file import Rig, rig_of, setup_from
from metrology import Defaults, DomainError, MeasurementError, UsageError
from physics.bodies import Ball, Pendulum
from physics.restitution import ConstantCor, CorLaw, ExponentialCor
from physics.swing import frictionless_speed
from pipelines.campaign.ledger import Ledger
from pipelines.campaign.results import ClipResult, clip_results, not_counted, recordings
from pipelines.doors import (
    CorLawOption,
    NamedBallOption,
    NoTableOption,
    ResultsJsonOption,
    SetupFileOption,
)
from pipelines.model import asked, plan_command, scatter_of
from pipelines.terminal import DefaultCommandGroup, screen, write_json

__all__ = [
    "PLAN_COMMANDS",
    "CampaignDesign",
    "DistanceOrCommand",
    "Precisions",
    "Setting",
    "design_campaign",
    "from_pilot",
    "from_rig",
    "plan_campaign_command",
]

FloatArray = NDArray[np.float64]

CLIP_STD = 0.007
"""Standard uncertainty of one clip's COR without shared inputs: from the track noise of the
sample recordings (432 to 640 px wide); --pilot replaces it."""
SESSION_VARIANCE_FRACTION = 0.25
"""Fraction of the remaining variance allowed to sessions (chosen: a session costs a day, a
strike minutes)."""
_MIN_SESSIONS = 2
"""Minimum number of sessions: two show whether sessions differ."""
_MAX_DESIGN_STEPS = 4000
"""Limit of the multiplicative search; its gap falls as one over the number of steps."""
_DESIGN_TOLERANCE = 1e-4
"""Relative: the largest variance is within this of the minimum of any design (Kiefer and Wolfowitz
1960)."""
_MIN_SETTING_WEIGHT = 0.02
"""Relative to an even design: a setting with less weight gets no strike (chosen)."""
_STEP_DEG = 2.0
"""Spacing of the back-swings considered, degrees (chosen)."""


@dataclass(frozen=True)
class Precisions:
    """Standard deviations of the COR: of one strike, and of what strikes share.

    Attributes
    ----------
    clip : float
        Uncertainty of one clip.
    strike : float
        Standard deviation between strikes.
    session : float
        Standard deviation between sessions.
    shared : mapping of str to float
        Setup inputs shared by all clips, by name.
    source : str
        Origin of the numbers, as text.
    """

    clip: float
    strike: float
    session: float
    shared: Mapping[str, float]
    source: str

    @property
    def one_strike(self) -> float:
        """Of one strike, without shared contributions."""
        return math.hypot(self.clip, self.strike)

    @property
    def floor(self) -> float:
        """Limit that no number of strikes improves."""
        return math.hypot(*self.shared.values()) if self.shared else 0.0


@dataclass(frozen=True)
class Setting:
    """Strikes at one back-swing."""

    backswing_deg: float
    impact_speed: float
    strikes: int


@dataclass(frozen=True)
class CampaignDesign:
    """A planned campaign.

    Attributes
    ----------
    settings : tuple of Setting
        Totals over all sessions.
    std : float
        Largest standard uncertainty of the law over the speeds.
    random_std : float
        Its random part, reduced by more strikes.
    floor : float
        Its systematic part, reduced only by a better setup.
    reachable : bool
        Whether a number of strikes exists that reaches the target.
    first : tuple of (str, float, float)
        Setup inputs, the largest contribution first: name, contribution to the COR, and the
        largest value that reaches the target with the others unchanged (0: the others alone are
        too large).
    """

    settings: tuple[Setting, ...]
    sessions: int
    std: float
    random_std: float
    floor: float
    target: float
    reachable: bool
    precisions: Precisions
    first: tuple[tuple[str, float, float], ...]

    @property
    def strikes(self) -> int:
        """All strikes of all sessions."""
        return sum(setting.strikes for setting in self.settings)


def design_campaign(
    law: CorLaw,
    pendulum: Pendulum,
    ball: Ball,
    target: float,
    precisions: Precisions,
    *,
    backswings_deg: tuple[float, float] = (20.0, 120.0),
    gravity: float = Defaults.GRAVITY.known,
) -> CampaignDesign:
    """Choose back-swings and strikes for a wanted precision of the law.

    Parameters
    ----------
    law : CorLaw
        Approximate law: its curvature decides where to measure.
    pendulum, ball
    target : float
        Largest standard uncertainty of the law wanted at any speed between the back-swings.
    backswings_deg : (2,) tuple of float
        Smallest and largest back-swing of the rig, degrees.
    gravity : float
        m/s².

    Raises
    ------
    DomainError
        If the target is not positive, or the back-swings give no speed range.
    """
    if not 0.0 < target < 1.0:
        raise DomainError(
            f"a standard uncertainty of {target:g} of the COR is not between 0 and 1",
            hint="Pass for example --target-cor-std 0.003.",
        )
    angles = _backswings(ball, *backswings_deg)
    swings = np.radians(angles)
    speeds = np.asarray(frictionless_speed(pendulum, swings, ball.launch_angle, gravity))
    slopes = _slopes(law, speeds)
    weights = _d_optimal(slopes)
    left = target**2 - precisions.floor**2
    reachable = left > 0.0
    # unreachable target: plan strikes until their part equals the floor
    left = left if reachable else precisions.floor**2
    sessions = max(
        _MIN_SESSIONS, math.ceil(precisions.session**2 / (SESSION_VARIANCE_FRACTION * left) - 1e-9)
    )
    random = left - precisions.session**2 / sessions
    counts = _rounded(weights, slopes, precisions.one_strike, random, sessions)
    variance = _largest_variance(slopes, counts, precisions.one_strike)
    variance += precisions.session**2 / sessions
    settings = tuple(
        Setting(float(angle), float(speed), int(count))
        for angle, speed, count in zip(angles, speeds, counts, strict=True)
        if count
    )
    return CampaignDesign(
        settings=settings,
        sessions=sessions,
        std=math.sqrt(variance + precisions.floor**2),
        random_std=math.sqrt(variance),
        floor=precisions.floor,
        target=target,
        reachable=reachable,
        precisions=precisions,
        first=_first(precisions, target),
    )


def _backswings(ball: Ball, smallest: float, largest: float) -> FloatArray:
    """Back-swings that are considered, degrees."""
    angles = np.arange(smallest, largest + 0.5 * _STEP_DEG, _STEP_DEG)
    lowest = math.degrees(ball.launch_angle)
    if len(angles) < 3 or angles[0] <= lowest or np.radians(angles[-1]) > np.pi:
        raise DomainError(
            f"back-swings from {smallest:g}° to {largest:g}° are not a usable range",
            hint="Pass --smallest and --largest at least 4° apart, between"
            f" {lowest:.0f}° and 180°.",
        )
    return angles


def _slopes(law: CorLaw, speeds: FloatArray) -> FloatArray:
    """∂e/∂θ at each speed, (V, P): of the exponential law, or of a constant."""
    if isinstance(law, ConstantCor):
        return np.ones((len(speeds), 1))
    if isinstance(law, ExponentialCor):
        bent, rate = np.exp(-law.rate * speeds - law.shift), law.rate
        return np.column_stack(
            [np.exp(-rate * speeds), -law.amplitude * speeds * bent, np.ones_like(speeds)]
        )
    # other laws: a parabola covers slope and curvature
    middle = (speeds - speeds.mean()) / np.ptp(speeds)
    return np.column_stack([np.ones_like(middle), middle, middle**2])


def _d_optimal(slopes: FloatArray) -> FloatArray:
    """Weights of the speeds by the multiplicative algorithm (Titterington 1976)."""
    parameters = slopes.shape[1]
    scaled = np.linalg.qr(slopes)[0]
    weights = np.full(len(slopes), 1.0 / len(slopes))
    for _ in range(_MAX_DESIGN_STEPS):
        information = scaled.T @ (weights[:, np.newaxis] * scaled)
        variance = np.einsum("ij,jk,ik->i", scaled, np.linalg.inv(information), scaled)
        if variance.max() < parameters * (1.0 + _DESIGN_TOLERANCE):
            break
        weights = weights * variance / parameters
    return _gathered(weights)


def _gathered(weights: FloatArray) -> FloatArray:
    """Merge weights of neighbours at the largest: they are one back-swing of the optimum."""
    kept = np.zeros_like(weights)
    cuts = np.flatnonzero(weights > _MIN_SETTING_WEIGHT / len(weights))
    for group in np.split(cuts, np.flatnonzero(np.diff(cuts) > 1) + 1):
        kept[group[np.argmax(weights[group])]] = weights[group].sum()
    return np.asarray(kept / kept.sum())


def _largest_variance(slopes: FloatArray, counts: FloatArray, one: float) -> float:
    """Largest variance of the law over the speeds for given strikes at each."""
    scaled = np.linalg.qr(slopes)[0]
    information = scaled.T @ (counts[:, np.newaxis] * scaled) / one**2
    variance = np.einsum("ij,jk,ik->i", scaled, np.linalg.pinv(information), scaled)
    return float(variance.max())


def _rounded(
    weights: FloatArray, slopes: FloatArray, one: float, wanted: float, sessions: int
) -> FloatArray:
    """Whole strikes per back-swing, equal in all sessions, that reach a variance."""
    parameters = slopes.shape[1]
    used = weights > 0.0
    each = max(1, math.floor(parameters * one**2 / (wanted * sessions * used.sum())))
    while True:
        counts = np.where(used, np.maximum(np.rint(weights * each * used.sum()), 1.0), 0.0)
        if _largest_variance(slopes, counts * sessions, one) <= wanted * (1.0 + 1e-9):
            return np.asarray(counts * sessions)
        each += 1


def _first(precisions: Precisions, target: float) -> tuple[tuple[str, float, float], ...]:
    ranked = sorted(precisions.shared.items(), key=lambda item: -item[1])
    found = []
    for name, std in ranked:
        others = precisions.floor**2 - std**2
        room = target**2 - others
        found.append((name, std, math.sqrt(room) if room > 0.0 else 0.0))
    return tuple(found)


def from_pilot(results: Sequence[ClipResult], fallback: Precisions) -> Precisions:
    """Precisions estimated from the clips of a campaign.

    Parameters
    ----------
    results : sequence of ClipResult
        Clips of one ball, or of all.
    fallback : Precisions
        Values for what the clips do not determine (standard deviations between strikes).

    Raises
    ------
    DomainError
        If none of them has a COR.
    """
    used = [one for one in results if one.used and math.isfinite(one.quantity("cor")[0])]
    if not used:
        raise DomainError(
            "no clip of that campaign has a coefficient of restitution",
            hint="Inspect `vision campaign status DIR`, or omit --pilot.",
        )
    names = dict.fromkeys(name for one in used for name in one.shared)
    shared = {name: float(np.median([one.shared.get(name, 0.0) for one in used])) for name in names}
    own = [
        math.sqrt(max(one.quantity("cor")[1] ** 2 - sum(std**2 for std in one.shared.values()), 0))
        for one in used
    ]
    return replace(
        fallback,
        clip=float(np.median(own)),
        shared={name: std for name, std in shared.items() if std > 0.0},
        source=f"{len(used)} clips measured",
    )


def from_rig(rig: Rig, ball: Ball, pendulum: Pendulum, law: CorLaw, scatter: float) -> Precisions:
    """Precisions estimated from the setup, before any clip is measured.

    By the balance of angular momentum e + 1 = (u / v)(1 + m / M): a relative uncertainty of the
    masses contributes (1 + e) (m / M) / (1 + m / M) times itself to e.
    """
    middle = float(law(2.5))
    ratio = ball.mass / pendulum.mass_at_contact
    lever = (1.0 + middle) * ratio / (1.0 + ratio)
    shared = {
        "inertia of the pendulum": lever * rig.inertia.relative_std,
        "length of the pendulum": lever * 2.0 * rig.length.relative_std,
    }
    if rig.ball_mass is not None:
        shared["mass of the ball"] = lever * rig.ball_mass.relative_std
    return Precisions(
        clip=CLIP_STD,
        strike=scatter,
        session=0.0,
        shared=shared,
        source="from the setup alone; --pilot DIR with one measured clip is more accurate",
    )


def _pilot(folder: Path, ball: str, fallback: Precisions) -> Precisions:
    if not (folder / "ledger.sqlite").is_file():
        raise UsageError(
            f"{folder} contains no campaign", hint="Pass the folder that was given as --out."
        )
    with Ledger(folder) as ledger:
        entries, copies = list(ledger.entries()), ledger.copies()
    strikes = {entry.order.clip: None for entry in entries}
    results = clip_results(entries, strikes, not_counted(recordings(copies, strikes)))
    return from_pilot(results, fallback)


def _document(design: CampaignDesign) -> dict[str, Any]:
    return {
        "quantities": {
            "cor_law_std": {"value": design.std, "unit": "1"},
            "strikes": {"value": design.strikes, "unit": "1"},
            "sessions": {"value": design.sessions, "unit": "1"},
        },
        "settings": [asdict(setting) for setting in design.settings],
        "target": design.target,
        "reachable": design.reachable,
        "shared_std": design.floor,
        "measure_first": [
            {"source": name, "std": std, "needed": needed} for name, std, needed in design.first
        ],
        "basis": design.precisions.source,
    }


def _sessions_taken(taken: Precisions) -> str:
    """Statement about sessions: without a measurement they are assumed equal."""
    if taken.session == 0.0:
        return "sessions are assumed not to differ (two of them would show it)"
    return f"sessions by {taken.session:.4f}"


def _print_design(design: CampaignDesign) -> None:
    table = Table("back-swing", "impact speed", "strikes")
    for setting in design.settings:
        table.add_row(
            f"{setting.backswing_deg:.0f}°",
            f"{setting.impact_speed:.2f} m/s",
            str(setting.strikes),
        )
    console = screen()
    console.print(table)
    console.print(
        f"{design.strikes} strikes in {design.sessions} sessions, each with all back-swings: the"
        f" law to {design.std:.4f} or better at every speed between them"
        f" ({design.random_std:.4f} random, {design.floor:.4f} from the setup).",
        soft_wrap=True,
    )
    taken = design.precisions
    console.print(
        f"Assumed standard deviations of the COR: {taken.clip:.4f} per clip,"
        f" {taken.strike:.4f} between strikes; {_sessions_taken(taken)} ({taken.source}).",
        soft_wrap=True,
    )
    for name, std, needed in design.first[:3]:
        if std < 0.1 * design.target:
            break
        console.print(
            f"Measure better: {name} contributes {std:.4f} to COR; {_gain(design, std, needed)}.",
            soft_wrap=True,
        )


def _gain(design: CampaignDesign, std: float, needed: float) -> str:
    if not design.reachable:
        if needed > 0.0:
            return (
                f"to reach {design.target:g} with the others unchanged, reduce it to {needed:.4f}"
            )
        return f"the others alone exceed {design.target:g}"
    # strikes are inversely proportional to the variance allowed to them
    left = design.target**2 - design.floor**2
    saved = design.strikes * (1.0 - left / (left + std**2))
    return f"known exactly, it would save about {saved:.0f} of the {design.strikes} strikes"


_TargetOption = Annotated[
    float,
    typer.Option("--target-cor-std", help="Wanted standard uncertainty of the law, 1."),
]
_PilotOption = Annotated[
    Path | None,
    typer.Option(help="Measured campaign that gives the precision of a clip.", metavar="DIR"),
]
_SmallestOption = Annotated[float, typer.Option("--smallest", help="Smallest back-swing, degrees.")]
_LargestOption = Annotated[
    float, typer.Option("--largest", help="Largest back-swing of the rig, degrees.")
]


def plan_campaign_command(
    target: _TargetOption,
    setup: SetupFileOption = None,
    ball: NamedBallOption = None,
    cor_law: CorLawOption = None,
    pilot: _PilotOption = None,
    smallest: _SmallestOption = 20.0,
    largest: _LargestOption = 120.0,
    json_to: ResultsJsonOption = None,
    quiet: NoTableOption = False,
) -> None:
    """Plan the strikes and back-swings that a law of restitution of a wanted precision needs.

    Also lists which setup inputs to measure better first. A pilot clip gives the best estimate:
    vision plan campaign --target-cor-std 0.003 --setup lab.toml --pilot campaign
    """
    known = setup_from(setup)
    wanted = asked(known, ball, "variable", None, cor_law)
    struck, pendulum = wanted.experiment.ball, wanted.experiment.pendulum
    chosen = known.balls.get(ball or "", known.ball)
    precisions = from_rig(
        rig_of(known, chosen), struck, pendulum, wanted.law, scatter_of(known).cor
    )
    if wanted.campaign is not None:
        precisions = replace(
            precisions,
            strike=wanted.campaign.strike_scatter or precisions.strike,
            session=wanted.campaign.session_scatter,
        )
    if pilot is not None:
        precisions = _pilot(pilot, struck.name, precisions)
    design = design_campaign(
        wanted.law,
        pendulum,
        struck,
        target,
        precisions,
        backswings_deg=(smallest, largest),
        gravity=wanted.experiment.gravity,
    )
    if write_json(_document(design), json_to):
        return
    if not quiet:
        _print_design(design)
    if not design.reachable:
        raise MeasurementError(
            f"no number of strikes reaches {target:g}: the setup's uncertainty, shared by all"
            f" clips, contributes {design.floor:.4f}",
            hint=f"Measure the {design.first[0][0]} better first.",
        )


class DistanceOrCommand(DefaultCommandGroup):
    """`vision plan --distance 2.5m` means `vision plan distance --distance 2.5m`."""

    meant = "distance"
    asks_for_help = False


PLAN_COMMANDS: dict[str, Callable[..., None]] = {
    "distance": plan_command,
    "campaign": plan_campaign_command,
}
"""Commands of ``vision plan``; the first is the default."""
