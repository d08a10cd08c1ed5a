"""The setup file: every key of the contract, and what is said of slips in it."""

import math
from pathlib import Path

import pytest

from measuring.setup.file import ball_from_option, load_setup, read_setup
from metrology import SetupError, UsageError

WHOLE = """
[camera]
capture_fps = 600
distance_to_wall = "4.00 m"          # along the optical axis
principal_point_on_wall = ["1.10 m", "0.60 m"]   # optional: foot of the axis in wall coordinates
shutter = "1/2000 s"
lens = "lens.toml"                   # written by `vision calibrate`
[wall]
grid = "50 mm"
fine_grid = "10 mm"
ball_plane_offset = "0.45 m"         # ball plane in front of the wall
[ball]
preset = "jokku"                     # or basketball; or give the numbers:
mass = "0.353 kg"
diameter = "201.75 mm"
launch_angle = "8.5 deg"
[pendulum]
length = "0.5541 m"
inertia = "1.579 kg m^2"
mass = "6.0 kg"
com = "0.4553 m"
effective_mass = "5.1667 kg"
[support]
height = "0.3120 m"
[air]
temperature = "26 degC"
pressure = "1013.25 hPa"
humidity = 0.5
density = "1.180 kg/m^3"             # overrides the three above
viscosity = "1.852e-5 Pa s"
[balls.jokku]
mass = "0.353 kg"
diameter = "201.75 mm"
cor = "0.1305*exp(-0.2685*v - 0.1953) + 0.6746"
[[balls.jokku.contact_outcome]]
impact_speed = 1.1
cor = 0.7617                         # SI throughout this table
contact_time = 0.0160
pendulum_speed_after = 0.974
pendulum_angle = 0.1610              # at release, rad
ball_x = 0.0075
ball_y = 0.4141
ball_vx = 1.80
ball_vy = 0.17
[scatter]                            # trial to trial, one sigma: what repeats imperfectly
backswing = "0.2 deg"
launch_angle = "0.2 deg"
cor = 0.005
cor_law = 0.01                       # one offset per ball, shared by its trials
launch_angle_law = "0.3 deg"          # likewise
[noise]                              # a claim about the tracks; the engine tests it
position = "1.7 mm"
angle = "0.0011 rad"
[model]                              # the baseline that `vision explain` starts from
effects = ["gravity", "drag"]
[model.drag]
drag_coefficient = 0.47
"""


def test_every_key_is_read() -> None:
    setup = read_setup(WHOLE, folder=Path("lab"))
    camera, wall = setup.camera, setup.wall
    assert camera.capture_fps == 600.0
    assert camera.distance_to_wall == pytest.approx((4.0, 0.005))
    assert camera.principal_point_on_wall is not None
    assert [value for value, _ in camera.principal_point_on_wall] == pytest.approx([1.1, 0.6])
    assert camera.shutter == pytest.approx(1 / 2000)
    assert camera.lens == Path("lab/lens.toml")
    assert (wall.grid, wall.fine_grid) == pytest.approx((0.05, 0.01))
    assert wall.ball_plane_offset == pytest.approx((0.45, 0.005))
    assert setup.support is not None
    assert setup.support.height == pytest.approx(0.312)
    assert (setup.noise.position, setup.noise.angle) == pytest.approx((0.0017, 0.0011))
    scatter = setup.scatter
    assert scatter.backswing == pytest.approx(math.radians(0.2))
    assert scatter.launch_angle == pytest.approx(math.radians(0.2))
    assert (scatter.cor, scatter.cor_law) == (0.005, 0.01)
    assert scatter.launch_angle_law == pytest.approx(math.radians(0.3))
    assert setup.model.effects == ("gravity", "drag")
    assert setup.model.parameters["drag"] == {"drag_coefficient": 0.47}


def test_bodies_and_air_are_read() -> None:
    setup = read_setup(WHOLE)
    assert setup.ball is not None
    assert setup.ball.mass == pytest.approx(0.353)
    assert setup.ball.diameter == pytest.approx(0.20175)
    assert setup.ball.launch_angle == pytest.approx(math.radians(8.5))
    pendulum = setup.pendulum
    assert pendulum is not None
    assert (pendulum.length, pendulum.inertia, pendulum.mass, pendulum.com) == pytest.approx(
        (0.5541, 1.579, 6.0, 0.4553)
    )
    assert pendulum.mass_at_contact == pytest.approx(5.1667)
    assert (setup.air.density, setup.air.viscosity) == pytest.approx((1.180, 1.852e-5))
    jokku = setup.balls["jokku"]
    assert jokku.cor is not None
    assert float(jokku.cor(3.0)) == pytest.approx(0.1305 * math.exp(-0.2685 * 3 - 0.1953) + 0.6746)
    (outcome,) = jokku.contact_outcome
    assert outcome.model_dump() == {
        "impact_speed": 1.1, "cor": 0.7617, "contact_time": 0.0160, "pendulum_speed_after": 0.974,
        "pendulum_angle": 0.1610, "ball_x": 0.0075, "ball_y": 0.4141, "ball_vx": 1.80,
        "ball_vy": 0.17,
    }  # fmt: skip


def test_weather_gives_the_air_where_no_density_does() -> None:
    warm = read_setup('[air]\ntemperature = "35 degC"\npressure = "1013.25 hPa"\nhumidity = 0.5')
    cold = read_setup('[air]\ntemperature = "5 degC"\npressure = "1013.25 hPa"\nhumidity = 0.5')
    assert cold.air.density > 1.25 > 1.15 > warm.air.density


def test_an_empty_file_says_nothing() -> None:
    setup = read_setup("")
    assert setup.ball is None
    assert setup.pendulum is None
    assert setup.camera.capture_fps is None


@pytest.mark.parametrize(
    ("text", "nearest"),
    [
        ("[camra]\ncapture_fps = 600", "camera"),
        ("[camera]\ndistance_to_wal = 4", "distance_to_wall"),
        ('[wall]\nfine_gird = "1 cm"', "fine_grid"),
        ("[ball]\ndiamter = 0.2", "diameter"),
        ("[balls.jokku]\nmas = 0.3", "mass"),
        ("[pendulum]\ninertai = 1.5", "inertia"),
        ("[support]\nheigth = 0.3", "height"),
        ("[air]\nhumidty = 0.5", "humidity"),
        ("[scatter]\nbackswng = 0.1", "backswing"),
        ("[noise]\npositoin = 0.1", "position"),
        ('[balls.a]\ndiameter = "2 cm"\n[[balls.a.contact_outcome]]\nball_xx = 1', "ball_x"),
        ("[Ball]\nmass = 0.3", "ball"),
        ("[Kugel]\nmass = 0.3", "ball"),
        ("[ball]\nlaunchAngle = 0.3", "launch_angle"),
        ("[ball]\nlaunch-angle = 0.3", "launch_angle"),
        ("[camera]\nframe_rate = 600", "capture_fps"),
        ("[ball]\nradius = 0.1", "diameter', twice the radius"),
    ],
)
def test_an_unknown_key_names_the_nearest(text: str, nearest: str) -> None:
    with pytest.raises(SetupError, match=f"nearest is '{nearest}"):
        read_setup(text)


@pytest.mark.parametrize(
    ("text", "typed", "advice"),
    [
        ('[scatter]\ncor = "abc"', "'abc'", "Write a number there, without quotes."),
        ("ball = 3", "'3'", "Write a table: its name in brackets, then a line for each key."),
        ("[ball]\nfoo = 1", "foo", "Correct the key, or delete its line."),
    ],
)
def test_a_mistake_is_shown_with_what_to_do(text: str, typed: str, advice: str) -> None:
    with pytest.raises(SetupError) as refused:
        read_setup(text)
    assert typed in refused.value.message
    assert refused.value.hint == advice


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[camera\n", "not valid TOML"),
        ('[wall]\ngrid = "50 kg"', "50 kg"),
        ("[wall]\ngrid = 50", "wall.grid: 50: a square"),
        ('[wall]\ngrid = "-50 mm"', "wall.grid"),
        ("[camera]\ncapture_fps = 0", "capture_fps"),
        ("[ball]\nmass = 0.3", "no diameter"),
        ('[ball]\npreset = "football"', "football"),
        ('[balls.a]\ndiameter = "0.2 m"\ncor = "__import__(\'os\')"', "cor"),
        ("[air]\nhumidity = 50", "humidity"),
        ("[model.drag]\ndrag_coefficient = 'big'", "'big' can't be read as"),
        ("[support]\nheight = 0.3 m", 'quotation marks: height = "0.3 m"'),
        ('[support]\nheight = "0.3 m', 'quotation marks: height = "0.3 m"'),
        ("[support]\nheight = 1\nheight = 2", "height stands twice"),
        ('[support]\nheight = "0.3 m ± some"', "'some' in"),
        ('[support]\nheight = "0.3 kg"', "such as '0.3120 m'"),
        ('[camera]\ngrid = "50 mm"', "it belongs in the table [wall]"),
        ('[ball]\npreset = "jocku"', "did you mean 'jokku'"),
        ("[ball]\nspin = 1", "known are preset, mass"),
        ("[wall]\ngrid = “50 mm”", 'straight ones: grid = "50 mm"'),
        ('[camera]\nlens = "C:\\lab\\lens.toml"', 'lens = "C:/lab/lens.toml"'),
        ("// my lab", "comment begins with #: # my lab"),
        ("[ball]\nmass: 0.353 kg", 'Write mass = "0.353 kg"'),
        ("ball:\n  mass: 1 kg", "[ball]"),
        ('{"ball": 1}', "It is JSON"),
        ("[ball]\nmass =", "Write the value of mass"),
    ],
)
def test_a_wrong_value_is_told_with_its_place(text: str, said: str) -> None:
    with pytest.raises(SetupError) as refused:
        read_setup(text, "lab.toml")
    assert said in str(refused.value)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match=r"nowhere\.toml"):
        load_setup(tmp_path / "nowhere.toml")


def test_an_incomplete_ball_says_what_is_missing() -> None:
    ball = read_setup('[ball]\ndiameter = "0.2 m"\nmass = "0.3 kg"').ball
    assert ball is not None
    with pytest.raises(SetupError, match="no launch_angle and no cor"):
        ball.body()


@pytest.mark.parametrize(
    ("text", "diameter", "mass"),
    [
        ("220 mm, 0.35 kg", 0.22, 0.35),
        ("0,22 m,0,35 kg", 0.22, 0.35),
        ("0,22 m", 0.22, None),
        ("jokku, 400 g", 0.20175, 0.4),
    ],
)
def test_a_ball_is_a_size_with_or_without_mass(
    text: str, diameter: float, mass: float | None
) -> None:
    ball = ball_from_option(text)
    assert (ball.diameter, ball.mass) == (pytest.approx(diameter), pytest.approx(mass))


def test_a_wrong_mass_is_refused() -> None:
    with pytest.raises(UsageError, match="mass"):
        ball_from_option("220 mm, 350 kg")
