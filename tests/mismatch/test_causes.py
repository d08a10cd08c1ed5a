"""Every cause for which the first build was sure and wrong has tests that fail where it returns."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

CAUSES = {
    "long swings seeded out of phase": (
        "tests/mismatch/fitting/test_shooting.py",
        "test_dry_and_quadratic_losses_are_found_over_many_periods",
        "test_a_swing_tells_its_frequency_before_anything_is_fitted",
        "test_a_law_out_of_step_with_the_record_is_no_answer",
    ),
    "noise learnt from stretches longer than the motion": (
        "tests/mismatch/fitting/test_shooting.py",
        "test_noise_is_told_from_a_swing_that_is_sampled_sparsely",
    ),
    "instruments without a zero, a period or a tilt of their own": (
        "tests/mismatch/fitting/test_shooting.py",
        "test_a_zero_that_is_off_is_the_protractors_and_no_force",
    ),
    "one strength for all balls and trials": (
        "tests/mismatch/fitting/test_levels.py",
    ),
    "probabilities blind to misfit, verdicts blind to their own proof": (
        "tests/mismatch/test_gate.py",
        "test_a_ball_that_rolls_is_no_flight_and_no_fault_of_a_lens",
        "test_throws_read_off_a_grid_by_hand_get_no_confident_name",
    ),
    "forms of laws taken literally": (
        "tests/mismatch/fitting/test_form_evidence.py",
        "test_another_form_of_a_law_keeps_its_name_and_buys_no_second_one",
        "test_what_another_form_leaves_over_is_taken_up_by_the_error_of_the_form",
    ),
    "forms that differ by more than an error of form": (
        "tests/mismatch/search/test_contact_arm.py",
        "test_a_shorter_arm_is_told_from_a_tilted_camera",
    ),
    "forces that no law and no window in time has": (
        "tests/mismatch/search/test_field.py",
        "test_a_force_that_comes_and_goes_is_unnamed_and_no_fault_of_the_instrument",
    ),
    "a missing force that is always a constant": (
        "tests/mismatch/search/test_latent.py",
        "test_the_missing_force_follows_a_force_that_changes_its_sign",
        "test_laws_of_one_class_and_id_stay_apart_in_one_scan",
    ),
    "users' effects changed by the names of their parameters": (
        "tests/mismatch/test_own_effects.py",
        "test_a_parameter_keeps_the_bounds_that_its_user_gave_whatever_its_name",
        "test_more_shapes_than_can_be_tried_are_told_not_dropped",
    ),
    "reports that contradict themselves": (
        "tests/pipelines/explain/test_report.py",
        "test_the_story_does_not_contradict_itself",
        "test_what_contradicts_itself_is_seen",
        "test_the_headline_goes_with_what_is_left_and_what_is_not_excluded",
    ),
}  # fmt: skip


@pytest.mark.parametrize("cause", CAUSES)
def test_a_cause_is_watched(cause):
    file, *names = CAUSES[cause]
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert set(names) <= tests
    assert any(name.startswith("test_") for name in tests)
