"""What lay at first and left, or came and stayed, is no part of the scene behind it."""

import numpy as np
from numpy.typing import NDArray

from vision.scene import without_ghosts

SHAPE = (80, 120)


def wall() -> NDArray[np.float32]:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return (140.0 + 0.2 * rows - 0.1 * columns).astype(np.float32)


def disc(x: float, y: float, radius: float) -> NDArray[np.bool_]:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.asarray((columns - x) ** 2 + (rows - y) ** 2 < radius**2)


def test_a_ball_that_left_and_a_mass_that_came_to_hang_beside_it_are_both_taken_away() -> None:
    ball, mass = disc(50.0, 40.0, 9.0), disc(68.0, 40.0, 9.0)
    with_ball = np.where(ball, 60.0, wall()).astype(np.float32)
    with_mass = np.where(mass, 220.0, wall()).astype(np.float32)
    both = np.where(ball, 60.0, with_mass).astype(np.float32)
    always = np.ones(SHAPE, dtype=bool)
    noise = np.full(SHAPE, 1.0, dtype=np.float32)
    epochs = [with_ball, with_ball, wall(), with_mass]
    clean = without_ghosts(epochs, [always] * 4, both, noise)
    assert np.abs(clean - wall()).max() < 1.0


def test_what_is_seen_for_a_while_in_between_is_no_ghost() -> None:
    by = np.where(disc(50.0, 40.0, 9.0), 60.0, wall()).astype(np.float32)
    noise = np.full(SHAPE, 1.0, dtype=np.float32)
    always = [np.ones(SHAPE, dtype=bool)] * 4
    clean = without_ghosts([wall(), by, by, wall()], always, by, noise)
    assert np.array_equal(clean, by)


def test_specks_are_left_as_they_are() -> None:
    speck = np.where(disc(50.0, 40.0, 3.2), 60.0, wall()).astype(np.float32)
    noise = np.full(SHAPE, 1.0, dtype=np.float32)
    always = [np.ones(SHAPE, dtype=bool)] * 2
    assert np.array_equal(without_ghosts([speck, wall()], always, speck, noise), speck)
