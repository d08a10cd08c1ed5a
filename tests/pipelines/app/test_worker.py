"""The measuring process: one that dies is replaced by the next task, however soon it comes."""

from pathlib import Path
from queue import Queue

from pipelines.app.worker import ClipAnswer, Measurer
from pipelines.measure.chain import MeasureOptions


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
        measurer._process.kill()
        assert "ended unexpectedly" in answers.get(timeout=30.0)
    assert "missing.mp4" in answers.get(timeout=30.0)
    measurer.stop()
