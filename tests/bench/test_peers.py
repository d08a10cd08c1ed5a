import numpy as np
import pytest

from bench.concealed.draw import draw_campaign
from bench.concealed.flights import FreeFlight, baseline_residual, free_flights
from bench.concealed.peers import PEERS


def test_the_baseline_leaves_nothing_of_a_parabola():
    t = np.arange(0, 0.4, 1 / 600)
    place = np.stack([3 * t, 0.4 + 1 * t - 0.5 * 9.806 * t**2], axis=1)
    assert np.abs(baseline_residual(FreeFlight(t + 2, place, 0.0))).max() < 1e-6


def test_peers_answer_from_the_same_files(tmp_path):
    pytest.importorskip("pysindy")
    pytest.importorskip("sklearn")
    draw_campaign(5, 0, tmp_path / "a", tmp_path / "keys")
    assert len(free_flights(tmp_path / "a")) >= 8
    for name, peer in PEERS.items():
        assert peer(tmp_path / "a").verdict in ("no_mismatch", "explained"), name
