"""Render campaigns as clips, measure them, run the engine and score the answers.

Run: python -m bench.concealed.filmed.pixels FOLDER

Clips, tracks and answers are stored in the folder and reused.
"""

import argparse
import hashlib
import json
import os
import pickle
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from bench.concealed.answer import Answer, answer_from_json
from bench.concealed.engine import engine_version
from bench.concealed.filmed.scenes import FILMED, Filmed, Take, setup_text, takes
from bench.concealed.run import Stop, run_until
from measuring.chain import MeasureOptions, measure_clip
from measuring.measurement import ClipMeasurement
from measuring.setup.file import load_setup
from metrology import ImpactVisionError, write_text_whole, written_whole
from pipelines.explain.campaign import explain_campaign
from pipelines.explain.clips import campaign_from_clips, clip_facts, with_rig
from sample_videos.render import render_clip

ROOT = Path(__file__).parents[3]
CHAIN = ("vision/**/*.py", "calib/**/*.py", "measuring/**/*.py")


def _filmed(folder: Path, filmed: Filmed, take: Callable[[], Take], number: int) -> Path:
    clip = folder / filmed.name / f"{filmed.name}_{number + 1}.mp4"
    if not clip.exists():
        done = take()
        clip.parent.mkdir(parents=True, exist_ok=True)
        render_clip(done.scene, done.shot, clip)
    return clip


def _chain_version() -> str:
    digest = hashlib.sha256()
    for pattern in CHAIN:
        for path in sorted(ROOT.glob(pattern)):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _measured(version: str, path: Path, options: MeasureOptions) -> ClipMeasurement:
    """Measure a clip, or load the result of the same version."""
    kept = path.with_suffix(f".{version}.pickle")
    if kept.exists():
        found: ClipMeasurement = pickle.loads(kept.read_bytes())
        return found
    measured = measure_clip(path, options)
    with written_whole(kept) as part:
        part.write_bytes(pickle.dumps(measured))
    return measured


def _film_and_measure(task: tuple[Path, int, int, str]) -> str:
    folder, which, number, version = task
    filmed = FILMED[which]
    clip = _filmed(folder, filmed, takes(filmed)[number], number)
    setup = folder / filmed.name / "setup.toml"
    try:
        _measured(version, clip, MeasureOptions(setup=load_setup(setup)))
    except ImpactVisionError as problem:
        return f"{clip.name}: {problem.message}"
    return ""


def _write_facts(folder: Path, filmed: Filmed) -> None:
    home = folder / filmed.name
    home.mkdir(parents=True, exist_ok=True)
    write_text_whole(home / "setup.toml", setup_text(filmed))
    rows = [f"{t.name},{t.backswing_deg:g}" for t in (take() for take in takes(filmed))]
    write_text_whole(home / "trials.csv", "\n".join(["clip,backswing_deg", *rows]) + "\n")


def _explain(task: tuple[Path, int, str]) -> str:
    """Explain one filmed campaign from stored measurements, as `vision explain CLIP…` does."""
    folder, which, version = task
    home = folder / FILMED[which].name
    answer = home / f"answer-{version}-{engine_version(ROOT)}.json"
    if not answer.exists():
        start = time.perf_counter()
        setup = with_rig(load_setup(home / "setup.toml"))
        clips = sorted(home.glob("*.mp4"))
        facts = clip_facts(home / "trials.csv")
        try:
            campaign = campaign_from_clips(
                clips, setup, facts, partial(_measured, version), strikes=True
            )
            raw = explain_campaign(campaign, setup).verdict.to_json()
            raw["clips"] = len(campaign.trials)
        except ImpactVisionError as problem:
            raw = {"verdict": "failed", "failure": problem.message}
        raw["seconds"] = time.perf_counter() - start
        write_text_whole(answer, json.dumps(raw, indent=1))
    return answer.name


def right(filmed: Filmed, answer: Answer) -> bool:
    """Whether the concealed effect is named or in a declared group, and nothing else is named."""
    if not filmed.id:
        return not answer.failure and not answer.ids
    groups = [group for group in answer.groups if filmed.id in group]
    # A rotation about another point is the same rotation plus a shift.
    shifted = {"origin_offset"} if filmed.id == "camera_roll" else set()
    allowed = {filmed.id}.union(shifted, *groups)
    return (filmed.id in answer.ids or bool(groups)) and answer.ids <= allowed


def main() -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    parser = argparse.ArgumentParser(
        prog="python -m bench.concealed.filmed.pixels", description=__doc__
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--minutes", type=float, help="start nothing after this time")
    options = parser.parse_args()
    stop, version = Stop(options.minutes), _chain_version()
    for filmed in FILMED:
        if not (options.folder / filmed.name / "trials.csv").exists():
            _write_facts(options.folder, filmed)
    clips = [(options.folder, c, k, version) for c in range(len(FILMED)) for k in range(8)]
    for said in run_until(stop, _film_and_measure, clips, options.jobs):
        if said:
            print(said)
    answers = run_until(
        stop, _explain, [(options.folder, c, version) for c in range(len(FILMED))], options.jobs
    )
    for filmed, kept in zip(FILMED, answers, strict=True):
        if kept is not None:
            raw = json.loads((options.folder / filmed.name / kept).read_text(encoding="utf-8"))
            answer = answer_from_json(raw, raw["seconds"])
            groups = [sorted(group) for group in answer.groups]
            print(
                f"{'right' if right(filmed, answer) else 'wrong'}: {filmed.name}"
                f" ({filmed.description}), {raw.get('clips', 0)} clips: {answer.verdict}"
                f" {sorted(answer.ids)} {groups} {answer.failure}"
            )


if __name__ == "__main__":
    main()
