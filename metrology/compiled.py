"""The door to compiled loops: numba, kept on disk, free of the interpreter's lock.

Loading the compiler takes a quarter of a second, so it is loaded when the first loop runs. A loop
is compiled at its first use after an install and read from disk from then on.
"""

from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any, TypeVar, cast

__all__ = ["compiled"]

Function = TypeVar("Function", bound=Callable[..., object])

# Sums may be taken in any order and multiplications joined; NaN stays NaN, so that a comparison
# with it is false and nothing is read outside a picture.
_MATH = {"reassoc", "contract", "arcp", "nsz", "afn"}


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays when it is first called.

    It may call other compiled ones. Where nothing can be kept on disk it is compiled every time.
    """
    return cast(Function, _Compiled(function))


class _Compiled:
    """Stands for a function until it is called, or met in another one that is compiled."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._function = function
        update_wrapper(self, function)

    @cached_property
    def _made(self) -> Any:
        import numba

        options: dict[str, Any] = {"nogil": True, "fastmath": _MATH, "error_model": "numpy"}
        try:
            return numba.njit(cache=True, **options)(self._function)
        except RuntimeError:  # no folder to keep it in
            return numba.njit(**options)(self._function)

    @property
    def _numba_type_(self) -> Any:
        """What the compiler asks of a value that it meets in another function."""
        return self._made._numba_type_

    def __call__(self, *values: Any) -> Any:
        return self._made(*values)
