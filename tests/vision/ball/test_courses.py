"""Stretches of constant acceleration and courses from rest on."""

import numpy as np

from vision.ball.courses import lawful_stretch

TIME = np.arange(60.0)


def test_the_lawful_stretch_ends_at_the_bounce() -> None:
    fall = np.column_stack([2.0 * TIME[:30], 0.1 * TIME[:30] ** 2])
    after = TIME[1:25]
    rise = fall[-1] + np.column_stack([2.0 * after, -5.0 * after + 0.1 * after**2])
    stretch = lawful_stretch(np.arange(54), np.concatenate([fall, rise]), 6.0)
    assert (stretch.first, stretch.last) in {(0, 29), (0, 30), (0, 31)}
    assert stretch.evidence > 50.0
