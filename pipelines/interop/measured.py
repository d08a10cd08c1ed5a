"""`vision measure --from-tracks` and `vision convert`: foreign tracks."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from measuring.cache import clip_digest
from measuring.chain import (
    FollowedClip,
    MeasureOptions,
    measure_tracks,
    measurement_of,
)
from measuring.inputs import Inputs, gather_inputs
from measuring.measurement import ClipMeasurement, steady_px, tracks_as_frame
from measuring.metres import centre_of_arc
from measuring.setup.file import load_setup
from metrology import MeasurementError, UsageError, write_text_whole, written_whole
from pipelines.interop.external import (
    BALL_NAME,
    FOREIGN,
    PENDULUM_OBJECT,
    ExternalTrack,
    ExternalTracks,
    PlaneOfMotion,
    Program,
    as_track_table,
    is_text,
)
from pipelines.interop.projects import kinovea_annotations, read_kva, read_trk, tracker_project
from pipelines.interop.tables import (
    PROJECT_SUFFIXES,
    TABLE_SUFFIXES,
    ask_columns,
    header_of,
    keep_columns,
    parse_columns,
    read_table_of_tracks,
)
from pipelines.terminal import screen
from vision.clip.clip import ClipReader
from vision.clip.footage import choose_capture_rate
from vision.clip.picture import ClipInfo
from vision.motions.motion import interpret_tracks
from vision.scene import estimate_background
from vision.tracks import Face, MotionKind, PendulumTrack, Rest, Track, Tracks, find_rest
from vision.tracks import FollowedObject as FollowedObject

__all__ = [
    "convert_command",
    "external_of",
    "measure_from_tracks",
    "read_tracks",
    "settled_columns",
    "track_table",
    "write_tracks",
]

_MIN_OBJECT_ROWS = 3
"""Rows: two positions give a velocity, the third tests it."""


def external_of(measured: ClipMeasurement, path: Path, clip: Path | None) -> ExternalTracks:
    """Tracks of a measurement with the scale and axes at the ball's rest position.

    Parameters
    ----------
    measured : ClipMeasurement
    path : Path
        Output path; the clip's path is written relative to it.
    clip : Path or None
    """
    table, info = tracks_as_frame(measured), measured.info
    # other programs show the file's frames: its repeats, and both fields in one
    table["shown"] = info.frames_in_file(table["frame"].to_numpy(np.int64))
    tracks = tuple(
        ExternalTrack(
            name=str(name),
            frame=rows["shown"].to_numpy(np.int64),
            px=rows[["x_px", "y_px"]].to_numpy(float),
            time_s=rows["t_s"].to_numpy(float),
        )
        for name, rows in table.drop_duplicates(["object", "shown"]).groupby("object", sort=False)
    )
    ball = table[table["object"] == "ball"].dropna(subset=["x_m", "y_m"])
    plane = None
    if len(ball) >= _MIN_OBJECT_ROWS:
        plane = _plane(steady_px(ball), ball[["x_m", "y_m"]].to_numpy(float))
    named = None
    if clip is not None:
        named = Path(os.path.relpath(clip.resolve(), path.resolve().parent)).as_posix()
    return ExternalTracks(
        path=path,
        program=Program.IMPACT_VISION,
        tracks=tracks,
        size=info.whole_size,
        fps=measured.rate.fps * info.frames_per_picture,
        plane=plane,
        clip=named,
    )


def _plane(px: np.ndarray, metres: np.ndarray) -> PlaneOfMotion | None:
    """Fit scale and rotation from the ball's pixels to its metres (Umeyama 1991).

    Other programs have one scale and one rotation: perspective and lens distortion are omitted.
    """
    # y of the image points down
    seen = (px - px.mean(axis=0)) * [1.0, -1.0]
    real = metres - metres.mean(axis=0)
    size = float((seen**2).sum())
    if size <= 0.0:
        return None
    along = float((seen * real).sum()) / size
    across = float((seen[:, 0] * real[:, 1] - seen[:, 1] * real[:, 0]).sum()) / size
    per_px = float(np.hypot(along, across))
    if per_px <= 0.0:
        return None
    turn = -float(np.arctan2(across, along))
    plane = PlaneOfMotion(1.0 / per_px, 0.0, np.zeros(2), turn)
    # position of x = y = 0 in metres
    origin = px.mean(axis=0) + plane.pixels(-metres.mean(axis=0)[np.newaxis])[0]
    return PlaneOfMotion(1.0 / per_px, 0.0, origin, turn)


def settled_columns(path: Path, said: Mapping[str, str], setup: Path | None) -> dict[str, str]:
    """Meaning of the columns; ask once on a terminal for those that are unknown.

    Parameters
    ----------
    path : Path
        A table of tracks, or any other file of tracks.
    said : mapping of str to str
    setup : Path or None
        Receives the answers as its table ``[columns]`` if it has none.
    """
    if not path.is_file():
        return dict(said)
    try:
        read_tracks(path, said)
    except UsageError:
        answers = ask_columns(header_of(path), said, path.name)
    else:
        return dict(said)
    if answers != dict(said) and setup is not None:
        if load_setup(setup).columns:
            return answers
        keep_columns(setup, answers)
        screen(errors=True).print(f"saved in the table [columns] of {setup}", soft_wrap=True)
    return answers


def track_table(path: Path, columns: Mapping[str, str]) -> pd.DataFrame:
    """Another program's tracks as rows of `vision measure --tracks`.

    The pendulum's rows get the angle about the centre of their arc, 0 straight down.

    Raises
    ------
    UsageError
        As `read_tracks`.
    """
    table = as_track_table(read_tracks(path, columns).chosen(columns))
    swing = table["object"] == PENDULUM_OBJECT
    if swing.any():
        arm = table.loc[swing, ["x_px", "y_px"]].to_numpy(float)
        arm = arm - centre_of_arc(arm)
        table.loc[swing, "phi_rad"] = np.arctan2(arm[:, 0], arm[:, 1])
    return table


def read_tracks(path: Path, columns: Mapping[str, str] | None = None) -> ExternalTracks:
    """Read tracks of Tracker, Kinovea, trackpy, DeepLabCut, SLEAP, or any table.

    Parameters
    ----------
    path : Path
    columns : mapping of str to str, optional
        Meaning of the columns, and which track is the ball (`columns.parse_columns`).

    Raises
    ------
    UsageError
        If it can't be read, is of an unknown kind, or its columns are ambiguous.
    """
    said = columns or {}
    suffix = path.suffix.lower()
    if not path.exists():
        raise UsageError(f"there is no file {path}", hint="Check the path.")
    if suffix in (".trk", ".trz"):
        return read_trk(path)
    if suffix == ".kva":
        return read_kva(path)
    if suffix in TABLE_SUFFIXES or is_text(path):
        return read_table_of_tracks(path, said)
    kind, cure = FOREIGN.get(suffix, ("a file with an unknown ending", "Export a table of tracks."))
    known = ", ".join((*PROJECT_SUFFIXES, *TABLE_SUFFIXES))
    raise UsageError(f"{path} is {kind}", hint=f"{cure} Known endings: {known}.")


def write_tracks(path: Path, external: ExternalTracks) -> None:
    """Write tracks as Tracker (.trk), Kinovea (.kva), CSV or XLSX, atomically.

    Raises
    ------
    UsageError
        If the ending is none of these.
    """
    suffix = path.suffix.lower()
    if suffix == ".trk":
        write_text_whole(path, tracker_project(external))
    elif suffix == ".kva":
        write_text_whole(path, kinovea_annotations(external))
    elif suffix == ".csv":
        text = as_track_table(external).to_csv(
            index=False, lineterminator="\n", float_format="%.8g"
        )
        write_text_whole(path, text)
    elif suffix == ".xlsx":
        with written_whole(path) as temporary:
            as_track_table(external).to_excel(temporary, index=False)
    else:
        raise UsageError(
            f"{path} has an unknown ending",
            hint="Use .trk, .kva, .csv or .xlsx.",
        )


FloatArray = NDArray[np.float64]

MIN_MARK_STD_PX = 0.1
"""px: limit of template matching and of clicked marks (assumed)."""

CLICKED_MARK_STD_PX = 0.5
"""px: standard uncertainty of a mark in a track too short to estimate it (a careful click)."""

UNSEEN_RADIUS_PX = 10.0
"""px: used if neither the ball's size nor a scale is known; affects only the search for rest."""

_SCENE_FRAMES = 25
"""Number of frames in the median image of the scene (chosen: a moving object covers any point in
fewer than half of them)."""

_RATE_TOLERANCE = 0.01
"""Relative: 59.94 and 60 fps are the same rate, 30 and 29 are not."""

_FRAME_MARGIN_PX = 16
"""px around the tracks, so that the ball is inside the image assumed for them (chosen)."""


@dataclass(frozen=True, eq=False)
class _Filmed:
    """The clip of the tracks, or its replacement if it is not given."""

    info: ClipInfo
    background: NDArray[np.float32]
    clock: FloatArray
    warnings: tuple[str, ...]


_MIN_PLACES = 4
"""Rows of a track (derived: a parabola has three parameters; one more tests it)."""


def measure_from_tracks(
    path: Path,
    options: MeasureOptions | None = None,
    clip: Path | None = None,
    columns: Mapping[str, str] | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> ClipMeasurement:
    """Measure a motion from tracks made by another program.

    Parameters
    ----------
    path : Path
        Tracks of Tracker, Kinovea, trackpy, DeepLabCut, SLEAP, or a table.
    options : MeasureOptions, optional
        Setup and overrides, as for a clip. A scale in them overrides that of the file.
    clip : Path, optional
        The clip that was tracked: provides the wall and the frame times.
    columns : mapping of str to str, optional
        Meaning of the columns, and which track is the ball; overrides the setup's ``[columns]``.
    progress : callable, optional
        Called with the step's name and the fraction completed.

    Raises
    ------
    UsageError
        If the tracks can't be read, or do not belong to the clip.
    MeasurementError
        If there are too few marks.
    """
    options = options or MeasureOptions()
    said = {**options.setup.columns, **(columns or {})}
    external = read_tracks(path, said)
    external = external.chosen(_resting_ball(external) | said)
    if external.tracks[0].name != BALL_NAME:
        raise UsageError(
            f"{path.name} has a pendulum and no ball",
            hint='Pass --columns "ball=NAME" to name the ball.',
        )
    if (rows := len(external.tracks[0].frame)) < _MIN_PLACES:
        raise MeasurementError(
            f"{path.name} has only {rows} rows of positions; a motion needs at least {_MIN_PLACES}",
            hint="Mark the object in more pictures.",
        )
    inputs = gather_inputs(options.setup, options.ball, options.wall_grid)
    if clip is None:
        filmed = _without_clip(external)
    else:
        opened = ClipReader.open(clip, whole=True)
        external = _in_clip(external, opened.info)
        filmed = _of_clip(opened, external)
    camera = options.setup.camera
    rate = choose_capture_rate(
        filmed.info,
        options.fps,
        camera.capture_fps,
        option_std=options.fps_std,
        setup_std=camera.capture_fps_std,
    )
    scale, said_of_scale = _scale(external, options, clip)
    tracks = _tracks(external, filmed, inputs, scale, options.kind)
    followed = FollowedClip(tracks, filmed.clock, rate, inputs, scale)
    found = measure_tracks(followed, progress, options.budget)
    source = f"Tracks from {path.name} ({external.program}); no images were analysed."
    warnings = (*external.notes, *said_of_scale, *filmed.warnings, source)
    return measurement_of(filmed.info, followed, found, warnings)


def _resting_ball(external: ExternalTracks) -> dict[str, str]:
    """Of two bodies that meet, the one at rest until then is the ball; empty if that is unclear."""
    if len(external.tracks) != 2:
        return {}
    rests = [find_rest(one.frame, one.px, UNSEEN_RADIUS_PX) is not None for one in external.tracks]
    return {BALL_NAME: external.tracks[rests.index(True)].name} if sum(rests) == 1 else {}


def _scale(
    external: ExternalTracks, options: MeasureOptions, clip: Path | None
) -> tuple[tuple[float, float] | None, tuple[str, ...]]:
    """Metres per pixel with its std: given, or from the wall, or from the file."""
    if options.scale_m_per_px is not None:
        return options.scale_m_per_px, ()
    walled = options.wall_grid is not None or options.setup.wall.grid is not None
    if external.plane is None or (clip is not None and walled):
        return None, ()
    per_px = 1.0 / external.plane.px_per_m
    std = external.plane.relative_std
    said = (
        f"The scale is that of {external.path.name}, assumed accurate to {100 * std:.1f} %"
        " (a calibration stick may be out of the plane of motion). Pass --scale to set it."
    )
    return (per_px, per_px * std), (said,)


def _in_clip(external: ExternalTracks, info: ClipInfo) -> ExternalTracks:
    """Tracks with the frames of a clip; other programs count those of its file."""
    if external.program is Program.IMPACT_VISION or info.frames_per_picture == 1.0:
        return external
    tracks = []
    for track in external.tracks:
        frame, first = np.unique(info.frames_of_file(track.frame), return_index=True)
        rows = first[frame >= 0]
        given = {name: getattr(track, name) for name in ("time_s", "std_px", "radius_px")}
        kept = {name: None if one is None else one[rows] for name, one in given.items()}
        tracks.append(
            replace(track, frame=frame[frame >= 0], px=track.px[rows], **kept)  # type: ignore[arg-type]
        )
    fps = None if external.fps is None else external.fps / info.frames_per_picture
    return replace(external, tracks=tuple(tracks), fps=fps)


def _of_clip(clip: ClipReader, external: ExternalTracks) -> _Filmed:
    # other programs mark the pixels of the file
    path = clip.info.path
    last = max(int(track.frame.max()) for track in external.tracks)
    size = (clip.info.width, clip.info.height)
    if external.size is not None and external.size != size:
        raise UsageError(
            f"{external.path.name} was made from frames of {external.size[0]} × {external.size[1]}"
            f" px, {path.name} has {size[0]} × {size[1]}",
            hint="Pass the clip that was tracked.",
        )
    step = max(1, clip.info.frames // _SCENE_FRAMES)
    pictures = [frame.gray for frame in clip.frames() if frame.index % step == 0]
    clock = clip.capture_times(1.0)
    if last >= len(clock):
        raise UsageError(
            f"{external.path.name} has a mark in frame {last}; {path.name} has {len(clock)} frames",
            hint="Pass the clip that was tracked; frames count from 0.",
        )
    deep = 1.0 if pictures[0].dtype == np.uint8 else 1.0 / 257.0
    background = estimate_background(pictures, deep).image
    info = clip.info
    said = external.fps
    if said is not None and abs(said / info.container_fps - 1.0) > _RATE_TOLERANCE:
        # a rate other than the file's was entered as the camera's rate
        info = replace(info, capture_fps_metadata=info.capture_fps_metadata or said)
    return _Filmed(info, background, clock, clip.warnings)


def _without_clip(external: ExternalTracks) -> _Filmed:
    """Replacement of the clip: empty frames that contain the tracks, with their times."""
    count = max(int(track.frame.max()) for track in external.tracks) + 1
    low = np.vstack([track.px for track in external.tracks]).max(axis=0) + _FRAME_MARGIN_PX
    width, height = external.size or (max(int(low[0]), 1), max(int(low[1]), 1))
    rate = external.fps
    info = ClipInfo(
        path=external.path,
        sha256=clip_digest(external.path),
        width=width,
        height=height,
        frames=count,
        codec="tracks",
        container_fps=rate or 1.0,
        container_declares_rate=False,
        duration_s=(count - 1) / (rate or 1.0),
        rotation=0,
        weave="progressive",
        bit_depth=8,
        capture_fps_metadata=rate,
        variable_rate=False,
    )
    # at most as many rows as any motion spans: positions outside the image do no harm
    empty = np.zeros((min(height, 8192), min(width, 8192)), dtype=np.float32)
    return _Filmed(info, empty, _clock(external, count), ())


def _clock(external: ExternalTracks, count: int) -> FloatArray:
    """Time of each frame: even, unless the file's times are uneven."""
    clock = np.arange(count, dtype=float)
    if external.program is Program.TRACKER or external.fps is None:
        return clock
    known: dict[int, float] = {}
    for track in external.tracks:
        if track.time_s is not None:
            known |= dict(zip(track.frame.tolist(), track.time_s.tolist(), strict=True))
    if len(known) < 2:
        return clock
    frame = np.array(sorted(known))
    time = np.array([known[int(one)] for one in frame])
    return np.asarray(np.interp(clock, frame, (time - time[0]) * external.fps + frame[0]))


def _tracks(
    external: ExternalTracks,
    filmed: _Filmed,
    inputs: Inputs,
    scale: tuple[float, float] | None,
    given: MotionKind | None,
) -> Tracks:
    radius = UNSEEN_RADIUS_PX
    if scale is not None and inputs.ball is not None:
        radius = 0.5 * inputs.ball.diameter / scale[0]
    named = {track.name: _track(track, radius) for track in external.tracks}
    ball = named.pop(BALL_NAME)
    swing = named.pop(PENDULUM_OBJECT, None)
    others = list(named.values())
    rest = find_rest(ball.frame, ball.centre_px, float(np.median(ball.radius_px)))
    striker = None
    if swing is None and rest is not None and others:
        others.sort(key=lambda other: _nearest(other, rest))
        striker = others[0]
        if not any(track.has_size for track in external.tracks) and inputs.ball is None:
            # bodies that met are as large as their centres came near each other
            size = np.full(len(ball), 0.5 * _nearest(striker, rest))
            ball, striker = (
                replace(ball, radius_px=size),
                replace(striker, radius_px=np.full(len(striker), size[0])),
            )
            others[0] = striker
    pendulum = None if swing is None or rest is None else _pendulum(swing, ball, rest.direction)
    rest_frames = None if rest is None else (rest.first, rest.last)
    motion = interpret_tracks(ball, pendulum, striker, given)
    # an upside-down table is detected from gravity: image axes have no sign here
    motion = replace(motion, fall_px=None)
    return Tracks(
        ball=ball,
        pendulum=pendulum,
        background=filmed.background,
        rest_frames=None if motion.kind is MotionKind.SWING else rest_frames,
        others=tuple(map(FollowedObject, others)),
        motion=motion,
    )


def _nearest(other: Track, rest: Rest) -> float:
    """Smallest distance of another body to a ball at rest, px."""
    near = other.frame <= rest.last + 1
    away = other.centre_px[near] - rest.centre_px if near.any() else np.full((1, 2), np.inf)
    return float(np.hypot(*away.T).min())


def _track(given: ExternalTrack, radius: float) -> Track:
    count = len(given)
    std = _mark_std(given)
    covariance = np.zeros((count, 2, 2))
    covariance[:, [0, 1], [0, 1]] = std**2
    size, size_std = np.full(count, radius), np.inf
    if given.radius_px is not None and given.has_size:
        size, size_std = given.radius_px, 0.1 * radius
    return Track(
        frame=given.frame,
        time_s=given.frame.astype(float),
        centre_px=given.px,
        covariance_px2=covariance,
        bound_px2=covariance,
        radius_px=size,
        radius_std_px=np.full(count, size_std),
        quality=np.ones(count),
    )


def _mark_std(given: ExternalTrack) -> FloatArray:
    """Standard uncertainty of each mark (N, 2), px: as stated, or from its own noise.

    Third differences remove smooth motion; their standard deviation is √20 times that of the marks.
    """
    if given.std_px is not None and np.isfinite(given.std_px).all():
        return np.maximum(given.std_px, MIN_MARK_STD_PX)
    step = np.diff(given.frame)
    steady = step == np.median(step) if len(step) else np.zeros(0, dtype=bool)
    # a third difference needs four consecutive marks; without one the noise is unknown
    whole = steady[:-2] & steady[1:-1] & steady[2:]
    if np.sum(whole) < 4:
        return np.full((len(given), 2), CLICKED_MARK_STD_PX)
    third = np.diff(given.px, n=3, axis=0)
    scatter = 1.4826 * np.median(np.abs(third[whole]), axis=0) / np.sqrt(20.0)
    return np.tile(np.maximum(scatter, MIN_MARK_STD_PX), (len(given), 1))


def _pendulum(mass: Track, ball: Track, forward: FloatArray) -> PendulumTrack | None:
    """The mass on the arc of its marks; the position of its face is unknown.

    Parameters
    ----------
    mass : Track
    ball : Track
    forward : (2,) array
        Direction of the ball after impact.
    """
    if len(mass) < 8:
        return None
    px = mass.centre_px
    pivot = centre_of_arc(px)
    reach_px = np.hypot(*(px - pivot).T)
    arm = float(np.median(reach_px))
    # radial standard deviation of the marks, over the arc that they span
    turned = np.ptp(np.arctan2(*(px - pivot).T))
    spread = (float(np.std(reach_px - arm)) / max(1.0 - np.cos(0.5 * turned), 1e-3)) ** 2
    side = 1.0 if forward[0] >= 0.0 else -1.0
    angle = np.arctan2(side * (px[:, 0] - pivot[0]), px[:, 1] - pivot[1])
    std = np.sqrt(mass.covariance_px2[:, 0, 0]) / arm
    touching = int(np.argmin(np.hypot(*(px - np.median(ball.centre_px[:3], axis=0)).T)))
    # the face is between mark and ball: half of that distance ± all of it
    gap = np.median(ball.centre_px[:3], axis=0) - px[touching]
    reach = max(float(np.hypot(*gap)), 1.0)
    face = Face(int(mass.frame[touching]), px[touching] + 0.5 * gap, reach)
    return PendulumTrack(
        replace(mass, radius_px=np.full(len(mass), 0.5 * reach)),
        angle,
        std,
        pivot,
        spread / len(px) * np.eye(2),
        arm,
        face,
    )


_LENS_SUFFIXES = (".toml", ".yaml", ".yml")


def convert_command(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Tracks, or a lens file.")],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="File to write.")],
    columns: Annotated[
        str | None, typer.Option(help="Column map: 't=Time (s), x=X (cm), y=Y (cm), ball=A'.")
    ] = None,
) -> None:
    """Convert tracks or a lens between programs.

    Tracks are read from Tracker (.trk, .trz, text), Kinovea (.kva, text), trackpy, DeepLabCut,
    SLEAP or a table, and written as .trk, .kva, .csv or .xlsx; lenses from and to TOML and the
    YAML of OpenCV and ROS. Example: vision convert clip.trk clip.kva
    """
    if target.exists() and target.resolve() == source.resolve():
        raise UsageError(f"{target} would overwrite the input", hint="Choose another name.")
    if source.suffix.lower() in _LENS_SUFFIXES:
        _lens(source, target)
        return
    said = parse_columns(columns)
    external = read_tracks(source, said)
    if said:
        external = external.chosen(said)
    write_tracks(target, external)
    for note in external.notes:
        screen(errors=True).print(f"warning: {note}", soft_wrap=True)
    listed = ", ".join(f"{track.name} ({len(track)} marks)" for track in external.tracks)
    screen().print(f"{target}: {listed}, from {external.program}", soft_wrap=True)


def _lens(source: Path, target: Path) -> None:
    from calib.lens import YAML_SUFFIXES, lens_yaml, prior_toml, read_lens

    prior = read_lens(source)
    suffix = target.suffix.lower()
    if suffix not in _LENS_SUFFIXES:
        raise UsageError(
            f"{target} has an unknown ending; lens files end in {', '.join(_LENS_SUFFIXES)}",
            hint=f"Run for example vision convert {source} lens.yaml",
        )
    text = lens_yaml(prior, target.stem) if suffix in YAML_SUFFIXES else prior_toml(prior)
    write_text_whole(target, text)
    screen().print(f"{target}: focal length {prior.lens.fx:.1f} px", soft_wrap=True)
