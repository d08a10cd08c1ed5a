"""Files of a calibration: setup.toml, and lens.toml with the view of the wall."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomli_w

from calib.calibration import Calibration
from calib.grid import GridMap, WallGrid
from calib.lens import LENS_PARAMETERS, MIN_LENS_STD
from metrology import SetupError, UsageError, refuse_unwritable, write_text_whole, written_whole
from pipelines.calibrate.answers import Answers
from pipelines.calibrate.outlook import Outlook

__all__ = ["Written", "lens_for", "read_view", "save", "setup_text"]

LENS_NAME = "lens.toml"

VIEW_HEADING = "[view]"


@dataclass(frozen=True)
class Written:
    """Files that were written; no lens file where the scene has no wall grid."""

    setup: Path
    lens: Path | None

    def __str__(self) -> str:
        """Names of the files."""
        return " and ".join(str(one) for one in (self.setup, self.lens) if one is not None)


def save(answers: Answers, outlook: Outlook) -> Written:
    """Write both files, or none; without a wall grid only the setup file.

    Parameters
    ----------
    outlook : Outlook
        Of these answers.

    Raises
    ------
    UsageError
        If nothing is calibrated yet, or a file can't be written.
    """
    found = outlook.calibration
    if found is None and (answers.grid is not None or not answers.document):
        raise UsageError(
            f"nothing is calibrated yet: {outlook.problem}",
            hint="Find the wall grid first, or give rate and ball."
            if answers.grid is None
            else "Correct that input; then save again.",
        )
    text = setup_text(answers, outlook)
    refuse_unwritable(answers.out)
    if found is None or answers.grid is None:
        write_text_whole(answers.out, text)
        return Written(answers.out, None)
    lens = lens_for(answers.out)
    lens_text = _lens_text(answers, found) + _view_text(answers.grid)
    # Both contents are on the disk before either file gets its name.
    with written_whole(lens) as lens_file, written_whole(answers.out) as setup_file:
        lens_file.write_text(lens_text, encoding="utf-8")
        setup_file.write_text(text, encoding="utf-8")
    return Written(answers.out, lens)


def lens_for(setup: Path) -> Path:
    """The lens file that belongs to a setup file."""
    return setup.parent / LENS_NAME


def setup_text(answers: Answers, outlook: Outlook) -> str:
    """Text of the setup file."""
    name = "".join(one if one.isprintable() else "?" for one in answers.scene.info.path.name)
    lines = [f"# Written by `vision calibrate {name}`."]
    if outlook.std is not None and outlook.distance is not None:
        where = "assumed landing" if outlook.assumed else "landing"
        lines.append(
            f"# Expected: {where} {outlook.distance:.3f} m from rest, "
            f"± {1e3 * outlook.std:.1f} mm from the calibration."
        )
    if not answers.rate.known:
        lines.append("# Not given: [camera] capture_fps. Every time and speed scales with it.")
    document = dict(answers.document)
    if answers.lens is not None:
        document["camera"] = {**document["camera"], "lens": LENS_NAME}
    else:
        lines += [
            "# The grid of each clip determines the lens. For clips that show less of the grid:",
            f'# [camera] lens = "{LENS_NAME}"',
        ]
    return "\n".join(lines) + "\n" + tomli_w.dumps(document)


def _lens_text(answers: Answers, calibration: Calibration) -> str:
    if answers.setup.camera.lens is not None:
        text = answers.setup.camera.lens.read_text(encoding="utf-8")
        return text.split(VIEW_HEADING, 1)[0].rstrip() + "\n"
    lens = calibration.grid_camera.lens
    covariance = calibration.covariance[6:11, 6:11]
    std = np.maximum(np.sqrt(np.diag(covariance)), MIN_LENS_STD)
    related = covariance / np.outer(std, std)
    np.fill_diagonal(related, 1.0)
    own = {"fx": lens.fx * std[0], "fy": lens.fy * std[0]}
    own |= dict(zip(("cx", "cy", "k1", "k2"), std[1:].tolist(), strict=True))
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {float(getattr(lens, name))!r}" for name in LENS_PARAMETERS]
    lines += ["", "[std]", *(f"{name} = {float(value)!r}" for name, value in own.items())]
    lines += [
        "",
        "[prior]",
        "# in log focal length, principal point x and y (px), k1 and k2",
        f"std = {std.tolist()!r}",
        f"correlation = {np.round(related, 9).tolist()!r}",
        "",
        "[quality]",
        'model = "from the straight lines of the wall grid"',
    ]
    return "\n".join(lines) + "\n"


def _view_text(grid: WallGrid) -> str:
    """The wall as seen by the camera, to detect later camera moves."""
    variance = float(np.median(np.trace(grid.covariance_px2, axis1=1, axis2=2)))
    return "\n".join(
        [
            "",
            VIEW_HEADING,
            "# position of the wall's grid in the image, for `vision calibrate check`",
            f"size = {list(grid.size)!r}",
            f"pitch_m = {grid.pitch_m!r}",
            f"centre = {grid.map.centre.tolist()!r}",
            f"scale = {grid.map.scale.tolist()!r}",
            f"parameters = {grid.map.parameters.tolist()!r}",
            f"variance_px2 = {variance / len(grid.nodes)!r}",
            "",
        ]
    )


def read_view(lens: Path) -> WallGrid:
    """The view of the wall stored in a lens file; its map only, no crossings.

    Raises
    ------
    SetupError
        If the file is missing or contains no view.
    """
    try:
        view = tomllib.loads(lens.read_text(encoding="utf-8"))["view"]
        arrays = (np.array(view[key], float) for key in ("centre", "scale", "parameters"))
        grid_map = GridMap(*arrays)
        size = (int(view["size"][0]), int(view["size"][1]))
        pitch, variance = float(view["pitch_m"]), float(view["variance_px2"])
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, IndexError) as problem:
        raise SetupError(
            f"{lens} does not contain the camera's view of the wall",
            hint="`vision calibrate CLIP` writes it next to the setup file; or compare two clips: "
            "`vision calibrate check NEW_CLIP --against OLD_CLIP`.",
        ) from problem
    return WallGrid(
        size=size,
        pitch_m=pitch,
        nodes=np.zeros((1, 2), dtype=np.int64),
        points_px=np.zeros((1, 2)),
        covariance_px2=0.5 * variance * np.eye(2)[np.newaxis],
        map=grid_map,
        area=np.zeros(size[::-1], dtype=bool),
        dark=True,
        fine_ratio=None,
        origin_m=np.zeros(2),
    )
