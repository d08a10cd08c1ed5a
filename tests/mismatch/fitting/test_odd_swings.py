"""Swings that are no evidence: refused, or told in words, never a traceback."""

import numpy as np
import pandas as pd
import pytest

from bench.real.made import STRING, write_swings
from metrology import UsageError
from pipelines.explain.command import explain_files_in_full
from pipelines.explain.io import load_campaign
from pipelines.setup.file import load_setup


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    target = tmp_path_factory.mktemp("string")
    write_swings(STRING, target)
    return target


def _explained(folder, table):
    table.to_csv(folder / "odd.csv", index=False)
    return explain_files_in_full(None, folder / "odd.csv", folder / "setup.toml")


def test_angles_in_degrees_are_refused(folder):
    table = pd.read_csv(folder / "pendulum.csv")
    table["phi_rad"] = np.degrees(table["phi_rad"]) * 0.2
    with pytest.raises(UsageError, match="rad to each side"):
        _explained(folder, table)


def test_times_in_milliseconds_are_refused(folder):
    table = pd.read_csv(folder / "pendulum.csv")
    table["t_s"] *= 1000.0
    with pytest.raises(UsageError, match="small swings take"):
        _explained(folder, table)


def test_millions_of_rows_are_thinned_and_said_to_be(folder):
    count = 100_000
    time = np.linspace(0.0, 20.0, count)
    table = pd.DataFrame({"trial": 1, "t_s": time, "phi_rad": 0.3 * np.cos(3.2 * time)})
    table.to_csv(folder / "long.csv", index=False)
    campaign = load_campaign(None, folder / "long.csv", load_setup(folder / "setup.toml"))
    assert campaign.trials[0].pendulum_time.size <= 8000
    assert any("thinned" in note for note in campaign.notes)
