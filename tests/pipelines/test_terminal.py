"""Words on the terminal stay as they are."""

import os
from pathlib import Path

import pytest
from rich.table import Table

import pipelines
from metrology import Contribution, Quantity, write_text_whole
from pipelines.measure.files import without_formulas
from pipelines.model import send_out
from pipelines.terminal import counted, screen


def test_brackets_and_colons_in_tables_are_words(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(title="[title] :smile:")
    table.add_column("[b]head[/b]")
    table.add_row("give [support] height, see [/] and [link=x]y")
    screen().print(table)
    screen(errors=True).print("warning: [support] height")
    printed = capsys.readouterr()
    for words in ("[title] :smile:", "[b]head[/b]", "give [support] height, see [/]", "[link=x]y"):
        assert words in printed.out
    assert "[support] height" in printed.err


def test_control_characters_of_names_are_shown_and_not_obeyed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    table = Table()
    table.add_column("clip")
    table.add_row("\x1b[31mred\x07.mp4")
    screen().print(table)
    screen(errors=True).print("vision: can't read \x9b2J.mp4")
    printed = capsys.readouterr()
    assert "\\x1b[31mred\\x07.mp4" in printed.out
    assert "\\x9b2J.mp4" in printed.err


def test_a_terminal_of_no_width_still_shows_tables(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "0")
    table = Table()
    table.add_column("quantity")
    table.add_row("ball_speed")
    screen().print(table)
    assert "ball_speed" in capsys.readouterr().out


def test_a_reason_that_names_a_table_of_the_setup_file_is_told_whole(
    capsys: pytest.CaptureFixture[str],
) -> None:
    known = Quantity.measured("ball_speed", 3.0, "m/s", (Contribution("noise", 0.1),))
    missing = Quantity.missing("landing_time", "s", "give [support] height")
    send_out("[x]", (known, missing), ("[air]",), json_to=None, csv_to=None, quiet=False)
    printed = capsys.readouterr()
    assert "[support] height" in printed.out
    assert "[air]" in printed.err


def test_nobody_prints_past_it() -> None:
    folder = Path(pipelines.__file__).parent
    makers = [path.name for path in folder.rglob("*.py") if " Console(" in path.read_text("utf-8")]
    assert [name for name in makers if name not in ("terminal.py", "cli.py")] == []


def test_names_that_are_no_text_are_shown_and_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    name = os.fsdecode(b"a\xff\x1b=.mp4")
    screen().print(name)
    assert capsys.readouterr().out.strip() == r"a\udcff\x1b=.mp4"
    row = without_formulas({"clip": name, "note": "=1+1", "value": 1.5})
    assert row == {"clip": "a\ufffd\ufffd=.mp4", "note": "'=1+1", "value": 1.5}
    write_text_whole(tmp_path / "a.csv", str(row["clip"]))


def test_a_warning_of_many_clips_is_shown_once_with_their_number() -> None:
    said = counted([["rate 599.2 fps", "no mass"], ["rate 600.1 fps"], []])
    assert said == [
        "warning, 2 of 3 clips: rate 599.2 fps",
        "warning, 1 of 3 clips: no mass",
    ]
