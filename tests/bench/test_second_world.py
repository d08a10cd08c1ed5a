"""Conservation laws and repeatability of the second generator."""

import numpy as np
import pytest

from bench.concealed.answer import Answer, Named
from bench.concealed.report import Asked, Scored, proof_text
from bench.concealed.score import judge
from bench.concealed.second.careful import draw_careful
from bench.concealed.second.draw import draw_campaign, draw_plan
from bench.concealed.second.laws import NAMED, UNNAMED
from bench.concealed.second.motion import move
from physics.effects import CATALOGUE


@pytest.fixture(scope="module")
def plan():
    return draw_plan(np.random.default_rng(4))


@pytest.fixture(scope="module")
def bare(plan):
    return move(plan.cells)


def test_the_swing_conserves_energy_until_contact(plan, bare):
    cells = plan.cells
    stiffness = 2.0 * cells.weight_arm * cells.gravity / cells.inertia
    drop = np.cos(cells.contact_angle) - np.cos(cells.backswing)
    speed = np.sqrt(stiffness * drop) * cells.length
    assert bare.release.impact_speed == pytest.approx(speed, rel=1e-6)


def test_the_contact_conserves_momentum_and_obeys_the_law(plan, bare):
    cells, out = plan.cells, bare.release
    law = cells.cor[0] * np.exp(-0.27 * out.impact_speed) + cells.cor[1]
    assert out.cor == pytest.approx(law, abs=0.012)
    heavy = cells.inertia / cells.length**2
    after = heavy * out.omega * cells.length + cells.mass * np.hypot(out.vx, out.vy)
    # Gravity changes the momentum during contact.
    assert after == pytest.approx(heavy * out.impact_speed, rel=0.06)


@pytest.mark.parametrize("law", [*NAMED, *UNNAMED], ids=lambda law: law.name)
def test_a_law_of_zero_amplitude_changes_nothing(plan, bare, law):
    moved = move(plan.cells, ((law, 0.0),))
    times = np.linspace(-0.1, 0.3, 40)
    assert moved.ball_at(times, 0) == pytest.approx(bare.ball_at(times, 0), abs=1e-6)
    assert moved.angle_at(times, 0) == pytest.approx(bare.angle_at(times, 0), abs=1e-6)
    assert law.id in CATALOGUE or law.id == "unnamed"


def test_the_same_seed_draws_the_same_campaign(tmp_path):
    first = draw_campaign(5, 4, tmp_path / "a", tmp_path / "keys_a")
    again = draw_campaign(5, 4, tmp_path / "b", tmp_path / "keys_b")
    assert first == again
    assert (tmp_path / "a/ball.csv").read_bytes() == (tmp_path / "b/ball.csv").read_bytes()
    assert first.effects[0].delta_chi2 == pytest.approx(first.delta_chi2)


def test_a_careful_laboratory_states_what_its_inputs_may_be_off_by(tmp_path):
    keys = [draw_careful(3, n, tmp_path / str(n), tmp_path / "keys") for n in range(3)]
    stated = [(tmp_path / str(n) / "setup.toml").read_text() for n in range(3)]
    assert any("kg m^2 ± 0.2 %" in text for text in stated)
    assert {key.kind for key in keys} == {"careful"}
    assert draw_careful(3, 0, tmp_path / "again", tmp_path / "keys") == keys[0]


def test_a_careful_laboratory_may_be_told_of_its_own_ruler_only(tmp_path):
    key = draw_careful(3, 0, tmp_path / "0", tmp_path / "keys")

    def page(identity):
        answer = Answer("explained", (Named(identity, 0.9, {}),), ())
        scored = [Scored(judge(key, answer), tmp_path / "0")]
        return proof_text(scored, Asked(1, 3, world="careful"))

    assert "no error of theirs | 2 % | 0.5 % | 0.0 %" in page("length_scale")
    assert "no error of theirs | 2 % | 0.5 % | 100.0 %" in page("effective_mass")
