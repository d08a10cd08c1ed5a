"""Which clips can be opened: typed paths, dropped files, samples, recent ones."""

import os
from pathlib import Path

import pytest

from metrology import UsageError
from pipelines.app.corrections import corrections_file, options_of, read_corrections
from pipelines.app.openings import (
    MAX_RECENT,
    Recent,
    file_name,
    free_place,
    kept_once,
    place_from,
    placed_sample,
    samples,
)


def test_a_typed_path_is_found_and_a_wrong_one_is_a_sentence(tmp_path: Path) -> None:
    clip = tmp_path / "a clip.mp4"
    clip.write_bytes(b"1")
    assert place_from(f'  "{clip}" ') == clip
    assert place_from(str(tmp_path)) == tmp_path
    for text in ("", "  ", str(tmp_path / "no.mp4")):
        with pytest.raises(UsageError) as refused:
            place_from(text)
        assert refused.value.hint


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("a.mp4", "a.mp4"),
        ("../../etc/passwd", "passwd"),
        ("..\\..\\a.mp4", "a.mp4"),
        (".hidden.mp4", "hidden.mp4"),
        ("<b>x.mp4", "<b>x.mp4"),
    ],
)
def test_a_dropped_file_stays_in_its_folder(tmp_path: Path, name: str, plain: str) -> None:
    assert file_name(name) == plain
    assert free_place(tmp_path, name) == tmp_path / plain


@pytest.mark.parametrize("name", ["", "/", "..", "a/.."])
def test_a_file_without_a_name_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match="no name"):
        file_name(name)


def test_no_file_is_replaced(tmp_path: Path) -> None:
    for expected in ("a.mp4", "a-2.mp4", "a-3.mp4"):
        place = free_place(tmp_path, "a.mp4")
        assert place.name == expected
        place.write_bytes(b"1")


def test_three_samples_come_with_inputs_that_are_read(tmp_path: Path) -> None:
    found = samples()
    assert [one.kind for one in found] == ["strike", "drop", "swing"]
    for sample in found:
        copy = placed_sample(sample, tmp_path / "samples")
        assert copy.read_bytes() == sample.path.read_bytes()
        corrections = read_corrections(corrections_file(copy))
        options = options_of(copy, corrections, corrected=False)
        assert options.fps is not None or options.setup.camera.capture_fps is not None
        # a second time keeps what was entered
        corrections_file(copy).write_text('[inputs]\nfps = "50"\n')
        placed_sample(sample, tmp_path / "samples")
        assert read_corrections(corrections_file(copy)).inputs.fps == "50"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_can_not_be_written_is_a_sentence(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(UsageError, match="can't copy"):
        placed_sample(samples()[0], tmp_path / "samples")


def test_recent_clips_are_remembered_and_a_damaged_list_is_empty(tmp_path: Path) -> None:
    file = tmp_path / "state" / "recent.json"
    recent = Recent(file)
    assert recent.places() == ()
    clips = [tmp_path / f"{k}.mp4" for k in range(MAX_RECENT + 2)]
    for clip in clips:
        clip.write_bytes(b"1")
        recent.add(clip)
    recent.add(clips[5])
    assert Recent(file).places()[:2] == (clips[5], clips[-1])
    assert len(recent.places()) == MAX_RECENT
    clips[5].unlink()
    assert clips[5] not in recent.places()
    for damage in ("{", "3", '["a", 4]', "null"):
        file.write_text(damage)
        assert recent.places() == ()
    # where nothing can be written, nothing happens
    Recent(tmp_path / "0.mp4" / "recent.json").add(clips[0])


def test_a_clip_dropped_again_is_the_same_file(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"one")
    (tmp_path / "a-2.mp4").write_bytes(b"one")
    assert kept_once(tmp_path / "a-2.mp4", "a.mp4") == tmp_path / "a.mp4"
    assert [one.name for one in tmp_path.iterdir()] == ["a.mp4"]
    (tmp_path / "a-2.mp4").write_bytes(b"two")
    assert kept_once(tmp_path / "a-2.mp4", "a.mp4") == tmp_path / "a-2.mp4"
    assert kept_once(tmp_path / "a.mp4", "a.mp4") == tmp_path / "a.mp4"
