"""The door to compiled loops: numba, kept on disk, free of the interpreter's lock.

A module with compiled loops costs a quarter of a second to import, so it is imported where its
loops are run. A loop is compiled at its first use after an install and read from disk from then on.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

__all__ = ["compiled"]

Function = TypeVar("Function", bound=Callable[..., object])

# Sums may be taken in any order and multiplications joined; NaN stays NaN, so that a comparison
# with it is false and nothing is read outside a picture.
_MATH = {"reassoc", "contract", "arcp", "nsz", "afn"}


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays; where nothing can be kept on disk, every time."""
    options: dict[str, Any] = {"nogil": True, "fastmath": _MATH}
    try:
        made = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no folder to keep it in
        made = numba.njit(**options)(function)
    return cast(Function, made)
