"""What makes loops quick: a compiler behind a door, and work shared out to the processor's cores.

Compiled loops are numba's, kept on disk, free of the interpreter's lock. Loading the compiler takes
a quarter of a second, so it is loaded when the first loop runs. A loop is compiled at its first use
after an install and read from disk from then on. What that first use costs is kept low: a loop that
only others call is compiled as a part of them, without a way in from Python, once for each type of
its arguments; and code is optimised as far as makes it run faster, which for loops over some tens
of pixels is not far.

Arithmetic is IEEE's, in the order that is written: sums in any order and joined multiplications are
no faster here, and code just compiled rounded otherwise than the same code read from disk, so that
a clip's second measuring could follow another piece than its first.
"""

import gc
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, cached_property, update_wrapper
from itertools import chain, islice
from threading import RLock
from types import FunctionType
from typing import Any, TypeVar, cast

__all__ = [
    "compiled",
    "side_by_side",
    "with_room",
]

Function = TypeVar("Function", bound=Callable[..., object])

_OPTIMISED = 1
"""Of the compiler's levels 0 to 3: a third of what compiling costs at 3, and as fast (measured)."""

_ROOM = 33_000
"""Words of 8 bytes: just more than 256 KB, so that 512 KB are taken and half of them are left."""

_COMPILING = RLock()


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays when it is first called.

    It may call other compiled ones. Where nothing can be kept on disk it is compiled every time.
    """
    return cast(Function, _Compiled(function))


def with_room(function: Function) -> Function:
    """Let a function take room for the calls below it at once.

    Python before 3.13 holds calls in pieces of 16 KB that it fetches and gives back one by one
    (python/cpython issue 142183). Where the end of one falls into a loop that is deep down, every
    turn asks the system for memory: half a million times while one clip's loops are compiled.
    """
    plain = cast(FunctionType, function)
    plain.__code__ = plain.__code__.replace(co_stacksize=_ROOM)
    return function


@cache
def _compiler() -> Any:
    # the compiler colours the messages of what it tries in vain, which nobody reads
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    import numba

    return numba


class _Compiled:
    """Stands for a function until it is called, or met in another one that is compiled."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._function = function
        self._ready = False
        update_wrapper(self, function)

    @cached_property
    def _made(self) -> Any:
        numba = _compiler()
        options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
        try:
            return numba.njit(cache=True, **options)(self._function)
        except RuntimeError:  # no folder to keep it in
            return numba.njit(**options)(self._function)

    @cached_property
    def _part(self) -> Any:
        """The same to be called by other compiled functions alone."""
        numba = _compiler()
        options: dict[str, Any] = {"error_model": "numpy"}
        options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        part: Any = numba.njit(**options)(self._function)
        plain: Any = numba.types.unliteral
        compiled_for = part.get_call_template

        def of_any_value(types: tuple[Any, ...], keywords: Any) -> Any:
            # a constant among the arguments is no type of its own
            return compiled_for(tuple(plain(one) for one in types), keywords)

        part.get_call_template = of_any_value
        return part

    @property
    def _numba_type_(self) -> Any:
        """What the compiler asks of a value that it meets in another function."""
        return self._part._numba_type_

    def __call__(self, *values: Any) -> Any:
        if self._ready:
            return self._made(*values)
        return self._called_first(*values)

    @with_room
    def _called_first(self, *values: Any) -> Any:
        with _COMPILING, _lightly_optimised():
            result = self._made(*values)
        self._ready = True
        return result


@contextmanager
def _lightly_optimised() -> Iterator[None]:
    config = _compiler().config
    level, vectors, collecting = config.OPT, config.LOOP_VECTORIZE, gc.isenabled()
    config.OPT, config.LOOP_VECTORIZE = type(level)(_OPTIMISED), 0
    # the compiler makes millions of small objects that all stay: looking for waste takes 6 %
    gc.disable()
    try:
        yield
    finally:
        config.OPT, config.LOOP_VECTORIZE = level, vectors
        # nor are they looked through later
        gc.freeze()
        if collecting:
            gc.enable()


Item = TypeVar("Item")
Result = TypeVar("Result")

_MOST_WORKERS = 4
"""Processes at most: a clip gives no work to more."""
_AHEAD = 2


def side_by_side(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Do the same work on many things, a few at a time.

    Parameters
    ----------
    work : callable
        What to do with one of them; it must not change what the others use.
    items : iterable
        The things; only as many are taken ahead as keep the workers busy.

    Yields
    ------
    Result
        In the order of the items.
    """
    count = min(_MOST_WORKERS, os.cpu_count() or 1)
    every = iter(items)
    first = list(islice(every, 2))
    if count == 1 or len(first) < 2:
        # one thing alone keeps nobody else busy
        yield from map(work, chain(first, every))
        return
    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(count) as pool:
        for item in chain(first, every):
            waiting.append(pool.submit(work, item))
            if len(waiting) > count * _AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
