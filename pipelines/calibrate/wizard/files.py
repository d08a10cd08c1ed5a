"""`setup.toml` and `lens.toml`: the answers written down, and the wall as the camera saw it."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.camera.lens_fit import NAMES
from calib.camera.lens_prior import FLOOR
from calib.evidence import Known
from calib.grid.grid import WallGrid
from calib.grid.phase import GridMap
from metrology import SetupError, UsageError, write_text_whole
from pipelines.calibrate.wizard.answers import Answers
from pipelines.calibrate.wizard.outlook import Outlook

__all__ = ["Written", "lens_beside", "read_view", "save", "setup_text"]

FloatArray = NDArray[np.float64]

VIEW = "[view]"


@dataclass(frozen=True)
class Written:
    """Files that were written."""

    setup: Path
    lens: Path


def save(
    answers: Answers, outlook: Outlook, check: Callable[[str, Path], None] | None = None
) -> Written:
    """Write both files, each whole or not at all.

    Parameters
    ----------
    answers : Answers
    outlook : Outlook
        Of these answers.
    check : callable, optional
        Called with the setup file's text and its folder; raises if it would not be read.

    Raises
    ------
    UsageError
        If nothing is calibrated yet, or a file can't be written.
    """
    if answers.grid is None or outlook.calibration is None:
        raise UsageError(
            f"nothing is calibrated yet: {outlook.problem}", hint="Find the wall grid first."
        )
    text = setup_text(answers, outlook)
    if check is not None:
        check(text, answers.out.parent)
    lens = lens_beside(answers.out)
    write_text_whole(lens, _lens_text(answers, outlook.calibration) + _view_text(answers.grid))
    write_text_whole(answers.out, text)
    return Written(answers.out, lens)


def lens_beside(setup: Path) -> Path:
    """The lens file that goes with a setup file."""
    return setup.parent / "lens.toml"


def setup_text(answers: Answers, outlook: Outlook) -> str:
    """Text of the setup file."""
    lines = [f"# Written by `vision calibrate {_comment(answers.scene.info.path.name)}`."]
    if outlook.std is not None and outlook.distance is not None:
        where = "a supposed landing" if outlook.supposed else "landing"
        lines.append(
            f"# Expected: {where} {outlook.distance:.3f} m from rest, "
            f"± {1e3 * outlook.std:.1f} mm from the calibration."
        )
    lines += ["[camera]"]
    if answers.rate_known:
        lines.append(f"capture_fps = {answers.capture_fps!r}")
    else:
        lines.append("# capture_fps = 600   # not known; every time and speed scales with it")
    if answers.camera_distance is not None:
        lines.append(f'distance_to_wall = "{_taped(answers.camera_distance)}"')
    if answers.lens is not None:
        lines.append('lens = "lens.toml"')
    else:
        lines += [
            "# The grid of each clip tells the lens anew. For clips that show less of it:",
            '# lens = "lens.toml"',
        ]
    lines += ["", "[wall]", f'grid = "{_millimetres(answers.pitch)}"']
    if answers.fine_pitch is not None:
        lines.append(f'fine_grid = "{_millimetres(answers.fine_pitch)}"')
    if answers.ball_plane_offset is not None:
        lines.append(f'ball_plane_offset = "{_taped(answers.ball_plane_offset)}"')
    if answers.ball is not None:
        lines += ["", "[ball]"]
        if answers.ball_named:
            lines.append(f'preset = "{answers.ball.name}"')
        else:
            lines.append(f'diameter = "{_millimetres(answers.ball.diameter)}"')
            if answers.ball.mass is not None:
                lines.append(f'mass = "{answers.ball.mass:g} kg"')
    if answers.support_height is not None:
        lines += ["", "[support]", f'height = "{answers.support_height:.10g} m"']
    return "\n".join(lines) + "\n"


def _comment(text: str) -> str:
    """Fit for a comment: on one line."""
    return "".join(character if character.isprintable() else "?" for character in text)


def _millimetres(length: float) -> str:
    return f"{1e3 * length:.10g} mm"


def _taped(known: Known) -> str:
    return f"{known.value:.10g} m ± {1e3 * known.std:.6g} mm"


def _lens_text(answers: Answers, calibration: Calibration) -> str:
    if answers.lens is not None:
        return answers.lens.text.split(VIEW, 1)[0].rstrip() + "\n"
    lens = calibration.grid_camera.lens
    covariance = calibration.covariance[6:11, 6:11]
    std = np.maximum(np.sqrt(np.diag(covariance)), FLOOR)
    related = covariance / np.outer(std, std)
    np.fill_diagonal(related, 1.0)
    own = {"fx": lens.fx * std[0], "fy": lens.fy * std[0]}
    own |= dict(zip(("cx", "cy", "k1", "k2"), std[1:].tolist(), strict=True))
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {float(getattr(lens, name))!r}" for name in NAMES]
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
    """The wall as the camera saw it, to tell later whether the camera moved."""
    variance = float(np.median(np.trace(grid.covariance_px2, axis1=1, axis2=2)))
    return "\n".join(
        [
            "",
            VIEW,
            "# where the wall's grid was in the picture, for `vision calibrate --check`",
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
    """The wall as it was seen when a lens file was written; its map only, no crossings.

    Raises
    ------
    SetupError
        If the file is missing or holds no view.
    """
    try:
        view = tomllib.loads(lens.read_text(encoding="utf-8"))["view"]
        arrays = (np.array(view[key], float) for key in ("centre", "scale", "parameters"))
        grid_map = GridMap(*arrays)
        size = (int(view["size"][0]), int(view["size"][1]))
        pitch, variance = float(view["pitch_m"]), float(view["variance_px2"])
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, IndexError) as problem:
        raise SetupError(
            f"{lens} does not hold how the camera saw the wall",
            hint="`vision calibrate CLIP` writes it beside the setup file; or compare two clips: "
            "`vision calibrate check NEW_CLIP --against OLD_CLIP`.",
        ) from problem
    return WallGrid(
        size=size,
        pitch_m=pitch,
        nodes=np.zeros((1, 2), dtype=np.int64),
        points_px=np.zeros((1, 2)),
        covariance_px2=0.5 * variance * np.eye(2)[np.newaxis],
        residual_px=np.zeros((1, 2)),
        map=grid_map,
        area=np.zeros(size[::-1], dtype=bool),
        dark=True,
        fine_ratio=None,
        origin_m=np.zeros(2),
    )
