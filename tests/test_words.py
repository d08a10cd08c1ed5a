"""Wording: plain technical terms in docs, docstrings, comments and messages."""

import ast
import io
import re
import subprocess
import sys
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DICTIONARY = ROOT / ".codespell" / "words.txt"
# Files and folders whose words are not rewritten yet, one a line. Remove lines, add none.
UNCONVERTED = tuple((ROOT / ".codespell" / "unconverted.txt").read_text("utf-8").split())
FOLDERS = (
    "bench",
    "calib",
    "impact_vision",
    "measuring",
    "metrology",
    "mismatch",
    "physics",
    "pipelines",
    "sample_videos",
    "tests",
    "vision",
)
PACKAGES = frozenset(FOLDERS) - {"bench", "tests"}
MAX_SUMMARY_CHARACTERS = 80
UNCLEAR_CONSTANT = re.compile(r"_?(FEWEST|LEAST|MOST)(_|$)")


def _is_converted(path: Path) -> bool:
    name = path.relative_to(ROOT).as_posix()
    return not any(name == part or name.startswith(part + "/") for part in UNCONVERTED)


MODULES = [
    path
    for folder in FOLDERS
    for path in sorted((ROOT / folder).rglob("*.py"))
    if _is_converted(path) and path != Path(__file__)
]
TEXTS = [
    path
    for path in (
        ROOT / "README.md",
        ROOT / "CHANGELOG.md",
        *sorted((ROOT / "docs").rglob("*.md")),
        *sorted((ROOT / "docs").rglob("*.ipynb")),
        *(file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.j2"))),
    )
    if _is_converted(path)
]


def _prose(source: str) -> str:
    """Strings and comments of a module on their own lines; everything else left blank."""
    lines: list[list[str]] = [[] for _ in range(source.count("\n") + 2)]
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        kind = tokenize.tok_name[token.type]
        if kind in ("STRING", "COMMENT", "FSTRING_MIDDLE"):
            for number, text in enumerate(token.string.splitlines(), token.start[0]):
                lines[number].append(re.sub(r"\{[^{}]*\}|data-\w+|dataset\.\w+", " ", text))
    return "\n".join(" ".join(parts) for parts in lines[1:]) + "\n"


def test_no_word_of_the_project_dialect(tmp_path: Path) -> None:
    pytest.importorskip("codespell_lib", reason="codespell comes with the extra dev")
    for path in (*MODULES, *TEXTS):
        copy = tmp_path / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        text = path.read_text("utf-8")
        copy.write_text(_prose(text) if path.suffix == ".py" else text, "utf-8")
    command = [sys.executable, "-m", "codespell_lib", "--dictionary", str(DICTIONARY), "."]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


@pytest.mark.parametrize("text", ['"""The rate is told."""', 'x = f"astray {y}"', "# nought\n"])
def test_codespell_finds_words_in_strings_and_comments(text: str, tmp_path: Path) -> None:
    pytest.importorskip("codespell_lib", reason="codespell comes with the extra dev")
    (tmp_path / "module.py").write_text(_prose(text), "utf-8")
    command = [sys.executable, "-m", "codespell_lib", "--dictionary", str(DICTIONARY), "."]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert found.returncode != 0
    assert "module.py:1:" in found.stdout


def test_each_module_has_one_docstring_with_a_short_first_line() -> None:
    wrong = []
    for path in MODULES:
        if path.relative_to(ROOT).parts[0] not in PACKAGES:
            continue
        body = ast.parse(path.read_text("utf-8")).body
        strings = [isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant) for n in body]
        docstring = ast.get_docstring(ast.Module(body, [])) or ""
        first = docstring.partition("\n")[0]
        if not 0 < len(first) <= MAX_SUMMARY_CHARACTERS or strings[1:2] == [True]:
            wrong.append(f"{path.relative_to(ROOT)}: {first}")
    assert not wrong, "\n".join(wrong)


def test_limits_are_called_min_and_max() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.id}"
        for path in MODULES
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Name)
        and isinstance(node.ctx, ast.Store)
        and UNCLEAR_CONSTANT.match(node.id)
    ]
    assert not wrong, "\n".join(wrong)
