"""Reading tables: recognised formats are reported, damaged tables refused."""

import os

import numpy as np
import pandas as pd
import pytest

from metrology import UsageError
from pipelines.explain.tabular import numbers_of, read_sheet

UNITS = {"t": "s", "x": "m", "phi": "rad"}
PLAIN = "trial,t_s,x_m\n1,0.0,0.125\n1,0.1,0.25\n1,0.2,-1.5\n"


def sheet_of(tmp_path, raw):
    path = tmp_path / "ball.csv"
    path.write_bytes(raw if isinstance(raw, bytes) else raw.encode())
    return read_sheet(path, UNITS, ("trial",))


def column(sheet, name="x_m"):
    notes = list(sheet.notes)
    return numbers_of(sheet.table, name, sheet.name, notes), notes


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        (PLAIN, None),
        (PLAIN.replace("\n", "\r\n"), None),
        (PLAIN.encode("utf-8-sig"), None),
        (PLAIN.encode("utf-16"), "read as utf-16"),
        (PLAIN.encode("utf-16-le"), "read as utf-16-le"),
        (PLAIN.replace(",", ";"), "separated by semicolons"),
        (PLAIN.replace(",", "\t"), "separated by tabs"),
        (PLAIN.replace(",", ";").replace(".", ","), "decimal commas"),
        ('trial,t_s,x_m\n1,0,"0,125"\n1,0,"0,25"\n1,0,"-1,5"\n', "decimal commas"),
        ("trial,t_s,x_mm\n1,0,125\n1,0.1,250\n1,0.2,-1500\n", "x_mm is converted"),
        (PLAIN.replace("t_s", "t_s,größe").replace("\n1,", "\n1,0,").encode("cp1252"), "cp1252"),
    ],
)
def test_the_same_numbers_come_of_every_way_to_write_them(tmp_path, raw, said):
    values, notes = column(sheet_of(tmp_path, raw))
    assert values == pytest.approx([0.125, 0.25, -1.5])
    assert [note for note in notes if said and said in note] or (said is None and not notes)


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "not text"),
        (PLAIN.replace("x_m", "t_s"), "two columns called t_s"),
        ("trial,t_s,x_m\n1,0,1,0,125\n", "5 fields"),
        ("trial,t_s,x_m,x_mm\n1,0,1,1000\n", "same quantity"),
        ("trial,t_s,x_m\n1,0,1\n1,0,1,2\n", "4 fields"),
    ],
)
def test_what_can_be_read_in_two_ways_or_in_none_is_refused(tmp_path, raw, said):
    with pytest.raises(UsageError, match=said):
        sheet_of(tmp_path, raw)


def test_cells_that_are_no_numbers_are_counted_and_named(tmp_path):
    raw = "trial,t_s,x_m\n1,0,0.1\n1,1,lost\n1,2,inf\n1,3,\n1,4,0.5\n"
    values, notes = column(sheet_of(tmp_path, raw))
    assert np.isfinite(values).tolist() == [True, False, False, False, True]
    assert "1 of 5 cells of x_m are not numbers (row 2: 'lost')" in notes[0]
    assert "1 of 5 cells of x_m are infinite (row 3" in notes[1]


@pytest.mark.parametrize("cell", ["abc", "12 mm", "1.234,5"])
def test_a_column_of_words_is_refused_with_the_first_of_them(tmp_path, cell):
    sheet = sheet_of(tmp_path, f"trial;t_s;x_m\n1;0;{cell}\n1;1;{cell}\n")
    with pytest.raises(UsageError, match=f"row 1 is '{cell}'"):
        column(sheet)


def test_a_comma_that_may_part_thousands_is_refused(tmp_path):
    sheet = sheet_of(tmp_path, "trial;t_s;x_m\n1;0;1,234\n1;1;2,345\n")
    with pytest.raises(UsageError, match="thousand or a decimal"):
        column(sheet)


def test_uncertainties_that_are_none_are_told():
    table = pd.DataFrame({"x_m_std": [0.1, 0.0, -1.0, np.inf]})
    notes = []
    values = numbers_of(table, "x_m_std", "the table", notes, positive=True)
    assert np.isfinite(values).tolist() == [True, False, False, False]
    assert "2 of 4 cells of x_m_std are not positive" in notes[1]


@pytest.mark.parametrize("cells", [[0.0, 0.0, 0.0], ["0", "0,0", ""], [0.1, 0.0, -1.0]])
def test_what_is_said_to_be_exact_is_refused(cells):
    with pytest.raises(UsageError, match="no measurement is exact") as refused:
        numbers_of(pd.DataFrame({"x_m_std": cells}), "x_m_std", "b.csv", [], positive=True)
    assert "b.csv" in refused.value.message
    assert "omit the column" in refused.value.hint


def test_pipes_devices_and_folders_are_refused_at_once(tmp_path):
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path, tmp_path / "nowhere.csv", tmp_path / ("x" * 5000)):
        with pytest.raises(UsageError, match="can't read"):
            read_sheet(path, UNITS)


def test_a_table_without_end_is_thinned_evenly_and_told(tmp_path, monkeypatch):
    monkeypatch.setattr("pipelines.explain.tabular.MAX_TABLE_ROWS", 100)
    monkeypatch.setattr("pipelines.explain.tabular.CHUNK_ROWS", 64)
    raw = "trial,t_s,x_m\n" + "".join(f"1,{k},{k}\n" for k in range(500))
    values, notes = column(sheet_of(tmp_path, raw))
    assert values.tolist() == list(range(0, 500, 6))
    assert any("one in 6 is read" in note for note in notes)


def test_a_table_that_runs_sideways_is_refused_at_once(tmp_path):
    wide = ",".join(["trial", *(f"c{k}" for k in range(500_000))])
    with pytest.raises(UsageError, match="more than 2000 columns"):
        sheet_of(tmp_path, f"{wide}\n{',1' * 500_000}\n")
