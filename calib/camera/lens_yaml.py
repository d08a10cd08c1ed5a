"""Lens files of OpenCV and ROS: YAML, both ways.

OpenCV's ``FileStorage`` writes a YAML 1.0 document with matrices tagged ``opencv-matrix``
(``camera_matrix``, ``distortion_coefficients``); the ROS message CameraInfo, as
``camera_calibration`` stores it, has the same names with plain lists, and a ``distortion_model``.
Both count pixel centres from 0 and have OpenCV's order of coefficients.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from calib.camera.camera import Lens
from calib.camera.lens_fit import FLOOR, LensPrior
from metrology import SetupError

__all__ = ["YAML_SUFFIXES", "lens_yaml", "read_lens_yaml"]

FloatArray = NDArray[np.float64]

YAML_SUFFIXES = (".yaml", ".yml")
_LARGEST = 2**20
"""Bytes: a thousand times what such a file has, so that a clip given by mistake is not read."""
_MOST_NUMBERS = 64
"""Numbers in one entry: the longest of OpenCV, the thin-prism and tilted model, has fourteen."""
_MODELS = ("plumb_bob", "rational_polynomial")
"""Distortion models of ROS that are a lens here; ``equidistant`` is another law."""
SAID_STD: FloatArray = np.array([2e-3, 2.0, 2.0, 5e-3, 1e-2])
"""Of log focal length, principal point (px), k1 and k2 where the file states no uncertainty: what a
dozen pictures of a board give (udacity's 27 pictures of 1280 × 960 px: 1.3e-3, 1.1, 0.9, 2e-3,
3e-3)."""


class _Loader(yaml.SafeLoader):
    """YAML without objects, but for the matrices that OpenCV tags."""


def _matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> Any:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def read_lens_yaml(path: Path) -> LensPrior:
    """Read a lens as OpenCV or ROS wrote it.

    Raises
    ------
    SetupError
        If it can't be read, lacks the camera's matrix or the size of its pictures, or has a
        distortion that is no polynomial or ratio of polynomials.
    """
    table = _document(path)
    camera, bent = _numbers(table, "camera_matrix", path), table.get("distortion_coefficients")
    if camera is None or camera.size != 9:
        raise SetupError(
            f"{path} has no camera_matrix of 3 × 3", hint="Write it with OpenCV or ROS, or TOML."
        )
    model = table.get("distortion_model", _MODELS[0])
    if model not in _MODELS:
        raise SetupError(
            f"{path}: distortion model {model!r} is not known", hint=f"Known: {', '.join(_MODELS)}."
        )
    coefficients = np.zeros(0) if bent is None else _numbers(table, "distortion_coefficients", path)
    assert coefficients is not None
    if coefficients.size > 8 and np.any(coefficients[8:]):
        raise SetupError(f"{path}: thin-prism and tilted-sensor coefficients are not known here")
    try:
        width, height = (int(table[f"image_{name}"]) for name in ("width", "height"))
    except (KeyError, TypeError, ValueError) as problem:
        raise SetupError(
            f"{path} does not say how large its pictures are",
            hint="It needs image_width and image_height.",
        ) from problem
    fx, _, cx, _, fy, cy = camera.ravel()[:6]
    lens = Lens(width, height, fx, fy, cx, cy, *coefficients[:8].tolist())
    if width < 1 or height < 1 or fx <= 0.0 or fy <= 0.0:
        raise SetupError(f"{path}: a picture or a focal length is not positive")
    return LensPrior(lens, np.maximum(_std(table, lens, path), FLOOR))


def _document(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _LARGEST:
            raise SetupError(f"{path} is too large for a lens file")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise SetupError(f"can't read the lens file {path}: {problem}") from problem
    # OpenCV's "%YAML:1.0" is no directive of YAML
    text = re.sub(r"\A%YAML[^\n]*\n", "", text.lstrip("\ufeff"))
    try:
        table = yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        raise SetupError(f"{path} is no YAML: {problem}") from problem
    if not isinstance(table, dict):
        raise SetupError(f"{path} is no lens file", hint="It holds no table of names.")
    return table


def _numbers(table: dict[str, Any], name: str, path: Path) -> FloatArray | None:
    """A matrix as flat numbers, as OpenCV or ROS has it, or a plain (nested) list."""
    held = table.get(name)
    if held is None:
        return None
    if isinstance(held, dict):
        held = held.get("data")
    rows: list[Any] = held if isinstance(held, list) else [held]
    # two levels and no more: references of YAML within references unfold without end
    flat = [one for row in rows for one in (row if isinstance(row, list) else [row])]
    if len(flat) > _MOST_NUMBERS or any(isinstance(one, list | dict) for one in flat):
        raise SetupError(f"{path}: {name} is no matrix of a lens")
    try:
        values = np.array([float(one) for one in flat])
    except (TypeError, ValueError) as problem:
        raise SetupError(f"{path}: {name} is no matrix of numbers") from problem
    if not np.isfinite(values).all():
        raise SetupError(f"{path}: {name} is not finite")
    return values


def _std(table: dict[str, Any], lens: Lens, path: Path) -> FloatArray:
    """Of log focal length, principal point, k1 and k2: as OpenCV's ``stdDeviationsIntrinsics``."""
    stated = _numbers(table, "std_deviation_intrinsics", path)
    if stated is None or stated.size < 6:
        return SAID_STD
    fx, _, cx, cy, k1, k2 = stated[:6]
    return np.array([fx / lens.fx, cx, cy, k1, k2])


def lens_yaml(prior: LensPrior, name: str = "camera") -> str:
    """Text of a lens file that OpenCV's FileStorage and ROS both read.

    Parameters
    ----------
    prior : LensPrior
    name : str
        Of the camera, as ROS wants one.
    """
    lens = prior.lens
    bent = lens.coefficients
    model = _MODELS[1] if bent.size > 5 else _MODELS[0]
    focal, cx, cy, k1, k2 = prior.std.tolist()
    std = [focal * lens.fx, focal * lens.fy, cx, cy, k1, k2]
    projection = np.hstack([lens.matrix, np.zeros((3, 1))])
    parts = [
        "%YAML:1.0",
        "---",
        f"image_width: {lens.width}",
        f"image_height: {lens.height}",
        f"camera_name: {name}",
        f"distortion_model: {model}",
        _matrix_text("camera_matrix", lens.matrix),
        _matrix_text("distortion_coefficients", bent[np.newaxis]),
        _matrix_text("rectification_matrix", np.eye(3)),
        _matrix_text("projection_matrix", projection),
        "# of fx fy cx cy k1 k2, as calibrateCamera gives them",
        _matrix_text("std_deviation_intrinsics", np.array([std])),
    ]
    return "\n".join(parts) + "\n"


def _matrix_text(name: str, values: FloatArray) -> str:
    listed = ", ".join(repr(float(value)) for value in np.ravel(values))
    rows, columns = values.shape
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
        f"   data: [{listed}]"
    )
