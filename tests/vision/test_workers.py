import threading
from collections.abc import Iterator

import pytest

from metrology.compiled import side_by_side


def test_results_come_in_the_order_of_the_items() -> None:
    assert list(side_by_side(lambda number: number**2, range(50))) == [n**2 for n in range(50)]


def test_no_more_items_are_taken_than_keep_the_workers_busy() -> None:
    taken = 0

    def items() -> Iterator[int]:
        nonlocal taken
        for number in range(1000):
            taken += 1
            yield number

    results = side_by_side(lambda number: number, items())
    assert next(results) == 0
    assert taken < 20


def test_a_failure_is_handed_on() -> None:
    def fail(number: int) -> int:
        raise ValueError(f"{number} in {threading.current_thread().name}")

    with pytest.raises(ValueError, match="0 in"):
        list(side_by_side(fail, range(3)))


def test_one_thing_alone_starts_no_worker() -> None:
    def where(_: int) -> threading.Thread:
        return threading.current_thread()

    here = threading.current_thread()
    assert list(side_by_side(where, [1])) == [here]
    assert here not in list(side_by_side(where, range(4)))
