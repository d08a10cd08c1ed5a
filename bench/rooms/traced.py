"""Random rooms rendered by a path tracer that is independent of the project.

Light, shadows and reflections are computed by Mitsuba (https://mitsuba-renderer.org; `pip install
impact-vision[traced]`, with LLVM 16 or later as a shared library). The strike is integrated here
with a contact law that the project does not contain: a force of δ^1.3 with a loss proportional to
δ·dδ/dt. Frame of reference: x right, y up from the floor, z out of the wall, m; t = 0 at first
contact.
"""

import json
import math
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from sample_videos.truth import FrameTruth, truth_path

__all__ = ["TracedRoom", "draw_traced", "film_traced"]

FloatArray = NDArray[np.float64]

GRAVITY = 9.81
AIR = 1.2
BALLS = {"basketball": (0.605, 0.2459), "jokku": (0.353, 0.20175)}
"""Mass, kg, and diameter, m, of the balls in Ryu et al."""
BEFORE_S, AFTER_S = 0.085, 0.13
SIZES = ((432, 240), (320, 180), (640, 360), (208, 116))
STEP_S = 2e-5
SUBFRAMES, SAMPLES = 4, 4


@dataclass(frozen=True)
class Rig:
    """Pendulum and ball; the angle is zero when the arm hangs vertically.

    Attributes
    ----------
    make : {"block", "bob", "hammer"}
    half : (3,) array
        Half the sides of the block, along the arm's normal, along the arm and across, m.
    """

    make: str
    ball_mass: float
    radius: float
    height: float
    plane: float
    length: float
    half: FloatArray
    arm_radius: float
    effective_mass: float
    backswing: float
    touch: float
    stiffness: float
    loss: float
    friction: float


@dataclass(frozen=True)
class Strike:
    """States at fine time steps: time, ball position and velocity in its plane, angle and rate."""

    time: FloatArray
    place: FloatArray
    phi: FloatArray
    rest_pivot: FloatArray
    released: float
    speed: FloatArray
    before: float
    after: float
    cor: float


@dataclass(frozen=True)
class Eye:
    """A pinhole camera: position, axes as rows (right, down, forward), focal length in px."""

    place: FloatArray
    axes: FloatArray
    focal: float
    size: tuple[int, int]

    def pixels(self, points: FloatArray) -> FloatArray:
        """Project points (..., 3), px; pixel centres are integers."""
        own = (points - self.place) @ self.axes.T
        middle = (np.array(self.size) - 1.0) / 2.0
        return np.asarray(middle + self.focal * own[..., :2] / own[..., 2:])

    def outline(self, centre: FloatArray, radius: float) -> tuple[FloatArray, float]:
        """Centre and mean radius of a sphere's outline, an ellipse, px."""
        own = self.axes @ (centre - self.place)
        cone = (own @ own - radius**2) * np.eye(3) - np.outer(own, own)
        at = -np.linalg.solve(cone[:2, :2], cone[:2, 2])
        level = cone[2, 2] + cone[2, :2] @ at
        area = abs(level) / math.sqrt(np.linalg.det(cone[:2, :2]))
        middle = (np.array(self.size) - 1.0) / 2.0
        return middle + self.focal * at, self.focal * math.sqrt(area)


@dataclass(frozen=True)
class TracedRoom:
    """Everything one clip is rendered from; `scenery` is in the renderer's format."""

    seed: int
    words: str
    ball: str
    rig: Rig
    eye: Eye
    scenery: dict[str, Any]
    looks: dict[str, Any]
    pitch: float | None
    fps: float
    exposure: float
    first: float
    frames: int
    mirrored: bool
    noise: float
    flicker: float
    bitrate: int


def draw_traced(seed: int) -> TracedRoom:
    """Draw a room; a seed always gives the same room."""
    rng = np.random.default_rng([seed, 4201])
    ball = str(rng.choice(sorted(BALLS)))
    rig = _rig(rng, ball)
    size = SIZES[int(rng.choice(4, p=[0.5, 0.25, 0.1, 0.15]))]
    fps = float(rng.choice([600.0, 600.0, 480.0, 300.0]))
    eye, aside = _eye(rng, rig, size)
    pitch = 0.05 if rng.uniform() < 0.4 else None
    scenery, wall = _scenery(rng, rig, pitch)
    mirrored = bool(rng.uniform() < 0.4)
    first = -(BEFORE_S + float(rng.uniform(0.0, 1.0 / fps)))
    words = f"{rig.make}, {ball}, {wall}, {math.degrees(rig.backswing):.0f}°, {size[0]}×{size[1]}"
    words += f", {fps:.0f} fps, camera {aside:.0f}° aside" + (
        ", from the right" if mirrored else ""
    )
    return TracedRoom(
        seed=seed,
        words=words,
        ball=ball,
        rig=rig,
        eye=eye,
        scenery=scenery,
        looks=_looks(rng, ball),
        pitch=pitch,
        fps=fps,
        exposure=float(rng.uniform(0.15, 0.9)) / fps,
        first=first,
        frames=math.ceil((AFTER_S - first) * fps),
        mirrored=mirrored,
        noise=float(rng.uniform(0.004, 0.02)),
        flicker=float(rng.choice([0.0, 0.02, 0.05])),
        bitrate=int(float(rng.choice([0.6e6, 1.5e6, 4e6])) * size[0] * size[1] / (432 * 240)),
    )


def _rig(rng: np.random.Generator, ball: str) -> Rig:
    mass, diameter = BALLS[ball]
    make = str(rng.choice(["block", "block", "bob", "hammer"]))
    half = np.array([rng.uniform(0.02, 0.07), rng.uniform(0.02, 0.06), rng.uniform(0.02, 0.06)])
    if make == "bob":
        half = np.full(3, float(rng.uniform(0.03, 0.06)))
    return Rig(
        make=make,
        ball_mass=mass,
        radius=diameter / 2.0,
        height=float(rng.uniform(0.3, 0.6)),
        plane=float(rng.uniform(0.25, 0.7)),
        length=float(rng.uniform(0.42, 0.65)),
        half=half,
        arm_radius=float(rng.choice([0.002, 0.005, 0.01, 0.014])),
        effective_mass=float(rng.uniform(3.0, 7.0)),
        backswing=math.radians(float(rng.uniform(50.0, 110.0))),
        touch=math.radians(float(rng.uniform(-4.0, 10.0))),
        stiffness=float(rng.uniform(35e3, 90e3)),
        loss=float(rng.uniform(0.02, 0.12)),
        friction=float(rng.uniform(0.0, 0.3)),
    )


def _contact_offset(rig: Rig, phi: float | FloatArray) -> FloatArray:
    """Vector from the pivot to the contact point, in the plane of the swing, m."""
    ahead = rig.half[0]
    return np.stack(
        [
            ahead * np.cos(phi) + rig.length * np.sin(phi),
            ahead * np.sin(phi) - rig.length * np.cos(phi),
        ],
        axis=-1,
    )


def strike_of(rig: Rig) -> Strike:
    """Integrate mass and ball from before first contact to the end of the clip."""
    weight = GRAVITY / (0.83 * rig.length)
    fall = math.cos(rig.touch) - math.cos(rig.backswing)
    rate = math.sqrt(2.0 * weight * fall)
    rest = np.array([0.0, rig.height + rig.radius])
    normal = np.array([math.cos(rig.touch), math.sin(rig.touch)])
    pivot = rest - rig.radius * normal - _contact_offset(rig, rig.touch)
    back = _swung(rig.touch, rate, weight, -(BEFORE_S + 0.02))
    states = [(-(k + 1) * STEP_S, rest, np.zeros(2), phi) for k, (phi, _) in enumerate(back)][::-1]
    time, phi, place, speed = 0.0, rig.touch, rest.copy(), np.zeros(2)
    turn, released, parted = rate, math.nan, (np.zeros(2), 0.0, 0.0)
    while time < AFTER_S + 0.02:
        states.append((time, place, speed, phi))
        face = pivot + _contact_offset(rig, phi)
        normal = np.array([math.cos(phi), math.sin(phi)])
        depth = rig.radius - float((place - face) @ normal)
        closing = turn * rig.length - float(speed @ normal)
        force = 0.0
        if depth > 0.0 and math.isnan(released):
            force = max(0.0, rig.stiffness * depth**1.3 * (1.0 + rig.loss * closing))
        if time > 1e-3 and math.isnan(released) and force == 0.0:
            released, parted = time, (speed, turn, float(speed @ normal) - turn * rig.length)
        slide = np.array([-normal[1], normal[0]])
        push = force * (normal + rig.friction * slide * np.sign(turn * rig.half[0] - speed @ slide))
        drag = 0.5 * AIR * 0.47 * math.pi * rig.radius**2 * np.hypot(*speed) * speed
        pull = (push - drag) / rig.ball_mass - np.array([0.0, GRAVITY])
        speed = speed + STEP_S * pull
        if place[1] <= rest[1] + 1e-9 and speed[1] < 0.0 and place[0] < 0.01:
            speed = np.array([speed[0], 0.0])
        if place[1] < rig.radius and speed[1] < 0.0:
            speed = np.array([0.8, -0.6]) * speed
        place = place + STEP_S * speed
        turn -= STEP_S * (force / (rig.effective_mass * rig.length) + weight * math.sin(phi))
        phi += STEP_S * turn
        time += STEP_S
    return Strike(
        time=np.array([row[0] for row in states]),
        place=np.array([row[1] for row in states]),
        phi=np.array([row[3] for row in states]),
        rest_pivot=pivot,
        released=released,
        speed=parted[0],
        before=rate * rig.length,
        after=parted[1] * rig.length,
        cor=parted[2] / (rate * rig.length),
    )


def _swung(phi: float, turn: float, weight: float, until: float) -> list[tuple[float, float]]:
    rows = []
    for _ in range(round(abs(until) / STEP_S)):
        turn += STEP_S * weight * math.sin(phi)
        phi -= STEP_S * turn
        rows.append((phi, turn))
    return rows


def _eye(rng: np.random.Generator, rig: Rig, size: tuple[int, int]) -> tuple[Eye, float]:
    aside = math.radians(float(rng.uniform(-22.0, 22.0))) if rng.uniform() < 0.4 else 0.0
    down = math.radians(float(rng.uniform(-3.0, 9.0)))
    away = float(rng.uniform(1.8, 4.0))
    wide = float(rng.uniform(1.3, 2.2))
    look = np.array(
        [rng.uniform(-0.05, 0.25) * wide, rig.height + rng.uniform(0.05, 0.3), rig.plane]
    )
    forward = np.array(
        [math.sin(aside) * math.cos(down), -math.sin(down), -math.cos(aside) * math.cos(down)]
    )
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    roll = math.radians(float(rng.normal(0.0, 0.7)))
    below = np.cross(forward, right)
    right, below = (
        math.cos(roll) * right + math.sin(roll) * below,
        math.cos(roll) * below - math.sin(roll) * right,
    )
    eye = Eye(look - away * forward, np.array([right, below, forward]), size[0] * away / wide, size)
    return eye, math.degrees(aside)


def _level(rng: np.random.Generator, low: float, high: float) -> list[float]:
    level = rng.uniform(low, high)
    return [float(v) for v in np.clip(level * rng.uniform(0.75, 1.25, 3), 0.02, 0.92)]


def _renderer() -> Any:
    """Import the path tracer on demand; it is an optional dependency."""
    try:
        import mitsuba

        mitsuba.set_variant("llvm_ad_rgb")
    except ImportError as problem:
        raise SystemExit(
            f"the path tracer cannot start: {problem}\nInstall it (pip install "
            "impact-vision[traced]) and LLVM 16 or later (libllvm19 in Debian), and point "
            "DRJIT_LIBLLVM_PATH at the library if it is not found."
        ) from None
    return mitsuba


def _picture(image: FloatArray) -> dict[str, Any]:
    mi = _renderer()
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(image.astype(np.float32)),
        "raw": True,
        "filter_type": "bilinear",
    }


def _wall_picture(rng: np.random.Generator, kind: str, pitch: float | None) -> FloatArray:
    """Reflectance of the wall, 6 m × 3 m, top row first, (600, 1200, 3) at 5 mm per texel."""
    rows, columns = 1200, 2400
    image = np.ones((rows, columns, 3)) * _level(rng, 0.25, 0.85)
    v, u = np.mgrid[0:rows, 0:columns] * 0.0025
    if kind == "bricks":
        course = np.floor(v / 0.075)
        x = (u + 0.105 * (course % 2)) / 0.21
        tone = rng.uniform(0.75, 1.15, (60, 60))[
            course.astype(int) % 60, np.floor(x).astype(int) % 60
        ]
        mortar = (np.mod(x, 1.0) < 0.05) | (np.mod(v, 0.075) < 0.01)
        image = np.where(mortar[..., None], image * 1.15, image * 0.75 * tone[..., None])
    elif kind == "boards":
        board = np.floor(u / 0.12).astype(int)
        tone = rng.uniform(0.8, 1.1, 60)[board % 60] * (
            1.0 + 0.06 * np.sin(40.0 * v + 6.0 * np.sin(3.0 * u))
        )
        image = image * np.where(np.mod(u, 0.12) < 0.006, 0.5, tone)[..., None]
    elif kind == "speckled":
        coarse = rng.normal(0.0, 1.0, (rows // 8, columns // 8)).repeat(8, 0).repeat(8, 1)
        image = image * (1.0 + 0.07 * coarse)[..., None]
    elif kind == "paper":
        image = image * (1.0 + 0.15 * np.sign(np.sin(2 * np.pi * u / 0.3)))[..., None]
    if pitch is not None:
        x, y = u + rng.uniform(0.0, pitch), v + rng.uniform(0.0, pitch)
        half = float(rng.uniform(0.0012, 0.002))
        lines = (np.mod(x, pitch) < 2 * half + 0.0025) | (np.mod(y, pitch) < 2 * half + 0.0025)
        image = np.where(lines[..., None], image * float(rng.uniform(0.35, 0.75)), image)
    return np.clip(image, 0.02, 0.92)


def _box(centre: list[float], half: list[float], colour: list[float]) -> dict[str, Any]:
    mi = _renderer()
    at = mi.ScalarTransform4f().translate(centre).scale(half)
    return {"type": "cube", "to_world": at, "bsdf": _matt(colour)}


def _matt(colour: list[float]) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}


def _lamps(rng: np.random.Generator) -> dict[str, Any]:
    move, things = _renderer().ScalarTransform4f, {}
    for index in range(int(rng.integers(1, 3))):
        spread = float(rng.uniform(0.05, 0.5))
        at = [
            float(rng.uniform(-2.0, 2.0)),
            float(rng.uniform(1.8, 2.8)),
            float(rng.uniform(1.0, 3.0)),
        ]
        power = float(rng.uniform(3.0, 7.0)) / (4.0 * spread**2)
        things[f"lamp{index}"] = {
            "type": "rectangle",
            "to_world": move()
            .look_at(origin=at, target=[0.3, 0.5, 0.3], up=[0, 1, 0.01])
            .scale([spread, spread, 1.0]),
            "emitter": {
                "type": "area",
                "radiance": {"type": "rgb", "value": [power, power * 0.95, power * 0.88]},
            },
        }
    return things


def _furniture(rng: np.random.Generator, rig: Rig) -> dict[str, Any]:
    """Boxes on the floor and on the wall, and balls at rest."""
    things: dict[str, Any] = {}
    for index in range(int(rng.integers(0, 5))):
        half = [float(v) for v in rng.uniform([0.05, 0.08, 0.02], [0.35, 0.5, 0.12])]
        side = float(rng.uniform(-1.6, 2.2))
        things[f"box{index}"] = _box(
            [
                side,
                half[1] if rng.uniform() < 0.6 else float(rng.uniform(0.4, 1.2)),
                half[2] + 0.001,
            ],
            half,
            _level(rng, 0.05, 0.85),
        )
    for index in range(int(rng.integers(0, 3))):
        radius = float(rng.uniform(0.04, 0.12))
        things[f"other{index}"] = {
            "type": "sphere",
            "center": [
                float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.35, 1.3)) + 0.3,
                radius,
                float(rng.uniform(0.1, rig.plane + 0.2)),
            ],
            "radius": radius,
            "bsdf": _matt(_level(rng, 0.05, 0.85)),
        }
    return things


def _scenery(rng: np.random.Generator, rig: Rig, pitch: float | None) -> tuple[dict[str, Any], str]:
    """The static objects, and the kind of wall behind them."""
    move = _renderer().ScalarTransform4f
    kind = str(rng.choice(["plain", "plain", "bricks", "boards", "speckled", "paper"]))
    wall = _wall_picture(rng, kind, pitch)
    things: dict[str, Any] = {
        "wall": {
            "type": "rectangle",
            "to_world": move().translate([0.0, 1.5, 0.0]).scale([3.0, 1.5, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": _picture(wall)},
        },
        "floor": {
            "type": "rectangle",
            "to_world": move().rotate([1, 0, 0], -90.0).scale([6.0, 6.0, 1.0]),
            "bsdf": _matt(_level(rng, 0.15, 0.5)),
        },
        "sky": {
            "type": "constant",
            "radiance": {"type": "rgb", "value": [float(rng.uniform(0.15, 0.6))] * 3},
        },
    }
    things |= _lamps(rng)
    things |= _furniture(rng, rig)
    post = float(rng.uniform(0.008, 0.03))
    things["post"] = {
        "type": "cylinder",
        "p0": [0.0, 0.0, rig.plane],
        "p1": [0.0, rig.height + 0.5 * post**2 / rig.radius, rig.plane],
        "radius": post,
        "bsdf": {"type": "twosided", "bsdf": _matt(_level(rng, 0.05, 0.7))},
    }
    return things, kind


def _looks(rng: np.random.Generator, ball: str) -> dict[str, Any]:
    """Materials of ball, mass and arm."""
    make = str(rng.choice(["plain", "two halves", "stripes", "seams", "spots", "glossy", "metal"]))
    pale, dark = np.array(_level(rng, 0.4, 0.9)), np.array(_level(rng, 0.03, 0.45))
    v, u = np.mgrid[0:128, 0:256] / np.array([128.0, 256.0])[:, None, None]
    which = np.zeros((128, 256), bool)
    if make == "two halves":
        which = u < 0.5
    elif make == "stripes":
        which = np.mod(u * 6.0, 1.0) < 0.5
    elif make == "seams":
        which = (np.mod(u * 4.0, 1.0) < 0.06) | (np.abs(v - 0.5) < 0.012)
    elif make == "spots":
        for _ in range(40):
            which |= (u - rng.uniform()) ** 2 * 4.0 + (v - rng.uniform()) ** 2 < 0.0025
    base, mark = (pale, dark) if rng.uniform() < 0.6 else (dark, pale)
    skin: dict[str, Any] = {
        "type": "diffuse",
        "reflectance": _picture(np.where(which[..., None], mark, base)),
    }
    if make == "glossy":
        skin = {
            "type": "roughplastic",
            "alpha": 0.12,
            "diffuse_reflectance": {"type": "rgb", "value": [float(c) for c in base]},
        }
    elif make == "metal":
        skin = {"type": "roughconductor", "material": "Cr", "alpha": 0.25}
    spin = [float(a) for a in rng.uniform(0.0, 360.0, 2)]
    mass = _level(rng, 0.03, 0.8)
    body: dict[str, Any] = _matt(mass)
    if rng.uniform() < 0.3:
        body = {
            "type": "roughplastic",
            "alpha": 0.2,
            "diffuse_reflectance": {"type": "rgb", "value": mass},
        }
    return {
        "make": make,
        "ball": skin,
        "spin": spin,
        "mass": body,
        "arm": _matt(_level(rng, 0.05, 0.7)),
    }


def _moving(room: TracedRoom, place: FloatArray, phi: float, pivot: FloatArray) -> dict[str, Any]:
    mi = _renderer()
    rig, move = room.rig, mi.ScalarTransform4f
    centre = [float(place[0]), float(place[1]), rig.plane]
    hinge = [float(pivot[0]), float(pivot[1]), rig.plane]
    turned = move().translate(hinge).rotate([0, 0, 1], math.degrees(phi))
    ball = (
        move()
        .translate(centre)
        .rotate([0, 1, 0], room.looks["spin"][0])
        .rotate([1, 0, 0], room.looks["spin"][1])
    )
    middle = [0.0, -rig.length, 0.0]
    if rig.make == "bob":
        mass = {"type": "sphere", "to_world": turned.translate(middle).scale(float(rig.half[0]))}
    elif rig.make == "hammer":
        along = turned.translate([-float(rig.half[0]), -rig.length, 0.0]).rotate([0, 1, 0], 90.0)
        mass = {
            "type": "cylinder",
            "to_world": along.scale(
                [float(rig.half[1]), float(rig.half[1]), 2.0 * float(rig.half[0])]
            ),
        }
    else:
        mass = {
            "type": "cube",
            "to_world": turned.translate(middle).scale([float(h) for h in rig.half]),
        }
    arm = {
        "type": "cylinder",
        "to_world": turned.translate([0.0, -rig.length, 0.0])
        .rotate([1, 0, 0], -90.0)
        .scale([rig.arm_radius, rig.arm_radius, rig.length + 0.05]),
        "bsdf": {"type": "twosided", "bsdf": room.looks["arm"]},
    }
    parts: dict[str, Any] = {
        "ball": {"type": "sphere", "to_world": ball.scale(rig.radius), "bsdf": room.looks["ball"]},
        "mass": {
            **mass,
            "bsdf": {"type": "twosided", "bsdf": room.looks["mass"]}
            if rig.make == "hammer"
            else room.looks["mass"],
        },
        "arm": arm,
    }
    if rig.make == "hammer":
        end = (
            turned.translate([float(rig.half[0]), -rig.length, 0.0])
            .rotate([0, 1, 0], 90.0)
            .scale(float(rig.half[1]))
        )
        parts["face"] = {"type": "disk", "to_world": end, "bsdf": room.looks["mass"]}
    return parts


def film_traced(room: TracedRoom, path: Path) -> None:
    """Render a room; write the clip as H.264 and its truth file."""
    strike = strike_of(room.rig)
    room = _loaded(room)
    times = room.first + np.arange(room.frames) / room.fps
    rng = np.random.default_rng([room.seed, 7])
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=Fraction(30))
        stream.width, stream.height = room.eye.size
        stream.pix_fmt = "yuv420p"
        stream.bit_rate = room.bitrate
        gain = None
        for time in times:
            light = _exposed(room, strike, float(time))
            gain = gain or 0.42 / float(np.mean(light))
            level = light * gain * (1.0 + room.flicker * math.sin(2 * math.pi * 100.0 * time))
            level = level + rng.normal(0.0, 1.0, level.shape) * room.noise * np.sqrt(
                np.maximum(level, 0.05)
            )
            shown = (255.0 * np.clip(level, 0.0, 1.0) ** (1.0 / 2.2)).round().astype(np.uint8)
            if room.mirrored:
                shown = np.ascontiguousarray(shown[:, ::-1])
            for packet in stream.encode(av.VideoFrame.from_ndarray(shown, format="rgb24")):
                file.mux(packet)
        for packet in stream.encode():
            file.mux(packet)
    truth_path(path).write_text(json.dumps(_truth(room, strike, times)))


def _loaded(room: TracedRoom) -> TracedRoom:
    """The room with the static objects passed to the renderer once for all frames."""
    mi = _renderer()
    scenery = {name: mi.load_dict(thing) for name, thing in room.scenery.items()}
    looks = {
        name: mi.load_dict(thing) if isinstance(thing, dict) else thing
        for name, thing in room.looks.items()
    }
    return replace(room, scenery=scenery, looks=looks)


def _exposed(room: TracedRoom, strike: Strike, time: float) -> FloatArray:
    mi = _renderer()
    eye, total = room.eye, np.zeros(0)
    target = eye.place + eye.axes[2]
    sensor = {
        "type": "perspective",
        "fov": math.degrees(2.0 * math.atan(eye.size[0] / 2.0 / eye.focal)),
        "fov_axis": "x",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=eye.place.tolist(), target=target.tolist(), up=(-eye.axes[1]).tolist()
        ),
        "film": {
            "type": "hdrfilm",
            "width": eye.size[0],
            "height": eye.size[1],
            "rfilter": {"type": "gaussian"},
            "pixel_format": "rgb",
        },
        "sampler": {"type": "multijitter", "sample_count": SAMPLES},
    }
    for part in range(SUBFRAMES):
        at = time + room.exposure * ((part + 0.5) / SUBFRAMES - 0.5)
        place = np.array([np.interp(at, strike.time, strike.place[:, k]) for k in (0, 1)])
        phi = float(np.interp(at, strike.time, strike.phi))
        scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": 3},
                "sensor": sensor,
                **room.scenery,
                **_moving(room, place, phi, strike.rest_pivot),
            },
            optimize=False,
        )
        picture = np.array(mi.render(scene, spp=SAMPLES, seed=part), dtype=np.float64)
        total = picture if part == 0 else total + picture
    return np.asarray(total / SUBFRAMES)


def _truth(room: TracedRoom, strike: Strike, times: FloatArray) -> dict[str, Any]:
    rig, eye = room.rig, room.eye
    rows = []
    for time in times:
        place = np.array(
            [*(np.interp(time, strike.time, strike.place[:, k]) for k in (0, 1)), rig.plane]
        )
        phi = float(np.interp(time, strike.time, strike.phi))
        outline, radius = eye.outline(place, rig.radius)
        turn = np.array([[math.cos(phi), -math.sin(phi)], [math.sin(phi), math.cos(phi)]])
        mass = np.array([*(strike.rest_pivot + turn @ [0.0, -rig.length]), rig.plane])
        face = np.array([*(strike.rest_pivot + _contact_offset(rig, phi)), rig.plane])
        seen = np.vstack([eye.pixels(np.stack([place, mass, face])), outline])
        if room.mirrored:
            seen = np.array([eye.size[0] - 1.0, 0.0]) + seen * [-1.0, 1.0]
        rows.append((place, seen, radius, phi))
    frames = FrameTruth(
        time=times,
        ball_m=np.array([row[0] for row in rows]),
        ball_px=np.array([row[1][0] for row in rows]),
        outline_px=np.array([row[1][3] for row in rows]),
        radius_px=np.array([row[2] for row in rows]),
        compression_m=np.zeros(len(rows)),
        phi_rad=np.array([row[3] for row in rows]),
        mass_px=np.array([row[1][1] for row in rows]),
        face_px=np.array([row[1][2] for row in rows]),
    )
    told = {
        "time_s" if name == "time" else name: value.tolist()
        for name, value in asdict(frames).items()
    }
    first, speed = float(times[0]), float(np.hypot(*strike.speed))
    touching = int(np.count_nonzero((times >= 0.0) & (times <= strike.released)))
    values = {
        "contact_frames": touching,
        "contact_time": strike.released,
        "contact_start": -first,
        "contact_end": strike.released - first,
        "pendulum_speed_before": strike.before,
        "pendulum_speed_after": strike.after,
        "ball_speed": speed,
        "launch_angle": math.degrees(math.atan2(strike.speed[1], strike.speed[0])),
        **dict.fromkeys(("cor_speeds", "cor_launch", "cor_range"), strike.cor),
        "external_impulse": rig.ball_mass * speed,
        "ball_plane_offset": rig.plane,
        "backswing_angle": math.degrees(rig.backswing),
    }
    return {
        "words": room.words,
        "quantities": {name: {"value": value} for name, value in values.items()},
        "physics": {"gravity": GRAVITY},
        "frames": told,
        "events_s": {"contact_start": 0.0, "contact_end": strike.released, "landing": 10.0},
        "camera": {"width": eye.size[0], "height": eye.size[1]},
        "shutter": {"fps": room.fps},
    }
