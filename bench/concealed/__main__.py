"""Draw concealed campaigns, run the engine, score the answers and write the proof.

The engine receives folders with a ball table, a pendulum table and a setup file. Keys are in
another folder and are read after every answer has been written.
"""

import argparse
import json
import os
import tempfile
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from bench.concealed.answer import Answer, answer_from_json
from bench.concealed.campaign import read_key
from bench.concealed.engine import engine_answer, engine_version
from bench.concealed.report import WHOLE_PROOF, Asked, Scored, proof_text
from bench.concealed.run import Stop, run_until
from bench.concealed.score import judge
from bench.concealed.second.careful import GENERATOR as CAREFUL_GENERATOR
from bench.concealed.second.careful import draw_careful
from bench.concealed.second.draw import GENERATOR as SECOND_GENERATOR
from bench.concealed.second.draw import draw_campaign as draw_second
from bench.concealed.world.draw import GENERATOR, draw_campaign
from metrology import write_text_whole

ROOT = Path(__file__).parents[2]


class World(StrEnum):
    """Generator of the campaigns."""

    OWN = "own"
    SECOND = "second"
    CAREFUL = "careful"


@dataclass(frozen=True)
class Shelf:
    """Folders of campaigns, keys and answers."""

    cache: Path
    seed: int
    version: str
    world: World = World.OWN

    @property
    def campaigns(self) -> Path:
        return self.cache / f"campaigns-{self._label}"

    @property
    def keys(self) -> Path:
        return self.cache / f"keys-{self._label}"

    @property
    def answers(self) -> Path:
        return self.cache / f"answers-{self._label}-{self.version}"

    @property
    def _label(self) -> str:
        if self.world is World.SECOND:
            return f"second-{SECOND_GENERATOR}-{self.seed}"
        if self.world is World.CAREFUL:
            return f"careful-{CAREFUL_GENERATOR}-{self.seed}"
        return f"{GENERATOR}-{self.seed}"

    def campaign(self, number: int) -> Path:
        return self.campaigns / f"{number:04d}"

    def key(self, number: int) -> Path:
        return self.keys / f"{number:04d}.json"


def _draw(task: tuple[Shelf, int]) -> None:
    shelf, number = task
    draw = {World.SECOND: draw_second, World.CAREFUL: draw_careful}.get(shelf.world, draw_campaign)
    draw(shelf.seed, number, shelf.campaign(number), shelf.keys)


def _answer(task: tuple[Path, Path]) -> Answer:
    folder, output = task
    if output.exists():
        raw = json.loads(output.read_text(encoding="utf-8"))
        return answer_from_json(raw, raw["seconds"])
    return engine_answer(folder, output)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.concealed", description=__doc__)
    parser.add_argument(
        "--campaigns", type=int, default=50, help="number of campaigns (400 for the proof)"
    )
    parser.add_argument("--first", type=int, default=0, help="number of the first campaign")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--world",
        type=World,
        choices=list(World),
        default=World.OWN,
        help="own: laws in (nearly) the catalogue's form; second: laws of other forms;"
        " careful: nothing missing, inputs and instruments a little off",
    )
    parser.add_argument("--jobs", type=int, default=max((os.cpu_count() or 2) // 2, 1))
    parser.add_argument(
        "--cache",
        type=Path,
        default=Path(tempfile.gettempdir()) / "impact-vision-concealed",
        help="folder of campaigns, keys and answers; reused",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        help="start no campaign after this time and score the answers so far; Ctrl-C and SIGTERM"
        " do the same at once, and the same command continues later",
    )
    parser.add_argument("--draw-only", action="store_true")
    parser.add_argument(
        "-o", "--output", type=Path,
        help="report file (default: docs/evidence/concealed.md if complete, else the terminal)",
    )  # fmt: skip
    return parser.parse_args()


def _answered(options: argparse.Namespace, shelf: Shelf, stop: Stop) -> list[Scored]:
    """Campaigns with their answers, as far as time allowed."""
    numbers = list(range(options.first, options.first + options.campaigns))
    run_until(stop, _draw, [(shelf, n) for n in numbers], options.jobs)
    if options.draw_only:
        return []
    numbers = [n for n in numbers if shelf.key(n).exists()]
    tasks = [(shelf.campaign(n), shelf.answers / f"{n:04d}.json") for n in numbers]
    # Answers of earlier runs count even if this run has no time left.
    answers = {task: _answer(task) for task in tasks if task[1].exists()}
    missing = [task for task in tasks if task not in answers]
    for task, found in zip(missing, run_until(stop, _answer, missing, options.jobs), strict=True):
        if found is not None:
            answers[task] = found
    return [
        Scored(judge(read_key(shelf.key(number)), answers[task]), task[0])
        for number, task in zip(numbers, tasks, strict=True)
        if task in answers
    ]


def main() -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    options = _options()
    shelf = Shelf(options.cache, options.seed, engine_version(ROOT), options.world)
    for folder in (shelf.campaigns, shelf.keys, shelf.answers):
        folder.mkdir(parents=True, exist_ok=True)
    scored = _answered(options, shelf, Stop(options.minutes))
    if options.draw_only:
        return
    output = options.output
    if output is None and options.campaigns >= WHOLE_PROOF and options.world is World.OWN:
        output = ROOT / "docs" / "evidence" / "concealed.md"
    text = proof_text(scored, Asked(options.campaigns, options.seed, shelf.version, options.world))
    if output is None:
        print(text)
    else:
        write_text_whole(output, text)
        print(f"wrote {output}: {len(scored)} of {options.campaigns} campaigns scored")


if __name__ == "__main__":
    main()
