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
from mismatch.verdict import (
    Doubt,
    EngineVerdict,
    HeldOut,
    NamedEffect,
    ParameterValue,
    Remainder,
    StrengthsOfEach,
)
from physics.effects import CATALOGUE, FlightState
from pipelines.explain.report import (
    _directions,
    _typeset,
    draw_explained,
    explain_report_html,
    paths_figure,
)
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


def test_the_page_lists_everything_that_was_tried_with_the_unnamed(heavier):
    page = explain_report_html(heavier)
    table = page[page.index("Everything that was tried") :]
    for h in heavier.naming.tried:
        assert all(name.replace("_", " ") in table for name in h.ids)
    assert "unnamed (" in table
    assert table.count("the answer") == 1
    assert "independent ones" not in page


def test_the_first_figure_is_in_the_coordinate_that_the_answer_mends(heavier):
    forward, best = heavier.prepared.forward, heavier.naming.best
    rows = forward.records.ball_time.shape[1]
    mended = [
        float((before**2 - after**2).sum())
        for k in range(2)
        for before, after in (
            (
                heavier.prepared.fit.residual[:, k * rows : (k + 1) * rows],
                best.fit.residual[:, k * rows : (k + 1) * rows],
            ),
        )
    ]
    figure = paths_figure(heavier)
    labels = {axis.get_ylabel() for axis in figure.axes[:-1]}
    assert labels == {f"{'xy'[int(np.argmax(mended))]} − model before / mm"}


def test_a_place_that_records_leave_open_has_no_number(heavier):
    place = ParameterValue("place", 0.8, 47.0, "m", determined=False)
    size = ParameterValue("size", 0.8, 0.1, "N")
    told = verdict(effects=(replace(NAMED, parameters=(place, size)),)).text()
    assert "47" not in told
    assert "place not determined, size = 0.8 ± 0.1 N" in told


def test_a_name_beside_rivals_is_never_sure(heavier):
    assert heavier.verdict.indistinguishable
    assert all(effect.probability < 0.95 for effect in heavier.verdict.effects)


def test_the_story_does_not_contradict_itself(heavier):
    assert contradictions(heavier.verdict.to_json()) == []
    assert json.dumps(heavier.verdict.to_json(), allow_nan=False)


def test_drag_is_drawn_along_the_path_where_flights_cross():
    """A rally of flights both ways had the mean of forces forward and backward: a zigzag."""
    rng = np.random.default_rng(3)
    speed = rng.uniform(-1.0, 1.0, (3, 40)) * np.array([[9.0], [1.0], [3.0]])
    nothing, drag = np.zeros(40), CATALOGUE["drag"][0]
    flight = FlightState(*[nothing] * 4, *speed, 0.0027, 0.04, 1.2, 1.8e-5, 9.8)
    parts = _directions(drag.force({"drag_coefficient": 0.5}, flight), flight)
    assert max(parts, key=lambda way: float(np.abs(parts[way]).sum())) == "along_velocity"
    assert np.all(parts["along_velocity"] < 0.0)


def test_no_name_is_certain_and_strengths_of_each_trial_are_on_the_page(heavier):
    sure = replace(NAMED, probability=0.9996)
    assert "probability over 99 %" in verdict(effects=(sure,)).headline
    assert "(probability over 0.99)" in verdict(effects=(sure,)).text()
    spin = ParameterValue("spin", 90.0, 4.0, "rad/s")
    each = StrengthsOfEach("trial", {"spin": 113.0}, {"r001": (spin,)})
    told = replace(heavier.verdict, effects=(replace(sure, each=each),))
    page = explain_report_html(replace(heavier, verdict=told))
    assert "differs from trial to trial (spin by 113): r001: 90 ± 4." in page


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


def test_the_headline_names_what_was_found_and_what_is_left():
    assert verdict().headline == "An effect is missing from the model: drag (probability 90 %)."
    rest = Remainder(False, "What remains after the best model still holds structure.")
    assert "still show a pattern" in verdict(remainder=rest).headline
    group = verdict("ambiguous", indistinguishable=(("drag", "wind"),))
    assert group.headline.endswith("; not excluded instead: wind.")
    assert "Not excluded in place of drag: wind." in group.text()
    nameless = verdict("ambiguous", indistinguishable=(("drag", "unnamed"),))
    assert nameless.headline.endswith("; not excluded instead: a force that is in no catalogue.")
    assert "in doubt" in verdict("ambiguous").headline
    clock = replace(NAMED, id="time_base", probability=0.97)
    assert verdict(effects=(clock,)).headline == (
        "The recording has an error that the model does not include:"
        " wrong frame rate (probability 97 %)."
    )
    both = verdict(effects=(NAMED, clock)).headline
    assert both.startswith("2 effects are missing from the model: drag (probability 90 %) and")
    weak = replace(clock, probability=0.3)
    one = verdict("ambiguous", effects=(NAMED, weak), indistinguishable=(("drag", "wind"),))
    assert one.headline == (
        "An effect is missing from the model: drag (probability 90 %); not excluded instead: wind;"
        " in doubt: wrong frame rate (probability 30 %)."
    )


def test_errors_of_held_out_trials_are_in_small_units():
    assert "error 1 mm instead of 20 mm" in PROVED.in_words
    assert "error 1 mrad instead of 20 mrad" in replace(PROVED, unit="rad").in_words


def test_noise_as_large_as_the_motion_is_said_first():
    drowned = verdict("unexplained", effects=(), doubts=(Doubt.NOISE,))
    assert drowned.headline.startswith("Nothing can be said")
    assert "is not named" in drowned.text()


def test_a_proof_without_a_gain_is_called_none():
    flat = replace(PROVED, ratio_95=(0.998, 1.002))
    assert "no proof" in flat.in_words
    assert "chi-square falls by 40" in replace(flat, gain=40.0).in_words
    assert "no proof" in replace(flat, gain=2.0).in_words


def test_the_same_verdict_gives_the_same_bytes(heavier, tmp_path, monkeypatch):
    pages, drawn = [], []
    for day in ("", "", "2026-11-27"):
        if day:
            monkeypatch.setenv("IMPACT_VISION_DATE", day)
        draw_explained(heavier, tmp_path / "a.svg")
        drawn.append((tmp_path / "a.svg").read_text())
        pages.append(explain_report_html(heavier))
    for first, second, dated in (pages, drawn):
        assert first == second
        assert "2026-11-27" not in first
        assert "2026-11-27" in dated
