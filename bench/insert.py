"""Fill the numbers and tables of docs/ from result files and from the code.

Run: python -m bench.insert [--check] [--demo RESULTS.json]

A page holds ``<!--=KEY-->text<!--/-->``; the text is replaced by the value of KEY. With --check
nothing is written and the exit code is 1 if a page would change. --demo takes the JSON that
``vision demo`` wrote and stores its quantities in docs/results/demo.json.
"""

import argparse
import json
import math
import re
import statistics
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from metrology.defaults import Default, Defaults
from metrology.files import write_text_whole
from physics.bodies import GRAVITY

__all__ = ["filled", "pages", "read_results", "rounded", "values"]

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
RESULTS = DOCS / "results"
SAMPLE = ROOT / "sample_videos" / "clips" / "basketball_60.truth.json"
INSERT_MARK = re.compile(r"<!--=(?P<key>[\w.]+)-->.*?<!--/-->", re.DOTALL)
SHOWN_UNITS = {"1": "", "deg": "°", "m/s^2": "m/s²", "kg m^2": "kg m²", "N s": "N s", "m_s": "m/s"}
PERCENT = 100.0
SURE_FROM = 0.9
"""Probability from which a name is certain; convention."""

Record = dict[str, Any]


def pages() -> list[Path]:
    """Every page with marks, README included."""
    found = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
    return [page for page in found if INSERT_MARK.search(page.read_text(encoding="utf-8"))]


def filled(text: str, known: dict[str, Callable[[], str]]) -> str:
    """`text` with every mark filled.

    Raises
    ------
    KeyError
        If a mark names a value that no result file holds.
    """
    return INSERT_MARK.sub(lambda m: f"<!--={m['key']}-->{known[m['key']]()}<!--/-->", text)


def values() -> dict[str, Callable[[], str]]:
    """Every insertable value by key."""
    known: dict[str, Callable[[], str]] = {
        "defaults": _defaults_table,
        "pendulum.inertia": lambda: f"{_inertia():.3f} kg m²",
        "lessons.table": _lessons_table,
    }
    for name, entry in read_results("demo.json").items():
        _add(known, f"demo.{name}", entry)
    for lesson, record in read_results("lessons.json").items():
        known[f"lessons.{lesson}.kind"] = partial(str, record["kind"])
        for name, entry in record["quantities"].items():
            _add(known, f"lessons.{lesson}.{name}", entry)
    for name, (head, *rows) in read_results("model.json").items():
        known[f"model.{name}"] = partial(_table, head, rows)
    known |= _evidence(read_results("evidence.json"))
    for key, written in {
        "kills": _kills_text,
        "everywhere": _everywhere_text,
        "hostile": _hostile_text,
        "inputs": _inputs_text,
        "large": _large_text,
        "page": _page_text,
        "cost.table": _cost_table,
        "real.table": _real_table,
        "real.summary": _real_summary,
        "ablation.steps": _steps_table,
        "ablation.table": _ablation_table,
    }.items():
        known[key] = partial(written, read_results(f"{key.partition('.')[0]}.json"))
    names = read_results("acceptance.json")
    worlds = {**names["worlds"], "all": names["all"]}
    known["acceptance.worlds"] = lambda: _acceptance_table(worlds, ("world", "names"))
    stated = read_results("reliability.json")
    known["reliability.table"] = lambda: _acceptance_table(stated, ("probability of", "recordings"))
    return known


def _cost_table(found: Record) -> str:
    rows = [
        (name, f"{one['seconds']:.1f} s", f"{one['megabytes']} MB", ", ".join(one["named"]))
        for name, one in found.items()
    ]
    return _table(("campaign", "processor time", "memory", "named (probability)"), rows)


def _real_table(found: Record) -> str:
    """Names with probabilities, and outcome; recordings of one set with one outcome share a row."""
    sets: dict[tuple[str, str, str], list[str]] = {}
    for name, one in found.items():
        named = [f"{identity} {chance:.2f}" for identity, chance in one["named"].items()]
        key = name.partition(", ")[0], ", ".join(one["missing"]) or "nothing", one["outcome"]
        sets.setdefault(key, []).append(", ".join(named) or one["verdict"])
    rows = [
        (f"{name} ({len(said)})" if len(said) > 1 else name, missing,
         "; ".join(dict.fromkeys(said)), outcome)
        for (name, missing, outcome), said in sets.items()
    ]  # fmt: skip
    return _table(("recording", "missing", "named", "outcome"), rows)


def _real_summary(found: Record) -> str:
    said = [one["outcome"] for one in found.values()]
    kinds = ("right", "in part", "silent", "wrong")
    return f"{len(said)} recordings: " + ", ".join(f"{said.count(k)} {k}" for k in kinds)


def _page_text(found: Record) -> str:
    """The page in a browser, with what is wanted in brackets; only rows that are measured."""

    def lessons(one: Record) -> str:
        done = {
            name: each["kind_right"] and all(each["quantities"].values())
            for name, each in one.items()
        }
        missing = [f"not {name}" for name, right in done.items() if not right]
        return ", ".join([f"lessons done {sum(done.values())}", *missing])

    shown: dict[str, tuple[Callable[[Record], str], ...]] = {
        "first_numbers": (
            lambda one: f"first numbers {one['first']['cpu_s']} s CPU (6)",
            lambda one: f"correction {one['correction']['cpu_s']} s CPU (2)",
        ),
        "long": (
            lambda one: f"step {_delay(one['step'])} (50)",
            lambda one: f"seek in 20,000 frames {_delay(one['seek'])} (200)",
            lambda one: f"its page {one['page_mb']:.0f} MB (300)",
        ),
        "actions": (lambda one: f"actions to an exported page {one['actions']} (6)",),
        "lessons": (lambda one: f"{lessons(one)} (5)",),
        "campaign": (
            lambda one: f"rows lost of {one['clips']}, closed twice and killed {one['lost']} (0)",
        ),
        "report": (
            lambda one: f"report screens {one['screens']} (3)",
            lambda one: f"overflow {one['overflow_px']} px (0)",
        ),
        "code": (
            lambda one: f"front ends {one['front_ends']} (1)",
            lambda one: f"lines {one['lines']:,} (4,500)",
        ),
    }
    return "; ".join(
        say(found[name]) for name, each in shown.items() if name in found for say in each
    )


def _delay(found: Record) -> str:
    return f"{found['median_ms']:.0f} ms, slowest twentieth {found['slow_ms']:.0f}"


def _kills_text(found: Record) -> str:
    total = {key: sum(one[key] for one in found.values()) for key in next(iter(found.values()))}
    resumed = total["resumed"] + total["not_resumed"]
    again = f", {total['resumed']} of {resumed} resumed" if resumed else ""
    return (
        f"{len(found)} commands, {total['killed']} kills: {total['outputs']} outputs,"
        f" {total['incomplete']} incomplete; {total['inputs_damaged']} inputs damaged;"
        f" {total['orphans']} processes left after 5 s{again}"
    )


def _hostile_text(found: Record) -> str:
    faults = ", ".join(f"{count} × {fault}" for fault, count in found["faults"].items() if count)
    inputs = found["inputs"]
    return f"{sum(inputs.values())} inputs, {len(inputs)} kinds, faults: {faults or 'none'}"


def _inputs_text(found: Record) -> str:
    """Outcomes of inputs as people hand them in."""
    verdicts = ("right", "explained", "misdiagnosed", "wrong", "crash")
    counts = {one: [*found.values()].count(one) for one in verdicts}
    failed = [name for name, verdict in found.items() if verdict not in ("right", "explained")]
    listed = ", ".join(f"{count} {one}" for one, count in counts.items())
    return f"of {len(found)} inputs {listed}" + (f" ({'; '.join(failed)})" if failed else "")


def _large_text(found: Record) -> str:
    """CPU time and memory of large inputs."""
    return "; ".join(
        f"{name}: {one['seconds']:.1f} s, {one['megabytes']} MB" for name, one in found.items()
    )


def _everywhere_text(found: Record) -> str:
    """Answers of commands, page and Python about the same wrong inputs."""
    return f"{found['same']} of {found['asked']} answers agree on cause and cure"


def _acceptance_table(found: Record, head: tuple[str, str]) -> str:
    rows = [
        (
            name,
            str(one["names"]),
            str(one["right"]),
            f"{one['brier']:.3f}",
            f"{one['sure_right']} of {one['sure']}",
        )
        for name, one in found.items()
    ]
    return _table((*head, "right", "Brier score", "right of 0.9 or more"), rows)


def _steps_table(found: Record) -> str:
    """Laboratories that change without each step of following."""
    rows = [
        (
            name,
            f"{one['acts_in']} of {found['labs']}",
            ", ".join(one["worse_without"]) or "–",
            ", ".join(one["better_without"]) or "–",
        )
        for name, one in found["following"].items()
    ]
    return _table(("step of following", "acts in", "wrong without", "right without"), rows)


def _ablation_table(found: Record) -> str:
    """Choices without each feature of the selection and each step of linking."""
    parts = {"everything": found["whole"]}
    parts |= {f"without {name}": one for name, one in found["features"].items()}
    parts |= {f"without {name}": one for name, one in found["linking"].items()}
    rows = [
        (
            name,
            f"{one['right']} of {found['recordings']}",
            f"{one['wrong_sure']} of {one['sure']}",
            f"{one['log_loss']:.3f}",
        )
        for name, one in parts.items()
    ]
    return _table(("finding with", "right object", "wrong of 0.9 or more", "log loss"), rows)


def _evidence(found: Record) -> dict[str, Callable[[], str]]:
    """Tables of the evidence pages."""
    if not found:
        return {}
    known: dict[str, Callable[[], str]] = {"evidence.commit": lambda: found["commit"]}
    known["evidence.tables_commit"] = lambda: found.get("tables_commit", found["commit"])
    clips, tables = found["clips"], found["tables"]
    for part in ("shipped", "rendered", "scenes"):
        mine = {k: v for k, v in clips.items() if k.startswith(f"{part}/")}
        known[f"evidence.{part}"] = partial(_clips_table, mine)
        known[f"evidence.{part}.count"] = partial(str, len(mine))
    real = {k: v for k, v in clips.items() if k.startswith("clips/")}
    known["evidence.clips"] = lambda: _real_clips_table(real)
    known["evidence.clips.summary"] = lambda: _summary_table(clips)
    known["evidence.speed"] = lambda: _speed_table(clips, tables)
    own = {k: v for k, v in tables.items() if k.startswith("concealed/")}
    known["evidence.concealed"] = partial(_campaigns_table, own)
    known["evidence.concealed.summary"] = partial(_campaigns_summary, own)
    return known


def _error(entry: Record | None, relative: bool, factor: float, unit: str) -> str:
    if entry is None:
        return "–"
    error = entry["value"] - entry["true"]
    scaled = factor * (error / entry["true"] if relative else error)
    digits = 2 if unit else 3
    text = f"{scaled:+.{digits}f} {unit}".strip()
    return f"{text} ({error / entry['std']:+.1f})" if entry["std"] else text


COMPARED = (
    ("contact_time", False, 1e3, "ms"),
    ("ball_speed", True, PERCENT, "%"),
    ("launch_angle", False, 1.0, "°"),
    ("landing_distance", True, PERCENT, "%"),
    ("cor", False, 1.0, ""),
)
"""Quantities of the tables of clips: whether the error is relative, its factor and its unit."""


def _clips_table(clips: Record) -> str:
    rows = [
        (
            key.partition("/")[2],
            clip["kind"] or "refused",
            *(_error(clip["quantities"].get(name), *how) for name, *how in COMPARED),
            f"{clip['within_95']} of {clip['compared']}",
        )
        for key, clip in clips.items()
    ]
    header = ("clip", "kind", "contact time", "speed", "angle", "landing", "COR", "95 % hold")
    return _table(header, rows)


def _real_clips_table(clips: Record) -> str:
    rows = []
    for key, clip in clips.items():
        fall = clip["quantities"].get("gravity_check") or clip["quantities"].get(
            "fall_acceleration"
        )
        right = clip["kind"] in clip["kinds"] if clip["kinds"] else clip["kind"] in (None, "none")
        rows.append(
            (
                key.partition("/")[2],
                " or ".join(clip["kinds"]) or "none",
                clip["kind"] or "refused",
                "" if clip["probability"] is None else f"{clip['probability']:.2f}",
                "right" if right else "wrong",
                "–" if fall is None else shown(fall["value"], fall["std"], "m/s^2"),
            )
        )
    header = ("clip", "right kind", "kind found", "probability", "verdict", "gravity")
    return _table(header, rows)


def _summary_table(clips: Record) -> str:
    rows = []
    for part in ("shipped", "rendered", "scenes", "rooms", "altered"):
        mine = [clip for key, clip in clips.items() if key.startswith(f"{part}/")]
        if not mine:
            continue
        cells = [part, str(len(mine)), str(sum(clip["kind"] == "strike" for clip in mine))]
        for name, relative, factor, unit in COMPARED:
            entries = [c["quantities"][name] for c in mine if name in c["quantities"]]
            errors = [
                abs(e["value"] - e["true"]) * factor / (e["true"] if relative else 1.0)
                for e in entries
            ]
            cells.append(f"{statistics.median(errors):.3g} {unit}".strip() if errors else "–")
        held, count = (sum(clip[what] for clip in mine) for what in ("within_95", "compared"))
        cells += [f"{PERCENT * held / count:.0f} % of {count}" if count else "–"]
        cells += [str(sum(clip["beyond_4"] for clip in mine))]
        rows.append(tuple(cells))
    header = (
        "set", "clips", "strikes found", "contact time", "speed", "angle", "landing", "COR",
        "95 % intervals that hold", "beyond 4 uncertainties",
    )  # fmt: skip
    return _table(header, rows)


def _is_right(table: Record) -> bool:
    """Whether the verdict is right and every name with 0.5 or more is right or grouped with one."""
    names = set(table["names"])
    if table["verdict"] not in table["verdicts"]:
        return not names and table["verdict"] == "no_mismatch"
    grouped = {name for group in table["groups"] if names & set(group) for name in group}
    return all(name in names | grouped for name in table["effects"])


def _campaigns_table(tables: Record) -> str:
    rows = [
        (
            key.partition("/")[2],
            ", ".join(table["names"]) or "nothing",
            table["verdict"] or "refused",
            ", ".join(f"{name} ({p:.2f})" for name, p in table["effects"].items()) or "–",
            "; ".join("{" + ", ".join(group) + "}" for group in table["groups"]) or "–",
        )
        for key, table in tables.items()
    ]
    return _table(("campaign", "right names", "verdict", "named (probability)", "groups"), rows)


def _campaigns_summary(tables: Record) -> str:
    sure = [
        name in table["names"]
        for table in tables.values()
        for name, probability in table["effects"].items()
        if probability >= SURE_FROM
    ]
    rows = [
        ("campaigns", str(len(tables))),
        ("verdict right, every name right or grouped with a right one",
         str(sum(_is_right(table) for table in tables.values()))),
        (f"names with {SURE_FROM} or more", str(len(sure))),
        ("of these right", str(sum(sure))),
    ]  # fmt: skip
    return _table(("", "count"), rows)


def _speed_table(clips: Record, tables: Record) -> str:
    rows = []
    for part, found in (
        *((p, clips) for p in ("shipped", "rendered", "scenes", "rooms", "altered", "clips")),
        *((p, tables) for p in ("concealed", "realdata")),
    ):
        cpu = [entry["cpu_s"] for key, entry in found.items() if key.startswith(f"{part}/")]
        if cpu:
            command = "explain" if found is tables else "measure"
            row = (part, command, str(len(cpu)))
            rows.append((*row, f"{statistics.median(cpu):.1f} s", f"{max(cpu):.1f} s"))
    return _table(("set", "command", "inputs", "median", "slowest"), rows)


def _add(known: dict[str, Callable[[], str]], key: str, entry: Record) -> None:
    known[key] = lambda: shown(entry["value"], entry["std"], entry["unit"])
    known[f"{key}.std"] = lambda: shown(entry["std"], None, entry["unit"])
    if entry.get("true") is not None:
        known[f"{key}.true"] = lambda: shown(entry["true"], entry["std"], entry["unit"], True)


def shown(value: float, std: float | None, unit: str, bare: bool = False) -> str:
    """Value with its uncertainty to two digits; only the value if `bare`."""
    if unit == "s" and abs(value) < 0.1:
        value, unit = 1e3 * value, "ms"
        std = None if std is None else 1e3 * std
    width = value if std is None else std
    digits = 4 if not width else max(0, 1 - math.floor(math.log10(abs(width))))
    sign = SHOWN_UNITS.get(unit, unit)
    number = f"{value:.{digits}f}"
    if std is not None and not bare:
        number += f" ± {std:.{digits}f}"
    if sign == "°":
        return f"({number})°" if "±" in number else f"{number}°"
    return f"{number} {sign}".rstrip()


def read_results(name: str) -> Record:
    """Content of a file of docs/results; empty where it is absent."""
    path = RESULTS / name
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def rounded(tree: Any, digits: int = 6) -> Any:
    """A tree of results with its numbers rounded."""
    if isinstance(tree, dict):
        return {key: rounded(value, digits) for key, value in tree.items()}
    if isinstance(tree, list):
        return [rounded(value, digits) for value in tree]
    return float(f"{tree:.{digits}g}") if isinstance(tree, float) else tree


def _inertia() -> float:
    """Example of the page on the pendulum: 2.50 kg, 0.420 m, ten periods in 13.6 s; kg m²."""
    return 2.50 * GRAVITY * 0.420 * (1.36 / (2.0 * math.pi)) ** 2


def _defaults_table() -> str:
    rows = []
    for name in vars(Defaults):
        default = getattr(Defaults, name)
        if isinstance(default, Default):
            value = "" if default.value is None else f"{default.value:.4g} {_unit(default)}"
            std = (
                f"{PERCENT * default.std:.2g} %"
                if default.relative
                else f"{default.std:.3g} {_unit(default)}"
            )
            rows.append((default.name, value.strip(), std.strip()))
    return _table(("quantity", "value", "standard uncertainty"), rows)


def _unit(default: Default) -> str:
    return SHOWN_UNITS.get(default.unit, default.unit)


def _lessons_table() -> str:
    rows = []
    for lesson, record in read_results("lessons.json").items():
        for name, entry in record["quantities"].items():
            if entry.get("true") is not None:
                std, unit = entry["std"], entry["unit"]
                measured = shown(entry["value"], std, unit)
                rows.append((lesson, f"`{name}`", measured, shown(entry["true"], std, unit, True)))
    return _table(("lesson", "quantity", "measured", "true"), rows)


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---" for _ in header], *rows]
    return "\n\n" + "\n".join(f"| {' | '.join(row)} |" for row in lines) + "\n\n"


def _keep_demo(measured: Path) -> None:
    """Write docs/results/demo.json from the JSON of the sample clip."""
    found = json.loads(measured.read_text(encoding="utf-8"))
    truth = json.loads(SAMPLE.read_text(encoding="utf-8"))["quantities"]
    known = {**found["quantities"], "gravity": found["time_base"]["gravity_check"]}
    kept = {
        name: {
            "value": float(f"{entry['value']:.7g}"),
            "std": float(f"{entry['std']:.4g}"),
            "unit": entry["unit"],
            "true": GRAVITY if name == "gravity" else truth.get(name, {}).get("value"),
        }
        for name, entry in known.items()
        if entry.get("value") is not None
    }
    for entry in kept.values():
        if entry["true"] is not None:
            entry["true"] = float(f"{entry['true']:.7g}")
    if kept.get("cor") is not None:
        kept["cor"]["true"] = kept["cor_speeds"]["true"]
    write_text_whole(RESULTS / "demo.json", json.dumps(kept, indent=1) + "\n")


def main() -> int:
    """Fill or check the pages."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--demo", type=Path, metavar="RESULTS.json")
    options = parser.parse_args()
    if options.demo is not None:
        _keep_demo(options.demo)
    known, stale = values(), []
    for page in pages():
        text = page.read_text(encoding="utf-8")
        fresh = filled(text, known)
        if fresh != text:
            stale.append(page)
            if not options.check:
                write_text_whole(page, fresh)
    for page in stale:
        print(f"{'stale' if options.check else 'filled'}: {page.relative_to(ROOT)}")
    return 1 if options.check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
