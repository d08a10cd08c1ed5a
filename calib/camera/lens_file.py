"""`lens.toml`: a lens written down, with its uncertainties; and the board to print."""

import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calib.camera.camera import Lens
from calib.camera.lens import Board, LensCalibration
from calib.camera.lens_fit import NAMES
from calib.camera.lens_prior import FLOOR, LensPrior
from metrology import SetupError, write_text_whole, written_whole

__all__ = ["lens_toml", "read_lens", "write_board", "write_lens"]

A4_M = (0.297, 0.210)


def lens_toml(calibration: LensCalibration) -> str:
    """Text of a lens file."""
    lens = calibration.lens
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {getattr(lens, name)!r}" for name in NAMES]
    lines += ["", "[std]"]
    lines += [f"{name} = {calibration.std.get(name, 0.0)!r}" for name in NAMES]
    lines += [
        "",
        "[prior]",
        "# what it all amounts to in log focal length, principal point x and y (px), k1 and k2",
        f"std = {calibration.prior.std.tolist()!r}",
        f"correlation = {np.round(calibration.prior.related, 9).tolist()!r}",
        "",
        "[quality]",
        f'model = "{calibration.model}"',
        f"held_out_rms_px = {calibration.held_out_rms_px!r}",
        f"views = {len(calibration.used)}",
        f"coverage = {calibration.coverage!r}",
    ]
    return "\n".join(lines) + "\n"


def write_lens(path: Path, calibration: LensCalibration) -> None:
    """Write a lens file, whole or not at all."""
    write_text_whole(path, lens_toml(calibration))


def read_lens(path: Path, *, width: int | None = None, height: int | None = None) -> LensPrior:
    """Read a lens file for a picture of the given size.

    Parameters
    ----------
    path : Path
    width, height : int, optional
        Size of the clip's picture; the lens is scaled to it. The clip must show the whole picture.

    Raises
    ------
    SetupError
        If the file is missing or wrong, or its picture has another shape.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise SetupError(
            f"can't read the lens file {path}: {problem.strerror}",
            hint="Write one with `vision calibrate lens`.",
        ) from problem
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise SetupError(
            f"{path} is no lens file: {problem}", hint="Write one with `vision calibrate lens`."
        ) from problem
    numbers = table.get("lens", {})
    missing = [n for n in ("width", "height", *NAMES[:4]) if n not in numbers]
    if missing:
        raise SetupError(
            f"{path} lacks {', '.join(missing)} in its table [lens]",
            hint="Write it anew with `vision calibrate lens`.",
        )
    lens = Lens(
        int(numbers["width"]),
        int(numbers["height"]),
        *(float(numbers.get(name, 0.0)) for name in NAMES),
    )
    prior = _prior(lens, table, path)
    if width is None or height is None:
        return prior
    if abs(width / height - lens.width / lens.height) > 0.01 * width / height:
        raise SetupError(
            f"the lens was calibrated at {lens.width}×{lens.height} px, the clip has "
            f"{width}×{height}: another shape",
            hint="Calibrate in the mode the clip is filmed in: other modes crop the sensor.",
        )
    return prior.resized(width, height)


def _prior(lens: Lens, table: dict[str, Any], path: Path) -> LensPrior:
    """Uncertainty as the file has it: with correlations, or of each parameter by itself."""
    given = table.get("prior", {})
    if "std" in given and "correlation" in given:
        std, related = (np.asarray(given[key], dtype=float) for key in ("std", "correlation"))
        if std.shape != (5,) or related.shape != (5, 5):
            raise SetupError(
                f"the table [prior] of {path} needs 5 and 5 × 5 numbers",
                hint="Write it anew with `vision calibrate lens`.",
            )
        return LensPrior(lens, np.maximum(std, FLOOR), related)
    own = {name: float(table.get("std", {}).get(name, 0.0)) for name in NAMES}
    spread = [own["fx"] / lens.fx, own["cx"], own["cy"], own["k1"], own["k2"]]
    return LensPrior(lens, np.maximum(np.array(spread), FLOOR))


def write_board(path: Path, board: Board) -> None:
    """Write a board to print at 100 % on A4 paper, as PDF.

    Raises
    ------
    SetupError
        If the board does not fit the paper.
    """
    size = np.array([board.columns + 1, board.rows + 1]) * board.square_m
    if np.any(size > np.array(A4_M) - 0.01):
        raise SetupError(
            f"a board of {1e3 * size[0]:.0f} × {1e3 * size[1]:.0f} mm does not fit A4 paper",
            hint="Choose fewer or smaller squares.",
        )
    cells = (board.columns + 1, board.rows + 1)
    pixels = (cells[0] * 96, cells[1] * 96)
    if board.charuco:
        picture = np.asarray(board.opencv().generateImage(pixels))
    else:
        parity = np.add.outer(np.arange(cells[1]), np.arange(cells[0])) % 2
        small = (255 * parity).astype(np.uint8)
        picture = np.asarray(cv2.resize(small, pixels, interpolation=cv2.INTER_NEAREST))
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.hashsalt": "board"}):
        figure = Figure(figsize=(A4_M[0] / 0.0254, A4_M[1] / 0.0254))
        left, bottom = (np.array(A4_M) - size) / 2.0 / A4_M
        axes = figure.add_axes((left, bottom, size[0] / A4_M[0], size[1] / A4_M[1]))
        axes.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest", aspect="auto")
        axes.set_axis_off()
        note = f"print at 100 %; each square {1e3 * board.square_m:g} mm; measure it before use"
        figure.text(0.5, 0.015, note, ha="center", fontsize=7)
        with written_whole(path) as temporary:
            figure.savefig(temporary, format="pdf")
