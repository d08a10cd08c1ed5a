"""Fast loops: compile functions with numba at first use; map work over threads.

Compiled loops are cached on disk and release the interpreter lock. Importing numba takes a quarter
of a second, so it is imported when the first loop runs. To keep first use cheap, a loop called only
by compiled ones is compiled into them without a Python wrapper, once for each type of its
arguments, and the optimisation level is the lowest that gives full speed for loops over some tens
of pixels.

Arithmetic follows IEEE in source order: reordered sums and fused multiplications are no faster here
and code just compiled would round differently from the same code read from disk, so that repeated
measurements of a clip could differ.
"""

import gc
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache, cached_property, update_wrapper
from itertools import chain, islice
from threading import RLock
from types import FunctionType
from typing import Any, TypeVar, cast

__all__ = [
    "compiled",
    "map_in_threads",
    "with_stack_space",
]

Function = TypeVar("Function", bound=Callable[..., object])

_OPTIMISATION_LEVEL = 1
"""LLVM optimisation level (measured): a third of the compile time of level 3, equally fast code."""

_STACK_WORDS = 33_000
"""Stack size, words of 8 bytes (derived): just over 256 KB, so that Python allocates 512 KB and
half of it remains free."""

_COMPILE_LOCK = RLock()


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays at its first call.

    It may call other compiled ones. Without a writable cache folder it is compiled in every
    process.
    """
    return cast(Function, _Compiled(function))


def with_stack_space(function: Function) -> Function:
    """Make a function allocate stack space for the calls below it at once.

    Python before 3.13 allocates frames in blocks of 16 KB (python/cpython issue 142183). Where the
    end of a block falls into a deeply nested loop, every iteration allocates and frees memory: half
    a million times while the loops for one clip are compiled.
    """
    plain = cast(FunctionType, function)
    plain.__code__ = plain.__code__.replace(co_stacksize=_STACK_WORDS)
    return function


@cache
def _compiler() -> Any:
    # Coloured error messages of failed attempts cost time, and nobody reads them.
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    import numba

    return numba


def _cache_of(function: Callable[..., object]) -> Any:
    """Numba's cache of a function, without what only compiling needs.

    Its own loads the rules of every type first, which takes longer than all loops of a clip. What
    it calls is private to numba: where a version has it no more, numba's own way is taken.
    """
    from numba.core.caching import FunctionCache
    from numba.core.runtime.nrt import rtsys

    class Cached(FunctionCache):
        def load_overload(self, signature: Any, context: Any) -> Any:
            try:
                rtsys.initialize(context)
                with self._guard_against_spurious_io_errors():
                    return self._load_overload(signature, context)  # type: ignore[no-untyped-call]
            except (AttributeError, TypeError):
                return super().load_overload(signature, context)  # type: ignore[no-untyped-call]

    return Cached(function)  # type: ignore[no-untyped-call]


class _Compiled:
    """Proxy of a function until it is called, or used by another compiled one."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._function = function
        self._ready = False
        update_wrapper(self, function)

    @cached_property
    def _made(self) -> Any:
        made = _compiler().njit(nogil=True, error_model="numpy")(self._function)
        # no writable cache folder
        with suppress(RuntimeError):
            made._cache = _cache_of(self._function)
        return made

    @cached_property
    def _part(self) -> Any:
        """The same for calls from compiled functions only."""
        numba = _compiler()
        options: dict[str, Any] = {"error_model": "numpy"}
        options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        part: Any = numba.njit(**options)(self._function)
        plain: Any = numba.types.unliteral
        compiled_for = part.get_call_template

        def of_any_value(types: tuple[Any, ...], keywords: Any) -> Any:
            # A constant argument is not a type of its own.
            return compiled_for(tuple(plain(one) for one in types), keywords)

        part.get_call_template = of_any_value
        return part

    @property
    def _numba_type_(self) -> Any:
        """Type that numba requests for a value used in another function."""
        return self._part._numba_type_

    def __call__(self, *values: Any) -> Any:
        if self._ready:
            return self._made(*values)
        return self._called_first(*values)

    @with_stack_space
    def _called_first(self, *values: Any) -> Any:
        with _COMPILE_LOCK, _lightly_optimised():
            result = self._made(*values)
        self._ready = True
        return result


@contextmanager
def _lightly_optimised() -> Iterator[None]:
    config = _compiler().config
    level, vectors, collecting = config.OPT, config.LOOP_VECTORIZE, gc.isenabled()
    config.OPT, config.LOOP_VECTORIZE = type(level)(_OPTIMISATION_LEVEL), 0
    # The compiler allocates millions of small objects that all stay: garbage collection takes 6 %.
    gc.disable()
    try:
        yield
    finally:
        config.OPT, config.LOOP_VECTORIZE = level, vectors
        # Exclude them from later collections, too.
        gc.freeze()
        if collecting:
            gc.enable()


Item = TypeVar("Item")
Result = TypeVar("Result")

_MAX_THREADS = 4
"""Maximum number of threads (chosen): a clip does not keep more busy."""
_QUEUED_PER_THREAD = 2
"""Items queued per thread (chosen)."""


def map_in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Apply a function to many items in parallel threads.

    Parameters
    ----------
    work : callable
        The function; it must not modify shared data.
    items : iterable
        The items; consumed only as far ahead as keeps the threads busy.

    Yields
    ------
    Result
        In the order of the items.
    """
    count = min(_MAX_THREADS, os.cpu_count() or 1)
    every = iter(items)
    first = list(islice(every, 2))
    if count == 1 or len(first) < 2:
        # A single item needs no thread.
        yield from map(work, chain(first, every))
        return
    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(count) as pool:
        for item in chain(first, every):
            waiting.append(pool.submit(work, item))
            if len(waiting) > count * _QUEUED_PER_THREAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
