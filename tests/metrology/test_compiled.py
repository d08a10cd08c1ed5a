"""Compiled functions and the deferred import of the compiler."""

import resource
import subprocess
import sys
from collections.abc import Callable

import pytest
from numba.core.caching import Cache

from metrology.compiled import compiled, with_stack_space


@compiled
def _twice(value: float) -> float:
    return 2.0 * value


@compiled
def _thrice(value: float) -> float:
    return _twice(value) + value


def test_a_compiled_function_calls_another() -> None:
    assert _thrice(1.5) == 4.5
    assert _thrice.__name__ == "_thrice"


def test_the_compiler_is_loaded_when_the_first_loop_runs() -> None:
    script = "import sys, vision.following; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", script], check=True)


def test_a_numba_without_what_is_private_to_it_loads_its_own_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []
    monkeypatch.delattr(Cache, "_load_overload")
    monkeypatch.setattr(Cache, "load_overload", lambda *_: asked.append(1))
    assert compiled(_halved)(3.0) == 1.5
    assert asked


def _halved(value: float) -> float:
    return 0.5 * value


def test_a_comparison_with_no_number_is_false() -> None:
    @compiled
    def inside(x: float) -> bool:
        return x > 1.0 and x < 2.0

    assert not inside(float("nan"))
    assert inside(1.5)


_TURNS = 2000


def _nothing() -> None:
    pass


# larger than any of the calls below which it is called, so that at some depth it does not fit
_nothing.__code__ = _nothing.__code__.replace(co_stacksize=100)


def _below(calls: int) -> int:
    """Times that memory was asked for in a loop below so many calls."""
    if calls:
        return _below(calls - 1)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(_TURNS):
        _nothing()
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def _at_any_depth(below: Callable[[int], int]) -> list[int]:
    return [below(calls) for calls in range(300)]


def test_calls_with_a_workspace_allocate_no_memory() -> None:
    most = with_stack_space(lambda: max(_at_any_depth(_below)))
    assert most() < _TURNS // 10
    if sys.version_info < (3, 13):
        assert max(_at_any_depth(_below)) >= _TURNS


@compiled
def _left_of_a_product(x: float, y: float, z: float) -> float:
    return x * y - z


def test_arithmetic_is_rounded_as_written() -> None:
    """Joined into one operation the product would keep 2**-60; a code's copies differ in that."""
    assert _left_of_a_product(1.0 + 2.0**-30, 1.0 - 2.0**-30, 1.0) == 0.0
