"""Restitution laws and their text form."""

import math

import numpy as np
import pytest

from metrology import DomainError, UsageError
from physics.bodies import BASKETBALL, JOKKU
from physics.restitution import (
    ConstantCor,
    ExponentialCor,
    PowerLawCor,
    ShiftedCor,
    parse_cor_law,
)


def test_the_laws_of_ryu_et_al() -> None:
    assert JOKKU.cor(2.0) == pytest.approx(0.1305 * math.exp(-0.2685 * 2 - 0.1953) + 0.6746)
    assert BASKETBALL.cor(0.0) == pytest.approx(0.2235 * math.exp(-0.7226) + 0.8327)
    assert isinstance(JOKKU.cor, ExponentialCor)
    assert JOKKU.cor.at_rest.value == pytest.approx(float(JOKKU.cor(0.0)))


@pytest.mark.parametrize("law", [JOKKU.cor, PowerLawCor(0.2), ConstantCor(0.8)])
def test_laws_take_floats_and_arrays(law: ExponentialCor) -> None:
    speeds = np.array([[1.0, 2.0], [3.0, 4.0]])
    values = law(speeds)
    assert values.shape == speeds.shape
    assert values[1, 0] == law(3.0)


def test_text_is_parsed_as_a_formula() -> None:
    law = parse_cor_law("0.1305*exp(-0.2685*v - 0.1953) + 0.6746")
    speeds = np.linspace(0.1, 6.0, 20)
    np.testing.assert_allclose(law(speeds), JOKKU.cor(speeds), rtol=1e-15)
    assert parse_cor_law("0.75")(3.0) == 0.75
    assert parse_cor_law(0.75)(3.0) == 0.75
    assert parse_cor_law("1 - 0.1*v^0.2")(1.0) == pytest.approx(0.9)
    assert parse_cor_law("max(0.5, 0.9 - 0.1*v)")(10.0) == 0.5


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "v.__class__",
        "exp.__call__(v)",
        "[v][0]",
        "lambda: v",
        "(x := v)",
        "exp(v, v)",
        "exp(x=v)",
        "open('x')",
        "v if v else 1",
        "f'{v}'",
        "0.8 +",
        "u",
        "True",
        "1j",
        "",
        "0.5" + "+0.1" * 500,
    ],
)
def test_text_that_is_no_formula_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        parse_cor_law(text)


@pytest.mark.parametrize("value", ["0", "-0.5", "1.01", "nan", "inf"])
def test_numbers_outside_zero_to_one_are_refused(value: str) -> None:
    with pytest.raises(DomainError):
        parse_cor_law(value)


@pytest.mark.parametrize("text", ["1/(v-1)", "v**v**v**v", "log(0*v)", "2*v", "-v"])
def test_a_law_without_a_valid_value_is_an_error_not_a_nan(text: str) -> None:
    with pytest.raises(DomainError):
        parse_cor_law(text)(1.0 if text != "v**v**v**v" else 9.0)


def test_a_shifted_law_turns_about_its_pivot() -> None:
    law = ShiftedCor(ConstantCor(0.8), offset=0.01, slope=-0.02, pivot_speed=2.0)
    assert law(2.0) == pytest.approx(0.81)
    assert law(3.0) == pytest.approx(0.79)
