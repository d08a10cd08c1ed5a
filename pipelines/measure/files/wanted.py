"""Where the results of a measuring command go; checked before minutes of work, not after."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from metrology import UsageError, write_text_whole
from pipelines.measure.files.output import measurement_as_json, measurements_as_csv
from pipelines.measure.measurement import Measurement
from vision.clip.clip import Clip
from vision.overlay import OVERLAY_SUFFIXES

__all__ = ["Wanted"]

_PLOT_SUFFIXES = (".png", ".svg")


@dataclass(frozen=True)
class Wanted:
    """The files asked for; `json` may be "-" for stdout."""

    csv: Path | None = None
    json: str | None = None
    tracks: Path | None = None
    overlay: Path | None = None
    plot: Path | None = None
    report: Path | None = None
    quiet: bool = False

    def _files(self) -> dict[str, Path]:
        named = {
            "--csv": self.csv,
            "--json": None if self.json in (None, "-") else Path(str(self.json)),
            "--tracks": self.tracks,
            "--overlay": self.overlay,
            "--plot": self.plot,
            "--report": self.report,
        }
        return {option: path for option, path in named.items() if path is not None}

    def require_writable(self, inputs: Sequence[Path | None]) -> None:
        """Refuse what could not be written at the end, or would overwrite what is measured.

        Parameters
        ----------
        inputs : sequence of Path or None
            Clips and setup file.

        Raises
        ------
        UsageError
        """
        files = self._files()
        kept = {path.resolve() for path in inputs if path is not None}
        for option, path in files.items():
            if path.is_dir() or not path.parent.is_dir():
                wrong = "that is a folder" if path.is_dir() else f"no folder {path.parent}"
                raise UsageError(
                    f"{option} {path}: {wrong}", hint="Name a file in a folder that exists."
                )
            if path.resolve() in kept:
                raise UsageError(
                    f"{option} {path} would overwrite what is to be measured",
                    hint="Give the result another name.",
                )
            if sum(path.resolve() == other.resolve() for other in files.values()) > 1:
                raise UsageError(f"two results are to be written to {path}")
        for kinds, given in (("--overlay", OVERLAY_SUFFIXES), ("--plot", _PLOT_SUFFIXES)):
            if kinds in files and files[kinds].suffix.lower() not in given:
                raise UsageError(
                    f"{kinds} {files[kinds]}: its name does not say what kind of file it is",
                    hint=f"Name a file that ends in {', '.join(given)}.",
                )

    def write(self, measured: Measurement, clip: Path, names: Sequence[str]) -> None:
        """Write all files; each is written whole or not at all.

        Raises
        ------
        UsageError
            If one can't be written.
        """
        # each of these imports what takes longer to load than a clip to measure again
        files = self._files()
        if self.csv is not None:
            write_text_whole(self.csv, measurements_as_csv([measured], names))
        if "--json" in files:
            write_text_whole(files["--json"], measurement_as_json(measured, names) + "\n")
        if self.tracks is not None:
            from pipelines.measure.files.tracks import tracks_as_csv

            write_text_whole(self.tracks, tracks_as_csv(measured))
        if self.overlay is not None:
            from pipelines.measure.files.pictures import overlay_marks
            from vision.overlay.overlay import write_overlay

            write_overlay(self.overlay, Clip.open(clip), measured.tracks, overlay_marks(measured))
        if self.plot is not None:
            from pipelines.measure.files.pictures import report_input
            from pipelines.report.plots import write_plot

            write_plot(self.plot, report_input(measured, None))
        if self.report is not None:
            from pipelines.measure.files.pictures import report_input
            from pipelines.report.page import write_report

            write_report(self.report, report_input(measured, Clip.open(clip)))
