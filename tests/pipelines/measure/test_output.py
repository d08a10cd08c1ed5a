"""Rows for spreadsheets."""

import pytest

from pipelines.measure.files import harmless


@pytest.mark.parametrize("name", ["=cmd|'/c calc'!A0.mp4", "+1.mp4", "-1.mp4", "@SUM(A1).mp4"])
def test_a_clips_name_is_no_formula(name: str) -> None:
    row = harmless({"clip": name, "ball_speed_m_s": -1.5, "reason_cor": "a = b"})
    assert row == {"clip": f"'{name}", "ball_speed_m_s": -1.5, "reason_cor": "a = b"}
