"""Damaged campaigns give an answer or a message, no traceback and no confident name."""

import pytest

from bench.concealed.damaged import DAMAGES, SOUND, Outcome, explained

REFUSED = {
    "samples shuffled within each trial": "do not follow one another",
    "noise alone": "do not follow one another",
    "a constant record": "nothing moves",
    "times multiplied by 1e12": "none of a motion",
    "times near the largest number": "none of a motion",
    "positions near the largest number": "beyond all bounds",
    "ten samples": "10 samples",
    "every time twice": "repeat a time",
    "all trials under one name": "1",
    "a column of text": "no numbers",
    "two columns of one name": "two columns called x_m",
    "decimal commas between commas": "decimal commas",
    "no bytes": "is empty",
    "bytes of a picture": "not text",
    "a header alone": "no rows",
}


@pytest.mark.parametrize("damage", REFUSED)
def test_data_that_are_no_recording_are_rejected_with_a_message(tmp_path, damage):
    files = SOUND["thrown"](tmp_path)
    outcome = explained(DAMAGES[damage](files), tmp_path)
    assert outcome.fails == ""
    assert outcome.code in (2, 4)
    assert REFUSED[damage] in outcome.said


def test_a_damage_without_effect_is_detected(tmp_path):
    files = SOUND["thrown"](tmp_path)
    assert DAMAGES["angles in degrees"](files).like(files)
    assert not DAMAGES["tabs"](files).like(files)
    assert not DAMAGES["noise alone"](files).like(files)


def test_confident_names_and_tracebacks_are_failures():
    assert Outcome(2, "refused", {}, "").fails == ""
    assert Outcome(0, "explained", {"drag": 0.9}, "").fails == "confident name"
    assert Outcome(1, "refused", {}, "", "ValueError()").fails == "traceback"


@pytest.mark.slow
@pytest.mark.parametrize("sound", SOUND)
def test_no_damage_gives_a_confident_name(tmp_path, sound):
    files = SOUND[sound](tmp_path)
    for damage, change in DAMAGES.items():
        outcome = explained(change(files), tmp_path)
        assert outcome.fails == "", (damage, outcome)
