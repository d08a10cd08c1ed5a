import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest

from tests.vision.ball.painted import PaintedClip
from vision.clip import footage
from vision.clip.footage import Footage
from vision.clip.picture import Frame
from vision.scene import FilmedScene


class LongClip:
    """Frames made on demand, as many as wanted; counts how many were decoded."""

    def __init__(self, count: int, height: int, width: int) -> None:
        self._count, self._shape = count, (height, width)
        rng = np.random.default_rng(0)
        self._wall = rng.integers(90, 110, self._shape).astype(np.uint8)
        self.decoded = 0

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        for index in range(self._count if stop is None else min(stop, self._count)):
            self.decoded += 1
            if index >= start:
                picture = self._wall.copy()
                picture[20:30, index % 100 : index % 100 + 10] = 200
                yield Frame(index, index / 30.0, picture)


def test_frames_of_a_long_clip_are_the_same_as_those_of_a_short_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clip = LongClip(60, 40, 120)
    held = Footage(clip)  # type: ignore[arg-type]
    monkeypatch.setattr(footage, "_MAX_HELD_BYTES", 10_000)
    monkeypatch.setattr(footage, "_MAX_ACTION_BYTES", 10_000)
    monkeypatch.setattr(footage, "_DECODE_BLOCK_BYTES", 50_000)
    in_a_file = Footage(clip)  # type: ignore[arg-type]
    monkeypatch.setattr(footage, "_MAX_SPILLED_BYTES", 10_000)
    decoded = Footage(clip)  # type: ignore[arg-type]
    for wanted in ([3], [58, 59], list(range(0, 60, 7))):
        indices = np.array(wanted)
        for kept in (in_a_file, decoded):
            for (one, here), (other, there) in zip(
                held.frames(indices), kept.frames(indices), strict=True
            ):
                assert one == other
                assert np.array_equal(here, there)


def test_stepping_back_through_a_long_clip_does_not_decode_it_for_each_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(footage, "_MAX_HELD_BYTES", 10_000)
    monkeypatch.setattr(footage, "_MAX_ACTION_BYTES", 10_000)
    monkeypatch.setattr(footage, "_MAX_SPILLED_BYTES", 10_000)
    monkeypatch.setattr(footage, "_DECODE_BLOCK_BYTES", 40 * 40 * 120)
    clip = LongClip(200, 40, 120)
    decoded = Footage(clip)  # type: ignore[arg-type]
    clip.decoded = 0
    for index in range(180, 100, -1):
        next(decoded.frames(np.array([index])))
    assert clip.decoded < 8 * 200


@pytest.mark.parametrize("in_memory", [10_000_000, 10_000])
def test_an_action_that_memory_or_a_file_holds_is_decoded_twice_and_no_more(
    monkeypatch: pytest.MonkeyPatch, in_memory: int
) -> None:
    monkeypatch.setattr(footage, "_MAX_HELD_BYTES", 10_000)
    monkeypatch.setattr(footage, "_MAX_ACTION_BYTES", in_memory)
    monkeypatch.setattr(footage, "_DECODE_BLOCK_BYTES", 40 * 40 * 120)
    clip = LongClip(200, 40, 120)
    held = Footage(clip)  # type: ignore[arg-type]
    for index in (180, 3, 120, 60):
        assert next(held.frames(np.array([index])))[0] == index
    assert clip.decoded <= 2 * 200


def test_where_no_file_can_be_written_a_long_action_is_decoded_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(footage, "_MAX_HELD_BYTES", 10_000)
    monkeypatch.setattr(footage, "_MAX_ACTION_BYTES", 10_000)
    monkeypatch.setattr(footage.tempfile, "TemporaryFile", full)
    clip = LongClip(60, 40, 120)
    index, picture = next(Footage(clip).frames(np.array([30])))  # type: ignore[arg-type]
    assert index == 30
    assert (picture[25, 30:40] == 200).all()


@pytest.mark.slow
def test_memory_does_not_grow_with_the_length_of_a_full_hd_clip() -> None:
    clip = LongClip(18_000, 1080, 1920)
    tracemalloc.start()
    scene = FilmedScene(Footage(clip))  # type: ignore[arg-type]
    scene.picture(9_000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 400_000_000


def _scene_of(seed: int, count: int, shift: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    wall = np.kron(rng.integers(60, 200, (12, 20)), np.ones((10, 10))).astype(np.uint8)
    pictures = []
    for index in range(count):
        picture = np.roll(wall, shift, axis=1)
        picture[40:52, 10 + 2 * index : 22 + 2 * index] = 20
        pictures.append(picture)
    return pictures


class _Made:
    def __init__(self, pictures: list[np.ndarray]) -> None:
        self._pictures = pictures

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        for index in range(start, len(self._pictures) if stop is None else stop):
            yield Frame(index, index / 30.0, self._pictures[index])


def test_a_cut_is_told_from_a_bumped_camera_and_from_a_black_frame() -> None:
    one, other = _scene_of(1, 30), _scene_of(2, 40)
    black = [np.zeros_like(one[0])]
    for pictures, parts in (
        ([*one, *other], ((0, 30), (30, 70))),
        ([*one, *_scene_of(1, 30, shift=26)], ((0, 60),)),
        ([*one, *black, *one], ((0, 61),)),
    ):
        assert Footage(_Made(pictures)).parts == parts  # type: ignore[arg-type]


def test_one_part_of_a_clip_is_looked_at_by_itself() -> None:
    clip = _Made([*_scene_of(1, 30), *_scene_of(2, 40)])
    part = Footage(clip, part=(30, 70))  # type: ignore[arg-type]
    assert (part.first, part.count, part.parts) == (30, 40, ((30, 70),))


class _Timed(_Made):
    """Pictures with their times, s."""

    def __init__(self, pictures: list[np.ndarray], times: np.ndarray) -> None:
        super().__init__(pictures)
        self._times = times

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        for frame in super().frames(start, stop):
            yield Frame(frame.index, float(self._times[frame.index]), frame.gray)


def test_frames_are_counted_on_the_camera_s_clock_and_missing_ones_show_the_scene() -> None:
    kept = np.array([0, 1, 2, 3, 5, 6, 7, 12, 13, 14, 15, 16])
    pictures = [_moving(int(beat)) for beat in kept]
    footage = Footage(_Timed(pictures, kept / 240.0))  # type: ignore[arg-type]
    assert footage.shown.tolist() == kept.tolist()
    assert footage.count == 17
    for index, picture in footage.frames(np.arange(17)):
        assert np.array_equal(picture, _moving(index))
    assert [footage.in_clip(index) for index in (3, 4, 5, 11, 12)] == [3, 3, 4, 6, 7]
    assert [footage.of_clip(row) for row in (4, 6, 7, 11)] == [5, 7, 12, 16]
    scene = FilmedScene(footage)
    for index, picture in scene.pictures(np.array([9, 12])):
        difference = np.abs(scene.difference(index, picture)).max()
        assert (difference < 20.0) == (index == 9)


def test_a_rate_that_varies_counts_frames_by_their_order() -> None:
    times = np.cumsum(np.tile([1.0, 1.4, 0.7, 1.3], 5)) / 30.0
    footage = Footage(_Timed([_moving(k) for k in range(20)], times))  # type: ignore[arg-type]
    assert footage.shown.tolist() == list(range(20))


def _moving(beat: int) -> np.ndarray:
    picture = np.random.default_rng(5).integers(90, 110, (60, 120)).astype(np.uint8)
    picture[20:32, 5 + 6 * beat : 17 + 6 * beat] = 220
    return picture


def _with_motion(count: int, moving: range) -> PaintedClip:
    """A still wall on which a codec settles over the first frames, and something moves later."""
    rng = np.random.default_rng(0)
    still = rng.integers(90, 110, (40, 120)).astype(np.uint8)
    pictures = [still] * count
    pictures[0] = np.clip(still.astype(int) + 8 * (np.arange(120) > 100), 0, 255).astype(np.uint8)
    for index in moving:
        pictures[index] = still.copy()
        pictures[index][20:30, 4 * (index - moving[0]) : 4 * (index - moving[0]) + 10] = 200
    return PaintedClip(pictures)


def test_a_change_as_the_clip_begins_is_no_action_where_one_comes_long_after() -> None:
    found = Footage(_with_motion(420, range(350, 372)))  # type: ignore[arg-type]
    assert 350 - 60 <= found.first < 350
    first = found.frames(np.array([350 - found.first]))
    assert next(first)[1][25, 5] == 200
    assert len(found.clock) == found.count


def test_a_change_as_the_clip_begins_is_the_action_where_nothing_else_moves() -> None:
    found = Footage(_with_motion(420, range(350, 350)))  # type: ignore[arg-type]
    assert found.first == 0
    assert found.count <= 70


def test_what_stirs_now_and_then_for_all_of_a_clip_is_slow_and_no_flash() -> None:
    rng = np.random.default_rng(0)
    still = rng.integers(90, 110, (40, 120)).astype(np.uint8)
    pictures = []
    for index in range(2400):
        picture = still.copy()
        picture[20:30, 10 + index // 150 : 20 + index // 150] = 200
        pictures.append(picture)
    found = Footage(PaintedClip(pictures))  # type: ignore[arg-type]
    assert found.count > 1500


def test_of_two_actions_the_one_in_which_more_moves_is_looked_at() -> None:
    clip = _with_motion(420, range(350, 352))
    rng = np.random.default_rng(0)
    still = rng.integers(90, 110, (40, 120)).astype(np.uint8)
    for index in range(30, 33):
        clip.pictures[index] = still.copy()
        clip.pictures[index][20:30, 10 * (index - 29) : 10 * (index - 28)] = 200
    found = Footage(clip)  # type: ignore[arg-type]
    assert found.first <= 30 < found.first + found.count
