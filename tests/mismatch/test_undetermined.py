"""A law in no catalogue whose place leaves its strength open is no sure answer."""

import numpy as np
import pytest

from mismatch.candidates import Candidate
from mismatch.fitting.fit import Fit, free_parameters
from mismatch.fitting.hypotheses import Hypothesis
from mismatch.forward import Model
from mismatch.search.unnamed import Notch
from mismatch.verdict import _undetermined


@pytest.mark.parametrize(("std", "open_"), [(0.1, False), (0.24, True)])
def test_a_torque_squeezed_against_the_contact_is_not_known(std, open_):
    notch = Notch()
    values = {"strength": -0.44, "place": 0.115, "reach": 0.024}
    model = Model(((notch, values),))
    fit = Fit(
        model, np.zeros((4, 4)), np.zeros((0, 2)), 100.0, 0.0, 100, 100.0, free_parameters(model),
        np.diag([std, 0.015, 0.012]) ** 2, np.zeros((4, 25)),
    )  # fmt: skip
    answer = Hypothesis((Candidate(notch, (("place", 0.1), ("reach", 0.03)), 26),), fit, 300.0)
    assert _undetermined(answer) is open_
