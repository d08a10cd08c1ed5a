"""The fixed set of recordings, each with its options and its truth where it is known."""

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from bench.altered import WAYS, altered
from bench.cases import SHIPPED, Case, ray_traced, shipped
from bench.concealed.foreign import convert, foreign_key
from bench.real import juggling_mocap, rocket_coast, rod_pendulum
from bench.rooms import room_case

__all__ = ["CLIP_PARTS", "GOLDEN_PARTS", "ClipInput", "Item", "TableInput", "input_of", "items_of"]

ROOT = Path(__file__).parents[2]
ALTERED = "jokku_90_small"
"""Shipped clip that is altered: 208 × 116 px, the cheapest."""
TOO_LONG = "5 s still before and after"
"""Alteration that is not in the set: 6,000 additional frames cost more than all others."""
ROOMS = (0, 1, 3, 6, 10, 11, 13, 14, 15, 16, 23, 25, 27, 28, 30, 34, 35, 37, 39, 46)
"""Seeds: the first ten rooms of 208 × 116 px, seven of 320 × 180 and three of 432 × 240, chosen by
cost alone (about 4, 8 and 19 s of CPU)."""
SCENES = (
    "bob_on_rod brick_wall close_up_1000fps fps240_crushed net_in_front oblique"
    " second_ball_rolling small_cluttered steel_on_dark walker white_on_white wood_tape_grid"
)
RENDERED = (
    "basketball_120_dim basketball_60_wide close_up_720p cluttered_shaking jokku_120 jokku_90_small"
)
CAMPAIGNS = (
    "dev/01 dev/02 dev/03 dev/06 dev/09 foreign/01 foreign/08 foreign/16 foreign/19 foreign/22"
    " foreign/49 foreign/52 foreign/56 third/01 third/04 third/05 third/09 third/28 third/36"
    " third/38"
)
GOLDEN_CLIPS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "balltoss_480p15_tracker.mp4": ({"fps": 15.15}, ("flight",)),
    "balltoss_480p30.mov": ({"fps": 29.97, "scale": "398.7 px/m ± 8 px/m"}, ("flight",)),
    "blue_bob_lowres.mp4": ({"fps": 29.97}, ("swing",)),
    "freefall_phantom1000.mp4": ({"fps": 1000, "ball": "20.2mm"}, ("drop",)),
    "lfd_bola.mp4": ({"fps": 30}, ("flight",)),
    "pendulum_ornament_352p30.mp4": ({"fps": 29.75}, ("swing",)),
    "projectile_A_canon240.mp4": ({"fps": 240}, ("flight", "bounce")),
    "puck_collision_A_canon240.mp4": ({"fps": 240}, ("collision",)),
    "rolling_cylinder_canon240.mp4": ({"fps": 240}, ("roll",)),
    "tennis_ball_bounce_gif.gif": ({"fps": 10}, ("drop", "bounce")),
    "water_drops_gray.avi": ({}, ()),
    "yellow_ball_roll_occluded.avi": ({"fps": 30}, ("roll",)),
}
"""Real clips with the options a user could give and the motion kinds that are right."""
REAL_NAMES: dict[str, tuple[str, ...]] = {
    "encoder_pendulum": ("bearing_friction",),
    "juggling_mocap": ("length_scale", "camera_roll"),
    "pingpong_throws": (),
    "rocket_coast": ("drag", "density_lapse"),
    "rod_pendulum": ("bearing_friction", "viscous_damping"),
    "three_drops": ("drag",),
}
"""Real data sets with the effects that are missing; source: their PROVENANCE.md."""
QUICK_ITEMS = {
    "shipped/jokku_90_small",
    "scenes/small_cluttered",
    "rooms/003",
    "altered/03",
    "clips/blue_bob_lowres.mp4",
    "clips/tennis_ball_bounce_gif.gif",
    "concealed/dev/01",
    "concealed/third/09",
    "realdata/three_drops",
    "realdata/encoder_pendulum",
}
CLIP_PARTS = ("shipped", "rendered", "scenes", "rooms", "altered", "clips")
GOLDEN_PARTS: dict[str, tuple[str, ...]] = {
    "shipped": ("basketball_60", "jokku_120", "jokku_90_small"),
    "rendered": tuple(RENDERED.split()),
    "scenes": tuple(SCENES.split()),
    "rooms": tuple(f"{seed:03d}" for seed in ROOMS),
    "altered": tuple(f"{i:02d}" for i, way in enumerate(WAYS) if way.name != TOO_LONG),
    "clips": tuple(GOLDEN_CLIPS),
    "concealed": tuple(CAMPAIGNS.split()),
    "realdata": tuple(REAL_NAMES),
}


@dataclass(frozen=True)
class Item:
    """One recording of the set."""

    part: str
    name: str

    @property
    def key(self) -> str:
        """Name in golden.json."""
        return f"{self.part}/{self.name}"

    @property
    def source(self) -> Path | None:
        """File or folder of shared data it needs; None for data of the repository."""
        shared = Path(os.environ.get("IMPACT_VISION_SHARED", ROOT.parent / "shared"))
        if self.part == "concealed":
            return shared / f"concealed_{self.name}"
        return None if self.part in ("shipped", "rooms", "altered") else shared / self.key


@dataclass(frozen=True)
class ClipInput:
    """A clip, the keyword arguments of `impact_vision.measure` and the truth."""

    path: Path
    options: dict[str, Any]
    truth: dict[str, Any]
    marked: Path | None = None


@dataclass(frozen=True)
class TableInput:
    """Folder with ball.csv or pendulum.csv and setup.toml, and the truth."""

    folder: Path
    truth: dict[str, Any] = field(default_factory=dict)


def items_of(parts: list[str] | None = None, quick: bool = False) -> Iterator[Item]:
    """The items of the set, or of some parts, or of the quick subset."""
    for part, names in GOLDEN_PARTS.items():
        for item in (Item(part, name) for name in names):
            if (not parts or part in parts) and (not quick or item.key in QUICK_ITEMS):
                yield item


def input_of(item: Item, scratch: Path) -> ClipInput | TableInput:
    """Find or make the files of an item; made files are written to `scratch`."""
    if item.part == "clips":
        options, kinds = GOLDEN_CLIPS[item.name]
        assert item.source is not None
        marked = item.source.parent / "truth" / f"{item.source.stem}.csv"
        # WGS 84: gravity at sea level is 9.780 to 9.832 m/s²
        truth = {"kinds": kinds, "quantities": {"fall_acceleration": 9.806, "gravity_check": 9.806}}
        return ClipInput(item.source, options, truth, marked if marked.exists() else None)
    if item.part in CLIP_PARTS:
        return _as_input(_case(item, scratch))
    folder = scratch / item.name.replace("/", "-")
    assert item.source is not None
    if item.part == "realdata":
        return TableInput(_real(item, folder), _names(list(REAL_NAMES[item.name])))
    if item.name.startswith("third/"):
        answer = json.loads((item.source / "answer.json").read_text(encoding="utf-8"))
        return TableInput(item.source, _names([*answer["ids"], *answer["fair"]]))
    convert(item.source, folder)
    key = foreign_key(item.source / "answer.json")
    alike = {other for hidden in key.effects for other in hidden.alike}
    return TableInput(folder, _names([hidden.id for hidden in key.effects], alike))


def _names(missing: list[str], alike: set[str] | None = None) -> dict[str, Any]:
    """Truth of a table: names that are right, and verdicts that are right with them."""
    if not missing:
        return {"names": [], "verdicts": ["no_mismatch"]}
    verdicts = ["explained", "ambiguous", *(["unexplained"] if "unnamed" in missing else [])]
    return {"names": sorted({*missing, *(alike or ())}), "verdicts": verdicts}


def _case(item: Item, scratch: Path) -> Case:
    if item.part == "shipped":
        return shipped(SHIPPED / f"{item.name}.truth.json")
    if item.part == "altered":
        case = replace(shipped(SHIPPED / f"{ALTERED}.truth.json"), name=ALTERED)
        return altered(case, WAYS[int(item.name)], scratch)
    if item.part == "rooms":
        return room_case(int(item.name), scratch)
    assert item.source is not None
    return ray_traced(item.source)


def _as_input(case: Case) -> ClipInput:
    truth = {"kinds": ("strike",), "quantities": case.truth}
    return ClipInput(case.path, {"setup": case.options.setup, "ball": case.options.ball}, truth)


def _real(item: Item, folder: Path) -> Path:
    """Folder with the files of a real data set, converted if the engine can't read them."""
    source = item.source
    assert source is not None
    if item.name == "juggling_mocap":
        juggling_mocap.convert(source, folder, _first(source / "flights.csv", "recording"))
    elif item.name == "rocket_coast":
        rocket_coast.convert(source, folder, _first(source / "truth.csv", "object"))
    elif item.name == "rod_pendulum":
        rod_pendulum.convert(source, folder)
    else:
        return source
    return folder


def _first(table: Path, column: str) -> str:
    return str(pd.read_csv(table)[column].iloc[0])
