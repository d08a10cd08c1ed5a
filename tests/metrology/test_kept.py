"""Results of repeated steps."""

import numpy as np

from metrology.kept import KeptResults


def test_a_step_is_computed_again_only_for_other_inputs() -> None:
    kept, computed = KeptResults(), list[float]()

    def summed(values: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> float:
        def compute() -> float:
            computed.append(float(values.sum()))
            return computed[-1]

        return kept.once("sum", (values, "m"), compute)

    one, other = np.array([1.0, 2.0]), np.array([1.0, np.nextafter(2.0, 3.0)])
    assert summed(one) == summed(one.copy()) == 3.0
    assert len(computed) == 1
    assert summed(other) > 3.0
    assert kept.once("product", (other, "m"), lambda: 2.0) == 2.0
    assert summed(one) == 3.0
    assert len(computed) == 3
