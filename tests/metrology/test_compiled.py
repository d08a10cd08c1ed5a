import subprocess
import sys

from metrology.compiled import compiled


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


def test_a_comparison_with_no_number_is_false() -> None:
    @compiled
    def inside(x: float) -> bool:
        return x > 1.0 and x < 2.0

    assert not inside(float("nan"))
    assert inside(1.5)
