"""Every name that a benchmark imports from the package exists."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OURS = ("calib", "impact_vision", "measuring", "metrology", "mismatch", "physics", "pipelines",
        "sample_videos", "vision")  # fmt: skip


def _imported() -> set[tuple[str, str]]:
    found = set()
    for path in (ROOT / "bench").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OURS:
                found |= {(str(node.module), name.name) for name in node.names}
    return found


@pytest.mark.parametrize("module", sorted({module for module, _ in _imported()}))
def test_imported_names_exist(module: str) -> None:
    loaded = import_module(module)
    for other, name in _names_of(module):
        if not hasattr(loaded, name):
            import_module(f"{other}.{name}")


def _names_of(module: str) -> list[tuple[str, str]]:
    return [pair for pair in _IMPORTED if pair[0] == module]


_IMPORTED = sorted(_imported())
