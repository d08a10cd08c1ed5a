"""A measurement to report on: a strike, a flight under gravity, and a landing."""

import numpy as np

from measuring.checks import Check, CheckKind, CheckOutcome
from metrology import Contribution, Quantity
from pipelines.report import Curve, GapRecord, Moment, PathRecord, ReportInput, SpeedRecord

ONSET, RELEASE = 0.0840, 0.0981
SPEED, ANGLE, G = 6.361, np.radians(12.34), 9.806


def example(still: bytes | None = None) -> ReportInput:
    rng = np.random.default_rng(5)
    frame = np.arange(333) / 600
    gap = np.where(
        frame < ONSET, 3.9 * (ONSET - frame), np.where(frame > RELEASE, 2.8 * (frame - RELEASE), 0)
    )
    squash = (frame > ONSET) & (frame < RELEASE)
    gap = gap - 0.015 * np.sin(np.pi * (frame - ONSET) / (RELEASE - ONSET)) * squash
    near = (frame > 0.06) & (frame < 0.125)
    noise = rng.normal(0, 4e-4, frame.size)
    gap_record = GapRecord(
        frame[near], (gap + noise)[near], np.full(near.sum(), 4e-4), Moment(ONSET, 8e-5),
        Moment(RELEASE, 1.1e-4),
        (Curve(np.array([0.06, ONSET]), np.array([3.9 * (ONSET - 0.06), 0.0]), "closing"),
         Curve(np.array([RELEASE, 0.125]), np.array([0.0, 2.8 * (0.125 - RELEASE)]), "opening")),
    )  # fmt: skip
    flown = frame[frame > RELEASE] - RELEASE
    x = 0.02 + SPEED * np.cos(ANGLE) * flown
    y = 0.413 + SPEED * np.sin(ANGLE) * flown - 0.5 * G * flown**2
    left = rng.normal(0, 4e-4, (2, flown.size))
    std = np.full(flown.size, 4e-4)
    path = PathRecord(
        flown + RELEASE, x + left[0], y + left[1], std, std,
        (Curve(x, y, "fit, free fall with drag"),),
        (float(x[-1]), float(y[-1])), 0.002, flown + RELEASE, left[0], left[1], std,
    )  # fmt: skip
    speed = np.hypot(SPEED * np.cos(ANGLE), SPEED * np.sin(ANGLE) - G * flown)
    speeds = (
        SpeedRecord("ball", flown + RELEASE, speed + rng.normal(0, 0.3, flown.size),
                    np.full(flown.size, 0.3),
                    (Curve(flown + RELEASE, speed, "ball, fitted"),)),
        SpeedRecord("pendulum", frame[:55], 3.9 + rng.normal(0, 0.2, 55), np.full(55, 0.2)),
    )  # fmt: skip
    quantities = (
        Quantity.measured("contact_frames", 9.0, "1", (Contribution("exposure", 0.4),)),
        Quantity.measured("contact_time", 0.01413, "s",
                          (Contribution("gap noise", 1.2e-4),
                           Contribution("capture rate", 4.1e-6))),
        Quantity.measured("ball_speed", 6.361, "m/s",
                          (Contribution("length scale", 0.009),
                           Contribution("capture rate", 0.0018),
                           Contribution("picture noise", 0.003))),
        Quantity.measured("launch_angle", 12.341, "deg", (Contribution("picture noise", 0.06),
                                                           Contribution("camera roll", 0.05))),
        Quantity.missing("landing_distance", "m", "the ball leaves the frame at 0.31 s"),
        Quantity.measured("cor_speeds", 0.7153, "1", (Contribution("ball speed", 0.004),)),
    )  # fmt: skip
    checks = (
        Check(
            CheckKind.GRAVITY,
            CheckOutcome.PASSED,
            "free fall measures 9.79 ± 0.03 m/s², the true value is 9.806 m/s²",
        ),
        Check(CheckKind.COR_AGREEMENT, CheckOutcome.UNDECIDED, "only one of three estimates"),
        Check(
            CheckKind.CONTACT_BOUND,
            CheckOutcome.FAILED,
            "the ball seems 3 % too large for the plane that the tape gives",
        ),
    )
    facts = (
        ("clip", "jokku_120.mp4"),
        ("size", "432×240 px"),
        ("frames", "333"),
        ("capture rate", "600 fps (option)"),
        ("sha256", "d2c1…"),
    )
    warnings = ("The landing is out of the picture; <no> distance is given.",)
    return ReportInput(
        "jokku_120.mp4",
        facts,
        quantities,
        checks,
        warnings,
        gap_record,
        speeds,
        path,
        still,
        "0.1.0",
    )
