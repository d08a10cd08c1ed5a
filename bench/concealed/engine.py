"""Run the engine on a campaign folder as a user would."""

import hashlib
import json
import time
from pathlib import Path

import typer
from typer.testing import CliRunner

from bench.concealed.answer import Answer, answer_from_json
from metrology import write_text_whole
from pipelines.explain.command import explain_command

__all__ = ["engine_answer", "engine_version"]

SOURCES = ("metrology", "physics", "mismatch", "pipelines/explain", "measuring/setup")
"""Folders whose modules an answer depends on."""


def engine_version(root: Path) -> str:
    """Digest of the sources and fitted numbers an answer depends on.

    Raises
    ------
    FileNotFoundError
        If one of the folders contains no module: answers of another version would be reused.
    """
    digest = hashlib.sha256()
    for folder in SOURCES:
        files = sorted((root / folder).rglob("*.*"))
        if not any(path.suffix == ".py" for path in files):
            raise FileNotFoundError(f"no module in {root / folder}, on which answers depend")
        for path in (one for one in files if one.suffix in (".py", ".json")):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def engine_answer(folder: Path, output: Path) -> Answer:
    """Run `vision explain` on the files of a folder and write its JSON to `output`.

    Times are processor times, independent of the load of the machine.
    """
    app = typer.Typer()
    app.command()(explain_command)
    command = ["--setup", str(folder / "setup.toml"), "--json", str(output), "--quiet"]
    if (folder / "ball.csv").exists():
        command.insert(0, str(folder / "ball.csv"))
    if (folder / "pendulum.csv").exists():
        command += ["--pendulum", str(folder / "pendulum.csv")]
    output.unlink(missing_ok=True)
    start = time.process_time()
    result = CliRunner().invoke(app, command)
    seconds = time.process_time() - start
    if result.exit_code or not output.exists():
        said = (result.output or "").strip().splitlines()
        why = repr(result.exception) if result.exception else "no JSON written"
        failure = f"exit {result.exit_code}: {why} {said[-1:]}"
        raw = {"verdict": "failed", "failure": failure, "seconds": seconds}
        write_text_whole(output, json.dumps(raw))
        return answer_from_json(raw, seconds)
    raw = json.loads(output.read_text(encoding="utf-8"))
    raw["seconds"] = seconds
    write_text_whole(output, json.dumps(raw))
    return answer_from_json(raw, seconds)
