"""Files in, verdict out; bad input gets a clear message."""

import json
import math

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from measuring.setup.file import read_setup
from metrology import TooLittleDataError, UsageError
from pipelines.explain.campaign import explain_files, load_campaign
from pipelines.explain.command import explain_command
from tests.mismatch.synthetic import thrown_campaign

SETUP = """
[ball]
mass = "0.5 kg"
diameter = "50 mm"
[model]
effects = ["gravity"]
"""


@pytest.fixture
def thrown(tmp_path):
    campaign, _ = thrown_campaign(scale=1.03)
    lines = ["trial,t_s,x_m,y_m"]
    for trial in campaign.trials[:4]:
        for t, (x, y, _z) in zip(trial.ball_time, trial.position, strict=True):
            lines.append(f"{trial.name},{t:.6f},{x:.5f},{y:.5f}")
    ball = tmp_path / "ball.csv"
    ball.write_text("\n".join(lines) + "\n")
    setup = tmp_path / "setup.toml"
    setup.write_text(SETUP)
    return ball, setup


def run(*arguments: str):
    app = typer.Typer()
    app.command()(explain_command)
    return CliRunner().invoke(app, list(arguments))


def test_command_writes_json_plot_report_and_model(thrown, tmp_path):
    ball, setup = thrown
    result = run(
        str(ball), "--setup", str(setup), "--json", "-",
        "--report", str(tmp_path / "r.html"), "--plot", str(tmp_path / "p.png"),
        "--model", str(tmp_path / "m.toml"),
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    verdict = json.loads(result.stdout)
    assert verdict["verdict"] == "ambiguous"
    assert {"time_base", "length_scale"} <= set(verdict["indistinguishable"][0])
    assert verdict["next_measurement"]
    for effect in verdict["effects"]:
        assert 0.0 <= effect["probability"] <= 1.0
        for parameter in effect["parameters"].values():
            assert math.isfinite(parameter["value"])
    assert "<h1>" in (tmp_path / "r.html").read_text()
    assert (tmp_path / "p.png").read_bytes()[1:4] == b"PNG"
    again = read_setup((tmp_path / "m.toml").read_text())
    assert "gravity" in again.model.effects
    stages = result.stderr.splitlines()
    rows = len(ball.read_text().splitlines()) - 1
    assert stages[0] == f"Fit the baseline: {rows} rows, trials: 4."
    assert stages[-1] == "Test what was found on data kept aside."


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("trial,time,x_m\n1,0,0\n", "t_s"),
        ("trial,t_s,u\n1,0,0\n", "position"),
        ("trial,t_s,x_m\n", "no rows"),
        ("", "is empty"),
    ],
)
def test_bad_tables_are_refused_with_the_reason(tmp_path, text, said):
    ball = tmp_path / "ball.csv"
    ball.write_text(text)
    with pytest.raises(UsageError, match=said):
        load_campaign(ball, None, read_setup(SETUP))


def test_doubled_rows_nan_and_a_clock_that_jumps_back_are_told(tmp_path):
    ball = tmp_path / "ball.csv"
    ball.write_text("trial,t_s,x_m\n1,0,0\n1,0.1,1\n1,0.1,1\n1,0.05,0.5\n1,0.2,nan\n")
    campaign = load_campaign(ball, None, read_setup(SETUP))
    assert np.all(np.diff(campaign.trials[0].ball_time) > 0.0)
    assert len(campaign.notes) == 3


def test_degrees_for_radians_are_noticed(tmp_path):
    swing = tmp_path / "pendulum.csv"
    swing.write_text("trial,t_s,phi_rad\n1,0,-30\n1,0.1,-20\n")
    with pytest.raises(UsageError, match="full turn"):
        load_campaign(None, swing, read_setup(SETUP))


def test_a_handful_of_points_is_too_little(tmp_path, thrown):
    ball = tmp_path / "few.csv"
    ball.write_text("trial,t_s,x_m,y_m\n1,0,0,1\n1,0.1,0.2,1\n1,0.2,0.4,0.9\n")
    with pytest.raises(TooLittleDataError):
        explain_files(ball, None, thrown[1])


def rows_of(ball) -> list[str]:
    return ball.read_text().splitlines()


def test_a_clock_that_is_set_back_leaves_its_trial_out(thrown):
    ball, _ = thrown
    header, *rows = rows_of(ball)
    back = [
        f"0,{float(t) - 0.1001:.6f},{rest}" if number == "0" and float(t) > 0.3 else row
        for row in rows
        for number, t, rest in [row.split(",", 2)]
    ]
    ball.write_text("\n".join([header, *back]) + "\n")
    campaign = load_campaign(ball, None, read_setup(SETUP))
    assert [trial.name for trial in campaign.trials] == ["1", "2", "3"]
    assert any("the time jumps back within trial 0" in note for note in campaign.notes)


def test_rows_out_of_order_are_sorted(thrown):
    ball, _ = thrown
    header, *rows = rows_of(ball)
    ball.write_text("\n".join([header, *reversed(rows)]) + "\n")
    campaign = load_campaign(ball, None, read_setup(SETUP))
    assert len(campaign.trials) == 4


def test_several_trials_under_one_name_are_told(thrown):
    ball, setup = thrown
    header, *rows = rows_of(ball)
    one = [
        f"1,{float(row.split(',')[1]) + 1e-4 * int(row[0])},{row.split(',', 2)[2]}" for row in rows
    ]
    ball.write_text("\n".join([header, *one]) + "\n")
    with pytest.raises(UsageError, match="the time jumps back within trial 1"):
        explain_files(ball, None, setup)


def test_a_pendulum_of_other_trials_is_told(thrown, tmp_path):
    ball, setup = thrown
    pendulum = tmp_path / "pendulum.csv"
    pendulum.write_text("trial,t_s,phi_rad\n" + "".join(f"z,{k / 600},0.1\n" for k in range(40)))
    with pytest.raises(UsageError, match="no trial in common"):
        explain_files(ball, pendulum, setup)


def test_a_ball_table_without_numbers_is_no_free_swing(thrown, tmp_path):
    ball, setup = thrown
    pendulum = tmp_path / "pendulum.csv"
    pendulum.write_text("trial,t_s,phi_rad\n" + "".join(f"0,{k / 600},0.1\n" for k in range(40)))
    ball.write_text("trial,t_s,x_m,y_m\n" + "".join(f"0,{k / 600},,\n" for k in range(40)))
    with pytest.raises(TooLittleDataError, match="no row"):
        explain_files(ball, pendulum, setup)


def test_a_trial_that_states_two_back_swings_is_left_out_and_told(tmp_path):
    ball = tmp_path / "ball.csv"
    rows = [f"{k % 2},{k / 10},{k},{30 if k != 8 else 60}" for k in range(20)]
    ball.write_text("trial,t_s,x_m,backswing_deg\n" + "\n".join(rows) + "\n")
    campaign = load_campaign(ball, None, read_setup(SETUP))
    assert [trial.name for trial in campaign.trials] == ["1"]
    assert any("trial 0 states two back-swings" in note for note in campaign.notes)


def test_sessions_are_read_as_words_and_a_trial_of_two_is_left_out(tmp_path):
    ball = tmp_path / "ball.csv"
    rows = [f"{k % 3},{k / 10},{k},{(7, 'b', '7' if k < 20 else 'b')[k % 3]}" for k in range(30)]
    ball.write_text("trial,t_s,x_m,session\n" + "\n".join(rows) + "\n")
    campaign = load_campaign(ball, None, read_setup(SETUP))
    assert [(trial.name, trial.session) for trial in campaign.trials] == [("0", "7"), ("1", "b")]
    assert any("trial 2 states two sessions" in note for note in campaign.notes)


def test_a_clock_that_stands_still_is_refused(tmp_path):
    ball = tmp_path / "ball.csv"
    ball.write_text("trial,t_s,x_m\n" + "".join(f"1,{k // 2},{k}\n" for k in range(20)))
    with pytest.raises(UsageError, match="repeat a time"):
        load_campaign(ball, None, read_setup(SETUP))


def test_a_campaign_of_any_size_is_thinned_to_what_can_be_fitted(tmp_path, monkeypatch):
    monkeypatch.setattr("pipelines.explain.campaign.MAX_SAMPLES", 100)
    monkeypatch.setattr("pipelines.explain.campaign.MAX_TRIALS", 5)
    ball = tmp_path / "ball.csv"
    rows = [f"{trial},{k / 10},{k}" for trial in range(10) for k in range(60)]
    ball.write_text("trial,t_s,x_m\n" + "\n".join(rows) + "\n")
    campaign = load_campaign(ball, None, read_setup(SETUP))
    assert len(campaign.trials) == 5
    assert sum(trial.ball_time.size for trial in campaign.trials) <= 100
    assert sum("one" in note for note in campaign.notes) == 2
