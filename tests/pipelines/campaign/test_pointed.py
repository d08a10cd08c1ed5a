"""A clip whose ball was selected on the page is measured again."""

import sys
from pathlib import Path

import pytest

from metrology import UsageError
from pipelines.campaign.ledger import Ledger
from pipelines.campaign.results import match_clips
from pipelines.campaign.run import RunOptions, RunPlan, find_clips, local_crew, run

STAND_IN = Path(__file__).with_name("stand_in.py")


def test_a_clip_whose_ball_was_shown_is_measured_again_with_the_point(tmp_path: Path) -> None:
    clips, out = tmp_path / "clips", tmp_path / "out"
    clips.mkdir()
    for name in ("a", "b"):
        (clips / f"{name}.mp4").write_bytes(name.encode())
    options = RunOptions(command=(sys.executable, str(STAND_IN)))
    plan = RunPlan(out, options, match_clips(None, find_clips([clips])), "1")
    assert run(plan, lambda: local_crew(1, options)).done == 2
    with Ledger(out) as ledger:
        ledger.point_at("a.mp4", "120.0,88.0")
        for change in (ledger.point_at, ledger.exclude):
            with pytest.raises(UsageError, match=r"no clip 'c\.mp4'"):
                change("c.mp4", "1,2")
    again = run(plan, lambda: local_crew(1, options))
    assert again.again == {"a.mp4": "setup or options"}
    assert plan.request(clips / "a.mp4", "120.0,88.0").ball_at == "120.0,88.0"
    assert run(plan, lambda: local_crew(1, options)).todo == 0
