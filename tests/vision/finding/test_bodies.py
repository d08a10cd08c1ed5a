import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.vision.ball.painted import PaintedClip, exposed, wall
from vision.clip.footage import Footage
from vision.finding.bodies import rigid_bodies
from vision.finding.detection import searched_frames
from vision.following import follow
from vision.scene import FilmedScene
from vision.stages import given_objects, tracklet_table
from vision.tracks import MotionKind

PIVOT, ARM, PERIOD = np.array([120.0, -30.0]), 110.0, 57.0


def plank(frames: int, amplitude: float) -> tuple[PaintedClip, NDArray[np.float64]]:
    """Paint a mottled plank that swings about a pivot above the picture; its angles."""
    fine, shape, size = 4, (160, 240), (70, 44)
    mottle = np.random.default_rng(3).uniform(0, 1, (size[0] * fine, size[1] * fine))
    rough = cv2.GaussianBlur(mottle.astype(np.float32), (0, 0), 3.0 * fine)
    surface = 0.05 + 0.3 * (rough - rough.min()) / np.ptp(rough)
    scene, pictures, angles = wall(*shape), [], []
    for index in range(frames):
        angle = amplitude * np.sin(2.0 * np.pi * index / PERIOD)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        middle = PIVOT + ARM * np.array([np.sin(angle), np.cos(angle)])
        corner = (middle + 0.5) * fine - turn @ (np.array(size[::-1]) * fine / 2.0)
        pose, large = np.column_stack([turn, corner]), (shape[1] * fine, shape[0] * fine)
        part, shown = (
            cv2.resize(cv2.warpAffine(one, pose, large), shape[::-1], interpolation=cv2.INTER_AREA)
            for one in (np.ones_like(surface), surface)
        )
        pictures.append(exposed(scene * (1.0 - part) + shown, 1.5, index))
        angles.append(angle)
    return PaintedClip(pictures), np.array(angles)


@pytest.mark.parametrize("amplitude", [0.1, 0.6])
def test_a_plank_that_never_leaves_its_place_is_followed_about_its_pivot(amplitude: float) -> None:
    clip, angles = plank(120, amplitude)
    scene = FilmedScene(Footage(clip))  # type: ignore[arg-type]
    body = rigid_bodies(scene, searched_frames(scene))[0]
    arm = body.centre_px - PIVOT
    turned = np.unwrap(np.arctan2(arm[:, 0], arm[:, 1])) - angles[body.frame]
    assert len(body) > 110
    assert np.std(np.hypot(*arm.T)) < 0.15
    assert np.std(turned) * ARM < 0.15
    assert 20.0 < body.radius < 40.0


def test_a_table_of_a_body_that_is_handed_back_is_followed_by_its_corners() -> None:
    clip, angles = plank(120, 0.1)
    scene = FilmedScene(Footage(clip))  # type: ignore[arg-type]
    bodies = rigid_bodies(scene, searched_frames(scene))
    table = tracklet_table(bodies)
    table["measured"] = (table["tracklet"] == 0).astype(int)
    tracks = follow(clip, 600.0, given=given_objects(table))  # type: ignore[arg-type]
    arm = tracks.ball.centre_px - PIVOT
    turned = np.arctan2(arm[:, 0], arm[:, 1]) - angles[tracks.ball.frame]
    assert tracks.motion.kind is MotionKind.SWING
    assert np.std(turned) * ARM < 0.15
    # what corners span is no size of a ball
    assert not tracks.ball.sized


def test_nothing_moves_together_where_nothing_moves() -> None:
    still = PaintedClip([exposed(wall(160, 240), 1.5, seed) for seed in range(40)])
    scene = FilmedScene(Footage(still))  # type: ignore[arg-type]
    assert rigid_bodies(scene, searched_frames(scene)) == []
