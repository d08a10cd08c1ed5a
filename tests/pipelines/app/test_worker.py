"""The measuring process, and what it keeps from one correction to the next."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np

from measuring.chain import MeasureOptions
from measuring.setup.file import load_setup
from metrology.kept import KeptResults
from pipelines.app.corrections import ObjectMark, corrected_table
from pipelines.app.marks import marks_of
from pipelines.app.worker import ClipAnswer, Measurer, Task, measured_answer
from pipelines.measure.files import measurement_as_json
from tests.pipelines.app.small import CLIP, falling


def test_a_task_given_as_the_process_dies_is_answered(tmp_path: Path) -> None:
    task = tmp_path / "missing.mp4", MeasureOptions()
    answers: Queue[str] = Queue()

    def take(answer: ClipAnswer) -> None:
        if "ended unexpectedly" in answer.problem:
            # its pipe is closed, but it may still count as alive
            measurer.measure(*task)
        answers.put(answer.problem)

    measurer = Measurer(take)
    measurer.measure(*task)
    for _ in range(4):
        assert "missing.mp4" in answers.get(timeout=30.0)
        measurer._process.process.kill()
        assert "ended unexpectedly" in answers.get(timeout=30.0)
    assert "missing.mp4" in answers.get(timeout=30.0)
    measurer.stop()


def test_found_objects_are_reported_before_the_end(tmp_path: Path) -> None:
    answers: Queue[ClipAnswer] = Queue()
    measurer = Measurer(answers.put)
    measurer.measure(falling(tmp_path / "clip"), MeasureOptions())
    early, answer = [], answers.get(timeout=120.0)
    while not answer.done:
        early += [] if answer.candidates is None else [answer.candidates]
        answer = answers.get(timeout=120.0)
    measurer.stop()
    (drawn,) = (marks_of(None, one)["candidates"] for one in early)
    assert answer.measured is not None
    (ball,) = (one for one in drawn if one["measured"])
    at = dict(zip(ball["frame"], ball["y"], strict=True))
    exact = marks_of(answer.measured)["objects"][0]
    off = [at[one] - y for one, y in zip(exact["frame"], exact["y"], strict=True) if one in at]
    assert len(off) > 20
    assert np.abs(off).max() < 3.0


class _Counted(KeptResults):
    """Kept results that list the steps which were computed."""

    def __init__(self) -> None:
        super().__init__()
        self.computed: list[str] = []

    def once(self, step: str, inputs: object, compute: Callable[[], Any]) -> Any:
        def counted() -> Any:
            self.computed.append(step)
            return compute()

        return super().once(step, inputs, counted)


def test_a_correction_keeps_what_it_does_not_change_and_measures_the_same() -> None:
    kept, options = _Counted(), MeasureOptions(setup=load_setup(CLIP.with_suffix(".toml")))

    def answer(task: Task, kept: KeptResults | None) -> ClipAnswer:
        return measured_answer(task, lambda _step, _part: None, kept)

    def steps() -> set[str]:
        return {one.partition(" at ")[0] for one in kept.computed}

    found = answer(Task(1, CLIP, options), kept).candidates
    assert found is not None
    assert {"clip", "footage", "scene", "striker", "striker's motion", "grid"} == {*steps()}
    own = found[found["measured"] == 1].sort_values("frame")
    seen = own.iloc[len(own) // 2]
    mark = ObjectMark(int(seen["frame"]), seen["x_px"] + 3.0, seen["y_px"], moved=True)
    dragged = Task(2, CLIP, options, corrected_table(found, (mark,)))
    faster = replace(dragged, options=replace(options, fps=601.0))
    for task, computed in ((dragged, {"striker", "striker's motion"}), (faster, set())):
        kept.computed.clear()
        again, fresh = answer(task, kept).measured, answer(task, None).measured
        assert again is not None
        assert fresh is not None
        assert measurement_as_json(again) == measurement_as_json(fresh)
        assert np.array_equal(again.tracks.ball.centre_px, fresh.tracks.ball.centre_px)
        assert steps() == computed
