"""A clip as another camera or file might have held it gives the same numbers (metamorphic)."""

from pathlib import Path

import pytest

from bench.altered import WAYS, Tally, Way, altered
from bench.measure_truth import Case, cases
from pipelines.measure.chain import measure_clip
from pipelines.measure.measurement import ClipMeasurement

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def small() -> Case:
    return next(case for case in cases() if "jokku_90_small" in case.name)


@pytest.fixture(scope="module")
def usual(small: Case) -> ClipMeasurement:
    return measure_clip(small.path, small.options)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_nothing_is_far_from_what_the_clip_itself_gives(
    way: Way, small: Case, usual: ClipMeasurement, tmp_path: Path
) -> None:
    other = altered(small, way, tmp_path)
    tally = Tally()
    tally.add(other, way, usual, measure_clip(other.path, other.options))
    assert tally.far == []
    # the ball's speed and its impulse are one number
    assert tally.near >= tally.count - max(2, tally.count // 10)
    assert [note for note in tally.lost if note.endswith(": None")] == []
