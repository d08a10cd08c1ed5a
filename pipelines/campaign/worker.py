"""Measure one clip at a time in a separate process, isolated from the campaign.

``python -m pipelines.campaign.worker`` reads one request per line (JSON) from standard input and
answers with one line; `WorkerProcess` is the client. A clip that crashes, hangs or exhausts memory
ends only its worker; the next clip gets a new one.
"""

import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from pipelines.processes import ONE_THREAD

__all__ = ["ClipWorkerDied", "Request", "WorkerProcess", "answer"]


@dataclass(frozen=True)
class Request:
    """A request to a worker.

    Attributes
    ----------
    path : str
        The clip.
    setup : str or None
        Path of the setup file.
    fps, ball, wall_grid, ball_at : str or None
        As the options of `vision measure` are typed.
    joint_rate : tuple or None
        Rate of clips that state none, 1/s, with its std and its notice.
    tracks, picture : str or None
        Output files for the tracks (CSV) and an overlay frame (JPEG).
    """

    path: str
    setup: str | None = None
    fps: str | None = None
    ball: str | None = None
    wall_grid: str | None = None
    ball_at: str | None = None
    joint_rate: tuple[float, float, str] | None = None
    tracks: str | None = None
    picture: str | None = None


class ClipWorkerDied(Exception):
    """The worker process crashed, hung or exceeded its memory; the message states which."""


OWN_WORKER = (sys.executable, "-m", "pipelines.campaign.worker")
"""Default worker command."""
_ORPHAN_CHECK_S = 0.2
"""s: interval of the check that the sender of requests lives, once it sends no more (chosen)."""
_WATCH_S = 0.5
"""s: interval of memory checks; a worker fills a gigabyte in about that time."""


class WorkerProcess:
    """A worker process, started at the first request and again after it died.

    Parameters
    ----------
    timeout_s : float
        Time limit per clip.
    memory_bytes : int
        Memory limit; a worker that exceeds it is killed.
    command : tuple of str, optional
        Command of the worker.
    """

    def __init__(
        self, timeout_s: float, memory_bytes: int, command: tuple[str, ...] | None = None
    ) -> None:
        self._timeout_s, self._memory = timeout_s, memory_bytes
        self._command = command or OWN_WORKER
        self._process: subprocess.Popen[str] | None = None
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._pump: threading.Thread | None = None

    def ask(self, request: Request) -> dict[str, Any]:
        """Send a request and return the answer.

        Raises
        ------
        ClipWorkerDied
        """
        process = self._running()
        assert process.stdin is not None
        try:
            process.stdin.write(json.dumps(asdict(request)) + "\n")
            process.stdin.flush()
        except OSError as problem:
            raise ClipWorkerDied(self._ended(process)) from problem
        until = time.monotonic() + self._timeout_s
        while True:
            try:
                line = self._lines.get(timeout=_WATCH_S)
            except queue.Empty:
                self._watch(process, until)
                continue
            if line is None:
                raise ClipWorkerDied(self._ended(process))
            if line.startswith("{"):
                return dict(json.loads(line))

    def close(self) -> None:
        """End the process, if there is one."""
        process = self._process
        if process is not None:
            process.kill()
            self._put_away(process)

    def _running(self) -> "subprocess.Popen[str]":
        if self._process is None or self._process.poll() is not None:
            self._lines = queue.Queue()
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                env={**os.environ, **ONE_THREAD},
                # Ctrl-C is handled by the coordinator
                start_new_session=True,
            )
            self._pump = threading.Thread(
                target=_pump, args=(self._process, self._lines), daemon=True
            )
            self._pump.start()
        return self._process

    def _watch(self, process: "subprocess.Popen[str]", until: float) -> None:
        if time.monotonic() > until:
            self.close()
            raise ClipWorkerDied(f"it took longer than {self._timeout_s:g} s")
        try:
            held = psutil.Process(process.pid).memory_info().rss
        except psutil.NoSuchProcess:
            return
        if held > self._memory:
            self.close()
            raise ClipWorkerDied(f"it needed more than {self._memory / 2**20:.0f} MB of memory")

    def _put_away(self, process: "subprocess.Popen[str]") -> int:
        # the thread that asks and the one that closes may both come here
        code, pump = process.wait(), self._pump
        if pump is not None:
            pump.join()
        if process.stdin is not None:
            with suppress(OSError):
                # closing fails if unsent data has no reader
                process.stdin.close()
        self._process = self._pump = None
        return code

    def _ended(self, process: "subprocess.Popen[str]") -> str:
        code = self._put_away(process)
        return f"it ended the process that measured it ({_ending(code)})"


def _ending(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"


def _pump(process: "subprocess.Popen[str]", lines: "queue.Queue[str | None]") -> None:
    assert process.stdout is not None
    with process.stdout:
        for line in process.stdout:
            lines.put(line)
    lines.put(None)


def answer(request: Request) -> dict[str, Any]:
    """Measure one clip, write its files, and return the result.

    Returns
    -------
    dict
        ``{"document": …}`` or ``{"error": …, "document": …}``; the document may be None.
    """
    from metrology import ImpactVisionError

    try:
        return _measured(request)
    except ImpactVisionError as problem:
        return {"error": problem.in_one_line, "document": None}
    except MemoryError:
        return {"error": "not enough memory to measure it", "document": None}


def _measured(request: Request) -> dict[str, Any]:
    from measuring.chain import measure_clip
    from measuring.measurement import tracks_as_csv
    from metrology import write_text_whole
    from metrology.files import written_whole
    from pipelines.api.quantities import measure_options
    from pipelines.measure.files import measurement_as_dict, overlay_marks
    from vision.clip.clip import ClipReader
    from vision.clip.footage import CaptureRate, RateSource
    from vision.overlay import overlay_still

    options = measure_options(
        request.setup, request.fps, request.ball, request.wall_grid, request.ball_at
    )
    if request.joint_rate is not None:
        fps, std, notice = request.joint_rate
        joint = CaptureRate(fps, std, RateSource.ASSUMED, notice)
        options = replace(options, joint_rate=joint)
    measured = measure_clip(Path(request.path), options, lambda step, part: None)
    document = measurement_as_dict(measured)
    if request.tracks is not None:
        write_text_whole(Path(request.tracks), tracks_as_csv(measured))
    if request.picture is not None:
        still = overlay_still(
            ClipReader.open(Path(request.path)), measured.tracks, overlay_marks(measured)
        )
        with written_whole(Path(request.picture)) as temporary:
            temporary.write_bytes(_small_jpeg(still))
    if not any(item.known for item in measured.quantities):
        causes = [finding.sentence for finding in measured.findings]
        reason = causes[0] if causes else measured.quantity("ball_speed").reason
        return {"error": f"nothing can be measured: {reason}", "document": document}
    return {"document": document}


_THUMBNAIL_WIDTH = 640
"""px (chosen: readable, and 160 pictures keep the report below 5 MB)."""


def _small_jpeg(image: NDArray[np.uint8]) -> bytes:
    import cv2

    share = min(1.0, _THUMBNAIL_WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 70])[1])


def _serve() -> None:
    # anything a library prints must not be read as an answer
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    lines: queue.Queue[str | None] = queue.Queue()
    threading.Thread(target=_read_requests, args=(lines, os.getppid()), daemon=True).start()
    while (line := lines.get()) is not None:
        given: Mapping[str, Any] = json.loads(line)
        started = time.monotonic()
        reply = answer(Request(**given))
        reply["seconds"] = time.monotonic() - started
        answers.write(json.dumps(reply, allow_nan=False) + "\n")
        answers.flush()


def _read_requests(lines: "queue.Queue[str | None]", sender: int) -> None:
    """Pass on requests; end the process, even during a clip, when their sender is gone."""
    for line in sys.stdin:
        lines.put(line)
    lines.put(None)
    while os.getppid() == sender:
        time.sleep(_ORPHAN_CHECK_S)
    os._exit(1)


if __name__ == "__main__":
    _serve()
