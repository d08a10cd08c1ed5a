"""Effects during contact of pendulum and ball.

The table or contact model of the baseline gives the outcome of a contact; these effects change it
by the impulse that they add. The normal impulse of a contact with restitution e gives the ball (1 +
e) u M/(M + m) and leaves the pendulum (M − e m) u/(M + m), with M = I/L², u the impact speed.
"""

from dataclasses import dataclass, replace

import numpy as np

from physics.domain import Number, Vector
from physics.effects.base import (
    Contact,
    Effect,
    FlightState,
    Form,
    Outcome,
    Parameter,
    Phase,
    Values,
)

__all__ = [
    "MASS_ERROR",
    "ContactArm",
    "ContactDisplacement",
    "EffectiveMass",
    "FaceTurnedOnArm",
    "ObliqueImpact",
    "PivotRecoil",
    "RubbingFace",
    "SlidingSupport",
    "SupportFriction",
    "SupportRecoil",
    "TurnedFace",
    "VelocityDependentCor",
    "ViscoelasticCor",
    "YieldingCor",
    "add_normal_speeds",
    "change_restitution",
    "turn_launch",
]

SEPARATION_DISPLACEMENT = 0.12
"""Fraction of the displacement in contact per change of restitution (fitted): Hunt–Crossley
contacts with exponents of 1 to 1.6 give 0.06 to 0.17."""

CONTACT_EXPONENT = 1.25
"""Exponent n of the contact force by compression (chosen): between a linear spring's 1 and Hertz's
3/2; the time is proportional to mass^(1/(n + 1)) and speed^((1 − n)/(n + 1))."""

REFERENCE_SPEED = 2.5
"""Speed at which the slope of a velocity-dependent COR contributes nothing, m/s (chosen: middle of
the paper's range)."""


def add_normal_speeds(
    contact: Contact, outcome: Outcome, ball: Number, pendulum: Number, early: Number = 0.5
) -> Outcome:
    """Add to the ball's speed along the contact normal and to the pendulum's speed, m/s.

    `early` is the fraction of the contact time for which the added speed has acted at release: half
    of it if the whole contact is changed evenly.
    """
    normal = 0.5 * (contact.angle + outcome.pendulum_angle)
    way = early * outcome.contact_time
    return replace(
        outcome,
        vx=outcome.vx + ball * np.cos(normal),
        vy=outcome.vy + ball * np.sin(normal),
        x=outcome.x + way * ball * np.cos(normal),
        y=outcome.y + way * ball * np.sin(normal),
        pendulum_speed=outcome.pendulum_speed + pendulum,
        pendulum_angle=outcome.pendulum_angle + way * pendulum / contact.length,
    )


def last_longer(contact: Contact, outcome: Outcome, change: Number) -> Outcome:
    """Outcome of a contact that lasts longer by a fraction, at unchanged velocities.

    Released later, the ball has moved further by that fraction, and the pendulum at its mean speed.
    """
    longer = change * outcome.contact_time
    mean_rate = 0.5 * (contact.omega + outcome.pendulum_speed / contact.length)
    rise = 0.5 * (contact.angle + outcome.pendulum_angle)
    pull = contact.gravity * longer
    return replace(
        outcome,
        x=outcome.x * (1.0 + change),
        y=outcome.y + change * outcome.x * np.tan(rise) - 0.5 * pull * outcome.contact_time,
        vy=outcome.vy - pull,
        contact_time=outcome.contact_time + longer,
        pendulum_angle=outcome.pendulum_angle + mean_rate * longer,
    )


def change_restitution(contact: Contact, outcome: Outcome, change: Number) -> Outcome:
    """Outcome with the coefficient of restitution changed by `change`, everything else alike.

    Dissipation acts late in the contact, so the displacement hardly changes.
    """
    heavy, light = contact.inertial_mass, contact.ball_mass
    share = change * contact.impact_speed / (heavy + light)
    return add_normal_speeds(
        contact, outcome, heavy * share, -light * share, SEPARATION_DISPLACEMENT
    )


def turn_launch(outcome: Outcome, angle: Number) -> Outcome:
    """Outcome with force and velocity rotated by `angle` (rad, positive up).

    The displacement rotates with the force; its small vertical part is left unchanged.
    """
    cosine, sine = np.cos(angle), np.sin(angle)
    return replace(
        outcome,
        x=cosine * outcome.x,
        y=outcome.y + sine * outcome.x,
        vx=cosine * outcome.vx - sine * outcome.vy,
        vy=sine * outcome.vx + cosine * outcome.vy,
    )


@dataclass(frozen=True)
class VelocityDependentCor(Effect):
    """A COR whose dependence on speed differs from the model."""

    id: str = "velocity_dependent_cor"
    statement: str = "The coefficient of restitution changes with impact speed."
    law: str = r"e(v) = e_0(v) + s\,(v - 2.5\,\mathrm{m/s})"
    source: str = "Eqs 24, 25 of the paper; Kuwabara and Kono, Jpn. J. Appl. Phys. 26, 1230 (1987)"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = (
        Parameter("slope", "s/m", 0.02, -0.3, 0.3, meaning="change of e per speed"),
    )
    form: str = Form.LINEAR
    separating: str = "pendulum speeds before and after contact at three or more impact speeds"
    looseness: float = 0.2

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """More or less restitution, by impact speed."""
        change = values["slope"] * (contact.impact_speed - REFERENCE_SPEED)
        return change_restitution(contact, outcome, change)


@dataclass(frozen=True)
class YieldingCor(VelocityDependentCor):
    """A COR that decreases with a power of the speed, as for plastic bodies."""

    law: str = r"e(v) = e_0(v)\,(v / 2.5\,\mathrm{m/s})^{-p}"
    source: str = "Johnson, Contact Mechanics (1985), section 11.5 (p = 1/4 of a plastic contact)"
    parameters: tuple[Parameter, ...] = (
        Parameter("power", "1", 0.03, -0.5, 0.5, meaning="e falls with this power of the speed"),
    )
    form: str = Form.POWER

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """The model's restitution times the power."""
        pace = np.log(np.maximum(contact.impact_speed, 1e-6) / REFERENCE_SPEED)
        change = contact.restitution * np.expm1(-values["power"] * pace)
        return change_restitution(contact, outcome, change)


@dataclass(frozen=True)
class ViscoelasticCor(VelocityDependentCor):
    """A COR that decreases with the fifth root of the speed, as for viscoelastic spheres."""

    law: str = r"e(v) = e_0(v) - k\,((v / 2.5\,\mathrm{m/s})^{1/5} - 1)"
    source: str = "Kuwabara and Kono, Jpn. J. Appl. Phys. 26, 1230 (1987)"
    parameters: tuple[Parameter, ...] = (
        Parameter("loss", "1", 0.2, -2.0, 2.0, meaning="of restitution at 2.5 m/s by viscosity"),
    )
    form: str = Form.VISCOELASTIC

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Loss by the fifth root of the speed."""
        speed = np.maximum(contact.impact_speed, 1e-6) / REFERENCE_SPEED
        return change_restitution(contact, outcome, -values["loss"] * (speed**0.2 - 1.0))


MASS_ERROR = Parameter(
    "mass_error", "1", 0.02, -0.5, 0.5, meaning="true effective mass over the model's, minus one"
)


@dataclass(frozen=True)
class EffectiveMass(Effect):
    """A pendulum with another effective mass, or another arm, than the model's."""

    id: str = "effective_mass"
    statement: str = "The pendulum meets the ball with another effective mass (contact arm)."
    law: str = r"M_E = I / L_c^2,\quad L_c = L(1+\epsilon)"
    source: str = "section IV and Table 2 of the paper"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "arm_error", "1", 0.02, -0.5, 0.5, meaning="true arm over the model's, minus one"
        ),
    )
    form: str = Form.ARM
    separating: str = "pendulum speeds before and after contact, with a ball of another mass"
    looseness: float = 0.15

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Share the momentum with another mass; another arm also changes the impact speed.

        The contact time follows from mass and speed: m u² = F x, with F as x to the n.
        """
        light, heavy, e = contact.ball_mass, contact.inertial_mass, contact.restitution
        u = contact.impact_speed
        (error,) = values.values()
        stretch = 1.0 + error
        if self.form == Form.MASS:
            other, speed, seen = heavy * stretch, u, stretch / stretch
        else:
            other, speed, seen = heavy / stretch**2, u * stretch, 1.0 / stretch
        ball = (1.0 + e) * (speed * other / (other + light) - u * heavy / (heavy + light))
        after = (other - e * light) / (other + light) * speed * seen
        pendulum = after - (heavy - e * light) / (heavy + light) * u
        reduced = other / (other + light) * (heavy + light) / heavy
        longer = (reduced * (speed / u) ** (1.0 - CONTACT_EXPONENT)) ** (
            1.0 / (1.0 + CONTACT_EXPONENT)
        ) - 1.0
        pushed = add_normal_speeds(contact, outcome, ball, pendulum)
        return last_longer(contact, pushed, longer)


@dataclass(frozen=True)
class ContactArm(EffectiveMass):
    """A pivot higher or lower above the ball than in the model: arm and geometry change together.

    At the same distance from the pivot a lower ball meets the bar further down, at another angle:
    lever, mass, direction of the force and the instant change together.
    """

    law: str = (
        r"M_E = I / L_c^2,\quad L_c = L(1+\epsilon),\quad "
        r"\Delta\varphi = -\epsilon L \sin\varphi / (L \cos\varphi - \tfrac{d}{2} \sin\varphi)"
    )
    source: str = "Fig. 2 of the paper: ball, face and pivot as a triangle; horizontal side kept"
    form: str = Form.GEOMETRY

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Another lever, and a contact at another angle."""
        sine, cosine = np.sin(contact.angle), np.cos(contact.angle)
        lever = contact.length * cosine - 0.5 * contact.diameter * sine
        turned = -values["arm_error"] * contact.length * sine / lever
        pushed = turn_launch(super().contact(values, contact, outcome), turned)
        return replace(
            pushed,
            contact_time=pushed.contact_time + turned / contact.omega,
            pendulum_angle=pushed.pendulum_angle + turned,
        )


SHELL_INERTIA_RATIO = 1.5
"""m R² / I of a thin shell, 1 (derived), as for inflated balls."""


def _met_by_face(
    contact: Contact, outcome: Outcome, turn: Number, lever: Number, grip: Number
) -> Outcome:
    """Outcome with a rotated normal of the face and friction along it.

    The separation speed along the normal is e times the approach speed, and the impulses along and
    across the normal act on both bodies.

    Parameters
    ----------
    turn : Number
        Of the normal, rad, positive up.
    lever : Number
        Of the force, over the pendulum's length.
    grip : Number
        Speed of the ball across the normal, opposite to the turn, m/s.
    """
    sine, light = np.sin(turn), contact.ball_mass / contact.inertial_mass
    before = (1.0 + contact.restitution) * contact.impact_speed / (1.0 + light)
    met = (1.0 + contact.restitution) * contact.impact_speed - sine * light * grip
    along = lever * met / (1.0 + light * np.square(lever))
    kept = along / before
    turned = turn_launch(outcome, turn)
    normal = 0.5 * (contact.angle + outcome.pendulum_angle) + turn
    vx, vy = kept * turned.vx + grip * np.sin(normal), kept * turned.vy - grip * np.cos(normal)
    lost = (contact.impact_speed - outcome.pendulum_speed) * (lever * along + sine * grip) / before
    return replace(
        turned, vx=vx, vy=vy, pendulum_speed=contact.impact_speed - lost,
        x=turned.x + 0.5 * outcome.contact_time * (vx - turned.vx),
        y=turned.y + 0.5 * outcome.contact_time * (vy - turned.vy),
    )  # fmt: skip


@dataclass(frozen=True)
class ObliqueImpact(Effect):
    """A face that meets the ball off its centre."""

    id: str = "oblique_impact"
    statement: str = "The face meets the ball off its centre and sends it off at another angle."
    law: str = r"\Delta\theta = \arcsin(2h/d)"
    source: str = "oblique impact, Goldsmith, Impact (1960), ch. 1"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = (
        Parameter("offset", "m", 0.002, -0.08, 0.08, meaning="above the centre is positive"),
    )
    separating: str = "a plumb line in view, and a mark that shows spin"
    looseness: float = 0.25

    def turn(self, values: Values, contact: Contact) -> Number:
        """Angle by which the force is rotated up, rad."""
        return np.asarray(-np.arcsin(np.clip(2.0 * values["offset"] / contact.diameter, -0.9, 0.9)))

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Rotate the impulse."""
        turn = self.turn(values, contact)
        if self.form != Form.SMOOTH_FACE:
            return turn_launch(outcome, turn)
        return _met_by_face(contact, outcome, turn, np.cos(turn), 0.0)


SPIN_RATIO = Parameter(
    "spin_share", "1", 0.1, -1.5, 1.5, width=0.3,
    meaning="speed of the ball's surface by spin over the impact speed; back-spin is positive",
)  # fmt: skip


@dataclass(frozen=True)
class RubbingFace(ObliqueImpact):
    """A rotated face with friction, which spins the ball so that the air lifts it."""

    law: str = r"\Delta\theta = \arcsin(2h/d),\quad \omega = 2 k u / d"
    source: str = "oblique impact with friction, Garwin, Am. J. Phys. 37, 88 (1969)"
    parameters: tuple[Parameter, ...] = (*ObliqueImpact().parameters, SPIN_RATIO)
    form: str = Form.RUBBING_FACE

    def lever(self, turn: Number, contact: Contact) -> Number:
        """Lever of the force over the pendulum's length."""
        return np.cos(turn)

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Force along the rotated normal; the friction that spins the ball also slows it across."""
        turn = self.turn(values, contact)
        grip = values["spin_share"] * contact.impact_speed / SHELL_INERTIA_RATIO
        return _met_by_face(contact, outcome, turn, self.lever(turn, contact), grip)

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Lift by the spin from the face, with a coefficient of one per spin ratio."""
        k = flight.dynamic_area * values["spin_share"] * np.asarray(flight.impact_speed)
        return -k * flight.vy, k * flight.vx, np.zeros_like(np.asarray(flight.vz) * k)


@dataclass(frozen=True)
class TurnedFace(RubbingFace):
    """A face rotated by one angle, independent of the ball's size."""

    statement: str = "The face is turned and sends the ball off at another angle."
    law: str = r"\Delta\theta = \alpha,\quad \omega = 2 k u / d"
    parameters: tuple[Parameter, ...] = (
        Parameter("turn", "rad", 0.02, -0.6, 0.6, meaning="of the face's normal, positive up"),
        SPIN_RATIO,
    )
    form: str = Form.TURNED_FACE

    def turn(self, values: Values, contact: Contact) -> Number:
        """The same angle for all balls, rad."""
        return values["turn"]


@dataclass(frozen=True)
class FaceTurnedOnArm(TurnedFace):
    """A face rotated about its own position on the arm, so that it meets the ball elsewhere."""

    law: str = (
        r"\Delta\theta = \alpha,\quad \omega = 2 k u / d,\quad"
        r" \ell = L \cos\alpha + \tfrac{d}{2} \sin\alpha"
    )
    form: str = Form.TURNED_ON_ARM

    def lever(self, turn: Number, contact: Contact) -> Number:
        """Distance of the pivot from the normal through the ball's centre."""
        return np.cos(turn) + 0.5 * contact.diameter / contact.length * np.sin(turn)

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Contact a little sooner, at an earlier angle."""
        turn = self.turn(values, contact)
        sooner = 0.5 * contact.diameter * (1.0 - np.cos(turn)) / contact.length
        sooner = sooner / self.lever(turn, contact)
        met = turn_launch(super().contact(values, contact, outcome), -sooner)
        return replace(
            met,
            contact_time=met.contact_time - sooner / contact.omega,
            pendulum_angle=met.pendulum_angle - sooner,
        )


def _part_later(contact: Contact, outcome: Outcome, longer: Number, speed: Number) -> Outcome:
    """Outcome of bodies that stay in contact for `longer` (s) at a common `speed` (m/s)."""
    normal = 0.5 * (contact.angle + outcome.pendulum_angle)
    pull = contact.gravity * longer
    return replace(
        outcome,
        x=outcome.x + longer * speed * np.cos(normal),
        y=outcome.y + longer * speed * np.sin(normal) - 0.5 * pull * outcome.contact_time,
        vy=outcome.vy - pull,
        contact_time=outcome.contact_time + longer,
        pendulum_angle=outcome.pendulum_angle + longer * speed / contact.length,
    )


@dataclass(frozen=True)
class SupportFriction(Effect):
    """Friction between ball and support until the ball has lifted off.

    A steady force does not change the separation speed: the face compensates the ball's loss, and
    both are slowed by the momentum that the support takes. Pressed together more strongly, they
    separate a little later.
    """

    id: str = "support_friction"
    statement: str = "The ball rubs on its support while it is being pushed off."
    law: str = r"\Delta v = -\mu g\,t_s\,m/(m + M)\ \text{of both bodies}"
    source: str = "Coulomb friction under the ball's weight over the time on the support"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = (
        Parameter("friction_coefficient", "1", 0.3, 0.0, 3.0, meaning="ball on support"),
    )
    form: str = Form.WHOLE_CONTACT
    separating: str = "a launch off a slippery support (a sheet of PTFE)"
    looseness: float = 0.4

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Remove momentum while the ball rests on the support."""
        friction = values["friction_coefficient"] * contact.gravity
        gap = outcome.contact_time
        if self.form == Form.BALL_ALONE:
            lost = friction * gap
            return replace(outcome, vx=outcome.vx - lost, x=outcome.x - 0.5 * lost * gap)
        both = contact.inertial_mass + contact.ball_mass
        if self.form == Form.UNTIL_LIFT_OFF:
            # The ball lifts once sin(angle) of the rising push exceeds its weight; for a half sine
            # of impulse (1+e) u m M/(M+m) that is early in a fast contact.
            gain = (1.0 + contact.restitution) * contact.impact_speed
            gain = gain * contact.inertial_mass / both
            peak = 0.5 * np.pi * gain / gap * np.sin(contact.angle)
            with np.errstate(divide="ignore"):  # a level push never lifts it
                share = np.arcsin(np.clip(contact.gravity / peak, 0.0, 1.0)) / np.pi
            early = -friction * gap * share * contact.ball_mass / both
            return add_normal_speeds(contact, outcome, early, early, 1.0 - 0.5 * share)
        slowed = -friction * gap * contact.ball_mass / both
        # A half sine of duration T under a steady push a lasts 2 a T^2 / (pi^2 u) longer.
        longer = 2.0 * friction * np.square(gap / np.pi) / contact.impact_speed
        common = contact.inertial_mass / both * contact.impact_speed
        braked = add_normal_speeds(contact, outcome, slowed, slowed)
        return _part_later(contact, braked, longer, common)


CONTACT_TIME_FRACTIONS = np.linspace(0.0, 1.0, 65)
"""Fractions of a contact's time at which the displacement is tabulated (accurate to 1e-3)."""

DISPLACEMENT_FRACTIONS = CONTACT_TIME_FRACTIONS - np.sin(np.pi * CONTACT_TIME_FRACTIONS) / np.pi
"""Fractions of the displacement then (derived: v grows as 1 − cos under a half-sine force)."""


@dataclass(frozen=True)
class SlidingSupport(SupportFriction):
    """Friction until the ball has slid off the edge of its support."""

    law: str = r"\Delta v = -\mu g\,t(s)\,m/(m + M)\ \text{of both bodies}"
    source: str = "Coulomb friction under the ball's weight over the length of the support"
    parameters: tuple[Parameter, ...] = (
        *SupportFriction().parameters,
        Parameter("way", "m", 0.01, 0.003, 0.1, grid=(0.01, 0.02), meaning="length of the support"),
    )
    form: str = Form.OVER_A_WAY

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Remove momentum until the ball has left the support, or during the whole contact."""
        both = contact.inertial_mass + contact.ball_mass
        whole = np.maximum(np.abs(outcome.x), 1e-6)
        share = np.interp(
            np.minimum(values["way"] / whole, 1.0), DISPLACEMENT_FRACTIONS, CONTACT_TIME_FRACTIONS
        )
        lost = values["friction_coefficient"] * contact.gravity * outcome.contact_time * share
        early = -lost * contact.ball_mass / both
        return add_normal_speeds(contact, outcome, early, early, 1.0 - 0.5 * share)


@dataclass(frozen=True)
class ContactDisplacement(Effect):
    """Displacement of the ball during contact that differs from the model's."""

    id: str = "contact_displacement"
    statement: str = "The ball has moved otherwise during contact than the model says."
    law: str = r"x_0 = x_{0,model}(1+k)"
    source: str = "section II of the paper: displacement v_avg Δt during contact"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = (
        Parameter("relative_change", "1", 0.1, -2.0, 5.0, meaning="of the way during contact"),
    )
    separating: str = "more frames during contact (higher capture rate)"
    looseness: float = 0.3

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Scale the displacement at unchanged velocity; a softer ball also has a longer contact."""
        change = values["relative_change"]
        if self.form == Form.WAY_ALONE:
            return replace(outcome, x=outcome.x * (1.0 + change))
        return last_longer(contact, outcome, change)


@dataclass(frozen=True)
class PivotRecoil(Effect):
    """A pivot that yields and takes momentum."""

    id: str = "pivot_recoil"
    statement: str = "The pivot gives way under the impact and takes part of the momentum."
    law: str = r"J = J_0(1-k)"
    source: str = "centre of percussion: the pivot's reaction during the impact"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = (
        Parameter("lost_share", "1", 0.02, 0.0, 0.5, meaning="of ball's and pendulum's speeds"),
    )
    separating: str = "the pivot in view, or an accelerometer on the frame"
    looseness: float = 0.25

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Remove the same fraction from both bodies."""
        kept = 1.0 - values["lost_share"]
        if self.form == Form.PENDULUM_ALONE:
            lost = contact.impact_speed - outcome.pendulum_speed
            return replace(
                outcome, pendulum_speed=outcome.pendulum_speed - values["lost_share"] * lost
            )
        return replace(
            outcome,
            vx=outcome.vx * kept,
            vy=outcome.vy * kept,
            pendulum_speed=outcome.pendulum_speed * kept,
        )


@dataclass(frozen=True)
class SupportRecoil(Effect):
    """A support that adds or absorbs upward momentum."""

    id: str = "support_recoil"
    statement: str = "The support pushes back: the ball leaves with another vertical speed."
    law: str = r"\Delta v_y = k\,u \quad\text{or}\quad \Delta v_y = k\,v_{y}"
    source: str = "reaction impulse of the support during contact"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = (
        Parameter("vertical_share", "1", 0.02, -0.5, 0.5, meaning="vertical speed gained"),
    )
    form: str = Form.OF_IMPACT_SPEED
    separating: str = "the support in view at contact, or a launch off a soft support"
    looseness: float = 0.3

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """Add vertical speed."""
        if self.form == Form.WHOLE_VELOCITY:
            kept = 1.0 - values["vertical_share"]
            return replace(outcome, vx=outcome.vx * kept, vy=outcome.vy * kept)
        reference: Number = contact.impact_speed
        if self.form == Form.OF_VERTICAL_SPEED:
            reference = outcome.vy
        elif self.form == Form.CONSTANT:
            reference = 1.0
        gained = values["vertical_share"] * reference
        if self.form == Form.KICK_AT_RELEASE:
            return replace(outcome, vy=outcome.vy + gained)
        return replace(
            outcome, vy=outcome.vy + gained, y=outcome.y + 0.5 * gained * outcome.contact_time
        )
