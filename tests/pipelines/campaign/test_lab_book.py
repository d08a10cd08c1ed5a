"""The lab book as people write it: separators, commas, spreadsheets, slips."""

from pathlib import Path

import pandas as pd
import pytest

from metrology import UsageError
from pipelines.campaign.results import (
    SENSORS,
    match_clips,
    not_counted,
    read_lab_book,
    recordings,
    with_known_balls,
)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(("mark", "comma"), [(",", "."), (";", ","), ("\t", ","), (";", ".")])
def test_separators_commas_and_encodings_are_recognised(
    tmp_path: Path, mark: str, comma: str, encoding: str
) -> None:
    path = tmp_path / "trials.csv"
    rows = [["clip", "ball", "backswing_deg", "wer"], ["a.mp4", "jokku", f"62{comma}5", "Jürgen"]]
    path.write_text("\n".join(mark.join(row) for row in rows) + "\n", encoding=encoding)
    (strike,) = read_lab_book(path).strikes
    assert (strike.clip, strike.ball, strike.backswing_deg) == ("a.mp4", "jokku", 62.5)
    assert strike.cells["wer"] == "Jürgen"


def test_a_spreadsheet_with_dates_is_read(tmp_path: Path) -> None:
    path = tmp_path / "trials.xlsx"
    when = pd.Timestamp("2026-03-01")
    pd.DataFrame({"clip": ["a"], "session": [when], "landing_tape_m": [1.5]}).to_excel(
        path, index=False
    )
    (strike,) = read_lab_book(path).strikes
    assert strike.session is not None
    assert strike.session.startswith("2026-03-01")
    landing = next(sensor for sensor in SENSORS if sensor.column == "landing_tape_m")
    assert strike.sensor(landing)[0] == 1.5


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name,ball\na,jokku\n", "no column 'clip'"),
        ("clip,ball\na,jokku\na,jokku\n", "twice"),
        ("clip,backswing_deg\na,sixty\n", "line 2: backswing_deg"),
        ("clip,landing_tape_m\na,-3\n", "line 2: landing_tape_m"),
        ("clip,contact_time_fsr_s\na,15\n", "15 s"),
        ("clip,landing_tape_m,landing_tape_m_std\na,1.2,0\n", "must be positive"),
        ("clip,ball,ball\na,x,y\n", "two columns"),
        ("clip,ball\n", "no line"),
        ("clip,backswing_deg\na,nan\n", "not a number"),
        ("clip,ball\n,jokku\n", "line 2: the clip's name is missing"),
    ],
)
def test_slips_are_named_with_their_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "trials.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match=said):
        read_lab_book(path)


def test_clips_match_with_and_without_ending_and_absent_ones_are_told(tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    path.write_text("clip,ball\na,jokku\nb.mov,jokku\nc,jokku\n")
    clips = (Path("one/a.mp4"), Path("one/b.mov"), Path("one/d.mp4"))
    matched = match_clips(read_lab_book(path), clips)
    assert [strike and strike.clip for strike in matched.strikes.values()] == ["a", "b.mov", None]
    assert [strike.clip for strike in matched.absent] == ["c"]


def test_two_clips_of_one_name_are_refused() -> None:
    with pytest.raises(UsageError, match="two clips are called"):
        match_clips(None, (Path("one/a.mp4"), Path("two/a.mp4")))


def test_a_mark_on_the_name_that_counted_is_asked_about() -> None:
    (one,) = recordings([{"a": "not at rest", "b": None, "c": None}], dict.fromkeys("abc"))
    assert (one.counted, one.marked) == ("b", "a")
    assert "Mark it as bad too" in one.message()
    assert not_counted([one]) == {"c": "the same recording as b"}
    assert recordings([{"a": None, "b": "a copy"}], dict.fromkeys("ab")) == ()
    assert recordings([{"a": None, "b": None}], {"a": None}) == ()


def test_sixteen_bits_without_a_mark_are_told_as_such(tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    path.write_bytes("clip,ball\na,jokku\n".encode("utf-16-le"))
    with pytest.raises(UsageError, match="UTF-16 without a byte order mark") as refused:
        read_lab_book(path)
    assert refused.value.hint == "Save it as CSV in UTF-8, or as .xlsx."


@pytest.mark.parametrize(
    ("head", "cell", "column", "value"),
    [
        ("landing_tape_cm", "193,7", "landing_tape_m", 1.937),
        ("Landing tape (mm)", "1937", "landing_tape_m", 1.937),
        ("landing_tape_m", "1.937", "landing_tape_m", 1.937),
        ("backswing (rad)", "1.5708", "backswing_deg", 90.0),
        ("Backswing_deg", "62,5", "backswing_deg", 62.5),
        ("contact_time_fsr [ms]", "14.5", "contact_time_fsr_s", 0.0145),
        ("landing_tape_cm_std", "0,5", "landing_tape_m_std", 0.005),
        ("impact_speed_encoder_km_h", "18", "impact_speed_encoder_m_s", 5.0),
    ],
)
def test_other_units_and_spellings_are_converted(
    tmp_path: Path, head: str, cell: str, column: str, value: float
) -> None:
    path = tmp_path / "trials.csv"
    path.write_text(f'CLIP;Ball;{head}\na.mp4;jokku;"{cell}"\n')
    book = read_lab_book(path)
    (strike,) = book.strikes
    assert (strike.clip, strike.ball) == ("a.mp4", "jokku")
    assert strike.cells[column] == pytest.approx(value, rel=1e-4)
    assert head == column or head == "Backswing_deg" or any(head in note for note in book.notes)


@pytest.mark.parametrize("head", ["backswing", "landing tape", "contact_time_fsr"])
def test_a_known_column_without_a_unit_is_refused(tmp_path: Path, head: str) -> None:
    path = tmp_path / "trials.csv"
    path.write_text(f"clip,{head}\na.mp4,62\n")
    with pytest.raises(UsageError, match="states no unit") as refusal:
        read_lab_book(path)
    assert head.replace(" ", "_") + "_" in str(refusal.value.hint)


@pytest.mark.parametrize(
    "text", ['clip,note\na,x\n"b,y\nc,z\n"d,w\n', 'clip,note\na,x\nb,"two\nlines"\n']
)
def test_a_cell_over_several_lines_is_refused_with_its_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "trials.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match="line 3: the quotation mark"):
        read_lab_book(path)


@pytest.mark.parametrize(
    ("text", "column", "value"),
    [
        ("Video;Kugel;Auslenkung (°)\na;jokku;90,5\n", "backswing_deg", 90.5),
        ("Lab 3\nclip,ball,backswing_deg\na,jokku,90 deg\n", "backswing_deg", 90.0),
        ("clip,ball,landing tape [cm]\na,jokku,250.5\n", "landing_tape_m", 2.505),
        ("clip,ball,landing_tape_m\na,jokku,250.5 cm\n", "landing_tape_m", 2.505),
    ],
)
def test_other_names_places_and_units(text: str, column: str, value: float, tmp_path: Path) -> None:
    path = tmp_path / "book.csv"
    path.write_text(text, encoding="utf-8")
    (row,) = read_lab_book(path).strikes
    assert (row.clip, row.ball) == ("a", "jokku")
    assert row.cells[column] == pytest.approx(value)


def test_a_column_that_is_not_used_is_listed_with_the_name_that_may_be_meant(
    tmp_path: Path,
) -> None:
    path = tmp_path / "book.csv"
    path.write_text("clip,landing (cm),weather\na,250,fine\n", encoding="utf-8")
    book = read_lab_book(path)
    assert any("landing (cm), weather" in note and "landing_tape_cm" in note for note in book.notes)
    assert with_known_balls(book, ["Jokku"]).strikes == book.strikes


def test_letter_case_of_a_ball_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "book.csv"
    path.write_text("clip,ball\na,JOKKU\n", encoding="utf-8")
    assert with_known_balls(read_lab_book(path), ["Jokku"]).strikes[0].ball == "Jokku"


@pytest.mark.timeout(20)
def test_a_book_that_runs_sideways_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "book.csv"
    path.write_text("clip," + ",".join(map(str, range(200_000))) + "\na" + 200_000 * "," + "\n")
    with pytest.raises(UsageError, match="more than 2000 columns"):
        read_lab_book(path)


@pytest.mark.timeout(20)
def test_a_book_of_a_million_rows_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    path.write_text("clip,x\n" + "a,1\n" * 10**6)
    with pytest.raises(UsageError, match="one row per clip"):
        read_lab_book(path)
