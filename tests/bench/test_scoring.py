"""Scores of answers, their statistics and the proof page."""

from pathlib import Path

import pytest

from bench.concealed.answer import Answer, Named, answer_from_json
from bench.concealed.campaign import Hidden, Key, TrialTruth, read_key, write_key
from bench.concealed.report import Asked, Scored, proof_text
from bench.concealed.score import judge
from bench.concealed.statistics import Proportion, brier_score, calibration_error, wilson
from bench.concealed.world.conventions import true_parameter

TRIALS = (TrialTruth(0.25, 0.26, 0.66, 0.36, 0.42), TrialTruth(0.75, 0.76, 1.16, 0.86, 0.92))


def hidden(identity, name=None, phase="flight", channels=(), local=False, amplitude=1.0):
    return Hidden(
        name or identity, identity, phase, "knob", amplitude, {}, channels, local, 500.0, ("wind",)
    )


def key(*effects, kind="single", twins=()):
    return Key(1, 1, kind, "strong", 500.0, None, twins, effects, TRIALS)


def answered(*ids, groups=(), **more):
    return Answer(
        "explained",
        tuple(Named(i, 0.9, {}) for i in ids),
        tuple(frozenset(g) for g in groups),
        **more,
    )


def test_the_right_name_alone_is_right():
    assert judge(key(hidden("drag")), answered("drag")).right
    assert not judge(key(hidden("drag")), answered("wind")).right


def test_a_declared_group_with_the_truth_in_it_is_right():
    assert judge(key(hidden("drag")), answered("wind", groups=[("wind", "drag")])).right
    assert not judge(key(hidden("magnus")), answered("wind", groups=[("wind", "drag")])).right


def test_a_second_name_spoils_a_right_one():
    judgement = judge(key(hidden("drag")), answered("drag", "magnus"))
    assert judgement.covered
    assert not judgement.right


def test_a_rotation_about_another_centre_is_a_rotation_and_a_shift():
    assert judge(key(hidden("camera_roll")), answered("camera_roll", "origin_offset")).right
    assert not judge(key(hidden("drag")), answered("drag", "origin_offset")).right


def test_pairs_need_both():
    pair = key(hidden("drag"), hidden("bearing_friction", phase="swing"), kind="pair")
    assert judge(pair, answered("bearing_friction", "drag")).right
    assert not judge(pair, answered("drag")).covered


def test_on_a_null_any_name_counts():
    null = key(kind="null")
    assert not judge(null, Answer("no_mismatch")).named
    assert judge(null, answered("drag")).physics_named
    clock = judge(null, answered("time_base"))
    assert clock.named
    assert not clock.physics_named


def test_no_mismatch_with_groups_names_nothing():
    answer = Answer("no_mismatch", (), (frozenset({"drag", "wind"}),))
    assert not judge(key(kind="null"), answer).named


def test_unnamed_needs_direction_and_place():
    gust = hidden("unnamed", "gust", channels=("along_velocity", "horizontal"), local=True)
    good = answered("unnamed", phase="flight", channel="horizontal", t_start=0.115, t_end=0.17)
    judgement = judge(key(gust, kind="outside"), good)
    assert judgement.unnamed_said
    assert judgement.direction_right
    assert judgement.place_right
    assert judgement.start_error == pytest.approx(0.005 / 0.4)
    late = answered("unnamed", phase="flight", channel="vertical", t_start=0.4, t_end=0.45)
    judgement = judge(key(gust, kind="outside"), late)
    assert not judgement.direction_right
    assert not judgement.place_right


def test_twins_need_one_group_and_a_measurement():
    twins = key(hidden("time_base"), kind="twins", twins=("time_base", "length_scale"))
    groups = [("time_base", "length_scale")]
    assert judge(twins, answered("time_base", groups=groups, next_measurement="a ruler")).grouped
    assert not judge(twins, answered("time_base", groups=groups)).grouped
    assert not judge(twins, answered("time_base", next_measurement="a ruler")).grouped


def test_json_of_a_verdict_is_read():
    answer = answer_from_json(
        {
            "verdict": "explained",
            "location": {"phase": "flight", "t_start_s": 0.012, "channel": "horizontal"},
            "effects": [
                {
                    "id": "magnus",
                    "probability": 0.97,
                    "parameters": {"spin": {"value": 0.21, "std": 0.01, "unit": "rad/s"}},
                }
            ],
            "indistinguishable": [["time_base", "length_scale"]],
        },
        1.5,
    )
    assert answer.ids == {"magnus"}
    assert answer.named[0].parameters == {"spin": (0.21, 0.01)}
    assert answer.groups == (frozenset({"time_base", "length_scale"}),)


def test_drag_is_a_coefficient_and_not_a_change():
    setup = {"model": {"drag": {"drag_coefficient": 0.45}}}
    name, value = true_parameter(hidden("drag", amplitude=0.05), setup)
    assert (name, value) == ("drag_coefficient", pytest.approx(0.5))


def test_keys_survive_a_file(tmp_path):
    original = key(hidden("drag", channels=("horizontal",)), twins=("a", "b"))
    write_key(tmp_path / "key.json", original)
    assert read_key(tmp_path / "key.json") == original


def test_wilson_interval_agrees_with_a_published_value():
    # Newcombe, Stat. Med. 17, 857 (1998), table I: 81 of 263.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert str(Proportion(0, 0)) == "–"


def test_calibration_error_is_weighted_by_count():
    error, rows = calibration_error([0.95, 0.95, 0.95, 0.95, 0.55], [True] * 4 + [False])
    assert error == pytest.approx((0.05 * 4 + 0.55) / 5)
    assert len(rows) == 2


def test_the_page_counts_and_lists_misses_by_name(tmp_path):
    own = [
        Scored(judge(key(kind="null"), answered("drag")), tmp_path),
        Scored(judge(key(kind="null"), Answer("no_mismatch")), tmp_path),
        Scored(judge(key(hidden("magnus")), answered("magnus")), tmp_path),
    ]
    (tmp_path / "setup.toml").write_text("[camera]\ncapture_fps = 600\n")
    page = proof_text(own, Asked(400, 1))
    assert "3 campaigns were scored" in page
    assert "Incomplete" in page
    assert "| nulls with named physics | ≤ 2 % | ≤ 0.5 % | 50.0 % (1/2;" in page
    assert "| single strong effect | 97 % | 99.5 % | 100.0 % (1/1;" in page
    assert "| 1 | null | strong | 500 | nothing | drag" in page


def test_a_force_bound_to_a_position_may_start_at_the_time_of_any_trial():
    magnet = hidden("unnamed", "magnet", local=True)
    spread = (TrialTruth(0.0, 0.01, 0.41, 0.10, 0.20), TrialTruth(0.0, 0.01, 0.41, 0.14, 0.24))
    mine = Key(1, 1, "outside", "strong", 500.0, None, (), (magnet,), spread)
    at = answered("unnamed", phase="flight", channel="horizontal", t_start=0.12, t_end=0.22)
    assert judge(mine, at).start_error == 0.0
    early = answered("unnamed", phase="flight", channel="horizontal", t_start=0.08, t_end=0.22)
    assert judge(mine, early).start_error == pytest.approx(0.02 / 0.4)
    silent = answered("unnamed", phase="flight", channel="horizontal")
    assert judge(mine, silent).start_error == float("inf")


def test_a_failure_is_kept_and_read_again():
    answer = answer_from_json({"verdict": "failed", "failure": "exit 4: too little"}, 2.0)
    assert answer.failure == "exit 4: too little"
    assert not judge(key(hidden("drag")), answer).right


def test_the_brier_score_of_certainty_and_of_a_coin_toss():
    assert brier_score([1.0, 0.0], [True, False]) == 0.0
    assert brier_score([0.5, 0.5], [True, False]) == pytest.approx(0.25)


def test_a_confident_wrong_name_is_on_the_page():
    wrong = judge(key(hidden("drag")), answered("wind"))
    grouped = judge(key(hidden("drag")), answered("wind", groups=[("wind", "drag")]))
    scored = [Scored(one, Path("one")) for one in (wrong, grouped)]
    page = proof_text(scored, Asked(1, 1, world="second"))
    (row,) = [line for line in page.splitlines() if "that is wrong" in line and "1/2" in line]
    assert row.startswith("| a name with stated probability")
