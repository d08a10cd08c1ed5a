"""The wizard's answers, what they amount to, and the files they become."""

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.board import Board
from calib.calibration import Known
from calib.camera import Camera, Lens
from calib.grid import WallGrid
from calib.lens import MIN_LENS_STD, LensPrior, read_lens
from calib.solve import camera_movement
from metrology import CalibrationError, ClipError, SetupError, UsageError
from pipelines.calibrate.wizard.answers import (
    Answers,
    BallKind,
    LensChoice,
    WizardClip,
    ball_from,
    board_pictures,
    board_size,
    distance_from,
    fine_pitch_from,
    lens_from_board,
    lens_from_file,
    open_scene,
    pitch_from,
    point_from,
    rate_from,
)
from pipelines.calibrate.wizard.drawing import (
    grid_lines,
    handles,
    marks,
    residual_arrows,
    shaded_map,
)
from pipelines.calibrate.wizard.session import (
    Session,
    compare_length,
    grid_from_corners,
    length_between,
    outlook,
    read_view,
    save,
    setup_text,
    starting_corners,
    with_corners,
    with_grid,
)
from pipelines.web import Jobs
from tests.calib.synthetic import rendered

SIZE = (320, 180)
CAMERA = Camera.facing_wall(Lens.centred(*SIZE, 380.0), [0.9, 0.5, 2.0], yaw=0.15)
BALL = BallKind("ball", 0.2, 0.4)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clip")
    for index in range(3):
        picture = rendered(CAMERA, seed=index, samples=2)
        cv2.imwrite(str(folder / f"frame{index:03d}.png"), picture.astype(np.uint8))
    return folder


@pytest.fixture(scope="module")
def calibrated(clip: Path) -> Answers:
    return with_grid(Answers(open_scene(clip), fine_pitch=0.01, ball=BALL))


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
    far = replace(told, camera_distance=Known(2.0, 0.005))
    both = replace(far, ball_plane_offset=Known(0.4, 0.005))
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
    found = outlook(replace(calibrated, camera_distance=Known(2.0, 0.005))).calibration
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
    answers = replace(
        calibrated, out=out, fps=480.0, camera_distance=Known(2.0, 0.003), support_height=0.3
    )
    seen: list[str] = []
    written = save(answers, outlook(answers), lambda text, folder: seen.append(text))
    table = tomllib.loads(out.read_text(encoding="utf-8"))
    assert table["camera"] == {"capture_fps": 480.0, "distance_to_wall": "2 m ± 3 mm"}
    assert table["wall"] == {"grid": "50 mm", "fine_grid": "10 mm"}
    assert table["ball"] == {"diameter": "200 mm", "mass": "0.4 kg"}
    assert seen == [out.read_text(encoding="utf-8")]
    prior = read_lens(written.lens, width=SIZE[0], height=SIZE[1])
    assert abs(np.log(prior.lens.fx / 380.0)) < 4.0 * prior.std[0]
    view = read_view(written.lens)
    assert not camera_movement(view, grid_of(calibrated)).moved


def test_a_lens_known_beforehand_is_kept_as_it_was(calibrated: Answers, tmp_path: Path) -> None:
    first = replace(calibrated, out=tmp_path / "setup.toml")
    lens = save(first, outlook(first)).lens
    choice = lens_from_file(lens, SIZE)
    again = replace(first, lens=choice)
    save(again, outlook(again))
    text = lens.read_text(encoding="utf-8")
    assert text.count("[view]") == 1
    assert tomllib.loads(text)["lens"] == tomllib.loads(choice.text)["lens"]
    assert 'lens = "lens.toml"\n\n' in setup_text(again, outlook(again))
    with pytest.raises(SetupError, match="another aspect ratio"):
        lens_from_file(lens, (640, 480))


def test_nothing_is_written_before_there_is_a_calibration(clip: Path, tmp_path: Path) -> None:
    answers = Answers(open_scene(clip), out=tmp_path / "setup.toml")
    with pytest.raises(UsageError, match="nothing is calibrated"):
        save(answers, outlook(answers))
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_would_not_be_read_is_not_written(calibrated: Answers, tmp_path: Path) -> None:
    def refuse(text: str, folder: Path) -> None:
        raise SetupError("no")

    answers = replace(calibrated, out=tmp_path / "setup.toml")
    with pytest.raises(SetupError):
        save(answers, outlook(answers), refuse)
    assert list(tmp_path.iterdir()) == []
    nowhere = replace(calibrated, out=tmp_path / "gone" / "setup.toml")
    with pytest.raises(UsageError, match="can't write"):
        save(nowhere, outlook(nowhere))


def test_a_lens_file_without_a_view_says_so(tmp_path: Path) -> None:
    for text in ("[lens]\n", "not toml", "[view]\nsize = 3\n"):
        (tmp_path / "lens.toml").write_text(text, encoding="utf-8")
        with pytest.raises(SetupError, match="does not contain"):
            read_view(tmp_path / "lens.toml")


def test_what_people_type() -> None:
    assert rate_from("600 fps") == 600.0
    assert rate_from("") is None
    assert pitch_from("50mm") == 0.05
    assert fine_pitch_from("none", 0.05) is None
    assert distance_from("4.00 m ± 3 mm") == Known(4.0, 0.003)
    assert distance_from("400 cm") == Known(4.0, 0.005)
    assert ball_from("220 mm, 0.4 kg", [BALL]) == BallKind("ball", 0.22, 0.4)
    assert ball_from("ball", [BALL]) is BALL
    assert point_from("12, 34", (320, 180)).tolist() == [12.0, 34.0]
    assert board_size("8x6") == (8, 6)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: rate_from("fast"),
        lambda: rate_from("-5"),
        lambda: pitch_from("50 s"),
        lambda: pitch_from("50"),
        lambda: fine_pitch_from("50 mm", 0.05),
        lambda: distance_from("-4 m"),
        lambda: distance_from("4 m ± 0 mm"),
        lambda: ball_from("football", [BALL]),
        lambda: ball_from("20 m", [BALL]),
        lambda: point_from("12", (320, 180)),
        lambda: point_from("400,10", (320, 180)),
        lambda: board_size("2x6"),
        lambda: board_pictures(Path("/nowhere")),
    ],
)
def test_what_makes_no_sense_is_refused(wrong: Callable[[], object]) -> None:
    with pytest.raises(UsageError):
        wrong()


def test_a_lens_needs_pictures_of_the_board() -> None:
    with pytest.raises(ClipError, match="not a readable image"):
        lens_from_board([("a.jpg", b"")], Board(8, 6), SIZE)
    gray = cv2.imencode(".png", np.full((180, 320), 128, np.uint8))[1].tobytes()
    with pytest.raises(CalibrationError, match="no board found"):
        lens_from_board([("a.png", gray)], Board(8, 6), SIZE)


def test_drawings_show_what_they_are_about(calibrated: Answers) -> None:
    found = outlook(calibrated).calibration
    assert found is not None
    grid = grid_of(calibrated)
    assert grid_lines(grid).count("M") > 20
    svg, factor, rms = residual_arrows(found, grid)
    assert svg.count("<circle") == min(len(grid.nodes), 300)
    assert factor >= 1.0
    assert 0.0 < rms < 1.0
    cells, scale = shaded_map(found)
    assert cells.count("<rect") > 500
    assert 0.0 < scale.low < scale.high
    assert handles(starting_corners(grid, SIZE), 1, SIZE).count("<circle") == 4
    assert "assumed" in marks(calibrated, None)


def test_the_session_tells_what_each_answer_did(clip: Path, tmp_path: Path) -> None:
    session = Session(Answers(open_scene(clip), out=tmp_path / "setup.toml"), [BALL])
    session.find_grid()
    session.update("measured", ball_plane_offset=Known(0.4, 0.005))
    assert [change.label for change in session.changes] == ["wall grid found", "measured"]
    assert session.changes[1].before == session.changes[0].after
    session.update("squares", pitch=0.05)
    session.answers = replace(session.answers, scene=_blank(session))
    session.find_grid()
    assert session.answers.grid is None
    assert "no picture of the wall" in session.grid_problem
    session.look_for_ball()
    assert "no ball" in session.ball_problem


def _blank(session: Session) -> WizardClip:
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


def test_a_lens_known_beforehand_narrows_what_the_lens_leaves_open(calibrated: Answers) -> None:
    taped = replace(calibrated, ball_plane_offset=Known(0.4, 0.0005))
    assert std_of(replace(taped, lens=lens_choice())) < std_of(taped)


def lens_choice() -> LensChoice:
    return LensChoice(LensPrior(CAMERA.lens, 10.0 * MIN_LENS_STD), "[lens]\n", "known")
