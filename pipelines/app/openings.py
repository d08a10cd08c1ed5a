"""Clips to open: recent ones, samples, dropped files."""

import filecmp
import json
import shutil
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from metrology import ImpactVisionError, UsageError, write_text_whole
from pipelines.app.corrections import ClipInputs, Corrections, corrections_file, write_corrections

__all__ = [
    "Recent",
    "Sample",
    "file_name",
    "free_place",
    "kept_once",
    "place_from",
    "placed_sample",
    "samples",
]

MAX_RECENT = 8
"""Clips remembered (chosen: as many as fit on a screen)."""

_LESSON = ClipInputs(ball="201.75mm", wall_grid="50mm")


@dataclass(frozen=True)
class Sample:
    """A clip that comes with the program.

    Attributes
    ----------
    kind : str
        "strike", "drop" or "swing".
    """

    kind: str
    path: Path
    inputs: ClipInputs


def samples() -> tuple[Sample, ...]:
    """The samples that are installed."""
    clips = Path(str(files("sample_videos"))) / "clips"
    lessons = clips.parent.parent / "docs" / "lessons"
    named = (
        ("strike", "basketball_60.mp4", ClipInputs(setup="basketball_60.toml")),
        ("drop", "drop.mp4", ClipInputs("240", _LESSON.ball, _LESSON.wall_grid)),
        ("swing", "swing.mp4", ClipInputs("60", _LESSON.ball, _LESSON.wall_grid)),
    )
    found = []
    for kind, name, inputs in named:
        # a source tree keeps the lessons' clips with their pages
        place = next((one for one in (clips / name, lessons / name) if one.is_file()), None)
        if place is not None:
            found.append(Sample(kind, place, inputs))
    return tuple(found)


def placed_sample(sample: Sample, folder: Path) -> Path:
    """Copy a sample and its inputs where files may be written; return the copy.

    Raises
    ------
    UsageError
        If the folder can't be written to.
    """
    target = folder / sample.path.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for one in (sample.path, sample.path.with_suffix(".toml")):
            if one.is_file() and not (folder / one.name).exists():
                shutil.copyfile(one, folder / one.name)
    except OSError as problem:
        raise UsageError(
            f"can't copy the sample to {folder}: {problem.strerror}",
            hint="Start vision app in a folder that you may write to.",
        ) from problem
    if not corrections_file(target).exists():
        write_corrections(corrections_file(target), Corrections(sample.inputs))
    return target


def place_from(text: str) -> Path:
    """Clip or folder that a person typed.

    Raises
    ------
    UsageError
        If there is none.
    """
    # a path copied from a file manager may be in quotes
    path = Path(text.strip().strip("\"'")).expanduser()
    if not text.strip() or not path.exists():
        raise UsageError(
            f"there is no file {path}" if text.strip() else "no clip is named",
            hint="Type the path of a clip or a folder, or drop a clip.",
        )
    return path.absolute()


def file_name(name: str) -> str:
    """Plain name of a dropped file; folders in it are omitted.

    Raises
    ------
    UsageError
        If nothing is left.
    """
    plain = name.replace("\\", "/").rpartition("/")[2].replace("\0", "").lstrip(".")
    if not plain:
        raise UsageError(f"the file has no name: {name!r}", hint="Rename it and drop it again.")
    return plain


def free_place(folder: Path, name: str) -> Path:
    """Path of a new file in a folder; a number distinguishes it from others of its name."""
    plain = Path(file_name(name))
    for number in range(1, 10_000):
        path = folder / (plain.name if number == 1 else f"{plain.stem}-{number}{plain.suffix}")
        if not path.exists():
            return path
    raise UsageError(f"{folder} is full of {plain}", hint="Remove some of these files.")


def kept_once(copy: Path, name: str) -> Path:
    """The file of that name next to a new copy if it holds the same; else the copy.

    A clip that is dropped again has its corrections beside it.
    """
    earlier = copy.with_name(Path(file_name(name)).name)
    if earlier == copy or not filecmp.cmp(copy, earlier, shallow=False):
        return copy
    copy.unlink()
    return earlier


class Recent:
    """Clips and folders opened last, in a file of the user; a damaged file counts as empty.

    Parameters
    ----------
    file : Path, optional
        Default: in the user's state folder.
    """

    def __init__(self, file: Path | None = None) -> None:
        if file is None:
            from platformdirs import user_state_path

            file = user_state_path("impact-vision", appauthor=False) / "recent.json"
        self._file = file

    def places(self) -> tuple[Path, ...]:
        """Those that still exist, the last first."""
        try:
            held = json.loads(self._file.read_text(encoding="utf-8"))
            paths = [Path(one) for one in held if isinstance(one, str)]
            return tuple(path for path in paths if path.exists())[:MAX_RECENT]
        except (OSError, ValueError, TypeError):
            return ()

    def add(self, place: Path) -> None:
        """Remember a place; nothing happens where nothing can be written."""
        kept = [place, *(one for one in self.places() if one != place)][:MAX_RECENT]
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_text_whole(self._file, json.dumps([str(one) for one in kept]))
        except (OSError, ImpactVisionError):
            return
