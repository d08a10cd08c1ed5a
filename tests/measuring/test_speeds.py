"""The ball's speed the paper's ways, and what is said when they disagree."""

import math

import pytest

from measuring.checks import (
    Check,
    CheckKind,
    CheckOutcome,
    apply_contradictions,
    ball_size,
    compare_speeds,
    contact_contradiction,
    eq7_gravity_excess,
    passive_contact,
    pendulum_length,
    speed_by_pendulum,
)
from measuring.inputs import gather_inputs
from measuring.setup.file import Setup
from metrology import Contribution, Quantity
from physics.bodies import JOKKU, PAPER_PENDULUM, PAPER_SUPPORT
from physics.contact import simulate_contact


def test_eq_7_less_the_share_of_gravity_is_the_balls_speed() -> None:
    history = simulate_contact(PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, 3.0)
    out = history.outcome
    mass = JOKKU.mass
    by_pendulum = speed_by_pendulum(PAPER_PENDULUM, mass, 3.0, float(out.pendulum_speed_after))
    share = eq7_gravity_excess(
        PAPER_PENDULUM,
        mass,
        float(history.phi.mean()),
        PAPER_PENDULUM.length,
        (9.806, float(history.time[-1])),
    )
    assert 0.2 < share < 0.5
    assert by_pendulum - share == pytest.approx(float(out.ball_speed), rel=0.02)


def found(**values: tuple[float, float]) -> dict[str, Quantity]:
    return {
        name: Quantity.measured(name, value, "m/s", (Contribution("noise", std),))
        for name, (value, std) in values.items()
    }


def test_speeds_that_agree_pass() -> None:
    check = compare_speeds(
        found(
            ball_speed=(3.80, 0.005),
            ball_speed_per_frame=(3.78, 0.02),
            ball_speed_eq7=(4.20, 0.16),
            eq7_by_gravity=(0.30, 0.01),
        )
    )
    assert check is not None
    assert check.check.passed is True


def test_a_contact_at_its_bound_is_doubted_where_the_pendulum_did_not_lose_the_momentum() -> None:
    speeds = compare_speeds(
        found(
            ball_speed=(4.13, 0.02),
            ball_speed_per_frame=(4.12, 0.05),
            ball_speed_eq7=(1.84, 0.58),
            eq7_by_gravity=(0.67, 0.02),
        )
    )
    assert speeds is not None
    at_the_bound = Check(CheckKind.CONTACT_BOUND, CheckOutcome.UNDECIDED, "29.6 ms of 29 ms", 0.4)
    doubt = contact_contradiction(speeds, at_the_bound)
    assert doubt is not None
    lasting = {"contact_time": Quantity.measured("contact_time", 0.0296, "s", ())}
    assert apply_contradictions(lasting, [doubt])["contact_time"].value is None
    # a contact that is surely possible may be right though the pendulum's inertia is not
    possible = Check(CheckKind.CONTACT_BOUND, CheckOutcome.PASSED, "15 ms of 29 ms", 1.0)
    assert contact_contradiction(speeds, possible) is None


@pytest.mark.parametrize(
    ("per_frame", "eq7"), [(3.6, 4.2), (3.79, 6.0)], ids=["frames", "pendulum"]
)
def test_speeds_that_disagree_are_told(per_frame: float, eq7: float) -> None:
    check = compare_speeds(
        found(
            ball_speed=(3.80, 0.005),
            ball_speed_per_frame=(per_frame, 0.02),
            ball_speed_eq7=(eq7, 0.16),
            eq7_by_gravity=(0.30, 0.01),
        )
    )
    assert check is not None
    assert check.check.passed is False
    assert "disagree" in check.check.statement
    difference = check.flight_difference if eq7 < 5.0 else check.pendulum_difference
    assert difference == pytest.approx((3.80 - per_frame if eq7 < 5.0 else eq7 - 0.3 - 3.80) / 3.80)


def test_speeds_too_unsure_to_disagree_say_so() -> None:
    speeds = found(
        ball_speed=(3.80, 0.4),
        ball_speed_per_frame=(3.60, 0.5),
        ball_speed_eq7=(4.80, 0.9),
        eq7_by_gravity=(0.30, 0.01),
    )
    check = compare_speeds(speeds)
    assert check is not None
    assert check.check.outcome is CheckOutcome.UNDECIDED


def test_without_a_pendulum_only_the_frames_are_compared() -> None:
    speeds = found(ball_speed=(3.80, 0.005), ball_speed_per_frame=(3.79, 0.02))
    for name in ("ball_speed_eq7", "eq7_by_gravity"):
        speeds[name] = Quantity.missing(name, "m/s", "no pendulum")
    check = compare_speeds(speeds)
    assert check is not None
    assert check.check.passed is True
    assert "Eq. 7" not in check.check.statement


def test_a_ball_of_another_size_than_it_is_said_to_have_is_told_and_its_contact_withheld() -> None:
    values = {
        "ball_speed": Quantity.measured("ball_speed", 3.8, "m/s", (Contribution("noise", 0.01),)),
        "contact_time": Quantity.measured(
            "contact_time", 0.016, "s", (Contribution("noise", 5e-4),)
        ),
    }
    agrees = ball_size(0.2465, 0.005, 0.2459, values)
    assert agrees is not None
    assert agrees.check.outcome is CheckOutcome.PASSED
    assert not agrees.contradictions
    small = ball_size(0.2459, 0.005, 0.27, values)
    assert small is not None
    assert small.check.outcome is CheckOutcome.FAILED
    left = apply_contradictions(values, small.contradictions)
    assert left["contact_time"].value is None
    assert left["ball_speed"].std == pytest.approx(3.8 * (1 - 0.2459 / 0.27), rel=0.05)
    # an outline known to a twentieth can't tell
    vague = ball_size(0.2465, 0.05, 0.2459, values)
    assert vague is not None
    assert vague.check.outcome is CheckOutcome.UNDECIDED


@pytest.mark.parametrize("longer", [0.8, 1.0, 1.08, 1.2])
def test_an_arm_that_is_not_the_papers_puts_in_doubt_what_hangs_on_its_inertia(
    longer: float,
) -> None:
    inputs = gather_inputs(Setup(), "basketball", None)
    length = inputs.pendulum.length
    held = pendulum_length(longer * length, inputs)
    names = ("energy_loss", "cor_launch", "cor_speeds", "ball_speed")
    sure = {name: Quantity.measured(name, 1.0, "1", ()) for name in names}
    found = apply_contradictions(sure, held.contradictions)
    if abs(math.log(longer)) < 0.1:
        assert held.check.outcome is CheckOutcome.PASSED
        assert found == sure
        return
    assert held.check.outcome is CheckOutcome.FAILED
    assert "[pendulum]" in held.check.statement
    assert found["energy_loss"].value is None
    # a bar that is scaled as a whole has an inertia that goes with the square of its length
    launch = found["cor_launch"].std
    assert launch is not None
    assert 0.02 < launch < 0.3 * abs(longer**2 - 1.0)
    assert found["cor_speeds"] == sure["cor_speeds"]
    assert found["ball_speed"] == sure["ball_speed"]


@pytest.mark.parametrize(
    ("cor", "std", "detected", "left"),
    [
        (0.88, 0.01, False, True),
        (1.05, 0.03, False, True),
        (1.06, 0.01, True, True),
        (1.14, 0.02, True, False),
    ],
)
def test_a_contact_that_returns_more_speed_than_it_takes_is_not_believed(
    cor: float, std: float, detected: bool, left: bool
) -> None:
    values = {
        name: Quantity.measured(name, value, "1", (Contribution("noise", noise),))
        for name, value, noise in [
            ("cor", cor, std),
            ("pendulum_speed_before", 2.0, 0.01),
            ("ball_speed", 3.6, 0.01),
            ("launch_angle", 14.0, 0.1),
        ]
    }
    held = passive_contact(values)
    assert (held is not None) == detected
    if held is None:
        return
    assert held.check.outcome is CheckOutcome.FAILED
    found = apply_contradictions(values, held.contradictions)
    assert found["launch_angle"] == values["launch_angle"]
    for name in ("cor", "pendulum_speed_before", "ball_speed"):
        assert (found[name].value is not None) == left
    # what is left reaches down to what a contact can have
    if left:
        assert found["cor"].std is not None
        assert cor - 1.0 < 1.1 * found["cor"].std
