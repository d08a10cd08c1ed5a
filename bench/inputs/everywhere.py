"""Ask every command and page about the same wrong inputs, and compare the findings.

Run: python -m bench.inputs.everywhere [--json FILE]

An answer is *the same* if it blames the wrong input and its cure is the one expected. Tests run the
same questions.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from typer.testing import CliRunner

import impact_vision as iv
from metrology import ImpactVisionError, write_text_whole
from pipelines.app.corrections import ClipInputs
from pipelines.app.session import AppSession
from pipelines.calibrate.command import find_unattended
from pipelines.calibrate.session import session_of
from pipelines.cli import app

__all__ = ["ASKED", "CLIP_FOLDER", "WRONG", "Lab", "is_same"]

CLIP_FOLDER = Path(__file__).parents[2] / "sample_videos" / "clips"


@dataclass(frozen=True)
class Lab:
    """A set-up with one wrong value, and what the finding must say.

    Attributes
    ----------
    fps, grid, camera, ball : str
        As entered.
    blamed, cure : str
        Words of the finding.
    in_python : str
        The cure where it names a Python argument; otherwise as `cure`.
    """

    fps: str = "600"
    grid: str = "50 mm"
    camera: str = "4.601 m ± 5 mm"
    ball: str = "201.75 mm"
    clip: str = "jokku_90_small.mp4"
    blamed: str = ""
    cure: str = ""
    in_python: str = ""

    @property
    def path(self) -> Path:
        """The clip."""
        return CLIP_FOLDER / self.clip

    def setup(self, folder: Path) -> Path:
        """Write it as a set-up file."""
        path = folder / "lab.toml"
        path.write_text(
            f'[camera]\ncapture_fps = {self.fps}\ndistance_to_wall = "{self.camera}"\n'
            f'[wall]\ngrid = "{self.grid}"\nball_plane_offset = "0.444 m ± 5 mm"\n'
            f'[ball]\nmass = "0.353 kg"\ndiameter = "{self.ball}"\n',
            encoding="utf-8",
        )
        return path

    def options(self) -> dict[str, str]:
        """The same as options of the calibration."""
        return {
            "fps": self.fps,
            "wall_grid": self.grid,
            "camera_distance": self.camera,
            "ball_plane": "0.444 m ± 5 mm",
            "ball": f"{self.ball}, 0.353 kg",
        }


WRONG = {
    "tape 1.6 m too short": Lab(
        clip="jokku_120.mp4",
        camera="3.0 m ± 5 mm",
        blamed="one of the two distances",
        cure='distance_to_wall = "4.',
    ),
    "tape 2.4 m too short": Lab(
        # 4.6 m in truth, found to a tenth
        camera="2.2 m ± 5 mm",
        blamed="one of the two distances",
        cure='distance_to_wall = "',
    ),
    "30 fps for 600": Lab(
        fps="30", blamed="the capture rate", cure="--fps 600", in_python="fps=600"
    ),
    "grid of 40 mm": Lab(
        grid="40 mm",
        blamed="the wall grid",
        cure="--wall-grid 50mm",
        in_python='wall_grid="50mm"',
    ),
    "ball of 246 mm": Lab(
        ball="246 mm",
        blamed="the ball's diameter",
        cure="mm instead of 246 mm everything fits",
    ),
}


def _printed(*words: str) -> str:
    return CliRunner().invoke(app, list(words)).output


def _by_command(name: str) -> Callable[[Lab, Path], str]:
    return lambda lab, folder: _printed(name, str(lab.path), "--setup", str(lab.setup(folder)))


def _by_campaign(lab: Lab, folder: Path) -> str:
    out, setup = str(folder / "out"), str(lab.setup(folder))
    return _printed("campaign", str(lab.path), "--setup", setup, "--out", out, "-j", "1")


def _by_calibrate(lab: Lab, folder: Path) -> str:
    options = [w for k, v in lab.options().items() for w in (f"--{k.replace('_', '-')}", v)]
    out = str(folder / "new.toml")
    return _printed("calibrate", str(lab.path), "--yes", "--out", out, *options)


def _by_measure_in_python(lab: Lab, folder: Path) -> str:
    return " ".join(iv.measure(lab.path, setup=lab.setup(folder)).warnings)


def _by_calibrate_in_python(lab: Lab, folder: Path) -> str:
    try:
        return " ".join(iv.calibrate(lab.path, **lab.options()).warnings)
    except ImpactVisionError as problem:
        return str(problem)


def _by_wizard(lab: Lab, folder: Path) -> str:
    session = session_of(lab.path, folder / "new.toml", **lab.options())
    try:
        find_unattended(session)
    except ImpactVisionError as problem:
        return str(problem)
    return " ".join((session.outlook.problem, *session.outlook.warnings))


def _by_page(lab: Lab, folder: Path) -> str:
    """The contradictions that the page of a clip lists, with their buttons."""
    place = folder / lab.clip
    if not place.exists():
        place.symlink_to(lab.path)
    session = AppSession()
    try:
        clip = session.open_clip(place, ClipInputs(setup=lab.setup(folder).name))
        while clip.busy:
            time.sleep(0.1)
        found = () if clip.measured is None else clip.measured.findings
        return " ".join(one.sentence for one in found)
    finally:
        session.end()


ASKED: Mapping[str, Callable[[Lab, Path], str]] = {
    "measure": _by_command("measure"),
    "landing": _by_command("landing"),
    "campaign": _by_campaign,
    "calibrate --yes": _by_calibrate,
    "wizard": _by_wizard,
    "page": _by_page,
    "iv.measure": _by_measure_in_python,
    "iv.calibrate": _by_calibrate_in_python,
}
"""What people ask, by name."""


def is_same(name: str, lab: Lab, said: str) -> bool:
    """Whether an answer blames the wrong input, and states the cure first."""
    said = " ".join(said.split())
    if f"Likely cause: {lab.blamed}" not in said:
        return False
    cause = said.split("Likely cause: ", 1)[1].split("Less likely")[0]
    return (lab.in_python if name.startswith("iv.") and lab.in_python else lab.cure) in cause


def main() -> None:
    """Ask all, print, count."""
    parser = argparse.ArgumentParser(prog="python -m bench.inputs.everywhere")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    same: dict[str, list[str]] = {}
    print("| wrong input | " + " | ".join(ASKED) + " |\n|---" + "|---" * len(ASKED) + "|")
    for wrong, lab in WRONG.items():
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            same[wrong] = [
                name for name, ask in ASKED.items() if is_same(name, lab, ask(lab, place))
            ]
        cells = ("same" if name in same[wrong] else "other" for name in ASKED)
        print(f"| {wrong} | " + " | ".join(cells) + " |", flush=True)
    if asked.json is not None:
        counts = {"asked": len(ASKED) * len(WRONG), "same": sum(map(len, same.values()))}
        write_text_whole(asked.json, json.dumps(counts, indent=1) + "\n")


if __name__ == "__main__":
    main()
