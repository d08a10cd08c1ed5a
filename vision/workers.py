"""Work shared out to the processor's cores; the numerical libraries let go of the interpreter."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

__all__ = ["side_by_side"]

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
    if count == 1:
        yield from map(work, items)
        return
    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(count) as pool:
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > count * _AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
