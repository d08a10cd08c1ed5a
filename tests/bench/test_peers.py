import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.concealed.contest.flights import FreeFlight, baseline_residual, free_flights
from bench.concealed.contest.peers import PEERS

SAMPLE = Path(__file__).parents[2] / "sample_videos" / "campaign"


def test_the_baseline_leaves_nothing_of_a_parabola():
    t = np.arange(0, 0.4, 1 / 600)
    place = np.stack([3 * t, 0.4 + 1 * t - 0.5 * 9.806 * t**2], axis=1)
    assert np.abs(baseline_residual(FreeFlight(t + 2, place, 0.0))).max() < 1e-6


def test_peers_answer_from_the_same_files(tmp_path):
    pytest.importorskip("pysindy")
    pytest.importorskip("sklearn")
    # Three trials of the sample, every other row: peers that work on a part work on the whole.
    for name in ("ball.csv", "pendulum.csv"):
        table = pd.read_csv(SAMPLE / name)
        first = table["trial"].unique()[:3]
        table[table["trial"].isin(first)].iloc[::2].to_csv(tmp_path / name, index=False)
    shutil.copy(SAMPLE / "setup.toml", tmp_path)
    assert len(free_flights(tmp_path)) == 3
    for name, peer in PEERS.items():
        assert peer(tmp_path).verdict in ("no_mismatch", "explained"), name
