"""The shipped campaign: reproducible, small, and explained by the engine."""

from pathlib import Path

import pandas as pd

from bench.concealed.engine import engine_answer
from bench.concealed.sample import CONCEALED, make_sample

SHIPPED = Path(__file__).parents[2] / "sample_videos" / "campaign"


def test_the_shipped_campaign_is_the_one_the_script_makes(tmp_path):
    make_sample(tmp_path)
    for name in ("ball.csv", "pendulum.csv"):
        shipped, made = pd.read_csv(SHIPPED / name), pd.read_csv(tmp_path / name)
        # The last digit may differ between machines.
        pd.testing.assert_frame_equal(shipped, made, rtol=0, atol=2e-5)
    assert (SHIPPED / "setup.toml").read_text().splitlines()[:12] == (
        tmp_path / "setup.toml"
    ).read_text().splitlines()[:12]


def test_the_shipped_campaign_is_small():
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 300_000


def test_the_concealed_effect_is_found_with_its_size(tmp_path):
    answer = engine_answer(SHIPPED, tmp_path / "answer.json")
    assert not answer.failure
    found = next(named for named in answer.named if named.id == CONCEALED.recipe.id)
    value, std = found.parameters["spin"]
    assert abs(value - CONCEALED.amplitude) < 3.0 * std
