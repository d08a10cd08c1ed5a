"""`simulate`, `plan` and `cor`: the forward model and its inversions."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from measuring.setup.file import SetupLike, setup_from
from measuring.setup.tables import checked_values
from metrology import Quantity, UsageError, measurands, read_number
from physics.air import PAPER_AIR, SUBCRITICAL_DRAG
from physics.bodies import GRAVITY
from physics.forward import RangeInputs, cor_from_range
from pipelines.api.quantities import (
    Given,
    HasQuantities,
    QuantityView,
    angle_from,
    as_row,
)
from pipelines.api.wording import worded_for_python
from pipelines.model import (
    added_effects,
    asked,
    flights_figure,
    planned_figure,
    scatter_of,
)
from pipelines.model import plan as plan_strike
from pipelines.model import simulate as simulate_strike

if TYPE_CHECKING:
    import pandas as pd

    from pipelines.report.plots import Picture

__all__ = ["ModelResult", "cor", "plan", "simulate"]


class ModelResult(HasQuantities):
    """Results of the forward model. Every quantity is also an attribute.

    Parameters
    ----------
    quantities : sequence of Quantity
    warnings : tuple of str
    title : str
    draw : callable
        Draws the figure.
    """

    def __init__(
        self,
        quantities: Sequence[Quantity],
        warnings: tuple[str, ...],
        title: str,
        draw: "Callable[[], Picture]",
    ) -> None:
        super().__init__(quantities, title)
        self.warnings, self._draw = warnings, draw

    def to_frame(self) -> "pd.DataFrame":
        """One row, columns NAME_UNIT and NAME_UNIT_std."""
        import pandas as pd

        return pd.DataFrame([as_row(self.quantities)])

    def plot(self) -> "Picture":
        """The path, or distance over back-swing, as a matplotlib figure."""
        return self._draw()


@worded_for_python
@checked_values
def simulate(
    *,
    backswing: Given | QuantityView | None = None,
    impact_speed: Given | None = None,
    ball: str | None = None,
    cor: Given = "variable",
    drag: Given | None = None,
    effects: Sequence[str] = (),
    setup: SetupLike = None,
) -> ModelResult:
    """Simulate a strike from back-swing or impact speed to landing (steps a to e of the paper).

    Parameters
    ----------
    backswing : str or QuantityView, optional
        Angle with its unit: "90 deg", or a quantity of `plan`; or the number ``backswing_deg``.
        Alternatively give `impact_speed`.
    impact_speed : float or str, optional
        m/s.
    ball : str, optional
        A preset, or a ball of the setup; default: that of the setup, else "jokku".
    cor : str or float
        "variable", "constant", a number, or a law in v (m/s).
    drag : str or float, optional
        Drag coefficient, or a curve: "smooth", "soccer", "basketball".
    effects : sequence of str
        Effects of the catalogue with their values: "magnus:spin=10".
    setup : Setup or path, optional

    Returns
    -------
    ModelResult

    Raises
    ------
    UsageError
        For invalid options.
    DomainError
        For inputs outside the range of the laws.
    """
    known = setup_from(setup)
    wanted = asked(known, ball, str(cor), None if drag is None else str(drag))
    found = simulate_strike(
        wanted.experiment,
        backswing=None if backswing is None else angle_from("backswing", backswing),
        impact_speed=None
        if impact_speed is None
        else read_number(impact_speed, measurands.SPEED, "impact_speed"),
        cor=wanted.law,
        scatter=scatter_of(known, wanted.ball),
        effects=added_effects(known, tuple(effects)),
        uncertain=wanted.uncertain,
    )
    return ModelResult(
        found.quantities,
        found.warnings,
        f"{wanted.experiment.ball.name}, simulated",
        lambda: flights_figure(wanted.experiment, found.flight, found.contact_flight),
    )


@worded_for_python
@checked_values
def plan(
    distance: Given,
    *,
    ball: str | None = None,
    cor: Given = "variable",
    drag: Given | None = None,
    setup: SetupLike = None,
) -> ModelResult:
    """Back-swing angle and impact speed that reach a distance (section V.3).

    Parameters
    ----------
    distance : float or str
        Of the ball's centre from rest to landing, m, or text such as "2.5m".
    ball, cor, drag, setup
        As in `simulate`.

    Returns
    -------
    ModelResult

    Raises
    ------
    DomainError
        If the pendulum can't reach the distance.
    """
    known = setup_from(setup)
    wanted = asked(known, ball, str(cor), None if drag is None else str(drag))
    metres = read_number(distance, measurands.DISTANCE, "distance")
    found = plan_strike(
        wanted.experiment, metres, cor=wanted.law, scatter=scatter_of(known, wanted.ball)
    )
    return ModelResult(
        found.quantities,
        found.warnings,
        f"{wanted.experiment.ball.name}, {metres:g} m",
        lambda: planned_figure(wanted.experiment, wanted.law, found),
    )


@worded_for_python
@checked_values
def cor(
    *,
    distance: ArrayLike,
    impact_speed: ArrayLike,
    contact_time: ArrayLike,
    launch_angle: ArrayLike,
    support_height: ArrayLike,
    ball_mass: ArrayLike,
    effective_mass: ArrayLike,
    ball_diameter: ArrayLike,
    drag_coefficient: ArrayLike = SUBCRITICAL_DRAG,
    air_density: ArrayLike = PAPER_AIR.density,
    gravity: ArrayLike = GRAVITY,
) -> Any:
    """Coefficient of restitution from the landing point: Eq. 17 solved for e.

    Parameters
    ----------
    distance : float or array
        Of the ball's centre from rest to landing, m. All arrays broadcast.
    impact_speed : float or array
        Of the pendulum at the point of contact, m/s.
    contact_time : float or array
        s.
    launch_angle : float or array
        deg above the horizontal.
    support_height : float or array
        Height of fall, m.
    ball_mass, effective_mass : float or array
        Of the ball, and I/L² of the pendulum, kg.
    ball_diameter : float or array
        m.
    drag_coefficient, air_density : float or array
        1 and kg/m³; default: the paper's.
    gravity : float or array
        m/s².

    Returns
    -------
    float or array
        e; not limited to (0, 1], since measured distances have errors.

    Raises
    ------
    DomainError
        For inputs outside their domain, or a distance that no launch at that angle reaches.
    """
    given = (
        distance, impact_speed, contact_time, launch_angle, support_height,
        ball_mass, effective_mass, ball_diameter, drag_coefficient, air_density, gravity,
    )  # fmt: skip
    try:
        arrays: list[NDArray[np.float64]] = [np.asarray(value, np.float64) for value in given]
        np.broadcast_shapes(*(array.shape for array in arrays))
    except (TypeError, ValueError) as problem:
        raise UsageError(
            f"cor: {problem}", hint="Give numbers, or arrays of shapes that broadcast, in SI."
        ) from problem
    arrays[3] = np.radians(arrays[3])
    plain = all(array.ndim == 0 for array in arrays)
    found = cor_from_range(RangeInputs(*(float(a) if plain else a for a in arrays)))
    return float(found) if plain else np.asarray(found)
