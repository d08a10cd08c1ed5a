"""Package structure: imports, module size, public names, README commands, error hints."""

import ast
import subprocess
import sys
import tomllib
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pytest

from metrology import errors

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "metrology",
    "physics",
    "vision",
    "calib",
    "mismatch",
    "sample_videos",
    "measuring",
    "pipelines",
    "impact_vision",
)
# Packages of this repository that each package may import.
MAY_IMPORT = {
    "metrology": set(),
    "physics": {"metrology"},
    "vision": {"metrology"},
    "calib": {"metrology", "vision"},
    "mismatch": {"metrology", "physics"},
    "sample_videos": {"metrology", "physics", "vision", "calib"},
    "measuring": {"metrology", "physics", "vision", "calib"},
    "pipelines": set(PACKAGES) - {"impact_vision"},
    "impact_vision": {"measuring", "physics", "pipelines"},
}
MAX_FILES_IN_A_FOLDER = 14
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


@cache
def _parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _imported_packages(tree: ast.Module) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return names & set(PACKAGES)


def _assigned_names(tree: ast.Module) -> set[str]:
    return {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_packages_below_it(package: str) -> None:
    for path in (ROOT / package).rglob("*.py"):
        packages = _imported_packages(_parsed(path)) - {package}
        assert packages <= MAY_IMPORT[package], f"{path.relative_to(ROOT)} imports {packages}"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_module_has_a_docstring_and_lists_its_public_names(path: Path) -> None:
    tree = _parsed(path)
    assert ast.get_docstring(tree)
    if len(tree.body) > 1:
        assert "__all__" in _assigned_names(tree)


def test_no_folder_holds_too_many_modules() -> None:
    folders = {path.parent for path in MODULES} | {
        path.parent for path in (ROOT / "bench").rglob("*.py")
    }
    counts = {folder.relative_to(ROOT): len(list(folder.glob("*.py"))) for folder in folders}
    assert {folder: n for folder, n in counts.items() if n > MAX_FILES_IN_A_FOLDER} == {}


def test_every_package_is_shipped_typed_and_under_the_import_contract() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    shipped = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert sorted(shipped) == sorted(PACKAGES)
    assert sorted(project["tool"]["importlinter"]["root_packages"]) == sorted(PACKAGES)
    for package in PACKAGES:
        assert (ROOT / package / "py.typed").is_file(), package


def test_the_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert version("impact-vision") == project["version"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\n## {project['version']}\n" in changelog
    printed = subprocess.run(
        [sys.executable, "-c", "from pipelines.cli import app; app()", "--version"],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert printed.stdout.strip() == f"vision {project['version']}"


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


def test_no_two_classes_share_a_name() -> None:
    found: dict[str, list[str]] = {}
    for path in MODULES:
        for node in _parsed(path).body:
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in found.items() if len(paths) > 1} == {}


REFUSALS = {name for name in errors.__all__ if name not in ("DomainError", "TooLittleDataError")}
"""Error classes whose message needs a hint; the two others report the violated bound."""


def _without_advice(path: Path) -> list[str]:
    """Errors raised with a message but without a hint about what to do."""
    found = []
    for node in ast.walk(_parsed(path)):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
            continue
        own = bool(node.args) and isinstance(node.args[0], ast.Constant | ast.JoinedStr)
        # `…: {quantity.reason}` repeats a reason that already contains the hint
        repeats_reason = bool(node.args) and ast.unparse(node.args[0]).rstrip("'\"").endswith(
            ".reason}"
        )
        silent = all(keyword.arg != "hint" for keyword in node.keywords) and len(node.args) == 1
        if node.func.id in REFUSALS and own and silent and not repeats_reason:
            found.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    return found


@pytest.mark.parametrize("package", ["metrology", "calib", "measuring", "pipelines"])
def test_every_error_message_has_a_hint(package: str) -> None:
    found = [one for path in (ROOT / package).rglob("*.py") for one in _without_advice(path)]
    assert found == []
