import json

from bench.golden.__main__ import _updated
from bench.golden.compare import Judged, moves, unlisted
from bench.golden.items import GOLDEN_PARTS, QUICK_ITEMS, items_of


def _clip(value, std, kind="strike", probability=0.99):
    return {
        "failure": None,
        "motion": {"kind": kind, "probability": probability},
        "quantities": {"ball_speed": {"value": value, "std": std}},
    }


def _verdict(verdict, groups=(), **probabilities):
    effects = {
        name: {"probability": p, "parameters": {"size": {"value": 2.0, "std": 0.1}}}
        for name, p in probabilities.items()
    }
    return {"failure": None, "verdict": verdict, "effects": effects, "groups": list(groups)}


def _moves(old, new, **truth):
    return [(m.what, m.judged) for m in moves({"a": old}, {"a": new}, {"a": truth})]


def _speed(old, new, true=5.0):
    return _moves(_clip(*old), _clip(*new), quantities={"ball_speed": true}, kinds=["strike"])


def test_a_change_below_a_fifth_of_the_std_is_none():
    assert _speed((5.1, 0.1), (5.119, 0.1)) == []
    assert _speed((5.1, 0.1), (5.121, 0.1)) == [("ball_speed", Judged.FARTHER)]
    assert _speed((5.1, 0.1), (5.07, 0.1)) == [("ball_speed", Judged.NEARER)]
    # without a stated std every change counts
    assert _speed((5.1, None), (5.1 + 1e-12, None)) == [("ball_speed", Judged.FARTHER)]


def test_a_changed_std_is_judged_by_the_density_of_the_truth():
    assert _speed((5.2, 0.1), (5.2, 0.119)) == []
    assert _speed((5.2, 0.1), (5.2, 0.2)) == [("ball_speed", Judged.NEARER)]
    assert _speed((5.01, 0.1), (5.01, 0.2)) == [("ball_speed", Judged.FARTHER)]


def test_a_value_far_from_the_truth_is_better_withheld():
    assert _speed((5.1, 0.1), (None, None)) == [("ball_speed", Judged.FARTHER)]
    assert _speed((5.9, 0.1), (None, None)) == [("ball_speed", Judged.NEARER)]
    assert _speed((None, None), (5.1, 0.1)) == [("ball_speed", Judged.NEARER)]
    assert _speed((None, None), (5.9, 0.1)) == [("ball_speed", Judged.FARTHER)]


def test_motion_kind_and_probability():
    seen = _clip(5.0, 0.1)
    assert _moves(seen, _clip(5.0, 0.1, "flight"), kinds=["strike"]) == [("motion", Judged.FARTHER)]
    assert _moves(seen, _clip(5.0, 0.1, "flight")) == [("motion", Judged.UNKNOWN)]
    assert _moves(seen, _clip(5.0, 0.1, probability=0.9), kinds=["drop"]) == [
        ("motion probability", Judged.NEARER)
    ]


def test_names_and_verdicts():
    old, new = _verdict("explained", drag=0.9), _verdict("unexplained", drag=0.8, wind=0.4)
    assert _moves(old, new, names=["drag"], verdicts=["explained", "ambiguous"]) == [
        ("verdict", Judged.FARTHER),
        ("drag probability", Judged.FARTHER),
        ("wind", Judged.FARTHER),
    ]
    assert _moves(new, old, names=["drag"], verdicts=["explained"])[2] == ("wind", Judged.NEARER)
    grouped = _verdict("explained", [["drag", "wind"]], drag=0.9)
    assert _moves(old, grouped, names=["drag"]) == [("groups", Judged.UNKNOWN)]


def test_what_is_not_nearer_must_be_allowed_by_name():
    found = moves({"a/b": _clip(5.1, 0.1)}, {"a/b": _clip(5.3, 0.1)}, {})
    assert [move.judged for move in found] == [Judged.UNKNOWN]
    assert unlisted(found, ["a/c"]) == found
    assert unlisted(found, ["a/b"]) == unlisted(found, ["a/b: ball_speed"]) == []


def test_a_new_failure_and_another_input_are_listed():
    failed = {"input": "y", "failure": {"class": "NotFoundError", "exit": 4}}
    found = _moves({"input": "x"} | _clip(5.0, 0.1), failed, quantities={"ball_speed": 5.0})
    assert found == [
        ("input", Judged.UNKNOWN),
        ("failure", Judged.UNKNOWN),
        ("ball_speed", Judged.FARTHER),
    ]


def test_an_update_keeps_every_digit_and_the_items_that_were_not_run():
    kept, run = "shipped/jokku_120", "shipped/basketball_60"
    old, new = _clip(0.1 + 0.2, 1 / 3), _clip(2 / 3, 0.1) | {"truth": {"kinds": ["strike"]}}
    written = json.loads(_updated({kept: old}, {run: new}))
    assert written == {kept: old, run: {k: v for k, v in new.items() if k != "truth"}}
    assert list(written) == [run, kept]


def test_the_set_has_the_stated_sizes_and_its_quick_part_exists():
    sizes = {part: len(names) for part, names in GOLDEN_PARTS.items()}
    assert sizes == {
        "shipped": 3, "rendered": 6, "scenes": 12, "rooms": 20,
        "altered": 20, "clips": 12, "concealed": 20, "realdata": 6,
    }  # fmt: skip
    assert {item.key for item in items_of(quick=True)} == QUICK_ITEMS
