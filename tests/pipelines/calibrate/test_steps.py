"""The wizard's answers, what they amount to, and the files they become."""

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calib.camera import Camera, Lens
from calib.grid import WallGrid
from calib.lens import read_lens
from calib.solve import camera_movement
from measuring.setup.file import load_setup
from metrology import CalibrationError, ClipError, SetupError, UsageError
from pipelines.app.pages.setup import python_of
from pipelines.calibrate.answers import (
    ANSWER_OPTIONS,
    Answers,
    StillScene,
    answered,
    open_scene,
    point_from,
    text_of,
)
from pipelines.calibrate.corners import grid_from_corners, starting_corners
from pipelines.calibrate.drawing import grid_lines, shaded_map
from pipelines.calibrate.outlook import compare_length, length_between, outlook
from pipelines.calibrate.saving import read_view, save, setup_text
from pipelines.calibrate.session import Session, with_corners, with_grid
from pipelines.web import Jobs
from tests.calib.synthetic import rendered

SIZE = (320, 180)
CAMERA = Camera.facing_wall(Lens.centred(*SIZE, 380.0), [0.9, 0.5, 2.0], yaw=0.15)
BALL = "200 mm, 0.4 kg"


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clip")
    for index in range(3):
        picture = rendered(CAMERA, seed=index, samples=2)
        cv2.imwrite(str(folder / f"frame{index:03d}.png"), picture.astype(np.uint8))
    return folder


@pytest.fixture(scope="module")
def calibrated(clip: Path) -> Answers:
    return with_grid(typed(Answers(open_scene(clip)), wall_grid="50 mm", ball=BALL))


def typed(answers: Answers, **texts: str) -> Answers:
    for name, text in texts.items():
        answers = answered(answers, name, text)
    return answers


def test_the_page_gives_the_same_calibration_in_python(calibrated: Answers, clip: Path) -> None:
    namespace: dict[str, Any] = {}
    answers = typed(calibrated, pendulum_mass="2 kg")
    exec(python_of(answers).removesuffix("print(c)"), namespace)
    said = namespace["c"]._session.answers
    for name in ANSWER_OPTIONS:
        assert text_of(said, name) == text_of(calibrated, name)


def grid_of(answers: Answers) -> WallGrid:
    assert answers.grid is not None
    return answers.grid


def std_of(answers: Answers) -> float:
    std = outlook(answers).std
    assert std is not None
    return std


def test_every_answer_narrows_the_landing(calibrated: Answers) -> None:
    rest = CAMERA.project([0.5, 0.5, 0.4])
    landing = CAMERA.project([1.2, 0.3, 0.4])
    told = replace(calibrated, rest_px=rest, landing_px=landing)
    far = typed(told, camera_distance="2 m ± 5 mm")
    both = typed(far, ball_plane="0.4 m ± 5 mm")
    assert std_of(both) < std_of(far) <= 1.001 * std_of(told)
    found = outlook(both)
    assert found.distance == pytest.approx(0.7, abs=4.0 * std_of(both) + 0.002)
    assert not found.assumed
    assert outlook(calibrated).assumed
    largest = [line.std for line in found.budget]
    assert largest == sorted(largest, reverse=True)


def test_no_grid_no_number(clip: Path) -> None:
    found = outlook(Answers(open_scene(clip)))
    assert found.calibration is None
    assert found.std is None
    assert "wall grid" in found.problem


def test_corners_put_roughly_measure_the_same_grid(calibrated: Answers) -> None:
    grid = grid_of(calibrated)
    nodes = np.array([[-8, -5], [9, -5], [9, 5], [-8, 5]])
    true = grid.map.inverse(nodes.astype(float), starting_corners(None, SIZE))
    shaken = true + np.random.default_rng(3).normal(0.0, 0.7, (4, 2))
    again = with_corners(replace(calibrated, corners=shaken, squares=(17, 10)))
    assert again.grid_source == "corners"
    measured = grid_of(again)
    place = measured.map.inverse(np.array([[4.0, 3.0]]), true.mean(axis=0)[np.newaxis])
    assert np.abs(measured.to_wall(place) - [0.2, 0.15]).max() < 1e-6
    there = grid.map(place) - nodes[0]
    assert np.abs(there - [4.0, 3.0]).max() < 0.05


def test_corners_without_lines_between_them_are_the_grid_themselves() -> None:
    corners = np.array([[40.0, 150.0], [280.0, 150.0], [280.0, 30.0], [40.0, 30.0]])
    plain = np.random.default_rng(0).normal(128.0, 2.0, SIZE[::-1])
    grid, source = grid_from_corners(plain, corners, (10, 5), pitch_m=0.05, fine_pitch_m=None)
    assert source == "hand"
    assert np.allclose(grid.to_wall(corners), [[0, 0], [0.5, 0], [0.5, 0.25], [0, 0.25]])
    assert "by hand" in grid.warnings[0]


@pytest.mark.parametrize("order", [[1, 0, 2, 3], [0, 2, 1, 3], [3, 2, 1, 0]])
def test_corners_out_of_order_are_refused(order: list[int]) -> None:
    corners = np.array([[40.0, 150.0], [280.0, 150.0], [280.0, 30.0], [40.0, 30.0]])[order]
    with pytest.raises(UsageError, match="out of order"):
        grid_from_corners(np.zeros(SIZE[::-1]), corners, (10, 5), pitch_m=0.05, fine_pitch_m=None)


def test_a_known_length_agrees_or_does_not(calibrated: Answers) -> None:
    found = outlook(typed(calibrated, camera_distance="2 m ± 5 mm")).calibration
    assert found is not None
    ends = CAMERA.project([[0.6, 0.5, 0.0], [1.1, 0.5, 0.0]])
    length = length_between(found, ends[0], ends[1], on_wall=True)
    assert abs(length.value - 0.5) < 3.0 * length.std
    assert 1e-4 < length.std < 0.01
    assert "agrees" in compare_length(found, ends[0], ends[1], "50 cm", on_wall=True).text
    assert compare_length(found, ends[0], ends[1], "0.6 m", on_wall=True).disagrees
    assert compare_length(found, ends[0], ends[1], "long", on_wall=True).disagrees


def test_both_files_are_written_and_read_back(calibrated: Answers, tmp_path: Path) -> None:
    out = tmp_path / "setup.toml"
    begun = replace(calibrated, out=out, document={**calibrated.document, "air": {"humidity": 0.4}})
    answers = typed(begun, fps="480", camera_distance="2.000 m ± 3 mm", support_height="0.3 m")
    written = save(answers, outlook(answers))
    table = tomllib.loads(out.read_text(encoding="utf-8"))
    assert table["camera"] == {"capture_fps": "480", "distance_to_wall": "2.000 m ± 3 mm"}
    assert table["wall"] == {"grid": "50 mm"}
    assert table["ball"] == {"diameter": "200 mm", "mass": "0.4 kg"}
    assert table["support"] == {"height": "0.3 m"}
    # what a person wrote before is kept
    assert table["air"] == {"humidity": 0.4}
    assert load_setup(out).camera.distance_to_wall == (2.0, 0.003)
    prior = read_lens(written.lens, width=SIZE[0], height=SIZE[1])
    assert abs(np.log(prior.lens.fx / 380.0)) < 4.0 * prior.std[0]
    view = read_view(written.lens)
    assert not camera_movement(view, grid_of(calibrated)).moved


def test_a_lens_known_beforehand_is_kept_as_it_was(calibrated: Answers, tmp_path: Path) -> None:
    first = replace(calibrated, out=tmp_path / "setup.toml")
    lens = save(first, outlook(first)).lens
    held = tomllib.loads(lens.read_text(encoding="utf-8"))["lens"]
    again = typed(first, lens=str(lens))
    save(again, outlook(again))
    text = lens.read_text(encoding="utf-8")
    assert text.count("[view]") == 1
    assert tomllib.loads(text)["lens"] == held
    assert tomllib.loads(setup_text(again, outlook(again)))["camera"] == {"lens": "lens.toml"}
    wide = replace(first.scene, info=replace(first.scene.info, width=640, height=480))
    with pytest.raises(SetupError, match="another aspect ratio"):
        typed(replace(first, scene=wide), lens=str(lens))


def test_nothing_is_written_before_there_is_a_calibration(clip: Path, tmp_path: Path) -> None:
    answers = Answers(open_scene(clip), out=tmp_path / "setup.toml")
    with pytest.raises(UsageError, match="nothing is calibrated"):
        save(answers, outlook(answers))
    assert list(tmp_path.iterdir()) == []


def test_without_a_grid_the_ball_may_be_the_scale(clip: Path, tmp_path: Path) -> None:
    answers = typed(Answers(open_scene(clip), out=tmp_path / "setup.toml"), ball=BALL, fps="240")
    written = save(answers, outlook(answers))
    assert written.lens is None
    assert load_setup(written.setup).camera.capture_fps == 240.0


def test_no_folder_no_file(calibrated: Answers, tmp_path: Path) -> None:
    nowhere = replace(calibrated, out=tmp_path / "gone" / "setup.toml")
    with pytest.raises(UsageError, match="can't write"):
        save(nowhere, outlook(nowhere))


def test_a_lens_file_without_a_view_says_so(tmp_path: Path) -> None:
    for text in ("[lens]\n", "not toml", "[view]\nsize = 3\n"):
        (tmp_path / "lens.toml").write_text(text, encoding="utf-8")
        with pytest.raises(SetupError, match="does not contain"):
            read_view(tmp_path / "lens.toml")


def test_what_people_type(clip: Path) -> None:
    plain = Answers(open_scene(clip))
    told = typed(plain, fps="600 fps", wall_grid="40mm", fine_grid="none", ball="jokku")
    assert told.setup.camera.capture_fps == 600.0
    assert told.rate.known
    assert not plain.rate.known
    assert told.setup.wall.grid == pytest.approx(0.04)
    assert told.inputs.ball is not None
    assert told.inputs.ball.name == "jokku"
    assert text_of(told, "ball") == "jokku"
    own = typed(told, ball="220 mm, 0.4 kg", camera_distance="400 cm")
    assert (own.inputs.ball.diameter, own.inputs.ball.mass) == pytest.approx((0.22, 0.4))
    assert text_of(own, "ball") == "220 mm, 0.4 kg"
    assert own.setup.camera.distance_to_wall == pytest.approx((4.0, 0.005))
    assert typed(own, ball="", fps="-", wall_grid="", camera_distance="").document == {}
    assert point_from("12, 34", (320, 180)).tolist() == [12.0, 34.0]


def test_the_period_of_a_pendulum_gives_its_inertia(clip: Path) -> None:
    plain = Answers(open_scene(clip))
    with pytest.raises(UsageError, match="mass and centre of mass"):
        typed(plain, pendulum_period="1.36 s")
    parts = {"pendulum_mass": "2.50 kg ± 5 g", "pendulum_com": "0.420 m ± 3 mm"}
    told = typed(plain, **parts, pendulum_length="0.480 m", pendulum_period="1.36 s ± 0.01 s")
    pendulum, std = told.setup.pendulum, told.setup.pendulum_std.inertia
    assert pendulum is not None
    assert std is not None
    inertia = 2.5 * 9.81 * 0.42 * (1.36 / (2.0 * np.pi)) ** 2
    assert pendulum.inertia == pytest.approx(inertia, rel=1e-3)
    relative = np.sqrt((2 * 0.01 / 1.36) ** 2 + (0.005 / 2.5) ** 2 + (0.003 / 0.42) ** 2)
    assert std == pytest.approx(inertia * relative, rel=0.02)


@pytest.mark.parametrize(
    "wrong",
    [
        {"fps": "fast"},
        {"fps": "-5"},
        {"wall_grid": "50 s"},
        {"wall_grid": "50"},
        {"fine_grid": "50 mm"},
        {"camera_distance": "-4 m"},
        {"camera_distance": "4 m ± 0 mm"},
        {"ball": "football"},
        {"ball": "20 m"},
        {"ball": "220 mm, heavy"},
        {"pendulum_mass": "3 m"},
    ],
)
def test_what_makes_no_sense_is_refused(clip: Path, wrong: dict[str, str]) -> None:
    plain = Answers(open_scene(clip))
    with pytest.raises(UsageError):
        typed(plain, **wrong)


@pytest.mark.parametrize("text", ["12", "400,10"])
def test_what_is_no_point_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        point_from(text, (320, 180))


def test_a_lens_needs_pictures_of_the_board(calibrated: Answers, tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"")
    with pytest.raises(ClipError, match="not a readable image"):
        typed(calibrated, lens=str(tmp_path))
    (tmp_path / "a.jpg").unlink()
    cv2.imwrite(str(tmp_path / "b.png"), np.full((180, 320), 128, np.uint8))
    with pytest.raises(CalibrationError, match="no board found"):
        typed(calibrated, lens=str(tmp_path))


def test_drawings_show_what_they_are_about(calibrated: Answers) -> None:
    found = outlook(calibrated).calibration
    assert found is not None
    grid = grid_of(calibrated)
    assert grid_lines(grid).count("M") > 20
    cells, scale = shaded_map(found)
    assert cells.count("<rect") > 500
    assert 0.0 < scale.low < scale.high


def test_the_session_tells_what_each_answer_did(clip: Path, tmp_path: Path) -> None:
    session = Session(Answers(open_scene(clip), out=tmp_path / "setup.toml"))
    session.find_grid()
    session.answer("measured", "ball_plane", "0.4 m")
    assert [change.label for change in session.changes] == ["wall grid found", "measured 0.4 m"]
    assert session.changes[1].before == session.changes[0].after
    session.answers = replace(session.answers, scene=_blank(session))
    session.find_grid()
    assert session.answers.grid is None
    assert "no picture of the wall" in session.grid_problem
    session.look_for_ball()
    assert "no ball" in session.ball_problem


def _blank(session: Session) -> StillScene:
    scene = session.answers.scene
    return replace(scene, picture=np.full_like(scene.picture, 128))


def test_jobs_are_done_in_order_and_problems_are_kept() -> None:
    jobs, done = Jobs(), list[int]()

    def fail() -> None:
        raise UsageError("wrong", hint="Right.")

    for number in range(20):
        jobs.submit("counting", lambda number=number: done.append(number))  # type: ignore[misc]
    jobs.submit("failing", fail)
    while jobs.busy:
        pass
    assert done == list(range(20))
    assert jobs.problem == "wrong. Right."
    jobs.submit("counting", lambda: done.append(20))
    while jobs.busy:
        pass
    assert jobs.problem == ""


def test_a_lens_known_beforehand_narrows_what_the_lens_leaves_open(
    calibrated: Answers, tmp_path: Path
) -> None:
    taped = typed(calibrated, ball_plane="0.4 m ± 0.5 mm")
    lens = tmp_path / "lens.toml"
    about = {"fx": 1.0, "fy": 1.0, "cx": 0.3, "cy": 0.3, "k1": 0.001, "k2": 0.001}
    known = CAMERA.lens
    lines = ["[lens]", "width = 320", "height = 180"]
    lines += [f"{name} = {getattr(known, name)!r}" for name in about]
    lines += ["[std]", *(f"{name} = {value}" for name, value in about.items())]
    lens.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert std_of(typed(taped, lens=str(lens))) < std_of(taped)
