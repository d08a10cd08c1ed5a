"""Plan of a campaign: shots, frame times and noise."""

from dataclasses import dataclass

import numpy as np

from bench.concealed.world.camera import CameraFaults
from bench.concealed.world.labs import Lab, blank_shots
from bench.concealed.world.motion import Motion
from bench.concealed.world.shots import Array, Shots

__all__ = ["Design", "Noise", "Timing", "draw_design", "frames_of", "view"]


@dataclass(frozen=True)
class Noise:
    """Noise of one campaign's tracks; the correlated part is a first-order autoregression."""

    position: float
    angle: float
    correlated_share: float
    correlation_time: float
    outliers: float
    missing: float
    claim_factor: float


@dataclass(frozen=True)
class Timing:
    """Clock of one trial: label of the first frame and of first contact."""

    first_label: float
    touch_label: float
    hiccup: float


@dataclass(frozen=True)
class Design:
    """A campaign without concealed effects."""

    lab: Lab
    ball_of_trial: tuple[int, ...]
    backswing_deg: Array
    fps: float
    rest_frames: int
    swing_seconds: float
    follow_seconds: float
    timing: tuple[Timing, ...]
    noise: Noise

    def __len__(self) -> int:
        return len(self.ball_of_trial)

    @property
    def progress(self) -> Array:
        """Position of each trial in the series, -0.5 to 0.5."""
        return np.linspace(-0.5, 0.5, len(self))

    def shots(self) -> Shots:
        """The trials according to the baseline."""
        balls = [self.lab.balls[i] for i in self.ball_of_trial]
        return blank_shots(self.lab, balls, np.radians(self.backswing_deg))


def _draw_noise(rng: np.random.Generator) -> Noise:
    return Noise(
        position=float(rng.uniform(0.0005, 0.002)),
        angle=float(rng.uniform(0.0006, 0.0015)),
        correlated_share=float(rng.choice([0.0, 0.0, rng.uniform(0.1, 0.6)])),
        correlation_time=float(rng.uniform(0.003, 0.015)),
        outliers=float(rng.choice([0.0, 0.003, 0.01])),
        missing=float(rng.choice([0.0, 0.06, 0.12])),
        claim_factor=float(rng.choice([1.0, 1.0, rng.uniform(0.7, 1.4)])),
    )


def draw_design(rng: np.random.Generator, lab: Lab) -> Design:
    """8 to 24 trials over all balls and three to five back-swings between 30 and 120 degrees."""
    angles = [
        np.array([30.0, 60.0, 90.0, 120.0]),
        np.array([40.0, 80.0, 110.0]),
        np.array([30.0, 50.0, 70.0, 90.0, 110.0]),
    ][rng.choice(3, p=[0.7, 0.15, 0.15])]
    cells = [(b, a) for b in range(len(lab.balls)) for a in angles]
    trials = int(rng.choice([8, 12, 16, 24], p=[0.4, 0.35, 0.15, 0.1]))
    plan = [cells[i % len(cells)] for i in range(trials)]
    fps = float(rng.choice([600.0, 480.0, 1000.0], p=[0.8, 0.1, 0.1]))
    swing_seconds = float(rng.uniform(0.15, 0.25))
    offset = 0.0 if rng.random() < 0.6 else 1.0
    timing = []
    for _ in range(trials):
        start = np.round((0.02 + offset * rng.uniform(0, 1)) * fps) / fps
        timing.append(
            Timing(
                first_label=float(start),
                touch_label=float(start + swing_seconds + rng.uniform(-0.5, 0.5) / fps),
                hiccup=float(rng.uniform(0.05, 0.2)),
            )
        )
    return Design(
        lab=lab,
        ball_of_trial=tuple(b for b, _ in plan),
        backswing_deg=np.array([a for _, a in plan]),
        fps=fps,
        rest_frames=int(rng.integers(4, 12)),
        swing_seconds=swing_seconds,
        follow_seconds=float(rng.uniform(0.1, 0.16)),
        timing=tuple(timing),
        noise=_draw_noise(rng),
    )


def frames_of(design: Design, trial: int, landing: float) -> tuple[Array, Array]:
    """Times by the frame counter, s after first contact, of ball and pendulum rows."""
    timing, fps = design.timing[trial], design.fps
    start = timing.first_label - timing.touch_label
    last = max(landing, design.follow_seconds)
    elapsed = start + np.arange(int((last - start) * fps) + 1) / fps
    ball = elapsed[(elapsed >= -(design.rest_frames + 0.5) / fps) & (elapsed <= landing)]
    return ball, elapsed[elapsed <= design.follow_seconds]


def view(
    motion: Motion,
    body: int,
    camera: CameraFaults,
    hiccup: float,
    fps: float,
    frames: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Noise-free ball positions (n, 2) and pendulum angles (m,) at the counter times `frames`."""
    ball_frames, pendulum_frames = frames
    times = camera.true_times(ball_frames, hiccup, fps)
    place = motion.ball(times, body)
    if camera.readout:
        rest = float(motion.ball(np.array([-1e-3]), body)[0, 1])
        place = motion.ball(times + camera.row_delay(place[:, 1], rest), body)
    angle = motion.pendulum(camera.true_times(pendulum_frames, hiccup, fps), body)
    return camera.seen(place), angle
