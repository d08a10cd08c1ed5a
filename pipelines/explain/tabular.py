"""Tables in: a CSV file or a DataFrame, and what it is called in messages."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from metrology import UsageError

__all__ = ["TableLike", "name_of", "read_table"]

TableLike = Path | pd.DataFrame


def name_of(source: TableLike) -> str:
    """What to call the table in a message."""
    return source.name if isinstance(source, Path) else "the table"


def read_table(source: TableLike, dtype: Mapping[str, type] | None = None) -> pd.DataFrame:
    """Read a table; names of columns are stripped, a DataFrame is left as it was.

    Parameters
    ----------
    source : Path or DataFrame
    dtype : mapping, optional
        Columns that are words, whatever they look like.

    Raises
    ------
    UsageError
        If the file can't be read.
    """
    words = dict(dtype or {})
    if isinstance(source, Path):
        try:
            table = pd.read_csv(source, dtype=words, skipinitialspace=True)
        except (OSError, UnicodeDecodeError, ValueError) as problem:
            raise UsageError(
                f"can't read {source}: {problem}",
                hint="A CSV file with a header line is expected.",
            ) from problem
    else:
        table = source.copy()
    table.columns = [str(name).strip() for name in table.columns]
    for name in words:
        if name in table:
            known = table[name].notna()
            table[name] = table[name].astype(object).where(~known, table[name].astype(str))
    return table
