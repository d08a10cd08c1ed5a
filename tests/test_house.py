"""The house: arrows between rooms, size and face of modules, the commands of the README."""

import ast
import subprocess
import sys
import tomllib
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pytest

from bench.house.__main__ import FORMATS, modules, string_decisions
from metrology import errors

ROOT = Path(__file__).parents[1]
ROOMS = (
    "metrology",
    "physics",
    "vision",
    "calib",
    "mismatch",
    "sample_videos",
    "pipelines",
    "impact_vision",
)
# What each room may import of ours.
MAY_IMPORT = {
    "metrology": set(),
    "physics": {"metrology"},
    "vision": {"metrology"},
    "calib": {"metrology", "vision"},
    "mismatch": {"metrology", "physics"},
    "sample_videos": {"metrology", "physics", "vision", "calib"},
    "pipelines": set(ROOMS) - {"impact_vision"},
    "impact_vision": {"physics", "pipelines"},
}
MOST_FILES_IN_A_FOLDER = 14
MODULES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))


@cache
def _parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _imported_rooms(tree: ast.Module) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return names & set(ROOMS)


def _assigned_names(tree: ast.Module) -> set[str]:
    return {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_rooms_below_it(room: str) -> None:
    for path in (ROOT / room).rglob("*.py"):
        rooms = _imported_rooms(_parsed(path)) - {room}
        assert rooms <= MAY_IMPORT[room], f"{path.relative_to(ROOT)} imports {rooms}"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_module_has_a_docstring_and_a_public_face(path: Path) -> None:
    tree = _parsed(path)
    assert ast.get_docstring(tree)
    if len(tree.body) > 1:
        assert "__all__" in _assigned_names(tree)


def test_no_folder_is_a_corridor() -> None:
    folders = {path.parent for path in MODULES} | {
        path.parent for path in (ROOT / "bench").rglob("*.py")
    }
    counts = {folder.relative_to(ROOT): len(list(folder.glob("*.py"))) for folder in folders}
    assert {folder: n for folder, n in counts.items() if n > MOST_FILES_IN_A_FOLDER} == {}


def test_every_room_is_packaged_typed_and_under_the_import_contract() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packaged = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert sorted(packaged) == sorted(ROOMS)
    assert sorted(project["tool"]["importlinter"]["root_packages"]) == sorted(ROOMS)
    for room in ROOMS:
        assert (ROOT / room / "py.typed").is_file(), room


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert version("impact-vision") == project["version"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\n## {project['version']}\n" in changelog
    told = subprocess.run(
        [sys.executable, "-c", "from pipelines.cli import app; app()", "--version"],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert told.stdout.strip() == f"vision {project['version']}"


def _setup_commands() -> list[str]:
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("python3 -m venv ")]


def test_the_readme_has_two_setup_commands_and_ci_runs_the_second() -> None:
    demo, tests = _setup_commands()
    assert demo.endswith("&& .venv/bin/vision demo")
    assert ".venv/bin/pytest" in tests
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    wanted = ci.split('grep -F "', 1)[1].split('"', 1)[0]
    assert [line for line in _setup_commands() if wanted in line] == [tests]


def test_links_and_pictures_of_the_readme_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    targets = [part.partition(")")[0] for part in text.split("](")[1:]]
    assert targets
    assert [target for target in targets if not (ROOT / target).is_file()] == []


def test_every_fragment_of_the_changelog_is_assembled() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    for fragment in (ROOT / "changelog.d").glob("*.md"):
        assert fragment.read_text(encoding="utf-8").strip() in changelog, fragment.name


def test_no_decision_hangs_on_how_a_name_is_spelled() -> None:
    told = [
        one
        for path in modules()
        if not str(path.relative_to(ROOT)).startswith(FORMATS)
        for one in string_decisions(path)
    ]
    assert told == []


def test_no_two_classes_share_a_name() -> None:
    found: dict[str, list[str]] = {}
    for path in MODULES:
        for node in _parsed(path).body:
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in found.items() if len(paths) > 1} == {}


REFUSALS = {name for name in errors.__all__ if name not in ("DomainError", "TooLittleDataError")}
"""Those two hand on the bounds that were missed."""


def _without_advice(path: Path) -> list[str]:
    """Refusals that say what is wrong in words of their own, and not what to do."""
    found = []
    for node in ast.walk(_parsed(path)):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
            continue
        own = bool(node.args) and isinstance(node.args[0], ast.Constant | ast.JoinedStr)
        # `…: {quantity.reason}` hands on words that say it already
        handed_on = bool(node.args) and ast.unparse(node.args[0]).rstrip("'\"").endswith(".reason}")
        silent = all(keyword.arg != "hint" for keyword in node.keywords) and len(node.args) == 1
        if node.func.id in REFUSALS and own and silent and not handed_on:
            found.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    return found


@pytest.mark.parametrize("room", ["metrology", "calib", "pipelines"])
def test_whoever_is_refused_learns_what_to_do(room: str) -> None:
    told = [one for path in (ROOT / room).rglob("*.py") for one in _without_advice(path)]
    assert told == []
