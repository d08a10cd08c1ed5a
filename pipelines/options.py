"""Options that several commands take, each declared once: what it is called, and what it says."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.doors import FileRole

__all__ = [
    "BallAtOption",
    "BallOption",
    "ClipArgument",
    "ClipsOrNoneArgument",
    "ColumnsOption",
    "CorLawOption",
    "CorOption",
    "CsvOption",
    "DragOption",
    "EffectOption",
    "FpsOption",
    "FromTracksOption",
    "GridOption",
    "JobsOption",
    "JsonOption",
    "MassAtOption",
    "NamedBallOption",
    "NoCacheOption",
    "NoTableOption",
    "OutOption",
    "OverlayOption",
    "PlotOption",
    "QuietOption",
    "ReportOption",
    "ResultsCsvOption",
    "ResultsJsonOption",
    "ScaleOption",
    "SetupFileOption",
    "SetupOption",
    "TracksOption",
]

ClipArgument = Annotated[Path, typer.Argument(metavar="CLIP", help="Video or folder of pictures.")]
ClipsOrNoneArgument = Annotated[
    list[Path] | None, typer.Argument(metavar="CLIP...", help="Videos to measure.")
]
SetupOption = Annotated[Path | None, typer.Option("--setup", help="What the lab knows (TOML).")]
FpsOption = Annotated[str | None, typer.Option("--fps", help="Capture rate, such as 600.")]
BallOption = Annotated[
    str | None, typer.Option("--ball", help="jokku, basketball, or a diameter such as 220mm.")
]
GridOption = Annotated[
    str | None, typer.Option("--wall-grid", help="Side of the wall's squares, such as 50mm.")
]
ScaleOption = Annotated[
    str | None,
    typer.Option("--scale", help="In the plane of motion: '2.44 mm/px', '410 px/m ± 2 px/m'."),
]
BallAtOption = Annotated[
    str | None, typer.Option("--ball-at", metavar="X,Y[,FRAME]", help="A point on the ball, px.")
]
MassAtOption = Annotated[
    str | None, typer.Option("--mass-at", metavar="X,Y[,FRAME]", help="A point on the mass, px.")
]
CsvOption = Annotated[
    Path | None, typer.Option("--csv", help="Write results as CSV."), FileRole.WRITES
]
JsonOption = Annotated[
    str | None, typer.Option("--json", help="Write JSON; - for stdout."), FileRole.WRITES
]
TracksOption = Annotated[
    Path | None, typer.Option("--tracks", help="Write the tracks as CSV."), FileRole.WRITES
]
OverlayOption = Annotated[
    Path | None, typer.Option("--overlay", help="Write an overlay video."), FileRole.WRITES
]
PlotOption = Annotated[
    Path | None, typer.Option("--plot", help="Write plots (.png or .svg)."), FileRole.WRITES
]
ReportOption = Annotated[
    Path | None,
    typer.Option("--report", help="Write a one-page HTML report; prints the budgets, too."),
    FileRole.WRITES,
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Several clips: a folder for results.csv and files."),
]
JobsOption = Annotated[
    int | None, typer.Option("-j", min=1, help="With --out: processes; default one a core.")
]
FromTracksOption = Annotated[
    Path | None,
    typer.Option("--from-tracks", help="Tracks of another program instead of following the clip."),
]
ColumnsOption = Annotated[
    str | None,
    typer.Option("--columns", help="Of such a table: 't=Time (s), x=X (cm), y=Y (cm), ball=A'."),
]
NoCacheOption = Annotated[
    bool, typer.Option("--no-cache", help="Measure afresh, whatever was measured before.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No table, no warnings.")]
ResultsJsonOption = Annotated[
    str | None,
    typer.Option("--json", help="Results as JSON; - for stdout.", metavar="FILE"),
    FileRole.WRITES,
]
ResultsCsvOption = Annotated[
    Path | None, typer.Option("--csv", help="Results as CSV, one row."), FileRole.WRITES
]
SetupFileOption = Annotated[Path | None, typer.Option("--setup", help="Setup file (TOML).")]
NamedBallOption = Annotated[
    str | None,
    typer.Option("--ball", help="A preset, or a ball of the setup file.", metavar="NAME"),
]
CorOption = Annotated[
    str,
    typer.Option("--cor", help="variable, constant, a number, or a law in v (m/s).", metavar="LAW"),
]
CorLawOption = Annotated[
    Path | None,
    typer.Option("--cor-law", help="Laws of restitution of a campaign (cor.toml).", metavar="FILE"),
]
DragOption = Annotated[
    str | None,
    typer.Option(
        "--drag", help="Drag coefficient, or a curve: smooth, soccer, basketball.", metavar="C"
    ),
]
EffectOption = Annotated[
    list[str] | None,
    typer.Option(
        "--effect", help="Add an effect of the catalogue: magnus:spin=10.", metavar="ID:NAME=X"
    ),
]
NoTableOption = Annotated[bool, typer.Option("--quiet", help="No table, no warnings.")]
