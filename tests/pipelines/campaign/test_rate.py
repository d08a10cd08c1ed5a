"""Clips that state no rate share one, estimated once from all of them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.campaign import conduct, run
from pipelines.campaign.ledger import Entry, State, WorkOrder
from pipelines.campaign.rate import CommonRate, common_rate, kept_rate
from pipelines.campaign.worker import Request


def entry(fps: float, std: float | None, source: str = "assumed") -> Entry:
    base = {"capture_fps": fps, "std": std, "source": source}
    order = WorkOrder("a", "a", "", "", "")
    return Entry(order, State.DONE, 1, 1.0, None, None, {"time_base": base})


def test_what_clips_share_is_not_averaged_away() -> None:
    rng = np.random.default_rng(5)
    # a scale that is 1 % wrong in all clips, and independent noise
    alike = common_rate([entry(597.0 + e, 6.0) for e in rng.normal(0.0, 0.5, 20)])
    assert alike is not None
    assert alike.std == pytest.approx(6.0, rel=0.05)
    apart = common_rate([entry(600.0 + e, 6.0) for e in rng.normal(0.0, 6.0, 200)])
    assert apart is not None
    assert apart.std < 2.0
    assert abs(apart.fps - 600.0) < 2.0


def test_clips_of_two_cameras_have_no_common_rate() -> None:
    assert common_rate([entry(fps, 5.0) for fps in (240.0, 241.0, 600.0, 598.0)]) is None
    assert common_rate([entry(600.0, 5.0), entry(598.0, 5.0)]) is None
    assert common_rate([entry(600.0, None)] * 5) is None
    assert common_rate([entry(600.0, 1.0, "option")] * 5) is None


def test_the_rate_is_kept_and_a_damaged_file_is_no_rate(tmp_path: Path) -> None:
    rate = CommonRate(599.2, 1.5, 8, 587.6, 600.3)
    rate.keep(tmp_path)
    assert kept_rate(tmp_path) == rate
    for text in ("{", "[]", '{"fps": 1}', json.dumps({**vars(rate), "fps": -1.0})):
        (tmp_path / "rate.json").write_text(text)
        assert kept_rate(tmp_path) is None


def test_all_clips_are_measured_with_one_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, Any]] = []

    def answer(request: Request, _: run.RunOptions) -> dict[str, Any]:
        number = len(asked)
        asked.append((Path(request.path).name, request.joint_rate))
        fps, std, *_ = request.joint_rate or (595.0 + number % 5, 3.0)
        document = {
            "quantities": {"ball_speed": {"value": 2.0, "std": 0.1, "unit": "m/s"}},
            "time_base": {"capture_fps": fps, "std": std, "source": "assumed"},
            "warnings": [] if request.joint_rate is None else [request.joint_rate[2]],
            "motion": {"kind": "flight", "probability": 0.99},
            "budget": {},
        }
        return {"document": json.dumps(document), "seconds": 0.1}

    monkeypatch.setattr(run, "measure_in_worker", answer)
    clips = tmp_path / "clips"
    clips.mkdir()
    for number in range(20):
        (clips / f"{number}.mp4").write_bytes(bytes([number]))
    options = conduct.CampaignOptions((clips,), tmp_path / "out", jobs=1)
    done = conduct.conduct(options)
    assert sum(rate is None for _, rate in asked) == 7
    assert len({rate for _, rate in asked if rate is not None}) == 1
    assert len(asked) == 27
    assert done.again == {}
    said = [text for text in done.warnings if "Frame rate not given" in text]
    assert len(said) == 1
    assert "7 clips together" in said[0]
    # a second run with one more clip asks for that one alone, at the same rate
    (clips / "21.mp4").write_bytes(b"new")
    conduct.conduct(options)
    assert len(asked) == 28
    assert asked[-1] == ("21.mp4", asked[-2][1])
    # with the camera's rate all are measured with that
    again = conduct.conduct(replace(options, fps="600"))
    assert len(again.again) == 21
    assert asked[-1][1] is None
