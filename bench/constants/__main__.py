"""How many numeric constants say their unit and where they come from.

A module-level constant counts as told if a docstring below it or a comment on or above its lines
gives both a unit (or says that it is a share, a count, a factor) and a source or a derivation; a
docstring tells of the one assignment above it. A script can't judge an argument: it asks for a
unit's name (or what is counted) and for four words that argue, or for a colon and what follows
from it. Zero, a half, one and two are no choice, nor are the keys of a dictionary. What says
"supposed" is honest, but has no source: it is counted by itself.

Run: python -m bench.constants [--list] [FOLDER…]
"""

import argparse
import ast
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = (
    "metrology", "physics", "vision", "calib", "mismatch", "sample_videos", "pipelines",
    "impact_vision",
)  # fmt: skip
PLAIN = {0.0, 1.0, 2.0, -1.0, 0.5}
"""Numbers that are no choice."""

UNIT = re.compile(
    r"\b(m|mm|cm|km|µm|um|nm|s|ms|µs|min|h|kg|g|mg|N|J|W|K|Pa|hPa|Hz|fps|rad|deg|px|°|1/s|1/m|m/s"
    r"|m/s²|rad/s|kg/m³|V|%|dB|bit|bits|byte|bytes|MB|GB|frames?|rows?|columns?|pixels?|points?"
    r"|degrees?|seconds?|metres?|samples?|steps?|rounds?|trials?|clips?|counts?|times|tries|draws"
    r"|digits?|lines?|squares?|files?|characters?|iterations?|terms?|levels?|flights?|swings?"
    r"|radii|radius|diameters?|sigma|sigmas|σ|standard deviations?|chi-square|χ²|odds|share|part"
    r"|fraction|factor|ratio|relative|per cent|of (?:a|an|the|its|their|what|all|one)|probability"
    r"|dimensionless|chances?|speeds?|cells?|windows?|views?|crossings?|corners?|bins?|panels?|parts"
    r"|numbers?|orders?|periods?|exponents?|inches|looks?|nats|groups?|effects?|glimpses|instants"
    r"|rays|polynomials?|blue, green, red|red, green, blue"
    r"|units?|widths?|gray|grey|half|third|quarter|fifth|tenth|hundredth|1)\b|[°²³%σχ]"
)
REASON = re.compile(
    r"\b(19|20)\d\d\b|Eqs?\.|Table|Fig|section|paper|GUM|ISO|IEC|SMPTE|CIPM|CODATA|NIST|White|Hertz"
    r"|derived|because|since|so that|that is|hence|otherwise|below|above|beyond|least|most|usual"
    r"|measured|seen|from|where|as |for |than|is |are |may|by |until|within|to |has |have |can't"
    r"|: \w"
)


@dataclass(frozen=True)
class Constant:
    """A module-level numeric constant."""

    path: Path
    line: int
    name: str
    told: str

    @property
    def has_unit(self) -> bool:
        """Whether the text names a unit, as a symbol or as the word that a sentence begins with."""
        return bool(UNIT.search(self.told) or UNIT.search(self.told[:1].lower() + self.told[1:]))

    @property
    def is_supposed(self) -> bool:
        """Whether the text says that nobody derived or measured the number."""
        return "supposed" in self.told.lower()

    @property
    def has_source(self) -> bool:
        """Whether the text is an argument: a reference, or some words of reason."""
        return len(self.told.split()) >= 4 and bool(REASON.search(self.told))


def main() -> None:
    """Print the share by package, and the offenders where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", default=list(ROOMS))
    parser.add_argument("--list", action="store_true", help="name each constant that tells nothing")
    arguments = parser.parse_args()
    total = good = bare = 0
    print(
        f"{'package':24s} {'constants':>9s} {'with unit':>9s} {'and reason':>10s} {'supposed':>9s}"
    )
    for folder in arguments.folders:
        found = [c for path in sorted((ROOT / folder).rglob("*.py")) for c in constants_of(path)]
        both = [c for c in found if c.has_unit and c.has_source]
        units = sum(c.has_unit for c in found)
        supposed = sum(c.is_supposed for c in both)
        total, good, bare = total + len(found), good + len(both), bare + supposed
        print(f"{folder:24s} {len(found):9d} {units:9d} {len(both):10d} {supposed:9d}")
        if arguments.list:
            for constant in found:
                if not (constant.has_unit and constant.has_source):
                    where = constant.path.relative_to(ROOT)
                    print(f"    {where}:{constant.line} {constant.name}: {constant.told!r}")
    print(f"{'all':24s} {total:9d} {'':9s} {good:10d} {bare:9d}")
    print(
        f"{100 * good / max(total, 1):.0f} % say unit and reason, "
        f"{100 * (good - bare) / max(total, 1):.0f} % one that is more than supposed"
    )


def constants_of(path: Path) -> Iterator[Constant]:
    """Module-level assignments whose value holds a number that is a choice."""
    text = path.read_text(encoding="utf-8")
    tree, comments, rows = ast.parse(text), _comments(text), text.splitlines()
    for index, node in enumerate(tree.body):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        names = [n.id for n in ast.walk(target) if isinstance(n, ast.Name)]
        if not names or names[0].startswith("__") or not _is_choice(node.value):
            continue
        told = [comments[row] for row in range(node.lineno, node.end_lineno + 1) if row in comments]
        above = node.lineno - 1
        while above in comments and rows[above - 1].lstrip().startswith("#"):
            told.insert(0, comments[above])
            above -= 1
        below = tree.body[index + 1] if index + 1 < len(tree.body) else None
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            told.append(str(below.value.value))
        yield Constant(path, node.lineno, ", ".join(names), " ".join(told))


def _is_choice(value: ast.expr) -> bool:
    """Whether an expression is made of literals, with a number among them that is a choice."""
    allowed = (
        ast.Constant, ast.Tuple, ast.List, ast.Dict, ast.Set, ast.UnaryOp, ast.BinOp, ast.operator,
        ast.unaryop, ast.expr_context, ast.Call, ast.Attribute, ast.Name, ast.keyword, ast.Starred,
    )  # fmt: skip
    nodes = list(ast.walk(value))
    if not all(isinstance(node, allowed) for node in nodes):
        return False
    keys = {id(key) for node in nodes if isinstance(node, ast.Dict) for key in node.keys}
    numbers = [
        float(node.value)
        for node in nodes
        if isinstance(node, ast.Constant)
        and id(node) not in keys
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    ]
    calls = [node for node in nodes if isinstance(node, ast.Call)]
    plain = {"sqrt", "radians", "log", "exp", "float", "array", "linspace", "arange", "geomspace",
             "deg2rad", "hypot", "concatenate"}  # fmt: skip
    known = all(
        (isinstance(c.func, ast.Attribute) and c.func.attr in plain)
        or (isinstance(c.func, ast.Name) and c.func.id in plain)
        for c in calls
    )
    return known and any(number not in PLAIN for number in numbers)


def _comments(text: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(StringIO(text).readline)
    return {t.start[0]: t.string.lstrip("# ") for t in tokens if t.type == tokenize.COMMENT}


if __name__ == "__main__":
    main()
