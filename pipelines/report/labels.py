"""What the quantities of the results table are called on paper, and how they are printed."""

from metrology import Quantity
from metrology.quantity import format_quantity, format_value

__all__ = ["quantity_label", "quantity_text"]

COUNTS = frozenset({"contact_frames"})
"""Quantities that are whole numbers."""

_LABELS = {
    "contact_frames": "contact frames",
    "contact_time": "contact time Δt",
    "contact_start": "contact begins",
    "contact_end": "contact ends",
    "pendulum_speed_before": "pendulum speed before",
    "pendulum_speed_after": "pendulum speed after",
    "ball_speed": "ball speed at release",
    "launch_angle": "launch angle",
    "landing_distance": "landing distance, corrected",
    "landing_distance_on_wall": "landing distance as read on the wall",
    "landing_time": "landing time",
    "cor_speeds": "COR from the speeds (Eq. 2)",
    "cor_launch": "COR from the launch (Eqs 9–10)",
    "cor_range": "COR from the range (Eq. 17)",
    "cor": "COR, mean of the estimates",
    "external_impulse": "external impulse on the ball",
    "energy_loss": "energy the pendulum loses (Eq. 18)",
    "backswing_angle": "back-swing angle",
    "ball_plane_offset": "ball plane in front of the wall",
    "camera_distance": "camera to wall",
    "fall_acceleration": "acceleration of the fall",
    "flight_speed": "speed at the first frame of the flight",
    "flight_angle": "angle at the first frame of the flight",
    "swing_period": "period of the swing",
    "swing_damping": "damping of the swing",
    "speed_before": "speed before, of the ball that lay still",
    "speed_after": "speed after, of the ball that lay still",
    "other_speed_before": "speed before, of the other ball",
    "other_speed_after": "speed after, of the other ball",
    "cor_collision": "COR along the line of centres",
    "gravity_check": "free fall of the flight",
    "ball_speed_per_frame": "ball speed by displacement per frame (Fig. 18)",
    "ball_speed_eq7": "ball speed from the pendulum (Eq. 7)",
}


def quantity_label(name: str) -> str:
    """Label of a quantity; names without one are spelled out."""
    return _LABELS.get(name, name.replace("_", " "))


def quantity_text(quantity: Quantity) -> str:
    """Value ± std with its unit, a count without decimals; the reason where there is no value."""
    if quantity.value is None:
        return f"– {quantity.reason}"
    if quantity.name in COUNTS:
        return f"{quantity.value:.0f} ± {quantity.std:.1f}"
    if quantity.std == 0.0:
        return format_value(quantity.value, None, quantity.unit)
    return format_quantity(quantity)
