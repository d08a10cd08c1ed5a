"""`vision calibrate plan`: the uncertainty to expect before anyone films, and what would help."""

import json
import math
import re
import sys
from pathlib import Path
from string import ascii_lowercase
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from calib.camera.lens_file import read_lens
from metrology import (
    Quantity,
    UsageError,
    measurands,
    parse_quantity,
    read_number,
    write_text_whole,
)
from physics.bodies import PAPER_PENDULUM, PAPER_SUPPORT
from pipelines.calibrate.filming import Filming
from pipelines.calibrate.foresight import Change, Foreseen, changes_of, foresee
from pipelines.model.options import (
    angle_of,
    choose_ball,
    quantities_as_json,
    setup_or_default,
)
from pipelines.terminal import screen

__all__ = ["plan_filming_command"]

FILM_WIDTH_M = 0.036
"""m, width of the 35 mm film (ISO 1007) that focal lengths are quoted for."""
SHOWN = {
    "contact_time": "Δt",
    "ball_speed": "speed",
    "launch_angle": "angle",
    "landing_distance": "landing",
    "cor": "COR",
}
WORTH_SAYING = 1.03
"""Factor that a change must gain in some uncertainty: less than 3 % nobody would see."""


def plan_filming_command(
    resolution: Annotated[str, typer.Option(help="Picture, px.", metavar="WxH")] = "640x360",
    distance: Annotated[str, typer.Option(help="Camera to wall.")] = "4 m",
    field_of_view: Annotated[
        str | None,
        typer.Option(help="Across; without it, what just holds pendulum and landing."),
    ] = None,
    focal_length: Annotated[
        str | None, typer.Option(help="The same as 35 mm equivalent, such as 28mm.")
    ] = None,
    lens: Annotated[
        Path | None, typer.Option(help="A lens file, from `vision calibrate lens`.")
    ] = None,
    fps: Annotated[str, typer.Option(help="Capture rate.")] = "600 fps",
    shutter: Annotated[str, typer.Option(help="Exposure time.")] = "1/1000 s",
    light: Annotated[
        float,
        typer.Option(help="1: the wall is bright at 1/1000 s without gain; a gymnasium has 0.1."),
    ] = 1.0,
    noise: Annotated[
        float | None,
        typer.Option(help="Instead: noise of a pixel of the wall, gray levels of 255."),
    ] = None,
    ball: Annotated[
        str | None, typer.Option(help="A preset, or a ball of the setup file.", metavar="NAME")
    ] = None,
    backswing: Annotated[str, typer.Option(help="Angle the pendulum is let go at.")] = "90 deg",
    ball_plane: Annotated[str, typer.Option(help="Ball plane in front of the wall.")] = "0.45 m",
    tape: Annotated[
        str, typer.Option(help="How well both distances are taped (one sigma), or none.")
    ] = "5 mm",
    setup: Annotated[
        Path | None, typer.Option(help="Setup file (TOML): ball, pendulum, support.")
    ] = None,
    changes: Annotated[
        bool, typer.Option("--changes/--no-changes", help="Try what would help.")
    ] = True,
    json_to: Annotated[
        str | None, typer.Option("--json", help="Results as JSON; - for stdout.", metavar="FILE")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="No table, no warnings.")] = False,
) -> None:
    """Plan a recording: the uncertainty to expect of every quantity, and which change helps most.

    Example: vision calibrate plan --resolution 1280x720 --fps 240 --distance 3.5m --tape none
    """
    known = setup_or_default(setup)
    width, height = _size(resolution)
    filming = Filming(
        ball=choose_ball(known, ball),
        backswing_deg=math.degrees(angle_of(backswing)),
        width=width,
        height=height,
        fps=read_number(fps, measurands.CAPTURE_RATE, "--fps"),
        exposure_s=read_number(shutter, measurands.SHUTTER, "--shutter"),
        distance_m=read_number(distance, measurands.CAMERA_DISTANCE, "--distance"),
        plane_m=read_number(ball_plane, measurands.BALL_PLANE_OFFSET, "--ball-plane"),
        view_rad=_view(field_of_view, focal_length),
        light=_positive("--light", light),
        gray_std=None if noise is None else _positive("--noise", noise),
        tape_std_m=None if tape == "none" else _positive("--tape", parse_quantity(tape, "m")),
        lens=None if lens is None else read_lens(lens, width=width, height=height),
        pendulum=known.pendulum or PAPER_PENDULUM,
        support=known.support or PAPER_SUPPORT,
    )
    errors = screen(errors=True)
    foreseen = foresee(filming)
    tried: tuple[Change, ...] = ()
    if changes:
        with errors.status("") as status:
            tried = changes_of(foreseen, lambda words: status.update(f"trying: {words}"))
    document = _document(foreseen, tried)
    if json_to not in (None, "-"):
        write_text_whole(Path(str(json_to)), document + "\n")
    if json_to == "-":
        sys.stdout.write(document + "\n")
    elif not quiet:
        _print(screen(), foreseen, tried)
    if not quiet:
        for warning in foreseen.warnings:
            errors.print(f"warning: {warning}", soft_wrap=True)


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"\s*(\d+)\s*[x×]\s*(\d+)\s*", text)
    if match is None:
        raise UsageError(f"{text!r} is no picture size", hint="Write width x height: 640x360.")
    width, height = int(match[1]), int(match[2])
    if not 64 <= min(width, height) <= max(width, height) <= 8192:
        raise UsageError(f"a picture of {width} × {height} px", hint="Give 64 to 8192 px each way.")
    return width, height


def _positive(option: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise UsageError(f"{option} {value:g} makes no sense", hint="Give a positive number.")
    return value


def _view(field_of_view: str | None, focal_length: str | None) -> float | None:
    if field_of_view is not None and focal_length is not None:
        raise UsageError("field of view and focal length say the same thing", hint="Give one.")
    if focal_length is not None:
        focal = _positive("--focal-length", parse_quantity(focal_length, "m"))
        return 2.0 * math.atan(0.5 * FILM_WIDTH_M / focal)
    if field_of_view is None:
        return None
    angle = angle_of(field_of_view)
    if not math.radians(2.0) <= angle <= math.radians(130.0):
        raise UsageError(
            f"a field of view of {math.degrees(angle):g} deg", hint="Give 2 to 130 deg."
        )
    return angle


def _document(foreseen: Foreseen, tried: tuple[Change, ...]) -> str:
    extra: dict[str, Any] = {
        "metres_per_px": foreseen.metres_per_px,
        "field_of_view_deg": _degrees(foreseen),
        "noise_gray_levels": foreseen.filming.noise.gray_std,
        "changes": [_change(change) for change in tried],
    }
    return quantities_as_json(foreseen.quantities, foreseen.warnings, **extra)


def _change(change: Change) -> dict[str, Any]:
    table = json.loads(quantities_as_json(change.foreseen.quantities, ()))["quantities"]
    return {
        "change": change.words,
        "gain": change.gain,
        "opens": list(change.opens),
        "closes": list(change.closes),
        "quantities": table,
    }


def _degrees(foreseen: Foreseen) -> float:
    return math.degrees(2.0 * math.atan(0.5 * (foreseen.lens.width - 1) / foreseen.lens.fx))


def _print(console: Console, foreseen: Foreseen, tried: tuple[Change, ...]) -> None:
    f = foreseen.filming
    console.print(
        f"{f.ball.name}, {f.backswing_deg:g} deg, filmed with {f.width} × {f.height} px at "
        f"{f.fps:g} fps from {f.distance_m:g} m: {1e3 * foreseen.metres_per_px:.1f} mm per px, "
        f"{_degrees(foreseen):.0f} deg of view",
    )
    keys = dict(zip((change.words for change in tried), ascii_lowercase, strict=False))
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("quantity", "about", "± to expect", "unit", "helps most"):
        right = heading in ("about", "± to expect")
        table.add_column(heading, justify="right" if right else "left", no_wrap=True)
    for quantity in foreseen.quantities:
        table.add_row(*_row(quantity, foreseen, tried, keys))
    console.print(table)
    for reason in dict.fromkeys(one.reason for one in foreseen.quantities if one.reason):
        names = ", ".join(one.name for one in foreseen.quantities if one.reason == reason)
        console.print(f"– {names}: {reason}")
    if tried:
        _print_changes(console, foreseen, tried, keys)


def _row(
    quantity: Quantity, foreseen: Foreseen, tried: tuple[Change, ...], keys: dict[str, str]
) -> list[str]:
    name = quantity.name
    if quantity.value is None or quantity.std is None:
        opener = next((keys[change.words] for change in tried if name in change.opens), "")
        return [name, "–", "", quantity.unit, opener and f"{opener} makes it measurable"]
    ratios = [(change.ratio(foreseen, name) or 1.0, change.words) for change in tried]
    ratio, words = min(ratios, default=(1.0, ""))
    digits = min(max(1 - math.floor(math.log10(quantity.std)), 0), 8)
    return [
        name,
        f"{quantity.value:.{digits}f}",
        f"{quantity.std:.{digits}f}",
        quantity.unit,
        f"{keys[words]} × {ratio:.2f}" if ratio < 1.0 / WORTH_SAYING else "",
    ]


def _print_changes(
    console: Console, foreseen: Foreseen, tried: tuple[Change, ...], keys: dict[str, str]
) -> None:
    table = Table(title="What if: new ± over old", box=box.SIMPLE_HEAD)
    for heading in ("", "change"):
        table.add_column(heading)
    for heading in ("all", *SHOWN.values()):
        table.add_column(heading, justify="right", no_wrap=True)
    for change in tried:
        ratios = [change.ratio(foreseen, name) for name in SHOWN]
        cells = ["–" if ratio is None else f"{ratio:.2f}" for ratio in ratios]
        table.add_row(keys[change.words], change.words, f"{1.0 / change.gain:.2f}", *cells)
    console.print(table)
    for change in tried:
        for verb, names in (("makes measurable", change.opens), ("loses", change.closes)):
            if names:
                words = f"{keys[change.words]} {verb} {', '.join(names)}"
                console.print(words)
    best = tried[0]
    if best.opens or best.gain > WORTH_SAYING:
        console.print(
            f"Helps most: {best.words} (± shrinks to {100.0 / best.gain:.0f} % on the mean"
            f"{', and more can be measured' if best.opens else ''})",
        )
    else:
        console.print("None of these would help noticeably.")
