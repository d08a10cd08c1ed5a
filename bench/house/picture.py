"""The rooms of the house as a picture: floors by what imports what, folders by their lines."""

from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Rectangle

__all__ = ["draw"]

COLOURS = {
    "metrology": "#e3f1e3", "physics": "#ecdfc3", "vision": "#efc9cf", "calib": "#c6e9e5",
    "mismatch": "#d9d0ee", "sample_videos": "#f0cfe6", "pipelines": "#c4d8ee",
    "impact_vision": "#dde3ec",
}  # fmt: skip
LOOSE = "·"
"""Stands for the modules of a room that lie in no folder of it."""
HEIGHT, GAP = 0.62, 0.38
"""Height of a room and of the space between floors, of a floor."""


def draw(path: Path, lines: Mapping[Path, int], arrows: Mapping[tuple[str, str], int]) -> None:
    """Draw the rooms: each on a floor above all that it imports, as wide as its lines are many."""
    rooms = sorted({module.parts[0] for module in lines})
    floor = _floors(rooms, arrows)
    sizes = {room: sum(n for p, n in lines.items() if p.parts[0] == room) for room in rooms}
    by_floor = defaultdict(list)
    for room in rooms:
        by_floor[floor[room]].append(room)
    figure = Figure(figsize=(12.0, 1.5 * (max(floor.values()) + 1)), layout="constrained")
    axes = figure.add_subplot()
    axes.set_axis_off()
    widest = max(sum(sizes[room] for room in here) for here in by_floor.values())
    box: dict[str, tuple[float, float, float]] = {}
    for level, here in by_floor.items():
        spare = 0.04 * (len(here) - 1)
        share = {room: max(sizes[room] / widest, 0.14) for room in here}
        scale = min(1.0, (1.0 - spare) / sum(share.values()))
        left = 0.5 * (1.0 - spare - scale * sum(share.values()))
        for room in here:
            width = scale * share[room]
            box[room] = (left, float(level), width)
            left += width + 0.04
    for (above, below), count in arrows.items():
        if below != "metrology":
            _arrow(axes, box[above], box[below], count)
    for room, place in box.items():
        _room(axes, room, place, _folders(room, lines), sizes[room])
    axes.set_xlim(-0.01, 1.01)
    axes.set_ylim(-0.1, max(floor.values()) + 1.0)
    total = sum(sizes.values())
    axes.set_title(
        f"{len(lines)} modules, {total:,} lines of code; arrows: who imports whom (how many "
        "modules); all rooms stand on metrology",
        fontsize=9,
    )
    figure.savefig(path, dpi=110)


def _floors(rooms: list[str], arrows: Mapping[tuple[str, str], int]) -> dict[str, int]:
    floor = dict.fromkeys(rooms, 0)
    for _ in rooms:
        for above, below in arrows:
            floor[above] = max(floor[above], floor[below] + 1)
    if any(floor[above] <= floor[below] for above, below in arrows):
        raise ValueError("the rooms import each other in a circle")
    return floor


def _folders(room: str, lines: Mapping[Path, int]) -> list[tuple[str, int, int]]:
    found: Counter[str] = Counter()
    files: Counter[str] = Counter()
    for module, count in lines.items():
        if module.parts[0] == room:
            name = module.parts[1] if len(module.parts) > 2 else LOOSE
            found[name] += count
            files[name] += 1
    return [(name, count, files[name]) for name, count in found.most_common()]


def _room(axes, room, place, folders, size):  # type: ignore[no-untyped-def]
    left, level, width = place
    frame = {"edgecolor": "#444444", "linewidth": 0.9, "zorder": 3}
    axes.add_patch(Rectangle((left, level), width, HEIGHT, facecolor=COLOURS[room], **frame))
    axes.text(left + 0.005, level + HEIGHT - 0.04, f"{room}/", va="top", fontsize=9, zorder=4)
    axes.text(left + width - 0.005, level + HEIGHT - 0.04, f"{size:,}", va="top", ha="right",
              fontsize=7, zorder=4)  # fmt: skip
    at = left
    for name, count, files in folders:
        step = width * count / size
        inner = Rectangle((at, level), step, 0.6 * HEIGHT, facecolor="none", edgecolor="#888888",
                          linewidth=0.5, zorder=4)  # fmt: skip
        axes.add_patch(inner)
        if step > 0.012:
            label = (
                f"{name} {files}" if name != "·" else ("1 file" if files == 1 else f"{files} files")
            )
            turn = 90 if step < 0.009 * len(label) else 0
            axes.text(at + 0.5 * step, level + 0.3 * HEIGHT, label, ha="center", va="center",
                      rotation=turn, fontsize=5.4, zorder=5)  # fmt: skip
        at += step


def _arrow(axes, above, below, count):  # type: ignore[no-untyped-def]
    start = (above[0] + 0.5 * above[2], above[1])
    end = (below[0] + 0.5 * below[2], below[1] + HEIGHT)
    axes.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=8,
                                   linewidth=0.4 + 0.02 * min(count, 60), color="#777777",
                                   connectionstyle="arc3,rad=0.06", zorder=1))  # fmt: skip
    middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
    axes.text(*middle, str(count), fontsize=6, color="#555555", zorder=2)
