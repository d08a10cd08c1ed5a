"""The forms that several laws of one id come in."""

from enum import StrEnum

__all__ = ["Form"]


class Form(StrEnum):
    """Which of several laws of one id; the value is what verdicts print.

    A user's own effect may have any text as its form.
    """

    ARM = "arm"
    MASS = "mass"
    RUBBING_FACE = "rubbing face"
    SMOOTH_FACE = "smooth face"
    WHOLE_CONTACT = "whole contact"
    UNTIL_LIFT_OFF = "until lift-off"
    BALL_ALONE = "ball alone"
    WAY_ALONE = "way alone"
    PENDULUM_ALONE = "pendulum alone"
    OF_IMPACT_SPEED = "of impact speed"
    OF_VERTICAL_SPEED = "of vertical speed"
    CONSTANT = "constant"
    WHOLE_VELOCITY = "whole velocity"
    KICK_AT_RELEASE = "kick at release"
    ABOUT_THE_ORIGIN = "about the origin"
    ABOUT_THE_START = "about the start"
    ABOUT_A_POINT = "about a point"
    THREE_AXES = "three axes"
    BALL_ONLY = "ball only"
    OTHER_ROWS = "other rows"
    STEADILY = "steadily"
    BY_REYNOLDS_NUMBER = "by Reynolds number"
