"""A command evaluates what it prints, with the numbers that measuring everything gives."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.grid import WallGrid
from calib.solve import planned_grid
from measuring import metres
from measuring.budget import DERIVED, derived_values
from measuring.chain import (
    FittedClip,
    FollowedClip,
    fit_tracks,
    measurement_of,
    quantities_of,
)
from measuring.flight_fit import FlightFit
from measuring.inputs import gather_inputs
from measuring.results import NOT_ASKED, needed
from metrology import Quantity
from pipelines.calibrate.plan import Filming, film_scene, planned_setup, planned_tracks
from pipelines.measure.commands import CONTACT, COR, LANDING, LAUNCH
from vision.clip.footage import CaptureRate, RateSource
from vision.clip.picture import ClipInfo
from vision.tracks import Motion, MotionKind

FILMING = Filming(width=432, height=240, tape_std_m=0.005, fps=300.0)
GROUPS = {"contact-time": CONTACT, "launch": LAUNCH, "landing": LANDING, "cor": COR}


@pytest.fixture(scope="module")
def fitted() -> Iterator[FittedClip]:
    """A stroke as it would be filmed, followed and fitted."""
    scene, shot = film_scene(FILMING)
    grid = planned_grid(scene.camera)

    def seen(*_: object, **__: object) -> WallGrid:
        return grid

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(metres, "find_wall_grid", seen)
        tracks = planned_tracks(FILMING, scene, shot)
        tracks = replace(tracks, motion=Motion(MotionKind.STRIKE, 0.9))
        inputs = gather_inputs(planned_setup(FILMING, scene), None, None)
        rate = CaptureRate(FILMING.fps, 0.01, RateSource.OPTION)
        clock = np.arange(scene.frames, dtype=float)
        yield fit_tracks(FollowedClip(tracks, clock, rate, inputs))


@pytest.fixture(scope="module")
def whole(fitted: FittedClip) -> dict[str, Quantity]:
    return {one.name: one for one in quantities_of(fitted).results.quantities}


@pytest.mark.parametrize("command", GROUPS)
def test_what_is_asked_for_is_told_as_by_measuring_all(
    command: str, fitted: FittedClip, whole: dict[str, Quantity]
) -> None:
    asked = GROUPS[command]
    found = quantities_of(fitted, wanted=asked).results.quantities
    assert [one.name for one in found] == list(whole)
    for one in found:
        if one.name in asked:
            assert one == whole[one.name]
            assert one.known
        else:
            assert one.reason == NOT_ASKED


def test_only_what_is_asked_for_is_worked_out(
    fitted: FittedClip, monkeypatch: pytest.MonkeyPatch
) -> None:
    impact, inputs = fitted.impact, fitted.scene.inputs
    assert impact is not None
    flown: list[float] = []
    falls_to = FlightFit.falls_to

    def counted(self: FlightFit, *args: object) -> float | None:
        flown.append(1.0)
        return falls_to(self, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(FlightFit, "falls_to", counted)
    marches = {}
    for command, asked in GROUPS.items():
        flown.clear()
        names = needed(asked)
        values = dict(zip(DERIVED, derived_values(impact, inputs, names), strict=True))
        marches[command] = len(flown)
        assert {name for name, value in values.items() if np.isfinite(value)} == names
    assert marches["contact-time"] == marches["launch"] == 0
    assert marches["landing"] == 1
    assert marches["cor"] > 2


@pytest.mark.parametrize(("probability", "warned"), [(0.7, True), (0.97, False)])
def test_a_kind_of_motion_in_doubt_is_told_with_the_numbers(
    fitted: FittedClip, probability: float, warned: bool
) -> None:
    info = ClipInfo(
        Path("a.mp4"), "0", 432, 240, 9, "h264", 30.0, True, 0.3, 0, "progressive", 8, None, False
    )
    tracks = replace(fitted.followed.tracks, motion=Motion(MotionKind.STRIKE, probability))
    followed = replace(fitted.followed, tracks=tracks)
    measured = measurement_of(info, followed, quantities_of(fitted))
    assert any("probability of only 0.70" in one for one in measured.warnings) is warned
