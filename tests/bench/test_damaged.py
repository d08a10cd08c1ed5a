"""Damaged campaigns end in an answer or in plain words, never in a traceback or a sure name."""

import pytest

from bench.concealed.damaged import DAMAGES, SOUND, Outcome, damaged_section, explained

REFUSED = {
    "samples shuffled within each trial": "do not follow one another",
    "noise alone": "do not follow one another",
    "a constant record": "nothing moves",
    "times a million million": "none of a motion",
    "times beyond all bounds": "none of a motion",
    "positions beyond all bounds": "beyond all bounds",
    "ten samples": "10 samples",
    "every time twice": "repeat a time",
    "all trials under one name": "1",
    "a column of words": "holds no numbers",
    "two columns of one name": "two columns called x_m",
    "decimal commas between commas": "decimal commas",
    "no bytes": "is empty",
    "bytes of a picture": "no text",
    "a header alone": "no rows",
}


@pytest.mark.parametrize("damage", REFUSED)
def test_what_is_no_recording_is_refused_in_plain_words(tmp_path, damage):
    files = SOUND["thrown"](tmp_path)
    outcome = explained(DAMAGES[damage](files), tmp_path)
    assert outcome.fails == ""
    assert outcome.code in (2, 4)
    assert REFUSED[damage] in outcome.said


def test_a_damage_that_a_campaign_can_not_have_is_seen(tmp_path):
    files = SOUND["thrown"](tmp_path)
    assert DAMAGES["angles in degrees"](files).like(files)
    assert not DAMAGES["tabs"](files).like(files)
    assert not DAMAGES["noise alone"](files).like(files)


def test_a_sure_name_and_a_traceback_are_counted():
    good = Outcome(2, "refused", {}, "", 0.1)
    sure = Outcome(0, "explained", {"drag": 0.9}, "", 0.1)
    wild = Outcome(1, "refused", {}, "", 0.1, "ValueError()")
    text = "\n".join(damaged_section({"thrown": {"a": good, "b": sure, "c": wild}}))
    assert "3 damaged campaigns" in text
    assert "1 ended in a traceback, 1 in a name" in text


@pytest.mark.slow
@pytest.mark.parametrize("sound", SOUND)
def test_no_damage_makes_anyone_sure(tmp_path, sound):
    files = SOUND[sound](tmp_path)
    for damage, change in DAMAGES.items():
        outcome = explained(change(files), tmp_path)
        assert outcome.fails == "", (damage, outcome)
