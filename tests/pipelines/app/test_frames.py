"""Frames for the viewer: each is the clip's own, and what can't be read is a sentence."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from threading import Event

import cv2
import numpy as np
import pytest

from pipelines.app import frames
from pipelines.app.frames import FrameStore
from tests.pipelines.app.small import CLIP, falling
from vision.clip.clip import ClipReader


def _levels(content: bytes | None) -> np.ndarray:
    assert content is not None
    return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE), float)


def test_any_frame_is_the_one_asked_for(tmp_path: Path) -> None:
    clip = falling(tmp_path / "clip")
    store = FrameStore(clip)
    for index in (35, 0, 17):
        own = cv2.imread(str(clip / f"{index:03d}.png"), cv2.IMREAD_GRAYSCALE).astype(float)
        shown = _levels(store.jpeg(index, 20.0))
        assert np.abs(shown - own).mean() < 2.0
    assert store.wait_until_open(1.0)
    assert store.info is not None
    assert (store.info.frames, store.ready, store.problem) == (36, 36, "")
    assert store.jpeg(36, 5.0) is None
    assert store.jpeg(-1) is None
    store.close()
    assert store.jpeg(0) is None


def test_a_frame_far_ahead_is_sought_and_is_the_one_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clip = CLIP.with_name("basketball_60.mp4")
    own = dict(ClipReader.open(clip).colour_frames())
    go_on, plain = Event(), FrameStore._shown

    def slow(store: FrameStore, reader: ClipReader) -> Iterator[bytes]:
        yield from islice(plain(store, reader), 1)
        go_on.wait(60.0)

    monkeypatch.setattr(FrameStore, "_shown", slow)
    store = FrameStore(clip)
    assert store.wait_until_open(20.0)
    for index in (200, 201, 290, 77):
        content = np.frombuffer(store.jpeg(index) or b"", np.uint8)
        shown = np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR), float)
        near = {other: np.abs(shown - own[other]).mean() for other in (index - 1, index)}
        assert near[index] < min(2.0, near[index - 1])
    assert store.jpeg(292) is None
    assert store.ready <= 1
    go_on.set()
    store.close()


def test_a_large_picture_is_reduced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "MAX_SHOWN_WIDTH", 100)
    store = FrameStore(falling(tmp_path / "clip", frames=2))
    assert _levels(store.jpeg(1, 20.0)).shape == (167, 100)
    store.close()


def test_one_frame_is_shown(tmp_path: Path) -> None:
    store = FrameStore(falling(tmp_path / "clip", frames=1))
    assert store.jpeg(0, 20.0) is not None
    assert store.problem == ""
    store.close()


@pytest.mark.parametrize("content", [b"", b"not a video", None])
def test_what_is_no_clip_is_a_sentence(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "<b>clip.mp4"
    if content is not None:
        path.write_bytes(content)
    store = FrameStore(path)
    assert store.jpeg(0, 20.0) is None
    assert store.ended
    assert store.info is None
    assert "<b>clip.mp4" in store.problem
    store.close()


def test_a_full_disk_keeps_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "MAX_FRAME_BYTES", 20_000)
    store = FrameStore(falling(tmp_path / "clip"))
    assert store.jpeg(35, 20.0) is None
    assert 0 < store.ready < 36
    assert f"first {store.ready} frames" in store.problem
    assert store.jpeg(0) is not None
    store.close()
