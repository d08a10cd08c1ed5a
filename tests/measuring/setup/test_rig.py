"""What a setup's uncertainties and the defaults make of a rig, and a setup written back."""

import math
from dataclasses import replace

import numpy as np
import pytest

from measuring.budget import ClipConditions, systematic_budget
from measuring.inputs import gather_inputs
from measuring.setup.file import Origin, Setup, read_setup, rig_of
from metrology import Default, Defaults, SetupError, UsageError
from physics.air import moist_air_density
from pipelines.calibrate.answers import ANSWER_OPTIONS
from vision.clip.footage import CaptureRate

SURE = """
[camera]
capture_fps = "600 fps ± 0.5 fps"
shutter = "1/2000 s ± 10 us"
distance_to_wall = "4.00 m ± 3 mm"
principal_point_on_wall = ["1.10 m ± 4 mm", "0.60 m"]
[wall]
grid = "50 mm +- 0.02 mm"
fine_grid = "10 mm ± 0.01 mm"
ball_plane_offset = "0.45 m ± 2 mm"
[ball]
mass = "0.353 kg ± 0.002 kg"
diameter = "201.75 mm ± 0.5 mm"
launch_angle = "8.5 deg ± 0.1 deg"
cor = 0.75
[pendulum]
length = "0.5541 m ± 0.3 mm"
inertia = "1.579 kg m^2 ± 0.05 kg m^2"
mass = "6.0 kg ± 5 g"
com = "0.4553 m ± 1 mm"
effective_mass = "5.1667 kg ± 0.1 kg"
[support]
height = "0.3120 m ± 2 mm"
[air]
density = "1.2 kg/m^3 ± 0.01 kg/m^3"
viscosity = "1.85e-5 Pa s ± 1e-7 Pa s"
temperature = "22 degC ± 0.5 degC"
pressure = "1005 hPa ± 1 hPa"
humidity = "50 % ± 5 %"
[balls.red]
diameter = "30 mm ± 0.1 mm"
mass = "20 g"
cor = "0.8 - 0.01*v"
[[balls.red.contact_outcome]]
impact_speed = 1.0
cor = 0.76
contact_time = 0.016
pendulum_speed_after = 0.97
pendulum_angle = 0.161
ball_x = 0.0075
ball_y = 0.41
ball_vx = 1.8
ball_vy = 0.17
[scatter]
backswing = "0.25 deg"
cor = 0.006
[noise]
position = "1.7 mm"
angle = "0.0011 rad"
[model]
effects = ["gravity", "drag", "magnus"]
[model.drag]
drag_coefficient = "0.31 ± 0.02"
[model.magnus]
spin = "12 rad/s ± 1 rad/s"
"""


def test_every_physical_key_takes_its_uncertainty() -> None:
    setup = read_setup(SURE)
    rig = rig_of(setup, setup.ball)
    told = {name: known.std for name, known in vars(rig).items()}
    assert told == pytest.approx(
        {
            "inertia": 0.05, "pendulum_mass": 0.005, "com": 0.001, "length": 0.0003,
            "effective_mass": 0.1,
            "support_height": 0.002, "ball_mass": 0.002, "ball_diameter": 0.0005,
            "launch_angle": math.radians(0.1), "gravity": 0.01, "air_density": 0.01,
            "drag_coefficient": 0.02, "spin": 4.0, "grid_pitch": 2e-5,
        }
    )  # fmt: skip
    assert [known.name for known in rig.defaults_used] == [
        Defaults.GRAVITY.name, Defaults.SPIN.name,
    ]  # fmt: skip
    camera, wall = setup.camera, setup.wall
    assert (camera.capture_fps_std, camera.shutter_std) == pytest.approx((0.5, 1e-5))
    assert camera.principal_point_on_wall == ((1.1, 0.004), (0.6, Defaults.TAPE.std))
    assert wall.fine_grid_std == pytest.approx(1e-5)
    assert setup.pendulum_std.effective_mass == pytest.approx(0.1)
    assert setup.air_known.humidity_std == pytest.approx(0.025)
    assert setup.model.stds == {"drag": {"drag_coefficient": 0.02}, "magnus": {"spin": 1.0}}


def test_where_the_setup_is_silent_the_defaults_hold_and_say_so() -> None:
    ball = read_setup('[ball]\npreset = "jokku"').ball
    rig = rig_of(Setup(), ball)
    assert rig.drag_coefficient.value == Defaults.DRAG_COEFFICIENT.known
    assert rig.drag_coefficient.value_from is Origin.DEFAULT
    assert rig.inertia.value_from is Origin.PRESET
    assert rig.inertia.relative_std == pytest.approx(Defaults.PENDULUM_INERTIA.std)
    assert set(rig.defaults_used) == set(rig.numbers)
    assert all(known.source for known in rig.defaults_used)
    assert "default" in rig.inertia.in_words


def test_the_air_is_as_sure_as_what_was_read_off() -> None:
    setup = read_setup('[air]\ntemperature = "20 degC ± 2 degC"\npressure = "1000 hPa ± 4 hPa"')
    known = rig_of(setup, None).air_density
    by_temperature = moist_air_density(295.15, 1e5, 0.5) - moist_air_density(293.15, 1e5, 0.5)
    by_pressure = known.value * 0.004
    assert known.std == pytest.approx(math.hypot(by_temperature, by_pressure), rel=0.03)


def test_the_labs_own_uncertainties_make_its_budget() -> None:
    rate = CaptureRate(600.0, 0.0, "option", None)

    def share(text: str) -> float:
        inputs = gather_inputs(read_setup(text), "jokku", None)
        scene = ClipConditions(inputs, rate, None)
        table = systematic_budget(
            scene, lambda moved: np.array([moved.inputs.pendulum.inertia]), math.inf
        )
        return max(float(column[0]) for column in table.values())

    assert share('[pendulum]\ninertia = "1.6 kg m^2 ± 0.2 kg m^2"') == pytest.approx(0.2)
    assert share('[pendulum]\ninertia = "1.6 kg m^2"') == pytest.approx(0.016)


def test_measuring_takes_the_drag_of_the_setup() -> None:
    text = '[model.drag]\ndrag_coefficient = "0.2 ± 0.03"'
    half = gather_inputs(read_setup(text), "jokku", None).drag_per_metre
    usual = gather_inputs(Setup(), "jokku", None).drag_per_metre
    assert half[0] / usual[0] == pytest.approx(0.2 / Defaults.DRAG_COEFFICIENT.known)
    assert half[1] / half[0] == pytest.approx(math.hypot(0.03 / 0.2, 0.02 / 1.18), rel=1e-3)


def test_a_setup_written_back_reads_the_same() -> None:
    for text in (SURE, "", '[ball]\npreset = "basketball"\n[pendulum]\n', "[air]\nhumidity = 0.3"):
        setup = read_setup(text)
        assert read_setup(setup.to_toml()) == setup


def test_a_setup_is_edited_through_the_same_door() -> None:
    setup = read_setup(SURE)
    lighter = setup.having({"ball.mass": "300 g ± 3 g", "support.height": None})
    assert lighter.ball is not None
    assert (lighter.ball.mass, lighter.ball.mass_std) == pytest.approx((0.3, 0.003))
    assert lighter.support is None
    assert setup.ball is not None
    assert setup.ball.mass == pytest.approx(0.353)
    assert replace(lighter, ball=setup.ball, support=setup.support, support_std=0.002) == setup
    for keys, said in (
        ({"ball.mass": "50 tonnes"}, "mass"),
        ({"ball.mas": "1 kg"}, "nearest is 'mass'"),
        ({"wall.grid.pitch": 1}, "not a table"),
    ):
        with pytest.raises(SetupError, match=said):
            setup.having(keys)


@pytest.mark.parametrize("typed", [50, -0.05, "50 m", "-50 mm", "nan", "1e300 m", True])
def test_a_wrong_grid_is_refused_alike_by_option_setup_and_wizard(typed: object) -> None:
    written = str(typed).lower() if isinstance(typed, bool | int | float) else f'"{typed}"'
    with pytest.raises(SetupError, match=r"wall\.grid"):
        read_setup(f"[wall]\ngrid = {written}")
    with pytest.raises(UsageError) as by_option:
        gather_inputs(Setup(), None, str(typed))
    with pytest.raises(UsageError) as by_wizard:
        ANSWER_OPTIONS["wall_grid"].read(None, str(typed), "--wall-grid")  # type: ignore[arg-type]
    assert str(by_option.value) == str(by_wizard.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[model.drag]\nfoo = 1", r"model\.drag\.foo'\nIt has drag_coefficient"),
        ("[model.drg]\ndrag_coefficient = 1", "nearest is 'drag'"),
        ('[model]\neffects = ["gravity", "drags"]', "nearest is 'drag'"),
        ("[model.drag]\ndrag_coefficient = -1", "drag_coefficient"),
        ("[model.drag]\ndrag_coefficient = nan", "drag_coefficient"),
        ("[model.drag]\ndrag_coefficient = true", "drag_coefficient"),
        ('[ball]\npreset = "jokku"\ncor = "(1 - v)**0.5"', "no value at"),
        ('[ball]\npreset = "jokku"\ncor = "log(v - 1)"', "no value at"),
        ('[ball]\npreset = "jokku"\ncor = "0.7/(v - v)"', "no value at"),
        ('[ball]\npreset = "jokku"\ncor = "1.5 + v"', "at most 1"),
        ('[camera]\ndistance_to_wall = "-4 m"', "distance_to_wall"),
        ("[camera]\ncapture_fps = 1e300", "capture_fps"),
        ("[scatter]\ncor = nan", "scatter.cor"),
        ("[air]\nhumidity = 50", "humidity"),
    ],
)
def test_what_no_law_holds_for_is_refused_at_reading(text: str, said: str) -> None:
    with pytest.raises(SetupError, match=said):
        read_setup(text)


def test_every_default_has_a_unit_and_a_source() -> None:
    defaults = [d for d in vars(Defaults).values() if isinstance(d, Default)]
    assert len(defaults) > 20
    for default in defaults:
        assert default.unit
        assert len(default.source) > 10
        assert default.std > 0.0
