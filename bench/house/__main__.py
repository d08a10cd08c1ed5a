"""How the code is built: modules, lines, catalogues, integrators, decisions on strings, one walk.

Run: python -m bench.house [--list] [--picture FILE]

`--list` names each decision on a string and the files of the walk; `--picture` draws the rooms.
"""

import argparse
import ast
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from bench.constants.__main__ import ROOMS, ROOT, constants_of
from bench.house.picture import draw

NAMED = re.compile(r"(^|[._])(id|ids|name|names|source|label|title|words|reason|message)$")
"""What a decision must not be made on by its spelling: an identifier, a name, a source, prose."""
FORMATS = ("pipelines/interop/", "pipelines/setup/file.py", "pipelines/setup/tables.py")
"""Files that read formats of others, whose words are data and no decisions of ours."""
WALK = ("pipelines.cli", "pipelines.measure.commands", "physics.flight")
"""Where the walk begins and ends: the command line, `vision measure`, the flight that is fitted."""


def modules() -> list[Path]:
    """Every module of the packages."""
    return sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))


def code_lines(path: Path) -> int:
    """Lines that hold code: no blanks, comments or docstrings."""
    text = path.read_text(encoding="utf-8")
    held: set[int] = set()
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type not in _NO_CODE:
                held.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and _is_words(node.value):
            held -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(held)


_NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip


def string_decisions(path: Path) -> Iterator[str]:
    """Comparisons of an identifier, a name or a source with words written out beside it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Compare):
            continue
        sides = [node.left, *node.comparators]
        words = [side for side in sides if _is_words(side)]
        named = [side for side in sides if NAMED.search(ast.unparse(side))]
        if words and named and not _is_dunder(words[0]):
            yield f"{path.relative_to(ROOT)}:{node.lineno} {ast.unparse(node)}"


def _is_words(side: ast.expr) -> bool:
    if isinstance(side, ast.Constant):
        return isinstance(side.value, str) and bool(side.value)
    if isinstance(side, ast.Tuple | ast.List | ast.Set):
        return bool(side.elts) and all(_is_words(part) for part in side.elts)
    return False


def _is_dunder(side: ast.expr) -> bool:
    return isinstance(side, ast.Constant) and str(side.value).startswith("__")


_MODULE = re.compile(r"pipelines(\.\w+)+")


def imports_of(module: str) -> set[str]:
    """Our modules that a module names in its imports, or loads by a name written out."""
    path = path_of(module)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            inside = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name for name in inside if is_module(name)} or {node.module}
        elif isinstance(node, ast.Constant) and _MODULE.fullmatch(str(node.value)):
            found.add(str(node.value))
    return {name for name in found if name.partition(".")[0] in ROOMS and is_module(name)}


def path_of(module: str) -> Path:
    """The file of a module."""
    path = ROOT / module.replace(".", "/")
    face = path / "__init__.py"
    return face if face.is_file() else path.with_suffix(".py")


def is_module(name: str) -> bool:
    """Whether there is such a module."""
    return path_of(name).is_file()


def shortest_walk(start: str, end: str) -> list[str]:
    """The fewest files to open from one module to the first of a name that begins so."""
    came: dict[str, str | None] = {start: None}
    queue, at = [start], None
    for here in queue:
        if here.startswith(end):
            at = here
            break
        for there in sorted(imports_of(here) - came.keys()):
            came[there] = here
            queue.append(there)
    walk: list[str] = []
    while at is not None:
        walk.append(at)
        at = came[at]
    return walk[::-1]


def catalogues() -> list[str]:
    """Modules outside `physics` that define a class of the name of one of its effects."""
    effects = {
        node.name
        for path in (ROOT / "physics" / "effects").glob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and _has_law(node)
    }
    return sorted(
        f"{path.relative_to(ROOT)}: {node.name}"
        for path in modules()
        if "physics/effects" not in str(path)
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and node.name in effects
    )


def _has_law(node: ast.ClassDef) -> bool:
    fields = {n.target.id for n in node.body
              if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)}  # fmt: skip
    return {"id", "law"} <= fields


def integrators() -> list[str]:
    """Modules that step an equation of motion themselves, or hand one to scipy."""
    pattern = re.compile(r"\b(solve_ivp|odeint|DOP853|def runge_kutta_step)\b")
    return [
        str(path.relative_to(ROOT))
        for path in modules()
        if any(pattern.search(line) and not line.lstrip().startswith(("from", "import", "#"))
               for line in path.read_text(encoding="utf-8").splitlines())
    ]  # fmt: skip


def main() -> None:
    """Print the table; draw and list where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--list", action="store_true", help="name what is counted")
    parser.add_argument("--picture", type=Path, help="draw the rooms here (.png)")
    arguments = parser.parse_args()
    paths = modules()
    lines = {path: code_lines(path) for path in paths}
    crowd = Counter(path.parent for path in paths)
    fullest, files = crowd.most_common(1)[0]
    decisions = [
        one
        for path in paths
        if not str(path.relative_to(ROOT)).startswith(FORMATS)
        for one in string_decisions(path)
    ]
    constants = [one for path in paths for one in constants_of(path)]
    told = [one for one in constants if one.has_unit and one.has_source]
    walk = shortest_walk(WALK[0], WALK[1])[:-1] + shortest_walk(WALK[1], WALK[2])
    rows = [
        ("modules that step or solve an equation of motion", len(integrators())),
        ("effects defined outside the catalogue", len(catalogues())),
        ("modules", len(paths)),
        ("package lines without docstrings, comments and blanks", sum(lines.values())),
        (f"files in the fullest folder ({fullest.relative_to(ROOT)})", files),
        ("decisions on a name, an id, a source or prose", len(decisions)),
        ("numeric constants with unit and reason", f"{100 * len(told) / len(constants):.0f} %"),
        ("of these more than supposed",
         f"{100 * sum(not one.is_supposed for one in told) / len(constants):.0f} %"),
        ("files to open from the command line to the flight model", len(walk)),
    ]  # fmt: skip
    print("| | |\n|---|---|")
    for what, value in rows:
        print(f"| {what} | {value} |")
    if arguments.list:
        for heading, found in (("integrators", integrators()), ("catalogues", catalogues()),
                               ("decisions", decisions), ("walk", walk)):  # fmt: skip
            print(f"\n{heading}:", *found, sep="\n  ")
    if arguments.picture is not None:
        arrows = Counter(
            (room, other)
            for path in paths
            for room in [path.relative_to(ROOT).parts[0]]
            for other in {name.partition(".")[0] for name in imports_of(_name_of(path))}
            if other != room
        )
        draw(arguments.picture, {p.relative_to(ROOT): n for p, n in lines.items()}, arrows)


def _name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


if __name__ == "__main__":
    main()
