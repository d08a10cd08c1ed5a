"""The page and the story: every figure there, laws typeset, and no statement against another."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from bench.concealed.answer import contradictions
from mismatch import explain_in_full
from mismatch.explain import _plain
from mismatch.search.unnamed import Field, unnamed_laws
from mismatch.verdict import Doubt, EngineVerdict, HeldOut, NamedEffect, Remainder, pass_gate
from physics.effects import CATALOGUE
from pipelines.explain.report import _typeset, explain_report_html
from tests.mismatch.synthetic import thrown_campaign

LAWS = [
    *(form for forms in CATALOGUE.values() for form in forms),
    *unnamed_laws("impact"),
    Field(),
]


@pytest.fixture(scope="module")
def heavier():
    """Throws in air, whose baseline holds none: a mismatch with names and groups."""
    campaign, baseline = thrown_campaign(scale=1.03)
    return explain_in_full(replace(campaign, trials=campaign.trials[:3]), baseline)


def test_the_page_shows_pictures_first_and_a_caption_for_each(heavier):
    page = explain_report_html(heavier)
    figures = re.findall(r"<figure>.*?</figure>", page, re.S)
    assert len(figures) >= 3
    assert [f"Figure {k + 1}." in figure for k, figure in enumerate(figures)] == [True] * len(
        figures
    )
    assert page.index("<figure>") < page.index("<h2>")
    assert "can't tell" not in page or "not excluded" in page
    assert ">all<" in page


def test_the_page_says_how_many_independent_numbers_it_rests_on(heavier):
    assert "independent ones" not in explain_report_html(heavier)
    forward = heavier.prepared.forward
    records = replace(forward.records, inflation=np.full(4, 2.0))
    shared = replace(heavier.prepared, forward=replace(forward, records=records))
    page = explain_report_html(replace(heavier, prepared=shared))
    assert re.search(rf"equivalent to {records.count / 2:.0f}\s+independent ones", page)


@pytest.mark.parametrize(("gain", "doubted"), [(0.3, True), (40.0, False)])
def test_a_name_that_predicts_no_better_is_in_doubt(heavier, gain, doubted):
    flat = HeldOut(("1",), 0.02, 0.02, (0.99, 1.01), gain=gain)
    passed = pass_gate(heavier.prepared, heavier.naming.best, "explained", flat)
    assert (Doubt.NO_GAIN in passed.doubts) is doubted
    assert (Doubt.NO_GAIN in passed.against) is doubted


def test_a_name_beside_rivals_is_never_sure(heavier):
    assert heavier.verdict.indistinguishable
    assert all(effect.probability < 0.95 for effect in heavier.verdict.effects)


def test_the_story_does_not_contradict_itself(heavier):
    assert contradictions(heavier.verdict.to_json()) == []
    assert json.dumps(heavier.verdict.to_json(), allow_nan=False)


@pytest.mark.parametrize("law", LAWS, ids=lambda effect: f"{effect.id} {effect.form}".strip())
def test_every_law_is_typeset_and_has_a_plain_form(law):
    assert _typeset(law.law)
    assert "\\" not in _plain(law.law)


NAMED = NamedEffect("drag", "The air slows the ball.", 0.9, ())
NOISE = Remainder(True, "What remains after the best model cannot be distinguished from noise.")
PROVED = HeldOut(("3",), 0.02, 0.001, (14.0, 23.0))


def verdict(kind="explained", **changes):
    base = EngineVerdict(kind, ("gravity",), 40.0, None, (NAMED,), (), (), None, PROVED, NOISE)
    return replace(base, **changes)


WRONG = {
    "no mismatch, but": verdict("no_mismatch"),
    "probability below one half": verdict(effects=(replace(NAMED, probability=0.3),)),
    "an alternative is not excluded": verdict(
        indistinguishable=(("drag", "wind"),), next_measurement="x"
    ),
    "but nothing is named": verdict(effects=()),
    "unexplained, but a name is probable": verdict("unexplained"),
    "without a reason": verdict("ambiguous"),
    "predicts worse": verdict(held_out=replace(PROVED, ratio_95=(0.5, 0.9))),
    "without a measurement": verdict("ambiguous", indistinguishable=(("drag", "wind"),)),
    "not white called noise": verdict(remainder=replace(NOISE, white=False)),
}


@pytest.mark.parametrize("said", WRONG)
def test_what_contradicts_itself_is_seen(said):
    assert any(said in one for one in contradictions(WRONG[said].to_json()))
    assert contradictions(verdict().to_json()) == []


def test_a_path_that_is_as_far_off_is_no_worse_where_chi_square_falls():
    same = replace(PROVED, ratio_95=(0.9995, 0.99999), gain=12.7)
    assert contradictions(verdict(held_out=same).to_json()) == []


def test_the_headline_goes_with_what_is_left_and_what_is_not_excluded():
    assert verdict().headline.endswith("it has been found.")
    rest = Remainder(False, "What remains after the best model still holds structure.")
    assert "still has a pattern" in verdict(remainder=rest).headline
    group = verdict("ambiguous", indistinguishable=(("drag", "wind"),))
    assert "several explanations" in group.headline
    assert "Not excluded in place of drag: wind." in group.text()
    assert "in doubt" in verdict("ambiguous").headline


def test_noise_as_large_as_the_motion_is_said_first():
    drowned = verdict("unexplained", effects=(), doubts=(Doubt.NOISE,))
    assert drowned.headline.startswith("Nothing can be said")
    assert "is not named" in drowned.text()


def test_a_proof_without_a_gain_is_called_none():
    flat = replace(PROVED, ratio_95=(0.998, 1.002))
    assert "no proof" in flat.in_words
    assert "chi-square falls by 40" in replace(flat, gain=40.0).in_words
    assert "no proof" in replace(flat, gain=2.0).in_words
