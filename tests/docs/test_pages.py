"""Pages of the docs: lengths, inserted numbers, names of tests, and links."""

import re
import tomllib
from pathlib import Path

import pytest

from bench.insert import INSERT_MARK, filled, pages, read_results, values
from measuring.setup.file import load_setup

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
USER = (
    "index",
    "five-minutes",
    "film",
    "wrong-object",
    "report",
    "setup-file",
    "my-pendulum",
    "no-grid",
    "campaign",
    "explain",
    "python",
    "troubleshooting",
    "glossary",
)
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def words(path: Path) -> int:
    return len(COMMENT.sub("", path.read_text(encoding="utf-8")).split())


@pytest.mark.parametrize(
    ("found", "limit"),
    [
        ([DOCS / f"{name}.md" for name in USER], 10_000),
        ([*(DOCS / "evidence").glob("*.md")], 8_000),
        ([DOCS / "model.md"], 5_000),
        ([ROOT / "CHANGELOG.md"], 1_500),
    ],
    ids=["user", "evidence", "model", "changelog"],
)
def test_pages_stay_short(found: list[Path], limit: int) -> None:
    assert sum(map(words, found)) <= limit


def test_inserted_numbers_are_those_of_the_results() -> None:
    known = values()
    assert len(pages()) > 5
    stale = [p.name for p in pages() if filled(p.read_text("utf-8"), known) != p.read_text("utf-8")]
    assert not stale, f"run python -m bench.insert: {stale}"


def test_a_mark_without_a_result_is_an_error() -> None:
    with pytest.raises(KeyError, match=r"no\.such"):
        filled("<!--=no.such-->1<!--/-->", values())


def test_a_stale_number_is_replaced() -> None:
    key = "demo.ball_speed"
    text = filled(f"<!--={key}-->0<!--/-->", values())
    assert INSERT_MARK.sub("", text) == ""
    assert "± 0.0" in text


def test_the_sample_clip_on_the_pages_is_measured_rightly() -> None:
    """Stored values agree with the truth, and their uncertainties are not absurdly wide."""
    for name, entry in read_results("demo.json").items():
        if entry["true"] is not None:
            assert abs(entry["value"] - entry["true"]) < 4 * entry["std"], name


def test_every_page_is_in_the_navigation() -> None:
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    found = [p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md")]
    assert [name for name in found if f" {name}\n" not in site] == []


def test_tests_named_by_the_page_on_security_exist() -> None:
    page = (DOCS / "evidence" / "security.md").read_text(encoding="utf-8")
    named = re.findall(r"`(test_\w+)`", page)
    source = "\n".join(p.read_text("utf-8") for p in (ROOT / "tests").rglob("test_*.py"))
    assert len(named) > 5
    assert [name for name in named if f"def {name}(" not in source] == []


def test_files_named_by_the_page_on_architecture_exist() -> None:
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:\w+/)+[\w.]*)`", page)
    assert len(named) > 10
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("name", ["setup-file", "my-pendulum"])
def test_set_up_files_on_the_pages_are_valid(name: str, tmp_path: Path) -> None:
    page = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert blocks
    for block in blocks:
        path = tmp_path / "lab.toml"
        path.write_text(block.replace('lens = "lens.toml"', ""), encoding="utf-8")
        load_setup(path)


def test_the_pendulum_of_the_example_has_the_inertia_of_its_set_up_file() -> None:
    page = (DOCS / "my-pendulum.md").read_text(encoding="utf-8")
    block = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)[0]
    stated = float(tomllib.loads(block)["pendulum"]["inertia"].split()[0])
    shown = values()["pendulum.inertia"]()
    assert float(shown.split()[0]) == pytest.approx(stated, abs=5e-4)
