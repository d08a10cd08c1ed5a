import os
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from metrology.compiled import map_in_threads
from vision.ball.ball import BallFits, follow_ball
from vision.ball.path import BallPath
from vision.clip.clip import ClipReader
from vision.clip.footage import Footage
from vision.finding.detection import detect, searched_frames
from vision.finding.linking import link
from vision.scene import FilmedScene

CLIP = Path(__file__).parents[2] / "sample_videos" / "clips" / "basketball_60.mp4"


def test_results_come_in_the_order_of_the_items() -> None:
    assert list(map_in_threads(lambda number: number**2, range(50))) == [n**2 for n in range(50)]


def test_no_more_items_are_taken_than_keep_the_workers_busy() -> None:
    taken = 0

    def items() -> Iterator[int]:
        nonlocal taken
        for number in range(1000):
            taken += 1
            yield number

    results = map_in_threads(lambda number: number, items())
    assert next(results) == 0
    assert taken < 20


def test_a_failure_is_handed_on() -> None:
    def fail(number: int) -> int:
        raise ValueError(f"{number} in {threading.current_thread().name}")

    with pytest.raises(ValueError, match="0 in"):
        list(map_in_threads(fail, range(3)))


def test_one_thing_alone_starts_no_worker() -> None:
    def where(_: int) -> threading.Thread:
        return threading.current_thread()

    here = threading.current_thread()
    assert list(map_in_threads(where, [1])) == [here]
    assert here not in list(map_in_threads(where, range(4)))


def test_a_ball_is_found_and_fitted_alike_on_one_core_and_on_several(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    footage = Footage(ClipReader.open(CLIP))

    def seen(cores: int) -> tuple[list[float], BallFits]:
        monkeypatch.setattr(os, "cpu_count", lambda: cores)
        scene = FilmedScene(footage)
        found = detect(scene)
        first = link(found, searched_frames(scene), scene.shape)[0].seen
        path = BallPath(first.frame, first.centre_px, first.radius_px)
        return found.centre_px.ravel().tolist(), follow_ball(scene, path)

    (found, fits), (found_alone, alone) = seen(4), seen(1)
    assert len(fits) > 50
    assert found == found_alone
    assert np.array_equal(fits.frame, alone.frame)
    assert np.array_equal(fits.centre, alone.centre)
    assert np.array_equal(fits.fits.covariance, alone.fits.covariance)
