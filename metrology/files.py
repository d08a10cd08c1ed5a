"""Files are written whole or not at all."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from metrology.errors import UsageError

__all__ = ["write_text_whole", "written_whole"]


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; it takes the name `path` only if the block succeeds.

    Parameters
    ----------
    path : Path
        The file wanted at the end. The temporary one keeps its suffix, which encoders look at.

    Yields
    ------
    Path
        Where to write.

    Raises
    ------
    UsageError
        If the folder does not exist or can't be written to.
    """
    try:
        handle, name = tempfile.mkstemp(
            suffix=path.suffix, prefix=f".{path.stem}-", dir=path.parent or Path()
        )
    except OSError as problem:
        raise UsageError(
            f"can't write {path}: {problem.strerror}",
            hint="Name a file in a folder that exists and that you may write to.",
        ) from problem
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        os.chmod(temporary, 0o644)
        try:
            os.replace(temporary, path)
        except OSError as problem:
            raise UsageError(
                f"can't write {path}: {problem.strerror}", hint="Is there a folder of that name?"
            ) from problem
    finally:
        temporary.unlink(missing_ok=True)


def write_text_whole(path: Path, text: str) -> None:
    """Write a text file in one go, UTF-8."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
