"""Lens files of OpenCV and ROS, written and read by OpenCV."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from calib.camera import Lens
from calib.lens import LensPrior, lens_yaml, prior_toml, read_lens
from metrology import SetupError

LENS = Lens(1280, 960, 560.1, 561.2, 640.3, 478.9, -0.233, 0.062, 1e-4, -2e-4, 1e-3)
STD = np.array([1e-3, 0.8, 0.9, 2e-3, 3e-3])
# as ROS' camera_calibration stores it
ROS = """image_width: 1280
image_height: 960
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [560.1, 0.0, 640.3, 0.0, 561.2, 478.9, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.233, 0.062, 0.0001, -0.0002, 0.001]
"""


def test_opencv_reads_what_is_written(tmp_path) -> None:
    path = tmp_path / "lens.yaml"
    path.write_text(lens_yaml(LensPrior(LENS, STD)))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("camera_matrix").mat() == pytest.approx(LENS.matrix)
    assert storage.getNode("distortion_coefficients").mat().ravel() == pytest.approx(
        LENS.coefficients
    )
    assert storage.getNode("image_width").real() == 1280
    back = read_lens(path, width=640, height=480)
    assert back.lens.fx == pytest.approx(0.5 * LENS.fx)
    assert read_lens(path).std == pytest.approx(STD)


def test_files_of_opencv_and_ros_are_read(tmp_path) -> None:
    path = tmp_path / "cv.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1280)
    storage.write("image_height", 960)
    storage.write("camera_matrix", LENS.matrix)
    storage.write("distortion_coefficients", LENS.coefficients.reshape(-1, 1))
    storage.release()
    assert read_lens(path).lens == LENS
    ros = tmp_path / "ros.yaml"
    ros.write_text(ROS)
    assert read_lens(ros).lens == LENS
    assert (read_lens(ros).std > 1e-4).all()


def test_a_lens_goes_to_toml_and_back(tmp_path) -> None:
    path = tmp_path / "lens.toml"
    path.write_text(prior_toml(LensPrior(LENS, STD)))
    assert read_lens(path).lens == LENS
    assert read_lens(path).std == pytest.approx(STD)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not a lens file"),
        ("a: [", "not YAML"),
        ("a: !!python/object/apply:os.system [ls]", "not YAML"),
        (ROS.replace("plumb_bob", "equidistant"), "equidistant"),
        (ROS.replace("image_width: 1280\n", ""), "the size of"),
        (ROS.replace("data: [560.1", "data: [x"), "not a matrix"),
        (ROS.replace("rows: 3\n  cols: 3\n  data: [560.1, 0.0,", "data: [560.1,"), "3 × 3"),
        (
            "a: &a [1, 1, 1]\n"
            + "".join(f"{b}: &{b} [{f'*{a},' * 9}]\n" for a, b in pairwise("abcdefghij"))
            + "camera_matrix: *j\n",
            "not a matrix",
        ),
    ],
)
def test_broken_and_hostile_files_are_refused(text, said, tmp_path) -> None:
    path = tmp_path / "lens.yaml"
    path.write_text(text)
    with pytest.raises(SetupError, match=said):
        read_lens(path)
