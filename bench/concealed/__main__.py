"""Draw concealed campaigns, run the engine, score the answers and write the proof.

The engine receives folders with a ball table, a pendulum table and a setup file. Keys are in
another folder and are read after every answer has been written.
"""

import argparse
import json
import os
import tempfile
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from bench.concealed.answer import Answer, answer_from_json
from bench.concealed.calibration import draw_reliability
from bench.concealed.campaign import Key, read_key
from bench.concealed.engine import engine_answer, engine_version
from bench.concealed.filmed.section import section
from bench.concealed.foreign import convert_all, foreign_key
from bench.concealed.report import (
    WHOLE_PROOF,
    Asked,
    Scored,
    proof_text,
    with_kept_sections,
)
from bench.concealed.run import Stop, run_until
from bench.concealed.score import judge
from bench.concealed.second.careful import GENERATOR as CAREFUL_GENERATOR
from bench.concealed.second.careful import draw_careful
from bench.concealed.second.draw import GENERATOR as SECOND_GENERATOR
from bench.concealed.second.draw import draw_campaign as draw_second
from bench.concealed.world.draw import GENERATOR, draw_campaign
from bench.real.table import real_rows, real_table
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


def _real(source: Path, shelf: Shelf) -> list[str]:
    if not source.is_dir():
        return []
    return real_table(real_rows(source, shelf.answers / "real", _real_answer))


def _real_answer(folder: Path, output: Path) -> Answer:
    return _answer((folder, output))


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
    parser.add_argument(
        "--second", type=int, default=0, metavar="N",
        help="score the first N campaigns of the second world as well",
    )  # fmt: skip
    parser.add_argument("--jobs", type=int, default=max((os.cpu_count() or 2) // 2, 1))
    parser.add_argument(
        "--cache",
        type=Path,
        default=Path(tempfile.gettempdir()) / "impact-vision-concealed",
        help="folder of campaigns, keys and answers; reused",
    )
    parser.add_argument(
        "--foreign",
        type=Path,
        nargs="*",
        default=[
            ROOT.parent / "shared" / name
            for name in ("concealed_dev", "concealed_foreign", "concealed_third")
        ],
        help="folders of campaigns of an independent simulator; skipped if absent",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        help="start no campaign after this time and score the answers so far; Ctrl-C and SIGTERM"
        " do the same at once, and the same command continues later",
    )
    parser.add_argument(
        "--pixels",
        type=Path,
        default=None,
        metavar="FOLDER",
        help="add the section that `python -m bench.concealed.filmed.pixels` wrote to this folder",
    )
    parser.add_argument(
        "--real", type=Path, default=ROOT.parent / "shared" / "realdata", help="real recordings"
    )
    parser.add_argument("--no-real", action="store_true", help="skip the real recordings")
    parser.add_argument("--answers", type=Path, help="score only the answers in this folder")
    parser.add_argument("--kind", help="only campaigns of this kind (reads the keys first)")
    parser.add_argument("--draw-only", action="store_true")
    parser.add_argument(
        "-o", "--output", type=Path,
        help="report file (default: docs/evidence/concealed.md if complete, else the terminal)",
    )  # fmt: skip
    return parser.parse_args()


def _foreign(options: argparse.Namespace, shelf: Shelf) -> list[tuple[Path, Path]]:
    found = []
    for source in options.foreign:
        if source.is_dir():
            folders = convert_all(source, shelf.cache / source.name)
            found += [(folder, source / folder.name / "answer.json") for folder in folders]
    return found


def _foreign_answer(folder: Path) -> str:
    return f"{folder.parent.name}-{folder.name}.json"


def _answered(
    options: argparse.Namespace, shelf: Shelf, stop: Stop
) -> tuple[list[Scored], list[Scored]]:
    """Own and foreign campaigns with their answers, as far as time allowed."""
    numbers = list(range(options.first, options.first + options.campaigns))
    run_until(stop, _draw, [(shelf, n) for n in numbers], options.jobs)
    numbers = [n for n in numbers if (shelf.keys / f"{n:04d}.json").exists()]
    if options.draw_only:
        return [], []
    foreign = _foreign(options, shelf)
    answers_in = options.answers or shelf.answers
    if options.kind:
        numbers = [n for n in numbers if _key(shelf, n).kind == options.kind]
    if options.answers:
        numbers = [n for n in numbers if (options.answers / f"{n:04d}.json").exists()]
        foreign = [f for f in foreign if (options.answers / _foreign_answer(f[0])).exists()]
    tasks = [(f, answers_in / _foreign_answer(f)) for f, _ in foreign]
    tasks += [(shelf.campaign(n), answers_in / f"{n:04d}.json") for n in numbers]
    # Answers of earlier runs count even if this run has no time left.
    answers = [_answer(task) if task[1].exists() else None for task in tasks]
    missing = [k for k, answer in enumerate(answers) if answer is None]
    found = run_until(stop, _answer, [tasks[k] for k in missing], options.jobs)
    for k, answer in zip(missing, found, strict=True):
        answers[k] = answer
    keys = [foreign_key(path) for _, path in foreign]
    keys += [_key(shelf, n) for n in numbers]
    scored = [
        None if answer is None else Scored(judge(key, answer), folder)
        for key, answer, (folder, _) in zip(keys, answers, tasks, strict=True)
    ]
    theirs, own = scored[: len(foreign)], scored[len(foreign) :]
    return [s for s in own if s is not None], [s for s in theirs if s is not None]


def _made(shelf: Shelf) -> Shelf:
    for folder in (shelf.campaigns, shelf.keys, shelf.answers):
        folder.mkdir(parents=True, exist_ok=True)
    return shelf


def _second(options: argparse.Namespace, shelf: Shelf) -> list[Scored]:
    """The first campaigns of the second world."""
    if not options.second:
        return []
    other = vars(options) | {"campaigns": options.second, "first": 0, "foreign": [], "kind": None}
    asked = argparse.Namespace(**other)
    scored, _ = _answered(asked, _made(replace(shelf, world=World.SECOND)), Stop(options.minutes))
    return scored


def main() -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    options = _options()
    shelf = _made(Shelf(options.cache, options.seed, engine_version(ROOT), options.world))
    real = [] if options.no_real or options.draw_only else _real(options.real, shelf)
    own, theirs = _answered(options, shelf, Stop(options.minutes))
    if options.draw_only:
        return
    others = options.world in (World.SECOND, World.CAREFUL)
    second = own if others else _second(options, shelf)
    own = [] if others else own
    pixels = [] if options.pixels is None else section(options.pixels)
    answered_by = options.answers.name.rsplit("-", 1)[-1] if options.answers else shelf.version
    asked = Asked(options.campaigns, options.seed, answered_by)
    output = options.output
    if output is None and options.campaigns >= WHOLE_PROOF and options.world is World.OWN:
        output = ROOT / "docs" / "evidence" / "concealed.md"
    judged = [s.judgement for s in (*theirs, *second)]
    reliability = "" if output is None else draw_reliability(judged, output)
    text = proof_text(own, theirs, asked, real, pixels, second, reliability)
    if output is None:
        print(text)
    else:
        if output.exists():
            text = with_kept_sections(text, output.read_text(encoding="utf-8"))
        write_text_whole(output, text)
        print(f"wrote {output}: {len(own)} of {options.campaigns} campaigns scored")


def _key(shelf: Shelf, number: int) -> Key:
    return read_key(shelf.keys / f"{number:04d}.json")


if __name__ == "__main__":
    main()
