"""The uncertainty to expect of every quantity before anyone films, and which change helps most.

The stroke is simulated, its tracks are what following would give, the camera is fitted to the grid
as it will be seen, and from there on everything is the measuring chain itself, budget included.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.camera.lens_model import Lens
from calib.planning import board_lens, planned_grid
from calib.solve import SeenFall, solve
from metrology import Defaults, MeasurementError, Quantity
from pipelines.calibrate.filming import Filming, film_scene, planned_tracks
from pipelines.measure.budget import Scene as Known
from pipelines.measure.budget import systematic_budget, values_after_move
from pipelines.measure.calibrated import scene_evidence
from pipelines.measure.checks.gravity import seen_fall
from pipelines.measure.derived import derived_values, random_covariance
from pipelines.measure.fits.impact import find_impact
from pipelines.measure.inputs import gather_inputs
from pipelines.measure.metres import CameraMapping, tracks_in_metres
from pipelines.measure.results import Evaluated, NoScale, results_of
from pipelines.setup.file import BallSetup, CameraSetup, Setup, WallSetup
from sample_videos.scene import Scene
from vision.clip.capture_rate import CaptureRate, RateSource, nominal_rate_std
from vision.tracks import Tracks

__all__ = ["Change", "Foreseen", "changes_of", "foresee", "planned_setup"]

FloatArray = NDArray[np.float64]

SURE_PITCH_PX, SURE_RADIUS_PX = 3.6, 5.0
"""px, smallest squares that the grid search is sure to find, from rendered walls, and the smallest
radius of a ball whose outline is sure to be fitted, supposed."""
TAPE_CLOSER_STD_M = 0.002
"""m, a tape read twice by two people: as well as a length of metres is usually taped."""


@dataclass(frozen=True)
class Foreseen:
    """What a recording will tell.

    Attributes
    ----------
    filming : Filming
    quantities : tuple of Quantity
        In the order of the contract; values are those of the simulated stroke.
    metres_per_px : float
        On the ball plane, at the ball at rest.
    lens : Lens
        Of the camera that films.
    warnings : tuple of str
    """

    filming: Filming
    quantities: tuple[Quantity, ...]
    metres_per_px: float
    lens: Lens
    warnings: tuple[str, ...]

    def std(self, name: str) -> float | None:
        """Standard uncertainty of a quantity; None where it can't be measured."""
        return next(one.std for one in self.quantities if one.name == name)


@dataclass(frozen=True)
class Change:
    """Something that could be done otherwise, and what it does.

    Attributes
    ----------
    words : str
    foreseen : Foreseen
    gain : float
        By how much uncertainties shrink: geometric mean, over what can be measured both ways, of
        the old over the new.
    opens, closes : tuple of str
        Quantities that it makes measurable, and those it takes away.
    """

    words: str
    foreseen: Foreseen
    gain: float
    opens: tuple[str, ...]
    closes: tuple[str, ...]

    def ratio(self, before: Foreseen, name: str) -> float | None:
        """New over old uncertainty of a quantity; None where one of them is missing."""
        old, new = before.std(name), self.foreseen.std(name)
        return new / old if new is not None and old else None


def planned_setup(filming: Filming, scene: Scene) -> Setup:
    """What the lab will write down."""
    ball, tape = scene.ball, filming.tape_std_m
    distance = float(scene.camera.position[2])
    return Setup(
        camera=CameraSetup(filming.fps, None if tape is None else (distance, tape)),
        wall=WallSetup(
            scene.room.wall.pitch,
            scene.room.wall.fine_pitch,
            None if tape is None else (scene.room.plane, tape),
        ),
        ball=BallSetup(ball.name, ball.diameter, ball.mass, ball.launch_angle, ball.cor),
        pendulum=scene.pendulum,
        support=scene.support,
    )


def foresee(filming: Filming) -> Foreseen:
    """Uncertainty of every quantity of the contract for a recording that is only planned.

    Raises
    ------
    CalibrationError
        If the wall's grid would not be seen well enough.
    DomainError, UsageError
        If the stroke can't happen, or can't be filmed like that.
    """
    scene, shot = film_scene(filming)
    tracks = planned_tracks(filming, scene, shot)
    inputs = gather_inputs(planned_setup(filming, scene), None, None)
    rate = CaptureRate(filming.fps, nominal_rate_std(filming.fps), RateSource.SETUP)
    calibration = _calibrated(filming, scene, tracks, Known(inputs, rate, None))
    known = Known(inputs, rate, calibration)
    results = results_of(_evaluated(known, tracks, scene), tracks, NoScale(""))
    lens = scene.camera.lens
    scale = float(scene.camera.position[2] - scene.room.plane) / lens.fx
    return Foreseen(filming, results.quantities, scale, lens, _warnings(scene, scale))


def _warnings(scene: Scene, metres_per_px: float) -> tuple[str, ...]:
    said = []
    pitch = scene.room.wall.pitch * (scene.camera.lens.fx / float(scene.camera.position[2]))
    if pitch < SURE_PITCH_PX:
        said.append(
            f"the lines of the wall will be {pitch:.1f} px apart: they may not be found below "
            f"{SURE_PITCH_PX} px"
        )
    radius = scene.ball.radius / metres_per_px
    if radius < SURE_RADIUS_PX:
        said.append(f"the ball will be only {2 * radius:.0f} px across")
    return tuple(said)


def _times(known: Known, scene: Scene) -> FloatArray:
    return np.arange(scene.frames) / known.rate.fps


def _calibrated(filming: Filming, scene: Scene, tracks: Tracks, known: Known) -> Calibration:
    def see_fall(calibration: Calibration) -> SeenFall | None:
        return seen_fall(replace(known, calibration=calibration), tracks, _times(known, scene))

    grid = planned_grid(scene.camera, scene.room.wall.pitch)
    evidence = scene_evidence(tracks, known.inputs)
    return solve(grid, evidence, lens=filming.lens, see_fall=see_fall).calibration


def _evaluated(known: Known, tracks: Tracks, scene: Scene) -> Evaluated:
    inputs, calibration = known.inputs, known.calibration
    assert calibration is not None
    nothing = Evaluated(known, None, None, np.zeros(0), np.zeros((0, 0)), {}, "")
    try:
        metric = tracks_in_metres(tracks, CameraMapping(calibration), _times(known, scene))
        impact = find_impact(metric, inputs)
    except MeasurementError as problem:
        return replace(nothing, refusal=problem.message)

    def values(moved: Known) -> FloatArray:
        assert moved.calibration is not None
        again = tracks_in_metres(tracks, CameraMapping(moved.calibration), _times(moved, scene))
        return values_after_move(impact, again, moved.inputs)

    return Evaluated(
        known,
        metric,
        impact,
        derived_values(impact, inputs),
        random_covariance(impact, inputs),
        systematic_budget(known, values, np.inf),
        "",
    )


def changes_of(
    before: Foreseen, progress: Callable[[str], None] | None = None
) -> tuple[Change, ...]:
    """What could be done otherwise, the most helpful first.

    A change that can't be filmed (the grid gone, a rate beyond the shutter) is left out.
    """
    changes = []
    for words, filming in _tried(before):
        if progress is not None:
            progress(words)
        try:
            after = foresee(filming)
        except MeasurementError:
            continue
        changes.append(_compared(words, before, after))
    return tuple(sorted(changes, key=lambda c: (len(c.closes) - len(c.opens), -c.gain)))


def _tried(before: Foreseen) -> list[tuple[str, Filming]]:
    f = before.filming
    lens = before.lens
    tried: list[tuple[str, Filming]] = []
    if f.tape_std_m is None:
        taped = replace(f, tape_std_m=Defaults.TAPE.std)
        tried.append(("tape camera distance and ball plane (± 5 mm)", taped))
    elif f.tape_std_m > TAPE_CLOSER_STD_M:
        closer = replace(f, tape_std_m=TAPE_CLOSER_STD_M)
        tried.append(("tape both distances to ± 2 mm", closer))
    if f.lens is None:
        tried.append(("calibrate the lens with a board", replace(f, lens=board_lens(lens))))
        farther = replace(f, distance_m=1.5 * f.distance_m, view_rad=_zoomed(before))
        tried.append(("from half as far again, zoomed in", farther))
    width, height = f.width * 3 // 2, f.height * 3 // 2
    finer = None if f.lens is None else f.lens.resized(width, height)
    return [
        *tried,
        ("from nearer by a fifth", replace(f, distance_m=0.8 * f.distance_m, view_rad=_view(lens))),
        ("twice the frame rate", replace(f, fps=2 * f.fps, exposure_s=_shutter(f, 2 * f.fps))),
        ("four times the light", replace(f, light=4 * f.light, gray_std=_halved(f.gray_std))),
        ("half the shutter time", replace(f, exposure_s=0.5 * f.exposure_s)),
        ("half as many pixels again each way", replace(f, width=width, height=height, lens=finer)),
    ]


def _view(lens: Lens) -> float:
    """Horizontal angle of view, rad."""
    return 2.0 * math.atan(0.5 * (lens.width - 1) / lens.fx)


def _zoomed(before: Foreseen) -> float:
    """Angle of view that shows as much of the ball plane from half as far again."""
    f = before.filming
    share = (f.distance_m - f.plane_m) / (1.5 * f.distance_m - f.plane_m)
    return 2.0 * math.atan(share * math.tan(0.5 * _view(before.lens)))


def _shutter(filming: Filming, fps: float) -> float:
    return min(filming.exposure_s, 1.0 / fps)


def _halved(value: float | None) -> float | None:
    return None if value is None else 0.5 * value


def _compared(words: str, before: Foreseen, after: Foreseen) -> Change:
    names = [one.name for one in before.quantities]
    old = {name: before.std(name) for name in names}
    new = {name: after.std(name) for name in names}
    both = [name for name in names if old[name] and new[name]]
    logs = [math.log(float(old[n] or 1.0) / float(new[n] or 1.0)) for n in both]
    return Change(
        words,
        after,
        math.exp(float(np.mean(logs))) if logs else 1.0,
        tuple(name for name in names if old[name] is None and new[name] is not None),
        tuple(name for name in names if old[name] is not None and new[name] is None),
    )
