"""Where the mass strikes: its foremost edge, and the middle of a face seen as a strip."""

import numpy as np
import pytest

from tests.vision.ball.painted import PIVOT_PX, struck_ball
from vision.following import follow
from vision.tracks import Face

HALF_PX = 8.12
"""The mass as OpenCV fills it: half a fine pixel beyond its corners."""


def seen_face(**painting: float) -> tuple[Face, float]:
    clip, _, angles = struck_ball(**painting)  # type: ignore[arg-type]
    tracks = follow(clip, 600.0)  # type: ignore[arg-type]
    assert tracks.pendulum is not None
    face = tracks.pendulum.face
    return face, float(angles[face.frame])


def lead(point_px: np.ndarray, angle: float) -> float:
    """How far a point leads the line from the pivot down the arm, px."""
    return float((point_px - np.array(PIVOT_PX)) @ [np.cos(angle), -np.sin(angle)])


@pytest.mark.parametrize(
    ("shadow", "noise"),
    [
        pytest.param(0.0, 1.5, marks=pytest.mark.slow),
        (4.0, 1.5),
        pytest.param(0.0, 4.0, marks=pytest.mark.slow),
    ],
)
def test_a_face_seen_as_a_strip_is_met_in_its_middle(shadow: float, noise: float) -> None:
    face, angle = seen_face(strip=3.0, shadow=shadow, noise=noise)
    assert face.middle_px is not None
    assert lead(face.middle_px, angle) == pytest.approx(HALF_PX - 1.5, abs=0.15)
    assert lead(face.edge_px, angle) == pytest.approx(HALF_PX, abs=0.2)
    assert 0.02 < face.middle_std_px < 0.3


@pytest.mark.parametrize("shadow", [0.0, pytest.param(4.0, marks=pytest.mark.slow)])
def test_a_mass_of_one_shade_has_an_edge_alone(shadow: float) -> None:
    face, angle = seen_face(shadow=shadow)
    assert lead(face.edge_px, angle) == pytest.approx(HALF_PX, abs=0.2)
    assert face.middle_px is None
    assert face.edge_std_px < 0.3
