"""The bugs of the first review, tried on any source tree through the command line and its files.

Run: python -m bench.house.first_build [--tree FOLDER]

Without `--tree`, this one. A row for each bug: whether the tree has it, and what was seen.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).parents[2]
CLIP = "sample_videos/clips/jokku_90_small"
TIMEOUT_S = 900
GRID_MUST_BE_REFUSED = 2
"""Exit code of a user's mistake."""
NOT_DECLARED_BEFORE = ("fastapi", "uvicorn")
SHARE_OF_ASSUMED_RATE = 0.05
"""Of a frame rate that nobody stated: a standard uncertainty below this is sure of a guess."""

Seen = tuple[bool, str]


class Tree:
    """A source tree whose commands are run, and what measurements of its sample clip wrote."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, self.folder = root, folder
        self._kept: dict[str, tuple[dict[str, dict[str, float]], str]] = {}
        self.clip = ROOT / f"{CLIP}.mp4"
        self.setup = (ROOT / f"{CLIP}.toml").read_text(encoding="utf-8")

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run one command of the tree."""
        place = {**os.environ, "PYTHONPATH": str(self.root), "COLUMNS": "240",
                 "IMPACT_VISION_CACHE": "off"}  # fmt: skip
        command = [sys.executable, "-c", "from pipelines.cli import app; app()", *words]
        return subprocess.run(
            command, cwd=self.root, env=place, capture_output=True, text=True, timeout=TIMEOUT_S
        )

    def measured(self, name: str, setup: str) -> tuple[dict[str, dict[str, float]], str]:
        """Quantities of the sample clip under a setup, and all that was printed."""
        if name in self._kept:
            return self._kept[name]
        file, out = self.folder / f"{name}.toml", self.folder / f"{name}.json"
        file.write_text(setup, encoding="utf-8")
        told = self.run("measure", str(self.clip), "--setup", str(file), "--json", str(out),
                        "--csv", str(out.with_suffix(".csv")), "--tracks",
                        str(out.with_suffix(".tracks")), "--report",
                        str(out.with_suffix(".html")))  # fmt: skip
        held = out.is_file()
        found = json.loads(out.read_text(encoding="utf-8"))["quantities"] if held else {}
        self._kept[name] = found, told.stdout + told.stderr
        return self._kept[name]


def prose_decides(tree: Tree) -> Seen:
    """Bug 1: the distance on the wall keeps the line of the camera's distance."""
    _, told = tree.measured("plain", tree.setup)
    line = next((x for x in told.splitlines() if "as read on the wall:" in x), "")
    return "camera distance" in line or not line, line.partition("=")[2].strip()[
        :90
    ] or "no budget printed"


def setup_drag_ignored(tree: Tree) -> Seen:
    """Bug 2: a drag in the setup changes nothing, and masses take no ±."""
    plain, _ = tree.measured("plain", tree.setup)
    drag = tree.setup + '\n[model]\neffects = ["gravity", "drag"]\n[model.drag]\n'
    given, told = tree.measured("drag", drag + "drag_coefficient = 0.9\n")
    if not given:
        return True, told.strip().splitlines()[-1][:90]
    values = [found["landing_distance"]["value"] for found in (plain, given)]
    unsure = taken_unsure(tree, '[pendulum]\nmass = "5.46 kg ± 0.05 kg"\n')
    moved = abs(values[0] - values[1]) > 1e-9
    return not moved or "refused" in unsure, f"landing {values[0]:.6f}, {values[1]:.6f} m; {unsure}"


def taken_unsure(tree: Tree, extra: str) -> str:
    """What is said of a setup with something in it, without measuring."""
    file = tree.folder / "unsure.toml"
    file.write_text(extra, encoding="utf-8")
    told = tree.run("simulate", "--setup", str(file), "--ball", "jokku", "--backswing", "60")
    return "mass ± refused" if told.returncode else "mass with its uncertainty taken"


def range_is_launch(tree: Tree) -> Seen:
    """Bug 3: COR by range and by launch are one number."""
    found, _ = tree.measured("plain", tree.setup)
    pair = [found[name]["value"] for name in ("cor_launch", "cor_range")]
    if None in pair:
        return False, "the range is withheld"
    return abs(pair[0] - pair[1]) < 1e-6, f"{pair[0]:.9f}, {pair[1]:.9f}"


def bare_grid(tree: Tree) -> Seen:
    """Bug 4: a grid without a unit ends in a traceback."""
    file = tree.folder / "grid.toml"
    file.write_text(tree.setup.replace('grid = "50 mm"', "grid = 50", 1), encoding="utf-8")
    told = tree.run("measure", str(tree.clip), "--setup", str(file))
    last = (told.stderr.strip().splitlines() or [""])[-1]
    return told.returncode != GRID_MUST_BE_REFUSED, f"exit {told.returncode}: {last[:80]}"


def brackets_vanish(tree: Tree) -> Seen:
    """Bug 5: words in brackets are taken for markup in the table's reasons."""
    _, told = tree.measured(
        "unnamed", tree.setup.replace('preset = "jokku"', 'diameter = "246 mm"')
    )
    line = next((x for x in told.splitlines() if "landing distance, corrected" in x), told[-90:])
    return "[support]" not in line, " ".join(line.strip("│ ").split())[:110]


def wide_clip(tree: Tree) -> Seen:
    """Bug 6: pictures of 32,768 px end in a traceback."""
    folder = tree.folder / "wide"
    folder.mkdir(exist_ok=True)
    noise = np.random.default_rng(1).integers(90, 110, (64, 32768), dtype=np.uint8)
    for k in range(12):
        cv2.imwrite(str(folder / f"{k:03d}.png"), noise)
    told = tree.run("measure", str(folder), "--fps", "600", "--ball", "jokku")
    trace = "Traceback" in told.stderr or told.returncode == 1
    return trace, f"exit {told.returncode}: {(told.stderr.strip().splitlines() or [''])[-1][:80]}"


def sure_of_a_guess(tree: Tree) -> Seen:
    """Bug 7: an assumed rate has the uncertainty of a stated one."""
    found, _ = tree.measured("assumed", tree.setup.replace("capture_fps = 600\n", "", 1))
    base = json.loads((tree.folder / "assumed.json").read_text(encoding="utf-8"))["time_base"]
    std = next((v for k, v in base.items() if k.endswith("std")), None)
    fps = next((v for k, v in base.items() if k.startswith("capture_fps")), None)
    if std is None or fps is None:
        return False, f"rate {fps}, no standard uncertainty; {len(found)} quantities"
    return std < SHARE_OF_ASSUMED_RATE * fps, f"{fps:g} ± {std:g} fps"


def tables_drop_things(tree: Tree) -> Seen:
    """Bug 8: no angle of the pendulum in tracks, no budget in JSON, no reasons in CSV."""
    tree.measured("plain", tree.setup)
    tracks = (tree.folder / "plain.tracks").read_text(encoding="utf-8").splitlines()[0]
    table = (tree.folder / "plain.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    data = json.loads((tree.folder / "plain.json").read_text(encoding="utf-8"))
    lacking = [
        word
        for word, there in (
            ("angle", "phi_rad" in tracks),
            ("budget", "budget" in data),
            ("reasons", any(one.startswith("reason_") for one in table)),
            ("rate", any(one.startswith("capture_fps") for one in table)),
        )
        if not there
    ]
    return bool(lacking), "lacking: " + ", ".join(lacking) if lacking else "all there"


def page_needs_network(tree: Tree) -> Seen:
    """Bug 9: MathJax from a CDN."""
    text = (tree.root / "mkdocs.yml").read_text(encoding="utf-8")
    found = re.findall(r"https?://\S*(?:mathjax|polyfill|cdn)\S*", text)
    return bool(found), ", ".join(found) or "shipped"


def undeclared(tree: Tree) -> Seen:
    """Bug 10: imported and not declared, declared and not imported."""
    project = tomllib.loads((tree.root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[<>=\[ ]", one)[0] for one in project["dependencies"]}
    code = "\n".join(
        path.read_text(encoding="utf-8")
        for room in ("metrology", "physics", "vision", "calib", "mismatch", "pipelines")
        for path in (tree.root / room).rglob("*.py")
    )
    told = [
        f"{name} not declared"
        for name in NOT_DECLARED_BEFORE
        if name not in declared and re.search(rf"^(from|import) {name}\b", code, re.M)
    ]
    if not re.search(r"^\s*(from|import) skimage\b", code, re.M):
        told.append("scikit-image not imported")
    return bool(told), ", ".join(told) or "declared and used"


def drawn_at_random(tree: Tree) -> Seen:
    """Bug 11: the default run draws other examples each time."""
    files = [*(tree.root / "tests").glob("conftest.py"), tree.root / "pyproject.toml"]
    fixed = any("derandomize" in path.read_text(encoding="utf-8") for path in files)
    return not fixed, "derandomised" if fixed else "examples drawn anew in every run"


BUGS: tuple[tuple[str, Callable[[Tree], Seen]], ...] = (
    ("1 the wall's line is left in", prose_decides),
    ("2 drag and ± of the setup", setup_drag_ignored),
    ("3 COR by range is COR by launch", range_is_launch),
    ("4 `grid = 50`", bare_grid),
    ("5 words in brackets vanish", brackets_vanish),
    ("6 pictures of 32,768 px", wide_clip),
    ("7 an assumed rate is sure", sure_of_a_guess),
    ("8 tables drop things", tables_drop_things),
    ("9 MathJax from a CDN", page_needs_network),
    ("10 imports and declarations", undeclared),
    ("11 examples drawn at random", drawn_at_random),
)


def main() -> None:
    """Print one row a bug."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tree", type=Path, default=ROOT, help="source tree to try")
    parser.add_argument("--from", dest="first", type=int, default=1, help="bug to begin with")
    parser.add_argument("--to", dest="last", type=int, default=len(BUGS), help="bug to end with")
    asked = parser.parse_args()
    tree_of = asked.tree.resolve()
    with tempfile.TemporaryDirectory() as folder:
        tree = Tree(tree_of, Path(folder))
        print("| bug | there | seen |\n|---|---|---|")
        for name, tried in BUGS[asked.first - 1 : asked.last]:
            there, seen = tried(tree)
            print(f"| {name} | {'yes' if there else 'no'} | {seen.replace('|', '/')} |", flush=True)


if __name__ == "__main__":
    main()
