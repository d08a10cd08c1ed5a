"""`vision law`: laws from tables with known truth, real drops, and damaged tables."""

import json
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import impact_vision as iv
from measuring.setup.cor_file import read_cor_file
from metrology import DomainError, ImpactVisionError, TooLittleDataError, UsageError
from physics.air import PAPER_AIR, standard_drag
from physics.bodies import BALLS, GRAVITY
from physics.cor_fit import AveragedLaw
from physics.rebound import FallingBall
from pipelines.cli import app
from tests.shared_data import shared_folder

MASS, DIAMETER = 2.7e-3, 0.040


def _fall(speed: float, up: bool) -> tuple[float, float]:
    """Height and time of a table-tennis ball thrown up at `speed`, or fallen to it (scipy)."""

    def slope(_: float, state: np.ndarray) -> list[float]:
        v = state[1]
        drag = standard_drag(PAPER_AIR.reynolds(max(v, 1e-9), DIAMETER))
        k = 0.5 * PAPER_AIR.density * drag * np.pi * (DIAMETER / 2) ** 2 / MASS
        return [v, -GRAVITY - k * v**2 if up else GRAVITY - k * v**2]

    def end(_: float, state: np.ndarray) -> float:
        return float(state[1] if up else state[1] - speed)

    end.terminal = True  # type: ignore[attr-defined]
    start = [0.0, speed if up else 0.0]
    run = solve_ivp(slope, (0, 5), start, events=end, rtol=1e-9, atol=1e-12)
    return float(run.y[0, -1]), float(run.t[-1])


def test_drag_is_removed_from_heights_and_times() -> None:
    ball = FallingBall(MASS, DIAMETER, PAPER_AIR, 0.6)
    drop, _ = _fall(2.5, up=False)
    rise, rising = _fall(2.2, up=True)
    assert float(ball.speed_after_fall(np.array(drop))) == pytest.approx(2.5, rel=1e-5)
    assert float(ball.speed_of_rise(np.array(rise))) == pytest.approx(2.2, rel=1e-5)
    impact = _speed_after_fall(rise)
    falling = _fall(impact, up=False)[1]
    height = float(ball.height_of_flight(np.array(rising + falling)))
    assert height == pytest.approx(rise, rel=1e-5)


def _speed_after_fall(height: float) -> float:
    """Speed after a fall from this height, by bisection of `_fall`."""
    low, high = 0.1, 5.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _fall(middle, up=False)[0] < height else (low, middle)
    return low


def _concave(rng: np.random.Generator) -> pd.DataFrame:
    v = rng.uniform(0.5, 2.3, 60)
    e = 0.95 - 0.03 * np.maximum(0.0, v - 1.2) ** 1.5 + rng.normal(0, 0.004, 60)
    return pd.DataFrame({"impact_speed": v, "e": e})


def test_concave_data_fit_no_parametric_law(tmp_path: Path) -> None:
    found = iv.law(_concave(np.random.default_rng(0)))
    ball = found.to_dict()["balls"]["ball"]
    assert ball["law"] == "free"
    assert ball["statement"].startswith("None of the parametric laws fits")
    assert ball["lack_of_fit_p"] is None
    found.save(tmp_path / "cor.toml")
    saved = read_cor_file(tmp_path / "cor.toml")["ball"].law
    for at in ball["cor_at"]:
        assert saved(at["speed"]) == pytest.approx(at["value"], abs=0.001)


@pytest.mark.parametrize(
    ("name", "speeds", "truth"),
    [
        ("jokku", (1.1233, 2.3054, 3.2144, 3.9162), (0.1305 * np.exp(-0.1953), 0.2685, 0.6746)),
        ("basketball", (1.0364, 2.2144, 3.1223, 3.825), (0.2235 * np.exp(-0.7226), 0.2221, 0.8327)),
    ],
)
def test_the_papers_laws_come_back(
    name: str, speeds: tuple[float, ...], truth: tuple[float, ...]
) -> None:
    v = np.array(speeds)
    table = pd.DataFrame({"ball": name, "v (m/s)": v, "e": np.round(BALLS[name].cor(v), 4)})
    found = iv.law(table).to_dict()["balls"][name]
    assert found["law"] == "exponential"
    for item, value in zip(found["parameters"].values(), truth, strict=True):
        assert abs(item["value"] - value) < 2 * item["std"]
    for at in found["cor_at"]:
        assert at["value"] == pytest.approx(float(BALLS[name].cor(at["speed"])), abs=2 * at["std"])
        assert at["std"] < 0.01


def test_the_band_holds_new_levels() -> None:
    rng = np.random.default_rng(8)
    held = []
    for _ in range(12):
        v = np.linspace(1.0, 4.0, 9)
        level = 0.8 - 0.02 * v + rng.normal(0, 0.015, 9)
        e = level[:, None] + rng.normal(0, 0.006, (9, 10))
        used = np.arange(9) % 2 == 0
        rows = pd.DataFrame({"v": np.repeat(v[used], 10), "e": e[used].ravel()})
        law = iv.law(rows)
        at = law.balls["ball"]
        for k in np.flatnonzero(~used):
            band = AveragedLaw(at.fits).level_mean(v[k], 10)
            held.append(band.low <= e[k].mean() <= band.high)
        assert at.test.p is not None
        assert at.test.p < 1e-3
    assert np.mean(held) >= 0.85


def test_real_heights_and_times() -> None:
    heights, times = (
        shared_folder("realdata/rebound_heights"),
        shared_folder("realdata/rebound_times"),
    )
    table = pd.read_csv(heights / "cor.csv")
    held = []
    for use, columns in ((None, ["ball", "v_in", "e"]), ("h", ["ball", "h0_cm", "h1_cm"])):
        found = iv.law(table[columns], setup=heights / "setup.toml" if use else None)
        for ball in found.balls.values():
            assert ball.test.p is not None
            points, document = ball.points, ball.to_dict()
            assert points.level is not None
            for at in document["cor_at"]:
                own = np.isclose(points.speed, at["speed"])
                if own.any():
                    mean = points.cor[own].mean()
                    held.append(abs(mean - at["value"]) <= 1.96 * at["std"])
        assert not any(ball.none_fits for ball in found.balls.values())
    assert len(held) == 40
    assert sum(held) >= 36
    bounces = pd.read_csv(times / "cor.csv")
    bounces = bounces[bounces.ball == "pingpong"]
    given = iv.law(bounces).to_dict()["balls"]["pingpong"]
    assert given["none_of_the_parametric_laws_fits"]
    free = iv.law(bounces, setup=heights / "setup.toml", speeds_from="times")
    corrected = free.to_dict()["balls"]["pingpong"]
    assert corrected["law"] == "constant"
    assert corrected["parameters"]["d"]["value"] == pytest.approx(0.953, abs=0.002)


def test_times_between_bounces_are_paired_within_a_series() -> None:
    e, first = 0.8, np.array([0.6, 0.7])
    rows = [(s, t * e**k) for s, t in enumerate(first) for k in range(5)]
    found = iv.law(pd.DataFrame(rows, columns=["session", "time_between_bounces (s)"]))
    ball = found.balls["ball"]
    assert len(ball.points.cor) == 8
    np.testing.assert_allclose(ball.points.cor, e)
    assert any("drag" in text for text in found.warnings)


HEAD = "drop_height (cm);rebound_height (cm)\n"


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("", 2, "is empty"),
        (HEAD, 4, "no rows"),
        (HEAD + "50;30\n", 4, "too few"),
        (HEAD + "50;30\n40;24\n30;-3\n", 2, "row 3"),
        (HEAD + "50;30\n40;24\n30;33\n", 2, "above 1"),
        (HEAD + "50;30\n40;24\n30;0,18\n", 2, "row 3"),
        (HEAD + "50;30\n40;24\n0,45;0,27\n0,4;0,24\n45;27\n", 2, "Units seem to differ"),
        (HEAD + "50;35\n0,5;0,35\n100;68\n1;0,68\n150;99\n200;130\n", 2, "rows 2, 4 differ"),
        (HEAD + '50;30\n"40;24\n30;18\n20;12\n10;"6\n', 2, "quotation mark"),
        (HEAD + "50;30\n40;abc\n", 2, "abc"),
        ("t_s,y_m\n0,1\n1,2\n", 2, "no columns found"),
    ],
)
def test_damaged_tables(tmp_path: Path, text: str, code: int, words: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    done = CliRunner().invoke(app, ["law", str(path)])
    assert done.exit_code == code, done.output
    assert words in " ".join(done.output.split())


def test_levels_with_one_repeat_say_why_there_is_no_test() -> None:
    table = pd.DataFrame({"level": [1, 2, 3, 4], "v": [1.0, 2, 3, 4], "e": [0.8, 0.79, 0.8, 0.78]})
    found = iv.law(table).to_dict()["balls"]["ball"]
    assert found["lack_of_fit_p"] is None
    assert "one row" in found["lack_of_fit_reason"]


def test_a_table_that_runs_sideways_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(",".join(["v", "e", *(f"c{k}" for k in range(200_000))]) + "\n1,0.8\n")
    done = CliRunner().invoke(app, ["law", str(path)])
    assert done.exit_code == 2
    assert "more than 2000 columns" in done.output


def test_command_writes_everything(tmp_path: Path) -> None:
    path = tmp_path / "drops.csv"
    rows = "".join(
        f"{h};{h * f:.2f}\n".replace(".", ",") for h in (20, 40, 80) for f in (0.6, 0.62)
    )
    path.write_text("Drop height (cm);Rebound height (cm)\n" + rows)
    names = {key: str(tmp_path / key) for key in ("law.html", "cor.toml", "law.json")}
    options = ["--report", names["law.html"], "--save", names["cor.toml"], "--json"]
    done = CliRunner().invoke(app, ["law", str(path), *options, names["law.json"]])
    assert done.exit_code == 0, done.output
    assert "Most probable law" in done.output
    ball = json.loads(Path(names["law.json"]).read_text())["balls"]["ball"]
    assert ball["lack_of_fit_p"] is not None
    assert 0.76 < ball["cor_at"][0]["value"] < 0.80
    assert Path(names["law.html"]).read_text().count("<figure") == 1


def test_mistaken_options_are_errors() -> None:
    with pytest.raises(UsageError, match="speeds from"):
        iv.law(_concave(np.random.default_rng(1)), speeds_from="weights")
    with pytest.raises(DomainError):
        iv.law(pd.DataFrame({"v": [1.0, -2, 3], "e": [0.8, 0.8, 0.8]}))
    with pytest.raises(TooLittleDataError):
        iv.law(pd.DataFrame({"v": [1.0], "e": [0.8]}))


_HEADS = {
    "German": "Fallhöhe (cm);Rücksprunghöhe (cm)",
    "French": "Hauteur de chute (cm);Hauteur de rebond (cm)",
    "Spanish": "ALTURA INICIAL (CM);ALTURA DE REBOTE (CM)",
    "a title": "Drops of 3 May\nh0 / cm;h1 / cm",
    "a row of units": "drop height;rebound height\ncm;cm",
}


@pytest.mark.parametrize("name", _HEADS)
def test_heads_in_other_languages_and_places(name: str, tmp_path: Path) -> None:
    heights = np.array([50.0, 80.0, 100.0, 120.0, 150.0])
    rows = "".join(f"{h:.1f};{0.6 * h:.2f}\n".replace(".", ",") for h in heights)
    path = tmp_path / "a.csv"
    path.write_text(f"{_HEADS[name]}\n{rows}", encoding="utf-8")
    found = iv.law(path).balls["ball"]
    assert found.points.speed == pytest.approx(np.sqrt(2 * 9.80665 * heights / 100), rel=1e-3)
    assert found.points.cor == pytest.approx(np.sqrt(0.6), rel=1e-3)


@pytest.mark.parametrize("head", ["", " (cm)"])
def test_each_height_keeps_the_unit_of_its_cell(head: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "1.2 m,67.5 cm\n80 cm,0.45 m\n500 mm,28.125cm\n" + ("150,84.375\n" if head else "")
    path.write_text(f"drop_height{head},rebound_height{head}\n{rows}", encoding="utf-8")
    found = iv.law(path).balls["ball"]
    heights = [1.2, 0.8, 0.5, *([1.5] if head else [])]
    assert found.points.speed == pytest.approx(np.sqrt(2 * 9.80665 * np.array(heights)), rel=1e-3)
    assert found.points.cor == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("drop_height,rebound_height\n50 cm,30 cm\n1,0.61\n1.5 m,88 cm\n", "a unit in row 1 and"),
        ("drop_height,rebound_height\n50,30\n100,61\n150,88\n", "'drop_height' states no unit"),
        ("drop_height_m,rebound_height_m\n0.3,0.5\n0.6,1\n0.9,1.5\n", "are exchanged"),
        ("ball,impact_speed,ball_speed\njocku,1,1.6\njocku,2,3.2\n", "did you mean 'jokku'"),
    ],
)
def test_likely_mistakes_are_named_first(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ImpactVisionError) as refused:
        iv.law(path)
    assert said in refused.value.message


@pytest.mark.timeout(20)
def test_a_table_of_a_million_rows_is_refused_at_once() -> None:
    table = pd.DataFrame({"impact_speed_m_s": np.linspace(1, 5, 10**6), "e": 0.7})
    with pytest.raises(UsageError, match="1,000,000 rows"):
        iv.law(table)


def test_the_same_run_gives_the_same_bytes_and_a_date_only_if_asked(tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    rows = "".join(f"{h} cm,{0.6 * h:.1f} cm\n" for h in (50, 80, 100, 120, 150))
    table.write_text(f"drop_height,rebound_height\n{rows}", encoding="utf-8")
    pages = []
    for name, more in (("a", []), ("b", []), ("c", ["--date"])):
        page = tmp_path / f"{name}.html"
        ran = CliRunner().invoke(app, ["law", str(table), "--report", str(page), *more])
        assert ran.exit_code == 0
        pages.append(page.read_bytes())
    today = date.today().isoformat().encode()
    assert pages[0] == pages[1]
    assert today not in pages[0]
    assert today in pages[2]
