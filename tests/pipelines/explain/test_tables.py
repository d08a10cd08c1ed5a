"""Tables with a few numbers per trial through the command."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from measuring.setup.file import load_setup
from metrology import UsageError
from pipelines.explain.campaign import is_trial_table, load_trial_table
from pipelines.explain.command import explain_command
from tests.mismatch.table.trial_tables import SETUP, simulated_table


def run(*arguments: str):
    app = typer.Typer()
    app.command()(explain_command)
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture
def files(tmp_path):
    table = simulated_table(4, "velocity_dependent_cor")
    lines = [
        "trial,ball,impact_speed_m_s,impact_speed_m_s_std,ball_speed_m_s,ball_speed_m_s_std,"
        "range_m,range_m_std"
    ]
    for name, ball, values, stds in zip(
        table.names, table.balls, table.values, table.stds, strict=True
    ):
        pairs = ",".join(f"{v:.5f},{s:.5f}" for v, s in zip(values, stds, strict=True))
        lines.append(f"{name},{ball},{pairs}")
    path = tmp_path / "trials.csv"
    path.write_text("\n".join(lines) + "\n")
    setup = tmp_path / "setup.toml"
    setup.write_text(SETUP)
    return path, setup


def test_a_table_is_known_by_its_header(files, tmp_path):
    assert is_trial_table(files[0])
    tracks = tmp_path / "ball.csv"
    tracks.write_text("trial,t_s,x_m,y_m\n1,0,0,0\n")
    assert not is_trial_table(tracks)
    assert not is_trial_table(tmp_path / "nowhere.csv")


@pytest.mark.parametrize(("factor", "refused"), [(100.0, True), (0.001, True), (7.0, False)])
def test_rows_in_another_unit_are_refused_by_name(files, tmp_path, factor, refused):
    """Every other row in cm/s was pivot_recoil, 0.90."""
    lines = files[0].read_text().splitlines()
    for row in range(2, len(lines), 2):
        cells = lines[row].split(",")
        lines[row] = ",".join([*cells[:2], f"{factor * float(cells[2]):.6f}", *cells[3:]])
    other = tmp_path / "other.csv"
    other.write_text("\n".join(lines) + "\n")
    if not refused:
        assert load_trial_table(other).trials == len(lines) - 1
        return
    with pytest.raises(UsageError, match=r"impact_speed_m_s of trial .* units seem to differ"):
        load_trial_table(other)


def test_the_command_answers_a_table_as_it_answers_tracks(files, tmp_path):
    table, setup = files
    model = tmp_path / "model.toml"
    result = run(
        str(table), "--setup", str(setup), "--json", "-", "--report", str(tmp_path / "r.html"),
        "--plot", str(tmp_path / "p.png"), "--model", str(model),
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert set(told) >= {
        "verdict", "baseline", "location", "effects", "alternatives", "indistinguishable",
        "next_measurement", "held_out", "remainder",
    }  # fmt: skip
    assert told["effects"][0]["id"] == "velocity_dependent_cor"
    assert 0.0 < told["effects"][0]["probability"] < 1.0
    assert told["held_out"]["rmse_after_m"] < told["held_out"]["rmse_before_m"]
    assert (tmp_path / "p.png").read_bytes()[1:4] == b"PNG"
    assert "<h1>" in (tmp_path / "r.html").read_text()
    again = load_setup(model)
    assert "velocity_dependent_cor" in again.model.effects


def test_what_measure_writes_is_a_table(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text(
        "clip,contact_frames,pendulum_speed_before_m_s,pendulum_speed_before_m_s_std,"
        "ball_speed_m_s,landing_distance_m,landing_distance_m_std,backswing_angle_deg\n"
        "a.mp4,7,1.12,0.01,1.8,0.52,0.004,30\n"
        "b.mp4,7,2.30,0.01,3.7,,,60\n"
        "c.mp4,7,,,,,,\n"
    )
    table = load_trial_table(path)
    assert table.names == ("a.mp4", "b.mp4")
    assert table.values[0].tolist() == [1.12, 1.8, 0.52]
    assert np.isnan(table.values[1, 2])
    assert table.stds[0, 2] == 0.004
    assert np.rad2deg(table.backswing).tolist() == pytest.approx([30.0, 60.0])
    assert "c.mp4" in table.notes[0]


def test_doubles_and_texts_for_numbers_are_told(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(
        "trial,impact_speed_m_s,range_m\n1,1.0,0.5\n1,1.0,0.5\n2,2.0,far\n2,2.0,1.2\n3,3.0,1.8\n"
    )
    table = load_trial_table(path)
    assert table.trials == 3
    assert any("duplicate rows" in note for note in table.notes)
    assert any("not numbers" in note for note in table.notes)
    assert any("several rows" in note for note in table.notes)


def test_a_table_goes_alone(files, tmp_path):
    swing = tmp_path / "pendulum.csv"
    swing.write_text("trial,t_s,phi_rad\n1,0,-0.3\n")
    result = run(str(files[0]), "--pendulum", str(swing), "--setup", str(files[1]))
    assert isinstance(result.exception, UsageError)
    assert "pendulum" in result.exception.message


def test_an_empty_table_is_refused(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("trial,impact_speed_m_s,range_m\n")
    with pytest.raises(UsageError, match="no rows"):
        load_trial_table(path)


def test_a_range_that_is_none_is_refused_by_trial_and_column(tmp_path):
    path = tmp_path / "trials.csv"
    path.write_text("trial,impact_speed_m_s,range_m\na,2.0,1.1\nb,2.5,-1.4\nc,3.0,1.7\nd,3.2,1.8\n")
    with pytest.raises(UsageError, match=r"trials.csv: range_m is -1.4 in trial b"):
        load_trial_table(path)


def test_what_a_campaign_excludes_takes_no_part(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text(
        "clip,ball,pendulum_speed_before_m_s,landing_distance_m,excluded\n"
        "a,jokku,2.0,1.1,\nb,jokku,2.5,9.9,the ball was not at rest\nc,jokku,3.0,1.7,\n"
    )
    table = load_trial_table(path)
    assert table.names == ("a", "c")
    assert any("1 rows with a reason in excluded" in note for note in table.notes)
