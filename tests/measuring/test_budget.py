"""The budget of the measuring chain: what strongly correlated inputs do together."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.calibration import PARAMETERS, Calibration, Source
from calib.camera import Camera, Lens
from measuring.budget import (
    DERIVED,
    ClipConditions,
    Propagation,
    derived_values,
    impact_after_move,
    merged,
    random_covariance,
    systematic_budget,
    values_after_move,
    values_of,
)
from measuring.flight_fit import FlightPriors, fit_flight
from measuring.impact import find_impact
from measuring.inputs import gather_inputs
from measuring.metres import (
    BallScale,
    MetricTracks,
    arm_along_bar,
    radius_relative_std,
    tracks_in_metres,
)
from measuring.setup.file import Setup
from metrology import UncertaintySource
from tests.measuring.ideal_tracks import Noise, ideal_tracks, known_stroke
from vision.clip.footage import CaptureRate
from vision.tracks import Face, PendulumTrack, Track, Tracks

DISTANCE, FOCAL = PARAMETERS.index("log_distance"), PARAMETERS.index("log_focal")


def a_calibration(distance_std: float, scale_std: float) -> Calibration:
    """Distance and focal length open by `distance_std`, their ratio known to `scale_std`."""
    vector = np.zeros(len(PARAMETERS))
    vector[DISTANCE], vector[FOCAL] = np.log(4.0), np.log(900.0)
    together = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    together[np.ix_([DISTANCE, FOCAL], [DISTANCE, FOCAL])] = distance_std**2
    apart = np.zeros_like(together)
    apart[FOCAL, FOCAL] = scale_std**2
    return Calibration(
        Lens.centred(400, 300, 900.0),
        np.eye(3),
        vector,
        (Source("lens not calibrated", together), Source("grid lines", apart)),
    )


def a_scene(calibration: Calibration) -> ClipConditions:
    inputs = gather_inputs(Setup(), None, None)
    return ClipConditions(inputs, CaptureRate(600.0, 0.0, "option", None), calibration)


def scale_of(scene: ClipConditions) -> NDArray[np.float64]:
    assert scene.calibration is not None
    vector = scene.calibration.vector
    return np.array([np.exp(vector[FOCAL] - vector[DISTANCE])])


def test_a_scale_is_as_sure_as_the_ratio_it_hangs_on() -> None:
    scene = a_scene(a_calibration(0.4, 0.001))
    table = systematic_budget(scene, scale_of, np.inf)
    assert table["grid lines"][0] == pytest.approx(0.001 * 225.0, rel=0.01)
    assert table["lens not calibrated"][0] < 0.1 * table["grid lines"][0]


def test_each_input_is_moved_by_itself() -> None:
    scene = a_scene(a_calibration(0.05, 0.001))
    scene = replace(scene, rate=CaptureRate(600.0, 0.6, "setup", None))
    table = systematic_budget(scene, lambda moved: np.array([moved.rate.fps**2]), np.inf)
    assert table["capture rate"][0] == pytest.approx(2 * 600 * 0.6, rel=0.001)
    assert table["inertia of the pendulum"][0] == 0.0
    budget = merged(table, 0, 100.0)
    assert [line.source for line in budget] == ["capture rate", "noise of the tracks"]


def test_without_a_grid_roll_and_slant_of_the_camera_count() -> None:
    camera = Camera.facing_wall(Lens.centred(640, 360, 800.0), [1.0, 0.6, 4.0], yaw=0.1)
    path = np.column_stack(
        [np.linspace(0.0, 1.8, 60), 0.6 - 0.2 * np.linspace(-1.0, 1.0, 60) ** 2, np.full(60, 0.4)]
    )
    px, radius = camera.sphere_outline(path, 0.1)
    usual = np.median(px, axis=0)
    scale = 0.1 / float(np.median(radius))

    def speed(moved: ClipConditions) -> NDArray[np.float64]:
        growth = np.tan(moved.slant_rad) / 800.0
        mapping = BallScale(scale, px[0], usual, moved.roll_rad, float(growth))
        start = mapping.point(px[:2])
        return np.asarray(np.append(np.hypot(*(start[1] - start[0])), np.diff(start, axis=0)[0, 1]))

    scene = replace(a_scene(a_calibration(0.05, 0.001)), calibration=None)
    table = systematic_budget(scene, speed, 0.005)
    std = np.sqrt(sum(column**2 for column in table.values()))
    true = (path[1] - path[0])[:2]
    error = np.abs(speed(scene) - [np.hypot(*true), true[1]])
    assert np.all(error < 2.0 * std)
    assert error[0] > 2.0 * table["ball diameter"][0]


def test_a_rolled_camera_is_turned_upright_about_the_ball_at_rest() -> None:
    mapping = BallScale(0.01, np.array([50.0, 80.0]), np.array([70.0, 80.0]), roll_rad=0.1)
    assert mapping.point(np.array([50.0, 80.0])) == pytest.approx([0.0, 0.0])
    along = mapping.point(np.array([150.0, 80.0]))
    assert np.hypot(*along) == pytest.approx(1.0)
    assert abs(np.arctan2(along[1], along[0])) == pytest.approx(0.1)


def test_the_pendulums_length_and_effective_mass_are_inputs() -> None:
    """Energy is that of the rotation, whatever the length; Eq. 7 goes with the effective mass."""
    given = {"pendulum.length": "0.5541 m ± 1 %", "pendulum.effective_mass": "5.1667 kg ± 2 %"}
    inputs = gather_inputs(Setup().having(given), "jokku", None)
    tracks = ideal_tracks(*known_stroke("jokku", 60.0), Noise())
    impact = find_impact(tracks, inputs)
    scene = replace(a_scene(a_calibration(0.05, 0.001)), calibration=None, inputs=inputs)
    table = systematic_budget(
        scene, lambda moved: values_after_move(impact, tracks, moved.inputs), np.inf
    )
    value = dict(zip(DERIVED, values_after_move(impact, tracks, inputs), strict=True))
    column = {name: index for index, name in enumerate(DERIVED)}
    by_length = table[UncertaintySource.PENDULUM_LENGTH][column["energy_loss"]]
    assert by_length < 0.2 * 0.02 * value["energy_loss"]
    by_mass = table[UncertaintySource.EFFECTIVE_MASS][column["ball_speed_eq7"]]
    assert by_mass == pytest.approx(0.02 * value["ball_speed_eq7"], rel=1e-3)


@pytest.mark.parametrize("ball", ["jokku", "basketball"])
@pytest.mark.parametrize("moved", ["longer", "faster", "heavier"])
def test_linear_response_agrees_with_fits_done_anew(moved: str, ball: str) -> None:
    scene, shot = known_stroke(ball, 60.0)
    # little noise: what a frame gained or lost at the onset changes is noise, no response
    tracks = ideal_tracks(scene, shot, Noise(2e-5, 3e-5, 1e-4))
    inputs = gather_inputs(Setup(), ball, None)
    impact = find_impact(tracks, inputs)
    other, others_inputs = tracks, inputs
    if moved == "longer":
        other = replace(
            tracks, ball_m=1.002 * tracks.ball_m, rest_m=1.002 * tracks.rest_m, pivot_m=None
        )
        other = replace(other, pivot_m=1.002 * np.asarray(tracks.pivot_m))
    if moved == "faster":
        other = replace(
            tracks,
            ball_time_s=tracks.ball_time_s / 1.001,
            swing_time_s=tracks.swing_time_s / 1.001,
        )
    if moved == "heavier":
        body = replace(inputs.pendulum, inertia=1.01 * inputs.pendulum.inertia)
        others_inputs = replace(inputs, pendulum=body)
    changes = {
        how: values_after_move(impact, other, others_inputs, how)
        - values_after_move(impact, tracks, inputs, how)
        for how in Propagation
    }
    std = np.sqrt(np.diag(random_covariance(impact, inputs)))
    refit = np.hypot(std, changes[Propagation.REFIT])
    known = np.isfinite(refit) & (refit > 0.0)
    assert known.sum() > 10
    response = np.hypot(std, changes[Propagation.RESPONSE])
    assert response[known] == pytest.approx(refit[known], rel=0.01)


def a_swing(zero_std: float = 0.01) -> Tracks:
    """A ball that lies still and then flies, and a mass on an arc about (100, 20) px."""
    frame = np.arange(60)
    flying = np.maximum(frame - 30, 0)
    ball = Track(
        frame=frame,
        time_s=frame / 600.0,
        centre_px=np.column_stack([140.0 + 3.0 * flying, 120.0 - 1.0 * flying]),
        covariance_px2=np.tile(0.01 * np.eye(2), (60, 1, 1)),
        bound_px2=np.tile(0.01 * np.eye(2), (60, 1, 1)),
        radius_px=np.full(60, 20.0),
        radius_std_px=np.full(60, 0.1),
        quality=np.ones(60),
    )
    angle = 0.02 * (frame - 30.0)
    centre = np.array([100.0, 20.0]) + 100.0 * np.column_stack([np.sin(angle), np.cos(angle)])
    face = Face(25, centre[25] + np.array([12.0, 3.0]), 0.1)
    swing = PendulumTrack(
        replace(ball, centre_px=centre), angle, np.full(60, 1e-3), np.array([100.0, 20.0]),
        np.eye(2), 100.0, face, zero_std,
    )  # fmt: skip
    return Tracks(ball, swing, np.zeros((200, 400)), (0, 29))


def test_turning_the_zero_of_the_angles_leaves_the_face_where_it_is_seen() -> None:
    tracks, scale = a_swing(), BallScale(1e-3, np.array([140.0, 120.0]), np.zeros(2), 0.0, 0.0)
    times = np.arange(60) / 600.0
    usual, turned = (tracks_in_metres(tracks, scale, times, zero) for zero in (0.0, 0.01))
    assert turned.swing_rad - usual.swing_rad == pytest.approx(np.full(60, 0.01))

    def face(metric: MetricTracks) -> float:
        """Where the line of the face meets the height of what was seen of it, m."""
        phi = metric.swing_rad[25]
        assert metric.pivot_m is not None
        seen = np.array([100.0 + 100.0 * np.sin(-0.1) + 12.0, 20.0 + 100.0 * np.cos(0.1) + 3.0])
        at = scale.point(seen) * [metric.direction, 1.0] - metric.pivot_m
        return float(metric.edge_offset_m - at @ [np.cos(phi), np.sin(phi)])

    assert face(usual) == pytest.approx(0.0, abs=1e-9)
    assert face(turned) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("std_px", [0.1, 60.0])
def test_a_pivot_left_open_by_the_picture_is_where_the_given_length_has_it(std_px: float) -> None:
    tracks, scale = a_swing(), BallScale(1e-3, np.array([140.0, 120.0]), np.zeros(2), 0.0, 0.0)
    swing = tracks.pendulum
    assert swing is not None
    # as far as it was found from where the mass turns: 15 px along the bar at contact
    off = replace(
        swing, pivot_px=swing.pivot_px - [0.0, 15.0], pivot_covariance_px2=std_px**2 * np.eye(2)
    )
    times = np.arange(60) / 600.0
    true = tracks_in_metres(tracks, scale, times)
    length = float(arm_along_bar(true.rest_m - true.pivot_m, true.swing_rad[29])), 0.002
    found = tracks_in_metres(replace(tracks, pendulum=off), scale, times, length=length)
    turned = np.ptp(found.swing_rad) / np.ptp(true.swing_rad)
    assert turned == pytest.approx(1.0 if std_px > 10.0 else 100.0 / 115.0, abs=0.02)


def test_the_zero_of_the_angles_is_a_source_of_the_back_swing() -> None:
    scene = replace(a_scene(a_calibration(0.4, 0.001)), zero_std_rad=0.01)

    def first_angle(moved: ClipConditions) -> NDArray[np.float64]:
        scale = BallScale(1e-3, np.array([140.0, 120.0]), np.zeros(2), 0.0, 0.0)
        metric = tracks_in_metres(a_swing(), scale, np.arange(60) / 600.0, moved.zero_rad)
        return np.array([metric.swing_rad[0]])

    table = systematic_budget(scene, first_angle, np.inf)
    assert table[UncertaintySource.PENDULUM_ZERO][0] == pytest.approx(0.01)


def test_the_pivot_is_a_source_of_the_angle_along_both_axes_of_its_doubt() -> None:
    ways = ((0.6, 0.8), (2.4, -1.8))
    scene = replace(a_scene(a_calibration(0.4, 0.001)), pivot_steps_px=ways)

    def first_angle(moved: ClipConditions) -> NDArray[np.float64]:
        scale = BallScale(1e-3, np.array([140.0, 120.0]), np.zeros(2), 0.0, 0.0)
        times = np.arange(60) / 600.0
        metric = tracks_in_metres(a_swing(), scale, times, 0.0, moved.pivot_px)
        return np.array([metric.swing_rad[0]])

    table = systematic_budget(scene, first_angle, np.inf)
    # the body hangs 100 px from the pivot, at -0.6 rad: what is across its arm turns it
    across = [(x * np.cos(-0.6) - y * np.sin(-0.6)) / 100.0 for x, y in ways]
    assert table[UncertaintySource.PENDULUM_PIVOT][0] == pytest.approx(np.hypot(*across), rel=0.03)


def test_a_ball_seen_less_clearly_tells_a_scale_less_surely() -> None:
    ball = a_swing().ball
    clean = replace(ball, radius_std_px=np.full(60, 0.07))
    assert radius_relative_std(clean) == pytest.approx(0.13 / 20.0)
    unclear = replace(ball, radius_std_px=np.full(60, 0.3))
    # four times what frames state beyond a clean outline's own
    assert radius_relative_std(unclear) == pytest.approx(1.2 / 20.0, rel=0.05)


@pytest.mark.parametrize("lasting_s", [1e-6, 1e-4, 1e-3, 0.1])
def test_a_fall_that_the_frames_do_not_determine_is_not_given(lasting_s: float) -> None:
    inputs = gather_inputs(Setup(), "jokku", None)
    impact = find_impact(ideal_tracks(*known_stroke("jokku", 60.0), Noise()), inputs)
    time = impact.free_flight.time_s[0] + np.linspace(0.0, lasting_s, 8)
    place = impact.free_flight.states(time)[:, :2]
    priors = FlightPriors(inputs.gravity, np.inf, 0.0, 1e-6, 0.0, 1e-6)
    short = fit_flight(time, place, np.tile(np.eye(2) * 1e-10, (8, 1, 1)), float(time[0]), priors)
    found = derived_values(replace(impact, free_flight=short), inputs)
    fall = found[list(DERIVED).index("gravity")]
    std = np.sqrt(short.fitted.covariance[6, 6])
    assert np.isfinite(fall) == (lasting_s == 0.1)
    assert np.isnan(fall) or abs(fall - 9.806) < 5.0 * std


@pytest.mark.parametrize(
    ("changed", "alike"),
    [
        ({"arm_factor": 1.01}, True),
        ({"after_factor": 0.98}, True),
        ({"normal_sigmas": 1.0}, True),
        ({"gravity": 9.9}, False),
    ],
)
def test_only_what_no_fit_takes_leaves_the_fits_alone(
    changed: dict[str, float], alike: bool
) -> None:
    inputs = replace(gather_inputs(Setup(), "jokku", None), fall=1.0)
    others = replace(inputs, **changed)  # type: ignore[arg-type]
    assert others.fitted_alike(inputs) is alike
    tracks = ideal_tracks(*known_stroke("jokku", 60.0), Noise())
    impact = find_impact(tracks, inputs)
    moved = impact_after_move(impact, tracks, others, Propagation.RESPONSE)
    unmoved = impact_after_move(impact, tracks, inputs, Propagation.RESPONSE)
    here, there = values_of(moved, others), values_of(unmoved, others)
    assert np.array_equal(here, there, equal_nan=True) is alike


def test_of_the_presets_body_the_length_alone_enters_no_fit() -> None:
    inputs = gather_inputs(Setup(), "jokku", None)
    longer = replace(inputs.pendulum, length=1.01 * inputs.pendulum.length)
    heavier = replace(inputs.pendulum, inertia=1.01 * inputs.pendulum.inertia)
    assert replace(inputs, pendulum=longer).fitted_alike(inputs)
    assert not replace(inputs, pendulum=heavier).fitted_alike(inputs)
