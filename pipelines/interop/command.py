"""`vision convert`: tracks and lens files from one program to another."""

from pathlib import Path
from typing import Annotated

import typer

from metrology import UsageError, write_text_whole
from pipelines.terminal import screen

__all__ = ["convert_command"]

_LENS_SUFFIXES = (".toml", ".yaml", ".yml")


def convert_command(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Tracks, or a lens file.")],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="What to write.")],
    columns: Annotated[
        str | None, typer.Option(help="Of a table: 't=Time (s), x=X (cm), y=Y (cm), ball=A'.")
    ] = None,
) -> None:
    """Turn tracks or a lens of one program into those of another.

    Tracks are read from Tracker (.trk, .trz, text), Kinovea (.kva, text), trackpy, DeepLabCut,
    SLEAP or a table, and written as .trk, .kva, .csv or .xlsx; lenses from and to TOML and the
    YAML of OpenCV and ROS. Example: vision convert clip.trk clip.kva
    """
    if target.exists() and target.resolve() == source.resolve():
        raise UsageError(f"{target} would overwrite what is read", hint="Give it another name.")
    if source.suffix.lower() in _LENS_SUFFIXES:
        _lens(source, target)
        return
    from pipelines.interop.measured import read_tracks, write_tracks
    from pipelines.interop.tables import parse_columns

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
            f"{target}: a lens file ends in {', '.join(_LENS_SUFFIXES)}",
            hint=f"vision convert {source} lens.yaml",
        )
    text = lens_yaml(prior, target.stem) if suffix in YAML_SUFFIXES else prior_toml(prior)
    write_text_whole(target, text)
    screen().print(f"{target}: focal length {prior.lens.fx:.1f} px", soft_wrap=True)
